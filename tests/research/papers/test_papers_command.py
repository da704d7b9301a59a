from __future__ import annotations

import csv
import json
from functools import partial
from pathlib import Path

import mistakes
import numpy as np
import pytest

import wavegym
from research import papers
from research.papers import agile_clutter, rf_eo, seeds, urban, work
from research.papers.__main__ import main
from research.papers.agile_clutter import study as agile_clutter_study
from research.papers.agile_clutter.study import FREE, FULL, POLICIES, names
from research.papers.agile_clutter.table import markdown
from research.papers.rf_eo import study as rf_eo_study
from research.papers.rf_eo.adaptation import QUANTILES
from research.papers.rf_eo.numbers import shown
from research.papers.rf_eo.pictures import CURVES, TRACKS
from research.papers.urban import study as urban_study
from research.papers.urban.pictures import NAMES
from wavegym.core import work as core_work
from wavegym.core.errors import InputError

FILES = {"figure2.csv", "figure3.csv", "figure2.png", "figure3.png", "summary.json"}


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_the_agile_chirps_files_for_any_number_of_jobs(rebuilt, capsys, quick, monkeypatch):
    monkeypatch.setattr(agile_clutter_study, "CHUNK", 3)
    monkeypatch.setattr(agile_clutter, "play", partial(agile_clutter.play, tuning=1))
    folder = rebuilt(agile_clutter, 4)
    assert {path.name for path in folder.iterdir()} == FILES
    summary = json.loads((folder / "summary.json").read_text())
    assert markdown(summary) in capsys.readouterr().out
    figure2, figure3 = (rows(folder / name) for name in ("figure2.csv", "figure3.csv"))
    assert len(figure2) == len(POLICIES) * 2 * 32
    assert len(figure3) == 32 * 2 * (len(names(FULL)) + len(names(FREE)))
    for clutter, setting in summary["trackers"]["jpda"].items():
        shown = [r for r in figure2 if (r["policy"], r["clutter"]) == (FULL, clutter)]
        assert sum(float(r["mse"]) for r in shown) == pytest.approx(setting["policies"][FULL]["mse_kept"]["mean"])
        assert {int(r["kept"]) for r in shown} == {setting["policies"][FULL]["mse_kept"]["runs"]}
        assert all(float(r["low"]) <= float(r["mse"]) <= float(r["high"]) for r in shown)
    for policy, offered in ((FULL, names(FULL)), (FREE, names(FREE))):
        shown = [row for row in figure3 if row["policy"] == policy]
        share = np.array([float(row["share"]) for row in shown]).reshape(-1, len(offered))
        np.testing.assert_allclose(share.sum(axis=1), 1.0)
        reported = summary["trackers"]["jpda"]["clutter"]["choices"][policy]["share"]["all"]
        np.testing.assert_allclose(share.mean(axis=0), [reported[law]["mean"] for law in offered], atol=1e-15)
        assert (np.array([int(row["typical"]) for row in shown]).reshape(-1, len(offered)).sum(axis=1) == 1).all()
    for name in ("figure2.png", "figure3.png"):
        assert (folder / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_the_platforms_files_for_any_number_of_jobs(rebuilt, capsys, quick, monkeypatch):
    monkeypatch.setattr(rf_eo, "play", partial(rf_eo.play, tuning=2, horizon=6))
    folder = rebuilt(rf_eo, 6)
    assert "| lookahead:10 |" in capsys.readouterr().out
    figure2, figure3, figure4 = (rows(folder / f"figure{n}.csv") for n in (2, 3, 4))
    steps = len(shown(6))
    assert len(figure2) == sum(map(len, TRACKS.values())) * 2 * steps
    assert len(figure3) == sum(map(len, CURVES.values())) * 2 * steps
    assert len(figure4) == 2 * 2 * 2 * steps
    assert all(float(row["low"]) <= float(row["rms"]) <= float(row["high"]) for row in figure3)
    assert [f"{q:.0%}".rstrip("%") for q in QUANTILES] == ["10", "50", "90"]
    for row in figure4:
        assert float(row["pixel_angle_10"]) <= float(row["pixel_angle_50"]) <= float(row["pixel_angle_90"])


@pytest.mark.release
def test_the_urban_files_for_any_number_of_jobs(rebuilt, capsys, quick, monkeypatch):
    monkeypatch.setattr(urban_study, "CHUNK", 1)
    folder = rebuilt(urban, 2)
    assert "| loose | ghost logic | closed |" in capsys.readouterr().out
    figure3, figure4, figure5, figure6 = (rows(folder / f"figure{n}.csv") for n in (3, 4, 5, 6))
    assert [sum((r["of"], r["number"]) == ("target", n) for r in figure3) for n in "12"] == [140, 101]
    assert all((row["no_target"] == "") == (row["of"] == "target") for row in figure3)
    curves = len(urban_study.SETTINGS) * len(NAMES) * 140
    assert (len(figure4), len(figure5), len(figure6)) == (curves, curves, len(urban_study.SETTINGS) * 2 * 4 * 140)
    assert all((row["rms"] == "") == (float(row["held"]) == 0) for row in figure5)
    for row in figure6:
        assert (row["probability"] == "") == (row["runs"] == "0")
        assert all(0 <= float(row[key]) <= 1 + 1e-9 for key in ("probability", "low", "high") if row[key])


def test_an_interrupted_command_keeps_what_is_done(tmp_path, capsys, monkeypatch):
    few = dict.fromkeys(rf_eo_study.SCENES, (rf_eo_study.ADAPTIVE,))
    monkeypatch.setattr(rf_eo_study, "POLICIES", few)
    monkeypatch.setattr(rf_eo, "play", partial(rf_eo.play, tuning=2, horizon=2))
    assert main(["rf_eo", "--runs", "1", "--jobs", "1", "--out", str(tmp_path)]) != 0  # fewer policies than are drawn
    (store,) = tmp_path.iterdir()
    assert store.name.startswith(core_work.PREFIX)
    assert list(store.rglob("output.pkl"))
    assert capsys.readouterr().err.startswith("error: ")


@pytest.mark.slow
def test_a_stored_run_is_not_played_again(tmp_path, monkeypatch):
    """Every paper continues after an interruption."""
    monkeypatch.setattr(urban_study, "CASES", urban_study.CASES[:1])
    first = urban.play(1, 3, 1, store=tmp_path)
    stored = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("output.pkl")}
    again = urban.play(1, 3, 1, store=tmp_path)
    assert stored == {path: path.stat().st_mtime_ns for path in tmp_path.rglob("output.pkl")}
    assert len(stored) == 1
    for case, runs in first.runs.items():
        for one, other in zip(runs, again.runs[case], strict=True):
            np.testing.assert_array_equal(one, other)


def test_both_packages_are_in_the_hash(tmp_path, monkeypatch):
    taken = []
    monkeypatch.setattr(work.work, "sources_hash", lambda *packages: taken.append(packages) or "0" * 16)
    with work.cache_folder(tmp_path) as folder:
        assert folder == tmp_path / f".played-{'0' * 16}"
    assert taken == [(Path(papers.__file__).parent,)]
    assert Path(wavegym.__file__).parent == core_work.PACKAGE


def test_strings_that_seed_random_numbers_are_frozen():
    assert (seeds.TEST, seeds.TUNE, seeds.POLICY, seeds.BOOTSTRAP) == ("test", "tune", "policy", "bootstrap")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["agile_cluter"], "did you mean 'agile_clutter'"),
        (["agile_clutter", "--tracker", "jpd"], "did you mean 'jpda'"),
        (["agile_clutter", "--runs", "0"], "runs is 0"),
        (["agile_clutter", "--runs", "many"], "invalid int value: 'many'"),
        (["agile_clutter", "--jobs", "-2"], "jobs is -2"),
        (["agile_clutter", "--seed", "-1"], "seed is -1"),
        (["agile_clutter", "--run", "5"], "did you mean '--runs'"),
        (["rf_eo", "--runs", "0"], "runs is 0"),
        (["rf_eo", "--jobs", "0"], "jobs is 0"),
        (["rf_eo", "--seed", "-1"], "seed is -1"),
        (["rf_eo", "--tracker", "jpda"], "--tracker is 'jpda'"),
        (["urban", "--tracker", "jpda"], "--tracker is 'jpda'"),
        (["urban", "--runs", "0"], "runs is 0"),
        (["urbn"], "did you mean 'urban'"),
        ([], "PAPER"),
    ],
)
def test_mistakes_cost_one_line_and_no_earlier_result(tmp_path, capsys, arguments, words):
    mistakes.costs_one_line_and_no_earlier_result(
        lambda: main([*arguments, "--out", str(tmp_path)]), tmp_path, capsys, words
    )


def test_a_folder_that_cannot_be_made_is_a_mistake_too(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["agile_clutter", "--out", str(tmp_path / "file" / "out")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    ("study", "settings", "words"),
    [
        (agile_clutter_study, {"tuning": 0}, "tuning is 0"),
        (agile_clutter_study, {"tracker": "kalman"}, "tracker is 'kalman'"),
        (rf_eo_study, {"tuning": 0}, "tuning is 0"),
        (rf_eo_study, {"horizon": -1}, "horizon is -1"),
        *(
            (study, {name: value}, f"{name} is {value}")
            for study in (agile_clutter_study, rf_eo_study, urban_study)
            for name, value in (("runs", 0), ("jobs", 0), ("seed", -1))
        ),
    ],
)
def test_mistakes_are_found_before_any_run(monkeypatch, study, settings, words):
    monkeypatch.setattr(study, "_play", None)
    with pytest.raises(InputError, match=words):
        study.play(**{"runs": 1, "seed": 0, "jobs": 1, **settings})
