"""What is said of the RF/EO platforms follows the numbers."""

from __future__ import annotations

import copy

import pytest
from rf_eo_runs import RUNS
from told import heading_of

from papers.rf_eo.study import ADAPTIVE, CONSTANT, FAR, INFORMATION, PROPOSED, PUBLISHED, Runs, Study
from papers.rf_eo.claims import findings
from papers.rf_eo.numbers import summarise
from papers.rf_eo.table import markdown


def under(summary, words):
    return heading_of(findings(summary), words)


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


def of_share(value, low, high):
    return {"mean": value, "ci": [low, high], "platforms": [{"mean": value, "ci": [low, high]}] * 2}


OFTEN, PERHAPS, NEVER = of_share(0.4, 0.3, 0.5), of_share(0.12, 0.08, 0.16), of_share(0.0, 0.0, 0.17)


@pytest.mark.parametrize(("scene", "where"), [(PUBLISHED, "In the published scene"), (FAR, "Before far targets")])
@pytest.mark.parametrize(
    ("trace", "information", "words", "heading"),
    [
        (OFTEN, OFTEN, "alternates with either objective", "What is reproduced"),
        (NEVER, OFTEN, "alternates with one objective only", "What is reproduced only in part"),
        (PERHAPS, NEVER, "may alternate", "What is reproduced only in part"),
        (of_share(0.02, 0.01, 0.03), NEVER, "hardly ever jumps", "What is not"),
        (NEVER, NEVER, "never jumps", "What is not"),
    ],
)
def test_jumps_decide_what_is_said_of_the_prf(platforms_summary, scene, where, trace, information, words, heading):
    other = changed(platforms_summary, scene, ADAPTIVE, "jumps", trace)
    other = changed(other, scene, INFORMATION, "jumps", information)
    assert under(other, f"{where} the PRF {words}") == heading


def test_single_platforms_do_not_decide(platforms_summary):
    """One below a tenth and one above, both together above."""
    ends = [{"mean": 0.09, "ci": [0.08, 0.1]}, {"mean": 0.14, "ci": [0.13, 0.15]}]
    both = {"mean": 0.115, "ci": [0.105, 0.125], "platforms": ends}
    other = changed(platforms_summary, FAR, ADAPTIVE, "jumps", both)
    other = changed(other, FAR, INFORMATION, "jumps", OFTEN)
    assert under(other, "Before far targets the PRF alternates with either") == "What is reproduced"
    text = " ".join(findings(other).split())
    assert "9.0 % (8.0 to 10.0) at platform 1" in text
    assert "of each platform by itself it does with the paper's objective." in text


@pytest.mark.parametrize(
    ("ends", "words"), [((0.1, 0.1), "gains in both"), ((0.1, -0.1), "gains in one"), ((-0.1, -0.1), "gains nothing")]
)
def test_the_deepest_lookahead_is_the_judge(platforms_summary, ends, words):
    """Whatever the others gain."""
    other = copy.deepcopy(platforms_summary)
    for scene, end in zip((PUBLISHED, FAR), ends, strict=True):
        for depth, gain in other["scenes"][scene]["lookahead"].items():
            gain["percent"], gain["ci"] = 2.0, [end if depth == "10" else 1.0, 3.0]
    assert under(other, f"Lookahead {words}") == "What the paper does not ask"


def test_what_cannot_fail_is_not_called_reproduced(platforms_summary):
    assert under(platforms_summary, "The bandwidth never changes") == "What holds by construction"


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
