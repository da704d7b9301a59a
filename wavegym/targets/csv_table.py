"""Tables of reports in CSV files: columns by their names, times in seconds or ISO 8601; errors name file and line."""

from __future__ import annotations

import csv
import math
import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple, SupportsIndex, TextIO

import numpy as np

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError, check_within, nearest

TIME = ("time_s", "time", "t", "timestamp", "datetime", "basedatetime", "base_date_time")
ID = ("id", "icao24", "mmsi", "track_id")
METRES = (("x_m", "x"), ("y_m", "y"), ("z_m", "z"))
DEGREES = (
    ("lat_deg", "lat", "latitude"),
    ("lon_deg", "lon", "longitude", "lng"),
    ("alt_m", "alt", "altitude", "geoaltitude"),
)
BOUNDS = ((-90.0, 90.0), (-180.0, 360.0))
LATEST = 1e11  # s since 1970: the year 5138; greater numbers are milliseconds, or finer


@dataclass(frozen=True)
class ReportTable:
    """Rows of a file: times (row,), columns (row, 3) as recorded with NaN for an unknown height, ids per row."""

    times: FloatArray
    columns: FloatArray
    ids: list[str]
    geodetic: bool
    id_column: str | None  # None: the file has no column of ids, and all rows have the name of the file
    header: tuple[str, ...]


class _Rows(NamedTuple):
    """The cells of a file below its header, and the line of each row."""

    path: Path
    header: list[str]
    cells: list[list[str]]
    lines: list[int]

    def where(self, row: SupportsIndex) -> str:
        return f"{self.path}:{self.lines[row]}"


class _Columns(NamedTuple):
    """Indices of the time, of the position (2 or 3 columns) and of the id."""

    time: int
    place: list[int]
    name: int | None
    geodetic: bool


def read_table(path: Path) -> ReportTable:
    """The reports of a CSV file.

    Raises:
        InputError: no such file, no CSV text file, an empty file, a missing column, or a cell that is not valid.
    """
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


def _parse(path: Path, stream: TextIO) -> ReportTable:
    numbered = _numbered(stream)
    first = next(numbered, None)
    if first is None:
        raise InputError(f"{path}: empty, expected a header line and one line per report")
    header = [name.strip().lower() for name in first[1]]
    other = next((mark for mark in ";\t|" if mark in first[1][0]), None)
    if len(header) == 1 and other:
        raise InputError(f"{path}:{first[0]}: columns are separated by {other!r}, expected commas")
    found = _find_columns(f"{path}:{first[0]}", header)
    rows = _Rows(path, header, [], [])
    for line, cells in numbered:
        if len(cells) != len(header):
            raise InputError(f"{path}:{line}: {len(cells)} cells, expected {len(header)} as in the header")
        rows.cells.append(cells)
        rows.lines.append(line)
    if not rows.cells:
        raise InputError(f"{path}: no rows after the header, expected one line per report")
    columns = np.full((len(rows.cells), 3), np.nan)
    for axis, column in enumerate(found.place):
        columns[:, axis] = _numbers(rows, column, blank_allowed=axis == 2)
        if found.geodetic and axis < 2:
            _check_bounds(rows, column, columns[:, axis], BOUNDS[axis])
    id_column = None if found.name is None else header[found.name]
    return ReportTable(_times(rows, found.time), columns, _ids(rows, found), found.geodetic, id_column, tuple(header))


def _numbered(stream: TextIO) -> Iterator[tuple[int, list[str]]]:
    """Non-blank rows with their line numbers in the file."""
    reader = csv.reader(stream)
    for cells in reader:
        if any(cell.strip() for cell in cells):
            yield reader.line_num, cells


def _find_columns(where: str, header: list[str]) -> _Columns:
    """Find the columns; degrees where more of them are there than of metres."""
    twice = sorted({name for name in header if name and header.count(name) > 1})
    if twice:
        raise InputError(f"{where}: column {twice[0]!r} appears more than once in the header")

    def find(names: tuple[str, ...]) -> int | None:
        return next((header.index(name) for name in names if name in header), None)

    def need(names: tuple[str, ...]) -> int:
        index = find(names)
        if index is None:
            raise InputError(f"{where}: no column {listed(names)}; {_what_is_there(header, names)}")
        return index

    time = need(TIME)
    degrees, metres = (sum(find(names) is not None for names in group[:2]) for group in (DEGREES, METRES))
    if not degrees and not metres:
        names = tuple(name for group in (METRES, DEGREES) for column in group[:2] for name in column)
        raise InputError(f"{where}: no position, expected columns x, y or lat, lon; {_what_is_there(header, names)}")
    group = DEGREES if degrees > metres else METRES
    third = find(group[2])
    place = [need(group[0]), need(group[1]), *([] if third is None else [third])]
    return _Columns(time, place, find(ID), degrees > metres)


WIDEST, MOST_NAMES = 40, 20  # characters of a name and names of a header in an error


def listed(names: Sequence[str]) -> str:
    """``a, b or c``."""
    return " or ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _what_is_there(header: list[str], wanted: Sequence[str]) -> str:
    """The header, and a hint at the first unknown column that resembles a wanted column."""
    known = {name for group in (TIME, ID, *METRES, *DEGREES) for name in group}
    hints = (
        f"; for {name!r}{nearest(name, wanted)[1:]}" for name in header if name not in known and nearest(name, wanted)
    )
    names = [textwrap.shorten(name, WIDEST) for name in header[:MOST_NAMES]]
    if len(header) > MOST_NAMES:
        names.append(f"and {len(header) - MOST_NAMES} more")
    return f"the header has {', '.join(names)}{next(hints, '')}"


def _converted(rows: _Rows, column: int, convert: Callable[[str], float], expected: str) -> FloatArray:
    """A column of cells as numbers; the error names the first cell that cannot be converted."""
    row = -1

    def cells() -> Iterator[str]:
        nonlocal row
        for row, cells in enumerate(rows.cells):  # noqa: B007  (the error names the row)
            yield cells[column]

    try:
        return np.fromiter((convert(cell) for cell in cells()), np.float64, len(rows.cells))
    except (ValueError, OverflowError):
        cell = rows.cells[row][column]
        shown = repr(cell) if cell.strip() else "empty"
        raise InputError(f"{rows.where(row)}: {rows.header[column]} is {shown}, expected {expected}") from None


def _numbers(rows: _Rows, column: int, blank_allowed: bool = False) -> FloatArray:
    """A column of finite numbers; NaN where a cell is empty, if it may be."""
    convert = _number_or_blank if blank_allowed else float
    values = _converted(rows, column, convert, "a number")
    for row in np.flatnonzero(~np.isfinite(values)):
        cell = rows.cells[row][column].strip()
        if cell or not blank_allowed:
            raise InputError(f"{rows.where(row)}: {rows.header[column]} is {cell!r}, expected a finite number")
    return values


def _number_or_blank(cell: str) -> float:
    return float(cell) if cell.strip() else math.nan


def _times(rows: _Rows, column: int) -> FloatArray:
    """Times in seconds; the first row tells whether the column holds numbers or ISO 8601 times."""
    first = rows.cells[0][column]
    try:
        float(first)
    except ValueError:
        if _is_iso(first):
            expected = "an ISO 8601 time as in the first row, such as 2026-11-23T08:30:00Z"
            return _converted(rows, column, _iso_seconds, expected)
        shown = repr(first) if first.strip() else "empty"
        name = f"{rows.where(0)}: {rows.header[column]}"
        raise InputError(
            f"{name} is {shown}, expected a number (seconds) or an ISO 8601 time such as 2026-11-23T08:30:00Z"
        ) from None
    times = _numbers(rows, column)
    late = np.flatnonzero(np.abs(times) > LATEST)
    if len(late):
        cell = rows.cells[late[0]][column].strip()
        raise InputError(f"{rows.where(late[0])}: {rows.header[column]} is {cell}, expected seconds, not milliseconds")
    return times


def _is_iso(cell: str) -> bool:
    try:
        _iso_seconds(cell)
    except ValueError:
        return False
    return True


def _iso_seconds(cell: str) -> float:
    """Seconds since 1970 of an ISO 8601 time; without an offset it is UTC."""
    time = datetime.fromisoformat(cell.strip())
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()


def _check_bounds(rows: _Rows, column: int, values: FloatArray, bounds: tuple[float, float]) -> None:
    outside = np.flatnonzero((values < bounds[0]) | (values > bounds[1]))
    if len(outside):
        check_within(f"{rows.where(outside[0])}: {rows.header[column]}", float(values[outside[0]]), *bounds)


def _ids(rows: _Rows, found: _Columns) -> list[str]:
    if found.name is None:
        return [rows.path.stem] * len(rows.cells)
    ids = [cells[found.name].strip() for cells in rows.cells]
    if "" in ids:
        where, name = rows.where(ids.index("")), rows.header[found.name]
        raise InputError(f"{where}: {name} is empty, expected the name of the target")
    return ids
