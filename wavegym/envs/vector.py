"""The native vector environment; the single environment is a batch of one."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.error import ClosedEnvironmentError
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_choice, check_int
from wavegym.core.policy import Policy
from wavegym.core.system import System, build_system
from wavegym.envs.actions import action_reader
from wavegym.envs.episodes import Episodes, Info, Seed, seed_list
from wavegym.envs.policy_in_loop import PolicyInLoop
from wavegym.envs.rewards import Reward, make_reward
from wavegym.envs.scenario import with_scenario
from wavegym.registration import SETTINGS

PER_ENVIRONMENT = {"action_space": "single_action_space", "observation_space": "single_observation_space"}
Stepped = tuple[Array, Array, Array, Array, dict[str, Any]]


class ClosedError(InputError, ClosedEnvironmentError):
    """A closed environment was asked for a step: a user's mistake, and the error that Gymnasium raises for it."""


class FixedParameters:
    """Refuses new values of the system's parameters, and of settings, as attributes: they would change nothing."""

    _fixed: frozenset[str] = frozenset()

    def fix(self, system: System) -> None:
        """Refuse from now on, except for attributes that are there."""
        parameters = [field.name for field in dataclasses.fields(system)] if dataclasses.is_dataclass(system) else []
        self._fixed = frozenset({*parameters, *SETTINGS} - self.__dict__.keys())

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute. Raises an InputError for a parameter or a setting."""
        if name in self._fixed:
            new = f"a new environment: gym.make(..., {name}={value!r})"
            changed = f"reset(options={{'parameters': {{{name!r}: {value!r}}}}})"
            raise InputError(f"{name} is fixed in an episode, expected {new if name in SETTINGS else changed}")
        super().__setattr__(name, value)


class WaveformVectorEnv(FixedParameters, VectorEnv):
    """A batch of closed loops in which the action is the next waveform.

    Args:
        system: the closed loop: a System, its class, or ``"package.module:Class"``.
        num_envs, reward, render_mode, autoreset_mode, max_episode_steps, forecasts, candidates, measurements,
            observation, num_threads: the settings of every environment; ``wavegym.registration.SETTINGS`` holds their
            meaning, and ``wavegym.describe`` lists them.
        **parameters: the system's parameters.

    Raises:
        InputError: an unknown setting or a value out of range; the message names the nearest valid choice.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 4}

    def __init__(
        self,
        system: System | type[System] | str,
        num_envs: int = 1,
        *,
        reward: str | Reward = "cost",
        render_mode: str | None = None,
        autoreset_mode: str = "NextStep",
        max_episode_steps: int | None = None,
        forecasts: bool = False,
        candidates: int | None = None,
        measurements: bool = False,
        observation: str = "belief",
        num_threads: int = 1,
        **parameters: Any,
    ) -> None:
        if "scenario" in parameters:
            raise InputError("scenario is a setting of gym.make and gym.make_vec, expected it there")
        self.system = build_system(system, parameters, SETTINGS)
        self.num_envs = check_int("num_envs", num_envs, 1)
        self.render_mode = None if render_mode is None else check_choice("render_mode", render_mode, ["rgb_array"])
        limit = max_episode_steps
        self.max_episode_steps = None if limit is None else check_int("max_episode_steps", limit, 1)
        if isinstance(autoreset_mode, AutoresetMode):
            wanted = f"the string {autoreset_mode.value!r}: specifications are kept as JSON"
            raise InputError(f"autoreset_mode is {autoreset_mode}, expected {wanted}")
        modes = [mode.value for mode in AutoresetMode]
        self.autoreset_mode = AutoresetMode(check_choice("autoreset_mode", autoreset_mode, modes))
        self.metadata = {**type(self).metadata, "autoreset_mode": self.autoreset_mode}
        self.num_threads = check_int("num_threads", num_threads, 1)
        shown = forecasts, measurements, observation
        self._settings = make_reward(reward), *shown, self.num_threads, candidates
        self.episodes = Episodes(self.system, self.num_envs, *self._settings)
        self._reader = action_reader(self.system, self.episodes.observer.shortlist)
        self.single_action_space, self.single_observation_space = self._reader.space, self.episodes.observer.space
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._ended, self._some_ended = np.zeros(self.num_envs, np.bool_), False
        self._film = self._new_film()
        self.fix(self.system)

    def _new_film(self) -> Any:
        if self.render_mode is None:
            return None
        from wavegym.envs.film import Film

        return Film(self.system, self.num_envs)

    @property
    def belief(self) -> Any:
        """A copy of the belief, for schedulers; axis 0 = environment. It does not contain the truth."""
        return trees.copied(self.episodes.state.belief)

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Each environment's generator of worlds, as in SyncVectorEnv."""
        return tuple(self.episodes.generator(i) for i in range(self.num_envs))

    @property
    def np_random_seed(self) -> tuple[int | None, ...]:  # type: ignore[override]
        """The last seed of each environment, as in SyncVectorEnv."""
        assert len(self.np_random) == self.num_envs  # an environment without a generator gets one and its seed
        return tuple(self.episodes.seeds)

    @property
    def world(self) -> Any:
        """The worlds, for replays and clairvoyant bounds, never for a policy; later resets overwrite them."""
        return self.episodes.world

    def action_masks(self) -> Array:
        """Which actions are allowed now, (env, actions) bool; of a MultiDiscrete, sensor after sensor."""
        belief, shortlist = self.episodes.state.belief, self.episodes.observer.shortlist
        return shortlist(belief).allowed if shortlist else self.system.mask(belief)

    def policy(self, policy: str | Policy, seed: int = 0) -> PolicyInLoop:
        """A scheduler by name, or a Policy, that follows this environment: ``actions = policy()`` before each step.

        See ``wavegym.envs.policy_in_loop.PolicyInLoop``.
        """
        return PolicyInLoop(self, policy, seed)

    def reset(self, *, seed: Seed = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin new episodes: in all environments, or in those of ``options["reset_mask"]``.

        Args:
            seed: None (continue with each environment's generator), s (environment i is seeded with s + i) or a list.
            options: {"reset_mask": bool array (env,), "parameters": {name: value}}; read, never changed. New values of
                parameters hold from this reset on, in all environments.

        Raises:
            InputError: a seed that is not an integer >= 0, a wrong mask, option or parameter, or a parameter on which
                observations or actions depend; environments and generators are unchanged.
            ClosedError: after ``close``.
        """
        self._check_open()
        rows = self._rows_to_reset(options)
        if "parameters" in (options or {}):
            self._take_over(options["parameters"], rows)  # type: ignore[index]
        for i, s in enumerate(seed_list(seed, self.num_envs)):
            if s is not None and rows[i]:
                self.episodes.seed(i, s)
        self.episodes.begin(rows)
        observation, state_info = self.episodes.observe()
        self._ended = self._ended & ~rows
        self._some_ended = bool(self._ended.any())
        info: dict[str, Any] = {}
        _add_info(info, state_info, None if rows.all() else rows)
        if self._film:
            self._film.begin(self.episodes.state, rows)
        return observation, info

    def step(self, actions: Any) -> Stepped:
        """One step of every environment; see Gymnasium's three autoreset modes.

        Raises:
            InputError: an action out of range, masked or not finite, or (autoreset disabled) a step past an episode's
                end; the environment is unchanged.
            ClosedError: after ``close``.
        """
        self._check_open()
        restarting = self._ended if self._some_ended else None
        if restarting is not None and self.autoreset_mode is AutoresetMode.DISABLED:
            which = np.flatnonzero(restarting).tolist()
            raise InputError(f"environments {which} have ended, expected a reset of them before step()")
        observation, reward, terminated, truncated, state_info, transition_info = self.transmit(actions, restarting)
        active = None
        if restarting is not None:
            active = ~restarting
            reward = np.where(active, reward, 0.0)
            terminated, truncated = terminated & active, truncated & active
        self._ended = terminated | truncated
        self._some_ended = 1 in self._ended.tobytes()  # NumPy's any() takes a microsecond
        info: dict[str, Any] = {}
        if self._some_ended and self.autoreset_mode is AutoresetMode.SAME_STEP:
            active = ~self._ended
            _final_info(info, observation, {**state_info, **transition_info}, self._ended)
            observation, state_info = self._restart_now()
        _add_info(info, state_info, None)
        _add_info(info, transition_info, active)
        return observation, reward, terminated, truncated, info

    def transmit(self, actions: Any, restarting: Array | None) -> tuple[Array, Array, Array, Array, Info, Info]:
        """One step of all environments except those ``restarting`` (bool, env), which begin a new episode instead.

        Returns:
            Observations, rewards, terminated, truncated, state info, transition info.
        """
        chosen = self._reader.read(actions, self.episodes.state.belief, restarting)
        if restarting is not None:
            self.episodes.begin(restarting)
        observation, state_info, reward, transition_info = self.episodes.step(chosen, restarting)
        transition_info.update(self._reader.transition_info(actions, chosen))
        if self._film:
            self._film.add(self.episodes.state, chosen, state_info["cost"], restarting)
        belief = self.episodes.state.belief
        return observation, reward, *endings(self.system, belief, self.max_episode_steps), state_info, transition_info

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """The result of a method or attribute of each single environment, as in SyncVectorEnv.

        Raises:
            AttributeError: there is none of this name.
        """
        value = getattr(self, PER_ENVIRONMENT.get(name, name))
        if callable(value):
            value = value(*args, **kwargs)
        return tuple(row_of(value, i, self.num_envs) for i in range(self.num_envs))

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """An attribute of each single environment, as in SyncVectorEnv."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of all environments, which share one batch, to one value.

        Raises:
            InputError: a list or tuple of values that differ.
        """
        listed = values if isinstance(values, (list, tuple)) and name not in self._fixed else [values]
        if any(value != listed[0] for value in listed):
            raise InputError(f"{name} is {values!r}, expected one value for all environments: they share one batch")
        setattr(self, name, listed[0])

    def _check_open(self) -> None:
        if self.closed:
            raise ClosedError("the environment is closed, expected a new one of gym.make_vec")

    def saved(self) -> dict[str, Any]:
        """All that changes from step to step, as plain values and arrays; ``restore`` of another one takes it over."""
        return {"episodes": self.episodes.saved(), "ended": self._ended}

    def restore(self, saved: dict[str, Any]) -> None:
        """Continue the episodes of ``saved``, of environments with the same settings; frames of a film begin anew.

        Raises:
            KeyError, TypeError, ValueError: the episodes are those of other environments.
        """
        self.episodes.restore(saved["episodes"])
        self._ended, self._some_ended = saved["ended"], bool(saved["ended"].any())

    def render(self) -> tuple[Array, ...] | None:
        """A frame (height, width, 3) uint8 of each environment, or None without a render mode.

        Raises:
            InputError: before the first reset.
        """
        if self._film is None:
            return None
        assert self.episodes.state  # raises an InputError before the first reset
        return self._film.frames()

    def _restart_now(self) -> tuple[Array, Info]:
        """SAME_STEP: begin new episodes where one has ended; returns observations and state info after that."""
        self.episodes.begin(self._ended)
        if self._film:
            self._film.begin(self.episodes.state, self._ended)
        self._ended, self._some_ended = np.zeros(self.num_envs, np.bool_), False
        return self.episodes.observe()

    def _take_over(self, parameters: Any, rows: Array) -> None:
        """New values of the system's parameters; the generators of worlds go on."""
        if not isinstance(parameters, Mapping):
            raise InputError(f"options['parameters'] is {parameters!r}, expected a dictionary by name")
        if not rows.all():
            raise InputError("options has parameters and a reset_mask, expected one: environments share one system")
        system = build_system(self.system, dict(parameters), SETTINGS)
        episodes = Episodes(system, self.num_envs, *self._settings)
        meanings = [
            (each.system.actions, [(f.name, f.centre, f.scale) for f in each.observer.observation_fields])
            for each in (self.episodes, episodes)
        ]
        if meanings[0] != meanings[1]:
            kept = "parameters that keep observations and actions (nearest: a new environment of gym.make)"
            raise InputError(f"options['parameters'] has {', '.join(parameters)}, expected {kept}")
        episodes.generators, episodes.seeds = self.episodes.generators, self.episodes.seeds
        self.system, self.episodes = system, episodes
        self._reader = action_reader(system, episodes.observer.shortlist)
        self._film = self._new_film()

    def _rows_to_reset(self, options: dict[str, Any] | None) -> Array:
        """The environments to reset, (env,) bool."""
        options = options or {}
        for key in options:
            check_choice("option", key, ["reset_mask", "parameters"])
        if "reset_mask" not in options:
            return np.ones(self.num_envs, np.bool_)
        mask = options["reset_mask"]
        fits = isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and mask.shape == (self.num_envs,)
        if not fits or not mask.any():
            wanted = f"a bool array of shape ({self.num_envs},), not all False"
            raise InputError(f"options['reset_mask'] is {mask!r}, expected {wanted}")
        return mask.copy()


def make_vector_env(
    system: System | type[System] | str, num_envs: int = 1, *, registered: Mapping[str, Any] | None = None, **given: Any
) -> WaveformVectorEnv:
    """A vector environment; called by ``gym.make_vec``. See ``wavegym.envs.single.make_env``."""
    return WaveformVectorEnv(system, num_envs, **with_scenario(system, registered or {}, given))


def row_of(value: Any, i: int, num_envs: int) -> Any:
    """Environment i's part of a batch's value; a belief keeps a leading axis of one, as policies take it."""
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return trees.take(value, np.array([i]))
    listed = isinstance(value, (tuple, list)) or (isinstance(value, np.ndarray) and value.ndim > 0)
    return value[i] if listed and len(value) == num_envs else value


def endings(system: System, belief: Any, max_episode_steps: int | None) -> tuple[Array, Array]:
    """Terminated and truncated, (env,) each; as with Gymnasium's TimeLimit, a step may be both."""
    over = system.terminal(belief)
    late = belief.step >= max_episode_steps if max_episode_steps else np.zeros(len(over), np.bool_)
    return (over, late) if system.terminates else (np.zeros(len(over), np.bool_), over | late)


def _add_info(info: dict[str, Any], entries: dict[str, Array], rows: Array | None) -> None:
    """Add ``entries`` of the environments in ``rows`` (None: all); other rows are zero and masked out.

    The layout is Gymnasium's: for every key an array and a mask ``_key``.
    """
    if rows is None:
        everyone: Array | None = None
        for key, values in entries.items():
            info[key] = values
            everyone = np.ones(len(values), np.bool_) if everyone is None else everyone.copy()
            info[f"_{key}"] = everyone
    elif rows.any():
        for key, values in entries.items():
            shown = np.zeros_like(values)
            shown[rows] = values[rows]
            info[key] = shown
            info[f"_{key}"] = rows.copy()


def _final_info(info: dict[str, Any], observation: Array, entries: dict[str, Array], ended: Array) -> None:
    """``final_obs`` and ``final_info`` of the environments that ended in this step."""
    final = np.full(len(ended), None, dtype=object)
    for i in np.flatnonzero(ended):
        final[i] = observation[i].copy()
    nested: dict[str, Any] = {}
    _add_info(nested, entries, ended)
    info["final_obs"], info["_final_obs"] = final, ended.copy()
    info["final_info"], info["_final_info"] = nested, ended.copy()
