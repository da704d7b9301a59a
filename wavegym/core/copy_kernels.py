"""Copies of vectors and matrices in compiled form.

Numba compiles ``out[:] = source`` with a message for shapes that disagree, which takes three seconds in each kernel
that holds such a line; these loops take none.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from wavegym.core.kernels import kernel


@kernel
def copy_vector(source, out):
    """Copy source (n,) to out (n,)."""
    for i in range(len(out)):
        out[i] = source[i]


@kernel
def copy_matrix(source, out):
    """Copy source (n, m) to out (n, m)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = source[i, j]


@kernel
def copy_matrices(source, out):
    """Copy source (k, n, m) to out (k, n, m)."""
    for i in range(len(out)):
        copy_matrix(source[i], out[i])
