"""The transmitters on docs/echo_law.md are those of the environments' defaults, by the radar equation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.constants import Boltzmann, c

from wavegym.evaluation import make_task

PAGE = Path(__file__).parents[1] / "docs" / "echo_law.md"
SECTION = PAGE.read_text(encoding="utf-8").partition("## What a transmitter must send")[2].partition("\n## ")[0]
TABLE = [line for line in SECTION.splitlines() if line.startswith("|")][2:]
ROWS = [[cell.strip() for cell in line.strip("|").split("|")] for line in TABLE]


def test_page_has_every_environment_with_a_reference_range() -> None:
    """Eight of them."""
    assert len(ROWS) == 8


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_transmitter_of_the_page(row: list[str]) -> None:
    """r0, energy, time on air, peak and mean power, to three digits."""
    system: Any = make_task(row[0], {}).system
    sector = row[0].startswith("Sector")
    gain, target = (1e2, 10.0) if sector else (10.0**3.5, 1.0)
    r0 = system.reference_range * (system.reference_snr if sector else 1.0) ** 0.25
    noise = Boltzmann * 900.0 * 10.0**0.6
    energy = r0**4 * (4 * np.pi) ** 3 * noise / (2 * gain**2 * (c / system.carrier_hz) ** 2 * target)
    air = sorted({timing.time_on_air for timing in system.timings.values()})
    peaks = [energy / air[-1]] if row[0].startswith("Energy") else [energy / air[-1], energy / air[0]]
    wanted = [r0 / 1e3], [energy * 1e3], np.multiply(1e6, air), peaks, [energy / system.dt]
    for cell, want in zip(row[1:], wanted, strict=True):
        ends = [float(word) for word in cell.split(" to ")]
        assert ends[0] == pytest.approx(want[0], rel=6e-3)
        assert ends[-1] == pytest.approx(want[-1], rel=6e-3)
