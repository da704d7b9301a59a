"""Record the range of what saved agents observed in training: ``python -m agents.training_ranges``.

For runs under results/runs that were trained before ``wavegym train`` recorded this range. The agents play their
training environments, as at the end of a training.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from agents.leaderboard import ROOT
from wavegym.core.command_line import Parser, guarded
from wavegym.core.files import write_whole
from wavegym.learning.observed import range_in_training
from wavegym.policies.networks import RANGE_KEY, LearnedPolicy
from wavegym.policies.runs import RUN, read_network, read_run, shown_in

FOLDER = ROOT / "results" / "runs"


def note(folder: Path) -> None:
    """Add the range of a run to its record."""
    run = read_run(folder / RUN)
    settings = run["settings"]
    policy = LearnedPolicy(read_network(folder, run), *shown_in(run))
    found = range_in_training(policy, run["env"], run["seed"], settings["environment"], settings.get("variants", ()))
    write_whole(folder, {RUN: (json.dumps({**run, RANGE_KEY: found.record()}, indent=2) + "\n").encode()})


def main() -> None:
    """The command."""
    parser = Parser(prog="python -m agents.training_ranges", description="Note what saved agents observed in training.")
    parser.add_argument("--again", action="store_true", help="also where it is known")
    again = parser.read(None).again
    for file in sorted(FOLDER.glob(f"*/*/*/{RUN}")):
        if again or RANGE_KEY not in read_run(file):
            note(file.parent)
            print(file.parent.relative_to(FOLDER), flush=True)


if __name__ == "__main__":
    sys.exit(guarded(main))
