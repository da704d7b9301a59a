"""The range of an agent's observations in its training, and warnings outside it."""

from __future__ import annotations

import json
import shutil
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from runs_for_tests import ENVIRONMENT, EVERY, ID, small_spec

from wavegym.core.errors import InputError, InputWarning
from wavegym.core.policy import Trained
from wavegym.evaluation import compare, make_task
from wavegym.evaluation.play import play
from wavegym.learning.train import train
from wavegym.policies.networks import LearnedPolicy
from wavegym.policies.pretrained import FOLDER
from wavegym.policies.runs import load_policy
from wavegym.policies.training_range import KEY, MARGIN, TrainingRange
from wavegym.schedulers import Myopic

AGENTS = sorted(str(file.parent.relative_to(FOLDER)) for file in FOLDER.glob("*/*/run.json"))
OBSERVATIONS = arrays(np.float32, (6, 2 + 3 * 4), elements=st.floats(-10.0, 10.0, width=32))


@given(OBSERVATIONS)
def test_what_was_seen_is_inside_and_what_is_far_outside_is_not(shown: np.ndarray) -> None:
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
    """All of it and no more than an independent play finds; of all variants, where there are several."""
    found = {name: _range(unbroken[name]) for name in ("ppo", "dqn")}
    (policy,) = load_policy(unbroken["ppo"], ID, make_task(ID, {"horizon": ENVIRONMENT["horizon"]}).system)
    assert isinstance(policy, Trained)
    seen = _observed(policy, {"horizon": ENVIRONMENT["horizon"]})
    width = found["ppo"].high - found["ppo"].low
    assert (np.abs(seen.min(axis=0) - found["ppo"].low) <= 0.3 * width + 1e-3).all()
    assert (np.abs(seen.max(axis=0) - found["ppo"].high) <= 0.3 * width + 1e-3).all()
    spec = small_spec("ppo", variants=[{"start_range": (50e3, 60e3)}, {"start_range": (170e3, 210e3)}, {}])
    train(spec, tmp_path / "run", EVERY["ppo"], progress=False)
    both = _range(tmp_path / "run")
    assert (both.high - both.low)[0] > 5.0 * width[0], "the SNR of near targets is higher"


def _range(folder: Path) -> TrainingRange:
    return TrainingRange.from_record(json.loads((folder / "run.json").read_text())[KEY])


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
def test_every_packaged_agent_has_a_range_that_its_test_worlds_keep(name: str) -> None:
    """In all but a tenth of the decisions: then nobody is warned."""
    run = json.loads((FOLDER / name / "run.json").read_text())
    environment = {**run["settings"]["environment"]}
    task = make_task(run["env"], environment)
    (policy,) = load_policy(FOLDER / name, run["env"], task.system)
    played = play(task, policy, list(range(50, 66)), max_steps=300)
    assert played.outside.mean() < 0.1


def test_compare_warns_of_an_agent_in_worlds_unlike_its_training() -> None:
    with pytest.warns(InputWarning) as caught:
        compared = compare(ID, {"ppo": None}, worlds=20, jobs=1, progress=False, start_range=(900e3, 950e3))
    (text,) = (str(warning.message) for warning in caught if "observations" in str(warning.message))
    assert text == "policy 'ppo' takes 100% of its decisions on observations outside the range of its training"
    assert compared.account("ppo").outside.mean() > 0.99
    assert np.isnan(compared.account("myopic").outside).all(), "a scheduler has no training"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        compared = compare(ID, {"ppo": None}, worlds=20, jobs=1, progress=False)
    assert (compared.account("ppo").outside < 0.1).all()


def test_runs_without_a_record_play_and_a_broken_one_is_one_line(unbroken: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(unbroken["ppo"], tmp_path / "run"))
    task, run = make_task(ID, {"horizon": ENVIRONMENT["horizon"]}), json.loads((folder / "run.json").read_text())
    kept = run.pop(KEY)
    (folder / "run.json").write_text(json.dumps(run))
    (policy,) = load_policy(folder, ID, task.system)
    assert np.isnan(play(task, policy, [1, 2]).outside).all()
    assert np.isnan(play(task, Myopic(), [1, 2]).outside).all()
    for broken in (3, {}, {**kept, "low": kept["low"][1:]}, {**kept, "own": 2}, {**kept, "high": ["x"] * 6}):
        (folder / "run.json").write_text(json.dumps({**run, KEY: broken}))
        with pytest.raises(
            InputError, match=r"'observed' is no range, expected own = \d+ and low and high of \d+ numbers"
        ):
            load_policy(folder, ID, task.system)
