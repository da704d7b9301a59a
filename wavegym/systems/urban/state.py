"""The urban loop: tape, scene, drivers, truth, belief and observation fields."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from wavegym.core.arrays import Array, for_kernel
from wavegym.core.errors import InputError
from wavegym.core.system import ObservationField, State
from wavegym.sensors.multistatic import Multistatic
from wavegym.sensors.urban_map import UrbanMap
from wavegym.systems.urban import kernels
from wavegym.targets import ScriptedPath
from wavegym.trackers import gospa_kernels

HELD_WITHIN = 20.0  # m; a confirmed track farther from a target does not hold it; also the cutoff of GOSPA
MOST = 64  # minimum room for the measurements of a pair in a scan
GREATEST = 4096  # maximum room
RETURN = 0.3  # rad/s, natural frequency of the driver's return to the route
DAMPING = 0.7  # damping ratio of this motion: 1 is critical


class World(NamedTuple):
    """One episode's tape. Routes are fixed. Measurements and accelerations are drawn by counter from a key."""

    key: Array  # () uint64


class Truth(NamedTuple):
    """The part of the state that no scheduler sees."""

    targets: Array  # (env, target, 6): x, y, xdot, ydot, xddot, yddot
    present: Array  # (env, target)
    z: Array  # (env, pair, most, m): the last scan
    number: Array  # (env, pair): number of its measurements


class Measurements(NamedTuple):
    """The receivers' measurements in one scan."""

    z: Array  # (env, pair, most, m): range [m], range-rate [m/s] and direction cosine
    R: Array  # (env, pair, most, m, m): covariances of their errors, without the floor of range-rate
    number: Array  # (env, pair): number of measurements


class Belief(NamedTuple):
    """The tracks (``wavegym.systems.urban.Tracks``) at a step."""

    step: Array  # (env,)
    x: Array  # (env, slot, model, 6)
    P: Array  # (env, slot, model, 6, 6)
    mu: Array  # (env, slot, model)
    existence: Array  # (env, slot)
    status: Array  # (env, slot)
    age: Array  # (env, slot)
    refused: Array  # (env,)


def room_for(expected: float) -> int:
    """Room for the measurements of a pair in a scan, for an expected number of false returns.

    There is room for clutter up to six standard deviations above its mean, and for returns of targets.

    Raises:
        InputError: more than ``GREATEST``.
    """
    most = max(MOST, math.ceil(expected + 6.0 * math.sqrt(expected)) + MOST // 2)
    if most > GREATEST:
        largest = (math.sqrt(9.0 + GREATEST - MOST // 2) - 3.0) ** 2  # the inverse of ``most``
        given = f"false returns of a pair in a scan are {expected:.4g} on average"
        raise InputError(f"{given}, expected at most {largest:.0f}: reduce clutter_density")
    return most


class Scene(NamedTuple):
    """The route of the targets and its propagation paths, for every scan from 0 to the horizon."""

    truth: Array  # (scan, target, 6): targets that do not deviate from the route
    present: Array  # (scan, target)
    path_count: Array  # (pair, scan, target): number of visible paths; they come first along the path axis
    path_index: Array  # (pair, scan, target, path): index of each path in ``Multistatic.paths``
    images: Array  # (pair, index, 6): of transmitter and receiver, and the axis of the array, for each path index
    z: Array  # (pair, scan, target, path, 2): range and range-rate of targets on the route
    reflected: Array  # (pair, scan, target, path): fraction of the power that remains after the walls
    direct: Array  # (scan, target): whether the direct paths of the first two pairs are visible


def make_scene(
    urban_map: UrbanMap, pairs: Sequence[Multistatic], route: ScriptedPath, arrivals: ArrayLike, times: Array
) -> Scene:
    """The scene in which all targets drive along one route, each from its own arrival (s) on; times (scan,) in s.

    Raises:
        InputError: the route enters a building.
    """
    driven = [_driven(route, arrival, times) for arrival in np.asarray(arrivals, np.float64)]
    true_states = np.stack([states for states, _ in driven], axis=1)
    present = np.stack([there for _, there in driven], axis=1)
    for states, there in driven:
        if there.sum() > 1:
            urban_map.check_drivable("path", states[there, :2])
    if urban_map.indoors(true_states[present][:, :2]).any():
        raise InputError(f"path begins in a building at {tuple(route.start)} m, expected a route outside all buildings")
    visible = [pair.visible(true_states[..., :2]) & present[..., None] for pair in pairs]
    most = max(1, *(int(each.sum(axis=-1).max(initial=0)) for each in visible))
    tables = [_table(pair, true_states, own, most) for pair, own in zip(pairs, visible, strict=True)]
    z, reflected, path_count, path_index = (np.stack(each) for each in zip(*tables, strict=True))
    direct = np.logical_and.reduce([own[..., 0] for own in visible[:2]])
    return Scene(true_states, present, path_count, path_index, _images(pairs), z, reflected, direct)


def _driven(route: ScriptedPath, arrival: float, times: Array) -> tuple[Array, Array]:
    here = route.sample(np.maximum(times - arrival, 0.0))
    return np.concatenate([here.positions, here.velocities, here.accelerations], axis=1), times >= arrival


def _images(pairs: Sequence[Multistatic]) -> Array:
    """(x, y) of both images and the axis of the array for each path of each pair, (pair, index, 6); padded with 0."""
    images = np.zeros((len(pairs), max(len(pair.paths) for pair in pairs), 6))
    for own, pair in zip(images, pairs, strict=True):
        out, back = pair.paths.T
        own[: len(out)] = np.concatenate(
            [pair.transmitter.images[out], pair.receiver.images[back], pair.receiver.axes[back]], axis=1
        )
    return images


def _table(pair: Multistatic, true_states: Array, visible: Array, most: int) -> tuple[Array, Array, Array, Array]:
    """Range and range-rate, remaining power, number and indices of the paths; visible paths come first."""
    order = np.argsort(~visible, axis=-1, kind="stable")[..., :most]
    z = np.take_along_axis(pair.measure(true_states[..., :4]), order[..., None], axis=-2)
    return z, pair.reflected[order], visible.sum(axis=-1), order


def urban_fields(slots: int, models: tuple[str, ...], reach: float) -> tuple[ObservationField, ...]:
    """The observation fields: the time left, then each slot."""
    listed = [ObservationField("time_left", "1", 0.5, 0.3, "fraction of the horizon still to come")]
    for s in range(1, slots + 1):
        of = f"of the track in slot {s}; 0 if the slot is empty"
        listed += [
            ObservationField(f"existence_{s}", "1", 0.5, 0.5, f"probability of existence {of}"),
            ObservationField(f"confirmed_{s}", "1", 0.5, 0.5, f"whether the track in slot {s} is confirmed"),
            ObservationField(f"x_{s}", "m", 0.0, reach / 3, f"x relative to the first transmitter, {of}"),
            ObservationField(f"y_{s}", "m", 0.0, reach / 3, f"y relative to the first transmitter, {of}"),
            ObservationField(f"xdot_{s}", "m/s", 0.0, 10.0, f"velocity along x {of}"),
            ObservationField(f"ydot_{s}", "m/s", 0.0, 10.0, f"velocity along y {of}"),
            ObservationField(f"sigma_position_{s}", "m", 2.0, 3.0, f"RMS position uncertainty {of}"),
            ObservationField(f"sigma_velocity_{s}", "m/s", 1.0, 2.0, f"RMS velocity uncertainty {of}"),
        ]
        listed += [
            ObservationField(f"mu_{name.replace(' ', '_')}_{s}", "1", 0.5, 0.5, f"probability of {name} {of}")
            for name in models
        ]
    return tuple(listed)


def urban_info(state: State) -> dict[str, Array]:
    """See ``Urban.state_info``."""
    truth, belief = state
    values, held = np.empty((3, *truth.present.shape)), np.empty(truth.present.shape, np.bool_)
    counts, sure = np.empty((4, len(belief.step)), np.int64), np.empty(belief.status.shape, np.bool_)
    places = np.empty((*sure.shape, 2))
    sizes = (0,) * belief.x.shape[3], (0,) * belief.x.shape[2]
    kernels.figures(
        belief.step, belief.x, belief.P, belief.mu, belief.status, truth.targets, truth.present, truth.number,
        HELD_WITHIN, values, held, counts, sure, places, *sizes
    )  # fmt: skip
    distance = np.empty((len(sure), 4))
    there = for_kernel(truth.targets[..., :2])
    gospa_kernels.gospa(there, truth.present, places, sure, HELD_WITHIN, 2.0, distance)
    return {
        "position_error": values[0],
        "position_variance": values[1],
        "nees": values[2],
        "present": held,
        "held": held,
        "confirmed": counts[0],
        "false": counts[1],
        "tentative": counts[2],
        "refused": belief.refused,
        "gospa": distance[:, 0],
        "measurements": counts[3],
    }


def deviation_model(dt: float) -> tuple[Array, Array]:
    """F (2, 2) and g (2,) of the deviation (p, v) from the route on each axis: (p, v)' = F (p, v) + g a.

    Random accelerations push the target off its route, and the driver steers back.

    The random acceleration ``a`` is constant during a step of ``dt`` s. F and g are exact for any step. They are the
    matrix exponential of the oscillator
    v' = a - 2 DAMPING RETURN v - RETURN^2 p.
    With sigma = 0.25 m/s^2 and steps of 0.25 s the deviation has standard deviations of 0.45 m and 0.14 m/s.
    """
    rates = np.array([[0.0, 1.0, 0.0], [-(RETURN**2), -2.0 * DAMPING * RETURN, 1.0], [0.0, 0.0, 0.0]])
    step = scipy.linalg.expm(dt * rates)
    return step[:2, :2].copy(), step[:2, 2].copy()
