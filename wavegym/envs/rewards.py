"""Rewards of environments, by name or as an object: minus the cost by default, others for training.

The reported cost (``info["cost"]``) is that of the system, for every reward. A reward keeps no state: ``begin`` makes
its memory of a world, and the environment keeps this memory and passes it to the reward at every step.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_choice, check_positive
from wavegym.core.policy import Policy
from wavegym.core.registry import Registry
from wavegym.core.shortcuts import cost_to_come
from wavegym.core.system import State, System
from wavegym.core.traits import UnequalSteps
from wavegym.schedulers import Myopic, rollout
from wavegym.schedulers.heuristics.grids import HEURISTICS
from wavegym.schedulers.registry import check_not_renamed
from wavegym.schedulers.tuned_constants import SIMPLE, record_key, recorded, records, tuned_heuristic


class Transition(NamedTuple):
    """One step of a batch, as rewards see it."""

    system: System
    previous: State
    action: Array  # (env, ...)
    following: State
    cost: Array  # (env,) of the following state
    memory: Any  # the result of ``begin`` for these worlds


class Reward(Protocol):
    """Scores transitions."""

    def begin(self, system: System, world: Any) -> Any:
        """The memory of these worlds: a NamedTuple of arrays with axis 0 = environment, or None."""

    def __call__(self, transition: Transition) -> tuple[Array, dict[str, Array]]:
        """Rewards (env,) float64, and terms for info by name, each (env,)."""


class Cost:
    """Minus the cost of the system, exactly: -trace(Lambda P) if no track can be lost."""

    def begin(self, system: System, world: Any) -> None:
        """Nothing to remember."""

    def __call__(self, transition: Transition) -> tuple[Array, dict[str, Array]]:
        """See ``Reward``."""
        return -transition.cost, {}


class Scaled(Cost):
    """Minus the cost divided by one number, so that policies keep their order and rewards are of the order of -1.

    Args:
        scale: > 0; by default that of the system's class: see ``scale_of``.

    Raises:
        InputError: a number out of range.
    """

    def __init__(self, scale: float | None = None) -> None:
        self.scale = None if scale is None else check_positive("scale", scale)

    def begin(self, system: System, world: Any) -> None:
        """Nothing to remember. Raises an InputError where a scale is neither given nor recorded."""
        self._scale(system)

    def __call__(self, transition: Transition) -> tuple[Array, dict[str, Array]]:
        """See ``Reward``."""
        return -transition.cost / self._scale(transition.system), {}

    def _scale(self, system: System) -> float:
        return self.scale or scale_of(system)


def scale_of(system: System) -> float:
    """The cost of the one-step scheduler on tuning worlds (geometric mean), with the default parameters of the class.

    One number for a class and those derived from it, whatever the parameters, so that rewards can be compared.

    Raises:
        InputError: no class of the system's has such a record.
    """
    for kind in type(system).__mro__:
        if cost := records().get(record_key(kind), {}).get("costs", {}).get("myopic"):
            return float(cost)
    wanted = f"'cost' (nearest), or wavegym.envs.rewards.Scaled(number): {type(system).__name__} has no cost on record"
    raise InputError(f"reward is 'scaled', expected {wanted}")


class CostInTargets(Cost):
    """Minus the cost divided by c0, in seconds of one unseen target. For systems with a parameter ``c0``."""

    def begin(self, system: System, world: Any) -> None:
        """Nothing to remember. Raises an InputError where the system has no c0."""
        if not hasattr(system, "c0"):
            wanted = f"'cost' (nearest): {type(system).__name__} has no parameter c0"
            raise InputError(f"reward is 'cost-in-targets', expected {wanted}")

    def __call__(self, transition: Transition) -> tuple[Array, dict[str, Array]]:
        """See ``Reward``."""
        system: Any = transition.system
        return -transition.cost / system.c0, {}


class ShapedCost(Cost):
    """Minus the cost divided by c0, and minus the change of the cost to come.

    This is potential-based shaping (Ng, Harada and Russell, 1999): a dwell is credited with the predicted cost it
    saves, a find with that of all the time until the target would have been found anyway. So an agent need not find its
    effect among those of the next hundred dwells. The sum over an episode is that of "cost-in-targets", except for the
    two ends.
    """

    SECONDS = 0.7  # a usual time between two updates of a track

    def begin(self, system: System, world: Any) -> None:
        """Nothing to remember. Raises an InputError where the system has no ``cost_to_come``."""
        if why := cost_to_come.why_not(system):
            raise InputError(f"reward is 'shaped-cost', expected 'cost' (nearest): of {type(system).__name__}, {why}")

    def __call__(self, transition: Transition) -> tuple[Array, dict[str, Array]]:
        """See ``Reward``."""
        system: Any = transition.system
        before, after = (
            cost_to_come(system, state.belief, self.SECONDS) for state in (transition.previous, transition.following)
        )
        return (before - after - transition.cost) / system.c0, {}


class LogCost(Cost):
    """Minus the logarithm of the cost: for costs that span decades."""

    def __call__(self, transition: Transition) -> tuple[Array, dict[str, Array]]:
        """See ``Reward``."""
        return -np.log(transition.cost), {}


class Trace(Cost):
    """-trace(Lambda P) summed over the targets, also in a system with another cost."""

    def __call__(self, transition: Transition) -> tuple[Array, dict[str, Array]]:
        """See ``Reward``."""
        return -transition.system.trace(transition.following.belief), {}


class TrueError(Cost):
    """Minus the squared true position error in m^2, summed over targets (an absent target's error is 0).

    The cost is an estimate of this error; the reward reads the truth.
    """

    def begin(self, system: System, world: Any) -> None:
        """Nothing to remember. Raises an InputError where the system has no such metric."""
        _check_metric("error", "position_error", system, world)

    def __call__(self, transition: Transition) -> tuple[Array, dict[str, Array]]:
        """See ``Reward``."""
        error = transition.system.state_info(transition.following)["position_error"]
        if error.ndim == 1:
            return -error * error, {}
        return -(error * error).reshape(len(error), -1).sum(axis=1), {}


class SquaredGospa(Cost):
    """Minus the squared GOSPA distance in m^2 (order 2, alpha = 2): position errors, missed targets and false tracks.

    The mean square GOSPA is a cost of sensor management in Garcia-Fernandez, Hernandez and Maskell, *An analysis on
    metric-driven multi-target sensor management: GOSPA versus OSPA* (2021).
    """

    def begin(self, system: System, world: Any) -> None:
        """Nothing to remember. Raises an InputError where the system has no such metric."""
        _check_metric("gospa", "gospa", system, world)

    def __call__(self, transition: Transition) -> tuple[Array, dict[str, Array]]:
        """See ``Reward``."""
        return -np.square(transition.system.state_info(transition.following)["gospa"]), {}


def _check_metric(reward: str, metric: str, system: System, world: Any) -> None:
    metrics = system.state_info(system.initial(world))
    if metric not in metrics:
        wanted = f"a system with the metric {metric!r}, which {type(system).__name__} lacks"
        nearest = "error" if "position_error" in metrics else "cost"
        raise InputError(f"reward is {reward!r}, expected {wanted} (nearest: {nearest!r})")


class ReferenceCosts(NamedTuple):
    """The reference policy's own trajectory on each world."""

    cost: Array  # (env, H); the last cost is repeated after an early end
    mean: Array  # (env,) over the steps played


class Relative:
    """Gain over a reference policy on the same world and draws, step by step.

    The reference plays its own trajectory. A one-step regret from the agent's state would make the myopic choice
    optimal by construction. After the end of the reference's episode its last cost counts.

    Args:
        reference: the policy to compare with, or the name of a heuristic whose constants are recorded for the system,
            such as "best-simple"; the one-step scheduler by default.
        form: "share" 1 - cost/reference, "log" ln(reference/cost), "difference" (reference - cost)/mean reference, or
            "scaled" 1 - cost/mean reference. The sums of the last two rank policies exactly as the cost does; "scaled"
            does not vary with the reference's single steps, which a critic cannot observe.
    """

    def __init__(
        self,
        reference: Policy | str | None = None,
        form: Literal["share", "log", "difference", "scaled"] = "difference",
    ) -> None:
        self.reference = reference or Myopic()
        if isinstance(reference, str):
            check_not_renamed("reference policy", reference)
            check_choice("reference policy", reference, [SIMPLE, *HEURISTICS])
        self.form = check_choice("form", form, ["share", "log", "difference", "scaled"])

    def begin(self, system: System, world: Any) -> ReferenceCosts:
        """Play the reference on these worlds.

        Nothing is tuned here: agents trained on differently tuned rewards could not be compared.

        Raises:
            InputError: a heuristic without recorded constants; or steps of different length, after which the times of
                agent and reference differ.
        """
        reference = self.reference
        if isinstance(system, UnequalSteps):
            raise InputError("reward is relative, expected 'cost' (nearest): the steps differ in length")
        if isinstance(reference, str):
            if reference not in recorded(system):
                wanted = "a system at its defaults with such a record (nearest: reward='relative')"
                raise InputError(f"reward is relative to {reference!r}, expected {wanted}")
            reference = tuned_heuristic(reference, system, None)
        played = rollout(system, reference, world)
        step = np.minimum(np.arange(system.horizon), played.steps[:, None] - 1)
        return ReferenceCosts(np.take_along_axis(played.cost, step, axis=1), played.mean_cost)

    def __call__(self, transition: Transition) -> tuple[Array, dict[str, Array]]:
        """See ``Reward``."""
        memory, cost = transition.memory, transition.cost
        step = transition.previous.belief.step
        reference = memory.cost[np.arange(len(step)), step]
        if self.form == "log":
            reward = np.log(reference / cost)
        elif self.form == "share":
            reward = 1.0 - cost / reference
        elif self.form == "scaled":
            reward = 1.0 - cost / memory.mean
        else:
            reward = (reference - cost) / memory.mean
        return reward, {"reference_cost": reference}


RELATIVE = {
    "relative": "difference",
    "relative-log": "log",
    "relative-share": "share",
    "relative-scaled": "scaled",
}
OWN: dict[str, Callable[[], Reward]] = {
    "cost": Cost,
    "cost-in-targets": CostInTargets,
    "shaped-cost": ShapedCost,
    "log-cost": LogCost,
    "scaled": Scaled,
    "trace": Trace,
    "error": TrueError,
    "gospa": SquaredGospa,
    **{name: partial(Relative, form=form) for name, form in RELATIVE.items()},  # type: ignore[arg-type]
}
REWARDS: Registry[Callable[[], Reward]] = Registry("reward", OWN)


def make_reward(reward: str | Reward) -> Reward:
    """A reward by name, or ``reward`` itself; relative rewards may name a heuristic: "relative-log:best-simple".

    Raises:
        InputError: an unknown name (nearest named), or an object without ``begin`` and ``__call__``.
    """
    if isinstance(reward, str):
        family, _, reference = reward.partition(":")
        if reference and family in RELATIVE:
            return Relative(reference, RELATIVE[family])  # type: ignore[arg-type]
    made: Any = REWARDS.get(reward)() if isinstance(reward, str) else reward
    if callable(made) and hasattr(made, "begin") and not isinstance(made, type):
        return made
    if isinstance(reward, str):
        complaint = f"reward {reward!r} is registered as a maker of {made!r}, expected one of an object"
    else:
        complaint = f"reward is {reward!r}, expected one of {', '.join(REWARDS.names())} or an object"
    raise InputError(f"{complaint} with begin and __call__")
