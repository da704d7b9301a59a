"""A run that stops anywhere and is taken up again ends as if it had never stopped."""

from __future__ import annotations

import errno
import itertools
import json
import os
import pickle
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from runs_for_tests import EVERY, arguments, assert_same_run, small_run

import train as command
from wavegym.core.errors import InputError
from wavegym.core.files import packed, unpacked
from wavegym.learning import callbacks as callback
from wavegym.learning import imitation
from wavegym.learning import train as learn
from wavegym.learning.checkpoints import load_checkpoint, save_checkpoint
from wavegym.learning.train import train


class StoppedError(Exception):
    """Stands for a kill."""


def stop_after(monkeypatch: pytest.MonkeyPatch, calls: int) -> None:
    """Stop training in the middle of the ``calls``-th step of the batch."""
    add = callback.LearningCurve.add
    left = [calls]

    def counting(self: Any, cost: Any, ended: Any) -> None:
        left[0] -= 1
        if left[0] == 0:
            raise StoppedError
        add(self, cost, ended)

    monkeypatch.setattr(callback.LearningCurve, "add", counting)


def saved_steps(folder: Path) -> int:
    saved = load_checkpoint(folder / "checkpoints")
    assert saved is not None
    return saved[0]


@pytest.mark.slow
@pytest.mark.parametrize("algo", ["ppo", "dqn"])
def test_a_run_stopped_again_and_again_ends_with_the_same_weights(
    algo: str, unbroken: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, folder, resume = small_run(algo), tmp_path / "run", False
    for calls in (1, 37, 12, 29, 3, 40):
        before = saved_steps(folder) if resume else 0
        with monkeypatch.context() as patch:
            stop_after(patch, calls)
            with pytest.raises(StoppedError):
                train(run, folder, EVERY[algo], resume, progress=False)
        lost = before + 3 * calls - saved_steps(folder)
        assert 0 <= lost <= EVERY[algo], "no more than a checkpoint interval"
        # What the interruption leaves behind must not matter.
        np.random.seed(0)  # noqa: NPY002
        resume = True
    assert not (folder / "run.json").exists()
    train(run, folder, EVERY[algo], resume=True, progress=False)
    assert_same_run(folder, unbroken[algo])


@pytest.mark.slow
def test_a_run_in_several_variants_is_resumed_in_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mixed = small_run("ppo", variants=[{"q": q} for q in (1.0, 10.0, 100.0)])
    train(mixed, tmp_path / "whole", EVERY["ppo"], progress=False)
    with monkeypatch.context() as patch:
        stop_after(patch, 50)
        with pytest.raises(StoppedError):
            train(mixed, tmp_path / "run", EVERY["ppo"], progress=False)
    train(mixed, tmp_path / "run", EVERY["ppo"], resume=True, progress=False)
    assert_same_run(tmp_path / "run", tmp_path / "whole")
    plain = small_run("ppo")
    train(plain, tmp_path / "plain", EVERY["ppo"], progress=False)
    with pytest.raises(AssertionError):
        assert_same_run(tmp_path / "plain", tmp_path / "whole")


def test_lessons_of_a_round_that_is_over_are_not_given_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    taught = small_run("ppo", teacher="myopic", teacher_episodes=6, imitation_rounds=3, imitation_epochs=2)
    train(taught, tmp_path / "whole", EVERY["ppo"], progress=False)
    demonstrations, rounds = imitation.demonstrations, list[int]()

    def counted(*arguments: Any) -> Any:
        rounds.append(1)
        if len(rounds) == 3:
            raise StoppedError
        return demonstrations(*arguments)

    monkeypatch.setattr(imitation, "demonstrations", counted)
    with pytest.raises(StoppedError):
        train(taught, tmp_path / "run", EVERY["ppo"], progress=False)
    train(taught, tmp_path / "run", EVERY["ppo"], resume=True, progress=False)
    assert len(rounds) == 4, "the third round alone"
    assert_same_run(tmp_path / "run", tmp_path / "whole")
    assert not list((tmp_path / "run").glob(".played-*"))


def test_the_time_of_a_resumed_run_is_that_of_all_its_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that runs one second from rollout to rollout, of which there are ten; the third is played twice."""
    clock = itertools.count()
    monkeypatch.setattr(callback.time, "process_time", lambda: float(next(clock)))
    run, folder = small_run("ppo"), tmp_path / "run"
    with monkeypatch.context() as patch:
        stop_after(patch, 25)
        with pytest.raises(StoppedError):
            train(run, folder, 30, progress=False)
    train(run, folder, 30, resume=True, progress=False)
    assert json.loads((folder / "run.json").read_text())["cpu_seconds"] == 3.0 + 8.0 + 1.0


@pytest.mark.slow
def test_how_often_checkpoints_are_made_changes_nothing(unbroken: dict[str, Path], tmp_path: Path) -> None:
    train(small_run("dqn"), tmp_path / "run", 1, progress=False)
    assert_same_run(tmp_path / "run", unbroken["dqn"])


@pytest.mark.parametrize("algo", ["ppo", "dqn"])
def test_another_seed_is_another_run(algo: str, unbroken: dict[str, Path], tmp_path: Path) -> None:
    train(small_run(algo, seed=2), tmp_path / "run", EVERY[algo], progress=False)
    with pytest.raises(AssertionError):
        assert_same_run(tmp_path / "run", unbroken[algo])


def test_a_finished_run_is_left_alone(unbroken: dict[str, Path], tmp_path: Path) -> None:
    folder = shutil.copytree(unbroken["ppo"], tmp_path / "run")
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    train(small_run("ppo"), folder, EVERY["ppo"], resume=True, progress=False)
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
    with pytest.raises(InputError, match=r"already holds a run \(training.json\)"):
        train(small_run("ppo"), folder, EVERY["ppo"], progress=False)


@pytest.mark.slow
@pytest.mark.parametrize("algo", ["ppo", "dqn"])
def test_a_finished_run_is_extended(
    algo: str, unbroken: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From its last checkpoint, to the same weights whether the extension is killed or not."""
    longer = small_run(algo, steps=600)
    folders = [Path(shutil.copytree(unbroken[algo], tmp_path / name)) for name in ("killed", "whole")]
    start = saved_steps(folders[0])
    for calls in (20, 60):
        with monkeypatch.context() as patch:
            stop_after(patch, calls)
            with pytest.raises(StoppedError):
                train(longer, folders[0], EVERY[algo], resume=True, progress=False)
        assert json.loads((folders[0] / "run.json").read_text())["steps"] == 300, "the shorter run until the end"
    for folder in folders:
        train(longer, folder, EVERY[algo], resume=True, progress=False)
    assert_same_run(*folders)
    run, before = (json.loads((folder / "run.json").read_text()) for folder in (folders[1], unbroken[algo]))
    assert (run["steps"], run["settings"]["steps"], run["extended_from"]) == (600, 600, [300])
    assert before["extended_from"] == []
    assert run["policy_sha256"] != before["policy_sha256"]
    rows, shorter = ((folder / "curve.csv").read_text().splitlines() for folder in (folders[1], unbroken[algo]))
    early = [row for row in shorter if not row[0].isdigit() or int(row.split(",")[0]) <= start]
    assert rows[: len(early)] == early, "what was learnt before is kept"
    assert int(rows[-1].split(",")[0]) > 300


def test_a_finished_run_without_checkpoints_is_not_extended(unbroken: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(unbroken["ppo"], tmp_path / "run", ignore=shutil.ignore_patterns("*.ckpt")))
    before = (folder / "training.json").read_text()
    with pytest.raises(InputError, match="holds no checkpoint, expected one to extend the run from"):
        train(small_run("ppo", steps=600), folder, EVERY["ppo"], resume=True, progress=False)
    assert (folder / "training.json").read_text() == before


def test_a_finished_run_with_a_torn_policy_is_not_taken_for_whole(unbroken: dict[str, Path], tmp_path: Path) -> None:
    folder = shutil.copytree(unbroken["ppo"], tmp_path / "run")
    (folder / "policy.npz").write_bytes(b"torn")
    with pytest.raises(InputError, match=r"policy\.npz is torn"):
        train(small_run("ppo"), folder, EVERY["ppo"], resume=True, progress=False)


@pytest.mark.parametrize(
    "content",
    [b"no archive", pickle.dumps([1, 2]), packed([1, 2]), packed({"run": 1}), packed({"run": {"env": "a"}})],
)
def test_a_whole_checkpoint_that_is_no_snapshot_is_one_line(
    content: bytes, unbroken: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = unfinished(unbroken["ppo"], tmp_path / "run")
    save_checkpoint(folder / "checkpoints", 10**6, content)
    assert command.main(arguments("ppo", folder, "--resume")) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: checkpoint is no snapshot of a training: ")


def test_a_checkpoint_runs_no_code(unbroken: dict[str, Path], tmp_path: Path) -> None:
    class Intruder:
        def __reduce__(self) -> tuple[Any, tuple[str]]:
            return os.mkdir, (str(tmp_path / "intruded"),)

    folder = unfinished(unbroken["ppo"], tmp_path / "run")
    state = {"run": small_run("ppo").record(), "weights": np.array([Intruder()])}
    for content in (pickle.dumps(Intruder()), packed(state)):
        save_checkpoint(folder / "checkpoints", 10**6, content)
        with pytest.raises(InputError, match="checkpoint"):
            train(small_run("ppo"), folder, EVERY["ppo"], resume=True, progress=False)
    assert not (tmp_path / "intruded").exists()


def test_a_checkpoint_of_another_run_is_refused(unbroken: dict[str, Path], tmp_path: Path) -> None:
    """The plan in the folder is that of one seed, its checkpoints are those of another."""
    train(small_run("ppo", seed=2), tmp_path / "other", EVERY["ppo"], progress=False)
    folder = unfinished(unbroken["ppo"], tmp_path / "run")
    shutil.rmtree(folder / "checkpoints")
    shutil.copytree(tmp_path / "other" / "checkpoints", folder / "checkpoints")
    with pytest.raises(InputError, match="checkpoint is of another run: its seed is 2, expected 1"):
        train(small_run("ppo"), folder, EVERY["ppo"], resume=True, progress=False)


def test_a_checkpoint_that_lacks_a_part_is_one_line(unbroken: dict[str, Path], tmp_path: Path) -> None:
    folder = unfinished(unbroken["ppo"], tmp_path / "run")
    steps, content = load_checkpoint(folder / "checkpoints") or (0, b"")
    whole = unpacked(content)
    for name in set(whole) - {"run"}:
        save_checkpoint(
            folder / "checkpoints", steps, packed({key: part for key, part in whole.items() if key != name})
        )
        with pytest.raises(InputError, match="checkpoint does not fit this training"):
            train(small_run("ppo"), folder, EVERY["ppo"], resume=True, progress=False)


def test_two_trainings_in_one_folder_are_refused(
    unbroken: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second begins while the first is in its third step, and disturbs nothing."""
    add, calls = callback.LearningCurve.add, itertools.count(1)

    def intruded(self: Any, cost: Any, ended: Any) -> None:
        if next(calls) == 3:
            for resume in (False, True):
                with pytest.raises(InputError, match=r"another training runs in|already holds a run"):
                    train(small_run("ppo"), tmp_path / "run", EVERY["ppo"], resume, progress=False)
        add(self, cost, ended)

    monkeypatch.setattr(callback.LearningCurve, "add", intruded)
    train(small_run("ppo"), tmp_path / "run", EVERY["ppo"], progress=False)
    assert_same_run(tmp_path / "run", unbroken["ppo"])


def test_a_run_killed_before_its_first_checkpoint_begins_anew(unbroken: dict[str, Path], tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    shutil.copy(unbroken["ppo"] / "training.json", folder)
    train(small_run("ppo"), folder, EVERY["ppo"], resume=True, progress=False)
    assert_same_run(folder, unbroken["ppo"])


def unfinished(run: Path, folder: Path) -> Path:
    """A copy of a finished run as a kill in its last rollout would leave it."""
    shutil.copytree(run, folder)
    for name in ("run.json", "policy.npz"):
        (folder / name).unlink()
    return folder


def test_a_torn_checkpoint_costs_one_interval_and_two_are_an_error(
    unbroken: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = unfinished(unbroken["dqn"], tmp_path / "run")
    earlier, later = sorted((folder / "checkpoints").iterdir())
    kept = earlier.read_bytes()
    later.write_bytes(later.read_bytes()[:-1])
    earlier.write_bytes(b"")
    names = sorted(path.name for path in folder.rglob("*"))
    assert command.main(arguments("dqn", folder, "--resume")) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith("error: none of the 2 checkpoints")
    assert sorted(path.name for path in folder.rglob("*")) == names
    earlier.write_bytes(kept)
    assert command.main(arguments("dqn", folder, "--resume")) == 0
    assert f"{later.name} is torn, skipped" in capsys.readouterr().err
    assert_same_run(folder, unbroken["dqn"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"algo": "dqn"}, "algo is 'dqn', but the run in"),
        ({"seed": 2}, "seed is 2, but the run in"),
        ({"gamma": 0.5}, "settings.gamma is 0.5, but the run in"),
        ({"steps": 270}, "settings.steps is 270, but the run in"),
        ({"steps": 600, "seed": 2}, "seed is 2, but the run in"),
    ],
)
def test_another_plan_is_not_resumed(
    change: dict[str, Any], message: str, unbroken: dict[str, Path], tmp_path: Path
) -> None:
    folder = unfinished(unbroken["ppo"], tmp_path / "run")
    run = small_run(**{"algo": "ppo", **change})
    with pytest.raises(InputError, match=message):
        train(run, folder, 60, resume=True, progress=False)


def test_other_versions_are_not_resumed(unbroken: dict[str, Path], tmp_path: Path) -> None:
    folder = unfinished(unbroken["ppo"], tmp_path / "run")
    run = json.loads((folder / "training.json").read_text())
    run["versions"]["torch"] = "0.4.1"
    (folder / "training.json").write_text(json.dumps(run))
    with pytest.raises(InputError, match=r"versions.torch is .* has '0.4.1'"):
        train(small_run("ppo"), folder, 60, resume=True, progress=False)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_disk_ends_training_in_one_line_and_costs_one_interval(
    unbroken: dict[str, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = tmp_path / "run"

    def save_on_a_disk_full_at_120(checkpoints: Path, steps: int, content: bytes) -> None:
        if steps == 120:
            (checkpoints / f".step-000000000120.ckpt.{os.getpid()}.part").symlink_to("/dev/full")
        save_checkpoint(checkpoints, steps, content)

    with monkeypatch.context() as patch:
        patch.setattr(callback, "save_checkpoint", save_on_a_disk_full_at_120)
        assert command.main(arguments("ppo", folder)) != 0
    (line,) = capsys.readouterr().err.splitlines()
    assert os.strerror(errno.ENOSPC) in line
    assert "step-000000000120.ckpt" in line
    assert saved_steps(folder) == 60
    assert command.main(arguments("ppo", folder, "--resume")) == 0
    assert_same_run(folder, unbroken["ppo"])


def test_a_disk_full_at_the_very_end_leaves_no_half_result(
    unbroken: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = unfinished(unbroken["ppo"], tmp_path / "run")

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "policy.npz")

    with monkeypatch.context() as patch:
        patch.setattr(learn, "write_whole", full)
        assert command.main(arguments("ppo", folder, "--resume")) != 0
    assert not (folder / "run.json").exists()
    assert command.main(arguments("ppo", folder, "--resume")) == 0
    assert_same_run(folder, unbroken["ppo"])


def test_the_run_record_says_what_was_trained(unbroken: dict[str, Path]) -> None:
    run = json.loads((unbroken["ppo"] / "run.json").read_text())
    assert run["env"] == "wavegym/KershawEvansPosition-v0"
    assert (run["algo"], run["seed"], run["steps"]) == ("ppo", 1, 300)
    assert run["cpu_seconds"] > 0.0
    assert run["settings"]["environment"] == {"horizon": 7, "max_episode_steps": 6}
    assert run["observation"][0] == "snr"
    assert run["actions"]["count"] == 56
    curve = (unbroken["ppo"] / "curve.csv").read_text().splitlines()
    assert curve[0] == "steps,episodes,cost"
    assert [int(line.split(",")[0]) for line in curve[1:]] == list(range(30, 301, 30))
    assert list((unbroken["ppo"] / "tensorboard").glob("events.*"))
