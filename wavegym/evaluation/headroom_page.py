"""The page "How much is there to gain": ``python -m wavegym.evaluation.headroom_page RESULTS PAGE``."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

from wavegym.core.command_line import guarded
from wavegym.core.errors import InputError
from wavegym.evaluation import blocks
from wavegym.evaluation.files import write_whole
from wavegym.evaluation.table import interval, number, signed, tabulated
from wavegym.registration import SYSTEMS
from wavegym.schedulers.tuned_constants import PLANNER, SIMPLE

START, END = "<!-- made by `make headroom`: -->", "<!-- to here -->"
STEPS = ("random", "best-fixed", "cycle", "myopic", "plan-once", "best-planner")  # of the overview


def block(results: list[dict[str, Any]]) -> str:
    """What stands between the markers: the overview, and each environment's ladder."""
    return "\n\n".join([overview(results), *(chapter(result) for result in results)])


def overview(results: list[dict[str, Any]]) -> str:
    """One line for each environment: how much each costs more or less than the best simple rule."""
    head = ["environment", "best simple heuristic", *STEPS[:-1], "best planner", "95 %"]
    rows = []
    for result in results:
        policies, prepared = result["policies"], result["tuned_constants"]
        cells = [_percent(policies.get(name)) for name in STEPS]
        ends = interval(policies[PLANNER]["vs_simple_ci"], signed)
        rows.append([_short(result), prepared.get(SIMPLE, SIMPLE), *cells, ends])
    return tabulated(head, rows)


def chapter(result: dict[str, Any]) -> str:
    """One environment's ladder, the dearest first."""
    prepared = result["tuned_constants"]
    names = {SIMPLE: prepared.get(SIMPLE), PLANNER: prepared.get(PLANNER)}
    rows = []
    for name, row in sorted(result["policies"].items(), key=lambda item: -item[1]["mean"]):
        label = f"**{name}**: {names[name]}" if names.get(name) else name
        rows.append(
            [
                label,
                number(row["mean"]),
                interval(row["ci"], number),
                _percent(row),
                interval(row["vs_simple_ci"], signed),
                f"{row['us_per_decision']:.1f}",
            ]
        )
    head = ["policy", "mean cost", "95 %", "vs best simple %", "95 %", "µs/decision"]
    title = f"## {_short(result)}: {result['worlds']} worlds of {result['horizon']} steps"
    return f"{title}\n\n{tabulated(head, rows)}{_recovered(result)}"


def _recovered(result: dict[str, Any]) -> str:
    """How much of the planner's gain a plan made once has, where there is one."""
    policies = result["policies"]
    if "plan-once" not in policies or policies[PLANNER]["vs_simple_ci"][1] >= 0:
        return ""
    once, best = (math.log1p(policies[name]["vs_simple_percent"] / 100.0) for name in ("plan-once", PLANNER))
    share = once / best
    if share <= 0.0:
        return "\n\nA plan made once recovers nothing of the planner's gain."
    return f"\n\nA plan made once recovers {100.0 * share:.0f} % of the planner's gain."


def _short(result: dict[str, Any]) -> str:
    return str(result["env"]).rpartition("/")[2]


def _percent(row: dict[str, Any] | None) -> str:
    return "" if row is None else signed(row["vs_simple_percent"])


def renewed(page: str, results: list[dict[str, Any]]) -> str:
    """The page with its block made afresh; InputError where it has none."""
    return blocks.renewed(page, START, END, block(results))


def main(arguments: list[str]) -> int:
    """The command; returns its exit status."""

    def renew() -> None:
        if len(arguments) != 2:
            raise InputError("expected two arguments: python -m wavegym.evaluation.headroom_page RESULTS PAGE")
        folder, page = (Path(argument) for argument in arguments)
        files = [folder / f"{env_id.rpartition('/')[2]}.json" for env_id in SYSTEMS]
        results = [json.loads(file.read_text(encoding="utf-8")) for file in files if file.exists()]
        write_whole(page.parent, {page.name: renewed(page.read_text(encoding="utf-8"), results).encode()})

    return guarded(renew)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
