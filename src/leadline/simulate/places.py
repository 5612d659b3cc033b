"""Places on the ellipsoid of many moments, compiled: a simulated hour asks for half a million."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import kernel
from leadline.core.geodesy import ECCENTRICITY_2, FLATTENING, SEMI_MAJOR_AXIS

if TYPE_CHECKING:
    from leadline.data.records import Array


@kernel()
def geodetic(ex, ey, ez):
    """Latitude, longitude (rad) and height (m) of an Earth-fixed position (Bowring, 1976, three times)."""
    reach, ratio = math.sqrt(ex * ex + ey * ey), 1 - FLATTENING
    p = math.atan2(ez, ratio * reach)
    latitude = p
    for _ in range(3):
        s, k = math.sin(p), math.cos(p)
        up, out = ECCENTRICITY_2 / ratio * SEMI_MAJOR_AXIS * s * s * s, ECCENTRICITY_2 * SEMI_MAJOR_AXIS * k * k * k
        latitude = math.atan2(ez + up, reach - out)
        p = math.atan2(ratio * math.sin(latitude), math.cos(latitude))
    s, k = math.sin(latitude), math.cos(latitude)
    height = reach * k + ez * s - SEMI_MAJOR_AXIS * math.sqrt(1 - ECCENTRICITY_2 * s * s)
    return latitude, math.atan2(ey, ex), height


@kernel()
def rows(position, found):
    """Write latitude, longitude and height (3, rows) of Earth-fixed positions (rows, 3)."""
    for i in range(len(position)):
        found[0, i], found[1, i], found[2, i] = geodetic(position[i, 0], position[i, 1], position[i, 2])


@kernel()
def turns(latitude, longitude, rotation_eb, found):
    """Write rotations (rows, 3, 3) from body to local north-east-down, from those to the Earth-fixed frame."""
    for i in range(len(latitude)):
        sl, cl, so, co = math.sin(latitude[i]), math.cos(latitude[i]), math.sin(longitude[i]), math.cos(longitude[i])
        for j in range(3):
            x, y, z = rotation_eb[i, 0, j], rotation_eb[i, 1, j], rotation_eb[i, 2, j]
            found[i, 0, j] = -sl * co * x - sl * so * y + cl * z
            found[i, 1, j] = -so * x + co * y
            found[i, 2, j] = -cl * co * x - cl * so * y - sl * z


def geodetic_of(position_e: Array) -> tuple[Array, Array, Array]:
    """Return latitude, longitude (rad) and height (m) of Earth-fixed positions (rows, 3)."""
    found = np.empty((3, len(position_e)))
    rows(np.ascontiguousarray(position_e), found)
    return found[0], found[1], found[2]


def local(latitude: Array, longitude: Array, rotation_eb: Array) -> Array:
    """Return rotations (rows, 3, 3) from body to north-east-down at places (rad)."""
    found = np.empty(rotation_eb.shape)
    turns(latitude, longitude, np.ascontiguousarray(rotation_eb), found)
    return found
