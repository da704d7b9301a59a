"""Environments registered by users."""

import gymnasium as gym
import numpy as np
import pytest
from matplotlib.figure import Figure

import wavegym
from wavegym import registration
from wavegym.core.errors import InputError
from wavegym.envs.film import make_scene
from wavegym.registration import RECORDS, SYSTEMS, full_id
from wavegym.systems.kershaw_evans.scene import LineOfSightScene
from wavegym.systems.kershaw_evans.system import KershawEvans

ID = "tests/CutOff-v0"


@pytest.fixture
def cut_off():
    wavegym.register(ID, "wavegym.systems.kershaw_evans.system:KershawEvansPosition", max_episode_steps=5, horizon=9)
    yield
    del gym.registry[ID]


def length(env):
    """Steps to the end of the first episode, and whether it was truncated."""
    env.action_space.seed(0)
    env.reset(seed=0)
    for k in range(1, 20):
        _, _, terminated, truncated, _ = env.step(env.action_space.sample())
        if np.any(terminated | truncated):
            return k, bool(np.all(truncated))
    return None


@pytest.mark.usefixtures("cut_off")
@pytest.mark.parametrize(
    ("override", "want"), [({}, (5, True)), ({"max_episode_steps": 3}, (3, True)), ({"q": 2.0}, (5, True))]
)
def test_a_registered_time_limit_holds_until_it_is_overridden(override, want):
    assert length(gym.make(ID, **override)) == want
    assert length(gym.make_vec(ID, 2, **override)) == want
    assert length(gym.make_vec(ID, 2, vectorization_mode="sync", **override)) == want
    assert gym.spec(ID).max_episode_steps == 5


@pytest.mark.parametrize(
    ("system", "parameters", "words"),
    [
        ("no_class_here", {}, "system is 'no_class_here', expected 'package.module:Class'"),
        ("package.module.Class", {}, "expected 'package.module:Class'"),
        (3, {}, "system is 3, expected a System, its class, or 'package.module:Class'"),
        (dict, {}, "system is <class 'dict'>, expected a System"),
        (
            KershawEvans,
            {"horizn": 5},
            "KershawEvans got an unexpected keyword argument 'horizn'; did you mean 'horizon'",
        ),
        (
            KershawEvans,
            {"rewrd": "trace"},
            "KershawEvans got an unexpected keyword argument 'rewrd'; did you mean 'reward'",
        ),
        (KershawEvans, {"horizon": 0}, "horizon is 0, expected an integer >= 1"),
        (
            KershawEvans(),
            {"horizn": 5},
            "KershawEvans got an unexpected keyword argument 'horizn'; did you mean 'horizon'",
        ),
    ],
)
def test_what_cannot_be_made_is_not_registered(system, parameters, words):
    with pytest.raises(InputError, match=words) as caught:
        wavegym.register("tests/Wrong-v0", system, **parameters)
    assert "\n" not in str(caught.value)
    assert "tests/Wrong-v0" not in gym.registry


def test_a_finished_system_takes_other_parameters():
    wavegym.register("tests/Finished-v0", KershawEvans(q=9.0), horizon=5)
    try:
        system = gym.make("tests/Finished-v0", truth={"q": 2.0}).unwrapped.system
    finally:
        del gym.registry["tests/Finished-v0"]
    assert system == KershawEvans(q=9.0, horizon=5, truth={"q": 2.0})


def test_a_string_is_not_imported_when_it_is_registered():
    wavegym.register("tests/Later-v0", "no_such_package.module:Class", reward="log-cost", anything=3)
    try:
        with pytest.raises(InputError, match=r"'no_such_package\.module:Class', which cannot be loaded"):
            gym.make("tests/Later-v0")
    finally:
        del gym.registry["tests/Later-v0"]


class Blank:
    def __init__(self, system, figure):
        self.system = system


def test_a_scene_from_outside_serves_a_class_and_its_subclasses():
    class Mine(KershawEvans):
        pass

    class Heir(Mine):
        pass

    before = make_scene(Mine(), Figure().subfigures(1, 1))
    assert isinstance(before, LineOfSightScene), "of the base class"
    wavegym.register("tests/Mine-v0", Mine, scene=f"{__name__}:Blank")
    try:
        for system in (Mine(), Heir()):
            assert type(make_scene(system, Figure().subfigures(1, 1))).__name__ == "Blank"
        assert isinstance(make_scene(KershawEvans(), Figure().subfigures(1, 1)), LineOfSightScene)
        with pytest.raises(InputError, match=r"scene of tests/Other-v0 is .*: tests/Mine-v0 gives its system"):
            wavegym.register("tests/Other-v0", Mine, scene=LineOfSightScene)
    finally:
        del gym.registry["tests/Mine-v0"], RECORDS["tests/Mine-v0"]


def test_a_scene_that_is_not_there_is_named_when_it_is_drawn():
    class Mine(KershawEvans):
        pass

    wavegym.register("tests/Mine-v0", Mine, scene="no_such_package:Scene")
    try:
        with pytest.raises(InputError, match="scene is 'no_such_package:Scene', which cannot be loaded"):
            make_scene(Mine(), Figure().subfigures(1, 1))
    finally:
        del gym.registry["tests/Mine-v0"], RECORDS["tests/Mine-v0"]


def test_an_id_without_a_version_is_the_latest_and_an_old_one_names_it(monkeypatch):
    versions = {f"wavegym/MultifunctionRadar-v{n}": SYSTEMS["wavegym/MultifunctionRadar-v1"] for n in (1, 9, 10)}
    monkeypatch.setattr(registration, "list_envs", lambda: [*SYSTEMS, *versions])
    assert full_id("MultifunctionRadar") == full_id("wavegym/MultifunctionRadar") == "wavegym/MultifunctionRadar-v10"
    assert full_id("KershawEvans") == "wavegym/KershawEvans-v0"
    monkeypatch.undo()
    with pytest.raises(gym.error.DeprecatedEnv, match="use `wavegym/MultifunctionRadar-v1`"):
        gym.make_vec("wavegym/MultifunctionRadar-v0", num_envs=1)
    with pytest.raises(InputError, match="did you mean 'wavegym/MultifunctionRadar-v1'"):
        full_id("MultifunctionRadar-v0")
