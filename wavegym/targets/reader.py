"""Reader of recorded tracks in CSV files; errors name the file and the line.

Filters of one target's reports: recorders repeat positions, set late time stamps and lose altitudes.

WGS-84: geodetic coordinates to earth-centred coordinates and a local tangent plane (east, north, up). The tangent plane
is an exact rotation and shift of earth-centred coordinates: distances in it are true slant ranges. Because of the
earth's curvature a target far from the origin has a low or negative "up", as seen by a radar at the origin.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from heapq import heapify, heappop, heappush
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError, check_within
from wavegym.targets.csv_table import BOUNDS, ID, ReportTable, listed, read_table
from wavegym.targets.recorded import RecordedTrack

Mask = NDArray[np.bool_]
POSITION_TOLERANCE = 25.0  # m: quantisation and noise of position reports
SEMI_MAJOR = 6378137.0  # m, WGS-84 (NIMA TR8350.2, table 3.1)
FLATTENING = 1 / 298.257223563
ECCENTRICITY_2 = FLATTENING * (2 - FLATTENING)
AIRCRAFT_ACCELERATION = 8.0  # m/s²: airliners stay below 6 (bank of 30°); late reports at 10 s intervals give 9 to 16
GREATEST_ACCELERATION = 1000.0  # m/s²: no target accelerates more; several targets in one track seem to
MOST_IMPOSSIBLE = 0.5  # share of a file's reports: if more contradict the others, its columns are misread


def last_of_each_time(times: FloatArray) -> Mask:
    """Mask (report,) of the last report of each time; times ascend."""
    return np.append(times[1:] != times[:-1], True)


def fresh(horizontal: FloatArray, height: FloatArray) -> Mask:
    """Mask (report,) of the reports that do not repeat the previous position.

    A recorder without new data repeats the last position with a new time: the target would seem to stop and then jump.
    A height (report,) may be missing (NaN); horizontal is (report, 2).
    """
    same_height = (height[1:] == height[:-1]) | np.isnan(height[1:]) | np.isnan(height[:-1])
    return np.append(True, ~((horizontal[1:] == horizontal[:-1]).all(axis=1) & same_height))


def fill_heights(times: FloatArray, height: FloatArray) -> tuple[FloatArray, bool]:
    """Heights (report,) with missing heights (NaN) interpolated in time, held at the ends; whether any was known."""
    known = ~np.isnan(height)
    if not known.any():
        return np.zeros_like(height), False
    return np.interp(times, times[known], height[known]), True


def flyable(times: FloatArray, positions: FloatArray, max_acceleration: float) -> Mask:
    """Mask (report,) of the reports that a target can reach with at most ``max_acceleration`` [m/s²].

    A position whose time stamp is s seconds late lies behind the path by s times the speed. The suspicion of a report
    is a ratio: its distance to the chord between its neighbours, divided by the greatest distance under an acceleration
    a, a h₁ h₂ / 2 (h: the times to the neighbours). Reports are removed until no suspicion exceeds 1. Each removal
    takes the worst report or a neighbour: the one that leaves the fewest suspects, then the least total suspicion.

    Args:
        times: ascending [s], (report,).
        positions: metres, (report, 3).
        max_acceleration: limit [m/s²], beyond ``POSITION_TOLERANCE``; inf keeps all reports.
    """
    level = np.zeros(len(times))
    level[1:-1] = _suspicion(times, positions, max_acceleration)
    if not (level > 1).any():
        return np.ones(len(times), np.bool_)
    chain = _Chain(times.tolist(), positions.tolist(), level.tolist(), max_acceleration)
    chain.remove_suspects()
    return np.array(chain.is_kept, np.bool_)


class _Chain:
    """The reports as a linked list, with a heap of those that are suspect: a removal costs the same in any file."""

    def __init__(self, times: list[float], positions: list[list[float]], level: list[float], limit: float) -> None:
        count = len(times)
        self.times, self.positions, self.level, self.limit = times, positions, level, limit
        self.before, self.after = list(range(-1, count - 1)), list(range(1, count + 1))
        self.is_kept = [True] * count

    def remove_suspects(self) -> None:
        """Remove reports until none is suspect; of equal suspicions the first report's comes first."""
        heap = [(-suspicion, i) for i, suspicion in enumerate(self.level) if suspicion > 1]
        heapify(heap)
        while heap:
            suspicion, worst = heappop(heap)
            if not self.is_kept[worst] or self.level[worst] != -suspicion:
                continue  # the entry is out of date
            gone = self._best_removal(worst)
            left, right = self.before[gone], self.after[gone]
            self.is_kept[gone] = False
            for i in self._link(left, right):
                self.level[i] = self._level(self.before[i], i, self.after[i])
                if self.level[i] > 1:
                    heappush(heap, (-self.level[i], i))

    def _link(self, left: int, right: int) -> list[int]:
        """Make two reports neighbours; those of them that exist."""
        if left >= 0:
            self.after[left] = right
        if right < len(self.times):
            self.before[right] = left
        return [i for i in (left, right) if 0 <= i < len(self.times)]

    def _best_removal(self, worst: int) -> int:
        """The worst report or a neighbour: see ``flyable``."""
        near = [worst]
        for _ in range(3):  # a removal changes the suspicion of neighbours only
            first, last = self.before[near[0]], self.after[near[-1]]
            near = [*([first] if first >= 0 else []), *near, *([last] if last < len(self.times) else [])]
        remaining = {}
        for suspect in (worst, self.before[worst], self.after[worst]):  # the worst first: it wins a tie
            others = [i for i in near if i != suspect]
            left = [self._level(*three) for three in zip(others, others[1:], others[2:], strict=False)]
            remaining[suspect] = (sum(level > 1 for level in left), sum(left))
        return min(remaining, key=remaining.__getitem__)

    def _level(self, before: int, here: int, after: int) -> float:
        """``_suspicion`` of one report, with the same roundings."""
        if before < 0 or after >= len(self.times):
            return 0.0
        h1, h2 = self.times[here] - self.times[before], self.times[after] - self.times[here]
        weight, square = h1 / (h1 + h2), 0.0
        for p, q, r in zip(self.positions[before], self.positions[here], self.positions[after], strict=True):
            away = q - ((1 - weight) * p + weight * r)
            square += away * away
        return math.sqrt(square) / (POSITION_TOLERANCE + self.limit * h1 * h2 / 2)


def _suspicion(times: FloatArray, positions: FloatArray, max_acceleration: float) -> FloatArray:
    """Distance of each inner report to its neighbours' chord relative to the allowed distance, (report - 2,)."""
    if len(times) < 3:
        return np.zeros(0)
    before, after = times[1:-1] - times[:-2], times[2:] - times[1:-1]
    weight = (before / (before + after))[:, None]
    chord = (1 - weight) * positions[:-2] + weight * positions[2:]
    allowed = POSITION_TOLERANCE + max_acceleration * before * after / 2
    return np.linalg.norm(positions[1:-1] - chord, axis=1) / allowed


def geodetic_to_ecef(latitude: ArrayLike, longitude: ArrayLike, altitude: ArrayLike) -> FloatArray:
    """Earth-centred, earth-fixed points [m], (..., 3), of latitude, longitude [deg] and ellipsoidal height [m]."""
    phi, lam = np.radians(latitude), np.radians(longitude)
    h = np.asarray(altitude, np.float64)
    normal = SEMI_MAJOR / np.sqrt(1 - ECCENTRICITY_2 * np.sin(phi) ** 2)
    rho = (normal + h) * np.cos(phi)
    return np.stack([rho * np.cos(lam), rho * np.sin(lam), (normal * (1 - ECCENTRICITY_2) + h) * np.sin(phi)], axis=-1)


def ecef_to_enu(ecef: ArrayLike, latitude: float, longitude: float, altitude: float = 0.0) -> FloatArray:
    """East, north and up [m], (..., 3), of earth-centred points [m] about an origin in degrees and metres."""
    phi, lam = np.radians(latitude), np.radians(longitude)
    east = np.array([-np.sin(lam), np.cos(lam), 0.0])
    up = np.array([np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)])
    axes = np.stack([east, np.cross(up, east), up])  # (axis, 3)
    away = np.asarray(ecef, np.float64) - geodetic_to_ecef(latitude, longitude, altitude)
    return np.sum(away[..., None, :] * axes, axis=-1)


def mean_direction(latitude: ArrayLike, longitude: ArrayLike) -> tuple[float, float]:
    """Latitude and longitude [deg] of the mean surface normal; valid across the 180° meridian and at the poles."""
    phi, lam = np.radians(latitude), np.radians(longitude)
    x, y, z = (float(np.mean(c)) for c in (np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)))
    return float(np.degrees(np.arctan2(z, np.hypot(x, y)))), float(np.degrees(np.arctan2(y, x)))


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
