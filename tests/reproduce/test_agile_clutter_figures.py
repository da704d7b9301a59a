"""The agile chirps' runs, and every kind of number against direct computation from them."""

from __future__ import annotations

import numpy as np
import pytest

from wavegym.errors import InputError
from wavegym.evaluation.worlds import draw_worlds, world_seeds
from wavegym.reproduce import agile_clutter
from wavegym.reproduce.agile_clutter import AGILE, BEST_FIXED, FULL, LAWS, POLICIES, Case, Runs, laws, play, scene
from wavegym.reproduce.agile_clutter_numbers import curve, shares, summarise, typical
from wavegym.schedulers import Fixed, Progressive, rollout
from wavegym.schedulers.tuning import best_fixed

RUNS, SEED = 8, 3


@pytest.fixture(scope="module")
def study():
    return play(("jpda",), runs=RUNS, root=SEED, jobs=1, tuning=2)


@pytest.fixture(scope="module")
def summary(study):
    return summarise(study)


def test_every_policy_meets_the_same_worlds_in_every_setting(study):
    assert list(study.runs) == [Case("jpda", c, p) for c in ("clutter", "no clutter") for p in POLICIES]
    start = {tuple(draw_worlds(scene(case), world_seeds(SEED, "test", 2)).error.ravel()) for case in study.runs}
    assert len(start) == 1
    for runs in study.runs.values():
        assert runs.squared_error.shape == (RUNS, 32, 2)
        assert (np.isnan(runs.squared_error) == np.isnan(runs.squared_error[0])).all()
    present = ~np.isnan(runs.squared_error[0])
    assert [np.flatnonzero(column)[[0, -1]].tolist() for column in present.T] == [[0, 24], [7, 31]]


@pytest.mark.parametrize("clutter", ["clutter", "no clutter"])
@pytest.mark.parametrize("policy", [FULL, "agile LFM", BEST_FIXED])
def test_runs_are_those_of_the_system(study, clutter, policy):
    """Against ``rollout``, and its actions replayed."""
    case = Case("jpda", clutter, policy)
    system, runs = scene(case), study.runs[case]
    worlds = draw_worlds(system, world_seeds(SEED, "test", RUNS))
    played = rollout(system, Fixed(study.fixed["jpda", clutter][0]) if policy == BEST_FIXED else Progressive(), worlds)
    assert (played.cost == runs.cost).all()
    state, points = system.begin(worlds), 0.0
    for k in range(system.horizon):
        state = system.advance(state, played.actions[:, k], worlds)
        error = state.public.mean - state.hidden.truth
        shown = ~np.isnan(runs.squared_error[0, k])
        np.testing.assert_allclose(runs.squared_error[:, k, shown], np.square(error[:, shown]).sum(axis=2), rtol=1e-12)
        points += system.metrics(state)["clutter"]
    assert (runs.lost == (state.hidden.outside > 5)).all()
    assert (runs.clutter.sum(axis=1) == points).all()
    assert (points.sum() == 0) == (clutter == "no clutter")


def test_laws_are_those_transmitted():
    library = scene(Case("jpda", "clutter", BEST_FIXED))
    prefix = {"LFM": 0, "PFM3": 1, "HFM": 2, "EFM": 3}
    actions = np.arange(len(library.menu.library))[:, None].repeat(2, axis=1)
    want = [prefix[label.split()[0]] for label in library.menu.library.labels]
    assert laws(library, actions).tolist() == [[law, law] for law in want]
    full = scene(Case("jpda", "clutter", FULL))
    chosen = np.array([[i, j] for i in range(4) for j in range(4)])
    actions = full.menu.encode_chirps(chosen, np.full((16, 2), 2e-5), np.full((16, 2), -3e6))
    assert (laws(full, actions) == chosen).all()
    for name, allowed in AGILE.items():
        if name != FULL:
            restricted = scene(Case("jpda", "clutter", name))
            assert laws(restricted, np.zeros((5, 4))).tolist() == [[LAWS.index(allowed[0])] * 2] * 5


def test_the_best_constant_is_tuned_on_worlds_of_its_own(study):
    for (tracker, clutter), (index, waveforms) in study.fixed.items():
        system = scene(Case(tracker, clutter, BEST_FIXED))
        assert index == best_fixed(system, draw_worlds(system, world_seeds(SEED, "tune", 2)))
        assert list(waveforms) == [system.menu.library.labels[i] for i in system.constants()[index]]


def test_the_numbers_are_those_of_the_runs(study, summary):
    assert (summary["runs"], summary["seed"]) == (RUNS, SEED)
    assert summary["command"].endswith("agile_clutter --runs 8 --tracker jpda --seed 3")
    for clutter, setting in summary["trackers"]["jpda"].items():
        played = study.of("jpda", clutter)
        total = {name: np.nansum(runs.squared_error, axis=(1, 2)) for name, runs in played.items()}
        kept = {name: ~runs.lost.any(axis=1) for name, runs in played.items()}
        for name, policy in setting["policies"].items():
            both = kept[name] & kept[FULL]
            assert policy["kept"]["mean"] == pytest.approx(kept[name].mean())
            assert policy["mse_kept"]["mean"] == pytest.approx(total[name][kept[name]].mean())
            assert policy["mse_kept"]["runs"] == kept[name].sum()
            assert policy["mse_all"]["mean"] == pytest.approx(total[name].mean())
            assert policy["mse_all"]["median"] == pytest.approx(np.median(total[name]))
            ratio = policy["ratio_kept"]
            assert ratio["ratio"] == pytest.approx(total[name][both].mean() / total[FULL][both].mean())
            logs = np.log(total[name][both] / total[FULL][both])
            assert ratio["geometric"] == pytest.approx(np.exp(logs.mean()))
            assert ratio["ci"][0] <= ratio["ratio"] * (1 + 1e-9)
            assert ratio["ratio"] <= ratio["ci"][1] * (1 + 1e-9)
            assert policy["ratio_all"]["ratio"] == pytest.approx(total[name].mean() / total[FULL].mean())
        assert setting["policies"][FULL]["ratio_all"]["ci"] == [1.0, 1.0]


def test_jump_drop_and_shares_are_of_the_kept_runs(study, summary):
    for clutter, setting in summary["trackers"]["jpda"].items():
        full = study.of("jpda", clutter)[FULL]
        kept = ~full.lost.any(axis=1)
        mse = np.nansum(full.squared_error[kept], axis=2).mean(axis=0)
        np.testing.assert_allclose([e.value for e in curve(study, full)], mse, rtol=1e-12)
        assert setting["jump"]["ratio"] == pytest.approx(mse[7] / mse[6])
        assert setting["drop"]["ratio"] == pytest.approx(mse[25] / mse[24])
        for i, law in enumerate(LAWS):
            chosen = full.law[kept] == i
            np.testing.assert_allclose(shares(full)[..., i], chosen.mean(axis=0), atol=1e-15)
            assert setting["laws"]["all"][law]["mean"] == pytest.approx(chosen.mean())
            assert setting["laws"]["8"][law]["mean"] == pytest.approx(chosen[:, 7].mean())
            assert setting["laws"]["20-25"][law]["mean"] == pytest.approx(chosen[:, 19:25].mean())


def made(law, lost):
    count, steps, _ = np.shape(law)
    zeros = np.zeros((count, steps))
    return Runs(np.zeros((count, steps, 2)), zeros, np.array(law), zeros, np.array(lost))


def test_the_typical_run_is_the_kept_one_most_like_the_others():
    law = [[[3, 3]] * 2, [[3, 3]] * 2, [[1, 1], [2, 2]], [[1, 1], [2, 1]], [[1, 2], [2, 1]]]
    lost = [[True, False], [False, True], [False, False], [False, False], [False, False]]
    assert typical(made(law, lost)).tolist() == [[1, 1], [2, 1]]


def test_where_no_run_is_kept_there_is_nothing_to_tell(study):
    runs = made(np.zeros((3, 32, 2), int), np.ones((3, 2), bool))
    assert np.isnan(shares(runs)).all()
    assert (typical(runs) == -1).all()
    nothing = agile_clutter.Study(0, dict.fromkeys(study.runs, runs), study.fixed)
    assert all(estimate == (None, None) for estimate in curve(nothing, runs))
    policy = summarise(nothing)["trackers"]["jpda"]["clutter"]["policies"][FULL]
    assert policy["mse_kept"] == {"mean": None, "ci": None, "median": None, "runs": 0}
    assert policy["ratio_kept"]["ratio"] is None


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"runs": 0}, "runs is 0"),
        ({"jobs": 0}, "jobs is 0"),
        ({"root": -1}, "seed is -1"),
        ({"tuning": 0}, "tuning is 0"),
        ({"trackers": ("kalman",)}, "tracker is 'kalman'"),
    ],
)
def test_mistakes_are_told_before_anything_is_played(monkeypatch, settings, words):
    monkeypatch.setattr(agile_clutter, "_play", None)
    with pytest.raises(InputError, match=words):
        play(**settings)
