"""Submissions: what is played is what `compare` plays, bad files are one line, and nothing is played twice.

Lower bounds: the optimum's are below every scheduler in each world, those of a lifted limit below on average.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wavegym.cli.main import main
from wavegym.core.errors import InputError
from wavegym.evaluation import compare, submission
from wavegym.evaluation.submission import BOUNDS, lower_bound, play_submission, read_record, read_submission, suite
from wavegym.policies.onnx_files import export_onnx
from wavegym.policies.runs import PRETRAINED

ID = "wavegym/KershawEvansPosition-v0"
FILE = """
name = "mine"
code = "somewhere, version 1"
[policies.KershawEvansPosition-v0]
file = "position.onnx"
steps = 640_000
cpu_seconds = 900.0
[policies.AgileClutter-v0]
file = "agile"
steps = 1000
parameters = { action = "joint" }
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    own = tmp_path / "submission"
    own.mkdir()
    export_onnx(PRETRAINED / "KershawEvansPosition" / "ppo", own / "position.onnx")
    shutil.copytree(PRETRAINED / "AgileClutter" / "dqn", own / "agile")
    (own / "submission.toml").write_text(FILE)
    return own


@pytest.mark.slow
def test_a_submission_is_played_as_compare_plays_it(folder: Path, tmp_path: Path) -> None:
    played = list(play_submission(read_submission(folder), tmp_path, seed=7, worlds=6, jobs=1, progress=False))
    assert played == [ID, "wavegym/AgileClutter-v0"]
    record = read_record(tmp_path / "mine.json")
    assert (record["seed"], record["worlds"], record["code"]) == (7, 6, "somewhere, version 1")
    common: dict[str, Any] = {"worlds": 6, "seed": 7, "jobs": 1, "progress": False}
    for env_id, own, parameters in (
        (ID, folder / "position.onnx", {}),
        ("wavegym/AgileClutter-v0", folder / "agile", {"action": "joint"}),
    ):
        mine = compare(env_id, {"mine": own}, **common, **parameters)
        simple = compare(env_id, {"best-simple": None}, **common)
        found = record["environments"][env_id]
        np.testing.assert_allclose(found["cost"], mine.cost("mine")[0], rtol=1e-5)
        np.testing.assert_allclose(found["simple_cost"], simple.cost("best-simple")[0], rtol=1e-5)
        np.testing.assert_allclose(found["error"], mine.results("mine").squared_error[0], rtol=1e-5)
        np.testing.assert_allclose(found["simple_error"], simple.results("best-simple").squared_error[0], rtol=1e-5)
    optimum = compare(ID, {"optimum": None}, **common).cost("optimum")[0]
    np.testing.assert_allclose(record["environments"][ID]["bound"], optimum, rtol=1e-5)
    assert "bound" not in record["environments"]["wavegym/AgileClutter-v0"]
    assert record["environments"][ID]["cpu_seconds"] == 900.0
    assert record["environments"]["wavegym/AgileClutter-v0"]["cpu_seconds"] is None
    ratio = np.log(np.divide(*(record["environments"][ID][name] for name in ("cost", "simple_cost")))).mean()
    line = next(line for line in submission.table(record).splitlines() if "KershawEvansPosition" in line)
    assert float(line.split("|")[2]) == pytest.approx(100.0 * np.expm1(ratio), abs=0.06)


@pytest.mark.slow
def test_what_was_played_is_kept_until_policy_or_worlds_change(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    played: list[str] = []

    def counted(env_id: str, *rest: Any) -> dict[str, Any]:
        played.append(env_id)
        figures = {name: [1.0, 2.0] for name in ("cost", "simple_cost", "error", "simple_error")}
        return {**figures, "microseconds": 1.0}

    monkeypatch.setattr(submission, "_play", counted)

    def play(seed: int = 7) -> int:
        before = len(played)
        for _ in play_submission(read_submission(folder), tmp_path, seed=seed, worlds=2):
            assert read_record(tmp_path / "mine.json")["seed"] == seed
        return len(played) - before

    assert [play(), play()] == [2, 0]
    (folder / "submission.toml").write_text(FILE.replace("1000", "2000"))
    assert play() == 0, "another declaration"
    assert read_record(tmp_path / "mine.json")["environments"]["wavegym/AgileClutter-v0"]["steps"] == 2000
    run = folder / "agile" / "run.json"
    run.write_text(run.read_text() + "\n")
    assert play() == 1, "another policy"
    assert play(8) == 2, "other worlds"
    (folder / "submission.toml").write_text(FILE.split("[policies.Agile")[0])
    assert play(8) == 0
    assert list(read_record(tmp_path / "mine.json")["environments"]) == [ID]


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('"mine"', '"my policy"', "name is 'my policy', expected letters, digits"),
        ("KershawEvansPosition-v0", "KershawEvanPosition-v0", "did you mean .wavegym/KershawEvansPosition-v0"),
        ("KershawEvansPosition-v0", "UrbanSignal-v0", "environment is 'wavegym/UrbanSignal-v0', expected one of"),
        ('action = "joint"', "clutter_density = 0.0", "parameter of AgileClutter-v0 is 'clutter_density', expected"),
        ("position.onnx", "none.onnx", "file of KershawEvansPosition-v0 is 'none.onnx', expected an .onnx file or a"),
        ("position.onnx", "model.zip", "is 'model.zip', expected an .onnx file or a run's folder"),
        ("steps = 1000", "steps = -1", "greater than or equal to 0"),
        ("steps = 1000", "", "Field required"),
        ('code = "somewhere, version 1"', "", "Field required"),
        ("cpu_seconds", "seconds", "seconds Unexpected keyword argument"),
        ("[policies.AgileClutter-v0]", "[policies.", "line 8"),
    ],
)
def test_a_bad_file_is_one_line(old: str, new: str, text: str, folder: Path) -> None:
    (folder / "model.zip").write_bytes(b"may hold code")
    (folder / "submission.toml").write_text(FILE.replace(old, new))
    with pytest.raises(InputError, match=text) as caught:
        read_submission(folder)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_the_command_plays_and_its_mistakes_are_one_line(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "submission.toml").write_text(FILE.split("[policies.Agile")[0])
    out = tmp_path / "out"
    assert main(["submit", str(folder), "--out", str(out), "--worlds", "3", "--jobs", "1"]) == 0
    assert "| KershawEvansPosition-v0 |" in capsys.readouterr().out
    assert len(json.loads((out / "mine.json").read_text())["environments"][ID]["cost"]) == 3
    for arguments, text in (
        ([str(tmp_path / "none")], "submission.toml cannot be read: No such file"),
        ([str(folder), "--worlds", "0"], "worlds is 0, expected"),
    ):
        assert main(["submit", *arguments, "--out", str(tmp_path / "other"), "--jobs", "1"]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert text in line
    (out / "mine.json").write_text("{}")
    assert main(["submit", str(folder), "--out", str(out), "--worlds", "3", "--jobs", "1"]) == 2
    assert "mine.json is no record of a submission" in capsys.readouterr().err


def test_the_board_has_every_environment_with_a_rule_on_record() -> None:
    assert ID in suite()
    assert "wavegym/MultifunctionRadar-v1" in suite()
    assert "wavegym/UrbanSignal-v0" not in suite()


@pytest.mark.slow
@pytest.mark.parametrize("env_id", ["wavegym/KershawEvans-v0", "wavegym/KershawEvansPosition-v0"])
def test_no_scheduler_is_below_the_optimum_in_any_world(env_id: str) -> None:
    bound = lower_bound(env_id, seed=3, worlds=10, jobs=1, progress=False)
    played = compare(env_id, dict.fromkeys(("best-simple", "lookahead:2")), worlds=10, seed=3, jobs=1, progress=False)
    assert bound is not None
    for name in played.played:
        assert np.all(bound <= played.cost(name)[0] * (1.0 + 1e-3)), "certified to a thousandth"


@pytest.mark.slow
@pytest.mark.parametrize("env_id", ["wavegym/EnergyBudget-v0", "wavegym/EnergyBudgetKnown-v0"])
def test_free_energy_is_a_bound_on_average_and_its_choice_the_best(env_id: str) -> None:
    common = {"worlds": 40, "seed": 3, "jobs": 1, "progress": False}
    bound = lower_bound(env_id, **common)  # type: ignore[arg-type]
    simple = compare(env_id, {"best-simple": None}, **common).cost("best-simple")[0]  # type: ignore[arg-type]
    assert bound is not None
    gain = np.log(simple / bound)
    assert gain.mean() > 2.0 * gain.std() / np.sqrt(len(gain))
    policy, lifted = BOUNDS[env_id]
    others = dict.fromkeys(f"fixed:{index}" for index in range(10))
    free = compare(env_id, others, **common, **lifted)  # type: ignore[arg-type]
    costs = {name: np.log(free.cost(name)).mean() for name in others}
    assert min(costs, key=lambda name: costs[name]) == policy


def test_most_environments_have_no_bound() -> None:
    assert lower_bound("wavegym/CameraSlew-v0", seed=0, worlds=2, jobs=1, progress=False) is None
