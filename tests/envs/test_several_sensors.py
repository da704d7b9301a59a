"""Action sets for several sensors in the environments: spaces, checks, masks, info, conformance, pages and frames."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from two_sensors import Coupled, Quick, Strict, TwoSensors

import wavegym
from wavegym.core import shortcuts
from wavegym.core.errors import InputError
from wavegym.envs import WaveformEnv, WaveformVectorEnv
from wavegym.envs.describe import describe
from wavegym.envs.film import headline
from wavegym.rendering.timelines import Timelines, draw_choices, draw_predicted
from wavegym.testing import check_vector_env
from wavegym.testing.check import ConformanceError

SYSTEM = TwoSensors()
SHORT, LONG, _ = SYSTEM.library.labels
FORMS = ("library", "joint", "box")


@pytest.fixture
def registered():
    """Ids of the system with all forms and of that without a joint one."""
    ids = {TwoSensors: "tests/TwoSensors-v0", Strict: "tests/Strict-v0"}
    for system, id in ids.items():
        wavegym.register(id, system)
    yield ids
    for id in ids.values():
        gym.registry.pop(id)


def factory(system, **settings):
    return partial(making, system, settings)


def making(system, settings, num_envs, autoreset_mode, max_episode_steps=None):
    return WaveformVectorEnv(
        system, num_envs, autoreset_mode=autoreset_mode, max_episode_steps=max_episode_steps, **settings
    )


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("reward", ["trace", "relative"])
@pytest.mark.slow
def test_every_form_does_what_gymnasiums_vector_environment_does(form, reward):
    assert check_vector_env(factory(TwoSensors(action=form), reward=reward)) is None


@pytest.mark.parametrize("form", FORMS)
def test_gymnasiums_checker_passes(form, recwarn):
    check_env(WaveformEnv(TwoSensors(action=form)), skip_render_check=True)
    assert not [str(w.message) for w in recwarn if "spec" not in str(w.message)]


@pytest.mark.parametrize("system", [Quick(), Coupled()])
def test_a_system_with_its_own_search_and_one_with_coupled_sensors_conform(system):
    assert check_vector_env(factory(system)) is None


def test_spaces_and_masks():
    spaces = [WaveformVectorEnv(TwoSensors(action=form), 3).single_action_space for form in FORMS]
    box = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
    assert spaces == [gym.spaces.MultiDiscrete([3, 3]), gym.spaces.Discrete(4), box]
    env, single = WaveformVectorEnv(SYSTEM, 5), WaveformEnv(SYSTEM)
    env.reset(seed=0)
    single.reset(seed=0)
    assert env.action_masks().shape == (5, 6)
    assert env.action_masks().all()
    assert single.action_masks().shape == (6,)


def test_info_tells_the_indices_and_figures_of_each_target():
    env = WaveformVectorEnv(SYSTEM, 3)
    env.reset(seed=0)
    actions = np.array([[0, 2], [1, 0], [2, 2]])
    *_, info = env.step(actions)
    assert (info["waveform"] == actions).all()
    info["waveform"][:] = 7
    assert (actions < 3).all()
    assert [info[key].shape for key in ("position_error", "nees", "lost", "near")] == [(3, 2), (3, 2), (3, 2), (3,)]
    assert info["present"].tolist() == [[True, False]] * 3
    joint = WaveformEnv(TwoSensors(action="joint"))
    joint.reset(seed=0)
    assert joint.step(2)[-1]["waveform"] == 2


@given(st.lists(st.integers(0, 1), min_size=2, max_size=2), st.integers(0, 2**32))
def test_a_choice_is_the_same_in_every_form(pulses, seed):
    each, joint, box = (WaveformEnv(TwoSensors(action=form)) for form in FORMS)
    points = box.system.candidates().reshape(3, 3, 2)
    actions = (pulses, 2 * pulses[0] + pulses[1], points[tuple(pulses)])
    for env in (each, joint, box):
        env.reset(seed=seed)
    got = [env.step(action)[-1]["cost"] for env, action in zip((each, joint, box), actions, strict=True)]
    assert got[0] == got[1] == pytest.approx(got[2], rel=1e-9)


def test_the_error_reward_adds_up_the_targets():
    env = WaveformVectorEnv(SYSTEM, 4, reward="error")
    env.reset(seed=0)
    for _ in range(3):
        _, reward, *_, info = env.step(np.zeros((4, 2), int))
        np.testing.assert_allclose(reward, -(info["position_error"] ** 2).sum(axis=1), rtol=1e-14)
    assert (info["position_error"] > 0).all()


def test_a_mask_over_single_sensors_is_refused():
    with pytest.raises(InputError, match=r"Coupled has a mask of its own, .*joint form, a JointLibrary") as caught:
        WaveformEnv(Coupled(action="library"))
    assert "\n" not in str(caught.value)


def test_a_joint_mask_is_enforced():
    env = WaveformEnv(Coupled())
    env.reset(seed=0)
    assert env.action_masks().tolist() == [True, False, False, False]
    with pytest.raises(InputError, match=r"action is 3, which is not allowed now \(nearest allowed: 0\)"):
        env.step(3)
    env.step(0)
    assert env.action_masks().tolist() == [True, True, True, False]


@dataclass(frozen=True)
class Wrong(Quick):
    """Promises what it does not keep."""

    promise: str = ""

    def search(self, belief):
        if self.promise == "flat":
            return np.zeros(len(belief.step), int)
        return (super().search(belief) + (self.promise == "not best")) % 3

    def state_info(self, state):
        return {"nees": np.full(len(state.belief.step), np.nan if self.promise == "absent" else 1.0)}


@shortcuts.constants.register(Wrong)
def constants(system: Wrong):
    return {"far": np.array([[0, 3]]), "none": np.empty((0, 2), int)}.get(
        system.promise, shortcuts.constants.registered[TwoSensors](system)
    )


shortcuts.best_action.register(Wrong)(Wrong.search)


@pytest.mark.parametrize(
    ("promise", "message"),
    [
        ("absent", r"state_info\(\)\['nees'\] is not finite, expected 0 where a target is absent"),
        ("flat", r"best_action\(\) returned shape \(3,\), expected \(3, 2\)"),
        ("not best", r"best_action\(\) costs .*, but candidates cost"),
        ("far", r"constants\(\) has an index that candidates\(\) lacks"),
        ("none", r"constants\(\) returned shape \(0, 2\), expected \(n >= 1, 2\)"),
    ],
)
def test_promises_to_planners_are_checked(promise, message):
    with pytest.raises(ConformanceError, match=message):
        check_vector_env(factory(Wrong(promise=promise)))


def test_the_page_has_every_form_that_the_system_accepts(registered):
    page = describe(registered[TwoSensors])
    each, joint, box = (f'With `action="{form}"`: ' for form in FORMS)
    assert f"{each}`MultiDiscrete([3, 3])`, one index per sensor, the same waveforms at each." in page
    assert f"{joint}`Discrete(4)`, every combination of 2 waveforms at 2 sensors" in page
    assert f"The 2: {SHORT}, {LONG}." in page
    assert f"| 1 | {SHORT} \\| {LONG} |" in page
    assert f"{box}`Box(-1, 1, (2,))`" in page
    assert page.count(f"| 0 | {SHORT} |") == 1
    assert "| `waveform` | array (2,) | indices of the waveforms transmitted, one for each sensor; `env" in page
    strict = describe(registered[Strict])
    assert each in strict
    assert box in strict
    assert joint not in strict


def test_a_long_table_is_shown_whole():
    id = "tests/Long-v0"
    wavegym.register(id, TwoSensors, action="joint", few=7, durations=tuple(np.geomspace(1e-7, 1e-5, 7).tolist()))
    try:
        page = describe(id)
    finally:
        gym.registry.pop(id)
    assert all(f"\n| {i} | {label}" in page for i, label in ((0, "unmodulated"), (48, "unmodulated")))
    assert page.index('action="joint"') < page.index('action="library"')


def filmed(form, actions):
    env = WaveformVectorEnv(TwoSensors(action=form), 1, render_mode="rgb_array")
    env.reset(seed=0)
    for action in actions:
        env.step(np.array([action]))
    return env, env._film._moment(0)


@pytest.mark.parametrize(("form", "actions"), [("library", [[1, 0], [1, 1]]), ("joint", [2, 3])])
def test_frames_show_a_line_and_a_name_for_each_sensor(form, actions):
    env, moment = filmed(form, actions)
    assert env.render()[0].std() > 10
    assert f"transmitted: {LONG} | {LONG}" in headline(moment)
    axes = Figure().subplots()
    draw_choices(axes, moment)
    lines = [line.get_ydata().tolist() for line in axes.lines[::2]]
    assert lines == [[0.9, 0.9], [0.1, 1.1]]
    assert [text.get_text() for text in axes.get_yticklabels()] == [SHORT, LONG]
    panel = Timelines(env.system, Figure())._choices
    assert [text.get_text() for text in panel.get_legend().get_texts()] == ["sensor 1", "sensor 2"]


def test_the_predicted_costs_mark_the_combination_chosen():
    _, moment = filmed("library", [[1, 2]])
    axes = Figure().subplots()
    draw_predicted(axes, moment)
    grey, _, chosen = axes.lines
    assert len(grey.get_ydata()) == 9
    assert chosen.get_xdata().tolist() == [5]
    assert chosen.get_ydata() == grey.get_ydata()[5]
