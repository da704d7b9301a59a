"""Play episodes and write them as a Minari dataset, in a folder of the user's choice."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import minari
import numpy as np
from minari import MinariDataset
from minari.data_collector import EpisodeBuffer

from wavegym.core import VERSION, trees
from wavegym.core.action_sets import FiniteSet, ParameterBox
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int, nearest
from wavegym.core.policy import Policy
from wavegym.core.system import State, System
from wavegym.core.worlds import word
from wavegym.envs.vector import WaveformVectorEnv, endings
from wavegym.evaluation.adapters import as_policy
from wavegym.evaluation.play import make_task
from wavegym.observations.observer import Observer
from wavegym.registration import full_id
from wavegym.schedulers.rollout import allowed

BATCH = 64  # episodes played together
VARIABLE = "MINARI_DATASETS_PATH"


def collect(
    env_id: str,
    policy: Any = "myopic",
    episodes: int = 100,
    *,
    out: Path | str,
    name: str = "",
    exploration: float = 0.0,
    would_choose: Sequence[str] = (),
    all_returns: bool = False,
    seed: int = 0,
    **parameters: Any,
) -> MinariDataset:
    """Play a policy, write its episodes to ``out`` and return the dataset.

    The infos of an episode of T steps have

    * ``cost`` (T+1,): after the reset and after each step;
    * ``probability`` (T,): that of the chosen action. For a policy that draws its actions, the drawn action counts as
      its choice, except for "random", whose probabilities are those of a uniform choice;
    * ``would_choose`` (a dict of (T,) by name): the choices of other policies in the same state;
    * ``returns`` (T, action): with ``all_returns``, see ``ReturnsOfAll``; ``policy`` chooses after the first step.

    Args:
        env_id: with or without ``wavegym/``.
        policy: the name of a scheduler or of a saved agent, or anything that ``wavegym.evaluation.as_policy`` takes.
        episodes: number of episodes. Episode i plays the world of ``reset(seed=seed + i)``.
        out: folder of the datasets; the dataset has a folder in it.
        name: of the dataset; from the environment and the policy by default.
        exploration: probability of an action drawn uniformly from those allowed instead of the policy's.
        would_choose: names of further policies.
        all_returns: whether to play every alternative of every step, for a single index as the action.
        seed: of the worlds, of exploration and of policies.
        **parameters: of the environment.

    Raises:
        InputError: a wrong argument, a dataset of that name in ``out``, or exploration in a box.
    """
    env_id = full_id(env_id)
    check_int("episodes", episodes, 1)
    check_int("seed", seed, 0)
    if not (isinstance(exploration, (int, float)) and 0.0 <= exploration <= 1.0):
        raise InputError(f"exploration is {exploration!r}, expected a probability from 0 to 1")
    for played in would_choose:
        if not isinstance(played, str):
            raise InputError(f"would_choose has {played!r}, expected names of policies")
    label = policy if isinstance(policy, str) else type(policy).__name__
    dataset_id = name or _dataset_id(env_id, label)
    if (Path(out) / dataset_id).exists():
        raise InputError(f"{out} has a dataset {dataset_id!r}, expected another folder or name")
    player = _Player(env_id, policy, 1.0 if policy == "random" else exploration, would_choose, all_returns, parameters)
    buffers: list[EpisodeBuffer] = []
    while len(buffers) < episodes:
        first = seed + len(buffers)
        buffers += player.play(list(range(first, first + min(BATCH, episodes - len(buffers)))))
    Path(out).mkdir(parents=True, exist_ok=True)
    spec = gym.make(env_id, **parameters).spec
    with stored_in(out):
        return minari.create_dataset_from_buffers(
            dataset_id,
            buffers,
            env=spec,
            eval_env=spec,
            algorithm_name=label,
            author="wavegym",
            requirements=[f"wavegym=={VERSION}"],
            description=f"{label} in {env_id}, exploration {exploration}, worlds {seed} to {seed + episodes - 1}",
            code_permalink="",
            author_email="",
        )


def _dataset_id(env_id: str, policy: str) -> str:
    """Minari's form of a name: namespace/environment/policy-vN."""
    space, _, short = env_id.rpartition("/")
    stem, _, version = short.rpartition("-v")
    slug = re.sub(r"[^a-z0-9]+", "-", Path(policy).name.lower()).strip("-")
    return f"{space or 'gymnasium'}/{stem}/{slug}-v{version}"


class _Step(NamedTuple):
    """One step of a batch; axis 0 = environment."""

    observation: Array
    action: Array
    reward: Array
    terminated: Array
    truncated: Array
    infos: dict[str, Array]


class _Player:
    """Plays batches of episodes and remembers every step."""

    def __init__(
        self,
        env_id: str,
        policy: Any,
        exploration: float,
        would_choose: Sequence[str],
        all_returns: bool,
        parameters: dict[str, Any],
    ) -> None:
        task = make_task(env_id, parameters)
        if exploration and isinstance(task.system.actions, ParameterBox):
            raise InputError(f"exploration is {exploration}, expected 0 where the action is a point of a box")
        self.env_id, self.exploration, self.parameters = env_id, exploration, parameters
        self.policy = as_policy(policy, task)
        self.others = {other: as_policy(other, task) for other in would_choose}
        self.returns = ReturnsOfAll(task.system, self.policy, task.max_episode_steps) if all_returns else None

    def play(self, seeds: list[int]) -> list[EpisodeBuffer]:
        """One episode of each seed."""
        envs: Any = gym.make_vec(self.env_id, num_envs=len(seeds), **self.parameters)
        native: WaveformVectorEnv = envs.unwrapped
        choose = native.policy(self.policy, seeds[0])
        others = {name: native.policy(policy, seeds[0]) for name, policy in self.others.items()}
        rng = np.random.default_rng([word("exploration"), seeds[0]])
        observation, info = envs.reset(seed=seeds)
        cost, steps, running = info["cost"], [], np.ones(len(seeds), np.bool_)
        while running.any():
            infos = {f"would_choose/{name}": other() for name, other in others.items()}
            if self.returns:
                infos["returns"] = self.returns(native.episodes.state, native.world)
            action, infos["probability"] = self._explore(choose(), native, rng)
            following, reward, terminated, truncated, info = envs.step(action)
            infos["cost"] = info["cost"]
            steps.append(_Step(observation, action, reward, terminated, truncated, infos))
            observation, running = following, running & ~(terminated | truncated)
        return [_buffer(i, seed, steps, observation, cost) for i, seed in enumerate(seeds)]

    def _explore(self, action: Array, envs: WaveformVectorEnv, rng: np.random.Generator) -> tuple[Array, Array]:
        """The actions played, and the probability of each."""
        if isinstance(envs.system.actions, ParameterBox):
            return action, np.ones(len(action))
        sensors = action.shape[1] if action.ndim > 1 else 1
        mask = envs.action_masks().reshape(len(action), sensors, -1)
        drawn = np.where(mask, rng.random(mask.shape), -1.0).argmax(axis=2).reshape(action.shape)
        explores = (rng.random(len(action)) < self.exploration).reshape(-1, *[1] * (action.ndim - 1))
        played = np.where(explores, drawn, action)
        is_choice = (played == action).reshape(len(action), -1).all(axis=1)
        uniform = 1.0 / mask.sum(axis=2).prod(axis=1)
        return played, self.exploration * uniform + (1.0 - self.exploration) * is_choice


def _buffer(row: int, seed: int, steps: Sequence[_Step], last: Array, first_cost: Array) -> EpisodeBuffer:
    """The episode of one environment, up to its end."""
    ended = [bool(step.terminated[row] or step.truncated[row]) for step in steps]
    own = steps[: ended.index(True) + 1]
    following = steps[len(own)].observation[row] if len(own) < len(steps) else last[row]
    infos = {name: np.stack([step.infos[name][row] for step in own]) for name in own[0].infos}
    infos["cost"] = np.concatenate([first_cost[row : row + 1], infos["cost"]])
    return EpisodeBuffer(
        seed=seed,
        observations=np.stack([*(step.observation[row] for step in own), following]),
        actions=np.stack([step.action[row] for step in own]),
        rewards=[float(step.reward[row]) for step in own],
        terminations=[bool(step.terminated[row]) for step in own],
        truncations=[bool(step.truncated[row]) for step in own],
        infos=infos,
    )


@contextmanager
def stored_in(folder: Path | str) -> Iterator[None]:
    """Inside this context, Minari's functions find and write their datasets in ``folder``, else in the home folder."""
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = str(Path(folder).absolute())
    try:
        yield
    finally:
        if before is None:
            del os.environ[VARIABLE]
        else:
            os.environ[VARIABLE] = before


def load(folder: Path | str, dataset_id: str) -> MinariDataset:
    """A dataset that ``collect`` wrote to ``folder``.

    Raises:
        InputError: there is no such dataset (nearest named).
    """
    with stored_in(folder):
        found = list(minari.list_local_datasets())
        if dataset_id not in found:
            listed = f"one of {', '.join(found)}" if found else "the folder of a dataset"
            raise InputError(f"{folder} has no dataset {dataset_id!r}, expected {listed}{nearest(dataset_id, found)}")
        return minari.load_dataset(dataset_id)


class ReturnsOfAll:
    """The return of every action at a step, if a policy chooses from the next step on: minus the sum of the costs.

    All alternatives meet the same world: the same motion, noise and clutter. They are returns of this one episode, not
    their expectation.

    Args:
        system: the closed loop.
        policy: chooses after the first step. It begins anew at every step, so one with a memory starts empty.
        max_episode_steps: truncation before the system's own end, or None.

    Raises:
        InputError: the actions are points of a box, or every sensor has an action of its own.
    """

    def __init__(self, system: System, policy: Policy, max_episode_steps: int | None) -> None:
        actions: FiniteSet | ParameterBox = system.actions
        count = 0 if isinstance(actions, ParameterBox) else len(system.candidates())
        if count == 0 or system.candidates().ndim > 1:
            raise InputError(f"{type(system).__name__}'s action is no single index, expected one for `all_returns` "
                             "(nearest: a setting such as action='joint')")  # fmt: skip
        self._system, self._policy = system, policy
        self._count, self._observer, self._limit = count, Observer(system), max_episode_steps

    def __call__(self, state: State, world: object) -> Array:
        """Returns (env, action) from ``state`` on; NaN for a masked action."""
        system, envs = self._system, len(state.belief.step)
        mask = system.mask(state.belief)
        wanted = np.tile(np.arange(self._count), (envs, 1))
        tried = np.where(mask, wanted, mask.argmax(axis=1)[:, None]).ravel()  # a masked action is not played
        state, world = trees.repeated(state, self._count), trees.repeated(world, self._count)
        self._policy.begin(system, envs * self._count, np.random.default_rng(word("policy")))
        total = np.zeros(envs * self._count)
        action = tried
        while not (over := np.logical_or(*endings(system, state.belief, self._limit))).all():
            state = system.transition(state, action, world)
            total -= np.where(over, 0.0, system.cost(state.belief))
            observation, _ = self._observer(state.belief)
            action = self._policy.act(state.belief, observation, allowed(system, state.belief))
        return np.where(mask, total.reshape(envs, self._count), np.nan)
