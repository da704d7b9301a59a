"""Waveform scheduling in Stone Soup: an agent, wavegym's schedulers and Stone Soup's own managers compared.

A target on the radar's line of sight is simulated and tracked by Stone Soup: ``ConstantVelocity``, ``KalmanPredictor``,
``ExtendedKalmanUpdater``. The scenario is that of ``KershawEvansPosition-v0``. Every manager meets the same targets and
the same draws of measurement errors.

    python examples/stonesoup/waveform_gallery.py --seeds 200
"""

from __future__ import annotations

import argparse
import csv
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
from stonesoup.models.transition.linear import ConstantVelocity
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.sensormanager import BruteForceSensorManager
from stonesoup.sensormanager.reward import UncertaintyRewardFunction
from stonesoup.types.array import StateVector
from stonesoup.types.groundtruth import GroundTruthPath, GroundTruthState
from stonesoup.types.state import GaussianState
from stonesoup.types.track import Track
from stonesoup.updater.kalman import ExtendedKalmanUpdater

from wavegym.evaluation import statistics
from wavegym.integrations.stonesoup import PolicySensorManager, WeightedTraceReward, radars_of, simulate
from wavegym.integrations.stonesoup.simulation import START

ENV = "KershawEvansPosition-v0"
MANAGERS = ("ppo", "lookahead:2", "myopic", "random", "brute force, norm", "brute force, trace")
COLUMNS = ("seed", "manager", "trace", "squared_error", "seconds")


def scenario(system: Any, seed: int) -> tuple[GroundTruthPath, Track]:
    """A true path by Stone Soup's transition model, and a track that begins around its start."""
    rng = np.random.default_rng([seed, 0])
    low, high = np.array([system.start_range, system.start_speed]).T
    state = GroundTruthState(StateVector(rng.uniform(low, high)), timestamp=START)
    step, motion = timedelta(seconds=system.dt), ConstantVelocity(system.q, seed=seed)
    path = GroundTruthPath([state])
    for _ in range(system.horizon):
        state = GroundTruthState(
            motion.function(state, noise=True, time_interval=step), timestamp=state.timestamp + step
        )
        path.append(state)
    variance = np.array(system.prior_variance) * 10.0 ** rng.uniform(-1.0, 1.0, 2)
    mean = np.ravel(path[0].state_vector) + np.sqrt(variance) * rng.standard_normal(2)
    return path, Track([GaussianState(StateVector(mean), np.diag(variance), timestamp=START)])


def manager(name: str, system: Any, radar: Any, filters: tuple[Any, Any], seed: int) -> Any:
    """The sensor manager called ``name``."""
    if name == "brute force, norm":
        return BruteForceSensorManager({radar}, reward_function=UncertaintyRewardFunction(*filters))
    if name == "brute force, trace":
        return BruteForceSensorManager({radar}, reward_function=WeightedTraceReward(*filters, system.weights))
    parameters = {"horizon": system.horizon}
    return PolicySensorManager(sensors={radar}, env=ENV, parameters=parameters, policy=name, seed=seed)


def play(name: str, system: Any, seed: int) -> dict[str, Any]:
    """Mean trace(Lambda P), mean squared range error and processor time for a decision of one episode."""
    path, track = scenario(system, seed)
    (radar,) = radars_of(system, seed=seed)
    filters = KalmanPredictor(ConstantVelocity(system.q)), ExtendedKalmanUpdater()
    record = simulate(radar, manager(name, system, radar, filters, seed), *filters, path, track)
    weights, error = np.array(system.weights), record.mean - record.truth
    trace = np.diagonal(record.covariance, axis1=1, axis2=2) @ weights
    values = trace.mean(), (error**2 @ weights).mean(), record.seconds.mean()
    return dict(zip(COLUMNS, (seed, name, *map(float, values)), strict=True))


def table(rows: list[dict[str, Any]]) -> str:
    """A table in Markdown: means over the seeds that every manager has played, with 95 % intervals."""
    names = [name for name in MANAGERS if any(row["manager"] == name for row in rows)]
    played = {name: {int(row["seed"]): row for row in rows if row["manager"] == name} for name in names}
    seeds = sorted(set.intersection(*(set(each) for each in played.values())))
    lines = [
        f"| manager, {len(seeds)} paired seeds | trace by belief, m² | against myopic | squared error by truth, m² | "
        "time a decision, ms |",
        "|---|---|---|---|---|",
    ]
    of = {name: {c: np.array([[float(played[name][s][c]) for s in seeds]]) for c in COLUMNS[2:]} for name in names}
    for name in names:
        trace, error = (_interval(of[name][column]) for column in ("trace", "squared_error"))
        against = _against(of[name]["trace"], of["myopic"]["trace"]) if "myopic" in names and name != "myopic" else ""
        lines.append(f"| {name} | {trace} | {against} | {error} | {1e3 * np.median(of[name]['seconds']):.2g} |")
    return "\n".join(lines)


def _interval(values: np.ndarray) -> str:
    value, interval = statistics.mean(values, np.random.default_rng(0))
    return f"{value:.1f}" if interval is None else f"{value:.1f} [{interval[0]:.1f}, {interval[1]:.1f}]"


def _against(values: np.ndarray, baseline: np.ndarray) -> str:
    value, interval = statistics.difference(values, baseline, np.random.default_rng(0)).percent
    return f"{value:+.1f} %" if interval is None else f"{value:+.1f} % [{interval[0]:+.1f}, {interval[1]:+.1f}]"


def main(arguments: list[str] | None = None) -> str:
    """Play every manager on every seed, write a row for each episode, print and return the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10, help="number of paired seeds")
    parser.add_argument("--horizon", type=int, default=50, help="steps in an episode")
    parser.add_argument("--managers", nargs="+", choices=MANAGERS, default=MANAGERS, metavar="NAME")
    parser.add_argument("--out", type=Path, default=Path("out/stonesoup.csv"), help="a row for each episode")
    given = parser.parse_args(arguments)
    system, rows = PolicySensorManager(env=ENV, parameters={"horizon": given.horizon}).system, []
    for name in given.managers:
        play(name, system, given.seeds)  # the first decision compiles
    given.out.parent.mkdir(parents=True, exist_ok=True)
    with given.out.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        for seed in range(given.seeds):
            for name in given.managers:
                rows.append(play(name, system, seed))
                writer.writerow(rows[-1])
            file.flush()
    found = table(rows)
    print(found)
    return found


if __name__ == "__main__":
    main()
