"""Sensors: signal-to-noise ratio, detection, measurement functions and false returns.

>>> import numpy as np
>>> from wavegym.sensors import detection_probability, gate_probability, gate_volume, inside_gate
>>> from wavegym.sensors import range_and_rate, range_law_snr, union_clutter
>>> r, rdot = range_and_rate([2000.0, -1000.0, -100.0, 800.0], sensor=[3000.0, -16000.0])
>>> print(f"{r:.0f} m, receding at {rdot:.0f} m/s")
15033 m, receding at 805 m/s
>>> snr = range_law_snr(r)
>>> print(f"{snr:.0f}, detected with probability {detection_probability(snr, false_alarm=0.01):.2f}")
122, detected with probability 0.93
>>> print(f"{detection_probability(snr, 0.01, 'swerling0'):.4f} if the echo is steady")
1.0000 if the echo is steady

False returns also fall into the tracker's validation gate, here of four standard deviations of (r, rdot):

>>> S = np.diag([100.0**2, 5.0**2])
>>> print(f"{gate_volume(S, gate=4.0):.0f} m^2/s, {gate_probability(4.0):.5f} of the target's returns")
25133 m^2/s, 0.99966 of the target's returns
>>> clutter = union_clutter(key=1, centre=[(r, rdot)], S=[S], gate=4.0, density=1e-4)  # 2.5 expected
>>> bool(inside_gate(clutter - [r, rdot], S, gate=4.0).all())
True

A monostatic receiver is closed while its radar transmits. A chirp of 100 us is whole from 15 km on; nearer, its visible
share is less, and so is its information (``docs/waveform_timing.md``):

>>> from wavegym.sensors import EclipsedPulse
>>> from wavegym.waveforms import TrapezoidChirp
>>> eclipsed = EclipsedPulse(TrapezoidChirp(kind="hfm", duration=100e-6, sweep=15e6), energy=1.0)
>>> print(eclipsed.visible_share([3e3, 8e3, 20e3]).round(3))
[0.179 0.536 1.   ]
>>> R = eclipsed.measurement_covariance([3e3, 8e3, 20e3], carrier_hz=10.4e9)
>>> print(np.sqrt(R[:, 0, 0]).round(1), "m at SNR 1")
[2931.4  265.3   25.5] m at SNR 1
"""

from wavegym.sensors.clutter import gate_probability, gate_volume, inside_gate, union_clutter
from wavegym.sensors.detection import (
    FLUCTUATIONS,
    assumed_echo,
    detected_snr,
    detection_probability,
    echo_law,
    energy_detection_probability,
    mean_inverse_detected_snr,
    range_law_snr,
    realised_snr,
    unit_snr_range,
)
from wavegym.sensors.eclipsing import EclipsedLibrary, EclipsedPulse, EclipsePulses, EclipseTables, eclipse_tables
from wavegym.sensors.folding import (
    Agreements,
    Folded,
    FoldHypotheses,
    FoldUpdate,
    PairUpdate,
    agreeing_combinations,
    combined_interval,
    fold_hypotheses,
    fold_pair_update,
    fold_range,
    fold_update,
    fold_velocity,
    outside_notch,
    outside_notch_probability,
    resolve_folds,
    unfold,
)
from wavegym.sensors.interference import Bands, contiguous_bands, noise_factors
from wavegym.sensors.multipath import Antenna
from wavegym.sensors.multistatic import (
    Echoes,
    Multistatic,
    multistatic_range_and_rate,
    range_and_rate,
    range_and_rate_jacobian,
)
from wavegym.sensors.platform import View, fov_penalty, platform_jacobian, platform_measurement, platform_view
from wavegym.sensors.receiver import ArrayReceiver, Peaks
from wavegym.sensors.scatterers import Scatterers, clutter_power, exceedance
from wavegym.sensors.trains import (
    acceleration_loss,
    false_return_density,
    false_return_threshold,
    mean_rate_variance,
    motion_loss,
)
from wavegym.sensors.urban_map import Building, Road, UrbanMap

__all__ = [
    "FLUCTUATIONS",
    "Agreements",
    "Antenna",
    "ArrayReceiver",
    "Bands",
    "Building",
    "Echoes",
    "EclipsePulses",
    "EclipseTables",
    "EclipsedLibrary",
    "EclipsedPulse",
    "FoldHypotheses",
    "FoldUpdate",
    "Folded",
    "Multistatic",
    "PairUpdate",
    "Peaks",
    "Road",
    "Scatterers",
    "UrbanMap",
    "View",
    "acceleration_loss",
    "agreeing_combinations",
    "assumed_echo",
    "clutter_power",
    "combined_interval",
    "contiguous_bands",
    "detected_snr",
    "detection_probability",
    "echo_law",
    "eclipse_tables",
    "energy_detection_probability",
    "exceedance",
    "false_return_density",
    "false_return_threshold",
    "fold_hypotheses",
    "fold_pair_update",
    "fold_range",
    "fold_update",
    "fold_velocity",
    "fov_penalty",
    "gate_probability",
    "gate_volume",
    "inside_gate",
    "mean_inverse_detected_snr",
    "mean_rate_variance",
    "motion_loss",
    "multistatic_range_and_rate",
    "noise_factors",
    "outside_notch",
    "outside_notch_probability",
    "platform_jacobian",
    "platform_measurement",
    "platform_view",
    "range_and_rate",
    "range_and_rate_jacobian",
    "range_law_snr",
    "realised_snr",
    "resolve_folds",
    "unfold",
    "union_clutter",
    "unit_snr_range",
]
