from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.special import spherical_jn
from waveform_cases import KinkedChirp, chirps, trains

from wavegym.core.errors import InputError
from wavegym.waveforms import GaussianChirp, PulseTrain, Waveform, ambiguity, numeric_fisher_information
from wavegym.waveforms.numeric import NODES, legendre_moments, numeric_fisher_factors, resolve


def normalised(J, waveform):
    """J in units that make both diagonal elements near 1: tolerances are relative."""
    unit = np.diag(1 / np.sqrt(np.diag(waveform.fisher_information())))
    return unit @ J @ unit


def assert_same_factors(one, other, rtol):
    for name in ("residual", "slope", "spread"):
        scale = 1 / other.spread if name == "slope" else 0.0  # an unmodulated pulse has slope 0
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=rtol, atol=rtol * scale, err_msg=name)


@given(chirps())
def test_chirp_numeric_equals_closed_form(chirp):
    closed, numeric = chirp.fisher_information(), numeric_fisher_information(chirp)
    scale = np.sqrt(np.outer(np.diag(closed), np.diag(closed)))
    np.testing.assert_allclose(numeric / scale, closed / scale, rtol=1e-9, atol=1e-13)
    assert_same_factors(numeric_fisher_factors(chirp), chirp.fisher_factors(), rtol=1e-9)


@given(trains())
def test_train_numeric_equals_closed_form(train):
    closed, numeric = train.fisher_information(), numeric_fisher_information(train)
    scale = np.sqrt(np.outer(np.diag(closed), np.diag(closed)))
    np.testing.assert_allclose(numeric / scale, closed / scale, rtol=1e-9, atol=1e-13)
    assert_same_factors(numeric_fisher_factors(train), train.fisher_factors(), rtol=1e-9)


def minus_hessian_of_magnitude(waveform):
    """By finite differences of |chi|, in units of 1/sqrt(diag J).

    Kinks in the envelope put a term |x|^3 into |chi|, so along each direction 1 - |chi| is fitted by powers 2 to 7 of
    |x|; the coefficient of x^2 is half the curvature.
    """
    J = waveform.fisher_information()
    steps = 0.02 * np.arange(-6, 7)
    chi = np.abs(ambiguity(waveform, steps / np.sqrt(J[0, 0]), steps / np.sqrt(J[1, 1])))
    drops = 1 - np.stack([chi[:, 6], chi[6, :], np.diag(chi), np.diag(chi[:, ::-1])], axis=1)
    fit = np.linalg.solve(steps[7:, None] ** np.arange(2, 8), 0.5 * (drops[7:] + drops[5::-1]))
    delay, doppler, rising, falling = 2 * fit[0]
    off = (rising - falling) / 4
    return np.array([[delay, off], [off, doppler]])


HESSIAN_CASES = [
    GaussianChirp(duration=1e-6),
    GaussianChirp(duration=100e-6, chirp_rate=1e8),
    GaussianChirp(duration=100e-6, chirp_rate=1.5e10, direction="down"),
    GaussianChirp(duration=300e-6, chirp_rate=7.8e10),
    PulseTrain(GaussianChirp(duration=1e-6, chirp_rate=3e12), count=8, interval=40e-6),
    KinkedChirp("lfm", 100e-6, 0.3e6),
    KinkedChirp("pfm", 100e-6, 15e6, shape=3),
    KinkedChirp("hfm", 100e-6, 1e6),
    KinkedChirp("efm", 20e-6, 1e6),
]


@pytest.mark.parametrize("waveform", HESSIAN_CASES, ids=lambda w: w.label)
def test_information_is_minus_the_hessian_of_the_ambiguity_magnitude(waveform):
    J = normalised(waveform.fisher_information(), waveform)
    np.testing.assert_allclose(minus_hessian_of_magnitude(waveform), J, rtol=1e-6, atol=1e-7)


@settings(max_examples=20)
@given(chirps())
def test_information_is_minus_the_hessian_for_any_chirp(chirp):
    J = normalised(chirp.fisher_information(), chirp)
    np.testing.assert_allclose(minus_hessian_of_magnitude(chirp), J, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize(
    ("law", "shape", "sigma_range", "sigma_rate"),
    [
        ("lfm", 0.5, 2289.70, 33024.7),
        ("pfm", 3, 24.3753, 361.710),
        ("hfm", 0.5, 25.5369, 330.502),
        ("efm", 0.5, 26.5842, 365.751),
    ],
)
def test_a_waveform_with_kinks_needs_only_its_pieces(law, shape, sigma_range, sigma_rate):
    """Trapezoid chirps of 100 us and 15 MHz at 10.4 GHz against published-setting values, six digits."""
    chirp = KinkedChirp(law, 100e-6, 15e6, shape)
    R = chirp.measurement_covariance(carrier_hz=10.4e9, snr=1.0)
    assert np.sqrt(R[0, 0]) == pytest.approx(sigma_range, rel=3e-6)
    assert np.sqrt(R[1, 1]) == pytest.approx(sigma_rate, rel=3e-6)


def test_trapezoid_moments():
    """Elementary integrals of an unmodulated trapezoid of duration 1 and edges e: all moments by hand."""
    e = 1 / 20
    energy = 0.9 + 2 * e / 3
    bandwidth = 2 / (e * energy)
    flat = 2 * 0.45**3 / 3
    # int over one edge of (0.5 - e x)^2 x^2 e dx, x from 0 to 1
    edge = e * (0.25 / 3 - e / 4 + e * e / 5)
    J = numeric_fisher_information(KinkedChirp("lfm", 1.0, 0.0))
    assert J[0, 0] == pytest.approx(bandwidth, rel=1e-12)
    assert J[1, 1] == pytest.approx(4 * np.pi**2 * (flat + 2 * edge) / energy, rel=1e-12)
    assert J[0, 1] == pytest.approx(0, abs=1e-12)


def test_an_undeclared_kink_is_an_error():
    with pytest.raises(InputError, match=r"envelope or phase of hfm is not smooth, .* `pieces`"):
        numeric_fisher_information(KinkedChirp("hfm", 1e-4, 1e6, declared=False))


class Scaled(Waveform):
    """A Gaussian pulse with a wrong energy or zero energy."""

    label = "scaled"
    support = (-8.0, 8.0)

    def __init__(self, factor):
        self.factor = factor

    def envelope(self, t):
        return self.factor * GaussianChirp(duration=1.0).envelope(t)

    def phase(self, t):
        return 0 * t


@pytest.mark.parametrize(("factor", "energy"), [(2.0, "4"), (0.0, "0")])
def test_wrong_energy_is_an_error(factor, energy):
    with pytest.raises(InputError, match=f"energy of scaled is {energy}, expected 1"):
        numeric_fisher_information(Scaled(factor))


def test_not_a_number_is_an_error():
    with pytest.raises(InputError, match="expected finite values"):
        numeric_fisher_information(Scaled(float("nan")))


class Rectangle(Waveform):
    """A rectangular pulse: its delay information is infinite."""

    label = "rectangle"
    support = (-5e-5, 5e-5)

    def envelope(self, t):
        return np.where(np.abs(t) <= 5e-5, 1e-4**-0.5, 0.0)

    def phase(self, t):
        return np.zeros_like(t)


def test_an_envelope_with_jumps_is_refused():
    with pytest.raises(InputError, match="envelope of rectangle jumps by 1 of its peak"):
        Rectangle().fisher_information()


def test_moments_are_spherical_bessel_functions():
    z = np.concatenate([[0.0, 1e-12, -1e-3], np.linspace(-80, 80, 321), [1e3, -1e5]])[None]
    order = np.arange(NODES)[:, None]
    expected = 2 * (-1j) ** order * spherical_jn(order, z)
    np.testing.assert_allclose(legendre_moments(z)[0], expected, atol=5e-14)


def test_a_resolved_function_is_integrated_and_differentiated_to_rounding():
    def wave(t):
        return np.stack([np.sin(40 * t), np.exp(-t)])

    expansion = resolve(wave, np.array([0.0, 2.0]), np.array([1.0, 2.5]), np.ones(2), "wave")
    area = (expansion.values * expansion.weights).sum(axis=(1, 2, 3))
    sine = (1 - np.cos(40) + np.cos(80) - np.cos(100)) / 40
    decay = 1 - np.exp(-1) + np.exp(-2) - np.exp(-2.5)
    np.testing.assert_allclose(area, [sine, decay], atol=1e-14)
    slopes = [40 * np.cos(40 * expansion.times), -np.exp(-expansion.times)]
    np.testing.assert_allclose(expansion.derivative(), slopes, atol=1e-9)


@pytest.mark.parametrize("omega", [0.0, 3.0, -50.0, 4e4])
def test_fourier_integral(omega):
    expansion = resolve(lambda t: np.exp(-t)[None], np.array([-1.0, 1.0]), np.array([0.5, 2.0]), np.ones(1), "decay")
    exponent = -(1 + 1j * omega)
    exact = sum((np.exp(exponent * b) - np.exp(exponent * a)) / exponent for a, b in ((-1, 0.5), (1, 2)))
    assert expansion.fourier(np.array([omega]))[0, 0] == pytest.approx(exact, abs=2e-14)
