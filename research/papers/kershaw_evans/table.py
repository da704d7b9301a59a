"""The numbers of Kershaw and Evans's loop as tables."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from research.papers.cells import mean_cells, percent, ratio_cells, written
from research.papers.kershaw_evans.study import BEST
from wavegym.envs.describe import table

SCENE = ("scene", "q, m²/s³", "weights", "first range, km", "eta = 1 at, km", "best fixed pulse")
POLICIES = (
    "scene", "policy", "trace, m²", "95 %", "over the library's least", "95 %", "gate, m²/s", "95 %",
    "over the library's smallest", "95 %", "squared error over", "95 %", "NEES", "different pulses",
)  # fmt: skip
FORMS = ("scene", "gate's optimum inside the box, % of steps", "trace's duration inside the box, % of steps")
MOVING = (
    "scene", "targets", "policy", "duration, first fifth, us", "last fifth", "sweep, first fifth, MHz", "last fifth",
)  # fmt: skip


def markdown(summary: dict[str, Any]) -> str:
    """Scenes, policies, closed forms, closing and receding targets."""
    scenes = summary["scenes"]
    parts = [
        table(SCENE, [_scene(name, found) for name, found in scenes.items()]),
        f"Policies, targets as drawn\n\n{table(POLICIES, list(_policies(scenes)))}",
        f"Where the closed forms lie\n\n{table(FORMS, [_forms(name, found) for name, found in scenes.items()])}",
        f"Closing and receding targets\n\n{table(MOVING, list(_moving(scenes)))}",
    ]
    return "\n\n".join(parts)


def _scene(name: str, found: dict[str, Any]) -> tuple[str, ...]:
    weights = ", ".join(f"{weight:g}" for weight in found["weights"])
    low, high = (f"{end / 1e3:g}" for end in found["start_range"])
    return name, f"{found['q']:g}", weights, f"{low} to {high}", f"{found['reference_range'] / 1e3:g}", found["best"]


def _policies(scenes: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    for scene, of in scenes.items():
        for name, found in of["policies"].items():
            label = f"{name} ({of['best']})" if name == BEST else name
            yield (
                scene, label, *mean_cells(found["cost"]), *ratio_cells(found["cost_ratio"], 3),
                *mean_cells(found["gate"]), *ratio_cells(found["gate_ratio"], 3), *ratio_cells(found["error_ratio"]),
                written(found["nees"]["mean"], 2), written(found["waveforms"]["mean"], 1),
            )  # fmt: skip


def _forms(name: str, found: dict[str, Any]) -> tuple[str, ...]:
    forms = found["closed_forms"]
    return name, percent(forms["interior"]), percent(forms["trace_interior"])


def _moving(scenes: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    for scene, of in scenes.items():
        for targets, policies in of["moving"].items():
            for policy, found in policies.items():
                duration = [written(1e6 * found["duration"][end]["mean"], 1) for end in ("first", "last")]
                sweep = [written(1e-6 * found["sweep"][end]["mean"], 3) for end in ("first", "last")]
                yield scene, targets, policy, *duration, *sweep
