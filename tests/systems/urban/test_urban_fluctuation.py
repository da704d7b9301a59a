"""One model of detection: receivers of signals detect as the tracker and the measurement level assume."""

from __future__ import annotations

import math

import numpy as np
import oracles
import pytest

from wavegym.core.errors import InputError
from wavegym.core.parameters import make_checked
from wavegym.core.system import State
from wavegym.sensors import detection_probability
from wavegym.systems.urban.signal import UrbanSignal
from wavegym.systems.urban.system import Urban

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
    """2000 scans of signals: within four standard errors, plus .02 for cells, of the image's law, not of the cell's."""
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
    """At a mean eta of 10 and 20: both levels within four standard errors of the one law, plus .02 for cells."""
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
        tables = [system.urban_tracker.constants.detection_table for system in (signal, drawn)]
        np.testing.assert_array_equal(*tables)
        np.testing.assert_array_equal(tables[0], drawn._sensor_law.detection_table)
        assert len(tables[0])


def test_the_world_may_fluctuate_as_the_tracker_does_not_assume():
    system = Urban(truth={"fluctuation": "swerling0"})
    assert len(system.urban_tracker.constants.detection_table) == 0
    assert len(system.truth_model._sensor_law.detection_table)


def test_mistakes():
    with pytest.raises(InputError, match="searched is 2, expected 3 with fidelity='signal'"):
        make_checked(UrbanSignal, {"searched": 2})
    with pytest.raises(InputError, match=r"fluctuation.*swerling5"):
        make_checked(Urban, {"fluctuation": "swerling5"})
    with pytest.raises(InputError, match="searched"):
        make_checked(Urban, {"searched": -1})
