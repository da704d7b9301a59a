"""A frequency law that is steepest at both ends of the pulse: f(u) = (1 - s) u + s (4 (u - 1/2)^3 + 1/2)."""

from wavegym.waveforms import FrequencyLaw


def frequency(u, s):
    """Share of the sweep reached at u, the elapsed share of the pulse."""
    return (1.0 - s) * u + s * (4.0 * (u - 0.5) ** 3 + 0.5)


def phase(u, s):
    """Integral of the frequency from 0 to u."""
    return (1.0 - s) * 0.5 * u**2 + s * ((u - 0.5) ** 4 - 0.0625 + 0.5 * u)


cubic = FrequencyLaw(
    frequency,
    phase,
    shape="s",
    default=0.8,
    low=0.0,
    high=0.95,
    outside="below 0 the law is steepest in the middle; at 1 the frequency stands still there",
)
