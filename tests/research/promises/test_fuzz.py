"""The fuzzer: the suite stands up to a few files of each kind, and a planted defect is found."""

from __future__ import annotations

from typing import Any

import pytest

from research.promises import fuzz
from wavegym.evaluation import page
from wavegym.policies.networks import Network


@pytest.mark.slow
@pytest.mark.parametrize("kind", fuzz.KINDS)
def test_a_few_changed_files_are_accepted_or_refused_in_one_line(kind: str) -> None:
    accepted, refused = fuzz.fuzz(kind, 40)
    assert accepted + refused >= 40
    assert refused > 0 or kind == "reports"


def test_another_exception_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def careless(file: Any) -> float:
        return float(file.read_bytes().splitlines()[1].split(b",")[2])

    monkeypatch.setattr(fuzz, "read_tracks", careless)
    with pytest.raises((ValueError, IndexError)):
        fuzz.fuzz("tracks", 200)


def test_markup_from_a_name_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    fuzz.plain_tags()
    monkeypatch.setattr(page.html, "escape", lambda text: text)
    with pytest.raises(AssertionError, match="the report has the tags"):
        fuzz.fuzz("reports", 200)


def test_arrays_that_are_not_checked_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Network, "_try_out", lambda self: None)
    with pytest.raises((KeyError, IndexError, ValueError, TypeError)):
        fuzz.fuzz("policies", 400)
