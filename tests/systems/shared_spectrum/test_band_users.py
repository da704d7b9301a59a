"""Other users of the band: each kind keeps its law, and has its random numbers before the first action."""

from __future__ import annotations

from typing import Any

import numpy as np
import oracles
import pytest

from wavegym.core.errors import InputError
from wavegym.core.parameters import make_checked
from wavegym.systems.shared_spectrum import SharedSpectrum
from wavegym.systems.shared_spectrum.user_kernels import COME, HOME, LEAVE, NOISE, OFF, PERIOD, PLACE, STRIDE, WIDTH

KINDS = ("static", "bursts", "stepped", "hopping", "listening")


def places(kind, bands, steps=60, count=200, **parameters):
    """The users (world, 7), and (step, world, 4) of a single user, while the radar sends ``bands(belief)``."""
    system = SharedSpectrum(users=(kind,), takeover=0.0, horizon=steps, history=8, **parameters)
    worlds = oracles.worlds(system, count)
    state, found = system.initial(worlds), []
    for _ in range(steps):
        found.append(state.truth.places[:, 0])
        state = system.transition(state, bands(system, state), worlds)
    return state.truth.users[:, 0], np.array(found)


def lowest(system, state):
    """The lowest channel alone."""
    return np.zeros(len(state.belief.step), np.int64)


def everything(system, state):
    """The whole spectrum."""
    return np.full(len(state.belief.step), system.bands.width.argmax())


def on_it(system, state):
    """The first channel of the user."""
    first = np.maximum(state.truth.places[:, 0, PLACE], 0)
    return np.array([np.flatnonzero((system.bands.first == c) & (system.bands.width == 1))[0] for c in first])


def test_a_static_user_stays_whatever_the_radar_does():
    _, found = places("static", everything)
    assert (found[..., PLACE] == found[0, :, HOME]).all()
    assert len(np.unique(found[..., PLACE])) > 4


def test_bursts_are_a_markov_chain():
    """The shares of steps that begin and end a burst are the drawn probabilities, to four standard errors in all."""
    users, found = places("bursts", lowest, 100)
    on = found[..., PLACE] != OFF
    for chance, state in ((users[:, COME], False), (users[:, LEAVE], True)):
        at = on[:-1] == state
        changed = (on[1:] != state) & at
        expected, spread = (at * chance).sum(), np.sqrt((at * chance * (1.0 - chance)).sum())
        assert abs(changed.sum() - expected) < 4.0 * spread
    assert (found[..., PLACE][on] == found[..., HOME][on]).all()


def test_a_stepped_user_moves_by_a_constant_number_of_channels():
    users, found = places("stepped", everything)
    room = 8 - users[:, WIDTH] + 1
    moved = np.diff(found[..., PLACE], axis=0)
    np.testing.assert_array_equal(moved % room, np.broadcast_to(found[0, :, STRIDE] % room, moved.shape))
    assert set(np.unique(found[..., STRIDE])) == {-3, -2, -1, 1, 2, 3}


def test_a_hopping_user_repeats_its_pattern():
    users, found = places("hopping", everything)
    for w, period in enumerate(users[:, PERIOD].astype(int)):
        path = found[:, w, PLACE]
        np.testing.assert_array_equal(path[period:], path[:-period])
    assert users[:, PERIOD].max() > 16  # beyond the history that an agent observes


def test_a_listening_user_leaves_after_a_collision_for_channels_that_are_free():
    """The radar sends where the user was, and hits it if it stayed; the user answers one step later."""
    users, found = places("listening", on_it, 100)
    before, now, after = found[:-2, :, PLACE], found[1:-1, :, PLACE], found[2:, :, PLACE]
    struck = (before == now) & (now == found[1:-1, :, HOME])  # elsewhere it may also return
    expected = struck * users[:, LEAVE]
    assert abs((struck & (after != now)).sum() - expected.sum()) < 4.0 * np.sqrt((expected * (1.0 - expected)).sum())
    left = struck & (after != now)
    width = np.broadcast_to(users[:, WIDTH], now.shape)
    assert ((after > now) | (after + width <= now))[left].all()  # never on the channel that the radar took


def test_a_listening_user_returns_home_when_it_is_free():
    """It is pushed away once, and comes back with the drawn probability."""

    def once(system, state):
        return np.where(state.belief.step == 0, on_it(system, state), on_it(system, state) * 0 + idle(system, state))

    def idle(system, state):
        """A channel that is neither the user's nor its home."""
        taken = [state.truth.places[:, 0, k][:, None] + np.arange(2) for k in (PLACE, HOME)]
        free = [[c for c in range(8) if c not in row] for row in np.concatenate(taken, axis=1).tolist()]
        first = np.array([row[0] for row in free])
        return np.array([np.flatnonzero((system.bands.first == c) & (system.bands.width == 1))[0] for c in first])

    users, found = places("listening", once, 60, 400)
    away = found[:-1, :, PLACE] != found[:-1, :, HOME]
    back = away & (found[1:, :, PLACE] == found[1:, :, HOME])
    # a home that overlaps the user's own channels is not free, so count the others
    apart = away & (abs(found[:-1, :, PLACE] - found[:-1, :, HOME]) >= users[:, WIDTH])
    expected = apart * users[:, COME]
    assert abs((back & apart).sum() - expected.sum()) < 4.0 * np.sqrt((expected * (1.0 - users[:, COME])).sum())


def test_a_listening_user_waits_where_nothing_is_free():
    _, found = places("listening", everything, 100)
    assert (found[2:, :, PLACE] == OFF).any()
    _, found = places("listening", everything, 30)
    waits = found[..., PLACE] == OFF
    assert waits[-1].mean() > 0.99  # the radar takes all channels, and every user leaves in the end


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "listening"])
def test_users_that_do_not_listen_are_the_same_under_every_policy(kind):
    one, two = (places(kind, bands)[1] for bands in (lowest, everything))
    np.testing.assert_array_equal(one, two)


def test_reactive_users_read_the_tape_at_the_step():
    """Two policies that differ in one step only: users that the step did not touch go on alike."""
    system = SharedSpectrum(users=("listening",) * 3, horizon=30)
    worlds = oracles.worlds(system, 300)
    states = [system.initial(worlds)] * 2
    for k in range(30):
        moves = [lowest(system, s) for s in states]
        if k == 5:
            moves[1] = everything(system, states[1]) * 0 + 8  # one other channel
        states = [system.transition(s, a, worlds) for s, a in zip(states, moves, strict=True)]
    same = (states[0].truth.places == states[1].truth.places).all(axis=(1, 2))
    assert 0.2 < same.mean() < 1.0


def test_takeovers_move_a_user_as_often_as_stated():
    system = SharedSpectrum(users=("static",), takeover=0.2, horizon=100)
    worlds = oracles.worlds(system, 100)
    state, homes = system.initial(worlds), []
    for _ in range(100):
        homes.append(state.truth.places[:, 0, HOME])
        state = system.transition(state, lowest(system, state), worlds)
    changed = (np.diff(homes, axis=0) != 0).mean()
    room = 8 - state.truth.users[:, 0, WIDTH] + 1
    expected = 0.2 * (1.0 - 1.0 / room).mean()  # the next user may have the same channel
    assert abs(changed - expected) < 4.0 * np.sqrt(expected * (1.0 - expected) / (99 * 100))


def test_noise_is_that_of_the_users_in_their_channels_and_beside_them():
    system = SharedSpectrum(users=("static",), spill=10.0, takeover=0.0)
    state = system.initial(oracles.worlds(system, 50))
    for world in range(50):
        user, place = state.truth.users[world, 0], state.truth.places[world, 0, PLACE]
        expected = np.ones(8)
        above = int(place + user[WIDTH])
        expected[place:above] += user[NOISE]
        for c in (place - 1, above):
            if 0 <= c < 8:
                expected[c] += 0.1 * user[NOISE]
        np.testing.assert_allclose(state.truth.noise[world], expected)


class Follower:
    """A user of one's own: it is where the radar was, or at a drawn channel."""

    draws = 1

    def begin(self, uniform, channels):
        return (uniform[:, 0] * channels).astype(np.int64)

    def advance(self, state, band, uniform):
        drawn = (uniform[:, 0] * band.shape[1]).astype(np.int64)
        state = np.where(band.any(axis=1), band.argmax(axis=1), drawn)
        return state, 50.0 * (np.arange(band.shape[1]) == state[:, None])


def test_a_users_own_kind_plays():
    system = SharedSpectrum(users=("static", Follower()), horizon=20, history=4)
    worlds = oracles.worlds(system, 40)
    state = system.initial(worlds)
    drawn: Any = state.truth.own[0][0]
    assert len(np.unique(drawn)) > 4
    bands = np.random.default_rng(0).integers(36, size=(20, 40))
    for action in bands:
        state = system.transition(state, action, worlds)
        last = system.bands.first[action]
    moved = system.transition(state._replace(belief=state.belief._replace(step=np.full(40, 19))), bands[0], worlds)
    np.testing.assert_array_equal(moved.truth.own[0][0], last)
    assert (moved.truth.noise[np.arange(40), last] >= 51.0).all()
    alone = SharedSpectrum(users=(Follower(),), horizon=20, history=4)
    worlds = oracles.worlds(alone, 10)
    state = alone.initial(worlds)
    for _ in range(3):
        state = alone.transition(state, np.full(10, 35), worlds)  # the uppermost channel, which the user follows
    assert (alone.state_info(state)["collisions"] == 1.0).all()


@pytest.mark.parametrize(
    ("noise", "message"),
    [
        (np.full((3, 8), np.nan), "is nan, expected finite numbers >= 0"),
        (np.full((3, 8), -3.0), "is -3, expected finite numbers >= 0"),
        (np.full((3, 8), np.inf), "is inf, expected finite numbers >= 0"),
        (np.zeros((8, 3)), r"has shape \(8, 3\), expected \(3, 8\)"),
        (1j * np.ones((3, 8)), "is complex128, expected real numbers"),
    ],
)
def test_noise_of_a_users_own_kind_is_checked(noise, message):
    class Loud(Follower):
        def advance(self, state, band, uniform):
            return state, noise

    system = SharedSpectrum(users=(Loud(),))
    with pytest.raises(InputError, match=f"noise of user Loud {message}"):
        system.initial(oracles.worlds(system, 3))


def test_a_users_own_kind_returns_state_and_noise():
    class Forgetful(Follower):
        def advance(self, state, band, uniform):
            return 50.0 * band

    system = SharedSpectrum(users=(Forgetful(),))
    with pytest.raises(InputError, match=r"user Forgetful returned a ndarray from advance, expected \(state, noise\)"):
        system.initial(oracles.worlds(system, 3))


def test_mistakes():
    for draws in (-1, 1.5, None, 10**9):
        with pytest.raises(InputError, match="draws of user Greedy is"):
            make_checked(SharedSpectrum, {"users": (type("Greedy", (Follower,), {"draws": draws})(),)})
    with pytest.raises(InputError, match=r"user is <class .*Follower'>, expected .* or an object with draws"):
        make_checked(SharedSpectrum, {"users": (Follower,)})
    with pytest.raises(InputError, match=r"kind of user is 'statik', expected .*did you mean 'static'"):
        make_checked(SharedSpectrum, {"users": ("statik",)})
    with pytest.raises(InputError, match=r"user is 3, expected one of 'static', .* or an object with draws, begin"):
        make_checked(SharedSpectrum, {"users": (3,)})
