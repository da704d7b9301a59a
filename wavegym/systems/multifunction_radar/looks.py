"""What a dwell of the multifunction radar sends, and how its echo is judged."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import gammainccinv

from wavegym.core.arrays import Array
from wavegym.sensors.trains import acceleration_loss
from wavegym.systems.multifunction_radar.actions import Dwells, Train
from wavegym.systems.multifunction_radar.beam_kernels import Look
from wavegym.systems.multifunction_radar.dwell_kernels import Laws, share_found
from wavegym.systems.multifunction_radar.step_kernels import SEARCH, Menu

UNIT = 10e-3  # s: length of the burst whose E/N0 is 1 at the reference range
ANGLES = 64  # of an acceleration against the line of sight, in a mean over them


@dataclass(frozen=True)
class Receiver:
    """Doppler filters for each pulse of a burst, and a threshold for each purpose.

    Args:
        wavelength: m.
        span: of the ranges in which it looks, m.
        range_cell: range resolution, m.
        limits: of the accelerations of the targets, m/s^2.
        elevations: receive beams of a search, over which its energy is spread; an update has one.
        false_alarms: expected number of an update and of a search, over all cells.
    """

    wavelength: float
    span: float
    range_cell: float
    limits: tuple[float, float]
    elevations: int
    false_alarms: tuple[float, float]

    def look(self, train: Train, searching: bool) -> Look:
        """With a train of pulses."""
        elevations = self.elevations if searching else 1
        cells = train.pulses * elevations / self.range_cell  # a burst has as many Doppler filters as pulses
        stretch = train.burst**2 / self.wavelength
        return Look(
            bursts=train.bursts,
            gain=train.burst / UNIT / elevations,
            threshold=float(gammainccinv(train.bursts, self.false_alarms[searching] / (cells * self.span))),
            cells=cells,
            rate_error=self.wavelength * math.sqrt(3.0) / (2.0 * math.pi * train.burst),
            stretch=stretch,
            kept=np.array([_mean_share(limit * stretch) for limit in self.limits]),
        )

    def menu(self, dwells: Dwells, laws: Laws, bins: int) -> Menu:
        """All actions, with their looks; bins: of range, of the undetected targets."""
        kind, which, train, duration = dwells.menu
        updates, searches = ([self.look(each, searching) for each in dwells.trains] for searching in (False, True))
        covers = np.zeros((dwells.each, len(laws.area.angle), 3, bins, len(laws.beam.sections)))
        for look, out in zip(searches, covers, strict=True):
            share_found(look, laws, out)
        looks = [(searches if is_search else updates)[t] for is_search, t in zip(kind == SEARCH, train, strict=True)]
        return Menu(kind, which, duration, train, covers, *(np.array(column) for column in zip(*looks, strict=True)))


def share_kept(beta: Array) -> Array:
    """``acceleration_loss`` by beta alone: of a burst of 1 s and a wavelength of 1 m."""
    return acceleration_loss(1.0, 1.0, beta)


def _mean_share(most: float) -> float:
    """Mean share of the energy kept, over accelerations that are uniform in a disc.

    Args:
        most: beta of the greatest acceleration along the line of sight.
    """
    turn = math.pi * (np.arange(ANGLES) + 0.5) / ANGLES  # the radial part is most cos(turn), with density sin^2(turn)
    return float(np.average(share_kept(most * np.cos(turn)), weights=np.square(np.sin(turn))))
