"""The subcommand ``tracks``: the content of a recording of targets, and which parts can be played.

    wavegym tracks FILE.csv --out FOLDER

The columns are found by their names, in any order and case; other columns are ignored:

    time     time_s, time, t, timestamp, datetime, basedatetime, base_date_time:
             seconds, or ISO 8601 (UTC without offset)
    id       id, icao24, mmsi, track_id; left out where the file holds one target
    metres   x_m or x, y_m or y, and optionally z_m or z
    degrees  lat_deg, lat or latitude; lon_deg, lon, longitude or lng;
             optionally alt_m, alt, altitude or geoaltitude (metres)

docs/how_to/recorded_tracks.md says how reports are cleaned, cut and smoothed.
"""

from __future__ import annotations

from argparse import RawDescriptionHelpFormatter
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from wavegym.core.command_line import Parser
from wavegym.core.errors import InputError

if TYPE_CHECKING:
    from wavegym.targets import RecordedTrack, TrackSummary

SLOW = 0.01  # m/s; degrees that are taken for metres move like this
SINCE_1970 = 1e8  # s; later times are dates, earlier ones are seconds of a recorder's own
HEAD = (
    "id", "reports", "used", "start", "duration s", "every s", "gaps", "longest gap s", "longest piece s",
    "speed m/s", "smoothing s", "moves m", "dropped",
)  # fmt: skip


def parser() -> Parser:
    """The options."""
    described = (__doc__ or "").partition("\n\n")[2]
    options = Parser(
        prog="wavegym tracks",
        description=f"Show what is in a recording of targets.\n\n{described}",
        formatter_class=RawDescriptionHelpFormatter,
    )
    options.add_argument("file", type=Path, metavar="FILE", help="CSV file of reports")
    options.add_argument("--out", type=Path, metavar="FOLDER", help="also write tracks.csv and a picture, tracks.png")
    radar = "position of the radar, the origin of the picture: LAT LON [ALT]; for a file in degrees"
    options.add_argument("--radar", type=float, nargs="+", metavar="X", help=radar)
    gap = "cut where reports lie further apart (default: three times the usual time between reports, at least 30 s)"
    options.add_argument("--max-gap", type=float, metavar="S", help=gap)
    smoothing = "time constant of the smoothing (default: chosen for each track by predicting left-out reports)"
    options.add_argument("--smoothing", type=float, metavar="S", help=smoothing)
    return options


def tracks(arguments: Sequence[str]) -> None:
    """Read, print, write."""
    options = parser().read(arguments)
    from wavegym.core.errors import check_non_negative, check_positive
    from wavegym.targets import read_tracks, summarise

    if options.max_gap is not None:
        check_positive("max-gap", options.max_gap, "s")
    if options.smoothing is not None:
        check_non_negative("smoothing", options.smoothing, "s")
    if options.radar and len(options.radar) not in (2, 3):
        raise InputError(f"--radar has {len(options.radar)} numbers, expected LAT LON or LAT LON ALT")
    found = read_tracks(options.file, origin=options.radar)
    summaries = [summarise(track, options.max_gap, options.smoothing) for track in found]
    print(report(options.file, found, summaries))
    if options.out:
        _write(options.out, found, summaries, options.max_gap)
        print(f"written to {options.out}: tracks.csv, tracks.png")


def report(file: Path, found: Sequence[RecordedTrack], summaries: Sequence[TrackSummary]) -> str:
    """What was read: totals, a line for each track, and what was left out and why."""
    from wavegym.evaluation.table import tabulated

    total, used = sum(s.reports for s in summaries), sum(s.used for s in summaries)
    noun = "track" if len(found) == 1 else "tracks"
    lines = [f"{file}: {total} reports, {used} used, {len(found)} {noun}, {_frame(found[0])}", ""]
    lines += [tabulated(list(HEAD), [_row(summary) for summary in summaries]), ""]
    lines += [f"dropped: {count} for {reason} ({MEANING[reason]})" for reason, count in _reasons(summaries).items()]
    cuts, longest = sum(s.gaps for s in summaries), max(s.longest_piece for s in summaries)
    lines.append(f"cut at {cuts} gap{'' if cuts == 1 else 's'}; the longest piece lasts {longest:g} s")
    flat = sum(not s.height_known for s in summaries)
    if flat:
        lines.append(f"without any height: {flat} of {len(summaries)} tracks, which lie at height 0")
    if all(s.greatest_speed < SLOW for s in summaries):
        lines.append(f"nothing moves faster than {SLOW:g} m/s: are the positions in metres, and the times in seconds?")
    lines.append("speed m/s: least, median and greatest of the smoothed path")
    lines.append("moves m: RMS distance from the reports to the smoothed path; it should not exceed their errors")
    return "\n".join(lines)


MEANING = {
    "repeated time": "the last report of a time counts",
    "repeated position": "a recorder without new data repeats the last position",
    "too fast": "a late time stamp or a wrong position",
}


def _reasons(summaries: Sequence[TrackSummary]) -> dict[str, int]:
    """Reports left out of all tracks, by reason."""
    totals = {reason: sum(s.dropped.get(reason, 0) for s in summaries) for reason in MEANING}
    return {reason: count for reason, count in totals.items() if count}


def _frame(track: RecordedTrack) -> str:
    if track.origin is None:
        return "x, y, z in metres as recorded"
    latitude, longitude, height = track.origin
    return f"east, north, up about {latitude:.5f}, {longitude:.5f} deg, {height:g} m"


def _row(summary: TrackSummary) -> list[str]:
    s, dropped = summary, {reason: count for reason, count in summary.dropped.items() if count}
    return [
        s.id,
        str(s.reports),
        str(s.used),
        _time(s.start),
        f"{s.duration:g}",
        f"{s.spacing:.3g}",
        str(s.gaps),
        f"{s.longest_gap:g}",
        f"{s.longest_piece:g}",
        f"{s.least_speed:.3g} {s.median_speed:.3g} {s.greatest_speed:.3g}",
        f"{s.smoothing:.2g}",
        f"{s.moved:.3g}",
        ", ".join(f"{count} {reason}" for reason, count in dropped.items()) or "-",
    ]


def _time(seconds: float) -> str:
    """A date where the times are since 1970."""
    if seconds < SINCE_1970:
        return f"{seconds:g}"
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _write(
    folder: Path, found: Sequence[RecordedTrack], summaries: Sequence[TrackSummary], max_gap: float | None
) -> None:
    from wavegym.core.files import csv_text, write_whole

    fields = [name for name in summaries[0]._fields if name != "dropped"]
    head = [*fields, *(reason.replace(" ", "_") for reason in MEANING)]
    rows = [
        [*(getattr(each, field) for field in fields), *(each.dropped.get(reason, 0) for reason in MEANING)]
        for each in summaries
    ]
    contents = {"tracks.csv": csv_text(head, rows).encode(), "tracks.png": _picture(found, summaries, max_gap)}
    write_whole(folder, contents)


def _picture(found: Sequence[RecordedTrack], summaries: Sequence[TrackSummary], max_gap: float | None) -> bytes:
    """The paths from above, and the speeds over time."""
    import numpy as np
    from matplotlib.figure import Figure

    from wavegym.evaluation.picture import as_png

    figure = Figure(figsize=(11.0, 5.0), layout="constrained")
    above, along = figure.subplots(1, 2)
    zero = min(track.times[0] for track in found)
    for number, (track, summary) in enumerate(zip(found, summaries, strict=True)):
        colour = f"C{number % 10}"
        above.plot(*track.positions[:, :2].T / 1e3, ".", color=colour, markersize=2.5, alpha=0.5)
        step = max(summary.spacing / 2.0, track.duration / 20_000.0, 1e-3)
        for piece in track.resample(step, max_gap, summary.smoothing):
            above.plot(*piece.positions[:, :2].T / 1e3, "-", color=colour, linewidth=1.0)
            speed = np.linalg.norm(piece.velocities, axis=1)
            along.plot((piece.times - zero) / 60.0, speed, "-", color=colour, linewidth=1.0)
        above.annotate(track.id, track.positions[-1, :2] / 1e3, fontsize=6, color=colour)
    above.plot(0.0, 0.0, "k^")
    above.set(xlabel="x or east, km", ylabel="y or north, km", title="reports and smoothed paths; triangle: origin")
    above.set_aspect("equal", adjustable="datalim")
    along.set(xlabel="time since the first report, min", ylabel="speed, m/s", title="speed of the smoothed paths")
    return as_png(figure)
