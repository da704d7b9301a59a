"""The radar's actions, copies and draws in Stone Soup."""

from __future__ import annotations

import copy
from datetime import timedelta

import numpy as np
import pytest
from stonesoup.sensormanager import GreedySensorManager, RandomSensorManager
from stonesoup.types.array import StateVector
from stonesoup.types.groundtruth import GroundTruthState

from wavegym.core.errors import InputError
from wavegym.integrations.stonesoup import WaveformRadar, radars_of
from wavegym.integrations.stonesoup.simulation import START
from wavegym.sensors import detection_probability, mean_inverse_detected_snr
from wavegym.systems.agile_clutter import AgileClutter
from wavegym.systems.composed import PlanarRadar, Pulses
from wavegym.systems.energy_budget import EnergyBudget
from wavegym.systems.kershaw_evans import KershawEvans, KershawEvansPosition
from wavegym.waveforms import gaussian_chirp_library

SYSTEM = KershawEvansPosition()
NEXT = START + timedelta(seconds=1)
PLANAR = {"law": PlanarRadar(), "ndim_state": 4, "mapping": (0, 1, 2, 3)}
TRUTH = GroundTruthState(StateVector([20e3, 100.0]), timestamp=NEXT)


def radar_of(system=SYSTEM, seed=1):
    (radar,) = radars_of(system, seed=seed)
    radar.act(START)
    return radar


def test_every_waveform_is_an_action():
    radar = radar_of()
    (generator,) = radar.actions(NEXT)
    actions = list(generator)
    assert [action.target_value for action in actions] == list(range(len(SYSTEM.actions)))
    assert all(action in generator for action in actions)
    assert len(actions) not in generator
    for action in actions:
        radar.add_actions((action,))
        radar.act(NEXT)
        assert radar.waveform == action.target_value
    radar.act(NEXT + timedelta(seconds=1))  # without an action
    assert radar.waveform == actions[-1].target_value


@pytest.mark.parametrize("manager", [RandomSensorManager, GreedySensorManager])
def test_managers_of_stone_soup_enumerate_the_actions(manager):
    """The greedy one finds the waveform that a reward asks for."""
    radar = radar_of()
    found = manager({radar}, reward_function=lambda config, *_: -abs(config[radar][0].target_value - 17))
    ((action,),) = (config[radar] for config in found.choose_actions(set(), NEXT))
    assert 0 <= action.target_value < len(SYSTEM.actions)
    if manager is GreedySensorManager:
        assert action.target_value == 17


def test_a_copy_is_independent_and_draws_on_alike():
    radar = radar_of()
    radar.measure({TRUTH})
    twin = copy.deepcopy(radar)
    (generator,) = twin.actions(NEXT)
    twin.add_actions((generator.action_from_value(5),))
    assert radar.scheduled_actions == {}
    twin.act(NEXT)
    assert (radar.waveform, radar.timestamp, twin.waveform) == (0, START, 5)
    twin.waveform = 0
    (one,), (other,) = radar.measure({TRUTH}), twin.measure({TRUTH})
    np.testing.assert_array_equal(one.state_vector, other.state_vector)


def test_a_copy_has_a_place_of_its_own():
    radar = WaveformRadar(Pulses(SYSTEM.actions, 10.4e9), **PLANAR, position=StateVector([1.0, 2.0]))
    twin = copy.deepcopy(radar)
    twin.position = StateVector([5.0, 6.0])
    np.testing.assert_array_equal(np.ravel(radar.position), [1.0, 2.0])


def test_draws_do_not_depend_on_the_waveform():
    """The error in units of its own covariance is the same with every waveform, and differs from step to step."""
    drawn = []
    for waveform in (3, 50):
        radar = radar_of()
        radar.waveform = waveform
        for _ in range(2):
            (detection,) = radar.measure({TRUTH})
            error = np.ravel(detection.state_vector - TRUTH.state_vector)
            factor = np.linalg.cholesky(np.array(detection.measurement_model.covar(), float))
            drawn.append(np.linalg.solve(factor, error))
    np.testing.assert_allclose(drawn[0], drawn[2], rtol=1e-6)
    np.testing.assert_allclose(drawn[1], drawn[3], rtol=1e-6)
    assert abs(drawn[0] - drawn[1]).min() > 1e-3


@pytest.mark.slow
def test_errors_have_the_covariance_of_the_detection():
    radar = radar_of()
    radar.waveform = 12
    found = [next(iter(radar.measure({TRUTH}))) for _ in range(4000)]
    errors = np.array([np.ravel(each.state_vector - TRUTH.state_vector) for each in found])
    R = np.array(found[0].measurement_model.covar(), float)
    sigma = np.sqrt(np.diagonal(R))
    np.testing.assert_allclose(np.cov(errors.T) / np.outer(sigma, sigma), R / np.outer(sigma, sigma), atol=0.08)


def test_targets_are_detected_with_the_probability_of_the_law():
    pulses = Pulses(gaussian_chirp_library((1e-4,), (0.0,)), 10.4e9)
    law = PlanarRadar(reference_range=20e3, false_alarm=0.01)
    radar = WaveformRadar(pulses, **PLANAR | {"law": law}, seed=3)
    far = GroundTruthState(StateVector([20e3, 0.0, 0.0, 0.0]), timestamp=NEXT)  # eta = 1
    detected = np.mean([len(radar.measure({far})) for _ in range(2000)])
    assert detected == pytest.approx(0.01 ** (1.0 / 1.5), abs=0.02)  # Pd = Pf^(1 / (1 + eta / 2))
    (detection,) = radar.measure({far}, noise=False)
    np.testing.assert_array_equal(np.ravel(detection.state_vector), [20e3, 0.0])
    (detection,) = radar.measure({far}, noise=np.array([7.0, 0.5]))
    np.testing.assert_array_equal(np.ravel(detection.state_vector), [20e3 + 7.0, 0.5])


def expected_of(snr_law, eta, alarm):
    """Effective eta and Pd of the laws of AgileClutter."""
    if snr_law == "printed":
        return eta, alarm ** (1.0 / (1.0 + eta))
    inverse = mean_inverse_detected_snr(eta, alarm, searched=2, least=1.0)
    return 1.0 / inverse, detection_probability(eta, alarm, searched=2)


@pytest.mark.parametrize("snr_law", ["realised", "printed"])
def test_agile_clutter_has_a_radar_at_each_place(snr_law):
    system = AgileClutter(snr_law=snr_law)
    radars = radars_of(system)
    np.testing.assert_array_equal([np.ravel(radar.position) for radar in radars], system.sensors)
    state = GroundTruthState(StateVector([2e3, -1e3, -100.0, 800.0]), timestamp=NEXT)
    for radar, (x, y) in zip(radars, system.sensors, strict=True):
        eta = (50e3 / np.hypot(2e3 - x, -1e3 - y)) ** 4
        effective, pd = expected_of(snr_law, eta, system.false_alarm)
        relative, absolute = (1e-4, 5e-5) if snr_law == "realised" else (1e-12, 1e-12)  # the accuracy of ``echo_law``
        assert radar.snr(state) == pytest.approx(effective, rel=relative)
        assert radar._detection(state) == pytest.approx(pd, abs=absolute)


@pytest.mark.parametrize("value", [-1, 56, 2.5, "lfm"])
def test_a_waveform_outside_the_library_is_refused(value):
    with pytest.raises(InputError, match=r"waveform is .*, expected the index of a waveform, 0 to 55") as caught:
        radar_of().waveform = value
    assert "\n" not in str(caught.value)


def test_what_does_not_fit_is_refused():
    pulses = Pulses(SYSTEM.actions, 10.4e9)
    with pytest.raises(InputError, match=r"mapping is \(0, 2\), expected indices below ndim_state=2"):
        WaveformRadar(pulses, mapping=(0, 2))
    with pytest.raises(InputError, match="position has 3 elements, expected 2"):
        _ = WaveformRadar(pulses, **PLANAR, position=StateVector([0.0, 0.0, 0.0])).offset
    with pytest.raises(InputError, match=r"system has several thresholds, expected one \(nearest: false_alarms=\(\)"):
        radars_of(AgileClutter(false_alarms=(0.01, 0.1)))
    for system in (KershawEvans(action="box"), EnergyBudget()):
        with pytest.raises(InputError, match=f"system is {type(system).__name__}"):
            radars_of(system)
