"""The urban loop at the signal level: errors of its measurements, and tracking as at the measurement level."""

from __future__ import annotations

import math
import operator

import numpy as np
import oracles
import pytest

from wavegym.core.system import State
from wavegym.schedulers.registry import make_policy
from wavegym.sensors import multistatic_range_and_rate
from wavegym.systems.urban.system import Urban, UrbanSignal
from wavegym.waveforms import SPEED_OF_LIGHT, measurement_covariances

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
    """200 trains per receiver: no bias, deviations within four standard errors (20 %) of sqrt(R(psi) / eta).

    The range-rate has its spread of 0.1 m/s in addition.
    """
    count, scan = 200, 30
    truth = scanned(plain, scan, count, waveform)
    for m, place in enumerate(plain.receivers):
        target = plain.scene.truth[scan, 0, :4]
        range_and_rate = multistatic_range_and_rate(target, plain.transmitters[0], place)
        exact = np.append(range_and_rate, plain.pairs[m].directions(target[:2])[0])
        eta = 200.0 * plain.durations[waveform // 2] / plain.durations[0] * (100.0 / exact[0]) ** 4
        variances = np.diag(measurement_covariances(plain.actions, 4e9)[waveform])
        sigma = np.sqrt(np.append(variances, 12.0 / (math.pi**2 * (3**2 - 1))) / eta + [0.0, 0.01, 0.0])
        off = truth.z[:, m, 0] - exact  # strongest first
        off[:, 2] -= 2.0 * np.rint(off[:, 2] / 2.0)  # a direction cosine is measured modulo 2
        errors = off / sigma
        assert (np.abs(errors.mean(axis=0)) < 4.0 / math.sqrt(count)).all()
        np.testing.assert_allclose(errors.std(axis=0), 1.0, atol=0.2)


def test_without_targets_there_are_no_more_returns_than_from_noise():
    """The rest has density clutter_density."""
    empty, count = UrbanSignal(arrivals=(1000.0,)), 25
    number = scanned(empty, 1, count, LONG_UP).number
    expected = number.size * empty.clutter_density * empty.reach * 2.0 * empty.ambiguity
    assert abs(number.sum() / expected - 1.0) < 0.15 + 4.0 / math.sqrt(expected)  # the theory is accurate to 15 %


def test_a_recording_takes_the_echoes_of_walls_and_trees_away():
    """With and without static echoes, 20 dB above a target, in the scan and in the recording: equal to rounding.

    Without the recording they are returns at range-rate 0.
    """
    signals, pair = SYSTEM.signals, SYSTEM.pairs[0]
    array, echoes = signals.arrays[LONG_UP], pair.background()
    near = echoes.r <= array.reach
    place, axis = np.array(pair.receiver.position), np.array(pair.receiver.axis)
    longer = np.linalg.norm(echoes.source[:, None] - place - array.offsets[:, None] * axis, axis=2)
    longer -= np.linalg.norm(echoes.source - place, axis=1)[:, None]
    delays = np.repeat((2.0 * echoes.r[:, None] + longer)[near, None] / SPEED_OF_LIGHT, 25, axis=1)
    eta = 100.0 * signals.snr[LONG_UP] * echoes.reflected[near] * (100.0 / echoes.r[near]) ** 4
    static = array.receive(delays, np.sqrt(0.5 * eta))
    plain = signals.outputs(np.uint64(1), 3, SYSTEM.scene.truth[3], LONG_UP, 0)
    recorded = static[0] + array.noise(2)[0] / math.sqrt(30 * 25)
    subtracted = (plain + static) - static[0]
    np.testing.assert_allclose(subtracted, plain, rtol=0.0, atol=1e-12 * np.abs(static).max())
    for outputs, least, most in ((plain + static, 4, 12), (plain + static - recorded, 0, 2)):
        found = array.peaks(array.image(outputs), signals.thresholds[LONG_UP])
        still = np.abs(found.z[:, 1]) < 0.2  # of noise 0.1; of twelve echoes those within a cell of another one merge
        assert least <= still.sum() <= most


def test_noise_is_independent():
    """Noise differs between scans, receivers, worlds, and is reproducible."""
    signals, key, nobody = SYSTEM.signals, np.uint64(7), np.zeros((0, 6))
    first = signals.outputs(key, 3, nobody, LONG_UP, 0)
    np.testing.assert_array_equal(first, signals.outputs(key, 3, nobody, LONG_UP, 0))
    others = [(key, 3, 1), (key, 4, 0), (np.uint64(8), 3, 0)]
    for other_key, scan, m in others:
        a, b = (each[..., ::8].ravel() for each in (first, signals.outputs(other_key, scan, nobody, LONG_UP, m)))
        assert abs(a @ b) / np.linalg.norm(a) / np.linalg.norm(b) < 5.0 / math.sqrt(a.size)


def test_noise_of_the_recording_is_the_same_in_every_scan():
    """At range-rate 0 the mean over scans keeps the noise of the recorded mean, of variance 1 / 30 of a train's."""
    signals, nobody, count = SYSTEM.signals, np.zeros((0, 6)), 400
    at_rest = [signals.outputs(np.uint64(7), k, nobody, LONG_UP, 0).sum(axis=0) for k in range(count)]  # (3, 2, cell)
    power = 2.0 * 3.0 * np.mean(np.square(at_rest)), 2.0 * 3.0 * np.mean(np.square(np.mean(at_rest, axis=0)))
    independent = 3 * 2 * 20  # numbers in a train: a cell is like its neighbours
    assert abs(power[0] - (1.0 + 1.0 / 30.0)) < 5.0 * math.sqrt(2.0 / independent / count) + 1.0 / 30.0
    assert abs(power[1] - (1.0 / 30.0 + 1.0 / count)) < 5.0 * math.sqrt(2.0 / independent) / 30.0


@pytest.mark.slow
def test_it_is_tracked_as_well_as_at_the_measurement_level():
    """Ten episodes at each level, equal pulses and detection: mean GOSPA within four standard errors and 0.5 m."""
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


def test_systems_share_their_receivers():
    """The law of a receiver's noise takes 20 ms to compute."""
    assert all(map(operator.is_, UrbanSignal().signals.arrays, UrbanSignal(horizon=3).signals.arrays))
