"""The paper's search against an exhaustive one, on beliefs met in the course of episodes."""

from __future__ import annotations

from itertools import product
from types import SimpleNamespace

import numpy as np
import oracles
import pytest

from wavegym.schedulers import Myopic, Progressive
from wavegym.schedulers.registry import is_scheduler, make_policy
from wavegym.sensors.eclipsing import NEVER_CUT
from wavegym.systems.agile_clutter.shortcuts import after_sensor, sensor_costs
from wavegym.systems.agile_clutter.system import AgileClutter

BOX = AgileClutter(action="box")
WIDE = AgileClutter(action="box", tracker="jpda")  # beliefs so wide that settings differ
STEPS = (0, 3, 7, 12, 24)
WHOLE = NEVER_CUT[None]  # all targets are beyond the blind ranges
SENSOR = ((3e3, -16e3),)


@pytest.fixture(scope="module")
def beliefs():
    """Beliefs of six episodes under random choices, at ``STEPS``."""
    worlds, rng = oracles.worlds(WIDE, 6), np.random.default_rng(1)
    state, met = WIDE.initial(worlds), {}
    for k in range(max(STEPS) + 1):
        met[k] = state.belief
        action = rng.uniform(-1, 1, (6, *WIDE.candidates().shape[1:]))
        state = WIDE.transition(state, action, worlds)
    return [met[k] for k in STEPS]


def chosen(system, belief, **settings):
    policy = Progressive(**settings)
    policy.begin(system, len(belief.step), np.random.default_rng(0))
    return policy.act(belief, None, None)


def predicted(system, belief, action):
    return system.cost(system.predict(belief, action))


def fine_grid(system, points):
    """Every law and direction with ``points`` durations and sweeps: C (candidate, 2, 2)."""
    action_set = system.action_set
    axes = [np.geomspace(min(values), max(values), points) for values in (action_set.durations, action_set.sweeps)]
    law, duration, sweep, sign = np.array(list(product(range(len(action_set.laws)), *axes, (1.0, -1.0)))).T
    return action_set.chirp_covariance(law.astype(int), duration, sign * sweep)


def test_it_finds_what_a_fine_grid_finds(beliefs):
    """Its last grid is as fine as 17 points an axis; it may only miss another valley, by less than a grid step."""
    C = fine_grid(BOX, 17)
    for belief in beliefs:
        targets = BOX.predicted_targets(belief)
        for i in range(2):
            cost = sensor_costs(BOX, targets, i, C[None], WHOLE.repeat(len(C), 1), np.zeros(len(C), int))
            if i == 0:
                best, count = cost.argmin(axis=1), len(cost)
                targets = after_sensor(BOX, targets, 0, C[best], WHOLE[0].repeat(count, 0), np.zeros(count, int))
        best = cost.min(axis=1)
        found = predicted(BOX, belief, chosen(BOX, belief))
        np.testing.assert_array_less(found, best * 1.01)
        np.testing.assert_array_less(best, found * 1.01)


def test_finer_grids_reach_to_the_neighbours_of_the_best_point():
    """Durations 1 to 16 and a best one of 3.2: each grid of five spans the points beside the best of the one before."""
    tried = []

    def covariance(law, duration, sweep):
        tried.append(np.unique(duration.round(9)))
        return np.stack([duration, 0.0 * duration, 0.0 * duration, sweep], axis=-1).reshape(*duration.shape, 2, 2)

    actions = SimpleNamespace(
        sensors=1, laws=("only",), durations=(1.0, 16.0), sweeps=(1.0, 16.0), chirp_covariance=covariance,
        chirp_windows=lambda law, duration, sweep: np.zeros((*duration.shape, 11)), encode_chirps=lambda *chirp: chirp
    )  # fmt: skip
    policy = Progressive(points=5, levels=3)
    policy._system = SimpleNamespace(action_set=actions)
    policy._sensors = SimpleNamespace(
        begin=lambda belief: SimpleNamespace(mean=np.zeros((1, 1, 4))),
        costs=lambda predicted, sensor, C, windows, alarm: np.log(C[..., 0, 0] / 3.2) ** 2 + (C[..., 1, 1] - 4.0) ** 2,
    )
    _, duration, sweep = policy.act(None, None, None)
    for found, (low, high) in zip(tried, [(1, 16), (2, 8), (2, 4)], strict=True):
        np.testing.assert_allclose(found, np.geomspace(low, high, 5), rtol=1e-8)
    np.testing.assert_allclose([duration, sweep], [[[2.0**1.75]], [[4.0]]], rtol=1e-12)


def test_more_levels_leave_less_trace(beliefs):
    """Every grid holds the best point of the one before. (Of two sensors only the first is sure to gain.)"""
    system = AgileClutter(action="box", sensors=SENSOR)
    gained = 0
    for belief in beliefs:
        coarse, fine = (predicted(system, belief, chosen(system, belief, levels=levels)) for levels in (1, 4))
        assert (fine <= coarse * (1 + 1e-9)).all()
        gained += (fine < coarse * (1 - 1e-4)).sum()
    assert gained > 0


@pytest.mark.parametrize("sensors", [SENSOR, BOX.sensors])
def test_it_predicts_no_more_than_the_library_scheduler(beliefs, sensors):
    """The library's durations and sweeps span the box but are few. Its 4 MHz lie between points of the search: 1e-4."""
    box, listed, library = AgileClutter(action="box", sensors=sensors), AgileClutter(sensors=sensors), Myopic()
    library.begin(listed, 6, np.random.default_rng(0))
    for belief in beliefs:
        coarse = predicted(listed, belief, library.act(belief, None, None))
        assert (predicted(box, belief, chosen(box, belief)) <= coarse * (1 + 1e-4)).all()


def test_restricted_laws_are_all_it_transmits(beliefs):
    system = AgileClutter(action="box", laws=("efm:0.5",))
    action = chosen(system, beliefs[0])
    assert action.shape == (6, 4)
    assert (np.abs(action) <= 1).all()
    all_laws = predicted(BOX, beliefs[0], chosen(BOX, beliefs[0]))
    assert (all_laws <= predicted(system, beliefs[0], action) * (1 + 1e-9)).all()


def test_it_has_a_name():
    policy = make_policy("myopic:progressive", BOX, None)
    assert type(policy) is Progressive
    assert is_scheduler("myopic:progressive")
