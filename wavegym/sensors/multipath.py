"""Multipath in an urban map: an antenna and its mirror images in one wall or in two successive walls."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.array_checks import check_finite, check_last_axes, check_shape
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.sensors import multipath_kernels as kernels
from wavegym.sensors.urban_map import Point, UrbanMap


@dataclass(frozen=True)
class Antenna:
    """An antenna in an urban map, and its mirror images.

    A ray from the antenna to a point over up to two walls is as long as the straight line from an image to the point,
    and arrives from the same direction. So each image acts as an antenna for delay, Doppler shift and direction.

    Args:
        urban_map: the map whose walls reflect.
        position: (x, y) in m, outside the buildings; for an array, its centre.
        axis: direction of the line of array elements, a unit vector.

    Raises:
        InputError: a position that is not finite or inside a building, an axis of another length than 1.
    """

    urban_map: UrbanMap
    position: Point
    axis: Point = (1.0, 0.0)

    def __post_init__(self) -> None:
        check_shape("the antenna's position", check_finite("the antenna's position", self.position), (2,))
        self.urban_map.check_outdoors("the antenna's position", self.position)
        check_shape("the antenna's axis", np.asarray(self.axis), (2,))
        if not abs(np.hypot(*self.axis) - 1.0) <= 1e-9:
            raise InputError(f"the antenna's axis is {self.axis}, expected a unit vector such as (1.0, 0.0)")

    @cached_property
    def via(self) -> NDArray[np.int64]:
        """Indices of the walls that form each image, in order from the antenna, (image, 2); -1 for none."""
        return self._all[0]

    @cached_property
    def images(self) -> Array:
        """Positions (x, y) in m, (image, 2): the antenna itself, then images in one wall, then images in two."""
        return self._all[1]

    @cached_property
    def axes(self) -> Array:
        """Axis of the array in each image, (image, 2): a wall reflects it."""
        ends = np.array(self.position) + np.array(self.axis)
        seen = []
        for image, walls in zip(self.images, self.via, strict=True):
            end = ends
            for wall in walls[walls >= 0]:
                end = mirrored(end, self.urban_map.walls[wall])
            seen.append(end - image)
        return np.array(seen)

    @cached_property
    def order(self) -> NDArray[np.int64]:
        """Number of walls that form each image, (image,)."""
        return np.asarray((self.via >= 0).sum(axis=1))

    @cached_property
    def reflected(self) -> Array:
        """Fraction of the power left after these walls, (image,)."""
        factors = np.append(self.urban_map.reflectivity, 1.0)  # the last for no wall, whose number is -1
        return np.asarray(factors[self.via].prod(axis=1))

    def visible(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Which images are visible from points (x, y) in m, (..., 2): (..., image).

        Walls are opaque, their ends included. InputError for a wrong shape.
        """
        points, lead = _flat(points)
        return np.asarray(kernels.visible(points, *self._rays)).reshape(*lead, len(self.images))

    def directly_visible(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Whether no wall hides the antenna from points (x, y) in m, (..., 2): the first image of ``visible``."""
        points, lead = _flat(points)
        return np.asarray(
            kernels.directly_visible(points, np.array(self.position, np.float64), self.urban_map.walls)
        ).reshape(lead)

    def bounces(self, points: ArrayLike) -> Array:
        """Reflection points of the rays to points (..., 2), in order from the antenna, (x, y) in m, (..., image, 2, 2).

        NaN where there is no reflection. InputError for a wrong shape.
        """
        points, lead = _flat(points)
        return np.asarray(kernels.bounces(points, *self._rays)).reshape(*lead, len(self.images), 2, 2)

    @property
    def _rays(self) -> tuple[NDArray[Any], ...]:
        return np.array(self.position, np.float64), self.images, self._all[2], self.via, self.urban_map.walls

    @cached_property
    def _all(self) -> tuple[NDArray[np.int64], Array, Array]:
        """``via``, ``images``, and for each image the image in its first wall alone."""
        walls, position = self.urban_map.walls, np.array(self.position, np.float64)
        via, images, firsts = [(-1, -1)], [position], [position]
        ones = [w for w in range(len(walls)) if kernels.outside(*position, walls[w]) > 0.0]
        once = {w: mirrored(position, walls[w]) for w in ones}
        for w in ones:
            via.append((w, -1))
            images.append(once[w])
            firsts.append(once[w])
        for w in ones:
            for other in range(len(walls)):
                if other != w and kernels.outside(*once[w], walls[other]) > 0.0:
                    via.append((w, other))
                    images.append(mirrored(once[w], walls[other]))
                    firsts.append(once[w])
        return np.array(via, np.int64), np.array(images), np.array(firsts)


def mirrored(points: ArrayLike, wall: ArrayLike) -> Array:
    """Mirror images of points (..., 2) in the line through a wall (x0, y0, x1, y1)."""
    points, wall = check_last_axes("points", points, 2), check_last_axes("wall", wall, 4)
    x, y = points[..., 0] - wall[0], points[..., 1] - wall[1]
    dx, dy = wall[2] - wall[0], wall[3] - wall[1]
    twice = 2.0 * (x * dy - y * dx) / (dx * dx + dy * dy)
    return np.stack([points[..., 0] - twice * dy, points[..., 1] + twice * dx], axis=-1)


def _flat(points: ArrayLike) -> tuple[Array, tuple[int, ...]]:
    points = check_finite("points", points, 2)
    return np.array(points.reshape(-1, 2), order="C"), points.shape[:-1]
