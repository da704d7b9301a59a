"""The inputs of metrics for several targets and tracks: positions, and which of them count."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.array_checks import check_finite, check_last_axes, flatten_lead
from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError

Mask = NDArray[np.bool_]


class Pictures(NamedTuple):
    """Positions and what counts of them, with one flat leading axis."""

    targets: FloatArray  # (batch, T, d)
    present: Mask  # (batch, T)
    tracks: FloatArray  # (batch, N, d)
    alive: Mask  # (batch, N)


def flat_pictures(
    targets: ArrayLike, tracks: ArrayLike, present: ArrayLike, alive: ArrayLike
) -> tuple[Pictures, tuple[int, ...]]:
    """Check the arguments of a metric and flatten their leading axes.

    Args:
        targets: true positions in m, (..., T, d).
        tracks: estimated positions in m, (..., N, d).
        present: whether each target exists, (..., T).
        alive: whether each track counts, (..., N).

    Returns:
        The pictures, and the leading axes, which broadcast.

    Raises:
        InputError: shapes that do not fit, or a position that counts and is not finite.
    """
    truth, found = check_last_axes("targets", targets), check_last_axes("tracks", tracks)
    if min(truth.ndim, found.ndim) < 2 or truth.shape[-1] != found.shape[-1]:
        raise InputError(
            f"targets and tracks have shapes {truth.shape} and {found.shape}, expected (..., T, d) and (..., N, d)"
        )
    (T, d), N = truth.shape[-2:], found.shape[-2]
    there, counts = np.asarray(present, np.bool_), np.asarray(alive, np.bool_)
    try:
        lead = np.broadcast_shapes(truth.shape[:-2], found.shape[:-2], there.shape[:-1], counts.shape[:-1])
        flat = Pictures(
            flatten_lead(truth, lead, T, d),
            flatten_lead(there, lead, T),
            flatten_lead(found, lead, N, d),
            flatten_lead(counts, lead, N),
        )
    except ValueError:
        raise InputError(
            f"present and alive have shapes {there.shape} and {counts.shape} beside targets {truth.shape} and tracks "
            f"{found.shape}, expected (..., {T}) and (..., {N}) that broadcast"
        ) from None
    for name, positions, counted in (("targets", *flat[:2]), ("tracks", *flat[2:])):
        check_finite(f"{name} that count", np.where(counted[..., None], positions, 0.0))
    return flat, lead
