"""Policies in ONNX files, whatever library wrote them. Loading one runs no code of it. Needs ``onnxruntime``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.system import System
from wavegym.observations.forecasts import Forecasts

OBSERVATION, MASK, ACTION = "observation", "mask", "action"


class OnnxPolicy:
    """A deterministic policy in an ONNX file, as ``wavegym export`` writes it.

    The input ``observation`` is float32 (batch, elements): the environment's observation; or this and the forecasts of
    each candidate, as with ``forecasts=True``; or the forecasts alone. The number of elements tells which. The input
    ``mask``, bool (batch, alternatives), may be absent. The output ``action`` is int64 (batch,) or (batch, sensors),
    or float32 (batch, parameters) for a box.

    Args:
        file: the ONNX file.

    Raises:
        InputError: no such file, no ONNX model of this form, or ``onnxruntime`` is not installed.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        try:
            self._content = file.read_bytes()
        except OSError as error:
            raise InputError(f"{file} cannot be read: {error.strerror}") from None
        self._session: Any = None
        self._forecasts: Forecasts | None = None
        self._own = 0
        inputs, outputs = (
            {each.name: each for each in found} for found in (self.session.get_inputs(), self.session.get_outputs())
        )
        shape: list[Any] = inputs[OBSERVATION].shape if OBSERVATION in inputs else []
        if set(inputs) - {OBSERVATION, MASK} or ACTION not in outputs or len(shape) != 2 or isinstance(shape[1], str):
            found = f"inputs {', '.join(inputs)} and outputs {', '.join(outputs)}"
            wanted = f"{OBSERVATION} (batch, elements), perhaps {MASK}, and {ACTION}"
            raise InputError(f"policy {str(file)!r} has {found}, expected {wanted}, as of wavegym export")
        self.elements, self._takes_mask = int(shape[1]), MASK in self._all_inputs()

    @property
    def session(self) -> Any:
        """The runtime's session, with one thread; made when it is first needed."""
        if self._session is None:
            try:
                import onnxruntime
            except ImportError as error:
                raise InputError(f"policy {str(self.file)!r} needs {error.name}: pip install 'wavegym[onnx]'") from None
            options = onnxruntime.SessionOptions()
            options.log_severity_level, options.intra_op_num_threads = 3, 1
            try:
                self._session = onnxruntime.InferenceSession(self._content, options)
            except Exception as error:  # whatever the runtime raises
                text = " ".join(str(error).split())
                raise InputError(f"policy {str(self.file)!r} is no ONNX model that can be loaded: {text}") from None
        return self._session

    def _all_inputs(self) -> list[str]:
        """Names of the inputs, those with a default included."""
        return [each.name for each in (*self.session.get_inputs(), *self.session.get_overridable_initializers())]

    def __getstate__(self) -> dict[str, Any]:
        """The policy without its session, which cannot be sent to another process."""
        return {**self.__dict__, "_session": None}

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError if the model takes another number of elements."""
        self._own, self._forecasts = len(system.observation_fields), None
        if self.elements == self._own:
            return
        sizes = {self._own: "the observation"}
        try:
            self._forecasts = Forecasts(system)
            count = len(self._forecasts.observation_fields)
            sizes |= {count: "its forecasts", self._own + count: "both"}
        except InputError:  # this system has none
            pass
        if self.elements not in sizes:
            wanted = " or ".join(f"{size} ({what})" for size, what in sizes.items())
            raise InputError(f"policy {str(self.file)!r} takes {self.elements} elements, expected {wanted}")

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        if observation is None:
            raise InputError(f"policy {str(self.file)!r} was given no observation, expected the environment's")
        given = observation[:, : self._own]
        if self._forecasts is not None:
            is_shown = observation.shape[1] > self._own
            forecasts = observation[:, self._own :] if is_shown else self._forecasts(belief)
            is_alone = self.elements == forecasts.shape[1]
            given = forecasts if is_alone else np.concatenate([given, forecasts], axis=1)
        fed = {OBSERVATION: np.ascontiguousarray(given, np.float32)}
        if self._takes_mask and mask is not None:
            fed[MASK] = mask
        return np.asarray(self.session.run([ACTION], fed)[0])
