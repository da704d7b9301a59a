from __future__ import annotations

import json
from pathlib import Path

import pytest

from agents import demo


@pytest.mark.slow
def test_it_trains_compares_and_overwrites_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "demo"
    for folder in (out, tmp_path / "demo-2"):
        assert demo.main(["--out", str(out), "--worlds", "4", "--steps", "6400"]) == 0
        summary = json.loads((folder / "summary.json").read_text())
        assert set(summary["policies"]) == {*demo.SCHEDULERS.split(","), "ppo"}
        assert summary["worlds"] == 4
        shown = capsys.readouterr().out
        assert str(folder / "comparison.png") in shown
        assert "myopic:lags" in shown
        assert (folder / "comparison.png").stat().st_size > 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["demo", "demo-2"]


def test_the_first_free_folder_is_taken(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    assert demo.unused(out) == out
    out.mkdir()
    assert demo.unused(out) == out
    (out / "something").touch()
    assert demo.unused(out) == tmp_path / "demo-2"
    (tmp_path / "demo-2").touch()
    assert demo.unused(out) == tmp_path / "demo-3"


def test_a_mistake_is_one_line_before_any_training(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert demo.main(["--out", str(tmp_path / "demo"), "--steps", "0"]) == 2
    assert demo.main(["--ouut", "x"]) == 2
    first, second = capsys.readouterr().err.splitlines()
    assert first == "error: steps is 0, expected an integer >= 1 (nearest: 1)"
    assert "did you mean '--out'?" in second
    assert not list(tmp_path.iterdir())
