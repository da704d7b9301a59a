"""ONNX files make the same choices as the networks in NumPy."""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import TensorProto, helper

from wavegym.core.action_sets import PerSensorLibrary
from wavegym.core.errors import InputError
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.evaluation import as_policy, compare, make_task
from wavegym.evaluation.play import play
from wavegym.observations.forecasts import PRESENT
from wavegym.policies.networks import LearnedPolicy, Network
from wavegym.policies.onnx_files import OnnxPolicy, export_onnx, to_onnx
from wavegym.policies.runs import ALIKE, PRETRAINED, RUN, load_policy, read_network, read_run, shown_in
from wavegym.registration import full_id
from wavegym.schedulers import RandomChoice

ROUNDING = 64 * np.finfo(np.float32).eps  # relative to the largest score: sums of float32 in another order
ENVS, STEPS = 512, 8  # 4096 observations
EACH_KIND = ["KershawEvansPosition/ppo", "RfEo/ppo", "SectorSetup/ppo"]  # mlp, mixture, scorer
ALL = sorted(str(file.parent.relative_to(PRETRAINED)) for file in PRETRAINED.glob(f"*/*/{RUN}"))


def observations(run: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """What the network of a run sees, with its masks, in episodes with random allowed actions of its environment."""
    (forecasts, candidates), rng = shown_in(run), np.random.default_rng(0)
    shell = {"forecasts": forecasts, "candidates": candidates}
    envs = gym.make_vec(run["env"], num_envs=ENVS, **shell, **run["settings"]["environment"])
    choice, system = RandomChoice(), envs.unwrapped.system
    choice.begin(system, ENVS, rng)
    shown, masks = [envs.reset(seed=0)[0]], [envs.unwrapped.action_masks()]
    of_actions = not isinstance(system.actions, PerSensorLibrary)  # else a mask of each sensor's waveforms, all allowed
    for _ in range(STEPS - 1):
        if candidates:  # ranks, all of which are allowed in these environments
            actions = rng.integers(candidates, size=ENVS)
        else:
            actions = choice.act(envs.unwrapped.belief, shown[-1], masks[-1] if of_actions else None)
        shown.append(envs.step(actions)[0])
        masks.append(envs.unwrapped.action_masks())
    own = len(system.observation_fields) if run["actions"]["form"] == ALIKE else 0
    return np.concatenate(shown)[:, own:], np.concatenate(masks)


def session(content: bytes) -> Any:
    options = onnxruntime.SessionOptions()
    options.log_severity_level, options.intra_op_num_threads = 3, 1  # it warns of the mask's default
    return onnxruntime.InferenceSession(content, options)


def clear(scores: np.ndarray) -> np.ndarray:
    """Whether the best score is above the second best by more than what rounding may change."""
    best = np.sort(scores, axis=1)
    largest = np.abs(scores).max(axis=1, where=np.isfinite(scores), initial=1.0)
    return best[:, -1] - best[:, -2] > ROUNDING * largest


def assert_same_choices(network: Network, shown: np.ndarray, mask: np.ndarray | None = None) -> None:
    model = session(to_onnx(network))
    mask = mask if network.kind != "mixture" and network.heads else None
    fed = {"observation": shown} if mask is None else {"observation": shown, "mask": mask}
    (action,) = model.run(["action"], fed)
    expected, outputs = LearnedPolicy(network).act(None, shown, mask), network.outputs(shown)
    assert action.dtype == (np.int64 if expected.dtype == np.int64 else np.float32)
    if expected.dtype != np.int64:
        certain = clear(outputs[:, : network.heads[0]]) if network.kind == "mixture" else np.full(len(shown), True)
        assert certain.mean() > 0.99
        np.testing.assert_allclose(action[certain], expected[certain], rtol=0, atol=ROUNDING)
        return
    scores = outputs if mask is None else np.where(mask, outputs, -np.inf)
    parts = np.split(scores, np.cumsum(network.heads)[:-1], axis=1)
    certain = np.stack([clear(part) for part in parts], axis=1)
    assert certain.mean() > (0.8 if network.is_alike else 0.99)  # sectors or tracks with the same figures tie
    same = action.reshape(certain.shape) == expected.reshape(certain.shape)
    assert same[certain].all()
    np.testing.assert_allclose(model.run(["scores"], fed)[0], outputs, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("name", EACH_KIND)
def test_a_policy_of_each_kind_chooses_alike(name: str) -> None:
    run = read_run(PRETRAINED / name / RUN)
    network, (shown, mask) = read_network(PRETRAINED / name, run), observations(run)
    assert shown.shape == (4096, network.inputs)
    assert network.kind == ("mlp", "mixture", "scorer")[EACH_KIND.index(name)]
    assert_same_choices(network, shown, mask)


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_every_packaged_policy_chooses_alike(name: str) -> None:
    run = read_run(PRETRAINED / name / RUN)
    assert_same_choices(read_network(PRETRAINED / name, run), *observations(run))


def random_network(kind: str, heads: tuple[int, ...], shapes: dict[str, tuple[int, ...]], **fixed: Any) -> Network:
    rng = np.random.default_rng(0)
    arrays = {name: rng.standard_normal(shape).astype(np.float32) for name, shape in shapes.items()}
    return Network(kind, "tanh", heads, {**arrays, **fixed})


SCORER = {"W0": (8, 5), "b0": (8,), "shared": (8, 8), "shared_bias": (8,), "offset": (3, 8), "score": (1, 8)}
ROUND = {"round0": (8, 8), "round0_bias": (8,), "round0_others": (8, 16)}
PAIRS, NO_PAIRS = np.array([[0, 1], [2, 3], [1, 4]]), np.zeros((3, 0), np.int64)
SHAPES: dict[str, Network] = {
    "a choice for each sensor": random_network("mlp", (3, 4), {"W0": (9, 5), "b0": (9,), "W1": (7, 9), "b1": (7,)}),
    "a point of a box": random_network("mlp", (), {"W0": (9, 5), "b0": (9,), "W1": (2, 9), "b1": (2,)}),
    "a scorer without figures": random_network("scorer", (3,), SCORER, pairs=NO_PAIRS),
    "a scorer of forecasts alone": random_network("scorer", (3,), {**SCORER, "own": (8, 4)}, pairs=NO_PAIRS),
    "a scorer of targets alone": random_network("scorer", (3,), {**SCORER, **ROUND, "own": (8, 2)}, pairs=PAIRS),
    "candidates that are alike": random_network(
        "scorer", (3,), {"own": (8, 12), "own_bias": (8,), **ROUND, "score": (1, 8)}
    ),
    "a narrower round": random_network(
        "scorer",
        (3,),
        {**SCORER, "round0": (4, 8), "round0_bias": (4,), "round0_others": (4, 16), "own": (8, 6), "score": (1, 4)},
        pairs=PAIRS,
    ),
}


@pytest.mark.parametrize("name", SHAPES)
def test_every_shape_of_network_is_exported(name: str) -> None:
    network = SHAPES[name]
    elements = network.inputs * (network.heads[0] if network.is_alike else 1)
    rng = np.random.default_rng(1)
    shown = rng.standard_normal((500, elements)).astype(np.float32)
    if network.is_alike:  # some slots are free, but never all
        shown.reshape(500, 3, -1)[..., PRESENT] = 0.0
        shown.reshape(500, 3, -1)[:, :2, PRESENT.start] = rng.integers(0, 2, (500, 2))
        shown.reshape(500, 3, -1)[:, 2, PRESENT.start + 1] = 1.0
    assert_same_choices(network, shown)
    assert_same_choices(network, shown[:1])


def test_a_mask_rules_alternatives_out() -> None:
    network = SHAPES["a choice for each sensor"]
    rng = np.random.default_rng(2)
    shown, mask = rng.standard_normal((500, 5)).astype(np.float32), rng.random((500, 7)) < 0.5
    mask[:, [0, 1, 3, 4]] = True
    assert_same_choices(network, shown, mask)


def test_the_file_says_what_it_was_trained_on(tmp_path: Path) -> None:
    file = tmp_path / "new" / "policy.onnx"
    export_onnx(PRETRAINED / "SectorSetup" / "ppo", file)
    about = {entry.key: entry.value for entry in onnx.load(file).metadata_props}
    assert (about["env"], about["algo"], about["seed"]) == ("wavegym/SectorSetup-v0", "ppo", "0")
    assert about["forecasts"] == "True"
    assert about["observation"].split(", ") == read_run(PRETRAINED / "SectorSetup" / "ppo" / RUN)["observation"]


@pytest.mark.slow
def test_no_torch_is_needed(tmp_path: Path) -> None:
    code = (
        "import sys; sys.modules['torch'] = None; from pathlib import Path;"
        "from wavegym.policies.onnx_files import export_onnx;"
        f"export_onnx(Path({str(PRETRAINED / 'RfEo' / 'ppo')!r}), Path({str(tmp_path / 'x.onnx')!r}))"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_without_the_extra_the_error_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(InputError, match=r"pip install 'wavegym\[onnx\]'"):
        to_onnx(SHAPES["a point of a box"])


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
    """Except for choices between values that differ in the last bits: these depend on the processor."""
    env_id, (worlds, steps) = full_id(name.split("/")[0]), KINDS[name]
    given = {"slots": 32} if "Multifunction" in name else {}  # an ONNX file has a fixed size
    task, file = make_task(env_id, given), tmp_path / "mine.onnx"
    export_onnx(PRETRAINED / name, file)
    (agent,) = load_policy(PRETRAINED / name, env_id, task.system)
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
    export_onnx(PRETRAINED / "KershawEvansPosition" / "ppo", tmp_path / "mine.onnx")
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
