from __future__ import annotations

from pathlib import Path

import pytest
from runs_for_tests import ID, SMALL, arguments, assert_same_run

import train
from wavegym.cli import train as command
from wavegym.core.files import toml_value
from wavegym.envs.scenario import scenario_toml
from wavegym.evaluation import full_id


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["KershawEvan-v0", "--algo", "ppo"], "did you mean 'wavegym/KershawEvans-v0'?"),
        (["KershawEvans-v0", "--algo", "pp"], "algorithm is 'pp', expected one of 'ppo', 'dqn'; did you mean 'ppo'?"),
        (["KershawEvans-v0", "--algo", "ppo", "--setting", "gama=0"], "did you mean 'gamma'?"),
        (["KershawEvans-v0", "--algo", "ppo", "--setting", "gamma"], "'gamma' has no value, expected NAME=VALUE"),
        (["KershawEvans-v0", "--algo", "ppo", "--setting", "reward=relativ"], "did you mean 'relative'?"),
        (["KershawEvans-v0", "--algo", "ppo", "--set", "horizn=3"], "did you mean 'horizon'?"),
        (["KershawEvans-v0", "--algo", "dqn", "--set", "action=box"], "dqn cannot choose from Box"),
        (["KershawEvans-v0", "--algo", "ppo", "--steps", "many"], "invalid int value: 'many'"),
        (["KershawEvans-v0", "--algo", "ppo", "--steps", "0"], "steps is 0"),
        (["KershawEvans-v0", "--algo", "ppo", "--seed", "-1"], "seed is -1, expected an integer in [0, 4294967295]"),
        (["KershawEvans-v0", "--algo", "ppo", "--checkpoint-every", "0"], "checkpoint-every is 0"),
        (["KershawEvans-v0", "--algo", "ppo", "--resum"], "did you mean '--resume'?"),
        (["KershawEvans-v0", "--algo", "ppo", "--resume"], "holds no run to resume"),
        (["KershawEvans-v0"], "--algo"),
        (["KershawEvans-v0", "--algo", "ppo", "--setting", "batch_size=1"], "batch_size is 1"),
        (["Urban-v0", "--algo", "ppo", "--setting", "n_steps=1", "num_envs=1"], "n_steps times num_envs is 1"),
        (["KershawEvans-v0", "--algo", "ppo", "--set", "num_envs=3"], "expected --setting num_envs="),
        (["KershawEvans-v0", "--algo", "ppo", "--set", "autoreset_mode=NextStep"], "training needs SameStep"),
        (["KershawEvans-v0", "--algo", "ppo", "--settings", "no/such.toml"], "settings 'no/such.toml' cannot be read"),
        (["KershawEvans-v0", "--algo", "ppo", "--environment", "horizon=3"], "--environment: expected --set"),
        (["KershawEvans-v0", "--algo", "ppo", "--set", "gamma=0"], "--set gamma: expected --setting gamma=VALUE"),
        (["KershawEvans-v0", "--algo", "ppo", "--setting", "q=2"], "--setting q: expected --set q=VALUE"),
        (["no/such.toml", "--algo", "ppo"], "scenario 'no/such.toml' cannot be read"),
    ],
)
def test_a_mistake_is_one_line_and_leaves_nothing(
    given: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert train.main([*given, "--out", str(tmp_path / "run")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert message in line
    assert not (tmp_path / "run").exists()


def test_settings_of_a_file_stand_for_those_of_the_command_line(
    unbroken: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, (env, *given) = tmp_path / "best.toml", arguments("ppo", tmp_path / "run")
    at, end = given.index("--setting"), given.index("--set")
    lines = [f"{name} = {toml_value(value)}" for name, value in SMALL["ppo"].items()]
    file.write_text("\n".join([f'["{ID}".ppo]', *lines, "gamma = 0.5"]))
    settings = ["--settings", str(file), "--setting", "gamma=0.9"]  # --setting has the last word
    assert train.main([env, *given[:at], *settings, *given[end:]]) == 0
    assert_same_run(tmp_path / "run", unbroken["ppo"])
    other = [env, "--algo", "dqn", "--settings", str(file), "--out", str(tmp_path / "other")]
    assert train.main(other) == 2
    assert f'has no table, expected ["{ID}".dqn]' in capsys.readouterr().err
    assert not (tmp_path / "other").exists()


def test_a_folder_that_holds_a_run_is_not_touched(
    unbroken: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    folder = unbroken["ppo"]
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    assert train.main(arguments("ppo", folder)) == 2
    assert "already holds a run (training.json), expected a new folder or --resume" in capsys.readouterr().err
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before


def test_an_output_that_cannot_be_a_folder_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "file"
    file.write_text("not a folder")
    for out in (file, file / "run"):
        assert train.main(arguments("ppo", out)) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert str(file) in line
    assert file.read_text() == "not a folder"


def test_the_command_trains_what_the_function_trains(
    unbroken: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = arguments("dqn", tmp_path / "run")
    assert full_id("KershawEvansPosition-v0") == given[0]
    assert train.main(["KershawEvansPosition-v0", *given[1:]]) == 0
    assert_same_run(tmp_path / "run", unbroken["dqn"])
    assert str(tmp_path / "run") in capsys.readouterr().out


def test_a_scenario_changes_the_environment_and_keeps_the_recipe(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(scenario_toml("wavegym/KershawEvansPosition-v0", horizon=9, truth={"q": 4.0}))
    name = "wavegym/KershawEvansPosition-v0"
    options = command.parser().read([str(file), "--algo", "ppo", "--out", "x", "--set", "dt=0.5"])
    assert command._task(options) == (name, {"horizon": 9, "truth": {"q": 4.0}, "dt": 0.5}, {})
    file.write_text(scenario_toml(name, reward="log-cost", forecasts=True))
    options = command.parser().read([str(file), "--algo", "ppo", "--out", "x", "--setting", "forecasts=False"])
    assert command._task(options) == (name, {}, {"reward": "log-cost", "forecasts": False})


@pytest.mark.slow
def test_a_run_of_a_scenario_is_the_run_of_its_parameters(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('id = "wavegym/KershawEvansPosition-v0"\nhorizon = 5\n')
    rest = ["--algo", "ppo", "--steps", "64", "--setting", "num_envs=8", "n_steps=8", "batch_size=16", "--quiet"]
    assert train.main([str(file), *rest, "--out", str(tmp_path / "a")]) == 0
    words = ["--set", "horizon=5", "--out", str(tmp_path / "b")]
    assert train.main(["KershawEvansPosition-v0", *rest, *words]) == 0
    assert_same_run(tmp_path / "a", tmp_path / "b")
