"""Special functions of SciPy for kernels: the same bits as ``scipy.special``, without a call of an array function.

SciPy offers its compiled functions by address (``scipy.special.cython_special``). An address changes from process to
process, so the machine code that Numba caches refers to a name, which is given the address here.
"""

from __future__ import annotations

from typing import Any

from llvmlite.binding import add_symbol
from numba import types
from numba.extending import get_cython_function_address


def _of_one_number(name: str) -> Any:
    """The function from float64 to float64 with this name in SciPy, for calls from kernels."""
    symbol = f"wavegym_{name}"
    add_symbol(symbol, get_cython_function_address("scipy.special.cython_special", f"__pyx_fuse_1{name}"))
    return types.ExternalFunction(symbol, types.float64(types.float64))


erfc = _of_one_number("erfc")
"""1 - erf(x)."""
erfcx = _of_one_number("erfcx")
"""exp(x^2) erfc(x)."""
