"""Policies in ONNX files play what the networks they come from play."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from wavegym.core.errors import InputError
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.evaluation import as_policy, compare, make_task
from wavegym.evaluation.play import play
from wavegym.policies.onnx_export import export_onnx
from wavegym.policies.onnx_policy import OnnxPolicy
from wavegym.policies.pretrained import FOLDER
from wavegym.policies.runs import load_policy

KINDS = {  # worlds and steps: an observation alone, a box, masks, forecasts beside it, forecasts alone
    "KershawEvansPosition/ppo": (20, 50),
    "RfEo/ppo": (8, 60),
    "EnergyBudgetKnown/ppo": (4, 40),
    "SectorSetup/ppo": (20, 60),
    "MultifunctionRadar/ppo": (8, 100),
}


class Shadowed:
    """Plays as one policy, and asks another one for its actions at the same decisions."""

    def __init__(self, leader: Policy, follower: Policy) -> None:
        self.both, self.same = (leader, follower), list[np.ndarray]()

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        for policy in self.both:
            policy.begin(system, num_envs, rng)

    def act(self, belief: Any, observation: np.ndarray | None, mask: np.ndarray | None) -> np.ndarray:
        action, other = (policy.act(belief, observation, mask) for policy in self.both)
        close = np.isclose(action, other, rtol=0, atol=1e-5)
        self.same.append(close.reshape(len(action), -1).all(axis=1))
        return action


@pytest.mark.parametrize("name", KINDS)
def test_an_exported_agent_plays_as_the_agent(name: str, tmp_path: Path) -> None:
    """Up to choices between values that differ in the last bits: which is taken depends on the processor."""
    env_id, (worlds, steps) = f"wavegym/{name.split('/')[0]}-v0", KINDS[name]
    given = {"slots": 32} if "Multifunction" in name else {}  # an ONNX file has a fixed size
    task, file = make_task(env_id, given), tmp_path / "mine.onnx"
    export_onnx(FOLDER / name, file)
    (agent,) = load_policy(FOLDER / name, env_id, task.system)
    mine = as_policy(file, task)
    assert isinstance(mine, Policy)
    assert isinstance(mine, OnnxPolicy)
    shadowed = Shadowed(agent, mine)
    one, two = (play(task, policy, list(range(worlds)), max_steps=steps) for policy in (shadowed, mine))
    assert np.mean(shadowed.same) > 0.9
    assert one.cost[:, 0] == pytest.approx(two.cost[:, 0], rel=1e-4), "before choices differ, worlds do not"
    assert two.cost.mean() == pytest.approx(one.cost.mean(), rel=0.02)
    agreed = np.logical_and.accumulate(shadowed.same).T
    np.testing.assert_allclose(two.cost[agreed], one.cost[agreed], rtol=1e-4)


def test_a_file_is_compared_by_its_name_in_several_processes(tmp_path: Path) -> None:
    export_onnx(FOLDER / "KershawEvansPosition" / "ppo", tmp_path / "mine.onnx")
    policies: dict[str, Any] = {"mine": tmp_path / "mine.onnx", "ppo": None}
    compared = compare("KershawEvansPosition-v0", policies, worlds=60, jobs=2, progress=False)
    np.testing.assert_allclose(compared.cost("mine")[0], compared.cost("ppo")[0], rtol=0.01)
    assert pickle.loads(pickle.dumps(OnnxPolicy(tmp_path / "mine.onnx"))).elements == 6


def written(tmp_path: Path, inputs: dict[str, Any], outputs: tuple[str, ...] = ("action",)) -> Path:
    """A model that returns the sum of its first input as each output."""
    node_inputs = [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in inputs.items()]
    node_outputs = [helper.make_tensor_value_info(name, TensorProto.FLOAT, None) for name in outputs]
    nodes = [helper.make_node("ReduceSum", [next(iter(inputs))], [name], keepdims=0) for name in outputs]
    model = helper.make_model(
        helper.make_graph(nodes, "any", node_inputs, node_outputs), opset_imports=[helper.make_opsetid("", 18)]
    )
    model.ir_version = 10
    onnx.save(model, tmp_path / "other.onnx")
    return tmp_path / "other.onnx"


@pytest.mark.parametrize(
    ("inputs", "outputs", "text"),
    [
        ({"state": ["batch", 6]}, ("action",), "has inputs state and outputs action, expected observation"),
        ({"observation": ["batch", 6], "h": ["batch", 2]}, ("action",), "has inputs observation, h and outputs"),
        ({"observation": ["batch", 6]}, ("logits",), "outputs logits, expected observation"),
        ({"observation": ["batch", 6, 1]}, ("action",), "expected observation .batch, elements."),
        ({"observation": ["batch", "any"]}, ("action",), "expected observation .batch, elements."),
    ],
)
def test_a_model_of_another_form_is_one_line(
    inputs: dict[str, Any], outputs: tuple[str, ...], text: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=text):
        OnnxPolicy(written(tmp_path, inputs, outputs))


def test_files_that_are_no_models_and_other_sizes_are_one_line(tmp_path: Path) -> None:
    (tmp_path / "text.onnx").write_text("no model")
    with pytest.raises(InputError, match=r"text.onnx' is no ONNX model that can be loaded: \S[^\n]*$"):
        OnnxPolicy(tmp_path / "text.onnx")
    with pytest.raises(InputError, match=r"none.onnx cannot be read: No such file"):
        OnnxPolicy(tmp_path / "none.onnx")
    policy = OnnxPolicy(written(tmp_path, {"observation": ["batch", 5]}))
    wanted = r"takes 5 elements, expected 6 \(the observation\) or \d+ \(its forecasts\) or \d+ \(both\)"
    with pytest.raises(InputError, match=wanted):
        policy.begin(make_task("KershawEvansPosition-v0", {}).system, 1, np.random.default_rng(0))
    with pytest.raises(InputError, match=r"takes 5 elements, expected 28 \(the observation\)$"):
        policy.begin(make_task("RfEo-v0", {}).system, 1, np.random.default_rng(0))
    with pytest.raises(InputError, match="was given no observation"):
        policy.act(None, None, None)
