"""Rewards, injected into the environment: the cost by default, training rewards by name or by object.

The reported cost is always trace(Lambda P) (``info["cost"]``); what an agent is trained on may differ. A reward keeps
no state of its own: what it remembers of a world is made by ``begin``, kept by the environment and handed back.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple, Protocol

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_choice
from wavegym.core.policy import Policy
from wavegym.core.system import State, System
from wavegym.schedulers import Myopic, rollout
from wavegym.schedulers.heuristics.registry import HEURISTICS
from wavegym.schedulers.tuned_constants import SIMPLE, recorded, rule


class Transition(NamedTuple):
    """One step of a batch, as rewards see it."""

    system: System
    previous: State
    action: Array  # (env, ...)
    following: State
    cost: Array  # (env,) of the following state
    memory: Any  # what ``begin`` made of the worlds


class Reward(Protocol):
    """Scores transitions."""

    def begin(self, system: System, world: Any) -> Any:
        """What to remember of these worlds: a NamedTuple of arrays with axis 0 = environment, or None."""

    def __call__(self, transition: Transition) -> tuple[Array, dict[str, Array]]:
        """Rewards (env,) float64, and terms to show in info, each (env,)."""


class Cost:
    """-trace(Lambda P), exactly."""

    def begin(self, system: System, world: Any) -> None:
        """Nothing to remember."""

    def __call__(self, transition: Transition) -> tuple[Array, dict[str, Array]]:
        """See ``Reward``."""
        return -transition.cost, {}


class LogCost(Cost):
    """-ln trace(Lambda P): spans decades evenly."""

    def __call__(self, transition: Transition) -> tuple[Array, dict[str, Array]]:
        """See ``Reward``."""
        return -np.log(transition.cost), {}


class TrueError(Cost):
    """Minus the squared true position error in m^2: what the cost estimates; looks at what is hidden.

    Of several targets it is the sum (an absent one's error is 0).
    """

    def begin(self, system: System, world: Any) -> None:
        """Nothing to remember. Raises an InputError where the system has no such metric."""
        metrics = system.state_info(system.initial(world))
        if "position_error" not in metrics:
            wanted = f"a system with the metric 'position_error', which {type(system).__name__} lacks"
            raise InputError(f"reward is 'error', expected {wanted} (nearest: 'trace')")

    def __call__(self, transition: Transition) -> tuple[Array, dict[str, Array]]:
        """See ``Reward``."""
        error = transition.system.state_info(transition.following)["position_error"]
        if error.ndim == 1:
            return -error * error, {}
        return -(error * error).reshape(len(error), -1).sum(axis=1), {}


class ReferenceCosts(NamedTuple):
    """The reference policy's own trajectory on each world."""

    cost: Array  # (env, H), held at the last one after an early end
    mean: Array  # (env,) over the steps played


class Relative:
    """How much better than a reference policy on the same world and draws, step by step.

    The reference is the policy's own trajectory, not the one-step regret from the same state: that would make the
    myopic choice optimal by construction. Where the reference's episode ends before one's own, its last cost stands.

    Args:
        reference: the policy to compare with, or the name of a rule whose constants are recorded for the system, such
            as "best-simple"; the one-step scheduler by default.
        form: "share" 1 - cost/reference, "log" ln(reference/cost), "difference" (reference - cost)/mean reference,
            whose sum ranks policies exactly as the cost does, or "scaled" 1 - cost/mean reference, which does too and
            does not vary with what happened to the reference, of which a critic knows nothing.
    """

    def __init__(
        self,
        reference: Policy | str | None = None,
        form: Literal["share", "log", "difference", "scaled"] = "difference",
    ) -> None:
        self.reference = reference or Myopic()
        if isinstance(reference, str):
            check_choice("reference policy", reference, [SIMPLE, *HEURISTICS])
        self.form = check_choice("form", form, ["share", "log", "difference", "scaled"])

    def begin(self, system: System, world: Any) -> ReferenceCosts:
        """Run the reference on these worlds. Raises an InputError where it is a rule that the system has no record of.

        Nothing is tuned here: a reward that depends on how long somebody tuned is no reward to compare agents by.
        """
        reference = self.reference
        if isinstance(reference, str):
            if reference not in recorded(system):
                wanted = "a system at its defaults with such a record (nearest: reward='relative')"
                raise InputError(f"reward is relative to {reference!r}, expected {wanted}")
            reference = rule(reference, system, None)
        played = rollout(system, reference, world)
        step = np.minimum(np.arange(played.cost.shape[1]), played.steps[:, None] - 1)
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


REWARDS = {"trace": Cost, "log-trace": LogCost, "error": TrueError}
RELATIVE = {
    "relative": "difference",
    "relative-log": "log",
    "relative-share": "share",
    "relative-scaled": "scaled",
}


def make_reward(reward: str | Reward) -> Reward:
    """A reward by name, or the object itself; "relative" and its kin may name a rule: "relative-log:best-simple"."""
    if isinstance(reward, str):
        family, _, rule_name = reward.partition(":")
        if family in RELATIVE:
            return Relative(rule_name or None, RELATIVE[family])  # type: ignore[arg-type]
        return REWARDS[check_choice("reward", reward, [*REWARDS, *RELATIVE])]()
    if not callable(reward) or not hasattr(reward, "begin"):
        names = ", ".join([*REWARDS, *RELATIVE])
        raise InputError(f"reward is {reward!r}, expected one of {names} or an object with begin and __call__")
    return reward
