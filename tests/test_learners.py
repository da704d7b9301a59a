"""Training with other libraries: every example trains and plays, and every block of the page runs.

TorchRL, skrl and RL Zoo are not among the packages of the tests: ``make test-learners`` has them.
"""

from __future__ import annotations

import importlib
import re
import shlex
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO
from test_docs_how_to import BLOCK, DOCS

from wavegym.learning.settings import load_settings
from wavegym.registration import NAMESPACE, SYSTEMS

ROOT = Path(__file__).parents[1]
PAGE = (DOCS / "how_to" / "train_with_other_libraries.md").read_text(encoding="utf-8")
APART = ("torchrl", "skrl", "rl_zoo3")
FOLDER = ROOT / "examples" / "learners"
NEEDS = {  # example: the packages that it imports
    "sb3_plain": ["stable_baselines3"],
    "sb3_normalised": ["stable_baselines3"],
    "sb3_native": ["stable_baselines3"],
    "recurrent_ppo": ["sb3_contrib"],
    "cleanrl_ppo": ["torch"],
    "torchrl_ppo": ["torchrl"],
    "skrl_ppo": ["skrl"],
    "rl_zoo": ["rl_zoo3"],
}
PLAYED_WITH = {"recurrent_ppo": {"observation": "measurements"}}
STEPS = {"sb3_plain": 512, "sb3_normalised": 512, "torchrl_ppo": 512, "rl_zoo": 3200}  # others: one rollout of 3200


def installed(package):
    """Skip the test where a library is missing."""
    pytest.importorskip(package, reason=f"{package} is not installed: make test-learners has it")


@pytest.fixture(autouse=True)
def _beside(monkeypatch):
    """As with ``python examples/learners/NAME.py``: the examples' folder is on the path."""
    monkeypatch.syspath_prepend(str(FOLDER))
    yield
    for name in (*NEEDS, "against_myopic"):
        sys.modules.pop(name, None)


def test_no_example_is_left_out():
    assert {path.stem for path in FOLDER.glob("*.py")} == {*NEEDS, "against_myopic"}


@pytest.mark.slow
@pytest.mark.parametrize("name", NEEDS)
def test_an_example_trains_and_is_compared_with_myopic(name):
    for package in NEEDS[name]:
        installed(package)
    from against_myopic import DEFAULT, percent_over_myopic

    policy = importlib.import_module(name).train(DEFAULT, STEPS.get(name, 3200), 0)
    assert np.isfinite(percent_over_myopic(DEFAULT, policy, worlds=3, **PLAYED_WITH.get(name, {})))


@pytest.mark.slow
def test_the_blocks_of_the_page_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    namespace: dict = {}
    for block in BLOCK.findall(PAGE):
        if not any(package in block for package in APART):
            exec(compile(block, "page", "exec"), namespace)
    assert "geometric" in capsys.readouterr().out
    assert (tmp_path / "out" / "mine" / "report.html").exists()
    assert namespace["ended"]
    assert namespace["actions"].shape == (64,)


@pytest.mark.parametrize("package", ["torchrl", "skrl"])
def test_a_library_s_block_of_the_page_runs(package, capsys):
    installed(package)
    (block,) = (block for block in BLOCK.findall(PAGE) if package in block)
    exec(compile(block, "page", "exec"), {})
    assert capsys.readouterr().out


@pytest.mark.slow
def test_the_command_of_the_page_runs_rl_zoo(tmp_path):
    installed("rl_zoo3")
    (command,) = re.findall(r"^```sh\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
    _, *options = shlex.split(command.replace("\\\n", " "))
    short = ["--n-timesteps", "64", "--eval-freq", "-1", "--log-folder", str(tmp_path)]
    subprocess.run([sys.executable, *options, *short], check=True, cwd=ROOT)
    assert list(tmp_path.rglob("*KershawEvansPosition-v0.zip"))


def test_the_settings_on_the_page_are_those_of_the_recipes():
    table = PAGE.partition("\n## Reward and normalisation for each environment\n")[2]
    rows = [re.findall(r"[^|` ]+", line) for line in table.splitlines() if re.match(r"\| `\w+-v\d+`", line)]
    common = load_settings("mine/NotInTheFile-v0", "ppo")
    assert [NAMESPACE + row[0] for row in rows] == [id for id in SYSTEMS if load_settings(id, "ppo") != common]
    for name, reward, forecasts, gamma, teacher, masks, normalisation in rows:
        settings = load_settings(NAMESPACE + name, "ppo")
        assert (reward, float(gamma), normalisation) == (settings.reward, settings.gamma, "none")
        assert (forecasts, masks) == tuple("yes" if is_on else "no" for is_on in (settings.forecasts, settings.masks))
        assert teacher == (settings.teacher or "no")


def test_stable_baselines_refuses_what_make_vec_returns():
    """As the page says; the adapter is there for that."""
    with pytest.raises((AssertionError, TypeError, AttributeError, ValueError)):
        PPO("MlpPolicy", gym.make_vec("wavegym/KershawEvansPosition-v0", num_envs=4))
