"""Recorded targets in every system that draws them from a motion model: against the known paths in a recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wavegym.core import trees
from wavegym.core.errors import InputError
from wavegym.core.traits import RecordedTargets, lacks_trait
from wavegym.evaluation import make_task
from wavegym.registration import SYSTEMS, full_id
from wavegym.testing.shortcut_check import shortcut_defect

# First position [m] and velocity [m/s] of targets on straight lines, in the scene of every system
STARTS = np.array([[-3500, 2000, 100], [-1900, 3200, 50], [0, 3000, 20], [2400, 4000, 80], [3500, 2000, 60.0]])
VELOCITIES = np.array([[9, 1, 0.5], [7, -2, 0.0], [-4, 6, 0.1], [-8, -3, 0.0], [-6, 2, 0.2]])
SECONDS = 240
RADARS = ["AgileClutter", "BeamAllocation", "EnergyBudget", "EnergyBudgetKnown"]
PLANAR = [*RADARS, "RfEo", "RfEoFar", "CameraSlew", "SectorSetup"]
LINE = ["KershawEvans", "KershawEvansPosition"]
AIRCRAFT = Path(__file__).parents[2] / "examples" / "data" / "aircraft_tracks.csv"
WORLDS = 4


def written(file: Path) -> Path:
    rows = [
        ",".join([str(1000 + t), f"t{k}", *map(repr, (start + t * velocity).tolist())])
        for k, (start, velocity) in enumerate(zip(STARTS, VELOCITIES, strict=True))
        for t in range(SECONDS + 1)
    ]
    file.write_text("\n".join(["time_s,id,x_m,y_m,z_m", *rows]) + "\n")
    return file


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    return written(tmp_path_factory.mktemp("recording") / "lines.csv")


def made(name: str, **changes):
    return make_task(name, changes).system


def recorded(name: str, file: Path, **changes):
    by_name = {"targets": "recorded"} if isinstance(made(name).targets, str) else {}
    horizon = {"horizon": 40} if made(name).horizon > 100 else {}
    return made(name, tracks=file, **by_name, **horizon, **changes)


def worlds(system, count=WORLDS):
    return trees.stack([system.draw_world(np.random.default_rng([7, i])) for i in range(count)])


def played(system, world, seed=0, batch=None):
    """True targets of each step, (step + 1, env, target, n), with allowed random actions; and the last state."""
    state, candidates, rng = system.initial(world), system.candidates(), np.random.default_rng(seed)
    seen = [state.truth.targets]
    for _ in range(system.horizon):
        chosen = candidates[rng.integers(len(candidates), size=WORLDS)][:batch]
        state = system.transition(state, chosen, world)
        seen.append(state.truth.targets)
    return np.array(seen), state


def split(system, states):
    """Positions and velocities (..., 2) of states (..., 4)."""
    names = system.motion.names
    return tuple(states[..., [names.index(axis + rate) for axis in "xy"]] for rate in ("", "dot"))


@pytest.mark.parametrize("name", PLANAR)
def test_true_targets_follow_the_recorded_paths(name, recording):
    system = recorded(name, recording)
    seen, _ = played(system, worlds(system))
    positions, velocities = split(system, seen)
    away = np.abs(velocities[:, :, :, None] - VELOCITIES[:, :2]).max(axis=-1)  # (step, env, target, track)
    track = away[0].argmin(axis=-1)
    np.testing.assert_allclose(velocities, np.broadcast_to(VELOCITIES[track, :2], velocities.shape), atol=1e-6)
    # on the line of the track, at a time within the recording, dt after the step before
    times = ((positions - STARTS[track, :2]) / VELOCITIES[track, :2]).mean(axis=-1)
    at = STARTS[track, :2] + times[..., None] * VELOCITIES[track, :2]
    np.testing.assert_allclose(positions, at, atol=1e-6)
    assert times.min() >= -1e-6
    assert times.max() <= SECONDS + 1e-6
    moved = np.diff(times, axis=0)
    if name == "AgileClutter":  # a target moves from its birth to the end of its life
        moved = moved[system.births[-1] : system.lifetime]
    np.testing.assert_allclose(moved, system.dt, atol=1e-6)
    assert all(len(set(row)) == len(row) for row in track.tolist())  # targets of different tracks


@pytest.mark.parametrize("name", PLANAR)
def test_worlds_stay_paired_and_tapes_as_they_are(name, recording):
    system, drawn = recorded(name, recording), made(name)
    world = worlds(system)
    np.testing.assert_array_equal(played(system, world, seed=1)[0], played(system, world, seed=2)[0])
    if system.horizon == drawn.horizon:
        for ours, theirs in zip(world, worlds(drawn), strict=True):
            np.testing.assert_array_equal(ours, theirs)
    state = drawn.initial(worlds(drawn))
    assert getattr(state.truth, "window", None) is None
    assert drawn.recorded_windows is None


@pytest.mark.parametrize("name", PLANAR)
def test_a_batch_equals_its_elements(name, recording):
    system = recorded(name, recording)
    world = worlds(system)
    _, whole = played(system, world)
    first = trees.first(world, 1)
    _, single = played(system, first, batch=1)
    trees.tree_map(lambda a, b: np.testing.assert_array_equal(a[:1], b), whole, single)


@pytest.mark.parametrize("name", [*PLANAR, *LINE])
def test_every_shortcut_agrees_with_the_contract(name, recording):
    system = recorded(name, recording, **({"farthest_range": 1e5} if name in LINE else {}))
    assert not lacks_trait(system, RecordedTargets)
    assert len(system.recorded_windows) > 0
    assert shortcut_defect(system) is None


def test_every_system_with_a_motion_model_plays_recordings():
    offering = {id for id in SYSTEMS if not lacks_trait(make_task(id, {}).system, RecordedTargets)}
    assert offering >= {full_id(name) for name in (*PLANAR, *LINE)}
    streets, traffic = (
        ("SectorSetupCity", "Urban", "UrbanSignal"),
        ("MultifunctionRadar", "SharedSpectrum"),
    )  # with targets of their own
    others = {full_id(name) for name in (*streets, *traffic)}
    assert {*SYSTEMS} - offering == others


@pytest.mark.parametrize("name", ["CameraSlew", "RfEoFar"])
def test_the_radar_is_the_origin_of_the_scene(name, recording):
    plain = recorded(name, recording)
    moved = recorded(name, recording, radar=(100.0, 500.0, 30.0))
    world = worlds(plain)
    ours, theirs = (split(system, system.initial(world).truth.targets) for system in (plain, moved))
    np.testing.assert_allclose(ours[0] - theirs[0], np.broadcast_to((100.0, 500.0), ours[0].shape), atol=1e-9)
    np.testing.assert_array_equal(ours[1], theirs[1])


def test_a_world_may_be_recorded_where_the_tracker_assumes_its_model(recording):
    system = made("BeamAllocation", truth={"targets": "recorded", "tracks": recording})
    positions, _ = split(system, system.initial(worlds(system)).truth.targets)
    known, _ = split(system, recorded("BeamAllocation", recording).initial(worlds(system)).truth.targets)
    np.testing.assert_array_equal(positions, known)


def test_aircraft_are_played_several_at_once():
    system = recorded("RfEo", AIRCRAFT, radar=(51.75, -1.25, 100.0), first_estimate="drawn")
    seen, _ = played(system, worlds(system))
    positions, velocities = split(system, seen)
    assert (np.linalg.norm(positions, axis=-1) <= system.farthest_range).all()
    speed = np.linalg.norm(velocities, axis=-1)
    assert 20.0 < speed.min() < speed.max() < 270.0
    middle = (positions[2:] - positions[:-2]) / (2 * system.dt)
    np.testing.assert_allclose(middle, velocities[1:-1], atol=2.0)  # one curve


@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [
        ("BeamAllocation", {"targets": "recorded"}, "needs a recording, expected tracks='FILE.csv'"),
        ("RfEo", {"radar": (0.0, 0.0)}, r"radar is \(0.0, 0.0\), expected it with targets='recorded' only"),
        ("CameraSlew", {"radar": (0.0, 0.0)}, r"radar is \(0.0, 0.0\), expected it with tracks='FILE.csv' only"),
        ("SectorSetup", {"tracks": "no.csv"}, r"no.csv: no such file"),
        ("SectorSetup", {"tracks": "FILE", "targets": 6}, r"5 tracks have a window of 60 s .*expected 6, .*nearest: 5"),
        (
            "SectorSetup",
            {"tracks": "FILE", "farthest_range": 10.0},
            "no window stays between 0 and 10 m from the radar",
        ),
        ("SectorSetup", {"tracks": "FILE", "horizon": 900}, "longest gap-free piece lasts 240 s"),
        ("SectorSetupCity", {"tracks": "FILE"}, "tracks is"),
    ],
)
def test_mistakes_take_one_line(name, changes, words, recording):
    given = {key: recording if value == "FILE" else value for key, value in changes.items()}
    with pytest.raises(InputError, match=words) as caught:
        made(name, **given)
    assert "\n" not in str(caught.value)
