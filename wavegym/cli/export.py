"""The subcommand ``export``: a trained policy as an ONNX file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from wavegym.core.command_line import Parser
from wavegym.core.errors import InputError


def parser() -> Parser:
    """The options."""
    options = Parser(prog="wavegym export", description="Write a trained policy as an ONNX file.")
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
    from wavegym.evaluation import full_id
    from wavegym.policies.pretrained import pretrained_folder

    env_id, slash, algo = policy.rpartition("/")
    folder = pretrained_folder(full_id(env_id), algo) if slash else None
    if folder is None:
        raise InputError(f"policy is {policy!r}, expected the folder of a run, or ENV/ALGO such as RfEo-v0/ppo")
    return folder
