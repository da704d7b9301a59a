"""Frequency laws of generalised FM chirps: how the instantaneous frequency runs through the sweep."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError, check_choice


@dataclass(frozen=True)
class FrequencyLaw:
    """A law of u in [0, 1], the share of the pulse gone by, up to its shape.

    Attributes:
        frequency: share of the sweep reached at u, rising from 0 to 1.
        phase: integral of ``frequency`` from 0 to u.
        shape: what the shape is called; ``""`` for a law without.
        default: the usual shape.
        low, high: shapes taken.
        outside: why no others are.
    """

    frequency: Callable[[FloatArray, float], FloatArray]
    phase: Callable[[FloatArray, float], FloatArray]
    shape: str = ""
    default: float = 0.0
    low: float = 0.0
    high: float = 0.0
    outside: str = ""


_OUTSIDE_G = (
    "above, the chirp is linear to 0.3 % (use 'lfm'); below, half the sweep takes 1 % of the pulse; at 0 it folds"
)

FREQUENCY_LAWS = {
    "lfm": FrequencyLaw(lambda u, _: u, lambda u, _: 0.5 * (u * u)),
    "pfm": FrequencyLaw(
        lambda u, kappa: u ** (kappa - 1.0),
        lambda u, kappa: u**kappa / kappa,
        shape="kappa",
        default=3.0,
        low=2.0,
        high=64.0,
        outside="below 2 the chirp rate is infinite where the pulse begins, and from 1 on the chirp folds",
    ),
    "hfm": FrequencyLaw(
        lambda u, g: (g + 1.0) * u / (g + u),
        lambda u, g: (g + 1.0) * (u - g * np.log1p(u / g)),
        shape="g",
        default=0.5,
        low=0.01,
        high=100.0,
        outside=_OUTSIDE_G,
    ),
    "efm": FrequencyLaw(
        lambda u, g: np.expm1(-u / g) / np.expm1(-1.0 / g),
        lambda u, g: (u + g * np.expm1(-u / g)) / -np.expm1(-1.0 / g),
        shape="g",
        default=0.5,
        low=0.01,
        high=100.0,
        outside=_OUTSIDE_G,
    ),
}
"""By kind: linear u, power u^(kappa-1), hyperbolic -g (g+1)/(g+u), exponential -exp(-u/g)/(1 - exp(-1/g)) FM.

The last two up to a constant that makes them begin at 0; g = gamma/lam. Source: Sira, Papandreou-Suppappola, Morrell
and Cochran, Waveform-agile sensing for tracking multiple targets in clutter, Table 1, in units of the sweep and the
pulse duration lam.
"""

KINDS = tuple(FREQUENCY_LAWS)


def resolve_shape(kind: str, shape: float | None) -> float:
    """Check kind and shape; the shape as a float, the kind's default for None (0 for "lfm", which has none).

    Raises:
        InputError: if the kind is unknown, an "lfm" is given a shape, or the chirp would fold or be no longer smooth.
    """
    law = FREQUENCY_LAWS[check_choice("kind", kind, KINDS)]
    if shape is None:
        return law.default
    if not law.shape:
        raise InputError(f"shape is {shape!r}, expected None for {kind!r}, which has no shape")
    if not law.low <= shape <= law.high:
        closest = f" (nearest: {min(max(shape, law.low), law.high):g})" if shape == shape else ""
        raise InputError(
            f"shape {law.shape} of {kind!r} is {shape!r}, "
            f"expected a number in [{law.low:g}, {law.high:g}]{closest}: {law.outside}"
        )
    return float(shape)


def parse_law(text: str) -> tuple[str, float | None]:
    """Kind and shape of ``"hfm"`` or ``"pfm:2.5"``; the shape is None where none is written.

    Raises:
        InputError: if the kind is unknown, or the shape no number or not one that the kind takes.
    """
    if not isinstance(text, str):
        raise InputError(f"law is {text!r}, expected a string such as 'hfm' or 'pfm:2.5'")
    kind, colon, written = text.strip().partition(":")
    check_choice("kind", kind, KINDS)
    if not colon:
        return kind, None
    try:
        shape = float(written)
    except ValueError:
        usual = FREQUENCY_LAWS[kind].default
        example = f"{kind}:{usual:g}" if usual else kind
        raise InputError(f"shape in {text!r} is {written!r}, expected a number, as in {example!r}") from None
    return kind, resolve_shape(kind, shape)
