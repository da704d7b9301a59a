from __future__ import annotations

import signal
import subprocess
import sys

import gymnasium as gym
import pytest

from wavegym.core.command_line import guarded
from wavegym.core.errors import InputError


def failing(error):
    def main():
        raise error

    return main


@pytest.mark.parametrize(
    ("error", "line", "status"),
    [
        (InputError("q is -1,\nexpected more"), "error: q is -1, expected more", 2),
        (FileNotFoundError(2, "No such file", "a.csv"), "error: No such file: a.csv", 2),
        (OSError(), "error: OSError", 2),
        (OverflowError("math range error"), "error: OverflowError: math range error", 1),
        (MemoryError(), "error: MemoryError:", 1),
        (gym.error.Error("two\nlines"), "error: Error: two lines", 1),
        (KeyboardInterrupt(), "error: interrupted", 130),
    ],
)
def test_every_error_is_one_line_and_a_status(capsys, monkeypatch, error, line, status):
    monkeypatch.delenv("WAVEGYM_DEBUG", raising=False)
    assert guarded(failing(error)) == status
    assert capsys.readouterr().err == f"{line}\n"


@pytest.mark.parametrize("error", [InputError("q is -1"), OverflowError("math range error")])
def test_the_traceback_is_there_for_the_asking(capsys, monkeypatch, error):
    monkeypatch.setenv("WAVEGYM_DEBUG", "1")
    assert guarded(failing(error)) != 0
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("Traceback")
    assert lines[-1].startswith("error: ")


def test_what_goes_well_is_silent(capsys):
    assert guarded(lambda: None) == 0
    assert capsys.readouterr() == ("", "")


SLEEPER = """
import signal, sys, time
from wavegym.core.command_line import guarded

signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job starts with SIGINT ignored

def main():
    try:
        print("ready", flush=True)
        time.sleep(60.0)
    finally:
        print("cleaned up", flush=True)

sys.exit(guarded(main))
"""


@pytest.mark.parametrize(("sent", "status", "word"), [("SIGTERM", 143, "terminated"), ("SIGINT", 130, "interrupted")])
def test_a_signal_ends_a_command_in_one_line_with_all_cleaned_up(sent, status, word):
    command = subprocess.Popen(
        [sys.executable, "-c", SLEEPER], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert command.stdout.readline() == "ready\n"
    command.send_signal(getattr(signal, sent))
    out, errors = command.communicate(timeout=30.0)
    assert (command.returncode, out, errors) == (status, "cleaned up\n", f"error: {word}\n")
