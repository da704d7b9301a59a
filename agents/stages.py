"""What agents learn from rewards, from a teacher, and from both: ``python -m agents.stages [ENVIRONMENT ...]``.

Plays the agents ``ppo-scratch``, ``ppo-imitation`` and ``ppo-both`` of results/experiments.toml, and the same of DQN,
on the worlds of `make leaderboard`. The saved agent, ``ppo``, may be one of the three; its settings show which one.
Episodes are written to results/leaderboard, the tables to docs/learned.md. ``--tables`` renews the tables without
playing.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

from agents import blocks
from agents.leaderboard import (
    HEADROOM,
    LEADERBOARD,
    PAGE,
    against,
    environment_of,
    play_and_renew,
    simple_cost,
    stage_of,
)
from wavegym.core.command_line import Parser, guarded
from wavegym.core.files import write_whole
from wavegym.evaluation import compare, full_id
from wavegym.evaluation.adapters import AGENTS, SAVED
from wavegym.evaluation.headroom import WORLDS
from wavegym.evaluation.report import TABLE, compressed, read_results
from wavegym.evaluation.table import estimated, tabulated

START, END = "<!-- made by `python -m agents.stages`: -->", "<!-- stages to here -->"
STAGES = {"scratch": "from rewards alone", "imitation": "from the teacher alone", "both": "from both"}


def agent(name: str, algo: str, stage: str) -> str | None:
    """The agent for this stage in an environment: a separate agent or the saved one; None if there is none."""
    own = f"{algo}-{stage}"
    if (SAVED / name / own).is_dir():
        return own
    return algo if (SAVED / name / algo).is_dir() and stage_of(SAVED / name / algo) == stage else None


def play(name: str, jobs: int) -> None:
    """Play the agents of an environment that are not saved agents; writes the episodes to results/leaderboard."""
    files = {}
    for algo in AGENTS:
        for stage in STAGES:
            own = agent(name, algo, stage)
            if own is not None and own != algo:
                folder = SAVED / name / own
                common: dict[str, Any] = {"worlds": WORLDS, "jobs": jobs, "keep": LEADERBOARD}
                played = compare(full_id(name), {own: folder}, **common, **environment_of(folder))
                files[f"{name}-{own}{TABLE}"] = compressed(played.by_policy())
    write_whole(LEADERBOARD, files)


def table(algo: str, names: Sequence[str]) -> str:
    """One line for each environment: the cost of each stage against the best heuristic, and the training seeds."""
    rows = []
    for name in names:
        simple = simple_cost(name)
        cells, seeds = [], []
        for stage in STAGES:
            own = agent(name, algo, stage)
            file = LEADERBOARD / f"{name}-{own}{TABLE}"
            cost = read_results(file)[own].cost if own is not None and file.exists() else None
            cells += ["", ""] if cost is None else estimated(against(cost, simple))
            seeds.append("-" if cost is None else str(len(cost)))
        rows.append([name, *cells, ", ".join(seeds)])
    head = ["environment"]
    for title in STAGES.values():
        head += [f"{algo.upper()} {title}", "95 %"]
    return tabulated([*head, "seeds"], rows)


def renew(names: Sequence[str]) -> None:
    """Renew the tables in docs/learned.md."""
    blocks.renew(PAGE, START, END, "\n\n".join(table(algo, names) for algo in AGENTS))


def main() -> None:
    """The command."""
    parser = Parser(prog="python -m agents.stages", description="What agents learn from rewards, a teacher, and both.")
    play_and_renew(parser, HEADROOM, play, renew)


if __name__ == "__main__":
    sys.exit(guarded(main))
