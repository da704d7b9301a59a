"""The subcommands ``export``, an agent as an ONNX file, and ``submit``, a submission to the board."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from wavegym.core.command_line import Parser
from wavegym.core.errors import InputError
from wavegym.core.work import add_worker_options, workers
from wavegym.registration import NAMESPACE


def export_parser() -> Parser:
    """The options of ``export``."""
    options = Parser(prog="wavegym export", description="Write an agent as an ONNX file.")
    known = "folder of a finished run, or ENV/ALGO of an agent that comes with the package: RfEo-v0/ppo"
    options.add_argument("policy", metavar="POLICY", help=known)
    options.add_argument("--onnx", type=Path, required=True, metavar="FILE", help="the file to write")
    return options


def export(arguments: Sequence[str]) -> None:
    """Export and print the path of the file."""
    options = export_parser().read(arguments)
    from wavegym.policies.onnx_files import export_onnx

    export_onnx(_folder(options.policy), options.onnx)
    print(f"written to {options.onnx}")


def _folder(policy: str) -> Path:
    if Path(policy).is_dir():
        return Path(policy)
    from wavegym.policies.runs import pretrained_folder

    env_id, _, algo = policy.removeprefix(NAMESPACE).rpartition("/")
    folder = pretrained_folder(NAMESPACE + env_id, algo)
    if folder is None:
        wanted = "the folder of a run, or ENV/ALGO such as RfEo-v0/ppo"
        raise InputError(f"policy is {policy!r}, neither a folder nor an agent of the package, expected {wanted}")
    return folder


def submit_parser() -> Parser:
    """The options of ``submit``."""
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
    options = submit_parser().read(arguments)
    from wavegym.evaluation.submission import play_submission, read_record, read_submission, table

    submission = read_submission(options.folder)
    with workers(options):
        for env_id in play_submission(
            submission, options.out, seed=options.seed, worlds=options.worlds, jobs=options.jobs
        ):
            print(f"played {env_id}", flush=True)
    file = options.out / f"{submission.name}.json"
    print(f"\n{table(read_record(file))}\n\nwritten to {file}")
