"""The folder of a training run, and trained policies out of it.

::

    plan.json      what is being trained, written first: --resume checks it
    checkpoints/   the last two, while training lasts and after
    tensorboard/   for ``tensorboard --logdir``
    curve.csv      steps, episodes, mean episode cost
    policy.zip     Stable-Baselines3's own file: load it only from people you trust, it can hold code
    run.json       written last: what was trained on what; a folder without it holds no finished run
"""

from __future__ import annotations

import hashlib
import io
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import BasePolicy

from agents.records import difference, read_run
from wavegym.errors import InputError, choice
from wavegym.schedulers import Policy
from wavegym.systems.contract import System
from wavegym.waveforms import JointLibrary, ParameterBox, PerSensor

Array = NDArray[Any]

PLAN, RUN, POLICY, CURVE = "plan.json", "run.json", "policy.zip", "curve.csv"
CHECKPOINTS, BOARD = "checkpoints", "tensorboard"
CONTENTS = (PLAN, RUN, POLICY, CURVE, CHECKPOINTS, BOARD)
LEARNER = ("env", "algo", "settings")  # what training seeds of one learner have in common
MODELS: dict[str, type[BaseAlgorithm]] = {"ppo": PPO, "dqn": DQN}


class LearnedPolicy:
    """A trained network as a policy: deterministic, a batch at a time.

    Args:
        network: a policy of Stable-Baselines3's PPO or DQN.
    """

    def __init__(self, network: BasePolicy) -> None:
        self.network = network

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. One thread: for networks of this size a second one only costs."""
        torch.set_num_threads(1)

    def act(self, public: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``: the likeliest action, or the one of highest value, among those allowed."""
        if observation is None:
            raise InputError("a learned policy was shown no observation, expected an environment's")
        if mask is None:
            return self.network.predict(observation, deterministic=True)[0]
        return np.argmax(np.where(mask, self._scores(observation), -np.inf), axis=1)

    def _scores(self, observation: Array) -> Array:
        """Q values or log probabilities, (env, actions)."""
        network: Any = self.network
        with torch.no_grad():
            inputs, _ = network.obs_to_tensor(observation)
            scores = (
                network.q_net(inputs)
                if hasattr(network, "q_net")
                else network.get_distribution(inputs).distribution.logits
            )
        return scores.numpy()


def signature(system: System) -> dict[str, Any]:
    """What a network's inputs and outputs mean: the observation's elements and scaling, a hash of the actions."""
    form, count, names = _meaning(system.actions)
    return {
        "observation": [e.name for e in system.elements],
        "scaling": [[float(e.centre), float(e.scale)] for e in system.elements],
        "actions": {"form": form, "count": count, "sha256": hashlib.sha256(repr(names).encode()).hexdigest()},
    }


def _meaning(actions: Any) -> tuple[str, int, Any]:
    """The form of an action set, how many outputs or waveforms it has, and the names that give them their meaning."""
    if isinstance(actions, ParameterBox):
        return "box", len(actions.parameters), actions.parameters
    if isinstance(actions, JointLibrary):
        return "joint", len(actions), actions.labels
    names = tuple(actions.labels)
    if isinstance(actions, PerSensor):
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
    return (folder / RUN).exists() or (folder / PLAN).exists()


def _load(folder: Path, env_id: str, system: System) -> LearnedPolicy:
    """The policy of one run's folder."""
    if not (folder / RUN).exists():
        raise InputError(f"training in {str(folder)!r} is unfinished, expected {RUN}; finish it with train.py --resume")
    run = read_run(folder / RUN)
    _check_same(folder, run, env_id, system)
    model = MODELS[choice(f"algo in {folder / RUN}", run["algo"], MODELS)]
    content = read_policy(folder, run)
    try:
        # seed=None: loading must not seed the global generators.
        return LearnedPolicy(model.load(io.BytesIO(content), device="cpu", seed=None).policy)
    except Exception as error:  # unpickling foreign bytes can raise anything
        text = f"{type(error).__name__}: {error}"
        raise InputError(f"{folder / POLICY} is no {run['algo']} policy that can be loaded: {text}") from error


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
        form = run["actions"]["form"]
        hint = "" if form == here["actions"]["form"] else f" (nearest: the setting action={form.split()[0]})"
        raise InputError(
            f"policy {str(folder)!r} chooses among actions {known}, but this {env_id} offers {offered}{hint}"
        )
