"""One network that scores every candidate with the same weights.

A candidate has the features h = s(A f + B c + e), with the activation s: tanh in PPO, ReLU in DQN. f are its forecasts
(``observations.forecasts``) and the observed elements of its targets (shortcut ``target_of_action``), c is a summary of
the whole observation, and e is a learned offset of the candidate. In each round the candidates exchange information:
h + s(M h + N m), where m are the means and maxima over all h (deep sets: Zaheer et al., 2017). A score is w'h.

If candidates are tracks in slots, all slots are alike: h = s(A f + b) with the forecasts alone, and free slots do
not count in m. Such a network plays with any number of slots. An MLP has to learn the same function once for each
candidate; a scorer learns it once for all.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import torch
from gymnasium import spaces
from sb3_contrib.common.maskable.policies import MaskableActorCriticPolicy
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.dqn.policies import DQNPolicy, QNetwork
from torch import Tensor, nn

from wavegym.core import shortcuts
from wavegym.core.errors import InputError
from wavegym.core.system import System
from wavegym.core.traits import TrackSlots
from wavegym.learning.pooling_kernels import share_gradient
from wavegym.observations.forecasts import PRESENT
from wavegym.observations.shortlist import SEVERAL

FAR_BELOW = -1e9  # added to features of candidates that do not count, before a maximum


class Layout(NamedTuple):
    """The layout of an observation: the system's own elements, then the forecasts of each candidate in turn.

    Attributes:
        elements: number of the system's own elements.
        candidates: number of candidates.
        figures: number of forecasts of one candidate.
        pairs: indices of the elements that describe a candidate's targets, (candidate, element); rows may be empty.
        alike: whether candidates differ in their forecasts only, so that there is neither context nor offset.
    """

    elements: int
    candidates: int
    figures: int
    pairs: tuple[tuple[int, ...], ...]
    alike: bool = False

    @classmethod
    def of(cls, observation: spaces.Box, actions: spaces.Discrete, system: System) -> Layout:
        """The layout in an environment of a system."""
        own, count = len(system.observation_fields), int(actions.n)
        is_listed = isinstance(system.actions, SEVERAL) or count < len(system.candidates())
        of_targets = ((),) * count if is_listed else pairs(system)
        return cls(own, count, (observation.shape[0] - own) // count, of_targets, isinstance(system, TrackSlots))

    @classmethod
    def of_environments(cls, envs: Any) -> Layout:
        """The layout in an ``SB3VecEnv`` with ``forecasts=True`` or ``candidates=K``.

        Raises:
            InputError: without them, or with actions that are no single index.
        """
        (system, *_), shown, actions = envs.get_attr("system"), envs.observation_space, envs.action_space
        forecasts = shown.shape[0] - len(system.observation_fields)
        if not isinstance(actions, spaces.Discrete) or forecasts <= 0 or forecasts % actions.n:
            wanted = "an SB3VecEnv with one index and forecasts of each choice (nearest: candidates=32)"
            raise InputError(f"a scorer was given {actions} and {shown.shape[0]} elements, expected {wanted}")
        return cls.of(shown, actions, system)

    @classmethod
    def fitting(cls, layout: Any, observation: spaces.Space[Any], actions: spaces.Space[Any]) -> Layout:
        """The ``layout`` of a policy's settings.

        Raises:
            InputError: there is none, or that of other observations or actions.
        """
        wanted = "policy_kwargs={'layout': Layout.of_environments(envs)} with its environments"
        if layout is None:
            raise InputError(f"a scorer was given no layout, expected {wanted}")
        found = cls(*layout)
        elements = found.elements + found.candidates * found.figures
        if observation.shape != (elements,) or getattr(actions, "n", None) != found.candidates:
            given = f"the layout of {elements} elements and {found.candidates} choices for {observation} and {actions}"
            raise InputError(f"a scorer was given {given}, expected {wanted}")
        return found


def pairs(system: System) -> tuple[tuple[int, ...], ...]:
    """Indices of the elements that describe each candidate's targets: names that end with the target's number from 1.

    A second number is that of a sensor, as in ``snr_2_1``.
    """
    aimed = shortcuts.target_of_action.of(system)
    if aimed is None:
        return ((),) * len(system.candidates())
    of_target: dict[int, list[int]] = {}
    for n, element in enumerate(system.observation_fields):
        if named := re.fullmatch(r".*?_(\d+)(_\d+)?", element.name):
            of_target.setdefault(int(named[1]) - 1, []).append(n)
    return tuple(
        tuple(n for target in target_of_action for n in of_target[target]) for target_of_action in aimed().tolist()
    )


class Trunk(nn.Module):
    """Features (env, candidate, width) of each candidate, from observations with the given ``Layout``."""

    def __init__(self, layout: Layout, width: int, activation: type[nn.Module]) -> None:
        super().__init__()
        self.layout, self.activation = layout, activation()
        if layout.alike:
            self.own: nn.Linear | None = nn.Linear(layout.figures, width)
            return
        self.context = nn.Sequential(*_layers((layout.elements, width, width), activation))
        self.shared = nn.Linear(width, width)
        self.register_buffer("pairs", torch.tensor(layout.pairs, dtype=torch.int64))
        inputs = layout.figures + len(layout.pairs[0])
        self.own = nn.Linear(inputs, width, bias=False) if inputs else None
        self.offset = nn.Parameter(torch.zeros(layout.candidates, width))

    def forward(self, observation: Tensor) -> Tensor:
        """See above."""
        if self.own is not None and self.layout.alike:
            return self.activation(self.own(self._forecasts(observation)))
        hidden = self.shared(self.context(observation[:, : self.layout.elements]))[:, None] + self.offset
        if self.own is not None:
            of_pairs: Any = self.pairs
            hidden = hidden + self.own(torch.cat([self._forecasts(observation), observation[:, of_pairs]], dim=2))
        return self.activation(hidden)

    def present(self, observation: Tensor) -> Tensor | None:
        """1 or 0 for each candidate (env, candidate, 1): whether it counts among the others; None: all count."""
        if not self.layout.alike:
            return None
        return self._forecasts(observation)[..., PRESENT].sum(dim=2, keepdim=True)

    def _forecasts(self, observation: Tensor) -> Tensor:
        """(env, candidate, figure)."""
        elements, candidates, figures = self.layout[:3]
        return observation[:, elements:].unflatten(1, (candidates, figures))


class Exchange(nn.Module):
    """A round in which candidates exchange information; a residual connection if input and output widths are equal."""

    def __init__(self, inputs: int, width: int, activation: type[nn.Module]) -> None:
        super().__init__()
        self.own, self.others = nn.Linear(inputs, width), nn.Linear(2 * inputs, width, bias=False)
        self.activation = activation()

    def forward(self, hidden: Tensor, present: Tensor | None) -> Tensor:
        """Features (env, candidate, width) from features (env, candidate, inputs)."""
        exchanged = self.activation(self.own(hidden) + self.others(pooled(hidden, present))[:, None])
        return hidden + exchanged if exchanged.shape == hidden.shape else exchanged


class Scorer(nn.Module):
    """Scores (env, candidate) of observations (env, elements + candidates * figures).

    Args:
        layout: of the observations.
        widths: of the trunk and of each round after the trunk.
        activation: of all layers.
    """

    def __init__(self, layout: Layout, widths: Sequence[int], activation: type[nn.Module]) -> None:
        super().__init__()
        self.trunk = Trunk(layout, widths[0], activation)
        self.rounds = nn.ModuleList(Exchange(*pair, activation) for pair in pairwise(widths))
        self.score = nn.Linear(widths[-1], 1, bias=False)

    def forward(self, observation: Tensor) -> Tensor:
        """See above."""
        hidden, present = self.trunk(observation), self.trunk.present(observation)
        for exchange in self.rounds:
            hidden = exchange(hidden, present)
        return self.score(hidden)[..., 0]


class Critic(nn.Module):
    """Features (env, width) of the state, pooled over all candidates."""

    def __init__(self, layout: Layout, width: int, activation: type[nn.Module]) -> None:
        super().__init__()
        self.trunk = Trunk(layout, width, activation)
        self.summary = nn.Sequential(*_layers((2 * width, width), activation))

    def forward(self, observation: Tensor) -> Tensor:
        """See above."""
        return self.summary(pooled(self.trunk(observation), self.trunk.present(observation)))


def pooled(hidden: Tensor, present: Tensor | None) -> Tensor:
    """Means and maxima (env, 2 * width) of features (env, candidate, width) over the candidates that count."""
    if present is None:
        # The gradient of ``hidden.mean`` has a memory layout that makes all that follows slow.
        return torch.cat([hidden.sum(dim=1) / hidden.shape[1], _greatest(hidden)], dim=1)
    weights = present / present.sum(dim=1, keepdim=True)
    mean = torch.bmm(weights.transpose(1, 2), hidden)[:, 0]
    return torch.cat([mean, (hidden + FAR_BELOW * (1.0 - present)).max(dim=1).values], dim=1)


def _greatest(hidden: Tensor) -> Any:
    """(env, width) from (env, candidate, width)."""
    return _Greatest.apply(hidden) if hidden.device.type == "cpu" else hidden.amax(dim=1)


class _Greatest(torch.autograd.Function):
    """``hidden.amax(dim=1)`` with a faster gradient of the same bits, on the processor."""

    @staticmethod
    def forward(context: Any, hidden: Tensor) -> Tensor:
        """(env, width) from (env, candidate, width)."""
        greatest = hidden.amax(dim=1)
        context.save_for_backward(hidden, greatest)
        return greatest

    @staticmethod
    def backward(context: Any, *above: Any) -> Tensor:
        """From the gradient of the result."""
        hidden, greatest = context.saved_tensors
        out = torch.empty(hidden.shape)
        given = (tensor.detach().contiguous().numpy() for tensor in (hidden, greatest, above[0]))
        share_gradient(*given, out.numpy())
        return out


class ActorAndCritic(nn.Module):
    """An extractor as Stable-Baselines3 calls it: the actor's scores and the critic's hidden layers."""

    def __init__(self, layout: Layout, widths: Sequence[int], activation: type[nn.Module]) -> None:
        super().__init__()
        self.latent_dim_pi, self.latent_dim_vf = layout.candidates, widths[0]
        self.policy_net, self.value_net = Scorer(layout, widths, activation), Critic(layout, widths[0], activation)

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Scores and the critic's last hidden layer."""
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: Tensor) -> Tensor:
        """(env, candidate)."""
        return self.policy_net(features)

    def forward_critic(self, features: Tensor) -> Tensor:
        """(env, width)."""
        return self.value_net(features)


class _Scoring:
    """Replaces the MLP by the scorer; the scores are the logits, without a further layer.

    Args:
        layout: of the observation, ``policy_kwargs={"layout": Layout.of_environments(envs)}``.
        net_arch: widths of the trunk and of each round after it.

    Raises:
        InputError: see ``Layout.fitting``.
    """

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        action_space: spaces.Space[Any],
        *args: Any,
        layout: Layout | None = None,
        net_arch: Sequence[int] = (64, 64),
        **settings: Any,
    ) -> None:
        self.layout = Layout.fitting(layout, observation_space, action_space)
        super().__init__(observation_space, action_space, *args, net_arch=list(net_arch), **settings)  # type: ignore[call-arg]

    def _build_mlp_extractor(self) -> None:
        own: Any = self
        own.mlp_extractor = ActorAndCritic(self.layout, own.net_arch, own.activation_fn)

    def _build(self, lr_schedule: Callable[[float], float]) -> None:
        own: Any = self
        super()._build(lr_schedule)  # type: ignore[misc]
        own.action_net = nn.Identity()
        nn.init.orthogonal_(own.mlp_extractor.policy_net.score.weight, 0.01)
        own.optimizer = own.optimizer_class(own.parameters(), lr=lr_schedule(1), **own.optimizer_kwargs)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return {**super()._get_constructor_parameters(), "layout": tuple(self.layout)}  # type: ignore[misc]


class ScorerPolicy(_Scoring, ActorCriticPolicy):
    """For PPO."""


class MaskableScorerPolicy(_Scoring, MaskableActorCriticPolicy):
    """For MaskablePPO."""


class Dueling(nn.Module):
    """Q = V + scores - mean of the scores (Wang et al., 2016)."""

    def __init__(self, layout: Layout, widths: Sequence[int], activation: type[nn.Module]) -> None:
        super().__init__()
        self.scorer = Scorer(layout, widths, activation)
        self.value = nn.Sequential(Critic(layout, widths[0], activation), nn.Linear(widths[0], 1))

    def forward(self, observation: Tensor) -> Tensor:
        """(env, candidate)."""
        scores = self.scorer(observation)
        return self.value(observation) + scores - scores.mean(dim=1, keepdim=True)


class ScorerQNetwork(QNetwork):
    """DQN's network with a scorer instead of an MLP."""

    def __init__(self, *args: Any, layout: Layout, **settings: Any) -> None:
        super().__init__(*args, **settings)
        self.layout = Layout(*layout)
        self.q_net: Any = Dueling(self.layout, self.net_arch, self.activation_fn)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return {**super()._get_constructor_parameters(), "layout": tuple(self.layout)}


class ScorerDQNPolicy(DQNPolicy):
    """For DQN."""

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        action_space: spaces.Discrete,
        *args: Any,
        layout: Layout | None = None,
        **settings: Any,
    ) -> None:
        self.layout = Layout.fitting(layout, observation_space, action_space)
        super().__init__(observation_space, action_space, *args, **settings)

    def make_q_net(self) -> QNetwork:
        """A Q network; Stable-Baselines3 makes two, the online and the target network."""
        settings = self._update_features_extractor(self.net_args, features_extractor=None)
        return ScorerQNetwork(**settings, layout=self.layout).to(self.device)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return {**super()._get_constructor_parameters(), "layout": tuple(self.layout)}


def _layers(widths: tuple[int, ...], activation: type[nn.Module]) -> list[nn.Module]:
    """Linear layers, each followed by the activation."""
    layers: list[nn.Module] = []
    for inputs, outputs in pairwise(widths):
        layers += [nn.Linear(inputs, outputs), activation()]
    return layers
