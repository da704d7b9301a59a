"""Policies in worlds that they were not made for: ``python -m agents.distribution_shift [ENVIRONMENT ...]``.

``results/distribution_shifts.toml`` says what changes. Agents stay as they were trained, rules keep the constants
that were tuned for the environment's own parameters; the tracker, and so prediction, knows the new ones. Results go
to results/distribution_shift, their table to docs/learned.md; ``--tables`` makes it of what was played before.
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
    """Parameters by environment and shift; InputError where the file is no such thing."""
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8"))
        return {env: {name: settings(given) for name, given in shifts.items()} for env, shifts in table.items()}
    except (OSError, tomllib.TOMLDecodeError, AttributeError, TypeError) as error:
        raise InputError(f"{file} cannot be read: {error}") from None


def play(name: str, shifts: dict[str, dict[str, Any]], jobs: int) -> dict[str, Any]:
    """Costs against the best simple rule's under every shift, in per cent with intervals; and the filter's NEES."""
    env_id = full_id(f"{name}-v0")
    made_for = make_task(env_id, {}).system
    rule = make_policy(SIMPLE, made_for, None)
    agents = {}
    for algo in LEARNERS:
        folder = SAVED / name / algo
        if folder.is_dir():
            own = environment_of(folder)
            agents[algo] = own, load_policy(folder, env_id, make_task(env_id, own).system)
    found: dict[str, Any] = {}
    for shift, parameters in shifts.items():
        accounts = _accounts(env_id, SIMPLE, rule, parameters, jobs)
        for algo, (own, runs) in agents.items():
            accounts[algo] = _accounts(env_id, algo, runs, {**own, **parameters}, jobs)[algo]
        found[shift] = _against_simple(accounts)
    return found


def _accounts(env_id: str, name: str, policy: Any, parameters: dict[str, Any], jobs: int) -> dict[str, Account]:
    """What a policy, and the one-step scheduler, did in the changed environment."""
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
    """A line for every environment and shift."""
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
    """The table in docs/learned.md, of all that was played."""
    files = [FOLDER / f"{name}.json" for name in names]
    results = {f.stem: json.loads(f.read_text(encoding="utf-8")) for f in files if f.exists()}
    blocks.renew(PAGE, START, END, table(results))


def main() -> None:
    """The command."""
    parser = Parser(
        prog="python -m agents.distribution_shift", description="Policies in worlds that they were not made for."
    )
    parser.add_argument(
        "names", nargs="*", metavar="ENVIRONMENT", help="as results/distribution_shifts.toml has them (default: all)"
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--tables", action="store_true", help="of what was played before; play nothing")
    read = parser.read(None)
    shifts = load_shifts()
    for name in () if read.tables else read.names or shifts:
        found = play(check_choice("environment", name, shifts), shifts[name], read.jobs)
        write_whole(FOLDER, {f"{name}.json": (json.dumps(found, indent=2) + "\n").encode()})
    renew(list(shifts))


if __name__ == "__main__":
    sys.exit(guarded(main))
