"""A lower bound of the multifunction radar's cost by truth: a convex relaxation, solved to a known gap.

No scheduler with a tracker that is linear in its measurements has a smaller expected squared GOSPA distance, if

- it knows where each target is, when it manoeuvres, its cross section, and its velocity on arrival, to ``VELOCITY`` on
  each axis;
- updates point at the target, neither updates nor searches cause false alarms, and every fold of a range-rate is known;
- it divides its time freely: u_i(t) is the expected share of time on target i, v_s(t) that on sector s. Only the
  expectation of their sum over all worlds must be at most 1. For each purpose and each kind of information the best
  dwell counts;
- an acceleration is known where a greater one would have taken the speed out of its limits.

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
from scipy.special import gammaincc
from torch import Tensor

from wavegym.core.arrays import Array
from wavegym.core.system import State
from wavegym.sensors.trains import acceleration_loss
from wavegym.systems.multifunction_radar import beam_kernels as beams
from wavegym.systems.multifunction_radar.flight_kernels import fly_all
from wavegym.systems.multifunction_radar.state import World, estimates, flying
from wavegym.systems.multifunction_radar.step_kernels import look_of
from wavegym.systems.multifunction_radar.system import MultifunctionRadar

VELOCITY = 30.0  # m/s
NOWHERE = 1e10  # m^2, variance of the place of an unseen target
RATE, STEPS = 0.3, 100  # of the descent
MOST = 5.0  # bound of a step over RATE
NODES = 61  # of integrals over a beam
STRENGTHS = np.geomspace(1e-9, 1e9, 1000)  # S of the tables of rates
FEW = 1e-9  # least probability of having been found


class Paths(NamedTuple):
    """Targets of all worlds in one row; k cells of time, i targets. A cell's information counts from its beginning."""

    world: Array  # (i,)
    here: Array  # (k, i) bool
    x: Array  # (k, i, 4)
    radial: Array  # (k, i) acceleration along the line of sight, m/s^2
    variance: Array  # (k, i) of the acceleration on each axis, as the tracker knows it, (m/s^2)^2
    section: Array  # (i,) m^2
    known: Array  # (i,) bool, by a track at the beginning
    first: Array  # (i, 4, 4) covariance of this track


class Rates(NamedTuple):
    """What a second of time brings, (k, i) each."""

    update: Array  # mean sum of 2 z of detections; over a variance at 2 z = 1 it is Fisher information about a place
    update_rate: Array  # the same over the variance of a range-rate
    search: Array  # as update, of a search of the target's sector
    search_rate: Array  # as update_rate, of the same
    find: Array  # minus the log of the probability that such a search does not find the target
    sector: Array  # int


class Bound(NamedTuple):
    """A lower bound in targets."""

    value: float
    gap: float  # of the optimisation; it is already subtracted
    worlds: Array  # (world,) the part of each world in W times the mean


def paths(system: MultifunctionRadar, worlds: World) -> Paths:
    """The places of the targets of all worlds at the beginning of each cell."""
    state, flight, cell = system.initial(worlds), system.truth_model.flight, system.cell
    truth = state.truth
    x, (known, first) = truth.state, _first_tracks(system, state)
    seen: list[list[Array]] = [[], [], [], []]
    limits = np.array(flight.acceleration)
    for k in range(round(system.seconds / cell)):
        speed, most = np.hypot(x[..., 1], x[..., 3]), limits[truth.mode]
        is_free = (speed - cell * most > flight.slowest) & (speed + cell * most < flight.fastest)
        r = np.hypot(x[..., 0], x[..., 2])
        radial = (x[..., [0, 2]] * truth.acceleration).sum(axis=-1) / r
        for values, value in zip(seen, (truth.here, x, radial, 0.25 * most**2 * is_free), strict=True):
            values.append(value.copy())
        fly_all(worlds.key, truth.arrival, k, k + 1, flying(truth), flight)
    ever = np.any(seen[0], axis=0)
    number = np.broadcast_to(np.arange(len(x))[:, None], ever.shape)
    here, states, radials, variances = (np.stack(values)[:, ever] for values in seen)
    section = np.array(system.truth_model.sections)[truth.section[ever]]
    return Paths(number[ever], here, states, radials, variances, section, known[ever], first[ever])


def _first_tracks(system: MultifunctionRadar, state: State) -> tuple[Array, Array]:
    """Which targets have a track, (env, g), and the tracks' covariances, (env, g, 4, 4)."""
    truth, belief = state
    known, first = np.zeros(truth.here.shape, np.bool_), np.zeros((*truth.here.shape, 4, 4))
    made = estimates(belief, system.modes)
    for e, k in zip(*np.nonzero((belief.existence > 0.0) & (truth.origin >= 0)), strict=True):
        known[e, truth.origin[e, k]] = True
        first[e, truth.origin[e, k]] = made.covariance[e, k]
    return known, first


def rates(system: MultifunctionRadar, found: Paths) -> Rates:
    """The best rates of any dwell, at the least range of each cell."""
    r = np.hypot(found.x[..., 0], found.x[..., 2])
    sine, azimuth = found.x[..., 0] / r, np.arctan2(found.x[..., 0], found.x[..., 2])
    nearest = np.minimum(r, np.append(r[1:], r[-1:], axis=0))
    half, beam, menu = system.traffic.half_sector, system.beam, system.menu
    sector = np.clip((azimuth + half) / (2.0 * half) * system.sectors, 0, system.sectors - 1).astype(np.int64)
    across = np.diff(system.area.edges)[sector] / beam.width
    best = [np.zeros_like(r) for _ in range(5)]
    for a in range(system.dwells.each):
        for purpose, action in enumerate((a, int(system.dwells.search(np.array(0), np.array(a))))):
            look, duration = look_of(action, menu), menu.duration[action]
            S = look.gain * (beam.reference / nearest) ** 4 * found.section * (1.0 - sine**2) ** 1.5
            S = np.clip(S * acceleration_loss(1.0, 1.0, look.stretch * found.radial), *STRENGTHS[[0, -1]])
            power, find = _tables(look, wide=purpose == 1)
            each = duration * (across if purpose else 1.0)
            rate = np.exp(np.interp(np.log(S), np.log(STRENGTHS), np.log(power))) / each
            best[2 * purpose] = np.maximum(best[2 * purpose], rate)
            best[2 * purpose + 1] = np.maximum(best[2 * purpose + 1], rate / look.rate_error**2)
            if purpose:
                best[4] = np.maximum(best[4], np.interp(np.log(S), np.log(STRENGTHS), find) / each)
    return Rates(*[*best, sector])


def _tables(look: beams.Look, wide: bool) -> tuple[Array, Array]:
    """Mean of 2 z with 0 for a miss, and minus the log of the probability of a miss, by ``STRENGTHS`` on the axis.

    With ``wide`` integrals over the offset in beam widths.
    """
    off = np.linspace(-beams.REACH, beams.REACH, NODES) if wide else np.zeros(1)
    S = STRENGTHS[:, None] * np.exp(-beams.TWO_WAY * off * off)
    x = look.threshold / (1.0 + S)
    power = 2.0 * look.bursts * (1.0 + S) * gammaincc(look.bursts + 1, x)
    find = -np.log1p(-np.minimum(gammaincc(look.bursts, x), 1.0 - 1e-15))
    return (np.trapezoid(power, off), np.trapezoid(find, off)) if wide else (power[:, 0], find[:, 0])


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
        beam, T = system.beam, system.cell
        cosine, v = x[..., 2] / np.sqrt(r2), x[..., 1::2]
        H = np.zeros((*r2.shape, 3, 4))  # gradients of range and sine over their errors, and of range-rate
        H[..., 0, ::2] = along / beam.range_error
        H[..., 1, ::2] = across * (cosine * beams.SLOPE / beam.width)[..., None]
        H[..., 2, 1::2] = along
        H[..., 2, ::2] = (v - (v * along).sum(axis=-1, keepdims=True) * along) / np.sqrt(r2)[..., None]
        self.gradients = as_tensor(H)
        self.variance = as_tensor(self.paths.variance)
        self.noise = as_tensor(np.kron(np.eye(2), [[0.25 * T**4, 0.5 * T**3], [0.5 * T**3, T * T]]))
        F = np.eye(4)
        F[0, 1] = F[2, 3] = T
        self.forward = as_tensor(F)
        self.here = as_tensor(self.paths.here)
        self.update, self.update_rate, self.search, self.search_rate, self.find, self.sector = (
            as_tensor(rate) for rate in self.rates
        )
        self.known = as_tensor(self.paths.known)
        unseen = np.diag([NOWHERE, VELOCITY**2] * 2)
        self.first = as_tensor(np.where(self.paths.known[:, None, None], self.paths.first, unseen))

    def cost(self, share: Tensor) -> Tensor:
        """Time-averaged cost of each target, in targets, (i,).

        Args:
            share: expected share of time, (k, i + sectors + 1); the last is idle. The share of a target is divided by
                the number of worlds.
        """
        targets, sectors = self.here.shape[1], self.system.sectors
        u = (share[:, :targets] * self.count).unbind(0)
        v = share[:, targets : targets + sectors].unbind(0)
        P, hazard = self.first, torch.zeros(targets, dtype=torch.float64)
        total = torch.zeros(targets, dtype=torch.float64)
        c0, T = self.system.c0, self.system.cell
        for k in range(len(self.here)):
            of_sector = v[k][self.sector[k]]
            power = T * (u[k] * self.update[k] + of_sector * self.search[k])
            power_of_rate = T * (u[k] * self.update_rate[k] + of_sector * self.search_rate[k])
            H = torch.stack([power, power, power_of_rate], dim=-1).sqrt()[..., None] * self.gradients[k]
            gain = torch.linalg.solve(torch.eye(3, dtype=P.dtype) + H @ P @ H.mT, H @ P).mT
            left = torch.eye(4, dtype=P.dtype) - gain @ H
            P = torch.where(self.here[k][:, None, None], left @ P @ left.mT + gain @ gain.mT, self.first)  # Joseph
            hazard = hazard + torch.where(self.here[k], T * of_sector * self.find[k], 0.0)
            d = torch.where(self.known, 1.0, torch.clamp(-torch.expm1(-hazard), min=FEW))
            y = c0 / (P[:, 0, 0] + P[:, 2, 2])
            total = total + torch.where(self.here[k], 1.0 - d + d * envelope(y / d), 0.0)
            P = self.forward @ P @ self.forward.T + self.variance[k][:, None, None] * self.noise
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
