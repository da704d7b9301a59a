"""A stock learner in the shared band: ``python -m agents.stock_learner [SEED ...]``.

Stable-Baselines3's PPO with all its defaults, on the default reward: ``PPO("MlpPolicy",
"wavegym:wavegym/SharedSpectrum-v0").learn(1_000_000)``. Every ``EVERY`` steps its deterministic policy plays worlds
that no training drew. The costs go to results/shared_band/stock.csv, and docs/shared_band.md shows them. A seed takes
about ten minutes. ``--tables`` renews the page without training.
"""

from __future__ import annotations

import csv
import io
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from agents import blocks
from agents.shared_band import ENV_ID, FOLDER, PAGE, REFERENCE
from wavegym.core.command_line import Parser, guarded
from wavegym.core.files import csv_text, write_whole
from wavegym.evaluation import compare
from wavegym.evaluation.table import signed, tabulated

STEPS, EVERY, WORLDS, SEED = 1_000_000, 100_000, 100, 1  # the seed of the worlds
OPPONENTS = (REFERENCE, "myopic", "myopic:lags")
FILE = FOLDER / "stock.csv"
HEAD = ("seed", "steps", *OPPONENTS)
START, END = "<!-- made by `python -m agents.stock_learner`: -->", "<!-- stock learner to here -->"


def against_opponents(model: Any) -> list[Any]:
    """Cost of a model in per cent against each opponent, geometric, on the same worlds."""
    found = compare(ENV_ID, {"mine": model, REFERENCE: None, "myopic:lags": None}, worlds=WORLDS, seed=SEED, jobs=1,
                    progress=False)  # fmt: skip
    return [found.against("mine", name).value for name in OPPONENTS]


def train(seed: int, steps: int = STEPS, every: int = EVERY) -> list[list[float]]:
    """Rows of the file for one training seed."""
    from stable_baselines3 import PPO

    model = PPO("MlpPolicy", f"wavegym:{ENV_ID}", seed=seed)
    rows = []
    while model.num_timesteps < steps:
        model.learn(every, reset_num_timesteps=False)
        rows.append([seed, model.num_timesteps, *against_opponents(model)])
        print(*rows[-1], flush=True)
    return rows


def read() -> list[list[float]]:
    """The rows on file."""
    text = FILE.read_text("utf-8") if FILE.exists() else ""
    return [[float(cell) for cell in row] for row in list(csv.reader(io.StringIO(text)))[1:]]


def table(rows: Sequence[Sequence[float]]) -> str:
    """A line for each number of steps, with the mean over the seeds."""
    steps = sorted({round(row[1], -5) for row in rows})
    lines = []
    for count in steps:
        those = np.array([row for row in rows if round(row[1], -5) == count])
        ends = [", ".join(signed(value) for value in those[:, 2])]
        means = [
            signed(float(100.0 * np.expm1(np.log1p(those[:, 2 + i] / 100.0).mean()))) for i in range(len(OPPONENTS))
        ]
        lines.append([f"{count:.0f}", *ends, *means])
    head = ["steps", f"each seed against {REFERENCE} %", *(f"mean against {name} %" for name in OPPONENTS)]
    return tabulated(head, lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = Parser(prog="python -m agents.stock_learner", description="A stock learner in the shared band.")
    parser.add_argument(
        "seeds", nargs="*", type=int, default=[0, 1, 2], metavar="SEED", help="of trainings (default: 0 1 2)"
    )
    parser.add_argument("--tables", action="store_true", help="only renew the page")
    given = parser.read(arguments)
    for seed in () if given.tables else given.seeds:
        fresh = train(seed)
        rows = [*(row for row in read() if row[0] != seed), *fresh]
        write_whole(FILE.parent, {FILE.name: csv_text(HEAD, sorted(rows)).encode()})
    blocks.renew(PAGE, START, END, table(read()))


if __name__ == "__main__":
    sys.exit(guarded(main))
