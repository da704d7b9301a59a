"""What every other part stands on: the System contract, action sets, arrays, random numbers, kernels, errors."""
