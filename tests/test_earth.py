"""The compiled Earth: pyproj and pymap3d, published gravity, and `move` with its inverse at ordinary places, poles and the date line."""

from __future__ import annotations

from math import cos, degrees, pi, radians, sin

import numpy as np
import pymap3d
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from pyproj import Geod, Transformer

from leadline.core import attitude, geodesy
from leadline.core.earth import WATER_GRADIENT, curvature, earth_fixed, gravity, level_angle, level_rotation, move, offset, third_row

GEOD = Geod(ellps="WGS84")
TO_ECEF = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
latitudes = st.one_of(
    st.floats(-pi / 2, pi / 2), st.floats(0.0, 1.5e-6).map(lambda d: pi / 2 - d), st.floats(0.0, 1.5e-6).map(lambda d: d - pi / 2)
)  # the last two: within 10 m of a pole
longitudes = st.one_of(st.floats(-pi, pi), st.floats(pi - 1e-7, pi), st.floats(-pi, -pi + 1e-7))
wanders = st.floats(-pi, pi)
metres = st.floats(-100.0, 100.0)


def place(latitude: float, longitude: float, height: float, wander: float = 0.0) -> np.ndarray:
    """The place (5,), its first axis turned clockwise from north by `wander`."""
    north = attitude.quaternion_from_matrix(geodesy.rotation_en(latitude, longitude))
    return np.append(attitude.product(north, attitude.quaternion_from_euler(0.0, 0.0, wander)), height)


def axis_of(x: np.ndarray) -> tuple[float, float, float]:
    return third_row(x[0], x[1], x[2], x[3])


@given(latitude=latitudes, longitude=longitudes, height=st.floats(-11_000.0, 1000.0), wander=wanders)
def test_earth_fixed_position(latitude: float, longitude: float, height: float, wander: float) -> None:
    """As PROJ has it, to 5 nm, whatever the azimuth of the navigation frame."""
    expected = TO_ECEF.transform(degrees(longitude), degrees(latitude), height)
    assert_allclose(earth_fixed(place(latitude, longitude, height, wander), 0), expected, atol=5e-9)


@given(latitude=st.floats(-1.55, 1.55), longitude=longitudes, wander=wanders)
def test_curvature(latitude: float, longitude: float, wander: float) -> None:
    """Along north 1 / (M + h), along east 1 / (N + h), with pymap3d's radii; no other component."""
    height, x = -3000.0, place(latitude, longitude, -3000.0, wander)
    axis = axis_of(x)
    meridian, prime = (float(pymap3d.rcurve.__dict__[name](latitude, deg=False)) for name in ("meridian", "transverse"))
    for angle, radius in ((0.0, meridian), (pi / 2, prime)):
        level = np.array([cos(angle - wander), sin(angle - wander)])  # of the frame's axes
        turned = level_rotation(axis, curvature(axis, height), *level)
        across = turned[1] * level[0] - turned[0] * level[1]
        assert_allclose(across, -1.0 / (radius + height), rtol=1e-12)
        assert_allclose(turned[0] * level[0] + turned[1] * level[1], 0.0, atol=1e-20)


@pytest.mark.parametrize(
    ("latitude", "expected", "tolerance"),
    [(0.0, 9.7803253359, 1e-10), (45.0, 9.806199203 - 1.4356e-6, 5e-9), (90.0, 9.8321849379, 2e-10)],
    ids=["equator", "45 degrees", "pole"],
)
def test_normal_gravity_as_published(latitude: float, expected: float, tolerance: float) -> None:
    """Equator and pole of WGS 84 (NGA.STND.0036, 2014); at 45 degrees GRS 80 (Moritz, 1980) less what the two differ by."""
    assert abs(gravity((0.0, 0.0, -sin(radians(latitude))), 0.0, 0.0) - expected) < tolerance


def test_gravity_with_height_and_depth() -> None:
    """Free air -3.086e-6 per metre up; below the sea surface the water above pulls back: +2.22e-6 per metre down, as in a sea."""
    axis = (0.0, 0.0, -sin(radians(45.0)))
    up = (gravity(axis, 100.0, 0.0) - gravity(axis, 0.0, 0.0)) / 100.0
    down = (gravity(axis, -1000.0, 0.0) - gravity(axis, 0.0, 0.0)) / 1000.0
    assert_allclose(up, -3.086e-6, atol=2e-9)
    assert_allclose(down, 2.224e-6, atol=3e-9)
    assert_allclose(WATER_GRADIENT, 2 * 4.31e-7, rtol=2e-3)  # 0.0431 mGal/m per g/cm3 twice (Bouguer): Telford, 1990
    assert gravity(axis, -100.0, -200.0) == gravity(axis, -100.0, -100.0)  # no water above


@given(latitude=latitudes, longitude=longitudes, wander=wanders, north=metres, east=metres, down=metres)
def test_offset_undoes_move(latitude: float, longitude: float, wander: float, north: float, east: float, down: float) -> None:
    """To 5 nm (the rounding of a place) anywhere: within 10 m of a pole, over it, and across the date line."""
    origin = place(latitude, longitude, -20.0, wander)
    x = origin.copy()
    move(x, 0, north, east, down)
    assert_allclose(offset(x, 0, origin, 0), (north, east, down), atol=5e-9)
    assert_allclose(np.linalg.norm(x[:4]), 1.0, atol=4e-16)


@settings(max_examples=50)
@given(latitude=latitudes, longitude=longitudes, wander=wanders, north=metres, east=metres)
def test_a_move_is_as_long_as_it_says(latitude: float, longitude: float, wander: float, north: float, east: float) -> None:
    """Its Earth-fixed chord has the length and the direction of the step, to second order: 1 mm over 100 m."""
    origin = place(latitude, longitude, 0.0, wander)
    x = origin.copy()
    move(x, 0, north, east, 0.0)
    chord = np.array(earth_fixed(x, 0)) - earth_fixed(origin, 0)
    along = attitude.matrix_from_quaternion(origin[:4]).T @ chord
    assert_allclose(along, (north, east, (north**2 + east**2) / 2 / 6.378e6), atol=2e-5)


@given(latitude=st.floats(-1.5, 1.5), longitude=longitudes, azimuth=st.floats(-pi, pi), wander=wanders)
@settings(max_examples=50)
def test_a_move_follows_the_geodesic(latitude: float, longitude: float, azimuth: float, wander: float) -> None:
    """10 km in 1000 steps straight ahead in the navigation frame end where PROJ's geodesic ends, to 2 cm (its azimuth is parallel too)."""
    x = place(latitude, longitude, 0.0, wander)
    for _ in range(1000):
        move(x, 0, 10.0 * cos(azimuth - wander), 10.0 * sin(azimuth - wander), 0.0)
    lon, lat, _ = GEOD.fwd(degrees(longitude), degrees(latitude), degrees(azimuth), 10_000.0)
    assert_allclose(earth_fixed(x, 0), TO_ECEF.transform(lon, lat, 0.0), atol=0.02)


@given(latitude=latitudes, longitude=longitudes, wander=wanders, heading=st.floats(-pi, pi))
def test_level_angle(latitude: float, longitude: float, wander: float, heading: float) -> None:
    """The angle from true north of a direction equals that by core/geodesy's north and east, where north is known (1 m from a pole)."""
    if pi / 2 - abs(latitude) < 1.6e-7:
        return
    x = place(latitude, longitude, 0.0, wander)
    direction = attitude.matrix_from_quaternion(x[:4]) @ np.array([cos(heading - wander), sin(heading - wander), 0.0])
    north, east, _ = geodesy.rotation_en(latitude, longitude).T @ direction
    angle = level_angle(axis_of(x), cos(heading - wander), sin(heading - wander))
    assert abs(attitude.wrapped(angle - np.arctan2(east, north))) < 1e-15 + 2e-15 / cos(latitude)
    assert abs(attitude.wrapped(angle - heading)) < 1e-15 + 2e-15 / cos(latitude)


def test_over_the_pole() -> None:
    """Straight ahead over the pole the navigation frame does not turn, while the longitude jumps by 180 degrees."""
    x = place(pi / 2 - 1e-6, 0.3, 0.0)
    before = attitude.matrix_from_quaternion(x[:4])
    move(x, 0, 12.76, 0.0, 0.0)
    after = attitude.matrix_from_quaternion(x[:4])
    assert np.abs(after - before).max() < 3e-6
    assert_allclose(attitude.wrapped(np.arctan2(-after[1, 2], -after[0, 2]) - 0.3), -pi, atol=1e-6)
