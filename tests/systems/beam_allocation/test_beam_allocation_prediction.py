"""Beam allocation: a step against plain NumPy, prediction against the world, gains against repeated prediction."""

from __future__ import annotations

import agile_clutter_oracle as plain
import numpy as np
import oracles
import pytest
from beam_plays import CHIRPS, JPDA, SYSTEM, TARGET, choices, coasted, played

from wavegym.core import shortcuts, trees
from wavegym.core.horizon_weights import horizon_weights
from wavegym.schedulers import Myopic
from wavegym.systems.beam_allocation.system import BeamAllocation


def lit_by(belief, e, i, action):
    """The visible target of environment e that sensor i illuminates, (target,) bool; the chirp's C."""
    choice = choices(action)[i]
    lit = np.zeros(3, bool)
    lit[TARGET[choice]] = belief.visible[e, belief.step[e], TARGET[choice]]
    return lit, CHIRPS[choice % 2]


@pytest.mark.parametrize("snr_law", ["realised", "printed"])
def test_transition_and_predict_are_the_plain_loop(snr_law):
    """AgileClutter's equations in plain NumPy, of the illuminated targets; Pd and the effective eta by their tables."""
    system = BeamAllocation(tracker="jpda", snr_law=snr_law)
    worlds, rng = oracles.worlds(system, 4, seed=5), np.random.default_rng(6)
    for steps in (0, 7, 30):
        state = played(system, worlds, steps)
        belief, actions = state.belief, rng.integers(36, size=4)
        after, predicted = system.transition(state, actions, worlds), system.predict(belief, actions)
        for e in range(4):
            k = steps + 1
            x, P = plain.predicted(system, k, belief.mean[e], belief.covariance[e])
            np.testing.assert_allclose(predicted.mean[e], x, rtol=1e-12)
            guess, true_states = P.copy(), state.truth.path[e, :, k]
            for i, site in enumerate(np.array(system.sensors)):
                lit, C = lit_by(belief, e, i, actions[e])
                density = plain.density(system, C)
                _, S, G, pd = plain.expected_scan(system, site, C, predicted.mean[e], guess, lit)
                for t in np.flatnonzero(lit):
                    clutter = density * 16 * np.pi * np.sqrt(np.linalg.det(S[t]))
                    guess[t] -= plain.information_reduction(pd[t], clutter) * G[t] @ np.linalg.solve(S[t], G[t].T)
                z, S, G, pd = plain.expected_scan(system, site, C, x, P, lit)
                scan, _, _ = plain.received(system, worlds, e, k, i, site, C, true_states, z, S, lit)
                false = plain.false_returns(system, worlds, e, k, i, C, z, S, lit)
                if lit.any():
                    returns = np.array([*scan, *false]).reshape(-1, 2)
                    plain.jpda(system, returns, x, P, z, S, G, pd, lit, density)
            assert oracles.covariance_distance(after.belief.covariance[e], P) < 1e-3
            assert oracles.covariance_distance(predicted.covariance[e], guess) < 1e-3
            sigma = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
            assert (np.abs(after.belief.mean[e] - x) / sigma).max() < 1e-3


def test_a_given_outcome_is_predicted_as_the_world_updates_it():
    """Without clutter, of targets that one sensor illuminates; to 1e-12 of the predicted standard deviations."""
    system = BeamAllocation(clutter_density=0.0, gate=8.0, snr_law="printed")  # no false returns
    rng, seen = np.random.default_rng(3), 0
    worlds = oracles.worlds(system, 50, 2)
    calm = {name: 0.1 * getattr(worlds, name) for name in ("start", "process", "error")}  # nothing near a gate's edge
    worlds = worlds._replace(**calm)
    state = system.initial(worlds)
    for _ in range(system.horizon):
        first, step = rng.integers(3, size=50), rng.integers(1, 3, size=50)
        pair = np.stack([first, (first + step) % 3], axis=1)  # different targets
        action = (2 * pair + rng.integers(2, size=(50, 2))) @ [6, 1]
        before, after = state, system.transition(state, action, worlds)
        learned = np.diagonal(coasted(system, before.belief) - after.belief.covariance, axis1=2, axis2=3).sum(axis=2)
        updated = learned > 1e-9 * np.diagonal(after.belief.covariance, axis1=2, axis2=3).sum(axis=2)
        draws = np.where(updated, 0.0, 1.0)[:, None].repeat(2, axis=1)  # (env, sensor, target)
        given = system.predict(before.belief, action, draws)
        wide = coasted(system, before.belief)
        whole, sigma = given.covariance, np.sqrt(np.diagonal(wide, axis1=2, axis2=3))
        apart = (after.belief.covariance - whole) / (sigma[..., None] * sigma[..., None, :])
        assert np.abs(apart).max() < 1e-12
        np.testing.assert_array_equal(system.state_info(after)["detections"], updated.sum(axis=1))
        np.testing.assert_array_equal(given.visible, after.belief.visible)
        np.testing.assert_array_equal(given.step, after.belief.step)
        seen, state = seen + updated.sum(), after
    assert seen > 2000


@pytest.mark.slow
@pytest.mark.parametrize("action", [0 * 6 + 3, 1 * 6 + 0, 4 * 6 + 5])
def test_expected_prediction_is_the_mean_of_the_world(action):
    """Mean cost over 20 000 truths drawn from one belief; within 1 % of the reduction, and five standard errors.

    With JPDA, because prediction begins with one Gaussian for each target.
    """
    count = 20_000
    one = played(JPDA, oracles.worlds(JPDA, 1, 4), 4)
    belief = trees.tree_map(lambda leaf: np.repeat(leaf, count, axis=0), one.belief)
    belief = belief._replace(visible=np.ones_like(belief.visible))
    rng, (F, Q) = np.random.default_rng(action), plain.transition(JPDA)
    tape = oracles.worlds(JPDA, 1, 4)
    worlds = type(tape)(*(np.repeat(leaf, count, axis=0) for leaf in tape))
    worlds = worlds._replace(
        error=rng.standard_normal(worlds.error.shape),
        key=rng.integers(2**64, size=count, dtype=np.uint64),
    )
    path = np.repeat(one.truth.path, count, axis=0)
    drawn = belief.mean + np.einsum("tab,etb->eta", np.linalg.cholesky(one.belief.covariance[0]), normal(rng, count))
    path[:, :, 5] = drawn @ F.T + normal(rng, count) @ np.linalg.cholesky(Q).T
    truth = trees.tree_map(lambda leaf: np.repeat(leaf, count, axis=0), one.truth)._replace(path=path)
    costs = JPDA.cost(JPDA.transition(one._replace(truth=truth, belief=belief), np.full(count, action), worlds).belief)
    few = trees.tree_map(lambda leaf: leaf[:1], belief)
    predicted = JPDA.cost(JPDA.predict(few, np.array([action])))[0]
    nothing = JPDA.cost(JPDA.predict(few, np.array([action]), np.ones((1, 2, 3))))[0]
    assert nothing - predicted > 50 * costs.std() / np.sqrt(count)
    assert abs(costs.mean() - predicted) < 0.01 * (nothing - predicted) + 5 * costs.std() / np.sqrt(count)


def normal(rng, count):
    return rng.standard_normal((count, 3, 4))


def test_the_one_step_scheduler_tries_all_joint_actions():
    belief, policy = played(SYSTEM, oracles.worlds(SYSTEM, 30), 12).belief, Myopic()
    policy.begin(SYSTEM, 30, np.random.default_rng(0))
    many = SYSTEM.predict(belief, SYSTEM.candidates()[None]).covariance
    trace = np.diagonal(many, axis1=-2, axis2=-1).sum(axis=(-1, -2))
    chosen = trace[np.arange(30), policy.act(belief, None, None)]
    np.testing.assert_allclose(chosen, trace.min(axis=1), rtol=1e-12)
    assert shortcuts.best_action.of(SYSTEM) is None


@pytest.mark.parametrize("wait", [0, 1, 5])
@pytest.mark.parametrize("ahead", [1, 8])
def test_gain_is_that_of_repeated_prediction(wait, ahead):
    """Beliefs early and at the end, where there is nothing left to look at or fewer steps than ``ahead``."""
    for steps in (3, 20, 53, 57, 60):
        belief = here = played(SYSTEM, oracles.worlds(SYSTEM, 6), steps).belief
        for _ in range(wait):
            here = SYSTEM.predict(here, np.zeros(6, int), np.ones((6, 2, 3)))
        with_look = SYSTEM.predict(here, SYSTEM.candidates()[None]).covariance
        without = SYSTEM.predict(here, SYSTEM.candidates()[None], np.ones((6, 36, 2, 3))).covariance
        left = min(ahead, SYSTEM.horizon - steps - wait)
        M = horizon_weights(SYSTEM.motion.F, SYSTEM.weights, left) if left > 0 else np.zeros((4, 4))
        want = np.einsum("ab,ectab->ec", M, without - with_look)
        got = shortcuts.gain(SYSTEM, belief, wait, ahead)
        np.testing.assert_allclose(got, want, rtol=1e-9, atol=1e-9)
        assert (got.max() > 0) == (left > 0)
        truth = ~here.visible[:, min(steps + wait, 59)]
        both = TARGET[choices(np.arange(36))]
        assert (got[(truth[:, both]).all(axis=2)] == 0).all()


def test_gain_takes_a_number_of_steps_for_every_target():
    belief, rng = played(SYSTEM, oracles.worlds(SYSTEM, 5), 25).belief, np.random.default_rng(2)
    wait = rng.integers(0, 4, size=(5, 36))
    each = np.array([shortcuts.gain(SYSTEM, belief, w, 6) for w in range(4)])
    want = np.take_along_axis(each, wait[None], axis=0)[0]
    np.testing.assert_array_equal(shortcuts.gain(SYSTEM, belief, wait, 6), want)
    first = belief._replace(visible=belief.visible & (np.arange(3) == 0))
    others = belief._replace(visible=belief.visible & (np.arange(3) > 0))
    ahead = rng.integers(1, 9, size=5)
    want = np.array([shortcuts.gain(SYSTEM, first, 1, a)[e] for e, a in enumerate(ahead)]) + shortcuts.gain(
        SYSTEM, others, 1, 3
    )
    got = shortcuts.gain(SYSTEM, belief, 1, np.stack([ahead, 0 * ahead + 3, 0 * ahead + 3], axis=1))
    np.testing.assert_allclose(got, want, rtol=1e-12)
    many = SYSTEM.predict(belief, SYSTEM.candidates()[None])  # its windows are a view that cannot be written to
    row = trees.tree_map(lambda leaf: leaf[2], many)
    assert shortcuts.gain(SYSTEM, row, 0, 6).shape == (36, 36)
    np.testing.assert_array_equal(shortcuts.delay(SYSTEM, belief), np.zeros((5, 36)))
