"""The urban loop: four unscented filters against filterpy's IMM, a whole scan, the signal chain of a receiver."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
from filterpy.kalman import IMMEstimator, JulierSigmaPoints, UnscentedKalmanFilter

from research.benchmarks.timing import Ratio, compare
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.sensors import multistatic_range_and_rate
from wavegym.systems.urban.system import Urban, UrbanSignal
from wavegym.systems.urban.tracker import TRANSITION, Tracks
from wavegym.trackers import imm_ukf_scan
from wavegym.waveforms import measurement_covariances

BATCH, LONG_UP = 256, 0
SYSTEM = Urban()
F, Q = (np.stack([getattr(model, name) for model in SYSTEM.urban_tracker.motion]) for name in "FQ")
TX, RX = np.array(SYSTEM.transmitters[0]), np.array(SYSTEM.receivers[1])
R = np.array([[0.3, 0.05], [0.05, 0.1]])
STATE, P = np.array([2030.0, 1500.0, 8.0, 1.0, -0.5, 0.2]), np.diag([4.0, 4.0, 1.0, 1.0, 0.25, 0.25])
Z = multistatic_range_and_rate(STATE[:4], TX, RX)
SCANS = 100  # scan of an episode at which both targets are visible


def filterpy_imm(repeats: int = 10) -> int:
    """filterpy's IMM of four unscented filters, predicted and updated."""
    filters = []
    for j in range(4):
        points = JulierSigmaPoints(6, kappa=0.0)
        one = UnscentedKalmanFilter(
            6, 2, 0.25, lambda x: multistatic_range_and_rate(x[:4], TX, RX), lambda x, dt, F=F[j]: F @ x, points
        )
        one.x, one.P, one.Q, one.R = STATE.copy(), P.copy(), Q[j], R
        filters.append(one)
    estimator = IMMEstimator(filters, np.full(4, 0.25), TRANSITION)
    for _ in range(repeats):
        estimator.predict()
        estimator.update(Z)
    return repeats


def imm(batch: int, repeats: int) -> int:
    """The same with wavegym."""
    x, spread, mu = (np.tile(a, (batch, *[1] * np.ndim(a))) for a in (np.tile(STATE, (4, 1)), [P] * 4, [0.25] * 4))
    for _ in range(repeats):
        x, spread, mu = imm_ukf_scan(x, spread, mu, Z, R, TX, RX, F, Q, TRANSITION)
    return batch * repeats


class Scan:
    """A scan of both receivers with two visible targets, in ``count`` environments."""

    def __init__(self, count: int) -> None:
        self.worlds = draw_worlds(SYSTEM, world_seeds(0, "test", count))
        state = SYSTEM.initial(self.worlds)
        for _ in range(SCANS):
            state = SYSTEM.transition(state, np.full(count, LONG_UP), self.worlds)
        after = SYSTEM.transition(state, np.full(count, LONG_UP), self.worlds)
        self.state, self.truth, self.tracks = state, after.truth, Tracks(*state.belief[1:])
        self.waves = measurement_covariances(SYSTEM.library, SYSTEM.carrier)[LONG_UP], 200.0

    def track(self) -> None:
        """Only gates, LMIPDA, VS-IMM and track management."""
        SYSTEM.urban_tracker.scan(self.tracks, self.truth.z, self.truth.number, *self.waves)

    def transition(self) -> None:
        """The same with simulated measurements."""
        SYSTEM.transition(self.state, np.full(len(self.state.belief.step), LONG_UP), self.worlds)


def median_us(work: Callable[[], object], units: int = 1, rounds: int = 50) -> float:
    """Microseconds per unit, median of many rounds."""
    taken = []
    for _ in range(rounds):
        start = time.process_time_ns()
        work()
        taken.append(time.process_time_ns() - start)
    return float(np.median(taken)) / units / 1e3


def scans() -> dict[str, float]:
    """Microseconds of a scan, and of the signals of one receiver in it."""
    one, many = Scan(1), Scan(BATCH)
    rows = {
        "tracker's scan, both receivers, single": median_us(one.track),
        "the environment's step without its shell, single": median_us(one.transition),
        f"tracker's scan, both receivers, batch of {BATCH}": median_us(many.track, BATCH, 10),
    }
    for pulses in (25, 249):
        system = UrbanSignal(pulses=pulses)
        scan = partial(system.signals.scan, np.uint64(1), SCANS, system.scene.truth[SCANS], LONG_UP, 0)
        rows[f"signals of one receiver, {pulses} pulses"] = median_us(scan)
    return rows


def run() -> dict[str, tuple[Ratio, float | None]]:
    """Each measurement with the ratio wanted."""
    return {
        "IMM of four unscented filters, single": (compare(lambda: imm(1, 100), filterpy_imm), 40.0),
        f"IMM of four unscented filters, batch of {BATCH}": (compare(lambda: imm(BATCH, 2), filterpy_imm), 300.0),
    }
