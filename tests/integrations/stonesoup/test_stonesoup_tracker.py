"""Stone Soup's predictors, updaters and data associators as trackers of wavegym's environments."""

from __future__ import annotations

import pickle
from functools import partial

import numpy as np
import oracles
import pytest
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.dataassociator.probability import JPDA, PDA, JPDAwithEHM
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.measures import Mahalanobis
from stonesoup.predictor.kalman import CubatureKalmanPredictor, KalmanPredictor, UnscentedKalmanPredictor
from stonesoup.updater.kalman import CubatureKalmanUpdater, ExtendedKalmanUpdater, UnscentedKalmanUpdater

from wavegym.core import trees
from wavegym.core.errors import InputError
from wavegym.integrations.stonesoup import StoneSoupTracker, jpda
from wavegym.systems.agile_clutter import AgileClutter
from wavegym.systems.composed import LinearTargets, Loop, PlanarRadar, Pulses, WeightedTrace
from wavegym.systems.kershaw_evans import KershawEvansPosition
from wavegym.targets import constant_velocity
from wavegym.testing import check_vector_env
from wavegym.testing.shortcut_check import shortcut_defect
from wavegym.trackers.protocol import ExtendedKalman
from wavegym.waveforms import gaussian_chirp_library

# Julier and Uhlmann's transform with kappa = 0, which AgileClutter's own tracker has
PLAIN = {"alpha": 1.0, "beta": 0.0, "kappa": 0.0}
UNSCENTED = StoneSoupTracker(KalmanPredictor, partial(UnscentedKalmanUpdater, **PLAIN), JPDA)
NEAREST = StoneSoupTracker(
    data_associator=GNNWith2DAssignment,
    hypothesiser=partial(DistanceHypothesiser, measure=Mahalanobis(), missed_distance=4.0),
)
FILTERS = [
    (KalmanPredictor, ExtendedKalmanUpdater),
    (UnscentedKalmanPredictor, UnscentedKalmanUpdater),
    (CubatureKalmanPredictor, CubatureKalmanUpdater),
]


def play(system, steps, count=3, seed=0):
    """Beliefs of drawn actions, step by step, and the final state."""
    draws = np.random.default_rng(seed)
    worlds = trees.stack([system.draw_world(draws) for _ in range(count)])
    state, rng, found = system.initial(worlds), np.random.default_rng(seed), []
    for _ in range(steps):
        action = system.candidates()[rng.integers(len(system.candidates()), size=count)]
        state = system.transition(state, action, worlds)
        found.append(state.belief)
    return found


@pytest.mark.parametrize("filters", FILTERS)
def test_on_a_line_of_sight_every_filter_is_the_kalman_filter(filters):
    want = play(KershawEvansPosition(), 10)
    got = play(KershawEvansPosition(tracker=StoneSoupTracker(*filters)), 10)
    for own, other in zip(want, got, strict=True):
        np.testing.assert_allclose(other.mean, own.mean, rtol=1e-7)
        np.testing.assert_allclose(other.covariance, own.covariance, rtol=1e-6)


@pytest.mark.parametrize("name", ["kalman", "unscented"])
def test_a_tracker_is_found_by_its_name(name):
    place = f"wavegym.integrations.stonesoup:{name}"
    want, got = (play(KershawEvansPosition(tracker=tracker), 4) for tracker in (None, place))
    np.testing.assert_allclose(got[-1].covariance, want[-1].covariance, rtol=1e-6)


def test_in_the_plane_the_extended_filter_is_wavegyms():
    """A nonlinear sensor: Jacobians, missed detections and two targets."""
    motion = constant_velocity(1.0, 1.0, ("x", "y"), order="derivative")
    low = ((9e3, 0.0, -50.0, -50.0), (-12e3, 5e3, -50.0, -50.0))
    targets = LinearTargets(motion, low, low, (1e3, 1e3, 100.0, 100.0))
    pulses = Pulses(gaussian_chirp_library((20e-6, 200e-6), (0.0, 1e6)), 10.4e9)
    parts = {"targets": targets, "sensor": PlanarRadar(reference_range=20e3, false_alarm=0.01), "waveforms": pulses}
    want, got = (
        play(Loop(**parts, objective=WeightedTrace((1, 1, 0, 0)), tracker=tracker), 12)
        for tracker in (ExtendedKalman(), StoneSoupTracker())
    )
    for own, other in zip(want, got, strict=True):
        np.testing.assert_allclose(other.mean, own.mean, rtol=1e-7)
        np.testing.assert_allclose(other.covariance, own.covariance, rtol=1e-6, atol=1e-6)


class AtPredictedRange(StoneSoupTracker):
    """Takes the error's covariance at the predicted range of the only target, as AgileClutter's own tracker does."""

    def update(self, estimate, scan):
        return super().update(estimate, scan._replace(R=np.broadcast_to(scan.noise[:, :1], scan.R.shape)))


@pytest.mark.slow
@pytest.mark.parametrize("associator", [JPDA, JPDAwithEHM, PDA])
def test_association_in_clutter_is_wavegyms(associator):
    """One target; the same unscented transform and gate as the compiled tracker's."""
    one = {"starts": AgileClutter().starts[:1], "births": (0,), "horizon": 8, "clutter_density": 1e-5}
    tracker = AtPredictedRange(KalmanPredictor, UNSCENTED.updater, associator)
    want, got = (play(AgileClutter(tracker=name, **one), 8, 2) for name in ("jpda", tracker))
    for own, other in zip(want, got, strict=True):
        np.testing.assert_allclose(other.mean, own.mean, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(other.covariance, own.covariance, rtol=1e-5, atol=1e-6)


@pytest.mark.slow
def test_joint_association_of_two_targets_is_near_wavegyms():
    """The error's covariance is that at the return's range, not at the predicted one: costs differ by a few percent."""
    want, got = (play(AgileClutter(tracker=name, clutter_density=1e-5), 12, 2) for name in ("jpda", UNSCENTED))
    for own, other in zip(want, got, strict=True):
        sigma = np.sqrt(np.diagonal(own.covariance, axis1=-2, axis2=-1))
        assert (abs(other.mean - own.mean) / sigma).max() < 0.2
        np.testing.assert_allclose(np.sqrt(np.diagonal(other.covariance, axis1=-2, axis2=-1)), sigma, rtol=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("tracker", [UNSCENTED, jpda(), NEAREST])
def test_targets_are_followed_in_clutter(tracker):
    """The first target is not lost; the cost is near the compiled tracker's or below (nearest neighbour)."""
    cost, error = [], []
    for each in ("jpda", tracker):
        system = AgileClutter(tracker=each, clutter_density=1e-5, snr_law="printed")  # few false returns
        worlds = oracles.worlds(system, 2)
        state = system.initial(worlds)
        for k in range(10):
            state = system.transition(state, system.candidates()[np.full(2, 31 * k)], worlds)
        cost.append(system.cost(state.belief))
        error.append(np.linalg.norm((state.belief.mean - state.truth.targets)[:, 0, :2], axis=-1))
    assert (cost[1] < 1.5 * cost[0]).all()
    assert (error[1] < 100.0).all()


@pytest.mark.slow
def test_the_conformance_checks_hold():
    check_vector_env("wavegym/KershawEvansPosition-v0", tracker=StoneSoupTracker(), horizon=4)
    system = AgileClutter(tracker=UNSCENTED, horizon=5, truth={"clutter_density": 1e-5})
    assert shortcut_defect(system) is None


@pytest.mark.slow
def test_a_tracker_travels_to_other_processes():
    twin = pickle.loads(pickle.dumps(UNSCENTED))
    one, other = (play(AgileClutter(tracker=tracker, clutter_density=1e-5), 3) for tracker in (UNSCENTED, twin))
    np.testing.assert_array_equal(one[-1].mean, other[-1].mean)


def test_what_makes_no_tracker_is_refused():
    with pytest.raises(InputError, match=r"origin is unknown, expected a data associator \(nearest: Stone"):
        play(AgileClutter(tracker=StoneSoupTracker()), 1)
    with pytest.raises(InputError, match=r"updater is .* expected a class, or a function that makes one") as caught:
        StoneSoupTracker(updater=ExtendedKalmanUpdater(None))
    assert "\n" not in str(caught.value)
