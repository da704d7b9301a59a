"""The RF/EO platforms' runs, and every kind of number against direct computation from them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rf_eo_runs import RUNS, SEED, STEPS
from scipy.stats import binomtest, chi2

from wavegym.errors import InputError
from wavegym.evaluation import make_task
from wavegym.evaluation import play as shell
from wavegym.evaluation.worlds import draw_worlds, world_seeds
from wavegym.reproduce import rf_eo
from papers.rf_eo.study import (
    ADAPTIVE,
    CHUNK,
    CONSTANT,
    DEPTHS,
    FAR,
    INFORMATION,
    PENALTIES,
    POLICIES,
    PROPOSED,
    PUBLISHED,
    SCENES,
    Case,
    play,
    system,
)
from papers.rf_eo.numbers import curve, shown
from wavegym.schedulers.names import make_policy
from wavegym.systems.rf_eo import PROPOSED as SETTINGS

C = 299_792_458.0


def rmse(error):
    return np.array([math.sqrt(np.mean(run**2)) for run in error])


def test_every_policy_meets_the_same_worlds(platforms_study):
    wanted = {(scene, policy, PENALTIES[0]) for scene in SCENES for policy in POLICIES[scene]}
    wanted |= {(scene, ADAPTIVE, penalty) for scene in SCENES for penalty in PENALTIES}
    assert {case[:3] for case in platforms_study.runs} == wanted
    for scene in SCENES:
        alike = [runs for case, runs in platforms_study.runs.items() if case.scene == scene]
        for runs in alike:
            assert runs.error.shape == (RUNS, STEPS, 2)
            np.testing.assert_array_equal(runs.truth, alike[0].truth)
            offset = runs.estimate - runs.truth
            np.testing.assert_allclose(np.hypot(offset[..., 0], offset[..., 1]), runs.error, rtol=1e-12)


@pytest.mark.parametrize("policy", [ADAPTIVE, INFORMATION, "lookahead:3", "random"])
@pytest.mark.parametrize("scene", SCENES)
def test_runs_are_those_of_the_environments(platforms_study, scene, policy):
    env_id = {PUBLISHED: "RfEo-v0", FAR: "RfEoFar-v0"}[scene]
    task = make_task(env_id, {"horizon": STEPS})
    assert RUNS <= CHUNK  # random choices follow from the first world of a batch
    told = shell.play(task, make_policy(policy, task.system, None), world_seeds(SEED, "test", RUNS))
    runs = platforms_study.of(scene, policy)
    np.testing.assert_allclose(runs.cost, told.cost, rtol=1e-12)
    np.testing.assert_allclose(rmse(runs.error), told.rmse, rtol=1e-9)
    np.testing.assert_allclose(runs.nees.mean(axis=(1, 2)), told.nees, rtol=1e-9)


def test_the_tuned_constant_is_transmitted_throughout(platforms_study):
    for scene in SCENES:
        tuned = next(
            slots for case, slots in platforms_study.tuned.items() if (case.scene, case.policy) == (scene, CONSTANT)
        )
        assert tuned.shape == (1, 2, 3)
        settings = platforms_study.of(scene, CONSTANT).settings
        np.testing.assert_array_equal(settings, np.broadcast_to(tuned[0], settings.shape))


def test_far_targets_are_beyond_what_the_proposed_settings_see():
    loop = system(Case(FAR, ADAPTIVE))
    world = draw_worlds(loop, world_seeds(0, "test", 20))
    state, nearest = loop.begin(world), math.inf
    action = np.broadcast_to(loop.constants()[0], (20, 6))
    for _ in range(loop.horizon):
        state = loop.advance(state, action, world)
        offset = state.hidden.truth[:, :, None, ::2] - np.array(loop.platforms)
        nearest = min(nearest, np.hypot(offset[..., 0], offset[..., 1]).min())
    assert nearest > max(C / (2 * prf) for prf, _, _ in SETTINGS)
    assert PROPOSED in POLICIES[PUBLISHED]
    assert PROPOSED not in POLICIES[FAR]


def test_both_objectives_take_the_greatest_bandwidth(platforms_study):
    for scene in SCENES:
        for name in (ADAPTIVE, INFORMATION):
            np.testing.assert_allclose(platforms_study.of(scene, name).settings[..., 1], 20e6, rtol=1e-12)


def test_numbers_follow_from_the_runs(platforms_study, platforms_summary):
    assert platforms_summary["command"] == f"python -m papers rf_eo --runs {RUNS} --seed {SEED}"
    for scene in SCENES:
        reference = platforms_study.of(scene, ADAPTIVE).cost.mean(axis=1)
        constant = platforms_study.of(scene, CONSTANT).cost.mean(axis=1)
        assert list(platforms_summary["scenes"][scene]["policies"]) == list(POLICIES[scene])
        for name, told in platforms_summary["scenes"][scene]["policies"].items():
            runs = platforms_study.of(scene, name)
            cost, error, late = runs.cost.mean(axis=1), rmse(runs.error), rmse(runs.error[:, STEPS // 2 :])
            assert told["cost"]["mean"] == pytest.approx(cost.mean())
            assert told["cost"]["median"] == pytest.approx(np.median(cost))
            assert told["over_myopic"]["ratio"] == pytest.approx(cost.mean() / reference.mean())
            assert told["over_tuned"]["ratio"] == pytest.approx(cost.mean() / constant.mean())
            assert told["over_tuned"]["geometric"] == pytest.approx(np.exp(np.log(cost / constant).mean()))
            assert told["rmse"]["mean"] == pytest.approx(error.mean())
            assert told["rmse_late"]["mean"] == pytest.approx(late.mean())
            other = rmse(platforms_study.of(scene, ADAPTIVE).error[:, STEPS // 2 :])
            assert told["late_over_myopic"]["ratio"] == pytest.approx(late.mean() / other.mean())
            assert told["below_threshold"]["mean"] == pytest.approx(runs.below.mean())
            assert told["missed_first"]["mean"] == pytest.approx((runs.missed[:, 0] > 0).mean())
            spans = [(window["first"], window["last"]) for window in told["windows"]]
            assert [k for a, b in spans for k in range(a, b + 1)] == list(range(1, STEPS + 1))
            for (a, b), window in zip(spans, told["windows"], strict=True):
                assert window["mean"] == pytest.approx(rmse(runs.error[:, a - 1 : b]).mean())


def test_nees_is_held_against_the_law_of_its_mean(platforms_study, platforms_summary):
    """n runs of two targets: 2 n times the mean is chi-square with 8 n degrees of freedom."""
    for scene in SCENES:
        told, nees = (
            platforms_summary["scenes"][scene]["policies"][ADAPTIVE]["nees"],
            platforms_study.of(scene, ADAPTIVE).nees,
        )
        low, high = told["band"]
        assert chi2.cdf(2 * RUNS * low, 8 * RUNS) == pytest.approx(0.025)
        assert chi2.cdf(2 * RUNS * high, 8 * RUNS) == pytest.approx(0.975)
        by_step = [np.mean(nees[:, k]) for k in range(STEPS)]
        assert told["first"] == pytest.approx(by_step[0])
        assert told["inside"] == pytest.approx(np.mean([low <= value <= high for value in by_step]))
        assert told["inside_settled"] == pytest.approx(np.mean([low <= value <= high for value in by_step[10:]]))


def test_lookahead_and_penalties_are_told_against_the_one_step_scheduler(platforms_study, platforms_summary):
    for scene in SCENES:
        told, reference = platforms_summary["scenes"][scene], platforms_study.of(scene, ADAPTIVE).cost.mean()
        assert list(told["lookahead"]) == [str(H) for H in DEPTHS]
        for H, gain in told["lookahead"].items():
            cost = platforms_study.of(scene, f"lookahead:{H}").cost.mean()
            assert gain["percent"] == pytest.approx(100 * (1 - cost / reference), abs=1e-9)
            assert gain["ci"][0] <= gain["percent"] + 1e-9
            assert gain["percent"] <= gain["ci"][1] + 1e-9
        for penalty, found in told["penalties"].items():
            cost = platforms_study.of(scene, ADAPTIVE, penalty).cost.mean()
            assert found["over_logistic"]["ratio"] == pytest.approx(cost / reference)
            assert system(Case(scene, ADAPTIVE, penalty)).penalty == penalty


def test_the_rival_chooses_by_information_of_the_same_belief(platforms_study, platforms_summary):
    for scene in SCENES:
        runs, loop = platforms_study.of(scene, ADAPTIVE), system(Case(scene, ADAPTIVE, horizon=STEPS))
        first = loop.begin(draw_worlds(loop, world_seeds(SEED, "test", RUNS))).public
        chosen = loop.menu.settings(loop.most_information(first)[0])
        np.testing.assert_allclose(runs.rival[:, 0], chosen, rtol=1e-12)
        np.testing.assert_allclose(platforms_study.of(scene, INFORMATION).settings[:, 0], chosen, rtol=1e-12)
        same = np.array(
            [[abs(math.log(a / b)) < 1e-9] for a, b in zip(runs.rival.flat, runs.settings.flat, strict=True)]
        )
        same = same.reshape(runs.rival.shape)
        told = platforms_summary["scenes"][scene]["agreement"]
        assert told["prf"]["mean"] == pytest.approx(same[..., 0].mean())
        assert told["angle"]["mean"] == pytest.approx(same[..., 2].mean())
        assert told["both"]["mean"] == pytest.approx((same[..., 0] & same[..., 2]).mean())
        assert platforms_study.of(scene, INFORMATION).rival.size == 0


def test_curves_are_root_mean_squares_over_runs(platforms_study):
    steps = shown(STEPS)
    assert steps.tolist() == list(range(1, STEPS + 1))
    assert shown(1000)[[19, 20, -1]].tolist() == [20, 25, 1000]
    for target, estimates in enumerate(curve(platforms_study, PUBLISHED, PROPOSED, t, steps) for t in range(2)):
        error = platforms_study.of(PUBLISHED, PROPOSED).error[:, :, target]
        np.testing.assert_allclose([e.value for e in estimates], np.sqrt((error**2).mean(axis=0)))
        assert all(e.ci[0] <= e.value * (1 + 1e-9) and e.value <= e.ci[1] * (1 + 1e-9) for e in estimates)


def test_what_is_done_is_taken_up_again(tmp_path, monkeypatch):
    """Decision times come from a clock: only what was kept has the same ones."""
    monkeypatch.setattr(rf_eo, "POLICIES", {PUBLISHED: (PROPOSED, ADAPTIVE), FAR: (ADAPTIVE,)})
    first, again = (play(2, SEED, 1, horizon=4, store=tmp_path) for _ in range(2))
    for case, runs in first.runs.items():
        np.testing.assert_array_equal(runs.seconds, again.runs[case].seconds)
    fresh = play(2, SEED, 1, horizon=4)
    assert any((runs.seconds != fresh.runs[case].seconds).any() for case, runs in first.runs.items())


def test_shares_of_runs_have_exact_intervals(platforms_study, platforms_summary):
    runs = platforms_study.of(FAR, "random")
    count = int((runs.missed[:, 0] > 0).sum())
    exact = binomtest(count, RUNS).proportion_ci(0.95, method="exact")
    told = platforms_summary["scenes"][FAR]["policies"]["random"]["missed_first"]
    assert told["ci"] == pytest.approx([exact.low, exact.high])


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"runs": 0}, "runs is 0"),
        ({"jobs": 0}, "jobs is 0"),
        ({"root": -1}, "seed is -1"),
        ({"tuning": 0}, "tuning is 0"),
        ({"horizon": -1}, "horizon is -1"),
    ],
)
def test_mistakes_are_told_before_any_platform_plays(monkeypatch, settings, words):
    monkeypatch.setattr(rf_eo, "_play", None)
    with pytest.raises(InputError, match=words):
        play(**settings)
