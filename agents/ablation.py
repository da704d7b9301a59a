"""Ablation of the training: ``python -m agents.ablation [EXPERIMENT ...]``.

Experiments of results/experiments.toml whose names end in ``-ablation`` train agents with one part left out, for as
many steps as the complete agent, ``full``. The agents play the worlds of ``make leaderboard``. results/ablation keeps
the episodes, docs/learned.md shows their table. ``--tables`` renews the table without playing.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from agents.experiment import Experiment, load_experiments, run_folder, train_missing
from agents.leaderboard import PAGE, ROOT, WORLDS, against, shown
from wavegym.core.arrays import Array
from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import InputError, check_choice
from wavegym.evaluation import blocks, compare, statistics
from wavegym.evaluation.account import Account, read_accounts
from wavegym.evaluation.comparison import BASELINE
from wavegym.evaluation.files import write_whole
from wavegym.evaluation.report import episodes
from wavegym.evaluation.statistics import Estimate
from wavegym.evaluation.table import both, decimal, tabulated
from wavegym.schedulers.tuned_constants import SIMPLE

FOLDER = ROOT / "results" / "ablation"
SUFFIX, FULL = "-ablation", "full"
START, END = "<!-- made by `python -m agents.ablation`: -->", "<!-- ablations to here -->"


def play(name: str, experiment: Experiment, jobs: int) -> None:
    """Train missing agents; write the episodes of all agents and of the best simple heuristic."""
    train_missing(name, experiment, jobs)
    policies: dict[str, Any] = {SIMPLE: None}
    for learner in experiment.learners:
        policies[learner] = run_folder(name, learner)
    comparison = compare(experiment.env, policies, worlds=WORLDS, jobs=jobs, **experiment.parameters())
    write_whole(FOLDER, {f"{name}.csv": episodes(comparison).encode()})


def table(played: Mapping[str, Mapping[str, Account]]) -> str:
    """Two tables with a line for each agent: cost by belief and error by truth, in per cent."""
    figures = (lambda account: account.cost), (lambda account: account.squared_error)
    return both(*(_compared(played, figure) for figure in figures))


def _compared(played: Mapping[str, Mapping[str, Account]], figure: Callable[[Account], Array]) -> str:
    """A line for each agent: a figure of its episodes against the best simple heuristic's and the full agent's."""
    head = ["environment", "agent", "seeds", "against best simple", "95 %", "against full", "95 %", "lost"]
    rows = []
    for name, accounts in played.items():
        for agent in [FULL, *(agent for agent in accounts if agent not in (FULL, SIMPLE, BASELINE))]:
            own, simple, full = (figure(accounts[each]) for each in (agent, SIMPLE, FULL))
            against_full = ["", ""] if agent == FULL else shown(against_seed_by_seed(own, full))
            cells = [*shown(against(own, simple)), *against_full, decimal(statistics.average(accounts[agent].lost))]
            rows.append([name.removesuffix(SUFFIX), agent, str(len(own)), *cells])
    return tabulated(head, rows)


def against_seed_by_seed(values: Array, full: Array) -> Estimate:
    """Geometric mean of the ratios, in per cent, of each run to the full agent with the same seed.

    The full agent's arithmetic mean over seeds would exceed its geometric mean and favour the other agent.

    Args:
        values, full: (member, world) each.
    """
    if values.shape != full.shape:
        raise InputError(f"runs and worlds are {values.shape}, expected the full agent's {full.shape}")
    return against(values / full, np.ones((1, values.shape[1])))


def main() -> None:
    """The command."""
    parser = Parser(prog="python -m agents.ablation", description="Ablation of the training.")
    parser.add_argument("experiments", nargs="*", metavar="EXPERIMENT", help="which (default: all ablations)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--tables", action="store_true", help="renew the table from earlier results; play nothing")
    options = parser.read(None)
    experiments = {name: experiment for name, experiment in load_experiments().items() if name.endswith(SUFFIX)}
    asked = [check_choice("ablation", name, experiments) for name in options.experiments] or list(experiments)
    if not options.tables:
        for name in asked:
            play(name, experiments[name], options.jobs)
    played = {name: read_accounts(FOLDER / f"{name}.csv") for name in experiments if (FOLDER / f"{name}.csv").exists()}
    blocks.renew(PAGE, START, END, table(played))


if __name__ == "__main__":
    sys.exit(guarded(main))
