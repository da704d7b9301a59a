"""Frequency laws of generalised FM chirps: the instantaneous frequency over the pulse."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError
from wavegym.core.registry import Registry


@dataclass(frozen=True)
class FrequencyLaw:
    """A frequency law: functions of u in [0, 1], the elapsed share of the pulse, and of one shape parameter.

    Attributes:
        frequency: share of the sweep reached at (u, shape); rises from 0 at u = 0 to 1 at u = 1.
        phase: integral of ``frequency`` from 0 to u, at (u, shape).
        shape: name of the shape parameter; ``""`` for a law without one.
        default: the shape unless another is given.
        low, high: least and greatest shape.
        outside: why shapes beyond these are refused.
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


def check_law(name: str, law: object) -> None:
    """Raise an InputError unless ``law`` is a FrequencyLaw whose usual shape rises from 0 to 1 and fits its phase."""
    if not isinstance(law, FrequencyLaw):
        raise InputError(f"chirp law {name!r} is {law!r}, expected a FrequencyLaw")
    u = np.linspace(0.0, 1.0, 4001)
    frequency, phase = law.frequency(u, law.default), law.phase(u, law.default)
    if np.shape(frequency) != u.shape or np.shape(phase) != u.shape:
        raise InputError(f"chirp law {name!r} gives {np.shape(frequency)} for {u.shape} times, expected the same shape")
    if not (np.diff(frequency) >= 0.0).all() or not np.allclose(frequency[[0, -1]], [0.0, 1.0], rtol=0.0, atol=1e-9):
        raise InputError(f"frequency of chirp law {name!r} goes from {frequency[0]:g} to {frequency[-1]:g}, expected "
                         "a rise from 0 to 1")  # fmt: skip
    integral = np.append(0.0, np.cumsum(0.5 * (frequency[1:] + frequency[:-1]) * np.diff(u)))
    if not np.allclose(phase - phase[0], integral, rtol=0.0, atol=1e-3):
        raise InputError(f"phase of chirp law {name!r} is no integral of its frequency, expected one to 1e-3")


CHIRP_LAWS: Registry[FrequencyLaw] = Registry("chirp law", FREQUENCY_LAWS, check_law)


def resolve_shape(kind: str, shape: float | None) -> float:
    """The shape as a float, checked against its law; None stands for the law's default (0 for a law without a shape).

    Raises:
        InputError: if the law is unknown, takes no shape, or does not take this one.
    """
    law = CHIRP_LAWS.get(kind)
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
        InputError: if the law is unknown, or its shape is no number or out of range.
    """
    if not isinstance(text, str):
        raise InputError(f"law is {text!r}, expected a string such as 'hfm' or 'pfm:2.5'")
    kind, colon, written = text.strip().partition(":")
    law = CHIRP_LAWS.get(kind)
    if not colon:
        return kind, None
    try:
        shape = float(written)
    except ValueError:
        example = f"{kind}:{law.default:g}" if law.default else kind
        raise InputError(f"shape in {text!r} is {written!r}, expected a number, as in {example!r}") from None
    return kind, resolve_shape(kind, shape)
