"""Episodes are compared byte by byte, and a way that differs is named."""

from __future__ import annotations

import pytest

from research.promises import determinism

ENV, WAYS = "wavegym/KershawEvansPosition-v0", ("one by one", "in three threads")


def test_every_way_gives_the_episodes_of_one_batch() -> None:
    assert not determinism.differing(ENV, "cycle", WAYS)


def test_episodes_of_other_seeds_are_others() -> None:
    assert len(set(determinism.batch(ENV, "cycle", determinism.SEEDS))) == len(determinism.SEEDS)


def test_a_way_that_differs_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    later = [seed + 1 for seed in determinism.SEEDS]
    monkeypatch.setitem(
        determinism.WAYS, "one by one", lambda env_id, policy: determinism.single(env_id, policy, later)
    )
    assert determinism.differing(ENV, "cycle", WAYS) == ["KershawEvansPosition under cycle one by one"]
