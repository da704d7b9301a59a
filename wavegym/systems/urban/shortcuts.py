"""Shortcuts of schedulers for the urban loop."""

from __future__ import annotations

from typing import Any

from wavegym.core import shortcuts
from wavegym.systems.urban.system import Urban


@shortcuts.baselines.register(Urban)
def baselines(system: Urban) -> dict[str, tuple[str, dict[str, Any]]]:
    """The paper's baseline: round robin with one nearly constant velocity model."""
    return {"open-loop": ("round-robin", {"tracker": "ncv"})}
