"""Beam allocation: detections, worlds, observations."""

from __future__ import annotations

import agile_clutter_oracle as plain
import numpy as np
import oracles
import pytest
from beam_plays import SYSTEM, TARGET, choices, coasted, played
from scipy.stats import kstest

import wavegym  # noqa: F401
from wavegym.sensors import detection_probability
from wavegym.systems.agile_clutter.system import AgileClutter


@pytest.mark.slow
def test_only_visible_targets_in_a_beam_are_detected():
    """Pd at the true ranges, to five errors; other targets have no return and no update."""
    rng, rows, steps = np.random.default_rng(0), np.arange(500), 60_000
    worlds, looks, found, total, variance = oracles.worlds(SYSTEM, 500), 0, 0.0, 0.0, 0.0
    F = plain.transition(SYSTEM)[0]
    for _ in range(-(-steps // (500 * SYSTEM.horizon))):
        state = SYSTEM.initial(worlds)
        for k in range(SYSTEM.horizon):
            action, before = rng.integers(36, size=500), state.belief
            target = TARGET[choices(action)]
            state = SYSTEM.transition(state, action, worlds)
            figures, lit = SYSTEM.state_info(state), np.zeros((500, 3), bool)
            lit_by = np.zeros(500)
            for i, site in enumerate(SYSTEM.sensors):
                own, seen = target[:, i], before.visible[rows, k, target[:, i]]
                r = np.hypot(*(state.truth.targets[rows, own, :2] - site).T)
                pd = detection_probability((SYSTEM.reference_range / r) ** 4, SYSTEM.false_alarm, searched=2) * seen
                lit_by += seen
                total, variance = total + pd.sum(), variance + (pd * (1 - pd)).sum()
                lit[rows[seen], own[seen]] = True
            assert (figures["detections"] <= lit_by).all()
            assert (figures["clutter"][~lit.any(axis=1)] == 0).all()
            dark = np.abs(state.belief.covariance - coasted(SYSTEM, before))[~lit]
            assert dark.max() < 1e-9 * np.abs(state.belief.covariance).max()
            np.testing.assert_allclose(state.belief.mean[~lit], (before.mean @ F.T)[~lit], rtol=1e-12, atol=1e-12)
            assert not state.truth.outside[(~before.visible[:, : k + 1]).all(axis=1)].any()
            found, looks = found + figures["detections"].sum(), looks + lit_by.sum()
    assert looks > 0.5 * steps
    assert abs(found - total) < 5 * np.sqrt(variance)


def test_starts():
    """Starts are uniform about the middle ones, first errors have P0 (Kolmogorov, 1e-4)."""
    state = SYSTEM.initial(oracles.worlds(SYSTEM, 400))
    share = (state.truth.targets - SYSTEM.starts) / SYSTEM.spread
    assert kstest(share.ravel(), "uniform", (-1, 2)).pvalue > 1e-4
    error = (state.belief.mean - state.truth.targets) / np.sqrt(SYSTEM.prior_variance)
    assert kstest(error.ravel(), "norm").pvalue > 1e-4
    np.testing.assert_array_equal(state.truth.path[:, :, 0], state.truth.targets)
    assert 0.55 < state.belief.visible.mean() < 0.65  # 10 of 17 steps


def test_what_agents_see():
    """All but the windows is the parent's; ordinary values within the bounds."""
    shared = ("horizon", "dt", "q", "sensors", "starts", "births", "lifetime", "prior_variance", "clutter_density")
    parent = AgileClutter(**{name: getattr(SYSTEM, name) for name in shared})
    centre, scale = (np.array([getattr(e, name) for e in SYSTEM.observation_fields]) for name in ("centre", "scale"))
    assert [e.name for e in SYSTEM.observation_fields[:-9]] == [e.name for e in parent.observation_fields]
    for k in (0, 13, 45, 55, 59, 60):
        belief = played(SYSTEM, oracles.worlds(SYSTEM, 40), k).belief
        seen = SYSTEM.observe(belief)
        np.testing.assert_array_equal(seen[:, :-9], parent.observe(belief))
        assert (np.abs((seen - centre) / scale) < 10).all()


def test_labels_name_the_target_and_the_pulse_of_each_sensor():
    train = "target 1: 8 x (PFM3 up 6.25 us 1 MHz) every 250 us"
    assert SYSTEM.actions.labels[8] == f"{train} | target 2: PFM3 up 50 us 40 MHz"
