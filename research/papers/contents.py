"""CSV, JSON and PNG contents as bytes."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from wavegym.core.files import csv_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 150


def csv_bytes(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    """A table with a head."""
    return csv_text(head, rows).encode()


def json_bytes(summary: dict[str, Any]) -> bytes:
    """A summary; None, never NaN, means that there is no estimate."""
    return (json.dumps(summary, indent=2, allow_nan=False) + "\n").encode()


def new_figure(width: float, height: float) -> Figure:
    """An empty picture of this size in inches, without a window."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def png_bytes(figure: Figure) -> bytes:
    """A picture, the same bytes each time."""
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=DPI, metadata={"Software": None})
    return png.getvalue()
