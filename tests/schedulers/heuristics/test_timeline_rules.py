"""Rules for one beam on a time line: what each chooses, from beliefs of the multifunction radar."""

from __future__ import annotations

import numpy as np
import pytest

from wavegym.core import shortcuts
from wavegym.core.traits import CONFIRMED, DwellRule
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.schedulers.heuristics.timeline_rules import (
    DelayIndex,
    EarliestDeadline,
    GainPerSecond,
    PriceOfTime,
    RoundRobinSearch,
    SearchedDwell,
    VanKeukBlackman,
)
from wavegym.schedulers.registry import make_policy
from wavegym.systems.multifunction_radar.step_kernels import SEARCH, UPDATE
from wavegym.systems.multifunction_radar.system import MultifunctionRadar

SYSTEM = MultifunctionRadar(known=1.0, slots=30)
KIND, WHICH, SECONDS, DURATION = SYSTEM.dwells.menu


@pytest.fixture(scope="module")
def beliefs():
    """Of 20 worlds after 250 dwells of the one-step rule: tracks of many ages, some of them tentative."""
    worlds = draw_worlds(SYSTEM, world_seeds(0, "tune", 20))
    state = SYSTEM.initial(worlds)
    for _ in range(250):
        state = SYSTEM.transition(state, chosen(GainPerSecond(0.5, 0.75), state.belief), worlds)
    return state.belief


def chosen(rule, belief):
    rule.begin(SYSTEM, len(belief.step), np.random.default_rng(0))
    return rule.act(belief, None, SYSTEM.mask(belief))


def test_round_robin_keeps_its_share_and_takes_the_oldest_track_and_the_next_sector(beliefs):
    actions = np.stack(
        [chosen(RoundRobinSearch(0.3, 1, 2), beliefs._replace(step=beliefs.step + n)) for n in range(40)]
    )
    searches = KIND[actions] == SEARCH
    assert (searches.sum(axis=0) == 12).all()
    for column, is_search in zip(actions.T, searches.T, strict=True):
        sectors = WHICH[column[is_search]]
        np.testing.assert_array_equal(np.diff(sectors) % SYSTEM.sectors, 1)
    rows = SYSTEM.slots_now(beliefs)
    oldest = np.where(rows[..., 0] > 0, rows[..., 6], -1.0).argmax(axis=1)
    update = ~searches[0]
    assert (actions[0] == SYSTEM.dwells.update(oldest, 1))[update].all()


def test_the_most_overdue_track_comes_first_and_a_search_where_none_is_due(beliefs):
    rows = SYSTEM.slots_now(beliefs)
    late = rows[..., 6] - np.where(rows[..., 0] < 0.9, 0.05, 0.3)
    late[rows[..., 0] == 0.0] = -np.inf
    due = late.max(axis=1) >= 0.0
    actions = chosen(EarliestDeadline(0.3, 0.05, 2, 1), beliefs)
    assert due.any()
    assert (actions[due] == SYSTEM.dwells.update(late.argmax(axis=1), 2)[due]).all()
    never = chosen(EarliestDeadline(1e6, 1e6, 2, 1), beliefs)
    found = shortcuts.gain_per_second(SYSTEM, beliefs)[:, SYSTEM.dwells.search(np.arange(12), 1)]
    np.testing.assert_array_equal(never, SYSTEM.dwells.search(found.argmax(axis=1), 1))


def test_van_keuk_and_blackman_look_when_the_azimuth_is_uncertain_for_as_long_as_the_range_asks(beliefs):
    rows = SYSTEM.slots_now(beliefs)
    existence = rows[..., 0]
    confirmed = beliefs._replace(existence=np.where(existence >= 0.9, existence, 0.0))
    limit, snr = 0.03, 30.0
    pointing = np.where(existence >= 0.9, rows[..., 3], -1.0)
    actions = chosen(VanKeukBlackman(limit, snr, 0.0, 2), confirmed)
    due = pointing.max(axis=1) >= limit
    assert due.sum() > 0
    for e in np.flatnonzero(due):
        slot = pointing[e].argmax()
        strong = np.flatnonzero(rows[e, slot, 8] * np.array(SYSTEM.dwells.seconds) >= snr)
        dwell = strong[0] if len(strong) else 3
        assert actions[e] == SYSTEM.dwells.update(slot, dwell)
    assert (KIND[chosen(VanKeukBlackman(1e6, snr, 1e6, 2), beliefs)] == SEARCH).all()


def test_the_greatest_gain_per_second_is_taken_among_the_allowed(beliefs):
    gain = np.where(SYSTEM.mask(beliefs), shortcuts.gain_per_second(SYSTEM, beliefs, 0.7, 0.3), -np.inf)
    actions = chosen(GainPerSecond(0.7, 0.3), beliefs)
    np.testing.assert_array_equal(gain[np.arange(20), actions], gain.max(axis=1))
    usual = np.where(SYSTEM.mask(beliefs), shortcuts.gain_per_second(SYSTEM, beliefs), -np.inf).argmax(axis=1)
    np.testing.assert_array_equal(chosen(make_policy("myopic", SYSTEM, None), beliefs), usual)


def test_a_price_of_time_shortens_dwells_until_only_the_ratio_counts(beliefs):
    free, dear = (DURATION[chosen(PriceOfTime(0.5, 0.75, price), beliefs)] for price in (0.0, 3.0))
    assert free.mean() > dear.mean()
    at_any_price = chosen(PriceOfTime(0.5, 0.75, 1e9), beliefs)
    np.testing.assert_array_equal(at_any_price, chosen(GainPerSecond(0.5, 0.75), beliefs))


def test_the_score_is_the_formula_of_the_rule(beliefs):
    rule = DwellRule(-0.2, 0.9, worth=2.0, power=0.7, long_search=0.3, far=0.6, age=-0.4)
    is_update, k = KIND == UPDATE, WHICH[KIND == UPDATE]
    x, age = beliefs.mean[:, :, 0], beliefs.time[:, None] - beliefs.updated
    with np.errstate(divide="ignore"):
        score = np.log(shortcuts.gain_per_second(SYSTEM, beliefs, rule.worth, rule.power))
        powers = rule.far * np.log(np.hypot(x[..., 0], x[..., 2]) / SYSTEM.farthest)
    powers += rule.age * np.log(np.maximum(age, 0.01) / 0.1)
    long = np.where(beliefs.existence < CONFIRMED, rule.tentative, rule.long)[:, k]
    score[:, is_update] += long * np.log(DURATION[is_update] / 0.01) + powers[:, k]
    score[:, ~is_update] += rule.long_search * np.log(DURATION[~is_update] / 0.01)
    seen = np.isfinite(score)
    np.testing.assert_allclose(shortcuts.scores(SYSTEM, beliefs, rule)[seen], score[seen], rtol=1e-12, atol=1e-12)
    assert seen.sum() > 1000


@pytest.mark.parametrize(
    "rule",
    [
        DelayIndex(0.5, 0.75, 0.3, 0.0),
        SearchedDwell(),
    ],
    ids=lambda rule: rule.name,
)
def test_at_neutral_constants_a_rule_is_gain_per_second(rule, beliefs):
    np.testing.assert_array_equal(chosen(rule, beliefs), chosen(GainPerSecond(0.5, 0.75), beliefs))


def test_what_a_delay_costs_counts(beliefs):
    """Where a gain hardly changes with time, such as that of a search, a share of it is left out."""
    updates = [(KIND[chosen(DelayIndex(0.5, 0.75, 0.3, kappa), beliefs)] == UPDATE).mean() for kappa in (0.0, 0.95)]
    assert updates[0] != updates[1]
