"""Lower bounds: the optimum's are below every scheduler in each world, those of a lifted limit below on average."""

from __future__ import annotations

import numpy as np
import pytest

from wavegym.evaluation import compare
from wavegym.evaluation.submission import BOUNDS, lower_bound


@pytest.mark.slow
@pytest.mark.parametrize("env_id", ["wavegym/KershawEvans-v0", "wavegym/KershawEvansPosition-v0"])
def test_no_scheduler_is_below_the_optimum_in_any_world(env_id: str) -> None:
    bound = lower_bound(env_id, seed=3, worlds=10, jobs=1, progress=False)
    played = compare(env_id, dict.fromkeys(("best-simple", "lookahead:2")), worlds=10, seed=3, jobs=1, progress=False)
    assert bound is not None
    for name in played.played:
        assert np.all(bound <= played.cost(name)[0] * (1.0 + 1e-3)), "certified to a thousandth"


@pytest.mark.slow
@pytest.mark.parametrize("env_id", ["wavegym/EnergyBudget-v0", "wavegym/EnergyBudgetKnown-v0"])
def test_free_energy_is_a_bound_on_average_and_its_choice_the_best(env_id: str) -> None:
    common = {"worlds": 40, "seed": 3, "jobs": 1, "progress": False}
    bound = lower_bound(env_id, **common)  # type: ignore[arg-type]
    simple = compare(env_id, {"best-simple": None}, **common).cost("best-simple")[0]  # type: ignore[arg-type]
    assert bound is not None
    gain = np.log(simple / bound)
    assert gain.mean() > 2.0 * gain.std() / np.sqrt(len(gain))
    policy, lifted = BOUNDS[env_id]
    others = dict.fromkeys(f"fixed:{index}" for index in range(10))
    free = compare(env_id, others, **common, **lifted)  # type: ignore[arg-type]
    costs = {name: np.log(free.cost(name)).mean() for name in others}
    assert min(costs, key=lambda name: costs[name]) == policy


def test_most_environments_have_no_bound() -> None:
    assert lower_bound("wavegym/CameraSlew-v0", seed=0, worlds=2, jobs=1, progress=False) is None
