"""The missions of the papers and of the faults: each simulates, sails what its paper states, and says where its figures are from.

Witnesses are the papers' own figures, closed forms on the truth, and tables against the truth by their definition.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy import stats

from leadline.core.geodesy import north_east
from leadline.data.vehicle import read_vehicle
from leadline.formats.folder import read_log
from leadline.missions.fault_keys import FAULTS
from leadline.missions.mission import read_mission
from leadline.missions.simulation import Simulation, sailed, simulate_folder
from leadline.sea.fractal import steepness

if TYPE_CHECKING:
    from leadline.data.log import Log

ROOT = Path(__file__).parent.parent / "missions"
PAPERS = sorted(p.stem for p in (ROOT / "papers").glob("*.toml"))
DEGREE = np.pi / 180


@cache
def sim(folder: str, name: str) -> Simulation:
    return sailed(read_mission(ROOT / folder / f"{name}.toml"))


@cache
def log_of(name: str) -> Log:
    return sim("papers", name).log(0)


@dataclass(frozen=True)
class Way:
    """The truth in metres north and east of the origin."""

    time: Any
    north: Any
    east: Any
    depth: Any
    heading: Any

    @property
    def speed(self) -> Any:
        return np.hypot(np.gradient(self.north, self.time), np.gradient(self.east, self.time))

    @property
    def length(self) -> float:
        return float(np.sum(np.hypot(np.diff(self.north), np.diff(self.east))))

    def at(self, time: Any) -> Any:
        """Return north, east, depth (times, 3)."""
        return np.stack([np.interp(time, self.time, v) for v in (self.north, self.east, self.depth)], axis=1)


@cache
def way(name: str) -> Way:
    truth: Any = log_of(name).truth
    place = sim("papers", name).mission.place
    north, east = north_east(truth.latitude, truth.longitude, place.latitude, place.longitude)
    return Way(truth.time, north, east, truth.depth, np.unwrap(truth.heading))


def same(a: Any, b: Any) -> bool:
    """Whether two tables hold the same, with what arrived when and columns beyond the schema."""
    if len(a) != len(b) or set(a.extra) != set(b.extra):
        return False
    pairs = [(getattr(a, c.name), getattr(b, c.name), c.metadata["text"]) for c in a.columns()]
    pairs += [(a.extra[key], b.extra[key], False) for key in a.extra]
    return all(
        (x is None and y is None) or (x is not None and y is not None and np.array_equal(x, y, equal_nan=not t)) for x, y, t in pairs
    )


# ---- every file ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PAPERS)
def test_every_mission_of_a_paper_leaves_a_log(name: str) -> None:
    """Its vehicle's instruments, those of the mission and the truth each have a table, with the rows that its rate asks for."""
    simulation, log = sim("papers", name), log_of(name)
    mission = simulation.mission
    assert mission.name == name
    assert mission.note.strip()
    assert mission.path.read_text().startswith(f"# Paper {name[:3]} (")
    assert log.vehicle == mission.vehicle.name
    carried = {"magnetometer", "swath"} - set(mission.instruments)  # no filter reads them, and none is simulated without a word of it
    assert set(log.tables) == (set(mission.vehicle.sensors) | set(mission.instruments) | {"truth"}) - carried
    duration = log["truth"].time[-1]
    for sensor in ("imu", "attitude", "depth", "dvl"):
        if sensor in mission.vehicle.sensors:
            rate = mission.vehicle[sensor].value("rate")
            assert len(log[sensor]) == pytest.approx(rate * duration, rel=0.01, abs=2)


@pytest.mark.parametrize("path", sorted((ROOT / "vehicles").glob("*.toml")), ids=lambda p: p.stem)
def test_every_vehicle_can_be_read(path: Path) -> None:
    vehicle = read_vehicle(path)
    assert vehicle.name == path.stem
    assert vehicle.process.imu in vehicle.sensors


# What a paper states of the way, or its scenario: length (m), speed (m/s), depth (m), each with how far it may be off: a stretch of
# the run-up or of the corners in the length, a fraction of the speed, what a pilot holds in depth.
STATED = {
    "000-buoy-outside": (2804, 60, 1.0, 20.0),
    "000-buoy-centre": (2804, 60, 1.0, 20.0),
    "000-buoy-late-echoes": (2804, 60, 1.0, 20.0),
    "000-buoy-drifting": (2804, 60, 1.0, 20.0),
    "001-straight": (60, 6, 1.0, 10.0),
    "001-circle": (63, 8, 1.047, 10.0),
    "001-sine": (73, 11, 1.2, 10.0),
    "001-pool": (31.5, 3, 0.2, 1.2),
    "002-triangle": (690, 10, 0.6, 4.5),
    "003-rexrov-flat": (621, 5, 1.0, 20.0),
    "003-rexrov-rough": (621, 5, 1.0, 20.0),
    "003-medusa-rough": (621, 20, 1.0, 20.0),
    "003-medusa-flat": (621, 20, 1.0, 20.0),
    "004-straight": (80, 1.5, 0.8, 5.0),
    "004-straight-lbl-delay": (80, 1.5, 0.8, 5.0),
}


@pytest.mark.parametrize("name", STATED)
def test_the_way_is_that_of_the_paper(name: str) -> None:
    length, off, speed, depth = STATED[name]
    found = way(name)
    assert found.length == pytest.approx(length, abs=off)
    assert np.median(found.speed) == pytest.approx(speed, rel=0.06)
    assert np.median(found.depth) == pytest.approx(depth, abs=0.15)


# ---- paper 000 ----------------------------------------------------------------------------------------------------------------


def test_transects_are_eight_lines() -> None:
    """On line k, 30 m east of the one before, between its ends less 50 m for the turn, the vehicle is within a metre of the line."""
    found = way("000-buoy-outside")
    middle = (found.north > 50) & (found.north < 250) & (found.depth > 15)
    line = np.round(found.east[middle] / 30.0)
    assert set(line) == set(range(8))
    assert np.max(np.abs(found.east[middle] - 30.0 * line)) < 1.0
    assert np.min(np.bincount(line.astype(int))) > 1900  # 200 m each at 1 m/s and 10 Hz


@pytest.mark.parametrize("name", [n for n in PAPERS if n.startswith("000-buoy")])
def test_the_buoy_is_heard_each_half_minute(name: str) -> None:
    """One-way ranges against the straight distance from the true transducer to where the buoy says it is: 1 m of sigma, half each."""
    simulation, log = sim("papers", name), log_of(name)
    table, mission = log["buoy"], simulation.mission
    assert np.diff(table.transmit) == pytest.approx(30.0, abs=1e-3)
    moved = np.array([0.03, -0.04]) if name.endswith("drifting") else np.zeros(2)
    start = np.array([150.0, 105.0 if name.endswith("centre") else -100.0])
    place = np.stack(north_east(table.beacon_latitude, table.beacon_longitude, mission.place.latitude, mission.place.longitude), axis=1)
    assert np.max(np.abs(place - start - moved * table.transmit[:, None])) < 5 * 0.7
    state: Any = simulation.recorder.trajectory.at(table.time).point((0.2, 0.0, -0.1))
    north, east = north_east(*state.geodetic[:2], mission.place.latitude, mission.place.longitude)
    true = np.linalg.norm(np.column_stack([place - np.column_stack([north, east]), table.beacon_depth - state.depth]), axis=1)
    error = 1500.0 * table.travel_time - true
    if not name.endswith("echoes"):
        assert np.max(np.abs(error)) < 5.0  # five sigmas
        return
    late = np.sum(error > 5.0)  # an exponential delay of 20 m exceeds 5 m in exp(-1/4) of a tenth of the rows
    low, high = stats.binom.interval(0.999, len(table), 0.1 * np.exp(-0.25))
    assert low <= late <= high
    assert np.min(error) > -5.0


def test_attitudes_of_table_one() -> None:
    """Static: nothing moves by more than a fraction of a degree. Yaw: a turn there and back. Pitch and roll: tens of degrees, both."""
    spans = {}
    for what in ("static", "yaw", "pitch-roll"):
        truth: Any = log_of(f"000-attitude-{what}").truth
        spans[what] = np.array([np.ptp(np.unwrap(angle)) for angle in (truth.roll, truth.pitch, truth.heading)]) / DEGREE
        assert len(log_of(f"000-attitude-{what}")["magnetometer"]) == len(truth)  # 100 Hz
    assert np.max(spans["static"]) < 0.2
    assert spans["yaw"][2] == pytest.approx(360.0, abs=8.0)
    assert np.max(spans["yaw"][:2]) < 2.0
    assert np.min(spans["pitch-roll"][:2]) > 30.0


def test_the_magnetometer_lies_on_its_spheroid() -> None:
    """What is left when the stated iron is taken off is the Earth's field, of one length: 0.14 uT of noise across 24 000 rows."""
    name = "000-magnetometer-calibration"
    table = log_of(name)["magnetometer"]
    soft = np.array([[1.08, 0.03, -0.02], [0.03, 0.95, 0.04], [-0.02, 0.04, 1.02]])
    plain = (table.field - np.array([6.0, -9.0, 4.0]) * 1e-6) @ np.linalg.inv(soft).T
    size = np.linalg.norm(plain, axis=1)
    assert np.std(size) == pytest.approx(0.14e-6, rel=0.12)  # noise is stretched by the inverse of the soft iron: 0.92 to 1.05
    assert np.std(np.linalg.norm(table.field, axis=1)) > 2e-6  # and before it is not
    heading = way(name).heading
    assert np.ptp(heading) > 4 * np.pi


# ---- paper 001 ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["001-sine", "001-circle", "001-straight", "001-pool"])
def test_sbl_fixes_come_at_drawn_intervals(name: str) -> None:
    table = log_of(name)["sbl"]
    gap = np.diff(table.time)
    assert np.min(gap) >= 0.1
    assert np.max(gap) <= 2.0
    assert np.mean(gap) == pytest.approx(1.05, abs=4 * 1.9 / np.sqrt(12 * len(gap)))
    if name != "001-pool":
        assert np.sqrt(np.mean(table.sigma_axes[:, :2] ** 2)) == pytest.approx(0.2, rel=0.1)  # what the note says
    found = np.stack([table.north, table.east, table.depth], axis=1)
    assert np.max(np.abs(found - way(name).at(table.time)) / table.sigma_axes) < 5.0


def test_the_three_paths_of_table_three() -> None:
    """Away from the run-up: straight to 0.1 m; the curves within what a pilot with a lookahead of 3.9 m cuts, d^2 / 2R, twice."""
    straight, circle, sine = (way(f"001-{path}") for path in ("straight", "circle", "sine"))
    assert np.max(np.abs(straight.east - 1.0)) < 0.1
    radius = np.hypot(circle.north, circle.east - 10.0)
    assert np.max(np.abs(radius[100:] - 10.0)) < 2 * 3.9**2 / 20.0
    assert np.sum(np.diff(circle.heading)) > 0.85 * 2 * np.pi
    off = sine.east - 5.0 * np.sin(0.2 * sine.north)
    assert np.max(np.abs(off)) < 2 * 3.9**2 / 2 * 5.0 * 0.2**2
    assert np.max(sine.north) > 45.0


def test_noise_of_table_two() -> None:
    """Variances of velocities over ground against the truth: 4.46e-4 and 4.58e-4 (m/s)^2, here one sigma of 0.0213 m/s for all."""
    log = log_of("001-straight")
    dvl, truth = log["dvl"], sim("papers", "001-straight").recorder.trajectory.at(log["dvl"].time)
    error = dvl.velocity - truth.velocity_b
    for axis, variance in enumerate((4.46e-4, 4.58e-4)):
        assert np.var(error[:, axis]) == pytest.approx(variance, rel=4 * np.sqrt(2 / len(dvl)))


def test_the_pool() -> None:
    mission, found = sim("papers", "001-pool").mission, way("001-pool")
    place = {name: np.array([b.north, b.east, b.depth]) for name, b in mission.beacons.items()}
    assert np.linalg.norm(place["b2"] - place["b1"]) == pytest.approx(3.3)
    assert np.linalg.norm(place["b3"] - place["b1"]) == pytest.approx(11.08)
    assert np.min(found.north) > 0 < np.min(found.east)
    assert np.max(found.north) < 14.75
    assert np.max(found.east) == pytest.approx(3.1, abs=0.6)  # to the middle of the short edge, and a turn that swings out
    assert np.hypot(found.north[-1] - found.north[0], found.east[-1] - found.east[0]) < 0.5  # back where it began


# ---- paper 002 ----------------------------------------------------------------------------------------------------------------

# Table 1: USBL fixes, degrees north and east.
TABLE_1 = np.array([
    (44.031985, 9.829877), (44.031820, 9.829461), (44.032042, 9.829189), (44.032093, 9.828454), (44.032076, 9.828269),
    (44.032063, 9.828184), (44.032069, 9.828319), (44.031664, 9.828586), (44.031357, 9.828791), (44.031175, 9.828890),
    (44.030865, 9.829867),
])  # fmt: skip


def off_triangle(corners: Any, points: Any) -> Any:
    """Distances of points to the nearest side."""
    found = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        found.append(np.linalg.norm(points - a - share[:, None] * (b - a), axis=1))
    return np.min(found, axis=0)


def test_the_triangle_fits_the_fixes_of_table_one() -> None:
    """Sides of 190 m; 8.1 m from the fixes; and no triangle moved by 5 m or turned by 3 degrees lies nearer by the loss of the fit."""
    mission = sim("papers", "002-triangle").mission
    fixes = np.stack(north_east(*(DEGREE * TABLE_1.T), mission.place.latitude, mission.place.longitude), axis=1)
    corners = mission.plan.route[[0, 1, 2]][:, :2]
    assert np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1) == pytest.approx([190.0] * 3, abs=0.1)

    def loss(shape: Any) -> float:
        return float(np.sum(np.sqrt(1 + (off_triangle(shape, fixes) / 10.0) ** 2) - 1))

    assert np.sqrt(np.mean(off_triangle(corners, fixes) ** 2)) == pytest.approx(8.1, abs=0.05)
    centre = np.mean(corners, axis=0)
    for shift in (5.0 * np.array([np.cos(a), np.sin(a)]) for a in np.arange(0, 2 * np.pi, np.pi / 4)):
        assert loss(corners + shift) > loss(corners)
    for turn in (-3 * DEGREE, 3 * DEGREE):
        rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        assert loss(centre + (corners - centre) @ rotation.T) > loss(corners)


def test_resurfacing_each_two_and_a_half_minutes() -> None:
    """One resurfacing in 150 s, each with ten fixes and those on the way up and down; the current has 0.1 m/s; rates of section 3.2."""
    log, found, mission = log_of("002-triangle"), way("002-triangle"), sim("papers", "002-triangle").mission
    gnss = log["gnss"].time
    first = gnss[np.diff(gnss, prepend=-np.inf) > 30]
    assert np.diff(first) == pytest.approx(150.0, abs=5.0)
    assert len(gnss) / len(first) == pytest.approx(14.0, abs=4.0)
    assert np.max(np.interp(gnss, found.time, found.depth)) < 0.65  # the antenna is above water
    assert len(log["usbl"]) == pytest.approx(0.05 * 0.2 * found.time[-1], abs=4 * np.sqrt(0.01 * found.time[-1]))
    assert np.min(np.diff(log["usbl"].time)) > 4.9
    flow = mission.place.water.velocity_n(np.array([0.0]), np.zeros(1), np.zeros(1), np.array([4.5]))
    assert np.hypot(*flow[0, :2]) == pytest.approx(0.1, abs=4 * 0.03 * np.sqrt(2))


# ---- paper 003 ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [n for n in PAPERS if n.startswith("003")])
def test_ground_and_beams_of_paper_three(name: str) -> None:
    mission, swath = sim("papers", name).mission, log_of(name)["swath"]
    bed: Any = mission.sea.chart
    rough = "rough" in name
    assert bed.depth.shape == (513, 513)
    assert steepness(bed.depth, 1.0) == pytest.approx(0.51 if rough else 0.032)
    assert np.std(bed.depth) == pytest.approx(8.0 if rough else 0.5, rel=0.03)
    assert 35.0 < np.mean(bed.depth) - mission.depth < 55.0
    pings = np.unique(swath.time)
    assert np.diff(pings) == pytest.approx(0.1)
    assert len(swath) == 24 * len(pings)
    assert np.min(swath.angle_across) == pytest.approx(-np.pi / 4)
    assert np.max(swath.angle_across) == pytest.approx(np.pi / 4)
    outlier = swath.extra.get("outlier", np.zeros(len(swath)))
    seen = swath.range[outlier == 0.0]
    assert 1.0 < np.min(seen) < np.max(seen) < 100.0
    assert np.mean(outlier) == pytest.approx(0.05 if "outliers" in name else 0.0, abs=4 * np.sqrt(0.05 / len(swath)))
    if name.endswith("offset"):
        depth = log_of(name)["depth"]
        assert np.mean(depth.depth - way(name).at(depth.time)[:, 2]) == pytest.approx(1.0, abs=0.005)


# ---- paper 004 ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [n for n in PAPERS if n.startswith("004-straight")])
def test_lbl_at_loch_earn(name: str) -> None:
    """Fixes each 4 s; distances to four beacons in turn, against the distance at the moment of the reply; delay and outliers as said."""
    log, simulation = log_of(name), sim("papers", name)
    assert np.diff(log["lbl"].time) == pytest.approx(4.0)
    ranges: Any = log["ranges"]
    assert set(ranges.transmitter) == {"north", "east", "south", "west"}
    beacons = simulation.mission.beacons
    place = np.array([[beacons[str(one)].north, beacons[str(one)].east, beacons[str(one)].depth] for one in ranges.transmitter], float)
    true = np.linalg.norm(place - way(name).at(0.5 * (ranges.time + ranges.transmit)), axis=1)
    error = 0.5 * 1450.0 * (ranges.travel_time - ranges.turnaround) - true
    assert np.std(error) == pytest.approx(0.3, rel=4 / np.sqrt(2 * len(error)))
    if name.endswith("delay"):
        assert log["lbl"].received - log["lbl"].time == pytest.approx(1.5)
    if name.endswith("outliers"):
        off = np.linalg.norm(_level(log, simulation, "lbl") - way(name).at(log["lbl"].time)[:, :2], axis=1)
        wrong = log["lbl"].extra["outlier"] > 0
        assert np.max(off[~wrong]) < 5.0
        assert np.min(off[wrong]) > 0.5
        low, high = stats.binom.interval(0.999, len(wrong), 0.2)
        assert low <= np.sum(wrong) <= high
    if name.endswith("fog-heading"):
        assert len(log["compass"]) == 11


def _level(log: Log, simulation: Simulation, name: str) -> Any:
    table: Any = log[name]
    place = simulation.mission.place
    return np.stack(north_east(table.latitude, table.longitude, place.latitude, place.longitude), axis=1)


def test_the_spiral_comes_up_from_twelve_metres() -> None:
    found = way("004-spiral")
    assert found.depth[0] == pytest.approx(12.0, abs=0.1)
    assert np.min(found.depth[-100:]) < 0.45
    assert np.ptp(found.heading) > 3.8 * np.pi  # two turns
    assert np.min(np.diff(np.convolve(found.depth, np.ones(100) / 100, "valid"))[200:-300]) < 0
    assert len(log_of("004-spiral")["gnss"]) > 15


def test_squares_with_and_without_satellites() -> None:
    """Corners of 10 m, twice round; the GPS wanders by metres, or is there in the first second alone."""
    found = way("004-square-gps")
    corners = np.array([[0, 0], [10, 0], [10, 10], [0, 10]], float)
    for corner in corners:
        near = np.hypot(found.north - corner[0], found.east - corner[1]) < 1.5
        assert np.sum(np.diff(near.astype(int)) == 1) >= (1 if not corner.any() else 2)
    assert found.length == pytest.approx(80.0, abs=8.0)
    table = log_of("004-square-gps")["gnss"]
    assert len(table) == pytest.approx(found.time[-1], abs=2)
    error = _level(log_of("004-square-gps"), sim("papers", "004-square-gps"), "gnss") - found.at(table.time)[:, :2]
    assert 1.0 < np.sqrt(np.mean(error**2)) < 3 * np.hypot(1.0, 3.0)
    assert np.std(np.diff(error, axis=0)) == pytest.approx(np.sqrt(2 * (1.0 + 9.0 / 120.0)), rel=0.2)  # white 1 m, and a wander of 120 s
    assert len(log_of("004-square-without-gps")["gnss"]) == 2
    assert len(log_of("004-square-gps")["lbl"]) == 0


def test_along_the_pipe_three_times() -> None:
    found = way("004-pipe")
    along = np.array([0.5, np.sqrt(0.75)]) @ np.stack([found.north, found.east])
    assert np.sum(np.diff((along > 28.0).astype(int)) == 1) == 3
    assert np.sum(np.diff((along < 2.0).astype(int)) == 1) == 3
    assert np.median(found.depth) == pytest.approx(14.0, abs=0.1)
    assert len(log_of("004-pipe")["gnss"]) == 0 == len(log_of("004-pipe")["lbl"])


@pytest.mark.parametrize(("name", "dead"), [("004-rotation-without-fog", "fog"), ("004-rotation-without-compass", "compass")])
def test_rotation_on_the_spot_with_a_dead_sensor(name: str, dead: str) -> None:
    """A full turn, which runs out for a second or two at its 7 degrees a second; the other sensor goes on to the end."""
    log, found = log_of(name), way(name)
    assert np.max(np.hypot(found.north, found.east)) < 0.5
    assert np.ptp(found.heading) == pytest.approx(2 * np.pi, abs=2 * 2 * np.pi / 50)
    other = {"fog": "compass", "compass": "fog"}[dead]
    assert log[dead].time[-1] < 60.0 <= log[dead].time[-1] + 0.3
    assert log[other].time[-1] > found.time[-1] - 0.3


def test_a_log_with_tables_of_no_rows_is_written_and_read(tmp_path: Path) -> None:
    _, log = simulate_folder(ROOT / "papers" / "004-square-without-gps.toml", tmp_path / "log")
    back = read_log(tmp_path / "log")
    assert {k: len(t) for k, t in back.tables.items()} == {k: len(t) for k, t in log.tables.items()}


# ---- faults -------------------------------------------------------------------------------------------------------------------

BEFALLEN = {
    "dvl_loss": "dvl", "beam_loss": "dvl", "false_lock": "dvl", "scale_jump": "dvl", "usbl_outliers": "usbl", "late_usbl": "usbl",
    "range_outliers": "ranges", "compass_swing": "heading", "gyro_bias_jump": "imu", "accel_bias_jump": "imu", "imu_gap": "imu",
    "gnss_jump": "gnss", "depth_drift": "depth", "tide_jump": "depth", "clock_jump": "dvl", "stuck_value": "depth",
    "noise_burst": "dvl", "sensor_dead": "depth", "loss": "dvl", "repeats": "depth", "empty": "heading", "late": "ranges",
}  # fmt: skip


def test_there_is_a_mission_for_every_fault() -> None:
    assert {p.stem for p in (ROOT / "faults").glob("*.toml")} == set(FAULTS) == set(BEFALLEN)


@pytest.mark.parametrize("kind", BEFALLEN)
def test_a_fault_changes_its_sensor_and_no_other(kind: str) -> None:
    """Against the same log without faults; and what lies outside its window, less what still arrives late, is left as it was."""
    simulation = sim("faults", kind)
    healthy, troubled = simulation.healthy(0), simulation.log(0)
    assert {name for name, table in healthy.tables.items() if not same(table, troubled[name])} == {BEFALLEN[kind]}
    (fault,) = simulation.mission.faults
    before, after = healthy[BEFALLEN[kind]], troubled[BEFALLEN[kind]]
    assert same(_values(before.select(before.time < fault.begin)), _values(after.select(after.time < fault.begin)))
    if np.isfinite(fault.end) and kind != "clock_jump":
        assert same(_values(before.select(before.time >= fault.end)), _values(after.select(after.time >= fault.end)))
    assert np.sum((before.time >= fault.begin) & (before.time < fault.end)) >= 10  # the window meets rows


def _values(table: Any) -> Any:
    """The table without what a fault adds outside its window: a column for assessment, arrivals and counts where there were none."""
    return replace(table, extra={}, device_time=None, sequence=None, received=table.time if table.received is None else table.received)


@pytest.mark.parametrize("name", [n for n in PAPERS if n.startswith("004")])
def test_faults_of_a_paper_change_their_sensor_and_no_other(name: str) -> None:
    simulation = sim("papers", name)
    healthy, troubled = simulation.healthy(0), simulation.log(0)
    changed = {sensor for sensor, table in healthy.tables.items() if not same(table, troubled[sensor])}
    assert changed == {fault.sensor for fault in simulation.mission.faults}
