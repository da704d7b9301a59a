"""The RF/EO platforms' runs, and every kind of number against direct computation from them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import binomtest, chi2
from small_studies import RF_EO_RUNS as RUNS
from small_studies import RF_EO_SEED as SEED
from small_studies import RF_EO_STEPS as STEPS

from research.papers.rf_eo import study as rf_eo
from research.papers.rf_eo.numbers import curve, shown
from research.papers.rf_eo.study import (
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
    VANISHING,
    Case,
    play,
    system,
)
from wavegym.core import shortcuts
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.evaluation import make_task
from wavegym.evaluation import play as shell
from wavegym.schedulers.registry import make_policy
from wavegym.systems.rf_eo.shortcuts import PROPOSED as SETTINGS

pytestmark = pytest.mark.slow

C = 299_792_458.0


def rmse(error):
    return np.array([math.sqrt(np.mean(run**2)) for run in error])


def test_every_policy_meets_the_same_worlds(rf_eo_study):
    wanted = {(scene, policy, PENALTIES[0]) for scene in SCENES for policy in POLICIES[scene]}
    wanted |= {(scene, ADAPTIVE, penalty) for scene in SCENES for penalty in PENALTIES}
    assert {case[:3] for case in rf_eo_study.runs} == wanted
    for scene in SCENES:
        alike = [runs for case, runs in rf_eo_study.runs.items() if case.scene == scene]
        for runs in alike:
            assert runs.error.shape == (RUNS, STEPS, 2)
            np.testing.assert_array_equal(runs.truth, alike[0].truth)
            offset = runs.estimate - runs.truth
            np.testing.assert_allclose(np.hypot(offset[..., 0], offset[..., 1]), runs.error, rtol=1e-12)


@pytest.mark.parametrize("policy", [ADAPTIVE, INFORMATION, "lookahead:3", "random"])
@pytest.mark.parametrize("scene", SCENES)
def test_runs_are_those_of_the_environments(rf_eo_study, scene, policy):
    env_id = {PUBLISHED: "RfEo-v0", FAR: "RfEoFar-v0"}[scene]
    task = make_task(env_id, {"horizon": STEPS, **VANISHING})
    assert RUNS <= CHUNK  # random choices follow from the first world of a batch
    reported = shell.play(task, make_policy(policy, task.system, None), world_seeds(SEED, "test", RUNS))
    runs = rf_eo_study.of(scene, policy)
    np.testing.assert_allclose(runs.cost, reported.cost, rtol=1e-12)
    np.testing.assert_allclose(rmse(runs.error), reported.rmse, rtol=1e-9)
    np.testing.assert_allclose(runs.nees.mean(axis=(1, 2)), reported.nees, rtol=1e-9)


def test_the_tuned_constant_is_transmitted_throughout(rf_eo_study):
    for scene in SCENES:
        tuned = next(
            slots for case, slots in rf_eo_study.tuned.items() if (case.scene, case.policy) == (scene, CONSTANT)
        )
        assert tuned.shape == (1, 2, 3)
        settings = rf_eo_study.of(scene, CONSTANT).settings
        np.testing.assert_array_equal(settings, np.broadcast_to(tuned[0], settings.shape))


def test_far_targets_are_beyond_what_the_proposed_settings_see():
    loop = system(Case(FAR, ADAPTIVE))
    world = draw_worlds(loop, world_seeds(0, "test", 20))
    state, nearest = loop.initial(world), math.inf
    action = np.broadcast_to(shortcuts.constants(loop)[0], (20, 6))
    for _ in range(loop.horizon):
        state = loop.transition(state, action, world)
        offset = state.truth.targets[:, :, None, ::2] - np.array(loop.platforms)
        nearest = min(nearest, np.hypot(offset[..., 0], offset[..., 1]).min())
    assert nearest > max(C / (2 * prf) for prf, _, _ in SETTINGS)
    assert PROPOSED in POLICIES[PUBLISHED]
    assert PROPOSED not in POLICIES[FAR]


def test_both_objectives_take_the_greatest_bandwidth(rf_eo_study):
    for scene in SCENES:
        for name in (ADAPTIVE, INFORMATION):
            np.testing.assert_allclose(rf_eo_study.of(scene, name).settings[..., 1], 20e6, rtol=1e-12)


def test_numbers_follow_from_the_runs(rf_eo_study, rf_eo_summary):
    assert rf_eo_summary["command"] == f"python -m research.papers rf_eo --runs {RUNS} --seed {SEED}"
    for scene in SCENES:
        reference = rf_eo_study.of(scene, ADAPTIVE).cost.mean(axis=1)
        constant = rf_eo_study.of(scene, CONSTANT).cost.mean(axis=1)
        assert list(rf_eo_summary["scenes"][scene]["policies"]) == list(POLICIES[scene])
        for name, reported in rf_eo_summary["scenes"][scene]["policies"].items():
            runs = rf_eo_study.of(scene, name)
            cost, error, late = runs.cost.mean(axis=1), rmse(runs.error), rmse(runs.error[:, STEPS // 2 :])
            assert reported["cost"]["mean"] == pytest.approx(cost.mean())
            assert reported["cost"]["median"] == pytest.approx(np.median(cost))
            assert reported["over_myopic"]["ratio"] == pytest.approx(cost.mean() / reference.mean())
            assert reported["over_tuned"]["ratio"] == pytest.approx(cost.mean() / constant.mean())
            assert reported["over_tuned"]["geometric"] == pytest.approx(np.exp(np.log(cost / constant).mean()))
            assert reported["rmse"]["mean"] == pytest.approx(error.mean())
            assert reported["rmse_late"]["mean"] == pytest.approx(late.mean())
            other = rmse(rf_eo_study.of(scene, ADAPTIVE).error[:, STEPS // 2 :])
            assert reported["late_over_myopic"]["ratio"] == pytest.approx(late.mean() / other.mean())
            assert reported["below_threshold"]["mean"] == pytest.approx(runs.below.mean())
            assert reported["missed_first"]["mean"] == pytest.approx((runs.missed[:, 0] > 0).mean())
            spans = [(window["first"], window["last"]) for window in reported["windows"]]
            assert [k for a, b in spans for k in range(a, b + 1)] == list(range(1, STEPS + 1))
            for (a, b), window in zip(spans, reported["windows"], strict=True):
                assert window["mean"] == pytest.approx(rmse(runs.error[:, a - 1 : b]).mean())


def test_nees_is_compared_with_the_distribution_of_its_mean(rf_eo_study, rf_eo_summary):
    """n runs of two targets: 2 n times the mean is chi-square with 8 n degrees of freedom."""
    for scene in SCENES:
        reported, nees = (
            rf_eo_summary["scenes"][scene]["policies"][ADAPTIVE]["nees"],
            rf_eo_study.of(scene, ADAPTIVE).nees,
        )
        low, high = reported["band"]
        assert chi2.cdf(2 * RUNS * low, 8 * RUNS) == pytest.approx(0.025)
        assert chi2.cdf(2 * RUNS * high, 8 * RUNS) == pytest.approx(0.975)
        by_step = [np.mean(nees[:, k]) for k in range(STEPS)]
        assert reported["first"] == pytest.approx(by_step[0])
        assert reported["inside"] == pytest.approx(np.mean([low <= value <= high for value in by_step]))
        assert reported["inside_settled"] == pytest.approx(np.mean([low <= value <= high for value in by_step[10:]]))


def test_lookahead_and_penalties_are_compared_with_the_one_step_scheduler(rf_eo_study, rf_eo_summary):
    for scene in SCENES:
        reported, reference = rf_eo_summary["scenes"][scene], rf_eo_study.of(scene, ADAPTIVE).cost.mean()
        assert list(reported["lookahead"]) == [str(H) for H in DEPTHS]
        for H, gain in reported["lookahead"].items():
            cost = rf_eo_study.of(scene, f"lookahead:{H}").cost.mean()
            assert gain["percent"] == pytest.approx(100 * (1 - cost / reference), abs=1e-9)
            assert gain["ci"][0] <= gain["percent"] + 1e-9
            assert gain["percent"] <= gain["ci"][1] + 1e-9
        for penalty, found in reported["penalties"].items():
            cost = rf_eo_study.of(scene, ADAPTIVE, penalty).cost.mean()
            assert found["over_logistic"]["ratio"] == pytest.approx(cost / reference)
            assert system(Case(scene, ADAPTIVE, penalty)).penalty == penalty


def test_the_rival_chooses_by_information_of_the_same_belief(rf_eo_study, rf_eo_summary):
    for scene in SCENES:
        runs, loop = rf_eo_study.of(scene, ADAPTIVE), system(Case(scene, ADAPTIVE, horizon=STEPS))
        first = loop.initial(draw_worlds(loop, world_seeds(SEED, "test", RUNS))).belief
        chosen = loop.action_set.settings(shortcuts.most_information(loop, first)[0])
        np.testing.assert_allclose(runs.rival[:, 0], chosen, rtol=1e-12)
        np.testing.assert_allclose(rf_eo_study.of(scene, INFORMATION).settings[:, 0], chosen, rtol=1e-12)
        same = np.array(
            [[abs(math.log(a / b)) < 1e-9] for a, b in zip(runs.rival.flat, runs.settings.flat, strict=True)]
        )
        same = same.reshape(runs.rival.shape)
        reported = rf_eo_summary["scenes"][scene]["agreement"]
        assert reported["prf"]["mean"] == pytest.approx(same[..., 0].mean())
        assert reported["angle"]["mean"] == pytest.approx(same[..., 2].mean())
        assert reported["both"]["mean"] == pytest.approx((same[..., 0] & same[..., 2]).mean())
        assert rf_eo_study.of(scene, INFORMATION).rival.size == 0


def test_curves_are_root_mean_squares_over_runs(rf_eo_study):
    steps = shown(STEPS)
    assert steps.tolist() == list(range(1, STEPS + 1))
    assert shown(1000)[[19, 20, -1]].tolist() == [20, 25, 1000]
    for target, estimates in enumerate(curve(rf_eo_study, PUBLISHED, PROPOSED, t, steps) for t in range(2)):
        error = rf_eo_study.of(PUBLISHED, PROPOSED).error[:, :, target]
        np.testing.assert_allclose([e.value for e in estimates], np.sqrt((error**2).mean(axis=0)))
        assert all(e.ci[0] <= e.value * (1 + 1e-9) and e.value <= e.ci[1] * (1 + 1e-9) for e in estimates)


def test_partial_results_are_used_again(tmp_path, monkeypatch):
    """Decision times come from a clock: only stored results have the same ones."""
    monkeypatch.setattr(rf_eo, "POLICIES", {PUBLISHED: (PROPOSED, ADAPTIVE), FAR: (ADAPTIVE,)})
    first, again = (play(2, SEED, 1, horizon=4, store=tmp_path) for _ in range(2))
    for case, runs in first.runs.items():
        np.testing.assert_array_equal(runs.seconds, again.runs[case].seconds)
    fresh = play(2, SEED, 1, horizon=4)
    assert any((runs.seconds != fresh.runs[case].seconds).any() for case, runs in first.runs.items())


def test_shares_of_runs_have_exact_intervals(rf_eo_study, rf_eo_summary):
    runs = rf_eo_study.of(FAR, "random")
    count = int((runs.missed[:, 0] > 0).sum())
    exact = binomtest(count, RUNS).proportion_ci(0.95, method="exact")
    reported = rf_eo_summary["scenes"][FAR]["policies"]["random"]["missed_first"]
    assert reported["ci"] == pytest.approx([exact.low, exact.high])
