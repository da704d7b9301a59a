"""How much code there is, and how much of it runs: ``python -m research.benchmarks.paths``.

Prints four tables: modules of wavegym that an import loads; functions and files of wavegym that a step and ``wavegym
evaluate`` pass; lines and files of each folder; the largest files. A function counts once, however often it is called.
Compiled kernels that Python calls count (Numba reports them to ``sys.setprofile``). Kernels that other kernels call,
comprehensions, lambdas and code that runs during an import do not count.
"""

from __future__ import annotations

import io
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import gymnasium as gym

import wavegym
from wavegym.cli.main import main as command
from wavegym.evaluation.table import tabulated

ROOT = Path(__file__).parents[2]
PACKAGE = str(Path(wavegym.__file__).parent)
FOLDERS = ("wavegym", "agents", "research", "tests")
LARGEST = 5
EVALUATE = ["evaluate", "KershawEvans-v0", "--policies", "myopic,best-fixed", "--worlds", "10", "--jobs", "1", "--out"]


def passed(run: Callable[[], object]) -> set[CodeType]:
    """The functions of wavegym that ``run`` calls."""
    found, importing = set[CodeType](), 0

    def note(frame: FrameType, event: str, argument: Any) -> None:
        nonlocal importing
        code = frame.f_code
        if code.co_name == "<module>":
            importing += {"call": 1, "return": -1}.get(event, 0)
        elif event == "call" and not importing and code.co_name[0] != "<" and code.co_filename.startswith(PACKAGE):
            found.add(code)

    sys.setprofile(note)
    try:
        run()
    finally:
        sys.setprofile(None)
    return found


def of_step(env_id: str) -> set[CodeType]:
    """The functions that one step of an environment passes."""
    env = gym.make(env_id, disable_env_checker=True)
    env.reset(seed=0)
    env.action_space.seed(0)
    env.step(env.action_space.sample())  # loads kernels
    action = env.action_space.sample()
    return passed(lambda: env.step(action))


def of_evaluate() -> set[CodeType]:
    """The functions that a comparison of two policies passes, on ten worlds in this process."""
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()):
        return passed(lambda: command([*EVALUATE, folder]))


def loaded(statement: str) -> int:
    """How many modules of wavegym a statement loads in a new process."""
    code = f"{statement}\nimport sys\nprint(sum(name.split('.')[0] == 'wavegym' for name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, check=True)
    return int(done.stdout.split()[-1])


def lines() -> dict[Path, int]:
    """Lines of every Python file below ``FOLDERS``."""
    files = (file for folder in FOLDERS for file in sorted((ROOT / folder).rglob("*.py")))
    return {file.relative_to(ROOT): file.read_text("utf-8").count("\n") for file in files}


def main() -> None:
    """Print Markdown tables."""
    with tempfile.TemporaryDirectory() as folder:
        whole = f"from wavegym.cli.main import main; main({[*EVALUATE, folder]})"
        statements = {"`import wavegym`": "import wavegym", "`import wavegym.evaluation`": "import wavegym.evaluation"}
        rows = [[name, str(loaded(each))] for name, each in {**statements, "`wavegym evaluate`": whole}.items()]
    print(tabulated(["run", "modules"], rows), end="\n\n")
    runs = {"`wavegym evaluate`": of_evaluate()}
    runs |= {f"a step of {env_id}": of_step(f"wavegym/{env_id}") for env_id in ("KershawEvans-v0", "RfEo-v0")}
    rows = [[name, str(len(found)), str(len({code.co_filename for code in found}))] for name, found in runs.items()]
    print(tabulated(["run", "functions", "files"], rows), end="\n\n")
    counted = lines()
    rooms = sorted({f"wavegym/{f.parts[1]}" for f in counted if f.parts[0] == "wavegym" and len(f.parts) > 2})
    rows = []
    for folder in (*FOLDERS, *rooms):
        below = [n for file, n in counted.items() if file.is_relative_to(folder)]
        rows.append([folder, str(sum(below)), str(len(below))])
    print(tabulated(["folder", "lines", "files"], rows), end="\n\n")
    largest = sorted((n, str(file)) for file, n in counted.items() if file.parts[0] == "wavegym")[-LARGEST:]
    print(tabulated(["largest file of wavegym", "lines"], [[name, str(n)] for n, name in reversed(largest)]))


if __name__ == "__main__":
    main()
