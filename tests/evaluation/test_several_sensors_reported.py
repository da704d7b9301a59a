"""What a comparison says of several sensors and several targets."""

from __future__ import annotations

import csv
import io

import gymnasium as gym
import numpy as np
import pytest
from two_sensors import TwoSensors

import wavegym
from wavegym.core import trees
from wavegym.evaluation import compare, summarise, world_seeds
from wavegym.evaluation.play import Task, play
from wavegym.evaluation.report import episodes
from wavegym.evaluation.table import markdown
from wavegym.schedulers import Fixed, Myopic, RoundRobin

ID = "tests/TwoSensors-v0"
SEEDS = world_seeds(0, "test", 12)
LABELS = TwoSensors().library.labels


@pytest.fixture(scope="module", autouse=True)
def registered():
    wavegym.register(ID, TwoSensors)
    yield
    gym.registry.pop(ID)


def task(**settings):
    return Task(ID, TwoSensors(**settings), None, settings)


def by_hand(system, policy):
    """Position errors and NEES (world, step, target), NaN = absent; lost at the end (world, target); actions."""
    worlds = trees.stack([system.draw_world(np.random.default_rng(gym.utils.seeding.np_random(s)[0])) for s in SEEDS])
    state = system.initial(worlds)
    policy.begin(system, len(SEEDS), np.random.default_rng(0))
    seen, actions = [], []
    for _ in range(system.horizon):
        actions.append(policy.act(state.belief, None, None))
        state = system.transition(state, actions[-1], worlds)
        seen.append(system.state_info(state))
    present = np.stack([figures["present"] for figures in seen], axis=1)
    errors, nees = (
        np.where(present, np.stack([figures[key] for figures in seen], axis=1), np.nan)
        for key in ("position_error", "nees")
    )
    return errors, nees, seen[-1]["lost"], np.stack(actions, axis=1)


@pytest.mark.parametrize("appears", [0, 3, 99])
def test_figures_are_means_over_the_targets_present(appears):
    system = TwoSensors(appears=appears)
    errors, nees, lost, _ = by_hand(system, Fixed(0))
    played = play(task(appears=appears), Fixed(0), SEEDS)
    assert np.isnan(errors[:, :, 1]).sum(axis=1).tolist() == [max(min(appears, 7) - 1, 0)] * len(SEEDS)
    np.testing.assert_allclose(played.rmse, np.sqrt(np.nanmean(errors**2, axis=(1, 2))), rtol=1e-13)
    np.testing.assert_allclose(played.nees, np.nanmean(nees, axis=(1, 2)), rtol=1e-13)
    first = np.sqrt((errors[:, :, 0] ** 2).mean(axis=1))
    np.testing.assert_allclose(played.target_rmse[:, 0], first, rtol=1e-13)
    assert np.isnan(played.target_rmse[:, 1]).all() == (appears == 99)
    np.testing.assert_array_equal(played.lost, lost.sum(axis=1))


@pytest.mark.parametrize("form", ["library", "joint"])
def test_choices_are_counted_for_each_sensor(form):
    system = TwoSensors(action=form)
    actions = by_hand(system, Myopic())[-1]
    indices = system.actions.indices[actions] if form == "joint" else actions  # (world, step, sensor)
    count = len(system.actions.library)
    want = [[np.bincount(world[:, s], minlength=count) for s in range(2)] for world in indices]
    played = play(task(action=form), Myopic(), SEEDS)
    assert played.chosen.shape == (len(SEEDS), 2, count)
    np.testing.assert_array_equal(played.chosen, want)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("form", ["library", "joint"])
def test_episodes_and_summary_name_the_waveforms_of_each_sensor(form):
    comparison = compare(ID, {"round-robin": None, "fixed:1": None}, worlds=60, jobs=1, action=form)
    rows = list(csv.DictReader(io.StringIO(episodes(comparison))))
    assert list(rows[0])[10:] == [
        *(
            "lost",
            "collisions",
            "share",
            "outside",
            "rmse_1",
            "rmse_2",
            "favourite_1",
            "favourite_share_1",
            "favourite_2",
            "favourite_share_2",
        )
    ]
    fixed = [row for row in rows if row["policy"] == "fixed:1"]
    assert len(fixed) == 60
    assert {(row["favourite_1"], row["favourite_share_2"]) for row in fixed} == {(LABELS[1], "1.0")}
    policies = summarise(comparison)["policies"]
    used = LABELS[:2] if form == "joint" else LABELS
    assert policies["fixed:1"]["choices"] == [{LABELS[1]: 1.0}] * 2
    assert policies["round-robin"]["choices"] == [pytest.approx(dict.fromkeys(used, 1 / len(used)))] * 2
    for shares in policies["myopic"]["choices"]:
        assert sum(shares.values()) == pytest.approx(1.0)
        assert list(shares.values()) == sorted(shares.values(), reverse=True)
    figures = policies["fixed:1"]
    assert figures["rmse"]["targets"] == pytest.approx(
        [np.mean([float(row[key]) for row in fixed]) for key in ("rmse_1", "rmse_2")]
    )
    assert figures["lost"] == pytest.approx(np.mean([float(row["lost"]) for row in fixed]))
    text = markdown(summarise(comparison))
    assert all(f" {heading} |" in text for heading in ("RMS error m", "NEES", "lost"))


def test_a_target_that_never_appears_is_empty_and_null():
    comparison = compare(ID, {}, worlds=3, jobs=1, appears=99)
    row = next(csv.DictReader(io.StringIO(episodes(comparison))))
    assert float(row["rmse"]) == float(row["rmse_1"])
    assert row["rmse_2"] == ""
    assert summarise(comparison)["policies"]["myopic"]["rmse"]["targets"][1] is None


def test_a_box_of_several_sensors_has_no_favourites():
    comparison = compare(ID, {"round-robin": None}, worlds=3, jobs=1, action="box")
    row = next(csv.DictReader(io.StringIO(episodes(comparison))))
    assert (row["favourite"], row["favourite_share"]) == ("", "")
    assert "choices" not in summarise(comparison)["policies"]["myopic"]


def test_round_robin_through_the_shell_is_that_without_it():
    errors, *_ = by_hand(TwoSensors(), RoundRobin())
    played = play(task(), RoundRobin(), SEEDS)
    np.testing.assert_allclose(played.rmse, np.sqrt(np.nanmean(errors**2, axis=(1, 2))), rtol=1e-13)


def test_a_figure_of_all_targets_together_counts_where_any_is_present():
    class Together(TwoSensors):
        def state_info(self, state):
            present = np.repeat(state.belief.step[:, None] >= 3, 2, axis=1)
            return {"nees": np.where(present[:, 0], state.belief.step.astype(float), 0.0), "present": present}

    played = play(Task(ID, Together(), None, {}), Fixed(0), SEEDS)
    np.testing.assert_array_equal(played.nees, np.full(len(SEEDS), (3 + 4 + 5 + 6) / 4))
