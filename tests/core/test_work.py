"""Work for several processes: results in order, killed workers, orphans, and parts that are kept.

Options that choose where it runs, and their mistakes; test_ray_cluster.py has a Ray cluster itself.
"""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import joblib
import numpy as np
import pytest
from joblib.externals.loky.process_executor import TerminatedWorkerError

from research.promises.faults import children, is_alive
from wavegym.core import work
from wavegym.core.arrays import Array
from wavegym.core.command_line import Parser
from wavegym.core.errors import InputError
from wavegym.core.work import Call, Parts, add_worker_options, hidden_folder, kept_parts, run_all, workers


class Pair(NamedTuple):
    """What the calls of these tests return."""

    half: Array
    square: Array


def pair(number: int) -> Pair:
    return Pair(np.array([number / 2.0]), np.array([number**2]))


def mortal(number: int, marks: Path, lives: int) -> int:
    """Number 3 is killed until it has been called ``lives`` times."""
    if number == 3:
        (marks / str(len(list(marks.iterdir())))).touch()
        if len(list(marks.iterdir())) <= lives:
            os.kill(os.getpid(), signal.SIGKILL)
    return number


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_the_order_of_the_calls(jobs: int) -> None:
    counted: list[int] = []
    found = run_all([Call(pow, (n, 2)) for n in range(20)], jobs, counted.append)
    assert found == [n**2 for n in range(20)]
    assert sum(counted) == 20


@pytest.mark.slow
def test_what_a_killed_worker_was_doing_is_done_once_more(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = run_all([Call(mortal, (n, tmp_path, 1)) for n in range(8)], 2)
    assert found == list(range(8))
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("warning: a worker was killed (")
    assert "SIGKILL" in line
    assert line.endswith("of 8 batches are played again")


@pytest.mark.slow
def test_a_worker_that_is_killed_again_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(TerminatedWorkerError):
        run_all([Call(mortal, (n, tmp_path, 9)) for n in range(8)], 2)


ORPHANS = """
import time
from pathlib import Path
from wavegym.core.work import Call, run_all

def work(number):
    Path(FOLDER, str(number)).touch()
    time.sleep(60.0)

if __name__ == "__main__":
    run_all([Call(work, (number,)) for number in range(4)], 2)
"""


@pytest.mark.parametrize("sent", [signal.SIGKILL, signal.SIGTERM])
def test_no_worker_outlives_the_process_that_started_it(sent: signal.Signals, tmp_path: Path) -> None:
    (tmp_path / "orphans.py").write_text(ORPHANS.replace("FOLDER", repr(str(tmp_path))))
    parent = subprocess.Popen([sys.executable, str(tmp_path / "orphans.py")])
    deadline = time.monotonic() + 60.0
    while not {"0", "1"} <= {file.name for file in tmp_path.iterdir()} and time.monotonic() < deadline:
        time.sleep(0.1)
    workers = children(parent.pid)
    assert len(workers) == 4, "two workers and two trackers"
    parent.send_signal(sent)
    parent.wait()
    while any(map(is_alive, workers)) and time.monotonic() < deadline:
        time.sleep(0.2)
    assert not any(map(is_alive, workers))


def test_parts_that_are_kept_are_not_computed_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = [Call(pair, (n,)) for n in range(5)]
    parts = Parts(tmp_path, Pair)
    for call in calls[:3]:
        parts.put(parts.key(call), pair(*call.arguments))
    asked: list[int] = []
    unordered = work._unordered

    def counting(some: list[tuple[int, Call]], jobs: int) -> object:
        asked.extend(index for index, _ in some)
        return unordered(some, jobs)

    monkeypatch.setattr(work, "_unordered", counting)
    counted: list[int] = []
    found = run_all(calls, 1, counted.append, parts)
    assert asked == [3, 4]
    assert sum(counted) == 5
    for n, result in enumerate(found):
        np.testing.assert_array_equal(result.half, [n / 2.0])
        np.testing.assert_array_equal(result.square, [n**2])
    run_all(calls, 1, parts=parts)
    assert asked == [3, 4]


def test_a_torn_part_is_computed_again(tmp_path: Path) -> None:
    call, parts = Call(pair, (4,)), Parts(tmp_path, Pair)
    key = parts.key(call)
    assert parts.get(key) is None
    parts.put(key, pair(4))
    (file,) = tmp_path.iterdir()
    file.write_bytes(file.read_bytes()[:-30])
    assert parts.get(key) is None
    assert run_all([call], 1, parts=parts)[0].square == 16
    assert parts.get(key) is not None
    assert parts.get(parts.key(Call(pair, (5,)))) is None


def test_the_hidden_folder_goes_at_the_end_and_stays_after_an_interruption(tmp_path: Path) -> None:
    def interrupted() -> None:
        with kept_parts(tmp_path, Pair) as parts:
            assert parts is not None
            parts.put("four", pair(4))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    with kept_parts(tmp_path, Pair) as parts:
        assert parts is not None
        assert parts.get("four") is not None
    assert list(tmp_path.iterdir()) == []
    with kept_parts(None, Pair) as parts:
        assert parts is None


def test_results_of_other_sources_are_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A change in either package changes the name of the hidden folder."""
    sources = [tmp_path / "a" / "kernels.py", tmp_path / "b" / "study.py"]
    for source in sources:
        source.parent.mkdir()
        source.write_text("x = 1\n")
    monkeypatch.setattr(work, "PACKAGE", tmp_path / "a")

    def name() -> str:
        with hidden_folder(tmp_path, tmp_path / "b") as folder:
            return folder.name

    first = name()
    assert first == name()
    for source in sources:
        before = name()
        source.write_text("x = 2\n")
        assert name() != before


def options(*given):
    parser = Parser()
    add_worker_options(parser, jobs=3)
    return parser.read(given)


def test_processes_are_the_default_and_leave_joblib_alone():
    chosen = options()
    assert (chosen.jobs, chosen.backend, chosen.address) == (3, "processes", None)
    before = type(joblib.parallel.get_active_backend()[0])
    with workers(chosen):
        assert type(joblib.parallel.get_active_backend()[0]) is before


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["--backend", "rey"], "--backend is 'rey', expected one of 'processes', 'ray'; did you mean 'ray'"),
        (["--address", "auto"], "--address is 'auto', expected it with --backend ray only"),
    ],
)
def test_mistakes_name_what_was_expected(given, words):
    with pytest.raises(InputError, match=words), workers(options(*given)):
        pytest.fail("the work began")


@pytest.mark.skipif(importlib.util.find_spec("ray") is not None, reason="Ray is installed")
def test_without_ray_the_extra_is_named():
    with (
        pytest.raises(InputError, match=r"needs Ray.*pip install 'wavegym\[ray\]'"),
        workers(options("--backend", "ray")),
    ):
        pytest.fail("the work began")
