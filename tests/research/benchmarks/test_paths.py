"""The table of weights counts what runs, once."""

from __future__ import annotations

from research.benchmarks.paths import lines, loaded, passed
from wavegym.registration import stem


def test_a_function_counts_once_and_a_lambda_not_at_all() -> None:
    found = passed(lambda: [(lambda: stem("wavegym/Some-v0"))() for _ in range(3)])
    assert found == {stem.__code__}


def test_an_import_of_the_package_stays_light() -> None:
    assert loaded("import sys") == 0
    assert 1 < loaded("import wavegym") <= 60


def test_lines_are_those_of_the_file() -> None:
    counted = {file.as_posix(): count for file, count in lines().items()}
    with open(__file__, encoding="utf-8") as file:
        assert counted["tests/research/benchmarks/test_paths.py"] == len(file.readlines())
