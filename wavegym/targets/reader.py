"""Reader of recorded tracks in CSV files; errors name the file and the line."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError, check_within
from wavegym.targets.csv_table import BOUNDS, ID, ReportTable, listed, read_table
from wavegym.targets.geodesy import ecef_to_enu, geodetic_to_ecef, mean_direction
from wavegym.targets.recorded import RecordedTrack
from wavegym.targets.reports import fill_heights, flyable, fresh, last_of_each_time

AIRCRAFT_ACCELERATION = 8.0  # m/s²: airliners stay below 6 (bank of 30°); late reports at 10 s intervals give 9 to 16
GREATEST_ACCELERATION = 1000.0  # m/s²: no target accelerates more; several targets in one track seem to
MOST_IMPOSSIBLE = 0.5  # share of a file's reports: if more contradict the others, its columns are misread


class _Cleaned(NamedTuple):
    """The usable reports of one target."""

    recorded: FloatArray  # (report, 3) as in the file
    track: RecordedTrack  # earth-centred where the file is geodetic
    rows: int  # reports in the file
    elsewhere: int  # reports of a time at which another report of the target is somewhere else
    impossible: int  # those, and reports that need more than the acceleration allowed


def read_tracks(
    file: str | os.PathLike[str], origin: Sequence[float] | None = None, max_acceleration: float | None = None
) -> list[RecordedTrack]:
    """Read the tracks in a CSV file.

    The header names the columns in any order and case. Other columns are ignored:

    - ``time_s``, ``time``, ``t``, ``timestamp``, ``datetime``, ``basedatetime`` or ``base_date_time``: seconds, or ISO
      8601 times such as ``2026-11-23T08:30:00Z`` (UTC where an offset is missing), read as seconds since 1970;
    - ``id``, ``icao24``, ``mmsi`` or ``track_id``, if there are several targets; without it the file is one track,
      named after the file;
    - ``x_m`` or ``x``, ``y_m`` or ``y``, optionally ``z_m`` or ``z``: metres; preferred if a file also has degrees;
    - or ``lat_deg``, ``lat`` or ``latitude``; ``lon_deg``, ``lon``, ``longitude`` or ``lng``: degrees (WGS-84);
      optionally ``alt_m``, ``alt``, ``altitude`` or ``geoaltitude``: metres above the ellipsoid.

    Rows may be in any order, with ids interleaved. Of several reports of a target at one time, the last in the file
    counts. Reports that repeat the previous position, or that need more than ``max_acceleration`` (late time stamps or
    wrong positions), are dropped. A missing height (empty cell) is interpolated in time. A track without any
    height lies at height 0, with ``height_known`` False.

    Args:
        file: path of the file.
        origin: latitude [deg], longitude [deg] and optionally height [m] of the origin of the local tangent plane, such
            as the position of the radar. Default: the mean of the reports, at height 0.
        max_acceleration: [m/s²]; infinite keeps every report. Default: 8 m/s² for latitude and longitude, which come
            from aircraft, ships and vehicles; infinite for metres.

    Returns:
        One track per id, in order of id; positions in metres. ``dropped`` counts what was left out and why.

    Raises:
        InputError: no such file, an invalid column or cell, or reports that mostly contradict each other.
    """
    if max_acceleration is not None and not max_acceleration > 0:
        raise InputError(f"max_acceleration is {max_acceleration!r} m/s², expected a number > 0")
    table = read_table(Path(file))
    place = _check_origin(origin)
    if place is not None and not table.geodetic:
        raise InputError(f"{file}: origin is {place}, expected none, because the file gives x and y in metres")
    limit = max_acceleration or (AIRCRAFT_ACCELERATION if table.geodetic else math.inf)
    members: dict[str, list[int]] = {}
    for row, name in enumerate(table.ids):
        members.setdefault(name, []).append(row)
    cleaned = [_clean(table, np.array(members[name]), limit) for name in sorted(members)]
    if max_acceleration != math.inf:
        _check_possible(file, table, cleaned)
    if table.geodetic and place is None:
        directions = np.concatenate([each.recorded for each in cleaned])
        place = (*mean_direction(directions[:, 0], directions[:, 1]), 0.0)
    return [_placed(replace(each.track, source=str(file)), place) for each in cleaned]


def _clean(table: ReportTable, rows: NDArray[np.int64], limit: float) -> _Cleaned:
    """Sort the reports of one target, and leave out what cannot be used."""
    rows = rows[np.argsort(table.times[rows], kind="stable")]
    is_last = last_of_each_time(table.times[rows])
    latest = rows[is_last]
    counterpart = latest[np.cumsum(np.append(0, is_last[:-1]))]  # of each report, the one of its time that counts
    elsewhere = int((table.columns[rows, :2] != table.columns[counterpart, :2]).any(axis=1).sum())
    kept = latest[fresh(table.columns[latest, :2], table.columns[latest, 2])]
    times, columns = table.times[kept], table.columns[kept].copy()
    columns[:, 2], known = fill_heights(times, columns[:, 2])
    positions = geodetic_to_ecef(*columns.T) if table.geodetic else columns
    good = flyable(times, positions, limit)
    too_fast = int(len(kept) - good.sum())
    dropped = {
        "repeated time": len(rows) - len(latest),
        "repeated position": len(latest) - len(kept),
        "too fast": too_fast,
    }
    impossible = elsewhere + too_fast
    if not math.isfinite(limit):
        impossible += int((~flyable(times, positions, GREATEST_ACCELERATION)).sum())
    track = RecordedTrack(table.ids[rows[0]], times[good], positions[good], known, dropped)
    return _Cleaned(columns[good], track, len(rows), elsewhere, impossible)


def _check_possible(file: str | os.PathLike[str], table: ReportTable, cleaned: Sequence[_Cleaned]) -> None:
    """InputError where most reports contradict the others; the message names the likely cause."""
    rows, impossible = len(table.times), sum(each.impossible for each in cleaned)
    if impossible <= MOST_IMPOSSIBLE * rows:
        return
    worst = max(cleaned, key=lambda each: each.impossible)
    elsewhere = sum(each.elsewhere for each in cleaned)
    given = (
        f"{file}: {impossible} of {rows} reports contradict the others: {elsewhere} are at another place at the same "
        f"time, {impossible - elsewhere} move too fast"
    )
    if table.id_column is None:
        cause = (
            f"no column of ids, so all targets are one track; expected {listed(ID)} beside {', '.join(table.header)}"
        )
    else:
        cause = (
            f"several targets under one {table.id_column}, late time stamps, or another unit of time or position; most "
            f"are of {worst.track.id!r} ({worst.impossible} of {worst.rows})"
        )
    raise InputError(f"{given}; likely cause: {cause}")


def _placed(track: RecordedTrack, place: tuple[float, float, float] | None) -> RecordedTrack:
    """The track in the local tangent plane at ``place``; unchanged if ``place`` is None."""
    return track if place is None else replace(track, positions=ecef_to_enu(track.positions, *place), origin=place)


def _check_origin(origin: Sequence[float] | None) -> tuple[float, float, float] | None:
    """Return latitude, longitude and height of ``origin``; otherwise raise an InputError."""
    if origin is None:
        return None
    numbers = np.asarray(origin, np.float64)
    if numbers.shape not in ((2,), (3,)) or not np.isfinite(numbers).all():
        raise InputError(
            f"origin is {origin!r}, expected (latitude, longitude) or (latitude, longitude, height), all finite"
        )
    latitude, longitude, height = (*map(float, numbers), 0.0)[:3]
    check_within("origin's latitude", latitude, *BOUNDS[0], "deg")
    check_within("origin's longitude", longitude, *BOUNDS[1], "deg")
    return latitude, longitude, height
