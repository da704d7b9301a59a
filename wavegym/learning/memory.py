"""Memory of a training run."""

from __future__ import annotations

import ctypes
import sys

# Parameters of mallopt, from glibc's malloc.h.
M_TRIM_THRESHOLD, M_MMAP_MAX = -1, -4


def keep_freed_memory() -> None:
    """Let this process keep freed memory for later allocations; has an effect with glibc only.

    glibc returns blocks above 32 MiB to the operating system as soon as they are freed, and clears every page when they
    are allocated again. Activations of a scorer with many candidates are that large: this took two thirds of the time
    of MultifunctionRadar's updates. A run that keeps the memory needs 1.5 times as much.
    """
    if sys.platform != "linux":
        return
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt"):
        library.mallopt(M_MMAP_MAX, 0)
        library.mallopt(M_TRIM_THRESHOLD, 2**31 - 1)
