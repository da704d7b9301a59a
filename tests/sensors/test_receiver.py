"""From samples at array elements to ranges and range-rates: against direct sums, the bound, the theory of noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wavegym.core.errors import InputError
from wavegym.sensors import Antenna, ArrayReceiver, Multistatic, UrbanMap
from wavegym.waveforms import SPEED_OF_LIGHT, GaussianChirp, PulseTrain

CARRIER, BAND = 4e9, 40e6


def receiver(count=25, duration=1.375e-6, direction="up", elements=3):
    chirp = GaussianChirp(duration=duration, chirp_rate=math.pi * BAND / (7.4338 * duration), direction=direction)
    return ArrayReceiver(PulseTrain(chirp, count=count, interval=1e-3), CARRIER, BAND, 300.0, elements)


LONG = receiver()
MAP, PLACE = UrbanMap.load("intersection"), (2088.0, 1475.0)
PAIR = Multistatic(Antenna(MAP, (2085.0, 1470.5)), Antenna(MAP, PLACE, axis=(0.6, 0.8)))


def echo(array, r, rate, eta, angle=1.0, phase=0.0):
    """Samples of a target with constant range-rate at ``angle`` from the axis of the array."""
    path = 2.0 * (r + rate * array.times)
    delays = (path[:, None] - array.offsets * np.cos(angle)) / SPEED_OF_LIGHT
    return array.receive(delays[None], [math.sqrt(eta / 2) * np.exp(1j * phase)])


def noise(array, rng):
    return math.sqrt(0.5) * (rng.standard_normal(array.shape) + 1j * rng.standard_normal(array.shape))


def test_samples_are_delayed_pulses():
    """In time: the pulse shifted by its delay with the phase of the carrier, up to the cut-off at -60 dB."""
    r, angle = 100.3, 0.7
    samples = echo(LONG, r, 0.0, 2.0, angle)
    pulse = LONG.train.pulse
    begin = np.count_nonzero(pulse.envelope(np.arange(600) / BAND) > 1e-3 * pulse.envelope(0.0))
    t = (np.arange(LONG.shape[2]) - begin) / BAND
    tau = (2 * r - LONG.offsets * np.cos(angle)) / SPEED_OF_LIGHT
    delayed = pulse.signal(t - 2 * r / SPEED_OF_LIGHT) / math.sqrt(BAND * 25 * 3)
    expected = delayed * np.exp(-2j * np.pi * CARRIER * tau[:, None])
    assert np.abs(samples[7] - expected).max() < 4e-3 * np.abs(expected).max()
    np.testing.assert_array_equal(samples[0], samples[24])


def test_the_image_is_the_correlation_with_every_delayed_shifted_pulse():
    """One cell of one element against a double sum over pulses and samples."""
    array, rng = receiver(count=7), np.random.default_rng(3)
    samples = noise(array, rng)
    image = array.image(samples)
    assert image.shape[0] == 3
    delay, doppler = 20, 5  # cells, two per sample
    template = echo(array, delay / 2 / BAND * SPEED_OF_LIGHT / 2, 0.0, 2.0, np.pi / 2)[0, 0]
    template = template * np.exp(2j * np.pi * CARRIER * delay / 2 / BAND)
    turns = doppler / image.shape[2]
    total = sum(np.exp(-2j * np.pi * turns * q) * np.vdot(template, samples[q, 1]) for q in range(7))
    assert image[1, delay, doppler] == pytest.approx(total, rel=1e-9)


@pytest.mark.parametrize("duration", [0.5e-6, 1.375e-6])
@pytest.mark.parametrize("direction", ["up", "down"])
def test_without_noise_the_peak_is_where_the_target_is(duration, direction):
    """Within a twentieth of the bound at eta = 200; power eta / 2 minus the loss of the grid of directions."""
    array = receiver(duration=duration, direction=direction)
    bound = np.sqrt(np.diag(array.train.measurement_covariance(CARRIER, 200.0)))
    for r, rate, angle in ((40.0, 0.3, 0.2), (123.4, -17.9, 1.5), (290.0, 18.7, 2.9), (77.7, 0.0, 4.0)):
        peaks = array.peaks(array.image(echo(array, r, rate, 200.0, angle)), 7.0)
        assert len(peaks.z) == 1
        assert (np.abs(peaks.z[0, :2] - [r, rate]) < 0.05 * bound).all()
        assert abs(peaks.z[0, 2] - math.cos(angle)) < 0.1 * math.sqrt(peaks.R[0, 2, 2])
        assert 0.94 * 198 < peaks.snr[0] < 1.01 * 198  # 2 less: the noise is absent


def test_the_peak_s_own_shape_says_the_bound():
    peaks = LONG.peaks(LONG.image(echo(LONG, 100.0, 5.0, 1e4)), 7.0)
    np.testing.assert_allclose(
        np.diag(peaks.R[0])[:2], np.diag(LONG.train.measurement_covariance(CARRIER, peaks.snr[0])), rtol=0.05
    )
    np.testing.assert_allclose(peaks.R[0, 2, 2], 12.0 / (math.pi**2 * (3**2 - 1) * peaks.snr[0]))


def test_sidelobes_are_no_targets():
    """A peak 60 dB above the threshold stays single; a second target off its lobes is kept."""
    strong = echo(LONG, 60.0, 3.3, 1e7)
    assert len(LONG.peaks(LONG.image(strong), 7.0).z) == 1
    both = LONG.peaks(LONG.image(strong + echo(LONG, 120.0, -8.0, 200.0)), 7.0)
    np.testing.assert_allclose(both.z[:, :2], [[60.0, 3.3], [120.0, -8.0]], atol=0.05)


def test_two_targets_a_resolution_cell_or_two_apart_are_two():
    one, other = echo(LONG, 100.0, 2.0, 400.0), echo(LONG, 100.0, 2.0 + 2 * 1.5, 400.0)
    assert len(LONG.peaks(LONG.image(one + other), 7.0).z) == 2


def test_range_rates_fold():
    """One pulse per ms folds by lambda / (2 x 1 ms) = 37.5 m/s."""
    peaks = LONG.peaks(LONG.image(echo(LONG, 100.0, 25.0, 200.0)), 7.0)
    assert peaks.z[0, 1] == pytest.approx(25.0 - SPEED_OF_LIGHT / CARRIER / 2e-3, abs=0.01)


def test_what_comes_from_beyond_the_reach_is_not_received():
    """An echo beyond the reach does not wrap around to the start of the window."""
    assert np.abs(echo(LONG, 299.0, 0.0, 200.0)).max() > 0.0
    assert np.abs(echo(LONG, 320.0, 0.0, 200.0)).max() == 0.0


@pytest.mark.parametrize("elements", [1, 3])
def test_noise_has_unit_power_and_passes_the_threshold_as_often_as_theory_says(elements):
    """About 1700 noise peaks in 150 images: four standard errors are 10 %. Another 10 % for the theory, which assumes
    a high threshold and a field that is smooth between cells.
    """
    array, rng = receiver(duration=0.5e-6, elements=elements), np.random.default_rng(0)
    threshold = array.threshold(1e-3)
    assert array.false_returns(threshold) == pytest.approx(1e-3)
    count, power = 0, []
    for _ in range(150):
        image = array.image(noise(array, rng))
        power.append(np.mean(np.abs(image) ** 2) * elements)  # each element has its share
        count += len(array.peaks(image, threshold).z)
    assert np.mean(power) == pytest.approx(1.0, abs=0.02)
    area = 150 * 300.0 * SPEED_OF_LIGHT / CARRIER / 2e-3
    assert count / area == pytest.approx(1e-3, rel=0.2)


@pytest.mark.slow
def test_errors_reach_the_bound():
    """4000 echoes of eta = 200 at random places: standard deviations, covariances of the fits, no bias."""
    trials, rng = 4000, np.random.default_rng(11)
    errors, said, directions = [], [], []
    for _ in range(trials):
        r, rate = rng.uniform(20.0, 290.0), rng.uniform(-15.0, 15.0)
        angle, phase = rng.uniform(0.0, 2.0 * np.pi, 2)
        samples = echo(LONG, r, rate, 200.0, angle, phase) + noise(LONG, rng)
        peaks = LONG.peaks(LONG.image(samples), LONG.threshold(1e-3))
        off = peaks.z[0, :2] - [r, rate]
        assert np.abs(off).max() < 5.0  # strongest first
        errors.append(off)
        said.append(np.diag(peaks.R[0])[:2])
        directions.append((peaks.z[0, 2] - math.cos(angle) + 1.0) % 2.0 - 1.0)  # a cosine is measured modulo 2
    bound = np.diag(LONG.train.measurement_covariance(CARRIER, 200.0))
    deviation = np.std(errors, axis=0)
    assert (deviation / np.sqrt(bound) > 0.9).all()
    assert (deviation / np.sqrt(bound) < 1.15).all()
    np.testing.assert_allclose(np.mean(said, axis=0), bound, rtol=0.1)
    assert (np.abs(np.mean(errors, axis=0)) < 3.0 * deviation / math.sqrt(trials)).all()
    assert 0.95 < np.std(directions) / math.sqrt(12.0 / (math.pi**2 * 8.0 * 200.0)) < 1.1
    assert abs(np.mean(directions)) < 3.0 * np.std(directions) / math.sqrt(trials)


def test_delays_are_those_of_every_element_by_itself():
    """Images of an element equal those of an antenna at its position; the target moves with constant acceleration."""
    state = np.array([2070.0, 1560.0, 3.0, 9.0, -0.5, 1.0])
    paths, times, offsets = np.arange(len(PAIR.paths)), np.array([-0.1, 0.0, 0.1]), np.array([-0.4, 0.0, 0.4])
    delays = PAIR.delays(np.tile(state, (len(paths), 1)), paths, times, offsets)
    for i, t in enumerate(times):
        later = np.concatenate([state[:2] + t * state[2:4] + 0.5 * t * t * state[4:], state[2:4]])
        for m, offset in enumerate(offsets):
            element = Antenna(MAP, (PLACE[0] + 0.6 * offset, PLACE[1] + 0.8 * offset))
            alone = Multistatic(PAIR.transmitter, element)
            np.testing.assert_array_equal(alone.paths, PAIR.paths)
            np.testing.assert_allclose(delays[:, i, m], 2.0 * alone.measure(later)[:, 0] / SPEED_OF_LIGHT, rtol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ArrayReceiver(GaussianChirp(duration=1e-6), CARRIER, BAND, 300.0), "expected a PulseTrain"),
        (lambda: ArrayReceiver(LONG.train, CARRIER, -1.0, 300.0), "sample_rate is -1.0"),
        (lambda: ArrayReceiver(LONG.train, CARRIER, BAND, 300.0, elements=0), "elements is 0"),
        (
            lambda: ArrayReceiver(LONG.train, CARRIER, BAND, 300.0, elements=10**7),
            r"samples of a scan .* expected a number in \[0, 1e\+08\]",
        ),
        (
            lambda: ArrayReceiver(LONG.train, CARRIER, 1e6, 300.0),
            "sample_rate is 1000000.0 Hz, expected at least 6 tim",
        ),
        (lambda: LONG.receive(np.zeros((1, 25, 2)), [1.0]), r"expected \(path, 25, 3\)"),
        (lambda: LONG.receive(np.zeros((1, 25, 3)), np.ones((1, 1))), r"expected \(path, 25, 3\) and \(path,\)"),
        (lambda: LONG.receive(np.full((1, 25, 3), -1e-9), [1.0]), "delay is -1e-09"),
        (lambda: LONG.image(np.zeros((25, 3, 7))), r"samples has shape \(25, 3, 7\), expected \(25, 3, "),
        (lambda: LONG.peaks(np.zeros((3, 7, 7)), 7.0), r"image has shape \(3, 7, 7\), expected \(3, "),
        (lambda: LONG.peaks(LONG.image(np.zeros(LONG.shape)), np.nan), "threshold is nan"),
        (lambda: LONG.false_returns(0.0), r"threshold is 0\.0"),
        (lambda: PAIR.delays(np.zeros((1, 6)), [1.5], 0.0, 0.0), "path is .*, expected integers"),
        (
            lambda: PAIR.delays(np.zeros((1, 6)), [0], [[0.0]], 0.0),
            r"times and offsets have shapes \(1, 1\) and \(1,\)",
        ),
        (lambda: Antenna(MAP, (np.nan, 0.0)), r"position\[0\] is nan, expected finite numbers"),
        (lambda: Antenna(UrbanMap(), (0.0, 0.0), axis=(np.nan, 0.0)), "expected a unit vector"),
        (lambda: LONG.threshold(1.0), "density is 1.0"),
        (lambda: LONG.threshold(-1.0), "density is -1.0"),
        (lambda: PAIR.delays(np.zeros((1, 6)), [-1], 0.0, 0.0), "path is -1.0"),
        (lambda: PAIR.delays(np.zeros((1, 6)), [len(PAIR.paths)], 0.0, 0.0), f"path is {len(PAIR.paths)}"),
        (lambda: Antenna(UrbanMap(), (0.0, 0.0), axis=(1.0, 1.0)), "expected a unit vector"),
    ],
)
def test_mistakes(make, message):
    with pytest.raises(InputError, match=message) as error:
        make()
    assert "\n" not in str(error.value)
