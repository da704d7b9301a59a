"""The tutorial is a notebook: it runs from its first cell to its last, and what its text claims is so."""

from __future__ import annotations

import json
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

TUTORIAL = nbformat.read(Path(__file__).parents[1] / "docs" / "tutorial.ipynb", as_version=4)
SUMMARIES = """
import json
from wavegym.evaluation import summarise
print(json.dumps([summarise(found)["policies"] for found in (comparison, wrong)]))
"""


def below_0(interval):
    return max(interval) < 0


def test_the_committed_outputs_are_of_one_run():
    counts = [cell.execution_count for cell in TUTORIAL.cells if cell.cell_type == "code"]
    assert counts == list(range(1, len(counts) + 1))
    assert "agent" in str([cell.get("outputs") for cell in TUTORIAL.cells])


@pytest.mark.release
def test_the_agent_of_the_tutorial_does_what_the_text_says(tmp_path):
    notebook = nbformat.from_dict({**TUTORIAL, "cells": [*TUTORIAL.cells, nbformat.v4.new_code_cell(SUMMARIES)]})
    NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    known, unknown = json.loads(notebook.cells[-1].outputs[-1].text)
    for policy in ("agent", "lookahead:2"):
        assert below_0(known[policy]["vs_myopic"]["ci"])
        assert below_0(known[policy]["truth"]["percent_ci"])
        assert below_0(unknown[policy]["vs_myopic"]["ci"])
        assert not below_0(unknown[policy]["truth"]["percent_ci"])
        assert unknown[policy]["nees"]["flag"] == "high"
    assert unknown["agent"]["truth"]["percent_ci"][0] > 0
    assert (tmp_path / "out" / "agent" / "report.html").exists()
    assert (tmp_path / "out" / "mine.zip").exists()
