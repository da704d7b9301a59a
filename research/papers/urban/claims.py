"""The claims of Barbosa et al., and our own, checked with the summary."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from research.papers.claims import Claim, Limit, claim, decrease_of, increase_of, mean_of, percent_of, ratio_of
from research.papers.urban.motion_models import LIMIT, ON, SPEEDING, TURN
from research.papers.urban.numbers import figures_of, phase_of
from research.papers.urban.study import CLOSED, MYOPIC, NCV, NCV1, SETTINGS, TURNS, VSIMM

BETTER = (0.0, float("inf"))
MORE_TRACKS, LESS_ERROR = Limit(10.0, 15.0, BETTER), Limit(55.0, 65.0, BETTER)  # percent; the paper: 15 and 60
GAIN, FALSE, KNOWN = Limit(low=0.0), Limit(high=0.3), Limit(low=LIMIT)
KEEPS, ALWAYS = Limit(low=99.0), Limit(low=99.0)  # percent
MORE, LESS, ALIKE, NO_WORSE = Limit(low=1.0), Limit(high=1.0), Limit(0.95, 1.05), Limit(high=1.05)
MODELS_ALONE, SCHEDULER_ALONE, ONE_MODEL = (VSIMM, TURNS), (NCV, MYOPIC), (NCV1, TURNS)


def check_claims(summary: dict[str, Any]) -> list[Claim]:
    """The claims of the paper, then our own; all with ghost logic."""
    parts = (_headline, _models, _false_tracks, _emergent, _others)
    rows = [row for part in parts for setting in SETTINGS for row in part(summary, setting)]
    return rows + list(_starts(summary))


def _headline(summary: dict[str, Any], setting: str) -> Iterator[Claim]:
    over = figures_of(summary, setting, CLOSED)["over_open"]
    text = "The closed loop confirms more tracks than the open loop: %"
    yield claim(text, setting, increase_of(ratio_of(over["confirmed"])), MORE_TRACKS, "about 15", 1)
    text = "The closed loop has less RMS error than the open loop: %"
    yield claim(text, setting, decrease_of(ratio_of(over["rmse"])), LESS_ERROR, "about 60", 1)


def _models(summary: dict[str, Any], setting: str) -> Iterator[Claim]:
    """Model probabilities of target 1 in the closed loop."""
    for phase in (TURN, SPEEDING, ON):
        found = phase_of(summary, setting, phase)
        model = found["expected"]
        text = f"{model} is known, {phase}: mean probability, "
        yield claim(f"{text}lowest scan", setting, mean_of(found["least"]), KNOWN, "known")
        yield claim(f"{text}all scans", setting, mean_of(found["mean"][model]), KNOWN, "known")


def _false_tracks(summary: dict[str, Any], setting: str) -> Iterator[Claim]:
    false = figures_of(summary, setting, CLOSED)["false_tracks"]
    yield claim("The closed loop has few false tracks: number in a run", setting, mean_of(false), FALSE)
    ghosts = summary["settings"][setting]["ghosts_over_none"]["closed"]
    text = "Ghost logic reduces the false tracks of the closed loop: ratio"
    yield claim(text, setting, ratio_of(ghosts["false_tracks"]), LESS)
    text = "Ghost logic keeps the held targets of the closed loop: %"
    yield claim(text, setting, percent_of(ratio_of(ghosts["held"])), KEEPS, digits=1)


def _emergent(summary: dict[str, Any], setting: str) -> Iterator[Claim]:
    """Each half of the closed loop without the other, against the open loop."""
    models, scheduler = (figures_of(summary, setting, loop)["over_open"] for loop in (MODELS_ALONE, SCHEDULER_ALONE))
    for key, gain_of, words in (
        ("confirmed", increase_of, "confirm more tracks than the open loop: %"),
        ("rmse", decrease_of, "reduce the RMS error of the open loop: %"),
    ):
        alone = gain_of(ratio_of(scheduler[key]))
        gain = gain_of(ratio_of(models[key]))
        yield claim(f"The four models alone {words}", setting, gain, GAIN, digits=1)
        yield claim(f"The scheduler alone can {words}", setting, alone, GAIN, digits=1)
        if alone.ci is not None:
            text = "The gain is emergent: the four models alone gain no more than the scheduler alone, %"
            yield claim(text, f"{setting}, {key}", gain, Limit(high=alone.ci[1]), "emergent", 1)


def _others(summary: dict[str, Any], setting: str) -> Iterator[Claim]:
    """Questions that the paper does not ask."""
    one, models = (figures_of(summary, setting, loop)["over_closed"] for loop in (ONE_MODEL, MODELS_ALONE))
    text = "One NCV model of 1 m/s² in an open loop has no larger error than the closed loop: ratio"
    yield claim(text, setting, ratio_of(one["rmse"]), NO_WORSE)
    text = "One NCV model of 1 m/s² in an open loop confirms as many tracks as the closed loop: ratio"
    yield claim(text, setting, ratio_of(one["confirmed"]), ALIKE)
    text = "With the four models, round robin has more RMS error than myopic: ratio"
    yield claim(text, setting, ratio_of(models["rmse"]), MORE)
    closed = figures_of(summary, setting, CLOSED)
    text = "Myopic sends the long pulse whenever it has a track: % of scans"
    yield claim(text, setting, percent_of(mean_of(closed["long"])), ALWAYS, digits=1)
    text = "The closed loop holds its targets for more scans than the open loop: ratio"
    yield claim(text, setting, ratio_of(closed["over_open"]["held"]), MORE)


def _starts(summary: dict[str, Any]) -> Iterator[Claim]:
    """The strictest limit for new tracks against the loosest one."""
    strictest, *_, loosest = (increase_of(ratio_of(of["over_open"]["confirmed"])) for of in summary["starts"])
    if loosest.ci is not None:
        text = "The gain in confirmed tracks is larger with strict starts: %, against the interval of the loosest start"
        yield claim(text, "strictest start", strictest, Limit(low=loosest.ci[1]), digits=1)
