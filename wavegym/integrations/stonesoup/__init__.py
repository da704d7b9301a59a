"""Stone Soup, both ways: wavegym's radars and policies in its simulations, its filters as trackers of wavegym.

Stone Soup finds this package as a plugin: ``from stonesoup.plugins.wavegym import WaveformRadar``.
"""

try:
    import stonesoup as _stonesoup  # noqa: F401
except ImportError as error:
    raise ImportError("wavegym.integrations.stonesoup needs Stone Soup: pip install 'wavegym[stonesoup]'") from error

from wavegym.integrations.stonesoup.manager import PolicySensorManager, WeightedTraceReward
from wavegym.integrations.stonesoup.sensor import (
    ChangeWaveform,
    WaveformActionGenerator,
    WaveformMeasurement,
    WaveformRadar,
    radars_of,
)
from wavegym.integrations.stonesoup.simulation import Record, path_of, simulate
from wavegym.integrations.stonesoup.tracker import StoneSoupTracker, jpda, kalman, unscented

__all__ = [
    "ChangeWaveform",
    "PolicySensorManager",
    "Record",
    "StoneSoupTracker",
    "WaveformActionGenerator",
    "WaveformMeasurement",
    "WaveformRadar",
    "WeightedTraceReward",
    "jpda",
    "kalman",
    "path_of",
    "radars_of",
    "simulate",
    "unscented",
]
