"""The page of a mission: what is drawn lies where geometry says, nothing needs a network, and any log makes a page."""

from __future__ import annotations

import json
import re
from base64 import b64decode
from dataclasses import replace
from datetime import UTC, datetime
from math import radians

import numpy as np
import pytest
from solutions import straight

from leadline import cli
from leadline.core.attitude import quaternion_from_euler
from leadline.data import records
from leadline.data.log import Beacon, Datum, Log, Origin
from leadline.data.vehicle import SensorConfig, Vehicle
from leadline.formats.chart import write_chart
from leadline.formats.folder import write_log
from leadline.formats.solution import write_solution
from leadline.report.echoes import MOST_SOUNDINGS, soundings, usbl_fixes
from leadline.report.mission import mission_page
from leadline.report.picture import MOST_NODES, picture_of
from leadline.report.tracks import frame_of, position_fixes, track_of_truth
from leadline.sea.terrain import Chart, plane

EPOCH = datetime(2024, 5, 1, 9, tzinfo=UTC)
HAIFA = Origin(radians(32.84), radians(34.92))
TIME = np.arange(0.0, 600.0)


def truth_table(**more):
    """A circle of 100 m radius about north 300, east -50, deep as time goes, the bow along the way."""
    angle = TIME / 100.0
    values = {
        "time": TIME, "north": 300.0 + 100.0 * np.sin(angle), "east": -50.0 - 100.0 * np.cos(angle), "depth": 5.0 + TIME / 60.0,
        "roll": 0.0 * TIME, "pitch": 0.0 * TIME, "heading": angle % (2 * np.pi),
        "velocity": np.stack([np.cos(angle), np.sin(angle), 0.0 * angle + 1.0 / 60.0], axis=1),
    }  # fmt: skip
    return records.Truth(**(values | more))


def log_of(beacons=None, **tables):
    return Log("dive <1>", tables, EPOCH, HAIFA, datum=Datum(17.0), beacons=beacons or {})


def numbers(value):
    """The array that plotly's typed array stands for."""
    array = np.frombuffer(b64decode(value["bdata"]), "<f4").astype(float)
    return array.reshape([int(n) for n in value["shape"].split(",")]) if "shape" in value else array


def figures_of(page):
    return [
        json.loads(text, parse_constant=pytest.fail) for text in re.findall(r'<script type="application/json">(.*?)</script>', page, re.S)
    ]


def own_part(page):
    """The page less the inlined plotly."""
    return page.replace(max(re.findall(r"<script>.*?</script>", page, re.S), key=len), "")


def traces_of(page):
    """The traces of the scene by name."""
    return {trace["name"]: trace for trace in figures_of(page)[0]["data"] if "name" in trace}


@pytest.fixture(scope="module")
def rich():
    fixes = records.PositionFix(
        time=TIME[::60], north=truth_table().north[::60] + 0.5, east=truth_table().east[::60], depth=truth_table().depth[::60],
        extra={"outlier": np.array([0.0, 1.0] + [0.0] * 8)},
    )  # fmt: skip
    tables = {
        "truth": truth_table(),
        "depth": records.Depth(time=TIME, depth=5.0 + TIME / 60.0),
        "usbl": fixes,
        "dvl": records.Dvl(time=TIME, velocity=np.tile([1.0, 0.0, 0.0], (600, 1)), altitude=np.full(600, 20.0)),
        "thruster": records.Thruster(time=TIME, thruster=np.full((600, 2), 12.0), rudder=np.zeros(600)),
        "motor": records.MotorCurrent(time=TIME, motor=np.full((600, 2), 3.0)),
        "meter": records.WaterCurrent(time=TIME, current=np.full((600, 2), 0.1)),
        "tide": records.WaterLevel(time=TIME[::100], water_level=np.linspace(0.0, 0.5, 6)),
        "compass": records.Heading(time=TIME, heading=truth_table().heading),
        "tender": records.Platform(
            time=TIME[::10], name=np.full(60, "tender"), north=300.0 + TIME[::10] / 10.0, east=np.zeros(60), depth=np.zeros(60)
        ),
        "own": records.Other(time=TIME, extra={"salinity_psu": np.full(600, 39.0)}),
    }
    return log_of({"b1": Beacon(north=350.0, east=-50.0, depth=30.0)}, **tables)


@pytest.fixture(scope="module")
def page(rich):
    faults = [{"kind": "dvl_loss", "sensor": "dvl", "from_s": 100.0, "to_s": 160.0}]
    told = {"kind": "silent", "sensor": "dvl", "start": 100.0, "end": 160.0, "count": 0, "sentence": "dvl: silent for a minute."}
    solution = straight(TIME, summary={"happenings": [told]})
    chart = plane(40.0, 0.01, -0.02, (0.0, 800.0, -500.0, 500.0), 2.0)
    return mission_page(rich, solutions={"run": solution}, chart=chart, faults=faults)


def test_page_is_one_document_that_loads_nothing(page):
    own = own_part(page)
    assert page.startswith("<!DOCTYPE html>")
    assert page.count("</html>") == 1
    assert "dive &lt;1&gt;" in page
    assert not re.findall(r"https?://|//cdn|@import|url\(", own)
    assert not re.findall(r"<script[^>]*\ssrc=", page)
    assert len(page.encode()) < 8e6


def test_page_has_a_head_a_scene_tables_and_what_the_log_holds(page):
    own = own_part(page)
    sections = re.findall(r'<section id="([\w-]+)"', page)
    assert sections[:4] == ["scene", "tables", "faults", "happened-1"]
    assert {"depth", "speed", "attitude", "machinery", "water", "other"} <= set(sections)
    for word in ("9 min 59 s", "distance travelled, by truth", "5.0 to 15.0 m", "dvl_loss", "dvl: silent for a minute.", "water_level"):
        assert word in own, word
    titles = {a["text"] for figure in figures_of(page) for a in figure["layout"].get("annotations", ())}
    assert {
        "depth (m)", "altitude above the sea bed (m)", "speed over the ground (m/s)", "thruster speeds (revolutions per second)",
        "motor currents (A)", "current north (m/s)", "water level above the chart's datum (m)", "own: salinity_psu",
    } <= titles  # fmt: skip


def test_distance_is_that_of_the_circle(rich):
    """An arc of 599 s at 1 m/s; chords of 2 m are short of it by (2 / 100)^2 / 24."""
    assert picture_of(rich).distance == pytest.approx(599.0, abs=2.0 + 599.0 * 2e-5)


def test_figures_are_such_as_plotly_takes(page):
    """Plotly's own schema is the witness: it refuses a property that it does not know."""
    from plotly.graph_objects import Figure

    for figure in figures_of(page):
        Figure(figure)


def test_scene_shows_everything_where_it_was(page, rich):
    traces = traces_of(page)
    truth = rich.truth
    place = [numbers(traces["truth"][axis]) for axis in "yxz"]
    # float32 holds a metre in a thousand to 3e-5 m
    np.testing.assert_allclose(place, [truth.north, truth.east, -truth.depth], atol=1e-4)
    np.testing.assert_allclose(numbers(traces["truth"]["line"]["color"]), TIME / 60.0, atol=1e-5)
    np.testing.assert_allclose(numbers(traces["tender"]["y"]), rich["tender"].north, atol=1e-4)
    assert len(numbers(traces["usbl"]["x"])) == 9
    assert numbers(traces["usbl, doubtful"]["y"]) == pytest.approx([truth.north[60] + 0.5], abs=1e-4)
    assert [float(numbers(traces["beacons"][axis])[0]) for axis in "yxz"] == [350.0, -50.0, -30.0]
    np.testing.assert_allclose(numbers(traces["run"]["z"]), -20.0)
    bed = traces["sea bed"]
    north, east = numbers(bed["y"]), numbers(bed["x"])
    np.testing.assert_allclose(numbers(bed["z"]), -(40.0 + 0.01 * north[:, None] - 0.02 * east), atol=1e-4)
    assert {"sea surface", "track on the sea bed"} <= set(traces)


def test_scales_are_those_that_are_stated(page):
    scene = figures_of(page)[0]["layout"]["scene"]
    ratio, span = scene["aspectratio"], {axis: abs(np.diff(scene[f"{axis}axis"]["range"])[0]) for axis in "xyz"}
    stated = float(re.search(r"× ([\d.]+)$", scene["zaxis"]["title"]["text"])[1])
    assert f"Depth is drawn {stated:g} × the horizontal scale" in page
    assert ratio["x"] / span["x"] == pytest.approx(ratio["y"] / span["y"], rel=1e-12)
    assert ratio["z"] / span["z"] == pytest.approx(stated * ratio["x"] / span["x"], rel=1e-12)
    buttons = {b["label"]: b["args"][0] for menu in figures_of(page)[0]["layout"]["updatemenus"] for b in menu["buttons"]}
    assert buttons["× 1"]["scene.aspectratio.z"] == pytest.approx(ratio["z"] / stated, rel=1e-12)


def test_ground_is_thinned_to_nodes_of_the_chart_around_the_track(rich):
    fine = Chart(-1000.0, -1000.0, 1.0, 1.0, np.random.default_rng(0).uniform(30.0, 50.0, (2001, 2001)))
    picture = picture_of(rich, chart=fine)
    ground, box = picture.ground, picture.box
    assert max(ground.depth.shape) <= MOST_NODES
    rows, columns = (ground.north + 1000.0).astype(int), (ground.east + 1000.0).astype(int)
    assert (ground.depth == fine.depth[np.ix_(rows, columns)]).all()
    assert box.south - 5.0 <= ground.north[0] <= box.south + 5.0
    assert box.north - 5.0 <= ground.north[-1] <= box.north + 5.0
    below = ground.below(np.append(ground.north[:5], 9e9), np.append(ground.east[:5], 0.0))
    np.testing.assert_allclose(below[:5], np.diagonal(ground.depth)[:5], rtol=1e-12)
    assert np.isnan(below[5])


def test_a_chart_elsewhere_is_told_and_not_drawn(rich):
    picture = picture_of(rich, chart=plane(40.0, 0.0, 0.0, (9000.0, 9100.0, 0.0, 100.0), 10.0))
    assert picture.ground is None
    assert "The chart does not reach the track" in " ".join(picture.remarks)


def test_a_beacon_far_away_does_not_widen_the_picture(rich):
    picture = picture_of(replace(rich, beacons={"far": Beacon(north=5e4, east=0.0, depth=10.0)}))
    assert picture.box.north < 1000.0
    assert "Out of the picture: far." in picture.remarks


def test_places_in_angles_and_in_metres_are_the_same():
    """The witness is pyproj: 300 m along the meridian, and a parallel of radius N cos(latitude)."""
    from pyproj import Geod, Transformer

    east, north, _ = Geod(ellps="WGS84").fwd(34.92, 32.84, 0.0, 300.0)
    radius = np.hypot(*Transformer.from_crs("EPSG:4979", "EPSG:4978").transform(north, east, 0.0)[:2])
    log = log_of({"a": Beacon(latitude=radians(north), longitude=radians(east) + 200.0 / radius, depth=3.0)}, truth=truth_table())
    assert picture_of(log).beacons["a"] == pytest.approx((300.0, 200.0, 3.0), abs=1e-5)


def test_truth_by_height_without_outliers_in_order_of_time():
    order = np.random.default_rng(1).permutation(len(TIME))
    table = truth_table(height=17.0 - truth_table().depth, depth=None, outlier=(TIME == 7.0).astype(float)).select(order)
    log = log_of(truth=table)
    track = track_of_truth(log, frame_of(log, {}))
    assert track.time.tolist() == np.delete(TIME, 7).tolist()
    np.testing.assert_allclose(track.depth, 5.0 + track.time / 60.0, atol=1e-12)


def test_fixes_are_doubtful_where_log_sensor_or_truth_say_so():
    rng = np.random.default_rng(3)
    truth = truth_table()
    north, east = truth.north + rng.standard_normal(600), truth.east + rng.standard_normal(600)
    north[5] += 30.0
    valid = (TIME != 11.0).astype(float)
    fixes = records.PositionFix(time=TIME, north=north, east=east, valid=valid, extra={"outlier": (TIME == 17.0).astype(float)})
    log = log_of(truth=truth, usbl=fixes)
    frame = frame_of(log, {})
    found = next(position_fixes(log, frame, track_of_truth(log, frame)))
    # exp(-5^2 / 2) * 600: one in 440 draws of such a table has a good fix that is farther off
    assert np.flatnonzero(found.doubtful).tolist() == [5, 11, 17]
    np.testing.assert_allclose(found.track.depth, truth.depth, atol=1e-12)
    assert found.why == "marked as outliers in the log; invalid by the sensor's own word; more than 5 σ off truth"


def test_soundings_of_a_level_bed_lie_on_it():
    """Range to a bed 20 m below, at an angle a across and a roll r: 20 / cos(a - r); heading east, starboard is south."""
    time = np.repeat(TIME, 50)
    across, roll = np.tile(np.linspace(-0.9, 0.9, 50), 600), 0.1
    truth = truth_table(heading=np.full(600, 0.5 * np.pi), roll=np.full(600, roll), depth=np.full(600, 10.0))
    ping = records.Swath(time=time, beam=np.tile(np.arange(50.0), 600), angle_across=across, range=20.0 / np.cos(across - roll))
    log = log_of(truth=truth, multibeam=ping)
    reference = track_of_truth(log, frame_of(log, {}))
    cloud = soundings(log, reference)
    assert 0.9 * MOST_SOUNDINGS < len(cloud) <= MOST_SOUNDINGS
    np.testing.assert_allclose(cloud[:, 2], 30.0, atol=1e-9)
    single = soundings(replace(log, tables={"truth": truth, "multibeam": ping.select(slice(0, 50))}), reference)
    np.testing.assert_allclose(single[:, 0], truth.north[0] - 20.0 * np.tan(across[:50] - roll), atol=1e-9)
    np.testing.assert_allclose(single[:, 1], truth.east[0], atol=1e-9)
    timed = replace(ping, range=None, travel_time=2.0 * ping.range / 1480.0, sound_speed=np.full(len(time), 1480.0))
    np.testing.assert_allclose(soundings(replace(log, tables={"truth": truth, "multibeam": timed}), reference), cloud, atol=1e-9)


def test_mounting_of_an_echo_sounder_is_that_of_the_vehicle_file():
    """A sensor 1 m below the origin whose x axis looks down: its sounding at x = 19 m lies 20 m below."""
    truth = truth_table(depth=np.full(600, 10.0))
    seen = records.Sounding(time=TIME[:5], beam=np.zeros(5), position=np.tile([19.0, 0.0, 0.0], (5, 1)))
    log = log_of(truth=truth, echo=seen)
    turned = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    sensor = SensorConfig("echo", "sounding", np.array([0.0, 0.0, 1.0]), turned)
    vehicle = Vehicle("v", {"echo": sensor})
    cloud = soundings(log, track_of_truth(log, frame_of(log, {})), vehicle)
    np.testing.assert_allclose(cloud, np.stack([truth.north[:5], truth.east[:5], np.full(5, 30.0)], axis=1), atol=1e-9)


def usbl(seen, **more):
    """A row at 10 s of a head that sees its transmitter at a place (3,) in its axes."""
    x, y, z = seen
    distance = float(np.linalg.norm(seen))
    values = {"time": [10.0], "azimuth": [np.arctan2(y, x)], "elevation": [np.arcsin(z / distance)], "range": [distance]}
    return records.Usbl(**(values | more))


def test_a_head_on_a_ship_places_the_vehicle():
    """Heading east, what lies 10 m ahead and 5 m to starboard is 10 m east and 5 m south."""
    ship = records.Platform(
        time=[0.0, 20.0], name=["ship", "ship"], north=[100.0, 100.0], east=[40.0, 60.0], depth=[2.0, 2.0],
        roll=[0.0, 0.0], pitch=[0.0, 0.0], heading=[0.5 * np.pi] * 2,
    )  # fmt: skip
    seen = usbl((10.0, 5.0, 20.0), transmitter=["vehicle"], receiver=["ship"])
    log = log_of(poses=ship, usbl=seen)
    (fixes,) = usbl_fixes(log, frame_of(log, {}), None)
    place = [float(v[0]) for v in (fixes.track.north, fixes.track.east, fixes.track.depth)]
    assert place == pytest.approx([95.0, 60.0, 22.0], abs=1e-9)


@pytest.mark.parametrize("frame", ["sensor", "level"])
def test_a_head_on_the_vehicle_places_it_against_a_beacon(frame):
    """Heading north; in the level frame the roll of the vehicle does not count.  Sound there and back, less the turn-around."""
    roll = 0.3 if frame == "level" else 0.0
    truth = truth_table(heading=0.0 * TIME, roll=np.full(600, roll))
    distance = float(np.linalg.norm((20.0, 25.0, 45.0)))
    seen = usbl(
        (20.0, 25.0, 45.0), transmitter=["b"], frame=[frame], range=None, path=["two_way"], turnaround=[0.05],
        travel_time=[0.05 + 2.0 * distance / 1500.0],
    )  # fmt: skip
    log = log_of({"b": Beacon(north=30.0, east=40.0, depth=50.0)}, truth=truth, usbl=seen)
    frame_ = frame_of(log, {})
    (fixes,) = usbl_fixes(log, frame_, track_of_truth(log, frame_))
    place = [float(v[0]) for v in (fixes.track.north, fixes.track.east, fixes.track.depth)]
    assert place == pytest.approx([10.0, 15.0, 5.0], abs=1e-9)


def test_series_keep_their_spikes_and_headings_do_not_jump():
    time = np.arange(0.0, 20_000.0)
    depth = np.full(len(time), 10.0)
    depth[777] = 30.0
    heading = (0.01 * time) % (2 * np.pi)
    quaternion = quaternion_from_euler(0.0, 0.0, heading)
    log = log_of(
        depth=records.Depth(time=time, depth=depth),
        compass=records.Heading(time=time, heading=heading),
        ahrs=records.Attitude(time=time[5000:], quaternion=quaternion[5000:]),
    )
    drawn = {f["layout"]["annotations"][0]["text"]: f for f in figures_of(mission_page(log)) if f["layout"].get("annotations")}
    assert numbers(drawn["depth (m)"]["data"][0]["y"]).max() == 30.0
    lines = {t["name"]: numbers(t["y"]) for t in drawn["roll (°)"]["data"] if len(numbers(t["y"])) and np.nanmax(numbers(t["y"])) > 100.0}
    for name, last in (("compass", 0.01 * 19_999), ("ahrs", 0.01 * 19_999)):
        assert lines[name][-1] == pytest.approx(np.degrees(last), rel=1e-6)


ODD = {
    "one table": {"depth": records.Depth(time=[0.0, 1.0], depth=[1.0, 2.0])},
    "one row": {"gnss": records.Gnss(time=[5.0], latitude=[0.5], longitude=[0.6])},
    "no time": {"depth": records.Depth(time=[np.nan, np.nan], depth=[1.0, 2.0])},
    "no value": {"depth": records.Depth(time=[0.0, 1.0], depth=[np.nan, np.inf]), "imu": records.Imu(
        time=[0.0], delta_velocity=np.zeros((1, 3)), delta_angle=np.zeros((1, 3)), interval=[0.0])},
    "attitude alone": {"truth": records.Truth(time=TIME, heading=0.01 * TIME)},
    "wild truth": {"truth": records.Truth(time=[0.0, 1.0, 2.0], north=[0.0, 1e300, np.nan], east=[0.0, 1.0, 2.0], depth=[0.0, 1.0, 2.0])},
    "wild depth": {"depth": records.Depth(time=[0.0, 1.0, 2.0], depth=[1.0, 1e300, -1e60])},
    "standing": {"truth": records.Truth(time=TIME, north=0.0 * TIME, east=0.0 * TIME)},
    "equal times": {"gnss": records.Gnss(time=[5.0] * 4, latitude=[0.5] * 4, longitude=[0.6] * 4, valid=[0.0, 1.0, 1.0, 0.0])},
    "beacon unknown": {"usbl": usbl((1.0, 2.0, 3.0), transmitter=["nobody"])},
    "empty": {"depth": records.Depth(time=[], depth=[]), "gnss": records.Gnss(time=[], latitude=[], longitude=[]),
              "truth": records.Truth(time=[], north=[], east=[]), "echo": records.Sounding(time=[], beam=[], position=np.empty((0, 3)))},
}  # fmt: skip


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("tables", ODD.values(), ids=ODD.keys())
@pytest.mark.parametrize("origin", [HAIFA, None])
def test_any_log_makes_a_page(tables, origin):
    page = mission_page(Log("odd", tables, EPOCH, origin))
    assert figures_of(page)
    assert 'id="tables"' in page


def test_a_log_that_tells_no_place_says_so():
    assert "No table of this log says where the vehicle was." in mission_page(
        log_of(depth=records.Depth(time=[0.0, 1.0], depth=[1.0, 2.0]))
    )


def test_fixes_stand_in_for_a_way_that_nobody_tells():
    log = log_of(gnss=records.Gnss(time=TIME, latitude=0.57 + 1e-7 * TIME, longitude=np.full(600, 0.6)))
    page = mission_page(replace(log, origin=None))
    assert "distance travelled, by gnss" in page
    assert traces_of(page)["gnss"]["mode"] == "markers"


def test_a_day_stays_small():
    time = np.arange(0.0, 86_400.0, 0.2)
    rng = np.random.default_rng(0)
    walk = np.cumsum(rng.standard_normal((len(time), 2)), axis=0)
    beams = np.tile(np.linspace(-1.0, 1.0, 100), 8640)
    log = log_of(
        truth=records.Truth(time=time, north=walk[:, 0], east=walk[:, 1], depth=np.full(len(time), 50.0), heading=0.0 * time),
        imu=records.Imu(time=time, accel=rng.standard_normal((len(time), 3)), gyro=rng.standard_normal((len(time), 3))),
        fixes=records.PositionFix(time=time[::5], north=walk[::5, 0], east=walk[::5, 1]),
        swath=records.Swath(time=np.repeat(time[::50], 100), beam=beams, angle_across=beams, range=20.0 / np.cos(beams)),
    )
    chart = Chart(-3000.0, -3000.0, 3.0, 3.0, rng.uniform(60.0, 70.0, (2001, 2001)))
    assert len(mission_page(log, chart=chart).encode()) < 10e6


@pytest.fixture
def folder(tmp_path, rich):
    write_log(rich, tmp_path / "log")
    write_chart(plane(40.0, 0.01, -0.02, (0.0, 800.0, -500.0, 500.0), 10.0), tmp_path / "log" / "chart.asc")
    return tmp_path


def run(capsys, *arguments):
    capsys.readouterr()
    code = cli.run([str(a) for a in arguments])
    return code, *capsys.readouterr()


def test_command_draws_a_log_with_its_chart_and_a_solution(folder, capsys):
    write_solution(straight(TIME), folder / "run")
    (folder / "log" / "mission.toml").write_text('[[faults]]\nkind = "dvl_loss"\nfrom_s = 5.0\nto_s = 9.0\n')
    found = run(capsys, "report", folder / "log", "--out", folder / "page.html", "--solution", folder / "run")
    assert found == (0, f"report: {folder / 'page.html'}\n", "")
    page = (folder / "page.html").read_text("utf-8")
    assert {"sea bed", "run", "truth"} <= set(traces_of(page))
    assert "dvl_loss" in own_part(page)
    assert sorted(p.name for p in folder.iterdir()) == ["log", "page.html", "run"]


def test_command_lays_out_a_chart_in_degrees_of_heights(folder, capsys):
    """A level bed 44 m below the datum, in cells of a thousandth of a degree about the origin."""
    (folder / "land.asc").write_text(
        "ncols 30\nnrows 30\nxllcenter 34.905\nyllcenter 32.83\ncellsize 0.001\n" + "\n".join([" ".join(["-44"] * 30)] * 30) + "\n"
    )
    assert run(capsys, "report", folder / "log", "--out", folder / "p.html", "--chart", folder / "land.asc", "--positive", "up")[0] == 0
    bed = traces_of((folder / "p.html").read_text("utf-8"))["sea bed"]
    np.testing.assert_allclose(numbers(bed["z"])[np.isfinite(numbers(bed["z"]))], -44.0, atol=1e-4)
    assert np.diff(numbers(bed["y"])) == pytest.approx(np.full(len(numbers(bed["y"])) - 1, 110.9), abs=0.1)  # of a thousandth at 32.8 N


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--out", "log/log.toml"], "is there already"),
        (["--out", "p.html", "--chart", "none.asc"], "is not there"),
        (["--out", "p.html", "--positive", "sideways"], "positive is 'sideways'"),
        (["--out", "p.html", "--solution", "log"], "summary.json"),
        (["--out", "p.html", "--solution", "late"], "give a solution of this log"),
        (["--out", "p.html", "--vehicle", "none.toml"], "none.toml"),
        (["--out", "log/depth.csv/p.html"], "cannot be written"),
    ],
)
def test_what_is_wrong_is_one_line_and_nothing_is_written(folder, capsys, monkeypatch, more, words):
    write_solution(straight(TIME + 1e6), folder / "late")
    monkeypatch.chdir(folder)
    code, out, err = run(capsys, "report", "log", *more)
    assert (code, out) == (2, ""), err
    assert err.count("\n") == 1
    assert words in err
    assert sorted(p.name for p in folder.iterdir()) == ["late", "log"]
