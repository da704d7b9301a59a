"""constraints-oldest.txt holds the lower bounds of pyproject.toml."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).parents[1]
EXTRAS = ("agents", "tune", "onnx", "pettingzoo", "window", "stonesoup")
EXEMPT = {"torch"}  # its oldest build would have to be downloaded with all of CUDA
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
OLDEST = [Requirement(line) for line in (ROOT / "constraints-oldest.txt").read_text("utf-8").splitlines()[1:]]
PINNED = {canonicalize_name(pin.name): Version(str(pin.specifier).removeprefix("==")) for pin in OLDEST}
BOUNDS = [
    Requirement(line)
    for listed in (PROJECT["dependencies"], *(PROJECT["optional-dependencies"][extra] for extra in EXTRAS))
    for line in listed
]


@pytest.mark.parametrize("bound", [b for b in BOUNDS if b.name not in EXEMPT], ids=lambda bound: bound.name)
def test_the_lower_bound_is_tested(bound: Requirement) -> None:
    (least,) = (Version(each.version) for each in bound.specifier if each.operator == ">=")
    pinned = PINNED[canonicalize_name(bound.name)].release
    assert pinned[: len(least.release)] == least.release
    assert not any(pinned[len(least.release) :])
