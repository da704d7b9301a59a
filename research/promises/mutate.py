"""Planted defects: ``python -m research.promises.mutate [--only TEXT]``.

Each entry of defects.toml has a line of the suite, a defect of this line, and the tests that must find it. The command
copies the sources, plants one defect after the other, and runs its tests. A test that fails must pass without the
defect. A defect that no test finds survives, and the command fails.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter

from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import InputError

ROOT = Path(__file__).parents[2]
FILE = Path(__file__).parent / "defects.toml"
LEFT_OUT = shutil.ignore_patterns(
    ".git", ".pytest_cache", ".venv*", "out", "site", "results", "*.egg-info", ".hypothesis"
)
FAILED = 1  # pytest's exit status if tests fail; any other is a mistake of the command


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Defect:
    """One line that is changed.

    Attributes:
        what: the defect in words.
        file: of the suite.
        line: text that occurs in it once.
        planted: the text that replaces it.
        tests: files or tests, of which one must fail.
    """

    what: str
    file: str
    line: str
    planted: str
    tests: tuple[str, ...]


def read_defects(file: Path = FILE) -> list[Defect]:
    """The defects of a file. Raises an InputError if it is not valid or a line does not occur exactly once."""
    try:
        found = TypeAdapter(dict[str, list[Defect]]).validate_python(tomllib.loads(file.read_text(encoding="utf-8")))
    except (ValidationError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{file}: {' '.join(str(error).split())}") from None
    defects = found.get("defect", [])
    for defect in defects:
        count = (ROOT / defect.file).read_text(encoding="utf-8").count(defect.line)
        if count != 1:
            raise InputError(f"{defect.what}: {defect.line!r} occurs {count} times in {defect.file}, expected once")
    return defects


def is_found(defect: Defect, copy: Path) -> bool:
    """Whether a test fails with the defect, planted in a copy of the sources and taken out again.

    Raises:
        InputError: the tests cannot be run, or the failing test also fails without the defect.
    """
    file = copy / defect.file
    whole, known = file.read_text(encoding="utf-8"), file.stat()
    file.write_text(whole.replace(defect.line, defect.planted), encoding="utf-8")
    try:
        status = run_tests(defect.tests, copy)
    finally:
        file.write_text(whole, encoding="utf-8")
        os.utime(file, ns=(known.st_atime_ns, known.st_mtime_ns))  # kernels of an older file are not compiled again
    if status not in (0, FAILED):
        raise InputError(f"{defect.what}: pytest ends with status {status}, expected 0 or {FAILED}")
    if status and (again := run_tests(("--last-failed", *defect.tests), copy)):
        raise InputError(f"{defect.what}: pytest ends with status {again} without the defect, expected 0")
    return status == FAILED


def run_tests(tests: Sequence[str], copy: Path) -> int:
    """pytest's exit status in a copy of the sources, which remembers the test that failed."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-m", "", *tests]
    # No bytecode: Python would confuse a file with its earlier version if size and second of the change are the same.
    environment = {**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(command, cwd=copy, env=environment, capture_output=True, check=False).returncode


def survivors(defects: Sequence[Defect], copy: Path) -> list[str]:
    """The words of the defects that no test finds; prints a line for each defect."""
    survived = list[str]()
    for n, defect in enumerate(defects, start=1):
        start = perf_counter()
        found = is_found(defect, copy)
        survived += [] if found else [defect.what]
        took = f"{n} of {len(defects)}, {perf_counter() - start:.0f} s"
        print(f"{'found' if found else 'SURVIVED'}: {defect.what} ({defect.file}; {took})", flush=True)
    return survived


def main() -> None:
    """Print a line for each defect."""
    parser = Parser(
        prog="python -m research.promises.mutate", description="Plant defects, one at a time, and run the tests."
    )
    parser.add_argument("--only", default="", metavar="TEXT", help="defects whose words or file contain it")
    read = parser.read(None)
    defects = [each for each in read_defects() if read.only in each.what or read.only in each.file]
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder, "main")
        shutil.copytree(ROOT, copy, ignore=LEFT_OUT)
        for name in ("results", "site"):
            if (ROOT / name).exists():
                (copy / name).symlink_to(ROOT / name)
        survived = survivors(defects, copy)
    print(f"{len(defects) - len(survived)} of {len(defects)} defects are found")
    if survived:
        raise InputError(f"{len(survived)} defects survive: {'; '.join(survived)}")


if __name__ == "__main__":
    sys.exit(guarded(main))
