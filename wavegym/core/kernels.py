"""How compiled kernels are made: loops over one flat leading axis, called like NumPy functions.

A kernel is a plain Python function in a file called ``kernels.py`` or ``*_kernels.py``, compiled by Numba at its
first use and cached on disk. The cache is the user's, one for all processes, environments and checkouts of a machine.
The cache folder of a file is named by a hash of its source and of all kernel files that it imports: equal sources share
compiled code wherever they are, and a change of a function in *another* file, which Numba alone does not notice, leads
to another folder.
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
from numba.core import caching, event
from numba.core.types import unliteral
from numpy.typing import ArrayLike, NDArray

from wavegym.core.errors import InputError, InputWarning

_SETTINGS: Any = numba.config
_IMPORT = re.compile(r"^(?:from\s+(\S+)\s+import\s+(\([^)]*\)|.*)|import\s+(.*))$", re.MULTILINE)


def _caches() -> Path:
    """The folder of all caches, in the folder of Numba's setting or else in the user's cache folder."""
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return Path(_SETTINGS.CACHE_DIR or user) / "wavegym" / "kernels"


@cache
def _sources(module: str, named: str = "kernels.py") -> frozenset[Path]:
    """The file of an imported module, and those of all modules of kernels that it imports.

    The first module's file may have any name. Other modules count only if their file has the name of a kernel file.
    """
    loaded = sys.modules.get(module)
    file = Path(getattr(loaded, "__file__", None) or "")
    if not file.name or not file.name.endswith(named):
        return frozenset()
    package, found = getattr(loaded, "__package__", None) or "", {file}
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
    for source in sorted(_sources(module, named="")):
        digest.update(source.read_bytes())
    return str(_caches() / digest.hexdigest()[:16])


class _Locator(caching._CacheLocator):
    """Tells Numba where compiled code is: in the folder of its module, whatever the checkout's path."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> _Locator:
        """Called by Numba to make a locator."""
        return cls(function)

    def get_cache_path(self) -> str:
        """The folder."""
        return _cache_folder(self._function.__module__)

    def get_source_stamp(self) -> str:
        """An empty stamp: the name of the folder is a hash of the sources."""
        return ""

    def get_disambiguator(self) -> str:
        """Distinguishes functions of the same name."""
        return f"{self._function.__module__}-{self._function.__code__.co_firstlineno}"


class _Files(caching.IndexDataCacheFile):
    """One file for each version of a function. Numba's index loses versions when several processes write it at once."""

    def save(self, key: Any, data: Any) -> None:
        """Write a version."""
        self._save_data(self._name(key), data)

    def load(self, key: Any) -> Any:
        """Read a version; None where there is none."""
        try:
            return self._load_data(self._name(key))
        except FileNotFoundError:
            return None

    def _name(self, key: Any) -> str:
        return self._data_name(int(hashlib.sha256(repr(key).encode()).hexdigest()[:16], 16))


class _Found(caching.CompileResultCacheImpl):
    """Numba's rules for what can be cached, with the folder of ``_Locator``."""

    _locator_classes: Any = [_Locator]


class _Cache(caching.FunctionCache):
    """The cache of one function."""

    _impl_class = _Found

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file = _Files(self._cache_path, self._impl.filename_base, "")


class _Notice(event.Listener):
    """Prints once per process that kernels are being compiled, because the wait would otherwise look like a hang."""

    printed = False

    def on_start(self, event: Any) -> None:
        function = event.data["dispatcher"].py_func
        if not self.printed and function.__module__.startswith("wavegym."):
            self.printed = True
            print(
                "wavegym: compiling numerical kernels (once on this machine; wavegym warm-up does it beforehand) ...",
                file=sys.stderr,
            )

    def on_end(self, event: Any) -> None:
        """Nothing to print."""


event.register("numba:compile", _Notice())


def _is_writable(place: Path) -> bool:
    """Whether a folder can be written, or made."""
    while not place.exists():
        place = place.parent
    return place.is_dir() and os.access(place, os.W_OK)


_IS_CACHED = _is_writable(_caches())
if not _IS_CACHED:
    warnings.warn(
        f"{_caches()} cannot be written: kernels are compiled in every process (set XDG_CACHE_HOME to a folder)",
        InputWarning,
        stacklevel=2,
    )


def kernel(function: Callable[..., Any]) -> Any:
    """Compile ``function`` with Numba at its first call; division by zero follows IEEE 754 and raises no exception."""
    return _compiled(function, inline=False)


def inlined(function: Callable[..., Any]) -> Any:
    """As ``kernel``, but inlined: for small functions in inner loops. A call expands an array to many arguments."""
    return _compiled(function, inline=True)


def _compiled(function: Callable[..., Any], inline: bool) -> Any:
    compiled: Any = numba.njit(error_model="numpy", forceinline=inline, nogil=True)(function)
    if _IS_CACHED and _sources(function.__module__, named=""):  # a notebook has no source that could be hashed
        compiled._cache = _Cache(function)
    return _without_literals(compiled)


def _without_literals(dispatcher: Any) -> Any:
    """Make kernels that call ``dispatcher`` with constants use the version for all values of their types.

    Numba would compile another version for each constant argument. That took a fifth of the time until a first step.
    """
    resolve = dispatcher.get_call_template

    def resolve_types(args: tuple[Any, ...], named: dict[str, Any]) -> Any:
        return resolve(tuple(map(unliteral, args)), {name: unliteral(value) for name, value in named.items()})

    dispatcher.get_call_template = resolve_types
    return dispatcher


def batched(signature: str) -> Callable[[Callable[..., None]], Callable[..., Any]]:
    """Lift a kernel over one flat leading axis to any leading axes that broadcast, like a NumPy function.

    Args:
        signature: core dimensions in NumPy's notation, ``"(n),(n,n)->(n)"``. The kernel receives C-contiguous float64
            inputs and empty outputs, each with one leading axis, and fills the outputs. The next arguments are tuples
            of zeros, one for each named dimension in order of appearance. The length of a tuple is the size of the
            dimension, and the compiler knows it.

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
    dimensions: list[tuple[int, ...]]  # a tuple of zeros for each named core dimension; its length is the size


def _plan(cores_in: list[list[str]], cores_out: list[list[str]], shapes: tuple[tuple[int, ...], ...]) -> _Plan:
    """Match shapes with the signature; ValueError if they do not fit."""
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
