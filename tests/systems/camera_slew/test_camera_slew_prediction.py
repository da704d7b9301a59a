"""The camera that has to turn: one step in plain NumPy, prediction against transition, delays and gains."""

from __future__ import annotations

import math

import numpy as np
import oracles
import pytest
import rf_eo_oracle as plain
from camera_episodes import OPEN, SETTLES, azimuth, later, wrap
from scipy.stats import norm

from wavegym.core import shortcuts, trees
from wavegym.systems.camera_slew.system import CameraSlew
from wavegym.trackers.polar_kernels import to_cartesian


def polar(x):
    """[r, rdot, azimuth, cross velocity] of states (..., 4) relative to the sensor."""
    px, vx, py, vy = np.moveaxis(x, -1, 0)
    r = np.hypot(px, py)
    return np.stack([r, (px * vx + py * vy) / r, np.arctan2(px, py), (py * vx - px * vy) / r], axis=-1)


def state(p):
    """States relative to the sensor, (..., 4), from polar ones."""
    r, rdot, azimuth, v = np.moveaxis(p, -1, 0)
    s, c = np.sin(azimuth), np.cos(azimuth)
    return np.stack([r * s, rdot * s + v * c, r * c, rdot * c - v * s], axis=-1)


def gradient(function, at):
    """By central differences, (outputs, 4)."""
    steps = np.diag([1e-2, 1e-4, 1e-6, 1e-4])
    return np.stack([(function(at + h) - function(at - h)) / (2 * h.max()) for h in steps], axis=-1)


def predicted(system, p, S, q):
    """Sigma points p +- 2 A_k through the motion; the process noise is added at the mean."""
    F, spread = system.motion.F, 2 * np.linalg.cholesky(S).T
    turned = p * [1, 1, 0, 1]  # the frame whose y axis points at the target: azimuths stay far from +-pi
    points = polar(state(np.concatenate([turned + spread, turned - spread])) @ F.T)
    mean = points.mean(axis=0)
    back = gradient(state, mean)
    noise = np.linalg.solve(back, np.linalg.solve(back, q * system.motion.Q).T)
    return mean + np.array([0, 0, p[2], 0]), (points - mean).T @ (points - mean) / 8 + noise


def missed(p, S, off, half, detection):
    """A look around p[2] + off that finds nothing: moments of the azimuth, and regression on it."""
    sigma = np.sqrt(S[2, 2])
    grid = np.linspace(-9, 9, 200_001)
    weight = norm.pdf(grid) * (1 - detection * (np.abs(grid * sigma - off) <= half))
    mean = np.average(grid, weights=weight)
    share, g = np.average((grid - mean) ** 2, weights=weight) - 1, S[:, 2] / sigma
    return p + g * mean, S + share * np.outer(g, g)


def one_step(system, belief, action, seen):
    """Polar means and covariances and the camera one step on, predicted; ``seen``: whether a target searched is found.

    belief: of one environment.
    """
    aim = azimuth(system, belief.mean)
    off = wrap(aim[action] - belief.pointing)
    pointing = wrap(belief.pointing + np.clip(off, -system.slew * system.dt, system.slew * system.dt))
    far = abs(off) > system.half_field
    sees, settling = not far and belief.settling == 0, system.settle if far else max(belief.settling - 1, 0)
    R = plain.plain_variances(system, (system.prf, system.bandwidth, 2 * system.half_field / system.pixels))
    out = []
    for t in range(system.targets):
        p, S = predicted(system, belief.polar_mean[t], belief.polar_covariance[t], belief.q[t])
        S = np.linalg.inv(np.linalg.inv(S) + np.diag([1 / R[0], 1 / R[1], 0, 0]))
        sigma, away = np.sqrt(S[2, 2]), wrap(pointing - p[2])
        mass = np.subtract(*norm.cdf([(away + system.half_field) / sigma, (away - system.half_field) / sigma]))
        if sees and belief.visible[belief.step, t] and mass > 1e-9:
            if seen:
                S = np.linalg.inv(np.linalg.inv(S) + np.diag([0, 0, 1 / R[2], 0]))
            else:
                p, S = missed(p, S, away, system.half_field, system.detection)
        out.append((p, S))
    return np.array([p for p, _ in out]), np.array([S for _, S in out]), pointing, settling


def test_one_step_is_that_of_plain_numpy():
    """Polar means, covariances (to the precision of differences in doubles) and the camera."""
    system = CameraSlew(horizon=30)
    batch, worlds = later(system, 6, 3)
    for _ in range(20):  # until the cameras follow a target each
        batch = system.transition(batch, np.arange(6) % 4, worlds)
    some = 0
    for e in range(6):
        belief = oracles.rows(batch.belief, slice(e, e + 1))
        for action in range(4):
            for draw in (0.0, 1.0):
                got = system.predict(belief, np.array([action]), np.full((1, 4), draw))
                p, S, pointing, settling = one_step(system, oracles.rows(belief, 0), action, draw == 0.0)
                np.testing.assert_allclose(got.polar_mean[0], p, rtol=1e-6, atol=1e-5)
                scale = np.sqrt(np.einsum("tii->ti", S))
                assert (np.abs(got.polar_covariance[0] - S) < 1e-4 * scale[:, :, None] * scale[:, None]).all()
                np.testing.assert_allclose(got.pointing[0], pointing, atol=1e-12)
                assert (got.settling[0], got.step[0]) == (settling, belief.step[0] + 1)
                x, P = to_cartesian(got.polar_mean, got.polar_covariance, np.zeros(2))
                np.testing.assert_array_equal(x, got.mean)
                np.testing.assert_array_equal(P, got.covariance)
            found = system.predict(belief, np.array([action]), np.zeros((1, 4)))
            some += not np.array_equal(found.covariance, got.covariance)
    assert some >= 6  # looks that found something, and others


def test_prediction_with_a_given_outcome_is_the_transition():
    """Compared where truth and prediction are on the same side of every edge: targets close to an edge are left out.

    The filter linearises once, at the prediction. Cartesian moments turn with the estimate; the polar ones are equal.
    """
    system = CameraSlew(
        horizon=80, iterations=1, platforms=((-1e3, 0.0), (1e3, 0.0)), bandwidth=20e6, half_field=0.05, settle=1,
        detection=0.9, q=(0.02, 0.1), shown=(10, 20)
    )  # fmt: skip
    state, worlds = later(system, 40, 0)
    rng, action, agreed, found = np.random.default_rng(2), np.zeros(40, int), 0, 0
    for k in range(80):
        action = np.where(rng.random(40) < 0.15, rng.integers(4, size=40), action)
        predicted = system.predict(state.belief, action, worlds.found[:, k])
        true = np.arctan2(state.truth.targets[..., 0] + 1e3, state.truth.targets[..., 2])
        state = system.transition(state, action, worlds)
        edge = np.abs(np.abs(wrap(true - predicted.pointing[:, None])) - system.half_field)
        clear = (edge > 0.03).all(axis=1)
        for name in ("polar_covariance", "pointing", "settling", "step"):
            np.testing.assert_allclose(
                getattr(predicted, name)[clear], getattr(state.belief, name)[clear], rtol=1e-9, atol=1e-8
            )
        agreed, found = agreed + clear.sum(), found + state.truth.seen[clear].sum()
    assert agreed > 2000
    assert found > 300


def test_the_expected_outcome_is_the_mean():
    """The azimuth's variance, to five standard errors of 4000 draws; far from the prediction without detection."""
    system, count = CameraSlew(horizon=60, iterations=1, detection=0.6, **OPEN), 4000
    state, worlds = later(system, 1, 5)
    for _ in range(20):  # until the camera is there
        state = system.transition(state, np.array([2]), worlds)
    several = trees.take(state, np.zeros(count, int))
    tapes = trees.take(worlds, np.zeros(count, int))
    tapes.found[:] = np.random.default_rng(5).random(tapes.found.shape)
    came = system.transition(several, np.full(count, 2), tapes).belief.polar_covariance[:, 2, 2, 2]
    expected = system.predict(state.belief, np.array([2])).polar_covariance[0, 2, 2, 2]
    nothing = system.predict(state.belief, np.array([2]), np.ones((1, 4))).polar_covariance[0, 2, 2, 2]
    error = 5 * came.std() / math.sqrt(count)
    assert error > 0
    assert abs(came.mean() - expected) < error
    assert nothing - expected > 3 * error


@pytest.mark.parametrize("settle", SETTLES)
def test_the_delay_is_how_long_it_takes(settle):
    """Targets at rest: the first step in which a look changes the covariance, found by turning the camera."""
    system = CameraSlew(
        horizon=60, q=(1e-12, 1e-12), speed=0.0, prior_variance=(1e-2, 1e-9, 1e-2, 1e-9), settle=settle, **OPEN
    )
    state, _ = later(system, 20, 3)
    for target in range(4):
        wanted, belief = shortcuts.delay(system, state.belief)[:, target], state.belief
        seen = np.full(20, -1)
        for k in range(40):
            action = np.full(20, target)
            one, other = (system.predict(belief, action, np.full((20, 4), draw)) for draw in (0.0, 1.0))
            now = (one.covariance[:, target] != other.covariance[:, target]).any(axis=(1, 2))
            seen = np.where((seen < 0) & now, k, seen)
            belief = other
        np.testing.assert_array_equal(seen, wanted)


def test_the_gain_at_once_is_the_difference_that_a_look_makes():
    """trace(M (P without - P with)), M summed by hand; also at the episode's end, where fewer steps are left.

    To the second-order terms that a gain leaves out: it is linear in Cartesian coordinates.
    """
    system = CameraSlew(horizon=40, **OPEN)
    state, worlds = later(system, 8, 10)
    for _ in range(28):
        state = system.transition(state, np.zeros(8, int), worlds)
        gain = shortcuts.gain(system, state.belief, 0, 5)[:, 0]
        one, other = (system.predict(state.belief, np.zeros(8, int), np.full((8, 4), draw)) for draw in (0.0, 1.0))
        left, F = min(5, 40 - int(state.belief.step[0])), system.motion.F
        D, want = other.covariance - one.covariance, 0.0
        for _ in range(left):
            want, D = want + np.einsum("etii->e", D), F @ D @ F.T
        hidden = state.belief._replace(visible=np.zeros_like(state.belief.visible))
        unlooked = system.predict(hidden, np.zeros(8, int))
        sigma = np.sqrt(unlooked.polar_covariance[..., 2, 2])
        off = wrap(unlooked.polar_mean[..., 2] - unlooked.pointing[:, None])
        clear = (np.abs(np.abs(off) - system.half_field) > 7 * sigma).all(axis=1)  # in the image or not, surely
        looks = clear & (shortcuts.delay(system, state.belief)[:, 0] == 0)
        np.testing.assert_allclose(gain[looks], system.detection * want[looks], rtol=1e-3)
    assert looks.sum() >= 4
    assert (shortcuts.gain(system, state.belief, 2, 5) == 0).all()
    assert (shortcuts.gain(system, state.belief, 1, 5) > 0).all()


def test_a_gain_needs_sight_and_a_delay_waits_for_it():
    system = CameraSlew(horizon=30, windows=((0, 0, 9), (2, 20, 29)), half_field=1.5, settle=0)
    belief = later(system, 4, 0)[0].belief
    assert (shortcuts.delay(system, belief)[:, 0] == 10).all()  # out of cover by step 10
    assert (shortcuts.delay(system, belief)[:, 1] <= 1).all()
    narrow = CameraSlew(horizon=30, windows=((0, 0, 9), (2, 20, 29)), half_field=1e-6)
    for wait, hidden in ((9, [True, False, False, False]), (10, [False] * 4), (20, [False, False, True, False])):
        np.testing.assert_array_equal(shortcuts.gain(narrow, belief, wait, 5) == 0, [hidden] * 4)
