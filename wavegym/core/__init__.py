"""The foundations: the System contract, action sets, arrays, random numbers, kernels, errors, the version."""

VERSION = "0.3.0"
