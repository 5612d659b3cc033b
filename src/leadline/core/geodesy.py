"""WGS 84 geodesy of many points at once (NumPy): geographic, Earth-fixed, and metres along meridian and parallel.

Latitude and longitude in rad, heights in m above the ellipsoid, Earth-fixed vectors (..., 3) in m.
Source of the constants: NGA.STND.0036 (2014), WGS 84.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from leadline.data.records import Array

SEMI_MAJOR_AXIS = 6378137.0
FLATTENING = 1 / 298.257223563
ECCENTRICITY_2 = FLATTENING * (2 - FLATTENING)
EARTH_RATE = 7.292115e-5


def ecef_from_geodetic(latitude: ArrayLike, longitude: ArrayLike, height: ArrayLike) -> Array:
    """Return Earth-fixed positions (..., 3) in m."""
    lat, lon, h = np.broadcast_arrays(*(np.asarray(a, float) for a in (latitude, longitude, height)))
    prime = SEMI_MAJOR_AXIS / np.sqrt(1 - ECCENTRICITY_2 * np.sin(lat) ** 2)
    level = (prime + h) * np.cos(lat)
    return np.stack([level * np.cos(lon), level * np.sin(lon), (prime * (1 - ECCENTRICITY_2) + h) * np.sin(lat)], axis=-1)


def geodetic_from_ecef(position_e: ArrayLike) -> tuple[Array, Array, Array]:
    """Return latitude, longitude (rad) and height (m) of Earth-fixed positions (..., 3), to 1e-9 m near the surface.

    Bowring's parametric latitude as the start (Bowring, 1976), refined by two more of his steps.
    """
    x, y, z = np.moveaxis(np.asarray(position_e, float), -1, 0)
    level = np.hypot(x, y)
    ratio = 1 - FLATTENING
    parametric = np.arctan2(z, ratio * level)
    for _ in range(3):
        up = z + ECCENTRICITY_2 / ratio * SEMI_MAJOR_AXIS * np.sin(parametric) ** 3
        out = level - ECCENTRICITY_2 * SEMI_MAJOR_AXIS * np.cos(parametric) ** 3
        latitude = np.arctan2(up, out)
        parametric = np.arctan2(ratio * np.sin(latitude), np.cos(latitude))
    sine, cosine = np.sin(latitude), np.cos(latitude)
    height = level * cosine + z * sine - SEMI_MAJOR_AXIS * np.sqrt(1 - ECCENTRICITY_2 * sine**2)
    return latitude, np.arctan2(y, x), height


def rotation_en(latitude: ArrayLike, longitude: ArrayLike) -> Array:
    """Return rotations (..., 3, 3) from local north-east-down to the Earth-fixed frame."""
    lat, lon = np.broadcast_arrays(np.asarray(latitude, float), np.asarray(longitude, float))
    sl, cl, so, co = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    zero = np.zeros_like(sl)
    rows = [[-sl * co, -so, -cl * co], [-sl * so, co, -cl * so], [cl, zero, -sl]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def meridian_arc(latitude: ArrayLike) -> Array:
    """Return the distance (m) along the meridian from the equator to `latitude`, to 1e-8 m.

    Series in the third flattening (Helmert, 1880), to its fourth order.
    """
    lat = np.asarray(latitude, float)
    n = FLATTENING / (2 - FLATTENING)
    factors = (
        1 + n**2 / 4 + n**4 / 64,
        -3 / 2 * (n - n**3 / 8),
        15 / 16 * (n**2 - n**4 / 4),
        -35 / 48 * n**3,
        315 / 512 * n**4,
    )
    total = factors[0] * lat + sum(f * np.sin(2 * (k + 1) * lat) for k, f in enumerate(factors[1:]))
    return np.asarray(SEMI_MAJOR_AXIS / (1 + n) * total)


def latitude_from_arc(arc: ArrayLike) -> Array:
    """Return the latitude (rad) at a distance (m) along the meridian from the equator: the inverse of `meridian_arc`, by Newton."""
    target = np.asarray(arc, float)
    latitude = target / (SEMI_MAJOR_AXIS * (1 - ECCENTRICITY_2 / 4))
    for _ in range(4):
        radius = SEMI_MAJOR_AXIS * (1 - ECCENTRICITY_2) / (1 - ECCENTRICITY_2 * np.sin(latitude) ** 2) ** 1.5
        latitude = latitude + (target - meridian_arc(latitude)) / radius
    return latitude


def parallel_radius(latitude: ArrayLike) -> Array:
    """Return the radius (m) of the parallel at `latitude`, on the ellipsoid."""
    lat = np.asarray(latitude, float)
    return np.asarray(SEMI_MAJOR_AXIS * np.cos(lat) / np.sqrt(1 - ECCENTRICITY_2 * np.sin(lat) ** 2))


def north_east(latitude: ArrayLike, longitude: ArrayLike, origin_latitude: float, origin_longitude: float) -> tuple[Array, Array]:
    """Return metres north along the origin's meridian, then east along the point's own parallel; the short way round."""
    lat = np.asarray(latitude, float)
    turn = (np.asarray(longitude, float) - origin_longitude + np.pi) % (2 * np.pi) - np.pi
    return meridian_arc(lat) - meridian_arc(origin_latitude), parallel_radius(lat) * turn


def from_north_east(north: ArrayLike, east: ArrayLike, origin_latitude: float, origin_longitude: float) -> tuple[Array, Array]:
    """Return latitude and longitude (rad): the inverse of `north_east`."""
    lat = latitude_from_arc(meridian_arc(origin_latitude) + np.asarray(north, float))
    lon = origin_longitude + np.asarray(east, float) / parallel_radius(lat)
    return lat, (lon + np.pi) % (2 * np.pi) - np.pi
