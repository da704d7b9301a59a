"""The lower bound of the multifunction radar: the parts of the proof, and that no policy is below it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from agents import dwell_bound
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.evaluation.play import Task, play
from wavegym.schedulers.heuristics.timeline_rules import GainPerSecond
from wavegym.systems.multifunction_radar.system import MultifunctionRadar

SYSTEM = MultifunctionRadar(targets=4.0, seconds=5.0, slots=16)
SEEDS = world_seeds(0, "test", 6)


@pytest.fixture(scope="module")
def relaxation():
    return dwell_bound.Relaxation(SYSTEM, draw_worlds(SYSTEM, SEEDS))


@pytest.fixture(scope="module")
def bound(relaxation):
    return relaxation.solve(60)


def divisions(relaxation, count):
    """Random divisions of the time."""
    cells, targets = relaxation.here.shape
    rng = np.random.default_rng(0)
    shape = (cells, targets + SYSTEM.sectors + 1)
    for power in rng.uniform(0.2, 3.0, count):
        share = rng.exponential(size=shape) ** power
        yield torch.from_numpy(share / share.sum(axis=1, keepdims=True))


def test_the_capped_error_is_that_of_drawn_errors():
    drawn = np.random.default_rng(0).standard_normal(400_000) ** 2
    for trace in (0.05, 0.5, 1.0, 4.0):
        values = np.minimum(trace * drawn, 2.0)
        got = float(dwell_bound.capped(torch.tensor(trace, dtype=torch.float64)))
        assert abs(got - values.mean()) < 4.0 * values.std() / np.sqrt(len(values))


def test_the_cheapest_error_of_a_trace_lies_along_one_line():
    rng = np.random.default_rng(1)
    x, y = rng.standard_normal((2, 200_000)) ** 2
    for share in (0.1, 0.5):
        both = np.minimum(1.5 * ((1.0 - share) * x + share * y), 2.0).mean()
        assert both > np.minimum(1.5 * x, 2.0).mean()


def test_the_envelope_is_convex_falling_and_below_the_cost():
    y = torch.logspace(-3, 4, 4001, dtype=torch.float64)
    value = dwell_bound.envelope(y)
    assert (torch.diff(value) < 0.0).all()
    at = (y[1:-1] - y[:-2]) / (y[2:] - y[:-2])
    assert (value[1:-1] <= (1.0 - at) * value[:-2] + at * value[2:] + 1e-12).all()
    assert (value <= torch.clamp(dwell_bound.capped(1.0 / y), max=1.0) + 1e-9).all()
    assert float(dwell_bound.envelope(torch.zeros(1, dtype=torch.float64))) == 1.0


def test_the_cost_is_convex_in_the_division(relaxation):
    drawn = list(divisions(relaxation, 12))
    with torch.no_grad():
        for one, other in zip(drawn[::2], drawn[1::2], strict=True):
            ends = 0.5 * (relaxation.cost(one).sum() + relaxation.cost(other).sum())
            assert relaxation.cost(0.5 * (one + other)).sum() <= ends + 1e-9


@pytest.mark.slow
def test_no_division_of_time_is_below_the_bound(relaxation, bound):
    assert bound.value > 0.0
    assert bound.gap >= 0.0
    assert bound.worlds.mean() == pytest.approx(bound.value)
    with torch.no_grad():
        for share in divisions(relaxation, 20):
            assert relaxation.cost(share).sum() / relaxation.count >= bound.value


def test_a_track_of_constant_updates_has_the_covariance_of_a_kalman_filter():
    """The known targets of one world, each with its share in every cell, in covariance form."""
    system = MultifunctionRadar(targets=4.0, seconds=3.0, slots=16, known=1.0)
    relaxation = dwell_bound.Relaxation(system, draw_worlds(system, SEEDS[:1]))
    cells, targets = relaxation.here.shape
    always = relaxation.paths.here.all(axis=0) & relaxation.paths.known
    assert always.any()
    share = torch.zeros((cells, targets + system.sectors + 1), dtype=torch.float64)
    share[:, :targets] = 0.02
    got = relaxation.cost(share).numpy()[always]
    T = system.cell
    F = np.kron(np.eye(2), [[1.0, T], [0.0, 1.0]])
    G = np.kron(np.eye(2), [[0.5 * T**2], [T]])  # of an acceleration that lasts for a cell
    rates, beam = relaxation.rates, system.beam
    for n, i in enumerate(np.flatnonzero(always)):
        P, total = relaxation.paths.first[i], 0.0
        for k in range(cells):
            x, y = relaxation.paths.x[k, i, [0, 2]]
            r = np.hypot(x, y)
            vx, vy = relaxation.paths.x[k, i, [1, 3]]
            s, c, across = x / r, y / r, (vx * y - vy * x) / r**2
            H = np.array([[s, 0.0, c, 0.0], [c * c / r, 0.0, -s * c / r, 0.0], [c * across, s, -s * across, c]])
            of_power = np.array([beam.range_error**2, (beam.width / 1.6) ** 2]) / rates.update[k, i]
            S = H @ P @ H.T + np.diag([*of_power, 1.0 / rates.update_rate[k, i]]) / (T * 0.02)
            P = P - P @ H.T @ np.linalg.solve(S, H @ P)
            y = torch.tensor(system.c0 / (P[0, 0] + P[2, 2]), dtype=torch.float64)
            total += float(dwell_bound.envelope(y)) / cells
            P = F @ P @ F.T + relaxation.paths.variance[k, i] * G @ G.T
        assert got[n] == pytest.approx(total, rel=1e-9)


@pytest.mark.slow
def test_no_policy_is_below_the_bound_by_truth(bound):
    played = play(Task("", SYSTEM, None, {}), GainPerSecond(1.0, 0.5), SEEDS)
    assert (played.gospa**2 / SYSTEM.c0).mean() > bound.value
