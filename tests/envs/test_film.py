"""Frames: their content; the same episode gives the same frames; Gymnasium's recorder accepts them."""

import pickle
from dataclasses import dataclass
from types import SimpleNamespace
from typing import NamedTuple

import gymnasium as gym
import numpy as np
import pytest
from matplotlib.figure import Figure
from scene_plays import moment_of, played

import wavegym
from wavegym.core.system import ObservationField, State, System
from wavegym.envs import WaveformEnv, WaveformVectorEnv
from wavegym.envs.film import Film, ObservationScene, headline, make_scene
from wavegym.registration import RECORDS
from wavegym.rendering.maps import ellipse
from wavegym.rendering.timelines import Timelines, draw_choices, draw_predicted
from wavegym.schedulers import Myopic
from wavegym.systems.kershaw_evans.scene import transmitted
from wavegym.systems.kershaw_evans.system import KershawEvans, KershawEvansPosition
from wavegym.waveforms import GaussianChirp

SYSTEM = KershawEvansPosition(horizon=12)


@dataclass(frozen=True)
class Dial(System):
    """A system of one's own, without prediction: the action is the state."""

    class Belief(NamedTuple):
        step: np.ndarray
        value: np.ndarray

    horizon: int = 5
    actions = SimpleNamespace(labels=("left", "right"))
    observation_fields = (
        ObservationField("value", "V", 0.0, 2.0, "what was dialled"),
        ObservationField("step", "1", 2.0, 2.0, "steps made"),
    )

    def draw_world(self, rng):
        return self.Belief(np.array(0), rng.random(1))

    def initial(self, world):
        return State(None, self.Belief(np.zeros(len(world.value), np.int64), world.value[:, 0].copy()))

    def transition(self, state, action, world):
        return State(None, self.Belief(state.belief.step + 1, action.astype(float)))

    def cost(self, belief):
        return belief.value - 0.5

    def observe(self, belief):
        return np.stack([belief.value, belief.step], axis=1)


@pytest.mark.slow
def test_a_frame_is_an_rgb_picture_with_even_sides():
    frames = played(SYSTEM, 3, num_envs=2).render()
    assert len(frames) == 2
    for frame in frames:
        assert frame.shape == (640, 960, 3)
        assert frame.dtype == np.uint8
        assert len(np.unique(frame.reshape(-1, 3), axis=0)) > 100
    assert (frames[0] != frames[1]).any()


def test_without_a_render_mode_there_is_no_frame():
    assert played(SYSTEM, 1, render_mode=None).render() is None
    assert WaveformEnv(SYSTEM).render() is None


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_the_film_follows_each_environment_through_its_resets(mode):
    env = played(KershawEvansPosition(horizon=4), 2, num_envs=2, autoreset_mode=mode)
    env.reset(options={"reset_mask": np.array([True, False])})
    for k in range(6):
        if mode == "Disabled" and env._ended.any():
            env.reset(options={"reset_mask": env._ended.copy()})
        env.step(np.array([k, k]))
        for row, episode in enumerate(env._film.episodes):
            moment = moment_of(env, row)
            assert len(moment.actions) == env.belief.step[row] == len(moment.costs) - 1
            assert episode.costs[-1] == env.system.cost(env.belief)[row]
            assert moment.states[-1].belief.mean[0, 0] == env.belief.mean[row, 0]
            if moment.actions:
                assert moment.actions[-1] == [k]
    assert len(env.render()) == 2


def test_the_headline_names_step_waveform_and_cost():
    env = played(SYSTEM, 0)
    assert headline(moment_of(env)).startswith("KershawEvansPosition, step 0 of 12   ·   cost ")
    _, _, _, _, info = env.step(np.array([33]))
    text = headline(moment_of(env))
    assert "step 1 of 12" in text
    assert "transmitted: up 69.83 us 1 MHz" in text
    assert text.endswith(f"cost {info['cost'][0]:.4g}")
    boxed = played(KershawEvansPosition(action="box"), 0)
    boxed.step(np.array([[1.0, -1.0]]))
    assert "duration 300 us, sweep -1 MHz" in headline(moment_of(boxed))


def test_the_predicted_costs_show_why_a_waveform_was_chosen():
    env = played(SYSTEM, 5)
    myopic = Myopic()
    myopic.begin(env.system, 1, np.random.default_rng(0))
    before, best = env.belief, myopic.act(env.belief, None, None)
    predicted = env.system.cost(env.system.predict(before, env.system.candidates()[None]))[0]
    for action, ending in ((best, "the same"), (best + 1, "%")):
        twin = pickle.loads(pickle.dumps(env))
        twin.step(action)
        axes = Figure().subplots()
        draw_predicted(axes, moment_of(twin))
        grey, least, chosen = axes.lines
        assert (grey.get_ydata() == predicted).all()
        assert least.get_xdata() == best
        assert chosen.get_xdata() == action
        assert chosen.get_ydata() == predicted[action]
        assert axes.get_title().endswith(ending)


def test_the_choices_panel_has_a_row_for_every_waveform_used():
    env = played(SYSTEM, 0)
    for index in (5, 33, 5, 12):
        env.step(np.array([index]))
    axes = Figure().subplots()
    draw_choices(axes, moment_of(env))
    assert axes.lines[0].get_xdata().tolist() == [1, 2, 3, 4]
    assert axes.lines[0].get_ydata().tolist() == [0, 2, 0, 1]
    labels = [text.get_text() for text in axes.get_yticklabels()]
    assert labels == [env.system.actions.labels[i] for i in (5, 12, 33)]


def test_the_ellipse_is_two_sigma():
    P = np.array([[9.0, 2.0], [2.0, 4.0]])
    points = ellipse(P)
    np.testing.assert_allclose(np.einsum("ip,ij,jp->p", points, np.linalg.inv(P), points), 4.0, rtol=1e-12)


def test_the_pulse_drawn_is_the_pulse_transmitted():
    system, box = KershawEvansPosition(), KershawEvansPosition(action="box")
    assert transmitted(system, np.array([34])) is system.actions[34]
    pulse = transmitted(box, box.candidates()[[34]])
    assert isinstance(pulse, GaussianChirp)
    assert pulse.label == system.actions[34].label
    np.testing.assert_allclose(pulse.fisher_information(), system.actions[34].fisher_information(), rtol=1e-9)


def test_a_system_of_ones_own_gets_its_observation_drawn_and_needs_no_prediction():
    env = WaveformVectorEnv(Dial(), 2, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(np.array([0, 1]))
    assert len(env.render()) == 2
    left, right = Figure().subfigures(1, 2)
    scene, panels = make_scene(env.system, left), Timelines(env.system, right)
    assert isinstance(scene, ObservationScene)
    scene.draw(moment_of(env, 1))
    panels.draw(moment_of(env, 1))
    assert [bar.get_width() for bar in left.axes[0].patches] == [0.5, -0.5]
    assert left.axes[0].get_yticklabels()[0].get_text() == "value = 1 V"
    assert [axes.get_visible() for axes in right.axes] == [True, False, True]


def test_a_scene_can_be_registered_for_a_class_of_ones_own():
    class Knob(Dial):
        pass

    class Blank:
        def __init__(self, system, figure):
            self.drawn = []

        def draw(self, moment):
            self.drawn.append(len(moment.actions))

    wavegym.register("tests/Knob-v0", Knob, scene=Blank)
    film = Film(Knob(), 1)
    state = film.system.initial(Dial.Belief(np.zeros(1), np.ones((1, 1))))
    film.begin(state, np.array([True]))
    film.frames()
    film.add(film.system.transition(state, np.array([1]), None), np.array([1]), np.array([0.5]), None)
    film.frames()
    assert film._canvas._parts[0].drawn == [0, 1]
    del gym.registry["tests/Knob-v0"], RECORDS["tests/Knob-v0"]


@pytest.mark.parametrize(
    "settings", [{"model": "ca", "weights": (1, 0, 0), "prior_variance": (1e4, 1e4, 10)}, {"q": 0.0}]
)
def test_other_models_are_drawn_too(settings):
    assert played(KershawEvans(**settings), 3).render()[0].std() > 10


@pytest.mark.slow
def test_gymnasium_records_a_video(tmp_path):
    moviepy = pytest.importorskip("moviepy")
    env = gym.make("wavegym/KershawEvansPosition-v0", render_mode="rgb_array", horizon=4)
    env = gym.wrappers.RecordVideo(env, str(tmp_path / "videos"), name_prefix="frames-of-wavegym", disable_logger=True)
    env.reset(seed=0)
    for _ in range(4):
        env.step(env.action_space.sample())
    env.close()
    (video,) = tmp_path.glob("videos/frames-of-wavegym-*.mp4")
    with moviepy.VideoFileClip(str(video)) as clip:
        assert clip.size == [960, 640]
        assert clip.n_frames == 5
        assert clip.fps == env.metadata["render_fps"]
