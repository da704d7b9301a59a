"""Trained networks in plain NumPy: the same choices as torch's, outputs equal to 1e-6.

The range of a training against the extremes of what was observed.
"""

from __future__ import annotations

import json
import shutil
import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from runs_for_tests import ENVIRONMENT, EVERY, ID, SMALL, small_run

from wavegym.core.errors import InputError, InputWarning
from wavegym.core.files import pack_arrays, unpack_arrays
from wavegym.core.policy import Trained
from wavegym.envs import WaveformVectorEnv
from wavegym.evaluation import compare, make_task
from wavegym.evaluation.play import play
from wavegym.learning.export import export
from wavegym.learning.models import build_model
from wavegym.learning.settings import load_settings
from wavegym.learning.train import train
from wavegym.learning.training_run import TrainingRun
from wavegym.policies.networks import MARGIN, RANGE_KEY, LearnedPolicy, Network, TrainingRange
from wavegym.policies.runs import PRETRAINED, load_policy
from wavegym.registration import full_id
from wavegym.schedulers import Myopic
from wavegym.systems.multifunction_radar.system import MultifunctionRadar

SECTOR, CLUTTER, POSITION, RADAR = (
    full_id(name) for name in ("SectorSetup", "AgileClutter", "KershawEvansPosition", "MultifunctionRadar")
)
SCORER = {"policy": "scorer", "network": (16, 16, 8), "forecasts": True}
CASES: dict[str, tuple[str, str, dict[str, Any], dict[str, Any]]] = {
    "ppo": (POSITION, "ppo", {}, {}),
    "ppo, relu": (POSITION, "ppo", {"activation": "relu", "network": (32, 16, 8)}, {}),
    "dqn": (POSITION, "dqn", {}, {}),
    "box": (POSITION, "ppo", {}, {"action": "box"}),
    "several modes": (POSITION, "ppo", {"modes": 4}, {"action": "box"}),
    "several sensors": (CLUTTER, "ppo", {}, {"action": "library"}),
    "masked": (SECTOR, "ppo", {"masks": True, "policy": "mlp"}, {}),
    "scorer": (SECTOR, "ppo", SCORER, {}),
    "masked scorer": (SECTOR, "ppo", {**SCORER, "masks": True}, {}),
    "scorer without rounds": (SECTOR, "ppo", {**SCORER, "network": (16,)}, {}),
    "scorer without forecasts": (SECTOR, "ppo", {**SCORER, "forecasts": False}, {}),
    "dueling scorer": (SECTOR, "dqn", SCORER, {}),
}
ALIKE = (RADAR, "ppo", {**SCORER, "teacher": "", "variants": (), "masks": True}, {"slots": 6, "settled": 0.0})


def untrained(name: str) -> tuple[Any, Any]:
    """A model with weights drawn anew, so that no layer is nearly 0, and observations for it."""
    env_id, algo, changes, environment = {**CASES, "alike": ALIKE}[name]
    run = TrainingRun(env_id, algo, 0, load_settings(env_id, algo, {**SMALL[algo], **changes}, environment))
    model: Any = build_model(run)
    generator = torch.Generator().manual_seed(1)
    for parameter in model.policy.parameters():
        if parameter.ndim > 1:
            parameter.data = torch.randn(parameter.shape, generator=generator) / parameter.shape[-1] ** 0.5
    envs = gym.make_vec(env_id, num_envs=50, forecasts=run.settings.forecasts, **environment)
    return model, envs.reset(seed=0)[0]


def torch_outputs(model: Any, shown: np.ndarray) -> np.ndarray:
    """Q values less a state's mean, logits less each choice's mean, or the last layer's outputs in a box."""
    policy = model.policy
    with torch.no_grad():
        given = torch.as_tensor(shown)
        if hasattr(policy, "q_net"):
            return centred(policy.q_net(given).numpy(), (model.action_space.n,))
        latent = policy.mlp_extractor.forward_actor(given)
        outputs = policy.action_net(latent).numpy()
    heads = getattr(model.action_space, "nvec", None)
    if heads is None and hasattr(model.action_space, "n"):
        heads = (model.action_space.n,)
    return outputs if heads is None else centred(outputs, tuple(heads))


def centred(outputs: np.ndarray, heads: tuple[int, ...]) -> np.ndarray:
    parts = np.split(outputs.astype(np.float64), np.cumsum(heads)[:-1], axis=1)
    return np.concatenate([part - part.mean(axis=1, keepdims=True) for part in parts], axis=1)


@pytest.mark.parametrize("name", CASES)
def test_the_export_equals_the_torch_policy(name: str) -> None:
    model, shown = untrained(name)
    network = Network.from_bytes(export(model.policy).to_bytes())
    outputs = network.outputs(shown)
    assert outputs.dtype == np.float32
    is_box = isinstance(model.action_space, spaces.Box)
    compared = outputs if is_box else centred(outputs, network.heads)
    expected = torch_outputs(model, shown)
    assert np.ptp(expected, axis=0).max() > 1e-3  # it depends on what is observed
    np.testing.assert_allclose(compared, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
    chosen = LearnedPolicy(network).act(None, shown, None)
    predicted = model.predict(shown, deterministic=True)[0]
    if is_box:
        np.testing.assert_allclose(chosen, predicted, atol=1e-6)
        assert (np.abs(chosen) <= 1.0).all()
    else:
        assert (chosen == predicted).all()


def test_a_scorer_of_candidates_that_are_alike_plays_with_any_slots() -> None:
    """It equals torch's policy, and scores the same dwells alike in the order of the slots and among more free ones."""
    model, shown = untrained("alike")
    policy = LearnedPolicy(Network.from_bytes(export(model.policy).to_bytes()), forecasts=True)
    own, figures = len(model.env.get_attr("system")[0].observation_fields), policy.network.inputs
    outputs = policy.network.outputs(shown[:, own:])
    expected = torch_outputs(model, shown)
    np.testing.assert_allclose(
        centred(outputs, policy.network.heads), expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max()
    )  # sums over 73 candidates in float32
    order = np.random.default_rng(0).permutation(outputs.shape[1])
    permuted = shown[:, own:].reshape(50, -1, figures)[:, order].reshape(50, -1)
    np.testing.assert_allclose(policy.network.outputs(permuted), outputs[:, order], rtol=1e-5, atol=1e-5)
    few, many = (scores_of(policy.network, slots) for slots in (30, 40))
    np.testing.assert_allclose(few, many[:, [*range(120), *range(160, many.shape[1])]], rtol=1e-5, atol=1e-5)
    env = WaveformVectorEnv(MultifunctionRadar, 20, slots=40, settled=0.0)
    env.reset(seed=3)
    for slot in range(5):  # tracks are alike at first
        bare = env.step(np.full(20, 4 * slot))[0]
    policy.begin(env.system, 20, np.random.default_rng(0))
    chosen = policy.act(env.belief, bare, env.action_masks())
    assert env.action_masks()[np.arange(20), chosen].all()
    assert len(set(chosen.tolist())) > 3


def scores_of(network: Network, slots: int) -> np.ndarray:
    """Scores of the dwells at the beginning of the same 20 worlds, (env, action)."""
    env = WaveformVectorEnv(MultifunctionRadar, 20, slots=slots, settled=0.0, forecasts=True)
    return network.outputs(env.reset(seed=3)[0][:, len(env.system.observation_fields) :])


def test_forecasts_that_the_observation_lacks_are_made_of_the_belief() -> None:
    model, _ = untrained("scorer")
    policy = LearnedPolicy(export(model.policy), forecasts=True)
    env, plain = (WaveformVectorEnv(model.env.get_attr("system")[0], 20, forecasts=f) for f in (True, False))
    full, bare = env.reset(seed=3)[0], plain.reset(seed=3)[0]
    policy.begin(env.system, 20, np.random.default_rng(0))
    assert (policy.act(plain.belief, bare, None) == policy.act(env.belief, full, None)).all()


def test_the_same_network_makes_the_same_file_and_no_pickle_is_read(tmp_path: Any) -> None:
    model, _ = untrained("scorer")
    assert export(model.policy).to_bytes() == export(model.policy).to_bytes()
    np.savez(tmp_path / "evil.npz", _kind=np.array({"code": 1}, dtype=object))
    with pytest.raises(ValueError, match="an array of object"):
        Network.from_bytes((tmp_path / "evil.npz").read_bytes())


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_weights_that_are_not_finite_are_refused_one_by_one(value: float) -> None:
    """tanh of an infinite sum is finite, so outputs alone would not tell."""
    model, _ = untrained("ppo")
    content = export(model.policy).to_bytes()
    weights = [name for name, array in unpack_arrays(content).items() if array.dtype == np.float32]
    assert len(weights) >= 4
    for name in weights:
        arrays = {other: np.array(array) for other, array in unpack_arrays(content).items()}
        arrays[name].reshape(-1)[0] = value
        with pytest.raises(ValueError, match=f"weights {name} are not finite"):
            Network.from_bytes(pack_arrays(arrays))


def test_a_scorer_wants_one_index_and_a_width() -> None:
    with pytest.raises(
        InputError, match=r"network is \(\), expected at least one width for a scorer \(nearest: \(64,\)\)"
    ):
        load_settings(SECTOR, "ppo", {"policy": "scorer", "network": ()})
    settings = load_settings(CLUTTER, "ppo", {**SMALL["ppo"], "policy": "scorer", "network": (8,)})
    with pytest.raises(InputError, match=r"a scorer cannot choose from MultiDiscrete.*policy=mlp"):
        build_model(TrainingRun(CLUTTER, "ppo", 0, settings))


AGENTS = sorted(str(file.parent.relative_to(PRETRAINED)) for file in PRETRAINED.glob("*/*/run.json"))
OBSERVATIONS = arrays(np.float32, (6, 2 + 3 * 4), elements=st.floats(-10.0, 10.0, width=32))


@given(OBSERVATIONS)
def test_observations_of_the_training_are_inside_its_range_and_far_ones_outside(shown: np.ndarray) -> None:
    """Two elements of its own, three candidates with four forecasts each."""
    found = TrainingRange.of(shown, 2, 4)
    assert found.low.shape == found.high.shape == (6,)
    assert not found.is_left(shown).any()
    figures = shown[:, 2:].reshape(6, 3, 4)
    np.testing.assert_array_equal(found.low, np.concatenate([shown[:, :2].min(axis=0), figures.min(axis=(0, 1))]))
    np.testing.assert_array_equal(found.high, np.concatenate([shown[:, :2].max(axis=0), figures.max(axis=(0, 1))]))
    for column, field in [(0, 0), (1, 1), (2, 2), (2 + 4 + 3, 5), (2 + 8 + 1, 3)]:
        width = found.high[field] - found.low[field]
        for edge, sign in ((found.high, 1.0), (found.low, -1.0)):
            for step, is_left in ((0.9 * MARGIN, False), (1.1 * MARGIN + 1e-3, True)):
                moved = shown.astype(np.float64)
                moved[4, column] = edge[field] + sign * (step * width + 1e-3 * is_left)
                assert found.is_left(moved).tolist() == [n == 4 and is_left for n in range(6)]


@given(OBSERVATIONS, OBSERVATIONS)
def test_joined_is_the_range_of_all(first: np.ndarray, second: np.ndarray) -> None:
    parts, both = [TrainingRange.of(part, 2, 4) for part in (first, second)], np.concatenate([first, second])
    joined, whole = parts[0].joined(parts[1]), TrainingRange.of(both, 2, 4)
    np.testing.assert_array_equal(joined.low, whole.low)
    np.testing.assert_array_equal(joined.high, whole.high)
    read = TrainingRange.from_record(json.loads(json.dumps(whole.record())))
    np.testing.assert_allclose(read.low, whole.low, rtol=0, atol=6e-5)
    assert not read.is_left(both).any(), "rounding puts nothing outside"


def test_a_training_records_what_its_policy_observes(unbroken: dict[str, Path], tmp_path: Path) -> None:
    """The recorded range is exactly that of an independent play, over all variants if there are several."""
    found = {name: _range(unbroken[name]) for name in ("ppo", "dqn")}
    (policy,) = load_policy(unbroken["ppo"], ID, make_task(ID, {"horizon": ENVIRONMENT["horizon"]}).system)
    assert isinstance(policy, Trained)
    seen = _observed(policy, {"horizon": ENVIRONMENT["horizon"]})
    width = found["ppo"].high - found["ppo"].low
    assert (np.abs(seen.min(axis=0) - found["ppo"].low) <= 0.3 * width + 1e-3).all()
    assert (np.abs(seen.max(axis=0) - found["ppo"].high) <= 0.3 * width + 1e-3).all()
    run = small_run("ppo", variants=[{"start_range": (50e3, 60e3)}, {"start_range": (170e3, 210e3)}, {}])
    train(run, tmp_path / "run", EVERY["ppo"], progress=False)
    both = _range(tmp_path / "run")
    assert (both.high - both.low)[0] > 5.0 * width[0], "the SNR of near targets is higher"


def _range(folder: Path) -> TrainingRange:
    return TrainingRange.from_record(json.loads((folder / "run.json").read_text())[RANGE_KEY])


def _observed(policy: Any, parameters: dict[str, Any]) -> np.ndarray:
    """The observations in 200 test worlds."""
    shown: list[np.ndarray] = []

    class Noting(LearnedPolicy):
        def act(self, belief: Any, observation: Any, mask: Any) -> Any:
            shown.append(observation)
            return super().act(belief, observation, mask)

    play(make_task(ID, parameters), Noting(policy.network), list(range(200)))
    return np.concatenate(shown[:-1])


@pytest.mark.parametrize("name", AGENTS)
@pytest.mark.slow
def test_every_packaged_agent_has_a_range_that_its_test_worlds_keep(name: str) -> None:
    """In at least nine tenths of the decisions, so that there is no warning."""
    run = json.loads((PRETRAINED / name / "run.json").read_text())
    environment = {**run["settings"]["environment"]}
    task = make_task(run["env"], environment)
    (policy,) = load_policy(PRETRAINED / name, run["env"], task.system)
    played = play(task, policy, list(range(50, 66)), max_steps=300)
    assert played.outside.mean() < 0.1


def test_compare_warns_of_an_agent_in_worlds_unlike_its_training() -> None:
    with pytest.warns(InputWarning) as caught:
        compared = compare(ID, {"ppo": None}, worlds=20, jobs=1, progress=False, start_range=(900e3, 950e3))
    (text,) = (str(warning.message) for warning in caught if "observations" in str(warning.message))
    assert text == "policy 'ppo' takes 100% of its decisions on observations outside the range of its training"
    assert compared.results("ppo").outside.mean() > 0.99
    assert np.isnan(compared.results("myopic").outside).all(), "a scheduler has no training"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        compared = compare(ID, {"ppo": None}, worlds=20, jobs=1, progress=False)
    assert (compared.results("ppo").outside < 0.1).all()


def test_runs_without_a_record_play_and_a_broken_one_is_one_line(unbroken: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(unbroken["ppo"], tmp_path / "run"))
    task, run = make_task(ID, {"horizon": ENVIRONMENT["horizon"]}), json.loads((folder / "run.json").read_text())
    kept = run.pop(RANGE_KEY)
    (folder / "run.json").write_text(json.dumps(run))
    (policy,) = load_policy(folder, ID, task.system)
    assert np.isnan(play(task, policy, [1, 2]).outside).all()
    assert np.isnan(play(task, Myopic(), [1, 2]).outside).all()
    for broken in (3, {}, {**kept, "low": kept["low"][1:]}, {**kept, "own": 2}, {**kept, "high": ["x"] * 6}):
        (folder / "run.json").write_text(json.dumps({**run, RANGE_KEY: broken}))
        with pytest.raises(
            InputError, match=r"'observed' is no range, expected own = \d+ and low and high of \d+ numbers"
        ):
            load_policy(folder, ID, task.system)
