"""The seed argument of a reset, as one seed for each environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wavegym.core.errors import InputError

Seed = int | Sequence[int | None] | NDArray[np.integer] | None


def seed_list(seed: Seed, num_envs: int) -> list[int | None]:
    """One seed or None for each environment: s gives environment i the seed s + i, a list or an array is taken as is.

    Raises:
        InputError: a seed that is not an integer >= 0, or a list of the wrong length.
    """
    if isinstance(seed, np.ndarray):
        seed = seed.tolist()
    if seed is None:
        return [None] * num_envs
    if not isinstance(seed, Sequence) or isinstance(seed, str):
        first = _checked(seed)
        return [first + i for i in range(num_envs)]
    if len(seed) != num_envs:
        raise InputError(f"seed has {len(seed)} entries, expected {num_envs}: one for each environment")
    return [None if each is None else _checked(each) for each in seed]


def _checked(seed: Any) -> int:
    if not isinstance(seed, (int, np.integer)) or isinstance(seed, bool) or seed < 0:
        raise InputError(f"seed is {seed!r}, expected an integer >= 0")
    return int(seed)
