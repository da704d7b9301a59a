"""What is said of the RF/EO platforms follows the numbers."""

from __future__ import annotations

import copy

import pytest
from rf_eo_runs import RUNS

from wavegym.reproduce.rf_eo import ADAPTIVE, CONSTANT, FAR, INFORMATION, PROPOSED, PUBLISHED, Runs, Study
from wavegym.reproduce.rf_eo_findings import findings
from wavegym.reproduce.rf_eo_numbers import summarise
from wavegym.reproduce.rf_eo_table import markdown


def headings(text):
    """Of each bullet's title the heading it is under."""
    found, heading = {}, ""
    for line in text.splitlines():
        if line.startswith("### "):
            heading = line[4:]
        elif line.startswith("- **"):
            found[line[4:].partition("**")[0].rstrip(".")] = heading
    return found


def under(summary, words):
    (heading,) = {heading for title, heading in headings(findings(summary)).items() if title.startswith(words)}
    return heading


def changed(summary, scene, policy, key, value):
    other = copy.deepcopy(summary)
    other["scenes"][scene]["policies"][policy][key] = value
    return other


def of_ratio(low, high):
    return {"ratio": (low + high) / 2, "ci": [low, high], "geometric": low, "geometric_ci": [low, high], "runs": RUNS}


@pytest.mark.parametrize(
    ("ci", "words", "heading"),
    [
        ((11.0, 20.0), "At least an order", "What is reproduced"),
        ((8.0, 20.0), "About an order", "What is reproduced only in part"),
        ((2.0, 9.0), "Less than an order", "What is not"),
    ],
)
def test_the_order_of_magnitude_holds_only_if_its_interval_says_so(platforms_summary, ci, words, heading):
    assert under(changed(platforms_summary, PUBLISHED, PROPOSED, "late_over_myopic", of_ratio(*ci)), words) == heading


def test_jumps_decide_what_is_said_of_the_prf(platforms_summary):
    often, never = {"mean": 0.4, "ci": [0.3, 0.5]}, {"mean": 0.0, "ci": [0.0, 0.17]}
    cases = [
        (FAR, often, often, "The PRF alternates before far targets with either", "What is reproduced"),
        (FAR, never, often, "The PRF alternates before far targets with one", "What is reproduced only in part"),
        (FAR, never, never, "The PRF does not alternate before far", "What is not"),
        (PUBLISHED, never, never, "The PRF never jumps in the published", "What is not"),
        (PUBLISHED, often, often, "The PRF alternates in the published", "What is reproduced"),
    ]
    for scene, trace, information, words, heading in cases:
        other = changed(platforms_summary, scene, ADAPTIVE, "jumps", [trace, trace])
        other = changed(other, scene, INFORMATION, "jumps", [information, information])
        assert under(other, words) == heading


def test_the_headline_is_against_the_tuned_constant(platforms_summary):
    for ci, words in (
        ((1.2, 1.6), "Adapting pays"),
        ((0.9, 1.6), "Whether adapting pays"),
        ((0.5, 0.8), "Adapting costs"),
    ):
        other = changed(platforms_summary, FAR, CONSTANT, "over_myopic", of_ratio(*ci))
        assert (
            under(other, f"{words}{' cannot be told' * ('Whether' in words)}, far")
            == "Adaptive against the tuned constant"
        )


def test_a_single_run_has_no_interval_and_is_told_all_the_same(platforms_study):
    one = {case: Runs(*(array[:1] for array in runs)) for case, runs in platforms_study.runs.items()}
    summary = summarise(Study(platforms_study.root, one, platforms_study.tuned))
    assert summary["scenes"][PUBLISHED]["policies"][ADAPTIVE]["cost"]["ci"] is None
    text = f"{findings(summary)}{markdown(summary)}"
    assert "nan" not in text
    assert "None" not in text
