"""Played episodes of the urban loop for its tests."""

from __future__ import annotations

import numpy as np
import oracles

from wavegym.schedulers.registry import make_policy
from wavegym.systems.urban.tracker import CONFIRMED, Tracks

LONG_UP = 0  # index of the longer pulse with the up sweep


def played(system, policy, count, stop=None):
    """States after every scan of ``count`` episodes."""
    worlds = oracles.worlds(system, count)
    state, states = system.initial(worlds), []
    chosen = make_policy(policy, system, None)
    chosen.begin(system, count, np.random.default_rng(0))
    for _ in range(stop or system.horizon):
        state = system.transition(state, chosen.act(state.belief, None, None), worlds)
        states.append(state)
    return states


def headline(system, policy):
    """Mean number of confirmed tracks and RMSE of held targets in fifty runs; models of the first target."""
    states = played(system, policy, 50)
    figures = [system.state_info(state) for state in states]
    held = np.array([f["held"] for f in figures])
    squares = np.array([f["position_error"] for f in figures]) ** 2
    confirmed = np.mean([f["confirmed"] for f in figures])
    return (confirmed, np.sqrt(squares[held].mean())), models_of_first(states)


def models_of_first(states):
    """Mean model probabilities of the confirmed track nearest the first target, (scan, model); NaN for none."""
    rows = []
    for state in states:
        x, _ = Tracks(*state.belief[1:]).combined()
        off = np.linalg.norm(x[..., :2] - state.truth.targets[:, :1, :2], axis=2)
        off = np.where(state.belief.status == CONFIRMED, off, np.inf)
        near = off.min(axis=1) < 20.0
        rows.append(
            state.belief.mu[near, off[near].argmin(axis=1)].mean(axis=0)
            if near.any()
            else np.full(state.belief.mu.shape[2], np.nan)
        )
    return np.array(rows)
