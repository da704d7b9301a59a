"""Policies from files: saved agents, folders of training runs, and, where the user trusts them, other people's code."""

from __future__ import annotations

import importlib.util
import os
import re
from pathlib import Path
from typing import Any

from wavegym.core.build import load_object
from wavegym.core.errors import InputError
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.policies.runs import pretrained_folder
from wavegym.registration import stem

SAVED = Path(__file__).parents[2] / "results" / "runs"  # ENVIRONMENT/LEARNER/seedN, as agents.experiment makes them
AGENTS = ("ppo", "dqn")
CODE = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")  # package.module:factory


def saved_agent(name: str, env_id: str) -> Path:
    """The folder of the agents called ``name`` that come with an environment: the repository's, or the package's.

    Raises:
        InputError: there are none; the message says how to train one.
    """
    own = SAVED / stem(env_id) / name
    folder = own if own.is_dir() else pretrained_folder(env_id, name)
    if folder is None:
        command = f"wavegym train {env_id.removeprefix('wavegym/')} --algo {name} --out runs/{name}"
        wanted = f"the folder of a run (nearest: {command})"
        raise InputError(f"policy is {name!r}, of which none is saved for {env_id}, expected {wanted}")
    return folder


def load_folder(folder: Path, env_id: str, system: System) -> list[Policy]:
    """The trained runs in a folder, one policy each. Raises an InputError where there is none that fits."""
    from wavegym.policies.runs import load_policy

    return load_policy(folder, env_id, system)


def is_folder(source: str) -> bool:
    """Whether ``source``, which is no scheduler's name, is meant as a folder."""
    return os.sep in source or Path(source).is_dir()


def is_archive(source: str) -> bool:
    """Whether ``source`` is meant as a model that Stable-Baselines3 saved."""
    return source.endswith(".zip")


def is_onnx(source: str) -> bool:
    """Whether ``source`` is meant as a policy in an ONNX file."""
    return source.endswith(".onnx")


def load_onnx(path: Path) -> Policy:
    """The policy in an ONNX file; runs no code of it. Raises an InputError for any other file."""
    from wavegym.policies.onnx_files import OnnxPolicy

    return OnnxPolicy(path)


def is_code(source: str) -> bool:
    """Whether ``source`` is ``package.module:factory`` of an installed package. Imports nothing."""
    return bool(CODE.fullmatch(source)) and importlib.util.find_spec(source.partition(":")[0].split(".")[0]) is not None


def load_code(source: str, trust: bool) -> Any:
    """The object ``package.module:factory``.

    Raises:
        InputError: without ``trust``, since importing runs the module's code; or it cannot be imported.
    """
    _check_trusted(source, f"the module {source.partition(':')[0]}", trust)
    return load_object("policy", source)


def load_archive(path: Path, trust: bool) -> Any:
    """The policy of a model that Stable-Baselines3 or sb3-contrib saved, whatever its algorithm, on the processor.

    Raises:
        InputError: without ``trust``, since loading runs code in the file; no such file, or no such model in it.
    """
    _check_trusted(str(path), "the file", trust)
    if not path.is_file():
        raise InputError(f"policy {str(path)!r} is no file, expected a model that Stable-Baselines3 saved")
    try:
        from stable_baselines3.common.save_util import load_from_zip_file
    except ImportError as error:
        raise InputError(f"policy {str(path)!r} needs Stable-Baselines3: pip install 'wavegym[agents]'") from error
    try:
        data, weights, _ = load_from_zip_file(path, device="cpu")
        assert data is not None
        settings = {**data.get("policy_kwargs", {}), **({"use_sde": True} if data.get("use_sde") else {})}
        spaces = data["observation_space"], data["action_space"]
        policy = data["policy_class"](*spaces, lambda _: 0.0, **settings)  # a learning rate: of no use in play
        policy.load_state_dict(weights["policy"])
    except Exception as error:  # any error of code in the file
        wanted = "a model that Stable-Baselines3 saved"
        raise InputError(f"policy {str(path)!r}, expected {wanted}: {type(error).__name__}: {error}") from error
    policy.set_training_mode(False)
    return policy


def _check_trusted(source: str, code: str, trust: bool) -> None:
    if not trust:
        wanted = "--trust, or trust=True, if you trust its author"
        raise InputError(f"policy is {source!r}; loading it runs code of {code}, expected {wanted}")
