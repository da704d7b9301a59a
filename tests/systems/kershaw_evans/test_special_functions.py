"""Functions of SciPy called from kernels, against SciPy's own calls."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special

from wavegym.core.kernels import kernel
from wavegym.systems.kershaw_evans import kernels

ARGUMENTS = np.concatenate([np.linspace(-30.0, 30.0, 10_001), [0.0, -0.0, 1e-300, 1e300, np.inf, -np.inf, np.nan]])


@kernel
def erfc(x, out):
    for i in range(len(x)):
        out[i] = kernels.erfc(x[i])


@kernel
def erfcx(x, out):
    for i in range(len(x)):
        out[i] = kernels.erfcx(x[i])


@pytest.mark.parametrize("function", [erfc, erfcx])
def test_kernels_call_the_functions_of_scipy(function):
    out = np.empty(len(ARGUMENTS))
    function(ARGUMENTS, out)
    np.testing.assert_array_equal(out, getattr(special, function.__name__)(ARGUMENTS))
