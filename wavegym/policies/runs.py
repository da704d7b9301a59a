"""The folder of a training run, and trained policies out of it.

::

    run_spec.json      what is being trained, written first: --resume checks it
    checkpoints/   the last two, while training lasts and after
    tensorboard/   for ``tensorboard --logdir``
    curve.csv      steps, episodes, mean episode cost
    policy.npz     the trained network in plain NumPy: what is played
    model.zip      Stable-Baselines3's own file, to train on: load it only from people you trust, it can hold code
    run.json       written last: what was trained on what; a folder without it holds no finished run
"""

from __future__ import annotations

import hashlib
import shlex
from pathlib import Path
from typing import Any

from wavegym.core.action_sets import JointLibrary, PerSensorLibrary
from wavegym.core.errors import InputError, check_choice
from wavegym.core.parameter_box import ParameterBox
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.policies.networks import LearnedPolicy, Network
from wavegym.policies.records import difference, read_run

SPEC, RUN, POLICY, MODEL, CURVE = "run_spec.json", "run.json", "policy.npz", "model.zip", "curve.csv"
CHECKPOINTS, BOARD = "checkpoints", "tensorboard"
CONTENTS = (SPEC, RUN, POLICY, MODEL, CURVE, CHECKPOINTS, BOARD)
LEARNER = ("env", "algo", "settings")  # what training seeds of one learner have in common


def signature(system: System) -> dict[str, Any]:
    """What a network's inputs and outputs mean: the observation's elements and scaling, a hash of the actions."""
    form, count, names = _meaning(system.actions)
    return {
        "observation": [e.name for e in system.observation_fields],
        "scaling": [[float(e.centre), float(e.scale)] for e in system.observation_fields],
        "actions": {"form": form, "count": count, "sha256": hashlib.sha256(repr(names).encode()).hexdigest()},
    }


def _meaning(actions: Any) -> tuple[str, int, Any]:
    """The form of an action set, how many outputs or waveforms it has, and the names that give them their meaning."""
    if isinstance(actions, ParameterBox):
        return "box", len(actions.parameters), actions.parameters
    if isinstance(actions, JointLibrary):
        return "joint", len(actions), actions.labels
    names = tuple(actions.labels)
    if isinstance(actions, PerSensorLibrary):
        return f"library for each of {actions.sensors} sensors", len(names), (actions.sensors, names)
    return "library", len(names), names


def load_policy(folder: Path | str, env_id: str, system: System) -> list[Policy]:
    """The trained policies in a folder: one of a run's folder; all, sorted by name, of a folder of runs' folders.

    Args:
        folder: what ``train.py --out`` was given, or the folder above several (training seeds of one algorithm).
        env_id: the full id of the environment to be played.
        system: its closed loop; the policy's observation and actions must be this one's.

    Raises:
        InputError: no finished run, a missing or torn file, a policy from another environment (both named), or runs
            that are not seeds of one learner (the difference named).
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"policy {str(folder)!r} is not a folder, expected one that train.py made")
    if _is_run(folder):
        return [_load(folder, env_id, system)]
    runs = sorted(path for path in folder.iterdir() if path.is_dir() and _is_run(path))
    if not runs:
        raise InputError(
            f"policy folder {str(folder)!r} holds no training run, expected {RUN} in it or in folders in it"
        )
    policies: list[Policy] = [_load(run, env_id, system) for run in runs]
    _check_seeds({run.name: read_run(run / RUN) for run in runs}, folder)
    return policies


def _is_run(folder: Path) -> bool:
    return (folder / RUN).exists() or (folder / SPEC).exists()


def _load(folder: Path, env_id: str, system: System) -> LearnedPolicy:
    """The policy of one run's folder."""
    if not (folder / RUN).exists():
        raise InputError(f"training in {str(folder)!r} is unfinished, expected {RUN}; finish it with train.py --resume")
    run = read_run(folder / RUN)
    _check_same(folder, run, env_id, system)
    check_choice(f"algo in {folder / RUN}", run["algo"], ("ppo", "dqn"))
    content = read_policy(folder, run)
    try:
        return LearnedPolicy(Network.from_bytes(content), bool(run["settings"].get("forecasts", False)))
    except (ValueError, KeyError, OSError) as error:
        text = f"{type(error).__name__}: {error}"
        raise InputError(f"{folder / POLICY} is no policy that can be loaded: {text}") from error


def read_policy(folder: Path, run: dict[str, Any]) -> bytes:
    """The policy file of a finished run.

    Raises:
        InputError: it is missing, or not the one that the record ``run`` tells of.
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


def _check_same(folder: Path, run: dict[str, Any], env_id: str, system: System) -> None:
    """The run's environment, observation and actions are those to be played."""
    here = signature(system)
    if run["env"] != env_id:
        raise InputError(f"policy {str(folder)!r} was trained in {run['env']}, expected one trained in {env_id}")
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
        raise InputError(
            f"policy {str(folder)!r} chooses among actions {known}, but this {env_id} offers {offered}{hint}"
        )
