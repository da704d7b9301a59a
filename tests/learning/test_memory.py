"""Freed memory is used again without the operating system."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

PROGRAM = """
import resource
import torch
from wavegym.learning.train import keep_freed_memory

keep_freed_memory()
for _ in range(20):  # at first small blocks may come between large ones
    torch.ones(2**24)  # 64 MiB: 16 384 pages
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(10):
    torch.ones(2**24)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.slow
def test_a_large_tensor_takes_the_place_of_the_one_before() -> None:
    """The operating system provides no new pages; without the call it provides ten times those of a tensor."""
    if platform.libc_ver()[0] == "glibc":
        done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
        assert int(done.stdout) < 1000
