"""Planted defects: each still has its line, and a defect that no test finds is reported."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from research.promises import mutate
from research.promises.mutate import Defect, is_found, read_defects, survivors
from wavegym.core.errors import InputError


def test_each_defect_has_its_line_and_its_tests() -> None:
    defects = read_defects()
    assert len({defect.what for defect in defects}) == len(defects) >= 100
    for defect in defects:
        assert defect.line != defect.planted
        for test in defect.tests:
            assert (mutate.ROOT / test.partition("::")[0]).exists()


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    (tmp_path / "double.py").write_text("def double(x):\n    return 2 * x\n")
    (tmp_path / "test_double.py").write_text("from double import double\n\ndef test_it():\n    assert double(2) == 4\n")
    (tmp_path / "conftest.py").write_text("")
    return tmp_path


@pytest.mark.slow
def test_a_defect_is_found_if_a_test_fails(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = copy / "double.py"
    before, written = file.read_text(), file.stat().st_mtime_ns
    defects = [Defect(what, "double.py", "2 * x", what, ("test_double.py",)) for what in ("3 * x", "x**2")]
    assert survivors(defects, copy) == ["x**2"]
    assert (file.read_text(), file.stat().st_mtime_ns) == (before, written)
    first, second = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"found: 3 \* x \(double\.py; 1 of 2, \d+ s\)", first)
    assert re.fullmatch(r"SURVIVED: x\*\*2 \(double\.py; 2 of 2, \d+ s\)", second)


@pytest.mark.slow
def test_a_test_that_fails_without_the_defect_finds_none(copy: Path) -> None:
    (copy / "test_double.py").write_text("def test_it():\n    raise OSError\n")
    with pytest.raises(InputError, match="wrong: pytest ends with status 1 without the defect, expected 0"):
        is_found(Defect("wrong", "double.py", "2 * x", "3 * x", ("test_double.py",)), copy)


def test_tests_that_cannot_run_are_a_mistake(copy: Path) -> None:
    with pytest.raises(InputError, match="wrong: pytest ends with status 4, expected 0 or 1"):
        is_found(Defect("wrong", "double.py", "2 * x", "3 * x", ("test_missing.py",)), copy)


def test_a_line_that_is_gone_is_a_mistake(tmp_path: Path) -> None:
    (tmp_path / "defects.toml").write_text(
        '[[defect]]\nwhat = "old"\nfile = "train.py"\nline = "nowhere to be found"\nplanted = ""\ntests = []\n'
    )
    with pytest.raises(InputError, match=r"old: 'nowhere to be found' occurs 0 times in train.py, expected once"):
        read_defects(tmp_path / "defects.toml")
