"""Anybody's policy as a ``Policy``: functions, models with ``predict``, folders of training runs, saved models.

>>> import numpy as np
>>> from wavegym.evaluation import as_policy, compare
>>> def shortest(observation):  # (env, fields) float32 -> (env,) int
...     return np.zeros(len(observation), np.int64)
>>> comparison = compare("KershawEvansPosition-v0", {"shortest": shortest}, worlds=5, jobs=1, horizon=4)
>>> comparison.cost("shortest").shape
(1, 5)
"""

from __future__ import annotations

import difflib
import importlib.util
import inspect
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.policy import Policy
from wavegym.core.registry import load_object
from wavegym.core.shortcuts import measured_fields
from wavegym.core.system import System
from wavegym.core.worlds import tuning_tapes
from wavegym.envs.actions import action_reader
from wavegym.evaluation.play import Task, make_task
from wavegym.observations.observer import MeasurementObserver, Observer
from wavegym.policies.runs import load_policy, pretrained_folder
from wavegym.registration import PATH, stem
from wavegym.schedulers.registry import is_scheduler, make_policy

SAVED = Path(__file__).parents[2] / "results" / "runs"  # ENVIRONMENT/LEARNER/seedN, as agents.experiment makes them
AGENTS = ("ppo", "dqn")
TAKEN = "a Policy, a function of the observation, an object with predict, a folder, a name or a Factory"


@dataclass(frozen=True)
class Factory:
    """Marks a function that makes a policy for a system; without the mark a function is a policy.

    Args:
        make: ``make(system)`` returns what ``as_policy`` takes, or a sequence of it: the training runs of one agent.
    """

    make: Callable[[System], Any]


def as_policy(
    given: Any, env: Task | str | None = None, *, name: str = "", trust: bool = False, **parameters: Any
) -> Policy:
    """A ``Policy`` made of anything that chooses actions.

    Args:
        given: a Policy; a function (observation) -> actions, of observations (env, fields) float32 and actions
            (env, ...); an object with ``predict``, such as a model of Stable-Baselines3, which is asked for its
            deterministic actions and given masks if it takes ``action_masks``; a Factory; the name of a scheduler; the
            name of a saved agent, which stands for its first training run; the folder of a training run; an ``.onnx``
            file; with ``trust``, a ``.zip`` file of Stable-Baselines3 or ``"package.module:factory"``.
        env: id or Task of the environment to be played; needed for a Factory, a name, a folder and a file.
        name: of the policy, in error messages.
        trust: whether code in files and modules may run.
        **parameters: of the environment, other than the registered ones.

    Raises:
        InputError: nothing of that kind, a folder of several runs, or code without ``trust``.
    """
    named = name or (str(given) if isinstance(given, (str, Path)) else type(given).__name__)
    task = make_task(env, parameters) if isinstance(env, str) else env
    policies = as_policies(given, task, named, trust=trust)
    if isinstance(given, str) and given in AGENTS:
        policies = policies[:1]
    if len(policies) != 1:
        raise InputError(f"policy {named!r} has {len(policies)} training runs, expected one (nearest: compare, or the "
                         "folder of one run)")  # fmt: skip
    return policies[0]


def as_policies(given: Any, task: Task | None, name: str, *, trust: bool = False, tapes: Any = None) -> list[Policy]:
    """The policies of one entry of ``compare``: several for the training runs of one agent.

    Args:
        given: what ``as_policy`` takes, or a sequence of it.
        task: what is to be played.
        name: of the entry.
        trust: see ``as_policy``.
        tapes: worlds for tuning, axis 0 = world; drawn if a scheduler needs some and there are none.

    Raises:
        InputError: see ``as_policy``; an empty sequence.
    """
    if isinstance(given, (list, tuple)):
        if not given:
            raise InputError(f"policy {name!r} is an empty sequence, expected at least one policy")
        return [policy for each in given for policy in as_policies(each, task, name, trust=trust, tapes=tapes)]
    if isinstance(given, (Factory, str, Path)):
        if task is None:
            raise InputError(f"policy {name!r} depends on the environment, expected its id too")
        if isinstance(given, Factory):
            return as_policies(given.make(task.system), task, name, trust=trust, tapes=tapes)
        return _from_source(given, task, trust, tapes)
    if isinstance(given, type):
        raise InputError(f"policy {name!r} is the class {given.__name__}, expected an object of it, or a Factory")
    if isinstance(given, Policy):
        return [given]
    shown = () if task is None else (task.forecasts, task.candidates)
    if hasattr(given, "predict"):
        return [PredictPolicy(given, name, *shown)]
    if callable(given):
        return [FunctionPolicy(given, name, *shown)]
    raise InputError(f"policy {name!r} is {given!r}, expected {TAKEN}")


def _from_source(source: str | Path, task: Task, trust: bool, tapes: Any) -> list[Policy]:
    """The policies of a name, a folder, a file or ``package.module:factory``."""
    text, system = str(source), task.system
    if isinstance(source, str):
        planner, at, base = text.partition("@")
        is_named = is_scheduler(text) or is_scheduler(text.partition(":")[0])
        if at and is_named and not is_scheduler(base):
            bases = _from_source(base, task, trust, tapes)
            return [make_policy(planner, system, _tapes(task, tapes), base=each) for each in bases]
        if is_named:
            return [make_policy(text, system, _tapes(task, tapes))]
        if text in AGENTS:
            return load_policy(saved_agent(text, task.env_id), task.env_id, system)
    if text.endswith(".onnx"):
        from wavegym.policies.onnx_files import OnnxPolicy

        return [OnnxPolicy(Path(source))]
    if text.endswith(".zip"):
        return as_policies(_load_archive(Path(source), trust), task, text)
    if isinstance(source, Path) or is_folder(text):
        return load_policy(Path(source), task.env_id, system)
    if _is_code(text):
        _check_trusted(text, f"the module {text.partition(':')[0]}", trust)
        return as_policies(Factory(load_object("policy", text)), task, text, trust=trust, tapes=tapes)
    if close := difflib.get_close_matches(text.lower(), AGENTS, n=1, cutoff=0.6):
        wanted = f"a scheduler, a trained agent or a folder; did you mean {close[0]!r}?"
        raise InputError(f"policy is {text!r}, expected {wanted}")
    return [make_policy(text, system, _tapes(task, tapes))]  # an error that names the nearest


def _tapes(task: Task, tapes: Any) -> Any:
    return tuning_tapes(task.system, 0) if tapes is None else tapes


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


def is_folder(source: str) -> bool:
    """Whether ``source``, which is no scheduler's name, is meant as a folder."""
    return os.sep in source or Path(source).is_dir()


def _is_code(source: str) -> bool:
    """Whether ``source`` is ``package.module:factory`` of an installed package. Imports nothing."""
    return bool(PATH.fullmatch(source)) and importlib.util.find_spec(source.partition(":")[0].split(".")[0]) is not None


def _load_archive(path: Path, trust: bool) -> Any:
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


class _Adapted:
    """A policy that chooses from observations alone; its actions are checked.

    Args:
        name: of the policy, in error messages.
        forecasts, candidates: of the environment that it was made for, as in ``gym.make``.
        fields: length of the observations that it was made for; None: those of that environment.
        choices: number of actions or ranks among which it was made to choose; None where it chooses otherwise.
    """

    def __init__(
        self,
        name: str,
        forecasts: bool,
        candidates: int | None,
        fields: int | None = None,
        choices: int | None = None,
    ) -> None:
        self.name, self.forecasts, self.candidates = name, forecasts, candidates
        self.fields, self.choices = fields, choices

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``.

        Raises:
            InputError: the environment's observations, with forecasts or without, do not have ``fields`` elements.
        """
        self._observer: Observer | None = None  # of measurements, which the environment alone has
        self._length = self.fields  # of what it sees; None: what the environment shows
        if self.fields is None:
            self._observer = Observer(system, self.forecasts, self.candidates)
            if self._observer.forecasts:
                self._length = len(self._observer.observation_fields)
        elif self.fields == len(system.observation_fields):
            self._observer = Observer(system)
        elif self.fields != _measured_fields(system):
            self._observer = self._with_forecasts(system)
        self._shortlist = self._observer.shortlist if self._observer else None
        self._space = action_reader(system, self._shortlist).space

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``.

        Raises:
            InputError: the actions have the wrong shape or type, or the environment does not show what the policy sees.
        """
        if observation is None or self._length not in (None, observation.shape[1]):
            if self._observer is None:
                wanted = "an environment with observation='measurements'"
                raise InputError(f"policy {self.name!r} takes observations of measurements, expected {wanted}")
            observation, _ = self._observer(belief)
        if self._shortlist is None:
            return self._checked(self.answer(observation, belief, mask), len(observation))
        ranks = self._checked(self.answer(observation, belief, self._shortlist(belief).allowed), len(observation))
        return self._shortlist.taken(belief, ranks)

    def _with_forecasts(self, system: System) -> Observer:
        """Observations with forecasts, which the policy was made for. InputError if it was not."""
        own = len(system.observation_fields)
        wanted = str(own)
        with suppress(InputError):  # a system whose actions have no forecasts
            observer = Observer(system, forecasts=True)
            if self.fields == len(observer.observation_fields):
                return observer
            wanted = f"{own}, or {len(observer.observation_fields)} with forecasts"
        with suppress(InputError):  # a system without a short list
            observer = Observer(system, candidates=self.choices or self.candidates)
            if self.fields == len(observer.observation_fields):
                return observer
        raise InputError(f"policy {self.name!r} takes observations of {self.fields} elements, expected {wanted}")

    def answer(self, observation: Array, belief: Any, mask: Array | None) -> Any:
        """Actions (env, ...) of observations (env, fields), unchecked."""
        raise NotImplementedError

    def forget(self) -> None:
        """Forget earlier episodes; a policy with a state of its own overrides this."""

    def _checked(self, chosen: Any, count: int) -> Array:
        array, shape = np.asarray(chosen), (count, *(self._space.shape or ()))
        is_box = isinstance(self._space, spaces.Box)
        if array.dtype.kind not in ("fiu" if is_box else "iu"):
            given = f"{type(chosen).__name__} of the type {array.dtype}"
            wanted = "numbers in [-1, 1]" if is_box else "integers"
            hint = "; a function that makes a policy is a Factory" if array.dtype == object else ""
            raise InputError(f"policy {self.name!r} returned {given}, expected {wanted} of the shape {shape}{hint}")
        if array.shape != shape:
            wanted = f"{shape}: axis 0 = environment"
            raise InputError(f"policy {self.name!r} returned actions of the shape {array.shape}, expected {wanted}")
        return array


def _measured_fields(system: System) -> int:
    """The length of the observations of measurements; 0 where the system offers none."""
    return len(MeasurementObserver(system).observation_fields) if measured_fields.of(system) else 0


class FunctionPolicy(_Adapted):
    """A function (observation) -> actions as a Policy.

    Args:
        function: of observations (env, fields) float32; returns actions (env, ...).
        name: see ``as_policy``.
        forecasts, candidates: of the environment that it was made for, as in ``gym.make``.
    """

    def __init__(
        self,
        function: Callable[[Array], Any],
        name: str = "function",
        forecasts: bool = False,
        candidates: int | None = None,
    ) -> None:
        super().__init__(name, forecasts, candidates)
        self.function = function

    def answer(self, observation: Array, belief: Any, mask: Array | None) -> Any:
        """See ``_Adapted``."""
        return self.function(observation)


class PredictPolicy(_Adapted):
    """An object with ``predict`` as a Policy: a model or a policy of Stable-Baselines3 or sb3-contrib, or one's own.

    ``predict(observation)`` also receives those of the following arguments that it accepts: ``state`` (its own, of the
    last call), ``episode_start`` (env,) bool, ``deterministic=True`` and ``action_masks`` (env, actions) bool. It
    returns the actions, or a pair of them and a state.

    Args:
        model: the object.
        name: see ``as_policy``.
        forecasts, candidates: of the environment that it was made for, as in ``gym.make``, where it does not tell its
            ``observation_space`` and ``action_space``.
    """

    def __init__(self, model: Any, name: str = "model", forecasts: bool = False, candidates: int | None = None) -> None:
        # Of a model only its network travels to other processes: its environment, or replay buffer, would not.
        network: Any = getattr(model, "policy", None)
        self.model: Any = network if hasattr(network, "predict") else model
        shape = getattr(getattr(model, "observation_space", None), "shape", None)
        choices = getattr(getattr(model, "action_space", None), "n", None)
        fields = None if shape is None else int(np.prod(shape))
        super().__init__(name, forecasts, candidates, fields, None if choices is None else int(choices))
        self._taken = frozenset(inspect.signature(self.model.predict).parameters)
        self.forget()

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError where the model's spaces are not the environment's."""
        super().begin(system, num_envs, rng)
        trained = getattr(self.model, "action_space", self._space)
        if _form(trained) != _form(self._space):
            raise InputError(f"policy {self.name!r} chooses from {trained}, expected {self._space}")
        self.forget()

    def forget(self) -> None:
        """See ``_Adapted``."""
        self._state: Any = None

    def answer(self, observation: Array, belief: Any, mask: Array | None) -> Any:
        """See ``_Adapted``."""
        given = {
            "state": self._state,
            "episode_start": belief.step == 0,
            "deterministic": True,
            "action_masks": mask,
        }
        actions = self.model.predict(observation, **{key: given[key] for key in given if key in self._taken})
        if isinstance(actions, tuple):
            actions, self._state = actions
        return actions


def _form(space: Any) -> tuple[Any, ...]:
    """The kind and shape of a space, and how many actions it has where they are discrete."""
    return type(space), space.shape, str(getattr(space, "n", getattr(space, "nvec", "")))


Given = Policy | Callable[[Array], Any] | Factory | str | Path | Sequence[Any]
