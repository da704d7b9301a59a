"""The examples in the docstring of wavegym.sensors."""

from __future__ import annotations

import doctest

import wavegym.sensors


def test_examples_in_docstrings():
    result = doctest.testmod(wavegym.sensors)
    assert result.failed == 0
    assert result.attempted > 5
