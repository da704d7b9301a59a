"""The board of a release: ``python -m agents.board``.

Each release of the suite has its own seed, drawn with ``--release``, so that nobody could train or tune on its worlds.
``--play`` plays the suite's own agents as submissions. Other agents are played with ``wavegym submit FOLDER --seed SEED
--out results/board/RELEASE``. The tables and the picture of docs/board.md show all records of the latest release.
"""

from __future__ import annotations

import json
import secrets
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents import blocks
from agents.leaderboard import ROOT, environment_of, saved
from agents.suite_score import over_suite, profile, suite_score
from wavegym.core import VERSION
from wavegym.core.arrays import Array
from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import InputError
from wavegym.core.files import write_whole
from wavegym.evaluation.adapters import AGENTS
from wavegym.evaluation.picture import as_png
from wavegym.evaluation.submission import (
    PARAMETERS,
    Entry,
    Record,
    Submission,
    bootstrap,
    pair,
    play_submission,
    read_record,
    suite,
    table,
)
from wavegym.evaluation.table import estimated, interval, tabulated
from wavegym.policies.runs import RUN, read_run
from wavegym.registration import SYSTEMS

FOLDER, PAGE, PICTURE = ROOT / "results" / "board", ROOT / "docs" / "board.md", ROOT / "docs" / "images" / "board.png"
RELEASE = "release.json"  # version, seed and worlds
START, END = "<!-- made by `python -m agents.board`: -->", "<!-- board to here -->"
WORLDS = 100
FARTHEST = 50.0  # per cent, of the picture


def release() -> None:
    """Draw the seed of this version. Raises an InputError if it has one already, because then its worlds are known."""
    folder = FOLDER / VERSION
    if (folder / RELEASE).exists():
        raise InputError(f"{folder} has a seed already, expected a new version of the package")
    about = {"version": VERSION, "seed": secrets.randbelow(2**31), "worlds": WORLDS}
    write_whole(folder, {RELEASE: (json.dumps(about, indent=1) + "\n").encode()})


def latest() -> tuple[Path, dict[str, Any]]:
    """The folder of the latest release, and its seed and worlds."""
    folders = [file.parent for file in FOLDER.glob(f"*/{RELEASE}")]
    if not folders:
        raise InputError(f"{FOLDER} has no release, expected one (nearest: python -m agents.board --release)")
    folder = max(folders, key=lambda found: [int(part) for part in found.name.split(".")])
    return folder, json.loads((folder / RELEASE).read_text(encoding="utf-8"))


def own(algo: str) -> Submission:
    """The first training seed of the suite's agents of one algorithm, if the board admits their actions."""
    entries = {}
    for env_id in suite():
        folder = saved(env_id).get(algo)
        if folder is None or set(environment_of(folder)) - set(PARAMETERS):
            continue
        run = min(file.parent for file in folder.glob(f"*/{RUN}"))
        record = read_run(run / RUN)
        entries[env_id] = Entry(run, record["steps"], record.get("cpu_seconds"), environment_of(folder))
    return Submission(f"wavegym-{algo}", f"wavegym {VERSION}, results/runs, training seed 0", entries)


def renew() -> None:
    """Renew the page and the picture, if there is a record."""
    folder, about = latest()
    records = [read_record(file) for file in sorted(folder.glob("*.json")) if file.name != RELEASE]
    if not records:
        return
    parts = [
        f"Release {about['version']}, {about['worlds']} worlds of the seed {about['seed']}.",
        scores(records),
    ]
    parts += [f"### {record['name']}\n\n{table(record)}" for record in records]
    blocks.renew(PAGE, START, END, "\n\n".join(parts))
    write_whole(PICTURE.parent, {PICTURE.name: picture(records)})


def scores(records: Sequence[Record]) -> str:
    """A line for each submission over the benchmark tier, the cheapest first."""
    known, lines = benchmark(), list[tuple[float, list[str]]]()
    for record in records:
        found = suite_score(_logs(record), known, bootstrap(record))
        cells = [record["name"], f"{len(record['environments'].keys() & set(known))} of {len(known)}"]
        for estimate in (found.mean, found.interquartile):
            cells += estimated(estimate)
        ends = interval(found.improvement.ci, "{:.2f}".format)
        cells += [f"{found.improvement.value:.2f}", ends, record["code"]]
        lines.append((found.mean.value or 0.0, cells))
    head = ["submission", "plays", "geometric mean %", "95 %", "interquartile mean %", "95 %"]
    ordered = [cells for _, cells in sorted(lines, key=lambda line: line[0])]
    return tabulated([*head, "probability of improvement", "95 %", "code"], ordered)


def picture(records: Sequence[Record]) -> bytes:
    """Performance profiles as PNG: the share of worlds whose cost is at most a percentage above that of best-simple."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes, known = figure.subplots(), benchmark()
    percents = np.linspace(-FARTHEST, FARTHEST, 401)
    for record in records:
        axes.plot(percents, profile(over_suite(_logs(record), known), percents), label=record["name"])
    axes.axvline(0.0, color="0.8", linewidth=0.8, zorder=0)
    axes.set(xlabel="cost above that of the best heuristic [%]", ylabel="share of environments and worlds")
    axes.set(xlim=(-FARTHEST, FARTHEST), ylim=(0.0, 1.0))
    axes.legend(fontsize="small")
    return as_png(figure)


def benchmark() -> list[str]:
    """The environments that averages count."""
    return [env_id for env_id in suite() if SYSTEMS[env_id].tier == "benchmark"]


def _logs(record: Record) -> dict[str, Array]:
    """ln of the ratios of the costs, (world,), by environment."""
    pairs = {env_id: pair(found, "cost") for env_id, found in record["environments"].items()}
    return {env_id: np.log(own / simple)[0] for env_id, (own, simple) in pairs.items()}


def main() -> None:
    """The command."""
    parser = Parser(prog="python -m agents.board", description="The board of a release.")
    parser.add_argument("--release", action="store_true", help="draw the seed of this version first")
    parser.add_argument("--play", action="store_true", help="play the suite's own agents")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    read = parser.read(None)
    if read.release:
        release()
    folder, about = latest()
    for algo in AGENTS if read.play else ():
        given = {"seed": about["seed"], "worlds": about["worlds"], "jobs": read.jobs}
        for env_id in play_submission(own(algo), folder, **given):
            print(algo, env_id, flush=True)
    renew()


if __name__ == "__main__":
    sys.exit(guarded(main))
