"""PPO in the shared band with histories of several lengths: ``python -m agents.history_lengths``.

Trains three seeds for each length with the settings of the saved agents, plays them in their own environment, and
writes results/shared_band/history.json and the table of docs/shared_band.md. Runs are kept under ``--runs``, and those
that are there are not trained again. A training takes about ten minutes. ``--tables`` renews the page alone.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents import blocks
from agents.leaderboard import saved
from agents.shared_band import AGENT, ENV_ID, FOLDER, PAGE, REFERENCE, SEED, WORLDS, against
from wavegym.core.command_line import Parser, guarded
from wavegym.core.files import write_whole
from wavegym.evaluation import compare
from wavegym.evaluation.table import interval, signed, tabulated
from wavegym.learning.settings import load_settings
from wavegym.learning.train import train
from wavegym.learning.training_run import TrainingRun
from wavegym.policies.runs import RUN

LENGTHS, DEFAULT, SEEDS = (4, 12, 16, 32), 16, (0, 1, 2)
PREDICTOR = "myopic:stepped"
FILE = FOLDER / "history.json"
START, END = "<!-- made by `python -m agents.history_lengths`: -->", "<!-- history lengths to here -->"
CHECKPOINT_EVERY = 500_000  # steps


def trained(length: int, folder: Path) -> Path:
    """The folder of the agents for one length, trained where they are missing."""
    if length == DEFAULT:
        return saved(ENV_ID)[AGENT]
    for seed in SEEDS:
        run = folder / str(length) / str(seed)
        if not (run / RUN).exists():
            settings = load_settings(ENV_ID, AGENT, parameters={"history": length})
            train(TrainingRun(ENV_ID, AGENT, seed, settings), run, CHECKPOINT_EVERY)
    return folder / str(length)


def played(length: int, folder: Path) -> dict[str, Any]:
    """The agents of one length against sense-and-avoid and the best predictor, in environments of this length."""
    policies = {AGENT: trained(length, folder), REFERENCE: None, PREDICTOR: None}
    found = compare(ENV_ID, policies, worlds=WORLDS, seed=SEED, progress=False, history=length)
    return {other: against(found, AGENT, other) for other in (REFERENCE, PREDICTOR)}


def table(found: dict[str, Any]) -> str:
    """A line for each length."""
    head = ["steps"]
    for other in (REFERENCE, PREDICTOR):
        head += [f"cost against `{other}` %", "95 %", "by truth %", "95 %"]
    rows = []
    for length in sorted(found, key=int):
        halves = [found[length][other][half] for other in (REFERENCE, PREDICTOR) for half in ("belief", "truth")]
        cells = [cell for half in halves for cell in (signed(half["percent"]), interval(half["ci"], signed))]
        rows.append([length, *cells])
    return tabulated(head, rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = Parser(prog="python -m agents.history_lengths", description="PPO with histories of several lengths.")
    parser.add_argument(
        "--runs", type=Path, default=Path("runs/history"), metavar="DIR", help="folder of the trainings"
    )
    parser.add_argument("--tables", action="store_true", help="only renew the page")
    given = parser.read(arguments)
    for length in () if given.tables else LENGTHS:
        found = blocks.read_results(FILE) | {str(length): played(length, given.runs)}
        write_whole(FILE.parent, {FILE.name: (json.dumps(found, indent=1) + "\n").encode()})
        print(f"{length} steps: written", flush=True)
    blocks.renew(PAGE, START, END, table(blocks.read_results(FILE)))


if __name__ == "__main__":
    sys.exit(guarded(main))
