"""Missed measurements, jumps of the PRF and the finest pixels, in cases that are clear by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import binomtest

from research.papers.rf_eo import study as rf_eo
from research.papers.rf_eo.adaptation import adaptation, jumps
from research.papers.rf_eo.study import ADAPTIVE, PUBLISHED, SCENES, Case, Runs, system
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.schedulers.registry import make_policy
from wavegym.systems.rf_eo.system import RfEo

C = 299_792_458.0


def in_view(x, place, settings, loop):
    prf, _, angle = settings
    dx, dy = x[0] - place[0], x[2] - place[1]
    r = math.hypot(dx, dy)
    rate, wavelength = (x[1] * dx + x[3] * dy) / r, C / loop.carrier_hz
    return (
        r <= C / (2 * prf),
        abs(rate) <= wavelength * prf / 4,
        abs(math.atan2(dx, dy)) <= loop.pixels * angle / 2,
    )


@pytest.mark.parametrize("scene", SCENES)
def test_missed_are_quantities_that_only_the_prediction_has_in_view(scene):
    loop = system(Case(scene, "random", horizon=30))
    world = draw_worlds(loop, world_seeds(1, "test", 4))
    policy = make_policy("random", loop, None)
    policy.begin(loop, 4, np.random.default_rng(0))
    state, total, rng = loop.initial(world), 0, np.random.default_rng(0)
    for _ in range(30):
        doubted = state.belief._replace(
            mean=state.belief.mean + rng.normal(size=(4, 2, 4)) * [900.0, 20.0, 900.0, 20.0]
        )
        state = state._replace(belief=doubted)
        action = policy.act(state.belief, None, None)
        settings = loop.action_set.settings(action)
        after = loop.transition(state, action, world)
        reported = rf_eo._missed(loop, state, after, settings)
        for env in range(4):
            count = 0
            for target in range(2):
                predicted, truth = loop.motion.F @ state.belief.mean[env, target], after.truth.targets[env, target]
                for place, chosen in zip(loop.platforms, settings[env], strict=True):
                    views = zip(
                        in_view(predicted, place, chosen, loop), in_view(truth, place, chosen, loop), strict=True
                    )
                    count += sum(there and not here for there, here in views)
            assert reported[env] == count
            total += count
        state = after
    assert total > 0


@pytest.mark.parametrize(
    "scenario",
    [{}, {"nearest_range": 1500.0}, {"as_printed": True}, {"out_of_view": "inflated", "nearest_range": 1500.0}],
)
def test_the_system_measures_all_quantities_in_view(scenario):
    """One pixel angle of the library covers the full circle, also behind a platform."""
    loop = RfEo(action="library", horizon=30, looks=(math.pi, 0.0), **scenario)
    world = draw_worlds(loop, world_seeds(2, "test", 6))
    policy = make_policy("random", loop, None)
    policy.begin(loop, 6, np.random.default_rng(1))
    state, counts = loop.initial(world), []
    for _ in range(30):
        action = policy.act(state.belief, None, None)
        predicted, state = state.belief.mean @ loop.motion.F.T, loop.transition(state, action, world)
        offset = predicted[:, :, None, ::2] - np.array(loop.platforms)
        known = np.hypot(offset[..., 0], offset[..., 1]) >= loop.nearest_range
        seen = rf_eo.in_view(loop, state.truth.targets, loop.action_set.settings(action)) & known[..., None]
        np.testing.assert_array_equal(seen.sum(axis=(2, 3)), state.truth.received)
        counts += state.truth.received.ravel().tolist()
    assert len(set(counts)) > 1


def made(settings, truth=None):
    count, steps, _, _ = settings.shape
    flat = np.zeros((count, steps, 2))
    place = np.zeros((count, steps, 2, 2)) if truth is None else truth
    return Runs(flat[..., 0], flat, flat, flat[..., 0], flat[..., 0], settings, settings, place, place, flat[:, 0, 0])


def chosen(prf, angle):
    """(run, k, platform) each."""
    prf, angle = np.broadcast_arrays(np.array(prf, float), np.array(angle, float))
    return np.stack([prf, np.full(prf.shape, 20e6), angle], axis=-1)


def test_a_jump_is_by_more_than_a_factor_of_two():
    prf = np.array([[[1e3, 1e3], [2e3, 1e3], [4.1e3, 1e3], [1e3, 1e3], [1e3, 1.9e3]]])
    runs = made(chosen(prf, 1e-3))
    found = jumps(runs, 0, 0)
    assert found["mean"] == 0.25
    assert [of["mean"] for of in found["platforms"]] == [0.5, 0.0]
    assert jumps(runs, 3, 0)["mean"] == 0.0


def test_the_interval_of_jumps_is_of_a_runs_share_over_both_platforms():
    """The jumps of the platforms are anticorrelated: the interval of their sum is narrower than that of each."""
    one, other = [1e3, 5e3, 1e3, 5e3, 1e3], [1e3, 1e3, 1e3, 1e3, 5e3]
    prf = np.stack([np.stack(pair, axis=-1) for pair in ((one, other), (other, one)) * 5])
    found = jumps(made(chosen(prf, 1e-3)), 0, 0)
    assert found["mean"] == pytest.approx(5 / 8)
    for platform in found["platforms"]:
        assert platform["mean"] == pytest.approx(5 / 8)
        assert platform["ci"][1] - platform["ci"][0] > 0.3
    exact = 5 / 8 * (1 - binomtest(0, 10).proportion_ci(0.95, method="exact").high)  # all runs agree
    assert found["ci"][0] == pytest.approx(exact)


def test_the_interval_of_no_jump_in_any_run_is_exact():
    found = jumps(made(chosen(np.full((20, 5, 2), 1e3), 1e-3)), 0, 0)
    assert found["ci"] == found["platforms"][0]["ci"] == pytest.approx([0.0, 1 - 0.025 ** (1 / 20)])


def test_the_finest_pixels_and_their_platform():
    """In run 1 both targets are straight above platform 2, in run 2 above platform 1."""
    loop = system(Case(PUBLISHED, ADAPTIVE))
    angle = np.array([[[4e-3, 1e-3]] * 4, [[1e-3, 2e-3]] * 3 + [[2e-3, 1e-3]]])
    truth = np.zeros((2, 4, 2, 2))
    truth[0], truth[1] = (1e3, 2e3), (-1e3, 2e3)
    reported = adaptation(made(chosen(1e3, angle), truth), loop, [1, 4], 0)
    assert reported["finest"]["mean"] == 0.5  # of run 2 the last half is a tie
    assert reported["second_over_first"]["geometric"] == pytest.approx(0.5)
    assert reported["narrower"]["mean"] == pytest.approx((1.0 + 0.5) / 2)
    assert [of["geometric"] for of in reported["factor"]] == pytest.approx([math.sqrt(2), math.sqrt(2)])
    assert reported["angle"][0][0] == pytest.approx(np.quantile([4e-3, 1e-3], [0.1, 0.5, 0.9]))
