"""What sensors make of rows that are odd: unknown paths, beacons that are not where they say, sigmas of nothing, a user's mistakes."""

import sys
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest

from leadline.core.compiled import COMPONENTS, NUISANCES
from leadline.data.errors import InputError
from leadline.data.log import Beacon, Initial, Log, Origin
from leadline.data.outcome import Outcome
from leadline.data.records import AcousticRange, Depth, Heading, Imu, PositionFix
from leadline.data.vehicle import vehicle_from_toml
from leadline.estimate.solve import solve
from leadline.models.sensor import Channel, Context, Sensor, finite_rows, reading
from leadline.models.sensors import compose
from leadline.models.view import TANGENT, VIEW_SIZE, view_of

ORIGIN = Origin(0.6, 0.4)
CONTEXT = Context(origin=ORIGIN, beacons={"b": Beacon(north=300.0, east=400.0, depth=0.0, sigma_north=3.0, sigma_east=1.0)})
RANGES = vehicle_from_toml('name = "v"\n[process]\nmodel = "none"\n[sensors.ranges]\nkind = "acoustic_range"\nsigma_m = 0.5\n')["ranges"]
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
