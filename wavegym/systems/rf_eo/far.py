"""The RF/EO platforms before fast, distant targets: where no single pulse repetition frequency will do."""

from __future__ import annotations

from typing import Literal

from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from wavegym.systems.rf_eo.state import Pair, Quad
from wavegym.systems.rf_eo.system import RfEo


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class RfEoFar(RfEo):
    """The RF/EO loop with fast, distant targets, where the pulse repetition frequency has to alternate.

    Description
        As wavegym/RfEo-v0 with platforms at (-10, -10) and (10, -10) km and two targets 30 to 40 km away, one receding
        at 230 m/s and one closing at 210 m/s, q = 1 m^2/s^3. r |rdot| is beyond c lambda / 8, so no pulse repetition
        frequency sees both range and range-rate: at most 4 kHz is needed for the one, 30 kHz for the other. Schedulers
        want what they count on two standard deviations inside the field of view (``margin``): without, a first
        measurement that is missed costs a few episodes a hundred times as much.

    Rewards
        As wavegym/RfEo-v0.

    Starting state
        The first estimates are drawn around the true starts with covariance P0 = diag(prior_variance)
        (``first_estimate="drawn"``).

    Episode end
        Truncated after 200 steps (``horizon``), when the closing target passes between the platforms.
    """

    horizon: int = 200
    q: float = 1.0
    platforms: tuple[Pair, ...] = ((-10e3, -10e3), (10e3, -10e3))
    starts: tuple[Quad, ...] = ((-5e3, 0.0, 20e3, 230.0), (0.0, 0.0, 30e3, -210.0))
    first_estimate: Literal["halfway", "drawn"] = "drawn"
    prior_variance: Quad = (1e6, 400.0, 1e6, 400.0)
    margin: float = 2.0
