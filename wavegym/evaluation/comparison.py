"""Play several policies on the same worlds, on all cores."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from tqdm import tqdm

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.evaluation.play import Played, merged, play
from wavegym.evaluation.task import Task, make_task
from wavegym.evaluation.worlds import draw_worlds, world_seeds
from wavegym.schedulers.registry import make_policy

Factory = Callable[[System], Policy | Sequence[Policy]]  # several are the training runs of one learner

BASELINE = "myopic"
FLOOR = "random"
CHUNK = 50  # worlds played as one batch, whatever the number of jobs: a network's last bits depend on its batch
TUNING_STEPS, LEAST_WORLDS, MOST_WORLDS = 20_000, 20, 200  # of tuning: long episodes say more each


@dataclass(frozen=True)
class Comparison:
    """What several policies did on the same worlds.

    Attributes:
        task: environment and settings.
        root: the seed of it all.
        seeds: of the worlds, for ``env.reset(seed=[...])``.
        played: for each policy the accounts of its members.
    """

    task: Task
    root: int
    seeds: list[int]
    played: Mapping[str, Sequence[Played]]

    def cost(self, name: str) -> Array:
        """Mean cost per step, (member, world)."""
        return np.stack([member.episode_cost() for member in self.played[name]])


def compare(
    env_id: str,
    policies: Mapping[str, Factory | None],
    *,
    worlds: int = 200,
    root: int = 0,
    jobs: int = -1,
    progress: bool = True,
    **settings: Any,
) -> Comparison:
    """Play every policy on the same test worlds.

    The numbers do not depend on ``jobs``, nor on the other policies. Work is handed out through joblib: inside
    ``joblib.parallel_config("ray")`` the same call runs on a Ray cluster.

    Args:
        env_id: a registered id.
        policies: by name; None stands for the scheduler, or the system's loop, of that name. The baseline ``myopic``
            is added if absent.
        worlds: how many.
        root: the seed from which worlds, tuning worlds and the policies' own randomness follow.
        jobs: processes; -1 = one for each core.
        progress: show a bar on a terminal.
        **settings: parameters of the system other than the registered ones.

    Raises:
        InputError: an unknown id, setting or scheduler (nearest named), a number out of range, or
            parameters with which a policy's costs are not finite.
    """
    check_int("worlds", worlds, 1)
    if jobs != -1:
        check_int("jobs", jobs, 1)
    seeds = world_seeds(root, "test", worlds)
    task = make_task(env_id, settings)
    members = _members(task, policies if BASELINE in policies else {BASELINE: None, **policies}, root)
    work = [
        (own, policy, seeds[start : start + CHUNK])
        for own, those in members.values()
        for policy in those
        for start in range(0, worlds, CHUNK)
    ]
    with tqdm(total=len(work), desc="comparing", unit="batch", disable=None if progress else True) as bar:
        parts = iter(_Visible(bar, jobs)(delayed(_play_warm)(own, policy, chunk) for own, policy, chunk in work))
    chunks = range(0, worlds, CHUNK)
    played = {name: [merged([next(parts) for _ in chunks]) for _ in those] for name, (_, those) in members.items()}
    comparison = Comparison(task, root, seeds, played)
    _check_finite(comparison)
    return comparison


def _check_finite(comparison: Comparison) -> None:
    """Raise an InputError for the first policy with a cost that no mean can be taken of."""
    for name in comparison.played:
        cost = comparison.cost(name)
        broken = int((~np.isfinite(cost)).any(axis=0).sum())
        if broken:
            raise InputError(
                f"policy {name!r} has a cost that is not finite in {broken} of {cost.shape[1]} worlds, "
                f"expected finite costs: parameters of {comparison.task.env_id} are probably out of range"
            )


def tuning_worlds(system: System) -> int:
    """How many worlds policies are tuned on: TUNING_STEPS steps' worth of whole episodes, within bounds."""
    return min(max(TUNING_STEPS // system.horizon, LEAST_WORLDS), MOST_WORLDS)


def _members(task: Task, policies: Mapping[str, Factory | None], root: int) -> dict[str, tuple[Task, Sequence[Policy]]]:
    """Every policy's members and what they play, each tried for one step: mistakes show before the work begins, and
    kernels get compiled here, not by several processes at once.
    """
    loops = task.system.baselines()
    tuning = draw_worlds(task.system, world_seeds(root, "tune", tuning_worlds(task.system)))
    members: dict[str, tuple[Task, Sequence[Policy]]] = {}
    for name, factory in policies.items():
        try:
            scheduler, changed = (name, {}) if factory else loops.get(name, (name, {}))
            own = make_task(task.env_id, {**task.settings, **changed}) if changed else task
            made = factory(own.system) if factory else make_policy(scheduler, own.system, tuning)
            members[name] = own, made if isinstance(made, Sequence) else [made]
            for policy in members[name][1]:
                _warm_up(own, policy)
        except NotImplementedError as error:
            missing = f"{type(task.system).__name__} does not offer what it needs"
            raise InputError(f"policy {name!r} cannot play {task.env_id}: {missing}") from error
    return members


def _warm_up(task: Task, policy: Policy) -> None:
    """One step on one world that is not of the test: loads or compiles every kernel."""
    play(task, policy, world_seeds(0, "tune", 1), max_steps=1)


def _play_warm(task: Task, policy: Policy, seeds: Sequence[int]) -> Played:
    """Play, with the loading of compiled code left out of the decision times."""
    _warm_up(task, policy)
    return play(task, policy, seeds)


class _Visible(Parallel):
    """joblib calls ``print_progress`` after every task: here that moves a bar. Works with every backend."""

    def __init__(self, bar: Any, jobs: int) -> None:
        super().__init__(n_jobs=jobs)
        self._bar = bar

    def print_progress(self) -> None:
        self._bar.update(self.n_completed_tasks - self._bar.n)
