"""Reading CSV files of reports: real recordings, and files that are refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wavegym.core.errors import InputError
from wavegym.targets import read_tracks, windows

HEADER = "time_s,id,lat_deg,lon_deg,alt_m"
# An airliner climbing over England; the report of 330 s is stamped some 2.5 s late (speeds 230, 164, 284, 233 m/s).
CLIMB = """270,40653d,52.301858,-0.713170,9745.98
280,40653d,52.320014,-0.729885,9814.56
290,40653d,52.338215,-0.746678,9906.0
300,40653d,52.356171,-0.763321,10027.92
310,40653d,52.374200,-0.780029,10149.84
320,40653d,52.392334,-0.796890,10241.28
330,40653d,52.405064,-0.808829,10317.48
340,40653d,52.427223,-0.829468,10401.3
350,40653d,52.445389,-0.846405,10477.5
360,40653d,52.463425,-0.863190,10568.94
370,40653d,52.481049,-0.879669,10645.14""".splitlines()
# A helicopter; the recorder repeats its position twice.
STALE = """640,40774f,50.786350,-0.816727,480.06
650,40774f,50.787979,-0.813446,381.0
660,40774f,50.788330,-0.812766,350.52
670,40774f,50.790819,-0.808258,350.52
680,40774f,50.790819,-0.808258,350.52
690,40774f,50.790819,-0.808258,350.52
700,40774f,50.797943,-0.800220,350.52
710,40774f,50.800003,-0.799404,312.42
720,40774f,50.801992,-0.798874,350.52""".splitlines()


@pytest.fixture
def written(tmp_path):
    def write(*lines: str, name: str = "tracks.csv"):
        file = tmp_path / name
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return file

    return write


def same(a, b) -> None:
    assert [t.id for t in a] == [t.id for t in b]
    for left, right in zip(a, b, strict=True):
        np.testing.assert_array_equal(left.times, right.times)
        np.testing.assert_array_equal(left.positions, right.positions)


def test_real_reports(written):
    tracks = read_tracks(written(HEADER, *CLIMB, *STALE))
    assert [t.id for t in tracks] == ["40653d", "40774f"]
    climb, stale = tracks
    assert climb.dropped == {"repeated time": 0, "repeated position": 0, "too fast": 1}
    assert 330.0 not in climb.times
    assert stale.dropped == {"repeated time": 0, "repeated position": 2, "too fast": 0}
    assert stale.times.tolist() == [640, 650, 660, 670, 700, 710, 720]
    catalogue = windows(tracks, 1.0, 50)
    speed = np.linalg.norm(catalogue.samples[:, 3:6], axis=1)
    airliner = speed[: len(catalogue.pieces[0].times)]
    assert 221.0 < airliner.min() <= airliner.max() < 238.0
    everything = read_tracks(written(HEADER, *CLIMB), max_acceleration=np.inf)
    assert len(everything[0].times) == 11


def test_default_origin_is_the_mean_of_the_reports(written):
    rows = [f"{10 * k},a,{50 + 0.01 * k},{-2 + 0.02 * k},1000" for k in range(5)]
    (track,) = read_tracks(written(HEADER, *rows, rows[2]))  # a duplicate does not pull the mean
    assert track.origin == pytest.approx((50.02, -1.96, 0.0), abs=1e-5)
    np.testing.assert_allclose(track.positions[2], (0, 0, 1000), atol=2.0)
    # north: the meridian's length of a degree at 50 degrees, 111 229 m; east: 71 695 m (tabulated for WGS-84)
    np.testing.assert_allclose(track.positions[3] - track.positions[2], (1434, 1112, 0), atol=2.0)


def test_a_radar_may_be_the_origin(written):
    (track,) = read_tracks(written(HEADER, *CLIMB), origin=(52.301858, -0.713170, 9745.98))
    np.testing.assert_allclose(track.positions[0], 0.0, atol=1e-6)
    (flat,) = read_tracks(written(HEADER, *CLIMB), origin=(52.301858, -0.713170))
    np.testing.assert_allclose(flat.positions[0], (0.0, 0.0, 9745.98), atol=1e-6)
    assert flat.origin == (52.301858, -0.713170, 0.0)


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.permutations([*CLIMB, *STALE]), st.lists(st.sampled_from([*CLIMB, *STALE]), max_size=5))
def test_neither_order_nor_duplicates_matter(written, rows, again):
    same(read_tracks(written(HEADER, *rows, *again)), read_tracks(written(HEADER, *CLIMB, *STALE)))


@pytest.mark.parametrize(
    "header", ["time_s,x_m,y_m,z_m", "time,x,y,z", "T, X ,y_m,Z", "\ufefft,x,y,z", "t,x,y,z"], ids=repr
)
def test_names_of_metre_columns(written, header):
    (track,) = read_tracks(written(header, "0,1,2,3", "", " 1 ,4,5,6", name="harbour.csv"))
    assert track.id == "harbour"
    assert track.times.tolist() == [0, 1]
    assert track.positions.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert track.origin is None
    assert track.height_known


@pytest.mark.parametrize("header", ["t,id,lat,lon,alt", "time,id,latitude,longitude,altitude"])
def test_names_of_degree_columns(written, header):
    same(read_tracks(written(header, *CLIMB)), read_tracks(written(HEADER, *CLIMB)))


def test_columns_in_any_order_beside_others(written):
    (track,) = read_tracks(written("note,y,lat,x,t", "a,2,99,1,0", "b,5,99,4,1"))
    assert track.positions.tolist() == [[1, 2, 0], [4, 5, 0]]
    assert not track.height_known


def test_metres_are_taken_as_they_are_however_fast(written):
    (track,) = read_tracks(written("t,x,y", "0,0,0", "1,900,0", "2,100,0", "3,0,0"))
    assert track.positions[:, 0].tolist() == [0, 900, 100, 0]
    (checked,) = read_tracks(written("t,x,y", "0,0,0", "1,900,0", "2,100,0", "3,0,0"), max_acceleration=100.0)
    assert checked.dropped["too fast"] == 1


def test_the_columns_of_open_sky_and_of_gps_loggers(written):
    """OpenSky's history calls the height above the ellipsoid geoaltitude, and has a barometric one too."""
    (sky,) = read_tracks(written("time,icao24,lat,lon,baroaltitude,geoaltitude", "0,a,50,0,1,90", "9,a,50.001,0,1,90"))
    (gps,) = read_tracks(written("t,lat,lng,alt", "0,50,0,90", "9,50.001,0,90"))
    assert sky.height_known
    np.testing.assert_array_equal(sky.positions, gps.positions)


def test_the_later_of_two_reports_at_one_time_counts(written):
    (track,) = read_tracks(written("t,x,y", "0,0,0", "10,5,5", "20,7,7", "10,6,6"))
    assert track.positions[1].tolist() == [6, 6, 0]
    assert track.dropped["repeated time"] == 1


def test_missing_heights(written):
    lines = [HEADER, "0,a,50,0,100", "10,a,50.01,0,", "20,a,50.02,0,300", "0,b,50,0,", "10,b,50.01,0,"]
    some, none = read_tracks(written(*lines), origin=(50.01, 0.0))
    assert some.height_known
    assert some.positions[1, 2] == pytest.approx(200.0)
    assert not none.height_known
    assert none.positions[1, 2] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([""], "tracks.csv: empty"),
        ([HEADER], "tracks.csv: no rows"),
        (
            ["time_s,lat_deg", "0,1"],
            r"tracks.csv:1: no column lon_deg, lon, longitude or lng; the header has time_s, lat_deg",
        ),
        (["x,y", "0,1"], "no column time_s, time, t, timestamp, .*; the header has x, y"),
        (["t,latitud,longitud", "0,1,1"], "no position.*for 'latitud' did you mean 'latitude'"),
        (["tme,x,y", "0,1,1"], "for 'tme' did you mean 'time'"),
        (["t,x,y_n", "0,1,1"], "no column y_m or y; .*for 'y_n' did you mean 'y_m'"),
        (["t,x,x,y", "0,1,1,1"], "column 'x' appears more than once"),
        (["0,1,2", "1,2,3"], "tracks.csv:1: no column time_s"),
        (["t,x,y", "0,1,2", "", "1,abc,3"], "tracks.csv:4: x is 'abc', expected a number"),
        (["t,x,y", "0,1,2", "1,,3"], "tracks.csv:3: x is empty, expected a number"),
        (["t,x,y", "0,nan,2"], "tracks.csv:2: x is 'nan', expected a finite number"),
        (["t,x,y", "inf,1,2"], "tracks.csv:2: t is 'inf', expected a finite number"),
        (["t,x,y,z", "0,1,2,-inf"], "tracks.csv:2: z is '-inf'"),
        (["t,x,y", "0,1"], "tracks.csv:2: 2 cells, expected 3"),
        (["t,id,x,y", "0, ,1,2"], "tracks.csv:2: id is empty"),
        (["t,lat,lon", "0,1,2", "1,90.5,2"], r"tracks.csv:3: lat is 90.5, expected .*nearest: 90"),
        (["t,x,y", "soon,1,2"], r"tracks.csv:2: t is 'soon', expected a number \(seconds\) or an ISO 8601 time"),
        (["t,x,y", ",1,2"], "tracks.csv:2: t is empty, expected a number"),
        (["t,x,y", "2026-11-23T08:30:00Z,1,2", "9,1,2"], "tracks.csv:3: t is '9', expected an ISO 8601 time as in"),
        (["t,x,y", "9,1,2", "2026-11-23T08:30:00Z,1,2"], "tracks.csv:3: t is '2026-11-23T08:30:00Z', expected a num"),
        (["t;x;y", "0;1;2"], "tracks.csv:1: columns are separated by ';', expected commas"),
        (["t\tx\ty", "0\t1\t2"], r"columns are separated by '\\t', expected commas"),
        (["t,x,y", "1717228800000,1,2"], "tracks.csv:2: t is 1717228800000, expected seconds, not milliseconds"),
        (["t,lat,lon", "0,1,361"], "tracks.csv:2: lon is 361.0"),
    ],
)
def test_errors_name_the_line(written, lines, words):
    with pytest.raises(InputError, match=words) as caught:
        read_tracks(written(*lines))
    assert "\n" not in str(caught.value)


def test_missing_and_unreadable_files(written, tmp_path):
    written("t,x,y", "0,1,2", name="aircraft.csv")
    with pytest.raises(InputError, match=r"aircrafts\.csv: no such file; did you mean 'aircraft.csv'"):
        read_tracks(tmp_path / "aircrafts.csv")
    with pytest.raises(InputError, match="no such file"):
        read_tracks(tmp_path / "missing" / "aircraft.csv")
    with pytest.raises(InputError, match="cannot be read"):
        read_tracks(tmp_path)
    (tmp_path / "binary.csv").write_bytes(b"t,x,y\n0,\xff\xfe,1\n")
    with pytest.raises(InputError, match=r"binary.csv: not a CSV text file"):
        read_tracks(tmp_path / "binary.csv")


@pytest.mark.parametrize(
    ("settings_", "words"),
    [
        ({"origin": (91.0, 0.0)}, "origin's latitude is 91.0 deg"),
        ({"origin": (1.0,)}, "origin is"),
        ({"origin": (1.0, float("nan"))}, "origin is"),
        ({"max_acceleration": 0.0}, "max_acceleration is 0.0"),
        ({"max_acceleration": float("nan")}, "max_acceleration is nan"),
    ],
)
def test_bad_settings_are_named(written, settings_, words):
    with pytest.raises(InputError, match=words):
        read_tracks(written(HEADER, *CLIMB), **settings_)


def test_metres_have_no_origin(written):
    with pytest.raises(InputError, match=r"expected none, because the file gives x and y in metres"):
        read_tracks(written("t,x,y", "0,1,2"), origin=(50.0, 0.0))


def test_iso_8601_times_are_seconds_since_1970(written):
    stamps = ["2026-11-23T08:30:00Z", "2026-11-23 08:30:10.250", "2026-11-23T10:30:20+02:00"]
    (track,) = read_tracks(written("t,x,y", *(f"{stamp},{k},0" for k, stamp in enumerate(stamps))))
    # 2026-11-23 is 20780 days after 1970-01-01: 56 years, 14 leap days, and 326 days of 2026
    midnight = (56 * 365 + 14 + 326) * 86400.0
    assert track.times.tolist() == [midnight + 30600.0 + seconds for seconds in (0.0, 10.25, 20.0)]


def ships(count: int, reports: int, every: float = 60.0) -> list[tuple[float, str, float, float]]:
    """Reports of ships on straight courses at 5 to 10 m/s, in order of time."""
    rng = np.random.default_rng(5)
    lat, lon, speed, course = rng.uniform([50, -2, 5, 0], [51, -1, 10, 2 * np.pi], (count, 4)).T
    rows = []
    for ship in range(count):
        offset = rng.integers(0, int(every))
        for k in range(reports):
            t = offset + every * k
            north, east = speed[ship] * t * np.cos(course[ship]), speed[ship] * t * np.sin(course[ship])
            rows.append((t, f"23500{ship:04}", lat[ship] + north / 111.2e3, lon[ship] + east / 70e3))
    return sorted(rows)


def test_ships_with_and_without_their_ids(written):
    rows = ships(30, 40)
    named = [f"{mmsi},2024-01-01T{t // 3600:02.0f}:{t % 3600 // 60:02.0f}:{t % 60:02.0f},{lat:.5f},{lon:.5f}"
             for t, mmsi, lat, lon in rows]  # fmt: skip
    tracks = read_tracks(written("MMSI,BaseDateTime,LAT,LON", *named))
    assert len(tracks) == 30
    assert sum(sum(track.dropped.values()) for track in tracks) == 0
    assert len(windows(tracks, 10.0, 60, max_gap=None, smoothing=None).pieces) == 30
    bare = written("BaseDateTime,LAT,LON", *(row.partition(",")[2] for row in named))
    with pytest.raises(InputError) as caught:
        read_tracks(bare)
    message = str(caught.value)
    assert "of 1200 reports contradict the others" in message
    assert "no column of ids, so all targets are one track; expected id, icao24, mmsi or track_id beside" in message
    assert "\n" not in message
    one = written("id,t,lat,lon", *(f"fleet,{t},{lat},{lon}" for t, _, lat, lon in rows))
    with pytest.raises(InputError, match=r"several targets under one id, .* most are of 'fleet' \(\d+ of 1200\)"):
        read_tracks(one)
    assert len(read_tracks(bare, max_acceleration=np.inf)) == 1  # as asked for


def test_targets_in_metres_without_ids(written):
    rng = np.random.default_rng(6)
    places = rng.uniform(-5e3, 5e3, (8, 2))
    rows = [f"{t},{x + 10 * t},{y}" for t in range(50) for x, y in places]
    with pytest.raises(InputError, match=r"350 are at another place at the same time, .*no column of ids"):
        read_tracks(written("t,x,y", *rows))
    apart = [f"{t + k / 8},{x + 10 * t},{y}" for t in range(50) for k, (x, y) in enumerate(places)]
    with pytest.raises(InputError, match=r"0 are at another place at the same time, .*no column of ids"):
        read_tracks(written("t,x,y", *apart))


def test_a_file_that_repeats_its_rows_or_positions_is_no_error(written):
    (track,) = read_tracks(written(HEADER, *CLIMB, *CLIMB, *CLIMB))
    assert track.dropped["repeated time"] == 22
    (anchored,) = read_tracks(written(HEADER, *(f"{t},a,50,0,0" for t in range(20))))
    assert anchored.dropped["repeated position"] == 19
