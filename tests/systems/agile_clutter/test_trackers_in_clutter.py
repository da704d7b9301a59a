"""Trackers of one's own in agile clutter and in what derives from it; returns without an origin; births."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import oracles
import pytest

from wavegym.core import trees
from wavegym.core.errors import InputError
from wavegym.sensors import gate_probability
from wavegym.systems.agile_clutter import AgileClutter
from wavegym.systems.beam_allocation import BeamAllocation
from wavegym.systems.energy_budget import EnergyBudget
from wavegym.systems.energy_budget.known import EnergyBudgetKnown
from wavegym.testing.shortcut_check import shortcut_defect
from wavegym.trackers import jpda_update, predict
from wavegym.trackers.protocol import Estimate, ExtendedKalman

KINDS = (AgileClutter, BeamAllocation, EnergyBudget, EnergyBudgetKnown)
WORLDS = 6


class Associating:
    """A tracker of one's own: the project's public JPDA with an unscented transform in plain NumPy."""

    gate = 4.0

    def predict(self, estimate, motion):
        return Estimate(*predict(*estimate[:2], motion.F, motion.Q))

    def update(self, estimate, scan):
        mean, covariance = estimate.mean.copy(), estimate.covariance.copy()
        for e in range(len(mean)):
            lit = np.flatnonzero(scan.detection[e] > 0.0)
            if not lit.size:
                continue
            x, P = estimate.mean[e, lit], estimate.covariance[e, lit]
            centre, S, G = self.unscented(x, P, scan.model.measure)
            mean[e, lit], covariance[e, lit] = jpda_update(
                x, P, scan.z[e, scan.present[e]], centre, S + scan.noise[e, lit], G, scan.detection[e, lit],
                scan.clutter_density[e], self.gate, float(gate_probability(self.gate)),
            )  # fmt: skip
        return Estimate(mean, covariance)

    @staticmethod
    def unscented(x, P, measure):
        """Mean, covariance and cross-covariance of the measurement: Julier and Uhlmann (1997) with kappa = 0."""
        n = x.shape[-1]
        columns = np.sqrt(n) * np.swapaxes(np.linalg.cholesky(P), -1, -2)  # (target, column, n)
        offset = np.concatenate([columns, -columns], axis=1)
        z = measure(x[:, None] + offset)
        centre = z.mean(axis=1)
        d = z - centre[:, None]
        return centre, np.einsum("tka,tkb->tab", d, d) / (2 * n), np.einsum("tka,tkb->tab", offset, d) / (2 * n)


class Scans(NamedTuple):
    """The memory of ``Counting``."""

    count: np.ndarray  # (env,)


class Counting(Associating):
    """The same tracker, which remembers how many scans it has seen."""

    def begin(self, estimate, motion):
        return estimate._replace(memory=Scans(np.zeros(len(estimate.mean), np.int64)))

    def predict(self, estimate, motion):
        return super().predict(estimate, motion)._replace(memory=estimate.memory)

    def update(self, estimate, scan):
        return super().update(estimate, scan)._replace(memory=Scans(estimate.memory.count + 1))


def actions(system, count, seed=0):
    """Drawn actions of an episode."""
    rng, constants = np.random.default_rng(seed), system.candidates()
    return [constants[rng.integers(len(constants), size=count)] for _ in range(system.horizon)]


def leaves(state):
    """All arrays of a state."""
    found = []
    trees.tree_map(found.append, state)
    return found


def same(got, want):
    """Equal but for the rounding of sums that the order of the returns decides."""
    for one, other in zip(leaves(got), leaves(want), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_a_tracker_of_ones_own_plays_as_the_compiled_one(kind):
    """The public ``jpda_update`` with a plain unscented transform: the same association, so the same costs."""
    compiled, own = kind(clutter_density=2e-5, tracker="jpda"), kind(clutter_density=2e-5, tracker=Associating())
    worlds = oracles.worlds(compiled, WORLDS)
    want, got = compiled.initial(worlds), own.initial(worlds)
    for action in actions(compiled, WORLDS):
        want, got = compiled.transition(want, action, worlds), own.transition(got, action, worlds)
        np.testing.assert_allclose(own.cost(got.belief), compiled.cost(want.belief), rtol=1e-6)
    assert want.belief.hypotheses is got.belief.hypotheses is None


@pytest.mark.parametrize("kind", KINDS)
def test_a_memory_goes_from_step_to_step_where_targets_stay(kind):
    """It is a tracker's own: estimates are those of the tracker without it, and a prediction has none."""
    staying = {"births": (0, 0), "horizon": 25} if kind is AgileClutter else {}
    plain, own = (kind(clutter_density=1e-6, tracker=tracker(), **staying) for tracker in (Associating, Counting))
    worlds = oracles.worlds(plain, 2)
    want, got = plain.initial(worlds), own.initial(worlds)
    for k, action in enumerate(actions(plain, 2)[:8], 1):
        want, got = plain.transition(want, action, worlds), own.transition(got, action, worlds)
        np.testing.assert_array_equal(got.belief.hypotheses.memory.count, k * len(own.sensors))
        np.testing.assert_array_equal(got.belief.covariance, want.belief.covariance)
    assert own.predict(got.belief, action).hypotheses is None
    assert shortcut_defect(own) is None


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("tracker", ["particle", Associating()])
def test_the_shortcuts_are_checked_with_other_trackers(kind, tracker):
    last = 13 if kind is AgileClutter else kind().lifetime
    system = kind(tracker=tracker, particles=10, horizon=last, truth={"clutter_density": 2e-5})
    assert shortcut_defect(system) is None


def test_the_order_of_returns_does_not_tell_their_origin():
    system = AgileClutter(clutter_density=1e-3)
    worlds = oracles.worlds(system, WORLDS)
    state, action = system.initial(worlds), actions(system, WORLDS)[0]
    truth = system.move(state.truth, state.belief.step, worlds)
    measured = system.measure(truth, state.belief, action, worlds)
    assert measured.scan[:, 1].sum() > 0
    assert (np.diff(measured.z[..., 0], axis=2)[measured.present[..., 1:]] >= 0.0).all()
    assert not measured.z[~measured.present].any()


def test_an_estimate_is_handed_over_at_birth_and_not_before():
    system = AgileClutter()
    worlds = oracles.worlds(system, 2)
    state = system.initial(worlds)
    for k, action in enumerate(actions(system, 2)[:9], 1):
        measured = system.measure(system.move(state.truth, state.belief.step, worlds), state.belief, action, worlds)
        expected = state.truth.first[:, 1] if k == system.births[1] else np.zeros((2, 4))
        np.testing.assert_array_equal(measured.first[:, 1], expected)
        state = system.transition(state, action, worlds)


def test_a_tracker_that_needs_origins_is_refused():
    system = AgileClutter(tracker=ExtendedKalman())
    worlds = oracles.worlds(system, 2)
    with pytest.raises(InputError, match="origin is unknown"):
        system.transition(system.initial(worlds), actions(system, 2)[0], worlds)


def test_particles_have_the_compiled_step_alone():
    system = AgileClutter(tracker="particle", particles=20)
    worlds = oracles.worlds(system, 2)
    with pytest.raises(NotImplementedError, match="particle"):
        system.composed_transition(system.initial(worlds), actions(system, 2)[0], worlds)
