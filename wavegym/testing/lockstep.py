"""A native vector environment in lockstep with Gymnasium's SyncVectorEnv over single environments, bit by bit."""

from __future__ import annotations

import copy
import pickle
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from reprlib import repr as short
from typing import Any, NoReturn

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.vector.utils import iterate

from wavegym.core.arrays import Array

HELD = 3  # return values kept, to find later steps that write into them
STEP_NAMES = ("observations", "rewards", "terminated", "truncated", "info")


def difference(got: Any, want: Any) -> str | None:
    """The first difference of ``got`` from ``want``, as ``"['key'][3] is 1.0, expected 2.0"``; None where equal.

    Types, dtypes and shapes count, and so does the sign of a zero; a NaN equals a NaN.
    """
    if isinstance(want, dict):
        return _mappings(got, want)
    if isinstance(want, (tuple, list)):
        return _sequences(got, want)
    if isinstance(want, (np.ndarray, np.generic, int, float)):
        return _arrays(got, want)
    return None if type(got) is type(want) and got == want else f" is {short(got)}, expected {short(want)}"


def _mappings(got: Any, want: dict[Any, Any]) -> str | None:
    if not isinstance(got, dict):
        return f" is {short(got)}, expected a dictionary"
    for key in want:
        if key not in got:
            return f" lacks the key {key!r}"
    for key in got:
        if key not in want:
            return f" has the key {key!r}, which is not expected"
        inner = difference(got[key], want[key])
        if inner:
            return f"[{key!r}]{inner}"
    return None


def _sequences(got: Any, want: tuple[Any, ...] | list[Any]) -> str | None:
    if type(got) is not type(want) or len(got) != len(want):
        return f" is {short(got)}, expected a {type(want).__name__} of {len(want)}"
    for i, (one, other) in enumerate(zip(got, want, strict=True)):
        inner = difference(one, other)
        if inner:
            return f"[{i}]{inner}"
    return None


def _arrays(got: Any, want: Any) -> str | None:
    if isinstance(got, np.ndarray) is not isinstance(want, np.ndarray):
        return f" is {short(got)}, expected {short(want)}"
    one, other = np.asarray(got), np.asarray(want)
    if one.dtype != other.dtype or one.shape != other.shape:
        return f" is {one.dtype} with shape {one.shape}, expected {other.dtype} with shape {other.shape}"
    if other.dtype == object:
        for index in np.ndindex(other.shape):
            inner = difference(one[index], other[index])
            if inner:
                return f"{list(index)}{inner}"
        return None
    if one.tobytes() == other.tobytes():
        return None
    wrong = ~_same(one, other)
    if not wrong.any():
        return None
    first = tuple(int(i) for i in np.argwhere(wrong)[0])
    return f"{list(first) if first else ''} is {one[first]!r}, expected {other[first]!r}"


def _same(one: Array, other: Array) -> Array:
    """Whether elements are equal, bool array."""
    if one.dtype.kind not in "fc":
        return one == other
    equal = one == other
    if one.dtype.kind == "f":
        equal &= np.signbit(one) == np.signbit(other)
    return equal | (np.isnan(one) & np.isnan(other))


class ConformanceError(AssertionError):
    """A vector environment violates Gymnasium's contract; the message names the defect in one line."""


@dataclass(frozen=True)
class Makers:
    """Functions that make the environments to compare; ``limit`` is {} or {"max_episode_steps": k}."""

    name: str
    native: Callable[..., Any]  # a VectorEnv from (num_envs=, autoreset_mode=, **limit)
    single: Callable[..., gym.Env]  # (**limit)


class Lockstep:
    """Native environment and oracle, given the same seeds, masks and actions; raises at the first difference.

    With ``scribble``, every array that the native environment returns is overwritten after its comparison.
    """

    def __init__(
        self, makers: Makers, num_envs: int, mode: str, limit: dict[str, int], seed: int, scribble: bool = False
    ) -> None:
        self.mode, self.steps, self._scribble = AutoresetMode(mode), 0, scribble
        self.where = f"{makers.name}, num_envs={num_envs}, autoreset_mode={mode!r}" + "".join(
            f", {key}={value}" for key, value in limit.items()
        )
        with self._attempt("making the vector environment"):
            self.native: Any = makers.native(num_envs=num_envs, autoreset_mode=mode, **limit)
        with self._attempt("making the single environments"):
            self.oracle: Any = SyncVectorEnv([lambda: makers.single(**limit)] * num_envs, autoreset_mode=self.mode)
        self.ended = np.zeros(num_envs, np.bool_)
        self._rows: list[Any] = []
        self._held: deque[tuple[str, Any, Any]] = deque(maxlen=HELD)
        self._rng = np.random.default_rng(seed)
        self.native.action_space.seed(seed)
        self._check_attributes(num_envs)

    def reset(self, seed: int | list[int | None] | None, mask: Array | None = None) -> None:
        """Reset both, only the environments in ``mask`` (bool, env) where it is given."""
        options = None if mask is None else {"reset_mask": mask.copy()}
        with self._attempt("reset()"):
            got = self.native.reset(seed=seed, options=options)
        if mask is not None:
            self._check_options(options, mask)
        with self._attempt("reset() of the single environments"):
            want = self.oracle.reset(seed=seed, options=None if mask is None else {"reset_mask": mask.copy()})
        if not isinstance(got, tuple) or len(got) != 2:
            self.fail(f"reset() returned {type(got).__name__}, expected (observations, info)")
        observations, info = got
        rows = self._split(observations)
        for i in np.flatnonzero(~mask).tolist() if mask is not None else ():
            if difference(rows[i], self._rows[i]):
                self.fail(f"a partial reset changed environment {i}, which is not in options['reset_mask']")
        self._same("observations of reset()", observations, want[0])
        self._same("info of reset()", info, want[1])
        self.ended = np.zeros_like(self.ended) if mask is None else self.ended & ~mask
        self._remember("reset()", got, rows)

    def step(self) -> None:
        """Step both with random valid actions."""
        with self._attempt("action_masks()"):
            actions = random_actions(self.native, self._rng)
        given = copy.deepcopy(actions)
        with self._attempt("step()"):
            got = self.native.step(given)
        changed = difference(given, actions)
        if changed:
            self.fail(f"actions changed: after step() the caller's actions{changed}")
        with self._attempt("step() of the single environments"):
            want = self.oracle.step(actions)
        self.steps += 1
        if not isinstance(got, tuple) or len(got) != 5:
            self.fail(f"step() returned {type(got).__name__}, expected {', '.join(STEP_NAMES)}")
        rows, expected = self._split(got[0]), list(iterate(self.oracle.observation_space, want[0]))
        restarting = self.ended if self.mode is AutoresetMode.NEXT_STEP else np.zeros_like(self.ended)
        wrong = [i for i, row in enumerate(rows) if difference(row, expected[i])]
        self._check_no_step_lost(rows, wrong, restarting)
        self._check_endings(got, want)
        self.ended = want[2] | want[3]
        if self.mode is AutoresetMode.SAME_STEP:
            self._check_final_observations(got[4], want[4], rows)
        elif any(self.ended[i] for i in wrong):
            self.fail(f"terminal observation lost: environment {wrong[0]} ended, but this is not its last observation")
        for name, mine, theirs in zip(STEP_NAMES, got, want, strict=True):
            self._same(name, mine, theirs)
        if not np.isfinite(got[1]).all():
            self.fail(f"rewards are {got[1].tolist()}, expected finite numbers")
        self._remember(f"step {self.steps}", got, rows)

    def continue_with_pickled_copy(self) -> None:
        """Replace the native environment by an unpickled copy."""
        with self._attempt("pickling in mid-episode"):
            unpickled = pickle.loads(pickle.dumps(self.native))
        self.native.close()
        self.native = unpickled
        self.where += ", after pickling"

    def close(self) -> None:
        """Close both, the native one twice: a second close must do nothing."""
        self.native.close()
        with self._attempt("a second close()"):
            self.native.close()
        self.oracle.close()

    def fail(self, defect: str) -> NoReturn:
        """Raise the error that names ``defect``, the settings and the step."""
        raise ConformanceError(f"{self.where}, step {self.steps}: {defect}")

    @contextmanager
    def _attempt(self, call: str) -> Iterator[None]:
        """Turn any exception of the environment into a one-line defect."""
        try:
            yield
        except Exception as error:
            message = " ".join(str(error).split())
            raise ConformanceError(
                f"{self.where}, step {self.steps}: {call} raised {type(error).__name__}: {message}"
            ) from error

    def _check_attributes(self, num_envs: int) -> None:
        mode = self.native.metadata.get("autoreset_mode")
        if not isinstance(mode, AutoresetMode):
            self.fail(f"metadata['autoreset_mode'] is {mode!r}, expected the enum AutoresetMode.{self.mode.name}")
        if mode is not self.mode:
            self.fail(f"metadata['autoreset_mode'] is {mode}, expected {self.mode}")
        if self.native.num_envs != num_envs:
            self.fail(f"num_envs is {self.native.num_envs}, expected {num_envs}")
        for name in ("single_observation_space", "single_action_space", "observation_space", "action_space"):
            mine, theirs = getattr(self.native, name), getattr(self.oracle, name)
            if mine != theirs:
                self.fail(f"{name} is {mine}, expected {theirs} as for single environments")

    def _check_options(self, options: Any, mask: Array) -> None:
        if "reset_mask" not in options:
            self.fail("reset mask popped: reset() removed 'reset_mask' from the caller's options")
        wrong = difference(options, {"reset_mask": mask})
        if wrong:
            self.fail(f"reset mask changed: after reset() the caller's options{wrong}")

    def _check_no_step_lost(self, rows: list[Any], wrong: list[int], restarting: Array) -> None:
        """NEXT_STEP: the other environments advance while one is reset."""
        for i in wrong:
            if restarting.any() and not restarting[i] and difference(rows[i], self._rows[i]) is None:
                others = np.flatnonzero(restarting).tolist()
                self.fail(f"step lost: environment {i} stood still while environments {others} were reset")

    def _check_endings(self, got: Any, want: Any) -> None:
        for name, cause, mine, theirs in (
            ("truncation", "was cut off by its time limit", got[3], want[3]),
            ("termination", "ended", got[2], want[2]),
        ):
            if np.shape(mine) == theirs.shape and (theirs & ~mine).any():
                i = int(np.flatnonzero(theirs & ~mine)[0])
                flag = "truncated" if name == "truncation" else "terminated"
                self.fail(f"{name} lost: environment {i} {cause}, but {flag} is False")
            self._same("truncated" if name == "truncation" else "terminated", mine, theirs)

    def _check_final_observations(self, got: Any, want: Any, rows: list[Any]) -> None:
        """SAME_STEP: ``final_obs`` holds the ended episode's last observation, not the next episode's first."""
        if "final_obs" not in want:
            return
        present = got.get("_final_obs", np.zeros_like(self.ended))
        for i in np.flatnonzero(want["_final_obs"]):
            if "final_obs" not in got or not present[i] or got["final_obs"][i] is None:
                self.fail(f"terminal observation lost: environment {i} ended, but info['final_obs'][{i}] is missing")
            final = got["final_obs"][i]
            wrong = difference(final, want["final_obs"][i])
            if wrong:
                next_one = difference(final, rows[i]) is None
                defect = " is the first one of the next episode" if next_one else wrong
                self.fail(f"terminal observation lost: info['final_obs'][{i}]{defect}")
            if not self.native.single_observation_space.contains(final):
                self.fail(f"info['final_obs'][{i}] is outside single_observation_space")

    def _same(self, name: str, got: Any, want: Any) -> None:
        wrong = difference(got, want)
        if wrong:
            self.fail(f"{name}{wrong} as from single environments")

    def _split(self, observations: Any) -> list[Any]:
        """The observation of each environment; fails where the batch is outside the space."""
        if not self.native.observation_space.contains(observations):
            self.fail("observations are outside observation_space")
        return list(iterate(self.native.observation_space, observations))

    def _remember(self, call: str, returned: Any, rows: list[Any]) -> None:
        """Check that earlier return values are unchanged, then keep the newest."""
        for earlier, kept, snapshot in self._held:
            wrong = difference(kept, snapshot)
            if wrong:
                self.fail(f"buffers reused: what {earlier} returned was overwritten later (return value{wrong})")
        self._rows = copy.deepcopy(rows)
        if self._scribble:
            _overwrite(returned)
        self._held.append((call, returned, copy.deepcopy(returned)))


def random_actions(env: Any, rng: np.random.Generator) -> Any:
    """Random actions, allowed by ``action_masks()`` where the environment has them."""
    space, masks = env.single_action_space, getattr(env, "action_masks", None)
    if masks is None or not isinstance(space, (spaces.Discrete, spaces.MultiDiscrete)):
        return env.action_space.sample()
    allowed = np.asarray(masks())  # (env, actions), for MultiDiscrete one component after the other
    return most_wanted(env, np.where(allowed, rng.random(allowed.shape), -1.0))


def most_wanted(env: Any, wish: Array) -> Any:
    """The preferred action of each environment, (env, actions) as of a mask."""
    space = env.single_action_space
    sizes = np.atleast_1d(space.n if isinstance(space, spaces.Discrete) else space.nvec)
    parts = np.split(wish, np.cumsum(sizes)[:-1], axis=1)
    chosen = np.stack([part.argmax(axis=1) for part in parts], axis=1).astype(env.action_space.dtype)
    return chosen[:, 0] + space.start if isinstance(space, spaces.Discrete) else chosen


def _overwrite(returned: Any) -> None:
    """Write other values into every array of numbers or flags in a return value."""
    if isinstance(returned, dict):
        _overwrite(list(returned.values()))
    elif isinstance(returned, (tuple, list)):
        for part in returned:
            _overwrite(part)
    elif isinstance(returned, np.ndarray) and returned.dtype == object:
        _overwrite(returned.ravel().tolist())
    elif isinstance(returned, np.ndarray) and returned.flags.writeable and returned.dtype.kind in "biufc":
        returned[...] = ~returned if returned.dtype.kind == "b" else 77
