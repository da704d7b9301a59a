"""A lower bound of the multifunction radar's cost by truth: a convex relaxation, solved to a known gap.

No scheduler and no tracker has a smaller expected squared GOSPA distance, if

- it knows where each target is, when it manoeuvres, and its velocity on arrival, to ``VELOCITY`` on each axis;
- updates point at the target, and neither updates nor searches cause false alarms;
- it divides its time freely: u_i(t) is the expected share of time on target i, v_s(t) that on sector s. Only the
  expectation of their sum over all worlds must be at most 1. For each purpose the best dwell counts.

Then the expected information of a track, E[Lambda], is at most the result of the recursion with the expected
information of the echoes, because predict(Lambda) is concave. The probability d that a target has been found is at most
1 - exp(-integral of v times a rate), because survival is convex in v. The cost of a target is at least

    (1 - d) c0 + d psi(y / d),   y = 1 / tr(position part of Lambda^-1),

where psi is the convex envelope of min(E min(|error|^2, 2 c0), c0) for a Gaussian error of trace 1 / y along one line,
which has the lowest cost for this trace. The bound is jointly convex in u and v. The gradient at any division bounds
what all others could save (the gap of Frank and Wolfe). So cost minus gap is a bound, however well the division is
optimised.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import torch
from scipy.optimize import brentq
from torch import Tensor

from wavegym.core.arrays import Array
from wavegym.systems.multifunction_radar import beam_kernels as beams
from wavegym.systems.multifunction_radar.state import World
from wavegym.systems.multifunction_radar.step_kernels import fly_all
from wavegym.systems.multifunction_radar.system import MultifunctionRadar

CELL = 0.25  # s: a cell's information counts from the cell's beginning
VELOCITY = 30.0  # m/s
NOWHERE = 1e-10  # m^-2, information about the place of an unseen target
RATE, STEPS = 0.3, 100  # of the descent
MOST = 5.0  # bound of a step over RATE
NODES = 61  # of integrals over a beam
FEW = 1e-9  # least probability of having been found


class Paths(NamedTuple):
    """Targets of all worlds in one row; k cells, i targets."""

    world: Array  # (i,)
    here: Array  # (k, i) bool
    x: Array  # (k, i, 4)
    density: Array  # (k, i) least of the cell, m^2/s^3
    known: Array  # (i,) bool, from the beginning


class Rates(NamedTuple):
    """What a second of time brings, (k, i) each."""

    update: Array  # mean sum of 2 z of detections; divided by a variance at 2 z = 1 it is Fisher information
    search: Array  # the same, of a search of the target's sector
    find: Array  # minus the log of the probability that such a search does not find the target
    sector: Array  # int


class Bound(NamedTuple):
    """A lower bound in targets."""

    value: float
    gap: float  # of the optimisation; it is already subtracted
    worlds: Array  # (world,) the part of each world in W times the mean


def paths(system: MultifunctionRadar, worlds: World) -> Paths:
    """The places of the targets of all worlds at the beginning of each cell."""
    truth = system.initial(worlds).truth
    x, mode, here, arrival = truth.state, truth.mode, truth.here.copy(), truth.arrival
    known = here & (worlds.draw[..., 6] < system.known)
    each, cells = round(CELL / system.cell), round(system.seconds / CELL)
    seen, states, densities = [], [], []
    quiet = np.array(system.density)
    for k in range(cells):
        seen.append(here.copy())
        states.append(x.copy())
        least = quiet[mode]
        for part in range(each):
            begin = k * each + part
            fly_all(worlds.key, arrival, begin, begin + 1, x, mode, here, system.truth_model.flight)
            least = np.minimum(least, quiet[mode])
        densities.append(least)
    ever = np.any(seen, axis=0)
    number = np.broadcast_to(np.arange(len(x))[:, None], ever.shape)
    kept = [np.stack(values)[:, ever] for values in (seen, states, densities)]
    return Paths(number[ever], kept[0], kept[1], kept[2], known[ever])


def rates(system: MultifunctionRadar, found: Paths) -> Rates:
    """The best rates of any dwell, at the least range of each cell."""
    r = np.hypot(found.x[..., 0], found.x[..., 2])
    nearest = np.minimum(r, np.append(r[1:], r[-1:], axis=0))
    grid = np.geomspace(nearest.min(), nearest.max(), 400)
    off = np.linspace(-beams.REACH, beams.REACH, NODES)  # beam widths
    seconds = np.array(system.dwell_seconds)[:, None]
    in_update, in_search = system.thresholds
    on_axis = beams.energy(grid, 0.0, seconds, system.beam)  # (dwell, range)
    across = beams.energy(grid[:, None], off * system.beam.width, seconds[..., None], system.beam)
    duration = seconds + system.overhead
    update = _power(on_axis, in_update) / duration
    search = np.trapezoid(_power(across, in_search), off) / (duration * system.area.beams)
    find = np.trapezoid(-np.log1p(-beams.detection(across, in_search)), off) / (duration * system.area.beams)
    at = [np.interp(nearest, grid, rate.max(axis=0)) for rate in (update, search, find)]
    azimuth = np.arctan2(found.x[..., 0], found.x[..., 2])
    half = system.traffic.half_sector
    sector = np.clip((azimuth + half) / (2.0 * half) * system.sectors, 0, system.sectors - 1).astype(np.int64)
    return Rates(at[0], at[1], at[2], sector)


def _power(S: Array, threshold: float) -> Array:
    """Mean of 2 z if z exceeds the threshold, counted as 0 otherwise."""
    result: Array = 2.0 * (threshold + 1.0 + S) * beams.detection(S, threshold)
    return result


def capped(trace: Tensor) -> Tensor:
    """E min(trace chi^2, 2) with one degree of freedom; traces over c0."""
    half = 1.0 / trace  # of the cap over the trace
    inner = torch.erf(half.sqrt()) - 2.0 * (half / math.pi).sqrt() * torch.exp(-half)
    return trace * inner + 2.0 * torch.erfc(half.sqrt())


def _tangent() -> tuple[float, float]:
    """Where the tangent through (0, 1) touches y -> capped(1 / y), and the value there."""

    def value(y: float) -> float:
        return float(capped(torch.tensor(1.0 / y, dtype=torch.float64)))

    def misses(y: float) -> float:
        slope = (value(y * 1.0001) - value(y * 0.9999)) / (2e-4 * y)
        return value(y) - y * slope - 1.0

    touch = float(brentq(misses, 1.0, 50.0))
    return touch, value(touch)


TOUCH, THERE = _tangent()


def envelope(y: Tensor) -> Tensor:
    """psi of the module's first lines, over c0, of y times c0."""
    line = 1.0 - y * (1.0 - THERE) / TOUCH
    return torch.where(y < TOUCH, line, capped(1.0 / torch.clamp(y, min=TOUCH)))


class Relaxation:
    """The cost as a function of the division of time.

    Args:
        system: the radar.
        worlds: tapes, axis 0 = world.
    """

    def __init__(self, system: MultifunctionRadar, worlds: World) -> None:
        self.system, self.count = system, len(worlds.key)
        self.paths = paths(system, worlds)
        self.rates = rates(system, self.paths)
        as_tensor = torch.from_numpy
        x = self.paths.x
        r2 = x[..., 0] ** 2 + x[..., 2] ** 2
        along = np.stack([x[..., 0], x[..., 2]], axis=-1) / np.sqrt(r2)[..., None]
        across = np.stack([x[..., 2], -x[..., 0]], axis=-1) / r2[..., None]
        beam = system.beam
        place = np.einsum("kia,kib->kiab", along, along) / beam.range_error**2
        place += np.einsum("kia,kib->kiab", across, across) / beam.angle_error**2
        H = np.zeros((*r2.shape, 4, 4))
        H[..., ::2, ::2] = place
        self.information = as_tensor(H)
        self.inverse_noise = as_tensor(_inverse_noise(self.paths.density))
        F = np.eye(4)
        F[0, 1] = F[2, 3] = -CELL
        self.back = as_tensor(F)  # the inverse of the transition
        self.here = as_tensor(self.paths.here)
        self.update, self.search, self.find = (as_tensor(rate) for rate in self.rates[:3])
        self.sector = as_tensor(self.rates.sector)
        self.known = as_tensor(self.paths.known)

    def cost(self, share: Tensor) -> Tensor:
        """Time-averaged cost of each target, in targets, (i,).

        Args:
            share: expected share of time, (k, i + sectors + 1); the last is idle. The share of a target is divided by
                the number of worlds.
        """
        targets, sectors = self.here.shape[1], self.system.sectors
        u = (share[:, :targets] * self.count).unbind(0)
        v = share[:, targets : targets + sectors].unbind(0)
        position, velocity = self.system.first_errors
        known = torch.tensor([position**-2, velocity**-2] * 2, dtype=torch.float64)
        unseen = torch.tensor([NOWHERE, VELOCITY**-2] * 2, dtype=torch.float64)
        fresh = torch.diag_embed(torch.where(self.known[:, None], known, unseen))
        L, hazard = fresh, torch.zeros(targets, dtype=torch.float64)
        total = torch.zeros(targets, dtype=torch.float64)
        c0, eye = self.system.c0, torch.eye(4, dtype=torch.float64)
        for k in range(len(self.here)):
            of_sector = v[k][self.sector[k]]
            power = CELL * (u[k] * self.update[k] + of_sector * self.search[k])
            L = torch.where(self.here[k][:, None, None], L + power[:, None, None] * self.information[k], fresh)
            hazard = hazard + torch.where(self.here[k], CELL * of_sector * self.find[k], 0.0)
            d = torch.where(self.known, 1.0, torch.clamp(-torch.expm1(-hazard), min=FEW))
            place = L[:, ::2, ::2] - L[:, ::2, 1::2] @ torch.linalg.solve(L[:, 1::2, 1::2], L[:, 1::2, ::2])
            determinant = place[:, 0, 0] * place[:, 1, 1] - place[:, 0, 1] * place[:, 1, 0]
            y = c0 * determinant / (place[:, 0, 0] + place[:, 1, 1])
            total = total + torch.where(self.here[k], 1.0 - d + d * envelope(y / d), 0.0)
            A = self.back.T @ L @ self.back
            L = A @ (eye - torch.linalg.solve(A + self.inverse_noise[k], A))
        return total / len(self.here)

    def solve(self, steps: int = STEPS) -> Bound:
        """Divide the time by mirror descent, with steps relative to each cell's mean gradient, and subtract the gap."""
        targets, cells = self.here.shape[1], len(self.here)
        logits = torch.zeros((cells, targets + self.system.sectors + 1), dtype=torch.float64)
        present = self.here.sum(dim=1, keepdim=True).clamp(min=1)
        logits[:, :targets] = torch.where(self.here, -torch.log(2.0 * present.double()), -30.0)
        logits[:, targets:-1], logits[:, -1] = -math.log(2.0 * self.system.sectors), -10.0
        best = Bound(-math.inf, math.inf, np.zeros(0))
        for _ in range(steps):
            share = torch.softmax(logits, dim=1).requires_grad_(True)
            each = self.cost(share)
            value = each.sum() / self.count
            value.backward()
            best = max(best, self._bound(share, each, value.item()), key=lambda bound: bound.value)
            gradient: Any = share.grad
            mean = (share.detach() * gradient).sum(dim=1, keepdim=True)
            logits -= RATE * ((gradient - mean) / mean.abs()).clamp(-MOST, MOST)
        return best

    def _bound(self, share: Tensor, each: Tensor, value: float) -> Bound:
        gradient: Any = share.grad
        gap = ((share.detach() * gradient).sum(dim=1) - gradient.min(dim=1).values).sum().item()
        parts = np.bincount(self.paths.world, each.detach().numpy(), minlength=self.count)
        return Bound(value - gap, gap, parts * (1.0 - gap / value))


def _inverse_noise(density: Array) -> Array:
    """Inverse of the covariance that the white acceleration of a cell adds, (..., 4, 4)."""
    T = CELL
    block = np.array([[12.0 / T**3, -6.0 / T**2], [-6.0 / T**2, 4.0 / T]])
    inverse: Array = np.kron(np.eye(2), block) / density[..., None, None]
    return inverse
