"""Settings of RF/EO platforms: a box of parameters, a library for each platform, or a joint library."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from wavegym.core.action_sets import JointLibrary, Library, Parameter, ParameterBox, PerSensorLibrary, quantity
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int
from wavegym.sensors import View, platform_view

GRID_POINTS = 64  # PRFs, and pixel angles, that the search in a box tries; with 96 the cost is less than 1 % lower
MOST_CANDIDATES = 4096  # combinations of the platforms' settings that enumerating schedulers try
MOST_ACTIONS = 65536  # settings, or joint actions, in a library


class Setting(NamedTuple):
    """The setting of one platform."""

    prf: float  # Hz
    bandwidth: float  # Hz
    pixel_angle: float  # rad

    @property
    def label(self) -> str:
        """``"1 kHz 20 MHz 100 urad"``."""
        return " ".join(quantity(value, unit) for value, unit in zip(self, ("Hz", "Hz", "rad"), strict=True))


class TurningSetting(NamedTuple):
    """The setting of one platform that turns."""

    prf: float  # Hz
    bandwidth: float  # Hz
    pixel_angle: float  # rad
    turn: float  # rad, clockwise, before the measurement

    @property
    def label(self) -> str:
        """``"1 kHz 20 MHz 100 urad, turn 0.5 rad"``."""
        return f"{Setting(*self[:3]).label}, turn {quantity(self.turn, 'rad')}"


@dataclass(frozen=True)
class PlatformActions:
    """Pulse repetition frequency (PRF), bandwidth B and pixel angle alpha of every platform; its turn, if it turns.

    Args:
        ranges: least and greatest PRF (Hz), B (Hz) and alpha (rad).
        points: number of values of each in the library, spaced logarithmically; a single point is the greatest value.
        platforms: number of platforms.
        form: "library" (an index per platform), "joint" (one index for all platforms) or "box".
        wavelength: in m.
        fft_length: pulses integrated.
        pixels: number of pixels across the image.
        as_printed: use the paper's misprinted field of view.
        greatest_turn: greatest turn of the look direction in a step, to either side, in rad; 0: it is fixed.
        turns: number of turns in the library; odd, so that one of them is 0.

    Raises:
        InputError: bounds that are reversed or not positive, no points, or too many points.
    """

    ranges: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    points: tuple[int, int, int]
    platforms: int
    form: str
    wavelength: float
    fft_length: int
    pixels: int
    as_printed: bool = False
    greatest_turn: float = 0.0
    turns: int = 1

    @cached_property
    def one(self) -> ParameterBox:
        """One platform's parameters."""
        (f, F), (b, B), (a, A) = self.ranges
        listed = [
            Parameter("prf", "Hz", f, F),
            Parameter("bandwidth", "Hz", b, B),
            Parameter("pixel_angle", "rad", a, A),
        ]
        if self.greatest_turn > 0.0:
            listed.append(Parameter("turn", "rad", -self.greatest_turn, self.greatest_turn, scale="linear"))
        return ParameterBox(tuple(listed))

    @cached_property
    def box(self) -> ParameterBox:
        """Every platform's parameters, platform by platform."""
        numbered = range(1, self.platforms + 1)
        return ParameterBox(tuple(replace(p, name=f"{p.name}_{j}") for j in numbered for p in self.one.parameters))

    @cached_property
    def turn_levels(self) -> Array:
        """Turns of the library in rad; only 0 if the look direction is fixed."""
        return np.linspace(-self.greatest_turn, self.greatest_turn, self.turns) if self.greatest_turn else np.zeros(1)

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
        for name, count in zip(self.one.names[:3], self.points, strict=True):
            check_int(f"points of {name}", count, 1)
        turns = len(self.turn_levels)
        count = math.prod(self.points) * turns
        source = f"points {self.points}" + f" with {turns} turns" * (turns > 1)
        if count > MOST_ACTIONS:
            raise InputError(f"library has {count} settings from {source}, expected at most {MOST_ACTIONS}")
        if self.form == "joint" and count**self.platforms > MOST_ACTIONS:
            wanted = f"at most {MOST_ACTIONS} (nearest action: 'library')"
            raise InputError(f"number of joint actions is {count}^{self.platforms} from {source}, expected {wanted}")

    @cached_property
    def library(self) -> Library:
        """The settings of one platform: each PRF with each bandwidth, pixel angle and turn; turns vary fastest."""
        levels = [level.tolist() for level in self.levels]
        if self.greatest_turn:
            return Library(tuple(TurningSetting(*values) for values in product(*levels, self.turn_levels.tolist())))
        return Library(tuple(Setting(*values) for values in product(*levels)))

    @cached_property
    def joint(self) -> JointLibrary:
        """All combinations of the platforms' settings."""
        return JointLibrary(self.library, self.platforms)

    @property
    def actions(self) -> PerSensorLibrary | JointLibrary | ParameterBox:
        """The action set of ``form``."""
        if self.form == "box":
            return self.box
        return self.joint if self.form == "joint" else PerSensorLibrary(self.library, self.platforms)

    @cached_property
    def _library_settings(self) -> Array:
        return np.array(self.library.entries)

    def settings(self, actions: Array) -> Array:
        """PRF, bandwidth and pixel angle of every platform for ``actions``, (..., platform, 3); with the turn, 4."""
        if self.form == "box":
            values = self.box.decode(actions)
            return values.reshape(*values.shape[:-1], self.platforms, -1)
        indices = self.joint.indices.take(actions, axis=0) if self.form == "joint" else actions
        return self._library_settings.take(indices, axis=0)

    def encode(self, settings: Array) -> Array:
        """Box actions of settings (..., platform, 3), or with the turn (..., platform, 4)."""
        return self.box.encode(settings.reshape(*settings.shape[:-2], -1))

    def view(self, settings: Array) -> View:
        """Variances and field of view of settings (..., 3 or 4)."""
        prf, bandwidth, pixel_angle = settings[..., 0], settings[..., 1], settings[..., 2]
        return platform_view(
            prf, bandwidth, pixel_angle, self.wavelength, self.fft_length, self.pixels, self.as_printed
        )

    @cached_property
    def grid(self) -> tuple[Array, Array]:
        """PRFs and pixel angles that a one-step search tries: a fine grid of the box, or those of the library."""
        if self.form != "box":
            return self.levels[0], self.levels[2]
        (f, F), _, (a, A) = self.ranges
        return np.geomspace(f, F, GRID_POINTS), np.geomspace(a, A, GRID_POINTS)

    @cached_property
    def camera_grid(self) -> tuple[Array, Array]:
        """Pixel angles and turns that a one-step search tries: every pixel angle of ``grid`` with every turn.

        Turns are sorted by size, 0 first: of equal costs a search takes the first, so it turns only if that helps.
        """
        angles, turns = self.grid[1], self.turn_levels[self._turn_order]
        return np.tile(angles, len(turns)), np.repeat(turns, len(angles))

    @cached_property
    def _turn_order(self) -> Array:
        """Indices of ``turn_levels``, sorted by the size of the turn, to either side."""
        return np.argsort(np.abs(self.turn_levels), kind="stable")

    @property
    def sizes(self) -> tuple[int, int]:
        """Number of PRFs, and of pixel angles with turns, in the grid."""
        return len(self.grid[0]), len(self.camera_grid[0])

    @cached_property
    def axes(self) -> Array:
        """Variance, low, high and turn at the grid's points, (4, point, 3).

        The PRF sets the values of range and range-rate, the pixel angle sets those of azimuth. The turn changes only
        the azimuth. The field of view does not depend on the bandwidth, so the greatest bandwidth is best. The shorter
        axis repeats its last point.
        """
        longest = max(self.sizes)
        prfs, angles, turns = (
            np.pad(values, (0, longest - len(values)), mode="edge") for values in (self.grid[0], *self.camera_grid)
        )
        best = np.full(longest, self.levels[1][-1])
        turned = np.stack([np.zeros(longest), np.zeros(longest), turns], axis=-1)
        return np.stack([*self.view(np.stack([prfs, best, angles], axis=-1)), turned])

    def choose(self, prf: Array, camera: Array) -> Array:
        """Actions for grid points: indices of PRF and of pixel angle with turn, (..., platform) each."""
        if self.form == "box":
            best = np.full(prf.shape, self.levels[1][-1])
            angle, turn = (values[camera] for values in self.camera_grid)
            settings = np.stack([self.grid[0][prf], best, angle, turn], axis=-1)
            return self.encode(settings[..., : len(self.one)])
        prfs, bandwidths, angles, turns = *map(len, self.levels), len(self.turn_levels)
        turn, angle = np.divmod(camera, angles)
        indices = (prf, np.full(prf.shape, bandwidths - 1), angle, self._turn_order[turn])
        return self.number(np.ravel_multi_index(indices, (prfs, bandwidths, angles, turns)))

    def number(self, indices: Array) -> Array:
        """Actions for one library index per platform, (..., platform) int."""
        if self.form == "box":
            return self.encode(self._library_settings[indices])
        return self.joint.encode(indices) if self.form == "joint" else indices

    @cached_property
    def candidates(self) -> Array:
        """Every combination of the library's settings.

        If there are too many, and the form is not "joint", all platforms take the same setting in each candidate.
        """
        count = len(self.library)
        if count**self.platforms <= MOST_CANDIDATES or self.form == "joint":
            return self.number(PerSensorLibrary(self.library, self.platforms).combinations())
        return self.number(np.repeat(np.arange(count)[:, None], self.platforms, axis=1))
