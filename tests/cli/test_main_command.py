from __future__ import annotations

import json
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import onnx
import pytest
from PIL import Image

import wavegym
from wavegym.cli.main import COMMANDS, main
from wavegym.core import VERSION
from wavegym.core.command_line import guarded
from wavegym.evaluation import make_task, world_seeds
from wavegym.evaluation.play import play
from wavegym.policies.runs import PRETRAINED
from wavegym.schedulers import Fixed

SHORT = ["--set", "horizon=4"]


def test_list_prints_every_id_without_numba_or_torch():
    code = (
        "import sys; from wavegym.cli.main import main; main(['list']);"
        "print([name for name in ('numba', 'torch', 'scipy', 'matplotlib') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    *ids, heavy = done.stdout.splitlines()
    assert ids == [id for id in wavegym.list_envs() if id.startswith("wavegym/")]
    assert heavy == "[]"


def test_the_package_is_the_command():
    done = subprocess.run([sys.executable, "-m", "wavegym", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == VERSION


def test_the_help_lists_every_subcommand(capsys):
    assert main([]) == 0
    printed = capsys.readouterr().out
    with pytest.raises(SystemExit) as end:
        main(["--help"])
    assert end.value.code == 0
    assert capsys.readouterr().out == printed
    for name, command in COMMANDS.items():
        assert name in printed
        assert command.summary in printed


@pytest.mark.parametrize("name", COMMANDS)
def test_each_subcommand_has_a_help(name, capsys):
    with pytest.raises(SystemExit) as end:
        main([name, "--help"])
    assert end.value.code == 0
    assert capsys.readouterr().out.startswith(f"usage: wavegym {name} ")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["evalute"], "did you mean 'evaluate'?"),
        (["--hepl"], "did you mean '--help'?"),
        (["list", "KershawEvans-v0"], "unexpected argument 'KershawEvans-v0'"),
        (["describe"], "ENV"),
        (["describe", "KershawEvan-v0"], "did you mean 'wavegym/KershawEvans-v0'?"),
        (["describe", "mine/Ship-v0"], "expected PACKAGE:mine/Ship-v0, with the package that registers it"),
        (["describe", "KershawEvans-v0", "--set", "horizont=4"], "did you mean 'horizon'?"),
        (["check", "KershawEvans-v0", "--set", "horizon"], "expected NAME=VALUE"),
        (["play", "KershawEvans-v0", "--policy", "myopik"], "did you mean 'myopic'?"),
        (["play", "KershawEvans-v0", "--policy", "myopic,random"], "expected one name (nearest: 'myopic')"),
        (["play", "KershawEvans-v0", "--seed", "-1"], "seed is -1"),
        (["play", "UrbanSignal-v0", "--policy", "ppo"], "nearest: wavegym train UrbanSignal-v0 --algo ppo"),
        (["train", "KershawEvans-v0", "--algo", "pp", "--out", "nowhere"], "did you mean 'ppo'?"),
        (["evaluate", "KershawEvans-v0", "--polices", "random", "--out", "nowhere"], "did you mean '--policies'"),
        (["export", "no/such", "--onnx", "nowhere"], "no/such"),
        (["export", "Urban-v0/po", "--onnx", "nowhere"], "expected the folder of a run, or ENV/ALGO"),
        (["export", "Urban-v0/ppo"], "--onnx"),
    ],
)
def test_a_mistake_is_one_line(arguments, words, capsys):
    assert main(arguments) == 2
    output = capsys.readouterr()
    assert output.out == ""
    (line,) = output.err.splitlines()
    assert line.startswith("error: ")
    assert words in line
    assert not Path("nowhere").exists()


def test_describe_prints_the_page_with_the_parameters_given(capsys):
    assert main(["describe", "KershawEvans-v0", *SHORT]) == 0
    assert capsys.readouterr().out.strip() == wavegym.describe("wavegym/KershawEvans-v0", horizon=4).strip()


@pytest.mark.slow
def test_describe_writes_a_scenario_that_every_subcommand_takes(tmp_path, capsys):
    file = tmp_path / "mine.toml"
    assert main(["describe", "KershawEvans-v0", "--toml", *SHORT]) == 0
    file.write_text(capsys.readouterr().out)
    assert main(["describe", str(file), "--toml"]) == 0
    assert capsys.readouterr().out == file.read_text()
    assert main(["play", str(file), "--policy", "fixed:3", "--seed", "7"]) == 0
    assert main(["play", "KershawEvans-v0", "--policy", "fixed:3", "--seed", "7", *SHORT]) == 0
    by_file, by_words = capsys.readouterr().out.splitlines()
    assert by_file == by_words
    out = tmp_path / "out"
    assert main(["evaluate", str(file), "--policies", "random", "--worlds", "2", "--out", str(out), "--jobs", "1"]) == 0
    assert json.loads((out / "summary.json").read_text())["parameters"] == {"horizon": 4}
    assert main(["check", str(file)]) == 0


def test_a_scenario_without_an_id_needs_one(tmp_path, capsys):
    file = tmp_path / "mine.toml"
    file.write_text("horizon = 4\n")
    assert main(["play", str(file)]) == 2
    assert "names no id, expected id = " in capsys.readouterr().err
    assert main(["play", "KershawEvans-v0", "--set", f"scenario={file}"]) == 0
    assert "over 4 steps" in capsys.readouterr().out


@pytest.mark.slow
def test_check_says_that_an_environment_passed(capsys):
    assert main(["check", "KershawEvans-v0", *SHORT]) == 0
    assert capsys.readouterr().out == "wavegym/KershawEvans-v0 passed all checks\n"


def test_check_fails_with_the_first_defect(monkeypatch, capsys):
    from wavegym.testing import ConformanceError

    def fail(*_, **__):
        raise ConformanceError("step 3: another reward")

    monkeypatch.setattr("wavegym.testing.check_vector_env", fail)
    assert main(["check", "KershawEvans-v0"]) == 1
    assert capsys.readouterr().err == "error: ConformanceError: step 3: another reward\n"


def test_play_prints_the_cost_of_the_episode(capsys):
    assert main(["play", "KershawEvans-v0", "--policy", "fixed:3", "--seed", "7", *SHORT]) == 0
    cost = play(make_task("KershawEvans-v0", {"horizon": 4}), Fixed(3), [7]).episode_cost()[0]
    expected = f"wavegym/KershawEvans-v0 seed 7, fixed:3: mean cost {cost:.6g} over 4 steps\n"
    assert capsys.readouterr().out == expected


@pytest.mark.slow
def test_play_writes_a_frame_before_and_after_each_step(tmp_path, capsys):
    file = tmp_path / "new" / "episode.gif"
    assert main(["play", "KershawEvans-v0", "--policy", "random", "--gif", str(file), *SHORT]) == 0
    with Image.open(file) as film:
        assert film.n_frames == 5
    assert f"written to {file}" in capsys.readouterr().out


def test_a_policy_trained_elsewhere_is_played_with_a_line_of_warning(capsys):
    folder = PRETRAINED / "RfEoFar" / "ppo"
    assert main(["play", "RfEo-v0", "--policy", str(folder), "--set", "horizon=3", "--set", "prf=(2e3, 1e5)"]) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning: ")]
    (line,) = lines
    assert "was trained in wavegym/RfEoFar-v0, not in wavegym/RfEo-v0; parameters that differ: horizon=3" in line


def test_export_takes_a_folder_or_an_agent_of_the_package(tmp_path, capsys):
    for n, policy in enumerate(["KershawEvans-v0/dqn", str(PRETRAINED / "KershawEvans" / "dqn")]):
        assert main(["export", policy, "--onnx", str(tmp_path / f"{n}.onnx")]) == 0
    assert (tmp_path / "0.onnx").read_bytes() == (tmp_path / "1.onnx").read_bytes()
    assert onnx.load(tmp_path / "0.onnx").producer_name == "wavegym"


def test_evaluate_falls_back_to_the_agents_of_the_package(tmp_path, monkeypatch):
    monkeypatch.setattr("wavegym.evaluation.adapters.SAVED", tmp_path / "none")
    out = tmp_path / "out"
    given = ["KershawEvansPosition-v0", "--policies", "ppo", "--worlds", "2", "--jobs", "1", *SHORT]
    assert main(["evaluate", *given, "--out", str(out)]) == 0
    rows = [line.split(",") for line in (out / "episodes.csv").read_text().splitlines()[1:]]
    assert sorted({(row[0], row[1]) for row in rows}) == [("myopic", "0"), ("ppo", "0")]
    agent = wavegym.load_agent("KershawEvansPosition-v0", "ppo", horizon=4)
    cost = play(make_task("KershawEvansPosition-v0", {"horizon": 4}), agent, world_seeds(0, "test", 2)).episode_cost()
    column = (out / "episodes.csv").read_text().splitlines()[0].split(",").index("cost")
    np.testing.assert_array_equal([float(row[column]) for row in rows if row[0] == "ppo"], cost)


def test_train_without_torch_names_the_extra(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "wavegym.learning.train", None)
    assert main(["train", "KershawEvans-v0", "--algo", "ppo", "--out", str(tmp_path / "run")]) == 2
    assert "pip install 'wavegym[agents]'" in capsys.readouterr().err


def test_other_warnings_stay_python_s_own(capsys):
    with pytest.warns(UserWarning, match="elsewhere"):
        assert guarded(lambda: warnings.warn("elsewhere", UserWarning, stacklevel=1)) == 0
    assert capsys.readouterr().err == ""
    assert guarded(lambda: warnings.warn("two\nlines", wavegym.InputWarning, stacklevel=1)) == 0
    assert capsys.readouterr().err == "warning: two lines\n"
