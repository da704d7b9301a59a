"""Actions: what is taken, what is clipped and flagged, what is refused before anything has changed."""

import gymnasium as gym
import numpy as np
import pytest
from delay_systems import DelaySystem, delay_worlds
from hypothesis import given, settings
from hypothesis import strategies as st
from small_systems import Burner
from two_sensors import TwoSensors

from wavegym.core import trees
from wavegym.core.errors import InputError
from wavegym.envs import WaveformEnv, WaveformVectorEnv
from wavegym.envs.actions import action_reader
from wavegym.systems.kershaw_evans.system import KershawEvansPosition
from wavegym.testing.lockstep import difference

LIBRARY, BOX = KershawEvansPosition(horizon=20), KershawEvansPosition(horizon=20, action="box")

WRONG_INDICES = {
    "too large": (np.array([0, 56]), r"action is 56, expected an index in \[0, 55\] \(nearest: 55\)"),
    "negative": (np.array([-1, 3]), r"action is -1, expected an index in \[0, 55\] \(nearest: 0\)"),
    "not an integer": (np.array([0.0, 1.0]), "action has the type float64, expected integers"),
    "not a number": (np.array([np.nan, 1.0]), "action has the type float64, expected integers"),
    "truth values": (np.array([True, False]), "action has the type bool"),
    "words": (np.array(["0", "1"]), "action has the type <U1"),
    "one too few": (np.array([0]), r"actions have the shape \(1,\), expected \(2,\)"),
    "a column": (np.array([[0], [1]]), r"actions have the shape \(2, 1\), expected \(2,\)"),
}
WRONG_POINTS = {
    "not a number": (np.array([[0.0, 0.0], [0.5, np.nan]]), r"action is \[0.5, nan\], expected finite numbers"),
    "infinite": (np.array([[0.0, np.inf], [0.0, 0.0]]), r"action is \[0.0, inf\], expected finite numbers"),
    "flat": (np.zeros(4), r"actions have the shape \(4,\), expected \(2, 2\)"),
    "objects": (np.array([[None, 0], [0, 0]]), "action has the type object, expected numbers"),
}

WRONG_PAIRS = {
    "too large": (np.array([[0, 3], [0, 0]]), r"action of sensor 2 is 3, expected an index in \[0, 2\] \(nearest: 2\)"),
    "negative": (
        np.array([[0, 0], [-1, 9]]),
        r"action of sensor 1 is -1, expected an index in \[0, 2\] \(nearest: 0\)",
    ),
    "not an integer": (np.array([[0.0, 1.0]] * 2), r"action has the type float64, expected integers in \[0, 2\]"),
    "truth values": (np.array([[True, False]] * 2), "action has the type bool"),
    "flat": (np.array([0, 1]), r"actions have the shape \(2,\), expected \(2, 2\): one index for each sensor"),
    "one too few": (np.array([[0, 1]]), r"actions have the shape \(1, 2\), expected \(2, 2\)"),
    "a sensor too many": (np.zeros((2, 3), int), r"actions have the shape \(2, 3\), expected \(2, 2\)"),
}
WRONG = ((LIBRARY, WRONG_INDICES), (BOX, WRONG_POINTS), (TwoSensors(), WRONG_PAIRS))


@pytest.mark.parametrize(
    ("system", "wrong", "message"),
    [(system, *case) for system, cases in WRONG for case in cases.values()],
    ids=[f"{type(system).__name__}, {name}" for system, cases in WRONG for name in cases],
)
@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_a_wrong_action_changes_nothing(system, wrong, message, mode):
    env, twin = (WaveformVectorEnv(system, 2, autoreset_mode=mode) for _ in range(2))
    for each in (env, twin):
        each.action_space.seed(0)
        each.reset(seed=0)
        each.step(each.action_space.sample())
    with pytest.raises(InputError, match=message) as caught:
        env.step(wrong)
    assert "\n" not in str(caught.value)
    actions = twin.action_space.sample()
    for _ in range(3):
        assert difference(env.step(actions), twin.step(actions)) is None


def test_a_wrong_action_at_an_autoreset_leaves_the_finished_episode_in_place():
    env, twin = (WaveformVectorEnv(KershawEvansPosition(horizon=2), 2) for _ in range(2))
    for each in (env, twin):
        each.reset(seed=0)
        each.step(np.array([0, 1]))
        each.reset(options={"reset_mask": np.array([True, False])})
        assert each.step(np.array([0, 1]))[2].tolist() == [False, True]
    with pytest.raises(InputError, match="action is 99"):
        env.step(np.array([99, 0]))
    for _ in range(3):
        assert difference(env.step(np.array([5, 5])), twin.step(np.array([5, 5]))) is None


@pytest.mark.parametrize(
    ("system", "refused", "taken"),
    [
        (LIBRARY, (56, -1, 0.5, None, [1, 2], np.nan), (3, np.int64(3), np.array(3), np.uint8(3))),
        (TwoSensors(), (1, [0], [0, 3], [-1, 0], [0.0, 1.0], None), ([2, 0], (2, 0), np.array([2, 0], np.uint8))),
    ],
)
def test_the_single_environment_refuses_as_the_vector_one_does(system, refused, taken):
    env = WaveformEnv(system)
    env.reset(seed=0)
    before = env.batch.episodes.state.belief
    for wrong in refused:
        with pytest.raises(InputError):
            env.step(wrong)
    assert env.batch.episodes.state.belief is before
    for right in taken:
        np.testing.assert_array_equal(env.step(right)[-1]["waveform"], taken[0])


@settings(max_examples=40)
@given(st.lists(st.floats(-1e6, 1e6), min_size=4, max_size=4))
def test_finite_points_outside_the_box_are_clipped_and_flagged(values):
    points = np.array(values).reshape(2, 2)
    clipped = np.clip(points, -1.0, 1.0)
    one, two = WaveformVectorEnv(BOX, 2), WaveformVectorEnv(BOX, 2)
    for env in (one, two):
        env.reset(seed=0)
    (*got, info), (*want, plain) = one.step(points), two.step(clipped)
    assert difference(got, want) is None
    assert (info["action_clipped"] == (points != clipped).any(axis=1)).all()
    assert not plain["action_clipped"].any()
    assert difference(info["parameters"], plain["parameters"]) is None
    low, high = np.array([[p.low, p.high] for p in BOX.actions.parameters]).T
    assert ((low <= info["parameters"]) & (info["parameters"] <= high)).all()


def test_info_tells_the_parameters_in_physical_units():
    env = WaveformEnv(BOX)
    env.reset(seed=0)
    for action, duration, sweep in (([-1, -1], 10e-6, -1e6), ([1, 1], 300e-6, 1e6), ([0, 0], np.sqrt(3e-9), 0.0)):
        parameters = env.step(np.array(action, np.float32))[-1]["parameters"]
        np.testing.assert_allclose(parameters, [duration, sweep], rtol=1e-12)


def test_a_library_action_equals_its_point_of_the_box():
    library, box = WaveformVectorEnv(LIBRARY, 1), WaveformVectorEnv(BOX, 1)
    for index in range(0, 56, 7):
        (first, *_), (second, *_) = library.reset(seed=0), box.reset(seed=0)
        assert (first == second).all()
        costs = [env.step(np.asarray(env.system.candidates()[[index]]))[-1]["cost"] for env in (library, box)]
        np.testing.assert_allclose(*costs, rtol=1e-9)


def test_spaces_and_masks():
    env = gym.make_vec("wavegym/KershawEvansPosition-v0", 3)
    env.reset(seed=0)
    assert env.single_action_space == gym.spaces.Discrete(56)
    assert env.action_masks().shape == (3, 56)
    assert env.action_masks().all()
    box = gym.make("wavegym/KershawEvansPosition-v0", action="box")
    assert box.action_space == gym.spaces.Box(-1.0, 1.0, (2,), np.float32)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_a_masked_action_changes_nothing(mode):
    env, twin = (WaveformVectorEnv(Burner(), 2, autoreset_mode=mode) for _ in range(2))
    for each in (env, twin):
        each.reset(seed=0)
        each.step(np.array([0, 2]))
    for each in (env, twin):  # down to two units
        if each.belief.left[1] == 3:
            each.step(np.array([0, 0]))
    with pytest.raises(InputError, match=r"action is 2, which environment 1 does not allow now \(nearest allowed: 1\)"):
        env.step(np.array([0, 2]))
    assert difference(env.step(np.array([0, 1])), twin.step(np.array([0, 1]))) is None


def test_a_restarting_environment_may_get_a_masked_action():
    env = WaveformVectorEnv(Burner(), 1)
    env.reset(seed=0)
    terminated = np.array([False])
    while not terminated.all():
        *_, terminated, _, _ = env.step(np.array([0]))
    assert not env.action_masks().any()
    env.step(np.array([2]))
    assert env.belief.step.tolist() == [0]


def test_the_single_environment_refuses_masked_actions():
    env = WaveformEnv(Burner(fuel=1))
    env.reset(seed=0)
    with pytest.raises(InputError, match="which is not allowed now"):
        env.step(2)
    assert env.belief.step.tolist() == [0]
    env.step(0)


@pytest.mark.slow
def test_what_is_handed_out_is_the_callers_own():
    settings = {"render_mode": "rgb_array"}
    env, twin = (WaveformVectorEnv(LIBRARY, 2, **settings) for _ in range(2))
    for each in (env, twin):
        each.reset(seed=0)
    for actions in (np.array([3, 4]), np.array([50, 20])):
        *_, info = env.step(actions)
        info["waveform"][:] = 0
        trees.tree_map(lambda leaf: leaf.fill(7), env.belief)
        actions[:] = 0
    for actions in (np.array([3, 4]), np.array([50, 20])):
        twin.step(actions)
    assert difference(env.render(), twin.render()) is None
    assert difference(env.step(np.array([1, 2])), twin.step(np.array([1, 2]))) is None


@pytest.mark.parametrize("strict", [True, False])
def test_a_masked_action_reaches_only_a_system_that_replaces_it(strict):
    class Purse(DelaySystem):
        pass

    Purse.strict = strict
    system = Purse(horizon=4, budget=0.5)
    belief = system.initial(delay_worlds(system, 1)).belief
    reader = action_reader(system)
    assert not system.mask(belief)[0, 1]  # a long pulse takes 1
    if strict:
        with pytest.raises(InputError, match="nearest allowed"):
            reader.read(np.array([1]), belief, None)
    else:
        assert reader.read(np.array([1]), belief, None) == 1


def test_the_single_environment_speaks_of_no_batch_axis():
    env = WaveformEnv("wavegym.systems.rf_eo.system:RfEo", horizon=3)
    env.reset(seed=0)
    with pytest.raises(InputError, match=r"^action has the shape \(2,\), expected \(6,\)$"):
        env.step(np.zeros(2))
