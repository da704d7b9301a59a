"""The command ``wavegym``, also ``python -m wavegym``.

    wavegym evaluate KershawEvansPosition-v0 --policies myopic,ppo --worlds 50 --out DIR

A subcommand imports its packages only when it runs: ``wavegym list`` needs neither Numba nor torch.
"""

from __future__ import annotations

import sys
from argparse import RawDescriptionHelpFormatter
from collections.abc import Sequence
from importlib import import_module
from typing import NamedTuple

from wavegym.core import VERSION
from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import check_choice


class Command(NamedTuple):
    """A subcommand: its description, and the function that takes its arguments."""

    summary: str
    module: str
    function: str


COMMANDS = {
    "list": Command("list the ids of all environments", "environments", "list_ids"),
    "describe": Command("show actions, observations and parameters of an environment", "environments", "describe"),
    "policies": Command("list the policies that evaluate and play take", "environments", "policies"),
    "warm-up": Command("compile the kernels of environments before they are needed", "warm_up", "warm_up"),
    "check": Command("check that an environment conforms to Gymnasium", "environments", "check"),
    "play": Command("play one episode with a policy; optionally write a GIF", "play", "play"),
    "train": Command("train an agent (extra: agents)", "train", "train"),
    "evaluate": Command("compare policies on the same worlds", "evaluate", "evaluate"),
    "submit": Command("play a submission to the board", "evaluate", "submit"),
    "tracks": Command("show what is in a recording of targets", "tracks", "tracks"),
    "dataset": Command("write episodes of a policy as a Minari dataset (extra: minari)", "play", "dataset"),
    "export": Command("write an agent as an ONNX file (extra: onnx)", "train", "export"),
}


def parser() -> Parser:
    """The options before any subcommand."""
    listed = "\n".join(f"  {name:<10}{command.summary}" for name, command in COMMANDS.items())
    description = f"Schedule radar waveforms. Subcommands:\n{listed}\n\nwavegym SUBCOMMAND --help shows its options."
    options = Parser(
        prog="wavegym",
        usage="wavegym SUBCOMMAND ...",
        description=description,
        formatter_class=RawDescriptionHelpFormatter,
    )
    options.add_argument("--version", action="version", version=VERSION)
    return options


def run(arguments: Sequence[str]) -> None:
    """Hand the arguments to the subcommand that they name; without any, print the help."""
    if not arguments or arguments[0].startswith("-"):
        parser().read(arguments)
        parser().print_help()
        return
    command = COMMANDS[check_choice("subcommand", arguments[0], COMMANDS)]
    getattr(import_module(f"wavegym.cli.{command.module}"), command.function)(arguments[1:])


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns its exit status."""
    return guarded(lambda: run(sys.argv[1:] if arguments is None else arguments))
