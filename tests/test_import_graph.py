"""Imports go down: no circle, rooms in one order; imports under TYPE_CHECKING count too."""

from __future__ import annotations

import ast
from pathlib import Path

import networkx as nx
import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("wavegym", "agents", "research")

# From the lowest room to the highest: a file may import from its own room and from lower ones.
ROOMS = (
    "wavegym.core",
    "wavegym.registration",
    "wavegym.waveforms",
    "wavegym.targets",
    "wavegym.sensors",
    "wavegym.trackers",
    "wavegym.rendering",
    "wavegym.systems",
    "wavegym.observations",
    "wavegym.policies",
    "wavegym.schedulers",
    "wavegym.envs",
    "wavegym.testing",
    "wavegym.evaluation",
    "wavegym.integrations",
    "wavegym.learning",
    "wavegym.cli",
    "wavegym",  # the package itself, and python -m wavegym
    "agents",
    "research",
)


def modules(root: Path) -> dict[str, Path]:
    """Every module of the packages by its dotted name, a package's ``__init__`` by the package's."""
    found = {}
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            name = ".".join(path.relative_to(root).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = path
    return found


def imported(source: str, known: set[str]) -> set[str]:
    """The modules among ``known`` that a file imports, wherever in it the import stands."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            whole = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= {name if name in known else node.module for name in whole}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return names & known


def graph(root: Path) -> nx.DiGraph:
    """An arrow from every module to every module that it imports."""
    files = modules(root)
    arrows = nx.DiGraph()
    arrows.add_nodes_from(files)
    for name, path in files.items():
        arrows.add_edges_from((name, other) for other in imported(path.read_text("utf-8"), set(files)) - {name})
    return arrows


def room(module: str) -> str:
    """The room that a module belongs to; an unknown one is an error."""
    parts = module.split(".")
    name = ".".join(parts[:2]) if parts[0] == "wavegym" and module != "wavegym.__main__" else parts[0]
    assert name in ROOMS, f"{module} is in no room, expected one of {ROOMS}"
    return name


def circles(arrows: nx.DiGraph) -> list[list[str]]:
    return [sorted(group) for group in nx.strongly_connected_components(arrows) if len(group) > 1]


def upward(arrows: nx.DiGraph) -> list[tuple[str, str]]:
    return [(a, b) for a, b in arrows.edges if ROOMS.index(room(a)) < ROOMS.index(room(b))]


@pytest.fixture(scope="module")
def arrows() -> nx.DiGraph:
    return graph(ROOT)


@pytest.mark.slow
def test_no_module_imports_itself_by_way_of_others(arrows):
    assert circles(arrows) == []


def test_no_room_imports_a_higher_one(arrows):
    assert upward(arrows) == []


def test_a_state_does_not_know_its_system(arrows):
    """Within a system's folder: state, actions and kernels are below system, and scenes above."""
    below = ("state", "actions", "kernels", "paths", "account", "receivers")
    wrong = [
        (a, b)
        for a, b in arrows.edges
        if a.startswith("wavegym.systems.") and a.rpartition(".")[2].endswith(below) and b.endswith(".system")
        if a.rpartition(".")[0] == b.rpartition(".")[0]
    ]
    assert wrong == []


def test_the_checks_find_what_is_planted():
    """A circle under TYPE_CHECKING, and an arrow that runs up."""
    known = {"wavegym.core.errors", "wavegym.systems.urban.state", "wavegym.systems.urban.system"}
    state = "if TYPE_CHECKING:\n    from wavegym.systems.urban.system import Urban\n"
    system = "from wavegym.systems.urban import state\n"
    errors = "def f():\n    import wavegym.systems.urban.state\n"
    planted = nx.DiGraph()
    for name, source in zip(sorted(known), (errors, state, system), strict=True):
        planted.add_edges_from((name, other) for other in imported(source, known))
    assert circles(planted) == [["wavegym.systems.urban.state", "wavegym.systems.urban.system"]]
    assert upward(planted) == [("wavegym.core.errors", "wavegym.systems.urban.state")]
