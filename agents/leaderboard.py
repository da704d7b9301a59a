"""Trained agents and analytic schedulers in one table: ``python -m agents.leaderboard [ID ...]``.

Plays the saved agents of each environment (results/runs/ENVIRONMENT/ppo and dqn) on the worlds on which
``make headroom`` played the schedulers. The tables of both go to docs/learned.md and README. results/leaderboard keeps
the episodes. ``--times`` only repeats the timing of decisions, on an otherwise idle machine; ``--tables`` renews the
tables without playing.
"""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.timing import ALONE, decisions_us
from wavegym.core.arrays import Array
from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import InputError
from wavegym.evaluation import blocks, compare, full_id, make_task, statistics
from wavegym.evaluation.comparison import BASELINE
from wavegym.evaluation.files import write_whole
from wavegym.evaluation.report import episodes
from wavegym.evaluation.saved import LEARNERS, SAVED, stem
from wavegym.evaluation.table import interval, signed, tabulated
from wavegym.evaluation.worlds import word
from wavegym.policies.records import read_run
from wavegym.policies.runs import RUN, load_policy
from wavegym.registration import SYSTEMS
from wavegym.schedulers.tuned_constants import PLANNER, SIMPLE, recorded

ROOT = Path(__file__).parents[1]
HEADROOM, LEADERBOARD = ROOT / "results" / "headroom", ROOT / "results" / "leaderboard"
PAGE, README = ROOT / "docs" / "learned.md", ROOT / "README.md"
START, END = "<!-- made by `make leaderboard`: -->", "<!-- to here -->"
WORLDS, SEED = 200, 0  # those of `make headroom`


class Account(NamedTuple):
    """Costs and NEES of a policy, axis 0 = training run, axis 1 = world."""

    cost: Array  # (member, world), mean per step
    nees: Array  # (member, world); NaN if not measured

    def against(self, reference: Account) -> statistics.Estimate:
        """Geometric mean of the paired cost ratios, in per cent, with its interval."""
        rng = np.random.default_rng([SEED, word("bootstrap")])
        return statistics.difference(self.cost, reference.cost, rng).geometric

    def median_nees(self) -> float | None:
        """Median over episodes of the mean over steps; None if not measured. Lost tracks spoil a mean over episodes."""
        return None if np.isnan(self.nees).all() else float(np.nanmedian(self.nees))


def play(env_id: str, jobs: int) -> None:
    """Play the environment's saved agents; the episodes go to results/leaderboard."""
    files = {}
    for algo, folder in saved(env_id).items():
        settings = environment_of(folder)
        comparison = compare(env_id, {algo: folder}, worlds=WORLDS, jobs=jobs, **settings)
        files[f"{stem(env_id)}-{algo}.csv"] = episodes(comparison).encode()
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
    folders = {algo: SAVED / stem(env_id) / algo for algo in LEARNERS}
    return {algo: folder for algo, folder in folders.items() if folder.is_dir()}


def environment_of(folder: Path) -> dict[str, Any]:
    """The parameters in which the runs in a folder were trained."""
    run = read_run(next(iter(sorted(folder.glob(f"*/{RUN}")))))
    return dict(run["settings"]["environment"])


def read_accounts(file: Path) -> dict[str, Account]:
    """The accounts in an episodes.csv by policy; InputError if the file is missing."""
    if not file.exists():
        raise InputError(f"{file} is missing, expected it from `make headroom` or `python -m agents.leaderboard`")
    rows: dict[str, dict[int, list[tuple[float, float]]]] = {}
    with file.open(newline="", encoding="utf-8") as lines:
        for row in csv.DictReader(lines):
            members = rows.setdefault(row["policy"], {})
            members.setdefault(int(row["member"]), []).append((float(row["cost"]), float(row["nees"] or "nan")))
    values = {name: np.array([members[m] for m in sorted(members)]) for name, members in rows.items()}
    return {name: Account(table[:, :, 0], table[:, :, 1]) for name, table in values.items()}


class Entry(NamedTuple):
    """One environment's line."""

    env_id: str
    accounts: dict[str, Account]
    us: dict[str, float]  # per decision, by policy; empty if not timed

    def against(self, name: str, reference: str) -> statistics.Estimate:
        """See ``Account``; both policies by name."""
        return self.accounts[name].against(self.accounts[reference])

    def recovered(self, name: str) -> float | None:
        """The share of the planner's gain over the best simple heuristic; None if that gain is not significant."""
        gain = self.against(PLANNER, SIMPLE)
        if gain.value is None or gain.ci is None or gain.ci[1] >= 0.0 or gain.value > -1.0:
            return None
        own = self.against(name, SIMPLE).value
        return None if own is None else float(np.log1p(own / 100.0) / np.log1p(gain.value / 100.0))


def entry(env_id: str) -> Entry:
    """The results in one environment."""
    name = env_id.rpartition("/")[2]
    accounts = read_accounts(HEADROOM / f"{name}.csv")
    for algo in LEARNERS:
        file = LEADERBOARD / f"{stem(env_id)}-{algo}.csv"
        if file.exists():
            read = read_accounts(file)
            accounts |= {algo: read[algo], _rival(algo): read[BASELINE]}
    times = LEADERBOARD / f"{stem(env_id)}.json"
    us = json.loads(times.read_text(encoding="utf-8"))["us_per_decision"] if times.exists() else {}
    return Entry(env_id, accounts, us)


def table(entries: Sequence[Entry]) -> str:
    """One line for each environment: the cost of each policy against the best simple heuristic."""
    schedulers = ["best simple heuristic", "myopic", "best planner"]
    head = ["environment", *schedulers, "PPO", "95 %", "DQN", "95 %", "PPO recovers"]
    rows = []
    for e in entries:
        simple = recorded(make_task(e.env_id, {}).system).get(SIMPLE, SIMPLE)
        cells = [signed(e.against(name, SIMPLE).value) for name in (BASELINE, PLANNER)]
        for algo in LEARNERS:
            cells += _cells(e, algo)
        share = e.recovered("ppo") if "ppo" in e.accounts else None
        rows.append([e.env_id.rpartition("/")[2], simple, *cells, "" if share is None else f"{100 * share:.0f} %"])
    return tabulated(head, rows)


def details(entries: Sequence[Entry]) -> str:
    """One line for each environment: consistency of the filter and time per decision."""
    head = [
        "environment",
        "seeds",
        "NEES: best simple",
        "planner",
        "PPO",
        "DQN",
        "µs: planner",
        "in batch",
        "PPO",
        "ratio",
    ]
    rows = []
    for e in entries:
        nees = [_nees(e.accounts.get(name)) for name in (SIMPLE, PLANNER, *LEARNERS)]
        seeds = ", ".join(str(len(e.accounts[algo].cost)) for algo in LEARNERS if algo in e.accounts)
        took = [f"{e.us[name]:.0f}" if name in e.us else "" for name in (ALONE, PLANNER, "ppo")]
        ratio = f"{e.us[ALONE] / e.us['ppo']:.0f}" if ALONE in e.us and "ppo" in e.us else ""
        rows.append([e.env_id.rpartition("/")[2], seeds, *nees, *took, ratio])
    return tabulated(head, rows)


def libraries(entries: Sequence[Entry]) -> str:
    """One line for each agent with other actions than the schedulers: its cost against myopic with these actions."""
    head = ["environment", "agent", "parameters", "myopic there", "agent against it", "95 %"]
    rows = []
    for e in entries:
        for algo in filter(e.accounts.__contains__, LEARNERS):
            if parameters := environment_of(SAVED / stem(e.env_id) / algo):
                shown_parameters = ", ".join(f"{name}={value}" for name, value in parameters.items())
                there = signed(e.against(_rival(algo), SIMPLE).value)
                rows.append([stem(e.env_id), algo.upper(), shown_parameters, there, *_cells(e, algo, _rival(algo))])
    return tabulated(head, rows)


def _rival(algo: str) -> str:
    """The name of the one-step scheduler's account with the agent's actions."""
    return f"{BASELINE} for {algo}"


def _cells(e: Entry, algo: str, reference: str = SIMPLE) -> list[str]:
    if algo not in e.accounts:
        return ["", ""]
    return shown(e.against(algo, reference))


def shown(estimate: statistics.Estimate) -> list[str]:
    """An estimate's value and interval, for a table."""
    return [signed(estimate.value), interval(None if estimate.ci is None else list(estimate.ci), signed)]


def _nees(account: Account | None) -> str:
    middle = None if account is None else account.median_nees()
    return "" if middle is None else f"{middle:.2f}"


def renew(env_ids: Sequence[str]) -> None:
    """Renew the tables in docs/learned.md and README."""
    entries = [entry(env_id) for env_id in env_ids]
    front = table(entries)
    for file, text in ((PAGE, "\n\n".join([front, details(entries), libraries(entries)])), (README, front)):
        blocks.renew(file, START, END, text)


def main() -> None:
    """The command."""
    parser = Parser(
        prog="python -m agents.leaderboard", description="Trained agents and analytic schedulers in one table."
    )
    ladders = [env_id for env_id in SYSTEMS if (HEADROOM / f"{env_id.rpartition('/')[2]}.csv").exists()]
    wanted = "environments (default: those of the suite that `make headroom` played)"
    parser.add_argument("ids", nargs="*", metavar="ID", default=ladders, help=wanted)
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--times", action="store_true", help="time decisions, play nothing")
    parser.add_argument("--tables", action="store_true", help="renew the tables from earlier results; play nothing")
    read = parser.read(None)
    for env_id in map(full_id, () if read.tables else read.ids):
        if not read.times:
            play(env_id, read.jobs)
        time_decisions(env_id)
    renew(ladders)


if __name__ == "__main__":
    sys.exit(guarded(main))
