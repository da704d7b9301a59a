"""Windows of visibility: lengths, fractions, given windows."""

from __future__ import annotations

from itertools import groupby

import numpy as np
import oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wavegym.core.errors import InputError
from wavegym.evaluation.play import make_task
from wavegym.systems.visibility_windows import alternating_windows, coming, given_windows, window_draws

SHOWN, HIDDEN = (6, 14), (4, 10)


def lengths(visible):
    """(visible, steps) of each stay."""
    return [(bool(seen), len(list(steps))) for seen, steps in groupby(visible)]


def drawn(count, horizon, shown=SHOWN, hidden=HIDDEN, seed=0):
    uniforms = np.random.default_rng(seed).random((count, window_draws(horizon, shown, hidden)))
    return uniforms, alternating_windows(uniforms, horizon, shown, hidden)


def by_hand(uniforms, horizon, shown, hidden):
    """Stay after stay, step after step."""
    bounds = (shown, hidden) * len(uniforms)
    stays = [low + int(u * (high - low + 1)) for u, (low, high) in zip(uniforms[1:], bounds, strict=False)]
    steps = [i % 2 == 0 for i, stay in enumerate(stays) for _ in range(stay)]
    gone = int(uniforms[0] * (stays[0] + stays[1]))
    return steps[gone : gone + horizon]


@given(
    st.integers(0, 2**32 - 1), st.integers(1, 90), st.integers(1, 9), st.integers(0, 9), st.integers(1, 9),
    st.integers(0, 9)
)  # fmt: skip
def test_stays_have_their_lengths(seed, horizon, shortest, more, gap, wider):
    shown, hidden = (shortest, shortest + more), (gap, gap + wider)
    uniforms, visible = drawn(5, horizon, shown, hidden, seed)
    assert visible.shape == (5, horizon)
    assert visible.dtype == np.bool_
    for row, own in zip(uniforms, visible, strict=True):
        assert own.tolist() == by_hand(row, horizon, shown, hidden)
        stays = lengths(own)
        assert all(steps <= (shown if seen else hidden)[1] for seen, steps in stays)
        assert all(steps >= (shown if seen else hidden)[0] for seen, steps in stays[1:-1])


def test_lengths_and_phases_are_equally_likely():
    """Counts within five standard deviations of the binomial distribution; visible in about 10 of 17 steps."""
    _, visible = drawn(20_000, 60)
    stays = [stay for own in visible[:4000] for stay in lengths(own)[1:3]]  # later stays are complete
    for seen, (low, high) in ((True, SHOWN), (False, HIDDEN)):
        counts = np.bincount([steps for own, steps in stays if own == seen], minlength=high + 1)
        share, total = 1 / (high - low + 1), counts.sum()
        assert counts[:low].sum() == 0
        assert np.abs(counts[low:] - share * total).max() < 5 * np.sqrt(share * total)
    s, h = np.meshgrid(np.arange(6, 15), np.arange(4, 11))
    begin = (s / (s + h)).mean()
    assert abs(visible[:, 0].mean() - begin) < 5 * 0.5 / np.sqrt(20_000)
    assert abs(visible.mean() - 10 / 17) < 0.01


def test_each_by_itself_as_in_a_batch():
    uniforms, visible = drawn(12, 60)
    np.testing.assert_array_equal(alternating_windows(uniforms.reshape(3, 4, -1), 60), visible.reshape(3, 4, 60))
    np.testing.assert_array_equal(alternating_windows(uniforms[5], 60), visible[5])


def test_long_episodes_need_no_array_of_steps_times_stays():
    """It would hold 1.6e11 elements."""
    uniforms = np.random.default_rng(0).random((2, 4, window_draws(100_000, (6, 14), (4, 10))))
    visible = alternating_windows(uniforms, 100_000)
    assert visible.shape == (2, 4, 100_000)
    assert pytest.approx(visible.mean(), abs=0.01) == 10 / 17  # the mean stays are 10 and 7 steps


def test_draws_at_the_ends():
    """All 0: shortest stays from their start; all 1, which no generator draws: longest stays, the first nearly over."""
    needed = window_draws(60, SHOWN, HIDDEN)
    assert lengths(alternating_windows(np.zeros(needed), 60))[:3] == [(True, 6), (False, 4), (True, 6)]
    assert lengths(alternating_windows(np.ones(needed), 60))[:3] == [(False, 1), (True, 14), (False, 10)]


def test_nothing_hidden():
    assert drawn(4, 30, hidden=(0, 0))[1].all()


def test_given_windows_hide_their_steps_and_no_others():
    visible = given_windows(((1, 3, 5), (0, 0, 0), (1, 9, 9)), 3, 10)
    assert sorted(zip(*np.nonzero(~visible), strict=True)) == [(0, 0), (3, 1), (4, 1), (5, 1), (9, 1)]
    assert given_windows((), 2, 5).all()


@pytest.mark.parametrize(
    ("window", "words"),
    [
        ((3, 0, 1), r"target of hidden window \(3, 0, 1\) is 3.*nearest: 2"),
        ((-1, 0, 1), "target .* is -1"),
        ((0, -1, 4), "first step .* is -1.*nearest: 0"),
        ((0, 10, 10), "first step .* is 10.*nearest: 9"),
        ((0, 4, 10), "last step .* is 10.*nearest: 9"),
        ((0, 4, 3), "last step .* is 3.*nearest: 4"),
    ],
)
def test_windows_outside_the_episode_are_refused(window, words):
    with pytest.raises(InputError, match=words):
        given_windows((window,), 3, 10)


@pytest.mark.parametrize(
    ("shown", "hidden", "words"),
    [
        ((0, 3), HIDDEN, "shown is 0"),
        ((5, 3), HIDDEN, r"shown is \(5, 3\).*nearest: \(3, 5\)"),
        (SHOWN, (-1, 3), "hidden is -1"),
        (SHOWN, (7, 3), "hidden"),
    ],
)
def test_bounds_that_make_no_windows_are_refused(shown, hidden, words):
    with pytest.raises(InputError, match=words):
        alternating_windows(np.zeros(99), 10, shown, hidden)


def test_too_few_draws_are_refused():
    with pytest.raises(InputError, match=r"uniforms have shape \(2, 14\), expected \(..., n\) with n >= 15"):
        alternating_windows(np.zeros((2, 14)), 60)


@pytest.mark.parametrize("name", ["BeamAllocation", "CameraSlew", "SectorSetup"])
@pytest.mark.parametrize("windows", [(), ((2, 5, 9), (0, 0, 59))])
def test_what_is_observed_is_what_comes(name, windows):
    """Whether a target is visible, for how long at most ten steps, and in what share of them; none is at the end."""
    system = make_task(name, {"windows": windows} if windows else {}).system
    worlds, column = oracles.worlds(system, 20), {e.name: i for i, e in enumerate(system.observation_fields)}
    state, count = system.initial(worlds), system.horizon
    visible, targets = state.belief.visible, state.belief.visible.shape[2]
    if windows:
        np.testing.assert_array_equal(visible, np.tile(given_windows(windows, targets, count), (20, 1, 1)))
    for k in range(count + 1):
        seen = system.observe(state.belief)
        ahead = np.pad(visible, ((0, 0), (0, 11), (0, 0)))[:, k : k + 10]
        differs = ahead != ahead[:, :1]
        changes = np.where(differs.any(axis=1), differs.argmax(axis=1), 10)
        for t in range(targets):
            wanted = (
                ("visible", ahead[:, 0, t]),
                ("changes", changes[:, t]),
                ("soon_visible", ahead[..., t].mean(axis=1)),
            )
            for field, want in wanted[: 2 if name == "CameraSlew" else 3]:
                np.testing.assert_allclose(seen[:, column[f"{field}_{t + 1}"]], want, atol=1e-12)
        if k < count:
            state = system.transition(state, np.zeros(20, int), worlds)


@given(st.integers(0, 2**32), st.integers(1, 12))
def test_what_comes_is_read_off_the_windows(seed, most):
    rng = np.random.default_rng(seed)
    visible, step = rng.random((3, 8, 2)) < 0.6, rng.integers(0, 9, 3)
    found = coming(visible, step, most)
    for e in range(3):
        for t in range(2):
            ahead = [k < 8 and bool(visible[e, k, t]) for k in range(step[e], step[e] + most)]
            change = next((k for k, seen in enumerate(ahead) if seen != ahead[0]), most)
            got = found.now[e, t], found.changes[e, t], found.share[e, t]
            assert got == (ahead[0], change, sum(ahead) / most)
