"""Eclipsing and folding against a simulation of pulses: samples, matched filters and Monte Carlo."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pytest
from pulse_simulation import Receiver, maximum_likelihood, receiver, statistic
from scipy.stats import chi2, norm

from wavegym.sensors import EclipsedPulse, detection_probability, fold_range, fold_velocity
from wavegym.waveforms import GaussianChirp, PulseTrain, TrapezoidChirp, Waveform

C, CARRIER = 299792458.0, 10e9
UNIT = 1e-6
PLAIN = GaussianChirp(duration=10 * UNIT)
UP = GaussianChirp(duration=10 * UNIT, chirp_rate=2e10)
DOWN = GaussianChirp(duration=10 * UNIT, chirp_rate=2e10, direction="down")
LFM = TrapezoidChirp(kind="lfm", duration=50 * UNIT, sweep=0.3e6, rise=10 * UNIT)
HFM = TrapezoidChirp(kind="hfm", duration=50 * UNIT, sweep=0.4e6, rise=10 * UNIT, direction="down")
PFM = TrapezoidChirp(kind="pfm", duration=50 * UNIT, sweep=0.4e6, rise=5 * UNIT)


class Setting(NamedTuple):
    waveform: Waveform
    delay: float  # us
    interval: float | None = None  # us
    recovery: float = 0.0  # us


NEAR, FAR = 400.0, 350.0  # an interval, and delays near its end
SETTINGS = {
    "whole pulse": Setting(UP, 120.0),
    "unmodulated, begin cut": Setting(PLAIN, 22.0),
    "up, begin cut": Setting(UP, 18.0),
    "up, nearly hidden": Setting(UP, 10.0),
    "down, begin cut": Setting(DOWN, 22.0, NEAR),
    "up, end cut": Setting(UP, 380.0, NEAR),
    "down, end cut, second fold": Setting(DOWN, 784.0, NEAR),
    "linear FM, begin cut": Setting(LFM, 30.0),
    "linear FM, end cut": Setting(LFM, 372.0, NEAR),
    "hyperbolic FM down, begin cut, recovery": Setting(HFM, 25.0, NEAR, 6.0),
    "hyperbolic FM down, end cut": Setting(HFM, 378.0, NEAR),
    "power FM, end cut, first fold": Setting(PFM, 772.0, NEAR),
    "both ends cut": Setting(LFM, 40.0, 80.0),
    "train, begin cut": Setting(PulseTrain(DOWN, count=6, interval=400 * UNIT), 20.0),
    "train, end cut, second fold": Setting(PulseTrain(HFM, count=6, interval=400 * UNIT), 776.0),
}  # fmt: skip
ETA, TRIALS, SAMPLES = 1e6, 1000, 160
FALSE_ALARM, DRAWS = 0.01, 20_000


def eclipsed(setting: Setting) -> EclipsedPulse:
    interval = None if setting.interval is None else setting.interval * UNIT
    return EclipsedPulse(setting.waveform, interval, recovery=setting.recovery * UNIT)


def simulated(setting: Setting) -> Receiver:
    """The transmitted interval is that of 99 % of the energy, found by sampling the pulse's power."""
    train = setting.waveform if isinstance(setting.waveform, PulseTrain) else None
    pulse = train.pulse if train else setting.waveform
    t = np.linspace(*pulse.support, 200_001)
    energy = np.cumsum(pulse.envelope(t) ** 2) * (t[1] - t[0])
    first, last = np.interp([0.005, 0.995], energy, t)
    interval = train.interval / UNIT if train else setting.interval
    opens, closes = last + setting.recovery * UNIT, first
    if interval is None:
        windows = [(opens, np.inf)]
    else:
        windows = [(opens + m * interval * UNIT, closes + (m + 1) * interval * UNIT) for m in range(-1, 4)]
    return receiver(setting.waveform, setting.delay * UNIT, windows, SAMPLES)


@lru_cache
def errors(name: str) -> np.ndarray:
    """Errors of range and range-rate of the maximum-likelihood estimates, (2, trial)."""
    setting = SETTINGS[name]
    radar = simulated(setting)
    delay = setting.delay * UNIT
    R = eclipsed(setting).measurement_covariance(C / 2 * delay, CARRIER) / ETA
    to_range, to_rate = C / 2, -C / (2 * CARRIER)
    rng = np.random.default_rng(1)
    truth, still = np.full(TRIALS, delay), np.zeros(TRIALS)
    clean = np.sqrt(ETA / 2) * radar.echo(truth[:1], still[:1]) * np.exp(2j * np.pi * rng.random((TRIALS, 1)))
    y = clean + radar.noise(rng, TRIALS)
    step = np.sqrt(np.diag(R)) / [C / 2, C / (2 * CARRIER)]
    start = rng.standard_normal((2, TRIALS)) * step[:, None]  # anywhere near, not at the truth
    found = maximum_likelihood(radar, y, truth + start[0], still + start[1], tuple(0.2 * step))
    best = statistic(radar, y, *found)  # a maximum: no point around it is higher
    for angle in np.linspace(0, 2 * np.pi, 8, endpoint=False):
        away = np.linalg.cholesky(R) @ [np.cos(angle), np.sin(angle)]
        assert (statistic(radar, y, found[0] + away[0] / to_range, found[1] + away[1] / to_rate) < best).all()
    return np.stack([(found[0] - delay) * to_range, found[1] * to_rate])


def whitened_moments(name: str, R: np.ndarray) -> np.ndarray:
    """Second moments of the errors, in units of the covariance that is claimed, (2, 2); the identity if it is right."""
    whitened = np.linalg.solve(np.linalg.cholesky(R), errors(name))
    return whitened @ whitened.T / TRIALS


@pytest.mark.slow
@pytest.mark.parametrize("name", SETTINGS)
def test_maximum_likelihood_reaches_the_bound(name):
    """Covariance of range and range-rate errors in 1000 trials, at an SNR where the bound is reached.

    Each moment of the whitened errors is within 5 standard errors, 0.22 for a variance. Their sum, chi-square of 2 x
    trials, is within its interval of 2e-5.
    """
    setting = SETTINGS[name]
    R = eclipsed(setting).measurement_covariance(C / 2 * setting.delay * UNIT, CARRIER) / ETA
    moments = whitened_moments(name, R)
    np.testing.assert_allclose(np.diag(moments), 1.0, atol=5 * np.sqrt(2 / TRIALS))
    assert abs(moments[0, 1]) < 5 / np.sqrt(TRIALS)
    low, high = chi2.ppf([1e-5, 1 - 1e-5], 2 * TRIALS) / TRIALS
    assert low < np.trace(moments) < high


@pytest.mark.slow
@pytest.mark.parametrize("name", ["up, begin cut", "linear FM, end cut", "hyperbolic FM down, begin cut, recovery"])
def test_wrong_laws_are_told_apart(name):
    """Planted defects: the whole pulse's covariance over f, and the gate of a receiver that opens a fifth later."""
    setting = SETTINGS[name]
    pulse, r = eclipsed(setting), C / 2 * setting.delay * UNIT
    whole = setting.waveform.measurement_covariance(CARRIER, ETA * float(pulse.visible_share(r)))
    moved = pulse.measurement_covariance(0.8 * r if setting.delay < 100 else 1.02 * r, CARRIER) / ETA
    for wrong in (whole, moved):
        moments = whitened_moments(name, wrong)
        assert np.abs(moments - np.eye(2)).max() > 5 * np.sqrt(2 / TRIALS)


@pytest.mark.slow
@pytest.mark.parametrize("replica", ["visible", "full"])
@pytest.mark.parametrize("name", SETTINGS)
def test_detection_of_a_fluctuating_target(name, replica):
    """Swerling 1 echo through both filters; the share of detections against Pd of the reduced SNR.

    The full replica is correlated with noise of its whole length: the echo is blanked, the receiver's noise is not.
    """
    setting = SETTINGS[name]
    radar = simulated(setting)
    rng = np.random.default_rng(2)
    s = radar.echo(np.array([setting.delay * UNIT]), np.zeros(1))[0]
    energy = (np.abs(s) ** 2).sum() * radar.dt
    snr = 40.0
    amplitude = np.sqrt(snr / 2) * (rng.standard_normal((2, DRAWS)) * np.sqrt(0.5)).T @ [1, 1j]
    output = np.empty(DRAWS, dtype=complex)
    for k in range(0, DRAWS, 1000):  # echo and noise through the filter s
        y = amplitude[k : k + 1000, None] * s + radar.noise(rng, 1000)
        output[k : k + 1000] = y @ np.conj(s) * radar.dt
    if replica == "visible":
        power = np.abs(output) ** 2 / energy  # noise of one unit
    else:  # the noise of the hidden part of the replica comes on top: its energy is 1 - f
        hidden = (rng.standard_normal((2, DRAWS)) * np.sqrt(0.5 * max(1 - energy, 0.0))).T @ [1, 1j]
        power = np.abs(output + hidden) ** 2
    detected = (power > -np.log(FALSE_ALARM)).mean()
    pulse = eclipsed(setting)
    pd = detection_probability(snr * pulse.snr_factor(C / 2 * setting.delay * UNIT, replica), FALSE_ALARM)
    assert detected == pytest.approx(pd, abs=5 * np.sqrt(pd * (1 - pd) / DRAWS))


def test_the_settings_cover_whole_pulses_and_partial_overlaps():
    shares = {
        name: float(eclipsed(setting).visible_share(C / 2 * setting.delay * UNIT)) for name, setting in SETTINGS.items()
    }
    assert shares["whole pulse"] > 0.999
    assert sum(0.2 < f < 0.9 for f in shares.values()) >= 10, shares


PULSE = TrapezoidChirp(kind="lfm", duration=4e-6, sweep=1e6, rise=1e-6)
TARGETS = [(12e3, 40.0), (29e3, -75.0), (47.3e3, 130.0), (8e3, -300.0)]


@pytest.mark.parametrize("prf", [8e3, 11e3])
@pytest.mark.parametrize(("distance", "rate"), TARGETS)
def test_a_pulse_train_shows_the_folded_range_and_velocity(prf, distance, rate):
    """Steady train of 64 pulses at 2 PRFs: range-Doppler map of the receive windows, whose peak is the folded target.

    The target is far beyond the unambiguous range, echoes come whole windows later. Peak to one cell.
    """
    interval, count, dt = 1 / prf, 64, 0.25e-6
    tau, doppler = 2 * distance / C, -2 * rate * CARRIER / C
    fast = np.arange(round(interval / dt)) * dt
    times = interval * np.arange(count)[:, None] + fast  # (pulse, sample) of the receiver
    y = np.zeros(times.shape, dtype=complex)
    earliest = -int(np.ceil(tau / interval)) - 1
    for m in range(earliest, count + 1):  # pulses before the dwell fill the first windows
        y += PULSE.signal(times - m * interval - tau)
    y *= np.exp(2j * np.pi * doppler * times)
    noise = np.random.default_rng(0).standard_normal((2, *times.shape)) * 0.1 * np.abs(y).max()
    y += noise[0] + 1j * noise[1]
    replica = PULSE.signal((fast + interval / 2) % interval - interval / 2)
    compressed = np.fft.ifft(np.fft.fft(y, axis=1) * np.conj(np.fft.fft(replica)), axis=1)
    image = np.abs(np.fft.fft(compressed, axis=0))
    row, column = np.unravel_index(image.argmax(), image.shape)
    width = C / (2 * CARRIER) * prf
    apparent = fold_range(distance, C / 2 * interval).apparent
    seen_rate = fold_velocity(-np.fft.fftfreq(count, interval)[row] * C / (2 * CARRIER), width).apparent
    # The Doppler shift moves the peak of a chirp by nu / rate, 0.25 us here.
    assert C / 2 * fast[column] == pytest.approx(apparent, abs=C / 2 * (2 * dt + abs(doppler) * 4e-12))
    difference = seen_rate - fold_velocity(rate, width).apparent
    assert abs((difference + width / 2) % width - width / 2) <= width / count


def test_the_errors_of_a_sum_of_trials_are_those_assumed():
    """5 standard errors are exceeded once in 2e6."""
    assert 2 * norm.sf(5.0) < 1e-6
