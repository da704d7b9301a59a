"""The urban runs, and every kind of number against direct computation from them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import binomtest
from small_studies import URBAN_RUNS as RUNS
from small_studies import URBAN_SEED as SEED

from research.papers.estimates import rms_estimate, rms_ratio
from research.papers.urban.motion_models import models, phases, probability
from research.papers.urban.numbers import confirmed_curve, rmse_curve
from research.papers.urban.pictures import no_target
from research.papers.urban.study import (
    CASES,
    CHUNK,
    CLOSED,
    FILTERS,
    GHOSTS,
    LONG,
    LOOSE,
    NCV1,
    OPEN,
    POLICIES,
    RANDOM,
    SETTINGS,
    STARTS,
    STRICT,
    Case,
    system,
)
from wavegym.core.worlds import draw_worlds, word, world_seeds
from wavegym.evaluation import statistics
from wavegym.schedulers.registry import make_policy
from wavegym.systems.urban.tracker import CONFIRMED, EMPTY, Tracks

pytestmark = pytest.mark.slow

SCANS = 140
THERE = 140 + 101  # scans of the first target and of the second, which comes at the fortieth


def test_every_filter_meets_every_policy(urban_study):
    wanted = {(s, True, f, p) for s in SETTINGS for f in FILTERS for p in POLICIES}
    wanted |= {(s, False, *loop) for s in SETTINGS for loop in (CLOSED, OPEN)}
    wanted |= {(s, True, *loop) for s in STARTS for loop in (CLOSED, OPEN)}
    assert set(urban_study.runs) == wanted
    for case, runs in urban_study.runs.items():
        assert runs.confirmed.shape == (RUNS, SCANS)
        loop = system(case)
        assert (loop.vaguest, loop.ghosts) == (STARTS[case.setting], case.ghosts)
        assert (loop.tracker, loop.sigma) == {"VS-IMM": ("vsimm", 0.25), "NCV": ("ncv", 0.25)}.get(
            case.filter, ("ncv", 1.0)
        )
    assert list(system(CASES[0]).durations).index(max(system(CASES[0]).durations)) == int(LONG[-1]) // 2


@pytest.mark.parametrize(
    "case", [Case(LOOSE, True, *CLOSED), Case(STRICT, False, *OPEN), Case(LOOSE, True, NCV1, RANDOM)]
)
def test_runs_are_those_of_the_system(urban_study, case):
    """Replayed, and what is kept computed target by target."""
    assert RUNS <= CHUNK  # random choices follow from the first world of a batch
    runs, loop, seeds = urban_study.runs[case], system(case), world_seeds(SEED, "test", RUNS)
    worlds, policy = draw_worlds(loop, seeds), make_policy(case.policy, loop, None)
    policy.begin(loop, RUNS, np.random.default_rng([word("policy"), seeds[0]]))
    state = loop.initial(worlds)
    for k in range(SCANS):
        np.testing.assert_array_equal(runs.tracked[:, k], [(row != EMPTY).any() for row in state.belief.status])
        action = policy.act(state.belief, None, None)
        np.testing.assert_array_equal(runs.action[:, k], action)
        state = loop.transition(state, action, worlds)
        reported, (x, _) = loop.state_info(state), Tracks(*state.belief[1:]).combined()
        reported["lost"] = loop.scene.direct[k + 1] & ~reported["held"]
        names = ("confirmed", "false", "held", "position_error", "lost", "gospa")
        for name, kept in zip(names, runs[:6], strict=True):
            np.testing.assert_array_equal(kept[:, k], reported[name])
        for e in range(RUNS):
            sure = state.belief.status[e] == CONFIRMED
            np.testing.assert_array_equal(runs.place[e, k, sure], x[e, sure, :4])
            assert np.isnan(runs.place[e, k, ~sure]).all()
            for g in range(2):
                if not reported["held"][e, g]:
                    assert np.isnan(runs.mu[e, k, g]).all()
                    continue
                off = {s: math.dist(x[e, s, :2], state.truth.targets[e, g, :2]) for s in np.flatnonzero(sure)}
                np.testing.assert_array_equal(runs.mu[e, k, g], state.belief.mu[e, min(off, key=off.__getitem__)])


def rmse(runs):
    return math.sqrt(sum(e**2 for e in runs.error[runs.held]) / runs.held.sum())


def test_numbers_follow_from_the_runs(urban_study, urban_summary):
    assert urban_summary["command"] == f"python -m research.papers urban --runs {RUNS} --seed {SEED}"
    assert urban_summary["seen"] == pytest.approx(system(CASES[0]).scene.direct[1:].sum() / THERE)
    for case, runs in urban_study.runs.items():
        if case.setting not in SETTINGS:
            continue
        reported = urban_summary["settings"][case.setting]["systems"][GHOSTS[case.ghosts]][case.filter][case.policy]
        assert reported["confirmed"]["mean"] == pytest.approx(runs.confirmed.mean())
        assert reported["rmse"]["mean"] == pytest.approx(rmse(runs))
        assert reported["held"]["mean"] == pytest.approx(runs.held.sum() / (RUNS * THERE))
        assert reported["lost"]["mean"] == pytest.approx(runs.lost.sum() / RUNS / system(case).scene.direct[1:].sum())
        assert reported["gospa"]["mean"] == pytest.approx(runs.gospa.mean())
        assert reported["false"]["mean"] == pytest.approx(runs.false.mean())
        assert reported["false_tracks"]["mean"] == pytest.approx(runs.origins.sum() / RUNS)
        made_of = [of["mean"] for of in reported["false_tracks"]["origins"].values()]
        assert sum(made_of) == pytest.approx(reported["false_tracks"]["mean"])
        losses = sum(
            runs.held[e, k - 1, g] and not runs.held[e, k, g]
            for e in range(RUNS) for k in range(1, SCANS) for g in range(2)
        )  # fmt: skip
        assert reported["losses"]["mean"] == pytest.approx(losses / RUNS)
        shares = [np.mean(runs.action[e, runs.tracked[e]] >= 2) for e in range(RUNS)]
        assert reported["long"]["mean"] == pytest.approx(np.mean(shares))
        for key, loop in (("over_closed", CLOSED), ("over_open", OPEN)):
            other = urban_study.of(case.setting, loop, case.ghosts)
            assert reported[key]["rmse"]["ratio"] == pytest.approx(rmse(runs) / rmse(other))
            assert reported[key]["confirmed"]["ratio"] == pytest.approx(runs.confirmed.mean() / other.confirmed.mean())
            assert reported[key]["held"]["ratio"] == pytest.approx(runs.held.sum() / other.held.sum())
            assert reported[key]["gospa"]["ratio"] == pytest.approx(runs.gospa.mean() / other.gospa.mean())


def test_starts_go_from_strict_to_loose(urban_study, urban_summary):
    assert [of["vaguest"] for of in urban_summary["starts"]] == sorted(STARTS.values())
    assert SETTINGS == {LOOSE: 12.0, STRICT: 5.0} == {name: STARTS[name] for name in SETTINGS}
    for name, reported in zip(STARTS, urban_summary["starts"], strict=True):
        closed, opened = (urban_study.of(name, loop) for loop in (CLOSED, OPEN))
        assert reported["over_open"]["confirmed"]["ratio"] == pytest.approx(
            closed.confirmed.sum() / opened.confirmed.sum()
        )
        assert reported["over_open"]["rmse"]["ratio"] == pytest.approx(rmse(closed) / rmse(opened))
        assert reported["false_tracks"]["mean"] == pytest.approx(closed.origins.sum() / RUNS)
        assert reported["false_tracks_open"]["mean"] == pytest.approx(opened.origins.sum() / RUNS)


def test_ghost_logic_is_compared_with_none(urban_study, urban_summary):
    for setting in SETTINGS:
        for name, loop in (("closed", CLOSED), ("open", OPEN)):
            reported = urban_summary["settings"][setting]["ghosts_over_none"][name]
            ours, none = (urban_study.of(setting, loop, ghosts) for ghosts in (True, False))
            assert reported["held"]["ratio"] == pytest.approx(ours.held.sum() / none.held.sum())
            if none.origins.sum():
                assert reported["false_tracks"]["ratio"] == pytest.approx(ours.origins.sum() / none.origins.sum())


def test_curves_are_means_over_runs(urban_study):
    runs = urban_study.of(LOOSE, CLOSED)
    np.testing.assert_allclose([e.value for e in confirmed_curve(runs, 0)], runs.confirmed.mean(axis=0))
    for k, found in enumerate(rmse_curve(runs, 0)):
        errors = runs.error[:, k][runs.held[:, k]]
        if not len(errors):
            assert found == (None, None)
        else:
            assert found.value == pytest.approx(math.sqrt(np.mean(errors**2)))
    for model in range(4):
        for k, found in enumerate(probability(runs.mu, 0, model, 0)):
            of = [p for p in runs.mu[:, k, 0, model] if not math.isnan(p)]
            assert found.value == (pytest.approx(np.mean(of)) if of else None)


def test_a_root_mean_square_has_an_interval_that_scales_with_it():
    rng = np.random.default_rng(0)
    counts = rng.integers(5, 50, 40)
    squares = counts * rng.exponential(size=40)
    found, tenfold = (rms_estimate(scale**2 * squares, counts, 0) for scale in (1.0, 10.0))
    assert found.value == pytest.approx(math.sqrt(squares.sum() / counts.sum()))
    assert tenfold.ci == pytest.approx([10 * end for end in found.ci])
    drawn = rng.integers(40, size=(20000, 40))
    plain = np.quantile(np.sqrt(squares[drawn].sum(axis=1) / counts[drawn].sum(axis=1)), [0.025, 0.975])
    width = found.ci[1] - found.ci[0]
    assert found.ci == pytest.approx(plain, abs=0.2 * width)  # BCa moves the ends, a little
    same = rms_ratio((4.0 * squares, counts), (squares, counts), 0)
    assert (same["ratio"], same["ci"]) == (pytest.approx(2.0), pytest.approx([2.0, 2.0]))


def test_any_statistic_of_worlds_has_the_interval_of_the_mean():
    values = np.random.default_rng(0).exponential(size=30)
    found = statistics.of_worlds(lambda worlds: values[worlds].mean(axis=-1), 30, np.random.default_rng(1))
    assert found == statistics.mean(values[None], np.random.default_rng(1))


def test_phases_are_the_paper_s():
    """Five seconds each, ten of turn, at four scans a second; the second target ten seconds later."""
    loop = system(CASES[0])
    edges = [("driving in", 0, 20), ("braking", 20, 40), ("left turn", 40, 80), ("speeding up", 80, 100)]
    assert [tuple(phase) for phase in phases(loop, 0)] == [*edges, ("driving on", 100, 140)]
    assert [tuple(phase) for phase in phases(loop, 1)] == [(name, a + 40, b + 40) for name, a, b in edges]


def test_a_model_is_known_from_where_it_stays_above():
    """NCV of target 1 while it drives on, in three runs; one does not hold it at first."""
    mu = np.full((3, SCANS, 1, 4), 0.25)
    mu[:, 99:, 0, 0] = np.linspace(0.41, 0.81, 41)[None, :] + [[0.0], [0.05], [0.1]]
    mu[2, 99:110, 0] = np.nan
    reported = models(mu, system(CASES[0]), 0)[0][-1]
    assert (reported["phase"], reported["first"], reported["last"], reported["expected"]) == (
        "driving on",
        105,
        140,
        "NCV",
    )
    each = [np.nanmean(mu[:, k - 1, 0, 0]) for k in range(101, 141)]
    assert reported["least"]["mean"] == pytest.approx(each[4])
    assert reported["least"]["scan"] == 105
    assert reported["known_from"] == 101 + next(i for i, p in enumerate(each) if p > 0.8)
    by_run = [np.nanmean(mu[run, 104:140, 0, 0]) for run in range(3)]
    assert reported["mean"]["NCV"]["mean"] == pytest.approx(np.mean(by_run))
    flat = models(np.full((3, SCANS, 1, 4), 0.25), system(CASES[0]), 0)[0][-1]
    assert flat["known_from"] is None
    none = models(np.full((3, SCANS, 1, 4), np.nan), system(CASES[0]), 0)[0][-1]
    assert (none["least"]["mean"], none["least"]["scan"], none["mean"]["NCV"]["mean"]) == (None, None, None)


def test_figure_3_marks_the_tracks_that_the_metrics_call_false(urban_study):
    for loop in (CLOSED, OPEN):
        runs = urban_study.of(LOOSE, loop)
        far = no_target(system(Case(LOOSE, True, *loop)), runs.place[0])
        np.testing.assert_array_equal(far.sum(axis=1), runs.false[0])


def test_shares_of_all_scans_have_exact_intervals(urban_summary):
    """Myopic sends the long pulse whenever there is a track, in every run."""
    reported = urban_summary["settings"][STRICT]["systems"][GHOSTS[True]][CLOSED[0]][CLOSED[1]]["long"]
    exact = binomtest(RUNS, RUNS).proportion_ci(0.95, method="exact")
    assert reported == {"mean": 1.0, "ci": pytest.approx([exact.low, exact.high])}
