"""Sensors: what a waveform's echo is worth at the target's place.

>>> from wavegym.sensors import range_law_snr
>>> float(range_law_snr(25e3))
16.0
"""

from wavegym.sensors.snr import range_law_snr

__all__ = ["range_law_snr"]
