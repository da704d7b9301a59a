"""False confirmed tracks in the urban scene: their number, and the returns from which they were made."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wavegym.core.arrays import Array
from wavegym.sensors import multistatic_range_and_rate
from wavegym.sensors.urban_map import Point
from wavegym.systems.urban.state import HELD_WITHIN, Scene

STRAYED, MIRROR, WALLS, OTHER = "strayed", "mirror", "walls", "other"
ORIGINS = (STRAYED, MIRROR, WALLS, OTHER)
NEAR = (5.0, 2.0)  # m, m/s: a return this close to the track's own predicted return explains the track


def false_tracks(scene: Scene, transmitter: Point, receivers: Sequence[Point], place: Array, born: Array) -> Array:
    """The number of confirmed tracks with no target within 20 m at some scan, each counted once, by origin.

    *strayed*: a target was near when the track was confirmed, but not later. The origin of the others follows from the
    scan of confirmation: at every receiver some target has a return, over a visible path, where the track predicts its
    own direct return. *mirror*: direct returns of one target at all receivers, so that the position is on the wrong
    side of the receivers. *walls*: some returns are reflected, or come from different targets. *other*: anything else.

    Args:
        scene: targets and their visible paths, by scan.
        transmitter, receivers: (x, y) in m.
        place: states of confirmed tracks at scans 1, 2, ..., (run, k, slot, 4); NaN where there is none.
        born: the scan at which the track in a slot began, (run, k, slot).

    Returns:
        (run, origin), in the order of ``ORIGINS``.
    """
    run, slot, k = np.nonzero(np.isfinite(place[..., 0]).swapaxes(1, 2))  # in the order of a track's scans
    x = place[run, k, slot]
    off = scene.truth[k + 1, :, :2] - x[:, None, :2]
    distance = np.where(scene.present[k + 1], np.hypot(off[..., 0], off[..., 1]), np.inf)
    far = distance.min(axis=1) > HELD_WITHIN
    _, first, track = np.unique(
        np.stack([run, slot, born[run, k, slot]], axis=1), axis=0, return_index=True, return_inverse=True
    )
    counts = np.zeros((len(place), len(ORIGINS)), np.int64)
    first = first[np.bincount(track.ravel(), weights=far, minlength=len(first)) > 0]
    of = np.where(far[first], _made_of(scene, transmitter, receivers, x[first], k[first] + 1), ORIGINS.index(STRAYED))
    np.add.at(counts, (run[first], of), 1)
    return counts


def _made_of(scene: Scene, transmitter: Point, receivers: Sequence[Point], x: Array, scan: Array) -> Array:
    """Indices of origins of tracks at states x (n, 4) at scans (n,), as if none had strayed."""
    explained, straight = [], []
    for m, place in enumerate(receivers):
        own = multistatic_range_and_rate(x, transmitter, place)
        visible = np.arange(scene.z.shape[3]) < scene.path_count[m, scan][..., None]  # (n, target, path)
        close = (np.abs(scene.z[m, scan] - own[:, None, None]) <= NEAR).all(axis=-1) & visible
        explained.append(close.any(axis=(1, 2)))
        straight.append((close & (scene.reflected[m, scan] == 1.0)).any(axis=2))  # walls reflect without loss
    mirror = np.logical_and.reduce(straight).any(axis=1)
    walls = np.where(np.logical_and.reduce(explained), ORIGINS.index(WALLS), ORIGINS.index(OTHER))
    return np.where(mirror, ORIGINS.index(MIRROR), walls)
