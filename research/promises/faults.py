"""Commands that are killed at random: ``python -m research.promises.faults [--kills N]``.

A training and an evaluation are killed many times, by SIGKILL, SIGTERM or SIGINT, and started again each time. At the
end their results must be those of undisturbed commands, byte for byte, and none of their processes may be left.
"""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import InputError, check_int

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
PATIENCE = 5.0  # s until the workers of a killed command have ended
SLEEP = 0.05  # s between two looks
WAVEGYM = (sys.executable, "-m", "wavegym")
SMALL = ["num_envs=8", "n_steps=10", "batch_size=40", "n_epochs=2", "network=[8,8]", "steps=40_000", "variants=[]"]
COMMANDS = {
    "train": (
        (
            *["train", "KershawEvansPosition-v0", "--algo", "ppo", "--quiet", "--checkpoint-every", "400", "--setting"],
            *SMALL,
        ),
        ("policy.npz", "curve.csv"),
    ),
    "evaluate": (
        ("evaluate", "CameraSlew-v0", "--policies", "rollout:5,greedy", "--worlds", "400", "--jobs", "2"),
        ("episodes.csv",),
    ),
}


def undisturbed(name: str, out: Path) -> float:
    """Run a command to its end; the seconds that it took."""
    begun = time.monotonic()
    subprocess.run([*WAVEGYM, *COMMANDS[name][0], "--out", str(out)], check=True, capture_output=True)
    return time.monotonic() - begun


def disturbed(name: str, out: Path, kills: int, seconds: float, chance: random.Random) -> int:
    """Run a command, killed up to ``kills`` times, to its end; returns the number of kills.

    Raises:
        InputError: a process of a killed command is left, or the command fails without being killed.
    """
    command = [*WAVEGYM, *COMMANDS[name][0], "--out", str(out)]
    for done in range(kills + 1):
        resumed = ["--resume"] if name == "train" and (out / "training.json").exists() else []
        process = subprocess.Popen([*command, *resumed], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        if done == kills or not killed(process, chance.uniform(0.1, 0.8) * seconds, chance.choice(SIGNALS)):
            if process.wait() != 0:
                raise InputError(f"{name} fails after {done} kills with status {process.returncode}, expected 0")
            return done
    return kills


def killed(process: subprocess.Popen[bytes], after: float, sent: signal.Signals) -> bool:
    """Kill a process and wait for its children; False if it ended before."""
    end = time.monotonic() + after
    while time.monotonic() < end:
        if process.poll() is not None:
            return False
        time.sleep(SLEEP)
    workers = children(process.pid)
    process.send_signal(sent)
    process.wait()
    end = time.monotonic() + PATIENCE
    while left := [worker for worker in workers if is_alive(worker)]:
        if time.monotonic() > end:
            raise InputError(f"processes {left} are left {PATIENCE:g} s after {sent.name}, expected none")
        time.sleep(SLEEP)
    return True


def children(process: int) -> list[int]:
    """The processes that a process has started."""
    lines = _listed("-A", "-o", "pid=,ppid=")
    return [int(child) for child, parent in map(str.split, lines) if int(parent) == process]


def is_alive(process: int) -> bool:
    """Whether a process runs."""
    return any(not line.startswith("Z") for line in _listed("-o", "stat=", "-p", str(process)))


def _listed(*options: str) -> Sequence[str]:
    return subprocess.run(["ps", *options], capture_output=True, text=True, check=False).stdout.splitlines()


def main() -> None:
    """Print a line for each command."""
    parser = Parser(prog="python -m research.promises.faults", description="Commands that are killed at random.")
    parser.add_argument("names", nargs="*", metavar="COMMAND", help=f"which of {', '.join(COMMANDS)} (default: all)")
    parser.add_argument("--kills", type=int, default=20, help="of each command (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of times and signals (default: %(default)s)")
    read = parser.read(None)
    check_int("--kills", read.kills, 1)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it, and so its children
    for name in read.names or COMMANDS:
        chance, count = random.Random(read.seed), 0
        with tempfile.TemporaryDirectory() as folder:
            seconds = undisturbed(name, Path(folder, "whole"))
            while count < read.kills:
                out = Path(folder, f"killed{count}")
                count += disturbed(name, out, min(5, read.kills - count), seconds, chance)
                for file in COMMANDS[name][1]:
                    if (out / file).read_bytes() != Path(folder, "whole", file).read_bytes():
                        raise InputError(f"{name}: {file} differs after kills from that of an undisturbed command")
        print(f"{name}: {count} kills, the same files to the byte, no process left", flush=True)


if __name__ == "__main__":
    sys.exit(guarded(main))
