"""Clutter of scatterers, against simulated pulses over simulated scatterers and against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special
from scipy.constants import speed_of_light

from wavegym.core.errors import InputError
from wavegym.sensors.scatterers import Scatterers, clutter_power, exceedance, texture
from wavegym.waveforms import GaussianChirp, PulseTrain, TrapezoidChirp

CARRIER = 10e9
NUMBER = 3000  # simulated scatterers of a fold
SHORT = GaussianChirp(duration=1e-6)
UP, DOWN = (GaussianChirp(duration=4e-6, chirp_rate=3e11, direction=direction) for direction in ("up", "down"))
LONG = GaussianChirp(duration=20e-6)
HYPERBOLIC = TrapezoidChirp(kind="hfm", duration=20e-6, sweep=1e6)
SLOW = PulseTrain(SHORT, count=8, interval=100e-6)
FAST = PulseTrain(SHORT, count=8, interval=25e-6)
OF_CHIRPS = PulseTrain(UP, count=4, interval=120e-6)
GROUND = {"density": 0.02, "reference_range": 10e3}
RAIN = {**GROUND, "exponent": 2.0, "rate": -8.0, "spread": 4.0}
SEA = {**GROUND, "rate": 3.0, "spread": 1.5}


def simulated(scatterers, waveform, r, v, rng):
    """c(r, v) by scatterers at places and range-rates of their own, and its standard error."""
    train = waveform if isinstance(waveform, PulseTrain) else PulseTrain(waveform, count=1, interval=1.0)
    begin, end = train.pulse.support
    step = 0.2 / np.sqrt(train.pulse.fisher_information()[0, 0])
    starts = (np.arange(train.count) - 0.5 * (train.count - 1)) * train.interval
    t = (starts[:, None] + np.arange(begin, end, step)).ravel()
    receiver, reach, fold = np.conj(train.signal(t)) * step, 0.5 * speed_of_light * (end - begin), train.interval
    total, variance = 0.0, 0.0
    for apart in range(1 - train.count, train.count):
        middle = r + 0.5 * speed_of_light * apart * fold
        where = middle + reach * (2.0 * (np.arange(NUMBER) + rng.random(NUMBER)) / NUMBER - 1.0)  # one in each stratum
        rate = scatterers.rate + scatterers.spread * rng.standard_normal(NUMBER)
        delay, doppler = 2.0 * (where - r) / speed_of_light, -2.0 * CARRIER * (rate - v) / speed_of_light
        echo = train.signal(t - delay[:, None]) * np.exp(2j * np.pi * doppler[:, None] * t)
        energy = scatterers.per_metre(where) * np.abs(echo @ receiver) ** 2 * 2.0 * reach
        total += energy.mean()
        variance += np.square(np.diff(energy)).mean() / 2.0 / NUMBER  # of neighbouring strata
    return total, np.sqrt(variance)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("waveform", "field", "r", "v"),
    [
        (SHORT, GROUND, 8e3, 0.0),
        (LONG, GROUND, 12e3, 0.0),
        (LONG, GROUND, 12e3, 300.0),
        (LONG, RAIN, 12e3, 250.0),
        (UP, GROUND, 8e3, 200.0),
        (DOWN, GROUND, 8e3, 200.0),
        (UP, RAIN, 5e3, -200.0),
        (HYPERBOLIC, SEA, 15e3, 30.0),
        (SLOW, GROUND, 14e3, 0.0),
        (SLOW, GROUND, 14e3, 12.0),
        (SLOW, RAIN, 14e3, 20.0),
        (SLOW, SEA, 14e3, -9.0),
        (FAST, GROUND, 3e3, 30.0),
        (FAST, RAIN, 14e3, 40.0),
        (OF_CHIRPS, SEA, 12e3, 25.0),
    ],
)
def test_the_mean_power_is_that_of_simulated_pulses(waveform, field, r, v):
    scatterers = Scatterers(**field)
    found, error = simulated(scatterers, waveform, r, v, np.random.default_rng(0))
    assert clutter_power(scatterers, waveform, CARRIER, r, v)[0, 0] == pytest.approx(found, abs=4.0 * error, rel=0.01)


@pytest.mark.parametrize("waveform", [SHORT, UP, HYPERBOLIC], ids=lambda waveform: waveform.label)
def test_no_waveform_escapes_clutter_of_all_range_rates(waveform):
    """Where scatterers are uniform in range, the integral over range-rate is the volume under |chi|^2, 1 in s Hz."""
    even = Scatterers(density=1.0, reference_range=1e4, exponent=0.0, spread=0.0)
    widest = 8.0 * np.sqrt(waveform.fisher_information()[0, 0]) / (2.0 * np.pi) * speed_of_light / (2.0 * CARRIER)
    rates = np.linspace(-widest, widest, 201)
    volume = np.trapezoid(clutter_power(even, waveform, CARRIER, 1e4, rates)[0], rates)
    assert volume == pytest.approx(speed_of_light**2 / (4.0 * CARRIER), rel=0.01)


def test_a_train_is_blind_at_multiples_of_its_fold():
    wavelength = speed_of_light / CARRIER
    blind = 0.5 * wavelength / SLOW.interval
    power = clutter_power(Scatterers(**GROUND), SLOW, CARRIER, 14e3, [0.0, blind, 0.5 * blind])[0]
    assert power[1] == pytest.approx(power[0], rel=0.01)
    assert power[2] < 0.01 * power[0]


def test_without_scatterers_there_is_no_clutter():
    none = Scatterers(density=0.0, reference_range=1e4)
    assert not clutter_power(none, SLOW, CARRIER, [5e3, 9e3], [0.0, 5.0, 9.0]).any()


def test_kappa_falls_with_the_range_from_the_nearest_scatterers_on():
    field = Scatterers(density=0.3, reference_range=2e3, exponent=2.5)
    np.testing.assert_allclose(field.per_metre([2e3, 8e3]), [0.3, 0.3 / 32.0], rtol=1e-12)
    assert not field.per_metre(99.0).any()


@pytest.mark.parametrize("shape", [0.3, 1.0, 5.0])
def test_k_distributed_clutter_has_its_law(shape):
    T = np.array([1.0, 3.0, 8.0, 15.0])
    bessel = 2.0 / special.gamma(shape) * (shape * T) ** (0.5 * shape) * special.kv(shape, 2.0 * np.sqrt(shape * T))
    np.testing.assert_allclose(exceedance(T, 1e9, 0.0, "k", shape), bessel, rtol=0.005)


@pytest.mark.parametrize("shape", [0.5, 1.0, 1.5, 2.0])
def test_weibull_clutter_has_its_law(shape):
    T = np.array([1.0, 3.0, 8.0, 15.0])
    law = np.exp(-((T * special.gamma(1.0 + 2.0 / shape)) ** (0.5 * shape)))
    np.testing.assert_allclose(exceedance(T, 1e9, 0.0, "weibull", shape), law, rtol=0.005)


@pytest.mark.parametrize(("amplitude", "shape"), [("rayleigh", 1.0), ("k", 0.7), ("weibull", 1.2)])
def test_detections_and_false_alarms_are_those_of_drawn_powers(amplitude, shape):
    rng, count, T, c, eta = np.random.default_rng(1), 400_000, 6.0, 4.0, 60.0
    if amplitude == "weibull":
        clutter = c * rng.weibull(0.5 * shape, count) / special.gamma(1.0 + 2.0 / shape)
    else:
        g = rng.gamma(shape, 1.0 / shape, count) if amplitude == "k" else 1.0
        clutter = c * g * rng.exponential(size=count)
    phases = np.exp(2j * np.pi * rng.random(count))
    other = [rng.standard_normal((2, count)) * np.sqrt(0.5 * power) for power in (1.0, 0.5 * eta)]
    noise, echo = (x + 1j * y for x, y in other)
    for snr, received in ((0.0, noise), (eta, noise + echo)):
        share = np.mean(np.abs(received + np.sqrt(clutter) * phases) ** 2 > T * (1.0 + c))
        expected = exceedance(T, c, snr, amplitude, shape)
        assert share == pytest.approx(expected, abs=4.0 * np.sqrt(expected / count))


def test_textures_have_a_mean_of_one():
    for amplitude, shape in (("rayleigh", 1.0), ("k", 0.2), ("k", 50.0), ("weibull", 0.2), ("weibull", 1.9)):
        g, weights = texture(amplitude, shape)
        assert weights.sum() == pytest.approx(1.0, rel=1e-9)
        assert g @ weights == pytest.approx(1.0, rel=0.01)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"density": -1.0}, "density is -1.0"),
        ({"spread": -0.1}, "spread is -0.1"),
        ({"amplitude": "rayleih"}, "did you mean .rayleigh."),
        ({"shape": 1.0}, "expected None with amplitude='rayleigh'"),
        ({"amplitude": "k"}, "expected a number with amplitude='k'"),
        ({"amplitude": "weibull", "shape": 3.0}, "shape is 3.0"),
    ],
)
def test_a_field_that_cannot_be_is_refused(given, message):
    with pytest.raises(InputError, match=message):
        Scatterers(**{**GROUND, **given})
