"""Joint association against Stone Soup's JPDA, by enumeration and by efficient hypothesis management (EHM).

Like ``joint_association``, Stone Soup weights "missed" by 1 - Pd Pg and a detection by Pd N / rho without Pg. Pg also
sets its gate: squared Mahalanobis distance <= the Pg quantile of chi-square. In wavegym the caller gates, so the test
sets the likelihood to 0 outside that gate. Stone Soup normalises its joint sum over whole tracks, which cancels in the
probabilities; it has no joint evidence to compare.
"""

from __future__ import annotations

import datetime

import numpy as np
import pytest
import scipy.stats
from stonesoup.dataassociator.probability import JPDA, JPDAwithEHM, JPDAwithEHM2
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.detection import Detection
from stonesoup.types.state import GaussianState
from stonesoup.types.track import Track
from stonesoup.updater.kalman import KalmanUpdater

from wavegym.trackers import joint_association

START = datetime.datetime(2024, 1, 1)
INTERVAL, Q = 0.5, 0.3
R = np.array([[1.0, 0.3], [0.3, 2.0]])
H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])  # state (x, xdot, y, ydot)


def problem(seed, T, M):
    """Means (T, 4), covariances (T, 4, 4), measurements (M, 2) around targets close enough to share them."""
    rng = np.random.default_rng([seed, T, M])
    mean = rng.normal(0.0, 2.0, (T, 4))
    root = rng.normal(0.0, 1.0, (T, 4, 4))
    return mean, root @ np.swapaxes(root, -1, -2) + 0.5 * np.eye(4), rng.normal(0.0, 4.0, (M, 2))


def gated_likelihood(mean, covariance, z, gate_probability):
    """N(z; H F x, S), 0 outside the gate, (T, M), by SciPy from plain matrices."""
    block = np.array([[1.0, INTERVAL], [0.0, 1.0]])
    noise = Q * np.array([[INTERVAL**3 / 3, INTERVAL**2 / 2], [INTERVAL**2 / 2, INTERVAL]])
    F, process = np.kron(np.eye(2), block), np.kron(np.eye(2), noise)
    threshold, N = scipy.stats.chi2.ppf(gate_probability, 2), np.empty((len(mean), len(z)))
    for t, (x, P) in enumerate(zip(mean, covariance, strict=True)):
        S = H @ (F @ P @ F.T + process) @ H.T + R
        d = z - H @ F @ x
        inside = np.einsum("mi,ij,mj->m", d, np.linalg.inv(S), d) <= threshold
        N[t] = np.where(inside, scipy.stats.multivariate_normal(np.zeros(2), S).pdf(d), 0.0)
    return N


def stone_soup(associator, mean, covariance, z, pd, rho, gate_probability):
    """Stone Soup's probabilities (T, M+1)."""
    motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(Q), ConstantVelocity(Q)])
    sensor = LinearGaussian(ndim_state=4, mapping=(0, 2), noise_covar=R)
    hypothesiser = PDAHypothesiser(
        KalmanPredictor(motion),
        KalmanUpdater(sensor),
        clutter_spatial_density=rho,
        prob_detect=pd,
        prob_gate=gate_probability,
    )
    now = START + datetime.timedelta(seconds=INTERVAL)
    tracks = [Track([GaussianState(x, P, timestamp=START)]) for x, P in zip(mean, covariance, strict=True)]
    detections = [Detection(point[:, None], timestamp=now, measurement_model=sensor) for point in z]
    found = associator(hypothesiser).associate(tracks, detections, now)
    beta = np.zeros((len(tracks), len(z) + 1))
    for t, track in enumerate(tracks):
        for hypothesis in found[track]:
            column = next((m for m, d in enumerate(detections, 1) if d is hypothesis.measurement), 0)
            beta[t, column] += float(hypothesis.probability)
    return beta


@pytest.mark.parametrize("associator", [JPDA, JPDAwithEHM, JPDAwithEHM2])
@pytest.mark.parametrize(
    ("T", "M", "pd", "rho", "gate_probability"),
    [(1, 3, 0.9, 0.01, 0.99), (2, 5, 0.9, 0.05, 0.999), (2, 4, 0.5, 0.2, 0.6), (3, 4, 0.8, 0.02, 0.95)],
)
def test_equals_stone_soup(associator, T, M, pd, rho, gate_probability):
    for seed in range(3):
        mean, covariance, z = problem(seed, T, M)
        N = gated_likelihood(mean, covariance, z, gate_probability)
        assert N.any()
        ours = joint_association(N, np.full(T, pd), rho, gate_probability).probabilities
        theirs = stone_soup(associator, mean, covariance, z, pd, rho, gate_probability)
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-6)


def test_the_problems_include_shared_and_gated_measurements():
    N = gated_likelihood(*problem(0, 3, 4), 0.95)
    assert (N == 0.0).any()
    assert ((N > 0.0).sum(0) > 1).any()
