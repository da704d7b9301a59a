"""The urban loop at the signal level: errors of its measurements, and tracking as at the measurement level."""

from __future__ import annotations

import math

import numpy as np
import oracles
import pytest

from wavegym.core.errors import InputError
from wavegym.core.parameters import make_checked
from wavegym.core.system import State
from wavegym.schedulers.registry import make_policy
from wavegym.sensors import multistatic_range_and_rate
from wavegym.systems.urban.signal import UrbanSignal
from wavegym.systems.urban.system import Urban
from wavegym.waveforms import (
    measurement_covariances,
)

SYSTEM = UrbanSignal()
LONG_UP = 0  # index of the longer pulse with the up sweep
PLAIN = "roads = [{centre = [[1900, 1505], [2200, 1505]], width = 30}]"


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Neither walls nor trees, one target, whose echo is steady."""
    file = tmp_path_factory.mktemp("city") / "plain.toml"
    file.write_text(PLAIN)
    return UrbanSignal(city=str(file), arrivals=(0.0,), truth={"sigma": 0.0}, fluctuation="swerling0")


def scanned(system, scan, count, waveform):
    """Measurements of scan number ``scan`` in ``count`` worlds."""
    worlds = oracles.worlds(system, count)
    state = system.initial(worlds)
    targets = np.repeat(system.scene.truth[scan - 1][None], count, axis=0)
    state = State(state.truth._replace(targets=targets), state.belief._replace(step=np.full(count, scan - 1)))
    return system.transition(state, np.full(count, waveform), worlds).truth


@pytest.mark.parametrize("waveform", range(4))
def test_errors_without_walls_are_those_of_the_measurement_level(plain, waveform):
    """200 trains per receiver: no bias, deviations within four standard errors (20 %) of sqrt(R(psi) / eta)."""
    count, scan = 200, 30
    truth = scanned(plain, scan, count, waveform)
    for m, place in enumerate(plain.receivers):
        target = plain.scene.truth[scan, 0, :4]
        range_and_rate = multistatic_range_and_rate(target, plain.transmitters[0], place)
        exact = np.append(range_and_rate, plain.pairs[m].directions(target[:2])[0])
        eta = 200.0 * plain.durations[waveform // 2] / plain.durations[0] * (100.0 / exact[0]) ** 4
        variances = np.diag(measurement_covariances(plain.actions, 4e9)[waveform])
        sigma = np.sqrt(np.append(variances, 12.0 / (math.pi**2 * (3**2 - 1))) / eta)
        off = truth.z[:, m, 0] - exact  # strongest first
        off[:, 2] -= 2.0 * np.rint(off[:, 2] / 2.0)  # a direction cosine is measured modulo 2
        errors = off / sigma
        assert (np.abs(errors.mean(axis=0)) < 4.0 / math.sqrt(count)).all()
        np.testing.assert_allclose(errors.std(axis=0), 1.0, atol=0.2)


def test_without_targets_there_are_no_more_returns_than_from_noise():
    """Echoes of walls and trees, 20 dB above a target, are subtracted; the rest has density clutter_density."""
    empty, count = UrbanSignal(arrivals=(1000.0,)), 25
    number = scanned(empty, 1, count, LONG_UP).number
    expected = number.size * empty.clutter_density * empty.reach * 2.0 * empty.ambiguity
    assert abs(number.sum() / expected - 1.0) < 0.15 + 4.0 / math.sqrt(expected)  # the theory is accurate to 15 %
    samples = empty.signals.samples(np.uint64(1), 1, empty.scene.truth[1], LONG_UP, 0)
    array, threshold = empty.signals.arrays[LONG_UP], empty.signals.thresholds[LONG_UP]
    still = np.abs(array.peaks(array.image(samples), threshold).z[:, 1]) < 0.2
    assert still.sum() > 3  # of twelve visible; those within a cell of a stronger one merge with it


def test_noise_is_independent():
    """Noise differs between scans, receivers and worlds, and is reproducible."""
    signals, key, targets = SYSTEM.signals, np.uint64(7), SYSTEM.scene.truth[3]
    first = signals.samples(key, 3, targets, LONG_UP, 0)
    np.testing.assert_array_equal(first, signals.samples(key, 3, targets, LONG_UP, 0))
    background = [signals.background(key, LONG_UP, m) for m in range(2)]
    another = signals.samples(key, 3, targets, LONG_UP, 1) - background[1]
    others = [signals.samples(key, 4, targets, LONG_UP, 0), signals.samples(np.uint64(8), 3, targets, LONG_UP, 0)]
    for other in (another, *(each - background[0] for each in others)):
        a, b = (first - background[0]).ravel(), other.ravel()
        assert abs(np.vdot(a, b)) / np.linalg.norm(a) / np.linalg.norm(b) < 5.0 / math.sqrt(a.size)


@pytest.mark.slow
def test_it_is_tracked_as_well_as_at_the_measurement_level():
    """Ten episodes at each level, equal pulses and detection: mean GOSPA within four standard errors and .5 m."""
    drawn = Urban(pulses=25, searched=3, false_alarm=math.exp(-SYSTEM.signals.thresholds[0]))
    worse = per_episode(SYSTEM) - per_episode(drawn)
    assert abs(worse.mean()) < 4.0 * worse.std() / math.sqrt(len(worse)) + 0.5


def per_episode(system, count=10):
    """Mean GOSPA of each episode, always with the longer pulse."""
    worlds = oracles.worlds(system, count)
    state, total = system.initial(worlds), np.zeros(count)
    policy = make_policy(f"fixed:{LONG_UP}", system, None)
    policy.begin(system, count, np.random.default_rng(0))
    for _ in range(system.horizon):
        state = system.transition(state, policy.act(state.belief, None, None), worlds)
        total += system.state_info(state)["gospa"]
    return total / system.horizon


def test_pairs_of_several_transmitters_keep_to_their_own_trains(plain):
    """Measurements of a pair do not depend on the waveform of the other transmitter."""
    system = UrbanSignal(transmitters=(plain.transmitters[0], (2060.0, 1530.0)))
    mixed, alike = (scanned(system, 60, 2, waveform).z for waveform in (2, 0))
    np.testing.assert_array_equal(mixed[:, :2], alike[:, :2])
    assert (mixed[:, 2:] != alike[:, 2:]).any()


def test_mistakes():
    with pytest.raises(InputError, match=r"false_alarm is 0\.001, expected none with fidelity='signal'"):
        make_checked(UrbanSignal, {"false_alarm": 1e-3})
