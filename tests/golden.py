"""Tapes and costs of every environment, to prove that a change changes no number.

    python tests/golden.py record FILE                  records what this checkout plays
    python tests/golden.py compare OTHER_CHECKOUT       records both on this machine, and compares to the last bit

``OTHER_CHECKOUT`` is a folder with another commit, such as the parent's; both are played by the Python that runs this.
``tests/golden.json`` is such a record; ``tests/test_golden.py`` holds the code to it.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
SEED, WORLDS, TUNING, SAVED_WORLDS = 2025, 20, 20, 3
POLICIES = ("random", "round-robin", "myopic", "best-simple", "best-planner")
SLOW: dict[str, tuple[int, dict[str, Any], tuple[str, ...]]] = {  # worlds, parameters and policies of slow environments
    "UrbanSignal-v0": (4, {"horizon": 40}, POLICIES[:4]),
    "AgileClutter-v0": (WORLDS, {}, POLICIES[:4]),
    "Urban-v0": (WORLDS, {}, POLICIES[:4]),
    "RfEo-v0": (WORLDS, {"horizon": 200}, POLICIES),
    "MultifunctionRadar-v1": (4, {"horizon": 400}, POLICIES[:3]),
    "SharedSpectrum-v0": (4, {}, POLICIES),
}
MOVED = {  # where the checkout of another commit may have it
    "draw_worlds": ("wavegym.core.worlds", "wavegym.evaluation.worlds"),
    "world_seeds": ("wavegym.core.worlds", "wavegym.evaluation.worlds"),
    "load_policy": ("wavegym.policies.runs", "agents.policies.runs"),
    "make_policy": ("wavegym.schedulers.registry", "wavegym.schedulers.names"),
}


def moved(name: str) -> Any:
    """A function by its name, from the first of its modules that exists."""
    for module in MOVED[name]:
        try:
            return getattr(importlib.import_module(module), name)
        except ImportError:
            continue
    raise ImportError(name)


def leaves(tree: Any) -> Iterator[np.ndarray]:
    """The arrays of nested tuples."""
    if isinstance(tree, tuple):
        for branch in tree:
            yield from leaves(branch)
    elif tree is not None:
        yield np.asarray(tree)


def digest(tree: Any) -> str:
    """A hash of all arrays with their types and shapes."""
    sha = hashlib.sha256()
    for leaf in leaves(tree):
        sha.update(repr((leaf.dtype.str, leaf.shape)).encode())
        sha.update(np.ascontiguousarray(leaf).tobytes())
    return sha.hexdigest()


def record(
    name: str, policies: tuple[str, ...] = (), worlds: int = WORLDS, saved: int = SAVED_WORLDS
) -> dict[str, Any]:
    """The tape of one environment, and episode costs of its policies and saved agents as hexadecimal floats.

    Args:
        name: such as ``"RfEo-v0"``.
        policies: policies to play; if empty, all of the environment's.
        worlds: number of worlds for each scheduler; the random one plays all, because its draws depend on their number.
        saved: number of worlds for each saved agent; 0 plays none.
    """
    from wavegym.evaluation import make_task
    from wavegym.evaluation.play import play

    draw_worlds, world_seeds = moved("draw_worlds"), moved("world_seeds")
    most, settings, listed = SLOW.get(name, (WORLDS, {}, POLICIES))
    task, seeds = make_task(name, settings), world_seeds(SEED, "test", most)
    tuning = draw_worlds(task.system, world_seeds(SEED, "tune", TUNING))

    def costs(task: Any, policy: Any, seeds: list[int]) -> list[str]:
        return [cost.hex() for cost in play(task, policy, seeds).episode_cost().tolist()]

    found: dict[str, Any] = {"tape": digest(draw_worlds(task.system, seeds)), "settings": settings}
    found["costs"] = {
        policy: costs(
            task, moved("make_policy")(policy, task.system, tuning), seeds[: most if policy == "random" else worlds]
        )
        for policy in policies or listed
    }
    found["saved"] = {}
    folders = sorted((ROOT / "results" / "runs" / name.removesuffix("-v0")).glob("*/seed*")) if saved else []
    for folder in folders:
        own = json.loads((folder / "run.json").read_text("utf-8"))["settings"]["environment"]
        other = make_task(name, {**settings, **own})
        (policy,) = moved("load_policy")(folder, f"wavegym/{name}", other.system)
        found["saved"][f"{folder.parent.name}/{folder.name}"] = costs(other, policy, seeds[:saved])
    return found


def record_all(file: Path) -> None:
    """Record every environment of the suite; those that the file has already are kept."""
    import wavegym

    found = json.loads(file.read_text("utf-8")) if file.exists() else {}
    for name in (id.removeprefix("wavegym/") for id in wavegym.list_envs() if id.startswith("wavegym/")):
        if name not in found:
            found[name] = record(name)
            file.write_text(json.dumps(found, indent=1) + "\n", "utf-8")
            print(name, flush=True)


def compare(other: Path) -> int:
    """Record this checkout and another one; the number of environments that differ."""
    records = []
    with tempfile.TemporaryDirectory() as folder:
        for checkout in (ROOT, other.resolve()):
            file = Path(folder) / f"{len(records)}.json"
            source = f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); import golden\n"
            source += f"from pathlib import Path; golden.ROOT = Path({str(checkout)!r})\n"
            source += f"golden.record_all(Path({str(file)!r}))"
            environment = {**os.environ, "PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1"}
            subprocess.run([sys.executable, "-c", source], check=True, cwd=checkout, env=environment)
            records.append(json.loads(file.read_text("utf-8")))
    here, there = records
    wrong = [name for name in {*here, *there} if here.get(name) != there.get(name)]
    print(f"{len(here)} environments, differing: {', '.join(sorted(wrong)) or 'none'}")
    return len(wrong)


def main(arguments: list[str]) -> int:
    """The command; returns its exit status."""
    if len(arguments) == 2 and arguments[0] == "record":
        record_all(Path(arguments[1]))
        return 0
    if len(arguments) == 2 and arguments[0] == "compare":
        return min(compare(Path(arguments[1])), 1)
    print(__doc__, file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
