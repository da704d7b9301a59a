"""The origins of false confirmed tracks, in cases that are clear by hand."""

from __future__ import annotations

import numpy as np
import pytest
from small_studies import URBAN_RUNS as RUNS
from small_studies import URBAN_SEED as SEED

from research.papers.urban import false_tracks as module
from research.papers.urban.false_tracks import MIRROR, ORIGINS, OTHER, STRAYED, WALLS, false_tracks
from research.papers.urban.study import CLOSED, LOOSE, OPEN, Case, system
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.schedulers.registry import make_policy
from wavegym.sensors import Antenna, Multistatic
from wavegym.sensors.urban_map import Building, UrbanMap
from wavegym.systems.urban.state import make_scene
from wavegym.systems.urban.tracker import CONFIRMED, Tracks
from wavegym.targets import ScriptedPath

pytestmark = pytest.mark.slow

ANTENNAS = (0.0, 0.0), ((10.0, 0.0), (-10.0, 0.0))  # in one line: what lies above it has its mirror image below
SCANS, WALL = 10, 60.0


def driven(urban_map, path, arrivals, times):
    transmitter, receivers = ANTENNAS
    pairs = [Multistatic(Antenna(urban_map, transmitter), Antenna(urban_map, place)) for place in receivers]
    return make_scene(urban_map, pairs, path, arrivals, times)


@pytest.fixture(scope="module")
def scene():
    """A target drives along y = 30 m, past antennas in one line; behind x = 60 m stands a house that reflects."""
    house = Building(corners=((WALL, -50.0), (WALL + 20, -50.0), (WALL + 20, 80.0), (WALL, 80.0)))
    path = ScriptedPath((-5.0, 30.0), (4.0, 2.0), [])
    return driven(UrbanMap(buildings=(house,)), path, [0.0], 0.25 * np.arange(SCANS + 1))


def tracks(*states):
    """One run with one slot a track; states (k, 4) that may be NaN."""
    place = np.stack(states, axis=1)[None]
    return place, np.zeros(place.shape[:3], np.int64)


def counted(scene, *states):
    (counts,) = false_tracks(scene, *ANTENNAS, *tracks(*states))
    return {name: count for name, count in zip(ORIGINS, counts.tolist(), strict=True) if count}


@pytest.fixture
def truth(scene):
    return scene.truth[1:, 0, :4]


def test_a_target_s_own_track_is_none(scene, truth):
    assert counted(scene, truth, truth + np.array([19.0, 0.0, 0.0, 0.0])) == {}


def test_the_mirror_image_in_the_line_of_the_antennas(scene, truth):
    assert counted(scene, truth * [1.0, -1.0, 1.0, -1.0]) == {MIRROR: 1}


def test_the_mirror_image_in_a_wall(scene, truth):
    """A path over the wall out and back is as long as the straight path to the image behind the wall."""
    assert scene.path_count[:, :, 0].min() >= 3  # straight, by the wall on either leg, and on both
    assert counted(scene, truth * [-1.0, 1.0, -1.0, 1.0] + [2 * WALL, 0.0, 0.0, 0.0]) == {WALLS: 1}


def test_anything_else(scene, truth):
    assert counted(scene, truth - [0.0, 25.0, 0.0, 0.0]) == {OTHER: 1}


def test_what_strayed_was_a_target_s(scene, truth):
    drift = np.linspace(0.0, 40.0, SCANS)[:, None] * [0.0, 1.0, 0.0, 0.0]
    assert counted(scene, truth + drift) == {STRAYED: 1}


def test_a_slot_taken_twice_holds_two_tracks(scene, truth):
    """And one that vanishes for a scan is the same."""
    image = truth * [1.0, -1.0, 1.0, -1.0]
    image[4] = np.nan
    place, born = tracks(image)
    born[:, 6:] = 5
    assert false_tracks(scene, *ANTENNAS, place, born).tolist() == [[0, 2, 0, 0]]
    assert false_tracks(scene, *ANTENNAS, place, born * 0).tolist() == [[0, 1, 0, 0]]


def test_before_a_target_comes_every_track_is_false(truth):
    path = ScriptedPath((-5.0, 30.0), (4.0, 2.0), [])
    late = driven(UrbanMap(), path, [1.0], 0.25 * np.arange(SCANS + 1))
    assert counted(late, truth) == {OTHER: 1}


def replayed(case):
    """(loop, states) of the small study's worlds, scan by scan."""
    loop = system(case)
    worlds = draw_worlds(loop, world_seeds(SEED, "test", RUNS))
    policy = make_policy(case.policy, loop, None)
    policy.begin(loop, RUNS, np.random.default_rng(0))
    state, states = loop.initial(worlds), []
    for _ in range(loop.horizon):
        state = loop.transition(state, policy.act(state.belief, None, None), worlds)
        states.append(state)
    return loop, states


@pytest.mark.parametrize("of", [CLOSED, OPEN])
def test_each_false_track_of_the_street_is_counted_once(urban_study, of):
    """Against a list of the tracks that were ever far from all targets."""
    _, states = replayed(Case(LOOSE, True, *of))
    false, strayed = [set() for _ in range(RUNS)], [set() for _ in range(RUNS)]
    seen = set()
    for k, state in enumerate(states, 1):
        x, _ = Tracks(*state.belief[1:]).combined()
        for e, slot in zip(*np.nonzero(state.belief.status == CONFIRMED), strict=True):
            name = (e, slot, k - state.belief.age[e, slot])
            targets = state.truth.targets[e, state.truth.present[e], :2]
            near = np.linalg.norm(targets - x[e, slot, :2], axis=1).min() <= 20.0
            if near and name not in seen:
                strayed[e].add(name)
            seen.add(name)
            if not near:
                false[e].add(name)
    counts = urban_study.of(LOOSE, of).origins
    assert counts.sum(axis=1).tolist() == [len(names) for names in false]
    assert counts[:, 0].tolist() == [len(names & began) for names, began in zip(false, strayed, strict=True)]
    assert counts.sum() > 0


def test_returns_of_other_scans_explain_nothing(urban_study, monkeypatch):
    """That a false track lies where returns are is no accident: shifted by 15 scans hardly one does."""
    case = Case(LOOSE, True, *OPEN)
    loop, states = replayed(case)
    born = np.stack([state.belief.step[:, None] - state.belief.age for state in states], axis=1)
    place, made_of = urban_study.runs[case].place, module._made_of
    explained = []
    for shift in (0, 15):

        def shifted(scene, transmitter, receivers, x, scan, shift=shift):
            return made_of(scene, transmitter, receivers, x, np.minimum(scan + shift, loop.horizon))

        monkeypatch.setattr(module, "_made_of", shifted)
        counts = false_tracks(loop.scene, loop.transmitters[0], loop.receivers, place, born).sum(axis=0)
        explained.append(counts[1] + counts[2])
    assert explained[0] == urban_study.runs[case].origins[:, 1:3].sum() >= 4
    assert explained[1] <= explained[0] / 4
