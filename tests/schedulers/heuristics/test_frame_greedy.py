"""Frames of dwells: what is allotted, and in which order it is done."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from wavegym.core import shortcuts
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.schedulers.heuristics.timeline_rules import FrameGreedy
from wavegym.systems.multifunction_radar.system import MultifunctionRadar

SYSTEM = MultifunctionRadar(known=1.0, slots=30)
DURATION, EACH = SYSTEM.dwells.menu[3], SYSTEM.dwells.each


def rule(frame: float, num_envs: int = 1) -> FrameGreedy:
    made = FrameGreedy(1.0, 0.5, frame)
    made.begin(SYSTEM, num_envs, np.random.default_rng(0))
    return made


def most_by_linear_programme(worth, frame):
    """Of the relaxed multiple-choice knapsack: a task may have shares of dwells, together at most one."""
    tasks = len(worth) // EACH
    one_each = np.kron(np.eye(tasks), np.ones(EACH))
    limits = np.concatenate([[frame], np.ones(tasks)])
    found = linprog(-worth, np.vstack([np.tile(DURATION[:EACH], tasks), one_each]), limits)
    return -found.fun


@pytest.mark.parametrize("frame", [0.05, 0.2, 1.0])
def test_an_allotment_is_within_one_dwell_of_the_relaxed_optimum(frame):
    """Greedy lengthening follows the concave hull, so it leaves less than the last step of it that did not fit."""
    rng = np.random.default_rng(1)
    for _ in range(5):
        worth = np.append(np.sort(rng.exponential(size=(42, EACH)), axis=1).reshape(-1), 0.0)
        done = rule(frame).allotted(worth)
        assert done[:-1].reshape(-1, EACH).sum(axis=1).max() == 1
        assert DURATION[done].sum() <= frame + 1e-12
        best = most_by_linear_programme(worth[:-1], frame)
        assert best - worth.max() <= worth[done].sum() <= best + 1e-9


def test_all_dwells_of_a_frame_are_done_before_the_next_one_by_falling_gain():
    worlds = draw_worlds(SYSTEM, world_seeds(0, "tune", 3))
    state = SYSTEM.initial(worlds)
    frames, waits = rule(0.3, 3), len(DURATION) - 1
    first = frames.choose(state.belief, SYSTEM.mask(state.belief), None)
    gain = shortcuts.gain_per_second(SYSTEM, state.belief, 1.0, 0.5)
    planned = [SYSTEM.mask(state.belief)[e] & rule(0.3).allotted(gain[e] * DURATION) for e in range(3)]
    for e in range(3):
        assert first[e] == np.where(planned[e], gain[e], -np.inf).argmax()
        assert frames.left[e].sum() == planned[e].sum() - 1
    spent = 0.0
    while frames.left[0].any():
        state = SYSTEM.transition(state, first, worlds)
        spent += state.belief.duration[0]
        first = frames.choose(state.belief, SYSTEM.mask(state.belief), None)
        assert first[0] != waits
    assert spent < 0.3
