"""The HTML report: its data are the comparison's, and a browser draws them."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wavegym.evaluation import compare, write_report
from wavegym.evaluation.comparison import Comparison
from wavegym.evaluation.page import page
from wavegym.evaluation.summary import summarise
from wavegym.evaluation.table import order_sentence, tables
from wavegym.schedulers import Fixed, RandomChoice

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update"]


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    policies = {"a </script><b>": Fixed(2), "chance": [RandomChoice(), RandomChoice()]}
    return compare("wavegym/SectorSetup-v0", policies, worlds=7, jobs=1, progress=False)


def carried(text: str) -> Any:
    """The data in a page."""
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
    assert found
    return json.loads(found[1])


def drawn(file: Path, profile: Path) -> str:
    """The document after a browser has run its script."""
    assert BROWSER
    command = [BROWSER, *FLAGS, f"--user-data-dir={profile}", "--dump-dom", file.as_uri()]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout


def test_the_page_carries_what_was_played(comparison: Comparison) -> None:
    data = carried(page(comparison, summarise(comparison)).decode())
    assert [p["name"] for p in data["policies"]] == sorted(
        comparison.played, key=lambda name: comparison.cost(name).mean()
    )
    for policy in data["policies"]:
        members = comparison.played[policy["name"]]
        costs = np.concatenate([member.cost for member in members])
        np.testing.assert_allclose(policy["median"], np.median(costs, axis=0), rtol=1e-3)
        ratio = comparison.cost(policy["name"]).mean(axis=0) / comparison.cost("myopic")[0]
        np.testing.assert_allclose(policy["percent"], 100 * (ratio - 1), rtol=1e-3, atol=1e-9)
        (shares,) = policy["shares"]
        np.testing.assert_allclose(np.sum(shares, axis=1), 1.0, atol=1e-3)
        world = data["replay"]["world"]
        np.testing.assert_allclose(policy["episode"]["cost"], members[0].cost[world], rtol=1e-3)
        labels = comparison.task.system.actions.labels  # type: ignore[union-attr]
        told = [data["options"][row] for row in policy["episode"]["rows"][0]]
        assert told == [labels[i] for i in members[0].choice[world, :, 0]]


def test_it_needs_nothing_from_elsewhere(comparison: Comparison) -> None:
    text = page(comparison, summarise(comparison)).decode()
    assert not re.search(r"(src|href)\s*=|url\(|@import|fetch\(|import\(", text)
    assert text.count("</script>") == 2


def test_a_box_has_no_choices_to_show() -> None:
    played = compare("wavegym/RfEoFar-v0", {"myopic": None}, worlds=2, jobs=1, progress=False, horizon=6)
    data = carried(page(played, summarise(played)).decode())
    assert data["options"] == data["policies"][0]["shares"] == []


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine")
@pytest.mark.parametrize("env_id", ["wavegym/SectorSetup-v0", "wavegym/AgileClutter-v0", "wavegym/RfEoFar-v0"])
@pytest.mark.slow
def test_a_browser_draws_it(env_id: str, tmp_path: Path) -> None:
    parameters: dict[str, Any] = {"horizon": 6} if "RfEo" in env_id else {}
    played = compare(env_id, {"myopic": None, "random": None}, worlds=5, jobs=1, progress=False, **parameters)
    write_report(played, tmp_path)
    text = drawn(tmp_path / "report.html", tmp_path / "profile")
    assert 'data-drawn="yes"' in text  # the last line of the script was reached
    assert text.count('class="curve"') == text.count('class="lived"') == 2
    pairs = text[text.index('id="pairs"') : text.index('id="choices-card"') if "RfEo" not in env_id else None]
    assert pairs.count("<circle") >= 10
    sensors = {"wavegym/SectorSetup-v0": 1, "wavegym/AgileClutter-v0": 2}.get(env_id, 0)
    steps = played.task.system.horizon
    assert text.count('class="cell"') == 2 * sensors * steps
    assert ('id="choices-card"' in text) == bool(sensors)
    assert "NaN" not in text
    summary = summarise(played)
    assert text.count("<th>mean vs myopic %</th>") == 2  # by belief and by truth
    for title, columns in tables(summary):
        assert f"<h3>{title}</h3>" in text
        assert f"<td>{columns[-1][-1]}</td>" in text
    assert order_sentence(summary["reversals"]) in text


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine")
@pytest.mark.slow
def test_names_are_text_not_markup(comparison: Comparison, tmp_path: Path) -> None:
    write_report(comparison, tmp_path)
    text = drawn(tmp_path / "report.html", tmp_path / "profile")
    assert 'data-drawn="yes"' in text
    assert "a &lt;/script&gt;&lt;b&gt;</td>" in text


def test_the_tables_are_those_of_the_markdown_and_scroll(comparison: Comparison) -> None:
    summary = summarise(comparison)
    text = page(comparison, summary).decode()
    data = carried(text)
    assert data["tables"] == [{"title": title, "columns": columns} for title, columns in tables(summary)]
    assert [policy["name"] for policy in data["policies"]] == data["tables"][0]["columns"][0][1:]
    assert data["orders"] == order_sentence(summary["reversals"])
    assert 'wide.className = "wide"' in text
    assert ".wide { overflow-x: auto; }" in text


def test_a_title_that_holds_the_mark_of_the_data_stays_a_title(comparison: Comparison) -> None:
    """A recording may have any file name."""
    name = "__DATA__<img src=x onerror=alert(1)>__TITLE__.csv"
    text = page(comparison, {**summarise(comparison), "parameters": {"tracks": name}}).decode()
    assert carried(text)["title"].endswith(f"tracks={name}")
    assert "<img" not in text
    assert text.count(html.escape(name)) == 2, "in the title and in the heading, its marks as they are"
