"""RF/EO platforms with fast, distant targets, whose echoes fold."""

from __future__ import annotations

from typing import Literal

from wavegym.core.parameters import changed_default, system_parameters
from wavegym.systems.rf_eo.scenario import Bounds, Position, StateVariance, TargetState
from wavegym.systems.rf_eo.system import RfEo


@system_parameters
class RfEoFar(RfEo):
    """The RF/EO loop with fast, distant targets, whose ranges and range-rates fold.

    Description
        As wavegym/RfEo-v0 with platforms at (-10, -10) and (10, -10) km and two targets 30 to 40 km away. One recedes
        at 230 m/s, one closes at 210 m/s, and q = 1 m^2/s^3. r |rdot| exceeds c lambda / 8, so no pulse repetition
        frequency (PRF) measures both range and range-rate without ambiguity: echoes fold (``folding``).

        A low PRF resolves range-rates finely, but its notch hides more of them, and its folds need a narrow prediction.
        Every PRF has blind zones of range. So the best PRF changes as the targets move through blind zones and notches.
        The lowest PRF is 2 kHz, at which the notch of +-10 m/s leaves a third of the range-rates.

        Schedulers require predicted azimuths to be two standard deviations inside the image (``margin``). With
        ``folding=False, prf=(1e3, 1e5)`` echoes beyond the unambiguous interval vanish: the range then needs at most 4
        kHz, the range-rate at least 30 kHz.

    Rewards
        As wavegym/RfEo-v0.

    Starting state
        The first estimates are drawn around the true starts with covariance P0 = diag(prior_variance)
        (``first_estimate="drawn"``).

    Episode end
        Truncated after 200 steps (``horizon``), when the closing target passes between the platforms.
    """

    horizon: int = changed_default(RfEo, "horizon", 200)
    q: float = changed_default(RfEo, "q", 1.0)
    platforms: tuple[Position, ...] = changed_default(RfEo, "platforms", ((-10e3, -10e3), (10e3, -10e3)))
    starts: tuple[TargetState, ...] = changed_default(
        RfEo, "starts", ((-5e3, 0.0, 20e3, 230.0), (0.0, 0.0, 30e3, -210.0))
    )
    first_estimate: Literal["halfway", "drawn"] = changed_default(RfEo, "first_estimate", "drawn")
    prior_variance: StateVariance = changed_default(RfEo, "prior_variance", (1e6, 400.0, 1e6, 400.0))
    prf: Bounds = changed_default(RfEo, "prf", (2e3, 100e3))
    folding: bool = changed_default(RfEo, "folding", True)
    margin: float = changed_default(RfEo, "margin", 2.0)
