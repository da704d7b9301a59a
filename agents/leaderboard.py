"""Trained agents and analytic schedulers in one table: ``python -m agents.leaderboard [ID ...]``.

Plays the saved agents of each environment (results/runs/ENVIRONMENT/ppo and dqn) on the worlds on which ``make
headroom`` played the schedulers. The tables of both are in docs/learned.md, the episodes in results/leaderboard.
``--times`` only repeats the timing of decisions, on an otherwise idle machine. ``--tables`` renews the tables without
playing.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents import blocks
from agents.timing import ALONE, decisions_us
from wavegym.core.arrays import Array
from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import check_choice
from wavegym.core.files import write_whole
from wavegym.core.work import add_worker_options, workers
from wavegym.core.worlds import word
from wavegym.evaluation import compare, full_id, make_task, statistics
from wavegym.evaluation.adapters import AGENTS, SAVED
from wavegym.evaluation.comparison import BASELINE
from wavegym.evaluation.consistency import consistency, reversals
from wavegym.evaluation.headroom import WORLDS
from wavegym.evaluation.play import EpisodeResults
from wavegym.evaluation.report import TABLE, compressed, read_results
from wavegym.evaluation.table import (
    decimal,
    estimated,
    flagged,
    interval,
    number,
    shared,
    signed,
    tabulated,
)
from wavegym.policies import runs
from wavegym.policies.runs import RUN, load_policy, read_run
from wavegym.registration import SYSTEMS, stem
from wavegym.schedulers.tuned_constants import PLANNER, SIMPLE, recorded

ROOT = Path(__file__).parents[1]
HEADROOM, LEADERBOARD = ROOT / "results" / "headroom", ROOT / "results" / "leaderboard"
PAGE = ROOT / "docs" / "learned.md"
START, END = "<!-- made by `make leaderboard`: -->", "<!-- to here -->"
SEED = 0  # of the worlds of `make headroom`
LEAST = -1.0  # per cent; a planner that gains less does not count as better
SHARED = -5.0  # per cent; of a smaller gain of the planner PPO's share is not computed


def play(env_id: str, jobs: int) -> None:
    """Play the environment's saved agents; the episodes go to results/leaderboard."""
    files = {}
    for algo, folder in saved(env_id).items():
        parameters = environment_of(folder)
        comparison = compare(env_id, {algo: folder}, worlds=WORLDS, jobs=jobs, keep=LEADERBOARD, **parameters)
        files[f"{stem(env_id)}-{algo}{TABLE}"] = compressed(comparison.by_policy())
    write_whole(LEADERBOARD, files)


def time_decisions(env_id: str) -> None:
    """Time the decisions of the best planner and of each saved agent; the times go to results/leaderboard."""
    agents = {}
    for algo, folder in saved(env_id).items():
        system = make_task(env_id, environment_of(folder)).system
        agents[algo] = system, load_policy(folder, env_id, system)[0]
    times = {"us_per_decision": decisions_us(make_task(env_id, {}).system, agents)}
    write_whole(LEADERBOARD, {f"{stem(env_id)}.json": (json.dumps(times, indent=2) + "\n").encode()})


def saved(env_id: str) -> dict[str, Path]:
    """The folders of the environment's saved agents by algorithm."""
    folders = {algo: SAVED / stem(env_id) / algo for algo in AGENTS}
    return {algo: folder for algo, folder in folders.items() if folder.is_dir()}


def environment_of(folder: Path) -> dict[str, Any]:
    """The parameters in which the runs in a folder are played."""
    return runs.environment_of(first_run(folder))


def first_run(folder: Path) -> dict[str, Any]:
    """The record of the first training seed."""
    return read_run(min(folder.glob(f"*/{RUN}")))


class Entry(NamedTuple):
    """One environment's line."""

    env_id: str
    by_policy: dict[str, EpisodeResults]
    us: dict[str, float]  # per decision, by policy; empty if not timed

    def against(self, name: str, reference: str) -> statistics.Estimate:
        """Geometric mean of the paired ratios of the costs by belief, in per cent."""
        return against(self.by_policy[name].cost, self.by_policy[reference].cost)

    def error_against(self, name: str, reference: str) -> statistics.Estimate:
        """The same of the squared errors by truth."""
        return against(self.by_policy[name].squared_error, self.by_policy[reference].squared_error)

    def recovered(self, name: str) -> statistics.Estimate:
        """A policy's share of the planner's gain over the best heuristic; None if that is small or not significant.

        The gains are logarithms of cost ratios, so that a share means the same in environments with large and small
        gains.
        """
        gain = self.against(PLANNER, SIMPLE)
        if gain.value is None or gain.ci is None or gain.ci[1] >= 0.0 or gain.value > SHARED:
            return statistics.Estimate(None, None)
        own, others = (np.log(self.by_policy[each].cost / self.by_policy[SIMPLE].cost) for each in (name, PLANNER))
        return statistics.ratio(own, np.broadcast_to(others, own.shape), _bootstrap())


def names_played(env_id: str) -> dict[str, Any]:
    """The record of tuned constants that `make headroom` used; a newer record may have other best policies."""
    file = HEADROOM / f"{env_id.rpartition('/')[2]}.json"
    if file.exists():
        return dict(json.loads(file.read_text(encoding="utf-8"))["tuned_constants"])
    return recorded(make_task(env_id, {}).system)


def against(values: Array, reference: Array) -> statistics.Estimate:
    """Geometric mean of the paired ratios of (member, world) values, in per cent, with its interval."""
    return statistics.difference(values, reference, _bootstrap()).geometric


def _bootstrap() -> np.random.Generator:
    return np.random.default_rng([SEED, word("bootstrap")])


def simple_cost(name: str) -> Array:
    """The best heuristic's costs, (member, world), in the latest version of an environment."""
    file = HEADROOM / f"{full_id(name).rpartition('/')[2]}{TABLE}"
    cost: Array = read_results(file)[SIMPLE].cost
    return cost


def entry(env_id: str) -> Entry:
    """The results in one environment."""
    name = env_id.rpartition("/")[2]
    by_policy = read_results(HEADROOM / f"{name}{TABLE}")
    for algo in AGENTS:
        file = LEADERBOARD / f"{stem(env_id)}-{algo}{TABLE}"
        if file.exists():
            read = read_results(file)
            by_policy |= {algo: read[algo], _rival(algo): read[BASELINE]}
    times = LEADERBOARD / f"{stem(env_id)}.json"
    us = json.loads(times.read_text(encoding="utf-8"))["us_per_decision"] if times.exists() else {}
    return Entry(env_id, by_policy, us)


Comparer = Callable[[Entry, str, str], statistics.Estimate]  # of two policies by name
COMPARERS: tuple[Comparer, ...] = (Entry.against, Entry.error_against)
PAIRS = ("PPO", "95 %", "DQN", "95 %")
COMPARED = ("best planner", "95 %", *PAIRS)
SAME = 0.005  # per cent; costs that differ by less look equal in print
ALONE_STEPS = 1000  # a training with a teacher and without further steps is only imitation


def established(entries: Sequence[Entry], figure: str) -> set[tuple[str, str]]:
    """(environment, policy): differences from the best heuristic that hold in a whole table, by Holm's procedure.

    Args:
        entries: of the table.
        figure: "cost" or "squared_error".
    """
    family = [
        (e.env_id, name, statistics.p_value(*(getattr(e.by_policy[each], figure) for each in (name, SIMPLE))))
        for e in entries
        for name in (PLANNER, *AGENTS)
        if name in e.by_policy
    ]
    hold = statistics.established([p for *_, p in family])
    return {(env_id, name) for (env_id, name, _), holds in zip(family, hold, strict=True) if holds}


def table(entries: Sequence[Entry]) -> str:
    """One line for each environment: the cost of each policy by belief against the best heuristic."""
    rows, sure = [], established(entries, "cost")
    for e in entries:
        simple = names_played(e.env_id).get(SIMPLE, SIMPLE)
        share = e.recovered("ppo") if "ppo" in e.by_policy else statistics.Estimate(None, None)
        rows.append([_short(e), simple, *_against_simple(e, Entry.against, sure), *shared(share)])
    head = ["environment", "best heuristic", "myopic", *COMPARED, "PPO recovers", "95 %"]
    return tabulated(head, rows)


def scores(e: Entry) -> str:
    """The scores on an environment's page: the best known policy, and the policies against the best heuristic."""
    shown_as = _shown_as(e)
    by_belief = {name: e.against(name, SIMPLE) for name in shown_as}
    order = sorted(by_belief, key=lambda name: by_belief[name].value or 0.0)
    better = [name for name in order if (ci := by_belief[name].ci) is not None and ci[1] < 0.0]
    rows = []
    for name in order:
        mean = number(statistics.finite(np.mean(e.by_policy[name].cost)))
        rows.append([shown_as[name], mean, *estimated(by_belief[name]), *estimated(e.error_against(name, SIMPLE))])
    head = ["policy", "mean cost", "cost %", "95 %", "squared error by truth %", "95 %"]
    best = shown_as[next(iter(better), SIMPLE)]
    against_what = f"the best heuristic, {shown_as[SIMPLE]}, in the same {WORLDS} worlds"
    return f"Best known: {best}. Policies against {against_what} (geometric means):\n\n{tabulated(head, rows)}"


def _shown_as(e: Entry) -> dict[str, str]:
    """The names of the policies in ``scores``; if the one-step scheduler is the best heuristic, it is listed once."""
    names = names_played(e.env_id)
    found = {name: f"`{name}`" for name in ("random", BASELINE) if name != names[SIMPLE]}
    found |= {name: f"`{names[name]}`" for name in (SIMPLE, PLANNER)}
    for algo in filter(e.by_policy.__contains__, AGENTS):
        parameters = _given(environment_of(SAVED / stem(e.env_id) / algo))
        found[algo] = f"`{algo}`, {parameters}" if parameters else f"`{algo}`"
    return found


def errors(entries: Sequence[Entry]) -> str:
    """One line for each environment: error by truth against the best heuristic, and targets lost per episode."""
    played = (SIMPLE, PLANNER, *AGENTS)
    rows, sure = [], established(entries, "squared_error")
    for e in entries:
        losses = [np.mean(e.by_policy[name].lost) if name in e.by_policy else np.nan for name in played]
        lost = [decimal(statistics.finite(loss)) for loss in losses]
        rows.append([_short(e), *_against_simple(e, Entry.error_against, sure), *lost])
    head = ["environment", "myopic", *COMPARED, "lost: best-simple", "planner", "PPO", "DQN"]
    return tabulated(head, rows)


def foresight(e: Entry) -> str:
    """Whether the best planner costs less than the best heuristic, by ``LEAST`` or more, in a few words."""
    gain, error = e.against(PLANNER, SIMPLE), e.error_against(PLANNER, SIMPLE)
    if gain.value is None or gain.ci is None:
        return ""
    if gain.ci[1] < 0.0 and gain.value <= LEAST:
        is_true = error.ci is not None and error.ci[1] < 0.0
        return f"yes, {signed(-gain.value).removeprefix('+')} %{'' if is_true else ' by belief'}"
    if max(map(abs, gain.ci)) < SAME:
        return "no: saturated"
    return "no" if gain.ci[0] > LEAST else f"not shown ({interval(gain.ci, signed)} %)"


def orders(entries: Sequence[Entry]) -> str:
    """The environments in which belief and truth rank two policies differently."""
    return blocks.order_list({_short(e): reversals(e.by_policy, SEED) for e in entries})


def teachers(entries: Sequence[Entry]) -> str:
    """One line for each environment: from what its agents learn."""
    rows = [[_short(e), *(learns_from(e.env_id, algo) for algo in AGENTS)] for e in entries]
    return tabulated(["environment", "PPO learns from", "DQN learns from"], rows)


def learns_from(env_id: str, algo: str) -> str:
    """What the agent learns from: rewards, a teacher that it imitates first, or both; "" without a saved agent."""
    if algo not in saved(env_id):
        return ""
    folder = saved(env_id)[algo]
    teacher = first_run(folder)["settings"]["teacher"]
    return {"scratch": "rewards", "imitation": f"`{teacher}` alone", "both": f"`{teacher}`, then rewards"}[
        stage_of(folder)
    ]


def stage_of(folder: Path) -> str:
    """From what the runs in a folder learn: rewards ("scratch"), a teacher ("imitation") or "both"."""
    settings = first_run(folder)["settings"]
    if not settings["teacher"]:
        return "scratch"
    return "imitation" if settings["steps"] <= ALONE_STEPS else "both"


def consistency_table(entries: Sequence[Entry]) -> str:
    """One line for each environment: the mean NEES under each policy, flagged if it is outside its bounds."""
    head = ["environment", "expected NEES", "best-simple", "95 %", "planner", "95 %", *PAIRS]
    rows = []
    for e in entries:
        dimension = make_task(e.env_id, {}).system.nees_dimension
        cells = [cell for name in (SIMPLE, PLANNER, *AGENTS) for cell in _nees(e.by_policy.get(name), dimension)]
        rows.append([_short(e), "" if dimension is None else str(dimension), *cells])
    return tabulated(head, rows)


def medians(entries: Sequence[Entry]) -> str:
    """One line for each environment: medians of the cost ratios, which do not depend on a few extreme worlds."""
    rows = []
    for e in entries:
        simple = e.by_policy[SIMPLE].cost
        ratios = {name: e.by_policy[name].cost / simple for name in (PLANNER, *AGENTS) if name in e.by_policy}
        found = {name: statistics.finite(np.median(100.0 * (ratio - 1.0))) for name, ratio in ratios.items()}
        rows.append([_short(e), *(signed(found[name]) if name in found else "" for name in (PLANNER, *AGENTS))])
    return tabulated(["environment", "median: best planner", "PPO", "DQN"], rows)


def details(entries: Sequence[Entry]) -> str:
    """One line for each environment: training seeds and time per decision."""
    rows = []
    for e in entries:
        seeds = ", ".join(str(len(e.by_policy[algo].cost)) for algo in AGENTS if algo in e.by_policy)
        took = [f"{e.us[name]:.0f}" if name in e.us else "" for name in (ALONE, PLANNER, "ppo")]
        ratio = f"{e.us[ALONE] / e.us['ppo']:.0f}" if ALONE in e.us and "ppo" in e.us else ""
        rows.append([_short(e), seeds, *took, ratio])
    return tabulated(["environment", "seeds", "µs: planner", "in batch", "PPO", "ratio"], rows)


def libraries(entries: Sequence[Entry]) -> str:
    """One line for each agent with other actions than the schedulers: against myopic with these actions."""
    head = ["environment", "agent", "parameters", "myopic there", "agent by belief", "95 %", "by truth", "95 %"]
    rows = []
    for e in entries:
        for algo in filter(e.by_policy.__contains__, AGENTS):
            if parameters := environment_of(SAVED / stem(e.env_id) / algo):
                shown_parameters = _given(parameters)
                there = signed(e.against(_rival(algo), SIMPLE).value)
                own = [cell for comparer in COMPARERS for cell in estimated(comparer(e, algo, _rival(algo)))]
                rows.append([stem(e.env_id), algo.upper(), shown_parameters, there, *own])
    return tabulated(head, rows)


def _given(parameters: dict[str, Any]) -> str:
    return ", ".join(f"{name}={value}" for name, value in parameters.items())


def _against_simple(e: Entry, comparer: Comparer, sure: set[tuple[str, str]]) -> list[str]:
    """Myopic, the best planner and the agents against the best heuristic; what is ``established`` has a star."""
    cells = [signed(comparer(e, BASELINE, SIMPLE).value)]
    for name in (PLANNER, *AGENTS):
        value, ends = estimated(comparer(e, name, SIMPLE)) if name in e.by_policy else ["", ""]
        cells += [f"{value} \\*" if (e.env_id, name) in sure else value, ends]
    return cells


def _short(e: Entry) -> str:
    return e.env_id.rpartition("/")[2]


def _rival(algo: str) -> str:
    """The name of the one-step scheduler's results with the agent's actions."""
    return f"{BASELINE} for {algo}"


def _nees(results: EpisodeResults | None, dimension: int | None) -> list[str]:
    if results is None:
        return ["", ""]
    found = consistency(results, dimension, _bootstrap())
    return [flagged(found.nees.value, found.flag), interval(found.nees.ci, number)]


def renew(env_ids: Sequence[str]) -> None:
    """Renew the tables in docs/learned.md."""
    entries = [entry(env_id) for env_id in env_ids]
    parts = blocks.both(table(entries), errors(entries)), orders(entries), teachers(entries), medians(entries)
    more = consistency_table(entries), details(entries), libraries(entries)
    blocks.renew(PAGE, START, END, "\n\n".join([*parts, *more]))


def play_and_renew(
    parser: Parser, played: Path, play: Callable[[str, int], None], renew: Callable[[Sequence[str]], None]
) -> None:
    """A command that plays some environments and renews the table of all.

    Args:
        parser: of the command line, without options yet.
        played: folder with a table ID.csv or ID.csv.xz for each environment that may be named.
        play: of the environment's name and the number of processes.
        renew: of all names.
    """
    known = sorted({file.name.partition(".")[0].rpartition("-v")[0] for file in played.glob("*.csv*")})
    parser.add_argument("names", nargs="*", metavar="ENVIRONMENT", help="which (default: all)")
    add_worker_options(parser, jobs=2)
    parser.add_argument("--tables", action="store_true", help="renew the tables from earlier results; play nothing")
    read = parser.read(None)
    for name in () if read.tables else read.names or known:
        with workers(read):
            play(check_choice("environment", name, known), read.jobs)
    renew(known)


def main() -> None:
    """The command."""
    parser = Parser(
        prog="python -m agents.leaderboard", description="Trained agents and analytic schedulers in one table."
    )
    ladders = [env_id for env_id in SYSTEMS if (HEADROOM / f"{env_id.rpartition('/')[2]}{TABLE}").exists()]
    wanted = "environments (default: those of the suite that `make headroom` played)"
    parser.add_argument("ids", nargs="*", metavar="ID", default=ladders, help=wanted)
    add_worker_options(parser, jobs=2)
    parser.add_argument("--times", action="store_true", help="time decisions, play nothing")
    parser.add_argument("--tables", action="store_true", help="renew the tables from earlier results; play nothing")
    read = parser.read(None)
    for env_id in map(full_id, () if read.tables else read.ids):
        if not read.times:
            with workers(read):
                play(env_id, read.jobs)
        time_decisions(env_id)
    renew(ladders)


if __name__ == "__main__":
    sys.exit(guarded(main))
