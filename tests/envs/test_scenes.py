"""Scenes of looks, beams and accounts: every mark agrees with the states of the episode."""

from __future__ import annotations

import pickle
from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest
from matplotlib.figure import Figure
from scene_plays import drawn, played

from wavegym.envs.film import ObservationScene, make_scene
from wavegym.evaluation import make_task
from wavegym.registration import SYSTEMS
from wavegym.rendering.looks import APART, Looks, LookScene, draw_looks, prepare_looks
from wavegym.systems.beam_allocation.system import BeamAllocation
from wavegym.systems.camera_slew.system import CameraSlew
from wavegym.systems.energy_budget.known import EnergyBudgetKnown
from wavegym.systems.energy_budget.scene import occluded_slots
from wavegym.systems.energy_budget.system import EnergyBudget
from wavegym.systems.sector_setup.city import SectorSetupCity
from wavegym.systems.sector_setup.system import SectorSetup

STEPS = 14
LOOKING = (CameraSlew, SectorSetup, SectorSetupCity)


def markers(axes):
    """Positions of all filled and of all hollow marks of a panel, (mark, 2) each, in order."""
    found = {True: [], False: []}
    for line in axes.lines:
        if line.get_marker() == "o":
            found[line.get_markerfacecolor() != "white"].append(line.get_xydata())
    return [np.array(sorted(map(tuple, np.concatenate(found[key])))) for key in (True, False)]


@pytest.mark.parametrize("env_id", SYSTEMS)
def test_every_environment_of_the_suite_has_a_scene_of_its_own(env_id):
    scene = make_scene(make_task(env_id, {}).system, Figure().subfigures(1, 1))
    assert not isinstance(scene, ObservationScene)


PICTURED = [
    *((id, {}) for id, record in SYSTEMS.items() if record.scene),
    ("wavegym/AgileClutter-v0", {"tracker": "particle", "particles": 30}),
    ("wavegym/KershawEvansPosition-v0", {"action": "box"}),
]


@pytest.mark.slow
@pytest.mark.parametrize(("id", "settings"), PICTURED, ids=str)
def test_the_same_episode_gives_the_same_pixels_whatever_was_drawn_before(id, settings):
    """From the first state on, and after pickling."""
    system = make_task(id, settings).system
    env = played(system, 0)
    env.action_space.seed(0)
    frames = [env.render()[0]]
    for _ in range(3):
        env.step(env.action_space.sample())
        frames.append(env.render()[0])
    assert all((one != two).any() for one, two in pairwise(frames))
    env.reset(seed=0)
    assert (env.render()[0] == frames[0]).all()
    assert (pickle.loads(pickle.dumps(played(system, 3))).render()[0] == frames[3]).all()


def test_bars_stand_where_a_target_hides_and_marks_where_a_sensor_looked():
    visible = np.ones((6, 2), np.bool_)
    visible[0:2, 0] = visible[4:, 0] = visible[3, 1] = False
    axes = Figure().subplots()
    prepare_looks(axes, 2, 6, "")
    draw_looks(axes, visible, Looks(np.array([[0, 1], [1, -1]]), np.array([[True, False], [False, True]])))
    bars = [line.get_xydata().tolist() for line in axes.lines if line.get_linewidth() == 7]
    assert bars == [[[0, 0], [2, 0]], [[4, 0], [6, 0]], [[3, 1], [4, 1]]]
    filled, hollow = markers(axes)
    np.testing.assert_allclose(filled, [[0.5, -APART / 2]])
    np.testing.assert_allclose(hollow, [[0.5, 1 + APART / 2], [1.5, 1 - APART / 2]])


@pytest.mark.parametrize("system", LOOKING)
def test_looks_are_the_actions_and_what_they_found(system):
    scene, moment = drawn(system(horizon=30), STEPS, 4)
    assert isinstance(scene, LookScene)
    looks = scene.looks(moment)
    assert looks.target.shape == looks.hit.shape == (STEPS, 1)
    for action, state, target, hit in zip(
        moment.actions, moment.states[1:], looks.target[:, 0], looks.hit[:, 0], strict=True
    ):
        if system is CameraSlew:
            assert target == action[0]
            assert hit == state.truth.seen[0, target]
        else:
            assert target == action[0] // len(moment.system.waveforms)
            assert hit == (state.truth.detections[0] > 0)


def test_the_camera_is_drawn_where_it_points_and_grey_while_it_is_blind():
    system = CameraSlew(settle=2)
    for steps in range(1, 9):
        scene, moment = drawn(system, steps, 4)
        (image,) = scene.map.patches
        belief, corners = moment.states[-1].belief, image.get_xy()
        middle = corners[1:-1].mean(axis=0) - corners[0]
        turned = np.angle(np.exp(1j * (np.arctan2(*middle) - belief.pointing[0])))
        assert abs(turned) < 0.01
        assert (image.get_facecolor()[0] == image.get_facecolor()[2]) == (belief.settling[0] > 0)


@pytest.mark.parametrize("dead_steps", [0, 2])
def test_a_set_up_sends_no_pulse_to_the_receivers(dead_steps):
    system = SectorSetup(dead_steps=dead_steps, targets=2)
    seen = set()
    for steps in range(1, 9):
        scene, moment = drawn(system, steps, 4)
        is_silent = bool(moment.states[-1].truth.silent[0])
        paths = [line for line in scene.map.lines if line.get_marker() == "None" and len(line.get_xdata()) == 2]
        from_sender = [line for line in paths if tuple(line.get_xydata()[0]) == tuple(system.illuminator)]
        to_receivers = [line for line in paths if tuple(1e3 * line.get_xydata()[1]) in system.receivers]
        assert len(from_sender) == 1
        assert len(to_receivers) == (0 if is_silent else len(system.receivers))
        assert ("no pulse" in scene.report(moment)) == is_silent
        seen.add(is_silent)
    assert (False in seen) if dead_steps == 0 else (True in seen)


def test_beams_are_drawn_at_their_targets():
    scene, moment = drawn(BeamAllocation(), STEPS, 4)
    filled, hollow = markers(scene._beams)
    visible = moment.states[-1].belief.visible[0]
    wanted = [[], []]
    for step, action in enumerate(moment.actions):
        for target in scene.system.action_set.illuminated[action[0]].argmax(axis=1):
            wanted[0 if visible[step, target] else 1].append((step, target))
    for found, expected in zip((filled, hollow), wanted, strict=True):
        assert sorted((x - 0.5, round(y)) for x, y in found) == sorted(expected)


@pytest.mark.parametrize("system", [EnergyBudget, EnergyBudgetKnown])
def test_the_account_shows_the_energy_left_and_the_occluded_slots(system):
    scene, moment = drawn(system(), STEPS, 4)
    energies = [state.belief.energy[0] for state in moment.states]
    assert any(list(line.get_ydata()) == energies for line in scene._account.lines)
    occluded = occluded_slots(moment)
    assert len(occluded) == (moment.system.horizon if system is EnergyBudgetKnown else STEPS)
    np.testing.assert_array_equal(occluded[:STEPS], [state.truth.occluded[0] for state in moment.states[1:]])
    assert len(scene._account.patches) == occluded.sum()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*HumanRendering wrapper is being applied")
def test_a_window_shows_the_frames(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")  # a virtual display
    pygame = pytest.importorskip("pygame", reason="the extra window is not installed")
    envs = [gym.make("wavegym/CameraSlew-v0", render_mode=mode) for mode in ("human", "rgb_array")]
    for env in envs:
        env.reset(seed=0)
        env.step(2)
    shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    np.testing.assert_array_equal(shown, envs[1].render())
    envs[0].close()
