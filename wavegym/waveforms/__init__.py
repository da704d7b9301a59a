"""Waveforms: pulses that a radar may transmit, and their measurement accuracy.

A waveform is a unit-energy pulse with an envelope and a phase. Its Fisher information bounds the accuracy of delay and
Doppler measurements. Its inverse, scaled to range and range-rate, is the measurement covariance that a tracker uses. A
Gaussian up-chirp of duration parameter 100 us and chirp rate 1e8 rad/s^2 at X band and an SNR of 20 dB:

>>> import numpy as np
>>> from wavegym.waveforms import GaussianChirp, PulseTrain, ambiguity, gaussian_chirp_library
>>> from wavegym.waveforms import chirp_law, chirp_measurement_covariance, measurement_covariances
>>> from wavegym.waveforms import trapezoid_chirp_library
>>> chirp = GaussianChirp(duration=100e-6, chirp_rate=1e8, direction="up")
>>> chirp.label
'up 100 us 6.366 kHz'
>>> R = chirp.measurement_covariance(carrier_hz=10.4e9, snr=100)
>>> print(np.sqrt(np.diag(R)).round(2))  # standard deviations, m and m/s
[2119.85    7.25]

The errors of range and range-rate (positive when receding) of an up-chirp are negatively correlated. The ridge of its
ambiguity function rises accordingly: a delay error and a Doppler error of the same sign cancel.

>>> bool(R[0, 1] < 0)
True
>>> chi = ambiguity(chirp, delays=[0.0, 50e-6], dopplers=[-1591.5, 0.0, 1591.5])
>>> print(abs(chi).round(3))
[[0.779 1.    0.779]
 [0.346 0.732 0.939]]

Sixteen pulses at intervals of 1 ms measure range-rate far better at the same energy (standard deviation, m/s):

>>> train = PulseTrain(chirp, count=16, interval=1e-3)
>>> print(np.sqrt(train.measurement_covariance(carrier_hz=10.4e9, snr=100)[1, 1]).round(3))
0.05

A library is the set of waveforms that a scheduler chooses from. Sweeps are signed: positive up, negative down.

>>> library = gaussian_chirp_library(durations=[10e-6, 100e-6], sweeps=[0, 1e6, -1e6])
>>> library.labels[:3]
('unmodulated 10 us', 'up 10 us 1 MHz', 'down 10 us 1 MHz')
>>> measurement_covariances(library, 10.4e9).shape
(6, 2, 2)

Chirps with a trapezoid envelope have linear, power, hyperbolic or exponential FM. With a nonlinear FM the errors of
range and range-rate are far less correlated, and both are small (standard deviations at an SNR of 1, m and m/s):

>>> for pulse in trapezoid_chirp_library(["lfm", "pfm:3", "hfm"], [100e-6], [15e6], directions=["up"]):
...     print(pulse.label, np.sqrt(np.diag(pulse.measurement_covariance(10.4e9, snr=1))).round(1))
LFM up 100 us 15 MHz [ 2289.7 33024.7]
PFM3 up 100 us 15 MHz [ 24.4 361.7]
HFM up 100 us 15 MHz [ 25.5 330.5]

Four moments describe a frequency law. One call therefore takes any mixture of laws, durations and sweeps:

>>> moments = np.stack([chirp_law(kind).moments for kind in ("lfm", "hfm")])
>>> chirp_measurement_covariance(moments[[0, 1, 1]], [1e-4, 1e-4, 5e-5], [15e6, -15e6, 1e6], carrier_hz=10.4e9).shape
(3, 2, 2)

A radar cannot receive while it transmits. How long a pulse lasts is a matter of definition, here 99 % of the energy or
an amplitude above -60 dB. The blind ranges (m):

>>> from wavegym.waveforms import PulseTiming, transmitted_interval
>>> by_energy, by_level = PulseTiming.of(chirp, 10.4e9), PulseTiming.of(chirp, 10.4e9, level_db=-60)
>>> print(round(by_energy.blind_range), round(by_level.blind_range))
54604 111431
>>> timing = PulseTiming(duration=10e-6, interval=100e-6, count=64, carrier_hz=10.4e9, max_duty=0.1)
>>> print(f"{timing.unambiguous_range:.0f} m, +-{timing.unambiguous_velocity / 2:.1f} m/s")
14990 m, +-72.1 m/s

``plot_ambiguity(chirp).savefig("chirp.png")`` draws the ambiguity function and its cuts. To add a pulse, derive a
subclass of ``Waveform`` with a label, a support, an envelope and a phase; all of the above then works by quadrature.
"""

from wavegym.waveforms.ambiguity import ambiguity, plot_ambiguity, zero_delay_cut, zero_doppler_cut
from wavegym.waveforms.chirp_laws import FrequencyLaw, parse_law
from wavegym.waveforms.fisher import SPEED_OF_LIGHT, FisherFactors
from wavegym.waveforms.gaussian import (
    GaussianChirp,
    chirp_rate_for_sweep,
    gaussian_chirp_library,
    gaussian_fisher_factors,
    gaussian_measurement_covariance,
    sweep_for_chirp_rate,
)
from wavegym.waveforms.numeric import numeric_fisher_information
from wavegym.waveforms.pulse_train import PulseTrain
from wavegym.waveforms.timing import (
    PulseTiming,
    check_dwells,
    check_range_folds,
    check_time_on_target,
    check_velocity_folds,
    pulse_timings,
    time_left,
    transmitted_interval,
)
from wavegym.waveforms.trapezoid import (
    ChirpLaw,
    TrapezoidChirp,
    chirp_law,
    chirp_measurement_covariance,
    trapezoid_chirp_library,
    trapezoid_fisher_factors,
)
from wavegym.waveforms.waveform import Waveform, measurement_covariances

__all__ = [
    "SPEED_OF_LIGHT",
    "ChirpLaw",
    "FisherFactors",
    "FrequencyLaw",
    "GaussianChirp",
    "PulseTiming",
    "PulseTrain",
    "TrapezoidChirp",
    "Waveform",
    "ambiguity",
    "check_dwells",
    "check_range_folds",
    "check_time_on_target",
    "check_velocity_folds",
    "chirp_law",
    "chirp_measurement_covariance",
    "chirp_rate_for_sweep",
    "gaussian_chirp_library",
    "gaussian_fisher_factors",
    "gaussian_measurement_covariance",
    "measurement_covariances",
    "numeric_fisher_information",
    "parse_law",
    "plot_ambiguity",
    "pulse_timings",
    "sweep_for_chirp_rate",
    "time_left",
    "transmitted_interval",
    "trapezoid_chirp_library",
    "trapezoid_fisher_factors",
    "zero_delay_cut",
    "zero_doppler_cut",
]
