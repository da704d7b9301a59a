"""The subcommand ``tracks``: its output and its files, for recordings of known content."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from wavegym.cli.main import main

AIRCRAFT = Path(__file__).parents[2] / "examples" / "data" / "aircraft_tracks.csv"


def run(capsys, *arguments: str) -> tuple[int, str, str]:
    status = main(["tracks", *arguments])
    printed = capsys.readouterr()
    return status, printed.out, printed.err


@pytest.fixture
def drone(tmp_path) -> Path:
    """A drone at 10 m/s to the east, a report a second; a gap of 100 s, two repeated rows, one frozen report."""
    times = [*range(60), *range(160, 200)]
    rows = [f"2026-11-23T10:{t // 60:02}:{t % 60:02}Z,uav,{10.0 * t},0,50" for t in times]
    frozen = f"2026-11-23T10:03:20Z,uav,{10.0 * 199},0,50"
    file = tmp_path / "drone.csv"
    file.write_text("\n".join(["time,id,x,y,z", *rows, *rows[:2], frozen]) + "\n")
    return file


def test_it_prints_times_gaps_speeds_and_what_was_dropped(drone, capsys):
    status, out, err = run(capsys, str(drone))
    assert (status, err) == (0, "")
    assert "drone.csv: 103 reports, 100 used, 1 track, x, y, z in metres as recorded" in out
    line = next(line for line in out.splitlines() if line.startswith("| uav"))
    assert [cell.strip() for cell in line.strip("|").split("|")] == [
        "uav", "103", "100", "2026-11-23T10:00:00Z", "199", "1", "1", "101", "59", "10 10 10", "0", "0",
        "2 repeated time, 1 repeated position",
    ]  # fmt: skip
    assert "dropped: 2 for repeated time (the last report of a time counts)" in out
    assert "cut at 1 gap; the longest piece lasts 59 s" in out


def test_it_writes_a_table_and_a_picture(drone, tmp_path, capsys):
    out = tmp_path / "out"
    assert run(capsys, str(drone), "--out", str(out))[0] == 0
    with (out / "tracks.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert (row["id"], row["used"], row["gaps"], row["repeated_time"]) == ("uav", "100", "1", "2")
    assert float(row["median_speed"]) == pytest.approx(10.0)
    picture = np.asarray(Image.open(out / "tracks.png").convert("RGB"))
    assert (picture != 255).any(axis=2).mean() > 0.01


def test_settings_of_gaps_and_smoothing(drone, capsys):
    whole = run(capsys, str(drone), "--max-gap", "200", "--smoothing", "3")[1]
    assert "cut at 0 gaps; the longest piece lasts 199 s" in whole
    assert "|           3 |" in whole


def test_a_recording_of_aircraft(capsys):
    out = run(capsys, str(AIRCRAFT), "--radar", "51.75", "-1.25", "100")[1]
    assert "3082 reports, 2906 used, 27 tracks, east, north, up about 51.75000, -1.25000 deg, 100 m" in out
    assert "148 for repeated position" in out
    assert "28 for too fast" in out


def test_degrees_taken_for_metres_are_pointed_out(tmp_path, capsys):
    """A path of 10 m/s to the north in degrees, whose columns are called x and y."""
    rows = "".join(f"{t},10.5,{54.0 + 9e-5 * t}\n" for t in range(60))
    for header, slow in (("t,x,y\n", True), ("t,lon,lat\n", False)):
        (tmp_path / "ship.csv").write_text(header + rows)
        out = run(capsys, str(tmp_path / "ship.csv"))[1]
        assert ("nothing moves faster than 0.01 m/s" in out) == slow


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--max-gap", "0"], "max-gap is 0.0 s"),
        (["--smoothing", "-1"], "smoothing is -1.0 s"),
        (["--radar", "1"], "--radar has 1 numbers"),
        (["--radar", "1", "2"], "expected none, because the file gives x and y in metres"),
    ],
)
def test_mistakes_take_one_line(drone, capsys, arguments, words):
    status, out, err = run(capsys, str(drone), *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert words in err


def test_the_help_lists_every_column(capsys):
    from wavegym.targets.csv_table import DEGREES, ID, METRES, TIME

    with pytest.raises(SystemExit):
        main(["tracks", "--help"])
    printed = capsys.readouterr().out
    page = (AIRCRAFT.parents[2] / "docs" / "how_to" / "recorded_tracks.md").read_text(encoding="utf-8")
    for names in (TIME, ID, *METRES, *DEGREES):
        assert all(name in printed and f"`{name}`" in page for name in names)
