"""The sector set-up in a city: targets drive along its roads, and its buildings hide them."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.sensors.multipath import Antenna
from wavegym.sensors.urban_map import City
from wavegym.systems.sector_setup.state import Pair, Quad, World
from wavegym.systems.sector_setup.system import SectorSetup


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class SectorSetupCity(SectorSetup):
    """One illuminator serves several targets in a city; its buildings hide them, at times known from the beginning.

    Description
        As wavegym/SectorSetup-v0 before a row of boards. Targets start anywhere on the roads, on the right of the
        middle, and drive along them. Each has filed its route: where it starts, without error, and the velocity at
        which it means to drive on. Route and map say when a building would stand between it and the illuminator or a
        receiver; then it is out of sight, and else in sight, also where manoeuvres have taken it off its route. These
        times tell a scheduler something of the true start that the tracker does not use.

    Rewards
        As wavegym/SectorSetup-v0.

    Starting state
        True targets start on the roads; estimates as in wavegym/SectorSetup-v0.

    Episode end
        Terminates after ``horizon`` steps; the time left is observed.

    Arguments
        city: one that comes with wavegym, or a TOML file, with roads. region, shown and hidden are not used; windows,
        where given, take the place of the city's. All others as wavegym/SectorSetup-v0.

    References
        As wavegym/SectorSetup-v0.
    """

    city: str = "promenade"
    dt: float = 0.5
    illuminator: Pair = (0.0, 0.0)
    receivers: tuple[Pair, ...] = ((-80.0, 0.0), (80.0, 0.0))
    speed: Pair = (3.0, 10.0)
    q: Pair = (0.002, 0.1)
    prior_variance: Quad = (9.0, 1.0, 9.0, 1.0)
    waveforms: tuple[Pair, ...] = ((1.0, 2.0), (5.0, 0.1))
    reference_range: float = 300.0
    nearest_range: float = 15.0
    lost_beyond: ClassVar[float] = 9.0  # m: half the width of a lit sector of .15 rad at 120 m

    def __post_init__(self) -> None:
        """Check what single types cannot say."""
        super().__post_init__()
        if not self.map.roads:
            raise InputError(f"city is {self.city!r}, expected one with roads, on which targets start")
        self.map.check_roads()
        _ = self._sites

    @cached_property
    def map(self) -> City:
        """The city."""
        return City.load(self.city)

    @cached_property
    def _sites(self) -> list[Antenna]:
        return [Antenna(self.map, place) for place in (self.illuminator, *self.receivers)]

    @cached_property
    def _lanes(self) -> tuple[Array, Array]:
        """Stretches of the roads, from where to where, (stretch, 2, 2), and half their width, (stretch,)."""
        lanes = [(ends, road.width / 2) for road in self.map.roads for ends in pairwise(road.centre)]
        return np.array([ends for ends, _ in lanes]), np.array([half for _, half in lanes])

    def _starts(self, world: World) -> Array:
        """Anywhere on the roads, alike for every metre, on their right-hand side, driving along them."""
        ends, half = self._lanes
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        along, beside, speed, way = np.moveaxis(world.place, -1, 0)
        far = along * length.sum()
        stretch = np.minimum(np.searchsorted(np.cumsum(length), far, side="right"), len(length) - 1)
        far = far - (np.cumsum(length) - length)[stretch]
        forward = (ends[:, 1] - ends[:, 0]) / length[:, None]
        driven = np.where(way[..., None] < 0.5, 1.0, -1.0) * forward[stretch]
        right = np.stack([driven[..., 1], -driven[..., 0]], axis=-1)
        place = ends[stretch, 0] + far[..., None] * forward[stretch] + (beside * half[stretch])[..., None] * right
        velocity = (self.speed[0] + (self.speed[1] - self.speed[0]) * speed)[..., None] * driven
        return np.stack([place[..., 0], velocity[..., 0], place[..., 1], velocity[..., 1]], axis=-1)

    def _in_sight(self, world: World, truth: Array) -> Array:
        """While the illuminator and every receiver would see them if they drove on as they started."""
        if self.windows:
            return super()._in_sight(world, truth)
        t = self.dt * np.arange(1, self.horizon + 1)[:, None, None]
        places = truth[:, None, :, ::2] + t * truth[:, None, :, 1::2]  # where they are looked at in each step
        return np.logical_and.reduce([site.in_sight(places) for site in self._sites])
