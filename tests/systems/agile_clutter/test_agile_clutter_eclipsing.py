"""Echoes that return while the pulse is being sent: loop, prediction and derived systems against plain NumPy."""

from __future__ import annotations

from functools import cache

import agile_clutter_oracle as plain
import eclipsing_oracle as gated
import numpy as np
import oracles
import pytest

from wavegym.core import shortcuts, trees
from wavegym.sensors import detection_probability
from wavegym.systems.agile_clutter.system import AgileClutter
from wavegym.systems.beam_allocation.system import BeamAllocation
from wavegym.systems.energy_budget.system import EnergyBudget
from wavegym.testing.check import prediction_defect

CARRIER = 10.4e9
TABLES = 1e-3  # standard deviations by which the interpolated law may move estimates
NEAR = {  # of pulses of 100 us a third to nearly all is visible, of those of 30 us all; the second target is hidden too
    "sensors": ((0.0, -10e3), (9e3, 0.0)),
    "starts": ((0.0, 0.0, -100.0, 300.0), (8.8e3, 0.05e3, 10.0, -20.0)),
    "births": (0, 2),
    "lifetime": 12,
    "horizon": 12,
    "clutter_density": 1e-6,
    "prior_variance": (4e2, 4e2, 100.0, 100.0),
    "nearest_range": 1e3,  # eta stays within the tables of the law
}
WELL = {"laws": ("pfm:3", "hfm:0.5"), "durations": (30e-6, 100e-6), "sweeps": (4e6,)}
BEAMS = {"sensors": ((0.0, -4e3), (-5e3, 0.0)), "starts": ((0.0, 1e3, 0, 0), (-3e3, -1e3, 0, 0), (1e3, -2e3, 0, 0))}
BUDGET = {"starts": ((0.0, 7e3, 0.0, 0.0),), "spread": (3e3, 3e3, 100.0, 100.0)}


def cut(waveform):
    """C(r) of the oracle of the loop, from inner products of the gated pulse."""

    @cache
    def at(r):
        share, _ = gated.information(waveform, 2 * r / gated.C)
        return (1.0 if share > 1 - 1e-12 else share), gated.covariance(waveform, r, CARRIER) if share > 1e-4 else None

    return at


@pytest.mark.slow
def test_transition_and_prediction_are_the_plain_loop_with_cut_echoes():
    """Some echoes are whole, some cut, some gone. Pd and the effective eta are interpolated, hence TABLES."""
    system = AgileClutter(tracker="jpda", **NEAR, **WELL)
    worlds, rng = oracles.worlds(system, 2, seed=5), np.random.default_rng(6)
    pulses = [cut(waveform) for waveform in system.action_set.sensor_library]
    state, shares = system.initial(worlds), []
    for k in range(system.horizon):
        actions, belief = rng.integers(len(system.actions), size=(2, 2)), state.belief
        after, predicted = system.transition(state, actions, worlds), system.predict(belief, actions)
        detections = system.state_info(after)["detections"]
        for e in range(2):
            C = [pulses[a] for a in actions[e]]
            want = plain.step(system, worlds, e, belief, state.truth.path[e], C)
            assert oracles.covariance_distance(after.belief.covariance[e], want.covariance) < TABLES, f"step {k + 1}"
            sigma = np.sqrt(np.diagonal(want.covariance, axis1=1, axis2=2))
            assert (np.abs(after.belief.mean[e] - want.mean) / sigma).max() < TABLES
            assert detections[e] == want.detections
            np.testing.assert_array_equal(after.truth.outside[e] - state.truth.outside[e], want.outside)
            x, P = plain.predicted_after(system, k, belief.mean[e], belief.covariance[e], C)
            assert oracles.covariance_distance(predicted.covariance[e], P) < TABLES
            here = [t for t in range(2) if plain.present(system, k + 1)[t]]
            shares += [C[i](np.hypot(*(x[t, :2] - site)))[0] for t in here for i, site in enumerate(system.sensors)]
        state = after
    shares = np.array(shares)
    assert (shares == 1.0).sum() > 5
    assert ((shares > 0.02) & (shares < 1.0)).sum() > 10
    assert (shares < 0.02).sum() > 3


@pytest.mark.parametrize("system", [EnergyBudget(**BUDGET), BeamAllocation(**BEAMS)], ids=lambda s: type(s).__name__)
def test_the_gains_of_near_targets_agree_with_prediction(system):
    assert prediction_defect(system) is None
    off = type(system)(**(BUDGET if isinstance(system, EnergyBudget) else BEAMS), eclipsing=False)
    belief = system.initial(oracles.worlds(system, 20)).belief
    on, open_ = (shortcuts.gain(each, belief, 0, 5) for each in (system, off))
    assert (on <= open_ * (1 + 1e-9) + 1e-9).all()
    assert (on < 0.999 * open_).any()


@pytest.mark.parametrize("system", [AgileClutter, BeamAllocation, EnergyBudget])
def test_beyond_the_blind_ranges_nothing_changes(system):
    """Bit for bit, at the defaults."""
    worlds, rng, states = oracles.worlds(system(), 3), np.random.default_rng(0), []
    shape = (system().horizon, 3, *np.shape(system().candidates())[1:])
    actions = rng.integers(4, size=shape)
    for eclipsing in (True, False):
        one = system(eclipsing=eclipsing)
        state = one.initial(worlds)
        for action in actions:
            state = one.transition(state, action, worlds)
        states.append(state)
    trees.tree_map(np.testing.assert_array_equal, *states)


def test_detections_follow_the_snr_of_what_is_seen():
    """Targets that stand still at known shares of a pulse: Pd is that of the share of eta, to four errors."""
    for r in (3e3, 8e3, 12e3):
        system = AgileClutter(
            sensors=((0.0, 0.0),), starts=((r, 0.0, 0.0, 0.0),), births=(0,), q=0.0, prior_variance=(1e-2,) * 4,
            reference_range=r * 4**0.25, laws=("pfm:3",), durations=(100e-6,), sweeps=(4e6,), clutter_density=0.0,
            lifetime=25, horizon=25,
        )  # fmt: skip
        worlds, count = oracles.worlds(system, 400), 0.0
        state = system.initial(worlds)
        for _ in range(system.horizon):
            state = system.transition(state, np.zeros((400, 1), int), worlds)
            count += system.state_info(state)["detections"].sum()
        share, _ = gated.information(system.action_set.sensor_library[0], 2 * r / gated.C)
        pd = detection_probability(4 * share, 0.01, searched=2)
        assert abs(count / 1e4 - pd) < 4 * np.sqrt(pd * (1 - pd) / 1e4)


def test_an_echo_that_is_cut_away_opens_no_gate_and_teaches_nothing():
    system = AgileClutter(
        sensors=((0.0, 0.0),),
        starts=((200.0, 0.0, 0.0, 0.0),),
        births=(0,),
        q=0.0,
        durations=(100e-6,),
        prior_variance=(4.0, 4.0, 1.0, 1.0),
        horizon=25,
    )
    worlds = oracles.worlds(system, 5)
    state = system.initial(worlds)
    after = system.transition(state, np.zeros((5, 1), int), worlds)
    predicted = system.predict(state.belief, np.zeros((5, 1), int))
    F = system.motion.F
    want = F @ state.belief.covariance @ F.T + system.motion.Q
    for got in (after.belief.covariance, predicted.covariance):
        np.testing.assert_allclose(got, want, rtol=1e-12, atol=1e-9)
    figures = system.state_info(after)
    assert not figures["clutter"].any()
    assert not figures["detections"].any()
    assert not after.truth.outside.any()


def test_windows_of_a_box_are_those_of_its_library():
    library, box = (AgileClutter(**WELL, action=form).action_set for form in ("library", "box"))
    np.testing.assert_allclose(box.sensor_windows[:, :-1], library.sensor_windows[:, :-1], rtol=1e-12)
    rows, windows = box.windows(box.candidates[:7])
    want = library.sensor_windows[library.candidates[:7]]
    np.testing.assert_allclose(windows[rows][..., :-1], want[..., :-1], rtol=1e-9)
    np.testing.assert_array_equal(want[..., -1], library.candidates[:7])  # rows of a clutter field, which has no box
