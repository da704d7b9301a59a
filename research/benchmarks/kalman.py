"""Kershaw-Evans against filterpy objects: Kalman kernel, batch of environments, single environment."""

from __future__ import annotations

import numpy as np
from filterpy.kalman import KalmanFilter

from research.benchmarks.timing import Ratio, compare
from wavegym.envs import WaveformEnv, WaveformVectorEnv
from wavegym.systems.kershaw_evans.system import KershawEvansPosition
from wavegym.trackers import predict, update

BATCH = 256
F, Q, R = np.array([[1.0, 1.0], [0.0, 1.0]]), np.diag([33.0, 100.0]), np.diag([400.0, 25.0])


def filterpy_objects(count: int) -> list[KalmanFilter]:
    """One filter object per track, as users of filterpy keep them."""
    filters = []
    for _ in range(count):
        tracker = KalmanFilter(dim_x=2, dim_z=2)
        tracker.F, tracker.H, tracker.Q, tracker.R = F, np.eye(2), Q, R
        filters.append(tracker)
    return filters


def peer(count: int, repeats: int) -> int:
    """Predict and update of ``count`` filters alone."""
    filters, z = filterpy_objects(count), np.array([[1.0], [2.0]])
    for _ in range(repeats):
        for tracker in filters:
            tracker.predict()
            tracker.update(z)
    return count * repeats


def kernel(repeats: int = 300) -> int:
    """Predict and update of a batch of tracks."""
    mean, covariance, z = np.zeros((BATCH, 2)), np.tile(np.eye(2), (BATCH, 1, 1)), np.array([1.0, 2.0])
    for _ in range(repeats):
        mean, covariance = predict(mean, covariance, F, Q)
        mean, covariance = update(mean, covariance, z - mean, np.eye(2), R)
    return BATCH * repeats


def vector_step(envs: WaveformVectorEnv, actions: np.ndarray, episodes: int = 4) -> int:
    """Environment steps with observation, reward, info and resets."""
    steps = episodes * (envs.system.horizon + 1)
    for _ in range(steps):
        envs.step(actions)
    return BATCH * steps


def single_step(env: WaveformEnv, episodes: int) -> int:
    """Environment steps of the unwrapped single environment, each episode with its reset."""
    for _ in range(episodes):
        env.reset()
        for _ in range(env.system.horizon):
            env.step(3)
    return episodes * env.system.horizon


def run() -> dict[str, tuple[Ratio, float | None]]:
    """Each ratio with its target, if any."""
    envs = WaveformVectorEnv(KershawEvansPosition, BATCH)
    envs.reset(seed=0)
    actions = np.random.default_rng(0).integers(0, len(envs.system.actions), BATCH)
    env, long = WaveformEnv(KershawEvansPosition), WaveformEnv(KershawEvansPosition, horizon=1000)
    return {
        "Kalman predict and update, batch of 256": (compare(kernel, lambda: peer(BATCH, 8)), 150.0),
        "environment step with info and resets, batch of 256": (
            compare(lambda: vector_step(envs, actions), lambda: peer(BATCH, 8)),
            60.0,
        ),
        "environment step, single": (compare(lambda: single_step(long, 2), lambda: peer(1, 2000)), 1.0),
        "environment step, single, with a reset every 50 steps": (
            compare(lambda: single_step(env, 40), lambda: peer(1, 2000)),
            None,
        ),
    }
