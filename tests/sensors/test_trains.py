"""The law of a coherent train against simulated pulses in plain NumPy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import maximum_filter

from wavegym.core.errors import InputError
from wavegym.sensors.detection import detection_probability
from wavegym.sensors.trains import (
    acceleration_loss,
    false_return_density,
    false_return_threshold,
    mean_rate_variance,
    motion_loss,
)
from wavegym.waveforms import GaussianChirp, PulseTrain, TrapezoidChirp, Waveform
from wavegym.waveforms.fisher import SPEED_OF_LIGHT

CARRIER, WAVE = 10e9, SPEED_OF_LIGHT / 10e9
PULSES, PADDED = 128, 32
THRESHOLDS = np.array([4.0, 6.0, 8.0])
SPACING = 0.2  # of cells, in standard deviations of delay and Doppler at eta = 1


def share_kept(ranges: np.ndarray) -> np.ndarray:
    """Greatest power over Doppler of echoes from ranges (world, pulse), over that of a target at rest."""
    echoes = np.exp(4j * math.pi / WAVE * ranges)
    return (np.abs(np.fft.fft(echoes, PADDED * ranges.shape[1], axis=1)) ** 2).max(axis=1) / ranges.shape[1] ** 2


def paths(rng: np.random.Generator, duration: float, q: float, sigma: float, worlds: int) -> tuple:
    """Ranges (world, pulse) in a train, and range-rates at its middle: white and steady accelerations."""
    dt = duration / PULSES
    t = (np.arange(PULSES) + 0.5) * dt - 0.5 * duration
    rate = np.cumsum(np.sqrt(q * dt) * rng.standard_normal((worlds, PULSES)), axis=1)
    rate += 30.0 * rng.standard_normal((worlds, 1)) + sigma * rng.standard_normal((worlds, 1)) * t
    ranges = np.cumsum(rate, axis=1) * dt
    return t, ranges, 0.5 * (rate[:, PULSES // 2 - 1] + rate[:, PULSES // 2])


@pytest.mark.parametrize(
    ("duration", "q", "sigma"),
    [(0.02, 0.0, 0.0), (0.064, 1.0, 0.0), (0.064, 10.0, 0.0), (0.064, 100.0, 0.0), (0.256, 100.0, 0.0),
     (0.064, 0.0, 3.0), (0.064, 0.0, 20.0), (0.064, 0.0, 80.0), (0.128, 0.0, 80.0), (0.064, 10.0, 20.0)],
)  # fmt: skip
def test_motion_leaves_the_simulated_share(duration, q, sigma) -> None:
    """The fit of white acceleration holds to 0.16 dB, both kinds together to 0.6 dB."""
    _, ranges, _ = paths(np.random.default_rng(3), duration, q, sigma, 1500)
    kept = share_kept(ranges)
    error = kept.std() / math.sqrt(len(kept)) / kept.mean()
    decibels = 10.0 * math.log10(kept.mean() / motion_loss(duration, WAVE, q, sigma))
    assert abs(decibels) < (0.6 if q and sigma else 0.2) + 4.34 * 3.0 * error


@pytest.mark.parametrize("acceleration", [-20.0, 5.0, 60.0, 200.0])
def test_a_steady_acceleration_leaves_the_simulated_share(acceleration) -> None:
    duration = 0.064
    t = (np.arange(PULSES) + 0.5) * duration / PULSES - 0.5 * duration
    kept = share_kept(3.0 * t[None] + 0.5 * acceleration * t[None] ** 2)
    np.testing.assert_allclose(acceleration_loss(duration, WAVE, acceleration), kept[0], rtol=0.02)


def test_the_mean_range_rate_moves_away_from_the_middle_one() -> None:
    duration, q, worlds = 0.1, 40.0, 4000
    t, ranges, middle = paths(np.random.default_rng(4), duration, q, 0.0, worlds)
    slope = np.polyfit(t, ranges.T, 1)[0]
    expected = mean_rate_variance(duration, q)
    assert abs(np.mean((slope - middle) ** 2) - expected) < 4.0 * expected * math.sqrt(2.0 / worlds) + 0.02 * expected


def noise_peaks(pulse: Waveform, count: int, interval: float, seed: int) -> tuple[np.ndarray, float]:
    """Peaks above ``THRESHOLDS`` in simulated noise after a matched filter and a Doppler transform; m times m/s."""
    rng, length, scans = np.random.default_rng(seed), 2048, 12
    rate = math.sqrt(float(pulse.fisher_factors().information()[0, 0])) / SPACING
    t = np.arange(math.floor(pulse.support[0] * rate), math.ceil(pulse.support[1] * rate) + 1) / rate
    replica = np.fft.fft(pulse.envelope(t) * np.exp(1j * pulse.phase(t)), length)
    replica /= np.sqrt(np.mean(np.abs(replica) ** 2))
    cells = math.ceil(2.0 * math.pi / math.sqrt(12.0) / SPACING) * count
    found = np.zeros(len(THRESHOLDS))
    for _ in range(scans):
        noise = rng.standard_normal((2, count, length)) / math.sqrt(2.0)
        filtered = np.fft.ifft(np.fft.fft(noise[0] + 1j * noise[1], axis=1) * replica.conj(), axis=1)
        power = np.abs(np.fft.fft(filtered, cells, axis=0)) ** 2 / count
        peak = power == maximum_filter(power, 3, mode="wrap")
        found += [(peak & (power > T)).sum() for T in THRESHOLDS]
    return found, scans * length / rate * SPEED_OF_LIGHT / 2.0 * WAVE / (2.0 * interval)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pulse", "count"),
    [
        (GaussianChirp(duration=1e-6), 1 << 5),
        (GaussianChirp(duration=5e-6, chirp_rate=2e11), 1 << 4),
        (TrapezoidChirp(kind="lfm", duration=10e-6, sweep=4e6), 1 << 4),
    ],
)
def test_noise_has_the_expected_peaks(pulse, count) -> None:
    """Between cells a peak loses 2 T SPACING^2 / 24 of its power on average, and so as many peaks."""
    interval = 100e-6
    found, region = noise_peaks(pulse, count, interval, 5)
    C = PulseTrain(pulse, count=count, interval=interval).fisher_factors().measurement_covariance(CARRIER)
    expected = false_return_density(C, THRESHOLDS) * region
    lost = THRESHOLDS * SPACING**2 / 12.0
    assert (np.abs(found / expected - 1.0) < 4.0 / np.sqrt(expected) + 2.0 * lost).all()


def detected(energy: float, q: float, sigma: float, threshold: float, worlds: int) -> float:
    """Share of simulated trains whose echo has a peak above the threshold; Swerling 1, any delay and range-rate.

    Fast time, slow time and noise are simulated. The peak is sought within three cells of the echo.
    """
    rng, count, interval, length = np.random.default_rng(6), 32, 2e-3, 64
    pulse = GaussianChirp(duration=1e-6)
    rate = math.sqrt(float(pulse.fisher_factors().information()[0, 0])) / SPACING
    fast = (np.arange(length) - length // 2) / rate
    replica = pulse.envelope(fast) / np.linalg.norm(pulse.envelope(fast))
    matched = np.fft.fft(np.fft.ifftshift(replica)).conj()
    found, slow = 0, (np.arange(count) - 0.5 * (count - 1)) * interval
    for _ in range(worlds):
        moved = np.cumsum(np.sqrt(q * interval) * rng.standard_normal(count))
        velocity = (
            WAVE / (2.0 * count * interval) * rng.uniform(-1.0, 1.0) + sigma * rng.standard_normal() * slow + moved
        )
        ranges = np.cumsum(velocity) * interval
        amplitude = math.sqrt(energy / count * rng.exponential())
        late = pulse.envelope(fast - rng.uniform(-0.5, 0.5) / rate) / np.linalg.norm(pulse.envelope(fast))
        echo = amplitude * np.exp(-4j * math.pi / WAVE * ranges)[:, None] * late
        noise = rng.standard_normal((2, count, length)) / math.sqrt(2.0)
        filtered = np.fft.ifft(np.fft.fft(echo + noise[0] + 1j * noise[1], axis=1) * matched, axis=1)
        power = np.abs(np.fft.fft(filtered[:, length // 2 - 2 : length // 2 + 3], 8 * count, axis=0)) ** 2 / count
        spectrum = np.abs(np.fft.fft(np.exp(-4j * math.pi / WAVE * ranges), 8 * count))
        near = (np.arange(-24, 25) + spectrum.argmax()) % (8 * count)
        found += power[near].max() > threshold
    return found / worlds


@pytest.mark.slow
@pytest.mark.parametrize(
    ("energy", "q", "sigma"),
    [(12.0, 0.0, 0.0), (60.0, 0.0, 0.0), (60.0, 10.0, 0.0), (60.0, 0.0, 10.0), (60.0, 3.0, 5.0)],
)
def test_the_echo_is_detected_as_often_as_the_law_says(energy, q, sigma) -> None:
    """The loss is a mean over targets. Two quantities are searched, so noise beside the echo adds to its peak."""
    threshold, worlds = 9.0, 3000
    eta = 2.0 * energy * motion_loss(32 * 2e-3, WAVE, q, sigma)
    expected = detection_probability(eta, math.exp(-threshold), "swerling1", searched=2)
    error = math.sqrt(expected * (1.0 - expected) / worlds)
    assert abs(detected(energy, q, sigma, threshold, worlds) - expected) < 3.5 * error + 0.015


@given(
    st.floats(2.8, 60.0), st.floats(0.1, 1e3), st.floats(0.01, 1e3), st.floats(-0.99, 0.99), st.sampled_from([1, 2, 3])
)
def test_the_threshold_is_the_inverse_of_the_density(threshold, range_error, rate_error, correlation, elements) -> None:
    cross = correlation * range_error * rate_error
    C = np.array([[range_error**2, cross], [cross, rate_error**2]])
    density = false_return_density(C, threshold, elements)
    np.testing.assert_allclose(false_return_threshold(C, density, elements), threshold, rtol=1e-6)


def test_a_train_needs_a_threshold_higher_by_the_logarithm_of_its_pulses() -> None:
    """n pulses have n Doppler cells in the interval of one pulse's ambiguity, of which each has as many peaks."""
    C, count = np.diag([1.0, 1.0]), 200
    one, many = (false_return_threshold(cell * C, 1e-9) for cell in (1.0, 1.0 / count))
    assert many - one == pytest.approx(math.log(count), rel=0.06)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: motion_loss(-1.0, 0.03), "duration is -1.0, expected a finite number >= 0"),
        (lambda: motion_loss(1.0, 0.0), "wavelength is 0.0, expected a finite number > 0"),
        (lambda: mean_rate_variance(1.0, math.nan), "density is nan, expected"),
        (lambda: false_return_density(np.eye(2), 1.0), r"threshold is 1.0, expected finite numbers >= 1.5"),
        (lambda: false_return_density(np.eye(3), 9.0), r"unit_covariance has shape \(3, 3\), expected \(..., 2, 2\)"),
        (lambda: false_return_threshold(np.eye(2), 1.0), r"density is 1.0 per .*, expected at most 0.07102"),
    ],
)
def test_what_cannot_be_is_named(call, message) -> None:
    with pytest.raises(InputError, match=message):
        call()
