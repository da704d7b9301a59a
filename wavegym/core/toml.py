"""TOML files: read with one-line errors, and values written so that reading them back gives the same."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wavegym.core.errors import InputError


def read_toml(what: str, file: Path | str) -> dict[str, Any]:
    """The content of a TOML file.

    Args:
        what: the file's part, for an error, such as ``"scenario"``.
        file: its path.

    Raises:
        InputError: the file cannot be read, or is no TOML.
    """
    try:
        return tomllib.loads(Path(file).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:  # ValueError: no UTF-8, or no TOML
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{what} {str(file)!r} cannot be read: {reason}") from None


def toml_key(name: str) -> str:
    """A key: bare where that is possible, otherwise quoted."""
    is_bare = name.isascii() and name.replace("-", "").replace("_", "").isalnum()
    return name if is_bare else toml_value(name)


def toml_value(value: Any) -> str:
    """A string, path, number, flag, list, tuple or mapping of these as TOML; a mapping becomes an inline table.

    Raises:
        InputError: anything else, such as None or an object.
    """
    if isinstance(value, Mapping):
        entries = ", ".join(f"{toml_key(key)} = {toml_value(entry)}" for key, entry in value.items())
        return f"{{ {entries} }}" if entries else "{}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)):
        return repr(float(value) if isinstance(value, float) else int(value))  # not as NumPy writes its scalars
    if isinstance(value, (str, Path)):
        return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
    raise InputError(f"value is {value!r}, expected a string, number, flag or list of them: TOML has nothing else")
