"""Info dictionaries as Gymnasium's vector environments lay them out: for every key an array and a mask ``_key``."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core.arrays import Array


def add_info(info: dict[str, Any], entries: dict[str, Array], rows: Array | None) -> None:
    """Add ``entries`` of the environments in ``rows`` (None: all); other rows are zero and masked out."""
    if rows is None:
        everyone: Array | None = None
        for key, values in entries.items():
            info[key] = values
            everyone = np.ones(len(values), np.bool_) if everyone is None else everyone.copy()
            info[f"_{key}"] = everyone
    elif rows.any():
        for key, values in entries.items():
            shown = np.zeros_like(values)
            shown[rows] = values[rows]
            info[key] = shown
            info[f"_{key}"] = rows.copy()


def final_info(info: dict[str, Any], observation: Array, entries: dict[str, Array], ended: Array) -> None:
    """``final_obs`` and ``final_info`` of the environments that ended in this step."""
    final = np.full(len(ended), None, dtype=object)
    for i in np.flatnonzero(ended):
        final[i] = observation[i].copy()
    nested: dict[str, Any] = {}
    add_info(nested, entries, ended)
    info["final_obs"], info["_final_obs"] = final, ended.copy()
    info["final_info"], info["_final_info"] = nested, ended.copy()
