"""A task, which is a system with its parameters, and a policy played on its worlds: costs and metrics."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from wavegym.core.action_sets import ParameterBox, by_sensor, sensor_count, waveform_labels
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.policy import Clairvoyant, Policy, Trained
from wavegym.core.system import System, build_system
from wavegym.core.worlds import word
from wavegym.envs.scenario import scenario_differences
from wavegym.envs.vector import WaveformVectorEnv
from wavegym.observations.observer import Observer
from wavegym.registration import SETTINGS, SHELL, full_id, registered_system
from wavegym.schedulers.rollout import allowed, step_lengths


@dataclass(frozen=True)
class Task:
    """One environment as evaluation needs it. It is sent to other processes, where the id may not be registered.

    Attributes:
        env_id: the full id.
        system: the closed loop.
        max_episode_steps: truncation before the system's own end, or None.
        parameters: of the system, those that differ from those registered.
        observation: what policies observe, "belief" or "measurements"; schedulers read the belief itself.
        forecasts, candidates: what functions see and what they choose from, as in ``gym.make``; so do objects with
            ``predict`` that do not tell their spaces.
    """

    env_id: str
    system: System
    max_episode_steps: int | None
    parameters: Mapping[str, Any]
    observation: str = "belief"
    forecasts: bool = False
    candidates: int | None = None


def make_task(env_id: str, parameters: Mapping[str, Any]) -> Task:
    """The task of a registered environment.

    Args:
        env_id: with or without ``wavegym/``.
        parameters: of the system, other than the registered ones; "scenario" names a file of them.

    Raises:
        InputError: an unreadable scenario, an unknown id or parameter (nearest named), or a value out of range.
    """
    env_id = full_id(env_id)
    system, registered = registered_system(env_id)
    limit = registered.pop("max_episode_steps", gym.spec(env_id).max_episode_steps)
    file = parameters.get("scenario", registered.get("scenario"))
    of_file = scenario_differences(env_id, file) if file else {}
    given = {name: value for name, value in {**of_file, **parameters}.items() if name != "scenario"}
    own = {name: value for name, value in registered.items() if name not in SHELL}  # the cost itself is reported
    complete = {**own, **given}
    shown = {
        name: complete.pop(name, registered.get(name, default))
        for name, default in (("observation", "belief"), ("forecasts", False), ("candidates", None))
    }
    task = Task(env_id, build_system(system, complete, SETTINGS), limit, given, **shown)
    if task.forecasts or task.candidates is not None:
        if task.observation != "belief":
            wanted = "'belief' (nearest): forecasts and candidates show it"
            raise InputError(f"observation is {task.observation!r}, expected {wanted}")
        Observer(task.system, task.forecasts, task.candidates)  # report a mistake before policies play
    return task


class Played(NamedTuple):
    """The record of one policy, axis 0 = world. NaN where the system has no such metric."""

    cost: Array  # (world, H) after each step; NaN past an episode's end
    steps: Array  # (world,) int, length of the episode
    span: Array  # (world,) the divisor of means: steps, or seconds if steps differ in length
    rmse: Array  # (world,) root mean square position error over steps and the targets present, m
    target_rmse: Array  # (world, target) the same of each target, over the steps at which it was present
    believed_rmse: Array  # (world,) rmse by belief, from ``position_variance``, m
    gospa: Array  # (world,) root mean square GOSPA distance over steps, m
    nees_sum: Array  # (world, H) NEES summed over the targets present; 0 past an episode's end
    nees_count: Array  # (world, H) int, targets in that sum
    lost: Array  # (world,) targets lost when the episode ended
    collisions: Array  # (world,) mean number of other users of the band that a step disturbed
    share: Array  # (world,) mean share of the spectrum that was used
    choice: Array  # (world, H, sensor) int, the waveform transmitted; -1 past an episode's end; no sensor for a box
    options: Array  # (world,) int, waveforms to choose from at each sensor; 0 for a box
    outside: Array  # (world,) share of decisions on observations outside the range of the policy's training
    seconds: Array  # (world,) spent on decisions

    def episode_cost(self) -> Array:
        """Mean cost per step, or per second where steps differ in length, (world,)."""
        ran = np.arange(self.cost.shape[1]) < self.steps[:, None]
        return np.where(ran, self.cost, 0.0).sum(axis=1) / self.span

    @property
    def nees(self) -> Array:
        """Mean NEES over steps and the targets present, (world,)."""
        return _ratio(self.nees_sum.sum(axis=1), self.nees_count.sum(axis=1))

    @property
    def chosen(self) -> Array:
        """How often each waveform was transmitted, (world, sensor, waveform) int; (world, 0, 0) for a box."""
        alternatives = np.arange(self.options[0])
        each = [(self.choice[:, :, i, None] == alternatives).sum(axis=1) for i in range(self.choice.shape[2])]
        return np.stack(each, axis=1) if each else np.zeros((len(self.steps), 0, 0), np.int64)


class EpisodeResults(NamedTuple):
    """The results of every episode of a policy, (member, world) each; NaN where the system has no such metric."""

    cost: Array  # by belief, mean per step
    rmse: Array  # root mean square position error over steps and the targets present, m
    believed_rmse: Array  # the same by belief, m
    gospa: Array  # root mean square GOSPA distance over steps, m
    nees: Array  # mean over steps and the targets present
    lost: Array  # targets lost when the episode ended
    collisions: Array  # mean number of other users of the band that a step disturbed
    share: Array  # mean share of the spectrum that was used
    outside: Array  # share of decisions on observations outside the range of the policy's training

    @property
    def in_gospa(self) -> bool:
        """Whether the error by truth is the GOSPA distance, as in systems that report it."""
        return not np.isnan(self.gospa).all()

    @property
    def squared_error(self) -> Array:
        """The error by truth, m^2 per step: of the GOSPA distance where it is reported, else of the position."""
        return np.square(self.gospa if self.in_gospa else self.rmse)


BY_EPISODE = EpisodeResults._fields  # columns of episodes.csv


def results_of(members: Sequence[Played]) -> EpisodeResults:
    """The results of a policy's members on the same worlds."""
    by_member = [[member.episode_cost(), *(getattr(member, name) for name in BY_EPISODE[1:])] for member in members]
    return EpisodeResults(*(np.stack(values) for values in zip(*by_member, strict=True)))


Watch = Callable[[WaveformVectorEnv, Mapping[str, Array], Array], None]


def play(
    task: Task,
    policy: Policy,
    seeds: Sequence[int],
    max_steps: int | None = None,
    name: str = "",
    watch: Watch | None = None,
) -> Played:
    """Play ``policy`` to the end of the first episode of each seed.

    After an early end the shell begins another episode in that world, which does not count. The policy's own randomness
    follows from the seeds, so the result does not depend on the process.

    Args:
        task: the system and its parameters.
        policy: a scheduler or an agent. A clairvoyant one has a method ``reveal(world)``.
        seeds: of the worlds.
        max_steps: stop after this number of steps, even if episodes are unfinished.
        name: of the policy, in error messages.
        watch: called after the reset and after each step with the environment, the info, and the worlds that are still
            in their first episode, bool (world,). The info has the measurements if the system separates them from
            tracking.

    Raises:
        InputError: an action that the environment refuses.
    """
    env = WaveformVectorEnv(
        task.system,
        len(seeds),
        autoreset_mode="NextStep",
        max_episode_steps=task.max_episode_steps,
        observation=task.observation,
        measurements=watch is not None and type(task.system).measure is not System.measure,
    )
    observation, info = env.reset(seed=list(seeds))
    recorder = _Recorder(task, len(seeds))
    if watch:
        watch(env, info, recorder.running)
    start = perf_counter()
    policy.begin(task.system, len(seeds), np.random.default_rng([word("policy"), seeds[0]]))
    if isinstance(policy, Clairvoyant):
        policy.reveal(env.world)
    while recorder.running.any() and len(recorder.costs) != max_steps:
        action = policy.act(env.belief, observation, allowed(task.system, env.belief))
        recorder.seconds[recorder.running] += (perf_counter() - start) / recorder.running.sum()
        left = policy.is_outside_training() if isinstance(policy, Trained) else None
        recorder.outside += np.nan if left is None else left & recorder.running
        try:
            observation, _, terminated, truncated, info = env.step(action)
        except InputError as error:
            raise InputError(f"policy {name or type(policy).__name__!r}: {error}") from error
        if watch:
            watch(env, info, recorder.running)
        recorder.add(info, step_lengths(task.system, env.episodes.state.belief), terminated | truncated)
        start = perf_counter()
    return recorder.close()


class _Recorder:
    """Running sums over the steps of a batch of episodes."""

    def __init__(self, task: Task, count: int) -> None:
        self.actions: Any = task.system.actions
        self.running = np.ones(count, np.bool_)
        self.costs: list[Array] = []
        self.seconds, self.steps = np.zeros(count), np.zeros(count, np.int64)
        self.outside = np.zeros(count)  # decisions outside the policy's training; NaN where nobody knows
        self.span = np.zeros(count)
        self.square, self.variance, self.square_gospa = _Sum(), _Sum(), _Sum()
        self.nees_sums: list[Array] = []
        self.nees_counts: list[Array] = []
        self.lost = np.zeros(count)
        self.collisions, self.share = _Sum(), _Sum()
        self.sensors = 0 if isinstance(self.actions, ParameterBox) else sensor_count(self.actions)
        self.options = np.full(count, len(waveform_labels(self.actions)))
        self.choices: list[Array] = []

    def add(self, info: dict[str, Array], lengths: Array, ended: Array) -> None:
        """One step of every environment; only those still in their first episode count, each by its length (env,)."""
        on = self.running
        weight = np.where(on, lengths, 0.0)
        self.span += weight
        self.costs.append(np.where(on, info["cost"], np.nan))
        self.steps[on] += 1
        error, counted = _metric(info, "position_error", on)
        self.square.add(np.square(error), counted, weight)
        self.variance.add(*_metric(info, "position_variance", on), weight)
        gospa, _ = _metric(info, "gospa", on)
        self.square_gospa.add(np.square(gospa), (on & ("gospa" in info))[:, None], weight)
        nees, counted = _metric(info, "nees", on)
        self.nees_sums.append(np.where(counted, nees, 0.0).sum(axis=1))
        self.nees_counts.append(counted.sum(axis=1))
        lost, _ = _metric(info, "lost", on)
        self.lost[on] = lost[on].sum(axis=1)
        self.collisions.add(*_metric(info, "collisions", on), weight)
        self.share.add(*_metric(info, "share", on), weight)
        if self.sensors:
            self.choices.append(np.where(on[:, None], by_sensor(self.actions, info["waveform"]), -1))
        self.running = on & ~ended

    def close(self) -> Played:
        """The sums as means."""
        costs = np.stack(self.costs, axis=1)
        return Played(
            cost=costs,
            steps=self.steps,
            span=self.span,
            rmse=np.sqrt(self.square.mean()),
            target_rmse=np.sqrt(self.square.mean(of_each=True)),
            believed_rmse=np.sqrt(self.variance.mean()),
            gospa=np.sqrt(self.square_gospa.mean()),
            nees_sum=np.stack(self.nees_sums, axis=1),
            nees_count=np.stack(self.nees_counts, axis=1),
            lost=self.lost,
            collisions=self.collisions.mean(),
            share=self.share.mean(),
            choice=np.stack(self.choices, axis=1) if self.sensors else np.zeros((*costs.shape, 0), np.int64),
            options=self.options,
            outside=self.outside / self.steps,
            seconds=self.seconds,
        )


class _Sum:
    """A metric summed over steps, (world, target)."""

    def __init__(self) -> None:
        self.total: Any = 0.0
        self.count: Any = 0.0

    def add(self, values: Array, counted: Array, weight: Array) -> None:
        """One step's values, which of them count, (world, target) both, and the weight of the step, (world,)."""
        weights = counted * weight[:, None]
        self.total, self.count = self.total + np.where(counted, values, 0.0) * weights, self.count + weights

    def mean(self, of_each: bool = False) -> Array:
        """Over steps and targets, (world,), or over the steps of each target, (world, target); NaN without a value."""
        return _ratio(*(total if of_each else total.sum(axis=1) for total in (self.total, self.count)))


def _ratio(total: Array, count: Array) -> Array:
    return np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)


def _metric(info: dict[str, Array], key: str, on: Array) -> tuple[Array, Array]:
    """A metric with all its targets on one axis, and where it counts, (world, target) both; NaN where there is none.

    It counts for a target that is ``present`` in a world that is ``on`` (bool, world).
    """
    if key not in info:
        return np.full((len(on), 1), np.nan), np.zeros((len(on), 1), np.bool_)
    values = np.asarray(info[key], np.float64).reshape(len(on), -1)
    present = np.asarray(info.get("present", np.ones(values.shape)), np.bool_).reshape(len(on), -1)
    if present.shape != values.shape:  # a figure of all targets together
        present = np.logical_or.reduce(present, axis=1, keepdims=True)
    return values, present & on[:, None]


def merged(parts: Sequence[Played]) -> Played:
    """One record from those of consecutive chunks of worlds."""
    longest, padded = max(part.cost.shape[1] for part in parts), []
    for part in parts:
        gap = ((0, 0), (0, longest - part.cost.shape[1]))  # steps past the end of every episode
        padded.append(
            part._replace(
                cost=np.pad(part.cost, gap, constant_values=np.nan),
                nees_sum=np.pad(part.nees_sum, gap),
                nees_count=np.pad(part.nees_count, gap),
                choice=np.pad(part.choice, (*gap, (0, 0)), constant_values=-1),
            )
        )
    return Played(*(np.concatenate(arrays) for arrays in zip(*padded, strict=True)))
