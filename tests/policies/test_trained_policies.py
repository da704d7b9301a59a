"""Trained policies out of their folders."""

from __future__ import annotations

import hashlib
import json
import pickle
import random
import shutil
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from runs_for_tests import ENVIRONMENT, ID, small_run
from stable_baselines3 import DQN, PPO

import wavegym
from wavegym.core.errors import InputError, InputWarning
from wavegym.core.parameters import parameter, system_parameters
from wavegym.core.policy import Policy
from wavegym.envs import WaveformVectorEnv
from wavegym.evaluation import make_task, world_seeds
from wavegym.evaluation.play import play
from wavegym.learning.train import train
from wavegym.policies.runs import load_policy, pretrained_folder, signature
from wavegym.systems.kershaw_evans.system import KershawEvansPosition

SYSTEM = make_task(ID, {"horizon": ENVIRONMENT["horizon"]}).system  # that of the small runs
OTHER = make_task("wavegym/KershawEvans-v0", {}).system
RF_EO, RF_EO_FAR = (f"wavegym/{name}-v0" for name in ("RfEo", "RfEoFar"))
CLASSES: dict[str, Any] = {"ppo": PPO, "dqn": DQN}


def rewrite(folder: Path, **changes: Any) -> None:
    """Change entries of run.json."""
    run = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps({**run, **changes}))


def forge(folder: Path, content: bytes) -> None:
    """Another policy.npz, with the record that vouches for it."""
    (folder / "policy.npz").write_bytes(content)
    rewrite(folder, policy_sha256=hashlib.sha256(content).hexdigest())


def observations(count: int = 40) -> np.ndarray:
    env = WaveformVectorEnv(SYSTEM, count)
    return env.reset(seed=5)[0]


@pytest.mark.parametrize("algo", ["ppo", "dqn"])
def test_a_policy_chooses_what_its_model_predicts(algo: str, unbroken: dict[str, Path]) -> None:
    (policy,) = load_policy(unbroken[algo], ID, SYSTEM)
    assert isinstance(policy, Policy)
    policy.begin(SYSTEM, 40, np.random.default_rng(0))
    model = CLASSES[algo].load(unbroken[algo] / "model.zip", device="cpu")
    shown = observations()
    expected = model.predict(shown, deterministic=True)[0]
    assert (policy.act(None, shown, None) == expected).all()
    assert (pickle.loads(pickle.dumps(policy)).act(None, shown, None) == expected).all()


@pytest.mark.parametrize("algo", ["ppo", "dqn"])
def test_masked_actions_are_never_chosen_and_the_mask_changes_nothing_else(
    algo: str, unbroken: dict[str, Path]
) -> None:
    (policy,) = load_policy(unbroken[algo], ID, SYSTEM)
    shown = observations()
    free = policy.act(None, shown, None)
    everything = np.ones((len(shown), 56), np.bool_)
    assert (policy.act(None, shown, everything) == free).all()
    allowed = everything.copy()
    allowed[np.arange(20), free[:20]] = False
    masked = policy.act(None, shown, allowed)
    assert (masked[:20] != free[:20]).all()
    assert (masked[20:] == free[20:]).all()
    only = np.zeros_like(allowed)
    only[:, 17] = True
    assert (policy.act(None, shown, only) == 17).all()


def test_a_box_policy_stays_in_the_box(tmp_path: Path) -> None:
    run = small_run("ppo", steps=60)
    boxed = type(run.settings)(**{**vars(run.settings), "environment": {**ENVIRONMENT, "action": "box"}})
    train(type(run)(ID, "ppo", 1, boxed), tmp_path / "run", 60, progress=False)
    system = make_task(ID, {"action": "box", "horizon": ENVIRONMENT["horizon"]}).system
    (policy,) = load_policy(tmp_path / "run", ID, system)
    actions = policy.act(None, 10.0 * observations(), None)
    assert actions.shape == (40, 2)
    assert (np.abs(actions) <= 1.0).all()
    with pytest.raises(InputError, match=r"2 \(box, .*offers 56 \(library.*nearest: the setting.* action=box of"):
        load_policy(tmp_path / "run", ID, SYSTEM)


def test_loading_leaves_the_global_generators_alone(unbroken: dict[str, Path]) -> None:
    random.seed(3)
    np.random.seed(3)  # noqa: NPY002
    first = random.random(), np.random.random()  # noqa: NPY002
    random.seed(3)
    np.random.seed(3)  # noqa: NPY002
    load_policy(unbroken["dqn"], ID, SYSTEM)
    assert (random.random(), np.random.random()) == first  # noqa: NPY002


def test_loading_needs_no_environment(unbroken: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(WaveformVectorEnv, "__init__", lambda *_, **__: pytest.fail("an environment was made"))
    assert len(load_policy(unbroken["ppo"], ID, SYSTEM)) == 1


def test_a_folder_of_runs_gives_all_in_order(unbroken: dict[str, Path], tmp_path: Path) -> None:
    folder = tmp_path / "ppo"
    shutil.copytree(unbroken["ppo"], folder / "seed1")
    train(small_run("ppo", seed=0), folder / "seed0", 300, progress=False)
    (folder / "notes").mkdir()
    first, second = load_policy(folder, ID, SYSTEM)
    shown = observations()
    for policy, name in ((first, "seed0"), (second, "seed1")):
        model = PPO.load(folder / name / "model.zip", device="cpu")
        assert (policy.act(None, shown, None) == model.predict(shown, deterministic=True)[0]).all()


@pytest.mark.parametrize(
    ("env_id", "system", "message"),
    [
        ("wavegym/KershawEvans-v0", OTHER, f"was trained in {ID} and chooses among actions 56 .*offers 88"),
        (
            ID,
            {"model": "ca", "weights": (1, 0, 0), "prior_variance": (1, 1, 1)},
            "correlation_rdot_r., not .*rddot",
        ),
        (ID, {"durations": (1e-5, 2e-5)}, r"among actions 56 \(library, .*offers 14 \(library"),
        (ID, {"sweeps": (0.0, 1e5, -1e5, 3e5, -3e5, 2e6, -2e6)}, r"among actions 56 \(library, .*offers 56 \(library"),
    ],
)
def test_a_policy_of_another_environment_is_refused(
    env_id: str, system: Any, message: str, unbroken: dict[str, Path]
) -> None:
    here = KershawEvansPosition(**system) if isinstance(system, dict) else system
    with pytest.raises(InputError, match=message) as caught:
        load_policy(unbroken["ppo"], env_id, here)
    assert "\n" not in str(caught.value)


@system_parameters
class Windy(KershawEvansPosition):
    """A subclass with the observations and actions of its base, and a parameter of its own."""

    wind: float = parameter(3.0, "speed of the wind", unit="m/s")


@pytest.fixture
def windy() -> Iterator[str]:
    wavegym.register("tests/Windy-v0", Windy)
    yield "tests/Windy-v0"
    gym.registry.pop("tests/Windy-v0")


def test_a_subclass_with_the_same_signature_plays(windy: str, unbroken: dict[str, Path]) -> None:
    system = make_task(windy, {"horizon": 7}).system  # as in the training
    assert signature(system) == signature(SYSTEM)
    with pytest.warns(InputWarning, match=f"was trained in {ID}, not in {windy}") as caught:
        (policy,) = load_policy(unbroken["ppo"], windy, system)
    (notice,) = caught
    assert "parameters that differ" not in str(notice.message)
    (same,) = load_policy(unbroken["ppo"], ID, SYSTEM)
    shown = observations()
    assert (policy.act(None, shown, None) == same.act(None, shown, None)).all()
    assert play(make_task(windy, {"horizon": 7}), policy, world_seeds(0, "test", 2)).steps.tolist() == [7, 7]


def test_the_parameters_that_differ_from_training_are_named_once(unbroken: dict[str, Path], tmp_path: Path) -> None:
    for seed in (1, 2):
        shutil.copytree(unbroken["ppo"], tmp_path / f"seed{seed}")
        rewrite(tmp_path / f"seed{seed}", seed=seed)
    with pytest.warns(InputWarning) as caught:
        load_policy(tmp_path, ID, make_task(ID, {"q": 2.0}).system)
    (notice,) = caught
    parameters = "parameters that differ: horizon=50 (training: 7), q=2.0 (training: 100.0)"
    assert str(notice.message) == f"policy {str(tmp_path)!r} was trained in {ID}; {parameters}"


def test_the_parameters_of_the_training_itself_need_no_warning(unbroken: dict[str, Path]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_policy(unbroken["ppo"], ID, SYSTEM)


def test_an_id_that_is_not_registered_here_is_still_named(unbroken: dict[str, Path], tmp_path: Path) -> None:
    folder = shutil.copytree(unbroken["ppo"], tmp_path / "run")
    rewrite(folder, env="elsewhere/Radar-v3")
    with pytest.warns(InputWarning, match=r"was trained in elsewhere/Radar-v3, not in .*horizon=50 \(training: 7\)"):
        load_policy(folder, ID, make_task(ID, {}).system)


def test_rf_eo_and_rf_eo_far_take_each_others_policies_with_a_warning() -> None:
    folder = pretrained_folder(RF_EO_FAR, "ppo")
    assert folder is not None
    with pytest.warns(
        InputWarning, match=f"trained in {RF_EO_FAR}, not in {RF_EO}; .*q=0.01 .training: 1.0."
    ) as caught:
        load_policy(folder, RF_EO, make_task(RF_EO, {"prf": (2e3, 1e5)}).system)
    assert "\n" not in str(caught[0].message)


def test_a_network_with_other_forecasts_is_refused(unbroken: dict[str, Path], tmp_path: Path) -> None:
    folder = shutil.copytree(unbroken["ppo"], tmp_path / "run")
    settings = json.loads((folder / "run.json").read_text())["settings"]
    rewrite(folder, settings={**settings, "forecasts": True})
    with pytest.raises(InputError, match=r"observes 6 elements, but this .* shows 62"):
        load_policy(folder, ID, SYSTEM)


def test_another_scaling_of_the_observation_is_refused(unbroken: dict[str, Path], tmp_path: Path) -> None:
    folder = shutil.copytree(unbroken["ppo"], tmp_path / "run")
    run = json.loads((folder / "run.json").read_text())
    run["scaling"][0] = [0.0, 1.0]
    (folder / "run.json").write_text(json.dumps(run))
    with pytest.raises(InputError, match="has centre and scale"):
        load_policy(folder, ID, SYSTEM)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda folder: (folder / "policy.npz").unlink(), "policy.npz cannot be read"),
        (lambda folder: (folder / "policy.npz").write_bytes((folder / "policy.npz").read_bytes()[:-9]), "is torn"),
        (lambda folder: (folder / "run.json").unlink(), "unfinished, expected run.json"),
        (lambda folder: (folder / "run.json").write_text('{"env": '), "run.json cannot be read"),
        (lambda folder: (folder / "run.json").write_text("[]"), "holds no JSON object"),
        (lambda folder: (folder / "run.json").write_text("{}"), "'env' is missing"),
        (lambda folder: rewrite(folder, algo="sac"), "algo in .*run.json is 'sac', expected one of 'ppo', 'dqn'"),
        (lambda folder: rewrite(folder, algo=["ppo"]), r"'algo' is \['ppo'\], expected str"),
        (lambda folder: rewrite(folder, observation=[1]), r"'observation' is \[1\], expected names"),
        (lambda folder: rewrite(folder, actions={"form": "box"}), "'actions.count' is missing"),
        (lambda folder: forge(folder, b"no zip file"), "policy.npz is no policy that can be loaded"),
        (shutil.rmtree, "is not a folder"),
        (lambda folder: (shutil.rmtree(folder), folder.mkdir()), "holds no training run"),
    ],
)
def test_a_damaged_run_is_named(damage: Any, message: str, unbroken: dict[str, Path], tmp_path: Path) -> None:
    folder = shutil.copytree(unbroken["ppo"], tmp_path / "run")
    damage(folder)
    with pytest.raises(InputError, match=message) as caught:
        load_policy(folder, ID, SYSTEM)
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_policy_is_played_without_torch(unbroken: dict[str, Path]) -> None:
    code = (
        "import sys; from wavegym.policies.runs import load_policy; from wavegym.evaluation import make_task;"
        f"load_policy({str(unbroken['ppo'])!r}, {ID!r}, make_task({ID!r}, {{}}).system);"
        "print('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_a_folder_of_runs_holds_seeds_of_one_learner(unbroken: dict[str, Path], tmp_path: Path) -> None:
    first, second = (shutil.copytree(unbroken["ppo"], tmp_path / name) for name in ("seed1", "seed2"))
    with pytest.raises(InputError, match=r"runs seed1 and seed2 in .* have one seed, 1, expected two"):
        load_policy(tmp_path, ID, SYSTEM)
    rewrite(second, seed=2)
    assert len(load_policy(tmp_path, ID, SYSTEM)) == 2
    settings = json.loads((first / "run.json").read_text())["settings"]
    rewrite(second, settings={**settings, "gamma": 0.5})
    with pytest.raises(InputError, match=r"settings\.gamma is 0\.5 in seed2, but 0\.9 in seed1"):
        load_policy(tmp_path, ID, SYSTEM)
    shutil.rmtree(second)
    shutil.copytree(unbroken["dqn"], tmp_path / "seed3")
    with pytest.raises(InputError, match="algo is 'dqn' in seed3, but 'ppo' in seed1"):
        load_policy(tmp_path, ID, SYSTEM)
