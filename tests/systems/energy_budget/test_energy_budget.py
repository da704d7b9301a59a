"""Two radars on one account of energy: conservation, masks and replacements, occlusions, observation."""

from __future__ import annotations

import agile_clutter_oracle as plain
import gymnasium as gym
import numpy as np
import oracles
import pytest
from energy_episodes import BOTH, at_random, states
from hypothesis import given
from hypothesis import strategies as st

from wavegym.core import shortcuts
from wavegym.schedulers import Myopic
from wavegym.systems.energy_budget.actions import Account, PulseActions
from wavegym.systems.energy_budget.known import FAR, EnergyBudgetKnown
from wavegym.systems.energy_budget.system import EnergyBudget

IDS = ("wavegym/EnergyBudget-v0", "wavegym/EnergyBudgetKnown-v0")


@given(st.lists(st.integers(1, 40), min_size=1, max_size=3, unique=True), st.integers(1, 2), st.data())
def test_the_account_pays_the_dearest_affordable_action(units, sensors, data):
    """The dearest affordable action within the action asked, by a loop over all; the energy left, exactly."""
    action_set = PulseActions("lfm", tuple(2e-6 * u for u in units), 1e6, "up", 1e10, sensors)
    account = Account(action_set.action_quanta, action_set.actions.indices, action_set.quanta)
    unit = np.array([0, *sorted(units)]) * action_set.quanta // max(units)
    np.testing.assert_array_equal(action_set.action_quanta, unit[action_set.actions.indices].sum(axis=1))
    left = data.draw(st.integers(0, 3 * action_set.quanta))
    asked = data.draw(st.integers(0, len(action_set.action_quanta) - 1))
    used, energy = account.pay(np.array([left / action_set.quanta]), np.array([asked]))
    options = action_set.actions.indices
    within = [
        a for a in range(len(options)) if (options[a] <= options[asked]).all() and action_set.action_quanta[a] <= left
    ]
    assert used[0] in within
    assert action_set.action_quanta[used[0]] == max(action_set.action_quanta[a] for a in within)
    assert (used[0] == asked) == (action_set.action_quanta[asked] <= left)
    assert energy[0] == (left - action_set.action_quanta[used[0]]) / action_set.quanta >= 0.0
    np.testing.assert_array_equal(
        account.affordable(np.array([left / action_set.quanta]))[0], action_set.action_quanta <= left
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", BOTH)
def test_energy_is_conserved_in_every_random_step(kind):
    """With 7000 worlds of 72 steps for either environment: a million steps. Durations that no binary fraction holds."""
    system, count = kind(durations=(10e-6, 30e-6, 70e-6), budget=0.3), 7000
    worlds, rng = oracles.worlds(system, count, 3), np.random.default_rng(3)
    state, spent = system.initial(worlds), np.zeros(count)
    units = np.round(np.array([0.0, 1.0, 3.0, 7.0])[system.actions.indices].sum(axis=1))
    eager = rng.random(count)  # how much of the time an environment transmits: accounts run dry early, late, or never
    total, replaced = np.floor(0.3 * system.horizon * 7.0), 0
    assert np.isclose(system.total * 7.0, total, rtol=1e-12)
    for _ in range(system.horizon):
        asked = np.where(rng.random(count) < eager, rng.integers(len(units), size=count), 0)
        mask, before = system.mask(state.belief), state.belief.energy
        state = system.transition(state, asked, worlds)
        figures = system.state_info(state)
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


def test_occluded_nothing_is_seen_and_all_energy_is_lost():
    system = EnergyBudget(reference_range=1e6)  # detects every clear target
    worlds = oracles.worlds(system, 5, 2)
    worlds = worlds._replace(occlusion=np.ones_like(worlds.occlusion))
    start = system.initial(worlds)
    loud, quiet = (system.transition(start, np.full(5, action), worlds) for action in (15, 0))
    np.testing.assert_array_equal(loud.belief.covariance, quiet.belief.covariance)
    np.testing.assert_array_equal(loud.belief.energy, system.total - 2.0)
    np.testing.assert_array_equal(quiet.belief.energy, system.total)
    assert (loud.belief.occluded == 1.0).all()
    assert system.state_info(loud)["occluded"].all()


@pytest.mark.slow
def test_spells_have_the_lengths_of_their_chain():
    system = EnergyBudget(mean_clear=9.0, mean_occluded=4.0)
    worlds = oracles.worlds(system, 3000, 5)
    occluded = np.array([s.belief.occluded for s in states(system, worlds, lambda p: np.zeros(3000, np.int64))])
    assert (occluded[0] == 0.0).all()
    for now, mean in ((0.0, 9.0), (1.0, 4.0)):
        turns = occluded[1:][occluded[:-1] == now] != now
        chance = 1.0 / mean
        assert abs(turns.mean() - chance) < 5 * np.sqrt(chance * (1 - chance) / turns.size)
    share = 4.0 / 13.0  # in the long run; an expectation without news tends to it
    assert abs(occluded[40:].mean() - share) < 0.02
    belief = system.initial(oracles.worlds(system, 1)).belief
    for _ in range(60):
        belief = system.predict(belief, np.array([0]))
    np.testing.assert_allclose(belief.occluded, share, rtol=1e-9)


def test_known_spells_are_in_the_belief_from_the_start_and_occur():
    system = EnergyBudgetKnown(shown=(3, 5), hidden=(2, 4))
    worlds = oracles.worlds(system, 50, 5)
    played = states(system, worlds, at_random(system))
    visible = played[0].belief.visible
    assert visible.shape == (50, system.horizon)
    assert 0.4 < visible.mean() < 0.75
    for k, state in enumerate(played[1:]):
        np.testing.assert_array_equal(state.belief.visible, visible)
        np.testing.assert_array_equal(system.state_info(state)["occluded"], ~visible[:, k])
    chosen = EnergyBudgetKnown(windows=((3, 5), (70, 71)))
    seen = chosen.initial(oracles.worlds(chosen, 2)).belief.visible
    np.testing.assert_array_equal(seen, np.tile(~np.isin(np.arange(72), [3, 4, 5, 70, 71]), (2, 1)))


def test_targets_start_all_over_their_region_and_off_the_radars_line():
    system = EnergyBudget()
    start = system.initial(oracles.worlds(system, 2000)).truth.targets[:, 0]
    offset = (start - system.starts[0]) / np.array(system.spread)
    assert (np.abs(offset) <= 1.0).all()
    np.testing.assert_allclose(offset.mean(axis=0), 0.0, atol=5 / np.sqrt(3 * 2000))
    np.testing.assert_allclose(offset.var(axis=0), 1 / 3, atol=0.03)
    played = states(system, oracles.worlds(system, 200), lambda p: np.zeros(200, np.int64))
    sides = np.array(system.sensors)[:, None, None] - np.array([s.truth.targets[:, 0, :2] for s in played])
    a, b = sides / np.linalg.norm(sides, axis=-1, keepdims=True)
    assert np.abs(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]).min() > np.sin(np.deg2rad(15.0))


@pytest.mark.parametrize("kind", BOTH)
def test_the_observation_shows_the_belief_of_a_planner(kind):
    system = kind()
    played = states(system, oracles.worlds(system, 6, 9), at_random(system, 9))
    names = [element.name for element in system.observation_fields]
    eta = [plain.snr(system, plain.measure(played[0].belief.mean[0, 0], np.array(s))[0]) for s in system.sensors]
    first = dict(zip(names, system.observe(played[0].belief)[0], strict=True))
    np.testing.assert_allclose([first["snr_1_1"], first["snr_1_2"]], 10 * np.log10(eta), atol=0.2)
    for k, state in enumerate(played):
        seen = dict(zip(names, system.observe(state.belief).T, strict=True))
        np.testing.assert_allclose(seen["energy_left"], state.belief.energy / system.total)
        rate = state.belief.energy / max(72 - k, 1)
        np.testing.assert_allclose(seen["energy_rate"], np.minimum(rate, 2.0))
        np.testing.assert_allclose(seen["time_left"], 1 - k / 72)
        if kind is EnergyBudget:
            np.testing.assert_array_equal(seen["occluded"], system.state_info(state)["occluded"])
        elif k < 72:
            for e, row in enumerate(state.belief.visible[:, k:]):
                changes = [*(np.flatnonzero(row[1:] != row[:-1]) + 1), FAR, FAR, FAR]
                assert seen["occluded"][e] == (not row[0])
                assert [seen[f"change_{n}"][e] for n in (1, 2, 3)] == [min(change, FAR) for change in changes[:3]]
                assert seen["visible_ahead"][e] == pytest.approx(row.mean())


@pytest.mark.parametrize("kind", BOTH)
def test_it_keeps_the_contract(kind):
    system = kind()
    assert shortcuts.best_action.of(system) is None
    assert len(system.actions) == 16
    assert 0 in shortcuts.constants(system)
    assert shortcuts.spending(system).tolist() == [
        (0, 0.25, 0.5, 1)[a] + (0, 0.25, 0.5, 1)[b] for a, b in system.actions.indices
    ]


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
    assert (played[30].belief.energy == 0.0).all()


def test_a_budget_of_just_the_cheapest_pulse_pays_it_once():
    system = EnergyBudget(budget=0.25 / 72)
    assert system.total == 0.25
    state = system.initial(oracles.worlds(system, 1))
    state = system.transition(state, np.array([15]), oracles.worlds(system, 1))
    assert system.state_info(state)["spent"] == 0.25
