"""The sector set-up on an urban map: targets drive along roads, and buildings hide them."""

from __future__ import annotations

import math
from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int
from wavegym.core.parameters import NonNegative, Positive, changed_default, parameter, system_parameters
from wavegym.core.system import ObservationField
from wavegym.sensors.multipath import Antenna, sight_table
from wavegym.sensors.multipath_kernels import SightTable
from wavegym.sensors.urban_map import UrbanMap
from wavegym.systems.look_system import NN
from wavegym.systems.sector_setup import prediction_kernels
from wavegym.systems.sector_setup.state import Belief, World, sector_fields
from wavegym.systems.sector_setup.system import Point, SectorSetup, Train
from wavegym.systems.sector_setup.visibility_kernels import BLUR

PLACES = 48  # points of a target's distribution, for which visibility is evaluated
FEW_PLACES = 24  # the same for predictions of many steps
FARTHEST = 1e7  # m: limit of the map for targets that drive out of the city


@system_parameters
class SectorSetupCity(SectorSetup):
    """One illuminator serves several targets on an urban map; buildings hide them.

    Description
        As wavegym/SectorSetup-v0, with two roads behind a row of boards. Targets start anywhere on the roads, right of
        the centre line, and drive along them. A target is hidden if, at the end of a step, a building stands between
        its true position and the illuminator or a receiver. The times at which targets are hidden are unknown.

        Tracker and schedulers know the map and the estimates. At each step they predict the probability that a target
        is visible. The tracker learns from every look: a detection shows that the target was visible, and a miss shows
        that it was probably hidden. A ``tracker`` of your own does not learn from a miss, because a scan contains only
        detections. With ``windows`` the times are given and known in advance, and buildings hide nothing.

    Rewards
        As wavegym/SectorSetup-v0.

    Starting state
        True targets start on the roads. Estimates are as in wavegym/SectorSetup-v0.

    Episode end
        Terminates after ``horizon`` steps. The remaining time is observed.

    References
        As wavegym/SectorSetup-v0.
    """

    city: str = parameter(
        "promenade",
        "an urban map of wavegym, or a TOML file, with roads; replaces region, shown and hidden",
        unit="",
        truth=True,
    )
    dt: float = changed_default(SectorSetup, "dt", 0.5)
    illuminator: Point = changed_default(SectorSetup, "illuminator", (0.0, 0.0))
    receivers: tuple[Point, ...] = changed_default(SectorSetup, "receivers", ((-80.0, 0.0), (80.0, 0.0)))
    speed: tuple[NonNegative, float] = changed_default(SectorSetup, "speed", (3.0, 10.0))
    q: tuple[Positive, float] = changed_default(SectorSetup, "q", (0.002, 0.1))
    prior_variance: tuple[Positive, Positive, Positive, Positive] = changed_default(
        SectorSetup, "prior_variance", (9.0, 1.0, 9.0, 1.0)
    )
    carrier_hz: float = changed_default(SectorSetup, "carrier_hz", 10e9)
    waveforms: tuple[Train, ...] = changed_default(
        SectorSetup, "waveforms", ((4, 250e-6, 9e-6, 15e6), (72, 250e-6, 0.5e-6, 3e6))
    )
    reference_range: float = changed_default(SectorSetup, "reference_range", 300.0)
    nearest_range: float = changed_default(SectorSetup, "nearest_range", 15.0)
    tracks: None = parameter(None, "not used: targets drive along roads", unit="")
    radar: None = parameter(None, "not used", unit="")
    recorded_windows: ClassVar[None] = None
    lost_beyond: ClassVar[float] = 9.0  # m: half the width of a sector of 0.15 rad at 120 m

    def __post_init__(self) -> None:
        """Check several fields together."""
        if not self.map.roads:
            raise InputError(f"city is {self.city!r}, expected a map with roads, on which targets start")
        self.map.check_roads()
        super().__post_init__()
        _ = self._sites

    @cached_property
    def map(self) -> UrbanMap:
        """The urban map."""
        return UrbanMap.load(self.city)

    @cached_property
    def _sites(self) -> list[Antenna]:
        return [Antenna(self.map, place) for place in (self.illuminator, *self.receivers)]

    @cached_property
    def _lanes(self) -> tuple[Array, Array]:
        """Ends of the segments of all roads, (segment, 2, 2), and half their width, (segment,)."""
        lanes = [(ends, road.width / 2) for road in self.map.roads for ends in pairwise(road.centre)]
        return np.array([ends for ends, _ in lanes]), np.array([half for _, half in lanes])

    def _farthest(self) -> float:
        """Half the greatest path over an end of a road, m; targets may drive further."""
        ends = self._lanes[0].reshape(-1, 2)
        return float(self._half_paths(np.concatenate([ends, np.zeros_like(ends)], axis=1))[..., 0].max())

    def _starts(self, world: World) -> Array:
        """Uniform along all roads, right of the centre line, driving along the road."""
        ends, half = self._lanes
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        along, beside, speed, direction = np.moveaxis(world.place, -1, 0)
        far = along * length.sum()
        segment = np.minimum(np.searchsorted(np.cumsum(length), far, side="right"), len(length) - 1)
        far = far - (np.cumsum(length) - length)[segment]
        forward = (ends[:, 1] - ends[:, 0]) / length[:, None]
        driven = np.where(direction[..., None] < 0.5, 1.0, -1.0) * forward[segment]
        right = np.stack([driven[..., 1], -driven[..., 0]], axis=-1)
        place = ends[segment, 0] + far[..., None] * forward[segment] + (beside * half[segment])[..., None] * right
        velocity = (self.speed[0] + (self.speed[1] - self.speed[0]) * speed)[..., None] * driven
        return np.stack([place[..., 0], velocity[..., 0], place[..., 1], velocity[..., 1]], axis=-1)

    @property
    def _times_are_known(self) -> bool:
        """Whether the times of visibility are known in advance."""
        return bool(self.windows)

    @cached_property
    def _hiding(self) -> tuple[SightTable, Array, Array]:
        if self._times_are_known:
            return super()._hiding
        seconds = self.dt * self.horizon
        astray = 2.0 * math.sqrt(self.q[1] * seconds**3 / 3.0)  # standard deviations, at the end of the episode
        table = sight_table(tuple(self._sites), min(self.speed[1] * seconds, FARTHEST), min(astray, FARTHEST))
        return table, spread_places(PLACES), spread_places(FEW_PLACES)

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """As in SectorSetup; if visibility is predicted, with its probability."""
        known = self._times_are_known
        return sector_fields(self.targets, len(self.receivers), self.dead_steps, predicted=not known)

    @property
    def outcome_shape(self) -> tuple[int, ...]:
        """As in SectorSetup; if visibility is predicted, a draw of the target's place comes first."""
        return super().outcome_shape if self._times_are_known else (1 + len(self.receivers),)

    def _visible(self, world: World, true_states: Array) -> Array:
        """Whether no building hides the targets at the end of each step, bool (env, H, target)."""
        if self.windows:
            return super()._visible(world, true_states)
        places = self._driven(world, true_states)[..., ::2]
        return np.logical_and.reduce([site.directly_visible(places) for site in self._sites])

    def _known(self, world: World, true_states: Array, visible: Array) -> Array:
        """As in SectorSetup; all True if visibility is predicted, because the times are unknown."""
        return super()._known(world, true_states, visible) if self._times_are_known else np.ones_like(visible)

    def visible_ahead(self, belief: Belief, steps: int) -> Array:
        """Probability that each target is visible in each of the next steps, (env, steps, target).

        It follows from the estimate, its covariance and the map, without further looks. 0 after the end of the episode.

        Raises:
            InputError: fewer than one step.
        """
        out = np.empty((len(belief.step), check_int("steps", steps, 1), belief.mean.shape[1]))
        prediction_kernels.predict_visibility(*self._expected(belief)[:8], self._radar, out, NN)
        return out


def spread_places(count: int) -> Array:
    """Points (count, 2) of equal weight on a sunflower's spiral, for the kernels of ``visibility_kernels``.

    They have the mean 0 and the covariance 1 - BLUR times the identity. With the blur of each point they have the
    moments of a standard normal distribution.
    """
    share, golden = (np.arange(count) + 0.5) / count, np.pi * (3.0 - np.sqrt(5.0))
    angle, radius = golden * np.arange(count), np.sqrt(-2.0 * np.log1p(-share))
    points = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points -= points.mean(axis=0)
    root = np.linalg.cholesky(points.T @ points / count)
    return np.ascontiguousarray(np.sqrt(1.0 - BLUR) * np.linalg.solve(root, points.T).T)
