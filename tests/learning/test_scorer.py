"""Pooling over candidates against PyTorch's own mean and maximum, bit for bit."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from wavegym.learning.scorer import pooled


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
