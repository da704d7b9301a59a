"""Submissions to the board: policies in files that run no code, played on worlds of a seed drawn after they were made.

A submission is a folder with ``submission.toml`` and the files that it names::

    name = "mine"
    code = "https://example.org/mine, version 3"

    [policies.KershawEvansPosition-v0]
    file = "kershaw.onnx"      # or the folder of a run
    steps = 640_000            # of all its training, trials not counted
    cpu_seconds = 900.0        # of the same; leave it out if it is not known

    [policies.AgileClutter-v0]
    file = "agile.onnx"
    steps = 640_000
    parameters = { action = "joint" }
"""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import ConfigDict, NonNegativeFloat, NonNegativeInt, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from wavegym.core import VERSION
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_choice
from wavegym.core.files import write_whole
from wavegym.core.worlds import word
from wavegym.evaluation import statistics
from wavegym.evaluation.comparison import compare
from wavegym.evaluation.play import make_task
from wavegym.evaluation.summary import us_per_decision
from wavegym.evaluation.table import estimated, shared, signed, tabulated
from wavegym.registration import SYSTEMS, full_id
from wavegym.schedulers.tuned_constants import SIMPLE, recorded

FILE = "submission.toml"
PARAMETERS = ("action", "points")  # a submission may change the form of the actions, not the world or the tracker
DIGITS = 6  # of a cost
CLOSED = ConfigDict(extra="forbid")
FREE_ENERGY = 2.0  # longest pulses of one radar in a step: the most that two radars can spend

Record = Mapping[str, Any]  # of ``play_submission``


@dataclass(frozen=True, config=CLOSED)
class Entry:
    """A policy for one environment.

    Attributes:
        file: an ONNX file or the folder of a run, relative to the submission.
        steps: of its training.
        cpu_seconds: of its training; None: not known.
        parameters: of the environment's action set.
    """

    file: Path
    steps: NonNegativeInt
    cpu_seconds: NonNegativeFloat | None = None
    parameters: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, config=CLOSED)
class Submission:
    """What ``submission.toml`` says.

    Attributes:
        name: of the entrant; letters, digits, - and _.
        code: where the code of the training is, and which version.
        policies: by environment, with or without ``wavegym/``.
    """

    name: str
    code: str
    policies: dict[str, Entry]


class Bound(NamedTuple):
    """A way to play that costs at most as much as any policy of the environment, in the same world."""

    policy: str
    lifted: dict[str, Any]  # parameters that lift a limit


# With free energy the longest pulses of both radars are the best: they have the highest SNR and the finest range-rate.
BOUNDS = {
    "wavegym/KershawEvans-v0": Bound("optimum", {}),
    "wavegym/KershawEvansPosition-v0": Bound("optimum", {}),
    "wavegym/EnergyBudget-v0": Bound("fixed:9", {"budget": FREE_ENERGY}),
    "wavegym/EnergyBudgetKnown-v0": Bound("fixed:9", {"budget": FREE_ENERGY}),
}


def suite() -> list[str]:
    """The environments of the board: those of the suite that have a best heuristic on record."""
    return [env_id for env_id in SYSTEMS if SIMPLE in recorded(make_task(env_id, {}).system)]


def read_submission(folder: Path) -> Submission:
    """The submission in a folder, with full ids and whole paths.

    Raises:
        InputError: no or an invalid file, an environment that is not on the board, parameters that are not allowed, or
            a file that may hold code.
    """
    path = folder / FILE
    try:
        found = TypeAdapter(Submission).validate_python(tomllib.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None
    except (ValidationError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}") from None
    if not found.name.replace("-", "").replace("_", "").isalnum():
        raise InputError(f"{path}: name is {found.name!r}, expected letters, digits, - and _")
    if not found.policies:
        raise InputError(f"{path}: there is no policy, expected [policies.KershawEvansPosition-v0] or another id")
    known, policies = suite(), {}
    for name, entry in found.policies.items():
        env_id = check_choice(f"{path}: environment", full_id(name), known)
        for parameter in entry.parameters:
            check_choice(f"{path}: parameter of {name}", parameter, PARAMETERS)
        file = folder / entry.file
        if not (file.suffix == ".onnx" and file.is_file()) and not file.is_dir():
            raise InputError(f"{path}: file of {name} is {str(entry.file)!r}, expected an .onnx file or a run's folder")
        policies[env_id] = Entry(file, entry.steps, entry.cpu_seconds, entry.parameters)
    return Submission(found.name, found.code, policies)


def play_submission(
    submission: Submission, out: Path, *, seed: int, worlds: int, jobs: int = -1, progress: bool = True
) -> Iterator[str]:
    """Play every policy and the best heuristic; write ``out``/NAME.json after each environment; yield its id.

    What the file already has of the same policy, seed, worlds and version is not played again.

    Args:
        submission: what to play.
        out: folder of the record.
        seed: of the worlds.
        worlds: in each environment.
        jobs: processes; -1 = one for each core.
        progress: show a bar on a terminal.

    Raises:
        InputError: see ``compare``.
    """
    file = out / f"{submission.name}.json"
    about = {"name": submission.name, "code": submission.code, "version": VERSION, "seed": seed, "worlds": worlds}
    earlier = read_record(file) if file.exists() else {}
    same = all(earlier.get(key) == about[key] for key in ("version", "seed", "worlds"))
    kept = earlier.get("environments", {}) if same else {}
    played: dict[str, Any] = {}
    for env_id, entry in submission.policies.items():
        content, earlier = _sha256(entry.file), kept.get(env_id, {})
        if earlier.get("sha256") != content or earlier.get("parameters") != entry.parameters:
            figures = _play(
                env_id, submission.name, entry, {"worlds": worlds, "seed": seed, "jobs": jobs, "keep": out}, progress
            )
            kept = {**kept, env_id: {**figures, "sha256": content}}
        declared = {"steps": entry.steps, "cpu_seconds": entry.cpu_seconds, "parameters": entry.parameters}
        played[env_id] = {**kept[env_id], **declared}
        write_whole(out, {file.name: (json.dumps({**about, "environments": played}, indent=1) + "\n").encode()})
        yield env_id


def read_record(file: Path) -> dict[str, Any]:
    """A record of ``play_submission``. Raises an InputError for any other file."""
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
        if {"name", "version", "seed", "worlds", "environments"} <= set(found):
            return dict(found)
    except (OSError, ValueError, TypeError):
        pass
    raise InputError(f"{file} is no record of a submission, expected one that wavegym submit wrote")


def table(record: Record) -> str:
    """A line for each environment of one submission: cost by belief and squared error by truth against best-simple.

    *Share of the gap* is the submission's gain over best-simple, in logarithms, over that of the lower bound.
    """
    rows = []
    for env_id, found in record["environments"].items():
        cells = [env_id.rpartition("/")[2]]
        for figure in ("cost", "error"):
            estimate = statistics.difference(*pair(found, figure), bootstrap(record)).geometric
            cells += estimated(estimate)
        cells += _share_of_gap(found, record)
        spent = found["cpu_seconds"]
        rows.append([*cells, f"{found['microseconds']:g}", f"{found['steps']}", "" if spent is None else f"{spent:g}"])
    head = ["environment", "cost %", "95 %", "squared error by truth %", "95 %"]
    head += ["bound %", "share of the gap", "95 %", "us", "steps", "CPU seconds"]
    return tabulated(head, rows)


def _share_of_gap(found: Mapping[str, Any], record: Record) -> list[str]:
    """The lower bound against best-simple and the share of the gap to it; empty where no bound is known."""
    if "bound" not in found:
        return ["", "", ""]
    cost, simple = pair(found, "cost")
    bound = np.array([found["bound"]], np.float64)
    share = statistics.ratio(np.log(cost / simple), np.log(bound / simple), bootstrap(record))
    return [signed(statistics.difference(bound, simple, bootstrap(record)).geometric.value), *shared(share)]


def pair(found: Mapping[str, Any], figure: str) -> tuple[Array, Array]:
    """A figure of the submission and of the best heuristic, (1, world) each."""
    own, simple = (np.array([found[name]], np.float64) for name in (figure, f"simple_{figure}"))
    return own, simple


def bootstrap(record: Record) -> np.random.Generator:
    """The random numbers of the intervals of a record."""
    return np.random.default_rng([record["seed"], word("bootstrap")])


def _play(env_id: str, name: str, entry: Entry, common: dict[str, Any], progress: bool) -> dict[str, Any]:
    """Costs and squared errors of the policy and of the best heuristic, and a lower bound where one is known."""
    own = compare(env_id, {name: entry.file}, progress=progress, **common, **entry.parameters)
    simple = compare(env_id, {SIMPLE: None}, progress=progress, **common)
    figures: dict[str, Any] = {}
    for prefix, comparison, policy in (("", own, name), ("simple_", simple, SIMPLE)):
        results = comparison.results(policy)
        figures[f"{prefix}cost"] = _rounded(results.cost.mean(axis=0))
        figures[f"{prefix}error"] = _rounded(results.squared_error.mean(axis=0))
    bound = lower_bound(env_id, progress=progress, **common)
    if bound is not None:
        figures["bound"] = _rounded(bound)
    return {**figures, "microseconds": float(f"{us_per_decision(own, name):.3g}")}


def lower_bound(env_id: str, **common: Any) -> Array | None:
    """Lower bound of the mean cost per step, (world,); None if no bound is known.

    In KershawEvans and KershawEvansPosition it is the clairvoyant optimum, certified to a thousandth. In EnergyBudget
    and EnergyBudgetKnown the account never runs out: no policy can do better on average, but one may in a single world,
    because clutter is random.

    Args:
        env_id: a full id.
        **common: number of worlds, seed, jobs and the like, as for ``compare``.
    """
    if env_id not in BOUNDS:
        return None
    policy, lifted = BOUNDS[env_id]
    played = compare(env_id, {policy: None}, **common, **lifted)
    return played.cost(policy)[0]


def _rounded(values: Any) -> list[float | None]:
    """To significant digits, None where there is no value."""
    return [None if math.isnan(value) else float(f"{value:.{DIGITS}g}") for value in np.asarray(values).tolist()]


def _sha256(path: Path) -> str:
    """Of a file, or of all files in a folder with their names."""
    digest = hashlib.sha256()
    for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
        if file.is_file():
            digest.update(str(file.relative_to(path.parent)).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()
