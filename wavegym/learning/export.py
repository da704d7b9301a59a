"""From Stable-Baselines3's policies to networks in plain NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.policies import BasePolicy
from torch import Tensor, nn

from wavegym.core.arrays import Array
from wavegym.learning.mixture import Mixture
from wavegym.learning.scorer import Dueling, Exchange, Scorer
from wavegym.policies.networks import Network

ACTIVATIONS = {nn.Tanh: "tanh", nn.ReLU: "relu"}


def export(policy: BasePolicy) -> Network:
    """The network that chooses in a policy of PPO, MaskablePPO or DQN, without critic and without a dueling V."""
    chooser: Any = policy
    if hasattr(chooser, "q_net"):
        core = chooser.q_net.q_net
        core, rest = (core.scorer, []) if isinstance(core, Dueling) else (core, [])
    else:
        core, rest = chooser.mlp_extractor.policy_net, [chooser.action_net]
    heads = _heads(policy.action_space)
    if isinstance(core, Scorer):
        return Network("scorer", ACTIVATIONS[type(core.trunk.activation)], heads, _scorer_arrays(core))
    modules, kind = [*core, *rest], "mlp"
    if isinstance(mixture := getattr(policy, "action_dist", None), Mixture):
        heads, kind = (mixture.modes,), "mixture"
    (activation,) = {ACTIVATIONS[type(module)] for module in modules if type(module) in ACTIVATIONS}
    return Network(kind, activation, heads, _linear_arrays(modules))


def _heads(actions: spaces.Space) -> tuple[int, ...]:
    """Number of alternatives of each choice; () for a box."""
    if isinstance(actions, spaces.MultiDiscrete):
        return tuple(actions.nvec.tolist())
    return (int(actions.n),) if isinstance(actions, spaces.Discrete) else ()


def _linear_arrays(modules: Any) -> dict[str, Array]:
    """W0, b0, W1, ... of the linear layers among the modules."""
    linear = [module for module in modules if isinstance(module, nn.Linear)]
    return {
        name: _array(tensor)
        for n, layer in enumerate(linear)
        for name, tensor in ((f"W{n}", layer.weight), (f"b{n}", layer.bias))
    }


def _scorer_arrays(scorer: Scorer) -> dict[str, Array]:
    trunk = scorer.trunk
    own = {} if trunk.own is None else {"own": _array(trunk.own.weight)}
    if trunk.layout.alike:
        assert trunk.own is not None
        first = {**own, "own_bias": _array(trunk.own.bias)}
    else:
        first = {
            **_linear_arrays(trunk.context),
            "shared": _array(trunk.shared.weight),
            "shared_bias": _array(trunk.shared.bias),
            **own,
            "pairs": np.array(trunk.layout.pairs, np.int64),
            "offset": _array(trunk.offset),
        }
    rounds: dict[str, Array] = {}
    for n, layer in enumerate(scorer.rounds):
        assert isinstance(layer, Exchange)
        weights = {"": layer.own.weight, "_bias": layer.own.bias, "_others": layer.others.weight}
        rounds |= {f"round{n}{suffix}": _array(weight) for suffix, weight in weights.items()}
    return {**first, **rounds, "score": _array(scorer.score.weight)}


def _array(tensor: Tensor) -> Array:
    return np.array(tensor.detach().cpu().numpy(), np.float32)
