"""The folder of a training run, and the loading of trained policies from such folders.

::

    run_spec.json  the specification of the training, written first: --resume checks it
    checkpoints/   the last two, during and after the training
    tensorboard/   for ``tensorboard --logdir``
    curve.csv      steps, episodes, mean episode cost
    policy.npz     the trained network in plain NumPy: evaluation plays this file
    model.zip      Stable-Baselines3's own file, for further training: it can hold code, so load only trusted ones
    run.json       the record of the finished run and its CPU time, written last: without it no run is finished
"""

from __future__ import annotations

import dataclasses
import hashlib
import shlex
import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import load_env_creator

from wavegym.core.action_sets import JointLibrary, PerSensorLibrary
from wavegym.core.errors import InputError, InputWarning, check_choice
from wavegym.core.parameter_box import ParameterBox
from wavegym.core.parameters import make_checked
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.core.traits import TrackSlots
from wavegym.observations.forecasts import Forecasts
from wavegym.policies.networks import LearnedPolicy, Network
from wavegym.policies.records import difference, read_run
from wavegym.policies.training_range import KEY, TrainingRange
from wavegym.registration import registered_system

SPEC, RUN, POLICY, MODEL, CURVE = "run_spec.json", "run.json", "policy.npz", "model.zip", "curve.csv"
CHECKPOINTS, BOARD, LOCK = "checkpoints", "tensorboard", ".lock"
CONTENTS = (SPEC, RUN, POLICY, MODEL, CURVE, CHECKPOINTS, BOARD)
LEARNER = ("env", "algo", "settings")  # equal in all training seeds of one learner
ABSENT = object()  # stands for a parameter that a system does not have
ALIKE = "alike"  # form of actions that a scorer tells apart by their forecasts only
OF_ANY_SIZE = ("slots", "horizon")  # parameters that mean nothing to such a scorer


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
    return (folder / RUN).exists() or (folder / SPEC).exists()


def _load(folder: Path, env_id: str, system: System) -> LearnedPolicy:
    """The policy of one run's folder."""
    if not (folder / RUN).exists():
        wanted = f"expected {RUN}; finish it with wavegym train --resume"
        raise InputError(f"training in {str(folder)!r} is unfinished, {wanted}")
    run = read_run(folder / RUN)
    _check_signature(folder, run, env_id, system)
    check_choice(f"algo in {folder / RUN}", run["algo"], ("ppo", "dqn"))
    network, forecasts = read_network(folder, run), bool(run["settings"].get("forecasts", False))
    own = 0 if network.is_alike else len(system.observation_fields)
    of_candidate, of_all = 0, 0
    if forecasts:
        fields = Forecasts(system)
        of_candidate, of_all = len(fields.candidate_fields), len(fields.observation_fields)
    shown = own + (of_candidate if network.is_alike else of_all)
    if network.inputs != shown:
        raise InputError(f"policy {str(folder)!r} observes {network.inputs} elements, but this {env_id} shows {shown}")
    return LearnedPolicy(network, forecasts, _training_range(folder, run, own, of_candidate))


def _training_range(folder: Path, run: dict[str, Any], own: int, forecasts: int) -> TrainingRange | None:
    """The range on record, None where there is none. Raises an InputError if it is not one of so many elements."""
    if KEY not in run:
        return None
    try:
        found = TrainingRange.from_record(run[KEY])
        if (found.own, found.low.shape, found.high.shape) == (own, (own + forecasts,), (own + forecasts,)):
            return found
    except (KeyError, TypeError, ValueError):
        pass
    wanted = f"own = {own} and low and high of {own + forecasts} numbers"
    raise InputError(f"{folder / RUN} is no record of wavegym train: {KEY!r} is no range, expected {wanted}")


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
        seen, shown = ", ".join(run["observation"]), ", ".join(here["observation"])
        raise InputError(f"policy {str(folder)!r} observes ({seen}), but this {env_id} shows ({shown})")
    if run["scaling"] != here["scaling"]:
        raise InputError(
            f"policy {str(folder)!r} scales its observation as {run['scaling']}, but this {env_id} as {here['scaling']}"
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
