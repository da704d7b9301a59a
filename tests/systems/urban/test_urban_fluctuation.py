"""One model of detection: receivers of signals detect as the tracker and the measurement level assume."""

from __future__ import annotations

import math

import numpy as np
import oracles
import pytest
from scipy import stats

from wavegym.core.system import State
from wavegym.sensors import detection_probability
from wavegym.systems.urban.kernels import snr_of_peak
from wavegym.systems.urban.system import Urban, UrbanSignal

PLAIN = "roads = [{centre = [[1900, 1505], [2200, 1505]], width = 30}]"
SCAN = 30
NEAR = 6.0  # m and resolution cells of range-rate: farther peaks are no detection of the target


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """The file of a map with neither walls nor trees."""
    file = tmp_path_factory.mktemp("city") / "plain.toml"
    file.write_text(PLAIN)
    return str(file)


def detected(system, count):
    """Share of scans with a return of the one target at each receiver, (pair,)."""
    worlds = oracles.worlds(system, count)
    state = system.initial(worlds)
    targets = np.repeat(system.scene.truth[SCAN - 1][None], count, axis=0)
    state = State(state.truth._replace(targets=targets), state.belief._replace(step=np.full(count, SCAN - 1)))
    truth = system.transition(state, np.zeros(count, int), worlds).truth
    own = system.scene.z[:, SCAN, 0, 0]  # (pair, 2)
    off = np.abs(truth.z[..., :2] - own[:, None])
    valid = np.arange(truth.z.shape[2]) < truth.number[..., None]
    near = (off[..., 0] < NEAR) & (off[..., 1] < 1.0 + 3.0 * system.rate_floor) & valid
    return near.any(axis=2).mean(axis=0)


def at_snr(snr, **settings):
    """Settings in which the target has a mean eta of ``snr``, and eta at each receiver, (pair,)."""
    place = Urban(**settings).scene.z[:, SCAN, 0, 0, 0]
    reference = snr * (place.mean() / 100.0) ** 4
    return {**settings, "reference_snr": reference}, reference * (100.0 / place) ** 4


@pytest.mark.slow
@pytest.mark.parametrize("fluctuation", ["swerling0", "swerling1"])
def test_the_law_of_a_known_cell_is_refuted(plain, fluctuation):
    """2000 scans of signals: four standard errors, plus 0.02 for cells, include the image's law, not the cell's."""
    count = 2000
    settings = {"city": plain, "arrivals": (0.0,), "fluctuation": fluctuation, "truth": {"sigma": 0.0}}
    common, eta = at_snr(20.0, **settings)
    signal = UrbanSignal(**common)
    false_alarm = math.exp(-signal.signals.thresholds[0])
    image, cell = (detection_probability(eta, false_alarm, fluctuation, searched=d).mean() for d in (3, 0))
    bound = 4.0 * math.sqrt(image * (1.0 - image) / (2 * count)) + 0.02
    found = detected(signal, count).mean()
    assert abs(found - image) < bound < abs(found - cell)


@pytest.mark.parametrize("fluctuation", ["swerling0", "swerling1", "swerling3"])
@pytest.mark.parametrize("snr", [10.0, 20.0])
def test_signals_and_measurements_are_detected_alike(plain, fluctuation, snr):
    """At a mean eta of 10 and 20: both levels within four standard errors of the one law, plus 0.02 for cells."""
    count = 400
    settings = {"city": plain, "arrivals": (0.0,), "fluctuation": fluctuation, "truth": {"sigma": 0.0}}
    common, eta = at_snr(snr, **settings)
    signal = UrbanSignal(**common)
    drawn = Urban(**common, pulses=25, searched=3, false_alarm=math.exp(-signal.signals.thresholds[0]))
    law = detection_probability(eta, math.exp(-signal.signals.thresholds[0]), fluctuation, searched=3)
    for system, rest in ((signal, 0.02), (drawn, 0.002)):
        spread = np.sqrt(law * (1.0 - law) / count)
        assert (np.abs(detected(system, count) - law) < 4.0 * spread + rest).all()


def test_both_trackers_assume_the_law_of_the_receivers():
    for fluctuation in ("swerling0", "swerling1"):
        signal = UrbanSignal(fluctuation=fluctuation)
        drawn = Urban(pulses=25, fluctuation=fluctuation, searched=3, false_alarm=signal.urban_tracker.false_alarm)
        tables = [system.urban_tracker.constants.echo.detection for system in (signal, drawn)]
        np.testing.assert_array_equal(*tables)
        np.testing.assert_array_equal(tables[0], drawn._sensor_law.echo.detection)
        assert len(tables[0])


def test_the_world_may_fluctuate_as_the_tracker_does_not_assume():
    system = Urban(truth={"fluctuation": "swerling0"})
    assert system.urban_tracker.constants.echo.shape == 1
    assert system.truth_model._sensor_law.echo.shape == 0


def drawn_echoes(name, snr, searched, count=1_000_000):
    """SNR of the echoes that a simulated receiver detects, at least 1."""
    rng = np.random.default_rng(11)
    found, own = oracles.simulated_echoes(name, 1, snr, 1e-3, count, rng, searched)
    return np.maximum(own[found], 1.0)


def first_returns(system, count):
    """Errors (detected, 3) of the first receiver about a target without clutter, their R, and where it is detected."""
    worlds = oracles.worlds(system, count)
    state = system.initial(worlds)
    targets = np.repeat(system.scene.truth[SCAN - 1][None], count, axis=0)
    step, action = np.full(count, SCAN - 1), np.zeros(count, int)
    truth, belief = state.truth._replace(targets=targets), state.belief._replace(step=step)
    found = system.measure(system.move(truth, step, worlds), belief, action, worlds)
    direction = system.pairs[0].directions(system.scene.truth[SCAN, 0, :2])[0]
    seen = found.number[:, 0] == 1
    off = found.z[seen, 0, 0] - [*system.scene.z[0, SCAN, 0, 0], direction]
    off[:, 2] -= 2.0 * np.rint(0.5 * off[:, 2])  # an array of half a wavelength folds the cosine
    return off, found.R[seen, 0, 0], seen


@pytest.mark.slow
@pytest.mark.parametrize("searched", [0, 3])
@pytest.mark.parametrize("snr", [5.0, 20.0, 200.0])
@pytest.mark.parametrize("name", ["swerling1", "swerling3"])
def test_errors_have_the_snr_that_a_simulated_receiver_detects(plain, name, snr, searched):
    """15000 scans against a mixture of echoes that an independent receiver with amplitudes, noise and threshold keeps.

    In worlds of the same key the errors at the mean differ by the root of the SNR alone, which shows it echo by echo.
    """
    settings = {"city": plain, "arrivals": (0.0,), "truth": {"sigma": 0.0}, "clutter_density": 1e-12}
    settings |= {"fluctuation": name, "searched": searched, "rate_floor": 1e-9, "false_alarm": 1e-3, "pulses": 25}
    common, eta = at_snr(snr, **settings)
    own = drawn_echoes(name, eta[0], searched)
    at_mean, R, seen = first_returns(Urban(**common, error_snr="mean"), 15_000)
    off, wider, same = first_returns(Urban(**common, error_snr="realised"), 15_000)
    np.testing.assert_array_equal(seen, same)
    realised = eta[0] * (at_mean / off) ** 2  # of each quantity
    np.testing.assert_allclose(realised[:, 1], realised[:, 0], rtol=1e-4)
    unfolded = realised[:, 0] > 20.0
    np.testing.assert_allclose(realised[unfolded, 2], realised[unfolded, 0], rtol=1e-4)
    assert stats.ks_2samp(realised[:, 0], own[:100_000]).pvalue > 1e-3
    mixed = np.random.default_rng(12).standard_normal(len(own)) * np.sqrt(eta[0] / own)
    wanted = np.mean(mixed**2)
    normalised = off[:, :2] / np.sqrt(np.diagonal(R.mean(axis=0))[:2])
    assert stats.ks_2samp(normalised[:, 0], mixed[:100_000]).pvalue > 1e-3
    bound = 4.5 * np.std(mixed**2) * np.sqrt(1.0 / len(off) + 1.0 / len(mixed)) + 0.01 * wanted
    np.testing.assert_allclose((normalised**2).mean(axis=0), wanted, atol=bound)
    np.testing.assert_allclose(np.diagonal(wider.mean(axis=0)) / np.diagonal(R.mean(axis=0)), wanted, atol=bound)


def played(system, scans, count=3):
    """The state after ``scans`` scans of the first pulse."""
    worlds = oracles.worlds(system, count)
    state = system.initial(worlds)
    for _ in range(scans):
        state = system.transition(state, np.zeros(count, int), worlds)
    return state


def assert_alike(one, other):
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_steady_echo_has_the_mean_snr():
    mean, realised = (Urban(fluctuation="swerling0", error_snr=name) for name in ("mean", "realised"))
    for one, other in zip(played(mean, 60), played(realised, 60), strict=True):
        assert_alike(one, other)
    belief = played(mean, 60).belief
    assert belief.status.any()
    assert_alike(mean.predict(belief, np.arange(4)[None]), realised.predict(belief, np.arange(4)[None]))


@pytest.mark.slow
def test_the_world_may_have_errors_that_the_tracker_does_not_assume():
    """``truth`` changes the world alone: what the tracker predicts from a belief stays."""
    mean, both = Urban(error_snr="mean"), Urban()
    world = Urban(error_snr="mean", truth={"error_snr": "realised"})
    assert_alike(played(world, 60).truth, played(both, 60).truth)
    assert (played(world, 60).truth.z != played(mean, 60).truth.z).any()
    belief = played(mean, 60).belief
    predicted = [system.predict(belief, np.arange(4)[None]) for system in (mean, world, both)]
    assert_alike(*predicted[:2])
    assert (predicted[0].P != predicted[2].P).any()


def test_signals_have_errors_of_their_own():
    """The choice leaves the measurements of signals, and changes what the tracker expects."""
    mean, realised = (UrbanSignal(error_snr=name) for name in ("mean", "realised"))
    world = UrbanSignal(error_snr="mean", truth={"error_snr": "realised"})
    state = played(mean, 3, count=1)
    assert state.truth.number.any()
    for other in (realised, world):
        assert_alike(state.truth, played(other, 3, count=1).truth)
    assert_alike(state.belief, played(world, 3, count=1).belief)
    belief = played(Urban(), 60).belief
    predicted = [system.predict(belief, np.arange(4)[None]).P for system in (mean, world, realised)]
    np.testing.assert_array_equal(predicted[0], predicted[1])
    assert (predicted[0] != predicted[2]).any()


@pytest.mark.parametrize("mean", [12.0, 40.0, 400.0])
def test_a_peak_has_the_snr_of_the_errors_behind_it(mean):
    """Simulated Rayleigh echoes in noise, searched over three quantities: the mean of 1 / S of those with a peak.

    Peaks between two powers, from a threshold of 8 to 20: within 12 %, because the law is the first term of a series.
    """
    rng, count = np.random.default_rng(5), 2_000_000
    S = 0.5 * mean * rng.exponential(size=count)
    noise = rng.standard_normal((2, count)) / math.sqrt(2.0)
    power = (np.sqrt(S) + noise[0]) ** 2 + noise[1] ** 2 + 0.5 * rng.chisquare(3, count)
    for low, high in ((10.0, 11.0), (13.0, 14.0), (19.0, 20.0)):
        peak = (power > low) & (power < high)
        wanted = np.mean(1.0 / np.maximum(2.0 * S[peak], 1.0))
        given = np.mean([1.0 / snr_of_peak(2.0 * (y - 1.0), mean) for y in power[peak][:2000]])
        error = np.std(1.0 / np.maximum(2.0 * S[peak], 1.0)) / math.sqrt(peak.sum())
        assert abs(given / wanted - 1.0) < 0.12 + 4.0 * error / wanted
