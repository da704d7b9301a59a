"""The multifunction radar against its load: ``python -m agents.loads [LOAD ...]``.

For each expected number of targets all policies play the same test worlds. Heuristics have the recorded constants, and
agents were trained, at the registered load. Results are written to results/loads, tables and picture to
docs/multifunction_radar.md.

``--planners`` plays the planners at one load, in few worlds, because a decision takes up to 0.1 s. ``--shifts``
changes the radar or the targets at one load, with the same constants and agents. ``--agents`` plays only the agents and
the best rule again. ``--times`` only times the decisions again, on an otherwise idle machine. ``--tables`` renews the
page without playing.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from scipy.stats import chi2

from agents.blocks import read_results
from agents.dwell_bound import Relaxation
from agents.leaderboard import ROOT
from agents.loads_page import BASE, COST_PARTS, FOLDER, LOADS, SIMPLE, renew
from wavegym.core.arrays import Array
from wavegym.core.command_line import Parser, guarded
from wavegym.core.files import write_whole
from wavegym.core.policy import Policy
from wavegym.core.worlds import draw_worlds, word, world_seeds
from wavegym.envs.vector import WaveformVectorEnv
from wavegym.evaluation import make_task, statistics
from wavegym.evaluation.play import Played, Task, play
from wavegym.policies.runs import load_policy
from wavegym.schedulers import RandomChoice
from wavegym.schedulers.heuristics.grids import HEURISTICS, TIMELINE
from wavegym.schedulers.planners.rollout import DwellRollout
from wavegym.schedulers.tuned_constants import recorded
from wavegym.systems.multifunction_radar.step_kernels import SEARCH, UPDATE
from wavegym.systems.multifunction_radar.system import MultifunctionRadar

NAME = "MultifunctionRadar"
ENV_ID = f"wavegym/{NAME}-v1"
RUNS = ROOT / "results" / "runs" / NAME
WORLDS, SEED = 60, 0
TIMED = 300  # decisions of one environment
QUANTILE = 0.99  # of the chi-squared distribution
BOUND_TARGETS = 360  # greatest number of paths in one lower bound
PLANNED_LOAD, PLANNED_WORLDS, PLANNED_SECONDS = 16, 8, 20.0
PLANNERS = ((1, 2), (2, 8), (8, 16))  # futures and tried dwells: about 1, 10 and 100 ms
PLANNED_DECISIONS = 50
SHIFTED_LOAD, SHIFTED_HEURISTICS = 16, (SIMPLE, "van-keuk-blackman", BASE)
MORE_TIME = 1.1
SHIFTS: dict[str, dict[str, Any]] = {
    "none": {},
    "10 % more time": {  # the same energy of the same pulses in a shorter time
        "interval": 320e-6 / MORE_TIME,
        "overhead": 1e-3 / MORE_TIME,
        "reference_range": 160e3 * MORE_TIME**0.25,
    },
    "beam of 1.1 deg": {"beam_width": 1.1},
    "beam of 2 deg": {"beam_width": 2.0},
    "half the energy": {"reference_range": 160e3 * 0.5**0.25},
    "three quarters of the pulses": {"pulses": (12, 36, 96, 24)},
    "manoeuvres of twice the acceleration": {"acceleration": (8.0, 120.0)},
    "manoeuvres that last 0.5 s": {"leave": (0.5, 2.0)},
}


def results_of(load: int, worlds: int) -> dict[str, Any]:
    """All policies on the test worlds of one load."""
    task = make_task(ENV_ID, {"targets": float(load)})
    played = _compared(task, _policies(task), world_seeds(SEED, "test", worlds), BASE, TIMED)
    blind = _blind_search(task.system, played[BASE]["searched"])
    return {"load": load, "worlds": worlds, "policies": played, "bound": _bound(task.system, load), "blind": blind}


def agents_again(results: Mapping[str, Any]) -> dict[str, Any]:
    """The results of one load with agents that play now, on the same worlds."""
    task, seeds = make_task(ENV_ID, {"targets": float(results["load"])}), world_seeds(SEED, "test", results["worlds"])
    policies = {**_heuristics([BASE]), **_agents(task)}
    return {**results, "policies": {**results["policies"], **_compared(task, policies, seeds, BASE, TIMED)}}


def timed_again(results: Mapping[str, Any]) -> dict[str, Any]:
    """The results of one load with times of decisions that are measured now."""
    task = make_task(ENV_ID, {"targets": float(results["load"])})
    played = {
        name: {**results["policies"][name], "microseconds": _microseconds(task, members, TIMED)}
        for name, members in _policies(task).items()
    }
    return {**results, "policies": played}


def _policies(task: Task) -> dict[str, list[Policy]]:
    """Everything that is played at a load, each a list of members."""
    return {"random": [RandomChoice()], **_heuristics(TIMELINE), **_agents(task)}


def _heuristics(names: Iterable[str]) -> dict[str, list[Policy]]:
    """With the constants of the registered load."""
    constants = recorded(MultifunctionRadar())
    return {name: [HEURISTICS[name].make(**constants[name])] for name in names}


def _agents(task: Task) -> dict[str, list[Policy]]:
    """The trained agents of results/experiments.toml, each a list of seeds."""
    return {folder.name: load_policy(folder, ENV_ID, task.system) for folder in sorted(RUNS.glob("*"))}


def _compared(
    task: Task, policies: Mapping[str, list[Policy]], seeds: list[int], reference: str, timed: int
) -> dict[str, Any]:
    """Costs and figures of each policy's members on the same worlds; costs also against those of a reference."""
    played, costs = dict[str, Any](), dict[str, Array]()
    for name, members in policies.items():
        watched = [_play(task, member, seeds) for member in members]
        costs[name] = np.stack([record.episode_cost() for record, _ in watched]) / task.system.c0  # type: ignore[attr-defined]
        squares = np.stack([record.gospa**2 for record, _ in watched]) / task.system.c0  # type: ignore[attr-defined]
        played[name] = {
            "belief": _estimate(costs[name]),
            "truth": _estimate(squares),
            "nees": _estimate(np.stack([record.nees for record, _ in watched])),
            "lost": float(np.mean([record.lost for record, _ in watched])),
            **{key: float(np.mean([figures[key] for _, figures in watched])) for key in watched[0][1]},
            "microseconds": _microseconds(task, members, timed),
        }
    for name, figures in played.items():
        figures["against"] = statistics.difference(costs[name], costs[reference], _rng()).percent._asdict()
    return played


def _bound(system: Any, load: int) -> dict[str, Any]:
    """The lower bound by truth, on the first of the test worlds."""
    count = max(BOUND_TARGETS // (2 * load), 4)
    found = Relaxation(system, draw_worlds(system, world_seeds(SEED, "test", count))).solve()
    return {"worlds": count, "gap": found.gap, **_estimate(found.worlds[None])}


def _blind_search(system: Any, share: float) -> dict[str, float]:
    """Lower bounds of the cost of undetected targets by belief, in the long run.

    With all of the time, and with the share of it that the best rule searches.
    """
    shares = {"all of the time": 1.0, f"{100.0 * share:.0f} % of the time": share}
    return {name: system.best_search(each).least for name, each in shares.items()}


def planners_of(load: int) -> dict[str, Any]:
    """The planners and the heuristic that they follow, on the same worlds."""
    task = make_task(ENV_ID, {"targets": float(load), "seconds": PLANNED_SECONDS})
    policies = _heuristics((BASE,))
    base: Any = policies[BASE][0]
    planners = {f"dwell-rollout:{futures}, {tried} dwells": (futures, tried) for futures, tried in PLANNERS}
    policies |= {name: [DwellRollout(base, *settings)] for name, settings in planners.items()}
    policies |= _agents(task)
    played = _compared(task, policies, world_seeds(SEED, "test", PLANNED_WORLDS), BASE, PLANNED_DECISIONS)
    return {
        "load": load,
        "worlds": PLANNED_WORLDS,
        "seconds": PLANNED_SECONDS,
        "shortest_dwell": float(task.system.dwells.menu[3].min()),  # type: ignore[attr-defined]
        "policies": played,
    }


def shifts_of(load: int, worlds: int) -> dict[str, Any]:
    """Heuristics and agents of one load in changed environments, whose parameters the tracker and prediction know."""
    found = {}
    for name, changes in SHIFTS.items():
        task = make_task(ENV_ID, {"targets": float(load), **changes})
        policies = _heuristics(SHIFTED_HEURISTICS) | _agents(task)
        found[name] = _compared(task, policies, world_seeds(SEED, "test", worlds), BASE, TIMED)
    return {"load": load, "worlds": worlds, "shifts": found}


def _play(task: Task, policy: Policy, seeds: list[int]) -> tuple[Played, dict[str, float]]:
    """The record, and figures from the info.

    These are the mean number of false tracks, the seconds until confirmation at the end, the share of NEES beyond the
    0.99 quantile, the shares of time in searches and in updates, and the shares of the parts of the cost.
    """
    system: Any = task.system
    false, delay, beyond, parts = [], np.zeros(len(seeds)), [], np.zeros(len(COST_PARTS))
    kind, spent = system.dwells.menu[0], np.zeros(3)
    quantile = chi2.ppf(QUANTILE, task.system.nees_dimension)

    def watch(env: WaveformVectorEnv, info: Mapping[str, Array], running: Array) -> None:
        false.append(np.sum((info["false_tracks"] * info["duration"])[running]))
        delay[running] = info["confirm_delay"][running]
        nees = info["nees"][running][info["present"][running]]
        beyond.append([np.sum(nees > quantile), len(nees)])
        if "waveform" in info:  # not after the reset
            np.add.at(spent, kind[info["waveform"]][running], info["duration"][running])
            parts[:] += [info[f"cost_{part}"][running].sum() for part in COST_PARTS]

    played = play(task, policy, seeds, watch=watch)
    many, of_all = np.sum(beyond, axis=0)
    return played, {
        "false_tracks": float(np.sum(false) / played.span.sum()),
        "confirm": float(delay.mean()),
        "beyond": float(many / of_all),
        "searched": float(spent[SEARCH] / played.span.sum()),
        "updated": float(spent[UPDATE] / played.span.sum()),
        **dict(zip(COST_PARTS, (parts / parts.sum()).tolist(), strict=True)),
    }


def _microseconds(task: Task, members: list[Policy], timed: int) -> float:
    """CPU time of a decision, the least of all members."""
    return 1e6 * min(_decision_seconds(task, member, timed) for member in members)


def _decision_seconds(task: Task, policy: Policy, timed: int) -> float:
    """Mean CPU time of a decision in one environment; it has tracks after ``TIMED`` dwells of a heuristic."""
    env = WaveformVectorEnv(task.system, 1)
    observation, _ = env.reset(seed=SEED)
    policy.begin(task.system, 1, np.random.default_rng(0))
    spent = 0.0
    heuristic: Policy = HEURISTICS[SIMPLE].make(**HEURISTICS[SIMPLE].start)
    heuristic.begin(task.system, 1, np.random.default_rng(0))
    for n in range(TIMED + timed):
        belief, mask = env.belief, env.action_masks()
        begin = time.process_time()
        action = (policy if n >= TIMED else heuristic).act(belief, observation, mask)
        spent += (time.process_time() - begin) * (n >= TIMED)
        observation = env.step(action)[0]
    return spent / timed


def _rng() -> np.random.Generator:
    return np.random.default_rng([SEED, word("bootstrap")])


def _estimate(values: Array) -> dict[str, Any]:
    return statistics.mean(values, _rng())._asdict()


def _write(name: str, content: Mapping[str, Any]) -> None:
    write_whole(FOLDER, {name: (json.dumps(content, indent=1) + "\n").encode()})


def main() -> None:
    """The command."""
    parser = Parser(prog="python -m agents.loads", description="The multifunction radar against its load.")
    parser.add_argument("loads", nargs="*", type=int, metavar="LOAD", help=f"targets (default: {LOADS})")
    parser.add_argument("--worlds", type=int, default=WORLDS, help=f"test worlds (default: {WORLDS})")
    parser.add_argument("--planners", action="store_true", help=f"play only the planners, at {PLANNED_LOAD} targets")
    parser.add_argument("--shifts", action="store_true", help=f"play only changed radars, at {SHIFTED_LOAD} targets")
    parser.add_argument("--agents", action="store_true", help=f"play only agents and {BASE} again")
    parser.add_argument("--times", action="store_true", help="time the decisions of earlier results; play nothing")
    parser.add_argument("--tables", action="store_true", help="renew the page from earlier results; play nothing")
    read = parser.read(None)
    if read.planners:
        _write("planners.json", planners_of(PLANNED_LOAD))
    if read.shifts:
        _write("shifts.json", shifts_of(SHIFTED_LOAD, read.worlds))
    for load in () if read.tables or read.planners or read.shifts else read.loads or LOADS:
        name = f"{load}.json"
        if read.times or read.agents:
            again = timed_again if read.times else agents_again
            _write(name, again(read_results(FOLDER / name)))
        else:
            _write(name, results_of(load, read.worlds))
    renew()


if __name__ == "__main__":
    sys.exit(guarded(main))
