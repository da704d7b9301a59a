"""The closed loop of one radar and one target in Stone Soup: choose, transmit, measure, track."""

from __future__ import annotations

from datetime import datetime, timedelta
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from stonesoup.types.array import StateVector
from stonesoup.types.groundtruth import GroundTruthPath, GroundTruthState
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.track import Track

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError

START = datetime(2000, 1, 1)


class Record(NamedTuple):
    """The record of each of the H steps."""

    mean: Array  # (H, n) of the track
    covariance: Array  # (H, n, n)
    truth: Array  # (H, n)
    waveform: Array  # (H,) int
    seconds: Array  # (H,) processor time of each decision


def path_of(states: Array, dt: float) -> GroundTruthPath:
    """True states (H + 1, n), ``dt`` seconds apart, as a path of Stone Soup."""
    times = (START + timedelta(seconds=dt * k) for k in range(len(states)))
    return GroundTruthPath([GroundTruthState(StateVector(x), timestamp=t) for x, t in zip(states, times, strict=True)])


class _Tape:
    """One step's draws in place of a generator's: detected, and these standard normal numbers."""

    def __init__(self, normal: Array) -> None:
        self._normal = normal

    def random(self) -> float:
        """Below every probability of detection."""
        return 0.0

    def standard_normal(self, size: int) -> Array:
        """The numbers, (size,)."""
        return self._normal


def simulate(
    radar: Any, manager: Any, predictor: Any, updater: Any, path: Any, track: Track, draws: Array | None = None
) -> Record:
    """Play a sensor manager against one true path.

    Args:
        radar: a ``WaveformRadar`` that ``manager`` manages.
        manager: a sensor manager of Stone Soup.
        predictor: of Stone Soup, as all of these.
        updater: takes the measurement model of each detection.
        path: the true states of steps 0 to H.
        track: of the target, with the estimate at step 0; it grows by a state a step.
        draws: standard normal draws of the measurement errors of steps 1 to H, (H, quantity), with which every pulse
            detects; None: the radar draws.

    Raises:
        InputError: a track that does not begin with the path, or another number of draws.
    """
    steps = len(path) - 1
    if draws is not None and len(draws) != steps:
        raise InputError(f"draws has {len(draws)} rows, expected {steps}, one for each step after the first")
    if track.timestamp != path[0].timestamp:
        raise InputError(
            f"the track's time is {track.timestamp}, expected that of the path's start, {path[0].timestamp}"
        )
    radar.act(path[0].timestamp)
    rows = []
    for k, truth in enumerate(list(path)[1:]):
        start = process_time()
        (config,) = manager.choose_actions({track}, truth.timestamp)
        seconds = process_time() - start
        radar.add_actions(config[radar])
        radar.act(truth.timestamp)
        detections = radar.measure({truth}, random_state=None if draws is None else _Tape(draws[k]))
        prediction = predictor.predict(track, timestamp=truth.timestamp)
        track.append(prediction)
        for detection in detections:
            track[-1] = updater.update(SingleHypothesis(prediction, detection))
        rows.append(
            (np.ravel(track.mean), np.array(track.covar), np.ravel(truth.state_vector), radar.waveform, seconds)
        )
    return Record(*(np.array(column) for column in zip(*rows, strict=True)))
