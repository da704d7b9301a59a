"""How compiled kernels are made: loops over one flat leading axis, called like NumPy functions.

A kernel is a plain Python function in a file called ``kernels.py`` or ``*_kernels.py``, compiled by Numba at its
first use and cached on disk. The cache folder of a file carries a hash of its source, of all kernel files that it
imports and of those that define types of numbers: Numba alone does not notice that a function or a type in *another*
file has changed and would go on with the old one.
"""

from __future__ import annotations

import hashlib
import math
import os
import re
import sys
import warnings
from collections.abc import Callable
from functools import cache, lru_cache, wraps
from importlib.util import resolve_name
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.core import event
from numba.core.types import unliteral
from numpy.typing import ArrayLike, NDArray

from wavegym.core.errors import InputError, InputWarning

PACKAGE = Path(__file__).parents[1]
NUMBER_TYPES = frozenset((PACKAGE / "core").glob("lane*_kernels.py"))  # a kernel of any file may be compiled for these
_IMPORT = re.compile(r"^(?:from\s+(\S+)\s+import\s+(\([^)]*\)|.*)|import\s+(.*))$", re.MULTILINE)


def _caches() -> Path:
    """The folder of all caches: beside the package where that can be written, else the user's."""
    user = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "wavegym"
    return (PACKAGE / "__pycache__" if os.access(PACKAGE, os.W_OK) else user) / "kernels"


@cache
def _sources(module: str) -> frozenset[Path]:
    """The file of an imported module of kernels, and those of all modules of kernels that it imports."""
    loaded = sys.modules.get(module)
    file = Path(getattr(loaded, "__file__", None) or "")
    if not file.name.endswith("kernels.py"):
        return frozenset()
    package, found = getattr(loaded, "__package__", ""), {file}
    for source, names, plain in _IMPORT.findall(file.read_text("utf-8")):
        listed = [name.split()[0] for name in re.split(r"[(),\n]", names or plain) if name.strip()]
        origin = resolve_name(source, package) if source else ""
        for name in [origin, *(f"{origin}.{name}".strip(".") for name in listed)]:
            if name != module:
                found |= _sources(name)
    return frozenset(found)


@cache
def _cache_folder(module: str) -> str:
    """The folder for the compiled code of a module of kernels."""
    digest = hashlib.sha256(numba.__version__.encode())  # versions of Numba overwrite each other's caches
    for source in sorted(_sources(module) | NUMBER_TYPES):
        digest.update(source.read_bytes())
    return str(_caches() / digest.hexdigest()[:16])


class _Notice(event.Listener):
    """Prints once per process that kernels are being compiled, because the wait would otherwise look like a hang."""

    printed = False

    def on_start(self, event: Any) -> None:
        function = event.data["dispatcher"].py_func
        if not self.printed and function.__module__.startswith("wavegym."):
            self.printed = True
            print(
                "wavegym: compiling numerical kernels (once per installation; wavegym warm-up does it beforehand) ...",
                file=sys.stderr,
            )

    def on_end(self, event: Any) -> None:
        """Nothing to print."""


event.register("numba:compile", _Notice())
_SETTINGS: Any = numba.config
_PARENT = _SETTINGS.CACHE_DIR or str(_caches())


def _is_writable(folder: str) -> bool:
    """Whether a folder can be written, or made."""
    place = Path(folder)
    while not place.exists():
        place = place.parent
    return place.is_dir() and os.access(place, os.W_OK)


_IS_CACHED = _is_writable(_PARENT)
if not _IS_CACHED:
    warnings.warn(
        f"{_PARENT} cannot be written: kernels are compiled in every process (set XDG_CACHE_HOME to a folder)",
        InputWarning,
        stacklevel=2,
    )


def kernel(function: Callable[..., Any]) -> Any:
    """Compile ``function`` with Numba at its first call; division by zero follows IEEE 754 and raises no exception."""
    return _compiled(function, inline=False)


def inlined(function: Callable[..., Any]) -> Any:
    """As ``kernel``, but inlined: for small functions in inner loops, as a call passes an array as many arguments."""
    return _compiled(function, inline=True)


def _compiled(function: Callable[..., Any], inline: bool) -> Any:
    configured = _SETTINGS.CACHE_DIR
    # read while the dispatcher is made; other packages' kernels keep their own
    _SETTINGS.CACHE_DIR = configured or _cache_folder(function.__module__)
    try:
        compiled = numba.njit(cache=_IS_CACHED, error_model="numpy", forceinline=inline, nogil=True)(function)
    finally:
        _SETTINGS.CACHE_DIR = configured
    return _without_literals(compiled)


def _without_literals(dispatcher: Any) -> Any:
    """Make kernels that call ``dispatcher`` with constants use the version for all values of their types.

    Numba compiles one more version for each constant argument, which took a fifth of the time until a first step.
    """
    resolve = dispatcher.get_call_template

    def resolve_types(args: tuple[Any, ...], named: dict[str, Any]) -> Any:
        return resolve(tuple(map(unliteral, args)), {name: unliteral(value) for name, value in named.items()})

    dispatcher.get_call_template = resolve_types
    return dispatcher


def batched(signature: str) -> Callable[[Callable[..., None]], Callable[..., Any]]:
    """Lift a kernel over one flat leading axis to any leading axes that broadcast, like a NumPy function.

    Args:
        signature: core dimensions in NumPy's notation, ``"(n),(n,n)->(n)"``. The kernel is given C-contiguous float64
            inputs and empty outputs, each with one leading axis, and fills the outputs. After them it is given, for
            each named dimension in order of appearance, a tuple of that many zeros: its length is known when compiling.

    Returns:
        A decorator. The decorated function takes array-likes and returns one array, or a tuple of several.

    Raises:
        InputError: from the decorated function, when core dimensions disagree.
    """
    inputs, outputs = (re.findall(r"\(([^)]*)\)", side) for side in signature.split("->"))
    cores_in = [[d for d in core.split(",") if d] for core in inputs]
    cores_out = [[d for d in core.split(",") if d] for core in outputs]

    def decorate(function: Callable[..., None]) -> Callable[..., Any]:
        compiled = kernel(function)

        @lru_cache(maxsize=256)
        def plan(shapes: tuple[tuple[int, ...], ...]) -> _Plan:
            try:
                return _plan(cores_in, cores_out, shapes)
            except ValueError as error:
                wanted = f"shapes that fit {signature} with leading axes that broadcast"
                raise InputError(f"{function.__name__}: argument shapes are {shapes}, expected {wanted}") from error

        @wraps(function)
        def lifted(*arguments: ArrayLike) -> Any:
            arrays = [np.asarray(a, np.float64) for a in arguments]
            lead, whole, flat, outputs, dimensions = plan(tuple([a.shape for a in arrays]))
            results = [np.empty(shape) for shape in outputs]
            compiled(
                *[_ready(a, w).reshape(f) for a, w, f in zip(arrays, whole, flat, strict=True)],
                *results,
                *dimensions,
            )
            if len(lead) != 1:
                results = [r.reshape(lead + r.shape[1:]) for r in results]
            return results[0] if len(results) == 1 else tuple(results)

        return lifted

    return decorate


def _ready(array: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.float64]:
    """``array`` broadcast to ``shape``, C-contiguous and writeable: a read-only one would compile a second version."""
    if array.shape == shape and array.flags.c_contiguous and array.flags.writeable:
        return array
    copy = np.empty(shape)
    copy[...] = array
    return copy


class _Plan(NamedTuple):
    """The shapes of all arrays for one combination of argument shapes."""

    lead: tuple[int, ...]
    whole: list[tuple[int, ...]]  # each argument's shape after broadcasting
    flat: list[tuple[int, ...]]  # each argument's shape with its leading axes flattened
    outputs: list[tuple[int, ...]]
    dimensions: list[tuple[int, ...]]  # for each named core dimension, a tuple of that many zeros


def _plan(cores_in: list[list[str]], cores_out: list[list[str]], shapes: tuple[tuple[int, ...], ...]) -> _Plan:
    """Match shapes with the signature; ValueError where they do not fit."""
    sizes: dict[str, int] = {}
    leads = []
    for core, shape in zip(cores_in, shapes, strict=True):
        split = len(shape) - len(core)
        if split < 0 or any(sizes.setdefault(d, s) != s for d, s in zip(core, shape[split:], strict=True)):
            raise ValueError(shape)
        leads.append(shape[:split])
    lead = np.broadcast_shapes(*leads)
    count = math.prod(lead)
    fixed_in, fixed_out = ([tuple(sizes[d] for d in core) for core in cores] for cores in (cores_in, cores_out))
    return _Plan(
        lead,
        whole=[lead + core for core in fixed_in],
        flat=[(count, *core) for core in fixed_in],
        outputs=[(count, *core) for core in fixed_out],
        dimensions=[(0,) * size for size in sizes.values()],
    )
