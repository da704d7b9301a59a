"""The trial of a decision for the street: what is lit, the beam's turn, the account and the forecasts."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from wavegym.core import shortcuts
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.systems.urban.scan_kernels import expect

sys.path.insert(0, str(Path(__file__).parents[1] / "examples" / "street"))
from street import LIVE, Street

pytestmark = pytest.mark.slow

COUNT = 12


@pytest.fixture(scope="module", autouse=True)
def _visible_paths():
    """All streets share the tables of their map, which take four seconds."""
    Street()


def begun(**settings):
    system = Street(**settings)
    worlds = draw_worlds(system, world_seeds(0, "tune", COUNT))
    return system, worlds, system.initial(worlds)


@pytest.mark.slow
@pytest.mark.parametrize(("action", "sign"), [(0, 1.0), (1, -1.0)])
def test_echoes_come_from_the_lit_street(action, sign):
    system, worlds, state = begun(clutter_density=1e-9)
    chosen, cosines = np.full(COUNT, action), []
    for _ in range(8):
        truth = system.move(state.truth, state.belief.step, worlds)
        found = system.measure(truth, state.belief, chosen, worlds)
        for z, number in zip(found.z[:, 1], found.number[:, 1], strict=True):  # its array stands along y
            cosines += z[:number, 2].tolist()
        state = system.transition(state, chosen, worlds)
    assert len(cosines) > COUNT
    assert np.mean(sign * np.array(cosines) > 0.0) > 0.75  # the others come over walls of the other side


def test_beam_sends_nothing_while_it_turns():
    system, worlds, state = begun(kind="revisit", dead_scans=4)
    sent = []
    for action in [0] * 7 + [1] * 2 + [0] * 6:
        chosen = np.full(COUNT, action)
        assert (shortcuts.delay(system, state.belief)[:, action] == sent_in(sent, action)).all()
        truth = system.move(state.truth, state.belief.step, worlds)
        sent.append((action, system.measure(truth, state.belief, chosen, worlds).number.sum() > 0))
        state = system.transition(state, chosen, worlds)
    assert [is_sent for _, is_sent in sent] == [False] * 4 + [True] * 3 + [False] * 2 + [False] * 4 + [True] * 2


def sent_in(sent, action):
    """Scans until a train, by hand: four after a change of street, one less with each scan since."""
    since = 0
    for before, _ in reversed(sent):
        if before != action:
            break
        since += 1
    return max(4 - since, 0)


def test_account_pays_trains_until_it_is_empty():
    system, worlds, state = begun(kind="energy", budget=0.05)
    for left in (4.0, 3.0, 2.0, 1.0):
        assert (state.belief.energy == left).all()
        assert system.mask(state.belief).all()
        state = system.transition(state, np.zeros(COUNT, np.int64), worlds)
    np.testing.assert_array_equal(system.mask(state.belief), np.tile([False, True], (COUNT, 1)))


@pytest.mark.slow
def test_forecast_of_narrow_tracks_is_the_trackers():
    """Where a track has hardly any spread, its place is lit or not, as ``expect`` of the tracker takes it."""
    system, _, state = begun(kind="revisit")
    P = state.belief.P.copy()
    P[..., :2, :] = P[..., :, :2] = 0.0
    P[..., 0, 0] = P[..., 1, 1] = 1e-6
    P[..., 2, 2] = P[..., 3, 3] = 1e-6
    belief = state.belief._replace(P=P)
    predicted = system.predict(belief, np.zeros(COUNT, np.int64))
    wave, snr = system._of_pairs(np.ones(COUNT, np.int64))
    tracks = [np.array(leaf) for leaf in belief[1:7]]
    expect(*tracks, system._lit[0], wave, snr, *system.urban_tracker._sizes)
    close = np.isclose(predicted.P[:, :4], tracks[1][:, :4], rtol=1e-9, atol=1e-12).all(axis=(2, 3, 4))
    assert close.mean() > 0.95  # all but tracks that stand within a centimetre of the edge of a cell


@pytest.mark.slow
def test_drawn_outcomes_keep_the_mean_of_existence():
    system, _, state = begun(kind="revisit")
    one = state.belief._replace(existence=np.full_like(state.belief.existence, 0.6))
    draws = np.random.default_rng(1).random((3000, *system.outcome_shape))
    many = type(one)(*(np.repeat(leaf[:1], len(draws), axis=0) for leaf in one))
    after = system.predict(many, np.zeros(len(draws), np.int64), draws)
    mean, spread = after.existence[:, :4].mean(axis=0), after.existence[:, :4].std(axis=0) / np.sqrt(len(draws))
    assert (np.abs(mean - 0.6 * LIVE) <= 4.5 * spread + 1e-12).all()
