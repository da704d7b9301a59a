"""What RF/EO platforms may be set to: a box of parameters, a library for each platform, or a joint library."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from wavegym.core.action_sets import JointLibrary, Library, PerSensorLibrary
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int
from wavegym.core.parameter_box import Parameter, ParameterBox
from wavegym.core.units import quantity
from wavegym.sensors import View, platform_view

FINE = 64  # values of PRF and of pixel angle that the box's own search tries; 96 gain less than 1 % more
FEW = 4096  # combinations of the platforms' settings that enumerating schedulers try
MANY = 65536  # settings, or joint actions, that are listed one by one


class Setting(NamedTuple):
    """What one platform is set to."""

    prf: float  # Hz
    bandwidth: float  # Hz
    pixel_angle: float  # rad

    @property
    def label(self) -> str:
        """``"1 kHz 20 MHz 100 urad"``."""
        return " ".join(quantity(value, unit) for value, unit in zip(self, ("Hz", "Hz", "rad"), strict=True))


@dataclass(frozen=True)
class PlatformActions:
    """Pulse repetition frequency (PRF), bandwidth B and pixel angle alpha of every platform.

    Args:
        ranges: least and greatest PRF (Hz), B (Hz) and alpha (rad).
        points: how many of each, in equal ratios, are in the library; of a single one, the greatest value.
        platforms: how many.
        form: "library" (an index per platform), "joint" (one index for all platforms) or "box".
        wavelength: in m.
        fft_length: pulses integrated.
        pixels: of the image.
        as_printed: the paper's misprinted field of view.

    Raises:
        InputError: bounds that are reversed or not > 0, no points, or too many.
    """

    ranges: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    points: tuple[int, int, int]
    platforms: int
    form: str
    wavelength: float
    fft_length: int
    pixels: int
    as_printed: bool = False

    @cached_property
    def one(self) -> ParameterBox:
        """One platform's parameters."""
        (f, F), (b, B), (a, A) = self.ranges
        return ParameterBox(
            (Parameter("prf", "Hz", f, F), Parameter("bandwidth", "Hz", b, B), Parameter("pixel_angle", "rad", a, A))
        )

    @cached_property
    def box(self) -> ParameterBox:
        """Every platform's parameters, platform by platform."""
        numbered = range(1, self.platforms + 1)
        return ParameterBox(
            tuple(Parameter(f"{p.name}_{j}", p.unit, p.low, p.high) for j in numbered for p in self.one.parameters)
        )

    @cached_property
    def levels(self) -> tuple[Array, Array, Array]:
        """PRFs, bandwidths and pixel angles of the library."""
        self._check_points()
        bounds = zip(self.ranges, self.points, strict=True)
        prf, bandwidth, angle = (
            np.geomspace(*ends, count) if count > 1 else np.array(ends[1:]) for ends, count in bounds
        )
        return prf, bandwidth, angle

    def _check_points(self) -> None:
        for name, count in zip(self.one.names, self.points, strict=True):
            check_int(f"points of {name}", count, 1)
        count = math.prod(self.points)
        if count > MANY:
            raise InputError(f"points is {self.points}, which makes {count} settings, expected at most {MANY}")
        if self.form == "joint" and count**self.platforms > MANY:
            wanted = f"at most {MANY} (nearest action: 'library')"
            raise InputError(f"joint actions are {count}^{self.platforms}, of points {self.points}, expected {wanted}")

    @cached_property
    def library(self) -> Library:
        """Every PRF with every bandwidth and pixel angle, the last fastest: what one platform may be set to."""
        return Library(tuple(Setting(*values) for values in product(*(level.tolist() for level in self.levels))))

    @cached_property
    def joint(self) -> JointLibrary:
        """All combinations of the platforms' settings."""
        return JointLibrary(self.library, self.platforms)

    @property
    def actions(self) -> PerSensorLibrary | JointLibrary | ParameterBox:
        """What an action means."""
        if self.form == "box":
            return self.box
        return self.joint if self.form == "joint" else PerSensorLibrary(self.library, self.platforms)

    @cached_property
    def _library_settings(self) -> Array:
        return np.array(self.library.entries)

    def settings(self, actions: Array) -> Array:
        """PRF, bandwidth and pixel angle of every platform, (..., platform, 3), that ``actions`` name."""
        if self.form == "box":
            values = self.box.decode(actions)
            return values.reshape(*values.shape[:-1], self.platforms, 3)
        indices = self.joint.indices.take(actions, axis=0) if self.form == "joint" else actions
        return self._library_settings.take(indices, axis=0)

    def encode(self, settings: Array) -> Array:
        """Box actions of settings (..., platform, 3)."""
        return self.box.encode(settings.reshape(*settings.shape[:-2], -1))

    def view(self, settings: Array) -> View:
        """What settings (..., 3) are worth."""
        prf, bandwidth, pixel_angle = settings[..., 0], settings[..., 1], settings[..., 2]
        return platform_view(
            prf, bandwidth, pixel_angle, self.wavelength, self.fft_length, self.pixels, self.as_printed
        )

    @cached_property
    def grid(self) -> tuple[Array, Array]:
        """PRFs and pixel angles that a one-step search tries: fine ones of a box, else those of the library."""
        if self.form != "box":
            return self.levels[0], self.levels[2]
        (f, F), _, (a, A) = self.ranges
        return np.geomspace(f, F, FINE), np.geomspace(a, A, FINE)

    @property
    def sizes(self) -> tuple[int, int]:
        """How many PRFs and pixel angles the grid has."""
        prfs, angles = self.grid
        return len(prfs), len(angles)

    @cached_property
    def axes(self) -> Array:
        """What the grid is worth, (3, point, 3): variance, low and high, of which the PRF sets (range, range-rate) and
        the pixel angle the azimuth.

        The field of view does not depend on the bandwidth, so the greatest is the best. The shorter axis repeats its
        last point.
        """
        longest = max(len(values) for values in self.grid)
        prfs, angles = (np.pad(values, (0, longest - len(values)), mode="edge") for values in self.grid)
        best = np.full(longest, self.levels[1][-1])
        return np.stack(self.view(np.stack([prfs, best, angles], axis=-1)))

    def choose(self, prf: Array, pixel_angle: Array) -> Array:
        """Actions of one point of the grid for every platform: indices (..., platform) of PRF and pixel angle."""
        prfs, angles = self.grid
        if self.form == "box":
            best = np.full(prf.shape, self.levels[1][-1])
            return self.encode(np.stack([prfs[prf], best, angles[pixel_angle]], axis=-1))
        bandwidths = len(self.levels[1])
        return self.number((prf * bandwidths + bandwidths - 1) * len(angles) + pixel_angle)

    def number(self, indices: Array) -> Array:
        """Actions of one setting of the library for every platform, (..., platform) int."""
        if self.form == "box":
            return self.encode(self._library_settings[indices])
        return self.joint.encode(indices) if self.form == "joint" else indices

    @cached_property
    def candidates(self) -> Array:
        """Every combination of the library's settings; of very many, the same one at all platforms.

        All of them in the joint form, whose actions they are.
        """
        count = len(self.library)
        if count**self.platforms <= FEW or self.form == "joint":
            return self.number(PerSensorLibrary(self.library, self.platforms).combinations())
        return self.number(np.repeat(np.arange(count)[:, None], self.platforms, axis=1))
