"""What sensors make of rows that are odd: unknown paths, beacons that are not where they say, sigmas of nothing, a user's mistakes."""

import sys
from dataclasses import replace
from datetime import UTC, datetime
from types import ModuleType

import numpy as np
import pytest

from leadline.core.compiled import COMPONENTS, NUISANCES
from leadline.data.errors import InputError
from leadline.data.log import Beacon, Initial, Log, Origin
from leadline.data.outcome import Outcome
from leadline.data.records import (
    AcousticRange,
    Altimeter,
    Attitude,
    Depth,
    Dvl,
    Gnss,
    Heading,
    Imu,
    Navigation,
    PositionFix,
    Pressure,
    Speed,
    WaterVelocity,
    YawRate,
)
from leadline.data.vehicle import vehicle_from_toml
from leadline.estimate.solve import solve
from leadline.models.sensor import Channel, Context, Sensor, finite_rows, reading
from leadline.models.sensors import compose
from leadline.models.view import TANGENT, VIEW_SIZE, view_of

ORIGIN = Origin(0.6, 0.4)
CONTEXT = Context(origin=ORIGIN, beacons={"b": Beacon(north=300.0, east=400.0, depth=0.0, sigma_north=3.0, sigma_east=1.0)})
RANGES = vehicle_from_toml('name = "v"\n[process]\nmodel = "cruise"\n[sensors.ranges]\nkind = "acoustic_range"\nsigma_m = 0.5\n')["ranges"]
DEPTH = '[sensors.imu]\npreset = "kvh-1775"\n[sensors.depth]\nsigma_m = 0.1\n'


def rows(**columns):
    count = len(next(iter(columns.values())))
    return AcousticRange(time=np.arange(float(count)), transmitter=["b"] * count, **{"range": [500.0] * count, **columns})


def test_only_known_paths_to_the_vehicle_are_ranges_of_it():
    table = rows(path=["one_way", "two way", "difference", "two_way", "one_way"], receiver=["", "", "", "vehicle", "ship"])
    used, invalid, foreign = int(Outcome.USED), int(Outcome.INVALID), int(Outcome.NOT_CONFIGURED)
    assert compose(RANGES, CONTEXT).read(table).outcome.tolist() == [used, invalid, invalid, used, foreign]


def test_a_row_without_a_place_of_its_beacon_falls_back_on_the_log():
    north, east = np.array([np.nan, 10.0]), np.array([np.nan, 20.0])
    part = compose(RANGES, CONTEXT).read(rows(beacon_north=north, beacon_east=east)).rows[0]
    distance = np.linalg.norm(part.data[0, 2:5] - part.data[1, 2:5])
    assert distance == pytest.approx(np.hypot(290.0, 380.0), rel=1e-3)


def test_the_uncertainty_of_a_beacon_counts_along_the_line_of_sight():
    """A beacon at 3 : 4 of north and east, 3 m and 1 m uncertain: 0.36 x 9 + 0.64 x 1 beside the sensor's own 0.25."""
    sensor = compose(RANGES, CONTEXT)
    row = sensor.read(rows(path=["one_way"])).rows[0].data[0]
    view = np.zeros(2 * VIEW_SIZE)
    view[:VIEW_SIZE] = view_of(ORIGIN.latitude, ORIGIN.longitude, 0.0, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    z, R = np.zeros(COMPONENTS), np.zeros((COMPONENTS, COMPONENTS))
    Hv, Hn = np.zeros((COMPONENTS, 2 * TANGENT)), np.zeros((COMPONENTS, NUISANCES))
    channel = sensor.channels[0]
    assert channel.predict(view, np.zeros(NUISANCES), row, channel.parameters, z, R, Hv, Hn) == Outcome.USED
    assert z[0] == pytest.approx(500.0, abs=0.1)
    assert R[0, 0] == pytest.approx(0.25 + 0.36 * 9.0 + 0.64 * 1.0, rel=1e-3)


@pytest.mark.parametrize("sigma", [0.0, -1.0])
def test_a_sigma_of_nothing_makes_a_row_invalid(sigma):
    vehicle = vehicle_from_toml(
        'name = "v"\n' + DEPTH + '[sensors.heading]\nsigma_deg = 1.0\n[sensors.fix]\nkind = "position_fix"\nsigma_m = 1.0\n'
    )
    heading = compose(vehicle["heading"], CONTEXT).read(Heading(time=[0.0, 1.0], heading=[0.1, 0.1], sigma=[sigma, np.nan]))
    fix = compose(vehicle["fix"], CONTEXT).read(PositionFix(time=[0.0, 1.0], north=[0.0, 0.0], east=[0.0, 0.0], sigma=[sigma, np.nan]))
    assert heading.outcome.tolist() == fix.outcome.tolist() == [Outcome.INVALID, Outcome.USED]


USED, INVALID, FAR = Outcome.USED, Outcome.INVALID, Outcome.OUT_OF_RANGE
NAN = np.nan


def sensor(text, context=CONTEXT):
    """The sensor `a` of a vehicle file, composed."""
    found = vehicle_from_toml('name = "v"\n[process]\nmodel = "cruise"\n[sensors.a]\n' + text)
    return compose(found["a"], replace(context, shared=found.shared))


def outcomes(text, table):
    return sensor(text).read(table).outcome.tolist()


def looked(channel, row, **pose):
    """The outcome, value and covariance of a channel at a pose near the origin, at rest."""
    view = np.zeros(2 * VIEW_SIZE)
    up, quaternion = pose.get("height", 0.0), pose.get("quaternion", [1.0, 0.0, 0.0, 0.0])
    view[:VIEW_SIZE] = view_of(ORIGIN.latitude, ORIGIN.longitude, up, np.array(quaternion), np.array(pose.get("velocity", [0.0, 0.0, 0.0])))
    z, R = np.zeros(COMPONENTS), np.zeros((COMPONENTS, COMPONENTS))
    Hv, Hn = np.zeros((COMPONENTS, 2 * TANGENT)), np.zeros((COMPONENTS, NUISANCES))
    values = np.array([*(n.value for n in channel.nuisances), *np.zeros(NUISANCES)])[:NUISANCES]
    outcome = channel.predict(view, values, row, channel.parameters, z, R, Hv, Hn)
    return outcome, z[: len(channel.components)], R


def test_what_instruments_cannot_have_measured_is_said_so():
    time = np.arange(3.0)
    cases = [
        ('kind = "speed"\nsigma_mps = 0.1\nspeed_max_mps = 3.0', Speed(time=time, speed=[1.0, 4.0, NAN]), [USED, FAR, INVALID]),
        ('kind = "pressure"\nsigma_pa = 100.0\nfull_scale_pa = 3e6', Pressure(time=time, pressure=[2e5, 4e6, NAN]), [USED, FAR, INVALID]),
        (
            'kind = "yaw_rate"\nnoise_deg_per_rth = 0.1\nrate_hz = 10.0\nrate_max_degps = 50.0',
            YawRate(time=time, yaw_rate=[0.1, -1.0, NAN]),
            [USED, FAR, INVALID],
        ),
        (
            'kind = "altimeter"\nsigma_m = 0.1\nrange_max_m = 80.0\n[seabed]\ndepth = { value_m = 50.0 }',
            Altimeter(time=time, range=[20.0, 90.0, 0.0]),
            [USED, FAR, INVALID],
        ),
        (
            'kind = "water_velocity"\nsigma_mps = 0.1',
            WaterVelocity(time=time, velocity=[[1.0, 0.0, 0.0], [11.0, 0.0, 0.0], [NAN, 0.0, 0.0]]),
            [USED, FAR, INVALID],
        ),
    ]
    for text, table, expected in cases:
        assert outcomes(text, table) == expected, table.kind


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_a_doppler_log_serves_with_the_beams_that_it_has(count):
    """A ping of which so many beams are heard gives so many rows; one without any is invalid, not lost."""
    beams = 'kind = "dvl"\nsigma_mps = 0.01\nuse = "beams"\nbeam_tilt_deg = 30.0\n'
    text = beams + "beam_azimuth_deg = [45.0, 135.0, 225.0, 315.0]\ncorrelation_min = 60.0"
    beam = np.full((2, 4), 0.3)
    beam[0, count:], beam[1] = NAN, NAN
    table = Dvl(time=[0.0, 1.0], beam=beam, beam_correlation=np.full((2, 4), 90.0))
    found = sensor(text).read(table)
    assert [len(part.row) for part in found.rows] == [1] * count + [0] * (4 - count)
    assert found.outcome.tolist() == [USED, INVALID]
    weak = replace(table, beam_correlation=np.tile([50.0, 90.0, NAN, 90.0], (2, 1)))
    assert [len(part.row) for part in sensor(text).read(weak).rows] == [0, *[1] * (count - 1), *[0] * (4 - count)]
    azimuths = ", ".join(["0.0"] * count)
    assert outcomes(f"{beams}beam_azimuth_deg = [{azimuths}]", Dvl(time=[0.0, 1.0], beam=beam[:, :count])) == [USED, INVALID]


def test_a_figure_of_merit_gives_a_sigma_where_asked_and_makes_a_row_invalid():
    keys = 'kind = "dvl"\nsigma_mps = 0.05\nfom_max_mps = 0.2\nerror_velocity_max_mps = 0.1\n'
    velocity, fom = np.tile([1.0, 0.0, 0.0], (4, 1)), np.array([0.02, 0.3, NAN, 0.02])
    table = Dvl(time=np.arange(4.0), velocity=velocity, fom=fom, error_velocity=[0.0, 0.0, 0.0, -0.2])
    assert outcomes(keys, table) == [USED, INVALID, USED, INVALID]
    plain, by_fom = (sensor(keys + more).read(table).rows[0].data[:, 3] for more in ("", "sigma_per_fom = 2.0"))
    np.testing.assert_allclose(plain, 0.05**2)
    np.testing.assert_allclose(by_fom, [0.04**2, 0.05**2])  # the third row has none
    own = replace(table, sigma=np.full((4, 3), 0.01))
    np.testing.assert_allclose(sensor(keys + "sigma_per_fom = 2.0").read(own).rows[0].data[:, 3], 0.01**2)


def test_bottom_lock_lost_and_regained_loses_no_row():
    text = 'kind = "dvl"\nsigma_mps = 0.01\naltitude_sigma_m = 0.5\n[seabed]\ndepth = { value_m = 60.0 }'
    velocity = np.array([[1.0, 0.0, 0.0], [NAN] * 3, [NAN] * 3, [1.0, 0.0, 0.0]])
    table = Dvl(time=np.arange(4.0), velocity=velocity, altitude=[40.0, 41.0, 0.0, 42.0], valid=[1.0, 0.0, 0.0, 1.0])
    found = sensor(text).read(table)
    assert found.outcome.tolist() == [USED, INVALID, INVALID, USED]
    assert [part.row.tolist() for part in found.rows] == [[0, 3], [0, 3]]
    outcome, z, _ = looked(sensor(text).channels[4], found.rows[1].data[0], height=-15.0)
    assert (outcome, z.tolist()) == (0, [45.0])


def test_satellite_sigmas_come_from_the_row_then_hdop_then_the_type_of_fix():
    keys = 'kind = "gnss"\nsigma_m = 5.0\nsigma_fixed_m = 0.02\nsigma_float_m = 0.4\nsigma_per_hdop_m = 1.5\n'
    kinds = ["fixed", "float", "single", "none", "fixed", "fixed"]
    place = {"latitude": np.full(6, 0.6), "longitude": np.full(6, 0.4)}
    table = Gnss(time=np.arange(6.0), **place, fix_type=kinds, hdop=[NAN, NAN, NAN, 1.0, 2.0, 2.0], sigma=[NAN] * 5 + [0.1])
    found = sensor(keys).read(table)
    assert found.outcome.tolist() == [USED, USED, USED, INVALID, USED, USED]
    np.testing.assert_allclose(np.sqrt(found.rows[0].data[:, 5]), [0.02, 0.4, 5.0, 3.0, 0.1])
    down = sensor(keys + "vertical = true\nsigma_vertical_m = 7.0\n").read(replace(table, height=np.zeros(6)))
    np.testing.assert_allclose(np.sqrt(down.rows[1].data[:, 1]), [7.0, 7.0, 7.0, 7.0, 0.1])


def test_a_satellite_velocity_is_used_where_somebody_states_its_sigma():
    place = {"latitude": np.full(2, 0.6), "longitude": np.full(2, 0.4), "velocity": np.ones((2, 3))}
    table = Gnss(time=[0.0, 1.0], **place)
    text = 'kind = "gnss"\nsigma_m = 1.0\n'
    assert [len(part.row) for part in sensor(text).read(table).rows] == [2, 0]
    assert [len(part.row) for part in sensor(text).read(replace(table, sigma_velocity=[0.1, NAN])).rows] == [2, 1]
    data = sensor(text + "sigma_velocity_mps = 0.2\n").read(replace(table, sigma_velocity=[0.1, NAN])).rows[1].data
    np.testing.assert_allclose(np.sqrt(data[:, 3]), [0.1, 0.2])


@pytest.mark.parametrize(("depth", "expected"), [(0.3, USED), (0.9, FAR)])
def test_a_satellite_fix_is_out_of_range_while_the_antenna_is_under_water(depth, expected):
    """The antenna sits 0.2 m above the origin; up to 0.5 m of depth it may still be heard."""
    text = 'kind = "gnss"\nsigma_m = 1.0\nvertical = true\nsurface_depth_m = 0.5\nlever_arm_m = [0.0, 0.0, -0.2]\n'
    for channel in sensor(text).channels:
        assert looked(channel, np.ones(channel.row_length), height=-depth)[0] == expected
    free = sensor(text.replace("surface_depth_m = 0.5\n", ""))
    assert all(looked(channel, np.ones(channel.row_length), height=-depth)[0] == USED for channel in free.channels)


def test_a_covariance_that_is_none_makes_a_fix_invalid():
    table = PositionFix(time=np.arange(4.0), north=np.zeros(4), east=np.zeros(4), depth=np.zeros(4), cov_north_east=[0.5, 1.5, -1.0, NAN])
    assert outcomes('kind = "position_fix"\nsigma_m = 1.0', table) == [USED, INVALID, INVALID, USED]


def test_a_row_brings_its_own_atmosphere():
    text = 'kind = "pressure"\nsigma_pa = 100.0\natmosphere_pa = 99000.0\ndensity_kgpm3 = 1000.0\ngravity_mps2 = 10.0'
    found = sensor(text)
    table = Pressure(time=[0.0, 1.0], pressure=[2e5, 2e5], atmosphere=[NAN, 103000.0])
    values = [looked(found.channels[0], row, height=-10.0)[1][0] for row in found.read(table).rows[0].data]
    np.testing.assert_allclose(values, [199000.0, 203000.0], rtol=1e-12)


def test_an_altimeter_that_looks_along_the_bottom_sees_none():
    found = sensor('kind = "altimeter"\nsigma_m = 0.1\n[seabed]\ndepth = { value_m = 50.0 }').channels[0]
    row = np.array([20.0, 0.01])
    assert looked(found, row, height=-20.0)[:2] == (0, [30.0])
    for roll in (np.pi / 2, np.pi):
        assert looked(found, row, height=-20.0, quaternion=[np.cos(roll / 2), np.sin(roll / 2), 0.0, 0.0])[0] == FAR


def test_a_compass_whose_needle_sticks_is_out_of_range():
    text = 'kind = "heading"\nsigma_deg = 1.0\nnuisance.swing = {{ value_deg = [{0}, 0.0, 0.0, 0.0] }}'
    assert looked(sensor(text.format(30.0)).channels[0], np.array([0.0, 1.0]))[0] == USED
    assert looked(sensor(text.format(70.0)).channels[0], np.array([0.0, 1.0]))[0] == FAR


INCREMENTS = (
    'kind = "navigation"\nuse = "increments"\nincrement_s = 5.0\nsigma_m = 0.3\nsigma_rate_m_per_rts = 0.1\nsigma_distance_percent = 2.0\n'
)


def reckoned(time, speed=2.0):
    """Another system that says: due north at 2 m/s, sinking at 0.1 m/s and turning at 0.01 rad/s."""
    time = np.asarray(time, float)
    return Navigation(time=time, north=speed * time, east=0.0 * time, depth=0.1 * time, heading=0.01 * time)


def test_increments_join_end_to_end_and_never_overlap():
    table = reckoned([0.3, 1.0, 4.9, 5.0, 7.0, 9.9, 10.1, 31.0, 36.0])
    found = sensor(INCREMENTS + "sigma_depth_m = 0.1\nsigma_heading_deg = 0.5\n").read(table)
    none, between = Outcome.NO_CLONE, Outcome.DECIMATED
    assert found.outcome.tolist() == [none, between, between, USED, between, between, USED, none, USED]  # a gap of 21 s is none
    horizontal, depth, heading = found.rows
    np.testing.assert_allclose(horizontal.earlier, [0.3, 5.0, 31.0])
    lasted = table.time[horizontal.row] - horizontal.earlier
    np.testing.assert_allclose(horizontal.data[:, 0], 2.0 * lasted, atol=1e-5)
    np.testing.assert_allclose(horizontal.data[:, 2], 0.3**2 + 0.01 * lasted + (0.04 * lasted) ** 2, rtol=1e-5)
    np.testing.assert_allclose(depth.data[:, 0], 0.1 * lasted)
    np.testing.assert_allclose(heading.data[:, 0], 0.01 * lasted)
    assert [len(part.row) for part in sensor(INCREMENTS).read(table).rows] == [3, 0, 0]


def test_an_increment_is_the_same_from_the_rows_shortly_before_it():
    """What a live navigator sees of the table, `before` seconds of it, makes of a row what the whole table makes; in any order."""
    generator = np.random.default_rng(3)
    time = np.sort(generator.uniform(0.0, 200.0, 300))
    time = time[(time < 80.0) | (time > 97.0)]
    table, found = reckoned(time), sensor(INCREMENTS)
    whole = found.read(table)
    for k in range(0, len(time), 7):
        part = found.read(table.select((time >= time[k] - found.before) & (time <= time[k])))
        assert part.outcome[-1] == whole.outcome[k]
        mine = whole.rows[0].row == k
        np.testing.assert_array_equal(part.rows[0].data[part.rows[0].row == len(part.outcome) - 1], whole.rows[0].data[mine])
    shuffled = generator.permutation(len(time))
    np.testing.assert_array_equal(found.read(table.select(shuffled)).outcome, whole.outcome[shuffled])


def test_navigation_that_is_compared_alone_is_left_out():
    assert outcomes('kind = "navigation"', reckoned([0.0, 1.0])) == [Outcome.EXCLUDED] * 2
    vehicle = vehicle_from_toml('name = "v"\n' + DEPTH + '[sensors.other]\nkind = "navigation"\n')
    log = dive()
    solution = solve(replace(log, tables={**log.tables, "other": reckoned([0.5, 1.5])}), vehicle)
    assert solution.summary["counts"]["other"] == {"excluded": 2}


WMM = 'reference = "magnetic"\ndeclination = "wmm"\nsigma_deg = 1.0\n'


@pytest.mark.parametrize("kind", ["heading", "attitude"])
def test_the_declination_of_a_compass_is_that_of_epoch_and_origin(kind):
    """WMM 2025: published test value 1.28 degrees at 80 north, 0 east, at the start of 2025."""
    there = Context(origin=Origin(np.radians(80.0), 0.0), date=datetime(2025, 1, 1, tzinfo=UTC))
    found = sensor(f'kind = "{kind}"\n{WMM}' + ("sigma_tilt_deg = 1.0\n" if kind == "attitude" else ""), there)
    if kind == "heading":
        heading = found.read(Heading(time=[0.0], heading=[0.1])).rows[0].data[0, 0]
    else:
        data = found.read(Attitude(time=[0.0], roll=[0.0], pitch=[0.0], heading=[0.1])).rows[0].data[0]
        heading = np.arctan2(data[8], data[7])
    assert np.degrees(heading - 0.1) == pytest.approx(1.28, abs=0.005)


@pytest.mark.parametrize(
    ("text", "context", "words"),
    [
        (f'kind = "heading"\n{WMM}', Context(date=datetime(2025, 1, 1, tzinfo=UTC)), "no origin"),
        (f'kind = "heading"\n{WMM}', replace(CONTEXT, date=datetime(2000, 1, 1, tzinfo=UTC)), "field of 2000 is not known; 2010 to 2029"),
        (f'kind = "heading"\n{WMM}', Context(origin=Origin(1.5, -1.9), date=datetime(2025, 1, 1, tzinfo=UTC)), "near a magnetic pole"),
        ('kind = "heading"\nsigma_deg = 1.0\nreference = "magnetic"', CONTEXT, "is magnetic and has no declination_deg"),
        ('kind = "attitude"\nsigma_deg = 1.0\nsigma_tilt_deg = 1.0\nreference = "magnetic"', CONTEXT, "has no declination_deg"),
        ('kind = "altimeter"\nsigma_m = 0.1', CONTEXT, r"sea bed of unknown depth; add \[seabed\]"),
        ('kind = "dvl"\nsigma_mps = 0.1\naltitude_sigma_m = 1.0', CONTEXT, "sea bed of unknown depth"),
        ('kind = "yaw_rate"\nnoise_deg_per_rth = 0.1', CONTEXT, "has no rate_hz"),
        ('kind = "navigation"\nuse = "increments"', CONTEXT, "has increments and no sigma"),
    ],
)
def test_what_an_instrument_lacks_is_said_in_one_line(text, context, words):
    with pytest.raises(InputError, match=words) as caught:
        sensor(text, context)
    assert str(caught.value).startswith("sensors.a")
    assert "\n" not in str(caught.value)


def dive():
    time = np.arange(0.0, 3.0, 0.02)
    imu = Imu(time=time, accel=np.tile([0.0, 0.0, -9.8], (len(time), 1)), gyro=np.zeros((len(time), 3)))
    depth = Depth(time=[1.0, 2.0], depth=[5.0, 5.0])
    start = Initial(time=0.0, latitude=0.6, longitude=0.4, depth=5.0, heading=0.0, roll=0.0, pitch=0.0)
    return Log("dive", {"imu": imu, "depth": depth}, origin=ORIGIN, initial=start)


def made(monkeypatch, compose_own):
    module = ModuleType("users_own")
    module.compose = compose_own
    monkeypatch.setitem(sys.modules, "users_own", module)
    vehicle = vehicle_from_toml('name = "v"\n' + DEPTH)
    return replace(vehicle, sensors={**vehicle.sensors, "depth": replace(vehicle["depth"], model="users_own:compose")})


def own(answer, row_length=1):
    """A user's depth sensor whose predict gives `answer(view)`."""

    def compose_own(config, context):
        channel = Channel(("depth",), lambda views, nuisance, row: answer(views[0]), np.zeros(0), row_length)
        return Sensor(config, (channel,), lambda table: reading(table, finite_rows(0, table.depth[:, None])))

    return compose_own


def test_a_users_sensor_is_used(monkeypatch):
    solution = solve(dive(), made(monkeypatch, own(lambda view: ([-view.height], [0.01]))))
    assert solution.summary["counts"]["depth"] == {"used": 2}


@pytest.mark.parametrize(
    ("compose_own", "words"),
    [
        (own(lambda view: ([view.nothing], [0.01])), "raised AttributeError"),
        (own(lambda view: ([1.0, 2.0], [0.01])), r"predicts \(2,\)"),
        (own(lambda view: ([1.0], [-0.01])), "they must be positive"),
        (own(lambda view: ([1.0], [0.01]), row_length=2), "makes rows of 1 numbers"),
        (lambda config, context: None, "made a NoneType"),
        (lambda config, context: 1 / 0, "raised ZeroDivisionError"),
    ],
)
def test_a_users_mistake_is_said_in_one_line_that_names_the_sensor(monkeypatch, compose_own, words):
    with pytest.raises(InputError, match=words) as caught:
        solve(dive(), made(monkeypatch, compose_own))
    assert str(caught.value).startswith("sensors.depth")
    assert "\n" not in str(caught.value)
