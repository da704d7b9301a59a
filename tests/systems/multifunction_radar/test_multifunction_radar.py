"""The multifunction radar as a system: time, cost, predictions that conserve targets, figures by truth."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from wavegym.core import shortcuts, trees
from wavegym.core.system import State
from wavegym.core.traits import CONFIRMED, DwellRule
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.schedulers import RandomChoice, rollout
from wavegym.schedulers.heuristics.timeline_rules import GainPerSecond
from wavegym.systems.multifunction_radar.area_kernels import next_beam, thin
from wavegym.systems.multifunction_radar.gain_kernels import AFTER
from wavegym.systems.multifunction_radar.state import _errors, _follow, _square_gospa, estimates, states_now
from wavegym.systems.multifunction_radar.step_kernels import SEARCH, UPDATE, WAIT
from wavegym.systems.multifunction_radar.system import MultifunctionRadar
from wavegym.trackers import gospa


def after(system, worlds, seconds, choose):
    """The state after so many seconds of a policy (belief, mask) -> actions."""
    state = system.initial(worlds)
    while state.belief.time.min() < seconds:
        state = system.transition(state, choose(state.belief, system.mask(state.belief)), worlds)
    return state


def by_gain(system):
    policy = GainPerSecond(1.0, 0.5)
    policy.begin(system, 1, np.random.default_rng(0))
    return lambda belief, mask: policy.choose(belief, mask, None)


def test_samples_astray_are_of_targets_that_stay_and_had_a_track():
    """Slots follow targets 0, 1 and 4 and a false alarm; 1 has left, 2 is without its track, 3 never had one.

    The track of 0 is 99 m away, in limits of 100 m; that of 4 has a NEES beyond its region, 18.5.
    """
    truth = SimpleNamespace(
        here=np.array([[True, False, True, True, True]]), astray=np.array([[3, 3, 3, -1, 3]]),
        state=np.zeros((1, 5, 4)), origin=np.array([[0, 1, -1, 4]]), present=np.array([[True, False, False, True]]),
        squared_error=np.array([[99.0**2, 0, 0, 0]]), nees=np.array([[18.0, 0, 0, 19.0]]),
        confirmed=np.array([[1.0, 1.0, 1.0, np.nan, 1.0]])
    )  # fmt: skip
    _follow(truth, 0, 5.0, 100.0)
    assert truth.astray[0].tolist() == [0, 3, 4, -1, 4]
    truth.origin[0, 2], truth.present[0, 2] = 3, True
    _follow(truth, 0, 6.0, 99.0)
    assert truth.astray[0].tolist() == [1, 3, 5, 0, 5]
    np.testing.assert_array_equal(truth.confirmed[0], [1.0, 1.0, 1.0, 6.0, 1.0])
    truth.present[:] = False
    _follow(truth, 0, 7.0, 100.0)
    assert truth.astray[0].tolist() == [2, 3, 6, 1, 6]


def test_errors_are_of_targets_that_are_there():
    """Slots follow target 0, target 1 that has left, and a false alarm; a fourth track is not confirmed.

    The fifth has used an echo of target 0, which is 101 m away, beyond the limit of 100 m.
    """
    rng, x = np.random.default_rng(0), np.array([[1e3, 5.0, 2e3, -5.0], [9e9, 0.0, 9e9, 0.0]])
    off, covariance = rng.standard_normal((5, 4)), np.tile(np.diag([4.0, 1.0, 9.0, 1.0]), (5, 1, 1))
    off[4, [0, 2]] = 0.0, 101.0
    truth = SimpleNamespace(
        origin=np.array([[0, 1, -1, 0, 0]]), here=np.array([[True, False]]), false=np.zeros(1, int),
        present=np.zeros((1, 5), bool), squared_error=np.ones((1, 5)), variance=np.ones((1, 5)), nees=np.ones((1, 5))
    )  # fmt: skip
    _errors(truth, 0, np.array([True, True, True, False, True]), x, (x[0] + off, covariance), 100.0)
    assert truth.present[0].tolist() == [True, False, False, False, False]
    assert truth.false[0] == 3
    squares, rest = off[0] ** 2, [0, 0, 0, 0]
    np.testing.assert_allclose(truth.squared_error[0], [squares[0] + squares[2], *rest], rtol=1e-9)
    np.testing.assert_allclose(truth.variance[0], [13.0, *rest], rtol=1e-12)
    np.testing.assert_allclose(truth.nees[0], [squares @ (1 / np.array([4.0, 1.0, 9.0, 1.0])), *rest], rtol=1e-9)


def test_a_pair_far_apart_costs_a_target_missed_and_a_false_track():
    """Each with the weight of its range: 3 at 5 km, 1 at 40 km, and linear in between."""
    area = MultifunctionRadar(priority=3.0).area
    near, far = area.nearest, area.farthest
    for target, track in ((near, far), (0.5 * (near + far), near), (far, far)):
        weights = (1.0 + 2.0 * (far - r) / (far - near) for r in (target, track))
        missed, false = (1e4 * weight for weight in weights)
        for unfound, want in ((True, [missed, 0, false, 0]), (False, [0, missed, false, 0])):
            pair = np.array([[0.0, 0.0, target, 0.0]]), np.array([unfound]), np.array([[track, 0.0, 0.0, 0.0]])
            np.testing.assert_allclose(_square_gospa(*pair, 1e4, area), want, rtol=1e-9)
    close = np.array([[0.0, 0.0, near, 0.0]]), np.array([True]), np.array([[30.0, 0.0, near, 0.0]])
    np.testing.assert_allclose(_square_gospa(*close, 1e4, area), [0, 0, 0, 3.0 * 900.0], rtol=1e-9)


def worlds_of(system, count, root=0):
    return draw_worlds(system, world_seeds(root, "tune", count))


def places(state, system):
    """True states (env, g, 4) at the time of the belief."""
    return states_now(state.truth, state.belief.time - state.truth.cell * system.cell)


def test_a_dwell_takes_the_time_of_its_pulses_and_the_overhead():
    system = MultifunctionRadar(pulses=(6, 50), bursts=(1, 4))
    kind, which, train, duration = system.dwells.menu
    labels = system.actions.labels
    assert labels[:2] == ("update 0 1.92 ms", "update 0 64 ms in 4 bursts")
    assert labels[-3:] == ("search 11 1.92 ms", "search 11 64 ms in 4 bursts", "wait")
    np.testing.assert_array_equal(train[[0, 1, 2, 127, 128, 151]], [0, 1, 0, 1, 0, 1])
    np.testing.assert_allclose(duration[[0, 1, -1]], [2.92e-3, 65e-3, 5e-3], rtol=1e-12)
    assert (kind == np.repeat([UPDATE, SEARCH, WAIT], [128, 24, 1])).all()
    np.testing.assert_array_equal(which[[0, 1, 2, 127, 128, 151]], [0, 0, 1, 63, 0, 11])


def test_an_episode_ends_with_the_first_dwell_past_its_time_and_means_are_over_seconds():
    system = MultifunctionRadar(seconds=0.4)
    played = rollout(system, RandomChoice(), worlds_of(system, 6))
    assert ((played.span >= 0.4) & (played.span < 0.4 + 0.065)).all()
    assert len(set(played.steps.tolist())) > 1
    np.testing.assert_allclose(played.mean_cost, played.cost.sum(axis=1) / played.span, rtol=1e-12)


def test_the_cost_is_the_integral_over_the_time_of_the_dwell():
    """One wait of 0.2 s against 200 waits of 1 ms: Simpson's rule on a quadrature of another order."""
    spent = []
    for dt, count in ((0.2, 1), (1e-3, 200)):
        system = MultifunctionRadar(dt=dt)
        state = system.initial(worlds_of(system, 4))
        wait, total = np.full(4, len(system.actions) - 1), 0.0
        for _ in range(count):
            state = system.transition(state, wait, worlds_of(system, 4))
            total = total + state.belief.spent
        np.testing.assert_allclose(state.belief.time, 0.2, rtol=1e-12)
        spent.append(total)
    np.testing.assert_allclose(spent[0], spent[1], rtol=1e-4)


def test_the_parts_of_the_cost_are_those_of_the_belief_without_the_others():
    """Each part against the cost of a belief that has nothing else, and the parts' sum against the cost."""
    system = MultifunctionRadar()
    state = after(system, worlds_of(system, 4), 2.0, by_gain(system))
    wait, belief = np.full(4, len(system.actions) - 1), state.belief
    belief.existence[0, np.argmax(belief.existence[0])] = 0.5  # a tentative track for certain
    is_confirmed, quiet = belief.existence >= CONFIRMED, np.zeros_like(belief.undetected)
    alone = (
        ("cost_undetected", belief._replace(existence=np.zeros_like(belief.existence))),
        ("cost_tentative", belief._replace(existence=np.where(is_confirmed, 0.0, belief.existence), undetected=quiet)),
        ("cost_confirmed", belief._replace(existence=np.where(is_confirmed, belief.existence, 0.0), undetected=quiet)),
    )
    now = system.predict(belief, wait)
    info = system.state_info(State(state.truth, now))
    closed = dataclasses.replace(system, targets=0.0)  # nobody comes meanwhile
    for name, part in alone:
        want = (system if name == "cost_undetected" else closed).predict(part, wait)
        assert info[name].max() > 0.0
        np.testing.assert_allclose(info[name], system.cost(want), rtol=1e-9)
    np.testing.assert_allclose(sum(info[name] for name, _ in alone), system.cost(now), rtol=1e-12)


def test_an_update_of_a_free_slot_is_a_wait():
    system = MultifunctionRadar(known=0.0, settled=0.0)
    worlds = worlds_of(system, 2)
    state = system.initial(worlds)
    assert not system.mask(state.belief)[:, : system.slots * 4].any()
    updated = system.transition(state, np.full(2, 7), worlds)
    waited = system.transition(state, np.full(2, len(system.actions) - 1), worlds)
    assert system.state_info(updated)["replaced"].all()
    assert not system.state_info(waited)["replaced"].any()
    for a, b in zip(updated.belief, waited.belief, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("kind", ["update", "search"])
def test_futures_conserve_the_expected_number_of_targets(kind):
    """Existence by Bayes's rule is a martingale: over the draws, tracks and undetected sum to what was expected.

    Nothing is dropped. Draws (i + 0.5) / 400 are a quadrature of the uniform distribution.
    """
    system = MultifunctionRadar(known=1.0, dropped=0.0)
    worlds = worlds_of(system, 1)
    state = after(system, worlds, 1.0, by_gain(system))
    belief = state.belief
    belief.existence[0, belief.existence[0] > 0] = 0.6
    action = system.dwells.update(0, 1) if kind == "update" else system.dwells.search(3, 2)
    assert system.mask(belief)[0, action]
    draws = np.stack([(np.arange(400) + 0.5) / 400, np.full(400, 0.5)], axis=1)
    futures = system.predict(belief, np.full((1, 400), action), draws[None])
    waited = system.predict(belief, np.array([action]))
    number = futures.existence.sum(axis=2) + futures.undetected.sum(axis=(2, 3, 4))
    want = waited.existence.sum() + waited.undetected.sum()
    assert number.mean() == pytest.approx(want, abs=2.0 / 400)
    assert len(np.unique((futures.existence > 0.0).sum(axis=2) if kind == "search" else number.round(3))) > 1


@pytest.mark.slow
def test_the_gain_of_an_update_is_what_its_futures_save():
    """Until the track is as bad as it is now, against 400 futures.

    The gain updates one Gaussian for both modes of motion, which saves up to a tenth less.
    """
    system = MultifunctionRadar(known=1.0, dropped=0.0)
    belief = after(system, worlds_of(system, 1), 0.7, by_gain(system)).belief
    draws, seconds = np.random.default_rng(0).random((1, 400, 2)), np.linspace(0.0, 8.0, 401)
    gains, both = shortcuts.gain_per_second(system, belief)[0], []

    def trace(belief, slot):
        return np.square(system.slots_now(belief)[:, slot, 4])

    for slot in np.flatnonzero(belief.existence[0] > 0.0)[:6].tolist():
        for dwell in (1, 3):
            action, e = int(system.dwells.update(slot, dwell)), belief.existence[0, slot]
            duration = system.dwells.menu[3][action]
            looked = system.predict(belief, np.full((1, 400), action), draws)
            looked = type(belief)(*(leaf[0] for leaf in looked))
            level = trace(belief._replace(time=belief.time + duration), slot)[0]
            found = trace(looked, slot) < level
            level = level if e * level + (1.0 - e) * system.c0 < e * system.c0 else system.c0
            later = np.array([trace(looked._replace(time=looked.time + s), slot) for s in seconds])
            assert (later[-1] > level).all()
            saved = found * np.trapezoid(np.maximum(level - later, 0.0), seconds, axis=0)
            error = 4.0 * saved.std() / np.sqrt(400)
            assert abs(gains[action] * duration - saved.mean()) < 0.25 * saved.mean() + error, (slot, dwell)
            both.append((gains[action] * duration, saved.mean()))
    assert 0.9 < np.divide(*np.sum(both, axis=0)) < 1.0


def test_the_gain_of_a_search_is_what_its_finds_are_worth():
    system = MultifunctionRadar(known=1.0, slots=30)
    belief = after(system, worlds_of(system, 3), 0.5, by_gain(system)).belief
    together = shortcuts.gain_per_second(system, belief, 2.0, (0.0, 0.7))
    for n, power in enumerate((0.0, 0.7)):
        np.testing.assert_array_equal(together[..., n], shortcuts.gain_per_second(system, belief, 2.0, power))
    for action in (system.dwells.search(0, 1), system.dwells.search(7, 3)):
        _, which, train, duration = (column[action] for column in system.dwells.menu)
        for e in range(3):
            i, left = next_beam(which, belief.turn[e, which], system.area), belief.undetected[e].copy()
            thin(left, i, system.menu.covers[train, i])
            found = belief.undetected[e] - left
            want = 2.0 * system.c0 / duration * np.array([found.sum(), (found * system.value_of_find**0.7).sum()])
            np.testing.assert_allclose(together[e, action], want, rtol=1e-9)


@pytest.mark.slow
def test_simulated_futures_are_those_of_predict_and_the_rule():
    """Mean cost of 0.15 s and of the time after, in which all wait, against a loop over predictions with draws.

    Of 1500 futures each, to four standard errors.
    """
    system = MultifunctionRadar(known=1.0)
    state = after(system, worlds_of(system, 1), 0.5, by_gain(system))
    belief = state.belief._replace(undetected=np.zeros_like(state.belief.undetected))
    system = dataclasses.replace(system, targets=0.0)  # searches find nothing, and no draw is needed for them
    first, rng = int(system.dwells.update(0, 2)), np.random.default_rng(0)
    futures, seconds, rule = 1500, 0.15, DwellRule(worth=1.0)
    got = shortcuts.simulate(system, belief, np.array([[first]]), rule, seconds, futures)[0, 0]
    now = trees.repeated(belief, futures)
    waits = np.full(futures, len(system.actions) - 1)
    end, action, want = now.time + seconds, np.full(futures, first), np.zeros(futures)

    def to_come(belief):
        waiting = dataclasses.replace(system, dt=AFTER)
        return waiting.predict(trees.repeated(belief, 1), waits).spent.sum(axis=-1)

    while (going := now.time < end).any():
        after_dwell = system.predict(now, action, rng.random((futures, 2)))
        spent, share = after_dwell.spent.sum(axis=-1), (end - now.time) / after_dwell.duration
        last = share * (spent + to_come(after_dwell)) + (1.0 - share) * to_come(now)
        want += np.where(going, np.where(share > 1.0, spent, last), 0.0)
        now = trees.merged(after_dwell, ~going, now)
        action = np.where(system.mask(now), shortcuts.scores(system, now, rule), -np.inf).argmax(axis=1)
    error = want.std() / np.sqrt(futures)
    assert error < 0.02 * want.mean()
    assert abs(got - want.mean()) < 4.0 * np.sqrt(2.0) * error


@pytest.mark.slow
def test_gospa_is_that_of_the_reported_tracks():
    """At each of 60 dwells, in the worlds whose figures are due there."""
    system = MultifunctionRadar(targets=5.0, sample=0.07)
    worlds, choose, compared = worlds_of(system, 6), by_gain(system), 0
    state = after(system, worlds, 3.0, choose)
    for _ in range(60):
        before, state = state, system.transition(state, choose(state.belief, system.mask(state.belief)), worlds)
        due = state.belief.time // system.sample > before.belief.time // system.sample
        made, e = estimates(state.belief, system.modes), state.belief.existence
        trace = made.covariance[..., 0, 0] + made.covariance[..., 2, 2]
        reported = e * trace + (1 - e) * system.c0 < e * system.c0
        seen = places(state, system)[..., [0, 2]][:, :12], made.mean[..., [0, 2]]
        want = gospa(*seen, state.truth.here[:, :12], reported, cutoff=np.sqrt(2 * system.c0))
        assert not state.truth.here[:, 12:].any()
        unfound, lost, false, error = state.truth.square_gospa[due].T
        np.testing.assert_allclose(unfound + lost, want.missed[due], rtol=1e-9)
        np.testing.assert_allclose(false, want.false[due], rtol=1e-9)
        np.testing.assert_allclose(error, want.localisation[due], rtol=1e-9)
        compared += due.sum()
    assert compared > 20


@pytest.mark.slow
def test_traffic_is_in_equilibrium():
    """Over 400 worlds of straight flight: the number, and its distribution over range bins, before and after 40 s."""
    system = MultifunctionRadar(acceleration=(0.0, 0.0), farthest=40e3, seconds=50.0)
    worlds, counts = worlds_of(system, 400), []
    state, wait = system.initial(worlds), np.full(400, len(system.actions) - 1)
    system = MultifunctionRadar(acceleration=(0.0, 0.0), farthest=40e3, seconds=50.0, dt=1.0)
    for _ in range(41):
        x = places(state, system)
        bins = ((np.hypot(x[..., 0], x[..., 2]) - 5e3) / 5e3).astype(int)
        counts.append(np.bincount(bins[state.truth.here].clip(0, 6), minlength=7) / 400)
        state = system.transition(state, wait, worlds)
    want = system.usual_numbers.sum(axis=0)
    for count in (counts[0], counts[-1]):
        assert (np.abs(count - want) < 4.0 * np.sqrt(want / 400)).all(), (count, want)


@pytest.mark.slow
def test_beliefs_agree_with_the_truth():
    """Over 48 worlds under the one-step rule: existence, the undetected, the cost and the NEES against the truth.

    Expected numbers of targets are within three standard errors; a tenth is left for the approximations of the filter
    (one Gaussian a mode, a sector's beams alike).
    """
    system = MultifunctionRadar(targets=8.0, seconds=15.0)
    worlds, choose = worlds_of(system, 48), by_gain(MultifunctionRadar(targets=8.0))
    state, believed, actual, rates, distances, nees = system.initial(worlds), [], [], [], [], []
    sampled = 5.0
    while state.belief.time.min() < 14.9:
        state = system.transition(state, choose(state.belief, system.mask(state.belief)), worlds)
        if state.belief.time.min() > sampled:
            sampled += 1.0
            belief, truth = state.belief, state.truth
            rows = np.arange(48)[:, None]
            made = estimates(belief, system.modes)
            apart = np.linalg.norm((made.mean - places(state, system)[rows, truth.origin])[..., [0, 2]], axis=-1)
            wide = np.sqrt(made.covariance[..., 0, 0] + made.covariance[..., 2, 2])
            held = (belief.existence > 0) & (truth.origin >= 0) & truth.here[rows, truth.origin] & (apart < 4 * wide)
            believed.append(belief.existence.sum(axis=1))
            actual.append(held.sum(axis=1))
            rates.append(belief.spent.sum(axis=-1) / belief.duration)
            distances.append(truth.square_gospa.sum(axis=1))
            nees.append(truth.nees[truth.present])
    for got, want, room in ((believed, actual, 0.1), (rates, distances, 0.1)):
        gap = np.mean(got, axis=0) - np.mean(want, axis=0)
        assert abs(gap.mean()) < room * np.mean(want) + 3.0 * gap.std() / np.sqrt(48)
    assert 3.2 < np.concatenate(nees).mean() < 4.4  # accelerations last for a cell, and the tracker takes them as white
    assert CONFIRMED == 0.9


@pytest.mark.slow
def test_tracks_of_targets_with_one_motion_model_are_consistent():
    """Where no mixture is left to approximate, the NEES is chi-squared: its mean and its tail beyond the 0.99 quantile.

    Accelerations change fast enough to be white, and few are refused at the limits of speed. Beyond the quantile of one
    in a million a track follows another target, and counts as there. Intervals are three standard errors from the
    spread over worlds, and a twentieth for what is no Gaussian: offsets after a miss or of a new track.
    """
    system = MultifunctionRadar(
        targets=8.0, seconds=20.0, cell=0.02, acceleration=(95.0, 95.0), speeds=(50.0, 600.0)
    )  # fmt: skip
    worlds, choose = worlds_of(system, 64), by_gain(system)
    state, nees, present, sampled = system.initial(worlds), [], [], 2.0
    while state.belief.time.min() < 19.9:
        state = system.transition(state, choose(state.belief, system.mask(state.belief)), worlds)
        if state.belief.time.min() > sampled:
            sampled += 1.0
            nees.append(state.truth.nees.copy())
            present.append(state.truth.present.copy())
    counts, nees = np.sum(present, axis=(0, 2)), np.minimum(nees, chi2.ppf(1.0 - 1e-6, 4))
    for values, want in ((nees, 4.0), (nees > chi2.ppf(0.99, 4), 0.01)):
        totals = np.where(present, values, 0.0).sum(axis=(0, 2))
        mean = totals.sum() / counts.sum()
        error = np.sqrt(np.square(totals - mean * counts).sum()) / counts.sum()
        assert abs(mean - want) < 3.0 * error + 0.05 * want, (mean, error)
        assert error < 0.2 * want


def test_a_priority_weighs_the_cost_of_every_target_by_its_range():
    """Of tracks one by one, of the undetected bin by bin, of what updates gain, and of the truth."""
    plain, weighted = MultifunctionRadar(settled=0.0), MultifunctionRadar(settled=0.0, priority=5.0)
    state = after(plain, worlds_of(plain, 4), 2.0, by_gain(plain))
    rows, wait = plain.slots_now(state.belief), np.full(4, len(plain.actions) - 1)

    def weight(r):
        return 1.0 + 4.0 * (30e3 - r) / 25e3

    def ratio(belief):
        return heavy.cost(heavy.predict(belief, wait)) / light.cost(light.predict(belief, wait))

    light, heavy = (dataclasses.replace(system, targets=0.0) for system in (plain, weighted))  # nobody comes meanwhile
    empty = state.belief._replace(undetected=np.zeros_like(state.belief.undetected))
    for k in range(8):
        taken = rows[:, k, 0] > 0.0
        alone = np.where(np.arange(plain.slots) == k, empty.existence, 0.0)
        got = ratio(empty._replace(existence=alone))[taken]
        np.testing.assert_allclose(got, weight(rows[taken, k, 1]), rtol=1e-3)  # it flies on meanwhile
    seen = plain.mask(empty) & (plain.dwells.menu[0] == UPDATE)
    r = rows[np.nonzero(seen)[0], plain.dwells.menu[1][np.nonzero(seen)[1]], 1]
    light_gains, heavy_gains = (shortcuts.gain_per_second(each, empty)[seen] for each in (plain, weighted))
    assert (light_gains > 0.0).mean() > 0.9
    np.testing.assert_allclose(heavy_gains, weight(r) * light_gains, rtol=1e-2)
    silent = empty._replace(existence=np.zeros_like(empty.existence))
    for b in range(plain.bins):
        one = np.zeros_like(empty.undetected)
        one[:, :, b] = 1e-3
        middle = 5e3 + (b + 0.5) * 25e3 / 7
        now = silent._replace(undetected=one)
        np.testing.assert_allclose(ratio(now), weight(middle), rtol=1e-3)
    blind = dataclasses.replace(weighted, known=0.0)
    first = blind.initial(worlds_of(blind, 4)).truth
    r = np.hypot(first.state[..., 0], first.state[..., 2])
    np.testing.assert_allclose(
        first.square_gospa.sum(axis=1), (weight(r) * first.here).sum(axis=1) * blind.c0, rtol=1e-12
    )
