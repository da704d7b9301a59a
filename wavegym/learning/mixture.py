"""A mixture of Gaussians over a box, for tasks with several good points far apart (Bishop, 1994).

A single Gaussian that imitates a scheduler with two alternating points learns their mean, which is neither point.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from stable_baselines3.common.distributions import DiagGaussianDistribution
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import Tensor, nn
from torch.distributions import Categorical, Independent, MixtureSameFamily, Normal


class Mixture(DiagGaussianDistribution):
    """A mixture of ``modes`` Gaussians with logits as weights; all share the same standard deviations.

    The network's outputs are the logits of the modes (env, mode), then their means (env, mode * parameter).

    Args:
        modes: number of Gaussians.
        parameters: number of parameters of the box.
    """

    mixture: MixtureSameFamily

    def __init__(self, modes: int, parameters: int) -> None:
        super().__init__(parameters)
        self.modes = modes

    def proba_distribution_net(self, latent_dim: int, log_std_init: float = 0.0) -> tuple[nn.Module, nn.Parameter]:
        """The last layer and the logarithms of the standard deviations."""
        outputs = self.modes * (1 + self.action_dim)
        return nn.Linear(latent_dim, outputs), nn.Parameter(torch.full((self.action_dim,), log_std_init))

    def proba_distribution(self, mean_actions: Tensor, log_std: Tensor) -> Mixture:
        """The distribution from the last layer's outputs."""
        logits, means = mean_actions[:, : self.modes], mean_actions[:, self.modes :]
        points = means.reshape(-1, self.modes, self.action_dim)
        gaussians = Independent(Normal(points, log_std.exp()), 1)
        self.mixture = MixtureSameFamily(Categorical(logits=logits), gaussians)
        return self

    def log_prob(self, actions: Tensor) -> Tensor:
        """Log-densities (env,) of actions (env, parameter)."""
        return self.mixture.log_prob(actions)

    def entropy(self) -> None:
        """None: there is no closed form. PPO then estimates the entropy from the actions taken."""
        return

    def sample(self) -> Tensor:
        """Random actions (env, parameter)."""
        return self.mixture.sample()

    def mode(self) -> Tensor:
        """The mean (env, parameter) of the most probable Gaussian."""
        log_weights, points = parts(self)
        return points[torch.arange(len(points)), log_weights.argmax(dim=1)]


def parts(chosen: DiagGaussianDistribution) -> tuple[Tensor, Tensor]:
    """Log-probabilities (env, mode) and means (env, mode, parameter) of the modes.

    A plain Gaussian is a mixture with one mode.
    """
    if isinstance(chosen, Mixture):
        gaussians: Any = chosen.mixture.component_distribution
        choice: Any = chosen.mixture.mixture_distribution
        return choice.logits, gaussians.mean
    means = chosen.distribution.mean
    return torch.zeros(len(means), 1), means[:, None]


class MixturePolicy(ActorCriticPolicy):
    """An MLP with this distribution, for PPO."""

    def __init__(self, *args: Any, modes: int, **settings: Any) -> None:
        self.modes = modes
        super().__init__(*args, **settings)

    def _build(self, lr_schedule: Callable[[float], float]) -> None:
        gaussian: Any = self.action_dist
        self.action_dist = Mixture(self.modes, gaussian.action_dim)
        super()._build(lr_schedule)
        last: Any = self.action_net
        nn.init.uniform_(last.bias[self.modes :], -1.0, 1.0)  # equal modes would stay equal

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return {**super()._get_constructor_parameters(), "modes": self.modes}
