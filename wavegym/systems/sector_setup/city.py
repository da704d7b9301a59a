"""The sector set-up on an urban map: targets drive along roads, and buildings hide them."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.parameters import NonNegative, Positive, changed_default, parameter, system_parameters
from wavegym.sensors.multipath import Antenna
from wavegym.sensors.urban_map import UrbanMap
from wavegym.systems.sector_setup.state import World
from wavegym.systems.sector_setup.system import Point, SectorSetup


@system_parameters
class SectorSetupCity(SectorSetup):
    """One illuminator serves several targets on an urban map; buildings hide them at times known from the start.

    Description
        As wavegym/SectorSetup-v0, with two roads behind a row of boards. Targets start anywhere on the roads, right of
        the centre line, and drive along them. Each target has filed its route: its exact start and a constant velocity.
        A target is hidden when, on its filed route, a building stands between it and the illuminator or a receiver;
        otherwise it is visible, even if manoeuvres or a turn rate have taken it off the route. These times depend on
        the true start: schedulers can use them, the tracker does not.

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

    def _visible(self, world: World, true_states: Array) -> Array:
        """Whether no building hides the targets on their filed routes, bool (env, H, target)."""
        if self.windows:
            return super()._visible(world, true_states)
        t = self.dt * np.arange(1, self.horizon + 1)[:, None, None]
        places = true_states[:, None, :, ::2] + t * true_states[:, None, :, 1::2]  # at the end of each step
        return np.logical_and.reduce([site.directly_visible(places) for site in self._sites])
