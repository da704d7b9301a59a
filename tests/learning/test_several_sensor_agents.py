"""Training and loading of agents that choose for several sensors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from runs_for_tests import SMALL
from two_sensors import TwoSensors

import train as command
import wavegym
from wavegym.core.action_sets import JointLibrary, Library, PerSensorLibrary
from wavegym.core.errors import InputError
from wavegym.envs import WaveformVectorEnv
from wavegym.evaluation import compare
from wavegym.learning.settings import load_settings
from wavegym.learning.train import train
from wavegym.learning.training_run import TrainingRun
from wavegym.policies.onnx_files import export_onnx
from wavegym.policies.runs import load_policy, signature

ID = "tests/TwoSensors-v0"


@pytest.fixture(autouse=True)
def registered() -> Any:
    wavegym.register(ID, TwoSensors)
    yield
    gym.registry.pop(ID)


def trained(folder: Path, algo: str, **environment: Any) -> Path:
    run = TrainingRun(ID, algo, 1, load_settings(ID, algo, {**SMALL[algo], "steps": 90}, environment))
    train(run, folder, 60, progress=False)
    return folder


@pytest.mark.parametrize(("algo", "form"), [("ppo", "library"), ("ppo", "joint"), ("ppo", "box"), ("dqn", "joint")])
def test_an_agent_of_each_form_is_trained_loaded_and_compared(algo: str, form: str, tmp_path: Path) -> None:
    folder = trained(tmp_path / "run", algo, action=form)
    system = TwoSensors(action=form)
    (policy,) = load_policy(folder, ID, system)
    env = WaveformVectorEnv(system, 5)
    observation, _ = env.reset(seed=0)
    policy.begin(system, 5, np.random.default_rng(0))
    env.step(policy.act(env.belief, observation, None))
    comparison = compare(ID, {"agent": folder}, worlds=4, jobs=1, action=form)
    assert np.isfinite(comparison.cost("agent")).all()


@pytest.mark.parametrize(("algo", "form"), [("ppo", "library"), ("dqn", "box")])
@pytest.mark.parametrize("policy", ["mlp", "scorer"])
def test_an_agent_of_a_short_list_is_trained_loaded_exported_and_compared(
    algo: str, form: str, policy: str, tmp_path: Path
) -> None:
    listed = {"candidates": 4, "policy": policy, "network": (8,)}
    settings = load_settings(ID, algo, {**SMALL[algo], "steps": 90, **listed}, {"action": form})
    train(TrainingRun(ID, algo, 1, settings), tmp_path / "run", 60, progress=False)
    export_onnx(tmp_path / "run", tmp_path / "agent.onnx")
    agents = {"run": tmp_path / "run", "file": str(tmp_path / "agent.onnx")}
    played = compare(ID, agents, worlds=4, jobs=1, progress=False, action=form)
    assert np.isfinite(played.cost("run")).all()
    np.testing.assert_array_equal(played.cost("run"), played.cost("file"))


def test_a_teacher_of_an_agent_of_a_short_list_is_refused(tmp_path: Path) -> None:
    settings = load_settings(ID, "ppo", {**SMALL["ppo"], "candidates": 4, "teacher": "myopic"})
    with pytest.raises(InputError, match=r"teacher is 'myopic' with candidates=4, expected '' \(nearest\): a teacher"):
        train(TrainingRun(ID, "ppo", 1, settings), tmp_path / "run", 60, progress=False)


def test_an_agent_of_another_form_or_sub_library_is_refused(tmp_path: Path) -> None:
    each, joint = (trained(tmp_path / form, "ppo", action=form) for form in ("library", "joint"))
    with pytest.raises(
        InputError, match=r"among actions 3 \(library for each of 2 sensors, .*offers 4 \(joint"
    ) as caught:
        load_policy(each, ID, TwoSensors(action="joint"))
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=r"among actions 4 \(joint, .*offers 9 \(joint"):
        load_policy(joint, ID, TwoSensors(action="joint", few=3))


def test_signatures_tell_action_sets_apart() -> None:
    library = TwoSensors().library
    sets = [library, *(kind(library, n) for kind in (PerSensorLibrary, JointLibrary) for n in (1, 2, 3))]

    class Shown(TwoSensors):
        actions: Any = None

    signatures = []
    for actions in sets:
        system = Shown()
        object.__setattr__(system, "actions", actions)
        signatures.append(signature(system)["actions"])
    assert isinstance(sets[0], Library)
    assert signatures[0]["form"] == "library"
    for i, one in enumerate(signatures):
        assert all(one != other for other in signatures[:i])


def test_dqn_is_pointed_to_the_joint_form(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main([ID, "--algo", "dqn", "--out", str(tmp_path / "run"), "--quiet"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "dqn cannot choose from MultiDiscrete([3 3]), expected candidates=K, or a joint library" in line
    assert not (tmp_path / "run").exists()
