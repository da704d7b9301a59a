"""Reader of recorded tracks in CSV files; errors name the file and the line."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError, check_within, nearest
from wavegym.targets.geodesy import ecef_to_enu, geodetic_to_ecef, mean_direction
from wavegym.targets.recorded import RecordedTrack
from wavegym.targets.reports import fill_heights, flyable, fresh, last_of_each_time

AIRCRAFT_ACCELERATION = 8.0  # m/s²: airliners stay below 6 (bank of 30°); late reports at 10 s intervals give 9 to 16

TIME = ("time_s", "time", "t")
ID = ("id",)
METRES = (("x_m", "x"), ("y_m", "y"), ("z_m", "z"))
DEGREES = (("lat_deg", "lat", "latitude"), ("lon_deg", "lon", "longitude"), ("alt_m", "alt", "altitude"))
BOUNDS = ((-90.0, 90.0), (-180.0, 360.0))


@dataclass(frozen=True)
class _Table:
    """Rows of a file: times (row,), columns (row, 3) as recorded with NaN for an unknown height, ids per row."""

    times: FloatArray
    columns: FloatArray
    ids: list[str]
    geodetic: bool


def read_tracks(
    file: str | os.PathLike[str], origin: Sequence[float] | None = None, max_acceleration: float | None = None
) -> list[RecordedTrack]:
    """Read the tracks in a CSV file.

    The header names the columns in any order and case. Other columns are ignored:

    - ``time_s``, ``time`` or ``t``: seconds;
    - ``id``, if there are several targets; without it the file is one track, named after the file;
    - ``x_m`` or ``x``, ``y_m`` or ``y``, optionally ``z_m`` or ``z``: metres; preferred if a file also has degrees;
    - or ``lat_deg``, ``lat`` or ``latitude``; ``lon_deg``, ``lon`` or ``longitude``: degrees (WGS-84); optionally
      ``alt_m``, ``alt`` or ``altitude``: metres above the ellipsoid.

    Rows may be in any order, with ids interleaved. Of several reports of a target at one time, the last in the file
    counts. Dropped are reports that repeat the position before, and reports that need more than ``max_acceleration``
    (late time stamps or wrong positions). A missing height (empty cell) is interpolated in time. A track without any
    height lies at height 0, with ``height_known`` False.

    Args:
        file: path of the file.
        origin: latitude [deg], longitude [deg] and optionally height [m] of the origin of the local tangent plane, such
            as the position of the radar. Default: the mean of the reports, at height 0.
        max_acceleration: [m/s²]; infinite keeps every report. Default: 8 m/s² for latitude and longitude, which come
            from aircraft, ships and vehicles; infinite for metres.

    Returns:
        One track per id, in order of id; positions in metres.

    Raises:
        InputError: no such file, an empty file, a missing column, a cell that is not a finite number, a latitude
            outside [-90, 90], an invalid origin, or an origin for a file in metres.
    """
    if max_acceleration is not None and not max_acceleration > 0:
        raise InputError(f"max_acceleration is {max_acceleration!r} m/s², expected a number > 0")
    table = _read_table(Path(file))
    place = _check_origin(origin)
    if place is not None and not table.geodetic:
        raise InputError(f"{file}: origin is {place}, expected none, because the file gives x and y in metres")
    limit = max_acceleration or (AIRCRAFT_ACCELERATION if table.geodetic else math.inf)
    members: dict[str, list[int]] = {}
    for row, name in enumerate(table.ids):
        members.setdefault(name, []).append(row)
    cleaned = {name: _clean(table, np.array(members[name]), limit) for name in sorted(members)}
    if table.geodetic and place is None:
        directions = np.concatenate([geodetic for geodetic, _ in cleaned.values()])
        place = (*mean_direction(directions[:, 0], directions[:, 1]), 0.0)
    return [_placed(replace(track, source=str(file)), place) for _, track in cleaned.values()]


def _clean(table: _Table, rows: NDArray[np.int64], limit: float) -> tuple[FloatArray, RecordedTrack]:
    """The usable reports of one target: as recorded, (report, 3), and as a track (earth-centred where geodetic)."""
    rows = rows[np.argsort(table.times[rows], kind="stable")]
    latest = rows[last_of_each_time(table.times[rows])]
    kept = latest[fresh(table.columns[latest, :2], table.columns[latest, 2])]
    times, columns = table.times[kept], table.columns[kept].copy()
    columns[:, 2], known = fill_heights(times, columns[:, 2])
    positions = geodetic_to_ecef(*columns.T) if table.geodetic else columns
    good = flyable(times, positions, limit)
    dropped = {
        "repeated time": len(rows) - len(latest),
        "repeated position": len(latest) - len(kept),
        "too fast": int(len(kept) - good.sum()),
    }
    return columns[good], RecordedTrack(table.ids[rows[0]], times[good], positions[good], known, dropped)


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


def _read_table(path: Path) -> _Table:
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            return _parse(path, stream)
    except FileNotFoundError:
        names = [entry.name for entry in path.parent.iterdir()] if path.parent.is_dir() else []
        raise InputError(f"{path}: no such file{nearest(path.name, names)}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not a CSV text file: {error}") from error


def _parse(path: Path, stream: TextIO) -> _Table:
    lines = _numbered(stream)
    first = next(lines, None)
    if first is None:
        raise InputError(f"{path}: empty, expected a header line and one line per report")
    header = [name.strip().lower() for name in first[1]]
    time, place, name, geodetic = _columns(f"{path}:{first[0]}", header)
    times, columns, ids = [], [], []
    for number, cells in lines:
        where = f"{path}:{number}"
        if len(cells) != len(header):
            raise InputError(f"{where}: {len(cells)} cells, expected {len(header)} as in the header")
        times.append(_number(where, header[time], cells[time]))
        row = [_number(where, header[c], cells[c]) for c in place[:2]]
        if geodetic:
            for column, value, bounds in zip(place, row, BOUNDS, strict=False):
                check_within(f"{where}: {header[column]}", value, *bounds)
        blank = len(place) == 2 or not cells[place[2]].strip()
        columns.append((*row, math.nan if blank else _number(where, header[place[2]], cells[place[2]])))
        ids.append(path.stem if name is None else cells[name].strip())
        if not ids[-1]:
            raise InputError(f"{where}: id is empty, expected the name of the target")
    if not times:
        raise InputError(f"{path}: no rows after the header, expected one line per report")
    return _Table(np.array(times), np.array(columns), ids, geodetic)


def _numbered(stream: TextIO) -> Iterator[tuple[int, list[str]]]:
    """Non-blank rows with their line numbers in the file."""
    reader = csv.reader(stream)
    for cells in reader:
        if any(cell.strip() for cell in cells):
            yield reader.line_num, cells


def _columns(where: str, header: list[str]) -> tuple[int, list[int], int | None, bool]:
    """Indices of the time, of the position (2 or 3 columns) and of the id, and whether the position is geodetic."""
    twice = sorted({name for name in header if name and header.count(name) > 1})
    if twice:
        raise InputError(f"{where}: column {twice[0]!r} appears more than once in the header")

    def find(names: tuple[str, ...]) -> int | None:
        return next((header.index(name) for name in names if name in header), None)

    def need(names: tuple[str, ...]) -> int:
        index = find(names)
        if index is None:
            raise InputError(f"{where}: no column {_listed(names)}; {_what_is_there(header, names)}")
        return index

    time = need(TIME)
    degrees, metres = (sum(find(names) is not None for names in group[:2]) for group in (DEGREES, METRES))
    if not degrees and not metres:
        names = tuple(name for group in (METRES, DEGREES) for column in group[:2] for name in column)
        raise InputError(f"{where}: no position, expected columns x, y or lat, lon; {_what_is_there(header, names)}")
    group = DEGREES if degrees > metres else METRES
    third = find(group[2])
    return time, [need(group[0]), need(group[1]), *([] if third is None else [third])], find(ID), degrees > metres


def _listed(names: Sequence[str]) -> str:
    return " or ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _what_is_there(header: list[str], wanted: Sequence[str]) -> str:
    """The header, and a hint at the first unknown column that resembles a wanted column."""
    known = {name for group in (TIME, ID, *METRES, *DEGREES) for name in group}
    hints = (
        f"; for {name!r}{nearest(name, wanted)[1:]}" for name in header if name not in known and nearest(name, wanted)
    )
    return f"the header has {', '.join(header)}{next(hints, '')}"


def _number(where: str, name: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        shown = repr(cell) if cell.strip() else "empty"
        raise InputError(f"{where}: {name} is {shown}, expected a number") from None
    if not math.isfinite(value):
        raise InputError(f"{where}: {name} is {cell.strip()!r}, expected a finite number")
    return value
