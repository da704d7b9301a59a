"""The sector set-up on an urban map: starts on roads, visibility against shapely, and its prediction."""

from __future__ import annotations

import numpy as np
import oracles
import pytest
import sector_setup_oracle as plain
import shapely
from scipy.stats import kstest

from wavegym.core import shortcuts
from wavegym.core.errors import InputError
from wavegym.core.parameters import make_checked
from wavegym.observations.forecasts import Forecasts
from wavegym.schedulers.heuristics.index_policies import CostOfDelay
from wavegym.sensors import Antenna
from wavegym.systems.sector_setup.city import SectorSetupCity, spread_places
from wavegym.systems.sector_setup.state import Measurements, sector_fields
from wavegym.systems.sector_setup.visibility_kernels import BLUR

SYSTEM = SectorSetupCity()


@pytest.mark.slow
def test_targets_start_on_roads_and_drive_along_their_right_hand_side():
    truth = SYSTEM.initial(oracles.worlds(SYSTEM, 400)).truth.targets.reshape(-1, 4)
    x, u, y, v = truth.T
    assert (v == 0.0).all()  # both roads lead from west to east
    assert SYSTEM.map.on_road(truth[:, ::2]).all()
    speed = np.abs(u)
    assert (speed >= 3.0).all()
    assert (speed <= 10.0).all()
    middle = np.where(y < 122.5, 110.0, 135.0)
    assert ((y < middle) == (u > 0)).all()
    for part in (y < 122.5, u > 0, x > 0):  # uniform along roads and over directions, within five standard errors
        assert abs(part.mean() - 0.5) < 5 * 0.5 / np.sqrt(len(truth))


def hidden_by_shapely(system, places):
    """Whether a building crosses a straight line from places (n, 2) to one of the antennas."""
    built = shapely.union_all([shapely.Polygon(each.corners) for each in system.map.buildings])
    lines = [
        shapely.linestrings(np.stack([places, np.broadcast_to(site, places.shape)], axis=1))
        for site in (system.illuminator, *system.receivers)
    ]
    return np.any([shapely.crosses(each, built) | shapely.within(each, built) for each in lines], axis=0)


def wander(system, count, seed=1):
    """Any target and waveform, changed once in five steps."""
    rng, last = np.random.default_rng(seed), np.zeros(count, np.int64)
    while True:
        drawn = rng.integers(len(system.actions), size=count)
        last = np.where(rng.random(count) < 0.2, drawn, last)
        yield last


def test_nobody_is_told_when_buildings_hide_a_target():
    belief = SYSTEM.initial(oracles.worlds(SYSTEM, 20)).belief
    assert belief.visible.all()
    assert SYSTEM.observation_fields == sector_fields(4, 2, 3, predicted=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    "change", [{}, {"truth": {"q": (0.05, 0.5), "turn_rate": 0.02}}], ids=["as assumed", "other world"]
)
def test_buildings_hide_targets_where_they_truly_are(change):
    """Every step of every target against shapely, and no detection of a hidden target.

    The straight course from the true start, taken for the truth, is wrong in a fifth of the target-steps; in the other
    world, in more.
    """
    system, count = make_checked(SectorSetupCity, change), 300
    worlds = oracles.worlds(system, count)
    state, rows = system.initial(worlds), np.arange(count)
    start, wrong, detections = state.truth.targets, [], 0
    for k, action in zip(range(system.horizon), wander(system, count), strict=False):
        state = system.transition(state, action, worlds)
        hidden = hidden_by_shapely(system, state.truth.targets[..., ::2].reshape(-1, 2)).reshape(count, -1)
        np.testing.assert_array_equal(state.truth.visible[:, k], ~hidden)
        assert (state.truth.detections[hidden[rows, action // 2]] == 0).all()
        detections += state.truth.detections.sum()
        course = start[..., ::2] + system.dt * (k + 1) * start[..., 1::2]
        wrong.append(hidden_by_shapely(system, course.reshape(-1, 2)) != hidden.ravel())
    assert 0.3 < state.truth.visible.mean() < 0.7
    assert detections > 5 * count
    assert np.mean(wrong) > 0.15


def test_predicted_visibility_is_as_frequent_as_true_visibility():
    """300 worlds with looks now and then: shares by decile of the probability, 1, 6 and 16 steps ahead.

    The bound is five standard errors of the mean over worlds, and 0.06 for the few places that are tried.
    """
    worlds, ahead = oracles.worlds(SYSTEM, 300), (1, 6, 16)
    state, told, came = SYSTEM.initial(worlds), [], []
    for k, action in zip(range(SYSTEM.horizon - max(ahead)), wander(SYSTEM, 300), strict=False):
        probability = SYSTEM.visible_ahead(state.belief, max(ahead))
        assert (probability >= 0).all()
        assert (probability <= 1).all()
        told.append(probability[:, [n - 1 for n in ahead]])
        came.append(state.truth.visible[:, [k + n - 1 for n in ahead]])
        state = SYSTEM.transition(state, action, worlds)
    told, came = np.array(told), np.array(came)
    for n in range(len(ahead)):
        for low in np.arange(0.0, 1.0, 0.2):
            chosen = (told[:, :, n] >= low) & (told[:, :, n] <= low + 0.2)
            error = np.where(chosen, came[:, :, n] - told[:, :, n], 0.0).sum(axis=(0, 2))
            spread = 5 * np.sqrt(np.square(error).sum()) / chosen.sum()
            assert abs(error.sum() / chosen.sum()) < spread + 0.06
    assert SYSTEM.visible_ahead(state.belief._replace(step=np.full(300, 58)), 4)[:, 2:].max() == 0.0


def test_predicted_visibility_is_right_after_a_detection():
    """400 worlds of a rule that keeps its tracks. A target was in sight a step ago: hidden places are unlikely.

    Without their lower weight a chance of 0.4 came in 0.7 of all cases.
    """
    worlds, rule = oracles.worlds(SYSTEM, 400, seed=11), CostOfDelay(alpha=0.2, later=6, ahead=20)
    rule.begin(SYSTEM, 400, np.random.default_rng(0))
    state, told, came, rows = SYSTEM.initial(worlds), [], [], np.arange(400)
    for k in range(SYSTEM.horizon):
        action, belief = rule.act(state.belief, None, None), state.belief
        found = (belief.looked == 1) & (belief.pointed == action // 2)
        told.append(SYSTEM.visible_ahead(belief, 1)[rows, 0, action // 2][found])
        came.append(state.truth.visible[rows, k, action // 2][found])
        state = SYSTEM.transition(state, action, worlds)
    told, came = np.concatenate(told), np.concatenate(came)
    doubtful = (told > 0.3) & (told < 0.9)
    assert doubtful.sum() > 200
    error = np.sqrt(np.mean(told[doubtful] * (1 - told[doubtful])) / doubtful.sum())
    assert abs(told[doubtful].mean() - came[doubtful].mean()) < 5 * error + 0.06


def many_places(system, x, P, count=50_000):
    """States drawn from a Gaussian, and whether they are visible."""
    rng = np.random.default_rng(3)
    states = x + rng.standard_normal((count, 4)) @ np.linalg.cholesky(P).T
    return states, np.logical_and.reduce([site.directly_visible(states[:, ::2]) for site in system._sites])


def wide(system, count, spread=12.0):
    """Beliefs about targets on the roads with wide priors, set up for target 0."""
    worlds = oracles.worlds(system, count, seed=5)
    state = system.initial(worlds)
    P = np.tile(np.diag([spread**2, 4.0, spread**2, 4.0]), (count, system.targets, 1, 1))
    P[..., 0, 1] = P[..., 1, 0] = P[..., 2, 3] = P[..., 3, 2] = spread
    zero = np.zeros(count, np.int64)
    return worlds, state.belief._replace(mean=state.truth.targets, covariance=P, pointed=zero, dead=zero)


@pytest.mark.slow
def test_a_look_that_finds_nothing_has_the_moments_of_the_hidden_places():
    """Against 50 000 drawn places, in 40 cases: the mean to 0.2 standard deviations, the covariance to 15 %, typically.

    The probability itself to 0.04 typically: 48 places are tried.
    """
    _, belief = wide(SYSTEM, 40)
    chance = SYSTEM.visible_ahead(belief, 1)[:, 0, 0]
    count, zero = len(chance), np.zeros(len(chance), np.int64)
    nothing = Measurements(np.zeros((count, 2, 2)), np.zeros((count, 2), np.bool_), np.zeros(count, np.bool_))
    after, before = SYSTEM.track(belief, zero, nothing), SYSTEM.predict(belief, zero + 2)
    assert (after.looked == -1).all()
    off = []
    for e in range(count):
        x, P = before.mean[e, 0], before.covariance[e, 0]
        states, clear = many_places(SYSTEM, x, P)
        found = 1 - np.prod(1 - plain.noise(SYSTEM, x, 0, belief.q[e, 0])[1])
        weight = 1 - found * clear
        weight /= weight.sum()
        mean = weight @ states
        covariance = (weight[:, None] * (states - mean)).T @ (states - mean)
        sigma = np.sqrt(np.diag(P))
        share = np.trace(after.covariance[e, 0]) / np.trace(covariance)
        off.append((chance[e] - clear.mean(), np.abs((after.mean[e, 0] - mean) / sigma).max(), np.log(share)))
    typical = np.sqrt(np.square(off).mean(axis=0))
    assert typical[0] < 0.04
    assert typical[1] < 0.2
    assert typical[2] < 0.15
    np.testing.assert_array_equal(after.mean[:, 1:], before.mean[:, 1:])


def test_a_look_at_a_target_that_cannot_hide_says_nothing():
    """All places visible: a miss is a failed detection, and leaves the estimate as predicted."""
    _, belief = wide(SYSTEM, 5)
    zero = np.zeros(5, np.int64)
    road = np.stack([np.arange(-100.0, 100.0), np.full(200, 110.0)], axis=1)
    hidden = hidden_by_shapely(SYSTEM, road)
    (middle,) = np.flatnonzero(~np.convolve(hidden, np.ones(9), "same").astype(bool))[:1]
    mean = np.tile([road[middle, 0], 0.0, 110.0, 0.0], (5, 4, 1))
    belief = belief._replace(mean=mean, covariance=0.04 * np.tile(np.eye(4), (5, 4, 1, 1)))
    assert (SYSTEM.visible_ahead(belief, 1) == 1.0).all()
    nothing = Measurements(np.zeros((5, 2, 2)), np.zeros((5, 2), np.bool_), np.zeros(5, np.bool_))
    after, coasted = SYSTEM.track(belief, zero, nothing), SYSTEM.predict(belief, zero + 2)
    np.testing.assert_array_equal(after.mean, coasted.mean)
    np.testing.assert_array_equal(after.covariance, coasted.covariance)


def test_a_predicted_miss_is_the_trackers():
    """A draw of a hidden place gives the mean, covariance and memory that the tracker has after such a step."""
    _, belief = wide(SYSTEM, 60)
    zero, misses = np.zeros(60, np.int64), 0
    nothing = Measurements(np.zeros((60, 2, 2)), np.zeros((60, 2), np.bool_), np.zeros(60, np.bool_))
    for _ in range(2):  # the second after a miss
        predicted = SYSTEM.predict(belief, zero, np.full((60, 3), 0.999))
        after = SYSTEM.track(belief, zero, nothing)
        assert (predicted.looked == -1).all()  # draws of 0.999 are no detections
        for name in ("mean", "covariance", "looked", "pointed", "dead"):
            np.testing.assert_allclose(getattr(predicted, name), getattr(after, name), rtol=1e-9, atol=1e-9)
        misses += (
            np.abs(after.covariance - SYSTEM.predict(belief, zero + 2).covariance).max(axis=(1, 2, 3)) > 1e-6
        ).sum()
        belief = after
    assert misses > 60


@pytest.mark.parametrize("last", [0, 1, -1], ids=["no look before", "found before", "nothing found before"])
def test_the_expected_outcome_is_the_mean_of_drawn_ones(last):
    """10^4 draws for each of 6 beliefs: mean covariance and detections within five standard errors."""
    _, belief = wide(SYSTEM, 6)
    belief = belief._replace(looked=np.full(6, last))
    rng, zero = np.random.default_rng(0), np.zeros(10_000, np.int64)
    for e in range(6):
        one = oracles.rows(belief, slice(e, e + 1))
        many = oracles.rows(belief, np.full(10_000, e))
        drawn = SYSTEM.predict(many, zero, rng.random((10_000, 3)))
        want = SYSTEM.predict(one, zero[:1])
        traces = np.trace(drawn.covariance[:, 0], axis1=1, axis2=2)
        assert abs(traces.mean() - np.trace(want.covariance[0, 0])) < 5 * traces.std() / 100 + 1e-9
        coasted = SYSTEM.predict(one, zero[:1] + 2).mean[0, 0]
        pd = plain.noise(SYSTEM, coasted, 0, one.q[0, 0])[1]
        share = SYSTEM.visible_ahead(one, 1)[0, 0, 0] * (1 - np.prod(1 - pd))
        assert abs((drawn.looked == 1).mean() - share) < 5 * np.sqrt(share * (1 - share) / 10_000) + 1e-9


def test_gain_is_what_a_look_takes_off_the_costs_to_come():
    """Against ``predict`` and beliefs without further looks, for the targets of which nothing hides the radar."""
    _, belief = wide(SYSTEM, 10)
    belief = belief._replace(dead=np.zeros(10, np.int64))
    gain = shortcuts.gain(SYSTEM, belief, 0, 8)
    for c in (0, 1):
        here, there = SYSTEM.predict(belief, np.full(10, c)), SYSTEM.predict(belief, np.full(10, 2))
        total = np.zeros(10)
        for _ in range(8):
            total += SYSTEM.cost(there) - SYSTEM.cost(here)
            dark = [b._replace(pointed=np.full(10, -1)) for b in (here, there)]
            here, there = (SYSTEM.predict(b, np.full(10, 2)) for b in dark)
        np.testing.assert_allclose(gain[:, c], total, rtol=1e-9, atol=1e-6)
    assert (gain[:, :2] > 0).any()


def test_forecasts_are_finite_where_a_look_may_raise_the_cost():
    worlds, forecasts, least = oracles.worlds(SYSTEM, 100), Forecasts(SYSTEM), 0.0
    state = SYSTEM.initial(worlds)
    for _, action in zip(range(SYSTEM.horizon), wander(SYSTEM, 100), strict=False):
        least = min(least, shortcuts.gain(SYSTEM, state.belief, 0, 8).min())
        with np.errstate(invalid="raise"):
            assert np.isfinite(forecasts(state.belief)).all()
        state = SYSTEM.transition(state, action, worlds)
    assert least < 0.0


def test_predicted_steps_are_counted():
    belief = SYSTEM.initial(oracles.worlds(SYSTEM, 1)).belief
    with pytest.raises(InputError, match="steps is 0"):
        SYSTEM.visible_ahead(belief, 0)


def test_places_have_the_moments_of_a_normal_distribution():
    points = spread_places(48)
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(points.T @ points / 48 + BLUR * np.eye(2), np.eye(2), atol=1e-12)
    radius = np.linalg.norm(points, axis=1) / np.sqrt(1 - BLUR)
    assert kstest(radius, "rayleigh").pvalue > 0.5


def test_direct_visibility_is_that_of_the_first_image():
    antenna, rng = Antenna(SYSTEM.map, (0.0, 0.0)), np.random.default_rng(0)
    points = rng.uniform((-200.0, 0.0), (200.0, 160.0), (50, 3, 2))
    np.testing.assert_array_equal(antenna.directly_visible(points), antenna.visible(points)[..., 0])
    assert antenna.directly_visible((0.0, 50.0)).shape == ()


def test_given_windows_replace_those_of_the_map():
    system = SectorSetupCity(windows=((1, 5, 9),))
    state = system.initial(oracles.worlds(SYSTEM, 2))
    for visible in state.belief.visible, state.truth.visible, system.visible_ahead(state.belief, 60):
        assert visible.sum() == visible.size - 2 * 5
    assert system.outcome_shape == (2,)
    assert system.observation_fields == sector_fields(4, 2, 3)
    assert system._radar.table.clear.size == 0


def test_a_map_without_roads_is_refused(tmp_path):
    file = tmp_path / "bare.toml"
    file.write_text("[[buildings]]\ncorners = [[0, 50], [10, 50], [10, 60]]\n")
    with pytest.raises(InputError, match="expected a map with roads"):
        make_checked(SectorSetupCity, {"city": str(file)})


def test_no_road_leads_through_a_building(tmp_path):
    file = tmp_path / "tunnel.toml"
    file.write_text(
        "[[buildings]]\ncorners = [[-20, 100], [20, 100], [20, 120], [-20, 120]]\n"
        "[[roads]]\ncentre = [[-150, 110], [150, 110]]\nwidth = 14\n"
    )
    with pytest.raises(InputError, match="leads into a building, expected roads outside all buildings"):
        make_checked(SectorSetupCity, {"city": str(file)})
