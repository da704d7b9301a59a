"""The pages of all papers are made from the results in the repository."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from research.papers import claims
from research.papers.catalogue import RUNS, load
from research.papers.claims import HEAD
from research.papers.page import END, START, block, main
from research.papers.rf_eo import numbers as rf_eo_numbers
from research.papers.urban import numbers as urban_numbers

ROOT = Path(__file__).parents[3]


@pytest.fixture(params=RUNS)
def paper(request):
    return request.param


@pytest.fixture
def results(paper):
    return ROOT / "results" / paper / "summary.json"


@pytest.fixture
def summary(results):
    return json.loads(results.read_text())


def test_the_page_is_made_from_the_results(paper, summary):
    page = (ROOT / "docs" / "papers" / f"{paper}.md").read_text()
    assert f"{START}\n\n{block(summary)}\n\n{END}" in page
    assert summary["command"].startswith(f"python -m research.papers {paper} --runs {summary['runs']} ")


def test_every_package_offers_the_same(paper):
    package = load(paper)
    assert package.FILES[-1] == "summary.json"
    assert isinstance(package.TRACKERS, tuple)
    assert all(callable(getattr(package, name)) for name in ("play", "write", "markdown", "check_claims"))


def test_pictures_and_data_of_the_page_are_in_the_repository(paper):
    for name in load(paper).FILES:
        is_picture = name.endswith("png")
        kept = f"{name}.xz" if name.endswith("csv") else name
        place = ROOT / "docs" / "images" / f"{paper}_{name}" if is_picture else ROOT / "results" / paper / kept
        assert place.is_file()
        if is_picture:
            assert f"(../images/{place.name})" in (ROOT / "docs" / "papers" / f"{paper}.md").read_text()


def test_the_block_is_renewed_and_the_rest_left(results, summary, tmp_path, capsys):
    page = tmp_path / "page.md"
    old = f"{START}\n\n{block(summary)}\n\n{END}"
    page.write_text("before\n" + re.sub(r"\d(?=\d)", "7", old) + "\nafter\n")
    assert main([str(results), str(page)]) == 0
    assert page.read_text() == f"before\n{old}\nafter\n"
    page.write_text("no block")
    assert main([str(results), str(page)]) == main([str(results)]) == 2
    assert page.read_text() == "no block"
    assert all(line.startswith("error: ") for line in capsys.readouterr().err.splitlines())


def test_the_block_has_tables_and_no_sentences(summary):
    _, _, text = block(summary).partition("```\n\n")
    for part in text.split("\n\n"):
        assert part.startswith("| ") or ("\n" not in part and len(part) < 60)
    assert f"| {' | '.join(HEAD)} |" in text


def test_text_and_case_identify_a_claim(paper, summary):
    rows = load(paper).check_claims(summary)
    assert len({(row.text, row.case) for row in rows}) == len(rows)


def planted(value, number):
    """A summary with ``number`` and a narrow interval in place of each estimate."""
    if isinstance(value, list):
        return [planted(of, number) for of in value]
    if not isinstance(value, dict):
        return value
    found = {key: planted(of, number) for key, of in value.items()}
    for name, ends in (("mean", "ci"), ("ratio", "ci"), ("percent", "ci"), ("geometric", "geometric_ci")):
        if name in found and ends in found and isinstance(found[name], float):
            found[name], found[ends] = number, sorted([0.99 * number, 1.01 * number])
    if "kept" in found and "choices" in found:  # a count of runs with its interval
        found["ci"] = sorted([0.99 * number, 1.01 * number])
    return found


def test_wrong_numbers_turn_every_verdict(paper, summary):
    """Numbers that are far too small or far too large refute each claim with a limit of its own."""
    check = load(paper).check_claims
    rows = {(row.text, row.case): row for row in check(summary)}
    verdicts = {name: set() for name in rows}
    for number in (-1e6, 1e6):
        for row in check(planted(summary, number)):
            verdicts[row.text, row.case] |= {row.verdict} if row.limit == rows[row.text, row.case].limit else {"no"}
    assert all("no" in found for found in verdicts.values()), verdicts


def test_without_intervals_every_claim_is_undecided(paper, summary):
    def bare(value):
        if isinstance(value, list):
            return [bare(of) for of in value]
        if isinstance(value, dict):
            return {key: None if key in ("ci", "geometric_ci") else bare(of) for key, of in value.items()}
        return value

    rows = load(paper).check_claims(bare(summary))
    assert {row.verdict for row in rows if row.measured.value != 0.0} == {"undecided"}


@pytest.mark.parametrize("name", ["rf_eo", "urban"])
@pytest.mark.slow
def test_a_single_run_has_no_interval_and_no_verdict(name, rf_eo_study, urban_study):
    played = {"rf_eo": rf_eo_study, "urban": urban_study}[name]
    one = {case: type(runs)(*(array[:1] for array in runs)) for case, runs in played.runs.items()}
    summary = {"rf_eo": rf_eo_numbers, "urban": urban_numbers}[name].summarise(replace(played, runs=one))
    rows = load(name).check_claims(summary)
    assert "undecided" in {row.verdict for row in rows if row.measured.ci is None and row.measured.value}
    assert not {"yes", "no"} & {row.verdict for row in rows if row.measured.ci is None and row.measured.value}
    text = f"{load(name).markdown(summary)}{claims.markdown(rows)}"
    assert "nan" not in text
    assert "None" not in text
