"""Episodes are compared byte by byte, and a way that differs is named."""

from __future__ import annotations

import pytest

from promises import determinism
from wavegym.core.errors import InputError

ENV, WAYS = "wavegym/KershawEvansPosition-v0", ("one by one", "in three threads")


def test_every_way_gives_the_episodes_of_one_batch() -> None:
    determinism.check(ENV, "cycle", WAYS)


def test_episodes_of_other_seeds_are_others() -> None:
    assert len(set(determinism.batch(ENV, "cycle", determinism.SEEDS))) == len(determinism.SEEDS)


def test_a_way_that_differs_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    later = [seed + 1 for seed in determinism.SEEDS]
    monkeypatch.setitem(
        determinism.WAYS, "one by one", lambda env_id, policy: determinism.single(env_id, policy, later)
    )
    with pytest.raises(InputError, match="cycle: episodes one by one differ, expected those of one batch"):
        determinism.check(ENV, "cycle", WAYS)
