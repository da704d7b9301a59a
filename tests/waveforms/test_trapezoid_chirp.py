"""Generalised FM chirps with a trapezoid envelope, against reference values, quadrature and the ambiguity function."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_numeric_fisher import minus_hessian_of_magnitude, normalised
from waveform_cases import KinkedChirp, directions, durations

from wavegym.core.errors import InputError
from wavegym.waveforms import (
    PulseTrain,
    TrapezoidChirp,
    ambiguity,
    chirp_law,
    chirp_measurement_covariance,
    measurement_covariances,
    numeric_fisher_information,
    plot_ambiguity,
    trapezoid_chirp_library,
    trapezoid_fisher_factors,
)
from wavegym.waveforms.numeric import numeric_fisher_factors

CARRIER = 10.4e9
KINDS = ("lfm", "pfm", "hfm", "efm")
SHAPES = {"lfm": st.none(), "pfm": st.floats(2, 12), "hfm": st.floats(0.03, 20), "efm": st.floats(0.03, 20)}
RISES = st.floats(0.01, 0.5)


def chirp_of(kind, **changes):
    return TrapezoidChirp(**({"kind": kind, "duration": 100e-6, "sweep": 15e6} | changes))


@st.composite
def trapezoids(draw, largest_product=1e4, rises=RISES):
    """Chirps of any kind; the time-bandwidth product is 0 or spans decades."""
    kind, duration = draw(st.sampled_from(KINDS)), draw(durations)
    product = draw(st.one_of(st.just(0.0), st.floats(-1, np.log10(largest_product)).map(lambda e: 10.0**e)))
    return TrapezoidChirp(
        kind=kind,
        duration=duration,
        sweep=product / duration,
        shape=draw(SHAPES[kind]),
        direction=draw(directions),
        rise=draw(rises) * duration,
    )


def one_minus_rho_squared(factors):
    return factors.residual / (factors.residual + factors.slope * factors.slope * factors.spread)


@pytest.mark.parametrize(
    ("kind", "sigma_range", "sigma_rate", "decoupling"),
    [
        ("lfm", "2289.70", "33024.7", "7e-06"),
        ("pfm", "24.3753", "361.710", "0.055"),
        ("hfm", "25.5369", "330.502", "0.066"),
        ("efm", "26.5842", "365.751", "0.054"),
    ],
)
def test_reference_values_to_all_printed_digits(kind, sigma_range, sigma_rate, decoupling):
    """100 us, 15 MHz, up, edges lam/20, SNR 1 at 10.4 GHz."""
    chirp = chirp_of(kind)
    R = chirp.measurement_covariance(CARRIER, snr=1)
    assert f"{np.sqrt(R[0, 0]):#.6g}" == sigma_range
    assert f"{np.sqrt(R[1, 1]):#.6g}" == sigma_rate
    assert f"{one_minus_rho_squared(chirp.fisher_factors()):.{1 if kind == 'lfm' else 2}g}" == decoupling
    assert 1 - R[0, 1] ** 2 / (R[0, 0] * R[1, 1]) == pytest.approx(float(decoupling), rel=0.1)


def test_decoupling_of_a_long_linear_chirp_to_all_digits():
    """1 - rho^2 from the elementary integrals of a trapezoid; from R itself ten of these digits are lost."""
    e, turns = 0.05, 2 * np.pi * 15e6 * 100e-6
    energy = 1 - 4 * e / 3
    spread = (2 * 0.45**3 / 3 + 2 * e * (0.25 / 3 - e / 4 + e * e / 5)) / energy
    bandwidth = 2 / (e * energy)
    expected = bandwidth / (bandwidth + turns * turns * spread)
    assert one_minus_rho_squared(chirp_of("lfm").fisher_factors()) == pytest.approx(expected, rel=1e-14)


@given(trapezoids())
def test_closed_form_equals_quadrature(chirp):
    numeric, closed = numeric_fisher_factors(chirp), chirp.fisher_factors()
    # A chirp of product 1e4 has 1 - rho^2 of 1e-7, so that agreement of its residual means 1e-16 of J.
    np.testing.assert_allclose(numeric.residual, closed.residual, rtol=1e-9)
    np.testing.assert_allclose(numeric.slope, closed.slope, rtol=1e-9, atol=1e-9 / closed.spread)
    np.testing.assert_allclose(numeric.spread, closed.spread, rtol=1e-9)
    J = closed.information()
    scale = np.sqrt(np.outer(np.diag(J), np.diag(J)))
    np.testing.assert_allclose(numeric_fisher_information(chirp) / scale, J / scale, rtol=1e-9, atol=1e-13)


@given(trapezoids(rises=st.just(0.05)))
def test_closed_form_equals_an_independent_pulse(chirp):
    upward = replace(chirp, direction="up").fisher_factors()
    other = numeric_fisher_factors(KinkedChirp(chirp.kind, chirp.duration, chirp.sweep, chirp.shape))
    # The other pulse's phase has terms g (g + 1) times too large, whose rounding remains.
    rtol = 1e-9 * (1 + chirp.law.shape**2 if chirp.kind in ("hfm", "efm") else 1)
    np.testing.assert_allclose(other.residual, upward.residual, rtol=rtol)
    np.testing.assert_allclose(other.slope, upward.slope, rtol=rtol, atol=rtol / upward.spread)
    np.testing.assert_allclose(other.spread, upward.spread, rtol=1e-9)


HESSIAN_CASES = [chirp_of(kind, sweep=3e6, direction=way) for kind in KINDS[1:] for way in ("up", "down")]
HESSIAN_CASES += [chirp_of("lfm", sweep=0.3e6), chirp_of("efm", shape=2.0, sweep=1e6, rise=50e-6)]
HESSIAN_CASES += [chirp_of("pfm", shape=2.5, sweep=1e6, rise=20e-6), chirp_of("hfm"), chirp_of("hfm", sweep=0)]


@pytest.mark.parametrize("chirp", HESSIAN_CASES, ids=lambda w: w.label)
def test_information_is_minus_the_hessian_of_the_ambiguity_magnitude(chirp):
    J = normalised(chirp.fisher_information(), chirp)
    np.testing.assert_allclose(minus_hessian_of_magnitude(chirp), J, rtol=1e-6, atol=1e-7)


@given(trapezoids(largest_product=100))
def test_energy_is_one(chirp):
    low, high = np.array(chirp.pieces).T
    x, w = np.polynomial.legendre.leggauss(4)  # exact: a^2 is a parabola
    t = low[:, None] + 0.5 * (high - low)[:, None] * (x + 1)
    energy = (np.abs(chirp.signal(t)) ** 2 * w * 0.5 * (high - low)[:, None]).sum()
    assert energy == pytest.approx(1, abs=1e-12)
    begin, end = chirp.support
    assert (begin, end) == (chirp.pieces[0][0], chirp.pieces[-1][1])
    np.testing.assert_array_equal(chirp.signal([begin, 2 * begin, end, 2 * end]), 0)


@given(trapezoids())
def test_the_frequency_has_the_given_sweep_and_direction(chirp):
    begin, end = chirp.support
    sign = 1 if chirp.direction == "up" else -1
    frequency = np.array([_frequency(chirp, t) for t in np.linspace(begin, end, 21)])
    noise = 1e-5 * chirp.sweep
    assert frequency[-1] - frequency[0] == pytest.approx(sign * chirp.sweep, abs=noise)
    assert frequency[0] == pytest.approx(-sign * chirp.sweep / 2, abs=noise)
    assert (sign * np.diff(frequency) >= -noise).all()


def _frequency(chirp, t):
    """Instantaneous frequency, Hz, at t inside the pulse: slope of the phase's fit over a small window about t."""
    begin, end = chirp.support
    width = 1e-3 * (end - begin)
    low = min(max(t - width / 2, begin), end - width)
    x = np.linspace(-1, 1, 33)
    phase = chirp.phase(low + width / 2 * (x + 1))
    fit = np.polynomial.Polynomial.fit(x, phase - phase[16], 6, domain=(-1, 1))
    return fit.deriv()((t - low) / width * 2 - 1) * 2 / width / (2 * np.pi)


@given(trapezoids())
def test_the_direction_flips_the_sign_of_the_correlation_and_nothing_else(chirp):
    flipped = replace(chirp, direction="down" if chirp.direction == "up" else "up")
    carrier = 10 * max(chirp.sweep, 1.0)
    signs = np.array([[1, -1], [-1, 1]])
    R = chirp.measurement_covariance(carrier, 4.0)
    np.testing.assert_array_equal(flipped.measurement_covariance(carrier, 4.0), signs * R)
    assert R[0, 1] == 0 if chirp.sweep == 0 else (R[0, 1] < 0) == (chirp.direction == "up")


def test_a_mixed_batch_equals_its_elements_bit_for_bit():
    rng = np.random.default_rng(5)
    laws = [chirp_law(kind) for kind in KINDS] + [chirp_law("pfm", 2.5), chirp_law("efm", 0.2)]
    which = rng.integers(len(laws), size=(7, 5))
    lam, sweep = 10 ** rng.uniform(-6, -3, (7, 5)), rng.normal(0, 1e7, (7, 5))
    carriers = np.array([1e9, CARRIER])[:, None, None]
    moments = np.stack([law.moments for law in laws])[which]
    batch = chirp_measurement_covariance(moments, lam, sweep, carriers)
    assert batch.shape == (2, 7, 5, 2, 2)
    for i, j, f in np.ndindex(7, 5, 2):
        law, carrier = laws[which[i, j]], float(carriers[f, 0, 0])
        single = chirp_measurement_covariance(law.moments, float(lam[i, j]), float(sweep[i, j]), carrier)
        assert np.array_equal(single, batch[f, i, j])
        chirp = TrapezoidChirp(
            kind=law.kind,
            shape=law.shape or None,
            duration=float(lam[i, j]),
            sweep=abs(float(sweep[i, j])),
            direction="up" if sweep[i, j] >= 0 else "down",
        )
        assert np.array_equal(chirp.measurement_covariance(carrier, 1.0), batch[f, i, j])


def test_one_law_broadcasts_over_a_grid():
    factors = trapezoid_fisher_factors(chirp_law("hfm").moments, np.array([1e-5, 1e-4])[:, None], [1e6, -1e6, 0.0])
    assert factors.information().shape == (2, 3, 2, 2)


def test_a_train_of_trapezoids():
    train = PulseTrain(chirp_of("hfm", sweep=1e6), count=5, interval=150e-6)
    J = normalised(train.fisher_information(), train)
    np.testing.assert_allclose(normalised(numeric_fisher_information(train), train), J, rtol=1e-9, atol=1e-12)
    assert train.label == "5 x (HFM up 100 us 1 MHz) every 150 us"
    chi = ambiguity(train, [0.0, 150e-6], [0.0])
    np.testing.assert_allclose(np.abs(chi[:, 0]), [1, 0.8], atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_the_ambiguity_function_can_be_drawn(kind):
    figure = plot_ambiguity(chirp_of(kind, sweep=1e6))
    magnitude = figure.axes[0].images[0].get_array()
    assert magnitude.max() == pytest.approx(1, abs=1e-9)
    assert magnitude.min() >= 0


def test_the_default_rise_and_the_same_rise_given_are_one_law():
    assert chirp_of("hfm", rise=100e-6 / 20).law is chirp_of("hfm").law
    assert chirp_of("hfm", rise=7e-7, duration=14e-6).law is chirp_of("hfm").law
    assert len(chirp_of("hfm").pieces) == 3
    assert chirp_of("hfm", rise=50e-6).pieces == ((-50e-6, 0.0), (0.0, 50e-6))  # a triangle


@pytest.mark.parametrize(
    ("changes", "label"),
    [
        ({"kind": "hfm"}, "HFM up 100 us 15 MHz"),
        ({"kind": "hfm", "shape": 0.3, "direction": "down"}, "HFM0.3 down 100 us 15 MHz"),
        ({"kind": "pfm", "rise": 1e-6}, "PFM3 up 100 us 15 MHz rise 1 us"),
        ({"kind": "efm", "sweep": 0}, "unmodulated trapezoid 100 us"),
    ],
)
def test_labels(changes, label):
    assert chirp_of(**changes).label == label


def test_a_library_varies_the_direction_fastest_and_the_kind_slowest():
    library = trapezoid_chirp_library(["lfm", "hfm:0.3"], [10e-6, 100e-6], [1e6, 15e6])
    assert library.labels[:5] == (
        "LFM up 10 us 1 MHz",
        "LFM down 10 us 1 MHz",
        "LFM up 10 us 15 MHz",
        "LFM down 10 us 15 MHz",
        "LFM up 100 us 1 MHz",
    )
    assert library.labels[8] == "HFM0.3 up 10 us 1 MHz"
    assert len(library) == 16
    assert measurement_covariances(library, CARRIER).shape == (16, 2, 2)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: chirp_of("xfm"), "chirp law is 'xfm', expected one of 'lfm', 'pfm', 'hfm', 'efm'; did you mean"),
        (
            lambda: chirp_of("lfm", direction="dwn"),
            "direction is 'dwn', expected one of 'up', 'down'; did you mean 'down'?",
        ),
        (lambda: chirp_of("lfm", duration=0.0), "duration is 0.0 s, expected a finite number > 0"),
        (lambda: chirp_of("lfm", sweep=-1e6), "sweep is -1000000.0 Hz, expected a finite number >= 0; for a falling"),
        (lambda: chirp_of("lfm", sweep=np.inf), "sweep is inf Hz, expected a finite number >= 0"),
        (lambda: chirp_of("lfm", shape=3), "shape is 3, expected None for 'lfm'"),
        (lambda: chirp_of("pfm", shape=1.0), "shape kappa of 'pfm' is 1.0, expected a number in [2, 64] (nearest: 2)"),
        (lambda: chirp_of("hfm", shape=-0.5), "shape g of 'hfm' is -0.5, expected a number in [0.01, 100]"),
        (lambda: chirp_of("lfm", rise=51e-6), "rise is 5.1e-05 s, expected a time > 0 and at most half the duration"),
        (lambda: chirp_of("lfm", rise=0.0), "at most half the duration (nearest: 5e-06)"),
        (lambda: chirp_of("lfm").measurement_covariance(CARRIER, 0.0), "snr is 0.0, expected a finite number > 0"),
        (lambda: chirp_of("lfm").measurement_covariance(-1.0, 1.0), "carrier_hz is -1.0 Hz"),
        (lambda: chirp_of("lfm").measurement_covariance(15e6, 1.0), "15000000.0 Hz, expected less than the carrier"),
        (lambda: trapezoid_chirp_library(["lfn"], [1e-4], [1e6]), "chirp law is 'lfn'"),
        (lambda: trapezoid_chirp_library(["pfm", "pfm:3"], [1e-4], [1e6]), "holds 'PFM3 up 100 us 1 MHz' 2 times"),
        (lambda: trapezoid_chirp_library(["lfm"], [1e-4], [0.0]), "holds 'unmodulated trapezoid 100 us' 2 times"),
        (lambda: trapezoid_chirp_library([], [1e-4], [1e6]), "library is empty"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(InputError, match=re.escape(message)) as error:
        make()
    assert "\n" not in str(error.value)
