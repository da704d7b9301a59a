import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from waveform_cases import chirps

from wavegym.core.errors import InputError
from wavegym.waveforms import (
    SPEED_OF_LIGHT,
    GaussianChirp,
    chirp_rate_for_sweep,
    gaussian_measurement_covariance,
    sweep_for_chirp_rate,
)


def printed_covariance(k, signed_rate, carrier_hz, eta):
    """R as printed by Kershaw and Evans."""
    c, wc = SPEED_OF_LIGHT, 2 * np.pi * carrier_hz
    off = -(c**2) * signed_rate * k**2 / wc
    return np.array([[c**2 * k**2 / 2, off], [off, (c / wc) ** 2 * (1 / (2 * k**2) + 2 * signed_rate**2 * k**2)]]) / eta


def test_reference_covariance_to_all_printed_digits():
    chirp = GaussianChirp(duration=100e-6, chirp_rate=1e8, direction="up")
    R = chirp.measurement_covariance(carrier_hz=10.4e9, snr=100) / (SPEED_OF_LIGHT / 3e8) ** 2
    assert R[0, 0] == pytest.approx(4.5e6, rel=1e-12)
    assert round(R[0, 1], 4) == -13773.0239
    assert R[1, 0] == R[0, 1]
    assert round(R[1, 1], 7) == 52.6933855


@given(chirps(), st.floats(1e8, 1e11), st.floats(1e-3, 1e6))
def test_covariance_is_the_printed_formula(chirp, carrier, eta):
    expected = printed_covariance(chirp.duration, chirp.signed_chirp_rate, carrier, eta)
    np.testing.assert_allclose(chirp.measurement_covariance(carrier, eta), expected, rtol=1e-13)


@given(chirps(largest_product=1e2), st.floats(1e-2, 1e4))
def test_covariance_is_the_scaled_inverse_of_the_information(chirp, eta):
    carrier = 10e9
    gamma = np.diag([SPEED_OF_LIGHT / 2, -SPEED_OF_LIGHT / (2 * carrier)])
    k = chirp.duration
    unit = np.diag([k, 1 / k])  # inverted in normalised time: J in SI units is too badly scaled
    J = unit @ chirp.fisher_information() @ unit * eta
    expected = gamma @ unit @ np.linalg.inv(J) @ unit @ gamma.T
    # Inverting J loses its condition number, about (g k^2)^2 here.
    np.testing.assert_allclose(chirp.measurement_covariance(carrier, eta), expected, rtol=1e-9)


@given(chirps())
def test_determinant_of_the_information_does_not_depend_on_the_chirp(chirp):
    J = chirp.fisher_information()
    cancelled = J[0, 0] * J[1, 1] * 1e-15  # rounding of the products that are subtracted
    assert J[0, 0] * J[1, 1] - J[0, 1] * J[1, 0] == pytest.approx(np.pi**2, rel=1e-12, abs=4 * cancelled)


@given(chirps())
def test_energy_is_one(chirp):
    t = np.linspace(*chirp.support, 2001)
    assert np.trapezoid(np.abs(chirp.signal(t)) ** 2, t) == pytest.approx(1, abs=1e-13)


def test_frequency_rises_for_up_and_falls_for_down():
    t = np.linspace(-1e-4, 1e-4, 5)
    rate = 3e9
    for direction, sign in (("up", 1), ("down", -1)):
        chirp = GaussianChirp(duration=1e-4, chirp_rate=rate, direction=direction)
        step = 1e-7
        frequency = (chirp.phase(t + step) - chirp.phase(t - step)) / (2 * step)
        np.testing.assert_allclose(frequency, sign * 2 * rate * t, rtol=1e-9, atol=1e-3)


def test_effective_length_is_where_the_amplitude_is_a_thousandth():
    chirp = GaussianChirp(duration=2e-6)
    assert chirp.effective_length == pytest.approx(7.4338 * 2e-6, rel=1e-5)
    assert chirp.envelope(chirp.effective_length / 2) / chirp.envelope(0.0) == pytest.approx(1e-3, rel=1e-12)


def test_a_batch_equals_its_elements_bit_for_bit():
    rng = np.random.default_rng(3)
    k, g = 10 ** rng.uniform(-6, -3, (7, 5)), rng.normal(0, 1e10, (7, 5))
    carriers = rng.uniform(1e9, 2e10, (2, 1, 1))
    batch = gaussian_measurement_covariance(k, g, carriers)
    assert batch.shape == (2, 7, 5, 2, 2)
    for i, j, f in np.ndindex(7, 5, 2):
        single = gaussian_measurement_covariance(float(k[i, j]), float(g[i, j]), float(carriers[f, 0, 0]))
        assert np.array_equal(single, batch[f, i, j])
        direction = "up" if g[i, j] >= 0 else "down"
        chirp = GaussianChirp(duration=float(k[i, j]), chirp_rate=float(abs(g[i, j])), direction=direction)
        assert np.array_equal(chirp.measurement_covariance(float(carriers[f, 0, 0]), 1.0), batch[f, i, j])


@given(st.floats(-1e8, 1e8), st.floats(1e-8, 1e-2))
def test_sweep_rule_and_its_inverse(sweep, k):
    assert sweep_for_chirp_rate(chirp_rate_for_sweep(sweep, k), k) == pytest.approx(sweep, rel=1e-14)


def test_sweep_is_the_frequency_swept_in_two_durations():
    k, sweep = 50e-6, 2e6
    g = float(chirp_rate_for_sweep(sweep, k))
    frequency = 2 * g * np.array([-k, k]) / (2 * np.pi)
    assert np.ptp(frequency) == pytest.approx(sweep)
    assert g == pytest.approx(np.pi * sweep / (2 * k), rel=1e-15)


@pytest.mark.parametrize(
    ("arguments", "label"),
    [
        ({"duration": 1e-4, "chirp_rate": float(chirp_rate_for_sweep(1e6, 1e-4))}, "up 100 us 1 MHz"),
        (
            {"duration": 2e-3, "chirp_rate": float(chirp_rate_for_sweep(5e3, 2e-3)), "direction": "down"},
            "down 2 ms 5 kHz",
        ),
        ({"duration": 1.375e-6}, "unmodulated 1.375 us"),
        ({"duration": 50e-9}, "unmodulated 50 ns"),
    ],
)
def test_label(arguments, label):
    assert GaussianChirp(**arguments).label == label


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"duration": -1e-6}, r"duration is -1e-06 s, expected a finite number > 0"),
        ({"duration": 0.0}, r"duration is 0\.0 s"),
        ({"duration": float("nan")}, r"duration is nan s"),
        ({"duration": 1e-6, "chirp_rate": -1.0}, r"chirp_rate is -1\.0 rad/s\^2, expected a finite number >= 0"),
        ({"duration": 1e-6, "direction": "upp"}, r"direction is 'upp'.*did you mean 'up'"),
    ],
)
def test_bad_parameters(arguments, message):
    with pytest.raises(InputError, match=message):
        GaussianChirp(**arguments)


@pytest.mark.parametrize(
    ("carrier", "snr", "message"),
    [(0.0, 1.0, "carrier_hz is 0.0 Hz"), (1e9, 0.0, "snr is 0.0"), (1e9, -3.0, "snr is -3.0")],
)
def test_bad_carrier_or_snr(carrier, snr, message):
    with pytest.raises(InputError, match=message):
        GaussianChirp(duration=1e-6).measurement_covariance(carrier_hz=carrier, snr=snr)


def test_frozen_and_keyword_only():
    with pytest.raises(AttributeError):
        GaussianChirp(duration=1e-6).duration = 2e-6
    with pytest.raises(TypeError):
        GaussianChirp(1e-6)
