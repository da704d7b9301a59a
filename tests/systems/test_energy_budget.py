"""Two radars on one account of energy: conservation, masks and replacements, foresight, occlusions, observation."""

from __future__ import annotations

import agile_clutter_oracle as plain
import gymnasium as gym
import numpy as np
import oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wavegym.envs.foresight import foresight_defect
from wavegym.errors import InputError
from wavegym.parameter_sets import make_checked
from wavegym.schedulers import Myopic
from wavegym.systems import trees
from wavegym.systems.contract import State
from wavegym.systems.horizon import horizon_weights
from wavegym.systems.planning.energy_account import Account, PulseMenu
from wavegym.systems.planning.energy_budget import EnergyBudget
from wavegym.systems.planning.energy_budget_known import FAR, EnergyBudgetKnown

BOTH = (EnergyBudget, EnergyBudgetKnown)
IDS = ("wavegym/EnergyBudget-v0", "wavegym/EnergyBudgetKnown-v0")


def states(system, worlds, choose):
    """States at k = 0, 1, ...; ``choose`` (public) -> actions."""
    found = [system.begin(worlds)]
    for _ in range(system.horizon):
        found.append(system.advance(found[-1], choose(found[-1].public), worlds))
    return found


def at_random(system, seed=0):
    rng = np.random.default_rng(seed)
    return lambda public: rng.integers(len(system.actions), size=len(public.step))


def beliefs(system, count=4, steps=(0, 5, 30)):
    """Public states of episodes in which little is spent, so that all actions can be paid."""
    rng = np.random.default_rng(1)
    played = states(system, oracles.worlds(system, count, 1), lambda p: rng.choice([0, 1, 4], size=len(p.step)))
    return [played[k].public for k in steps]


@given(st.lists(st.integers(1, 40), min_size=1, max_size=3, unique=True), st.integers(1, 2), st.data())
def test_whatever_is_asked_the_account_pays_what_it_has(units, sensors, data):
    """The dearest affordable action within what was asked, by a loop over all; and what is left, exactly."""
    menu = PulseMenu("lfm", tuple(2e-6 * u for u in units), 1e6, "up", 1e10, sensors)
    account = Account(menu.takes, menu.actions.indices, menu.quanta)
    unit = np.array([0, *sorted(units)]) * menu.quanta // max(units)
    np.testing.assert_array_equal(menu.takes, unit[menu.actions.indices].sum(axis=1))
    left = data.draw(st.integers(0, 3 * menu.quanta))
    asked = data.draw(st.integers(0, len(menu.takes) - 1))
    used, energy = account.pay(np.array([left / menu.quanta]), np.array([asked]))
    options = menu.actions.indices
    within = [a for a in range(len(options)) if (options[a] <= options[asked]).all() and menu.takes[a] <= left]
    assert used[0] in within
    assert menu.takes[used[0]] == max(menu.takes[a] for a in within)
    assert (used[0] == asked) == (menu.takes[asked] <= left)
    assert energy[0] == (left - menu.takes[used[0]]) / menu.quanta >= 0.0
    np.testing.assert_array_equal(account.affordable(np.array([left / menu.quanta]))[0], menu.takes <= left)


@pytest.mark.parametrize("count", [300, pytest.param(7000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", BOTH)
def test_energy_is_conserved_in_every_random_step(kind, count):
    """With 7000 worlds of 72 steps for either environment: a million steps. Durations that no binary fraction holds."""
    system = kind(durations=(10e-6, 30e-6, 70e-6), budget=0.3)
    worlds, rng = oracles.worlds(system, count, 3), np.random.default_rng(3)
    state, spent = system.begin(worlds), np.zeros(count)
    units = np.round(np.array([0.0, 1.0, 3.0, 7.0])[system.actions.indices].sum(axis=1))
    eager = rng.random(count)  # how much of the time an environment transmits: accounts run dry early, late, or never
    total, replaced = np.floor(0.3 * system.horizon * 7.0), 0
    assert np.isclose(system.total * 7.0, total, rtol=1e-12)
    for _ in range(system.horizon):
        asked = np.where(rng.random(count) < eager, rng.integers(len(units), size=count), 0)
        mask, before = system.mask(state.public), state.public.energy
        state = system.advance(state, asked, worlds)
        figures = system.metrics(state)
        left, taken = np.round(figures["energy"] * 7.0), np.round(figures["spent"] * 7.0)
        np.testing.assert_array_equal(mask, units <= np.round(before * 7.0)[:, None])
        np.testing.assert_array_equal(figures["replaced"], ~mask[np.arange(count), asked])
        np.testing.assert_array_equal(taken[~figures["replaced"]], units[asked][~figures["replaced"]])
        assert (taken[figures["replaced"]] < units[asked][figures["replaced"]]).all()
        assert (figures["detections"][figures["occluded"] | (taken == 0)] == 0).all()
        spent += taken
        np.testing.assert_array_equal(left + spent, total)
        assert (figures["energy"] >= 0.0).all()
        replaced += figures["replaced"].sum()
    assert replaced > 0
    assert (spent < total).any()


@pytest.mark.parametrize("kind", BOTH)
def test_foresight_carries_the_account_as_the_world_does(kind):
    system = kind(budget=0.05)
    worlds, choose = oracles.worlds(system, 20, 4), at_random(system, 4)
    state = system.begin(worlds)
    for _ in range(20):
        action = choose(state.public)
        several = system.imagine(state.public, system.candidates()[None])
        ahead = system.advance(state, action, worlds)
        np.testing.assert_array_equal(system.imagine(state.public, action).energy, ahead.public.energy)
        np.testing.assert_array_equal(several.energy[np.arange(20), action], ahead.public.energy)
        state = ahead
    assert system.metrics(state)["replaced"].any()


def centred(system, state, worlds, sensor, action):
    """The tape changed so that ``sensor`` detects just what it predicts, the others nothing, and the slot is clear."""
    step, (x, P) = int(state.public.step[0]), (state.public.mean, state.public.covariance)
    C = system.menu.option_covariances[system.actions.indices[action, sensor]]
    error, detection = worlds.error.copy(), np.ones_like(worlds.detection)
    detection[:, :, sensor] = 0.0
    for e in range(len(x)):
        mean, covariance = plain.predicted(system, step + 1, x[e], P[e])
        site = np.array(system.sensors[sensor])
        foreseen = plain.unscented(mean[0], covariance[0], site)[0]
        true = plain.measure(state.hidden.path[e, 0, step + 1], site)
        eta = (system.reference_range / true[0]) ** 4
        error[e, step, sensor, 0] = np.linalg.solve(np.linalg.cholesky(C / eta), foreseen - true)
    return worlds._replace(error=error, detection=detection, occlusion=0.0 * worlds.occlusion)


@pytest.mark.parametrize("kind", BOTH)
@pytest.mark.parametrize("sensor", [0, 1])
def test_a_given_outcome_is_what_the_world_makes_of_it(kind, sensor):
    """Without clutter, of a detection where it is predicted."""
    system = kind(clutter_density=0.0, gate=6.0, reference_range=100e3, **clear(kind))
    count = 3
    worlds = oracles.worlds(system, count, 6)
    state = system.begin(worlds)
    for action in (5, 10, 15, 13, 7):
        tape = centred(system, state, worlds, sensor, action)
        ahead = system.advance(state, np.full(count, action), tape)
        assert (system.metrics(ahead)["detections"] == 1).all()
        outcome = np.ones((count, *system.chances))
        outcome[:, sensor] = 0.0
        if kind is EnergyBudget:
            outcome[:, -1] = 0.0
        told = system.imagine(state.public, np.full(count, action), outcome)
        silent = system.imagine(state.public, np.full(count, 0), outcome)
        assert oracles.covariance_distance(told.covariance, ahead.public.covariance) < 1e-12
        for name in set(told._fields) - {"mean", "covariance", "particles"}:
            np.testing.assert_array_equal(getattr(told, name), getattr(ahead.public, name))
        missed = system.imagine(state.public, np.full(count, action), np.ones_like(outcome))
        lost = system.advance(state, np.full(count, action), blind(kind, tape))
        np.testing.assert_allclose(missed.covariance, silent.covariance, rtol=1e-12)
        np.testing.assert_allclose(lost.public.covariance, silent.covariance, rtol=1e-12)
        state = ahead


def clear(kind):
    """What makes the first slots clear and the account large enough for what is played in them."""
    return {"windows": ((60, 71),), "budget": 0.27} if kind is EnergyBudgetKnown else {}


def blind(kind, tape):
    """Nothing is detected, and the slot is occluded where that is up to chance."""
    return tape._replace(detection=np.ones_like(tape.detection), occlusion=np.ones_like(tape.occlusion))


def test_occluded_nothing_is_seen_and_all_energy_is_lost():
    system = EnergyBudget()
    worlds = oracles.worlds(system, 5, 2)
    worlds = worlds._replace(occlusion=np.ones_like(worlds.occlusion), detection=np.zeros_like(worlds.detection))
    start = system.begin(worlds)
    loud, quiet = (system.advance(start, np.full(5, action), worlds) for action in (15, 0))
    np.testing.assert_array_equal(loud.public.covariance, quiet.public.covariance)
    np.testing.assert_array_equal(loud.public.energy, system.total - 2.0)
    np.testing.assert_array_equal(quiet.public.energy, system.total)
    assert (loud.public.occluded == 1.0).all()
    assert system.metrics(loud)["occluded"].all()


def repeated(system, count, seed=0):
    """One belief after a few steps, ``count`` truths drawn from it, and tapes."""
    worlds = oracles.worlds(system, 1, seed)
    before = states(system, worlds, lambda p: np.full(1, 10 if p.step[0] % 3 == 0 else 0))[12]
    public = trees.take(before.public, np.zeros(count, np.int64))
    worlds = oracles.worlds(system, count, seed + 1)
    hidden = system.begin(worlds).hidden
    mean, covariance = plain.predicted(system, 13, public.mean[0], public.covariance[0])
    path = hidden.path.copy()
    path[:, 0, 13] = (
        mean[0] + np.random.default_rng(seed).standard_normal((count, 4)) @ np.linalg.cholesky(covariance[0]).T
    )
    return State(hidden._replace(path=path), public), worlds


@pytest.mark.parametrize("kind", BOTH)
@pytest.mark.parametrize("action", [3, 15, 9])
def test_the_expected_step_is_the_mean_of_steps(kind, action):
    """Of the share of the trace that a step takes away: 3 % with one pulse, 12 % with two, and Monte Carlo.

    Two pulses are foreseen one after the other, each with the mean of the other's outcomes, as if they were occluded
    one by one.
    """
    count = 20_000
    system = kind(**clear(kind))
    state, worlds = repeated(system, count)
    ahead = system.advance(state, np.full(count, action), worlds).public
    one = trees.take(state.public, np.arange(1))
    foreseen, silent = (system.cost(system.imagine(one, np.array([a])))[0] for a in (action, 0))
    costs = system.cost(ahead)
    tolerance = (0.12 if action > 3 else 0.03) * (silent - foreseen)
    assert abs(costs.mean() - foreseen) < tolerance + 4 * costs.std() / np.sqrt(count)
    assert silent - foreseen > 20 * costs.std() / np.sqrt(count)
    if kind is EnergyBudget:
        sight = 1.0 - system.imagine(one, np.array([action])).occluded[0]
        assert abs((1.0 - ahead.occluded).mean() - sight) < 5 * np.sqrt(sight * (1 - sight) / count)


@pytest.mark.parametrize("kind", BOTH)
def test_sampled_outcomes_are_as_likely_as_the_worlds(kind):
    """Mean cost over drawn outcomes against that of steps: 3 % of what the step takes away, and Monte Carlo."""
    count, action = 20_000, 15
    system = kind(**clear(kind))
    state, worlds = repeated(system, count)
    costs = system.cost(system.advance(state, np.full(count, action), worlds).public)
    draws = np.random.default_rng(8).random((count, *system.chances))
    told = system.cost(system.imagine(state.public, np.full(count, action), draws))
    silent = system.cost(system.imagine(trees.take(state.public, np.arange(1)), np.array([0])))[0]
    error = 4 * np.hypot(costs.std(), told.std()) / np.sqrt(count)
    assert abs(costs.mean() - told.mean()) < 0.03 * (silent - told.mean()) + error


@pytest.mark.parametrize("kind", BOTH)
def test_candidates_are_a_loop_over_them_bit_for_bit(kind):
    system = kind()
    for public in beliefs(system):
        draws = np.random.default_rng(1).random((4, 16, *system.chances))
        for told in (None, draws):
            many = system.imagine(public, system.candidates()[None], told)
            for a in system.candidates():
                one = system.imagine(public, np.full(4, a), None if told is None else told[:, a])
                for x, y in zip(many, one, strict=True):
                    assert x is None or np.array_equal(x[:, a], y)
        gain = system.gain(public, 3, 6)
        for e in range(4):
            np.testing.assert_array_equal(system.gain(trees.take(public, np.array([e])), 3, 6), gain[e : e + 1])


@pytest.mark.parametrize("kind", BOTH)
def test_gain_is_what_a_pulse_takes_off_the_summed_cost(kind):
    """Against ``imagine``: silence for a while, then each candidate; the steps beyond the end count nothing."""
    system = kind(budget=0.27)
    for public in beliefs(system, steps=(0, 5, 30, 69)):
        for wait, ahead in ((0, 1), (0, 7), (4, 5), (1, 90)):
            later = public
            for _ in range(wait):
                if not system.ended(later).all():
                    later = system.imagine(later, np.zeros(4, np.int64))
            got = system.gain(public, wait, ahead)
            if public.step[0] + wait >= system.horizon:
                assert (got == 0.0).all()
                continue
            P = system.imagine(later, system.candidates()[None]).covariance[:, :, 0]
            M = horizon_weights(system.transition, system.weights, min(ahead, system.horizon - later.step[0]))
            wanted = np.trace(M @ (P[:, :1] - P), axis1=2, axis2=3)
            np.testing.assert_allclose(got, wanted, rtol=1e-8, atol=1e-8 * np.trace(M @ P[0, 0]))
            mixed = system.gain(public, np.where(np.arange(16) % 3, wait, 2)[None].repeat(4, axis=0), ahead)
            np.testing.assert_array_equal(mixed[:, 1], got[:, 1])
    assert (system.delay(public) == 0).all()


def test_spells_have_the_lengths_of_their_chain():
    system = EnergyBudget(mean_clear=9.0, mean_occluded=4.0)
    worlds = oracles.worlds(system, 3000, 5)
    occluded = np.array([s.public.occluded for s in states(system, worlds, lambda p: np.zeros(3000, np.int64))])
    assert (occluded[0] == 0.0).all()
    for now, mean in ((0.0, 9.0), (1.0, 4.0)):
        turns = occluded[1:][occluded[:-1] == now] != now
        chance = 1.0 / mean
        assert abs(turns.mean() - chance) < 5 * np.sqrt(chance * (1 - chance) / turns.size)
    share = 4.0 / 13.0  # in the long run; an expectation without news tends to it
    assert abs(occluded[40:].mean() - share) < 0.02
    public = system.begin(oracles.worlds(system, 1)).public
    for _ in range(60):
        public = system.imagine(public, np.array([0]))
    np.testing.assert_allclose(public.occluded, share, rtol=1e-9)


def test_known_spells_are_public_from_the_start_and_are_lived_through():
    system = EnergyBudgetKnown(shown=(3, 5), hidden=(2, 4))
    worlds = oracles.worlds(system, 50, 5)
    played = states(system, worlds, at_random(system))
    visible = played[0].public.visible
    assert visible.shape == (50, system.horizon)
    assert 0.4 < visible.mean() < 0.75
    for k, state in enumerate(played[1:]):
        np.testing.assert_array_equal(state.public.visible, visible)
        np.testing.assert_array_equal(system.metrics(state)["occluded"], ~visible[:, k])
    chosen = EnergyBudgetKnown(windows=((3, 5), (70, 71)))
    seen = chosen.begin(oracles.worlds(chosen, 2)).public.visible
    np.testing.assert_array_equal(seen, np.tile(~np.isin(np.arange(72), [3, 4, 5, 70, 71]), (2, 1)))


def test_targets_start_all_over_their_region_and_off_the_radars_line():
    system = EnergyBudget()
    start = system.begin(oracles.worlds(system, 2000)).hidden.truth[:, 0]
    offset = (start - system.starts[0]) / np.array(system.spread)
    assert (np.abs(offset) <= 1.0).all()
    np.testing.assert_allclose(offset.mean(axis=0), 0.0, atol=5 / np.sqrt(3 * 2000))
    np.testing.assert_allclose(offset.var(axis=0), 1 / 3, atol=0.03)
    played = states(system, oracles.worlds(system, 200), lambda p: np.zeros(200, np.int64))
    sides = np.array(system.sensors)[:, None, None] - np.array([s.hidden.truth[:, 0, :2] for s in played])
    a, b = sides / np.linalg.norm(sides, axis=-1, keepdims=True)
    assert np.abs(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]).min() > np.sin(np.deg2rad(15.0))


@pytest.mark.parametrize("kind", BOTH)
def test_the_observation_tells_what_a_planner_knows(kind):
    system = kind()
    played = states(system, oracles.worlds(system, 6, 9), at_random(system, 9))
    names = [element.name for element in system.elements]
    eta = [
        plain.strength(system, plain.measure(played[0].public.mean[0, 0], np.array(s))[0])[0] for s in system.sensors
    ]
    first = dict(zip(names, system.observe(played[0].public)[0], strict=True))
    np.testing.assert_allclose([first["snr_1_1"], first["snr_1_2"]], 10 * np.log10(eta), atol=0.2)
    for k, state in enumerate(played):
        seen = dict(zip(names, system.observe(state.public).T, strict=True))
        np.testing.assert_allclose(seen["energy_left"], state.public.energy / system.total)
        rate = state.public.energy / max(72 - k, 1)
        np.testing.assert_allclose(seen["energy_rate"], np.minimum(rate, 2.0))
        np.testing.assert_allclose(seen["time_left"], 1 - k / 72)
        if kind is EnergyBudget:
            np.testing.assert_array_equal(seen["occluded"], system.metrics(state)["occluded"])
        elif k < 72:
            for e, row in enumerate(state.public.visible[:, k:]):
                changes = np.flatnonzero(row != row[0])
                assert seen["occluded"][e] == (not row[0])
                assert seen["change"][e] == min(changes[0] if len(changes) else FAR, FAR)
                assert seen["visible_ahead"][e] == pytest.approx(row.mean())


@pytest.mark.parametrize("kind", BOTH)
def test_it_keeps_the_contract(kind):
    system = kind()
    assert foresight_defect(system) is None
    with pytest.raises(NotImplementedError):
        system.best_action(system.begin(oracles.worlds(system, 1)).public)
    assert len(system.actions) == 16
    assert 0 in system.constants()
    assert system.spending.tolist() == [(0, 0.25, 0.5, 1)[a] + (0, 0.25, 0.5, 1)[b] for a, b in system.actions.indices]


@pytest.mark.parametrize("id", IDS)
def test_the_shell_takes_what_cannot_be_paid_and_says_so(id):
    env = gym.make(id, budget=0.03)
    env.reset(seed=1)
    for k in range(72):
        _, _, terminated, truncated, info = env.step(15)
        assert info["replaced"] == (k > 0)
        assert terminated == (k == 71)
        assert not truncated
    assert info["energy"] == 0.0


def test_myopic_spends_all_it_can():
    system = EnergyBudgetKnown()
    worlds, policy = oracles.worlds(system, 3), Myopic()
    policy.begin(system, 3, np.random.default_rng(0))
    played = states(system, worlds, lambda p: policy.act(p, None, system.mask(p)))
    assert (played[30].public.energy == 0.0).all()


@pytest.mark.parametrize(
    ("kind", "settings", "says"),
    [
        (EnergyBudget, {"budget": -0.1}, "budget is -0.1 a step, expected"),
        (EnergyBudget, {"budget": 0.003}, "cheapest pulse"),
        (EnergyBudget, {"budget": float("nan")}, "budget is nan"),
        (EnergyBudget, {"budget": 2.1}, "nearest: 2"),
        (EnergyBudget, {"mean_clear": 0.5}, "mean_clear is 0.5"),
        (EnergyBudget, {"mean_occluded": float("inf")}, "mean_occluded is inf"),
        (EnergyBudget, {"durations": (1e-5, 3.1415926535e-5)}, "multiples of one unit"),
        (EnergyBudget, {"durations": (1e-5, -3e-5)}, "duration"),
        (EnergyBudget, {"laws": ("lfm", "pfm:3")}, "laws is"),
        (EnergyBudget, {"births": (3,)}, "births is"),
        (EnergyBudget, {"spread": (1.0, -1.0, 0.0, 0.0)}, "spread is -1.0"),
        (EnergyBudget, {"tracker": "particle"}, "tracker is 'particle'"),
        (EnergyBudget, {"action": "box"}, "action is 'box'"),
        (EnergyBudget, {"windows": ((1, 2),)}, "'windows' is unknown"),
        (EnergyBudgetKnown, {"windows": ((70, 72),)}, "last step of hidden window"),
        (EnergyBudgetKnown, {"windows": ((-1, 2),)}, "first step of hidden window"),
        (EnergyBudgetKnown, {"windows": ((5, 2),)}, "last step of hidden window"),
        (EnergyBudgetKnown, {"windows": ((0, 71),)}, "at least one step"),
        (EnergyBudgetKnown, {"shown": (0, 3)}, "shown"),
        (EnergyBudgetKnown, {"hidden": (5, 3)}, "hidden"),
    ],
)
def test_bad_input_is_one_line(kind, settings, says):
    with pytest.raises(InputError, match=says.replace("(", r"\(")) as error:
        make_checked(kind, settings)
    assert "\n" not in str(error.value)


def test_a_budget_of_just_the_cheapest_pulse_pays_it_once():
    system = EnergyBudget(budget=0.25 / 72)
    assert system.total == 0.25
    state = system.begin(oracles.worlds(system, 1))
    state = system.advance(state, np.array([15]), oracles.worlds(system, 1))
    assert system.metrics(state)["spent"] == 0.25
