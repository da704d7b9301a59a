from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import mistakes
import numpy as np
import pytest

import evaluate
from wavegym.evaluation import adapters
from wavegym.schedulers import Fixed

ROOT = Path(evaluate.__file__).parent
QUICK = ["--worlds", "3", "--jobs", "1", "--set", "horizon=4"]


def run(out, *arguments):
    return evaluate.main([arguments[0], "--out", str(out), *QUICK, *arguments[1:]])


def policies(out):
    return json.loads((out / "summary.json").read_text())["policies"]


def test_help_says_where_the_policies_are_listed(capsys):
    with pytest.raises(SystemExit):
        evaluate.main(["--help"])
    assert "wavegym policies ENV" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("env_id", ["KershawEvansPosition-v0", "wavegym/KershawEvansPosition-v0"])
@pytest.mark.slow
def test_a_comparison_is_written_and_its_table_printed(tmp_path, capsys, env_id):
    assert run(tmp_path, env_id, "--policies", "random, fixed:3,lookahead:2", "--seed", "9") == 0
    assert list(policies(tmp_path)) == ["myopic", "random", "fixed:3", "lookahead:2"]
    assert (tmp_path / "table.md").read_text() in capsys.readouterr().out
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["env"], summary["seed"]) == ("wavegym/KershawEvansPosition-v0", 9)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["KershawEvansPosition-v1"], "did you mean 'wavegym/KershawEvansPosition-v0'"),
        (["KershawEvans-v0", "--policies", "myopik"], "did you mean 'myopic'"),
        (["KershawEvans-v0", "--policies", "priced"], "policy is 'priced', which is called 'lagrangian-price' now"),
        (
            ["KershawEvans-v0", "--policies", "rollout:2@paced"],
            "policy is 'paced', which is called 'constant-pace' now",
        ),
        (["KershawEvans-v0", "--policies", "m.zip"], "loading it runs code of the file, expected --trust"),
        (["KershawEvans-v0", "--import", "no_such_one"], "package is 'no_such_one', expected an importable one"),
        (["KershawEvans-v0", "--set", "trust=True"], "expected --trust"),
        (["KershawEvans-v0", "--policies", "fixed:two"], "nearest: 'fixed:2'"),
        (["KershawEvans-v0", "--policies", ","], "expected at least one name"),
        (["KershawEvans-v0", "--policies", "no/such/run"], "no/such/run"),
        (["KershawEvans-v0", "--polices", "random"], "unexpected argument '--polices'; did you mean '--policies'"),
        (["KershawEvans-v0", "--worlds", "many"], "invalid int value: 'many'"),
        (["KershawEvans-v0", "--worlds", "0"], "worlds is 0"),
        (["KershawEvans-v0", "--jobs", "-3"], "jobs is -3"),
        (["KershawEvans-v0", "--root", "1"], "error: --root: expected --seed"),
        (["KershawEvans-v0", "--set", "horizont=5"], "did you mean 'horizon'"),
        (["KershawEvans-v0", "--set", "horizon"], "expected NAME=VALUE"),
        (["KershawEvans-v0", "--set", "q=-1"], "q is -1"),
        (["KershawEvans-v0", "--set", "weights=1e400,1"], "weights"),
        (["tests/Hopeless-v0", "--set", "price=1e400"], "not finite in 3 of 3 worlds"),
        (["KershawEvans-v0", "--set", "worlds=3"], "expected --worlds N"),
        (
            ["KershawEvans-v0", "--set", "reward=trace"],
            "reward is no parameter of KershawEvans, expected it in gym.make only",
        ),
        (["KershawEvans-v0", "--radar", "51.0"], "--radar has 1 numbers, expected LAT LON"),
        (["KershawEvans-v0", "--tracks", "no_such_file.csv"], "no_such_file.csv"),
        (["Urban-v0", "--tracks", "f.csv"], "wavegym/Urban-v0 takes no recorded targets (nearest: Kershaw"),
    ],
)
def test_mistakes_cost_one_line_and_no_earlier_result(tmp_path, capsys, arguments, words):
    mistakes.costs_one_line_and_no_earlier_result(lambda: run(tmp_path, *arguments), tmp_path, capsys, words)


def test_a_folder_that_cannot_be_made_is_a_mistake_too(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert run(tmp_path / "file" / "out", "KershawEvans-v0") == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.slow
def test_as_a_program_it_exits_with_2_and_no_traceback():
    command = [sys.executable, "evaluate.py", "KershawEvans-v7", "--out", "nowhere"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert not (ROOT / "nowhere").exists()


def test_recorded_tracks_are_played(tmp_path):
    times = np.arange(0.0, 60.0, 2.0)
    lines = [f"{t},a,{20e3 + 150 * t},{5e3 - 20 * t},3000" for t in times]
    tracks = tmp_path / "tracks.csv"
    tracks.write_text("\n".join(["time_s,id,x_m,y_m,z_m", *lines]))
    out = tmp_path / "out"
    assert run(out, "KershawEvans-v0", "--policies", "random", "--tracks", str(tracks), "--radar", "100", "50") == 0
    parameters = json.loads((out / "summary.json").read_text())["parameters"]
    assert parameters == {"horizon": 4, "targets": "recorded", "tracks": str(tracks), "radar": [100.0, 50.0, 0.0]}


@pytest.fixture
def trained(monkeypatch):
    """Replaces the loading of trained networks: a folder's name gives the waveform."""
    calls = []

    def load_policy(folder, env_id, system):
        calls.append((folder, env_id, type(system).__name__))
        return [Fixed(int(number)) for number in folder.name.split("-")[1:]]

    monkeypatch.setattr(adapters, "load_policy", load_policy)
    return calls


def test_folders_are_trained_runs(tmp_path, monkeypatch, trained):
    (tmp_path / "runs" / "ppo-0-1-2").mkdir(parents=True)
    (tmp_path / "dqn-3").mkdir()
    (tmp_path / "random").mkdir()  # a scheduler's name stays a scheduler's
    monkeypatch.chdir(tmp_path)
    out = tmp_path / "out"
    assert run(out, "KershawEvansPosition-v0", "--policies", "runs/ppo-0-1-2/,dqn-3,random") == 0
    assert list(policies(out)) == ["myopic", "ppo-0-1-2", "dqn-3", "random"]
    assert {call[1:] for call in trained} == {("wavegym/KershawEvansPosition-v0", "KershawEvansPosition")}
    rows = [line.split(",") for line in (out / "episodes.csv").read_text().splitlines()]
    assert [row[1] for row in rows if row[0] == "ppo-0-1-2"] == ["0"] * 3 + ["1"] * 3 + ["2"] * 3


def test_two_runs_of_one_name_are_refused(tmp_path, capsys, trained):
    assert run(tmp_path, "KershawEvans-v0", "--policies", "a/ppo-1,b/ppo-1") == 2
    assert "two policies are called 'ppo-1'" in capsys.readouterr().err


def test_a_planner_follows_a_folder(tmp_path, trained):
    (tmp_path / "ppo-3-4").mkdir()
    name = f"rollout:2@{tmp_path / 'ppo-3-4'}"
    assert run(tmp_path / "out", "KershawEvansPosition-v0", "--policies", f"{name},fixed:3") == 0
    assert list(policies(tmp_path / "out")) == ["myopic", name, "fixed:3"]
    assert {call[0].name for call in trained} == {"ppo-3-4"}


def test_code_needs_trust(tmp_path, monkeypatch, capsys):
    (tmp_path / "their_code.py").write_text("from wavegym.schedulers import Fixed\nmake = lambda system: Fixed(3)\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    given = ["KershawEvansPosition-v0", "--policies", "their_code:make,fixed:3"]
    assert run(tmp_path / "out", *given) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: policy is 'their_code:make'; loading it runs code of the module their_code")
    assert "their_code" not in sys.modules
    assert run(tmp_path / "out", *given, "--trust") == 0
    played = policies(tmp_path / "out")
    assert played["their_code:make"]["cost"] == played["fixed:3"]["cost"]
    sys.modules.pop("their_code")


def test_an_archive_is_called_by_its_stem(tmp_path, capsys):
    given = ["KershawEvansPosition-v0", "--policies", "runs/mine.zip,mine.zip"]
    assert run(tmp_path, *given, "--trust") == 2
    assert "two policies are called 'mine'" in capsys.readouterr().err
