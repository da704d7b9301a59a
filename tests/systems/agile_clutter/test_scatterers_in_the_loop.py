"""Radars among scatterers: SNR over clutter in the kernels, the world and every prediction; what is refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import oracles
import pytest
from numpy.testing import assert_allclose
from scipy import special, stats

from wavegym.core import shortcuts
from wavegym.core.action_sets import Library
from wavegym.core.errors import InputError
from wavegym.core.horizon_weights import horizon_weights
from wavegym.sensors.detection_kernels import detection_of, effective_snr
from wavegym.sensors.scatterers import KINDS, Scatterers, clutter_power, likely_textures
from wavegym.sensors.scatterers_kernels import noise_with_clutter
from wavegym.systems.agile_clutter.kernels import detected
from wavegym.systems.agile_clutter.system import AgileClutter
from wavegym.systems.beam_allocation.system import BeamAllocation
from wavegym.systems.energy_budget.system import EnergyBudget
from wavegym.waveforms import PulseTrain, TrapezoidChirp

TRAINS = {"durations": (3e-6,) * 2, "sweeps": (5e6,) * 2, "counts": (16, 16), "intervals": (220e-6, 300e-6)}
PULSE = TrapezoidChirp(kind="lfm", duration=3e-6, sweep=5e6)
LIBRARY = Library(tuple(PulseTrain(PULSE, count=16, interval=interval) for interval in (250e-6, 300e-6)))


def beams(field="ground"):
    return BeamAllocation(scatterers=field, **TRAINS)


@pytest.mark.parametrize("kind", ["ground", "sea", "rain"])
def test_the_table_is_the_formula_between_its_points(kind):
    """Within 2 % of noise and clutter at places that the table does not hold."""
    system, rng = BeamAllocation(scatterers=kind, **TRAINS), np.random.default_rng(4)
    r, v = rng.uniform(12e3, 30e3, 40), rng.uniform(-200.0, 200.0, 40)
    for w, waveform in enumerate(system.action_set.waveforms):
        want = 1.0 + np.diagonal(clutter_power(KINDS[kind], waveform, system.carrier_hz, r, v))
        got = [noise_with_clutter(system.clutter_field, w, *each, 0.5) for each in zip(r, v, strict=True)]
        assert_allclose(got, want, rtol=0.02)


def test_beyond_the_table_the_clutter_is_that_of_its_edge():
    field = beams().clutter_field
    for r, v, edge in ((1e6, 10.0, field.power[0, -1]), (1.0, 10.0, field.power[0, 0])):
        assert edge.min() <= noise_with_clutter(field, 0, r, v, 0.5) - 1.0 <= edge.max()
    assert_allclose(
        noise_with_clutter(field, 0, 20e3, 1e4, 0.0), noise_with_clutter(field, 0, 20e3, -field.slowest, 0.0)
    )


@pytest.mark.parametrize("amplitude", ["rayleigh", "k"])
def test_what_is_predicted_is_the_mean_over_range_rates_and_textures(amplitude):
    """Pd and the errors of detected echoes, against 20,000 drawn range-rates and textures, to 5 standard errors."""
    shape = {"rayleigh": None, "k": 0.8}[amplitude]
    radar = beams(dataclasses.replace(KINDS["ground"], amplitude=amplitude, shape=shape))._radar
    rng, drawn = np.random.default_rng(0), 20_000
    for v, sigma, eta in ((3.0, 4.0, 60.0), (20.0, 3.0, 30.0), (31.0, 8.0, 100.0)):
        g = rng.gamma(shape, 1.0 / shape, drawn) if shape else np.ones(drawn)
        rates = v + sigma * rng.standard_normal(drawn)
        mean = np.array([noise_with_clutter(radar.field._replace(texture=np.ones(1)), 0, 20e3, v, 0.0) for v in rates])
        seen = eta / (1.0 + (mean - 1.0) * g)
        pd = np.array([detection_of(each, 0, radar.law) for each in seen])
        error = pd / np.array([effective_snr(each, 0, radar.law) for each in seen])
        got, effective = detected(eta, 20e3, v, sigma**2, 0, 0, radar.field, radar.law)
        rule = 0.04  # of thirteen places, where clutter changes within the belief
        assert abs(got - pd.mean()) < rule + 5.0 * pd.std() / np.sqrt(drawn)
        assert abs(got / effective - error.mean()) < rule * error.mean() + 5.0 * error.std() / np.sqrt(drawn)


@pytest.mark.parametrize(("amplitude", "shape"), [("rayleigh", None), ("k", 0.5), ("weibull", 1.0)])
def test_the_textures_of_kernels_have_the_mean_and_the_law_of_the_field(amplitude, shape):
    """Mean 1; quantiles of the gamma law; for Weibull amplitudes the mean of exp(-x / g) is that of their law."""
    values = likely_textures(Scatterers(density=1.0, reference_range=1e4, amplitude=amplitude, shape=shape))
    assert values.mean() == pytest.approx(1.0, rel=1e-12)
    assert (np.diff(values) >= 0.0).all()
    if amplitude == "k":
        want = stats.gamma(shape, scale=1.0 / shape).ppf((np.arange(values.size) + 0.5) / values.size)
        assert np.abs(values - want)[: values.size // 2].max() < 0.02
        assert_allclose(values[values.size // 2 : -5], want[values.size // 2 : -5], rtol=0.04)
    if amplitude == "weibull":
        for x in (0.5, 1.0, 3.0):  # power beyond x: exp(-(x Gamma(1 + 2 / shape))^(shape / 2))
            want = np.exp(-((x * special.gamma(1.0 + 2.0 / shape)) ** (0.5 * shape)))
            assert np.exp(-x / values).mean() == pytest.approx(want, abs=0.01)


@pytest.mark.parametrize("shape", [None, 0.8])
def test_detections_in_the_world_are_as_likely_as_the_formula_says(shape):
    """One train of both radars at one target: at a blind speed and beside it; Rayleigh and K amplitudes."""
    count, amplitude = 4000, "k" if shape else "rayleigh"
    g = np.random.default_rng(1).gamma(shape, 1.0 / shape, 4000) if shape else np.ones(1)
    for speed in (0.0, 14.0):
        field = Scatterers(density=0.3, reference_range=20e3, amplitude=amplitude, shape=shape)
        system = BeamAllocation(
            scatterers=field, **TRAINS, starts=((0.0, 4e3, speed, speed),), births=(0,), spread=(0.0,) * 4, q=0.0,
            clutter_density=0.0, windows=((0, 59, 59),),
        )  # fmt: skip
        worlds = oracles.worlds(system, count, seed=8)
        state = system.transition(system.initial(worlds), np.zeros(count, int), worlds)
        want = 0.0
        for seen in state.truth.targets[0, 0, :2] - np.array(system.sensors):
            r = np.hypot(*seen)
            v = seen @ state.truth.targets[0, 0, 2:] / r
            c = clutter_power(field, system.action_set.waveforms[0], system.carrier_hz, r, v)[0, 0]
            eta = (system.reference_range / r) ** 4 / (1.0 + c * g)
            want += np.mean([detection_of(each, 0, system._radar.law) for each in eta])
        got = system.state_info(state)["detections"]
        assert abs(got.mean() - want) < 5.0 * got.std() / np.sqrt(count) + 0.01


def test_predictions_of_all_forms_agree():
    """``predict``, the gain of beams, and the costs sensor by sensor see the same clutter."""
    system = beams()
    worlds = oracles.worlds(system, 6)
    state = system.initial(worlds)
    for step in range(5):
        state = system.transition(state, np.full(6, 7 * step), worlds)
    every = system.candidates()[None]
    with_look = system.predict(state.belief, every).covariance
    without = system.predict(state.belief, every, np.ones((6, every.size, 2, 3))).covariance
    M = horizon_weights(system.motion.F, system.weights, 3)
    assert_allclose(
        shortcuts.gain(system, state.belief, 0, 3),
        np.einsum("ab,ectab->ec", M, without - with_look),
        rtol=1e-9,
        atol=1e-9,
    )
    agile = AgileClutter(library=LIBRARY, scatterers="sea", births=(0, 0), horizon=25)
    belief = agile.transition(*played(agile, 4)).belief
    by_sensor = shortcuts.sensor_by_sensor(agile)
    for n, _ in enumerate(LIBRARY):
        C, windows = agile.action_set.sensor_covariances[n], agile.action_set.sensor_windows[n]
        targets = by_sensor.begin(belief)
        for sensor in range(2):
            cost = by_sensor.costs(targets, sensor, C[None, None], windows[None, None], np.zeros(1, int))
            targets = by_sensor.after(
                targets, sensor, C[None].repeat(4, 0), windows[None].repeat(4, 0), np.zeros(4, int)
            )
        want = agile.cost(agile.predict(belief, np.full((4, 2), n)))
        assert_allclose(cost[:, 0], want, rtol=1e-9)


def played(system, count):
    worlds = oracles.worlds(system, count)
    return system.initial(worlds), np.zeros((count, 2), int), worlds


def test_a_shorter_pulse_receives_less_clutter():
    system = EnergyBudget(scatterers="rain")
    pulses, field = system.action_set, system.clutter_field
    for n, waveform in enumerate(pulses.waveforms):
        want = pulses.strength[n + 1] * clutter_power(KINDS["rain"], waveform, system.carrier_hz, 20e3, 40.0)[0, 0]
        assert_allclose(noise_with_clutter(field, n, 20e3, 40.0, 0.5) - 1.0, want, rtol=0.01)
        assert pulses.sensor_windows[n + 1, -1] == n


def test_without_scatterers_there_is_no_field():
    assert BeamAllocation().clutter_field is None
    assert noise_with_clutter(None, 0, 20e3, 0.0, 0.5) == 1.0
    empty = BeamAllocation(scatterers=Scatterers(density=0.0, reference_range=20e3))
    worlds = oracles.worlds(empty, 5)
    for _ in range(2):
        states = [s.transition(s.initial(worlds), np.full(5, 9), worlds) for s in (empty, BeamAllocation())]
        assert_allclose(states[0].belief.covariance, states[1].belief.covariance, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("kind", "parameters", "words"),
    [
        (BeamAllocation, {"scatterers": "gruond"}, "scatterers"),
        (AgileClutter, {"scatterers": "sea", "action": "box"}, "action='library' or 'joint'"),
        (BeamAllocation, {"intervals": (250e-6,)}, "expected one of each for every chirp"),
    ],
)
def test_bad_input_is_refused(kind, parameters, words):
    with pytest.raises((InputError, ValueError), match=words):
        kind(**parameters)
