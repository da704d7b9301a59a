"""Numbers with units, as labels show them."""

from __future__ import annotations


def quantity(value: float, unit: str) -> str:
    """``value`` to four digits with an SI prefix: ``quantity(1e-4, "s") == "100 us"``."""
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n")):
        if abs(value) >= 0.99995 * factor:
            return f"{value / factor:.4g} {prefix}{unit}"
    return f"{value:.4g} {unit}"
