"""Rules, a planner and agents over the difficulty of an environment: ``python -m agents.grades [NAME ...]``.

A registration record names the parameter that sets the difficulty, and its values. At each value the heuristics are
tuned anew, and PPO learns from rewards alone, from the teacher alone, and from both; at the default value these are the
agents of results/experiments.toml. ``--stages`` names the agents that are trained where they are missing. Costs go to
results/grades, the tables and the picture to docs/grades.md. ``--tables`` renews the page without playing.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from agents import blocks
from agents.experiment import Experiment, load_experiments, run_folder, train_missing
from agents.leaderboard import ROOT
from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import check_choice
from wavegym.core.files import write_whole
from wavegym.evaluation import compare, make_task
from wavegym.evaluation.comparison import Comparison
from wavegym.evaluation.picture import as_png
from wavegym.evaluation.summary import named
from wavegym.evaluation.table import interval, signed, tabulated
from wavegym.policies.runs import RUN
from wavegym.registration import SYSTEMS, full_id, stem
from wavegym.schedulers.tuned_constants import BASE, PLANNER, SIMPLE, recorded

ALONE = "ppo-imitation"
STAGES = {"ppo-scratch": "rewards alone", ALONE: "teacher alone", "ppo": "both"}
GRADED = {stem(env_id): next(iter(record.grades.items())) for env_id, record in SYSTEMS.items() if record.grades}
FOLDER, PAGE = ROOT / "results" / "grades", ROOT / "docs" / "grades.md"
PICTURE = ROOT / "docs" / "images" / "grades.png"
START, END = "<!-- made by `python -m agents.grades`: -->", "<!-- grades to here -->"
WORLDS, SEED = 200, 2  # of the test
UNPLANNED = ("EnergyBudgetKnown",)  # a decision of its best planner takes 0.15 s, and at the default it gains nothing
STEPS = 1_000_000  # of a training at another difficulty than the default


def default_of(name: str) -> Any:
    """The value of the difficulty in the registered environment."""
    return getattr(make_task(full_id(name), {}).system, GRADED[name][0])


def folder_of(name: str, label: str, value: Any) -> Path:
    """The runs of an agent at one difficulty."""
    parameter = GRADED[name][0]
    return run_folder(name, label if value == default_of(name) else f"{label}-{parameter}-{value:g}")


def train(name: str, stages: Sequence[str], jobs: int) -> None:
    """Train the agents that are missing; those of other than the default difficulty with one seed."""
    parameter, values = GRADED[name]
    known = load_experiments()[name]
    scaled = "reward=scaled"  # a reward relative to a heuristic needs its constants, which are of the default
    own = {
        folder_of(name, label, value).name: dataclasses.replace(
            known.agents[label],
            settings=(*known.agents[label].settings, scaled, *(() if label == ALONE else (f"steps={STEPS}",))),
            parameters=(f"{parameter}={value:g}",),
            seeds=(0,),
        )
        for label in stages
        for value in values
        if value != default_of(name)
    }
    train_missing(name, Experiment(known.env, agents=own), jobs)


def play(name: str, jobs: int) -> None:
    """Play every policy at every difficulty; its costs go to results/grades."""
    parameter, values = GRADED[name]
    record = recorded(make_task(full_id(name), {}).system)
    planner = f"{record[PLANNER]}@{record.get(BASE, record[SIMPLE])}"
    for value in values:
        policies: dict[str, Any] = dict.fromkeys(["myopic", SIMPLE, *(() if name in UNPLANNED else (planner,))])
        policies |= {
            label: folder for label in STAGES if any((folder := folder_of(name, label, value)).glob(f"*/{RUN}"))
        }
        common: dict[str, Any] = {"worlds": WORLDS, "seed": SEED, "jobs": jobs, "progress": False}
        found = compare(full_id(name), policies, **common, **{parameter: value})
        blocks.add_result(FOLDER / f"{name}.json", f"{value:g}", _figures(found, planner))


def _figures(found: Comparison, planner: str) -> dict[str, Any]:
    """Each policy against the best heuristic, by belief and by truth."""
    return {
        PLANNER if name == planner else name: {
            by: named("percent", "ci", found.against(name, SIMPLE, by=by)) for by in ("belief", "truth")
        }
        for name in found.played
        if name != SIMPLE
    }


def table(name: str, figures: Mapping[str, Any], by: str) -> str:
    """A line for each difficulty."""
    shown = {"myopic": "myopic", PLANNER: "best planner", **STAGES}
    rows = []
    for value, policies in figures.items():
        cells = [value]
        for label in shown:
            found = policies.get(label, {}).get(by)
            cells += [signed(found["percent"]), interval(found["ci"], signed)] if found else ["", ""]
        rows.append(cells)
    return tabulated([GRADED[name][0], *(head for label in shown.values() for head in (label, "95 %"))], rows)


def picture(results: Mapping[str, Mapping[str, Any]]) -> bytes:
    """The costs against the best heuristic over the difficulty, as PNG; myopic is far above."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.6 * len(results), 3.4), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, (name, figures) in zip(figure.subplots(1, len(results), squeeze=False)[0], results.items(), strict=True):
        for label, shown in {PLANNER: "best planner", **STAGES}.items():
            found = {value: each[label]["belief"] for value, each in figures.items() if label in each}
            if found:
                middle = [each["percent"] for each in found.values()]
                ends = [[abs(each["ci"][side] - each["percent"]) for each in found.values()] for side in (0, 1)]
                axes.errorbar([*found], middle, ends, marker="o", capsize=3, label=shown)
        axes.axhline(0.0, color="0.6", linewidth=0.8, zorder=0)
        axes.set(title=name, xlabel=GRADED[name][0])
    figure.axes[0].set_ylabel("cost against the best heuristic [%]")
    figure.axes[0].legend(fontsize="small")
    return as_png(figure)


def renew() -> None:
    """Renew the page and the picture."""
    results = {name: found for name in GRADED if (found := blocks.read_results(FOLDER / f"{name}.json"))}
    parts = [
        f"### {name}\n\n{blocks.both(table(name, found, 'belief'), table(name, found, 'truth'))}"
        for name, found in results.items()
    ]
    blocks.renew(PAGE, START, END, "\n\n".join(parts))
    write_whole(PICTURE.parent, {PICTURE.name: picture(results)})


def main() -> None:
    """The command."""
    parser = Parser(prog="python -m agents.grades", description="Policies over the difficulty of an environment.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of environments (default: {' '.join(GRADED)})")
    parser.add_argument("--stages", nargs="*", default=[*STAGES], metavar="AGENT", help="trained where missing")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--tables", action="store_true", help="renew the page from earlier results; play nothing")
    read = parser.read(None)
    for name in () if read.tables else read.names or GRADED:
        check_choice("environment", name, GRADED)
        train(name, [check_choice("agent", label, STAGES) for label in read.stages], read.jobs)
        play(name, read.jobs)
    renew()


if __name__ == "__main__":
    sys.exit(guarded(main))
