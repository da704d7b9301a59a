"""The board of a release: ``python -m agents.board``.

Each release of the suite has a root of its own, which ``--release`` draws: nobody could train or tune on its worlds.
``--play`` plays the suite's own agents as submissions; those of others are played with ``wavegym submit FOLDER --seed
ROOT --out results/board/RELEASE``. All records of the latest release make the tables and the picture of docs/board.md.
"""

from __future__ import annotations

import json
import secrets
import sys
from pathlib import Path
from typing import Any

from agents.leaderboard import ROOT, environment_of, saved
from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import InputError
from wavegym.core.version import VERSION
from wavegym.evaluation import blocks, board
from wavegym.evaluation.files import write_whole
from wavegym.evaluation.saved import LEARNERS
from wavegym.evaluation.submission import SETTINGS, Entry, Submission, play_submission, read_record, suite
from wavegym.policies.records import read_run
from wavegym.policies.runs import RUN

FOLDER, PAGE, PICTURE = ROOT / "results" / "board", ROOT / "docs" / "board.md", ROOT / "docs" / "images" / "board.png"
RELEASE = "release.json"  # version, root and worlds
START, END = "<!-- made by `python -m agents.board`: -->", "<!-- board to here -->"
WORLDS = 100


def release() -> None:
    """Draw the root of this version. Raises an InputError if it has one: then its worlds are known."""
    folder = FOLDER / VERSION
    if (folder / RELEASE).exists():
        raise InputError(f"{folder} has a root already, expected a new version of the package")
    about = {"version": VERSION, "root": secrets.randbelow(2**31), "worlds": WORLDS}
    write_whole(folder, {RELEASE: (json.dumps(about, indent=1) + "\n").encode()})


def latest() -> tuple[Path, dict[str, Any]]:
    """The folder of the latest release, and its root and worlds."""
    folders = [file.parent for file in FOLDER.glob(f"*/{RELEASE}")]
    if not folders:
        raise InputError(f"{FOLDER} has no release, expected one (nearest: python -m agents.board --release)")
    folder = max(folders, key=lambda found: [int(part) for part in found.name.split(".")])
    return folder, json.loads((folder / RELEASE).read_text(encoding="utf-8"))


def own(algo: str) -> Submission:
    """The first training seed of the suite's agents of one algorithm, where the board admits their actions."""
    entries = {}
    for env_id in suite():
        folder = saved(env_id).get(algo)
        if folder is None or set(environment_of(folder)) - set(SETTINGS):
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
        f"Release {about['version']}, {about['worlds']} worlds of the root {about['root']}.",
        board.scores(records),
    ]
    parts += [f"### {record['name']}\n\n{board.table(record)}" for record in records]
    blocks.renew(PAGE, START, END, "\n\n".join(parts))
    write_whole(PICTURE.parent, {PICTURE.name: board.picture(records)})


def main() -> None:
    """The command."""
    parser = Parser(prog="python -m agents.board", description="The board of a release.")
    parser.add_argument("--release", action="store_true", help="draw the root of this version first")
    parser.add_argument("--play", action="store_true", help="play the suite's own agents")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    read = parser.read(None)
    if read.release:
        release()
    folder, about = latest()
    for algo in LEARNERS if read.play else ():
        given = {"root": about["root"], "worlds": about["worlds"], "jobs": read.jobs}
        for env_id in play_submission(own(algo), folder, **given):
            print(algo, env_id, flush=True)
    renew()


if __name__ == "__main__":
    sys.exit(guarded(main))
