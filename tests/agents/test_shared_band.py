"""The page of the shared band: tables and picture from a few worlds, and its code."""

from __future__ import annotations

import json
import re
from functools import partial

import pytest

from agents import history_lengths, shared_band, stock_learner
from agents.leaderboard import ROOT
from wavegym.learning.settings import load_settings


@pytest.mark.slow
def test_scenarios_and_prices_become_tables_and_a_picture(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(shared_band, "FOLDER", tmp_path / "results")
    monkeypatch.setattr(shared_band, "PAGE", tmp_path / "page.md")
    monkeypatch.setattr(shared_band, "PICTURE", tmp_path / "shared_band.png")
    monkeypatch.setattr(shared_band, "README", tmp_path / "readme.md")
    monkeypatch.setattr(shared_band, "FRONT", {"claim": "a rule", "informed": "all"})
    monkeypatch.setattr(shared_band, "WORLDS", 4)
    monkeypatch.setattr(shared_band, "PRICES", (0.0, 1.0))
    for file in (shared_band.PAGE, shared_band.README):
        file.write_text(f"before\n{shared_band.START}\n{shared_band.END}\nafter\n")
    monkeypatch.setattr(shared_band.renew, "__defaults__", (tmp_path / "results",))
    shared_band.main(["mixture", "price", "--jobs", "1"])
    assert capsys.readouterr().out == "mixture: written\nprice: written\n"
    page = shared_band.PAGE.read_text()
    rows = re.findall(r"^\| `([\w:-]+)`", page.partition("### A price")[0], re.MULTILINE)
    policies = json.loads((tmp_path / "results" / "mixture.json").read_text())["policies"]
    assert rows == sorted(policies, key=lambda name: policies[name]["belief"]["percent"])
    assert {"claim", "myopic:lags", "informed", "clairvoyant", "fixed:full-band"} <= set(rows)
    assert policies["fixed:full-band"]["share"] == 1.0
    assert policies["sense-and-avoid"]["belief"]["percent"] == 0.0
    assert page.partition("### A price")[2].count("`myopic`") == 2
    assert re.search(r"^\| `informed` \| +all \|", shared_band.README.read_text(), re.MULTILINE)
    assert shared_band.PICTURE.read_bytes().startswith(b"\x89PNG")


def test_an_unknown_scenario_is_refused(capsys):
    with pytest.raises(ValueError, match=r"scenario is 'mixtures', expected .*did you mean 'mixture'"):
        shared_band.main(["mixtures"])


def test_the_user_on_the_page_plays():
    page = (ROOT / "docs" / "shared_band.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", page.partition("## A user of your own")[2], re.DOTALL)
    made: dict = {}
    exec(code, made)
    envs = made["envs"]
    envs.reset(seed=0)
    _, _, _, _, info = envs.step(envs.action_space.sample())
    assert info["cost"].shape == (8,)


@pytest.mark.slow
def test_a_stock_learner_is_written_down_as_it_learns(tmp_path, monkeypatch):
    monkeypatch.setattr(stock_learner, "FILE", tmp_path / "stock.csv")
    monkeypatch.setattr(stock_learner, "PAGE", tmp_path / "page.md")
    monkeypatch.setattr(stock_learner, "WORLDS", 3)
    monkeypatch.setattr(stock_learner.train, "__defaults__", (4096, 2048))
    stock_learner.PAGE.write_text(f"{stock_learner.START}\n{stock_learner.END}\n")
    stock_learner.main(["4"])
    rows = stock_learner.read()
    assert [row[:2] for row in rows] == [[4.0, 2048.0], [4.0, 4096.0]]
    assert all(row[2] > 0.0 for row in rows)  # it has hardly begun to learn


def test_the_table_of_a_stock_learner_is_the_geometric_mean_of_its_seeds():
    rows = [[0.0, 100_352.0, 100.0, 0.0, 0.0], [1.0, 100_352.0, -50.0, 0.0, 0.0]]
    (line,) = stock_learner.table(rows).splitlines()[2:]
    assert [cell.strip() for cell in line.split("|")[1:4]] == ["100000", "+100.0, -50.0", "0"]


@pytest.mark.slow
def test_agents_of_each_history_are_trained_once_and_meet_opponents_in_their_own_worlds(tmp_path, monkeypatch):
    for name, value in {"FILE": tmp_path / "history.json", "PAGE": tmp_path / "page.md", "WORLDS": 3,
                        "LENGTHS": (4, 16), "SEEDS": (5,)}.items():  # fmt: skip
        monkeypatch.setattr(history_lengths, name, value)
    short = partial(load_settings, chosen={"steps": 6400})
    monkeypatch.setattr(history_lengths, "load_settings", short)
    history_lengths.PAGE.write_text(f"{history_lengths.START}\n{history_lengths.END}\n")
    history_lengths.main(["--runs", str(tmp_path / "runs")])
    run = json.loads((tmp_path / "runs" / "4" / "5" / "run.json").read_text())
    assert run["settings"]["environment"]["history"] == 4
    first, second = history_lengths.PAGE.read_text().splitlines()[4:6]
    untrained, saved = (float(line.split("|")[2]) for line in (first, second))
    assert untrained > 0.0 > saved  # against sense-and-avoid
    monkeypatch.setattr(history_lengths, "train", None)  # not called again
    history_lengths.main(["--runs", str(tmp_path / "runs")])
