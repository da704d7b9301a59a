"""Controlled tracking in urban terrain with receivers that process simulated signals."""

from __future__ import annotations

from typing import Literal

from wavegym.core.parameters import changed_default, system_parameters
from wavegym.systems.urban.system import Urban


@system_parameters
class UrbanSignal(Urban):
    """The urban loop at the signal level: pulse trains at array elements, matched filters, peaks.

    Description
        As wavegym/Urban-v0, but measurements come from simulated signals at the three elements of each receiver: echoes
        of targets over all paths, and noise. The mean of thirty frames without targets is subtracted. This cancels the
        echoes of walls and trees and adds the noise of the mean. Matched filters give an image over delay and Doppler.
        Peaks in the best direction count if they exceed a threshold that noise exceeds ``clutter_density`` times per (m
        x m/s). A quadratic fit to log |A|^2 measures them. Paths less than a resolution cell apart return one peak. A
        train has 25 pulses and lasts 25 ms. The echo of each path has a new phase and a new amplitude in every scan
        (``fluctuation``). The tracker knows that a receiver takes the greatest value of an image: its Pd is that of
        ``wavegym.sensors.detection_probability`` with searched = 3.

    Rewards
        As wavegym/Urban-v0.

    Starting state
        As wavegym/Urban-v0.

    Episode end
        As wavegym/Urban-v0.
    """

    pulses: int = changed_default(Urban, "pulses", 25)
    fidelity: Literal["measurement", "signal"] = changed_default(Urban, "fidelity", "signal")
