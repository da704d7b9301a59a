"""Platforms that turn: the look direction as a part of the action."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import gymnasium as gym
import numpy as np
import oracles
import pytest

from wavegym.core import shortcuts, trees
from wavegym.sensors import platform_measurement
from wavegym.systems.rf_eo.system import RfEo, RfEoFar

FORMS = ("box", "library", "joint")
SLEW = 0.3
NARROW = {"pixel_angle": (1e-5, 4e-4), "points": (2, 1, 2), "turns": 3, "slew_rate": SLEW}  # images of up to 0.4 rad
PASSING = ((-1500.0, 60.0, 800.0, 0.0),)  # passes a platform at the origin, from 62 degrees left to 62 degrees right
ONE = {"platforms": ((0.0, 0.0),), "starts": PASSING, "first_estimate": "drawn", "prior_variance": (1e3, 25.0) * 2}


def crossing(**settings):
    """One platform with a narrow image, and a target that passes it from left to right."""
    return RfEo(**{"horizon": 50, "action": "library", **ONE, **NARROW, **settings})


def met(system, worlds, choose):
    """(state before, action, state after) of every step."""
    state = system.initial(worlds)
    for _ in range(system.horizon):
        action = choose(state.belief)
        before, state = state, system.transition(state, action, worlds)
        yield before, action, state


@pytest.mark.parametrize(
    "system",
    [RfEo(horizon=6, slew_rate=SLEW), RfEo(horizon=6, slew_rate=9.0, margin=1.0), RfEoFar(horizon=6, slew_rate=SLEW)],
)
def test_a_step_is_that_of_fixed_platforms_that_look_there(system):
    """Transition, prediction and information against a system without turns, whose looks are those after the turn."""
    rng, worlds = np.random.default_rng(1), oracles.worlds(system, 1)
    for before, action, after in met(system, worlds, lambda _: rng.uniform(-1, 1, (1, len(system.actions)))):
        *settings, turn = np.moveaxis(system.action_set.settings(action), -1, 0)
        looks = np.angle(np.exp(1j * (before.belief.looks + turn)))
        np.testing.assert_allclose(after.belief.looks, looks, rtol=0, atol=1e-12)
        fixed = replace(system, slew_rate=0.0, looks=tuple(after.belief.looks[0].tolist()))
        same = fixed.action_set.encode(np.stack(settings, axis=-1))
        start = before._replace(belief=before.belief._replace(looks=after.belief.looks))
        want = fixed.transition(start, same, worlds)
        trees.tree_map(partial(np.testing.assert_allclose, rtol=1e-9, atol=1e-9), after, want)
        for ask in ("predict", "information"):
            got, expected = (
                getattr(s, ask)(b, a) for s, b, a in ((system, before.belief, action), (fixed, start.belief, same))
            )
            trees.tree_map(partial(np.testing.assert_allclose, rtol=1e-9, atol=1e-9), got, expected)


def test_a_platform_turns_by_no_more_than_its_slew_rate():
    system = crossing(dt=0.5)
    assert {s.turn for s in system.action_set.library} == {-0.15, 0.0, 0.15}
    assert system.action_set.library[0].label == "1 kHz 20 MHz 10 urad, turn -150 mrad"
    assert max(s.turn for s in crossing(slew_rate=50.0).action_set.library) == np.pi


@pytest.mark.parametrize("form", FORMS)
def test_search_finds_the_best_setting_and_turn(form):
    """Against every setting of the library of one platform; in a box, the grid has the library's turns."""
    system, worlds = crossing(action=form), oracles.worlds(crossing(), 5)
    for before, action, _ in met(system, worlds, shortcuts.best_action.of(system)):
        every = np.broadcast_to(system.candidates(), (5, *system.candidates().shape))
        least = system.cost(system.predict(before.belief, every)).min(axis=1)
        cost = system.cost(system.predict(before.belief, action))
        np.testing.assert_array_less(cost, least * (1 + 1e-9))
        if form != "box":
            np.testing.assert_allclose(cost, least, rtol=1e-9)


def test_constrained_choice_has_the_most_information():
    """Against every setting, where all reach the threshold of 0."""
    system, worlds = crossing(), oracles.worlds(crossing(), 5)
    for before, _, _ in met(system, worlds, shortcuts.best_action.of(system)):
        chosen, feasible = shortcuts.most_information(system, before.belief, 0.0)
        every = np.broadcast_to(system.candidates(), (5, *system.candidates().shape))
        most = system.information(before.belief, every)[..., 0].max(axis=1)
        np.testing.assert_allclose(system.information(before.belief, chosen)[:, 0], most, rtol=1e-9)
        assert feasible.all()


def test_plan_lies_between_two_best_steps_and_the_best_pair():
    """Against all pairs of settings and turns, followed by ``predict``."""
    system, worlds = crossing(margin=1.0), oracles.worlds(crossing(), 3)
    every, better = system.candidates(), 0
    for before, _, _ in list(met(system, worlds, shortcuts.best_action.of(system)))[:-1:7]:
        belief = before.belief
        first = system.predict(belief, shortcuts.best_action(system, belief))
        greedy = system.cost(first) + system.cost(system.predict(first, shortcuts.best_action(system, first)))
        _, cost = shortcuts.plan(system, belief, 2)
        least = np.full(3, np.inf)
        for a in every:
            ahead = system.predict(belief, np.tile(a, (3, 1)))
            second = system.cost(system.predict(ahead, np.broadcast_to(every, (3, *every.shape)))).min(axis=1)
            least = np.minimum(least, system.cost(ahead) + second)
        assert (cost <= greedy * (1 + 1e-9)).all()
        assert (cost >= least * (1 - 1e-9)).all()
        better += int((cost < greedy * (1 - 1e-6)).sum())
    assert better > 0


def mean_cost(system, worlds):
    return np.mean([system.cost(after.belief) for _, _, after in met(system, worlds, shortcuts.best_action.of(system))])


def test_turning_keeps_a_passing_target_in_the_image():
    """A fixed narrow image sees the target at the middle alone."""
    worlds = oracles.worlds(crossing(), 20)
    free = crossing(looks=(-1.0,))
    assert mean_cost(free, worlds) < 0.7 * mean_cost(replace(free, slew_rate=0.0), worlds)


def test_observation_tells_the_side():
    system = RfEo(horizon=4, slew_rate=SLEW, looks=(0.4, -3.0))
    plain, worlds = replace(system, slew_rate=0.0), oracles.worlds(system, 3)
    count = len(plain.observation_fields)
    assert [f.name for f in system.observation_fields[count:]] == [
        f"azimuth_off_look_{t}_{j}" for t in (1, 2) for j in (1, 2)
    ]
    for _, _, after in met(system, worlds, shortcuts.best_action.of(system)):
        got, x = system.observe(after.belief), after.belief.mean @ system.motion.F.T
        for e in range(3):
            places = np.column_stack([system.platforms, after.belief.looks[e]])
            off = platform_measurement(x[e][:, None], places)[..., 2]
            np.testing.assert_allclose(got[e, count:], off.ravel(), rtol=1e-12)
            fixed = plain.observe(trees.tree_map(lambda a, e=e: a[e : e + 1], after.belief))
            np.testing.assert_allclose(got[e, :count], fixed[0], rtol=1e-12)
    assert "azimuth_off_look_2_1" in system.decision_makers[0].fields
    known = shortcuts.measured_fields(system)
    assert [f.name for f in known.setting_fields] == ["look_1", "look_2"]
    np.testing.assert_array_equal(known.settings(after.belief), after.belief.looks)


def test_environment_plays_with_the_measurements_alone():
    env = gym.make("wavegym/RfEo-v0", horizon=3, slew_rate=SLEW, observation="measurements", disable_env_checker=True)
    observation, _ = env.reset(seed=0)
    fields = shortcuts.measured_fields(env.unwrapped.system).setting_fields
    assert len(fields) == 2
    assert env.observation_space.contains(observation)
    assert "turn_1" in env.unwrapped.system.actions.names
