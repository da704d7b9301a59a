"""Hooks of mkdocs: the navigation and the API list follow the records of the suite (``wavegym.registration``)."""

from __future__ import annotations

from typing import Any

from wavegym.registration import NAMESPACE, SYSTEMS

ENVIRONMENTS, SYSTEMS_PAGE, MARK = "Environments", "api/systems.md", "<!-- the systems of the suite -->"
OPTIONS = """
    options:
      show_root_heading: true
      show_root_toc_entry: true
      inherited_members: false
"""


def on_config(config: Any) -> Any:
    """Append the page of every environment to the navigation."""
    names = [env_id.removeprefix(NAMESPACE) for env_id in SYSTEMS]
    section = next(entry[ENVIRONMENTS] for entry in config["nav"] if ENVIRONMENTS in entry)
    section += [{name: f"environments/{name}.md"} for name in names]
    return config


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """List the class of every environment in the API reference, once."""
    if page.file.src_uri != SYSTEMS_PAGE:
        return markdown
    places = dict.fromkeys(record.system.replace(":", ".") for record in SYSTEMS.values())
    return markdown.replace(MARK, "\n".join(f"::: {place}{OPTIONS}" for place in places))
