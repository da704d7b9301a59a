"""A closed loop composed of parts that anybody may write: targets, sensor, tracker, waveforms, objective.

``parts.py`` states what each part has to offer and holds ready ones; ``system.py`` is the loop.
"""

from wavegym.systems.composed.parts import (
    LinearTargets,
    LineOfSightRadar,
    Objective,
    PlanarRadar,
    Pulses,
    Quantity,
    Sensor,
    Targets,
    Waveforms,
    WeightedTrace,
)
from wavegym.systems.composed.system import Loop

__all__ = [
    "LineOfSightRadar",
    "LinearTargets",
    "Loop",
    "Objective",
    "PlanarRadar",
    "Pulses",
    "Quantity",
    "Sensor",
    "Targets",
    "Waveforms",
    "WeightedTrace",
]
