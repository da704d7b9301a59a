"""The subcommand ``export``: an agent as an ONNX file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from wavegym.core.command_line import Parser
from wavegym.core.errors import InputError
from wavegym.registration import NAMESPACE


def parser() -> Parser:
    """The options."""
    options = Parser(prog="wavegym export", description="Write an agent as an ONNX file.")
    known = "folder of a finished run, or ENV/ALGO of an agent that comes with the package: RfEo-v0/ppo"
    options.add_argument("policy", metavar="POLICY", help=known)
    options.add_argument("--onnx", type=Path, required=True, metavar="FILE", help="the file to write")
    return options


def export(arguments: Sequence[str]) -> None:
    """Export and print the path of the file."""
    options = parser().read(arguments)
    from wavegym.policies.onnx_export import export_onnx

    export_onnx(_folder(options.policy), options.onnx)
    print(f"written to {options.onnx}")


def _folder(policy: str) -> Path:
    if Path(policy).is_dir():
        return Path(policy)
    from wavegym.policies.pretrained import pretrained_folder

    env_id, _, algo = policy.removeprefix(NAMESPACE).rpartition("/")
    folder = pretrained_folder(NAMESPACE + env_id, algo)
    if folder is None:
        wanted = "the folder of a run, or ENV/ALGO such as RfEo-v0/ppo"
        raise InputError(f"policy is {policy!r}, neither a folder nor an agent of the package, expected {wanted}")
    return folder
