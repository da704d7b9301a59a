from __future__ import annotations

import doctest

import wavegym.targets


def test_the_tutorial_runs():
    result = doctest.testmod(wavegym.targets)
    assert result.attempted > 15
    assert result.failed == 0
