"""Sira et al.'s search: progressively finer rectangular grids over the whole chirp space, sensor by sensor."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int
from wavegym.core.shortcuts import sensor_by_sensor
from wavegym.core.system import System


class Progressive:
    """The chirps with the least predicted trace one step ahead (Sira et al., section 5).

    For every sensor in turn, and every phase law and direction, it searches a grid over log duration and log sweep,
    then finer grids around the best point, out to its neighbours. For systems that have ``sensor_by_sensor``, with
    ``action="box"``.

    Args:
        points: grid points per axis, at least 3.
        levels: number of grids, at least 1.

    Raises:
        InputError: too few points or levels.
    """

    def __init__(self, points: int = 5, levels: int = 3) -> None:
        self.points, self.levels = check_int("points", points, 3), check_int("levels", levels, 1)

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError for a system without chirps, or with another form of actions."""
        if not (sensor_by_sensor.of(system) and getattr(system, "action", None) == "box"):
            what = f"{type(system).__name__} with action={getattr(system, 'action', None)!r}"
            raise InputError(f"policy 'myopic:progressive' is not for {what}, expected chirps and action='box'")
        self._system: Any = system
        self._sensors = sensor_by_sensor(system)

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        system = self._system
        predicted, chosen = self._sensors.begin(belief), []
        for i in range(system.action_set.sensors):
            chirp, C, windows = self._search(predicted, i)
            chosen.append(chirp)
            if i + 1 < system.action_set.sensors:
                predicted = self._sensors.after(predicted, i, C, windows)
        law, duration, sweep = (np.stack(parts, axis=1) for parts in zip(*chosen, strict=True))
        return system.action_set.encode_chirps(law, duration, sweep)

    def _search(self, predicted: Any, sensor: int) -> tuple[tuple[Array, Array, Array], Array, Array]:
        """The best chirp for one sensor, (env,) each of law, duration and signed sweep, its C (env, 2, 2) and receive
        window (env, 10).
        """
        action_set, count = self._system.action_set, len(predicted.mean)
        law = np.repeat(np.arange(len(action_set.laws)), 2)  # (group,)
        sign = np.tile([1.0, -1.0], len(action_set.laws))
        low = np.log([min(action_set.durations), min(action_set.sweeps)])
        width = np.log([max(action_set.durations), max(action_set.sweeps)]) - low
        centre = np.full((count, len(law), 2), 0.5)  # of each group's grid, in shares of the width
        axis = np.linspace(-0.5, 0.5, self.points)
        offsets = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)  # (point, 2)
        reach = 1.0
        rows = np.arange(count)
        for _ in range(self.levels):
            share = np.clip(centre[:, :, None] + reach * offsets, 0.0, 1.0)  # (env, group, point, 2)
            chirp = np.exp(low + width * share)
            sweeps = chirp[..., 1] * sign[:, None]
            laws = np.broadcast_to(law[:, None], sweeps.shape)
            C = action_set.chirp_covariance(laws, chirp[..., 0], sweeps)
            windows = action_set.chirp_windows(laws, chirp[..., 0], sweeps)
            flat = C.reshape(count, -1, 2, 2), windows.reshape(count, -1, windows.shape[-1])
            cost = self._sensors.costs(predicted, sensor, *flat).reshape(sweeps.shape)
            best = cost.argmin(axis=2)
            centre = np.take_along_axis(share, best[:, :, None, None], axis=2)[:, :, 0]
            reach *= 2.0 / (self.points - 1)
        group = np.take_along_axis(cost, best[:, :, None], axis=2)[..., 0].argmin(axis=1)
        point = best[rows, group]
        found = law[group], chirp[rows, group, point, 0], sweeps[rows, group, point]
        return found, C[rows, group, point], windows[rows, group, point]
