"""Traffic, world, truth and belief of the multifunction radar, and figures by truth: GOSPA, errors, false tracks."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from wavegym.core.arrays import Array
from wavegym.core.track_loss import is_astray, steps_astray
from wavegym.core.traits import CONFIRMED
from wavegym.systems.multifunction_radar.area_kernels import Area, weight_at
from wavegym.systems.multifunction_radar.dwell_kernels import Laws
from wavegym.systems.multifunction_radar.flight_kernels import Flight, Flying
from wavegym.systems.multifunction_radar.step_kernels import estimate_slots
from wavegym.systems.multifunction_radar.track_kernels import Modes


class World(NamedTuple):
    """All random numbers of an episode."""

    key: Array  # (env,) uint64: of manoeuvres and of dwells
    draw: Array  # (env, target, 8) uniform: gap of arrivals, place (2), heading, speed, mode, known or not, section
    error: Array  # (env, target, 4) standard normal: of the first estimates


class Truth(NamedTuple):
    """The true targets, and figures that were taken last; g targets, k slots."""

    state: Array  # (env, g, 4) [x xdot y ydot], m, m/s, at the beginning of the cell
    acceleration: Array  # (env, g, 2) in the cell, m/s^2
    mode: Array  # (env, g) int
    here: Array  # (env, g) bool
    section: Array  # (env, g) int, class of cross section
    cell: Array  # (env,) int, the cell of time
    looks: Array  # (env, g) int, how often a target has been in the beam
    origin: Array  # (env, k) int, the target whose echo a slot has used last; -1: a false alarm
    arrival: Array  # (env, g) s, from the beginning of the episode
    astray: Array  # (env, g) int, consecutive samples without a confirmed track that follows; see ``steps_astray``
    confirmed: Array  # (env, g) s, when the target had its first confirmed track; NaN before
    false: Array  # (env,) confirmed tracks of no target
    square_gospa: Array  # (env, 4) m^2, by ``PARTS``
    squared_error: Array  # (env, k) m^2
    variance: Array  # (env, k) m^2
    nees: Array  # (env, k)
    replaced: Array  # (env,) bool, whether the last action was the update of a free slot, which is a wait
    present: Array  # (env, k) bool, whether a slot's track is confirmed and of a target that is there


class Belief(NamedTuple):
    """The tracks, as they were at their last update, and the undetected.

    k slots, m modes, s sectors, i beams, b range bins, c classes of cross section.
    """

    step: Array  # (env,) int
    time: Array  # (env,) s
    updated: Array  # (env, k) s, time of the last update
    mean: Array  # (env, k, m, 4) [x xdot y ydot], m, m/s
    covariance: Array  # (env, k, m, 4, 4)
    probability: Array  # (env, k, m) of the modes
    existence: Array  # (env, k); 0: the slot is free
    section: Array  # (env, k, c) probability of each class of cross section
    moments: Array  # (env, k, 10), see ``Slots``
    undetected: Array  # (env, i, b, c) expected number of targets of each class without a track
    turn: Array  # (env, s) int, the next beam of each sector
    spent: Array  # (env, 3) m^2 s, cost of the last dwell: undetected targets, tentative tracks, confirmed tracks
    duration: Array  # (env,) s, of the last dwell


PARTS = ("unfound", "lost", "false", "error")
"""Of the squared GOSPA distance: targets without a track, which have never had a confirmed one or have lost it; tracks
without a target; and the squared errors of the other tracks."""


class Estimates(NamedTuple):
    """Tracks at the time of the belief."""

    mean: Array  # (env, k, 4)
    covariance: Array  # (env, k, 4, 4)


def estimates(belief: Belief, modes: Modes) -> Estimates:
    """Mean and covariance of every slot, of all modes together; 0 where it is free."""
    count, slots = belief.existence.shape
    made = Estimates(np.zeros((count, slots, 4)), np.zeros((count, slots, 4, 4)))
    estimate_slots(belief, modes, *made)
    return made


def flying(truth: Truth) -> Flying:
    """The targets of all environments, for kernels."""
    return Flying(truth.state, truth.acceleration, truth.mode, truth.here)


def states_now(truth: Truth, seconds: Array) -> Array:
    """States (env, g, 4) so many seconds (env,) after the cell began."""
    x, late = truth.state.copy(), seconds[:, None, None]
    x[..., [0, 2]] += late * (x[..., [1, 3]] + 0.5 * late * truth.acceleration)
    x[..., [1, 3]] += late * truth.acceleration
    return x


def take_figures(truth: Truth, belief: Belief, rows: Array, flight: Flight, laws: Laws, lost_beyond: float) -> None:
    """Write the figures of the environments ``rows`` into ``truth``.

    Args:
        truth: changed in place.
        belief: at the same time.
        rows: indices (row,).
        flight: of the true targets.
        laws: of the tracker. The GOSPA distance of order 2 has the cutoff sqrt(2 c0), so a target that no track
            reports, and a track without target, cost c0.
        lost_beyond: m, see ``System``.
    """
    area, most = laws.area, laws.most
    part = Belief(*(leaf[rows] for leaf in belief))
    made, states = estimates(part, laws.modes), states_now(truth, belief.time - truth.cell * flight.cell)
    for i, e in enumerate(rows.tolist()):
        x = states[e]
        mean, covariance, existence = made.mean[i], made.covariance[i], part.existence[i]
        trace = covariance[:, 0, 0] + covariance[:, 2, 2]
        reported = (existence > 0.0) & (existence * (2.0 * most - trace) > most)
        confirmed = existence >= CONFIRMED
        _errors(truth, e, confirmed, x, (mean, covariance), lost_beyond)
        _follow(truth, e, belief.time[e], lost_beyond)
        here = truth.here[e]
        truth.square_gospa[e] = _square_gospa(x[here], np.isnan(truth.confirmed[e, here]), mean[reported], most, area)


def _square_gospa(x: Array, unfound: Array, mean: Array, most: float, area: Area) -> Array:
    """Squared GOSPA distance of order 2 of targets (g, 4) and reported tracks (k, 4), weighted by range; by ``PARTS``.

    A pair at the cutoff is a target without a track, and a track without a target. unfound (g,) bool: targets that have
    not had a confirmed track.
    """
    counts, false = (weight_at(np.hypot(states[:, 0], states[:, 2]), area) for states in (x, mean))
    apart = counts[:, None] * np.square(x[:, None, [0, 2]] - mean[None, :, [0, 2]]).sum(axis=2)
    apart = np.minimum(apart, (counts[:, None] + false) * most)
    row, column = linear_sum_assignment(apart)
    near = apart[row, column] < (counts[row] + false[column]) * most
    missed, no_target = np.delete(np.arange(len(x)), row[near]), np.delete(false, column[near])
    error = apart[row[near], column[near]].sum()
    never = unfound[missed]
    return np.array([
        most * counts[missed[never]].sum(), most * counts[missed[~never]].sum(), most * no_target.sum(), error
    ])  # fmt: skip


def _follow(truth: Truth, e: int, time: float, beyond: float) -> None:
    """When targets first had a confirmed track, and in how many samples in a row they have been astray since."""
    astray = is_astray(np.sqrt(truth.squared_error[e]), truth.nees[e], beyond, truth.state.shape[-1])
    held, near = np.zeros((2, *truth.here[e].shape), np.bool_)
    held[truth.origin[e][truth.present[e]]] = True
    near[truth.origin[e][truth.present[e] & ~astray]] = True
    truth.confirmed[e][held & np.isnan(truth.confirmed[e])] = time
    truth.astray[e] = steps_astray(truth.astray[e], truth.here[e] & ~near, held)


def _errors(truth: Truth, e: int, confirmed: Array, x: Array, tracks: tuple[Array, Array], beyond: float) -> None:
    """Errors of confirmed tracks against the target whose echo each has used last, and the number of false tracks.

    A track farther than ``beyond`` from that target is of no target: the echo came from the flank of the beam, or the
    track has stayed where no target is.
    """
    (mean, covariance), origin = tracks, truth.origin[e]
    near = np.hypot(mean[:, 0] - x[origin, 0], mean[:, 2] - x[origin, 2]) <= beyond
    present = confirmed & (origin >= 0) & truth.here[e][origin] & near
    truth.false[e] = (confirmed & ~present).sum()
    truth.present[e] = present
    error = mean[present] - x[origin[present]]
    spread = covariance[present]
    for figure, values in (
        (truth.squared_error, error[:, 0] ** 2 + error[:, 2] ** 2),
        (truth.variance, spread[:, 0, 0] + spread[:, 2, 2]),
        (truth.nees, (error * np.linalg.solve(spread, error[..., None])[..., 0]).sum(axis=1)),
    ):
        figure[e] = 0.0
        figure[e, present] = values


class Traffic(NamedTuple):
    """The traffic of an isotropic flow in a sector of a ring: the region, the number and velocities of targets in it.

    In the plane targets are a Poisson process with uniform places and headings. So inside a region the intensity is
    uniform. Over each metre of its edge targets enter at the rate density x mean speed / pi. The density of the angle
    between heading and inward normal is proportional to its cosine. Velocities inside are uniform between the least and
    the greatest speed, as ``Flight`` keeps them; the density of an entering target's speed is proportional to its
    square.
    """

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
        low, high = self.slowest, self.fastest
        return 2.0 / 3.0 * (low * low + low * high + high * high) / (low + high)

    @property
    def velocity_variance(self) -> float:
        """Of the velocity on each axis, (m/s)^2."""
        return 0.25 * (self.slowest**2 + self.fastest**2)

    @property
    def arc_and_sides(self) -> Array:
        """Lengths of the outer arc, the inner arc and the two sides, m."""
        side = self.farthest - self.nearest
        return np.array([2 * self.half_sector * self.farthest, 2 * self.half_sector * self.nearest, side, side])

    @property
    def rate(self) -> float:
        """Targets that come over the edge, 1/s."""
        return float(self.density * self.mean_speed / math.pi * self.arc_and_sides.sum())

    def most_targets(self, seconds: float) -> int:
        """Number of targets that is exceeded in one of a billion episodes."""
        expected = self.targets + self.rate * seconds if self.targets else 0.0
        return math.ceil(expected + 6.5 * math.sqrt(expected)) + 10

    def states(self, draw: Array) -> tuple[Array, Array]:
        """States [x xdot y ydot] (..., target, 4) at arrival, and the arrivals (..., target) in s.

        Args:
            draw: uniform draws (..., target, 8); see ``World``.
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
        speed = np.sqrt(self.slowest**2 + draw[..., 4] * (self.fastest**2 - self.slowest**2))
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
        speed = np.cbrt(self.slowest**3 + draw[..., 4] * (self.fastest**3 - self.slowest**3))
        return r, azimuth, heading, speed
