"""The measurement model in Stone Soup is wavegym's law: against plain formulas, and wavegym's own functions."""

from __future__ import annotations

import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stonesoup.models.base import Model
from stonesoup.types.array import StateVector, StateVectors
from stonesoup.types.state import State

from wavegym.core.errors import InputError
from wavegym.integrations.stonesoup import WaveformRadar, radars_of
from wavegym.sensors import mean_inverse_detected_snr, range_law_snr
from wavegym.systems.composed import PlanarRadar, Pulses
from wavegym.systems.kershaw_evans import KershawEvans
from wavegym.waveforms import gaussian_chirp_library

SYSTEM = KershawEvans()
DURATIONS, SWEEPS = (20e-6, 200e-6), (0.0, 1e6, -1e6)
LIBRARY = gaussian_chirp_library(DURATIONS, SWEEPS)


def planar(**placing):
    """A radar for vectors [x xdot y ydot]."""
    law = PlanarRadar((0.0, 0.0), reference_range=40e3, false_alarm=0.01)
    return WaveformRadar(Pulses(LIBRARY, 10.4e9), law=law, ndim_state=4, mapping=(0, 2, 1, 3), **placing)


@given(r=st.floats(50.0, 200e3), rate=st.floats(-500.0, 500.0), waveform=st.integers(0, len(LIBRARY) - 1))
@settings(max_examples=60, deadline=None)
def test_the_covariance_is_the_law_of_kershaw_and_evans(r, rate, waveform):
    system = KershawEvans(durations=DURATIONS, sweeps=SWEEPS, reference_range=50e3, eclipsing=False)
    (radar,) = radars_of(system)
    radar.waveform = waveform
    state = State(StateVector([r, rate]))
    eta = (50e3 / max(r, 100.0)) ** 4
    k, sweep = [(k, s) for k in DURATIONS for s in SWEEPS][waveform]
    R = np.array(radar.model_at(state).covar(), float)
    np.testing.assert_allclose(R, oracles.chirp_covariance(k, sweep) / eta, rtol=1e-12)
    own = system.unit_covariance(np.array(waveform)) / range_law_snr(r, *system._snr_law)
    np.testing.assert_allclose(R, own, rtol=1e-12)
    assert radar.snr(state) == pytest.approx(eta, rel=1e-12)


def test_every_waveform_of_the_environment_measures_as_in_wavegym():
    """Against ``measure`` of the system: the covariance that it reports at the true range."""
    (radar,) = radars_of(SYSTEM)
    count = len(SYSTEM.actions)
    world = oracles.worlds(SYSTEM, count)
    state = SYSTEM.initial(world)
    truth = SYSTEM.move(state.truth, state.belief.step, world)
    found = SYSTEM.measure(truth, state.belief, np.arange(count), world)
    for i in range(count):
        radar.waveform = i
        at = State(StateVector(truth.targets[i]))
        np.testing.assert_allclose(np.array(radar.model_at(at).covar(), float), found.R[i], rtol=1e-12)
        normal = world.normal[i, 1, -2:]
        z = truth.targets[i] + np.linalg.cholesky(found.R[i]) @ normal
        np.testing.assert_allclose(z, found.z[i], rtol=1e-10)


def test_pulses_of_ones_own_are_whole():
    eclipsed = KershawEvans(library=LIBRARY)
    with pytest.raises(InputError, match=r"library is given with eclipsing, .* \(nearest: eclipsing=False\)"):
        radars_of(eclipsed)
    assert len(radars_of(KershawEvans(library=LIBRARY, eclipsing=False))) == 1


def test_range_and_rate_in_the_plane_are_seen_from_the_radar():
    radar = planar(position=StateVector([3e3, -16e3]))
    x, xdot, y, ydot = vector = np.array([2e3, -100.0, 1e3, 250.0])
    state = State(StateVector(vector))
    model = radar.model_at(state)
    dx, dy = x - 3e3, y + 16e3
    r = np.hypot(dx, dy)
    np.testing.assert_allclose(np.ravel(model.function(state)), [r, (dx * xdot + dy * ydot) / r], rtol=1e-12)
    np.testing.assert_allclose(model.jacobian(state), Model.jacobian(model, state), rtol=1e-4, atol=1e-6)
    effective = 1.0 / mean_inverse_detected_snr((40e3 / r) ** 4, 0.01, least=1.0)
    assert radar.snr(state) == pytest.approx(effective, rel=1e-4)


def test_a_radar_that_moves_with_the_target_measures_no_range_rate():
    from datetime import datetime

    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
    from stonesoup.platform import MovingPlatform

    radar = planar()
    start = State(StateVector([0.0, -100.0, 0.0, 250.0]), timestamp=datetime(2000, 1, 1))
    motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(0.0), ConstantVelocity(0.0)])
    MovingPlatform(states=start, position_mapping=(0, 2), transition_model=motion, sensors=[radar])
    state = State(StateVector([2e3, -100.0, 1e3, 250.0]))
    np.testing.assert_allclose(np.ravel(radar.model_at(state).function(state)), [np.hypot(2e3, 1e3), 0.0], atol=1e-9)


def test_several_vectors_are_measured_as_each_alone():
    model = planar().measurement_model
    vectors = np.random.default_rng(0).normal([2e3, -100.0, 1e3, 250.0], 10.0, (9, 4)).T
    together = model.function(State(StateVectors(vectors)))
    assert isinstance(together, StateVectors)
    for column, vector in zip(np.array(together, float).T, vectors.T, strict=True):
        np.testing.assert_array_equal(column, np.ravel(model.function(State(StateVector(vector)))))
    assert not np.array_equal(model.function(State(StateVectors(vectors)), noise=True), together)
