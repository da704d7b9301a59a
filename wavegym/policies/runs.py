"""The folder of a training run, and the loading of trained policies from such folders.

::

    training.json  environment, algorithm, seed and settings, written first: --resume checks them
    checkpoints/   the last two, during and after the training
    tensorboard/   for ``tensorboard --logdir``
    curve.csv      steps, episodes, mean episode cost
    policy.npz     the trained network in plain NumPy: evaluation plays this file
    model.zip      Stable-Baselines3's own file, for further training: it can hold code, so load only trusted ones
    run.json       the record of the finished run and its CPU time, written last: without it no run is finished

The package comes with training seed 0 of PPO and DQN in each environment that has them:
``pretrained/ENVIRONMENT/ALGORITHM/`` holds policy.npz and run.json. ``python -m agents.package`` moves them from
results/runs.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import shlex
import warnings
from collections.abc import Mapping
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import load_env_creator

from wavegym.core.action_sets import JointLibrary, ParameterBox, PerSensorLibrary
from wavegym.core.errors import InputError, InputWarning, check_choice, nearest
from wavegym.core.parameters import make_checked
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.core.traits import TrackSlots
from wavegym.observations.forecasts import Forecasts
from wavegym.observations.observer import Observer
from wavegym.policies.networks import RANGE_KEY, LearnedPolicy, Network, TrainingRange
from wavegym.registration import registered_system, stem

# Entries of run.json that evaluation needs.
RUN_FIELDS: dict[str, type] = {
    "env": str,
    "algo": str,
    "seed": int,
    "settings": dict,
    "settings.environment": dict,
    "observation": list,
    "scaling": list,
    "actions": dict,
    "actions.form": str,
    "actions.count": int,
    "actions.sha256": str,
    "policy_sha256": str,
}
TRAINING, RUN, POLICY, MODEL, CURVE = "training.json", "run.json", "policy.npz", "model.zip", "curve.csv"
CHECKPOINTS, BOARD, LOCK = "checkpoints", "tensorboard", ".lock"
CONTENTS = (TRAINING, RUN, POLICY, MODEL, CURVE, CHECKPOINTS, BOARD)
LEARNER = ("env", "algo", "settings")  # equal in all training seeds of one learner
ABSENT = object()  # stands for a parameter that a system does not have
ALIKE = "alike"  # form of actions that a scorer tells apart by their forecasts only
OF_ANY_SIZE = ("slots", "horizon")  # parameters that mean nothing to such a scorer
PRETRAINED = Path(__file__).parent / "pretrained"
ALGORITHMS = ("ppo", "dqn")
PRETRAINED_FILES = (POLICY, RUN)


class Unlike(NamedTuple):
    """An entry in which two records differ; a record without the entry has None."""

    name: str
    here: Any
    there: Any


def read_record(path: Path) -> dict[str, Any]:
    """A JSON object that a training run wrote.

    Raises:
        InputError: the file is missing or holds no JSON object.
    """
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read: {error}") from None
    if not isinstance(record, dict):
        raise InputError(f"{path} holds no JSON object, expected a record of wavegym train")
    return record


def read_run(path: Path) -> dict[str, Any]:
    """The record of a finished run, with every entry that evaluation needs.

    Raises:
        InputError: the file is missing or no JSON object, or an entry is missing or of another type (named).
    """
    run = read_record(path)
    for name, kind in RUN_FIELDS.items():
        value: Any = run
        for key in name.split("."):
            if key not in value:
                raise InputError(f"{path} is no record of wavegym train: {name!r} is missing")
            value = value[key]
        if not isinstance(value, kind):
            raise InputError(f"{path} is no record of wavegym train: {name!r} is {value!r}, expected {kind.__name__}")
    variants = run["settings"].get("variants", [])
    if not isinstance(variants, list) or not all(isinstance(variant, dict) for variant in variants):
        raise InputError(f"{path} is no record of wavegym train: 'settings.variants' is {variants!r}, expected tables")
    if not all(isinstance(element, str) for element in run["observation"]):
        raise InputError(
            f"{path} is no record of wavegym train: 'observation' is {run['observation']!r}, expected names"
        )
    return run


def difference(here: Mapping[str, Any], there: Mapping[str, Any]) -> Unlike | None:
    """The first entry, in alphabetical order, in which two records differ, such as ``settings.gamma``; or None."""
    mine, other = _flat(here), _flat(there)
    for name in sorted({*mine, *other}):
        if mine.get(name) != other.get(name):
            return Unlike(name, mine.get(name), other.get(name))
    return None


def _flat(record: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """{"settings.gamma": 0.9, ...} of a nested record."""
    flat: dict[str, Any] = {}
    for key, value in record.items():
        flat |= _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: value}
    return flat


def signature(system: System, policy: str = "mlp") -> dict[str, Any]:
    """The meaning of a network's inputs and outputs: names and scaling of the observation, a hash of the actions.

    A scorer of tracks in slots sees the forecasts of each candidate and nothing else, so it plays with any slots and
    dwells.
    """
    fields = system.observation_fields
    form, count, names = _meaning(system.actions)
    if policy == "scorer" and isinstance(system, TrackSlots):
        fields, (form, count, names) = Forecasts(system).candidate_fields, (ALIKE, 0, ())
    return {
        "observation": [e.name for e in fields],
        "scaling": [[float(e.centre), float(e.scale)] for e in fields],
        "actions": {"form": form, "count": count, "sha256": hashlib.sha256(repr(names).encode()).hexdigest()},
    }


def _meaning(actions: Any) -> tuple[str, int, Any]:
    """The form of an action set, its number of outputs or waveforms, and the names that define their meaning."""
    if isinstance(actions, ParameterBox):
        return "box", len(actions.parameters), actions.parameters
    if isinstance(actions, JointLibrary):
        return "joint", len(actions), actions.labels
    names = tuple(actions.labels)
    if isinstance(actions, PerSensorLibrary):
        return f"library for each of {actions.sensors} sensors", len(names), (actions.sensors, names)
    return "library", len(names), names


def load_policy(folder: Path | str, env_id: str, system: System) -> list[Policy]:
    """The trained policies in a folder: one from a run's folder; all, sorted by name, from a folder of run folders.

    A policy plays every system with the observations and actions of its training. If the id or a parameter differs
    from the training, an InputWarning names both.

    Args:
        folder: the folder of a run, or the folder above several (training seeds of one algorithm).
        env_id: the full id of the environment to be played.
        system: its closed loop.

    Raises:
        InputError: no finished run, a broken file, or runs that do not fit the system or each other.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"policy {str(folder)!r} is not a folder, expected one that wavegym train made")
    runs = [folder] if _is_run(folder) else sorted(p for p in folder.iterdir() if p.is_dir() and _is_run(p))
    if not runs:
        raise InputError(
            f"policy folder {str(folder)!r} holds no training run, expected {RUN} in it or in folders in it"
        )
    policies: list[Policy] = [_load(run, env_id, system) for run in runs]
    records = {run.name: read_run(run / RUN) for run in runs}
    _check_seeds(records, folder)
    if text := _unlike_training(records[runs[0].name], env_id, system):
        warnings.warn(f"policy {str(folder)!r} {text}", InputWarning, stacklevel=2)
    return policies


def _is_run(folder: Path) -> bool:
    return (folder / RUN).exists() or (folder / TRAINING).exists()


def _load(folder: Path, env_id: str, system: System) -> LearnedPolicy:
    """The policy of one run's folder."""
    if not (folder / RUN).exists():
        wanted = f"expected {RUN}; finish it with wavegym train --resume"
        raise InputError(f"training in {str(folder)!r} is unfinished, {wanted}")
    run = read_run(folder / RUN)
    _check_signature(folder, run, env_id, system)
    check_choice(f"algo in {folder / RUN}", run["algo"], ("ppo", "dqn"))
    network, shown = read_network(folder, run), shown_in(run)
    own = 0 if network.is_alike else len(system.observation_fields)
    fields = Observer(system, *shown).forecasts
    of_candidate, of_all = (len(fields.candidate_fields), len(fields.observation_fields)) if fields else (0, 0)
    inputs = own + (of_candidate if network.is_alike else of_all)
    if network.inputs != inputs:
        raise InputError(f"policy {str(folder)!r} observes {network.inputs} elements, but this {env_id} shows {inputs}")
    return LearnedPolicy(network, *shown, _training_range(folder, run, own, of_candidate))


def shown_in(run: dict[str, Any]) -> tuple[bool, int | None]:
    """The forecasts and the candidates of a run's training, as ``Observer`` takes them."""
    settings = run["settings"]
    return bool(settings.get("forecasts", False)), settings.get("candidates") or None


def _training_range(folder: Path, run: dict[str, Any], own: int, forecasts: int) -> TrainingRange | None:
    """The recorded range; None without a record. Raises an InputError if it has another number of elements."""
    if RANGE_KEY not in run:
        return None
    try:
        found = TrainingRange.from_record(run[RANGE_KEY])
        if (found.own, found.low.shape, found.high.shape) == (own, (own + forecasts,), (own + forecasts,)):
            return found
    except (KeyError, TypeError, ValueError):
        pass
    wanted = f"own = {own} and low and high of {own + forecasts} numbers"
    raise InputError(f"{folder / RUN} is no record of wavegym train: {RANGE_KEY!r} is no range, expected {wanted}")


def read_network(folder: Path, run: dict[str, Any]) -> Network:
    """The network of a finished run with the record ``run``.

    Raises:
        InputError: the policy file is missing, torn, or holds no network.
    """
    content = read_policy(folder, run)
    try:
        return Network.from_bytes(content)
    except ValueError as error:
        raise InputError(f"{folder / POLICY} is no policy that can be loaded: {error}") from error


def read_policy(folder: Path, run: dict[str, Any]) -> bytes:
    """The policy file of a finished run with the record ``run``.

    Raises:
        InputError: the file is missing, or its SHA-256 is not the recorded one.
    """
    try:
        content = (folder / POLICY).read_bytes()
    except OSError as error:
        raise InputError(f"{folder / POLICY} cannot be read: {error.strerror}") from None
    if hashlib.sha256(content).hexdigest() != run["policy_sha256"]:
        raise InputError(f"{folder / POLICY} is torn or not this run's: its SHA-256 differs from that in {RUN}")
    return content


def _check_seeds(runs: dict[str, dict[str, Any]], folder: Path) -> None:
    """Runs in one folder are training seeds of one learner: the same algorithm and settings, and no seed twice.

    Versions may differ: seeds trained on two machines are still seeds of one learner.
    """
    (first, reference), *others = runs.items()
    names = {reference["seed"]: first}
    for name, run in others:
        unlike = difference(*({key: record[key] for key in LEARNER} for record in (run, reference)))
        if unlike:
            raise InputError(
                f"runs in {str(folder)!r} are not seeds of one learner: {unlike.name} is {unlike.here!r} in {name}, "
                f"but {unlike.there!r} in {first}"
            )
        twin = names.setdefault(run["seed"], name)
        if twin != name:
            raise InputError(f"runs {twin} and {name} in {str(folder)!r} have one seed, {run['seed']}, expected two")


def _check_signature(folder: Path, run: dict[str, Any], env_id: str, system: System) -> None:
    """Raise an InputError if the system's observation, its scaling or its actions differ from those of the run."""
    here = signature(system, run["settings"].get("policy", "mlp"))
    if run["observation"] != here["observation"]:
        seen, shown = run["observation"], here["observation"]
        first = next(i for i, (a, b) in enumerate(zip_longest(seen, shown)) if a != b)
        a, b = (repr(names[first]) if first < len(names) else "no more" for names in (seen, shown))
        counts = f"{len(seen)} elements, but this {env_id} shows {len(shown)}"
        raise InputError(
            f"policy {str(folder)!r} observes {counts}; the first that differs, {first + 1}, is {a}, not {b}"
        )
    if run["scaling"] != here["scaling"]:
        rows = zip(here["observation"], run["scaling"], here["scaling"], strict=True)
        name, seen, shown = next(row for row in rows if row[1] != row[2])
        raise InputError(
            f"policy {str(folder)!r} has centre and scale {seen} of {name!r}, but this {env_id} has {shown}"
        )
    if run["actions"] != here["actions"]:
        known, offered = (f"{a['count']} ({a['form']}, {a['sha256'][:8]})" for a in (run["actions"], here["actions"]))
        own = run["settings"]["environment"]
        given = shlex.join(f"{name}={value}" for name, value in own.items())
        hint = f" (nearest: the setting{'s' if len(own) > 1 else ''} {given} of its training)" if own else ""
        trained = "" if run["env"] == env_id else f"was trained in {run['env']} and "
        raise InputError(
            f"policy {str(folder)!r} {trained}chooses among actions {known}, but this {env_id} offers {offered}{hint}"
        )


def _unlike_training(run: dict[str, Any], env_id: str, system: System) -> str:
    """How the environment to be played differs from that of the training, in one line; "" if it does not."""
    here = _parameters(system)
    there, *variants = (_trained_parameters(run, own) for own in ({}, *run["settings"].get("variants", ())))
    names = [
        name
        for name in _of_meaning(run, there)
        if not any(_equal(here.get(name, ABSENT), seen.get(name, there[name])) for seen in (there, *variants))
    ]
    changes = [f"{name}={_shown(here.get(name, ABSENT))} (training: {_shown(there[name])})" for name in names]
    if run["env"] == env_id and not changes:
        return ""
    other = "" if run["env"] == env_id else f", not in {env_id}"
    parameters = f"; parameters that differ: {', '.join(changes)}" if changes else ""
    return f"was trained in {run['env']}{other}{parameters}"


def environment_of(run: dict[str, Any]) -> dict[str, Any]:
    """The parameters of the training that replace defaults of the environment and that the policy depends on."""
    return _of_meaning(run, run["settings"]["environment"])


def _of_meaning(run: dict[str, Any], parameters: dict[str, Any]) -> dict[str, Any]:
    """The parameters that mean something to the policy of a run."""
    ignored = OF_ANY_SIZE if run["actions"]["form"] == ALIKE else ()
    return {name: value for name, value in parameters.items() if name not in ignored}


def _trained_parameters(run: dict[str, Any], variant: dict[str, Any]) -> dict[str, Any]:
    """All parameters of the system of a run's variant; only those on record if that system cannot be made here."""
    recorded = {**run["settings"].get("environment", {}), **variant}
    try:
        system, registered = registered_system(run["env"])
        given = {**registered, **recorded}
        if isinstance(system, System):
            return _parameters(system)
        make: Any = load_env_creator(system) if isinstance(system, str) else system
        names = {field.name for field in dataclasses.fields(make)}
        return _parameters(make_checked(make, {name: value for name, value in given.items() if name in names}))
    except (gym.error.Error, ImportError, AttributeError, KeyError, TypeError, ValueError):
        return recorded  # the id is not registered here, or another version had other parameters


def _parameters(system: Any) -> dict[str, Any]:
    if not dataclasses.is_dataclass(system):
        return {}
    return {field.name: getattr(system, field.name) for field in dataclasses.fields(system)}


def _equal(first: Any, second: Any) -> bool:
    same = first == second
    return same if isinstance(same, bool) else bool(np.array_equal(first, second))


def _shown(value: Any) -> str:
    value = str(value) if isinstance(value, Path) else value
    return "none" if value is ABSENT else " ".join(repr(value).split())


def pretrained_folder(env_id: str, algo: str) -> Path | None:
    """The folder of the agent that comes with an environment, for ``load_policy``; None if there is none.

    Args:
        env_id: the full id.
        algo: "ppo" or "dqn".
    """
    folder = PRETRAINED / stem(env_id) / algo
    if algo not in ALGORITHMS or not (folder / RUN).is_file() or read_run(folder / RUN)["env"] != env_id:
        return None
    return folder


def load_pretrained(env_id: str, algo: str, system: System) -> Policy:
    """The agent that comes with an environment.

    Raises:
        InputError: no such agent, or one that does not fit ``system``.
    """
    check_choice("agent", algo, ALGORITHMS)
    folder = pretrained_folder(env_id, algo)
    if folder is None:
        known = sorted({read_run(path)["env"] for path in PRETRAINED.glob(f"*/*/{RUN}")})
        wanted = f"expected one of {', '.join(map(repr, known))}{nearest(env_id, known)}"
        raise InputError(f"environment is {env_id!r}, which comes without a trained agent, {wanted}")
    (policy,) = load_policy(folder, env_id, system)
    return policy
