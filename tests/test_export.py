"""Exports read back by libraries that know nothing of Leadline: shapely, fastkml with the OGC schema, gpxpy, pyproj."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from math import cos, radians

import numpy as np
import pytest
from solutions import EPOCH, solution, survey

from leadline import cli
from leadline.core import attitude
from leadline.data.errors import InputError
from leadline.data.log import Origin
from leadline.data.solution import Status
from leadline.formats.export import FORMATS, SUFFIXES, export, format_of
from leadline.formats.geojson import cut_at_date_line
from leadline.formats.sbet import LEAP_DAYS, leap_seconds, week_seconds
from leadline.formats.solution import write_solution
from leadline.formats.track import track_of

# Written from the published record: time, latitude, longitude, altitude, three velocities, roll, pitch, platform heading, wander angle,
# three body accelerations, three body rates; 17 doubles, 136 bytes.
PUBLISHED = np.dtype([(f"f{i}", "<f8") for i in range(17)])


@pytest.fixture(scope="module")
def dive():
    estimate, _ = survey()
    return estimate


def eastward(longitude, direction=1.0):
    """A kilometre along a parallel from a longitude (degrees), at 20 m: to the east, or to the west."""
    time = np.arange(0.0, 101.0)
    place = Origin(radians(-16.5), radians(longitude))
    velocity = np.tile([0.0, 10.0 * direction, 0.0], (len(time), 1))
    return solution(time, 0.0, 10.0 * direction * time, 20.0, velocity, direction * np.pi / 2, origin=place)


def lost_between(estimate, first, last):
    """The same with states that are lost from row `first` up to row `last`: no numbers, or only called so."""
    status, latitude = estimate.status.copy(), estimate.latitude.copy()
    status[first:last] = Status.LOST
    latitude[first : (first + last) // 2] = np.nan
    return replace(estimate, status=status, latitude=latitude)


def moment(estimate, time):
    return estimate.epoch + timedelta(seconds=float(time))


# GeoJSON


def features(path, kind):
    return [f for f in json.loads(path.read_text())["features"] if f["properties"]["kind"] == kind]


def test_geojson_holds_the_track_and_its_states(dive, tmp_path):
    from shapely.geometry import shape

    file = tmp_path / "dive.geojson"
    count = export(dive, file, every=0.0)
    points, lines = features(file, "state"), features(file, "track")
    assert len(points) == count == len(dive)
    found = np.array([[*shape(f["geometry"]).coords[0]] for f in points])
    np.testing.assert_allclose(found[:, 0], np.degrees(dive.longitude), atol=1e-9)
    np.testing.assert_allclose(found[:, 1], np.degrees(dive.latitude), atol=1e-9)
    np.testing.assert_allclose(found[:, 2], dive.height, atol=1e-3)
    assert [f["properties"]["status"] for f in lines] == ["aligning", "aided", "dead_reckoning", "aided"]
    assert all(shape(f["geometry"]).is_valid and shape(f["geometry"]).length > 0.0 for f in lines)
    row = int(np.searchsorted(dive.time, 700.0))
    told = points[row]["properties"]
    assert told["depth_m"] == pytest.approx(dive.depth[row], abs=1e-4)
    assert told["sigma_north_m"] == pytest.approx(dive.sigma[row, 0], abs=1e-4)
    assert told["status"] == "dead_reckoning"
    assert datetime.fromisoformat(told["time"]) == moment(dive, dive.time[row])
    for before, after in pairwise(lines):  # no hole where the status changes
        assert before["geometry"]["coordinates"][-1] == after["geometry"]["coordinates"][0]


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_geojson_cuts_a_line_at_the_date_line(tmp_path, direction):
    from shapely.geometry import shape

    export(eastward(direction * 179.995, direction), tmp_path / "line.geojson")
    (line,) = features(tmp_path / "line.geojson", "track")
    assert line["geometry"]["type"] == "MultiLineString"
    near, far = (shape({"type": "LineString", "coordinates": part}) for part in line["geometry"]["coordinates"])
    assert near.coords[-1][0] == direction * 180.0
    assert far.coords[0][0] == -direction * 180.0
    assert near.coords[-1][1:] == far.coords[0][1:]
    metres = radians(near.length + far.length) * 6378137.0 * cos(radians(16.5)) / np.sqrt(1 - 0.00669438 * np.sin(radians(16.5)) ** 2)
    assert metres == pytest.approx(1000.0, abs=0.01)
    assert max(part.bounds[2] - part.bounds[0] for part in (near, far)) < 0.01


def test_a_point_on_the_date_line_is_on_both_sides():
    line = np.array([[179.0, 1.0, 0.0], [180.0, 1.0, 0.0], [-179.0, 1.0, 0.0], [-180.0, 2.0, 0.0], [179.0, 2.0, 0.0]])
    parts = [part.tolist() for part in cut_at_date_line(line)]
    assert parts == [
        [[179.0, 1.0, 0.0], [180.0, 1.0, 0.0]],
        [[-180.0, 1.0, 0.0], [-179.0, 1.0, 0.0], [-180.0, 2.0, 0.0]],
        [[180.0, 2.0, 0.0], [179.0, 2.0, 0.0]],
    ]


def test_lost_states_are_left_out_and_no_line_bridges_them(dive, tmp_path):
    estimate = lost_between(dive, 300, 340)
    count = export(estimate, tmp_path / "a.geojson", every=0.0)
    assert count == len(dive) - 40
    lines = features(tmp_path / "a.geojson", "track")
    assert [f["properties"]["status"] for f in lines] == ["aligning", "aided", "aided", "dead_reckoning", "aided"]
    times = [f["properties"]["time_s"] for f in features(tmp_path / "a.geojson", "state")]
    np.testing.assert_allclose(times, dive.time[np.r_[0:300, 340 : len(dive)]])
    assert lines[1]["geometry"]["coordinates"][-1] != lines[2]["geometry"]["coordinates"][0]


# KML


def test_kml_is_valid_by_the_schema_and_holds_the_track(dive, tmp_path):
    from fastkml import kml
    from fastkml.containers import Document
    from fastkml.features import Placemark
    from fastkml.gx import Track
    from fastkml.utils import find_all
    from fastkml.validator import validate

    estimate = lost_between(dive, 300, 340)
    count = export(estimate, tmp_path / "dive.kml", every=0.0)
    assert validate(file_to_validate=tmp_path / "dive.kml")
    document = kml.KML.parse(tmp_path / "dive.kml", strict=True)
    tracks = list(find_all(document, of_type=Track))
    assert len(tracks) == 2
    assert sum(len(track.track_items) for track in tracks) == count
    items = [item for track in tracks for item in track.track_items]
    kept = np.r_[0:300, 340 : len(dive)]
    found = np.array([[item.coord.x, item.coord.y, item.coord.z] for item in items])
    np.testing.assert_allclose(found[:, 0], np.degrees(dive.longitude[kept]), atol=1e-9)
    np.testing.assert_allclose(found[:, 1], np.degrees(dive.latitude[kept]), atol=1e-9)
    np.testing.assert_allclose(found[:, 2], -dive.depth[kept], atol=1e-3)
    assert items[-1].when.dt == moment(dive, dive.time[-1])
    assert {track.altitude_mode.value for track in tracks} == {"absolute"}
    places = [p for p in find_all(document, of_type=Placemark) if p.name and not p.name.startswith("track")]
    assert [p.name for p in places] == ["start", "aided", "aided", "dead reckoning", "aided", "end"]
    assert next(iter(find_all(document, of_type=Document))).name


# GPX


def test_gpx_is_read_back(dive, tmp_path):
    import gpxpy

    estimate = lost_between(dive, 300, 340)
    export(estimate, tmp_path / "dive.gpx", every=0.0)
    with (tmp_path / "dive.gpx").open() as file:
        (track,) = gpxpy.parse(file, version="1.1").tracks
    assert [len(segment.points) for segment in track.segments] == [300, len(dive) - 340]
    points = [point for segment in track.segments for point in segment.points]
    kept = np.r_[0:300, 340 : len(dive)]
    np.testing.assert_allclose([p.latitude for p in points], np.degrees(dive.latitude[kept]), atol=1e-9)
    np.testing.assert_allclose([p.elevation for p in points], -dive.depth[kept], atol=1e-3)
    assert points[-1].time == moment(dive, dive.time[-1])
    assert points[500].type == "aided"
    sigma = {e.tag.partition("}")[2]: float(e.text) for e in points[-1].extensions}
    assert sigma["sigma_depth_m"] == pytest.approx(dive.sigma[-1, 2], abs=1e-3)


def test_gpx_begins_a_segment_at_the_date_line(tmp_path):
    import gpxpy

    export(eastward(179.995), tmp_path / "a.gpx")
    with (tmp_path / "a.gpx").open() as file:
        west, east = gpxpy.parse(file).tracks[0].segments
    assert min(p.longitude for p in west.points) > 179.0
    assert max(p.longitude for p in east.points) < -179.0


# TUM


def test_tum_holds_position_and_attitude(dive, tmp_path):
    from scipy.spatial.transform import Rotation

    estimate = lost_between(dive, 300, 340)
    assert export(estimate, tmp_path / "dive.tum") == len(dive) - 40
    table = np.loadtxt(tmp_path / "dive.tum")
    kept = np.r_[0:300, 340 : len(dive)]
    np.testing.assert_allclose(table[:, 0], EPOCH.timestamp() + dive.time[kept], atol=1e-5)
    np.testing.assert_allclose(table[:, 1:4], dive.position_n[kept], atol=1e-4)
    heading, pitch, roll = Rotation.from_quat(table[:, 4:]).as_euler("ZYX").T
    expected = attitude.euler_from_quaternion(dive.quaternion_nb[kept])
    for found, right in zip((roll, pitch, heading), expected, strict=True):
        np.testing.assert_allclose(attitude.wrapped(found - right), 0.0, atol=1e-8)


# SBET


def curve():
    """A steady turn to starboard that climbs, banked: every rate and acceleration has a closed form."""
    time = np.arange(0.0, 60.0, 0.02)
    speed, turn, climb, roll = 2.0, 0.05, 0.3, 0.1
    heading = 0.4 + turn * time
    north = speed / turn * (np.sin(heading) - np.sin(0.4))
    east = -speed / turn * (np.cos(heading) - np.cos(0.4))
    velocity = np.stack([speed * np.cos(heading), speed * np.sin(heading), np.full_like(time, -climb)], axis=1)
    return solution(time, north, east, 30.0 - climb * time, velocity, heading, roll=roll), speed, turn, roll


def test_sbet_positions_are_those_of_the_solution(dive, tmp_path):
    from pyproj import Transformer

    export(dive, tmp_path / "dive.sbet")
    assert (tmp_path / "dive.sbet").stat().st_size == 136 * len(dive)
    table = np.fromfile(tmp_path / "dive.sbet", PUBLISHED)
    to_earth = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    found = np.array(to_earth.transform(np.degrees(table["f2"]), np.degrees(table["f1"]), table["f3"])).T
    right = to_earth.transform(np.degrees(dive.longitude), np.degrees(dive.latitude), dive.height)
    np.testing.assert_allclose(found, np.array(right).T, atol=1e-6)
    # and by what was put in: metres along meridian and parallel, by the geodesic
    from pyproj import Geod

    _, _, steps = Geod(ellps="WGS84").inv(
        np.degrees(table["f2"][:-1]), np.degrees(table["f1"][:-1]), np.degrees(table["f2"][1:]), np.degrees(table["f1"][1:])
    )
    np.testing.assert_allclose(steps, np.hypot(np.diff(dive.north), np.diff(dive.east)), atol=2e-3)


def test_sbet_velocity_and_attitude_by_the_published_formulas(tmp_path):
    estimate, *_ = curve()
    export(estimate, tmp_path / "curve.out", "sbet")
    table = np.fromfile(tmp_path / "curve.out", PUBLISHED)
    x, y, z, wander = (table[name] for name in ("f4", "f5", "f6", "f10"))
    north, east = x * np.cos(wander) - y * np.sin(wander), -x * np.sin(wander) - y * np.cos(wander)
    np.testing.assert_allclose(np.stack([north, east, -z], axis=1), estimate.velocity_n, atol=1e-12)
    right = attitude.euler_from_quaternion(estimate.quaternion_nb)
    for found, angle in zip((table["f7"], table["f8"], table["f9"] - wander), right, strict=True):
        np.testing.assert_allclose(attitude.wrapped(found - angle), 0.0, atol=1e-12)


def test_sbet_accelerations_and_rates_are_those_of_a_banked_turn(tmp_path):
    estimate, speed, turn, roll = curve()
    export(estimate, tmp_path / "curve.sbet")
    table = np.fromfile(tmp_path / "curve.sbet", PUBLISHED)[1:-1]
    # level, the turn pulls to starboard by speed x turn and goes round down; the body is rolled
    expected = [0.0, speed * turn * np.cos(roll), -speed * turn * np.sin(roll), 0.0, turn * np.sin(roll), turn * np.cos(roll)]
    for name, value in zip(("f11", "f12", "f13", "f14", "f15", "f16"), expected, strict=True):
        np.testing.assert_allclose(table[name], value, atol=1e-6)


def test_nothing_is_differentiated_across_lost_states(tmp_path):
    estimate, speed, turn, _ = curve()
    estimate = lost_between(estimate, 1000, 1500)
    export(estimate, tmp_path / "curve.sbet")
    table = np.fromfile(tmp_path / "curve.sbet", PUBLISHED)
    size = np.linalg.norm([table["f11"], table["f12"], table["f13"]], axis=0)
    np.testing.assert_allclose(size, speed * turn, rtol=1e-3)
    alone = np.fromfile(_written(estimate.select(slice(0, 1)), tmp_path), PUBLISHED)
    assert all(alone[name] == 0.0 for name in ("f11", "f12", "f13", "f14", "f15", "f16"))


def _written(estimate, place):
    export(estimate, place / "one.sbet")
    return place / "one.sbet"


@pytest.mark.parametrize(
    ("day", "seconds"),
    [
        # GPS time - UTC of the tables of IERS and USNO; 2024-05-01 was a Wednesday
        (datetime(2024, 5, 1, 9, tzinfo=UTC), 3 * 86400 + 9 * 3600 + 18),
        (datetime(2016, 12, 31, 23, 59, 42, tzinfo=UTC), 7 * 86400 - 18 + 17),
        (datetime(2016, 12, 31, 23, 59, 59, tzinfo=UTC), 16),  # the GPS week begins 17 s before that of UTC
        (datetime(2017, 1, 1, tzinfo=UTC), 18),
        (datetime(1980, 1, 6, tzinfo=UTC), 0),
        (datetime(2000, 1, 1, tzinfo=UTC), 6 * 86400 + 13),
    ],
)
def test_sbet_times_are_seconds_of_the_gps_week(day, seconds):
    assert week_seconds(day, np.array([0.0]))[0] == seconds


def test_leap_seconds_are_those_of_the_system_time_zones():
    """The table `right` of the time zone data counts them as well, where it is installed."""
    from pathlib import Path

    file = next((p for p in (Path("/usr/share/zoneinfo") / n for n in ("leapseconds", "leap-seconds.list")) if p.exists()), None)
    if file is None:
        pytest.skip("no table of leap seconds on this system")
    lines = [line.split() for line in file.read_text().splitlines() if line.strip() and not line.startswith("#")]
    if file.name == "leapseconds":
        months = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"]
        days = [datetime(int(w[1]), months.index(w[2]) + 1, int(w[3]), tzinfo=UTC) + timedelta(days=1) for w in lines if w[0] == "Leap"]
    else:
        days = [datetime(1900, 1, 1, tzinfo=UTC) + timedelta(seconds=int(w[0])) for w in lines][1:]
    assert [day for day in days if day > datetime(1980, 1, 6, tzinfo=UTC)] == list(LEAP_DAYS)


def test_times_count_on_beyond_the_week_and_utc_has_no_leap_seconds(dive, tmp_path):
    late = replace(dive, epoch=datetime(2024, 5, 4, 23, 59, 0, tzinfo=UTC))
    export(late, tmp_path / "late.sbet")
    time = np.fromfile(tmp_path / "late.sbet", PUBLISHED)["f0"]
    np.testing.assert_allclose(np.diff(time), np.diff(dive.time), atol=1e-6)
    assert time[0] == 7 * 86400 - 60 + 18 + dive.time[0]
    export(late, tmp_path / "utc.sbet", scale="utc")
    np.testing.assert_allclose(np.fromfile(tmp_path / "utc.sbet", PUBLISHED)["f0"], time - leap_seconds(late.epoch), atol=1e-9)


# Choice, thinning, trouble


def test_maps_are_thinned_and_keep_ends_and_changes(dive):
    fine = replace(dive, time=dive.time / 10.0)  # ten states a second
    track = track_of(fine, 1.0)
    assert len(track) < len(fine) / 8
    assert track.states.time[0] == fine.time[0]
    assert track.states.time[-1] == fine.time[-1]
    changes = np.flatnonzero(np.diff(fine.status)) + 1
    assert set(fine.time[changes]) <= set(track.states.time)
    assert np.diff(track.states.time).max() <= 1.0 + 1e-9
    broken = track_of(lost_between(fine, 303, 340), 1.0).states.time
    assert {fine.time[302], fine.time[340]} <= set(broken)


@pytest.mark.parametrize("name", FORMATS)
def test_the_suffix_chooses_the_format(name, dive, tmp_path):
    export(dive, tmp_path / f"x.{name.upper()}")
    export(dive, tmp_path / "named", name)
    assert (tmp_path / "named").read_bytes() == (tmp_path / f"x.{name.upper()}").read_bytes()
    assert {format_of(f"x{suffix}") for suffix in SUFFIXES} == set(FORMATS)


def test_the_larger_axis_of_an_ellipse(dive):
    turned = np.tile(np.eye(9), (len(dive), 1, 1))
    turned[:, :2, :2] = [[5.0, 4.0], [4.0, 5.0]]  # axes 3 and 1 at 45 degrees
    np.testing.assert_allclose(track_of(replace(dive, covariance=turned)).sigma_horizontal, 3.0)


def test_names_are_escaped(dive, tmp_path):
    import gpxpy
    from lxml import etree

    named = replace(dive, summary={"log": 'a <b> & "c"'})
    export(named, tmp_path / "a.gpx")
    export(named, tmp_path / "a.kml")
    assert gpxpy.parse((tmp_path / "a.gpx").read_text()).tracks[0].name == 'a <b> & "c"'
    assert etree.parse(tmp_path / "a.kml").findtext("{*}Document/{*}name") == 'a <b> & "c"'


def refused(capsys, *arguments):
    assert cli.run([str(a) for a in arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return err


def test_the_command(dive, tmp_path, capsys):
    write_solution(dive, tmp_path / "solution")
    assert cli.run(["export", str(tmp_path / "solution"), "--out", str(tmp_path / "a.gpx"), "--every", "60"]) == 0
    assert "gpx" in capsys.readouterr().out
    assert (tmp_path / "a.gpx").read_text().count("<trkpt") == len(track_of(dive, 60.0))


def test_trouble_is_one_line(dive, tmp_path, capsys):
    place = tmp_path / "solution"
    write_solution(dive, place)
    assert "geojson" in refused(capsys, "export", place, "--out", tmp_path / "a.csv")
    assert "did you mean 'gpx'" in refused(capsys, "export", place, "--out", tmp_path / "a", "--to", "gpxx")
    assert "--every" in refused(capsys, "export", place, "--out", tmp_path / "a.kml", "--every", "-1")
    assert "--time" in refused(capsys, "export", place, "--out", tmp_path / "a.sbet", "--time", "tai")
    assert "is missing" in refused(capsys, "export", tmp_path, "--out", tmp_path / "a.kml")
    (tmp_path / "file").write_text("")
    assert "cannot be written" in refused(capsys, "export", place, "--out", tmp_path / "file" / "a.kml")
    (tmp_path / "a.kml").write_text("mine")
    assert "is there already" in refused(capsys, "export", place, "--out", tmp_path / "a.kml")
    assert (tmp_path / "a.kml").read_text() == "mine"
    assert sorted(os.listdir(tmp_path)) == ["a.kml", "file", "solution"]


@pytest.mark.parametrize("name", FORMATS)
def test_a_solution_without_states_is_refused(name, dive, tmp_path):
    for empty in (dive.select(slice(0, 0)), lost_between(dive, 0, len(dive))):
        with pytest.raises(InputError, match="has a position that is a number"):
            export(empty, tmp_path / f"a.{name}")
    assert not list(tmp_path.iterdir())


def test_time_before_gps_is_refused(dive, tmp_path):
    with pytest.raises(InputError, match="before GPS time began"):
        export(replace(dive, epoch=datetime(1979, 1, 1, tzinfo=UTC)), tmp_path / "a.sbet")
    assert not list(tmp_path.iterdir())
