"""The closed loop of one radar and one target in Stone Soup: choose, transmit, measure, track."""

from __future__ import annotations

from collections.abc import Sequence
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
    """What happened in each of the H steps."""

    mean: Array  # (H, n) of the track
    covariance: Array  # (H, n, n)
    truth: Array  # (H, n)
    waveform: Array  # (H,) int
    seconds: Array  # (H,) processor time of each decision


def path_of(states: Array, dt: float) -> GroundTruthPath:
    """True states (H + 1, n), ``dt`` seconds apart, as a path of Stone Soup."""
    times = (START + timedelta(seconds=dt * k) for k in range(len(states)))
    return GroundTruthPath([GroundTruthState(StateVector(x), timestamp=t) for x, t in zip(states, times, strict=True)])


def simulate(
    radar: Any,
    manager: Any,
    predictor: Any,
    updater: Any,
    path: Any,
    track: Track,
    errors: Sequence[Array] | None = None,
) -> Record:
    """Play a sensor manager against one true path.

    Args:
        radar: a ``WaveformRadar`` that ``manager`` manages.
        manager: a sensor manager of Stone Soup.
        predictor: of Stone Soup, as all of these.
        updater: takes the measurement model of each detection.
        path: the true states of steps 0 to H.
        track: of the target, with the estimate at step 0; it grows by a state a step.
        errors: measurement errors of steps 1 to H, (H, quantity); None: the radar draws them.

    Raises:
        InputError: a track that does not begin with the path, or another number of errors.
    """
    steps = len(path) - 1
    if errors is not None and len(errors) != steps:
        raise InputError(f"errors has {len(errors)} rows, expected {steps}, one for each step after the first")
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
        detections = radar.measure({truth}, noise=True if errors is None else errors[k])
        prediction = predictor.predict(track, timestamp=truth.timestamp)
        track.append(prediction)
        for detection in detections:
            track[-1] = updater.update(SingleHypothesis(prediction, detection))
        rows.append(
            (np.ravel(track.mean), np.array(track.covar), np.ravel(truth.state_vector), radar.waveform, seconds)
        )
    return Record(*(np.array(column) for column in zip(*rows, strict=True)))
