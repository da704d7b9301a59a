"""Cost and key figures of the urban loop, against the same in plain NumPy."""

from __future__ import annotations

import numpy as np
import oracles
import pytest

from wavegym.systems.urban.state import HELD_WITHIN
from wavegym.systems.urban.system import Urban
from wavegym.systems.urban.tracker import CONFIRMED, EMPTY, Tracks
from wavegym.trackers import gospa

SYSTEM, COUNT = Urban(horizon=80), 3


@pytest.fixture(scope="module")
def states():
    """Every tenth state of a run in which tracks begin, are confirmed and are lost."""
    worlds = oracles.worlds(SYSTEM, COUNT)
    state, found = SYSTEM.initial(worlds), []
    for step in range(SYSTEM.horizon):
        if step % 10 == 0:
            found.append(state)
        state = SYSTEM.transition(state, np.full(COUNT, step % 4), worlds)
    return found


def expected(state, e):
    """The figures of environment e, target by target and track by track."""
    truth, belief = state
    x, P = Tracks(*belief[1:]).combined()
    sure = np.flatnonzero(belief.status[e] == CONFIRMED)
    distance = np.linalg.norm(truth.targets[e, :, None, :2] - x[e, sure, :2], axis=-1)  # (target, track)
    rows = []
    for t, present in enumerate(truth.present[e]):
        least = distance[t].min(initial=np.inf)
        held, variance, nees = present and least <= HELD_WITHIN, 0.0, 0.0
        if held:
            own = sure[distance[t].argmin()]
            off, spread = truth.targets[e, t, :4] - x[e, own, :4], P[e, own, :4, :4]
            variance, nees = spread[0, 0] + spread[1, 1], off @ np.linalg.inv(spread) @ off
        rows.append((min(least, HELD_WITHIN) if present else 0.0, variance, nees, held, held))
    names = ("position_error", "position_variance", "nees", "present", "held")
    return dict(zip(names, np.array(rows).T, strict=True)) | {
        "confirmed": len(sure),
        "false": (~(distance[truth.present[e]] <= HELD_WITHIN).any(axis=0)).sum(),
        "tentative": (belief.status[e] != EMPTY).sum() - len(sure),
        "refused": belief.refused[e],
        "gospa": gospa(truth.targets[e, truth.present[e], :2], x[e, sure, :2], cutoff=HELD_WITHIN).distance,
        "measurements": truth.number[e].sum(),
    }


def test_figures_are_those_of_the_nearest_confirmed_track(states):
    counted = 0
    for state in states:
        figures = SYSTEM.state_info(state)
        for e in range(COUNT):
            wanted = expected(state, e)
            assert figures.keys() == wanted.keys()
            for name, value in wanted.items():
                np.testing.assert_allclose(figures[name][e], value, rtol=1e-9, err_msg=name)
            counted += wanted["held"].sum()
    assert counted > COUNT
    assert SYSTEM.nees_dimension == 4


def test_the_cost_is_that_of_the_cheapest_slots(states):
    for state in states:
        belief = state.belief
        _, P = Tracks(*belief[1:]).combined()
        trace = np.minimum(np.trace(P, axis1=-2, axis2=-1), SYSTEM.absent)  # all weights are 1
        each = belief.existence * trace + (1.0 - belief.existence) * SYSTEM.absent
        wanted = np.sort(each, axis=1)[:, : SYSTEM.charged].sum(axis=1)
        assert SYSTEM.absent == 5.0**2 + 2 * 10.0**2 + 2 * 1.0**2
        np.testing.assert_allclose(SYSTEM.cost(belief), wanted, rtol=1e-12)
