"""Policies under distribution shift: ``python -m agents.distribution_shift [ENVIRONMENT ...]``.

``results/distribution_shifts.toml`` lists the changed parameters. Agents and tuned constants stay those of the
original parameters; the tracker, and therefore prediction, knows the new ones. Results go to
results/distribution_shift, their table to docs/learned.md. ``--tables`` renews the table without playing.
"""

from __future__ import annotations

import json
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.leaderboard import PAGE, ROOT, Account, environment_of
from wavegym.core.command_line import Parser, guarded, settings
from wavegym.core.errors import InputError, check_choice
from wavegym.evaluation import blocks, compare, full_id, make_task
from wavegym.evaluation.files import write_whole
from wavegym.evaluation.saved import LEARNERS, SAVED
from wavegym.evaluation.table import interval, signed, tabulated
from wavegym.policies.runs import load_policy
from wavegym.schedulers.registry import make_policy
from wavegym.schedulers.tuned_constants import SIMPLE

FILE, FOLDER = ROOT / "results" / "distribution_shifts.toml", ROOT / "results" / "distribution_shift"
START, END = "<!-- made by `python -m agents.distribution_shift`: -->", "<!-- shifts to here -->"
WORLDS = 200


def load_shifts(file: Path = FILE) -> dict[str, dict[str, dict[str, Any]]]:
    """Changed parameters by environment and shift; InputError if the file is not valid."""
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8"))
        return {env: {name: settings(given) for name, given in shifts.items()} for env, shifts in table.items()}
    except (OSError, tomllib.TOMLDecodeError, AttributeError, TypeError) as error:
        raise InputError(f"{file} cannot be read: {error}") from None


def play(name: str, shifts: dict[str, dict[str, Any]], jobs: int) -> dict[str, Any]:
    """Under every shift: costs against the best simple heuristic, in per cent with intervals, and the filter's NEES."""
    env_id = full_id(f"{name}-v0")
    original = make_task(env_id, {}).system
    heuristic = make_policy(SIMPLE, original, None)
    agents = {}
    for algo in LEARNERS:
        folder = SAVED / name / algo
        if folder.is_dir():
            own = environment_of(folder)
            agents[algo] = own, load_policy(folder, env_id, make_task(env_id, own).system)
    found: dict[str, Any] = {}
    for shift, parameters in shifts.items():
        accounts = _accounts(env_id, SIMPLE, heuristic, parameters, jobs)
        for algo, (own, runs) in agents.items():
            accounts[algo] = _accounts(env_id, algo, runs, {**own, **parameters}, jobs)[algo]
        found[shift] = _against_simple(accounts)
    return found


def _accounts(env_id: str, name: str, policy: Any, parameters: dict[str, Any], jobs: int) -> dict[str, Account]:
    """Costs and NEES of a policy and of the one-step scheduler in the changed environment."""
    comparison = compare(env_id, {name: policy}, worlds=WORLDS, jobs=jobs, **parameters)
    return {
        name: Account(comparison.cost(name), np.stack([member.nees for member in members]))
        for name, members in comparison.played.items()
    }


def _against_simple(accounts: dict[str, Account]) -> dict[str, Any]:
    rows = {}
    for name, account in accounts.items():
        estimate = account.against(accounts[SIMPLE])
        rows[name] = {"percent": estimate.value, "ci": estimate.ci, "nees": account.median_nees()}
    return rows


def table(results: dict[str, dict[str, Any]]) -> str:
    """A line for each environment and shift."""
    head = ["environment", "shift", "NEES", "myopic", "PPO", "95 %", "DQN", "95 %"]
    rows = []
    for env, shifts in results.items():
        for shift, policies in shifts.items():
            nees = policies[SIMPLE]["nees"]
            cells = [env, shift, "" if nees is None else f"{nees:.2f}", signed(policies["myopic"]["percent"])]
            for algo in LEARNERS:
                row = policies.get(algo)
                cells += [signed(row["percent"]), interval(row["ci"], signed)] if row else ["", ""]
            rows.append(cells)
    return tabulated(head, rows)


def renew(names: Sequence[str]) -> None:
    """Renew the table in docs/learned.md from all results."""
    files = [FOLDER / f"{name}.json" for name in names]
    results = {f.stem: json.loads(f.read_text(encoding="utf-8")) for f in files if f.exists()}
    blocks.renew(PAGE, START, END, table(results))


def main() -> None:
    """The command."""
    parser = Parser(prog="python -m agents.distribution_shift", description="Policies under distribution shift.")
    parser.add_argument(
        "names", nargs="*", metavar="ENVIRONMENT", help="names in results/distribution_shifts.toml (default: all)"
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--tables", action="store_true", help="renew the table from earlier results; play nothing")
    read = parser.read(None)
    shifts = load_shifts()
    for name in () if read.tables else read.names or shifts:
        found = play(check_choice("environment", name, shifts), shifts[name], read.jobs)
        write_whole(FOLDER, {f"{name}.json": (json.dumps(found, indent=2) + "\n").encode()})
    renew(list(shifts))


if __name__ == "__main__":
    sys.exit(guarded(main))
