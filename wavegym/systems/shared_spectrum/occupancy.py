"""Predictors of the occupancy by the names that ``SharedSpectrum.predictor`` takes."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_choice
from wavegym.sensors.interference import Bands
from wavegym.systems.shared_spectrum import occupancy_kernels as kernels

MEMORY = 0.98  # of "lags": see ``occupancy_kernels.lags``; chosen on tuning worlds
FAMILIES: dict[str, tuple[Any, int]] = {  # a kernel with constants that follow from a number, and the greatest number
    "counts": (lambda number: (kernels.counts, ()), 0),
    "markov": (lambda number: (kernels.markov, ()), 0),
    "reactions": (lambda number: (kernels.reactions, ()), 0),
    "lags": (lambda number: (kernels.lags, (number, MEMORY)), 100),
    "stepped": (lambda number: (kernels.stepped, (number, MEMORY)), 100),
    "context-tree": (lambda number: (kernels.context_tree, (number,)), 12),
}


def predictor_of(name: str, bands: Bands) -> Callable[[Array, Array, Array, int], Array]:
    """The predictor ``name``, a function of four arguments.

    They are the noise heard (env, T, channel), the radar's bands (env, H), the steps heard (env,) and the steps from
    the last one heard to the one predicted. It returns probabilities (env, channel).

    Args:
        name: "counts", "markov", "reactions", or with a number of steps "lags:N", "stepped:N" and "context-tree:N".
        bands: that the radar may choose.

    Raises:
        InputError: another name, or a number out of range.
    """
    family, colon, number = name.partition(":")
    make, most = FAMILIES[check_choice("predictor", family, FAMILIES)]
    if most and not (re.fullmatch(r"[1-9]\d*", number) and int(number) <= most):
        raise InputError(f"predictor is {name!r}, expected {family}: and 1 to {most} steps (nearest: '{family}:10')")
    if colon and not most:
        raise InputError(f"predictor is {name!r}, expected {family!r}, which has no number")
    kernel, constants = make(int(number or 0))

    def predictor(heard: Array, sent: Array, length: Array, gap: int) -> Array:
        found = np.empty((len(length), heard.shape[2]))
        own = (sent, bands.first, bands.width) if kernel is kernels.reactions else ()
        kernel(heard, *own, length, gap, *constants, found)
        return found

    return predictor
