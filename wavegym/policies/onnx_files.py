"""Policies as ONNX files: trained networks are exported without torch, and a file of any library plays.

Loading a file runs no code of it. Export needs ``onnx``, playing ``onnxruntime``: the extra ``onnx``.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from wavegym.core import VERSION
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.system import System
from wavegym.observations.forecasts import PRESENT
from wavegym.observations.observer import Observer
from wavegym.policies.networks import Network
from wavegym.policies.runs import RUN, read_network, read_run

OPSET, IR = 18, 10  # of ONNX: old enough for runtimes of 2024
ACTIVATIONS = {"tanh": "Tanh", "relu": "Relu"}
OBSERVATION, MASK, ACTION = "observation", "mask", "action"
CANDIDATES = "candidates"  # entry of the metadata: length of the short list from which the model chooses; 0: none


def export_onnx(folder: Path, file: Path) -> None:
    """Write the policy of a run's folder as an ONNX file.

    Raises:
        InputError: no finished run, a torn policy file, or the extra ``onnx`` is not installed.
        OSError: ``file`` cannot be written.
    """
    run = read_run(folder / RUN)
    about = {key: str(run[key]) for key in ("env", "algo", "seed")}
    about["observation"] = ", ".join(run["observation"])
    about["forecasts"] = str(bool(run["settings"].get("forecasts", False)))
    about[CANDIDATES] = str(run["settings"].get(CANDIDATES, 0))
    content = to_onnx(read_network(folder, run), about)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(content)


def to_onnx(network: Network, about: dict[str, str] | None = None) -> bytes:
    """The network as the bytes of an ONNX model.

    The input ``observation`` is float32 (batch, elements), from an environment with the ``forecasts`` of the training;
    of candidates that are alike, the forecasts alone.
    The output ``action`` is int64 (batch,), or (batch, sensors), or for a box float32 (batch, parameters) in [-1, 1].
    For finite sets there are also the output ``scores`` (batch, alternatives) and the optional input ``mask``, bool of
    the same shape: the allowed alternatives (default: all). onnxruntime logs a warning about this default.

    Args:
        network: of any kind.
        about: entries of the model's metadata.

    Raises:
        InputError: the extra ``onnx`` is not installed.
    """
    try:
        import onnx
    except ImportError as error:
        raise InputError(f"export to ONNX needs the extra: {error}; pip install 'wavegym[onnx]'") from None
    graph = _Graph(network)
    helper = onnx.helper
    floats, integers, booleans = onnx.TensorProto.FLOAT, onnx.TensorProto.INT64, onnx.TensorProto.BOOL
    elements = network.inputs * (network.heads[0] if network.is_alike else 1)
    inputs = [helper.make_tensor_value_info("observation", floats, ["batch", elements])]
    outputs = [helper.make_tensor_value_info("action", integers, ["batch"])]
    if graph.alternatives:
        inputs.append(helper.make_tensor_value_info("mask", booleans, ["masks", graph.alternatives]))
        outputs.append(helper.make_tensor_value_info("scores", floats, ["batch", graph.alternatives]))
        if len(network.heads) > 1:
            outputs[0] = helper.make_tensor_value_info("action", integers, ["batch", len(network.heads)])
    else:
        outputs[0] = helper.make_tensor_value_info("action", floats, ["batch", graph.parameters])
    nodes = [helper.make_node(kind, list(given), [result], **settings) for kind, given, result, settings in graph.nodes]
    constants = [onnx.numpy_helper.from_array(value, name) for name, value in graph.constants.items()]
    model = helper.make_model(
        helper.make_graph(nodes, "policy", inputs, outputs, constants),
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR,
        producer_name="wavegym",
        producer_version=VERSION,
    )
    helper.set_model_props(model, about or {})
    onnx.checker.check_model(model, full_check=True)
    return model.SerializeToString()


class _Graph:
    """The nodes and constants of a network, in the order of ``Network.outputs`` and ``LearnedPolicy.act``."""

    def __init__(self, network: Network) -> None:
        self.nodes: list[tuple[str, Sequence[str], str, dict[str, Any]]] = []
        self.constants: dict[str, Array] = {}
        self.network, self.activation = network, ACTIVATIONS[network.activation]
        self.alternatives = 0 if network.kind == "mixture" else sum(network.heads)
        self.parameters = 0
        if network.kind == "scorer":
            self._choice(self._scorer())
        elif self.alternatives:
            self._choice(self._mlp())
        else:
            self._point(self._mlp())

    def _add(self, kind: str, *given: str, to: str = "", **settings: Any) -> str:
        """A node; the name of its result."""
        result = to or f"{kind.lower()}_{len(self.nodes)}"
        self.nodes.append((kind, given, result, settings))
        return result

    def _constant(self, value: Any, name: str = "") -> str:
        name = name or f"constant_{len(self.constants)}"
        self.constants[name] = np.asarray(value)
        return name

    def _linear(self, hidden: str, weight: str, offset: str = "") -> str:
        """``hidden @ weight.T + offset``, by names of the network's arrays."""
        arrays = self.network.arrays
        product = self._add("MatMul", hidden, self._constant(np.ascontiguousarray(arrays[weight].T), weight))
        return self._add("Add", product, self._constant(arrays[offset], offset)) if offset else product

    def _columns(self, of: str, columns: Any) -> str:
        return self._add("Gather", of, self._constant(np.asarray(columns, np.int64)), axis=1)

    def _mlp(self) -> str:
        hidden, layers = "observation", self.network.number_of("W")
        for n in range(layers):
            hidden = self._linear(hidden, f"W{n}", f"b{n}")
            if n < layers - 1:
                hidden = self._add(self.activation, hidden)
        return hidden

    def _scorer(self) -> str:
        hidden, axis, present = self._alike() if self.network.is_alike else (*self._in_context(), "")
        hidden = self._add(self.activation, hidden)
        for n in range(self.network.number_of("round") // 3):
            hidden = self._round(hidden, n, axis, present)
        return self._add("Squeeze", self._linear(hidden, "score"), self._constant([2], "score_axis"))

    def _alike(self) -> tuple[str, str, str]:
        """The first layer of candidates that are alike, their axis, and whether each counts (1 or 0)."""
        shape = self._constant(np.array([0, -1, self.network.inputs], np.int64))
        figures = self._add("Reshape", "observation", shape)
        is_one = self._add(
            "Gather", figures, self._constant(np.arange(PRESENT.start, PRESENT.stop), "present_columns"), axis=2
        )
        present = self._add("ReduceSum", is_one, self._constant([2], "figure_axis"), keepdims=1)
        return self._linear(figures, "own", "own_bias"), self._constant([1], "candidate_axis"), present

    def _in_context(self) -> tuple[str, str]:
        """The first layer of candidates with a context, and the axis of the candidates."""
        arrays, elements = self.network.arrays, self.network.arrays["W0"].shape[1]
        candidates = len(arrays["offset"])
        context = self._columns("observation", np.arange(elements))
        for n in range(self.network.number_of("W")):
            context = self._add(self.activation, self._linear(context, f"W{n}", f"b{n}"))
        axis = self._constant([1], "candidate_axis")
        hidden = self._add("Unsqueeze", self._linear(context, "shared", "shared_bias"), axis)
        hidden = self._add("Add", hidden, self._constant(arrays["offset"], "offset"))
        if "own" in arrays:
            figures = (self.network.inputs - elements) // candidates
            predicted = self._columns("observation", np.arange(elements, self.network.inputs))
            shape = self._constant(np.array([-1, candidates, figures], np.int64))
            own = self._add("Reshape", predicted, shape) if figures else ""
            if arrays["pairs"].shape[1]:
                of_targets = self._columns("observation", arrays["pairs"])
                own = self._add("Concat", own, of_targets, axis=2) if own else of_targets
            hidden = self._add("Add", hidden, self._linear(own, "own"))
        return hidden, axis

    def _pools(self, hidden: str, axis: str, present: str) -> list[str]:
        """Means and maxima over the candidates that count."""
        if not present:
            return [self._add(kind, hidden, axis, keepdims=1) for kind in ("ReduceMean", "ReduceMax")]
        total = self._add("ReduceSum", self._add("Mul", hidden, present), axis, keepdims=1)
        mean = self._add("Div", total, self._add("ReduceSum", present, axis, keepdims=1))
        counts = self._add("Greater", present, self._constant(np.float32(0.0)))
        shown = self._add("Where", counts, hidden, self._constant(np.float32(-np.inf)))
        return [mean, self._add("ReduceMax", shown, axis, keepdims=1)]

    def _round(self, hidden: str, n: int, axis: str, present: str) -> str:
        """A round in which the candidates exchange information."""
        pools = self._pools(hidden, axis, present)
        others = self._linear(self._add("Concat", *pools, axis=2), f"round{n}_others")
        own = self._linear(hidden, f"round{n}", f"round{n}_bias")
        exchanged = self._add(self.activation, self._add("Add", own, others))
        width, inputs = self.network.arrays[f"round{n}"].shape
        return self._add("Add", hidden, exchanged) if width == inputs else exchanged

    def _choice(self, scores: str) -> None:
        """The allowed alternative of highest score, for each choice."""
        self._add("Identity", scores, to="scores")
        self._constant(np.ones((1, self.alternatives), np.bool_), "mask")
        masked = self._add("Where", "mask", scores, self._constant(np.float32(-np.inf)))
        edges = np.cumsum([0, *self.network.heads])
        if len(self.network.heads) == 1:
            self._add("ArgMax", masked, to="action", axis=1, keepdims=0)
            return
        parts = [self._columns(masked, np.arange(*edges[n : n + 2])) for n in range(len(self.network.heads))]
        self._add("Concat", *(self._add("ArgMax", part, axis=1, keepdims=1) for part in parts), to="action", axis=1)

    def _point(self, outputs: str) -> None:
        """The point of a box; of a mixture the mean of the likeliest mode."""
        last = self.network.arrays[f"b{self.network.number_of('W') - 1}"]
        self.parameters = len(last)
        if self.network.kind == "mixture":
            (modes,) = self.network.heads
            self.parameters = len(last) // modes - 1
            mode = self._add("ArgMax", self._columns(outputs, np.arange(modes)), axis=1, keepdims=1)
            shape = self._constant(np.array([-1, modes, self.parameters], np.int64))
            means = self._add("Reshape", self._columns(outputs, np.arange(modes, len(last))), shape)
            outputs = self._add("GatherND", means, mode, batch_dims=1)
        bounds = (self._constant(np.float32(bound)) for bound in (-1.0, 1.0))
        self._add("Clip", outputs, *bounds, to="action")


class OnnxPolicy:
    """A deterministic policy in an ONNX file, as ``wavegym export`` writes it.

    The input ``observation`` is float32 (batch, elements): the environment's observation; or this and the forecasts of
    each candidate, as with ``forecasts=True``; or the forecasts alone. The number of elements distinguishes the three.
    A model whose metadata has ``candidates``, K above 0, is given the forecasts of the short list of K, and its action
    is a rank in it. The input ``mask``, bool (batch, alternatives), may be absent. The output ``action`` is int64
    (batch,) or (batch, sensors), or float32 (batch, parameters) for a box.

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
        self._observer: Observer | None = None
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
        candidates = self.session.get_modelmeta().custom_metadata_map.get(CANDIDATES, "0")
        if not candidates.isdecimal():
            wanted = "an integer >= 0"
            raise InputError(f"policy {str(file)!r} has the metadata candidates={candidates!r}, expected {wanted}")
        self._candidates = int(candidates) or None

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
            except Exception as error:  # any error of the runtime
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
        self._own, self._observer = len(system.observation_fields), None
        if self.elements == self._own:
            return
        sizes = {self._own: "the observation"}
        with suppress(InputError):  # of a system that has no forecasts
            self._observer = Observer(system, self._candidates is None, self._candidates)
            count = len(self._observer.observation_fields) - self._own
            sizes |= {count: "its forecasts", self._own + count: "both"}
        if self.elements not in sizes:
            wanted = " or ".join(f"{size} ({what})" for size, what in sizes.items())
            raise InputError(f"policy {str(self.file)!r} takes {self.elements} elements, expected {wanted}")

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        if observation is None:
            raise InputError(f"policy {str(self.file)!r} was given no observation, expected the environment's")
        if self._observer is None:
            return self._answer(observation[:, : self._own], mask)
        if observation.shape[1] != len(self._observer.observation_fields):
            observation, _ = self._observer(belief)
        given = observation[:, observation.shape[1] - self.elements :]
        if self._observer.shortlist is None:
            return self._answer(given, mask)
        listed = self._observer.shortlist
        return listed.taken(belief, self._answer(given, listed(belief).allowed))

    def _answer(self, given: Array, mask: Array | None) -> Array:
        """What the model answers."""
        fed = {OBSERVATION: np.ascontiguousarray(given, np.float32)}
        if self._takes_mask and mask is not None:
            fed[MASK] = mask
        return np.asarray(self.session.run([ACTION], fed)[0])
