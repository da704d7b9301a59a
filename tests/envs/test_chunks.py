"""Environments that advance in several threads give the bits of one thread."""

from __future__ import annotations

import os
import sys
import threading
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pytest
from small_systems import BRIEF

import wavegym
from wavegym.core import trees
from wavegym.core.errors import InputError
from wavegym.envs.chunks import in_chunks
from wavegym.testing.lockstep import difference

ENVS, STEPS, LIMIT = 5, 9, 4
SETTINGS: dict[str, dict[str, Any]] = {
    "KershawEvansPosition": {"reward": "relative"},
    "RfEo": {"observation": "measurements", "autoreset_mode": "SameStep"},
    "CameraSlew": {"forecasts": True},
    "EnergyBudget": {"measurements": True},
}


class Pair(NamedTuple):
    kept: np.ndarray
    new: Any


@pytest.mark.parametrize(
    "env_id", [pytest.param(id, marks=[pytest.mark.slow] * ("City" in id)) for id in wavegym.list_envs()]
)
def test_threads_change_no_bit(env_id: str) -> None:
    """Past the ends of episodes; five environments in three threads make chunks of unequal size."""
    settings = {**BRIEF.get(env_id, {}), **SETTINGS.get(env_id.split("/")[1].removesuffix("-v0"), {})}
    one, several = (
        gym.make_vec(env_id, num_envs=ENVS, max_episode_steps=LIMIT, num_threads=threads, **settings)
        for threads in (1, 3)
    )
    assert difference(one.reset(seed=3), several.reset(seed=3)) is None
    random = one.unwrapped.policy("random")
    for _ in range(STEPS):
        actions = random()
        assert difference(one.step(actions), several.step(actions)) is None
    assert difference(trees.leaves(one.unwrapped.belief), trees.leaves(several.unwrapped.belief)) is None


def test_chunks_advance_at_the_same_time() -> None:
    """Each waits for the other: in one thread this would not end."""
    together = threading.Barrier(2, timeout=60)
    places = in_chunks(lambda x: (together.wait(), x + 1.0)[1], np.arange(7.0), 7, 2)
    assert (places == np.arange(1.0, 8.0)).all()


def test_what_a_function_passes_on_is_not_copied() -> None:
    """Worlds and paths are large, and do not change from step to step."""
    large, numbers = np.arange(6.0), np.arange(6)
    after = in_chunks(
        lambda before: Pair(before.kept, {"twice": 2 * before.new, "none": None}), Pair(large, numbers), 6, 4
    )
    assert after.kept is large
    assert (after.new["twice"] == 2 * numbers).all()
    assert after.new["none"] is None


def test_an_error_of_any_chunk_is_raised_when_all_have_ended() -> None:
    ended = []

    def fail_late(rows: np.ndarray) -> np.ndarray:
        ended.append(rows[0])
        if rows[0] == 2:
            raise ZeroDivisionError("of the second chunk")
        return rows

    with pytest.raises(ZeroDivisionError, match="second chunk"):
        in_chunks(fail_late, np.arange(4), 4, 2)
    assert sorted(ended) == [0, 2]


@pytest.mark.skipif(sys.platform == "win32", reason="processes are not forked there")
def test_a_forked_process_starts_threads_of_its_own() -> None:
    assert (in_chunks(np.negative, np.arange(4), 4, 2) == -np.arange(4)).all()
    child = os.fork()
    if not child:
        os._exit(0 if (in_chunks(np.negative, np.arange(4), 4, 2) == -np.arange(4)).all() else 1)
    assert os.waitpid(child, 0)[1] == 0


def test_threads_are_counted_from_one_and_belong_to_vector_environments() -> None:
    with pytest.raises(InputError, match="num_threads is 0, expected"):
        gym.make_vec("wavegym/KershawEvans-v0", num_envs=2, num_threads=0)
    with pytest.raises(InputError, match="num_threads is a setting of vector environments"):
        gym.make("wavegym/KershawEvans-v0", num_threads=2)
