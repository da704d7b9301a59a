"""JPDA against Stone Soup: predict, gate, associate and update two tracks with five detections.

Stone Soup caches predictions: each scan gets new states. Both sides start from the same means and covariances.
"""

from __future__ import annotations

import datetime

import numpy as np
from stonesoup.dataassociator.probability import JPDA
from stonesoup.functions import gm_reduce_single
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.array import StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.state import GaussianState
from stonesoup.types.track import Track
from stonesoup.types.update import GaussianStateUpdate
from stonesoup.updater.kalman import KalmanUpdater

from research.benchmarks.timing import Ratio, compare
from wavegym.trackers import jpda_update, predict

BATCH, PD, DENSITY, GATE = 256, 0.9, 0.05, 4.0
GATE_PROBABILITY = 1.0 - np.exp(-0.5 * GATE * GATE)
START = datetime.datetime(2024, 1, 1)
NOW = START + datetime.timedelta(seconds=1)
R, H = np.array([[1.0, 0.3], [0.3, 2.0]]), np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
F = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]])
Q = np.kron(np.eye(2), 0.3 * np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]]))
MEAN, COVARIANCE = np.array([[0.0, 1.0, 0.0, 0.0], [3.0, 0.0, 1.0, 0.5]]), np.tile(2.0 * np.eye(4), (2, 1, 1))
Z = np.array([[1.2, 0.3], [2.8, 1.0], [0.0, -1.0], [4.0, 2.5], [2.0, 1.0]])

SENSOR = LinearGaussian(ndim_state=4, mapping=(0, 2), noise_covar=R)
UPDATER = KalmanUpdater(SENSOR)
PREDICTOR = KalmanPredictor(CombinedLinearGaussianTransitionModel([ConstantVelocity(0.3), ConstantVelocity(0.3)]))
ASSOCIATOR = JPDA(
    PDAHypothesiser(PREDICTOR, UPDATER, clutter_spatial_density=DENSITY, prob_detect=PD, prob_gate=GATE_PROBABILITY)
)


def stone_soup_scan() -> list[Track]:
    """One scan as in Stone Soup's tutorial on JPDA."""
    tracks = [Track([GaussianState(x, P, timestamp=START)]) for x, P in zip(MEAN, COVARIANCE, strict=True)]
    detections = {Detection(z[:, None], timestamp=NOW, measurement_model=SENSOR) for z in Z}
    for track, hypotheses in ASSOCIATOR.associate(tracks, detections, NOW).items():
        states = [UPDATER.update(h) if h else h.prediction for h in hypotheses]
        mean, covariance = gm_reduce_single(
            StateVectors([s.state_vector for s in states]),
            np.stack([s.covar for s in states], axis=2),
            np.array([float(h.probability) for h in hypotheses]),
        )
        track.append(GaussianStateUpdate(mean, covariance, hypotheses, NOW))
    return tracks


def scan(mean: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One scan by wavegym."""
    mean, covariance = predict(mean, covariance, F, Q)
    G = covariance @ H.T
    return jpda_update(mean, covariance, Z, mean @ H.T, H @ G + R, G, [PD, PD], DENSITY, GATE)


def peer(repeats: int) -> int:
    """Scans by Stone Soup."""
    for _ in range(repeats):
        stone_soup_scan()
    return repeats


def single(repeats: int) -> int:
    """Scans of one environment by wavegym."""
    for _ in range(repeats):
        scan(MEAN, COVARIANCE)
    return repeats


def batch(repeats: int) -> int:
    """Scans of a batch by wavegym."""
    mean, covariance = np.tile(MEAN, (BATCH, 1, 1)), np.tile(COVARIANCE, (BATCH, 1, 1, 1))
    for _ in range(repeats):
        scan(mean, covariance)
    return BATCH * repeats


def check() -> None:
    """Check that both sides compute the same."""
    mean, covariance = scan(MEAN, COVARIANCE)
    for t, track in enumerate(stone_soup_scan()):
        np.testing.assert_allclose(mean[t], np.ravel(track.state_vector), rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(covariance[t], track.covar, rtol=0.0, atol=1e-6)


def run() -> dict[str, tuple[Ratio, float | None]]:
    """Each ratio with its target, if any."""
    check()
    return {
        "JPDA scan, 2 tracks x 5 detections": (compare(lambda: single(500), lambda: peer(10)), 100.0),
        f"JPDA scan, 2 tracks x 5 detections, batch of {BATCH}": (compare(lambda: batch(20), lambda: peer(10)), None),
    }
