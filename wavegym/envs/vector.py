"""The native vector environment: one implementation, of which the single environment is a batch of one."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_choice, check_int
from wavegym.core.system import System
from wavegym.envs.actions import action_reader
from wavegym.envs.build import build_system
from wavegym.envs.episodes import Episodes, Facts
from wavegym.envs.info import add_info, final_info
from wavegym.envs.rewards import Reward, make_reward
from wavegym.envs.seeds import Seed, seed_list

Stepped = tuple[Array, Array, Array, Array, dict[str, Any]]


class WaveformVectorEnv(VectorEnv):
    """A batch of closed loops in which the action is the next waveform.

    Args:
        system: the closed loop: a System, its class, or ``"package.module:Class"``.
        num_envs: how many.
        reward: "trace" (-trace(Lambda P)), "log-trace" (-ln trace(Lambda P)), "relative" (gain over the one-step
            scheduler's own episode on the same world, divided by that episode's mean cost), "relative-log" (ln of that
            scheduler's cost over one's own, step by step), "relative-share" (1 - cost/that cost), "relative-scaled" (1
            - cost/that episode's mean cost), each of the four also with a rule in that scheduler's place, such as
            "relative:best-simple", "error" (minus the squared true position error), or a Reward of your own.
        render_mode: None or "rgb_array".
        autoreset_mode: "NextStep", "SameStep" or "Disabled".
        max_episode_steps: truncate here, before the system's own end.
        forecasts: show, after the system's own elements, what one step ahead holds for each candidate (``Forecasts``).
        **parameters: the system's parameters.

    Raises:
        InputError: an unknown setting or one out of range, the nearest valid one named.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 4}

    def __init__(
        self,
        system: System | type[System] | str,
        num_envs: int = 1,
        *,
        reward: str | Reward = "trace",
        render_mode: str | None = None,
        autoreset_mode: str = "NextStep",
        max_episode_steps: int | None = None,
        forecasts: bool = False,
        **parameters: Any,
    ) -> None:
        self.system = build_system(system, parameters)
        self.num_envs = check_int("num_envs", num_envs, 1)
        self.render_mode = None if render_mode is None else check_choice("render_mode", render_mode, ["rgb_array"])
        self.max_episode_steps = _limit(max_episode_steps)
        self.autoreset_mode = _mode(autoreset_mode)
        self.metadata = {**type(self).metadata, "autoreset_mode": self.autoreset_mode}
        self.episodes = Episodes(self.system, self.num_envs, make_reward(reward), forecasts)
        self._reader = action_reader(self.system)
        self.single_action_space, self.single_observation_space = self._reader.space, self.episodes.observer.space
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._ended, self._some_ended = np.zeros(self.num_envs, np.bool_), False
        self._film = None
        if self.render_mode is not None:
            from wavegym.envs.film import Film

            self._film = Film(self.system, self.num_envs)

    @property
    def belief(self) -> Any:
        """A copy of the belief, for schedulers; axis 0 = environment. The hidden part stays out of reach."""
        return trees.copied(self.episodes.state.belief)

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Each environment's generator of worlds, as SyncVectorEnv has them."""
        return tuple(self.episodes.generator(i) for i in range(self.num_envs))

    @property
    def np_random_seed(self) -> tuple[int | None, ...]:  # type: ignore[override]
        """What each environment was seeded with last, as SyncVectorEnv has them."""
        assert len(self.np_random) == self.num_envs  # an environment without a generator gets one and its seed
        return tuple(self.episodes.seeds)

    @property
    def world(self) -> Any:
        """The tapes, for replays and clairvoyant bounds, never for a policy; later resets overwrite them."""
        return self.episodes.world

    def action_masks(self) -> Array:
        """Which actions are allowed now, (env, actions) bool; of a MultiDiscrete, one sensor after the other."""
        return self.system.mask(self.episodes.state.belief)

    def reset(self, *, seed: Seed = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin new episodes, in the environments of ``options["reset_mask"]`` only where that is given.

        Args:
            seed: None (go on with each environment's generator), s (environment i is seeded with s + i) or a list.
            options: {"reset_mask": bool array (env,)}; read, never changed.

        Raises:
            InputError: a seed that is no integer >= 0, a wrong mask or option; no generator has changed then.
        """
        rows = self._rows_to_reset(options)
        for i, s in enumerate(seed_list(seed, self.num_envs)):
            if s is not None and rows[i]:
                self.episodes.seed(i, s)
        self.episodes.begin(rows)
        observation, state_info = self.episodes.look()
        self._ended = self._ended & ~rows
        self._some_ended = bool(self._ended.any())
        info: dict[str, Any] = {}
        add_info(info, state_info, None if rows.all() else rows)
        if self._film:
            self._film.begin(self.episodes.state, rows)
        return observation, info

    def step(self, actions: Any) -> Stepped:
        """One step of every environment; see Gymnasium's three autoreset modes.

        Raises:
            InputError: an action out of range, masked or not finite, or (autoreset disabled) a step past an episode's
                end; nothing has changed then.
        """
        restarting = self._restarting()
        observation, reward, terminated, truncated, state_info, transition_info = self.transmit(actions, restarting)
        active = None
        if restarting is not None:
            active = ~restarting
            reward = np.where(active, reward, 0.0)
            terminated, truncated = terminated & active, truncated & active
        self._ended = terminated | truncated
        self._some_ended = bool(np.logical_or.reduce(self._ended))
        info: dict[str, Any] = {}
        if self._some_ended and self.autoreset_mode is AutoresetMode.SAME_STEP:
            active = ~self._ended
            final_info(info, observation, {**state_info, **transition_info}, self._ended)
            observation, state_info = self._restart_now()
        add_info(info, state_info, None)
        add_info(info, transition_info, active)
        return observation, reward, terminated, truncated, info

    def transmit(self, actions: Any, restarting: Array | None) -> tuple[Array, Array, Array, Array, Facts, Facts]:
        """One step of all environments but those ``restarting`` (bool, env), which begin a new episode instead.

        Returns:
            Observations, rewards, terminated, truncated, facts of the new states, facts of the actions and rewards.
        """
        chosen = self._reader.read(actions, self.episodes.state.belief, restarting)
        if restarting is not None:
            self.episodes.begin(restarting)
        observation, state_info, reward, transition_info = self.episodes.step(chosen, restarting)
        transition_info.update(self._reader.state_info(self.system, actions, chosen))
        if self._film:
            self._film.add(self.episodes.state, chosen, state_info["cost"], restarting)
        belief = self.episodes.state.belief
        return observation, reward, *endings(self.system, belief, self.max_episode_steps), state_info, transition_info

    def render(self) -> tuple[Array, ...] | None:
        """A frame (height, width, 3) uint8 of each environment, or None without a render mode.

        Raises:
            InputError: there was no reset yet.
        """
        if self._film is None:
            return None
        assert self.episodes.state  # or an InputError
        return self._film.frames()

    def _restarting(self) -> Array | None:
        """Environments whose coming step is a reset; None where there is none."""
        if not self._some_ended:
            return None
        if self.autoreset_mode is AutoresetMode.DISABLED:
            which = np.flatnonzero(self._ended).tolist()
            raise InputError(f"environments {which} have ended, expected a reset of them before step()")
        return self._ended

    def _restart_now(self) -> tuple[Array, Facts]:
        """SAME_STEP: begin new episodes where one has ended; observations and facts of the states now."""
        self.episodes.begin(self._ended)
        if self._film:
            self._film.begin(self.episodes.state, self._ended)
        self._ended, self._some_ended = np.zeros(self.num_envs, np.bool_), False
        return self.episodes.look()

    def _rows_to_reset(self, options: dict[str, Any] | None) -> Array:
        """The environments that a reset is meant for, (env,) bool."""
        options = options or {}
        for key in options:
            check_choice("option", key, ["reset_mask"])
        if "reset_mask" not in options:
            return np.ones(self.num_envs, np.bool_)
        mask = options["reset_mask"]
        fits = isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and mask.shape == (self.num_envs,)
        if not fits or not mask.any():
            wanted = f"a bool array of shape ({self.num_envs},), not all False"
            raise InputError(f"options['reset_mask'] is {mask!r}, expected {wanted}")
        return mask.copy()


def endings(system: System, belief: Any, max_episode_steps: int | None) -> tuple[Array, Array]:
    """Terminated and truncated, (env,) each; as Gymnasium's TimeLimit, a step may be both."""
    over = system.terminal(belief)
    late = belief.step >= max_episode_steps if max_episode_steps else np.zeros(len(over), np.bool_)
    return (over, late) if system.terminates else (np.zeros(len(over), np.bool_), over | late)


def _mode(mode: str) -> AutoresetMode:
    if isinstance(mode, AutoresetMode):
        raise InputError(
            f"autoreset_mode is {mode}, expected the string {mode.value!r}: specifications are kept as JSON"
        )
    return AutoresetMode(check_choice("autoreset_mode", mode, [m.value for m in AutoresetMode]))


def _limit(max_episode_steps: int | None) -> int | None:
    return None if max_episode_steps is None else check_int("max_episode_steps", max_episode_steps, 1)
