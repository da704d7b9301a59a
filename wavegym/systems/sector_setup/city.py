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
from wavegym.systems.sector_setup import kernels, prediction_kernels
from wavegym.systems.sector_setup.state import Belief, World, sector_fields
from wavegym.systems.sector_setup.system import NN, Point, SectorSetup
from wavegym.systems.sector_setup.visibility_kernels import BLUR

PLACES = 48  # of a target, at which it may be hidden
FEW_PLACES = 24  # the same where many steps are foretold
FARTHEST = 1e7  # m: where the map of targets that drive on ends


@system_parameters
class SectorSetupCity(SectorSetup):
    """One illuminator serves several targets on an urban map; buildings hide them where they truly are.

    Description
        As wavegym/SectorSetup-v0, with two roads behind a row of boards. Targets start anywhere on the roads, right of
        the centre line, and drive along them. A target is hidden when, at the end of a step, a building stands between
        its true place and the illuminator or a receiver. Nobody knows these times. Tracker and schedulers know the map
        and the estimates, and foretell the probability that a target is visible, anew in each step. The tracker learns
        from every look: a detection says that the target was visible, and a look that finds nothing that it was
        probably hidden. With ``windows`` the times are those given, known from the start, and buildings hide nothing.

    Rewards
        As wavegym/SectorSetup-v0.

    Starting state
        True targets start on the roads; estimates as in wavegym/SectorSetup-v0.

    Episode end
        Terminates after ``horizon`` steps; the time left is observed.

    References
        As wavegym/SectorSetup-v0.
    """

    city: str = parameter(
        "promenade",
        "an urban map of wavegym, or a TOML file, with roads; region, shown and hidden are not used",
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
    waveforms: tuple[tuple[Positive, Positive], ...] = changed_default(
        SectorSetup, "waveforms", ((1.0, 2.0), (5.0, 0.1))
    )
    reference_range: float = changed_default(SectorSetup, "reference_range", 300.0)
    nearest_range: float = changed_default(SectorSetup, "nearest_range", 15.0)
    tracks: None = parameter(None, "not used: targets drive along roads", unit="")
    radar: None = parameter(None, "not used", unit="")
    recorded_windows: ClassVar[None] = None
    lost_beyond: ClassVar[float] = 9.0  # m: half the width of a sector of .15 rad at 120 m

    def __post_init__(self) -> None:
        """Check what single fields cannot say."""
        super().__post_init__()
        if not self.map.roads:
            raise InputError(f"city is {self.city!r}, expected a map with roads, on which targets start")
        self.map.check_roads()
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
        """Whether the times of visibility are known from the start."""
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
        """As in SectorSetup; where visibility is foretold, a probability stands for it."""
        known = self._times_are_known
        return sector_fields(self.targets, len(self.receivers), self.dead_steps, foretold=not known)

    @property
    def outcome_shape(self) -> tuple[int, ...]:
        """As in SectorSetup; where visibility is foretold, with a draw of the target's place before the others."""
        return super().outcome_shape if self._times_are_known else (1 + len(self.receivers),)

    def _visible(self, world: World, true_states: Array) -> Array:
        """Whether no building hides the targets at the end of each step, bool (env, H, target)."""
        if self.windows:
            return super()._visible(world, true_states)
        return np.logical_and.reduce([site.directly_visible(self._driven(world, true_states)) for site in self._sites])

    def _driven(self, world: World, true_states: Array) -> Array:
        """True places at the end of each step, (env, H, target, 2).

        No action moves a target, so its whole path is known to the world from the start.
        """
        states = np.empty((len(true_states), self.horizon, *true_states.shape[1:]))
        here, q, step = true_states, self._densities(world), np.zeros(len(true_states), np.int64)
        for k in range(self.horizon):
            after = np.empty(here.shape)
            kernels.move(step + k, here, q, world.process, self.motion.noise_factor, self._radar, after, NN)
            states[:, k] = here = after
        return states[..., ::2]

    def _known(self, world: World, true_states: Array, visible: Array) -> Array:
        """As in SectorSetup; where visibility is foretold, nobody is told when buildings hide a target: all True."""
        return super()._known(world, true_states, visible) if self._times_are_known else np.ones_like(visible)

    def visible_ahead(self, belief: Belief, steps: int) -> Array:
        """Probability that each target is visible in each of the next steps, (env, steps, target).

        From the estimate, its covariance and the map; without further looks. 0 after the end of the episode.

        Raises:
            InputError: fewer than one step.
        """
        out = np.empty((len(belief.step), check_int("steps", steps, 1), belief.mean.shape[1]))
        prediction_kernels.foretell(*belief, self._radar, out, NN)
        return out


def spread_places(count: int) -> Array:
    """Points (count, 2) of equal weight on a sunflower's spiral, for the kernels of ``visibility_kernels``.

    Mean 0 and covariance 1 - BLUR times the identity: with the blur of each point they have the moments of a standard
    normal distribution.
    """
    share, golden = (np.arange(count) + 0.5) / count, np.pi * (3.0 - np.sqrt(5.0))
    angle, radius = golden * np.arange(count), np.sqrt(-2.0 * np.log1p(-share))
    points = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points -= points.mean(axis=0)
    root = np.linalg.cholesky(points.T @ points / count)
    return np.ascontiguousarray(np.sqrt(1.0 - BLUR) * np.linalg.solve(root, points.T).T)
