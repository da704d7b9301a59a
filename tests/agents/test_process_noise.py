"""The gain of foresight against process noise."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from agents import process_noise as study
from wavegym.core.errors import InputError

pytestmark = pytest.mark.filterwarnings("ignore:.*parameters that differ")


@pytest.fixture
def results(monkeypatch: pytest.MonkeyPatch) -> dict:
    monkeypatch.setattr(study, "DENSITIES", (1.0, 100.0))
    return {study.DRAWN: study.play(None, worlds=20, jobs=1), "aircraft": study.play(study.AIRCRAFT, worlds=6, jobs=1)}


@pytest.mark.slow
def test_figures_page_and_picture(results: dict, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Two densities: the one-step scheduler gains nothing over itself; the filter of the true density is consistent."""
    drawn, recorded = results[study.DRAWN], results["aircraft"]
    assert [(case["tracker"], case["q"]) for case in drawn["cases"]] == [
        ("kalman", 1.0),
        ("kalman", 100.0),
        ("imm", 1.0),
        ("imm", 100.0),
    ]
    assert [(case["tracker"], case["q"]) for case in recorded["cases"]][2:] == [("imm", None)]
    assert (recorded["file"], recorded["targets"]) == ("aircraft_tracks.csv", 15)
    for found in results.values():
        for case in found["cases"]:
            myopic, ahead = case["policies"]["myopic"], case["policies"]["lookahead:2"]
            assert myopic["belief"]["value"] == myopic["truth"]["value"] == 0.0
            assert ahead["belief"]["value"] == pytest.approx(100.0 * (ahead["cost"] / myopic["cost"] - 1.0))
            ratio = ahead["squared_error"] / myopic["squared_error"]
            assert ahead["truth"]["value"] == pytest.approx(100.0 * (ratio - 1.0))
    for case in drawn["cases"][:2]:
        # 20 episodes of 50 steps, about 2 steps long in memory: a standard error of some 2 sqrt(2 / 1000) = 0.1
        assert abs(case["policies"]["myopic"]["nees"] - 2.0) < 0.4
    assert drawn["cases"][1]["policies"]["lookahead:2"]["belief"]["value"] < -10.0  # README's first table

    page = tmp_path / "page.md"
    page.write_text(f"# Page\n\n{study.START}\n{study.END}\n")
    monkeypatch.setattr(study, "PAGE", page)
    monkeypatch.setattr(study, "PICTURE", tmp_path / "picture.png")
    for name, found in results.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(found))
    study.renew(tmp_path)
    text = page.read_text()
    joined = " ".join(text.split())
    for part in (
        "### Drawn | tracker | policy |",
        "| IMM, world's q = 1 | myopic |",
        "| IMM | lookahead:2 |",
        "| aircraft | `aircraft_tracks.csv` | 51.75°, -1.25°, 100 m | 15 |",
        f"| aircraft | {np.sqrt(recorded['cases'][1]['policies']['myopic']['squared_error']):#.4g} |",
    ):
        assert part in joined
    assert (tmp_path / "picture.png").read_bytes().startswith(b"\x89PNG")


def test_an_unknown_set_of_worlds_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["process_noise", "aircrafts"])
    with pytest.raises(InputError, match="name is 'aircrafts', expected one of 'drawn', 'aircraft'; did you mean"):
        study.main()


def test_the_committed_results_are_those_of_the_page() -> None:
    """Each set of worlds has every tracker."""
    text = study.PAGE.read_text(encoding="utf-8").replace(" ", "")
    files = sorted(study.FOLDER.glob("*.json"))
    assert {"drawn", "aircraft"} <= {file.stem for file in files}
    for file in files:
        cases = json.loads(file.read_text())["cases"]
        assert {case["q"] for case in cases if case["tracker"] == "kalman"} == set(study.DENSITIES)
        for policy in (policy for case in cases for policy in case["policies"].values()):
            assert f"{np.sqrt(policy['squared_error']):#.4g} | {policy['nees']:.2f} |".replace(" ", "") in text
