"""The scorer: pooling over candidates against PyTorch's own mean and maximum, bit for bit, and its layouts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.env_util import make_vec_env
from torch import Tensor

from wavegym.core.errors import InputError
from wavegym.envs.sb3 import SB3VecEnv
from wavegym.learning.scorer import Layout, ScorerDQNPolicy, ScorerPolicy, pooled


def by_pytorch(hidden: Tensor) -> Tensor:
    return torch.cat([hidden.mean(dim=1), hidden.amax(dim=1)], dim=1)


def values_and_gradients(pool: Callable[[Tensor], Tensor], given: Tensor, above: Tensor) -> list[bytes]:
    """As bytes, so that zeros of another sign differ; the features are used as in a round of exchange."""
    features = given.clone().requires_grad_()
    hidden = features * 1.0
    out = pool(hidden)
    ((hidden.tanh() + out[:, None, : given.shape[2]]).sum() + (out * above).sum()).backward()
    assert features.grad is not None
    return [out.detach().numpy().tobytes(), features.grad.numpy().tobytes()]


@pytest.mark.parametrize("shape", [(1, 1, 1), (5, 7, 3), (33, 4, 64), (16, 36, 20)])
@pytest.mark.parametrize("step", [1e-9, 0.5, 4.0])
def test_pooling_equals_that_of_pytorch(shape: tuple[int, int, int], step: float) -> None:
    """With a coarse step many candidates are equally good, zeros of both signs among them."""
    generator = torch.Generator().manual_seed(1)
    hidden = torch.round(torch.randn(shape, generator=generator) / step) * step
    above = torch.randn(shape[0], 2 * shape[2], generator=generator)
    ours = values_and_gradients(lambda each: pooled(each, None), hidden, above)
    assert ours == values_and_gradients(by_pytorch, hidden, above)


def test_a_gradient_at_nan_is_nan() -> None:
    hidden = torch.tensor([[[torch.nan], [1.0]]]).requires_grad_()
    pooled(hidden, None).sum().backward()
    assert hidden.grad is not None
    assert hidden.grad.isnan().all()


def test_pooling_works_on_other_devices() -> None:
    """On the device "meta", whose tensors have no values: like those of a GPU they are no NumPy arrays."""
    hidden = torch.empty((3, 4, 2), device="meta", requires_grad=True)
    pooled(hidden, None).sum().backward()
    assert hidden.grad is not None


@pytest.mark.parametrize("settings", [{}, {"action": "box"}, {"observation": "measurements"}])
def test_environments_without_forecasts_or_an_index_have_no_layout(settings: dict[str, Any]) -> None:
    envs = SB3VecEnv("wavegym/KershawEvans-v0", 2, **settings)
    with pytest.raises(InputError, match=r"expected an SB3VecEnv with one index .*nearest: candidates=32"):
        Layout.of_environments(envs)


def test_single_environments_side_by_side_have_the_layout_of_a_batch() -> None:
    single = make_vec_env("wavegym/RfEo-v0", n_envs=2, env_kwargs={"candidates": 3})
    assert Layout.of_environments(single) == Layout.of_environments(SB3VecEnv("wavegym/RfEo-v0", 2, candidates=3))


@pytest.mark.parametrize(("algorithm", "policy"), [(PPO, ScorerPolicy), (DQN, ScorerDQNPolicy)])
def test_a_scorer_refuses_the_layout_of_another_list(algorithm: Any, policy: Any) -> None:
    few, more = (SB3VecEnv("wavegym/RfEo-v0", 2, candidates=count) for count in (2, 3))
    with pytest.raises(InputError, match="was given no layout, expected policy_kwargs="):
        algorithm(policy, few)
    with pytest.raises(InputError, match=r"was given the layout of .* elements and 3 choices"):
        algorithm(policy, few, policy_kwargs={"layout": Layout.of_environments(more)})
