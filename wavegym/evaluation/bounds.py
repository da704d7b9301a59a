"""Lower bounds of the cost: the optimum where it can be certified, and else a limit that is lifted."""

from __future__ import annotations

from typing import Any, NamedTuple

from wavegym.core.arrays import Array
from wavegym.evaluation.comparison import compare

FREE_ENERGY = 2.0  # longest pulses of one radar in a step: what two radars can spend


class Bound(NamedTuple):
    """A play that no policy of the environment can be cheaper than, in the same world."""

    policy: str
    lifted: dict[str, Any]  # parameters that lift a limit


# With free energy the longest pulses of both radars are the best: they have the highest SNR and the finest range-rate.
BOUNDS = {
    "wavegym/KershawEvans-v0": Bound("optimum", {}),
    "wavegym/KershawEvansPosition-v0": Bound("optimum", {}),
    "wavegym/EnergyBudget-v0": Bound("fixed:9", {"budget": FREE_ENERGY}),
    "wavegym/EnergyBudgetKnown-v0": Bound("fixed:9", {"budget": FREE_ENERGY}),
}


def lower_bound(env_id: str, **common: Any) -> Array | None:
    """Mean cost per step, (world,), below which no policy is expected; None where no bound is known.

    In KershawEvans and KershawEvansPosition it is the clairvoyant optimum, certified to a thousandth. In EnergyBudget
    and EnergyBudgetKnown the account never runs out: no policy can do better on average, but one may in a single world,
    because clutter is random.

    Args:
        env_id: a full id.
        **common: number of worlds, root, jobs and the like, as for ``compare``.
    """
    if env_id not in BOUNDS:
        return None
    policy, lifted = BOUNDS[env_id]
    played = compare(env_id, {policy: None}, **common, **lifted)
    return played.cost(policy)[0]
