"""The law of a coherent train against simulated pulses in plain NumPy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import maximum_filter

from wavegym.core.errors import InputError
from wavegym.sensors.detection import detection_probability, mean_inverse_detected_snr
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
        (GaussianChirp(duration=2e-6, chirp_rate=5e11, direction="down"), 8),
        (TrapezoidChirp(kind="lfm", duration=10e-6, sweep=4e6), 1 << 4),
        (TrapezoidChirp(kind="hfm", duration=10e-6, sweep=4e6), 64),
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


class Simulation:
    """Trains of 32 Gaussian pulses in noise: fast time, slow time and Doppler. Swerling 1, any delay and range-rate."""

    count, interval, length, padded = 32, 2e-3, 64, 8
    pulse = GaussianChirp(duration=1e-6)

    def __init__(self, energy: float, q: float, sigma: float) -> None:
        self.energy, self.q, self.sigma = energy, q, sigma
        self.rng, self.seconds = np.random.default_rng(6), self.count * self.interval
        self.rate = math.sqrt(float(self.pulse.fisher_factors().information()[0, 0])) / SPACING
        self.fast = (np.arange(self.length) - self.length // 2) / self.rate
        self.bin = WAVE / (2.0 * self.seconds * self.padded)  # m/s
        self.C = PulseTrain(self.pulse, count=self.count, interval=self.interval).fisher_factors()

    def look(self) -> tuple[np.ndarray, float, float, int]:
        """Power (delay, Doppler), true delay in samples, true range-rate at the middle in bins, strongest Doppler."""
        rng, n = self.rng, self.count
        slow = (np.arange(n) - 0.5 * (n - 1)) * self.interval
        moved = np.cumsum(np.sqrt(self.q * self.interval) * rng.standard_normal(n))
        velocity = 8.0 * self.bin * rng.uniform(-1.0, 1.0) + self.sigma * rng.standard_normal() * slow + moved
        phases = np.exp(-4j * math.pi / WAVE * np.cumsum(velocity) * self.interval)
        late = rng.uniform(-0.5, 0.5)
        shape = self.pulse.envelope(self.fast - late / self.rate)
        amplitude = math.sqrt(self.energy / n * rng.exponential())
        echo = amplitude * phases[:, None] * shape / np.linalg.norm(shape)
        noise = rng.standard_normal((2, n, self.length)) / math.sqrt(2.0)
        replica = self.pulse.envelope(self.fast) / np.linalg.norm(self.pulse.envelope(self.fast))
        matched = np.fft.fft(np.fft.ifftshift(replica)).conj()
        filtered = np.fft.ifft(np.fft.fft(echo + noise[0] + 1j * noise[1], axis=1) * matched, axis=1)
        power = np.abs(np.fft.fft(filtered, self.padded * n, axis=0)).T ** 2 / n
        strongest = int(np.abs(np.fft.fft(phases, self.padded * n)).argmax())
        return power, late, -0.5 * (velocity[n // 2 - 1] + velocity[n // 2]) / self.bin, strongest


def climbed(power: np.ndarray, i: int, j: int) -> tuple[float, float, float]:
    """The local maximum that is reached from a cell, and its place by parabolas; Doppler (axis 1) is periodic."""
    while True:
        around = power.take(range(j - 1, j + 2), axis=1, mode="wrap")[i - 1 : i + 2]
        up, right = np.unravel_index(around.argmax(), (3, 3))
        if (up, right) == (1, 1):
            break
        i, j = min(max(i + up - 1, 1), len(power) - 2), j + right - 1
    logs = np.log(around[:, 1]), np.log(around[1])
    shifts = [0.5 * (a[0] - a[2]) / (a[0] - 2.0 * a[1] + a[2]) for a in logs]
    return power[i, j % power.shape[1]], i + shifts[0], j + shifts[1]


@pytest.mark.slow
@pytest.mark.parametrize("energy", [12.0, 60.0, 200.0])
@pytest.mark.parametrize(("q", "sigma"), [(0.0, 0.0), (3.0, 0.0), (10.0, 0.0), (0.0, 3.0), (3.0, 5.0)])
def test_a_train_is_detected_and_measures_as_the_law_says(energy, q, sigma) -> None:
    """Pd to 0.015: a peak within three cells of the echo. Errors to a tenth: of the peak in the echo's main lobe.

    Farther peaks are those of the noise, which ``false_return_density`` counts. The loss is a mean over targets. An
    echo that loses more than 2 dB has several filters in which it may be found: Pd to 0.03.
    """
    threshold, worlds, simulation = 9.0, 3000, Simulation(energy, q, sigma)
    unit = simulation.C.measurement_covariance(CARRIER)
    metres, middle = SPEED_OF_LIGHT / 2.0 / simulation.rate, simulation.length // 2
    errors, seen = [], 0
    for _ in range(worlds):
        power, late, rate, strongest = simulation.look()
        near = (np.arange(-24, 25) + strongest) % power.shape[1]
        seen += power[middle - 2 : middle + 3, near].max() > threshold
        peak, i, j = climbed(power, middle, strongest)
        bins = (j - rate + 0.5 * power.shape[1]) % power.shape[1] - 0.5 * power.shape[1]
        error = np.array([(i - middle - late) * metres, bins * simulation.bin])
        lobe = np.array([abs(error[0]), abs(j - strongest) * simulation.bin]) < np.sqrt(np.diag(unit))
        if peak > threshold and lobe.all():
            errors.append(error)
    found = np.square(errors)
    kept = motion_loss(simulation.seconds, WAVE, q, sigma)
    law = 2.0 * energy * kept, math.exp(-threshold), "swerling1"
    expected = np.diag(unit) * mean_inverse_detected_snr(*law, searched=2, least=1.0)
    expected[1] += mean_rate_variance(simulation.seconds, q)
    spread = found.std(axis=0) / math.sqrt(len(found))
    assert (np.abs(found.mean(axis=0) - expected) < 3.5 * spread + 0.1 * expected).all()
    pd = detection_probability(*law, searched=2)
    assert abs(seen / worlds - pd) < 3.5 * math.sqrt(pd * (1.0 - pd) / worlds) + (0.015 if kept > 0.63 else 0.03)


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
