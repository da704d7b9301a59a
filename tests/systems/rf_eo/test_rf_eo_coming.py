"""Targets that come and go before RF/EO platforms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import oracles
import pytest

from wavegym.core import shortcuts
from wavegym.envs.single import WaveformEnv
from wavegym.rendering.panels import Moment
from wavegym.systems.rf_eo.scene import received_caption
from wavegym.systems.rf_eo.state import SOON
from wavegym.systems.rf_eo.system import RfEo, RfEoFar

BIRTHS, STAY, STEPS = (0, 5, 13), 8, 24
STARTS = ((-1e3, 0.0, 1e3, 0.0), (1e3, 0.0, 1e3, 0.0), (300.0, 20.0, -400.0, -10.0))
FAR = ((-5e3, 0.0, 20e3, 230.0), (0.0, 0.0, 30e3, -210.0), (4e3, 100.0, 9e3, -50.0))
COMING = {"births": BIRTHS, "lifetime": STAY, "horizon": STEPS, "first_estimate": "drawn"}
ENDS = (STAY, 5 + STAY, 13 + STAY)  # steps 8 and 13; target 3 is alone from step 14 to 21, and then nothing is there
SYSTEMS = [
    RfEo(starts=STARTS, **COMING),
    RfEo(starts=STARTS, slew_rate=0.2, margin=1.0, **COMING),
    RfEoFar(starts=FAR, **COMING),
]


def played(system, worlds, seed=0):
    """(state before, action, state after) of every step under random actions."""
    rng, state = np.random.default_rng(seed), system.initial(worlds)
    for _ in range(system.horizon):
        action = rng.uniform(-1, 1, (len(state.belief.step), len(system.actions)))
        before, state = state, system.transition(state, action, worlds)
        yield before, action, state


def alone(system, t, worlds, state):
    """The system of target ``t`` alone from its birth on, its tape, and its share of a state, as if ever present."""
    from_birth, one, copied = slice(BIRTHS[t], None), slice(t, t + 1), np.ascontiguousarray
    single = replace(system, starts=system.starts[one], births=(), lifetime=1_000_000, horizon=STEPS - BIRTHS[t])
    process, error = worlds.process[:, from_birth, one], worlds.error[:, from_birth, :, one]
    tape = worlds._replace(start=copied(worlds.start[:, one]), process=copied(process), error=copied(error))
    parts = {name: copied(getattr(state.truth, name)[:, one]) for name in ("targets", "received", "unseen")}
    mean, covariance = copied(state.belief.mean[:, one]), copied(state.belief.covariance[:, one])
    belief = state.belief._replace(mean=mean, covariance=covariance)
    return single, tape, state._replace(truth=state.truth._replace(**parts), belief=belief)


def same(got, want):
    for one, other in zip(got, want, strict=True):
        np.testing.assert_array_equal(one, other)


def shifted(state, t):
    return state._replace(belief=state.belief._replace(step=state.belief.step - BIRTHS[t]))


@pytest.mark.parametrize("system", SYSTEMS)
def test_each_target_is_that_of_a_scene_of_its_own(system):
    """Targets do not affect each other: each is tracked, from its birth on, as by a system that has no other."""
    worlds = oracles.worlds(system, 3)
    for before, action, after in played(system, worlds):
        step, cost = before.belief.step[0], 0.0
        shares = []
        for t in range(3):
            single, tape, own = alone(system, t, worlds, before)
            if not BIRTHS[t] <= step < ENDS[t]:
                got = alone(system, t, worlds, after)[2]
                same((got.truth.targets, *got.belief[1:3]), (own.truth.targets, *own.belief[1:3]))
                assert not got.truth.received.any()
                assert not got.truth.unseen.any()
                continue
            want = single.transition(shifted(own, t), action, tape)
            got = shifted(alone(system, t, worlds, after)[2], t)
            shares.append(want.truth.share)
            same(got.belief, want.belief)
            same(got.truth[:3], want.truth[:3])
            cost = cost + single.cost(want.belief)
            predicted = single.predict(shifted(own, t).belief, action)
            np.testing.assert_array_equal(
                system.predict(before.belief, action).covariance[:, t], predicted.covariance[:, 0]
            )
        np.testing.assert_allclose(system.cost(after.belief), cost, rtol=1e-12)
        np.testing.assert_array_equal(after.truth.share, np.min(shares, axis=0) if shares else np.zeros(3))


@pytest.mark.parametrize("system", SYSTEMS)
def test_schedulers_decide_for_the_targets_that_are_there(system):
    """Target 3 alone is in the scene from step 14 to 21: choices and costs are those of a scene that has no other."""
    worlds, compared = oracles.worlds(system, 3), 0
    for before, _, _ in played(system, worlds):
        belief, step = before.belief, before.belief.step[0]
        if step < 13 or step > 17:
            continue
        single, _, own = alone(system, 2, worlds, before)
        expected = shifted(own, 2).belief
        np.testing.assert_array_equal(shortcuts.best_action(system, belief), shortcuts.best_action(single, expected))
        same(shortcuts.most_information(system, belief), shortcuts.most_information(single, expected))
        same(shortcuts.plan(system, belief, 3), shortcuts.plan(single, expected, 3))
        compared += 1
    assert compared == 5


def test_an_empty_scene_costs_nothing():
    system = SYSTEMS[0]
    *_, (before, action, after) = played(system, oracles.worlds(system, 3))
    _, cost = shortcuts.plan(system, before.belief, 2)
    for found in (system.cost(after.belief), cost, after.truth.share):
        np.testing.assert_array_equal(found, np.zeros_like(found))
    assert (system.information(before.belief, action) == system.threshold).all()
    assert shortcuts.most_information(system, before.belief)[1].all()
    assert not system.state_info(after)["below_threshold"].any()


def test_a_plan_prepares_for_a_target_that_comes():
    """Against all pairs of choices, followed by ``predict``: the second step is the new target's first."""
    system = RfEo(
        horizon=9, births=(0, 4), action="library", points=(2, 1, 2), turns=3, slew_rate=0.5, pixel_angle=(1e-5, 3e-4),
        platforms=((0.0, 0.0),), starts=((-490.0, 0.0, 800.0, 0.0), (390.0, 0.0, 810.0, 0.0)), first_estimate="drawn",
        prior_variance=(1e3, 25.0, 1e3, 25.0), looks=(-0.5,)
    )  # fmt: skip
    worlds, state = oracles.worlds(system, 4), system.initial(oracles.worlds(system, 4))
    for _ in range(3):
        state = system.transition(state, shortcuts.best_action(system, state.belief), worlds)
    belief, every = state.belief, system.candidates()
    assert belief.step[0] == 3
    assert not system.present(belief.step + 1)[:, 1].any()
    first = system.predict(belief, shortcuts.best_action(system, belief))
    greedy = system.cost(first) + system.cost(system.predict(first, shortcuts.best_action(system, first)))
    least = np.full(4, np.inf)
    for a in every:
        ahead = system.predict(belief, np.tile(a, (4, 1)))
        second = system.cost(system.predict(ahead, np.broadcast_to(every, (4, *every.shape)))).min(axis=1)
        least = np.minimum(least, system.cost(ahead) + second)
    _, cost = shortcuts.plan(system, belief, 2)
    np.testing.assert_allclose(cost, least, rtol=1e-9)
    assert (cost < 0.9 * greedy).all()


def test_observation_and_figures_tell_who_is_there():
    system = SYSTEMS[1]
    plain, names = replace(system, births=(), lifetime=1_000_000), ("present", "changes")
    count = len(plain.observation_fields)
    assert [f.name for f in system.observation_fields[count:]] == [f"{name}_{t}" for t in (1, 2, 3) for name in names]
    for before, _, after in played(system, oracles.worlds(system, 2)):
        step, observed = int(before.belief.step[0]), system.observe(before.belief)
        assert np.isfinite(observed).all()
        np.testing.assert_array_equal(observed[:, :count], plain.observe(before.belief))
        here = [BIRTHS[t] <= step < ENDS[t] for t in range(3)]
        changes = [min([k - step for k in (BIRTHS[t], ENDS[t]) if k > step] + [SOON]) for t in range(3)]
        np.testing.assert_array_equal(observed[0, count:], np.ravel(np.column_stack([here, changes])))
        figures, full = system.state_info(after), plain.state_info(after)
        np.testing.assert_array_equal(figures["present"], [here] * 2)
        for name in ("position_error", "position_variance", "nees"):
            np.testing.assert_array_equal(figures[name], np.where(here, full[name], 0.0))
    assert "present" not in full


@pytest.mark.slow
def test_the_picture_shows_who_is_there():
    """From the birth on, until it has gone; the caption names who is absent."""
    system = RfEo(horizon=4, births=(1, 2), lifetime=1, slew_rate=0.2)
    env = WaveformEnv(system, render_mode="rgb_array")
    env.reset(seed=0)
    frames = [env.render()]
    for _ in range(4):
        env.step(env.action_space.sample() * 0.0)
        frames.append(env.render())
    assert len({frame.tobytes() for frame in frames}) == 5
    state = system.initial(oracles.worlds(system, 1))
    states = [state]
    for _ in range(4):
        state = system.transition(state, np.zeros((1, 8)), oracles.worlds(system, 1))
        states.append(state)
    absent = (None, [True, True], [False, True], [True, False], [True, True])
    for k, expected in enumerate(absent):
        moment = Moment(system, states[: k + 1], [np.zeros((1, 8))] * k, np.zeros(k + 1))
        parts = received_caption(system, moment).split("  ·  ")
        assert parts == [""] if k == 0 else [part.endswith("absent") for part in parts] == expected
