from __future__ import annotations

import doctest

import wavegym.evaluation


def test_the_example_in_the_documentation_runs():
    result = doctest.testmod(wavegym.evaluation)
    assert result.attempted >= 3
    assert result.failed == 0
