"""The urban loop: tape, scene, truth, belief and observation fields."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.system import ObservationField, State
from wavegym.sensors.multistatic import Multistatic
from wavegym.sensors.urban_map import UrbanMap
from wavegym.targets import ScriptedPath
from wavegym.trackers import Tracks, gospa
from wavegym.trackers.urban.tracker import CONFIRMED, EMPTY

HELD_WITHIN = 20.0  # m, cutoff of GOSPA too: a confirmed track farther from a target does not hold it
MOST = 64  # least room for the measurements of a pair in a scan
GREATEST = 4096  # greatest room


class World(NamedTuple):
    """One episode's tape: routes are fixed; measurements are drawn by counter from a key."""

    key: Array  # () uint64


class Truth(NamedTuple):
    """What no scheduler sees."""

    targets: Array  # (env, target, 6): x, y, xdot, ydot, xddot, yddot
    present: Array  # (env, target)
    z: Array  # (env, pair, most, 2): the last scan
    number: Array  # (env, pair): number of its measurements
    refused: Array  # (env,): new tracks that found no free slot in it


class Belief(NamedTuple):
    """The tracks (``wavegym.trackers.Tracks``) at a step."""

    step: Array  # (env,)
    x: Array  # (env, slot, model, 6)
    P: Array  # (env, slot, model, 6, 6)
    mu: Array  # (env, slot, model)
    existence: Array  # (env, slot)
    status: Array  # (env, slot)
    age: Array  # (env, slot)


def room_for(expected: float) -> int:
    """Room for the measurements of a pair in a scan, for an expected number of false returns.

    Six standard deviations of clutter, and returns of targets.

    Raises:
        InputError: more than ``GREATEST``.
    """
    most = max(MOST, math.ceil(expected + 6.0 * math.sqrt(expected)) + MOST // 2)
    if most > GREATEST:
        wanted = f"at most {GREATEST} with targets' and six standard deviations"
        raise InputError(f"false returns of a pair in a scan are {expected:.4g} on average, expected {wanted}")
    return most


class Scene(NamedTuple):
    """Targets and their propagation paths, for every scan from 0 to the horizon; no action changes them."""

    truth: Array  # (scan, target, 6)
    present: Array  # (scan, target)
    path_count: Array  # (pair, scan, target): number of visible paths; they come first along the path axis
    path_index: Array  # (pair, scan, target, path): index of each path in ``Multistatic.paths``
    z: Array  # (pair, scan, target, path, 2): range and range-rate
    reflected: Array  # (pair, scan, target, path): fraction of the power left after the walls
    direct: Array  # (scan, target): whether the direct paths of the first two pairs are visible


def make_scene(
    urban_map: UrbanMap, pairs: Sequence[Multistatic], route: ScriptedPath, arrivals: ArrayLike, times: Array
) -> Scene:
    """All targets drive along one route, each from its own arrival [s] on; times (scan,) in s.

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
    return Scene(true_states, present, path_count, path_index, z, reflected, direct)


def _driven(route: ScriptedPath, arrival: float, times: Array) -> tuple[Array, Array]:
    here = route.sample(np.maximum(times - arrival, 0.0))
    return np.concatenate([here.positions, here.velocities, here.accelerations], axis=1), times >= arrival


def _table(pair: Multistatic, true_states: Array, visible: Array, most: int) -> tuple[Array, Array, Array, Array]:
    """Range and range-rate, power left, number and indices of the paths; visible paths come first."""
    order = np.argsort(~visible, axis=-1, kind="stable")[..., :most]
    z = np.take_along_axis(pair.measure(true_states[..., :4]), order[..., None], axis=-2)
    return z, pair.reflected[order], visible.sum(axis=-1), order


def urban_fields(slots: int, models: tuple[str, ...], reach: float) -> tuple[ObservationField, ...]:
    """Observation fields, slot by slot."""
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


def urban_info(state: State, direct: Array) -> dict[str, Array]:
    """See ``Urban.state_info``; direct (scan, target): whether both direct paths to a target are visible."""
    truth, belief = state
    x, P = Tracks(*belief[1:]).combined()
    sure = belief.status == CONFIRMED
    off = truth.targets[:, :, None, :4] - x[:, None, :, :4]  # (env, target, slot, 4)
    distance = np.where(sure[:, None], np.hypot(off[..., 0], off[..., 1]), np.inf)
    near = distance.argmin(axis=2)
    least = distance.min(axis=2)
    held = truth.present & (least <= HELD_WITHIN)
    e, g = np.nonzero(held)
    nees, variance = np.zeros((2, *held.shape))
    own, spread = off[e, g, near[e, g]], P[e, near[e, g], :4, :4]
    nees[e, g] = (own * np.linalg.solve(spread, own[..., None])[..., 0]).sum(axis=-1)
    variance[e, g] = spread[:, 0, 0] + spread[:, 1, 1]
    nobody = (np.where(truth.present[:, :, None], distance, np.inf).min(axis=1) > HELD_WITHIN) & sure
    return {
        "position_error": np.where(truth.present, np.minimum(least, HELD_WITHIN), 0.0),
        "position_variance": variance,
        "nees": nees,
        "present": held,
        "held": held,
        "lost": direct[belief.step] & ~held,
        "confirmed": sure.sum(axis=1),
        "false": nobody.sum(axis=1),
        "tentative": ((belief.status != EMPTY) & ~sure).sum(axis=1),
        "refused": truth.refused,
        "gospa": gospa(truth.targets[..., :2], x[..., :2], truth.present, sure, HELD_WITHIN).distance,
        "measurements": truth.number.sum(axis=1),
    }
