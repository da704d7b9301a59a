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
"""

from wavegym.sensors.clutter import union_clutter
from wavegym.sensors.detection import detection_probability, energy_detection_probability
from wavegym.sensors.fluctuation import FLUCTUATIONS, detected_snr, mean_inverse_detected_snr, realised_snr
from wavegym.sensors.gates import gate_probability, gate_volume, inside_gate
from wavegym.sensors.geometry import range_and_rate, range_and_rate_jacobian
from wavegym.sensors.multipath import Antenna
from wavegym.sensors.multistatic import Echoes, Multistatic, multistatic_range_and_rate
from wavegym.sensors.penalties import fov_penalty
from wavegym.sensors.platform import platform_jacobian, platform_measurement
from wavegym.sensors.receiver import ArrayReceiver, Peaks
from wavegym.sensors.resolution import View, platform_view
from wavegym.sensors.snr import range_law_snr
from wavegym.sensors.urban_map import Building, Road, UrbanMap

__all__ = [
    "FLUCTUATIONS",
    "Antenna",
    "ArrayReceiver",
    "Building",
    "Echoes",
    "Multistatic",
    "Peaks",
    "Road",
    "UrbanMap",
    "View",
    "detected_snr",
    "detection_probability",
    "energy_detection_probability",
    "fov_penalty",
    "gate_probability",
    "gate_volume",
    "inside_gate",
    "mean_inverse_detected_snr",
    "multistatic_range_and_rate",
    "platform_jacobian",
    "platform_measurement",
    "platform_view",
    "range_and_rate",
    "range_and_rate_jacobian",
    "range_law_snr",
    "realised_snr",
    "union_clutter",
]
