"""The agile chirps' runs, and every kind of number against direct computation from them."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from research.papers import claims
from research.papers.agile_clutter import study as agile_clutter
from research.papers.agile_clutter.claims import check_claims
from research.papers.agile_clutter.numbers import DROP, JUMP, WINDOWS, curve, shares, summarise, typical
from research.papers.agile_clutter.study import (
    AGILE,
    BEST_FIXED,
    BEST_FREE,
    CONSTANT,
    FREE,
    FULL,
    LIBRARY,
    POLICIES,
    Case,
    Runs,
    laws,
    names,
    play,
    scene,
)
from research.papers.agile_clutter.table import markdown
from research.papers.estimates import share_estimate
from wavegym.core import shortcuts
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.schedulers import Fixed, Myopic, Progressive, rollout
from wavegym.schedulers.tuning import best_fixed
from wavegym.systems.agile_clutter.system import AgileClutter

pytestmark = pytest.mark.slow

RUNS, SEED = 8, 3


@pytest.fixture(scope="module")
def study():
    return play(RUNS, SEED, 1, tuning=2)


@pytest.fixture(scope="module")
def both():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(agile_clutter, "CONVERGENCE", (5, 30))
        patch.setattr(agile_clutter, "CONVERGENCE_RUNS", 3)
        patch.setattr(agile_clutter, "SHORTLIST", 4)
        patch.setattr(agile_clutter, "POLICIES", (FULL, *CONSTANT))
        return play(3, SEED, 1, tracker="both", tuning=2)


@pytest.fixture(scope="module")
def summary(study):
    return summarise(study)


@pytest.mark.slow
def test_every_policy_meets_the_same_worlds_in_every_setting(study):
    assert list(study.runs) == [Case("jpda", c, p) for c in ("clutter", "no clutter") for p in POLICIES]
    start = {tuple(draw_worlds(scene(case), world_seeds(SEED, "test", 2)).error.ravel()) for case in study.runs}
    assert len(start) == 1
    for runs in study.runs.values():
        assert runs.squared_error.shape == (RUNS, 32, 2)
        assert (np.isnan(runs.squared_error) == np.isnan(runs.squared_error[0])).all()
    present = ~np.isnan(runs.squared_error[0])
    assert [np.flatnonzero(column)[[0, -1]].tolist() for column in present.T] == [[0, 24], [7, 31]]


@pytest.mark.slow
@pytest.mark.parametrize("clutter", ["clutter", "no clutter"])
@pytest.mark.parametrize("policy", [FULL, FREE, "agile LFM", BEST_FIXED])
def test_runs_are_those_of_the_system(study, clutter, policy):
    """Against ``rollout``, and its actions replayed."""
    case = Case("jpda", clutter, policy)
    system, runs = scene(case), study.runs[case]
    worlds = draw_worlds(system, world_seeds(SEED, "test", RUNS))
    played = rollout(system, Fixed(study.fixed[case][0]) if policy == BEST_FIXED else Progressive(), worlds)
    assert (played.cost == runs.cost).all()
    state, points = system.initial(worlds), 0.0
    for k in range(system.horizon):
        state = system.transition(state, played.actions[:, k], worlds)
        error = state.belief.mean - state.truth.targets
        shown = ~np.isnan(runs.squared_error[0, k])
        np.testing.assert_allclose(runs.squared_error[:, k, shown], np.square(error[:, shown]).sum(axis=2), rtol=1e-12)
        shape = state.belief.covariance[:, shown]
        nees = (error[:, shown][..., None, :] @ np.linalg.inv(shape) @ error[:, shown][..., None])[..., 0, 0]
        np.testing.assert_allclose(runs.nees[:, k, shown], nees, rtol=1e-6)
        assert np.isnan(runs.nees[:, k, ~shown]).all()
        points += system.state_info(state)["clutter"]
    assert (runs.lost == (state.truth.outside > 5)).all()
    assert (runs.clutter.sum(axis=1) == points).all()
    assert (points.sum() == 0) == (clutter == "no clutter")


def test_laws_are_those_transmitted():
    assert names(FULL) == names(BEST_FIXED) == ("LFM", "PFM3", "HFM", "EFM")
    for policy in CONSTANT:
        system = scene(Case("jpda", "clutter", policy))
        actions = np.arange(len(system.action_set.library))[:, None].repeat(2, axis=1)
        want = [names(policy).index(label.split()[0]) for label in system.action_set.library.labels]
        assert laws(system, actions).tolist() == [[law, law] for law in want]
    for policy, offered in AGILE.items():
        system, count = scene(Case("jpda", "clutter", policy)), len(offered)
        assert len(names(policy)) == count
        chosen = np.array([[i, j] for i in range(count) for j in range(count)])
        duration, sweep = (np.full(chosen.shape, value) for value in (2e-5, -3e6))
        assert (laws(system, system.action_set.encode_chirps(chosen, duration, sweep)) == chosen).all()


@pytest.mark.slow
def test_the_best_constant_is_tuned_on_worlds_of_its_own(study):
    assert list(study.fixed) == [Case("jpda", c, p) for c in agile_clutter.CLUTTER for p in CONSTANT]
    for case, (index, waveforms) in study.fixed.items():
        system = scene(case)
        assert index == best_fixed(system, draw_worlds(system, world_seeds(SEED, "tune", 2)))
        assert list(waveforms) == [system.action_set.library.labels[i] for i in shortcuts.constants(system)[index]]


@pytest.mark.slow
@pytest.mark.parametrize("policy", CONSTANT)
def test_with_particles_the_constants_best_with_jpda_are_tuned(both, policy):
    seeds = world_seeds(SEED, "tune", 2)

    @cache
    def cost(case, index):
        system = scene(case)
        return rollout(system, Fixed(index), draw_worlds(system, seeds)).mean_cost.mean()

    quick, slow = (Case(tracker, "no clutter", policy) for tracker in ("jpda", "particle"))
    short = sorted(range(len(shortcuts.constants(scene(quick)))), key=lambda k: cost(quick, k))[:4]
    assert both.fixed[quick][0] == short[0]
    assert both.fixed[slow][0] == min(short, key=lambda k: cost(slow, k))


def test_numbers_of_particles_are_tried_on_the_first_worlds(study, both):
    assert study.converged == {}
    assert list(both.converged) == [5, 30]
    for count, runs in both.converged.items():
        system = AgileClutter(tracker="particle", particles=count, snr_law="printed")
        played = rollout(system, Myopic(), draw_worlds(system, world_seeds(SEED, "test", 3)))
        np.testing.assert_array_equal(runs.cost, played.cost)
    assert scene(Case("particle", "clutter", LIBRARY)).particles == AgileClutter().particles


def test_the_numbers_are_those_of_the_runs(study, summary):
    assert (summary["runs"], summary["seed"]) == (RUNS, SEED)
    assert summary["command"].endswith("agile_clutter --runs 8 --tracker jpda --seed 3")
    for clutter, setting in summary["trackers"]["jpda"].items():
        played = study.of("jpda", clutter)
        total = {name: np.nansum(runs.squared_error, axis=(1, 2)) for name, runs in played.items()}
        kept = {name: ~runs.lost.any(axis=1) for name, runs in played.items()}
        runs_nees = {name: runs.nees for name, runs in played.items()}
        for name, policy in setting["policies"].items():
            both = kept[name] & kept[FULL]
            assert policy["nees"]["mean"] == pytest.approx(np.nanmean(runs_nees[name][kept[name]]))
            assert policy["kept"]["mean"] == pytest.approx(kept[name].mean())
            assert policy["mse_kept"]["mean"] == pytest.approx(total[name][kept[name]].mean())
            assert policy["mse_kept"]["runs"] == kept[name].sum()
            assert policy["mse_all"]["mean"] == pytest.approx(total[name].mean())
            assert policy["mse_all"]["median"] == pytest.approx(np.median(total[name]))
            if name == FULL:
                assert policy["ratio_kept"] is policy["ratio_all"] is None
                continue
            ratio = policy["ratio_kept"]
            assert ratio["ratio"] == pytest.approx(total[name][both].mean() / total[FULL][both].mean())
            logs = np.log(total[name][both] / total[FULL][both])
            assert ratio["geometric"] == pytest.approx(np.exp(logs.mean()))
            assert ratio["ci"][0] <= ratio["ratio"] * (1 + 1e-9)
            assert ratio["ratio"] <= ratio["ci"][1] * (1 + 1e-9)
            assert policy["ratio_all"]["ratio"] == pytest.approx(total[name].mean() / total[FULL].mean())
        free = total[BEST_FREE].mean() / total[FREE].mean()
        assert setting["best_free"]["ratio_all"]["ratio"] == pytest.approx(free)


def test_jump_drop_and_shares_are_of_the_kept_runs(study, summary):
    for clutter, setting in summary["trackers"]["jpda"].items():
        full = study.of("jpda", clutter)[FULL]
        kept = ~full.lost.any(axis=1)
        mse = np.nansum(full.squared_error[kept], axis=2).mean(axis=0)
        np.testing.assert_allclose([e.value for e in curve(study, full)], mse, rtol=1e-12)
        assert setting["jump"]["ratio"] == pytest.approx(mse[7] / mse[6])
        assert setting["drop"]["ratio"] == pytest.approx(mse[25] / mse[24])
    assert (JUMP, DROP, WINDOWS["late"]) == (8, 26, (20, 25))


@pytest.mark.parametrize("policy", [FULL, FREE])
@pytest.mark.parametrize("clutter", ["clutter", "no clutter"])
def test_choices_are_those_of_the_kept_runs(study, summary, clutter, policy):
    runs, reported = study.of("jpda", clutter)[policy], summary["trackers"]["jpda"][clutter]["choices"][policy]
    law = np.array(names(policy))[runs.law[~runs.lost.any(axis=1)]]
    for i, name in enumerate(names(policy)):
        np.testing.assert_allclose(shares(runs, len(names(policy)))[..., i], (law == name).mean(axis=0), atol=1e-15)
        assert reported["share"]["all"][name]["mean"] == pytest.approx((law == name).mean())
        assert reported["share"]["jump"][name]["mean"] == pytest.approx((law[:, 7] == name).mean())
        assert reported["share"]["late"][name]["mean"] == pytest.approx((law[:, 19:25] == name).mean())
    for kind, early in reported["kind"]["early"].items():
        assert early["mean"] == pytest.approx(np.char.startswith(law[:, :3], kind).mean())
    assert (reported["linear"]["choices"], reported["linear"]["of"]) == ((law == "LFM").sum(), law.size)
    assert any((np.transpose(reported["typical"]) == run).all() for run in law)


def test_intervals_of_shares_are_exact_where_a_bootstrap_knows_nothing(summary):
    """Of 0 of n runs the upper bound is 1 - 0.025^(1/n)."""
    reported, bound = summary["trackers"]["jpda"]["no clutter"], 1 - 0.025 ** (1 / RUNS)
    assert reported["policies"][FULL]["kept"] == {"mean": 1.0, "ci": pytest.approx([1 - bound, 1.0])}
    assert reported["choices"][FULL]["linear"]["ci"] == pytest.approx([0.0, bound])
    assert reported["choices"][FULL]["kind"]["late"]["LFM"]["ci"] == pytest.approx([0.0, bound])
    half = share_estimate(np.full(RUNS, 0.5), 0)
    assert half == (0.5, pytest.approx((0.5 - bound / 2, 0.5 + bound / 2)))
    low, high = share_estimate(np.array([1.0] * 7 + [0.0] * 3), 0).ci
    at_most = sum(math.comb(10, i) * high**i * (1 - high) ** (10 - i) for i in range(8))
    at_least = sum(math.comb(10, i) * low**i * (1 - low) ** (10 - i) for i in range(7, 11))
    assert (at_most, at_least) == pytest.approx((0.025, 0.025))


def made(law, lost):
    count, steps, _ = np.shape(law)
    zeros = np.zeros((count, steps))
    return Runs(np.zeros((count, steps, 2)), zeros, np.zeros((count, steps, 2)), np.array(law), zeros, np.array(lost))


def test_the_typical_run_is_the_kept_one_most_like_the_others():
    law = [[[3, 3]] * 2, [[3, 3]] * 2, [[1, 1], [2, 2]], [[1, 1], [2, 1]], [[1, 2], [2, 1]]]
    lost = [[True, False], [False, True], [False, False], [False, False], [False, False]]
    assert typical(made(law, lost)).tolist() == [[1, 1], [2, 1]]


def test_where_no_run_is_kept_there_are_no_numbers(study):
    runs = made(np.zeros((3, 32, 2), int), np.ones((3, 2), bool))
    assert np.isnan(shares(runs, 4)).all()
    assert (typical(runs) == -1).all()
    nothing = agile_clutter.Study(0, dict.fromkeys(study.runs, runs), study.fixed, {})
    assert all(estimate == (None, None) for estimate in curve(nothing, runs))
    summary = summarise(nothing)
    policies = summary["trackers"]["jpda"]["clutter"]["policies"]
    assert policies[FULL]["mse_kept"] == {"mean": None, "ci": None, "median": None, "runs": 0}
    assert policies[LIBRARY]["ratio_kept"]["ratio"] is None
    text = f"{markdown(summary)}{claims.markdown(check_claims(summary))}"
    assert "nan" not in text
    assert "None" not in text
