"""Urban tracker: an unknown number of targets. Walls hide targets, and reflections at walls appear as ghost targets.

The tracker has gates, LMIPDA, a variable-structure IMM of unscented filters, and track management (Barbosa et al.,
section 4.2). There are two or more receivers, which can separate the signals of the transmitters. The paper leaves some
rules open; here the map decides them:

- A track starts where the measurements of the first two receivers, with the first transmitter, intersect on a road that
  is visible to all three antennas.
- A missed detection does not lower the existence probability of a track that the map hides.
- A track that leaves the roads is a mirror image, and ends.
- Returns of a confirmed track over walls are clutter for all other tracks (``ghosts``).
"""

from __future__ import annotations

import math
from functools import cached_property
from itertools import product
from typing import Literal, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass
from scipy.special import chdtri

from wavegym.core.arrays import Array, check_elements, check_last_axes, check_shape
from wavegym.core.errors import (
    InputError,
    check_int,
    check_non_negative,
    check_positive,
    check_probability,
    check_within,
)
from wavegym.core.parameters import in_one_line
from wavegym.sensors.detection import echo_law
from wavegym.sensors.detection_kernels import EchoLaw
from wavegym.sensors.multipath import Antenna, Grid, VisibilityMap, in_junctions, metres_to_road, visibility_map
from wavegym.sensors.multistatic import check_triangle
from wavegym.sensors.urban_map import Point, UrbanMap
from wavegym.systems.urban import scan_kernels, tracker_kernels
from wavegym.targets.motion import MotionModel, coordinated_turn, nearly_constant_acceleration, nearly_constant_velocity
from wavegym.trackers import imm_kernels
from wavegym.trackers.imm import variable_structure

EMPTY, TENTATIVE, CONFIRMED = tracker_kernels.EMPTY, tracker_kernels.TENTATIVE, tracker_kernels.CONFIRMED
MODELS = ("NCV", "NCA", "CT left", "CT right")
TRANSITION = np.array([[0.99, 0.01, 0.0, 0.0], [0.1, 0.7, 0.1, 0.1], [0.0, 0.01, 0.99, 0.0], [0.0, 0.01, 0.0, 0.99]])
"""Transition probabilities, from row to column.

The paper prints 0.1 instead of 0.01 and exchanges rows and columns; its rows sum to 1.09.
"""
SETS = ((False, True, True, True), (True, True, False, False))  # near junctions, elsewhere
NO_IMAGE = 9  # order of a padding image: more walls than any path has


class Tracks(NamedTuple):
    """Slots for tracks; axis 0 = environment."""

    x: Array  # (env, slot, model, 6): x, y, xdot, ydot, xddot, yddot
    P: Array  # (env, slot, model, 6, 6)
    mu: Array  # (env, slot, model): model probabilities
    existence: Array  # (env, slot): psi, 0 in an empty slot
    status: Array  # (env, slot): EMPTY, TENTATIVE or CONFIRMED
    age: Array  # (env, slot): scans since the track began
    refused: Array  # (env,): new tracks of the last scan that found no free slot

    def combined(self) -> tuple[Array, Array]:
        """Mean (env, slot, 6) and covariance (env, slot, 6, 6) over each track's models."""
        return imm_kernels.combine(self.x, self.P, self.mu)  # unchecked: empty slots hold no distribution


@in_one_line
@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class UrbanTracker:
    """See the module. The paper prints almost no parameters, so the defaults are choices of this suite.

    Args:
        urban_map: the map.
        transmitters, receivers: (x, y) in m; at least two receivers. Measurements are ordered by pairs: the first
            transmitter with each receiver first.
        axes: unit vector along the line of array elements of each receiver, for measurements with a direction of
            arrival. None for measurements without it, as in the paper; then the first two receivers and the first
            transmitter must not stand in one line.
        elements: number of elements of each array, half a wavelength apart.
        models: "vsimm": constant velocity and acceleration, and turns near junctions; "ncv": constant velocity.
        dt: time between scans, s.
        turn_rate: turn rate of both turn models, rad/s.
        sigma: standard deviation of acceleration in NCV and turn models, m/s^2.
        sigma_acceleration: standard deviation of the change of acceleration in a scan, NCA, m/s^2.
        pushed: whether NCA also has the random acceleration of the other models, which lasts for a scan. The paper's
            NCA has not.
        stay: probability that a target keeps its motion model until the next scan; all others are equally likely. None
            for the matrix of the paper, in which acceleration lasts three scans and turns last a hundred.
        slots: maximum number of tracks. If all are in use, a new track replaces the tentative track of least existence.
        clutter_density: expected false returns in a scan of a receiver, per (m x m/s).
        gate_probability: Pg, probability that a gate contains the measurement of a detected target.
        false_alarm: Pfa, which relates SNR and detection probability.
        fluctuation: model of the echoes, "swerling0" to "swerling4", see ``wavegym.sensors.detection``.
        error_snr: SNR that sets measurement covariances. "mean": the mean eta. "realised": 1 / E[1 / max(eta, 1)] of a
            detected echo, for errors at the SNR of the scan. Pd follows from the mean eta in both cases. Measurements
            with covariances of their own (``scan``) keep them.
        searched: number of quantities over which receivers search for the peak of an echo, see
            ``detection_probability``.
        rate_floor: standard deviation of range-rate in addition to its noise, m/s.
        reach: half path length beyond which no echo is received, m.
        survival: probability that a target still exists in the next scan.
        birth: existence probability of a new track.
        confirm: existence probability at which a track is confirmed.
        confirm_after: minimum number of scans before confirmation; mirror images between the receivers rarely last so
            long.
        drop: existence probabilities below which a tentative track and a confirmed track end.
        merge: distance (m) and velocity difference (m/s) below which two tracks are merged.
        vaguest: largest standard deviation of the position of a new track, m.
        fastest: largest speed of a new track, m/s; a track ends beyond twice this speed.
        usual_speed: prior standard deviation of the velocity of a target on each axis, m/s.
        ghosts: whether the map is used to separate tracks from their ghosts.
        cell: width of the cells of the grid, m.

    Raises:
        InputError: an invalid value, an antenna in a building or far from all roads, or antennas that cannot locate
            a target.
    """

    urban_map: UrbanMap
    transmitters: tuple[Point, ...]
    receivers: tuple[Point, ...]
    axes: tuple[Point, ...] | None = None
    elements: int = 3
    models: Literal["vsimm", "ncv"] = "vsimm"
    dt: float = 0.25
    turn_rate: float = math.pi / 20
    sigma: float = 0.25
    sigma_acceleration: float = 0.3
    pushed: bool = False
    stay: float | None = None
    slots: int = 8
    clutter_density: float = 1e-3
    gate_probability: float = 0.99
    false_alarm: float = 1e-3
    fluctuation: str = "swerling1"
    error_snr: Literal["mean", "realised"] = "realised"
    searched: int = 0
    rate_floor: float = 0.1
    reach: float = 300.0
    survival: float = 0.99
    birth: float = 0.1
    confirm: float = 0.95
    confirm_after: int = 4
    drop: tuple[float, float] = (0.03, 0.05)
    merge: tuple[float, float] = (5.0, 4.0)
    vaguest: float = 5.0
    fastest: float = 20.0
    usual_speed: float = 10.0
    ghosts: bool = True
    cell: float = 1.0

    def __post_init__(self) -> None:
        if not self.transmitters:
            raise InputError("transmitters is (), expected at least one place (x, y) in m")
        if len(self.receivers) < 2:
            raise InputError(f"receivers is {self.receivers}, expected at least two: one cannot locate a target")
        if self.axes is None:
            check_triangle(np.array(self.transmitters[0]), np.array(self.receivers[:2]))
        elif len(self.axes) != len(self.receivers):
            raise InputError(
                f"axes has {len(self.axes)} entries, expected {len(self.receivers)}: one for each receiver"
            )
        check_int("elements", self.elements, 1 if self.axes is None else 2)
        check_int("slots", self.slots, 1)
        check_int("confirm_after", self.confirm_after, 1)
        for name in ("clutter_density", "rate_floor", "reach", "vaguest", "fastest", "usual_speed"):
            check_positive(name, getattr(self, name))
        for name in ("gate_probability", "false_alarm"):
            check_probability(name, getattr(self, name))
        for name in ("survival", "birth", "confirm"):
            check_within(name, getattr(self, name), 0.0, 1.0)
        if self.stay is not None:
            check_probability("stay", self.stay)
        check_elements(lambda name, value: check_within(name, value, 0.0, 1.0), "drop", self.drop)
        check_elements(check_non_negative, "merge", self.merge)
        self._check_antennas()
        _ = self.constants

    def _check_antennas(self) -> None:
        """InputError for an antenna too far from all roads to receive an echo."""
        for name in ("transmitters", "receivers"):
            for place in getattr(self, name):
                away = self.urban_map.paved.distance(shapely.Point(place))
                if away > 2.0 * self.reach:
                    wanted = f"at most twice the reach, {2.0 * self.reach:g} m: farther echoes are not received"
                    raise InputError(f"{name} has {place}, {away:g} m from the nearest road, expected {wanted}")

    @cached_property
    def motion(self) -> tuple[MotionModel, ...]:
        """The motion models, in the order of ``MODELS``."""
        straight = nearly_constant_velocity(self.dt, self.sigma)
        if self.models == "ncv":
            return (straight,)
        turns = (coordinated_turn(self.dt, sign * self.turn_rate, self.sigma) for sign in (1.0, -1.0))
        push = self.sigma if self.pushed else 0.0
        return (straight, nearly_constant_acceleration(self.dt, self.sigma_acceleration, push), *turns)

    @property
    def quantities(self) -> int:
        """Number of measured quantities: range and range-rate, and with ``axes`` the direction cosine."""
        return 2 if self.axes is None else 3

    def empty(self, num_envs: int) -> Tracks:
        """No tracks."""
        lead, models = (num_envs, self.slots), len(self.motion)
        return Tracks(
            np.zeros((*lead, models, 6)), np.zeros((*lead, models, 6, 6)), np.full((*lead, models), 1.0 / models),
            np.zeros(lead), np.zeros(lead, np.int64), np.zeros(lead, np.int64), np.zeros(num_envs, np.int64),
        )  # fmt: skip

    def scan(
        self,
        tracks: Tracks,
        z: ArrayLike,
        count: ArrayLike,
        R: ArrayLike,
        snr: ArrayLike,
        errors: ArrayLike | None = None,
    ) -> Tracks:
        """Tracks after one scan of all receivers.

        Args:
            tracks: tracks before the scan.
            z: measurements of each pair, (env, pair, most, m): range and range-rate, m and m/s; with ``axes`` also the
                direction cosine at the receiver's array, see ``Multistatic.directions``.
            count: number of measurements, (env, pair).
            R: error covariance at an SNR of 1 of the waveform that the transmitter of each pair sent, without the
                range-rate variance rate_floor^2; leading axes broadcast to (env, pair, 2, 2).
            snr: SNR of this waveform at a half path length of 100 m without walls; broadcasts to (env, pair).
            errors: covariance of each measurement as the receiver reports it, without rate_floor^2,
                (env, pair, most, m, m); by default ``direct_errors``.

        Returns:
            The tracks. A new track that finds no free slot replaces a tentative track or is not started, and counts as
            ``refused``.

        Raises:
            InputError: a wrong shape, or an invalid count, R or SNR.
        """
        envs, pairs = len(tracks.existence), len(self.transmitters) * len(self.receivers)
        size = self.quantities
        z, count = np.array(check_last_axes("z", z, size), order="C"), np.array(count, np.float64, order="C")
        if z.shape[:2] != (envs, pairs) or z.ndim != 4 or count.shape != (envs, pairs):
            raise InputError(
                f"z and count have shapes {z.shape} and {count.shape}, expected ({envs}, {pairs}, most, {size}) and "
                f"({envs}, {pairs})"
            )
        if not tracker_kernels.are_counts(count, z.shape[2]):
            wrong = (count < 0) | (count > z.shape[2]) | (count != np.floor(count))
            raise InputError(f"count is {count[wrong][0]:g}, expected an integer from 0 to {z.shape[2]}, the size of z")
        after, waves, count = self._copied(tracks), self._waves(R, snr, envs), count.astype(np.int64)
        given = self.direct_errors(z, count, *waves) if errors is None else np.array(errors, np.float64, order="C")
        check_shape("errors", given, (*z.shape, size))
        scan_kernels.scan(*after[:6], self.constants, *waves, z, given, count, after.refused, *self._sizes)
        return after

    def direct_errors(self, z: Array, count: Array, R: Array, snr: Array) -> Array:
        """Covariance of each measurement at the SNR of a direct path of its range, without the floor of range-rate.

        ``error_snr`` selects the SNR. Arguments as in ``scan``; R and snr have the full shapes (env, pair, 2, 2) and
        (env, pair). Returns (env, pair, most, m, m), 0 beyond the measurements.
        """
        errors = np.zeros((*z.shape, self.quantities))
        tracker_kernels.direct_errors(z, count, R, snr, self.constants, errors, self._sizes[-1])
        return errors

    def expect(self, tracks: Tracks, R: ArrayLike, snr: ArrayLike) -> Tracks:
        """Tracks after an expected scan: covariances shrink in proportion to the detection probability.

        Arguments as in ``scan``; means are the predicted means.
        """
        after = self._copied(tracks)
        scan_kernels.expect(*after[:6], self.constants, *self._waves(R, snr, len(after.existence)), *self._sizes)
        return after

    def _copied(self, tracks: Tracks) -> Tracks:
        """A copy that kernels overwrite; InputError for tracks of another tracker."""
        models, envs = len(self.motion), len(tracks.existence)
        cores: list[tuple[int, ...]] = [(models, 6), (models, 6, 6), (models,), (), (), ()]
        for name, leaf, core in zip(Tracks._fields, tracks, cores, strict=False):
            if leaf.shape != (envs, self.slots, *core):
                wanted = (envs, self.slots, *core)
                raise InputError(f"tracks.{name} has shape {leaf.shape}, expected {wanted} for this tracker")
        return Tracks(*(np.array(leaf, order="C") for leaf in tracks))

    def _waves(self, R: ArrayLike, snr: ArrayLike, envs: int) -> tuple[Array, Array]:
        """R and SNR of each pair in each environment."""
        lead = envs, len(self.transmitters) * len(self.receivers)
        covariance, ratio = np.empty((*lead, 2, 2)), np.empty(lead)
        try:
            covariance[...], ratio[...] = check_last_axes("R", R, 2, 2), snr
        except ValueError:
            raise InputError(
                f"R and snr have shapes {np.shape(R)} and {np.shape(snr)}, expected {(*lead, 2, 2)} and {lead}"
            ) from None
        if not tracker_kernels.are_waves(covariance, ratio):
            check_elements(check_positive, "snr", ratio)
            raise InputError(f"R is {np.asarray(R).tolist()}, expected positive definite matrices")
        return covariance, ratio

    @property
    def _sizes(self) -> tuple[tuple[int, ...], ...]:
        return (0,) * 6, (0,) * len(self.motion), (0,) * self.quantities

    @property
    def _echo_law(self) -> EchoLaw:
        realised = self.error_snr == "realised"
        return echo_law((self.false_alarm,), self.fluctuation, self.searched, realised=realised)

    @cached_property
    def constants(self) -> tracker_kernels.TrackerConstants:
        """The constants of the kernels."""
        grid = Grid.over(self.urban_map, (*self.transmitters, *self.receivers), self.cell)
        lines = self.axes or ((1.0, 0.0),) * len(self.receivers)
        pairs = list(product(self.transmitters, zip(self.receivers, lines, strict=True)))
        out = [visibility_map(Antenna(self.urban_map, place), grid) for place, _ in pairs]
        back = [visibility_map(Antenna(self.urban_map, *array), grid) for _, array in pairs]
        whole_set, models = self.models == "vsimm", len(MODELS)
        changes = TRANSITION
        if self.stay is not None:
            changes = np.where(np.eye(models, dtype=np.bool_), self.stay, (1.0 - self.stay) / (models - 1))
        return tracker_kernels.TrackerConstants(
            transmitters=np.array([t for t, _ in pairs]), receivers=np.array([r for _, (r, _) in pairs]),
            axes=np.array([axis for _, (_, axis) in pairs], np.float64), elements=self.elements,
            F=np.stack([model.F for model in self.motion]), Q=np.stack([model.Q for model in self.motion]),
            transition=variable_structure(changes, SETS) if whole_set else np.ones((2, 1, 1)),
            corner=np.array(grid.corner), cell=float(grid.cell), road=metres_to_road(self.urban_map, grid),
            junction=in_junctions(self.urban_map, grid), **_images("out", out), **_images("back", back),
            back_axes=_padded(back, "axes", 0.0), density=self.clutter_density / 2.0 ** (self.quantities - 2),
            gate=float(chdtri(self.quantities, 1.0 - self.gate_probability)),
            start_gate=float(chdtri(4, 1.0 - self.gate_probability)),
            gate_probability=self.gate_probability, echo=self._echo_law,
            rate_floor=self.rate_floor, reach=self.reach, survival=self.survival, birth=self.birth,
            confirm=self.confirm, confirm_after=self.confirm_after,
            drop_tentative=self.drop[0], drop_confirmed=self.drop[1],
            merge_distance=self.merge[0], merge_speed=self.merge[1], slack=self.cell, vaguest=self.vaguest,
            fastest=self.fastest, usual_speed=self.usual_speed, first_acceleration=1.0, ghosts=self.ghosts,
        )  # fmt: skip


def _images(side: str, maps: list[VisibilityMap]) -> dict[str, Array]:
    """Tables of the images of each pair's transmitter, or receiver, padded to one length."""
    return {
        f"{side}_images": _padded(maps, "images", 0.0), f"{side}_order": _padded(maps, "order", NO_IMAGE),
        f"{side}_reflected": _padded(maps, "reflected", 0.0),
        f"{side}_visible": _padded(maps, "visible", False, axis=-1),
    }  # fmt: skip


def _padded(maps: list[VisibilityMap], name: str, fill: float, axis: int = 0) -> Array:
    """One field of all maps, (pair, ...), padded with ``fill`` for maps with fewer images."""
    most, parts = max(len(one.images) for one in maps), []
    for one in maps:
        values = getattr(one, name)
        room = [(0, most - len(one.images)) if a == axis % values.ndim else (0, 0) for a in range(values.ndim)]
        parts.append(np.pad(values, room, constant_values=fill))
    return np.ascontiguousarray(np.stack(parts))
