"""AgileClutter against filterpy objects: the search over chirps, and environment steps."""

from __future__ import annotations

import numpy as np
from filterpy.kalman import JulierSigmaPoints, UnscentedKalmanFilter, unscented_transform

from research.benchmarks.timing import Ratio, compare
from wavegym.core import shortcuts
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.envs import WaveformEnv, WaveformVectorEnv
from wavegym.systems.agile_clutter.system import AgileClutter
from wavegym.trackers import predict

BATCH = 256
DENSE = {"durations": tuple(np.geomspace(10e-6, 100e-6, 4)), "sweeps": tuple(np.geomspace(1e6, 15e6, 8))}
POINTS = JulierSigmaPoints(4, kappa=0.0)


def measure(x: np.ndarray, sensor: np.ndarray) -> np.ndarray:
    """Range and range-rate in plain Python arithmetic, as in a user's own measurement function."""
    dx, dy = x[0] - sensor[0], x[1] - sensor[1]
    r = (dx * dx + dy * dy) ** 0.5
    return np.array([r, (dx * x[2] + dy * x[3]) / r])


def cost_of(system: AgileClutter, x: np.ndarray, P: np.ndarray, sensor: np.ndarray, C: np.ndarray) -> np.ndarray:
    """The covariance after one pulse by filterpy's unscented transform and the published fit of q2."""
    sigmas = POINTS.sigma_points(x, P)
    images = np.array([measure(s, sensor) for s in sigmas])
    z, Pzz = unscented_transform(images, POINTS.Wm, POINTS.Wc)
    eta = (system.reference_range / z[0]) ** 4
    S = Pzz + C / eta
    G = (POINTS.Wc[:, None] * (sigmas - x)).T @ (images - z)
    pd = system.false_alarm ** (1.0 / (1.0 + eta))
    volume = np.pi * system.gate**2 * (S[0, 0] * S[1, 1] - S[0, 1] ** 2) ** 0.5
    q2 = 0.997 * pd / (1.0 + 0.37 * pd**-1.57 * system.clutter_density * volume)
    return P - q2 * G @ np.linalg.solve(S, G.T)


def filterpy_decision(system: AgileClutter, belief: object) -> int:
    """One decision by loops over sensors, candidates and targets."""
    motion, C = system.motion, system.action_set.sensor_covariances
    x, P = predict(belief.mean[0], belief.covariance[0], motion.F, motion.Q)
    for sensor in np.array(system.sensors):
        after = [[cost_of(system, x[t], P[t], sensor, c) for t in range(len(x))] for c in C]
        P = np.array(after[int(np.argmin([sum(np.trace(p) for p in each) for each in after]))])
    return 1


def decision() -> Ratio:
    """One decision: 256 chirps at each of two sensors for two targets."""
    system = AgileClutter(births=(0, 0), horizon=25, **DENSE)
    assert len(system.action_set.sensor_library) == BATCH
    belief = system.initial(draw_worlds(system, world_seeds(0, "test", 1))).belief

    def ours() -> int:
        for _ in range(50):
            shortcuts.best_action(system, belief)
        return 50

    return compare(ours, lambda: filterpy_decision(system, belief), rounds=5)


def filterpy_filters(repeats: int) -> int:
    """Two targets: predict, and one unscented update with both sensors' measurements; no clutter, no association."""
    system = AgileClutter()
    sensors, R = np.array(system.sensors), np.diag([10.0, 1000.0, 10.0, 1000.0])
    filters = []
    for start in system.starts:
        tracker = UnscentedKalmanFilter(
            4, 4, system.dt, lambda x: np.concatenate([measure(x, s) for s in sensors]), None, POINTS
        )
        tracker.fx = lambda x, dt: system.motion.F @ x
        tracker.x, tracker.P, tracker.Q = np.array(start), np.diag(system.prior_variance), system.motion.Q
        filters.append(tracker)
    for _ in range(repeats):
        for tracker in filters:
            tracker.predict()
            tracker.update(tracker.hx(tracker.x), R=R)
    return repeats


def single_step(env: WaveformEnv, action: np.ndarray, episodes: int = 4) -> int:
    """Environment steps with clutter, association, observation, reward and info, each episode with its reset."""
    for _ in range(episodes):
        env.reset()
        for _ in range(env.system.horizon):
            env.step(action)
    return episodes * env.system.horizon


def vector_step(envs: WaveformVectorEnv, actions: np.ndarray) -> int:
    """Environment steps of a batch."""
    steps = envs.system.horizon + 1
    for _ in range(steps):
        envs.step(actions)
    return steps * len(actions)


def run() -> dict[str, tuple[Ratio, float | None]]:
    """Each ratio with its target, if any."""
    env, envs = WaveformEnv(AgileClutter), WaveformVectorEnv(AgileClutter, BATCH)
    hfm = env.system.actions.labels.index("HFM up 100 us 15 MHz")
    action, actions = np.full(2, hfm), np.full((BATCH, 2), hfm)
    envs.reset(seed=0)
    envs.action_space.seed(0)
    return {
        "decision: 256 chirps, two sensors, two targets": (decision(), 500.0),
        "AgileClutter step, single, against two UKFs without clutter or association": (
            compare(lambda: single_step(env, action), lambda: filterpy_filters(100)),
            None,
        ),
        "AgileClutter step, batch of 256, against the same": (
            compare(lambda: vector_step(envs, actions), lambda: filterpy_filters(100)),
            None,
        ),
        "AgileClutter step, batch of 256, random actions, against the same": (
            compare(lambda: vector_step(envs, envs.action_space.sample()), lambda: filterpy_filters(100)),
            None,
        ),
    }
