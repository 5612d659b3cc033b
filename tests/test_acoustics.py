"""Acoustic instruments against geometry by hand, times of flight by root finding, and the statistics of what goes wrong."""

from __future__ import annotations

from dataclasses import replace
from math import asinh, atan2, cos, hypot, pi, sin, sqrt
from typing import Any

import numpy as np
import pymap3d
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, kstest

from leadline.data.errors import InputError
from leadline.data.log import Beacon
from leadline.sea.sound import SoundProfile
from leadline.sea.water import Level, Water
from leadline.simulate.acoustics import AcousticRange
from leadline.simulate.dive import Recorder, simulate
from leadline.simulate.instrument import Instrument
from leadline.simulate.plans import Weave, circle, still, straight
from leadline.simulate.platforms import Circle, Fixed, Moving, PlatformPose, Steady, Waves, Waypoints
from leadline.simulate.trajectory import Place, Trajectory
from leadline.simulate.usbl import ShortBaseline, Usbl, UsblFix

HERE = Place(0.57, 0.61, 30.0, 17.0)  # 30 m deep
SURFACE = replace(HERE, depth=0.0)
ROUGH = Weave((0.3, 6.1), (0.2, 7.3), (0.1, 9.0), (0.4, 11.0), (0.3, 5.0), (0.2, 4.0))
SEA = Waves((0.1, 8.0), (0.07, 6.5), (0.8, 9.0))
DRIFTING = Moving(motion=Steady(0.4, -0.3, heading=1.0), place=SURFACE, waves=SEA, lever_arm_b=(0.1, 0.0, 2.0), turnaround=0.2)
SHIP = Moving(motion=Circle(4.0, 300.0, 0.5), place=SURFACE, waves=SEA, lever_arm_b=(3.0, 1.0, 5.0))
C = 1500.0


def quiet(instrument: Instrument[Any], trajectory: Trajectory, duration: float | None = None, seed: int = 0) -> Any:
    return simulate(trajectory, {"it": instrument}, duration=duration, seed=seed)["it"]


def spread(values: np.ndarray, sigma: float) -> None:
    """Independent normal values have this sigma: chi-square, 99.9 %."""
    low, high = chi2.ppf([0.0005, 0.9995], np.size(values))
    assert low < np.sum((np.asarray(values) / sigma) ** 2) < high


def share(flags: np.ndarray, probability: float) -> None:
    """So large a share is true, within 3.5 sigmas."""
    assert np.mean(flags) == pytest.approx(probability, abs=3.5 * sqrt(probability * (1 - probability) / len(flags)))


def ned(table: Any, place: Place = HERE) -> np.ndarray:
    """North, east and down (rows, 3) of geographic rows from a place, in its tangent plane."""
    height = place.surface_height - table.depth
    return np.stack(
        pymap3d.geodetic2ned(
            table.latitude, table.longitude, height, place.latitude, place.longitude, place.surface_height - place.depth, deg=False
        ),
        axis=-1,
    )


def beacon(north: float, east: float, depth: float, **other: float) -> Beacon:
    """A beacon at metres of the tangent plane of HERE."""
    latitude, longitude, height = pymap3d.ned2geodetic(north, east, depth - 30.0, HERE.latitude, HERE.longitude, -13.0, deg=False)
    return Beacon(latitude=float(latitude), longitude=float(longitude), depth=float(17.0 - height), **other)


# What carries transducers


def test_tracks_are_metres_along_meridian_and_parallel() -> None:
    time = np.array([0.0, 10.0, 100.0])
    moving = Moving(motion=Steady(2.0, 1.0), place=SURFACE)
    latitude, longitude, height = moving.geodetic(time)
    north, east, _ = pymap3d.geodetic2ned(latitude, longitude, height, SURFACE.latitude, SURFACE.longitude, 17.0, deg=False)
    assert_allclose(np.stack([north, east], 1), time[:, None] * [2.0, 1.0], atol=2e-2)
    assert_allclose(height, 17.0)
    assert_allclose(moving.rotation_nb(time), np.tile(Rotation.from_euler("z", atan2(1, 2)).as_matrix(), (3, 1, 1)), atol=1e-15)
    north, east, heading = Circle(4.0, 100.0, 0.3)(np.array([0.0, 50 * pi]))
    assert_allclose([north[1], east[1], heading[1]], [0.0, 0.0, 0.3 + 2 * pi], atol=1e-9)
    early = Circle(4.0, 100.0, 0.3)(np.array([1e-3]))
    assert_allclose([early[0][0], early[1][0]], [4e-3 * cos(0.3), 4e-3 * sin(0.3)], rtol=1e-4)


def test_waypoints_are_joined_by_lines_and_even_turns() -> None:
    way = Waypoints((0.0, 100.0, 200.0), (0.0, 200.0, 200.0), (0.0, 0.0, 100.0), turn_time=20.0)
    north, east, heading = way(np.array([0.0, 50.0, 100.0, 150.0, 200.0, 250.0]))
    # at the corner: half of the turn is done; cut by |(-2, 1)| 20 / 8
    assert_allclose(north, [0.0, 100.0, 200.0 - 2.0 * 20 / 8, 200.0, 200.0, 200.0], atol=1e-12)
    assert_allclose(east, [0.0, 0.0, 1.0 * 20 / 8, 50.0, 100.0, 150.0], atol=1e-12)
    assert_allclose(heading, [0.0, 0.0, atan2(0.5, 1.0), pi / 2, pi / 2, pi / 2], atol=1e-12)
    time = np.linspace(80.0, 120.0, 4001)
    speed = np.diff(np.stack(way(time)[:2]), axis=1) / 0.01
    assert np.max(np.abs(np.diff(speed, axis=1))) < 1.1 * 0.01 * hypot(2.0, 1.0) / 20  # no jump
    for wrong in (((0.0,), (0.0,), (0.0,)), ((0.0, 1.0), (0.0,), (0.0, 1.0)), ((1.0, 0.0), (0.0, 1.0), (0.0, 1.0))):
        with pytest.raises(InputError, match="Waypoints"):
            Waypoints(*wrong)


def test_waves_move_what_is_afloat() -> None:
    time = np.linspace(0.0, 60.0, 50)
    afloat = Moving(motion=Steady(heading=1.0), place=SURFACE, waves=SEA, lever_arm_b=(0.0, 0.0, 2.0))
    assert_allclose(afloat.geodetic(time)[2], 17.0 - 0.8 * np.sin(2 * pi * time / 9.0 + 2.0), atol=1e-12)
    angles = Rotation.from_matrix(afloat.rotation_nb(time)).as_euler("ZYX")
    assert_allclose(
        angles, np.stack([np.ones(50), 0.07 * np.sin(2 * pi * time / 6.5 + 1.0), 0.1 * np.sin(2 * pi * time / 8.0)], 1), atol=1e-12
    )
    latitude, longitude, height = pymap3d.ecef2geodetic(*afloat.transducer_e(time).T, deg=False)
    down = Rotation.from_euler("ZYX", angles).apply([0.0, 0.0, 2.0])
    assert_allclose(height, afloat.geodetic(time)[2] - down[:, 2], atol=1e-6)
    north, east, _ = pymap3d.geodetic2ned(latitude, longitude, height, SURFACE.latitude, SURFACE.longitude, 17.0, deg=False)
    assert_allclose(np.stack([north, east], 1), down[:, :2], atol=1e-6)


def test_a_trajectory_moves_another_vehicle() -> None:
    other = circle(HERE, 50.0, speed=1.0, radius=20.0)
    moving, time = Moving(motion=other), np.array([1.0, 20.0])
    assert_array_equal(moving.position_e(time), other.at(time).position_e)
    assert_allclose(moving.rotation_eb(time), other.at(time).rotation_eb, atol=1e-15)
    for wrong in ({"motion": other, "place": HERE}, {"motion": Steady()}, {"motion": other, "waves": SEA}):
        with pytest.raises(InputError, match="Moving"):
            Moving(**wrong)


def test_poses_of_platforms_and_their_errors() -> None:
    trajectory = still(HERE, 500.0)
    pose = PlatformPose(rate=1.0, platforms={"ship": SHIP, "post": Fixed(beacon(10.0, 20.0, 5.0), HERE)}, lever_arm_b=(0.0, 0.0, -10.0))
    table = quiet(pose, trajectory)
    assert list(table.name[:4]) == ["post", "ship", "post", "ship"]
    assert table.sigma is None
    ship = table.select(table.name == "ship")
    angles = Rotation.from_matrix(SHIP.rotation_nb(ship.time))
    assert_allclose(
        Rotation.from_euler("ZYX", np.stack([ship.heading, ship.pitch, ship.roll], 1)).as_matrix(), angles.as_matrix(), atol=1e-12
    )
    height = SHIP.geodetic(ship.time)[2]
    assert_allclose(ship.depth, 17.0 - height + angles.apply([0.0, 0.0, -10.0])[:, 2], atol=1e-5)
    noisy = quiet(replace(pose, sigma=0.5, sigma_attitude=(0.01, 0.02, 0.03)), trajectory)
    assert_array_equal(noisy.sigma_attitude[7], [0.01, 0.02, 0.03])
    assert_array_equal(noisy.sigma, 0.5)
    spread(ned(noisy) - ned(table), 0.5)
    for name, sigma in (("roll", 0.01), ("pitch", 0.02), ("heading", 0.03)):
        spread((getattr(noisy, name) - getattr(table, name) + pi) % (2 * pi) - pi, sigma)
    with pytest.raises(InputError, match="no platform"):
        quiet(PlatformPose(rate=1.0), trajectory)


# Ranges with others that move


@pytest.mark.parametrize("path", ["one_way", "two_way"])
def test_flights_between_two_that_move(path: str) -> None:
    trajectory = circle(HERE, 100.0, speed=3.0, radius=30.0, weave=ROUGH)
    acoustic = AcousticRange(
        rate=0.5, platforms={"buoy": DRIFTING}, beacons={"a": beacon(100.0, 50.0, 60.0)}, path=path, lever_arm_b=(0.5, 0.1, -0.3)
    )
    table = quiet(acoustic, trajectory)
    assert list(table.transmitter[:3]) == ["a", "buoy", "a"]
    assert_array_equal(np.isnan(table.beacon_latitude), table.transmitter == "a")

    def ours(t: float) -> np.ndarray:
        return trajectory.at(t).point((0.5, 0.1, -0.3)).position_e[0]

    def theirs(t: float) -> np.ndarray:
        return DRIFTING.transducer_e(np.array([t]))[0]

    for row in np.flatnonzero(table.transmitter == "buoy"):
        sent = float(table.transmit[row])
        event = sent
        if path == "two_way":
            event = 0.2 + brentq(lambda t, s=sent: t - s - np.linalg.norm(theirs(t) - ours(s)) / C, sent, sent + 2.0, xtol=1e-14)
        heard = brentq(lambda t, s=event: t - s - np.linalg.norm(ours(t) - theirs(s)) / C, event, event + 2.0, xtol=1e-14)
        assert table.time[row] == pytest.approx(heard, abs=3e-12)
        told = pymap3d.geodetic2ecef(table.beacon_latitude[row], table.beacon_longitude[row], 17.0 - table.beacon_depth[row], deg=False)
        assert_allclose(np.array(told), theirs(event), atol=1e-8)


def test_a_buoy_that_broadcasts_where_it_is() -> None:
    """Each 30 s, one way: its clock is ahead by 1 ms + 1e-6 t, its place off by 2 m each way."""
    trajectory = still(HERE, 30000.0)
    buoy = AcousticRange(rate=1 / 30, path="one_way", platforms={"buoy": replace(DRIFTING, motion=Steady(0.02, -0.01))})
    clean = quiet(buoy, trajectory)
    table = quiet(replace(buoy, clock_offset=1e-3, clock_drift=1e-6, beacon_sigma=2.0, sigma=1e-4), trajectory)
    ahead = 1e-3 + 1e-6 * clean.transmit
    assert_allclose(table.transmit - clean.transmit, ahead, atol=1e-11)
    assert_allclose(table.time - table.transmit, table.travel_time, atol=1e-11)
    spread(table.travel_time + ahead - clean.travel_time, 1e-4)
    assert_array_equal(table.beacon_sigma, 2.0)
    where = [
        np.stack(
            pymap3d.geodetic2ned(
                t.beacon_latitude,
                t.beacon_longitude,
                -t.beacon_depth,
                clean.beacon_latitude,
                clean.beacon_longitude,
                -clean.beacon_depth,
                deg=False,
            ),
            1,
        )
        for t in (table, clean)
    ]
    spread(where[0] - where[1], 2.0)
    assert "buoy" not in simulate(trajectory, {"it": buoy}, duration=60.0).beacons


def test_differences_are_later_minus_reference() -> None:
    """Sound from dead ahead: the bow hears it first; the log of one ping is a row for each hydrophone but the reference."""
    trajectory = still(HERE, 2000.0, heading=0.7)
    phones = {"bow": (1.0, 0.0, 0.0), "stern": (-1.0, 0.0, 0.0), "port": (0.0, -0.5, 0.0)}
    ahead = beacon(400.0 * cos(0.7), 400.0 * sin(0.7), 30.0)
    acoustic = AcousticRange(rate=1.0, beacons={"a": ahead}, path="difference", receivers=phones, reference="stern")
    table = quiet(acoustic, trajectory)
    assert list(table.receiver[:3]) == ["bow", "port", "bow"]
    assert set(table.reference) == {"stern"}
    assert table.transmit is None
    assert_allclose(table.travel_time[:2], [-2.0 / C, (hypot(400.0, 0.5) - 401.0) / C], atol=1e-11)
    noisy = quiet(replace(acoustic, sigma=1e-5), trajectory)
    error = (noisy.travel_time - table.travel_time).reshape(-1, 2)
    spread(error[:, 0], 1e-5 * sqrt(2))
    spread(error[:, 0] - error[:, 1], 1e-5 * sqrt(2))  # the reference's error is one for all
    assert np.mean(error[:, 0] * error[:, 1]) == pytest.approx(1e-10, rel=0.15)
    for wrong in ({"reference": "keel"}, {"receivers": {"stern": (0.0, 0.0, 0.0)}}):
        with pytest.raises(InputError, match="difference"):
            quiet(replace(acoustic, **wrong), trajectory)


# Bent rays

GRADIENT = SoundProfile([0.0, 1000.0], [1500.0, 1517.0])


def test_bent_rays_have_the_time_of_their_circle() -> None:
    acoustic = AcousticRange(rate=1.0, path="one_way", beacons={"a": beacon(1500.0, 0.0, 400.0)}, profile=GRADIENT)
    time = quiet(acoustic, still(HERE, 2.0)).travel_time
    depth = acoustic.beacons["a"].depth
    chord = hypot(1500.0, 370.0)
    expected = 2 / 0.017 * asinh(0.5 * 0.017 * chord / sqrt((1500 + 0.017 * 30) * (1500 + 0.017 * depth)))
    assert_allclose(time, expected, rtol=1e-12)
    assert abs(time[0] - chord / 1500.0) > 1e-4
    straight_times = quiet(replace(acoustic, profile=None), still(HERE, 2.0)).travel_time
    assert_allclose(
        quiet(replace(acoustic, profile=SoundProfile.uniform(1500.0)), still(HERE, 2.0)).travel_time, straight_times, rtol=1e-14
    )


def test_no_row_comes_from_the_shadow() -> None:
    """Below a warm layer sound bends down and is lost: at 100 m the beacon is heard, at 3 km it lies in the shadow."""
    falling = SoundProfile([0.0, 200.0], [1520.0, 1490.0])
    near, far = beacon(100.0, 0.0, 40.0), beacon(3000.0, 0.0, 40.0)
    for path in ("one_way", "two_way"):
        table = quiet(AcousticRange(rate=1.0, path=path, beacons={"far": far, "near": near}, profile=falling), still(HERE, 20.0))
        assert set(table.transmitter) == {"near"}
        assert_allclose(table.transmit, np.arange(1.0, 20.0, 2.0))
    assert len(quiet(Usbl(rate=1.0, beacons={"far": far}, profile=falling), still(HERE, 5.0))) == 0


# The tide, and the end

HIGH = Water(levels=(Level(2.0, 1e9),))  # two metres up, all dive long


def test_what_floats_rises_with_the_tide_and_depths_count_from_the_surface_of_the_moment() -> None:
    """A vehicle 32 m below a surface that stands 2 m high; a ship that knows no tide of its own lies on the same surface."""
    trajectory = still(replace(HERE, water=HIGH), 50.0)
    assert_allclose(trajectory.truth([0.0]).depth, 32.0, atol=1e-9)
    ship = Moving(motion=Steady(heading=0.3), place=SURFACE, lever_arm_b=(3.0, 1.0, 5.0))
    fix = UsblFix(rate=1.0, ship=ship, lever_arm_b=(3.0, 1.0, 5.0))
    assert_allclose(quiet(fix, trajectory).depth, 32.0, atol=1e-6)
    angles = quiet(Usbl(rate=1.0, ship=ship, lever_arm_b=(0.0, 0.0, 5.0)), trajectory)
    assert_allclose(angles.travel_time, 2 * 27.0 / C, atol=1e-9)  # 32 m less 5 m: the surface lifts both ends or neither
    pose = PlatformPose(rate=1.0, platforms={"ship": ship})
    assert_allclose(quiet(pose, trajectory).depth, 0.0, atol=1e-6)
    buoy = AcousticRange(rate=1.0, path="one_way", platforms={"buoy": ship}, beacons={"a": beacon(0.0, 0.0, 80.0)})
    table = quiet(buoy, trajectory)
    told = table.transmitter == "buoy"
    assert_allclose(table.beacon_depth[told], 5.0, atol=1e-5)  # the arm's plumb line leans by 3 m / 6.4e6 m
    assert_allclose(table.travel_time[~told], 50.0 / C, atol=1e-9)  # what stands on the ground stays
    spread(quiet(replace(fix, sigma_position=(0.5, 0.5, 0.5)), still(replace(HERE, water=HIGH), 2000.0)).depth - 32.0, 0.5)


def test_an_echo_that_is_not_back_before_the_end_has_no_row() -> None:
    """A motion of 60 s is known for 10 s more: what is heard within 70 s is a row, the same as of a longer dive."""
    short, long = (straight(HERE, duration, speed=1.5) for duration in (60.0, 200.0))
    slow = AcousticRange(rate=1.0, beacons={"a": beacon(100.0, 50.0, 60.0, turnaround=15.0)}, path="two_way")
    table, whole = quiet(slow, short, 60.0), quiet(slow, long, 60.0)
    there = whole.time <= 70.0
    assert 50 < there.sum() < 60
    assert_array_equal(table.travel_time, whole.travel_time[there])
    far = {"far": beacon(20000.0, 0.0, 60.0)}
    for instrument in (slow, replace(slow, beacons=far), Usbl(rate=1.0, beacons=far), replace(slow, beacons=far, path="one_way")):
        found, known = quiet(instrument, short, 60.0), quiet(instrument, long, 60.0)
        assert_array_equal(found.time, known.time[known.time <= 70.0])
    phones = {"bow": (1.0, 0.0, 0.0), "stern": (-1.0, 0.0, 0.0)}
    pair = AcousticRange(rate=1.0, beacons=far, path="difference", receivers=phones, reference="stern")
    assert np.max(quiet(pair, short, 60.0).time) < 70.0
    other = Moving(motion=straight(HERE, 30.0, speed=1.0))  # a partner that is known for 40 s
    assert np.max(quiet(AcousticRange(rate=1.0, path="one_way", platforms={"other": other}), short, 60.0).transmit) == 40.0
    ship = Moving(motion=Steady(), place=SURFACE, lever_arm_b=(0.0, 0.0, 2.0))
    assert np.max(quiet(UsblFix(rate=1.0, ship=ship, turnaround=15.0), short, 60.0).time) < 70.0


def test_turns_go_on_from_piece_to_piece() -> None:
    trajectory = still(HERE, 20.0)
    three = AcousticRange(rate=1.0, beacons={name: beacon(50.0, 0.0, 60.0) for name in "abc"})
    whole = quiet(three, trajectory)
    time = np.arange(21.0)
    pieces = [three.going_on(time[:k]).ideal(trajectory, time[k : k + 4]).transmitter for k in range(0, 21, 4)]
    assert_array_equal(np.concatenate(pieces), whole.transmitter)


# What goes wrong

NEAR = AcousticRange(rate=1.0, beacons={"a": beacon(300.0, 0.0, 30.0, turnaround=0.1)}, path="two_way")


def test_turnaround_noise_quantum_and_level_of_signals() -> None:
    trajectory = still(HERE, 3000.0)
    clean = quiet(NEAR, trajectory)
    spread(quiet(replace(NEAR, sigma_turnaround=2e-3), trajectory).travel_time - clean.travel_time, 2e-3)
    rough = quiet(replace(NEAR, quantum=1e-3, sigma=1e-2), trajectory)
    assert_allclose(rough.travel_time / 1e-3, np.round(rough.travel_time / 1e-3), atol=1e-9)
    assert_allclose(rough.time - rough.transmit, rough.travel_time, atol=1e-11)
    assert kstest((rough.travel_time - clean.travel_time) / sqrt(1e-4 + 1e-6 / 12), "norm").pvalue > 1e-3
    assert_allclose(quiet(replace(NEAR, snr=20.0), trajectory).snr, 20.0 - 20.0 * np.log10(0.3), atol=1e-6)


def test_losses_grow_with_distance() -> None:
    trajectory = still(HERE, 4000.0)
    share(np.arange(4001) < len(quiet(replace(NEAR, dropout=0.3), trajectory)), 0.7)
    share(np.arange(4001) < len(quiet(replace(NEAR, range_50=300.0), trajectory)), 0.5)
    share(np.arange(4001) < len(quiet(replace(NEAR, range_50=250.0, range_width=50.0, dropout=0.2), trajectory)), 0.8 / (1 + np.e))
    assert len(quiet(replace(NEAR, range_max=299.0), trajectory, 10.0)) == 0
    assert len(quiet(replace(NEAR, range_max=301.0), trajectory, 10.0)) == 11


def test_echoes_are_late_and_ranked() -> None:
    trajectory = still(HERE, 4000.0)
    clean = quiet(NEAR, trajectory).travel_time
    late = quiet(replace(NEAR, echo_fraction=0.25, echo_delay=0.03), trajectory)
    assert late.peak is None
    delay = late.travel_time - clean
    share(delay > 1e-9, 0.25)
    assert kstest(delay[delay > 1e-9], "expon", args=(0.0, 0.03)).pvalue > 1e-3
    table = quiet(replace(NEAR, echo_fraction=0.25, echo_delay=0.03, peaks=3, snr=10.0), trajectory)
    assert_array_equal(table.peak.reshape(-1, 3), np.tile([1.0, 2.0, 3.0], (4001, 1)))
    delays = table.travel_time.reshape(-1, 3) - clean[:, None]
    share(delays[:, 0] > 1e-9, 0.25)
    assert np.all(np.diff(delays, axis=1) > 0)
    for gap in np.diff(delays, axis=1).T:
        assert kstest(gap, "expon", args=(0.0, 0.03)).pvalue > 1e-3
    assert_allclose(np.diff(table.snr.reshape(-1, 3)), -6.0, atol=1e-12)
    lossy = quiet(replace(NEAR, peaks=2, dropout=0.5), trajectory)
    assert_array_equal(lossy.transmit[::2], lossy.transmit[1::2])  # a ping is lost whole


def test_what_cannot_be_is_refused() -> None:
    trajectory = still(HERE, 5.0)
    with pytest.raises(InputError, match="AcousticRange: begins at -1 s"):
        replace(NEAR, offset=-1.0)
    with pytest.raises(InputError, match="times 0, 0, 100 s with turns of 20 s"):
        Waypoints(tuple(np.array([0.0, 0.0, 100.0])), (0.0, 0.0, 1.0), (0.0, 0.0, 1.0))
    for wrong, message in (
        (replace(NEAR, path="three_way"), "path"),
        (replace(NEAR, peaks=0), "peaks"),
        (replace(NEAR, platforms={"a": DRIFTING}), "a platform"),
        (Usbl(rate=1.0), "beacons"),
        (Usbl(rate=1.0, beacons=NEAR.beacons, ship=SHIP), "one of the two"),
        (Usbl(rate=1.0, beacons=NEAR.beacons, frame="north"), "frame"),
        (Usbl(rate=1.0, beacons=NEAR.beacons, path="difference"), "path"),
        (UsblFix(rate=1.0, beacons=NEAR.beacons), "ship"),
        (ShortBaseline(transducers=NEAR.beacons), "three"),
        (ShortBaseline(interval_min=0.0), "interval"),
    ):
        with pytest.raises(InputError, match=message):
            quiet(wrong, trajectory)


# Directions


@pytest.mark.parametrize(
    ("place", "azimuth", "elevation"),
    [((100.0, 0.0, 0.0), 0.0, 0.0), ((0.0, 100.0, 0.0), pi / 2, 0.0), ((0.0, -100.0, 0.0), -pi / 2, 0.0), ((0.0, 0.0, 100.0), None, pi / 2),
     ((100.0, 100.0, 0.0), pi / 4, 0.0), ((100.0, 0.0, -20.0), 0.0, -atan2(20, 100))],
)  # fmt: skip
def test_directions_by_hand(place: tuple[float, float, float], azimuth: float | None, elevation: float) -> None:
    """Of a vehicle that looks north and lies level."""
    table = quiet(Usbl(rate=1.0, beacons={"a": beacon(place[0], place[1], place[2] + 30.0)}), still(HERE, 2.0))
    assert_allclose(table.elevation, elevation, atol=1e-6)  # acos near 1: 1e-12 m of rounding in 100 m at the zenith is 1e-8
    if azimuth is not None:
        assert_allclose(table.azimuth, azimuth, atol=1e-9)
    assert_allclose(table.travel_time, 2 * np.linalg.norm(place) / C, rtol=1e-9)


def test_directions_in_turned_axes() -> None:
    """Heading east, a beacon in the north is to port; rolled to starboard, what is to starboard looks higher: elevation towards z less."""
    north, below = {"a": beacon(100.0, 0.0, 30.0)}, {"a": beacon(0.0, 0.0, 130.0)}
    east = still(HERE, 2.0, heading=pi / 2)
    assert_allclose(quiet(Usbl(rate=1.0, beacons=north), east).azimuth, -pi / 2, atol=1e-9)
    rolled = still(HERE, 2.0, heading=-pi / 2, roll=0.3)  # heads west: north is to starboard
    table = quiet(Usbl(rate=1.0, beacons=north), rolled)
    assert_allclose(table.azimuth, pi / 2, atol=1e-9)
    assert_allclose(table.elevation, -0.3, atol=1e-9)
    level = quiet(Usbl(rate=1.0, beacons=north, frame="level"), rolled)
    assert_allclose([level.azimuth[0], level.elevation[0]], [pi / 2, 0.0], atol=1e-9)
    assert set(level.frame) == {"level"}
    up = still(HERE, 2.0, pitch=0.2)  # nose up: what is below is before the belly, towards x
    assert_allclose([quiet(Usbl(rate=1.0, beacons=below), up).azimuth[0]], [pi], atol=1e-6)
    assert_allclose(quiet(Usbl(rate=1.0, beacons=below), up).elevation, pi / 2 - 0.2, atol=1e-8)
    # a head that is mounted looking to starboard has the north, dead ahead, to its left
    turned = quiet(Usbl(rate=1.0, beacons=north, mounting_bs=(0.0, 0.0, pi / 2)), still(HERE, 2.0))
    assert_allclose(turned.azimuth, -pi / 2, atol=1e-9)
    # a lever arm: 10 m ahead of a beacon that is 10 m ahead and 5 m below
    ahead = quiet(Usbl(rate=1.0, beacons={"a": beacon(10.0, 0.0, 35.0)}, lever_arm_b=(10.0, 0.0, 0.0)), still(HERE, 2.0))
    assert_allclose(ahead.elevation, pi / 2, atol=1e-6)
    assert_allclose(ahead.travel_time, 10.0 / C, atol=1e-11)


@pytest.mark.parametrize("frame", ["sensor", "level"])
def test_a_moving_ship_looks_at_a_moving_vehicle(frame: str) -> None:
    """Where the transponder was when it replied, seen from where the head is when it hears."""
    trajectory = circle(HERE, 100.0, speed=2.0, radius=40.0, weave=ROUGH)
    usbl = Usbl(rate=0.2, ship=SHIP, receiver="ship", transponder="snapir", transponder_b=(0.3, 0.0, -0.2), turnaround=0.15, frame=frame,
                lever_arm_b=(3.0, 1.0, 5.0), mounting_bs=(0.02, -0.03, 0.8))  # fmt: skip
    table = quiet(usbl, trajectory)
    assert set(table.receiver) == {"ship"}
    assert set(table.transmitter) == {"snapir"}
    assert_array_equal(table.turnaround, 0.15)

    def head(t: float) -> np.ndarray:
        return SHIP.transducer_e(np.array([t]))[0]  # which is at the same arm

    def other(t: float) -> np.ndarray:
        return trajectory.at(t).point((0.3, 0.0, -0.2)).position_e[0]

    mounting = Rotation.from_euler("ZYX", [0.8, -0.03, 0.02])
    for row, sent in enumerate(table.transmit):
        heard = brentq(lambda t, s=sent: t - s - np.linalg.norm(other(t) - head(s)) / C, sent, sent + 2.0, xtol=1e-14)
        replied = heard + 0.15
        arrival = brentq(lambda t, s=replied: t - s - np.linalg.norm(head(t) - other(s)) / C, replied, replied + 2.0, xtol=1e-14)
        assert table.time[row] == pytest.approx(arrival, abs=3e-12)
        latitude, longitude, height = pymap3d.ecef2geodetic(*head(arrival), deg=False)
        gap_n = np.array(pymap3d.ecef2ned(*other(replied), latitude, longitude, height, deg=False)).ravel()
        attitude = Rotation.from_matrix(SHIP.rotation_nb(np.array([arrival]))[0])
        axes = attitude * mounting if frame == "sensor" else Rotation.from_euler("Z", attitude.as_euler("ZYX")[0])
        x, y, z = axes.inv().apply(gap_n)
        assert table.azimuth[row] == pytest.approx(atan2(y, x), abs=1e-6)  # axes at the ship's reference, 6 m off: 1e-6 rad
        assert table.elevation[row] == pytest.approx(atan2(z, hypot(x, y)), abs=1e-6)


def test_an_inverted_usbl_on_a_moving_platform_says_where_that_was() -> None:
    table = quiet(Usbl(rate=0.5, platforms={"buoy": DRIFTING}, path="one_way"), still(HERE, 20.0))
    told = np.array(pymap3d.geodetic2ecef(table.beacon_latitude, table.beacon_longitude, 17.0 - table.beacon_depth, deg=False)).T
    assert_allclose(told, DRIFTING.transducer_e(table.transmit), atol=1e-8)
    assert table.turnaround is None


def test_the_direction_is_that_of_the_ray_that_arrives() -> None:
    """In one gradient, by the circle: the ray is steeper at the slow end and flatter at the fast one by half the arc."""
    steep = SoundProfile([0.0, 500.0], [1500.0, 1450.0])
    table = quiet(Usbl(rate=1.0, beacons={"a": beacon(300.0, 0.0, 200.0)}, profile=steep), still(HERE, 2.0))
    # circle through both ends whose centre lies where the speed would be 0: 15000 m down
    chord, middle = np.array([300.0, 170.0]), np.array([150.0, 115.0])
    along = (15000.0 - middle[1]) / chord[0]  # middle + along * (-chord_z, chord_x) has depth 15000
    centre = middle + along * np.array([-chord[1], chord[0]])
    radius = np.array([0.0, 30.0]) - centre
    expected = atan2(-radius[0], radius[1])
    expected = expected if abs(expected) < pi / 2 else expected - np.sign(expected) * pi
    assert_allclose(table.elevation, abs(expected), atol=1e-5)  # level layers against a curved Earth: 300 m of 6.4e6 m
    assert abs(table.elevation[0] - atan2(170.0, 300.0)) > 3e-3


def test_noise_of_directions_is_across_the_ray_wherever_it_comes_from() -> None:
    for place in ((200.0, 0.0, 30.0), (3.0, 0.0, 130.0), (50.0, 50.0, 80.0)):
        clean_usbl = Usbl(rate=1.0, beacons={"a": beacon(*place)})
        trajectory = still(HERE, 3000.0)
        noisy = quiet(replace(clean_usbl, sigma_angle=0.01, sigma=1e-3), trajectory)
        clean = quiet(clean_usbl, trajectory)
        unit = [
            np.stack([np.cos(t.elevation) * np.cos(t.azimuth), np.cos(t.elevation) * np.sin(t.azimuth), np.sin(t.elevation)], 1)
            for t in (noisy, clean)
        ]
        turn = np.cross(unit[1], unit[0])
        length = np.linalg.norm(turn, axis=1, keepdims=True)
        basis = np.linalg.svd(unit[1][:1])[2][1:]  # two axes across
        spread((turn * np.arcsin(length) / length) @ basis.T, 0.01)
        spread(noisy.travel_time - clean.travel_time, 1e-3)
    ranged = quiet(replace(clean_usbl, output="range", sigma=0.7), trajectory)
    spread(ranged.range - 0.5 * C * clean.travel_time, 0.7)
    share(np.arange(3001) < len(quiet(replace(clean_usbl, dropout=0.4), trajectory)), 0.6)


# Positions


def test_fixes_of_a_ship_are_true_without_errors_and_come_late() -> None:
    trajectory = circle(HERE, 200.0, speed=2.0, radius=40.0, weave=ROUGH)
    fix = UsblFix(rate=0.2, ship=SHIP, turnaround=0.1, transponder_b=(0.3, 0.0, -0.2), lever_arm_b=(3.0, 1.0, 5.0), latency=2.5)
    table = quiet(fix, trajectory)
    assert len(table) == 41
    position_e = np.array(pymap3d.geodetic2ecef(table.latitude, table.longitude, 17.0 - table.depth, deg=False)).T
    assert_allclose(position_e, trajectory.at(table.time).point((0.3, 0.0, -0.2)).position_e, atol=1e-6)
    assert_allclose(table.received - table.time, 2.5)
    assert table.sigma_axes is None
    assert np.all(table.time > np.arange(41) * 5.0 + 0.1)


def test_errors_of_fixes_are_those_they_state() -> None:
    """Standardised by their own sigmas they have unit variance; distance makes errors of direction grow."""
    trajectory = still(replace(HERE, depth=150.0), 2000.0)
    ship = Moving(motion=Steady(heading=0.8), place=replace(SURFACE, longitude=SURFACE.longitude + 4e-5), waves=SEA)
    fix = UsblFix(rate=1.0, ship=ship, sigma_angle=0.005, sigma=1e-4, sigma_position=(0.3, 0.4, 0.6), sigma_attitude=(0.002, 0.003, 0.008))
    table, clean = (
        quiet(fix, trajectory),
        quiet(replace(fix, sigma_angle=0.0, sigma=0.0, sigma_position=(0.0,) * 3, sigma_attitude=(0.0,) * 3), trajectory),
    )
    error = ned(table) - ned(clean)
    for axis in range(3):
        spread(error[:, axis] / table.sigma_axes[:, axis], 1.0)
    product = error[:, 0] * error[:, 1] - table.cov_north_east
    assert abs(np.mean(product)) < 4 * np.std(product) / sqrt(len(product))
    assert np.mean(table.sigma_axes[:, 0]) > 150 * 0.005  # of the angle alone
    draws = [quiet(UsblFix(rate=1.0, ship=ship, sigma_scale=0.01), trajectory, 0.0, seed=k) for k in range(200)]
    down = np.array([ned(t)[0, 2] - ned(clean)[0, 2] for t in draws])
    spread(down, 0.01 * (clean.depth[0] - 0.8 * sin(2.0)))


SQUARE = {
    k: Beacon(north=n, east=e, depth=d)
    for k, (n, e, d) in enumerate([(20.0, 0.0, 2.0), (0.0, 20.0, 2.0), (-20.0, 0.0, 3.0), (0.0, -20.0, 2.0)])
}
TRANSDUCERS = {f"t{k}": b for k, b in SQUARE.items()}


def test_a_short_baseline_draws_its_intervals_anew() -> None:
    sbl, trajectory = ShortBaseline(transducers=TRANSDUCERS, offset=1.0), straight(HERE, 2000.0, speed=1.0)
    first, second = (quiet(sbl, trajectory, seed=k) for k in (1, 2))
    gaps = np.diff(first.time)
    assert first.time[0] == 1.0
    assert first.time[-1] > 1998.0
    assert kstest(gaps, "uniform", args=(0.1, 1.9)).pvalue > 1e-3
    assert first.time[5] != second.time[5]
    truth = Recorder(trajectory, {}).trajectory.at(first.time)
    north, east, _ = pymap3d.geodetic2ned(*truth.geodetic, HERE.latitude, HERE.longitude, -13.0, deg=False)
    assert_allclose(
        np.stack([first.north, first.east], 1), np.stack([north, east], 1), atol=0.3
    )  # curvilinear against tangent plane: s^2 / R
    assert_allclose(first.depth, truth.depth, atol=1e-9)


def test_fixes_of_a_short_baseline_have_the_errors_of_their_geometry() -> None:
    sbl, trajectory = ShortBaseline(transducers=TRANSDUCERS, sigma=2e-5), still(HERE, 2000.0)
    table, clean = quiet(sbl, trajectory), quiet(replace(sbl, sigma=0.0), trajectory)
    for axis, name in enumerate(("north", "east", "depth")):
        spread((getattr(table, name) - getattr(clean, name)) / table.sigma_axes[:, axis], 1.0)
    # by hand, all four 34.4 m away nearly: H^T H north = 2 (20 / 34.4)^2
    assert table.sigma_axes[0, 0] == pytest.approx(0.03 / sqrt(2 * 400 / (400 + 28**2)), rel=0.03)
    assert len(quiet(sbl, still(replace(HERE, depth=2.0), 2.0), seed=1)) > 0
    flat = replace(sbl, transducers={k: replace(b, depth=2.0) for k, b in TRANSDUCERS.items()})
    assert len(quiet(flat, still(replace(HERE, depth=2.0), 20.0))) == 0  # all in one plane


def test_ranges_of_a_short_baseline_are_one_row_for_each_transducer() -> None:
    table = quiet(ShortBaseline(transducers=TRANSDUCERS, output="range"), still(HERE, 20.0))
    assert list(table.transmitter[:5]) == ["t0", "t1", "t2", "t3", "t0"]
    assert_allclose(table.transmit[::4], table.transmit[3::4])
    distance = [sqrt(400 + 28**2), sqrt(400 + 28**2), sqrt(400 + 27**2), sqrt(400 + 28**2)]
    assert_allclose(table.travel_time[:4] * C, distance, atol=1e-3)
