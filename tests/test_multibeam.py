"""Multibeam ranges: closed forms over a plane, brute force over a rough bed, the round Earth, noise and wrong detections."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from leadline.core.geodesy import geodetic_from_ecef, north_east
from leadline.data.errors import InputError
from leadline.sea.fractal import fractal
from leadline.sea.terrain import Chart, plane
from leadline.simulate.multibeam import Multibeam
from leadline.simulate.plans import Weave, driven, still
from leadline.simulate.profiles import Ramp
from leadline.simulate.trajectory import Place, Trajectory

HAIFA = Place(0.573, 0.6096, depth=30.0, surface_height=17.0)
EXTENT = (-300.0, 300.0, -300.0, 300.0)


def sounder(bed: Chart, **changes: object) -> Multibeam:
    return Multibeam(**{"rate": 10.0, "seabed": bed, "beams": 41} | changes)


def rocking(place: Place = HAIFA, duration: float = 20.0, speed: float = 1.5) -> Trajectory:
    weave = Weave(roll=(0.2, 6.1), pitch=(0.15, 7.3), heading=(0.3, 23.0), down=(0.1, 8.9))
    return driven(place, duration, forward=Ramp(speed), heading=Ramp(2.0, 0.05), pitch=Ramp(0.1), roll=Ramp(-0.1), weave=weave)


def position_e(trajectory: Trajectory, time: np.ndarray, arm: tuple[float, float, float]) -> np.ndarray:
    state = trajectory.at(time)
    return state.position_e + state.rotation_eb @ np.asarray(arm)


def on_chart(place: Place, point_e: np.ndarray) -> np.ndarray:
    """North, east and depth (n, 3) of Earth-fixed points."""
    latitude, longitude, height = geodetic_from_ecef(point_e)
    return np.stack([*north_east(latitude, longitude, place.latitude, place.longitude), place.surface_height - height], axis=-1)


def beam_e(trajectory: Trajectory, table, mounting: tuple[float, float, float]) -> np.ndarray:
    """Unit vectors of the rows' beams, Earth-fixed, by SciPy's rotations and the angle of the table."""
    sensor = np.stack([np.zeros(len(table)), np.sin(table.angle_across), np.cos(table.angle_across)], axis=1)
    body = Rotation.from_euler("ZYX", mounting[::-1]).apply(sensor)
    return np.einsum("kij,kj->ki", trajectory.at(table.time).rotation_eb, body)


ARM, MOUNTING = (1.2, -0.3, 0.4), (0.1, -0.2, 0.3)


def test_ranges_over_a_plane_are_those_of_geometry():
    """Chart coordinates move by a metre along a beam as a central difference over 2 x 50 m says: (50 m / R)^2 / 6 = 1e-11 of it off."""
    bed, trajectory = plane(75.0, 0.08, -0.05, EXTENT, 1.0), rocking()
    sonar = sounder(bed, lever_arm_b=ARM, mounting_bs=MOUNTING)
    table = sonar.ideal(trajectory, np.arange(0.0, 20.0, 0.5))
    assert len(table) == 40 * 41
    point_e, way_e = position_e(trajectory, table.time, ARM), beam_e(trajectory, table, MOUNTING)
    point = on_chart(HAIFA, point_e)
    way = (on_chart(HAIFA, point_e + 50 * way_e) - on_chart(HAIFA, point_e - 50 * way_e)) / 100
    curve = on_chart(HAIFA, point_e + 50 * way_e) + on_chart(HAIFA, point_e - 50 * way_e) - 2 * point
    assert np.max(np.abs(curve)) < 1e-3  # and even: it leaves the difference alone
    normal = np.array([-0.08, 0.05, 1.0])
    np.testing.assert_allclose(table.range, (75.0 - point @ normal) / (way @ normal), atol=4e-9)  # of positions to 1e-9 m, some 75 / 50


def test_a_level_vehicle_over_a_level_bed_in_numbers():
    """No step of the geometry is asked but the cosine: 45 m above the bed, range 45 / cos a."""
    table = sounder(plane(75.0, 0.0, 0.0, EXTENT, 1.0)).ideal(still(HAIFA, 1.0, heading=1.0), np.array([0.0, 0.5]))
    np.testing.assert_allclose(table.range, np.tile(45.0 / np.cos(np.linspace(-np.pi / 3, np.pi / 3, 41)), 2), atol=1e-9)
    np.testing.assert_array_equal(table.beam, np.tile(np.arange(41.0), 2))
    np.testing.assert_array_equal(table.ping, np.repeat([0.0, 1.0], 41))
    np.testing.assert_array_equal(table.time, np.repeat([0.0, 0.5], 41))
    np.testing.assert_array_equal(table.quality, np.ones(82))


@pytest.mark.parametrize(
    ("pose", "mounting", "arm", "slope", "expected"),
    [  # one beam, straight down in the sensor frame, 45 m above a plane that deepens by `slope` north and east
        ({"roll": 0.3}, (0.0, 0.0, 0.0), (0, 0, 0), (0.0, 0.0), 45 / np.cos(0.3)),
        ({"pitch": 0.3}, (0.2, 0.0, 0.0), (0, 0, 2.0), (0.0, 0.0), (45 - 2 * np.cos(0.3)) / (np.cos(0.3) * np.cos(0.2))),
        ({"roll": -0.2}, (0.2, 0.0, 0.0), (0, 0, 0), (0.0, 0.0), 45.0),
        ({"heading": np.pi / 2}, (0.0, 0.0, 0.0), (10.0, 0, 0), (0.0, 0.1), 46.0),  # the arm to the east
        ({"heading": 0.0}, (0.0, 0.0, 0.0), (0, 10.0, 0), (0.1, 0.2), 47.0),
        ({"roll": np.pi / 6}, (0.0, 0.0, 0.0), (0, 0, 0), (0.0, 0.1), 45 / (np.sqrt(0.75) + 0.05)),  # down and to port
        ({"pitch": np.pi / 6}, (0.0, 0.0, 0.0), (0, 0, 0), (0.1, 0.0), 45 / (np.cos(np.pi / 6) - 0.1 * np.sin(np.pi / 6))),  # and forward
        ({}, (np.pi / 6, 0.0, np.pi / 2), (0, 0, 0), (0.1, 0.0), 45 / (np.cos(np.pi / 6) - 0.1 * np.sin(np.pi / 6))),  # port is north
    ],
)
def test_signs_of_angles_and_arms(pose, mounting, arm, slope, expected):
    bed = plane(75.0, *slope, EXTENT, 1.0)
    sonar = sounder(bed, beams=1, lever_arm_b=arm, mounting_bs=mounting)
    table = sonar.ideal(still(HAIFA, 1.0, **pose), np.zeros(1))
    assert table.range[0] == pytest.approx(expected, abs=3e-5)  # over 10 m the plumb line leans by 1.6e-6


def test_far_from_the_origin_the_true_line_meets_the_bed():
    """A straight line in space, 8 km east of the chart's origin where meridians lean: its end lies on the bed, but for the round Earth.

    A beam that goes x across and z down rises by x^2 / 2R, and strays across by less than (x^2 tan(latitude) + x z) / R.
    """
    heading = np.pi / 2
    trajectory = driven(
        HAIFA, 16.0, forward=Ramp(500.0), heading=Ramp(heading), pitch=Ramp(0.0), weave=Weave(roll=(0.2, 6.1), heading=(0.5, 7.0))
    )
    time = np.arange(15.0, 16.0, 0.1)
    middle = on_chart(HAIFA, position_e(trajectory, time[5:6], ARM))[0]
    assert middle[1] > 7000
    extent = (middle[0] - 900, middle[0] + 900, middle[1] - 900, middle[1] + 900)
    radius = 6.36e6
    for slope in ((0.0, 0.0), (0.2, 0.1), (-0.1, 0.2)):
        bed = plane(middle[2] + 45.0 - slope[0] * middle[0] - slope[1] * middle[1], *slope, extent, 2.0)
        table = sounder(bed, lever_arm_b=ARM, mounting_bs=MOUNTING).ideal(trajectory, time)
        assert len(table) > 350
        end_e = position_e(trajectory, table.time, ARM) + table.range[:, None] * beam_e(trajectory, table, MOUNTING)
        end, start = on_chart(HAIFA, end_e), on_chart(HAIFA, position_e(trajectory, table.time, ARM))
        across = np.hypot(*(end - start)[:, :2].T)
        rise = across**2 / (2 * radius)
        above = bed.depth_at(*end[:, :2].T) - end[:, 2]
        strays = (across**2 * np.tan(HAIFA.latitude) + across * (end - start)[:, 2]) / radius * np.hypot(*slope)
        assert np.all(np.abs(above - rise) <= strays + 0.02 * rise + 1e-8)
        assert np.max(rise) > 5e-4


def test_over_a_rough_bed_the_first_meeting_counts():
    bed, trajectory = fractal(EXTENT, 1.0, 75.0, beta=2.6, sigma=6.0, seed=1), rocking()
    sonar = sounder(bed, lever_arm_b=ARM, mounting_bs=MOUNTING, range_max=150.0)
    table = sonar.ideal(trajectory, np.arange(0.0, 20.0, 2.0))
    axis = np.arange(-300.0, 300.5)
    surface = RegularGridInterpolator((axis, axis), bed.depth, bounds_error=False, fill_value=np.nan)
    point_e, way_e = position_e(trajectory, table.time, ARM), beam_e(trajectory, table, MOUNTING)
    point = on_chart(HAIFA, point_e)
    way = (on_chart(HAIFA, point_e + 50 * way_e) - on_chart(HAIFA, point_e - 50 * way_e)) / 100
    end = point + table.range[:, None] * way
    np.testing.assert_allclose(end[:, 2], surface(end[:, :2]), atol=1e-6)
    for k in range(len(table)):
        line = point[k] + np.arange(0.0, table.range[k] - 1e-6, 0.02)[:, None] * way[k]
        assert np.all(line[:, 2] < surface(line[:, :2]) + 1e-6)
    every = {(p, b) for p in range(10) for b in range(41)}
    missing = every - set(zip(table.ping, table.beam, strict=True))
    assert np.all(table.range <= 150.0)
    assert len(missing) < 200


def test_beams_that_meet_nothing_within_range_have_no_row():
    trajectory = still(HAIFA, 1.0)
    near = sounder(plane(75.0, 0.0, 0.0, EXTENT, 1.0), range_max=60.0, range_min=50.0).ideal(trajectory, np.zeros(3))
    angle = np.linspace(-np.pi / 3, np.pi / 3, 41)
    seen = (45 / np.cos(angle) >= 50) & (45 / np.cos(angle) <= 60)
    np.testing.assert_array_equal(near.beam, np.tile(np.flatnonzero(seen), 3))
    np.testing.assert_array_equal(near.ping, np.repeat([0.0, 1.0, 2.0], seen.sum()))
    upside = sounder(plane(75.0, 0.0, 0.0, EXTENT, 1.0), mounting_bs=(np.pi, 0.0, 0.0)).ideal(trajectory, np.zeros(3))
    assert len(upside) == 0
    assert len(sounder(plane(75.0, 0.0, 0.0, EXTENT, 1.0), sigma=1.0, outlier_fraction=0.1).record(upside, np.random.default_rng(1))) == 0


def recorded(seed: int = 1, **changes: object):
    bed = plane(75.0, 0.0, 0.0, EXTENT, 2.0)
    sonar = sounder(bed, **changes)
    ideal = sonar.ideal(still(HAIFA, 100.0), sonar.sampling(100.0, np.random.default_rng(0)))
    return sonar, ideal, sonar.record(ideal, np.random.default_rng(seed))


def test_without_noise_what_is_recorded_is_the_truth():
    _, ideal, table = recorded()
    np.testing.assert_array_equal(table.range, ideal.range)
    assert dict(table.extra) == {}
    _, ideal, table = recorded(output="travel_time", sound_speed=1480.0)
    assert table.range is None
    np.testing.assert_allclose(table.travel_time, 2 * ideal.range / 1480.0, rtol=1e-15)
    np.testing.assert_array_equal(table.sound_speed, np.full(len(ideal), 1480.0))


def test_noise_is_normal_with_the_sigma_of_its_range():
    _, ideal, table = recorded(sigma=0.05, sigma_fraction=0.002)
    unit = (table.range - ideal.range) / np.hypot(0.05, 0.002 * ideal.range)
    assert len(unit) == 1001 * 41
    assert kstest(unit, "norm").pvalue > 1e-3
    far = ideal.range > 80.0
    assert np.std(unit[far]) == pytest.approx(1.0, abs=4 / np.sqrt(2 * far.sum()))
    _, _, again = recorded(sigma=0.05, sigma_fraction=0.002)
    np.testing.assert_array_equal(again.range, table.range)
    assert not np.array_equal(recorded(2, sigma=0.05, sigma_fraction=0.002)[2].range, table.range)


def test_wrong_detections_are_as_many_and_as_wrong_as_asked():
    _, ideal, table = recorded(outlier_fraction=0.03, outlier_size=6.0, sigma=0.01)
    wrong = table.extra["outlier"] == 1.0
    rows = len(ideal)
    assert abs(wrong.sum() - 0.03 * rows) < 4 * np.sqrt(0.03 * 0.97 * rows)
    error = (table.range - ideal.range)[wrong]
    assert np.all((np.abs(error) > 3.0 - 0.06) & (np.abs(error) < 9.0 + 0.06))
    assert abs(np.mean(error > 0) - 0.5) < 4 * 0.5 / np.sqrt(len(error))
    assert np.max(np.abs((table.range - ideal.range)[~wrong])) < 0.06
    _, ideal, table = recorded(outlier_fraction=0.03, outlier_size=60.0, range_min=10.0)
    assert np.min(table.range) >= 10.0


def test_beams_are_lost_one_by_one_and_pings_as_a_whole():
    _, ideal, table = recorded(beam_loss=0.2)
    assert abs(len(table) - 0.8 * len(ideal)) < 4 * np.sqrt(0.16 * len(ideal))
    _, ideal, table = recorded(loss=0.3, latency=0.2, latency_jitter=0.05)
    kept = np.unique(table.ping)
    assert abs(len(kept) - 0.7 * 1001) < 4 * np.sqrt(0.21 * 1001)
    assert len(table) == 41 * len(kept)
    late = (table.received - table.time).reshape(-1, 41)
    assert np.all(late == late[:, :1]) or np.ptp(late, axis=1).max() < 1e-12
    assert late.min() >= 0.2 - 1e-12
    assert np.std(late[:, 0]) > 0.01


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"output": "depth"}, "output"),
        ({"beams": 0}, "0 beams"),
        ({"swath": 7.0}, "7 rad"),
        ({"range_min": 9.0, "range_max": 5.0}, "9 to 5"),
    ],
)
def test_a_sounder_that_is_none_is_refused(change, words):
    with pytest.raises(InputError, match=words):
        sounder(plane(75.0, 0.0, 0.0, EXTENT, 10.0), **change)


def test_a_dive_has_a_swath_table():
    from leadline.simulate.dive import simulate

    sonar = replace(sounder(plane(75.0, 0.0, 0.0, EXTENT, 2.0)), beams=5, rate=2.0)
    log = simulate(still(HAIFA, 3.0), {"sonar": sonar})
    assert log.tables["sonar"].kind == "swath"
    assert len(log.tables["sonar"]) == 7 * 5


def test_a_ping_has_one_stamp_and_pieces_are_numbered_on():
    sonar, ideal, table = recorded(stamp_offset=0.5, stamp_drift=1e-3, stamp_jitter=0.01)
    ahead = table.time - ideal.time * 1.001 - 0.5
    each = ahead.reshape(-1, 41)
    np.testing.assert_allclose(each, np.tile(each[:, :1], 41), atol=1e-12)
    assert kstest(each[:, 0] / 0.01, "norm").pvalue > 1e-3
    np.testing.assert_array_equal(table.device_time, table.time)
    np.testing.assert_array_equal(table.received, ideal.time)
    time = sonar.sampling(100.0, np.random.default_rng(0))
    pieces = [sonar.going_on(time[:k]) for k in (0, 300, 700)]
    ends = (300, 700, 1001)
    seen = [one.ideal(still(HAIFA, 100.0), time[one.first : end]) for one, end in zip(pieces, ends, strict=True)]
    np.testing.assert_array_equal(np.concatenate([part.ping for part in seen]), ideal.ping)
    lossy = [replace(one, loss=0.3, latency=0.1).record(part, np.random.default_rng(2)) for one, part in zip(pieces, seen, strict=True)]
    share = sum(len(np.unique(part.ping)) for part in lossy) / 1001
    assert share == pytest.approx(0.7, abs=4 * np.sqrt(0.21 / 1001))
