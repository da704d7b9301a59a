"""The traffic of the multifunction radar: an isotropic flow of targets through a sector of a ring.

In the plane targets are a Poisson process with uniform places and headings. A region has a uniform intensity inside.
Over each metre of its edge targets enter at the rate density x mean speed / pi. The angle of their heading from the
inward normal is distributed by its cosine; their speeds are distributed in proportion to frequency times speed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from wavegym.core.arrays import Array


class Traffic(NamedTuple):
    """The region, and how many targets fly in it how fast."""

    nearest: float  # m
    farthest: float  # m
    half_sector: float  # rad
    targets: float  # expected number inside
    slowest: float  # m/s
    fastest: float  # m/s

    @property
    def area(self) -> float:
        """Of the region, m^2."""
        return self.half_sector * (self.farthest**2 - self.nearest**2)

    @property
    def density(self) -> float:
        """Targets for each square metre."""
        return self.targets / self.area

    @property
    def mean_speed(self) -> float:
        """Of the targets inside, m/s."""
        return 0.5 * (self.slowest + self.fastest)

    @property
    def velocity_variance(self) -> float:
        """Of the velocity on each axis, (m/s)^2."""
        low, high = self.slowest, self.fastest
        return (low * low + low * high + high * high) / 6.0

    @property
    def arc_and_sides(self) -> Array:
        """Lengths of the outer arc, the inner arc and the two sides, m."""
        side = self.farthest - self.nearest
        return np.array([2 * self.half_sector * self.farthest, 2 * self.half_sector * self.nearest, side, side])

    @property
    def rate(self) -> float:
        """Targets that come over the edge, 1/s."""
        return float(self.density * self.mean_speed / math.pi * self.arc_and_sides.sum())

    @property
    def mean_stay(self) -> float:
        """Mean time from edge to edge of a target that flies straight on, s."""
        return math.pi * self.area / float(self.mean_speed * self.arc_and_sides.sum())

    def most_targets(self, seconds: float) -> int:
        """Number of targets that is exceeded in one of a billion episodes."""
        expected = self.targets + self.rate * seconds if self.targets else 0.0
        return math.ceil(expected + 6.5 * math.sqrt(expected)) + 10

    def states(self, draw: Array) -> tuple[Array, Array]:
        """States [x xdot y ydot] (..., target, 4) at arrival, and the arrivals (..., target) in s.

        Args:
            draw: uniform draws (..., target, 7); see ``World``.
        """
        passed = np.cumsum(-np.log1p(-draw[..., 0]), axis=-1)  # a Poisson process of rate 1
        inside = passed < self.targets
        arrival = np.where(inside, -1.0, (passed - self.targets) / self.rate if self.targets else np.inf)
        place, inward = self._inside(draw), self._on_the_edge(draw)
        r, azimuth, heading, speed = (np.where(inside, a, b) for a, b in zip(place, inward, strict=True))
        along = [r * np.sin(azimuth), speed * np.sin(heading), r * np.cos(azimuth), speed * np.cos(heading)]
        return np.stack(along, axis=-1), arrival

    def _inside(self, draw: Array) -> tuple[Array, ...]:
        """Range, azimuth, heading and speed of targets that are there at the beginning."""
        r = np.sqrt(self.nearest**2 + draw[..., 1] * (self.farthest**2 - self.nearest**2))
        azimuth = self.half_sector * (2.0 * draw[..., 2] - 1.0)
        speed = self.slowest + draw[..., 4] * (self.fastest - self.slowest)
        return r, azimuth, 2.0 * math.pi * draw[..., 3], speed

    def _on_the_edge(self, draw: Array) -> tuple[Array, ...]:
        """Range, azimuth, heading and speed of targets that come over the edge."""
        ends = np.cumsum(self.arc_and_sides)
        side = np.searchsorted(ends / ends[-1], draw[..., 1], side="right").clip(max=3)
        along_arc = self.half_sector * (2.0 * draw[..., 2] - 1.0)
        along_side = self.nearest + draw[..., 2] * (self.farthest - self.nearest)
        azimuth = np.choose(side, [along_arc, along_arc, -self.half_sector, self.half_sector])
        r = np.choose(side, [self.farthest, self.nearest, along_side, along_side])
        normal = azimuth + np.choose(side, [math.pi, 0.0, 0.5 * math.pi, -0.5 * math.pi])
        heading = normal + np.arcsin(2.0 * draw[..., 3] - 1.0)
        speed = np.sqrt(self.slowest**2 + draw[..., 4] * (self.fastest**2 - self.slowest**2))
        return r, azimuth, heading, speed
