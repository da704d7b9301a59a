"""Rewards: how each one follows from the cost, and that a user's own reward can be injected."""

import dataclasses

import numpy as np
import pytest
from small_systems import Burner

from wavegym.core import shortcuts
from wavegym.core.errors import InputError
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.envs import LogCost, Relative, Scaled, WaveformEnv, WaveformVectorEnv
from wavegym.envs.rewards import ShapedCost
from wavegym.schedulers import Fixed, Lookahead, Myopic, RandomChoice, RoundRobin
from wavegym.schedulers.registry import make_policy
from wavegym.schedulers.tuning import log_cost
from wavegym.systems.kershaw_evans.system import KershawEvansPosition
from wavegym.systems.multifunction_radar.system import MultifunctionRadar
from wavegym.systems.sector_setup.system import SectorSetup

SYSTEM = KershawEvansPosition(horizon=12)
NUM_ENVS = 4


def play(reward, policy, steps=12, mode="Disabled"):
    """Rewards (step, env) and infos of one episode."""
    env = WaveformVectorEnv(SYSTEM, NUM_ENVS, reward=reward, autoreset_mode=mode)
    env.reset(seed=3)
    policy.begin(SYSTEM, NUM_ENVS, np.random.default_rng(0))
    rewards, infos = [], []
    for _ in range(steps):
        _, reward_now, _, _, info = env.step(policy.act(env.belief, None, None))
        rewards.append(reward_now)
        infos.append(info)
    return np.array(rewards), infos


def costs_of(policy):
    return np.array([info["cost"] for info in play("cost", policy)[1]])


def stepped(system, **given):
    """Rewards, costs and P's first element of each step of one episode, (step, env) each."""
    env = WaveformVectorEnv(system, NUM_ENVS, **given)
    env.reset(seed=3)
    found = []
    for action in range(12):
        _, reward, _, _, info = env.step(np.full(NUM_ENVS, action))
        found.append((reward, info["cost"], env.belief.covariance[:, 0, 0]))
    return np.array(found).swapaxes(0, 1)


@pytest.mark.parametrize("given", [{}, {"reward": "cost"}, {"reward": "trace"}])
def test_where_no_track_is_lost_the_reward_is_minus_the_weighted_trace_of_the_covariance_exactly(given):
    reward, cost, trace = stepped(SYSTEM, **given)
    assert (reward == -trace).all()
    assert (reward == -cost).all()


def test_a_scaled_reward_is_the_cost_over_one_number_for_the_class():
    """The geometric mean cost of myopic on tuning worlds, to the four digits of the record, for any parameters."""
    default = KershawEvansPosition()
    scale = np.exp(log_cost(default, Myopic(), draw_worlds(default, world_seeds(0, "tune", 100))))
    for system in (SYSTEM, Doubted(horizon=12, q=3.0)):
        reward, cost, _ = stepped(system, reward="scaled")
        np.testing.assert_allclose(reward, -cost / scale, rtol=1e-3)
        assert np.ptp(reward / cost) < 1e-12
    reward, cost, _ = stepped(SYSTEM, reward=Scaled(3.0))
    np.testing.assert_array_equal(reward, -cost / 3.0)


def test_a_scaled_reward_needs_a_number():
    with pytest.raises(InputError, match=r"reward is 'scaled', expected 'cost' \(nearest\), .* Burner has no cost"):
        WaveformVectorEnv(Burner(), 2, reward="scaled").reset(seed=0)
    with pytest.raises(InputError, match=r"scale is 0.0, expected a finite number > 0"):
        Scaled(0.0)


class Doubted(KershawEvansPosition):
    """A track that exists with the probability 0.75; without it a target costs 1000 m^2."""

    def cost(self, belief):
        return 0.75 * np.minimum(super().cost(belief), 1000.0) + 0.25 * 1000.0

    def trace(self, belief):
        return super().cost(belief)


@pytest.mark.parametrize(
    ("name", "want"),
    [
        ("cost", lambda cost, trace: -cost),
        ("log-cost", lambda cost, trace: -np.log(cost)),
        ("trace", lambda _, trace: -trace),
    ],
)
def test_trace_does_not_follow_a_cost_that_counts_lost_tracks(name, want):
    reward, cost, trace = stepped(Doubted(horizon=12), reward=name)
    assert (cost > 250.0).all()
    assert (cost != trace).all()
    assert (reward == want(cost, trace)).all()


def test_by_default_the_reward_is_minus_the_cost_whatever_it_is():
    reward, cost, _ = stepped(Doubted(horizon=12))
    assert (reward == -cost).all()


class WithGospa(KershawEvansPosition):
    def state_info(self, state):
        figures = super().state_info(state)
        return {**figures, "gospa": np.minimum(figures["position_error"], 20.0)}


def test_gospa_is_minus_the_squared_distance_that_the_system_reports():
    env = WaveformVectorEnv(WithGospa(horizon=12), NUM_ENVS, reward="gospa")
    env.reset(seed=3)
    for _ in range(5):
        _, reward, _, _, info = env.step(np.full(NUM_ENVS, 20))
        assert (reward == -(info["gospa"] ** 2)).all()


def test_error_is_minus_the_squared_true_position_error():
    env = WaveformVectorEnv(SYSTEM, NUM_ENVS, reward="error")
    env.reset(seed=3)
    for _ in range(5):
        _, reward, _, _, info = env.step(np.full(NUM_ENVS, 20))
        state = env.episodes.state
        np.testing.assert_allclose(reward, -((state.belief.mean[:, 0] - state.truth.targets[:, 0]) ** 2), rtol=1e-12)
        assert (info["cost"] == state.belief.covariance[:, 0, 0]).all()  # what is reported does not follow the reward


@pytest.mark.parametrize("form", ["share", "log", "difference", "scaled"])
@pytest.mark.parametrize("reference", [Myopic(), Fixed(3)], ids=["myopic", "fixed"])
def test_relative_compares_with_the_references_own_trajectory_on_the_same_worlds(form, reference):
    policy = Lookahead(2)
    rewards, infos = play(Relative(reference, form), policy)
    ours, theirs = costs_of(policy), costs_of(reference)
    want = {
        "share": 1 - ours / theirs,
        "log": np.log(theirs / ours),
        "difference": (theirs - ours) / theirs.mean(axis=0),
        "scaled": 1 - ours / theirs.mean(axis=0),
    }
    np.testing.assert_allclose(rewards, want[form], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose([info["reference_cost"] for info in infos], theirs, rtol=1e-12)


def test_the_reference_scores_nothing_against_itself():
    for form in ("share", "log", "difference"):
        rewards, _ = play(Relative(Myopic(), form), Myopic())
        assert (rewards == 0.0).all()


def test_by_name_relative_is_the_difference_to_the_one_step_scheduler_whose_sum_ranks_as_the_cost():
    rewards, _ = play("relative", RandomChoice())
    ours, theirs = costs_of(RandomChoice()), costs_of(Myopic())
    np.testing.assert_allclose(rewards.sum(axis=0), 12 * (1 - ours.sum(axis=0) / theirs.sum(axis=0)), rtol=1e-9)


def test_the_reference_follows_each_world_through_resets():
    env = WaveformVectorEnv(SYSTEM, NUM_ENVS, reward="relative", autoreset_mode="SameStep")
    env.reset(seed=3)
    myopic = Myopic()
    myopic.begin(SYSTEM, NUM_ENVS, np.random.default_rng(0))
    for step in range(40):
        if step in (3, 9):
            env.reset(options={"reset_mask": np.array([True, False, step == 3, False])})
        assert (env.step(myopic.act(env.belief, None, None))[1] == 0.0).all()


class Smoothness(LogCost):
    """A reward of one's own: the cost's decrease, with a term of its own in info, and memory of the world."""

    def begin(self, system, world):
        return None

    def __call__(self, transition):
        before = transition.system.cost(transition.previous.belief)
        return before - transition.cost, {"cost_before": before}


def test_a_reward_of_ones_own_with_its_terms_in_info():
    rewards, infos = play(Smoothness(), Fixed(3))
    costs = np.array([info["cost"] for info in infos])
    np.testing.assert_allclose(rewards[1:], costs[:-1] - costs[1:], rtol=1e-12)
    assert (infos[5]["cost_before"] == costs[4]).all()
    single = WaveformEnv(SYSTEM, reward=Smoothness())
    single.reset(seed=3)
    assert single.step(3)[1] == rewards[0, 0]


@pytest.mark.parametrize(
    ("reward", "message"),
    [
        ("relativ", "did you mean 'relative'"),
        (3, "expected one of cost, cost-in-targets, shaped-cost"),
        (print, "an object with begin"),
    ],
)
def test_an_unknown_reward_is_refused(reward, message):
    with pytest.raises(InputError, match=message):
        WaveformVectorEnv(SYSTEM, 1, reward=reward)
    with pytest.raises(InputError, match="did you mean 'share'"):
        Relative(form="shares")


@pytest.mark.parametrize("form", ["share", "log", "difference", "scaled"])
def test_after_its_own_early_end_the_reference_is_held_at_its_last_cost(form):
    env = WaveformVectorEnv(Burner(), 6, reward=Relative(RoundRobin(), form), autoreset_mode="Disabled")
    env.reset(seed=0)
    # Round robin burns 1, 2 and 3 units of 6; of 5 it burns 1, 2, then 1 since 2 are left, and 1 more.
    costs = {5: [1, 1 / 2, 1, 1, 1], 6: [1, 1 / 2, 1 / 3, 1 / 3, 1 / 3]}
    means = {5: (1 + 1 / 2 + 1 + 1) / 4, 6: (1 + 1 / 2 + 1 / 3) / 3}
    fuel = env.belief.left.tolist()
    assert set(fuel) == {5, 6}
    for k in range(5):
        _, reward, _, _, info = env.step(np.zeros(6, np.int64))  # whose cost is 1
        reference, mean = np.array([costs[f][k] for f in fuel]), np.array([means[f] for f in fuel])
        np.testing.assert_allclose(info["reference_cost"], reference, rtol=1e-12)
        want = {
            "share": 1 - 1 / reference,
            "log": np.log(reference),
            "difference": (reference - 1) / mean,
            "scaled": 1 - 1 / mean,
        }
        np.testing.assert_allclose(reward, want[form], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(
    ("name", "form"),
    [("relative", "difference"), ("relative-log", "log"), ("relative-share", "share"), ("relative-scaled", "scaled")],
)
def test_a_name_says_the_form_and_the_rule_whose_constants_are_recorded(name, form):
    system = SectorSetup()
    given = Relative(make_policy("best-simple", system, None), form)
    envs = [WaveformVectorEnv(system, 3, reward=reward) for reward in (f"{name}:best-simple", given, name)]
    for env in envs:
        env.reset(seed=1)
    rewards = [[env.step(np.array([k % 8, 0, 5]))[1] for k in range(9)] for env in envs]
    assert np.array_equal(rewards[0], rewards[1])
    assert not np.array_equal(rewards[0], rewards[2])  # which is relative to the one-step scheduler


@pytest.mark.parametrize(
    ("system", "name", "message"),
    [
        (SectorSetup(), "best-simpel", "reference policy is 'best-simpel', .*did you mean 'best-simple'"),
        (SectorSetup(horizon=30), "best-simple", "relative to 'best-simple', expected a system at its defaults"),
        (
            SectorSetup(),
            "lagrangian-price",
            "relative to 'lagrangian-price', expected a system at its defaults with such a record",
        ),
    ],
)
def test_a_rule_without_recorded_constants_is_refused(system, name, message):
    with pytest.raises(InputError, match=message):
        WaveformVectorEnv(system, 2, reward=f"relative:{name}").reset(seed=0)


@pytest.mark.parametrize(
    ("system", "reward", "metric", "nearest"),
    [
        (Burner(), "error", "position_error", "cost"),
        (Burner(), "gospa", "gospa", "cost"),
        (SYSTEM, "gospa", "gospa", "error"),
    ],
)
def test_a_reward_by_truth_needs_its_metric(system, reward, metric, nearest):
    message = rf"reward is '{reward}', expected a system with the metric '{metric}', .*\(nearest: '{nearest}'\)"
    with pytest.raises(InputError, match=message):
        WaveformVectorEnv(system, 2, reward=reward).reset(seed=0)


def test_a_cost_in_targets_is_the_cost_over_c0_where_there_is_one():
    envs = WaveformVectorEnv(MultifunctionRadar, 3, reward="cost-in-targets", slots=8, c0=1e5)
    envs.reset(seed=0)
    _, reward, _, _, info = envs.step(np.array([0, 40, len(envs.system.actions) - 1]))
    np.testing.assert_allclose(reward, -info["cost"] / 1e5, rtol=1e-12)
    other = WaveformVectorEnv(KershawEvansPosition, 2, reward="cost-in-targets")
    with pytest.raises(
        InputError, match=r"reward is 'cost-in-targets', expected 'cost' \(nearest\): .* has no parameter c0"
    ):
        other.reset(seed=0)


def test_where_steps_differ_in_length_no_reward_is_relative():
    envs = WaveformVectorEnv(MultifunctionRadar, 2, reward="relative")
    with pytest.raises(
        InputError, match=r"reward is relative, expected 'cost' \(nearest\): the steps differ in length"
    ):
        envs.reset(seed=0)


def test_the_shaped_cost_has_the_cost_to_come_as_its_potential():
    """Rewards sum up to the cost, except for the ends; the potential is the cost of a long wait, and that of targets to
    be found.
    """
    envs = WaveformVectorEnv(MultifunctionRadar, 3, reward="shaped-cost", slots=12, targets=5.0)
    envs.reset(seed=2)
    first, total, cost = shortcuts.cost_to_come(envs.system, envs.belief, ShapedCost.SECONDS), np.zeros(3), np.zeros(3)
    rule = envs.policy("round-robin")
    for _ in range(60):
        _, rewards, _, _, info = envs.step(rule())
        total, cost = total + rewards, cost + info["cost"]
    last = shortcuts.cost_to_come(envs.system, envs.belief, ShapedCost.SECONDS)
    np.testing.assert_allclose(total, -(cost + last - first) / envs.system.c0, rtol=1e-9)
    resting = dataclasses.replace(envs.system, targets=0.0, dt=ShapedCost.SECONDS)
    alone = envs.belief._replace(undetected=np.zeros_like(envs.belief.undetected))
    waits = np.full(3, len(resting.actions) - 1)
    np.testing.assert_allclose(
        shortcuts.cost_to_come(resting, alone, ShapedCost.SECONDS),
        resting.cost(resting.predict(alone, waits)),
        rtol=1e-12,
    )
    nobody = envs.belief._replace(existence=np.zeros_like(envs.belief.existence))
    want = resting.c0 * (nobody.undetected * 0.5 * resting.value_of_find**0.75).sum(axis=(1, 2, 3))
    np.testing.assert_allclose(shortcuts.cost_to_come(resting, nobody, ShapedCost.SECONDS), want, rtol=1e-12)
    with pytest.raises(InputError, match="of KershawEvansPosition, it has no cost_to_come"):
        WaveformVectorEnv(KershawEvansPosition, 2, reward="shaped-cost").reset(seed=0)
