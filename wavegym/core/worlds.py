"""Seeds of the worlds for training, for tuning and for the test: three families without a common world.

A seed ``s`` stands for the first episode of ``env.reset(seed=s)``. With plain seeds 0, 1, 2, ... the first training run
would train on the worlds of the test.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.utils import seeding

from wavegym.core import trees
from wavegym.core.errors import check_choice, check_int
from wavegym.core.system import System

SPLITS = ("train", "tune", "test")
WORDS = 4  # of 32 bits in a seed: two of 128 bits never meet by chance
TUNING_STEPS, LEAST_WORLDS, MOST_WORLDS = 20_000, 20, 200  # of tuning: a long episode has more information


def word(text: str) -> int:
    """A stable integer for a word (CRC-32): Python's own hash differs from process to process."""
    return zlib.crc32(text.encode())


def world_seeds(seed: int, split: str, count: int) -> list[int]:
    """Seeds of the first ``count`` worlds of a split; world i does not depend on ``count``.

    Args:
        seed: of a comparison, >= 0; all its worlds follow from it.
        split: "train", "tune" or "test".
        count: how many.

    Returns:
        Integers of 128 bits for ``env.reset(seed=[...])``.

    Raises:
        InputError: an unknown split, a negative seed or count.
    """
    key = word(check_choice("split", split, SPLITS))
    check_int("seed", seed, 0)
    return [_seed(np.random.SeedSequence([seed, key, i])) for i in range(check_int("worlds", count, 0))]


def training_seeds(base_seed: int, seed: int, num_envs: int) -> list[int]:
    """One seed for each environment of the training run number ``seed``, spawned from [base_seed, "train", seed].

    Raises:
        InputError: a negative argument.
    """
    parent = np.random.SeedSequence([check_int("base_seed", base_seed, 0), word("train"), check_int("seed", seed, 0)])
    return [_seed(child) for child in parent.spawn(check_int("num_envs", num_envs, 0))]


def draw_worlds(system: System, seeds: Sequence[int]) -> Any:
    """The tapes that ``env.reset(seed=list(seeds))`` would draw, axis 0 = world."""
    return trees.stack([system.draw_world(seeding.np_random(seed)[0]) for seed in seeds])


def tuning_worlds(system: System) -> int:
    """The number of tuning worlds: their episodes have about TUNING_STEPS steps together, within bounds."""
    return min(max(TUNING_STEPS // system.horizon, LEAST_WORLDS), MOST_WORLDS)


def tuning_tapes(system: System, seed: int) -> Any:
    """The tapes that policies are tuned on in a comparison with this seed, axis 0 = world."""
    return draw_worlds(system, world_seeds(seed, "tune", tuning_worlds(system)))


def _seed(sequence: np.random.SeedSequence) -> int:
    return int.from_bytes(sequence.generate_state(WORDS).astype("<u4").tobytes(), "little")
