"""A street with targets: what one episode draws, the truth, the belief, and what an agent is shown."""

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
from wavegym.sensors.urban_map import City
from wavegym.targets import ScriptedPath
from wavegym.trackers import Tracks, gospa
from wavegym.trackers.urban.tracker import CONFIRMED, EMPTY

HELD_WITHIN = 20.0  # m, of GOSPA too: a confirmed track farther off is none of a target's
MOST = 64  # measurements of a pair in a scan, where there is little clutter
GREATEST = 4096  # in any


class World(NamedTuple):
    """One episode's tape: where a target drives is known, what is measured of it comes by counter from a key."""

    key: Array  # () uint64


class Truth(NamedTuple):
    """What no scheduler sees."""

    targets: Array  # (env, target, 6): x, y, xdot, ydot, xddot, yddot
    present: Array  # (env, target)
    z: Array  # (env, pair, most, 2): the last scan
    number: Array  # (env, pair): how many measurements it has
    refused: Array  # (env,): tracks that found no slot of their own in it


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
    """Measurements of a pair in a scan that there has to be room for, where so many false returns are expected.

    Targets' returns beside six standard deviations of clutter.

    Raises:
        InputError: more than may be.
    """
    most = max(MOST, math.ceil(expected + 6.0 * math.sqrt(expected)) + MOST // 2)
    if most > GREATEST:
        wanted = f"at most {GREATEST} with targets' and six standard deviations"
        raise InputError(f"false returns of a pair in a scan are {expected:.4g} on average, expected {wanted}")
    return most


class Scene(NamedTuple):
    """What happens in the street whatever is transmitted, for every scan from 0 to the horizon."""

    truth: Array  # (scan, target, 6)
    present: Array  # (scan, target)
    ways: Array  # (pair, scan, target): how many ways are open
    way: Array  # (pair, scan, target, way): their numbers
    z: Array  # (pair, scan, target, way, 2): range and range-rate by each of them
    reflected: Array  # (pair, scan, target, way): what their walls leave of the power
    direct: Array  # (scan, target): whether the straight ways of the first two pairs are open


def make_scene(
    city: City, pairs: Sequence[Multistatic], path: ScriptedPath, arrivals: ArrayLike, times: Array
) -> Scene:
    """All targets drive along one path, each from its own arrival [s] on; times (scan,) in s.

    Raises:
        InputError: a path that leads through a wall.
    """
    driven = [_driven(path, arrival, times) for arrival in np.asarray(arrivals, np.float64)]
    true_states = np.stack([states for states, _ in driven], axis=1)
    present = np.stack([there for _, there in driven], axis=1)
    for states, there in driven:
        if there.sum() > 1:
            city.check_drivable("the targets' path", states[there, :2])
    if city.indoors(true_states[present][:, :2]).any():
        raise InputError(f"the targets' path begins in a building at {tuple(path.start)} m, expected one in a street")
    doors = [pair.open(true_states[..., :2]) & present[..., None] for pair in pairs]
    most = max(1, *(int(each.sum(axis=-1).max(initial=0)) for each in doors))
    tables = [_table(pair, true_states, door, most) for pair, door in zip(pairs, doors, strict=True)]
    z, reflected, ways, way = (np.stack(each) for each in zip(*tables, strict=True))
    direct = np.logical_and.reduce([door[..., 0] for door in doors[:2]])
    return Scene(true_states, present, ways, way, z, reflected, direct)


def _driven(path: ScriptedPath, arrival: float, times: Array) -> tuple[Array, Array]:
    here = path.sample(np.maximum(times - arrival, 0.0))
    return np.concatenate([here.positions, here.velocities, here.accelerations], axis=1), times >= arrival


def _table(pair: Multistatic, true_states: Array, door: Array, most: int) -> tuple[Array, Array, Array, Array]:
    """Range and rate, and power left, of the open ways, which come first; how many, and which they are."""
    order = np.argsort(~door, axis=-1, kind="stable")[..., :most]
    z = np.take_along_axis(pair.measure(true_states[..., :4]), order[..., None], axis=-2)
    return z, pair.reflected[order], door.sum(axis=-1), order


def urban_elements(slots: int, models: tuple[str, ...], reach: float) -> tuple[ObservationField, ...]:
    """Observation elements, slot by slot."""
    listed = [ObservationField("time_left", "1", 0.5, 0.3, "fraction of the horizon still to come")]
    for s in range(1, slots + 1):
        of = f"of the track in slot {s}; 0 in an empty one"
        listed += [
            ObservationField(f"existence_{s}", "1", 0.5, 0.5, f"probability of existence {of}"),
            ObservationField(f"confirmed_{s}", "1", 0.5, 0.5, f"whether the track in slot {s} is confirmed"),
            ObservationField(f"x_{s}", "m", 0.0, reach / 3, f"x, counted from the first transmitter, {of}"),
            ObservationField(f"y_{s}", "m", 0.0, reach / 3, f"y, counted from the first transmitter, {of}"),
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


def key_figures(state: State, direct: Array) -> dict[str, Array]:
    """What ``Urban.metrics`` says of a state; direct (scan, target): whether both first pairs see it straight."""
    truth, belief = state
    x, P = Tracks(*belief[1:]).combined()
    sure = belief.status == CONFIRMED
    off = truth.targets[:, :, None, :4] - x[:, None, :, :4]  # (env, target, slot, 4)
    distance = np.where(sure[:, None], np.hypot(off[..., 0], off[..., 1]), np.inf)
    near = distance.argmin(axis=2)
    least = distance.min(axis=2)
    held = truth.present & (least <= HELD_WITHIN)
    e, g = np.nonzero(held)
    nees = np.zeros(held.shape)
    own, spread = off[e, g, near[e, g]], P[e, near[e, g], :4, :4]
    nees[e, g] = (own * np.linalg.solve(spread, own[..., None])[..., 0]).sum(axis=-1)
    nobody = (np.where(truth.present[:, :, None], distance, np.inf).min(axis=1) > HELD_WITHIN) & sure
    return {
        "position_error": np.where(truth.present, np.minimum(least, HELD_WITHIN), 0.0),
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
