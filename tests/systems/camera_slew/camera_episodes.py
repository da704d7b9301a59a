"""Episodes of the camera that has to turn."""

from __future__ import annotations

import numpy as np
import oracles

from wavegym.core import shortcuts

SETTLES = (0, 1, 3)
OPEN: dict = {"shown": (10_000, 10_000), "hidden": (0, 0)}  # nothing hides


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def azimuth(system, mean):
    """Of every target one step ahead, from the camera, (env, target)."""
    x = mean @ system.motion.F.T
    return np.arctan2(x[..., 0] - system.platforms[0][0], x[..., 2] - system.platforms[0][1])


def later(system, count, steps, seed=0):
    """A batch some drawn choices on, and its tapes."""
    worlds, rng = oracles.worlds(system, count), np.random.default_rng(seed)
    state = system.initial(worlds)
    for _ in range(steps):
        state = system.transition(state, rng.integers(system.targets, size=count), worlds)
    return state, worlds


def play(system, worlds, choose):
    """All states of a batch of episodes, and the actions between them."""
    states, actions = [system.initial(worlds)], []
    for _ in range(system.horizon):
        actions.append(choose(states[-1].belief))
        states.append(system.transition(states[-1], actions[-1], worlds))
    return states, actions


def index_rule(system):
    """Look where the gain per step of delay is greatest."""

    def choose(belief):
        wait = shortcuts.delay(system, belief)
        return (shortcuts.gain(system, belief, wait, 14) / (1.0 + 2.0 * wait)).argmax(axis=1)

    return choose
