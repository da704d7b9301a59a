"""Targets: motion models, scripted paths and recorded tracks.

Trackers and random targets share the same motion models. The state components have names, in one of two orders:

>>> import numpy as np
>>> from wavegym.targets import constant_velocity, random_path
>>> model = constant_velocity(dt=1.0, q=1.0, axes=("x", "y"), order="derivative")
>>> model.names
('x', 'y', 'xdot', 'ydot')
>>> rng = np.random.default_rng(1)
>>> random_path(model, [20e3, 0.0, 200.0, 0.0], rng, steps=50).shape  # the start and 50 steps
(51, 4)

A scripted path follows its segments exactly. This target brakes, turns left by 90 degrees and drives on:

>>> from wavegym.targets import ScriptedPath, Segment
>>> left = Segment(10.0, turn_rate=np.pi / 20)
>>> path = ScriptedPath(start=(0.0, 0.0), velocity=(10.0, 0.0), segments=[Segment(5.0, acceleration=-1.0), left])
>>> positions, velocities, accelerations = path.sample([0.0, 5.0, 15.0])
>>> velocities.round(6) + 0.0
array([[10.,  0.],
       [ 5.,  0.],
       [ 0.,  5.]])

A recording is a CSV file of positions over time, in metres or in degrees. ``read_tracks`` reads and cleans the file.
``windows`` cuts the tracks at gaps, resamples them and lists all windows: stretches long enough for one episode.

>>> import tempfile, pathlib
>>> from wavegym.targets import range_paths, read_tracks, windows
>>> folder = tempfile.TemporaryDirectory()
>>> file = pathlib.Path(folder.name) / "tracks.csv"
>>> rows = [f"{10 * k},4009cc,52.0,{0.5 + 0.03 * k},9000" for k in range(12)]
>>> _ = file.write_text("time_s,id,lat_deg,lon_deg,alt_m\\n" + "\\n".join(rows))
>>> tracks = read_tracks(file, origin=(52.0, 0.0))  # the radar's position becomes (0, 0, 0)
>>> seen = range_paths(windows(tracks, dt=1.0, steps=50), radar=(0.0, 0.0, 0.0))
>>> len(seen), seen.names
(61, ('r', 'rdot'))
>>> truth = seen[rng.integers(len(seen))]  # range [m] and range-rate [m/s], receding
>>> truth.shape, bool((truth[:, 1] > 200).all())
((51, 2), True)
>>> folder.cleanup()

Errors are one line and name the file, and the line in the file:

>>> read_tracks("no_such_file.csv")  # doctest: +ELLIPSIS
Traceback (most recent call last):
    ...
wavegym.core.errors.InputError: no_such_file.csv: no such file...
"""

from __future__ import annotations

from wavegym.targets.motion import (
    MotionModel,
    constant_acceleration,
    constant_turn,
    constant_velocity,
    coordinated_turn,
    nearly_constant_acceleration,
    nearly_constant_velocity,
    random_path,
)
from wavegym.targets.paths import Kinematics, ScriptedPath, Segment
from wavegym.targets.reader import read_tracks
from wavegym.targets.recorded import Piece, RecordedTrack, TrackSummary, summarise
from wavegym.targets.recorded_paths import Windows, range_paths, windows

__all__ = [
    "Kinematics",
    "MotionModel",
    "Piece",
    "RecordedTrack",
    "ScriptedPath",
    "Segment",
    "TrackSummary",
    "Windows",
    "constant_acceleration",
    "constant_turn",
    "constant_velocity",
    "coordinated_turn",
    "nearly_constant_acceleration",
    "nearly_constant_velocity",
    "random_path",
    "range_paths",
    "read_tracks",
    "summarise",
    "windows",
]
