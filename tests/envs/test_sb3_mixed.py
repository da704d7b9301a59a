"""Vector environments in one batch: each row is that of its own part."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from wavegym.core.errors import InputError
from wavegym.envs.sb3 import SB3VecEnv
from wavegym.envs.sb3_mixed import SB3MixedVecEnv
from wavegym.testing.lockstep import difference

ID = "wavegym/KershawEvansPosition-v0"


def parts() -> list[SB3VecEnv]:
    return [SB3VecEnv(ID, count, horizon=4, q=q) for count, q in ((2, 1.0), (3, 10.0))]


def test_every_step_is_that_of_the_parts() -> None:
    mixed, (few, many) = SB3MixedVecEnv(parts()), parts()
    mixed.seed([3, 4, 5, 6, 7])
    few.seed([3, 4])
    many.seed([5, 6, 7])
    assert difference(mixed.reset(), np.concatenate([few.reset(), many.reset()])) is None
    rng, ended = np.random.default_rng(0), 0
    for _ in range(9):
        actions = rng.integers(mixed.action_space.n, size=5)
        (*rows, infos), first, second = mixed.step(actions), few.step(actions[:2]), many.step(actions[2:])
        for got, a, b in zip(rows, first[:3], second[:3], strict=True):
            assert difference(got, np.concatenate([a, b])) is None
        assert difference(infos, [*first[3], *second[3]]) is None
        assert difference(mixed.reset_infos, [*few.reset_infos, *many.reset_infos]) is None
        ended += rows[2].sum()
    assert ended == 10
    assert (
        difference(mixed.env_method("action_masks"), few.env_method("action_masks") + many.env_method("action_masks"))
        is None
    )
    assert [system.q for system in mixed.get_attr("system")] == [1.0, 1.0, 10.0, 10.0, 10.0]
    assert [system.q for system in mixed.get_attr("system", indices=[0, 4])] == [1.0, 10.0]
    assert mixed.env_is_wrapped(object, indices=3) == [False]


def test_seeds_count_on_over_the_parts() -> None:
    mixed, few = SB3MixedVecEnv(parts()), parts()[1]
    mixed.seed(3)
    few.seed(5)
    assert difference(mixed.reset()[2:], few.reset()) is None
    with pytest.raises(InputError, match="seed has 2 entries, expected 5: one for each environment"):
        mixed.seed([3, 4])


def test_an_attribute_is_set_for_all_or_for_none() -> None:
    mixed = SB3MixedVecEnv(parts())
    mixed.set_attr("mark", 7)
    assert mixed.get_attr("mark") == [7] * 5
    with pytest.raises(InputError, match="mark cannot be set for some environments, expected all"):
        mixed.set_attr("mark", 8, indices=[0, 1])


@pytest.mark.parametrize(
    ("other", "name"), [({"action": "box"}, "action_space"), ({"reward": "cost", "forecasts": True}, "observation")]
)
def test_parts_have_the_same_spaces(other: dict[str, Any], name: str) -> None:
    with pytest.raises(InputError, match=f"{name}.* of part 1 is .*, expected that of part 0"):
        SB3MixedVecEnv([SB3VecEnv(ID, 2), SB3VecEnv(ID, 2, **other)])
