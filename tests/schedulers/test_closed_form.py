"""Closed forms over the box against fine grids."""

from __future__ import annotations

from typing import Any

import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scheduler_systems import CA

from wavegym.core import shortcuts
from wavegym.schedulers import Myopic, MyopicClosedForm, rollout
from wavegym.schedulers.myopic import OBJECTIVES
from wavegym.systems.kershaw_evans.system import KershawEvans, KershawEvansPosition

WHOLE: dict[str, Any] = {"action": "box", "eclipsing": False}
SYSTEMS = {
    "position": KershawEvansPosition(**WHOLE),
    "published": KershawEvans(**WHOLE),
    "narrow": KershawEvans(q=0.01, sweeps=(-50e3, 50e3), **WHOLE),
    "acceleration": KershawEvans(sweeps=(-1e6, 1e6), **WHOLE, **CA),
}
SHARE = np.linspace(-1.0, 1.0, 101)
GRID = np.stack(np.meshgrid(SHARE, SHARE, indexing="ij"), axis=-1).reshape(1, -1, 2)


def ready(system, objective):
    policy = MyopicClosedForm(objective)
    policy.begin(system, 1, None)
    return policy


def beliefs(system, seed, count=1):
    """Beliefs with standard deviations and ranges over decades."""
    rng = np.random.default_rng(seed)
    n = len(system.weights)
    scale = 10 ** rng.uniform([0, -2, -2][:n], [3, 2, 1][:n], (count, n))
    root = rng.standard_normal((count, n, n))
    covariance = scale[:, :, None] * (root @ np.swapaxes(root, 1, 2) + 1e-3 * np.eye(n)) * scale[:, None, :]
    mean = np.zeros((count, n))
    mean[:, 0], mean[:, 1] = 10 ** rng.uniform(3, 5, count), rng.uniform(-100, 100, count)
    belief = system.initial(oracles.worlds(system, 1)).belief
    return belief._replace(step=np.zeros(count, int), mean=mean, covariance=covariance)


@pytest.mark.parametrize("objective", ["trace", "gate"])
@pytest.mark.parametrize("name", SYSTEMS)
@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1))
def test_no_point_of_a_fine_grid_is_better(name, objective, seed):
    system = SYSTEMS[name]
    belief = beliefs(system, seed)
    action = ready(system, objective).act(belief, None, None)
    assert action.dtype == np.float64
    assert np.abs(action).max() <= 1.0
    value = OBJECTIVES[objective](system, belief, action[:, None])[0, 0]
    grid = OBJECTIVES[objective](system, belief, GRID)[0]
    # wide sweeps leave S a condition number of 1e9, so the objective itself is known to 1e-6 only
    assert value <= grid.min() * (1 + 1e-6)
    # and the best grid point of a second grid, one step of the first around the answer, is no better either
    around = (action[:, None] + GRID / 50).clip(-1.0, 1.0)
    assert value <= OBJECTIVES[objective](system, belief, around).min() * (1 + 1e-6)


@pytest.mark.parametrize("name", SYSTEMS)
def test_an_interior_gate_has_the_shape_of_the_prediction(name):
    """R proportional to H P H': k^2 = A11 / (wc sqrt(det A)), g = -wc A12 / (2 A11)."""
    system = SYSTEMS[name]
    belief = beliefs(system, 5, 300)
    actions = ready(system, "gate").act(belief, None, None)
    inside = (np.abs(actions) < 1.0).all(axis=1)
    assert inside.sum() > 20
    A = shortcuts.next_pulse(system, belief)[0][inside, :2, :2]
    k, sweep = system.actions.decode(actions[inside]).T
    wc = 2 * np.pi * system.carrier_hz
    np.testing.assert_allclose(k**2, A[:, 0, 0] / (wc * np.sqrt(np.linalg.det(A))), rtol=1e-8)
    np.testing.assert_allclose(np.pi * sweep / (2 * k), -wc * A[:, 0, 1] / (2 * A[:, 0, 0]), rtol=1e-6)
    for one, duration, width in zip(A, k, sweep, strict=True):
        R = oracles.chirp_covariance(duration, width, system.carrier_hz)
        ratio = R / one
        np.testing.assert_allclose(ratio, ratio[0, 0], rtol=1e-6)


@pytest.mark.parametrize("objective", ["trace", "gate"])
def test_all_parts_of_the_box_are_met(objective):
    """So the grid has tried every case."""
    actions = ready(SYSTEMS["narrow"], objective).act(beliefs(SYSTEMS["narrow"], 1, 2000), None, None)
    inside = np.abs(actions) < 1.0
    assert all((actions[:, i] == side).any() for i in (0, 1) for side in (-1.0, 1.0))
    assert (inside[:, 0] & ~inside[:, 1]).any()  # on the edge of the sweep alone: the quartic
    assert (inside[:, 1] & ~inside[:, 0]).any()
    assert inside.all(axis=1).any() == (objective == "gate")  # of two states, the least trace is on an edge


def test_a_gate_on_the_edge_of_the_sweep_solves_the_quartic():
    """d/dk of A22 R11 - 2 A12 R12 + A11 R22 at the widest sweep, times k^3."""
    system = SYSTEMS["narrow"]
    belief = beliefs(system, 1, 2000)
    actions = ready(system, "gate").act(belief, None, None)
    k, sweep = system.actions.decode(actions).T
    on_edge = (np.abs(actions[:, 1]) == 1.0) & (np.abs(actions[:, 0]) < 1.0)
    wc = 2 * np.pi * system.carrier_hz
    for A, duration, s in zip(
        shortcuts.next_pulse(system, belief)[0][on_edge], k[on_edge], sweep[on_edge], strict=True
    ):
        us = 1e-6  # a unit in which the coefficients are alike
        quartic = [A[1, 1] * us**4, np.pi * s * A[0, 1] / wc * us**3, 0.0, 0.0, -A[0, 0] / wc**2]
        roots = np.roots(quartic) * us
        (positive,) = roots[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0)].real
        np.testing.assert_allclose(duration, positive, rtol=1e-9)


@pytest.mark.parametrize("objective", ["trace", "gate"])
@pytest.mark.parametrize("name", SYSTEMS)
def test_a_batch_equals_its_elements(name, objective):
    system = SYSTEMS[name]
    belief = beliefs(system, 2, 40)
    policy = ready(system, objective)
    together = policy.act(belief, None, None)
    alone = [policy.act(oracles.rows(belief, slice(e, e + 1)), None, None)[0] for e in range(40)]
    assert (together == alone).all()


def test_it_is_no_worse_a_step_than_the_librarys_points_and_plays_whole_episodes():
    system = SYSTEMS["position"]
    worlds = oracles.worlds(system, 30)
    free, library = rollout(system, MyopicClosedForm(), worlds), rollout(system, Myopic(), worlds)
    # after the first step the beliefs differ
    assert (free.cost[:, 0] <= library.cost[:, 0] * (1 + 1e-6)).all()
    assert np.isfinite(free.cost).all()
