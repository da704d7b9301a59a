"""Kernels of multistatic measurements: SNR over a propagation path, and the covariance of range and range-rate."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from wavegym.core.kernels import inlined

REFERENCE_RANGE = 100.0  # m, the half path length for which the SNR of a waveform is given


@inlined
def snr_at(r, reference, reflected):
    """eta at half path length r [m]; reference: eta at 100 m; reflected: fraction of the power left after walls."""
    near = REFERENCE_RANGE / r
    return reference * reflected * (near * near) * (near * near)


@inlined
def noise(wave, eta, rate_floor):
    """(R00, R01, R11) of range and range-rate; wave (2, 2): covariance at unit SNR; rate_floor: a deviation, m/s."""
    return wave[0, 0] / eta, wave[0, 1] / eta, wave[1, 1] / eta + rate_floor * rate_floor
