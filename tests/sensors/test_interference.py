"""What trains of chirps measure in coloured noise, against simulated pulses in plain NumPy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wavegym.sensors.detection import detection_probability, realised_snr
from wavegym.sensors.interference import contiguous_bands, noise_factors

CHANNELS, PULSES, INTERVAL = 8, 4, 500.0
LENGTH, RATE = 150.0, 10.0  # of a pulse, and samples, in units of one over a channel's width
BANDS = contiguous_bands(CHANNELS)
QUIET = np.ones(CHANNELS)
STRONG = np.array([1.0, 1.0, 30.0, 1.0, 1.0, 1.0, 1.0, 1.0])
SLOPED = np.array([1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0])
SPARSE = np.array([100.0, 1.0, 1.0, 20.0, 1.0, 1.0, 1.0, 50.0])
SETTINGS = [
    (QUIET, 0, 8), (QUIET, 2, 1), (STRONG, 0, 8), (STRONG, 2, 3), (STRONG, 1, 2), (SLOPED, 0, 8), (SLOPED, 3, 4),
    (SPARSE, 0, 8), (SPARSE, 1, 4), (SPARSE, 3, 5),
]  # fmt: skip


class Simulation:
    """Trains of linear chirps in one band, in noise of the given power in each channel."""

    def __init__(self, noise: np.ndarray, first: int, width: int, receiver: str) -> None:
        size = round(1.25 * LENGTH * RATE)
        self.t = (np.arange(size) - size // 2) / RATE
        self.centres = (np.arange(PULSES) - 0.5 * (PULSES - 1)) * INTERVAL
        self.middle, self.rate = first + 0.5 * width - 0.5 * CHANNELS, width / LENGTH
        frequency = np.fft.fftfreq(size, 1.0 / RATE)
        channel = np.floor(frequency + 0.5 * CHANNELS).astype(int)
        self.power = noise[np.clip(channel, 0, CHANNELS - 1)]
        passed = abs(frequency - self.middle) <= 0.5 * width
        self.filter = passed / (self.power if receiver == "whitening" else 1.0)

    def train(self, delay: float, doppler: float) -> np.ndarray:
        """Spectra of the pulses (pulse, frequency) of unit energy in total."""
        t = self.t - delay
        chirp = np.where(abs(t) <= 0.5 * LENGTH, np.exp(2j * np.pi * (self.middle + 0.5 * self.rate * t) * t), 0.0)
        times = self.centres[:, None] + self.t
        pulses = chirp * np.exp(2j * np.pi * doppler * times) / math.sqrt(PULSES * LENGTH * RATE)
        return np.fft.fft(pulses, axis=1, norm="ortho")

    def noise(self, rng: np.random.Generator) -> np.ndarray:
        """Spectra of noise of unit power at each frequency, times that of its channel."""
        shape = 2, PULSES, len(self.t)
        real, imaginary = rng.standard_normal(shape)
        return np.sqrt(0.5 * self.power) * (real + 1j * imaginary)

    def output(self, received: np.ndarray, templates: np.ndarray) -> np.ndarray:
        """Filter outputs of templates (..., pulse, frequency)."""
        return np.einsum("...pf,pf->...", templates.conj() * self.filter, received)


def white_deviations(width: int) -> tuple[float, float]:
    """Of delay at a known Doppler shift, and of the Doppler shift, at eta = 1 in white noise, by the textbook."""
    spread = INTERVAL**2 * (PULSES**2 - 1.0) / 12.0
    return math.sqrt(12.0) / (2 * math.pi * width), 1.0 / (2 * math.pi * math.sqrt(spread))


@pytest.mark.slow
@pytest.mark.parametrize("receiver", ["matched", "whitening"])
@pytest.mark.parametrize(("noise", "first", "width"), SETTINGS)
def test_delay_doppler_and_detection_are_those_of_simulated_trains(noise, first, width, receiver) -> None:
    """Both variances, the power of the noise in the output and detections, to five standard errors of 400 trains."""
    (band,) = np.flatnonzero((BANDS.first == first) & (BANDS.width == width))
    gain, delay = (each[band] for each in noise_factors(noise, BANDS, receiver))
    eta, count = 400.0 / gain, 400
    one, two = white_deviations(width)
    # delay - Doppler / k has no coupling with the Doppler shift
    want = np.array([one * math.sqrt(delay / (eta * gain)), two / math.sqrt(eta * gain)])
    made, rng = Simulation(noise, first, width, receiver), np.random.default_rng(band)
    steps = np.arange(-5.0, 6.0)
    grid = np.array([[made.train(a * want[0] + b * want[1] / made.rate, b * want[1]) for b in steps] for a in steps])
    truth, errors, quiet = made.train(0.0, 0.0), [], []
    for _ in range(count):
        n = made.noise(rng)
        power = abs(made.output(math.sqrt(eta / 2) * truth + n, grid)) ** 2
        i, j = np.unravel_index(power.argmax(), power.shape)
        assert 0 < i < len(steps) - 1
        assert 0 < j < len(steps) - 1
        near = np.log(power[i - 1 : i + 2, j - 1 : j + 2])
        errors.append([steps[i] + peak(near[:, 1]), steps[j] + peak(near[1])])
        quiet.append(made.output(n, truth))
    squares = np.array(errors) ** 2
    spread = squares.std(axis=0) / math.sqrt(count)
    assert (abs(squares.mean(axis=0) - 1.0) < 5 * spread).all()
    echo, noise_alone = abs(made.output(truth, truth)), np.array(quiet)
    np.testing.assert_allclose(echo**2 / np.mean(abs(noise_alone) ** 2), gain, rtol=5 / math.sqrt(count))
    for name in ("swerling0", "swerling1"):  # a weaker echo, with a threshold on the power of the output
        mean, alarm = 12.0, 0.01
        amplitude = np.sqrt(0.5 * realised_snr(rng.random(count), mean, name))
        power = abs(amplitude + noise_alone * math.sqrt(gain) / echo) ** 2
        wanted = detection_probability(mean, alarm, name)
        detected = np.mean(power > -math.log(alarm))
        assert abs(detected - wanted) < 5 * math.sqrt(wanted * (1 - wanted) / count)


def peak(values: np.ndarray) -> float:
    """Place of the maximum of the parabola through three values."""
    low, middle, high = values
    return 0.5 * (low - high) / (low - 2 * middle + high)
