"""The closed forms against a dense grid over the box, at beliefs from the runs."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from research.papers.kershaw_evans.study import DRAWN, GATE, TRACE, Case, Study, system
from wavegym.core.arrays import Array
from wavegym.systems.kershaw_evans.system import KershawEvans

BELIEFS = 12  # beliefs from each scene, spread over runs and steps
GRID = (120, 121)  # durations and sweeps
INSIDE = 1e-9  # a pulse this far from the box's edges, relative to them, is inside


class Surface(NamedTuple):
    """Objectives over the box, for one predicted covariance."""

    duration: Array  # (k,) s
    sweep: Array  # (s,) Hz
    trace: Array  # (k, s) m^2, trace(Lambda P)
    gate: Array  # (k, s) m^2/s, sqrt(det S)


def surface(loop: KershawEvans, P: Array, eta: float) -> Surface:
    """Both objectives for the predicted covariance P (2, 2), by the formulas of the Kalman filter."""
    duration, sweep = loop.action_set.box.parameters
    k, s = np.geomspace(duration.low, duration.high, GRID[0]), np.linspace(sweep.low, sweep.high, GRID[1])
    grid = np.stack(np.meshgrid(k, s, indexing="ij"), axis=-1)
    R = loop.unit_covariance(loop.action_set.box.encode(grid)) / eta
    S = P + R
    updated = P - P @ np.linalg.solve(S, np.broadcast_to(P, S.shape))
    trace = (np.diagonal(updated, 0, -2, -1) * np.array(loop.weights)).sum(axis=-1)
    return Surface(k, s, trace, np.sqrt(np.linalg.det(S)))


def closed_forms(study: Study, scene: str) -> dict[str, Any]:
    """How the closed forms compare with the grid.

    Keys; the first four are {mean, ci} of numbers that do not depend on chance:
        det_spread: greatest det R of the library divided by the least, minus 1.
        trace_excess, gate_excess: objective at the closed form divided by the least of the grid, minus 1; the greatest
        of all beliefs. Negative if the closed form is always better than the grid.
        proportion: the greatest relative difference of R / sqrt(det R) and H P H' / sqrt(det H P H') at the steps with
        the gate's optimum inside the box; None if there is no such step.
        interior: share of all steps with the gate's optimum inside the box.
        trace_interior: share of all steps at which the trace's optimum has a duration inside the box.
    """
    loop = system(Case(scene, DRAWN, TRACE))
    of_library = np.linalg.det(loop.action_set.covariances)
    gate, trace = study.of(scene, GATE), study.of(scene, TRACE)
    inside = _inside(loop, gate.duration, gate.sweep)
    return {
        "det_spread": _exactly(float(of_library.max() / of_library.min() - 1.0)),
        "trace_excess": _exactly(_excess(loop, trace, "trace")),
        "gate_excess": _exactly(_excess(loop, gate, "gate")),
        "proportion": _exactly(_proportion(loop, gate.predicted[inside], gate.duration[inside], gate.sweep[inside])),
        "interior": float(inside.mean()),
        "trace_interior": float(_inside(loop, trace.duration, 0.0 * trace.sweep).mean()),
    }


def _exactly(value: float | None) -> dict[str, Any]:
    """A number that does not depend on chance, as an estimate."""
    return {"mean": value, "ci": None if value is None else [value, value]}


def _inside(loop: KershawEvans, duration: Array, sweep: Array) -> Array:
    low, high = loop.action_set.box.parameters[0].low, loop.action_set.box.parameters[0].high
    limit = loop.action_set.box.parameters[1].high
    long = (duration > low * (1.0 + INSIDE)) & (duration < high * (1.0 - INSIDE))
    return np.asarray(long & (np.abs(sweep) < limit * (1.0 - INSIDE)))


def _excess(loop: KershawEvans, runs: Any, objective: str) -> float:
    """The greatest excess of the played optimum over the least value of the grid, over all beliefs."""
    worst, size = -np.inf, runs.cost.size
    for index in np.linspace(0, size - 1, min(BELIEFS, size)).astype(int):
        run, k = np.unravel_index(index, runs.cost.shape)
        P, eta = runs.predicted[run, k], float(runs.eta[run, k])
        pulse = loop.action_set.box.encode(np.array([runs.duration[run, k], runs.sweep[run, k]]))
        S = P + loop.unit_covariance(pulse) / eta
        updated = P - P @ np.linalg.solve(S, P)
        values = {"trace": float(np.diag(updated) @ loop.weights), "gate": float(np.sqrt(np.linalg.det(S)))}
        worst = max(worst, values[objective] / getattr(surface(loop, P, eta), objective).min() - 1.0)
    return worst


def _proportion(loop: KershawEvans, A: Array, duration: Array, sweep: Array) -> float | None:
    """Greatest difference of two matrices of determinant 1, relative to each element's scale; None without beliefs."""
    if not len(A):
        return None
    R = loop.unit_covariance(loop.action_set.box.encode(np.stack([duration, sweep], axis=-1)))
    A, R = (M / np.sqrt(np.linalg.det(M))[:, None, None] for M in (A, R))
    scale = np.sqrt(np.diagonal(A, 0, -2, -1))
    return float(np.abs((R - A) / (scale[:, :, None] * scale[:, None, :])).max())
