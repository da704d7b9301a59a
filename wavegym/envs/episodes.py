"""A batch of episodes of one system: worlds, states and rewards, without Gymnasium's calling conventions.

The environments are built on this class; they define how a batch is reset and what info holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_choice
from wavegym.core.system import State, System
from wavegym.core.track_loss import LOST_AFTER, NO_TRACK_YET, is_astray, steps_astray
from wavegym.envs.chunks import in_chunks
from wavegym.envs.rewards import Reward, Transition
from wavegym.observations.observer import MeasurementObserver, Observer

Seed = int | Sequence[int | None] | NDArray[np.integer] | None

Info = dict[str, Array]  # state info or transition info, each value (env, ...)


class Begun(NamedTuple):
    """The beginning of new episodes."""

    state: State
    memory: Any  # the reward's


class Before(NamedTuple):
    """The state of a batch before a step."""

    state: State
    actions: Array
    world: Any
    memory: Any  # the reward's
    shown: Array | None  # the observation of a MeasurementObserver
    measured: Any  # the measurements of the step, if requested
    keep: Array | None  # environments that wait, (env,) bool


class After(NamedTuple):
    """The state of a batch after a step."""

    state: State
    shown: Array | None
    observation: Array
    state_info: Info
    reward: Array
    transition_info: Info


class Episodes:
    """``num_envs`` parallel episodes, each with its own generator of worlds.

    Args:
        system: the closed loop.
        num_envs: number of episodes.
        reward: scores each step.
        forecasts: whether observations also hold forecasts of each candidate.
        measurements: whether a step also returns the measurements of the sensors.
        observation: "belief", or "measurements" for the measurements of the sensors alone.
        num_threads: number of threads in which the episodes advance.
        candidates: length of the list from which agents choose, see ``Observer``; None: from all actions.

    Raises:
        InputError: measurements of a system that does not measure apart from tracking; another observation, one
            that the system does not have, or forecasts or candidates beside measurements.
    """

    def __init__(
        self,
        system: System,
        num_envs: int,
        reward: Reward,
        forecasts: bool = False,
        measurements: bool = False,
        observation: str = "belief",
        num_threads: int = 1,
        candidates: int | None = None,
    ) -> None:
        if measurements and type(system).measure is System.measure:
            wanted = f"False (nearest): {type(system).__name__} has no method measure"
            raise InputError(f"measurements is True, expected {wanted}")
        self.system, self.num_envs, self.reward, self.measurements = system, num_envs, reward, measurements
        self.observer: Observer | MeasurementObserver
        if check_choice("observation", observation, ("belief", "measurements")) == "belief":
            self.observer = Observer(system, forecasts, candidates)
        elif forecasts or candidates is not None:
            given = "forecasts is True" if forecasts else f"candidates is {candidates}"
            wanted = "False: forecasts tell the belief" if forecasts else "None: their forecasts tell the belief"
            raise InputError(f"{given} with observation='measurements', expected {wanted}")
        else:
            self.observer = MeasurementObserver(system)
        self._threads = num_threads
        self._shown: Array | None = None  # by environment, what a MeasurementObserver shows
        self._astray: Array | None = None  # (env, target) int, see ``steps_astray``; None: no step yet
        self.generators: list[np.random.Generator | None] = [None] * num_envs
        self.seeds: list[int | None] = [None] * num_envs  # -1 where a generator was given instead
        self.world: Any = None
        self._state: State | None = None
        self._memory: Any = None

    @property
    def state(self) -> State:
        """The current state; InputError before the first reset."""
        if self._state is None:
            raise InputError("the environment has no state yet, expected reset() first")
        return self._state

    def seed(self, row: int, seed: int) -> None:
        """Give one environment a new generator."""
        self.generators[row], self.seeds[row] = seeding.np_random(seed)

    def begin(self, rows: Array) -> None:
        """Draw new worlds for the environments in ``rows`` (bool, env), and set their initial states."""
        if self._state is None and not rows.all():
            raise InputError("options['reset_mask'] leaves out environments that never began, expected reset() first")
        worlds = [self.system.draw_world(self.generator(i)) for i in np.flatnonzero(rows).tolist()]
        world = trees.stack(worlds)
        state, memory = in_chunks(self._begun, world, len(worlds), self._threads)
        if rows.all():
            self.world, self._state, self._memory, self._astray = world, state, memory, None
        else:
            trees.overwrite(self.world, rows, world)
            trees.overwrite(self._memory, rows, memory)
            self._state = trees.scattered(self.state, rows, state)
            if self._astray is not None:
                self._astray = _replaced(self._astray, rows, np.full_like(self._astray, NO_TRACK_YET))
        if isinstance(self.observer, MeasurementObserver):
            self._shown = _replaced(self._shown, rows, self.observer.first(self.state.belief))

    def _begun(self, world: Any) -> Begun:
        """The initial states of worlds, and the memory of the reward."""
        return Begun(self.system.initial(world), self.reward.begin(self.system, world))

    def generator(self, row: int) -> np.random.Generator:
        """The generator of one environment's worlds; without a seed it is seeded at random."""
        generator = self.generators[row]
        if generator is None:
            generator, self.seeds[row] = seeding.np_random()
            self.generators[row] = generator
        return generator

    def saved(self) -> dict[str, Any]:
        """All that changes from step to step, as plain values and arrays; ``restore`` takes it over."""
        generators = [None if generator is None else generator.bit_generator.state for generator in self.generators]
        trees_of_arrays = {"world": self.world, "state": self.state, "memory": self._memory}
        leaves = {name: trees.leaves(tree) for name, tree in trees_of_arrays.items()}
        return {"generators": generators, "seeds": self.seeds, "shown": self._shown, "astray": self._astray, **leaves}

    def restore(self, saved: dict[str, Any]) -> None:
        """Continue the episodes of ``saved``. Raises a KeyError, TypeError or ValueError where they are others."""
        if len(saved["generators"]) != self.num_envs:
            raise ValueError(f"there are {len(saved['generators'])} generators, expected {self.num_envs}")
        if self._state is None:
            self.begin(np.ones(self.num_envs, np.bool_))  # for the form of worlds and states
        self.world = trees.refilled(self.world, saved["world"])
        self._state = trees.refilled(self.state, saved["state"])
        self._memory = trees.refilled(self._memory, saved["memory"])
        self._shown, self._astray, self.seeds = saved["shown"], saved["astray"], saved["seeds"]
        for row, state in enumerate(saved["generators"]):
            if state is not None:
                self.generator(row).bit_generator.state = state

    def observe(self) -> tuple[Array, Info]:
        """Observations (env, fields) and the state info."""
        observation, state_info = self._observed(self.state, self._shown)
        return observation, self._with_losses(state_info)

    def _observed(self, state: State, shown: Array | None) -> tuple[Array, Info]:
        """``observe`` of a state.

        Costs and key figures are not copied into info, so a system must return fresh arrays, not views of its state
        (``check_vector_env`` finds systems that return views).
        """
        observation, saturated = self.observer(state.belief if shown is None else shown)
        cost = self.system.cost(state.belief)
        return observation, {"cost": cost, "saturated": saturated, **self._figures(state)}

    def _figures(self, state: State) -> Info:
        """The system's key figures, and ``astray`` if it has ``lost_beyond`` and does not report ``lost`` itself."""
        figures, beyond = self.system.state_info(state), self.system.lost_beyond
        if beyond is not None and "lost" not in figures:
            errors = figures["position_error"], figures["nees"]
            figures["astray"] = is_astray(*errors, beyond, self.system.nees_dimension)
        return figures

    def _with_losses(self, state_info: Info) -> Info:
        """The state info with ``lost``, where it has ``astray``."""
        if "astray" in state_info:
            shape = state_info["astray"].shape
            lost = np.zeros(shape, np.bool_) if self._astray is None else self._astray >= LOST_AFTER
            state_info["lost"] = lost
        return state_info

    def _count_astray(self, state_info: Info, keep: Array | None) -> None:
        """Count the step of all environments except those in ``keep``."""
        if "astray" in state_info:
            astray = state_info["astray"]
            before = np.full(astray.shape, NO_TRACK_YET) if self._astray is None else self._astray
            after = steps_astray(before, astray, state_info.get("present", True))
            self._astray = after if keep is None else _replaced(before, ~keep, after)

    def step(self, actions: Array, keep: Array | None = None) -> tuple[Array, Info, Array, Info]:
        """Advance all environments except those in ``keep`` (bool, env), whose states stay unchanged.

        Returns:
            Observations, state info, rewards (env,), and the transition info: the reward's own terms, and measurements.
        """
        if keep is not None and keep.all():
            return *self.observe(), np.zeros(self.num_envs), {}
        measured: Any = self._measured(actions) if self.measurements or self._shown is not None else None
        before = Before(self.state, actions, self.world, self._memory, self._shown, measured, keep)
        after: After = in_chunks(self._advanced, before, self.num_envs, self._threads)
        self._state, self._shown, terms = after.state, after.shown, after.transition_info
        if self.measurements:
            terms = {**terms, **{f"measured_{name}": values for name, values in measured._asdict().items()}}
        self._count_astray(after.state_info, keep)
        return after.observation, self._with_losses(after.state_info), after.reward, terms

    def _advanced(self, before: Before) -> After:
        """A step of a batch, or of a chunk of it. It changes nothing here, as chunks are advanced side by side."""
        previous, actions, world, memory, shown, measured, keep = before
        following = self.system.transition(previous, actions, world)
        if keep is not None:
            following = trees.merged(following, keep, previous)
        if isinstance(self.observer, MeasurementObserver):
            new = self.observer.after(following.belief, actions, measured)
            shown = new if keep is None else _replaced(shown, ~keep, new)
        observation, state_info = self._observed(following, shown)
        cost = state_info["cost"]
        reward, terms = self.reward(Transition(self.system, previous, actions, following, cost, memory))
        return After(following, shown, observation, state_info, reward, terms)

    def _measured(self, actions: Array) -> Any:
        """The measurements of a step in all environments; all scans have the length of the longest one."""
        truth = self.system.move(self.state.truth, self.state.belief.step, self.world)
        return self.system.measure(truth, self.state.belief, actions, self.world)


def _replaced(old: Array | None, rows: Array, new: Array) -> Array:
    """``old`` with the rows (bool, env) of ``new``; without ``old`` all of ``new``."""
    return new if old is None else np.where(rows[:, None], new, old)


def seed_list(seed: Seed, num_envs: int) -> list[int | None]:
    """One seed or None for each environment: s gives environment i the seed s + i, a list or an array is taken as is.

    Raises:
        InputError: a seed that is not an integer >= 0, or a list of the wrong length.
    """
    if isinstance(seed, np.ndarray):
        seed = seed.tolist()
    if seed is None:
        return [None] * num_envs
    if not isinstance(seed, Sequence) or isinstance(seed, str):
        first = _checked_seed(seed)
        return [first + i for i in range(num_envs)]
    if len(seed) != num_envs:
        raise InputError(f"seed has {len(seed)} entries, expected {num_envs}: one for each environment")
    return [None if each is None else _checked_seed(each) for each in seed]


def _checked_seed(seed: Any) -> int:
    if not isinstance(seed, (int, np.integer)) or isinstance(seed, bool) or seed < 0:
        raise InputError(f"seed is {seed!r}, expected an integer >= 0")
    return int(seed)
