"""The foundations: the System contract, action sets, arrays, random numbers, kernels, errors."""
