"""Command lines that answer every mistake with one line and exit status 2.

An unexpected exception takes one line too, with exit status 1. With the environment variable WAVEGYM_DEBUG=1 the
traceback is printed before the line.
"""

from __future__ import annotations

import argparse
import ast
import os
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

from wavegym.core.errors import InputError, InputWarning, nearest

FAILED = 2
UNEXPECTED = 1
INTERRUPTED, TERMINATED = 130, 143  # as in shells
DEBUG = "WAVEGYM_DEBUG"
FORMER = {"--environment": "--set", "--root": "--seed"}  # earlier names of options, and today's


class TerminatedError(BaseException):
    """SIGTERM has come; no ``except Exception`` on the way to ``guarded`` takes it for a failure of its own."""


class Parser(argparse.ArgumentParser):
    """An argument parser that raises InputErrors and names the nearest option."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__(allow_abbrev=False, epilog=f"{DEBUG}=1 shows the traceback of an error.", **arguments)

    def error(self, message: str) -> NoReturn:
        """Raise ``message`` as an InputError."""
        raise InputError(message)

    def read(self, arguments: Sequence[str] | None) -> argparse.Namespace:
        """``parse_args``, whose error for an unknown option names today's option or the nearest known one."""
        given = list(sys.argv[1:] if arguments is None else arguments)
        options = self._option_string_actions
        for option in (argument.partition("=")[0] for argument in given):
            if option in FORMER and option not in options and FORMER[option] in options:
                self.error(f"{option}: expected {FORMER[option]}")
        parsed, unknown = self.parse_known_args(given)
        if unknown:
            hint = nearest(unknown[0], options) if unknown[0].startswith("-") else ""
            self.error(f"unexpected argument {unknown[0]!r}{hint}")
        return parsed


def named_values(pairs: Sequence[str]) -> dict[str, Any]:
    """``["horizon=20", "weights=1,0", "model=ca"]`` as a dictionary; values are Python literals, or else strings.

    Raises:
        InputError: a pair is not ``NAME=VALUE``.
    """
    found = {}
    for pair in pairs:
        name, equals, value = pair.partition("=")
        if not equals or not name.isidentifier():
            raise InputError(f"{pair!r} has no value, expected NAME=VALUE, such as horizon=20")
        found[name] = _literal(value)
    return found


def _literal(text: str) -> Any:
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text


def guarded(main: Callable[[], None]) -> int:
    """Run ``main`` and print any error as one line on stderr. Returns the exit status.

    Errors other than InputError and OSError are named by their type. With WAVEGYM_DEBUG=1 in the environment the
    traceback comes before the line.
    """
    try:
        with _one_line_warnings(), _ended_by_signal():
            main()
    except BrokenPipeError:  # the reader of our output, such as head, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (InputError, OSError) as error:
        text = f"{error.strerror}: {error.filename}" if isinstance(error, OSError) and error.filename else str(error)
        return _told(text or type(error).__name__, FAILED)
    except Exception as error:  # overflow, memory, a worker that was killed, another package's error
        return _told(f"{type(error).__name__}: {error}", UNEXPECTED)
    except KeyboardInterrupt:
        print("error: interrupted", file=sys.stderr)
        return INTERRUPTED
    except TerminatedError:
        print("error: terminated", file=sys.stderr)
        return TERMINATED
    return 0


@contextmanager
def _ended_by_signal() -> Iterator[None]:
    """SIGTERM ends the block as ctrl-C does: with everything cleaned up. Outside the main thread nothing changes."""

    def end(number: int, frame: Any) -> None:
        raise TerminatedError

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _one_line_warnings() -> Iterator[None]:
    """An InputWarning takes one line on stderr, without its place in the code."""
    with warnings.catch_warnings():
        show = warnings.showwarning

        def in_one_line(message: Warning | str, category: type[Warning], *place: Any, **named: Any) -> None:
            if not issubclass(category, InputWarning):
                return show(message, category, *place, **named)
            return print(f"warning: {' '.join(str(message).split())}", file=sys.stderr)

        warnings.showwarning = in_one_line
        yield


def _told(text: str, status: int) -> int:
    """Print the error being handled; its exit status."""
    if os.environ.get(DEBUG) == "1":
        traceback.print_exc()
    print(f"error: {' '.join(text.split())}", file=sys.stderr)
    return status
