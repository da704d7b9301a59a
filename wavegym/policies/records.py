"""Reading, checking and comparing the JSON records run_spec.json and run.json."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from wavegym.core.errors import InputError

# Entries of run.json that evaluation needs.
RUN_FIELDS: dict[str, type] = {
    "env": str,
    "algo": str,
    "seed": int,
    "settings": dict,
    "settings.environment": dict,
    "observation": list,
    "scaling": list,
    "actions": dict,
    "actions.form": str,
    "actions.count": int,
    "actions.sha256": str,
    "policy_sha256": str,
}


class Unlike(NamedTuple):
    """An entry in which two records differ; a record without the entry has None."""

    name: str
    here: Any
    there: Any


def read_record(path: Path) -> dict[str, Any]:
    """A JSON object that a training run wrote.

    Raises:
        InputError: the file is missing or holds no JSON object.
    """
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read: {error}") from None
    if not isinstance(record, dict):
        raise InputError(f"{path} holds no JSON object, expected a record of wavegym train")
    return record


def read_run(path: Path) -> dict[str, Any]:
    """The record of a finished run, with every entry that evaluation needs.

    Raises:
        InputError: the file is missing or no JSON object, or an entry is missing or of another type (named).
    """
    run = read_record(path)
    for name, kind in RUN_FIELDS.items():
        value: Any = run
        for key in name.split("."):
            if key not in value:
                raise InputError(f"{path} is no record of wavegym train: {name!r} is missing")
            value = value[key]
        if not isinstance(value, kind):
            raise InputError(f"{path} is no record of wavegym train: {name!r} is {value!r}, expected {kind.__name__}")
    variants = run["settings"].get("variants", [])
    if not isinstance(variants, list) or not all(isinstance(variant, dict) for variant in variants):
        raise InputError(f"{path} is no record of wavegym train: 'settings.variants' is {variants!r}, expected tables")
    if not all(isinstance(element, str) for element in run["observation"]):
        raise InputError(
            f"{path} is no record of wavegym train: 'observation' is {run['observation']!r}, expected names"
        )
    return run


def difference(here: Mapping[str, Any], there: Mapping[str, Any]) -> Unlike | None:
    """The first entry, in alphabetical order, in which two records differ, such as ``settings.gamma``; or None."""
    mine, other = _flat(here), _flat(there)
    for name in sorted({*mine, *other}):
        if mine.get(name) != other.get(name):
            return Unlike(name, mine.get(name), other.get(name))
    return None


def _flat(record: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """{"settings.gamma": 0.9, ...} of a nested record."""
    flat: dict[str, Any] = {}
    for key, value in record.items():
        flat |= _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: value}
    return flat
