"""The figures of Kershaw and Evans's loop as files: CSV, PNG and summary.json."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from research.papers.contents import csv_bytes, json_bytes
from research.papers.kershaw_evans.closed_forms import surface
from research.papers.kershaw_evans.numbers import curve, summarise
from research.papers.kershaw_evans.pictures import SHOWN, TARGET_LINES, Curves, draw_costs, draw_pulses, draw_surfaces
from research.papers.kershaw_evans.study import DRAWN, GATE, SCENES, TRACE, Case, Study, system
from wavegym.core.files import write_whole

FIGURE1 = ("scene", "objective", "duration", "sweep", "value")
FIGURE2 = ("scene", "targets", "policy", "field", "k", "mean", "low", "high")
FIGURE3 = ("scene", "policy", "field", "k", "mean", "low", "high")
FILES = (*(f"figure{n}.csv" for n in (1, 2, 3)), *(f"figure{n}.png" for n in (1, 2, 3)), "summary.json")
EVERY = 10  # points of the surface between those in figure1.csv


def write(study: Study, folder: Path) -> dict[str, Any]:
    """Write ``FILES``, all or none, and return the summary.

    Raises:
        OSError: the folder cannot be written or the disk is full; earlier files are then as they were.
    """
    moving = [Case(scene, targets, policy) for scene in SCENES for targets in TARGET_LINES for policy in (TRACE, GATE)]
    pulses: Curves = {(case, field): curve(study, case, field) for case in moving for field in ("duration", "sweep")}
    drawn = [Case(scene, DRAWN, policy) for scene in SCENES for policy in SHOWN]
    costs: Curves = {(case, field): curve(study, case, field) for case in drawn for field in ("cost", "gate")}
    summary = summarise(study)
    contents = (
        csv_bytes(FIGURE1, _surfaces(study)),
        csv_bytes(FIGURE2, ((*case, field, *row) for (case, field), e in pulses.items() for row in _rows(e))),
        csv_bytes(
            FIGURE3,
            ((case.scene, case.policy, field, *row) for (case, field), e in costs.items() for row in _rows(e)),
        ),
        draw_surfaces(study),
        draw_pulses(study, pulses),
        draw_costs(study, costs),
        json_bytes(summary),
    )
    write_whole(folder, dict(zip(FILES, contents, strict=True)))
    return summary


def _surfaces(study: Study) -> Iterable[Sequence[Any]]:
    """Rows of figure1.csv, in s, Hz and m^2 (trace) or m^2/s (gate): every tenth duration and sweep."""
    for scene in SCENES:
        loop = system(Case(scene, DRAWN, TRACE))
        for policy, field in ((TRACE, "trace"), (GATE, "gate")):
            runs = study.of(scene, policy)
            k = runs.cost.shape[1] // 2
            found = surface(loop, runs.predicted[0, k], float(runs.eta[0, k]))
            for i in range(0, len(found.duration), EVERY):
                for j in range(0, len(found.sweep), EVERY):
                    value = getattr(found, field)[i, j]
                    yield scene, field, _short(found.duration[i]), _short(found.sweep[j]), _short(value)


def _rows(estimates: Sequence[Any]) -> Iterable[Sequence[Any]]:
    """Step, mean and interval."""
    for k, (value, ci) in enumerate(estimates, 1):
        yield k, _short(value), *map(_short, ci or ("", ""))


def _short(value: Any) -> str:
    """Six figures."""
    return "" if value is None or value == "" else f"{value:.6g}"
