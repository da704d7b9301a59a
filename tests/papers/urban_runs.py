"""A small study of the street, played once for all tests."""

from __future__ import annotations

STREETS, SEED = 5, 3
