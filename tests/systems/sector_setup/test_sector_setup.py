"""Episodes of the sector set-up: dead steps, windows, consistency, starts, observation."""

from __future__ import annotations

import numpy as np
import oracles
import pytest
import sector_setup_oracle as plain
from scipy.stats import kstest

import wavegym  # noqa: F401
from wavegym.core import shortcuts
from wavegym.core.errors import InputError
from wavegym.core.parameters import make_checked
from wavegym.core.system import State
from wavegym.sensors import detection_probability
from wavegym.sensors.trains import DECAY, mean_rate_variance, motion_loss
from wavegym.systems.sector_setup.state import Measurements
from wavegym.systems.sector_setup.system import SectorSetup
from wavegym.waveforms import measurement_covariances

SYSTEM = SectorSetup()


def coasted(system, belief):
    """F P F' + Q of every target."""
    F, Q = system.motion.F, system.motion.Q
    return F @ belief.covariance @ F.T + belief.q[..., None, None] * Q


@pytest.mark.slow
@pytest.mark.parametrize("dead_steps", [3, 0])
def test_dead_steps_and_windows_hold_in_every_random_step(dead_steps):
    """Only the covariance of the illuminated target shrinks, and only if a pulse was sent and the target is visible."""
    system, rng = SectorSetup(dead_steps=dead_steps), np.random.default_rng(0)
    worlds, looks, steps = oracles.worlds(system, 500), 0, 1_000_000
    rows = np.arange(500)
    for _ in range(steps // (500 * system.horizon)):
        state, action, run = system.initial(worlds), np.full(500, -1), np.zeros(500, int)
        assert (state.belief.pointed == -1).all()
        for k in range(system.horizon):
            drawn = rng.integers(len(system.actions), size=500)
            fresh = np.where((rng.random(500) < 0.2) | (k == 0), drawn, action)
            run = np.where((fresh // 2 == action // 2) & (k > 0), run + 1, 1)  # steps in a row with this target
            action = fresh
            after = system.transition(state, action, worlds)
            silent, detections, target = after.truth.silent, after.truth.detections, action // 2
            np.testing.assert_array_equal(silent, run <= dead_steps)
            np.testing.assert_array_equal(after.belief.dead, np.maximum(dead_steps - run, 0))
            np.testing.assert_array_equal(after.belief.pointed, target)
            assert (detections[silent | ~state.belief.visible[rows, k, target]] == 0).all()
            learned = np.diagonal(coasted(system, state.belief) - after.belief.covariance, axis1=2, axis2=3)
            share = learned.sum(axis=2) / np.diagonal(after.belief.covariance, axis1=2, axis2=3).sum(axis=2)
            updated = share > 1e-9
            assert (np.abs(share) < 1e-12)[~updated].all()
            np.testing.assert_array_equal(updated[rows, target], detections > 0)
            updated[rows, target] = False
            assert not updated.any()
            looks += (detections > 0).sum()
            state = after
    assert looks > 0.1 * steps


def test_detections_are_as_frequent_as_the_signal_says():
    """Counts agree with Pd at the mean eta of the true place within five standard errors."""
    worlds, seen, expected = oracles.worlds(SYSTEM, 300), 0, []
    state = SYSTEM.initial(worlds)
    belief = state.belief._replace(pointed=np.zeros(300, np.int64))
    state = State(state.truth._replace(visible=np.ones_like(state.truth.visible)), belief)
    for _ in range(10):
        state = SYSTEM.transition(state, np.zeros(300, np.int64), worlds)
        seen += state.truth.detections.sum()
        place = state.truth.targets[:, 0, ::2]
        legs = [np.linalg.norm(place - site, axis=1) for site in (SYSTEM.illuminator, *SYSTEM.receivers)]
        eta = [20.0 * 5650.0**4 / (legs[0] * leg) ** 2 for leg in legs[1:]]
        expected += [detection_probability(each, SYSTEM.false_alarm, searched=2) for each in eta]
    pd = np.concatenate(expected)
    assert abs(seen - pd.sum()) < 5 * np.sqrt((pd * (1 - pd)).sum())


@pytest.mark.parametrize("fluctuation", ["swerling0", "swerling1", "swerling3"])
@pytest.mark.parametrize("waveform", [0, 1])
def test_errors_of_detected_echoes_have_the_covariance_that_the_tracker_assumes(waveform, fluctuation):
    """20 000 looks at one place: within five standard errors, by the scatter of the squares, and Pd.

    The normalised squared errors of receivers with Swerling-1 echoes are heavy-tailed, not chi-square.
    """
    count = 20_000
    system = SectorSetup(horizon=1, targets=1, q=(1.0, 1.0), fluctuation=fluctuation, region=((500.0,) * 2, (4e3,) * 2))
    rng, one = np.random.default_rng(3), system.initial(oracles.worlds(system, 1))
    truth = oracles.rows(one.truth, np.zeros(count, int))
    truth = truth._replace(visible=np.ones_like(truth.visible))
    belief = oracles.rows(one.belief, np.zeros(count, int))._replace(pointed=np.zeros(count, np.int64))
    worlds = oracles.rows(oracles.worlds(system, 1), np.zeros(count, int))._replace(
        key=rng.integers(2**64, size=count, dtype=np.uint64), error=rng.standard_normal((count, 1, 2, 1, 2))
    )
    got = system.measure(truth, belief, np.full(count, waveform), worlds)
    R, pd = plain.noise(system, truth.targets[0, 0], waveform, 1.0)
    for j in range(2):
        errors = (got.z[:, j] - plain.measure(system, truth.targets[0, 0])[0][j])[got.detected[:, j]]
        assert abs(len(errors) / count - pd[j]) < 5 * np.sqrt(pd[j] * (1 - pd[j]) / count)
        for a, b in ((0, 0), (0, 1), (1, 1)):
            products = errors[:, a] * errors[:, b]
            assert abs(products.mean() - R[j, a, b]) < 5 * products.std() / np.sqrt(len(errors))
        squares = (errors * np.linalg.solve(R[j], errors.T).T).sum(axis=1)
        assert abs(squares.mean() - 2) < 5 * squares.std() / np.sqrt(len(errors))


def test_scans_have_the_covariance_of_the_train():
    """A tracker of one's own gets C over the effective eta, with the variance of the mean range-rate."""
    state = SYSTEM.initial(oracles.worlds(SYSTEM, 8))
    belief, action = state.belief._replace(pointed=np.ones(8, np.int64)), np.array([2, 3] * 4)
    measurements = Measurements(np.zeros((8, 2, 2)), np.ones((8, 2), np.bool_), np.zeros(8, np.bool_))
    scans = SYSTEM._scans(belief, belief, action, measurements)
    for e, a in enumerate(action):
        R, _ = plain.noise(SYSTEM, SYSTEM.motion.F @ belief.mean[e, 1], a % 2, belief.q[e, 1])
        np.testing.assert_allclose([scan.R[e, 0] for scan in scans], R, rtol=2e-4)


def test_the_default_trains():
    """Equal energies; deviations at an eta of 20 of about 12 m and 14 m/s, and 60 m and 1 m/s; motion takes little."""
    C, timings = measurement_covariances(SYSTEM.library, SYSTEM.carrier_hz), list(SYSTEM.timings.values())
    np.testing.assert_allclose(np.sqrt(np.diagonal(C, axis1=1, axis2=2) / 20), [[12, 14.2], [59, 1.03]], rtol=0.02)
    np.testing.assert_allclose(SYSTEM._radar.energy, 1.0)
    for timing in timings:
        assert motion_loss(timing.time_on_target(0.0), timing.wavelength, SYSTEM.q[1]) > 0.99
    loss, mean_rate = SYSTEM._radar.blur, SYSTEM._radar.restless
    seconds = np.array([timing.time_on_target(0.0) for timing in timings])
    np.testing.assert_allclose((1 + 5.0 * loss) ** -DECAY, motion_loss(seconds, timings[0].wavelength, 5.0))
    np.testing.assert_allclose(5.0 * mean_rate, mean_rate_variance(seconds, 5.0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"waveforms": ((2, 1e-3, 15e-6, 1e6),)},
            r"range-rate of 2 x .* folds at 24.98.*interval 0.000832757",
        ),
        ({"waveforms": ((2, 20e-6, 1e-6, 1e6),)}, r"range of 2 x .* folds at 2997.9.*nearest: interval 3.9"),
        ({"waveforms": ((5000, 250e-6, 1e-6, 1e6),)}, r"takes 1.249.* expected at most the step, 1.0 s"),
        ({"false_alarm": 0.3}, r"false alarm probability is 0.3, expected at most 0.223 \(nearest\)"),
    ],
)
def test_trains_and_thresholds_that_do_not_fit_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        make_checked(SectorSetup, {**change, "speed": (5.0, 30.0)})


def test_starts():
    """Positions, speeds and log densities are uniform over their bounds; first errors have covariance P0."""
    state = SYSTEM.initial(oracles.worlds(SYSTEM, 500))
    truth, belief = state.truth.targets, state.belief
    speed, q = np.hypot(truth[..., 1], truth[..., 3]), np.log(belief.q)
    for values, (low, high) in (
        (truth[..., 0], SYSTEM.region[0]), (truth[..., 2], SYSTEM.region[1]), (speed, SYSTEM.speed),
        (np.arctan2(truth[..., 1], truth[..., 3]), (-np.pi, np.pi)), (q, np.log(SYSTEM.q)),
    ):  # fmt: skip
        assert kstest((values.ravel() - low) / (high - low), "uniform").pvalue > 1e-4
    error = (belief.mean - truth) / np.sqrt(SYSTEM.prior_variance)
    assert kstest(error.ravel(), "norm").pvalue > 1e-4
    np.testing.assert_array_equal(belief.covariance[3, 2], np.diag(SYSTEM.prior_variance))


def test_observation():
    """Time, set-up and spreads, counted independently; usual values lie within the bounds."""
    worlds, rng = oracles.worlds(SYSTEM, 60), np.random.default_rng(0)
    state, column = SYSTEM.initial(worlds), {e.name: i for i, e in enumerate(SYSTEM.observation_fields)}
    centre, scale = (np.array([getattr(e, name) for e in SYSTEM.observation_fields]) for name in ("centre", "scale"))
    for k in range(61):
        belief, seen = state.belief, SYSTEM.observe(state.belief)
        assert np.isfinite(seen).all()
        assert (np.abs((seen - centre) / scale) < 10).all()
        np.testing.assert_allclose(seen[:, column["time_left"]], 1 - k / 60)
        np.testing.assert_array_equal(seen[:, column["dead_steps"]], belief.dead)
        for t in range(4):
            F, Q = SYSTEM.motion.F, belief.q[:, t, None, None] * SYSTEM.motion.Q
            P = F @ belief.covariance[:, t] @ F.T + Q
            want = {
                "set_up": belief.pointed == t, "log10_q": np.log10(belief.q[:, t]),
                "log10_sigma_position": np.log10(P[:, 0, 0] + P[:, 2, 2]) / 2,
                "log10_sigma_velocity": np.log10(P[:, 1, 1] + P[:, 3, 3]) / 2,
            }  # fmt: skip
            for name, values in want.items():
                np.testing.assert_allclose(seen[:, column[f"{name}_{t + 1}"]], values, rtol=1e-9, atol=1e-12)
        if k < 60:
            state = SYSTEM.transition(state, rng.integers(8, size=60) if k % 7 == 0 else belief.pointed * 2, worlds)


def test_a_target_on_top_of_a_receiver():
    """No division by 0; a leg shorter than the nearest range counts as the nearest range."""
    system = SectorSetup(region=((-3e3, -3e3), (0.0, 0.0)), speed=(0.0, 0.0), receivers=((-3e3, 0.0), (0.0, 0.0)))
    worlds = oracles.worlds(system, 20)
    worlds = worlds._replace(start=0.0 * worlds.start, window=0.0 * worlds.window)
    state = system.initial(worlds)
    for _ in range(6):
        seen = system.observe(state.belief)
        assert np.isfinite(seen).all()
        assert np.isfinite(shortcuts.gain(system, state.belief, 1, 5)).all()
        state = system.transition(state, np.zeros(20, np.int64), worlds)
        assert np.isfinite(state.belief.mean).all()
        assert (system.state_info(state)["nees"] >= 0).all()
    eta = seen[:, [e.name for e in system.observation_fields].index("snr_1_1")]
    assert eta.max() <= 10 * np.log10(20 * 5650.0**4 / (500.0 * 2.5e3) ** 2)
