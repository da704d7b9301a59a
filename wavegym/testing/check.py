"""A check for native vector environments: they must behave as Gymnasium's SyncVectorEnv over single environments.

    >>> from wavegym.testing import check_vector_env
    >>> check_vector_env("wavegym/KershawEvansPosition-v0")

It finds these defects:

- a terminal observation or a truncation is lost at an autoreset;
- the other environments lose a step while one is reset;
- ``reset`` removes the reset mask from the caller's options, or ``step`` changes the caller's actions;
- buffers are reused, or returned arrays are the environment's own state;
- the seed has no effect;
- rare observations are outside the space.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import concatenate, create_empty_array, iterate
from gymnasium.wrappers import TimeLimit

from wavegym.core import trees
from wavegym.core.errors import InputError
from wavegym.core.system import System
from wavegym.testing.lockstep import ConformanceError, Lockstep, Makers, difference, most_wanted, random_actions
from wavegym.testing.shortcut_check import shortcut_defect

WORLDS = 3
FEW = 1000  # candidates tried, evenly spaced
__all__ = ["ConformanceError", "check_vector_env"]


MODES = ("NextStep", "SameStep", "Disabled")
SIZES = (1, 3)
SHORT = 4  # max_episode_steps of the truncated episodes
CUT_OFF_STEPS = 24
UNREST = 20  # steps with random partial resets before whole episodes are played
EPISODES = 2  # of every environment
SEEDED, USED = 3, 54321  # environments whose seeds are checked, and a seed from before
MANY, MANY_STEPS = 16, 60  # of the batch whose observations are checked


def prediction_defect(system: System, seed: int = 0) -> str | None:
    """The first defect of ``predict``, ``cost``, ``mask``, ``state_info`` or a shortcut, or None.

    A system without ``predict`` (NotImplementedError) has no planners; this is not a defect.
    """
    generators = [np.random.default_rng([seed, i]) for i in range(WORLDS)]
    state = system.initial(trees.stack([system.draw_world(rng) for rng in generators]))
    for name, figure in system.state_info(state).items():
        if not np.isfinite(figure).all():
            return f"state_info()[{name!r}] is not finite, expected 0 where a target is absent, and the key 'present'"
    belief = state.belief
    before, everything = trees.copied(belief), system.candidates()
    candidates = everything[:: -(-len(everything) // FEW)]
    count = len(candidates)
    forms = {
        "(env,)": (candidates[np.arange(WORLDS) % count], (WORLDS,)),
        "(1, candidate)": (candidates[None], (WORLDS, count)),
        "(env, candidate)": (np.repeat(candidates[None], WORLDS, axis=0), (WORLDS, count)),
    }
    for form, (actions, shape) in forms.items():
        try:
            predicted = system.predict(belief, actions)
        except NotImplementedError:
            break
        defect = _predicted_defect(system, belief, predicted, shape)
        if defect:
            return f"predict() with actions {form}: {defect}"
    if not _same(before, belief):
        return "predict() changed the belief that it was given"
    defect = _mask_defect(system, belief, len(everything))  # before anything plays allowed actions
    return defect or shortcut_defect(system, seed)


def _predicted_defect(system: System, belief: Any, predicted: Any, shape: tuple[int, ...]) -> str | None:
    for name, leaf in predicted._asdict().items():
        if isinstance(leaf, np.ndarray) and leaf.shape[: len(shape)] != shape:
            return f"{name} has shape {leaf.shape}, expected {shape} and its own axes"
    later = belief.step.reshape(-1, *[1] * (len(shape) - 1)) + 1
    if not (predicted.step == later).all():
        return "step is not one later"
    for name in ("cost", "trace"):
        value = np.asarray(getattr(system, name)(predicted))
        if value.shape != shape:
            return f"{name}() returned shape {value.shape}, expected {shape}"
        if not np.isfinite(value).all():
            return f"{name}() is not finite"
    return None


def _mask_defect(system: System, belief: Any, count: int) -> str | None:
    if type(system).mask is System.mask:
        return None
    mask = system.mask(belief)
    if mask.shape != (WORLDS, count) or mask.dtype != np.bool_:
        return f"mask() returned shape {mask.shape} of {mask.dtype}, expected ({WORLDS}, {count}) of bool"
    return None if mask.any(axis=1).all() else "mask() allows nothing"


def _same(a: Any, b: Any) -> bool:
    leaves: list[bool] = []
    trees.tree_map(lambda x, y: leaves.append(np.array_equal(x, y, equal_nan=x.dtype.kind == "f")), a, b)
    return all(leaves)


def check_vector_env(
    env: str | Callable[..., VectorEnv], *, seed: int = 0, max_steps: int = 1000, **settings: Any
) -> None:
    """Compare a native vector environment bit for bit with SyncVectorEnv over single environments.

    The check plays whole episodes with random valid actions in the three autoreset modes, with 1 and 3 environments. It
    also tries integer and list seeds, partial resets, truncation by ``max_episode_steps``, and an unpickled copy that
    continues in mid-episode. Returned values must be finite. Returned arrays must belong to the caller: the check
    overwrites them. Only its seed may decide an environment's episode. A larger batch must stay inside its spaces. If
    the system is a wavegym system, the check also covers ``predict``, ``cost``, ``mask`` and the shortcuts.

    Args:
        env: an id, whose single environments come from ``gym.make``; or a function ``(num_envs=, autoreset_mode=)``
            that makes the vector environment, in which case a batch of one is the single environment. If the function
            also takes ``max_episode_steps``, its truncation is compared with Gymnasium's TimeLimit.
        seed: of resets and actions.
        max_steps: steps after which endless episodes are stopped.
        **settings: settings of the environment, such as a shorter horizon where steps are slow; only with an id.

    Raises:
        ConformanceError: names the first defect, in one line.
        InputError: settings together with a function.
    """
    if settings and not isinstance(env, str):
        raise InputError(f"settings of {env!r} are {settings}, expected none: only an id takes any")
    makers, limits = _by_id(env, settings) if isinstance(env, str) else _by_factory(env)
    _check_system(makers)
    for limit in limits:
        for mode in MODES:
            for num_envs in SIZES:
                pair = Lockstep(makers, num_envs, mode, limit, seed)
                try:
                    _play(pair, np.random.default_rng(seed), CUT_OFF_STEPS if limit else max_steps)
                finally:
                    pair.close()
    for mode in MODES:
        pair = Lockstep(makers, SIZES[-1], mode, limits[0], seed, scribble=True)
        try:
            _play(pair, np.random.default_rng(seed), min(CUT_OFF_STEPS, max_steps))
        except ConformanceError as defect:  # the same run passed above
            raise ConformanceError(f"state exposed, as writing into returned arrays changes it: {defect}") from defect
        finally:
            pair.close()
    _check_seeds(makers, seed)
    _check_spaces(makers, seed, min(max_steps, MANY_STEPS))


def _check_system(makers: Makers) -> None:
    """Check the planning functions of the system, if the environment is wavegym's."""
    try:
        native = makers.native(num_envs=1, autoreset_mode=MODES[0])
    except Exception:  # the comparison with single environments reports this error
        return
    system = getattr(native.unwrapped, "system", None)
    native.close()
    if not isinstance(system, System):
        return
    try:
        defect = prediction_defect(system)
    except Exception as error:
        text = " ".join(str(error).split())
        raise ConformanceError(f"{makers.name}: the system raised {type(error).__name__}: {text}") from error
    if defect:
        raise ConformanceError(f"{makers.name}: {defect}")


def _check_seeds(makers: Makers, seed: int) -> None:
    """The seed of an environment alone decides its episode, not earlier episodes or other environments."""
    first = [seed + k for k in range(SEEDED)]
    reference = _seeded(makers, first, is_used=False)
    for seeds, like in (
        (first, [0, 1, 2]),
        (first[0], [0, 1, 2]),
        (first[1], [1, 2, None]),
        (first[::-1], [2, 1, 0]),
        ([seed + 100, seed + 101, first[2]], [None, None, 2]),
    ):
        for is_used in (False, True):
            found = _seeded(makers, seeds, is_used)
            for i, other in enumerate(like):
                if other is not None and (wrong := difference(found[i], reference[other])):
                    before = "in mid-episode" if is_used else "for the first time"
                    defect = f"seed ignored: after a reset {before} with seed={seeds}, environment {i} shows{wrong}"
                    raise ConformanceError(f"{makers.name}, num_envs={SEEDED}: {defect} as before with its seed")


def _seeded(makers: Makers, seeds: Any, is_used: bool) -> list[list[Any]]:
    """Observations of each environment at a reset and a few steps later; its actions depend on its own masks alone."""
    with _attempt(makers, SEEDED):
        envs = makers.native(num_envs=SEEDED, autoreset_mode="Disabled")
        if is_used:
            envs.reset(seed=USED)
            envs.step(_plain_actions(envs))
        shown = [envs.reset(seed=seeds)[0]]
        is_over = False
        while len(shown) <= SHORT and not is_over:
            observations, _, terminated, truncated, _ = envs.step(_plain_actions(envs))
            shown.append(observations)
            is_over = bool(np.any(terminated | truncated))
        rows = [list(iterate(envs.observation_space, batch)) for batch in shown]
        envs.close()
    return [[row[i] for row in rows] for i in range(SEEDED)]


def _plain_actions(envs: Any) -> Any:
    """One action for all, or the first one that each environment's mask allows."""
    space, masks = envs.single_action_space, getattr(envs, "action_masks", None)
    if masks is not None and isinstance(space, (gym.spaces.Discrete, gym.spaces.MultiDiscrete)):
        return most_wanted(envs, np.asarray(masks()).astype(np.float64))
    space.seed(0)
    room: Any = create_empty_array(space, envs.num_envs)
    return concatenate(space, [space.sample()] * envs.num_envs, room)


def _check_spaces(makers: Makers, seed: int, steps: int) -> None:
    """A larger batch stays inside its space, with finite rewards."""
    where = f"num_envs={MANY}"
    with _attempt(makers, MANY):
        envs, rng = makers.native(num_envs=MANY, autoreset_mode="NextStep"), np.random.default_rng(seed)
        envs.action_space.seed(seed)
        shown, rewards = envs.reset(seed=seed)[0], np.zeros(MANY)
        for step in range(steps):
            if not envs.observation_space.contains(shown):
                raise ConformanceError(
                    f"{makers.name}, {where}, step {step}: observations are outside observation_space"
                )
            if not np.isfinite(rewards).all():
                raise ConformanceError(f"{makers.name}, {where}, step {step}: rewards are not finite")
            shown, rewards, *_ = envs.step(random_actions(envs, rng))
        envs.close()


@contextmanager
def _attempt(makers: Makers, num_envs: int) -> Iterator[None]:
    """Turn any exception of the environment into a one-line defect."""
    try:
        yield
    except ConformanceError:
        raise
    except Exception as error:
        text = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise ConformanceError(f"{makers.name}, num_envs={num_envs}: raised {text}") from error


def _by_id(id: str, settings: dict[str, Any]) -> tuple[Makers, list[dict[str, int]]]:
    native = partial(gym.make_vec, id, vectorization_mode="vector_entry_point", **settings)
    single = partial(gym.make, id, disable_env_checker=True, **settings)
    return Makers(id, native, single), [{"max_episode_steps": SHORT}, {}]


def _by_factory(factory: Callable[..., VectorEnv]) -> tuple[Makers, list[dict[str, int]]]:
    def single(max_episode_steps: int | None = None) -> gym.Env:
        one = Unbatched(factory(num_envs=1, autoreset_mode="Disabled"))
        return TimeLimit(one, max_episode_steps) if max_episode_steps else one

    takes_limit = "max_episode_steps" in inspect.signature(factory).parameters
    name = getattr(factory, "__name__", type(factory).__name__)
    return Makers(name, factory, single), [{"max_episode_steps": SHORT}, {}] if takes_limit else [{}]


def _play(pair: Lockstep, rng: np.random.Generator, steps: int) -> None:
    """Steps with partial resets, then whole episodes, then a full reset with a list of seeds."""
    n = len(pair.ended)
    pair.reset(seed=int(rng.integers(1000)))
    endings = np.zeros(n, np.int64)
    for k in range(steps):
        if pair.mode.value == "Disabled" and pair.ended.any():
            pair.reset(seed=None, mask=pair.ended.copy())
        if k < UNREST and (k == 3 or rng.random() < 0.15):
            mask = rng.random(n) < 0.5
            mask[rng.integers(n)] = True
            seeds: list[int | None] = [int(s) if s < 500 else None for s in rng.integers(1000, size=n)]
            pair.reset(seed=seeds if k % 2 else None, mask=mask)
        if k == UNREST // 2:
            pair.continue_with_pickled_copy()
        pair.step()
        endings += pair.ended
        if k >= UNREST and (endings >= EPISODES).all():
            break
    pair.reset(seed=rng.integers(1000, size=n).tolist())
    for _ in range(SHORT - 1):
        if pair.mode.value == "Disabled" and pair.ended.any():
            break
        pair.step()


class Unbatched(gym.Env):
    """The single environment inside a vector environment of one (autoreset disabled)."""

    def __init__(self, batch: VectorEnv) -> None:
        self.batch: Any = batch
        self.metadata = dict(batch.metadata)
        self.observation_space, self.action_space = batch.single_observation_space, batch.single_action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin a new episode."""
        observations, info = self.batch.reset(seed=None if seed is None else [seed], options=options)
        return self._first(observations), _single_info(info)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One step."""
        room: Any = create_empty_array(self.action_space, 1)
        actions = concatenate(self.action_space, [action], room)
        observations, rewards, terminated, truncated, info = self.batch.step(actions)
        return self._first(observations), rewards[0], bool(terminated[0]), bool(truncated[0]), _single_info(info)

    def close(self) -> None:
        """Close the vector environment."""
        self.batch.close()

    def _first(self, observations: Any) -> Any:
        return next(iter(iterate(self.batch.observation_space, observations)))


def _single_info(info: dict[str, Any]) -> dict[str, Any]:
    """The info of a vector environment's only environment."""
    single: dict[str, Any] = {}
    for key, value in info.items():
        if key.startswith("_") or not info.get(f"_{key}", [True])[0]:
            continue
        if isinstance(value, dict):
            single[key] = _single_info(value)
        else:
            first = value[0]
            single[key] = first.item() if isinstance(first, np.bool_) else first
    return single
