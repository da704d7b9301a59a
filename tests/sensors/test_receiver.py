"""From array elements to ranges and range-rates: against a receiver of samples, the bound, the theory of noise.

The oracle is a textbook receiver: samples in time, delayed pulses, correlations, an FFT over all pulses, plain loops.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from wavegym.core.errors import InputError
from wavegym.sensors import Antenna, ArrayReceiver, Multistatic, UrbanMap
from wavegym.sensors.geometry_kernels import direction_variance
from wavegym.sensors.receiver import noise_law
from wavegym.waveforms import SPEED_OF_LIGHT, GaussianChirp, PulseTrain

CARRIER, BAND = 4e9, 40e6


def receiver(count=25, duration=1.375e-6, direction="up", elements=3):
    chirp = GaussianChirp(duration=duration, chirp_rate=math.pi * BAND / (7.4338 * duration), direction=direction)
    return ArrayReceiver(PulseTrain(chirp, count=count, interval=1e-3), CARRIER, BAND, 300.0, elements)


LONG = receiver()
MAP, PLACE = UrbanMap.load("intersection"), (2088.0, 1475.0)
PAIR = Multistatic(Antenna(MAP, (2085.0, 1470.5)), Antenna(MAP, PLACE, axis=(0.6, 0.8)))


def echo_delays(array, r, rate, angle):
    """Delays of a target with constant range-rate at ``angle`` from the axis of the array, (pulse, element)."""
    return (2.0 * (r + rate * array.times)[:, None] - array.offsets * np.cos(angle)) / SPEED_OF_LIGHT


def echo(array, r, rate, eta, angle=1.0, phase=0.0):
    """Outputs of a target with constant range-rate at ``angle`` from the axis of the array."""
    return array.receive(echo_delays(array, r, rate, angle)[None], [math.sqrt(eta / 2) * np.exp(1j * phase)])


def noise(array, rng):
    return array.noise(int(rng.integers(2**63)))


def joined(parts):
    """Complex numbers of an array whose second last axis is the real and the imaginary part."""
    return parts[..., 0, :] + 1j * parts[..., 1, :]


def split(numbers):
    return np.stack([numbers.real, numbers.imag], axis=-2)


class Textbook:
    """A receiver of samples in time, (pulse, element, sample), without any code of the package's receiver."""

    def __init__(self, count, duration, direction, elements):
        sign, (low, high) = 1.0 if direction == "up" else -1.0, (-800, 800)
        t = np.arange(low, high + 1) / BAND
        envelope = np.exp(-0.5 * (t / duration) ** 2)
        rate = sign * math.pi * BAND / (7.4338 * duration)
        kept = (
            np.exp(-0.5 * (np.maximum(np.abs(t) - 1 / BAND, 0.0) / duration) ** 2) > 1e-3
        )  # to the first below -60 dB
        self.pulse = (envelope * np.exp(1j * rate * t**2))[kept]
        self.pulse /= np.linalg.norm(self.pulse) * math.sqrt(count * elements)
        self.half = len(self.pulse) // 2
        self.length = (2 * self.half + math.ceil(2 * 300.0 / SPEED_OF_LIGHT * BAND)) | 1
        self.cells = math.ceil(2 * 300.0 / SPEED_OF_LIGHT * BAND * 2) + 2
        self.count, self.elements = count, elements

    def delayed(self, samples):
        """The pulse, delayed by a number of samples: band-limited interpolation."""
        padded = np.zeros(self.length, complex)
        padded[: len(self.pulse)] = self.pulse
        shift = np.exp(-2j * np.pi * np.fft.fftfreq(self.length) * samples)
        return np.fft.ifft(np.fft.fft(padded) * shift)

    def echo(self, delays, amplitude):
        """Samples of one path with delays (pulse, element) in s."""
        samples = np.empty((self.count, self.elements, self.length), complex)
        for q in range(self.count):
            pulse = self.delayed(delays[q].mean() * BAND)
            for m in range(self.elements):
                samples[q, m] = amplitude * np.exp(-2j * np.pi * CARRIER * delays[q, m]) * pulse
        return samples

    def filtered(self, samples):
        """Correlation with the pulse at every cell, half a sample each, (pulse, element, cell)."""
        replicas = np.array([self.delayed(cell / 2) for cell in range(self.cells)])
        return samples @ replicas.conj().T

    def image(self, samples):
        """(Doppler cell, element, delay cell): four cells per resolution cell, phase of the middle pulse."""
        dopplers, filtered = 4 * self.count, self.filtered(samples)
        shift = np.exp(2j * np.pi * np.arange(dopplers) * (self.count // 2) / dopplers)
        return np.fft.fft(filtered, dopplers, axis=0) * shift[:, None, None]

    def peaks(self, image, threshold):
        """Cells and powers of maxima in the best of beams, strongest first, without their sidelobes."""
        turns = np.arange(3 * self.elements) / (3 * self.elements)
        beams = np.exp(2j * np.pi * np.outer(turns, np.arange(self.elements)))
        power = (np.abs(np.einsum("bm,fmd->bfd", beams, image)) ** 2).max(axis=0)
        dopplers, delays = power.shape
        maxima = []
        for f in range(dopplers):
            for d in range(1, delays - 1):
                around = [power[(f + j) % dopplers, d + i] for i in (-1, 0, 1) for j in (-1, 0, 1)]
                if power[f, d] >= threshold and power[f, d] == max(around):
                    maxima.append((power[f, d], d, f))
        return sorted(maxima, reverse=True)


@pytest.mark.parametrize(("count", "elements"), [(7, 3), (12, 1), (25, 3)])
@pytest.mark.parametrize(("duration", "direction"), [(0.5e-6, "up"), (1.375e-6, "down")])
def test_the_chain_is_that_of_a_textbook_receiver_of_samples(count, elements, duration, direction):
    """Three echoes in white noise. The same noise passes the textbook's filters and is added to the chain's echoes.

    1e-9 of the strongest output: the polynomials between the tabulated responses err by less than 1e-10.
    """
    array, rng = receiver(count, duration, direction, elements), np.random.default_rng(count)
    book = Textbook(count, duration, direction, elements)
    samples = math.sqrt(0.5) * (rng.standard_normal((count, elements, book.length, 2)) @ [1.0, 1.0j])
    outputs = split(book.filtered(samples))
    for r, rate, eta, angle in ((31.7, 3.3, 400.0, 0.4), (180.0, -17.0, 900.0, 1.3), (299.0, 0.1, 200.0, 2.2)):
        delays, amplitude = echo_delays(array, r, rate, angle), math.sqrt(eta / 2) * np.exp(1j * r)
        samples += book.echo(delays, amplitude)
        outputs += array.receive(delays[None], [amplitude])
    largest = np.abs(book.filtered(samples)).max()
    np.testing.assert_allclose(joined(outputs), book.filtered(samples), rtol=0.0, atol=1e-9 * largest)
    image, direct = array.image(outputs), book.image(samples)
    assert image.shape == (4 * count, elements, 2, book.cells)
    np.testing.assert_allclose(joined(image), direct, rtol=0.0, atol=1e-9 * np.abs(direct).max())
    threshold = array.threshold(1e-3)
    expected, found = book.peaks(direct, threshold), array.peaks(image, threshold)
    assert len(expected) >= len(found.z) >= 3
    places = np.array([[d, f] for _, d, f in expected])
    cell = SPEED_OF_LIGHT / BAND / 4, -SPEED_OF_LIGHT / CARRIER / 2 / (len(direct) * 1e-3)
    turns = np.stack([found.z[:, 0] / cell[0], found.z[:, 1] / cell[1] % len(direct)], axis=1)
    off = np.abs(turns[:, None] - places)
    off[..., 1] = np.minimum(off[..., 1], len(direct) - off[..., 1])
    nearest = off.max(axis=2).argmin(axis=1)
    assert (off.max(axis=2).min(axis=1) <= 1.0).all()  # a fit moves a peak by less than a cell
    assert len(set(nearest)) == len(nearest)  # and each is one of the textbook's
    dropped = set(range(len(expected))) - set(nearest.tolist())
    assert all(book_says_sidelobe(k, expected, direct, array) for k in dropped)


def book_says_sidelobe(k, maxima, image, array):
    """Whether maximum k is within 3 dB of the lobes that all stronger maxima have there."""
    top, d, f = maxima[k]
    count = image.shape[0] // 4
    beams = np.exp(
        2j * np.pi * np.outer(np.arange(3 * array.elements) / (3 * array.elements), np.arange(array.elements))
    )
    reached = 0.0
    width = array.train.measurement_covariance(CARRIER, 1.0)
    decay = (SPEED_OF_LIGHT / BAND / 4) ** 2 * np.linalg.inv(width)[0, 0]
    for stronger, own_d, own_f in maxima[:k]:
        x = min(abs(f - own_f), len(image) - abs(f - own_f)) / 4
        if x < 1.0:
            reached += stronger * math.exp(-decay * (d - own_d) ** 2)
        else:
            there = (np.abs(beams @ image[own_f, :, d]) ** 2).max()
            reached += there / (count * math.sin(math.pi * x / count)) ** 2
    return top <= 2.0 * reached


@pytest.mark.parametrize("duration", [0.5e-6, 1.375e-6])
def test_noise_of_the_outputs_has_the_law_of_filtered_samples(duration):
    """Its covariance is M M^H for the matrix M of the textbook's correlations, to rounding."""
    array, book = receiver(duration=duration), Textbook(25, duration, "up", 3)
    M = np.array([book.delayed(cell / 2) for cell in range(book.cells)]).conj()
    np.testing.assert_allclose(covariance(array.noise_law), M @ M.conj().T, rtol=0.0, atol=1e-12 / 75)


def covariance(law):
    """Covariance of complex outputs that ``add_noise`` makes of unit normals."""
    one, other = law.factors
    cells, half = one.shape[1] + other.shape[1], other.shape[1]
    maps = np.zeros((2, law.rank, cells), complex)  # of the weights of a, and of i b
    maps[0, : len(one), : one.shape[1]] = one
    maps[0, : len(one), cells - half :] = one[:, :half][:, ::-1]
    maps[1, law.second : law.second + len(other), :half] = 1j * other
    maps[1, law.second : law.second + len(other), cells - half :] = -1j * other[:, ::-1]
    both = maps.sum(axis=0)
    return 2.0 * (both.T @ both.conj())


@pytest.mark.parametrize("cells", [12, 13])
def test_noise_of_a_pulse_without_symmetry(cells):
    """A complex covariance, of a moving average."""
    taps = np.array([1.0, 0.5 - 0.4j, 0.3j])
    lags = np.array([np.vdot(taps[: 3 - d], taps[d:]) for d in range(3)] + [0.0] * (cells - 3))
    expected = np.array([[lags[i - j] if i >= j else lags[j - i].conj() for j in range(cells)] for i in range(cells)])
    np.testing.assert_allclose(covariance(noise_law(lags, False)), expected, atol=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("count", [24, 25])
def test_noise_is_drawn_by_its_law(count):
    """2000 trains: mean, covariance and fourth moments within five standard errors; pulses and elements differ."""
    array = receiver(count=count)
    outputs = joined(np.array([array.noise(key) for key in range(2000)])) * math.sqrt(count * 3)
    cell = outputs[..., 77]
    size = cell.size
    for lag in (0, 1, 5):
        expected = covariance(array.noise_law)[77 + lag, 77] * count * 3
        got = (outputs[..., 77 + lag] * cell.conj()).mean()
        assert abs(got - expected) < 5.0 / math.sqrt(size)
    assert abs((cell**2).mean()) < 5.0 * math.sqrt(2.0 / size)  # circular
    assert abs((np.abs(cell) ** 4).mean() - 2.0) < 5.0 * math.sqrt(20.0 / size)
    between = np.einsum("nqm,npk->qmpk", cell, cell.conj()) / len(cell)
    between = between.reshape(3 * count, 3 * count)
    assert np.abs(between - np.eye(3 * count)).max() < 6.0 / math.sqrt(2000)


def test_many_pulses_take_the_fft(monkeypatch):
    """Both transforms give the same image."""
    for count in (24, 25):
        array = receiver(count=count)
        outputs = array.noise(1)
        dense = array.image(outputs)
        with monkeypatch.context() as patch:
            patch.setattr("wavegym.sensors.receiver.DENSE", 0)
            np.testing.assert_allclose(array.image(outputs), dense, rtol=0.0, atol=1e-13)


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


@pytest.mark.parametrize("rate", [-9.0, 0.0, 9.0])
@pytest.mark.parametrize("cells", [-1, 1])
def test_a_target_beside_a_stronger_one_is_kept_wherever_the_doppler_cells_begin(rate, cells):
    """One Doppler cell apart, a quarter of a resolution cell, and far apart in range; cells begin at a rate of 0."""
    other = rate + cells * SPEED_OF_LIGHT / CARRIER / 2e-3 / 100
    both = echo(LONG, 60.0, rate, 800.0) + echo(LONG, 200.0, other, 200.0)
    peaks = LONG.peaks(LONG.image(both), 7.0)
    np.testing.assert_allclose(peaks.z[:, :2], [[60.0, rate], [200.0, other]], atol=0.1)


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
        power.append(2.0 * np.mean(image**2) * elements)  # real and imaginary part; each element has its share
        count += len(array.peaks(image, threshold).z)
    assert np.mean(power) == pytest.approx(1.0, abs=0.02)
    area = 150 * 300.0 * SPEED_OF_LIGHT / CARRIER / 2e-3
    assert count / area == pytest.approx(1e-3, rel=0.2)


@pytest.mark.parametrize("elements", [2, 3])
def test_the_rest_of_a_plane_wave_is_chi_square(elements):
    """2 L numbers minus those of amplitude, phase and direction: X = chi2 / (2 L - 3). The variance of the direction is
    that of the bound times max(X, 1). Its mean agrees with the moments of the chi-square within four standard errors.
    """
    array, rng, count, free = receiver(8, 0.5e-6, elements=elements), np.random.default_rng(0), 400, 2 * elements - 3
    factors = np.empty(count)
    for k in range(count):
        r, rate = rng.uniform(60.0, 250.0), rng.uniform(-10.0, 10.0)
        signal = echo(array, r, rate, 200.0, *rng.uniform(0.0, 2.0 * np.pi, 2))
        peaks = array.peaks(array.image(signal + noise(array, rng)), 15.0)
        factors[k] = peaks.R[0, 2, 2] / direction_variance(peaks.snr[0], elements)
    mean = chi2.cdf(free, free) + chi2.sf(free, free + 2)
    square = chi2.cdf(free, free) + chi2.sf(free, free + 4) * (free + 2) / free
    assert factors.mean() == pytest.approx(mean, abs=4.0 * math.sqrt((square - mean**2) / count))


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
        (lambda: LONG.image(np.zeros((25, 3, 7))), r"outputs has shape \(25, 3, 7\), expected \(25, 3, 2, "),
        (lambda: LONG.noise(-1), "key is -1"),
        (lambda: LONG.noise(2**64), "key is 18446744073709551616"),
        (lambda: LONG.peaks(np.zeros((3, 7, 7)), 7.0), r"image has shape \(3, 7, 7\), expected \(100, 3, 2, "),
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
