"""The board of a release: its seed is drawn once, and its page holds every record."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from agents import board
from wavegym.core import VERSION
from wavegym.core.errors import InputError
from wavegym.evaluation.submission import PARAMETERS


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(board, "FOLDER", tmp_path)
    monkeypatch.setattr(board, "PAGE", tmp_path / "page.md")
    monkeypatch.setattr(board, "PICTURE", tmp_path / "images" / "board.png")
    (tmp_path / "page.md").write_text(f"before\n{board.START}\n{board.END}\nafter\n")
    return tmp_path


def test_a_root_is_drawn_once_for_a_version(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"has no release, expected one \(nearest: python -m agents.board --release\)"):
        board.latest()
    board.release()
    found, about = board.latest()
    assert found == folder / VERSION
    assert 0 <= about["seed"] < 2**31
    with pytest.raises(InputError, match="has a seed already"):
        board.release()
    for version in ("0.9.0", "0.10.0"):
        monkeypatch.setattr(board, "VERSION", version)
        board.release()
    later, other = board.latest()
    assert later.name == "0.10.0", "not by the alphabet"
    assert other["seed"] != about["seed"]


def test_the_agents_of_the_suite_are_those_whose_actions_the_board_admits() -> None:
    ppo, dqn = board.own("ppo"), board.own("dqn")
    assert "wavegym/MultifunctionRadar-v1" in ppo.policies
    assert ppo.policies["wavegym/AgileClutter-v0"].parameters == {}
    assert dqn.policies["wavegym/AgileClutter-v0"].parameters == {"action": "joint"}
    assert dqn.policies["wavegym/RfEo-v0"].parameters == {}, (
        "it chooses from a short list of the environment's own actions"
    )
    for entry in (*ppo.policies.values(), *dqn.policies.values()):
        assert set(entry.parameters) <= set(PARAMETERS)
        assert entry.file.name == "seed0"
        assert entry.steps > 0


def test_the_page_holds_every_record_of_the_latest_release(folder: Path) -> None:
    board.release()
    board.renew()
    assert (folder / "page.md").read_text().startswith("before"), "without a record nothing changes"
    environments = {"wavegym/KershawEvans-v0": {"microseconds": 3.0, "steps": 5, "cpu_seconds": 7.0}}
    for name in ("error", "simple_error", "simple_cost"):
        environments["wavegym/KershawEvans-v0"][name] = [1.0, 2.0]  # type: ignore[assignment]
    for name, ratio in (("plum", 0.9), ("pear", 0.8)):
        costs = {"wavegym/KershawEvans-v0": {**environments["wavegym/KershawEvans-v0"], "cost": [ratio, 2.0 * ratio]}}
        about = {"name": name, "code": "here", "version": VERSION, "seed": 1, "worlds": 2, "environments": costs}
        (folder / VERSION / f"{name}.json").write_text(json.dumps(about))
    board.renew()
    page = (folder / "page.md").read_text()
    assert page.startswith("before\n")
    assert page.endswith("after\n")
    rows = [line for line in page.splitlines() if line.startswith("|") and ("plum" in line or "pear" in line)]
    assert ["pear" in row for row in rows] == [True, False], "the cheaper one first"
    assert page.count("| KershawEvans-v0 |") == 2
    assert np.all([f"### {name}" in page for name in ("plum", "pear")])
    assert (folder / "images" / "board.png").exists()
