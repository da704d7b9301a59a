"""Do 95 % intervals contain the truth in 95 % of cases? ``python -m research.promises.coverage [ENVIRONMENT ...]``.

The episodes of `make leaderboard` are treated as the population. Samples of the same size are drawn from them with
replacement, and the command counts how often the interval of a sample contains the value of the population. Heavy tails
are visible at once: if one world costs as much as fifty others, most samples miss it. The table is in docs/promises.md.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from agents import blocks
from agents.leaderboard import LEADERBOARD, simple_cost
from wavegym.core.arrays import Array
from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import check_choice
from wavegym.core.worlds import word
from wavegym.evaluation import statistics
from wavegym.evaluation.report import TABLE, read_results
from wavegym.evaluation.table import tabulated

PAGE = Path(__file__).parents[2] / "docs" / "promises.md"
START, END = "<!-- made by `python -m research.promises.coverage`: -->", "<!-- coverage to here -->"
DRAWS = 400
LEAST, MOST = 0.90, 0.97  # a share of DRAWS between these counts as 95 %


def covered(own: Array, others: Array) -> Array:
    """For each number of a ``statistics.Difference``: the share of samples whose interval contains that of all worlds.

    Args:
        own, others: costs of a policy and of the one that it is compared with, (1, world).
    """
    rng = np.random.default_rng(word("coverage"))
    truth, held = statistics.difference(own, others, rng), np.zeros(len(statistics.Difference._fields))
    for _ in range(DRAWS):
        worlds = rng.integers(own.shape[1], size=own.shape[1])
        drawn = statistics.difference(own[:, worlds], others[:, worlds], rng)
        held += [_holds(each.ci, true.value) for each, true in zip(drawn, truth, strict=True)]
    return held / DRAWS


def _holds(interval: statistics.Interval | None, value: float | None) -> bool:
    return interval is not None and value is not None and interval[0] <= value <= interval[1]


def names() -> list[str]:
    """The environments with an agent whose episodes are kept."""
    return sorted(file.name.removesuffix(f"-ppo{TABLE}") for file in LEADERBOARD.glob(f"*-ppo{TABLE}"))


def row(name: str) -> list[str]:
    """An environment's line: the coverage of PPO's first training seed against the best heuristic."""
    own = read_results(LEADERBOARD / f"{name}-ppo{TABLE}")["ppo"].cost[:1]
    others = simple_cost(name)[:1]
    if (own == others).all():
        return [name, "equal costs", ""]
    return [name, *map(said, covered(own, others))]


def said(share: float) -> str:
    """A share in per cent, marked if it is too low or too high."""
    mark = " low" if share < LEAST else " high" if share > MOST else ""
    return f"{100 * share:.1f} %{mark}"


def table(chosen: Sequence[str]) -> str:
    """One line for each environment."""
    return tabulated(
        ["environment", "ratio of the means", "geometric mean of the ratios"], [row(name) for name in chosen]
    )


def main() -> None:
    """The command."""
    parser = Parser(
        prog="python -m research.promises.coverage", description="How often 95 % intervals contain the true value."
    )
    parser.add_argument("names", nargs="*", metavar="ENVIRONMENT", help="which to print (default: all, to the page)")
    chosen = parser.read(None).names
    for name in chosen:
        check_choice("environment", name, names())
    if chosen:
        print(table(chosen))
    else:
        blocks.renew(PAGE, START, END, table(names()))


if __name__ == "__main__":
    sys.exit(guarded(main))
