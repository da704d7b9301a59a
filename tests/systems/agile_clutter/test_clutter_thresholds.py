"""Returns of the world by the law of a realised echo, false returns of noise, and thresholds as actions."""

from __future__ import annotations

from functools import cached_property

import agile_clutter_oracle as plain
import numpy as np
import oracles
import pytest

from wavegym.core import shortcuts
from wavegym.core.errors import InputError
from wavegym.sensors import detection_probability, mean_inverse_detected_snr
from wavegym.systems.agile_clutter import AgileClutter

ALARMS = (1e-5, 1e-3, 0.1)
ONE = {"sensors": ((3e3, -16e3),), "starts": ((2e3, -1e3, 0.0, 0.0),), "births": (0,), "horizon": 25}
SHORT, LONG = 0, -2  # 10 us of 1 MHz, 100 us of 15 MHz


class Silent(AgileClutter):
    """Noise has no false returns."""

    @cached_property
    def _radar(self):
        radar = super()._radar
        return radar._replace(noise=np.zeros_like(radar.noise))


def first_scan(system, count, action):
    """The returns of the first step of ``count`` worlds, and the true state."""
    worlds = oracles.worlds(system, count)
    state = system.initial(worlds)
    truth = system.move(state.truth, state.belief.step, worlds)
    return system.measure(truth, state.belief, np.broadcast_to(action, (count, len(action))), worlds), truth.targets


@pytest.mark.slow
@pytest.mark.parametrize("eta", [4.0, 30.0, 300.0])
@pytest.mark.parametrize("fluctuation", ["swerling1", "swerling3"])
def test_a_return_has_the_detection_probability_and_the_errors_of_its_law(eta, fluctuation):
    """A target that stands still and is known, in gates that hold all errors: 20 000 looks, to five standard errors."""
    system = Silent(
        **ONE, q=0.0, prior_variance=(1e-4,) * 4, clutter_density=0.0, gate=30.0, laws=("pfm:3",),
        reference_range=np.hypot(1e3, 15e3) * eta**0.25, fluctuation=fluctuation,
    )  # fmt: skip
    count, site = 20_000, np.array(ONE["sensors"][0])
    scan, _ = first_scan(system, count, (LONG,))
    law = eta, system.false_alarm, fluctuation
    pd, seen = detection_probability(*law, searched=2), scan.present[:, 0].sum(axis=1)
    np.testing.assert_array_equal(scan.scan[:, 0], seen)
    assert abs(seen.mean() - pd) < 5 * np.sqrt(pd * (1 - pd) / count)
    C = plain.unit_covariance("pfm", 3.0, 100e-6, 15e6)
    error = scan.z[:, 0][scan.present[:, 0]] - plain.measure(np.array(ONE["starts"][0]), site)
    white = np.linalg.solve(np.linalg.cholesky(C), error.T)
    products = white[:, None] * white[None]
    got, spread = products.mean(axis=2), 5 * products.std(axis=2) / np.sqrt(seen.sum())
    want = mean_inverse_detected_snr(*law, searched=2, least=1) * np.eye(2)
    assert (np.abs(got - want) < spread).all()


@pytest.mark.slow
@pytest.mark.parametrize("action", [SHORT, LONG])
@pytest.mark.parametrize("alarm", [1e-3, 0.1])
def test_noise_has_its_number_of_peaks_in_every_area(action, alarm):
    """No clutter: Poisson with (2 T - 1) exp(-T) / (2 pi sqrt(det C)) per area of windows, and of gates."""
    system, count, T = AgileClutter(**ONE, clutter_density=0.0, false_alarm=alarm), 4000, np.log(1 / alarm)
    scan, _ = first_scan(system, count, (action,))
    kind, duration, sweep = ("efm", 100e-6, 15e6) if action == LONG else ("lfm", 10e-6, 1e6)
    C = plain.unit_covariance(kind, 0.5, duration, sweep)
    F, Q = plain.transition(system)
    P, area = F @ np.diag(system.prior_variance) @ F.T + Q, 0.0
    for mean in system.initial(oracles.worlds(system, count)).belief.mean[:, 0]:
        z, S, _ = plain.unscented(F @ mean, P, np.array(system.sensors[0]))
        area += np.pi * system.gate**2 * np.sqrt(np.linalg.det(S + plain.seen(system, C, z[0])[0]))
    expected = (2 * T - 1) * np.exp(-T) / (2 * np.pi * np.sqrt(np.linalg.det(C))) * area
    false = scan.present.sum() - scan.scan[:, 0].sum()  # all detections lie in windows of twelve standard deviations
    assert abs(scan.scan[:, 1].sum() - expected) < 5 * np.sqrt(expected)
    assert abs(false - 9 * expected) < 5 * np.sqrt(9 * expected)
    assert expected > 25


def test_thresholds_are_choices_beside_the_waveforms():
    system = AgileClutter(false_alarms=ALARMS)
    plainly = AgileClutter()
    labels = [f"{label}, Pf {alarm:g}" for label in plainly.actions.library.labels for alarm in ALARMS]
    assert list(system.actions.library.labels) == labels
    assert len(system.candidates()) == (3 * 72) ** 2
    joint = AgileClutter(false_alarms=ALARMS, action="joint")
    assert len(joint.actions) == (3 * 8) ** 2
    assert joint.actions.labels[25] == "LFM up 100 us 15 MHz, Pf 0.001 | LFM up 100 us 15 MHz, Pf 0.001"
    alarms, rows = joint.action_set.thresholds
    np.testing.assert_array_equal(alarms[rows], np.tile(ALARMS, 8))
    chosen = alarms[joint.action_set.alarms(np.arange(24 * 24))]
    np.testing.assert_array_equal(chosen, np.array([[a, b] for a in np.tile(ALARMS, 8) for b in np.tile(ALARMS, 8)]))


@pytest.mark.parametrize("action", ["library", "joint"])
def test_a_constant_has_one_threshold_and_one_chirp_for_all(action):
    system = AgileClutter(false_alarms=ALARMS, action=action)
    pulses, fixed = system.action_set, shortcuts.constants(system)
    alarms, C = pulses.alarms(fixed), pulses.unit_covariance(fixed)
    np.testing.assert_array_equal(alarms[:, 0], alarms[:, 1])
    np.testing.assert_allclose(C[:, 0, 0, 0], C[:, 1, 0, 0], rtol=1e-12)
    assert len(np.unique(fixed, axis=0)) == len(fixed) == 2 * len(pulses.sensor_library)


def test_a_fixed_choice_of_a_threshold_is_that_false_alarm():
    """A step of several thresholds, all with the same row, is that of the system with this threshold, bit for bit."""
    several = AgileClutter(false_alarms=ALARMS)
    worlds, waveforms = oracles.worlds(several, 5), np.random.default_rng(0).integers(72, size=(5, 2))
    for row, alarm in enumerate(ALARMS):
        one = AgileClutter(false_alarm=alarm)
        got = several.transition(several.initial(worlds), 3 * waveforms + row, worlds)
        want = one.transition(one.initial(worlds), waveforms, worlds)
        np.testing.assert_array_equal(got.belief.covariance, want.belief.covariance)
        np.testing.assert_array_equal(got.truth.scan, want.truth.scan)


def costs(settings, alarm, belief, e, chirps):
    """Predicted trace of the plain loop after each chirp at one threshold."""
    system = AgileClutter(**ONE, false_alarm=alarm, **settings)
    found = [
        plain.predicted_after(system, belief.step[e], belief.mean[e], belief.covariance[e], [plain.unit_covariance(*c)])
        for c in chirps
    ]
    return np.array([np.trace(P[0]) for _, P in found])


@pytest.mark.slow
def test_the_chosen_threshold_has_the_least_predicted_cost_and_follows_the_noise():
    """Against the plain loop. In heavy noise (eta of 5 in place of 1200) the threshold falls, to detect the target."""
    chirps = [(law, shape, 100e-6, sign * 15e6) for law, shape in (("pfm", 3.0), ("hfm", 0.5)) for sign in (1, -1)]
    sent = {"laws": ("pfm:3", "hfm:0.5"), "durations": (100e-6,), "sweeps": (15e6,)}
    worlds, chosen = oracles.worlds(AgileClutter(**ONE), 6), []
    for reference in (25e3, 100e3):
        settings = sent | {"reference_range": reference}
        system = AgileClutter(**ONE, false_alarms=ALARMS, **settings)
        belief = system.initial(worlds).belief
        best = shortcuts.best_action(system, belief)[:, 0]
        for e in range(6):
            tried = np.array([costs(settings, alarm, belief, e, chirps) for alarm in ALARMS]).T.ravel()
            assert tried[best[e]] <= tried.min() * (1 + 1e-4)
        chosen.append(best % len(ALARMS))
    assert (chosen[0] > chosen[1]).all()


def test_a_density_of_alarms_is_that_of_every_waveform():
    """Each waveform has its threshold T: (2 T - 1) exp(-T) / (2 pi sqrt(det C)) is the density."""
    density = 3e-7
    system = AgileClutter(alarm_density=density)
    alarms, rows = system.action_set.thresholds
    T = -np.log(alarms[rows])
    cell = 2 * np.pi * np.sqrt(np.linalg.det(system.action_set.sensor_covariances))
    np.testing.assert_allclose((2 * T - 1) * np.exp(-T) / cell, density, rtol=1e-9)
    assert T.max() > T.min() + 2
    np.testing.assert_array_equal(system.action_set.alarms(np.arange(144).reshape(72, 2) % 72)[0], rows[:2])
    joint = AgileClutter(alarm_density=density, action="joint").action_set
    np.testing.assert_array_equal(joint.alarms(np.array([9]))[0], joint.thresholds[1][[1, 1]])


@pytest.mark.slow
def test_false_returns_of_noise_have_that_density_with_every_waveform():
    """Points in the gates of a target whose place is so uncertain that the pulse hardly changes them."""
    wide = ONE | {"prior_variance": (1e6, 1e6, 1e4, 1e4), "clutter_density": 0.0}
    system, expected, counts = AgileClutter(**wide, alarm_density=3e-7), [], []
    belief = system.initial(oracles.worlds(system, 2000)).belief
    F, Q = plain.transition(system)
    for action in (SHORT, LONG):
        scan, _ = first_scan(system, 2000, (action,))
        counts.append(scan.scan[:, 1].sum())
        C, P, area = system.action_set.sensor_covariances[action], F @ belief.covariance[0, 0] @ F.T + Q, 0.0
        alarms, rows = system.action_set.thresholds
        own = AgileClutter(**wide, false_alarm=alarms[rows[action]])
        for mean in belief.mean[:, 0]:
            z, S, _ = plain.unscented(F @ mean, P, np.array(system.sensors[0]))
            area += np.pi * 16 * np.sqrt(np.linalg.det(S + plain.seen(own, C, z[0])[0]))
        expected.append(3e-7 * area)
    for count, wanted in zip(counts, expected, strict=True):
        assert abs(count - wanted) < 5 * np.sqrt(wanted)
        assert wanted > 50


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"false_alarm": 0.3}, r"false alarm probability is 0.3, expected at most 0.223 \(nearest\)"),
        ({"false_alarms": (0.01, 0.3)}, r"false alarm probability is 0.3, expected at most 0.223 \(nearest\)"),
        ({"false_alarms": (0.1, 0.01), "action": "box"}, "false_alarms is given with action='box', expected"),
        ({"alarm_density": 1e-7, "action": "box"}, "alarm_density is given with action='box', expected"),
        ({"alarm_density": 1e-7, "false_alarms": (0.1, 0.2)}, "are given, expected one of the two"),
        ({"false_alarm": 0.1, "false_alarms": (0.1, 0.2)}, "false_alarm is 0.1 with false_alarms=, expected one of"),
        ({"snr_law": "printed", "false_alarms": (0.1, 0.2)}, "with snr_law='printed', expected snr_law='realised'"),
        ({"snr_law": "printed", "fluctuation": "swerling0"}, "with snr_law='printed', expected 'swerling1'"),
        ({"false_alarms": (0.1, 0.1)}, r"false_alarms is \(0.1, 0.1\), expected each probability once"),
        ({"alarm_density": 1.0}, r"alarm_density is 1 s/m\^2, expected at most 3.6\d*e-07"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(settings, message):
    with pytest.raises((InputError, ValueError), match=message):
        AgileClutter(**settings)
