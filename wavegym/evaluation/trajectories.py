"""True, estimated and measured paths of single episodes, as CSV files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int
from wavegym.core.files import csv_text, write_whole
from wavegym.core.system import State, System
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.envs.vector import WaveformVectorEnv
from wavegym.evaluation.adapters import Given
from wavegym.evaluation.comparison import CHUNK, by_name, members_of
from wavegym.evaluation.play import Task, make_task, play

MEASURED = "measured_"
PATHS, RETURNS = "trajectories.csv", "measurements.csv"


def write_trajectories(
    folder: Path,
    env_id: str,
    policies: Mapping[str, Given | None],
    episodes: int,
    seed: int = 0,
    trust: bool = False,
    worlds: int = CHUNK,
    **parameters: Any,
) -> tuple[str, str]:
    """Play the first worlds of a comparison once more, and write what happened in them.

    ``trajectories.csv`` has a row for each policy, training run, world, step and target: whether the target is present,
    its true and its estimated state, and the standard deviations of the estimate. ``measurements.csv`` has a row for
    each number that the sensors reported: the field of the system's measurements, the index in that field and the
    value.

    Args:
        folder: where the files go.
        env_id, policies, seed, trust, parameters: as for ``compare``.
        episodes: how many worlds, from the first on; at most 50.
        worlds: as for ``compare``: the worlds are played in the batches of the comparison.

    Returns:
        The names of the files.

    Raises:
        InputError: an environment without one estimate for each target, or fewer than 1 or too many episodes.
    """
    most = min(CHUNK, worlds)
    if check_int("trajectories", episodes, 1) > most:
        raise InputError(f"trajectories is {episodes}, expected at most {most} worlds (nearest: {most})")
    task = make_task(env_id, parameters)
    seeds = world_seeds(seed, "test", most)
    _check_estimates(task)
    paths, returns = [], []
    for name, (own, members) in members_of(task, by_name(policies), seed, trust).items():
        for run, policy in enumerate(members):
            recorder = _Recorder(own.system, episodes, (name, run))
            play(own, policy, seeds, name=name, watch=recorder)
            paths += recorder.paths
            returns += recorder.returns
    head = ["policy", "run", "world", "step", "time_s", "target", "present"]
    names = _names(task.system)
    head += [f"{kind}_{name}" for kind in ("true", "estimated", "sigma") for name in names]
    of_returns = ["policy", "run", "world", "step", "time_s", "field", "index", "value"]
    contents = {PATHS: csv_text(head, paths).encode(), RETURNS: csv_text(of_returns, returns).encode()}
    write_whole(folder, contents)
    return PATHS, RETURNS


class _Recorder:
    """Rows of the files, from what ``play`` shows after the reset and after each step."""

    def __init__(self, system: System, episodes: int, labels: tuple[str, int]) -> None:
        self.system, self.episodes, self.labels = system, episodes, labels
        self.paths: list[list[Any]] = []
        self.returns: list[list[Any]] = []

    def __call__(self, env: WaveformVectorEnv, info: Mapping[str, Array], running: Array) -> None:
        """One state of all worlds; ``running`` (env,) marks those in their first episode."""
        state = env.episodes.state
        true, mean, sigma = _states(state)
        present = np.asarray(info.get("present", np.ones(true.shape[:2], np.bool_)))
        measured = {key: np.asarray(value) for key, value in info.items() if key.startswith(MEASURED)}
        for world in np.flatnonzero(running[: self.episodes]):
            step = int(state.belief.step[world])
            at = [*self.labels, int(world), step, step * self.system.dt]
            for target in range(true.shape[1]):
                values = np.concatenate([each[world, target] for each in (true, mean, sigma)])
                self.paths.append([*at, target, int(present[world, target]), *values.tolist()])
            for key, value in measured.items():
                field = key.removeprefix(MEASURED)
                for index in np.ndindex(value.shape[1:]):
                    shown = " ".join(map(str, index))
                    self.returns.append([*at, field, shown, value[(world, *index)].item()])


def _states(state: State) -> tuple[Array, Array, Array]:
    """True states, estimates and standard deviations, each (env, target, n)."""
    true, mean = state.truth.targets, state.belief.mean
    sigma = np.sqrt(np.diagonal(state.belief.covariance, axis1=-2, axis2=-1))
    if true.ndim == 2:  # one target without an axis of its own
        true, mean, sigma = true[:, None], mean[:, None], sigma[:, None]
    return true, mean, sigma


def _check_estimates(task: Task) -> None:
    """InputError for a system without one estimate for each target."""
    state = task.system.initial(draw_worlds(task.system, [0]))
    if not hasattr(state.truth, "targets") or not hasattr(state.belief, "mean"):
        raise InputError(f"trajectories of {task.env_id}: expected an environment with one estimate for each target")


def _names(system: System) -> tuple[str, ...]:
    motion: Any = getattr(system, "motion", None) or system.targets.motion  # type: ignore[attr-defined]
    return tuple(motion.names)
