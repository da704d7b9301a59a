"""The documentation site, the contributor's guide and the citation name what is there."""

from __future__ import annotations

import importlib
import re
import runpy
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

from wavegym.core import VERSION
from wavegym.registration import SYSTEMS

ROOT = Path(__file__).parents[1]
API, ENVIRONMENTS = ROOT / "docs" / "api", ROOT / "docs" / "environments"
HOOKS = runpy.run_path(str(ROOT / "docs" / "hooks.py"))
LINK = re.compile(r"\]\((?!https?://)([^)#]+)")


@pytest.mark.parametrize("page", [ROOT / "README.md", ROOT / "CONTRIBUTING.md"], ids=lambda page: page.name)
def test_links_of_the_front_pages_lead_somewhere(page):
    links = LINK.findall(page.read_text())
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_every_room_has_a_page_of_the_reference():
    inner = {"cli", "rendering"}  # nobody imports them
    rooms = {folder.parent.name for folder in (ROOT / "wavegym").glob("*/__init__.py")} - inner
    assert {page.stem for page in API.glob("*.md")} == rooms


@pytest.mark.parametrize("page", sorted(API.glob("*.md")), ids=lambda page: page.stem)
def test_the_reference_shows_every_public_name(page):
    """A function with its module's name is hidden by the module, so that the page has to name it."""
    room = importlib.import_module(f"wavegym.{page.stem}")
    hidden = {name for name in getattr(room, "__all__", []) if (Path(room.__file__).parent / f"{name}.py").exists()}
    shown = set(re.findall(r"^::: (\S+)", page.read_text(), re.MULTILINE))
    assert {f"wavegym.{page.stem}"} | {f"wavegym.{page.stem}.{name}.{name}" for name in hidden} <= shown


def test_the_reference_shows_every_system_of_the_suite():
    page = SimpleNamespace(file=SimpleNamespace(src_uri="api/systems.md"))
    text = HOOKS["on_page_markdown"]((API / "systems.md").read_text(), page=page)
    shown = re.findall(r"^::: (\S+)", text, re.MULTILINE)
    assert {record.system.replace(":", ".") for record in SYSTEMS.values()} <= set(shown)
    assert len(shown) == len(set(shown)), "each once"
    page.file.src_uri = "api/core.md"
    assert HOOKS["on_page_markdown"](text, page=page) == text


def test_the_navigation_leads_to_every_page_of_an_environment():
    nav = [{"Get started": ["index.md"]}, {"Environments": ["environments/index.md"]}]
    section = HOOKS["on_config"]({"nav": nav})["nav"][1]["Environments"]
    pages = ["environments/index.md", *(page for entry in section[1:] for page in entry.values())]
    written = sorted(str(page.relative_to(ROOT / "docs")) for page in ENVIRONMENTS.glob("*.md"))
    assert sorted(pages) == written, "make docs, or python -m research.pages, writes the page of a new environment"


def test_the_places_that_the_contributors_guide_names_exist():
    text = (ROOT / "CONTRIBUTING.md").read_text()
    places = {place for place in re.findall(r"`([\w./]+/[\w./]*)`", text) if "NAME" not in place}
    assert len(places) > 12
    assert [place for place in places if not (ROOT / place).exists()] == []


def test_an_environment_touches_at_most_five_places():
    guide = (ROOT / "CONTRIBUTING.md").read_text()
    section = guide.partition("### An environment")[2].partition("###")[0]
    steps = [int(step) for step in re.findall(r"^(\d+)\. ", section, re.MULTILINE)]
    assert steps == list(range(1, len(steps) + 1))
    assert len(steps) <= 5


def test_the_citation_has_the_version_of_the_package():
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == VERSION


def test_ci_runs_what_the_repository_runs():
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text())["jobs"]
    assert {"run": "make check"} in jobs["check"]["steps"]
    assert {"run": "bash .ci/run"} in jobs["test"]["steps"]
    assert "make test\n" in (ROOT / ".ci" / "run").read_text()


def test_every_tool_has_a_line_in_the_dependency_table():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = [*project["dependencies"], *(each for extra in project["optional-dependencies"].values() for each in extra)]
    table = (ROOT / "docs" / "architecture.md").read_text().partition("## Dependencies")[2].lower()
    common = {
        "pytest",
        "pytest-xdist",
        "hypothesis",
        "ruff",
        "mypy",
        "build",
        "setuptools",
        "networkx",
    }  # tools of tests
    names = {re.split(r"[\[<>=]", each)[0].lower() for each in asked}
    assert [name for name in sorted(names - common) if name not in table] == []


def test_the_readme_links_every_how_to_page_and_is_short():
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 120
    assert [page.name for page in (ROOT / "docs" / "how_to").glob("*.md") if f"how_to/{page.name}" not in text] == []
