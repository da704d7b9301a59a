"""Tracks of Stone Soup as the belief of a wavegym system."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.system import System
from wavegym.integrations.stonesoup.sensor import WaveformRadar
from wavegym.systems.composed import PlanarRadar


class TrackReader:
    """Reads the belief of one environment from tracks.

    A track takes the slot of a target whose first estimate is nearest to its own, and keeps it. A slot that no track
    has taken yet holds the system's first estimate; a slot whose track has ended, its last one.

    Args:
        system: whose belief is read.
        radar: that says how Stone Soup's state vectors are ordered. Tracks in a plane become range and range-rate, seen
            from the radar, where the system is one of a line of sight.

    Raises:
        InputError: a belief that holds more than means and covariances, or states that cannot be told from the tracks.
    """

    def __init__(self, system: System, radar: WaveformRadar) -> None:
        self._system, self._radar = system, radar
        world = trees.stack([system.draw_world(np.random.default_rng(0))])
        first: Any = system.initial(world).belief
        # Prediction begins with means and covariances, also if a tracker of wavegym keeps hypotheses.
        self._first = first._replace(hypotheses=None) if hasattr(first, "hypotheses") else first
        fields = getattr(self._first, "_fields", ())
        other = [name for name in fields if name not in ("step", "mean", "covariance")]
        told = [name for name in other if getattr(self._first, name) is not None]
        if not {"step", "mean", "covariance"} <= set(fields) or told:
            given = f"belief of {type(system).__name__} has {', '.join(told) or 'no means and covariances'}"
            raise InputError(f"{given}, expected means and covariances only, which tracks tell (nearest: KershawEvans)")
        n, mapping = self._first.mean.shape[-1], tuple(radar.mapping)
        self._is_projected = len(mapping) != n
        if self._is_projected and (n != len(radar.law.quantities) or not isinstance(radar.law, PlanarRadar)):
            wanted = f"a mapping of {n} elements, as states of {type(system).__name__} have, or a PlanarRadar for 2"
            raise InputError(f"mapping of the radar is {mapping}, expected {wanted}")
        self.restart()

    def restart(self) -> None:
        """Forget which track has which slot."""
        self._slots: dict[Any, int] = {}
        self._mean = self._first.mean.reshape(-1, self._first.mean.shape[-1]).copy()
        self._covariance = self._first.covariance.reshape(*self._mean.shape, -1).copy()

    def read(self, tracks: Any, step: int) -> Any:
        """The belief (axis 0 = environment, of length 1) at ``step``.

        Raises:
            InputError: no track, or more tracks than targets.
        """
        estimates = {track.id: self._estimate(track) for track in tracks}
        self._assign({id: mean for id, (mean, _) in estimates.items() if id not in self._slots})
        for id, (mean, covariance) in estimates.items():
            self._mean[self._slots[id]], self._covariance[self._slots[id]] = mean, covariance
        return self._first._replace(
            step=np.array([step]),
            mean=self._mean.reshape(self._first.mean.shape).copy(),
            covariance=self._covariance.reshape(self._first.covariance.shape).copy(),
        )

    def _estimate(self, track: Any) -> tuple[Array, Array]:
        """Mean (n,) and covariance (n, n) of a track's last state, in the system's coordinates."""
        radar = self._radar
        if self._is_projected:
            model = radar.measurement_model
            H = model.jacobian(track)
            return np.ravel(model.function(track)), H @ np.asarray(track.covar, np.float64) @ H.T
        order = list(radar.mapping)
        return np.asarray(track.mean, np.float64).ravel()[order], np.asarray(track.covar, np.float64)[
            np.ix_(order, order)
        ]

    def _assign(self, fresh: dict[Any, Array]) -> None:
        """Give each new track the free slot of the nearest first estimate."""
        free = [i for i in range(len(self._mean)) if i not in self._slots.values()]
        if len(fresh) > len(free) or not (fresh or self._slots):
            given = f"{len(fresh) + len(self._slots)} tracks"
            raise InputError(f"the scheduler is given {given}, expected 1 to {len(self._mean)}, one for each target")
        if fresh:
            distance = np.linalg.norm(np.stack(list(fresh.values()))[:, None] - self._mean[free], axis=-1)
            for id, column in zip(fresh, linear_sum_assignment(distance)[1], strict=True):
                self._slots[id] = free[column]
