from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from evaluation_systems import Measured, Uneven

from wavegym.core.traits import UnequalSteps
from wavegym.evaluation import draw_worlds, make_task, world_seeds
from wavegym.evaluation.play import Task, merged, play
from wavegym.schedulers import Fixed, Lookahead, Myopic, RandomChoice, RoundRobin, rollout

SEEDS = world_seeds(0, "test", 40)
UNEVEN = Task("tests/Uneven-v0", Uneven(), None, {})
WORLDS = draw_worlds(Uneven(), SEEDS)


def test_only_the_first_episode_of_each_world_counts():
    assert len(set(WORLDS.length)) > 5  # ends at different times
    played = play(UNEVEN, Fixed(1), SEEDS)
    np.testing.assert_array_equal(played.steps, WORLDS.length)
    past = np.arange(9) >= WORLDS.length[:, None]
    np.testing.assert_array_equal(played.cost, np.where(past, np.nan, 2.0 * WORLDS.level[:, None]))
    np.testing.assert_allclose(played.episode_cost(), 2.0 * WORLDS.level, rtol=1e-15)
    np.testing.assert_array_equal(played.chosen[:, 0], WORLDS.length[:, None] * [0, 1, 0])


def test_a_policy_chooses_for_each_world_by_its_own_step():
    played = play(UNEVEN, RoundRobin(), SEEDS)
    turns = np.arange(9)
    want = [np.bincount(turns[:length] % 3, minlength=3) for length in WORLDS.length]
    np.testing.assert_array_equal(played.chosen[:, 0], want)


def test_metrics_are_means_over_steps_and_targets_and_losses_those_of_the_end():
    played = play(Task("tests/Measured-v0", Measured(), None, {}), Fixed(0), SEEDS)
    steps = [np.arange(1, length + 1.0) for length in WORLDS.length]
    np.testing.assert_allclose(played.rmse, [np.sqrt(np.mean([s**2, (7 * s) ** 2])) for s in steps], rtol=1e-14)
    np.testing.assert_allclose(played.believed_rmse, 0.5 * played.rmse, rtol=1e-14)
    np.testing.assert_allclose(played.gospa, [np.sqrt(np.mean(s**2)) for s in steps], rtol=1e-14)
    np.testing.assert_allclose(played.nees, [4 * s.mean() for s in steps], rtol=1e-14)
    running = np.arange(9) < WORLDS.length[:, None]
    np.testing.assert_array_equal(played.nees_count, 2 * running)
    np.testing.assert_array_equal(played.nees_sum, np.where(running, 8.0 * np.arange(1, 10), 0.0))
    np.testing.assert_array_equal(played.lost, 1 + (WORLDS.length >= 3))


class Slowing(Measured, UnequalSteps):
    """Steps of 1, 2, 3, ... seconds."""

    def duration(self, belief):
        return 1.0 * belief.step


def test_where_steps_differ_in_length_means_are_over_seconds():
    played = play(Task("x", Slowing(), None, {}), Fixed(1), SEEDS)
    seconds = [np.arange(1, length + 1.0) for length in WORLDS.length]  # of each step, and the GOSPA distance in it
    mean_square = np.array([np.sum(s * s**2) / s.sum() for s in seconds])
    np.testing.assert_allclose(played.gospa**2, mean_square, rtol=1e-14)
    np.testing.assert_allclose(played.target_rmse**2, mean_square[:, None] * [1, 49], rtol=1e-14)
    np.testing.assert_allclose(played.rmse**2, 25 * mean_square, rtol=1e-14)
    want = [2.0 * level * len(s) / s.sum() for level, s in zip(WORLDS.level, seconds, strict=True)]
    np.testing.assert_allclose(played.episode_cost(), want, rtol=1e-14)


def test_metrics_that_a_system_lacks_are_not_numbers():
    played = play(UNEVEN, Fixed(0), SEEDS[:3])
    metrics = played.rmse, played.believed_rmse, played.gospa, played.nees, played.lost
    assert all(np.isnan(metric).all() for metric in metrics)


def test_a_cost_that_is_not_a_number_stays_visible():
    class Diverging(Uneven):
        def cost(self, belief):
            return np.where(belief.step == 1, np.nan, super().cost(belief))

    assert np.isnan(play(Task("x", Diverging(), None, {}), Fixed(0), SEEDS[:3]).episode_cost()).all()


@pytest.mark.parametrize("policy", [Myopic(), Lookahead(2), Fixed(3), RoundRobin()])
def test_through_the_shell_as_without_it(policy):
    task = make_task("KershawEvansPosition-v0", {"horizon": 7})
    direct = rollout(task.system, policy, draw_worlds(task.system, SEEDS))
    played = play(task, policy, SEEDS)
    np.testing.assert_array_equal(played.cost, direct.cost)
    count = len(task.system.candidates())
    np.testing.assert_array_equal(played.chosen[:, 0], [np.bincount(row, minlength=count) for row in direct.actions])


def test_rmse_and_nees_are_those_of_single_episodes():
    task = make_task("KershawEvans-v0", {"horizon": 6})
    played = play(task, Fixed(5), SEEDS[:3])
    env = gym.make("wavegym/KershawEvans-v0", horizon=6)
    for world, seed in enumerate(SEEDS[:3]):
        env.reset(seed=seed)
        infos = [env.step(5)[4] for _ in range(6)]
        rms = np.sqrt(np.mean([info["position_error"] ** 2 for info in infos]))
        np.testing.assert_allclose(played.rmse[world], rms, rtol=1e-13)
        np.testing.assert_allclose(played.nees[world], np.mean([info["nees"] for info in infos]), rtol=1e-13)


def test_a_box_of_parameters_has_no_counts():
    played = play(make_task("KershawEvans-v0", {"horizon": 3, "action": "box"}), Myopic(), SEEDS[:2])
    assert played.chosen.shape == (2, 0, 0)
    assert np.isfinite(played.cost).all()


def test_the_share_of_decisions_outside_the_training_is_of_each_worlds_own():
    """Outside in the first two decisions; every world is as long as its own episode."""

    class Lost(Fixed):
        def act(self, belief, observation, mask):
            self.outside = belief.step < 2
            return super().act(belief, observation, mask)

        def is_outside_training(self):
            return self.outside

    played = play(UNEVEN, Lost(0), SEEDS)
    np.testing.assert_allclose(played.outside, np.minimum(2, WORLDS.length) / WORLDS.length, rtol=1e-15)


def test_a_time_limit_truncates():
    played = play(Task("x", Uneven(), 4, {}), Fixed(0), SEEDS)
    np.testing.assert_array_equal(played.steps, np.minimum(WORLDS.length, 4))


def test_chance_follows_from_the_worlds_alone():
    policy = RandomChoice()
    first, again = play(UNEVEN, policy, SEEDS), play(UNEVEN, policy, SEEDS)
    np.testing.assert_array_equal(first.chosen, again.chosen)
    assert (first.chosen.sum(axis=0) > 0.2 * first.steps.sum()).all()  # each of 3 expected 0.33 of some 200, sd 0.033


def test_a_clairvoyant_policy_is_shown_the_tapes_once():
    class Clairvoyant(Fixed):
        shown: list = []

        def reveal(self, world):
            self.shown.append(world.level.copy())

    play(UNEVEN, Clairvoyant(0), SEEDS)
    assert len(Clairvoyant.shown) == 1
    np.testing.assert_array_equal(Clairvoyant.shown[0], WORLDS.level)


def test_chunks_of_different_length_become_one_account():
    parts = [play(UNEVEN, Fixed(1), SEEDS[:1]), play(UNEVEN, Fixed(1), SEEDS[1:])]
    whole = play(UNEVEN, Fixed(1), SEEDS)
    for one, other in zip(merged(parts)[:-1], whole[:-1], strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_time_of_a_decision_is_shared_by_the_running_worlds_and_the_environment_is_not_counted(monkeypatch):
    clock = [0.0]
    monkeypatch.setattr("wavegym.evaluation.play.perf_counter", lambda: clock[0])

    class Deciding(Fixed):
        def act(self, belief, observation, mask):
            clock[0] += 3.0
            return super().act(belief, observation, mask)

    class Moving(Uneven):
        def transition(self, state, action, world):
            clock[0] += 100.0
            return super().transition(state, action, world)

    played = play(Task("x", Moving(), None, {}), Deciding(0), SEEDS)
    running = [(WORLDS.length > step).sum() for step in range(9)]
    want = [sum(3.0 / running[step] for step in range(length)) for length in WORLDS.length]
    np.testing.assert_allclose(played.seconds, want, rtol=1e-12)
