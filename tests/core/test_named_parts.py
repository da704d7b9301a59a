from __future__ import annotations

import sys

import pytest

from wavegym.core import registry
from wavegym.core.errors import InputError
from wavegym.core.registry import Registry, import_package


@pytest.fixture
def parts():
    return Registry("chirp law", {"own": int})


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """A package with entry points, as pip would have installed it."""
    (tmp_path / "their_laws.py").write_text("def law(): return 7\n")
    about = tmp_path / "their_laws-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: their-laws\nVersion: 1.0\n")
    points = "theirs = their_laws:law\nbroken = their_laws:none\nown = their_laws:law\n"
    (about / "entry_points.txt").write_text(f"[wavegym.chirp_laws]\n{points}")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield
    sys.modules.pop("their_laws", None)


def test_a_registered_part_is_found_by_its_name(parts):
    parts.register("mine", float)
    assert parts.get("mine") is float
    assert parts.get("own") is int
    assert parts.names()[:2] == ("own", "mine")
    assert "mine" in parts
    assert "other" not in parts
    parts.register("mine", float)  # the same part again


@pytest.mark.parametrize(
    ("name", "part", "words"),
    [
        ("own", float, "chirp law 'own' is registered already, expected another name"),
        ("mine", str, "chirp law 'mine' is registered already"),
        ("a:b", float, "name of a chirp law is 'a:b', expected a letter, then letters, digits"),
        ("", float, "name of a chirp law is ''"),
        (3, float, "name of a chirp law is 3"),
        ("new", 3, "'new' is registered as 3, expected something callable"),
    ],
)
def test_what_cannot_be_registered_is_one_line(parts, name, part, words):
    parts.register("mine", float)
    with pytest.raises(InputError, match=f"^{words}"):
        parts.register(name, part)
    assert parts.get("mine") is float


@pytest.mark.parametrize("name", ["ownn", ["own"], None])
def test_an_unknown_name_is_answered_with_the_nearest(parts, name):
    with pytest.raises(InputError, match=r"^chirp law is .*, expected one of 'own'.*; did you mean 'own'") as caught:
        parts.get(name)
    assert "\n" not in str(caught.value)


def test_entry_points_are_read_on_a_miss_only(parts, monkeypatch):
    parts.register("mine", float)
    monkeypatch.setattr(registry, "entry_points", lambda group: pytest.fail("read"))
    assert [parts.get("own"), parts.get("mine")] == [int, float]


@pytest.mark.usefixtures("installed")
def test_entry_points_are_loaded_when_asked_for(parts):
    assert {"theirs", "broken"} <= set(parts.names())
    assert "theirs" in parts
    assert "their_laws" not in sys.modules
    assert parts.get("theirs")() == 7
    assert parts.get("own") is int
    with pytest.raises(InputError, match="chirp law 'broken' is at 'their_laws:none', which cannot be loaded"):
        parts.get("broken")


def test_a_package_that_is_not_there_is_named():
    for name in ("no_such_package", ""):
        with pytest.raises(InputError, match=f"^package is '{name}', expected an importable one"):
            import_package(name)
