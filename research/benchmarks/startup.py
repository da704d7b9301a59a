"""How long the first step of each environment takes: ``python -m research.benchmarks.startup [ID ...]``.

A new process makes, resets and steps each environment: first with an empty cache of kernels, then with the cache of the
first process. Then four processes with one empty cache play one environment at the same time. Seconds are CPU time of
the process, with its imports. On an idle machine that is the waiting time. Figures are written to results/startup.csv
and docs/speed.md.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tqdm import tqdm

from agents import blocks
from research.benchmarks.figures import read_rows, renew_rows
from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import InputError
from wavegym.evaluation.table import tabulated
from wavegym.registration import SYSTEMS, full_id, stem

ROOT = Path(__file__).parents[2]
FILE, PAGE = ROOT / "results" / "startup.csv", ROOT / "docs" / "speed.md"
START, END = "<!-- made by `python -m research.benchmarks.startup`: -->", "<!-- startup to here -->"
HEAD = "environment,cold,warm"
AT_ONCE, SHARED = 4, "wavegym/KershawEvans-v0"
FIRST_STEP = """
import sys, time
import gymnasium as gym, wavegym
env = gym.make(sys.argv[1], disable_env_checker=True)
env.reset(seed=0)
_, reward, *_ = env.step(env.unwrapped.policy("random")())
print(time.process_time(), float(reward).hex())
"""


def begun(env_id: str, cache: str) -> subprocess.Popen[str]:
    """Start a process that plays the first step of an environment, with a folder for compiled kernels."""
    settings = {**os.environ, "NUMBA_CACHE_DIR": cache, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-W", "error", "-c", FIRST_STEP, env_id]
    return subprocess.Popen(command, env=settings, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def ended(process: subprocess.Popen[str]) -> tuple[float, str]:
    """CPU seconds of such a process, and the reward of its step. Raises an InputError if it failed."""
    out, err = process.communicate()
    if process.returncode:
        raise InputError(f"the first step failed: {' '.join(err.split())[-400:]}")
    seconds, reward = out.split()
    return float(seconds), reward


def measured(env_id: str) -> tuple[float, float]:
    """Seconds until an environment's first step, with an empty cache and with the cache that this step has filled."""
    with tempfile.TemporaryDirectory() as cache:
        cold, warm = (ended(begun(env_id, cache))[0] for _ in range(2))
    return cold, warm


def at_once() -> float:
    """Seconds of wall time until ``AT_ONCE`` processes with one empty cache have made the same first step.

    Raises:
        InputError: a process failed, or the rewards differ.
    """
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as cache:
        processes = [begun(SHARED, cache) for _ in range(AT_ONCE)]
        rewards = {ended(process)[1] for process in processes}
    if len(rewards) > 1:
        raise InputError(f"rewards of the same step are {sorted(rewards)}, expected one value")
    return time.perf_counter() - start


def main() -> None:
    """The command."""
    parser = Parser(
        prog="python -m research.benchmarks.startup", description="Seconds until the first step of an environment."
    )
    parser.add_argument("ids", nargs="*", metavar="ID", help="environments (default: all of the suite)")
    ids = [full_id(name) for name in parser.read(None).ids] or list(SYSTEMS)
    for env_id in tqdm(ids, unit="environment", disable=None):
        cold, warm = measured(env_id)
        renew_rows(FILE, HEAD, stem(env_id), [[stem(env_id), f"{cold:.1f}", f"{warm:.1f}"]])
    blocks.renew(PAGE, START, END, tabulated(["environment", "cold, s", "warm, s"], read_rows(FILE)))
    print(f"{AT_ONCE} processes at once, {stem(SHARED)}, one empty cache: {at_once():.1f} s by the clock, same rewards")


if __name__ == "__main__":
    sys.exit(guarded(main))
