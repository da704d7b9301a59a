"""Off-policy evaluation: policies judged by the episodes of another policy. ``python off_policy_evaluation.py``.

The episodes are those of the one-step scheduler with exploration. The cost of each policy is estimated from these
episodes only, by fitted Q evaluation (a network learns the sum of the costs to come) and by weighted importance
sampling. Then the policies play, and the two rankings are compared.
"""

from __future__ import annotations

import argparse
import tempfile

import numpy as np
import torch
from scipy.stats import spearmanr

from wavegym.evaluation import compare
from wavegym.integrations.minari import collect

POLICIES = ("round-robin", "fixed:0", "best-fixed", "myopic", "lookahead:2", "ppo", "dqn")
SWEEPS, UPDATES, BATCH = 60, 40, 1024


def batch(dataset):
    """Observations (episode, T+1, fields), actions, costs and behaviour probabilities (episode, T); choices by name."""
    episodes = list(dataset.iterate_episodes())
    joined = {
        "observation": np.stack([e.observations for e in episodes]),
        "action": np.stack([e.actions for e in episodes]),
        "cost": np.stack([-e.rewards for e in episodes]),
        "probability": np.stack([e.infos["probability"] for e in episodes]),
    }
    chosen = {name: np.stack([e.infos["would_choose"][name] for e in episodes]) for name in POLICIES}
    return joined, chosen


def fitted_q(data, chosen, actions):
    """The mean cost of a step under a policy: a network of the costs to come, fitted to its own one-step estimates.

    The network learns their logarithm, because costs span decades.
    """
    torch.manual_seed(0)
    horizon = data["action"].shape[1]
    scale = data["cost"].mean() * horizon
    state = torch.as_tensor(data["observation"])
    action = torch.as_tensor(data["action"])
    cost = torch.as_tensor(data["cost"] / scale, dtype=torch.float32)
    wanted = torch.as_tensor(chosen)
    network = torch.nn.Sequential(
        torch.nn.Linear(state.shape[-1], 128), torch.nn.ReLU(), torch.nn.Linear(128, 128), torch.nn.ReLU(),
        torch.nn.Linear(128, actions),
    )  # fmt: skip
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-3)
    for _ in range(SWEEPS):
        with torch.no_grad():
            following = network(state[:, 1:-1]).gather(2, wanted[:, 1:, None]).squeeze(2)
            to_come = cost.clone()
            to_come[:, :-1] += following.exp()
            target = to_come.log()
        for _ in range(UPDATES):
            rows = torch.randint(target.numel(), (BATCH,))
            estimate = network(state[:, :-1].flatten(0, 1)[rows]).gather(1, action.flatten()[rows, None]).squeeze(1)
            loss = torch.nn.functional.smooth_l1_loss(estimate, target.flatten()[rows])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
    with torch.no_grad():
        first = network(state[:, 0]).gather(1, wanted[:, 0, None])
    return float(first.exp().mean() * scale / horizon)


def importance_sampling(data, chosen):
    """The mean cost of a step, weighted by the products of probability ratios, and the least effective sample size."""
    ratio = np.where(chosen == data["action"], 1.0 / data["probability"], 0.0).cumprod(axis=1)
    total = ratio.sum(axis=0)
    weight = np.divide(ratio, total, out=np.zeros_like(ratio), where=total > 0)
    effective = np.divide(1.0, np.square(weight).sum(axis=0), out=np.zeros(len(total)), where=total > 0)
    return (float((weight * data["cost"]).sum(axis=0).mean()) if (total > 0).all() else np.nan), float(effective.min())


def main():
    """The command."""
    parser = argparse.ArgumentParser(description="Off-policy evaluation")
    parser.add_argument("--env", default="wavegym/KershawEvansPosition-v0")
    parser.add_argument("--episodes", type=int, default=400)
    parser.add_argument("--exploration", type=float, default=0.5)
    parser.add_argument("--worlds", type=int, default=200)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        dataset = collect(
            options.env, "myopic", options.episodes, out=folder,
            exploration=options.exploration, would_choose=POLICIES,
        )  # fmt: skip
        data, chosen = batch(dataset)
        actions = int(dataset.action_space.n)
    played = compare(options.env, dict.fromkeys(POLICIES), worlds=options.worlds, jobs=1)
    true = [float(played.cost(name).mean()) for name in POLICIES]
    fitted = [fitted_q(data, chosen[name], actions) for name in POLICIES]
    sampled = [importance_sampling(data, chosen[name]) for name in POLICIES]
    print(f"{'policy':<14}{'played':>10}{'fitted Q':>10}{'importance':>12}{'episodes':>10}")
    for name, cost, by_fit, (by_weight, effective) in zip(POLICIES, true, fitted, sampled, strict=True):
        print(f"{name:<14}{cost:10.1f}{by_fit:10.4g}{by_weight:12.1f}{effective:10.1f}")
    print(f"rank correlation of fitted Q with the costs played: {spearmanr(true, fitted).statistic:.2f}")


if __name__ == "__main__":
    main()
