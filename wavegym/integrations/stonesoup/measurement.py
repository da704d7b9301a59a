"""A measurement law of wavegym as a measurement model of Stone Soup."""

from __future__ import annotations

from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.types.array import StateVector, StateVectors

from wavegym.core.arrays import Array


class WaveformMeasurement(NonLinearGaussianMeasurement):
    """The measurement of a radar with one waveform.

    ``noise_covar`` is R(theta) at the SNR of one state: that of the detected target. So the model of a detection has
    the covariance that the receiver knows.
    """

    law: Any = Property(doc="The law: a ``Sensor`` of ``wavegym.systems.composed``, seen from the radar")
    offset: np.ndarray = Property(doc="The radar's position and velocity in the order of the law's states, (n,)")

    @property
    def ndim_meas(self) -> int:
        """Number of measured quantities."""
        return len(self.law.quantities)

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        """The measurement of a state, a column for each of its vectors; ``noise``: as in Stone Soup."""
        vectors = state.state_vector
        if isinstance(noise, bool) or noise is None:
            noise = self.rvs(num_samples=vectors.shape[1], **kwargs) if noise else 0.0
        kind = StateVectors if isinstance(vectors, StateVectors) else StateVector
        return kind(self.law.measure(law_states(vectors, self.mapping, self.offset)).T) + noise

    def jacobian(self, state: Any, **kwargs: Any) -> Array:
        """Derivatives of the measurement, (quantity, state)."""
        H = np.zeros((self.ndim_meas, self.ndim_state))
        H[:, list(self.mapping)] = self.law.jacobian(law_states(state.state_vector, self.mapping, self.offset)[0])
        return H


def law_states(vectors: Any, mapping: Any, offset: Array) -> Array:
    """Stone Soup's vectors (state, sample) as states of a law seen from the radar, (sample, n)."""
    states: Array = np.asarray(vectors, np.float64)[list(mapping)].T - offset
    return states
