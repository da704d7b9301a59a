"""PPO beside the best planner that decides within 10 ms: ``python -m agents.quick_planners [ENVIRONMENT ...]``.

The planner has the least cost on tuning worlds among those of results/baselines with at most 10 ms of CPU time for a
decision. It plays the worlds of `make leaderboard`. Episodes are written to results/leaderboard, the table to
docs/learned.md. ``--tables`` renews the table without playing.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from agents import blocks
from agents.leaderboard import LEADERBOARD, PAGE, ROOT, against, play_and_renew, simple_cost
from wavegym.core.command_line import Parser, guarded
from wavegym.core.files import write_whole
from wavegym.evaluation import compare, full_id, make_task
from wavegym.evaluation.headroom import WORLDS
from wavegym.evaluation.planner_sweep import Swept, best_within, made, read_sweep
from wavegym.evaluation.report import TABLE, compressed, read_results
from wavegym.evaluation.table import estimated, tabulated
from wavegym.schedulers.tuned_constants import tuned_heuristic

SWEEPS = ROOT / "results" / "baselines"
LIMIT = 10.0  # CPU milliseconds of a decision
PLANNER = "quick-planner"
START, END = "<!-- made by `python -m agents.quick_planners`: -->", "<!-- quick planners to here -->"


def quick_planner(name: str) -> Swept:
    """The best planner within the limit; the heuristics of a sweep do not count."""
    rows = read_sweep((SWEEPS / f"{full_id(name).rpartition('/')[2]}.csv").read_text(encoding="utf-8"))
    return best_within([row for row in rows if row.setting.planner], LIMIT)


def play(name: str, jobs: int) -> None:
    """Play the planner of an environment; the episodes go to results/leaderboard."""
    env_id = full_id(name)
    setting, system = quick_planner(name).setting, make_task(env_id, {}).system
    bases = {setting.base: tuned_heuristic(setting.base, system, None)} if setting.base else {}
    played = compare(env_id, {PLANNER: made(setting, bases)}, worlds=WORLDS, jobs=jobs, keep=LEADERBOARD)
    write_whole(LEADERBOARD, {_file(name).name: compressed(played.by_policy())})


def table(names: Sequence[str]) -> str:
    """One line for each environment: the planner against the best heuristic, and PPO against the planner."""
    rows = []
    for name in names:
        chosen = quick_planner(name)
        setting = chosen.setting
        what = f"`{setting.planner}@{setting.base}`" if setting.base else f"`{setting.planner}`"
        cells = ["", "", "", ""]
        if _file(name).exists():
            planner = read_results(_file(name))[PLANNER].cost
            simple = simple_cost(name)
            ppo = read_results(LEADERBOARD / f"{name}-ppo{TABLE}")["ppo"].cost
            cells = [*estimated(against(planner, simple)), *estimated(against(ppo, planner))]
        rows.append([name, what, f"{chosen.cpu_ms:.1f}", *cells])
    head = ["environment", "planner", "CPU ms", "planner against best-simple", "95 %", "PPO against planner", "95 %"]
    return tabulated(head, rows)


def renew(names: Sequence[str]) -> None:
    """Renew the table in docs/learned.md."""
    blocks.renew(PAGE, START, END, table(names))


def main() -> None:
    """The command."""
    parser = Parser(prog="python -m agents.quick_planners", description="PPO beside the best planner within 10 ms.")
    play_and_renew(parser, SWEEPS, play, renew)


def _file(name: str) -> Path:
    return LEADERBOARD / f"{name}-{PLANNER}{TABLE}"


if __name__ == "__main__":
    sys.exit(guarded(main))
