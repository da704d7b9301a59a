"""Controlled tracking in urban terrain with receivers that process signals, pulse by pulse."""

from __future__ import annotations

from typing import Literal

from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from wavegym.systems.urban.system import Urban


@dataclass(frozen=True, config=ConfigDict(extra="forbid", allow_inf_nan=False))
class UrbanSignal(Urban):
    """The urban loop down to the signals: pulse trains at array elements, matched filters, peaks.

    Description
        As wavegym/Urban-v0, but measurements are found in what three elements of each receiver sample: echoes of
        targets by every way, of walls and trees, and noise. Each element's matched filter makes an image over delay and
        Doppler; the mean of thirty frames of the empty street is subtracted. Peaks in the best direction, above a
        threshold that noise passes ``clutter_density`` times per (m x m/s), are measured by a quadratic fit to
        log |A|^2. Ways that are less than a resolution cell apart return one peak. Trains are of 25 pulses, 25 ms.

    Rewards
        As wavegym/Urban-v0.

    Starting state
        As wavegym/Urban-v0.

    Episode end
        As wavegym/Urban-v0.
    """

    pulses: int = 25
    fidelity: Literal["measurement", "signal"] = "signal"
