"""The subcommand ``submit``: play a submission to the board."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from wavegym.core.command_line import Parser
from wavegym.core.workers import add_worker_options, workers


def parser() -> Parser:
    """The options."""
    options = Parser(prog="wavegym submit", description="Play a submission to the board against best-simple.")
    options.add_argument("folder", type=Path, metavar="FOLDER", help="folder with submission.toml and policies")
    options.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the record, NAME.json")
    options.add_argument(
        "--worlds", type=int, default=100, metavar="N", help="worlds of each environment (default: 100)"
    )
    seed = "seed of the test worlds (default: 0; the board draws its own at each release)"
    options.add_argument("--seed", type=int, default=0, metavar="S", help=seed)
    add_worker_options(options)
    return options


def submit(arguments: Sequence[str]) -> None:
    """Play, write the record, print the table."""
    options = parser().read(arguments)
    from wavegym.evaluation.submission import play_submission, read_record, read_submission, table

    submission = read_submission(options.folder)
    with workers(options):
        for env_id in play_submission(
            submission, options.out, seed=options.seed, worlds=options.worlds, jobs=options.jobs
        ):
            print(f"played {env_id}", flush=True)
    file = options.out / f"{submission.name}.json"
    print(f"\n{table(read_record(file))}\n\nwritten to {file}")
