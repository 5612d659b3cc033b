"""The Earth as the filter sees it, compiled: curvature, rotation, gravity; WGS 84.

A place is a navigation frame and a height: quaternion_en (navigation frame -> Earth-fixed) and metres above the ellipsoid.
The navigation frame is level, its third axis down along the ellipsoid's normal; its azimuth wanders: it never turns about the
vertical.  Its orientation against north is read off the third row of rotation_en, whose elements are cos(latitude) cos(wander),
-cos(latitude) sin(wander), -sin(latitude); nothing here divides by cos(latitude), so poles and date line are ordinary places.
Curvature needs no latitude either: 1/R_meridian - 1/R_prime is proportional to cos(latitude)^2.
For many points at once in NumPy see core/geodesy.py.
"""

from __future__ import annotations

import math

from leadline.core.compiled import kernel
from leadline.core.geodesy import ECCENTRICITY_2, FLATTENING, SEMI_MAJOR_AXIS
from leadline.core.rotation import exponential, load4, load_matrix, logarithm, product, store_quaternion

GRAVITY_EQUATOR = 9.7803253359  # m/s^2, NGA.STND.0036 (2014)
SOMIGLIANA_K = 1.931852652458e-3
GRAVITY_M = 3.449786506841e-3  # w^2 a^2 b / GM
WATER_GRADIENT = 4 * math.pi * 6.6743e-11 * 1028.0  # s^-2: what a layer of sea water takes off the free-air gradient

PLACE = 5  # numbers that make a place: quaternion_en 4, height


@kernel()
def third_row(q0, q1, q2, q3):
    """Third row of rotation_en: the Earth's axis in the navigation frame."""
    return 2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), 1 - 2 * (q1 * q1 + q2 * q2)


@kernel()
def curvature(axis, height):
    """Curvature tensor k0 I + k1 c c^T (1/m) of the level surface, with c the level part of the Earth's axis: k0, k1."""
    w = 1.0 - ECCENTRICITY_2 * axis[2] * axis[2]
    root = math.sqrt(w)
    prime = SEMI_MAJOR_AXIS / root
    k0 = 1.0 / (prime + height)
    meridian = prime * (1.0 - ECCENTRICITY_2) / w
    return k0, k0 * prime * ECCENTRICITY_2 / (w * (meridian + height))


@kernel()
def level_rotation(axis, k, d0, d1):
    """How the navigation frame turns (rad, its own axes 1 and 2) when it moves level by (d0, d1) metres."""
    along = k[1] * (axis[0] * d0 + axis[1] * d1)
    return k[0] * d1 + along * axis[1], -(k[0] * d0 + along * axis[0])


@kernel()
def gravity(axis, height, surface):
    """Plumb gravity (m/s^2): Somigliana's formula, second order in height, and less gradient below the sea `surface` (a height)."""
    s2 = axis[2] * axis[2]
    normal = GRAVITY_EQUATOR * (1.0 + SOMIGLIANA_K * s2) / math.sqrt(1.0 - ECCENTRICITY_2 * s2)
    h = height / SEMI_MAJOR_AXIS
    free_air = normal * (1.0 - 2.0 * (1.0 + FLATTENING + GRAVITY_M - 2.0 * FLATTENING * s2) * h + 3.0 * h * h)
    return free_air - WATER_GRADIENT * max(surface - height, 0.0)


@kernel()
def move(x, at, d0, d1, d2):
    """Move the place at x[at] by (d0, d1, d2) metres along the axes of its navigation frame, in place."""
    axis = third_row(x[at], x[at + 1], x[at + 2], x[at + 3])
    t0, t1 = level_rotation(axis, curvature(axis, x[at + 4]), d0, d1)
    store_quaternion(x, at, product(load4(x, at), exponential(t0, t1, 0.0)))
    x[at + 4] -= d2


@kernel()
def offset(x, at, y, origin):
    """Metres along the navigation frame of the place y[origin] that lead from it to the place x[at]: the inverse of `move`."""
    p = (y[origin], -y[origin + 1], -y[origin + 2], -y[origin + 3])
    q = product(p, load4(x, at))
    t0, t1, _ = logarithm(q[0], q[1], q[2], q[3])
    axis = third_row(y[origin], y[origin + 1], y[origin + 2], y[origin + 3])
    k0, k1 = curvature(axis, y[origin + 4])
    a, b, d = k0 + k1 * axis[0] * axis[0], k1 * axis[0] * axis[1], k0 + k1 * axis[1] * axis[1]
    det = a * d - b * b
    return (-t1 * d - t0 * b) / det, (a * t0 + b * t1) / det, y[origin + 4] - x[at + 4]


@kernel()
def earth_fixed(x, at):
    """Earth-fixed position (m) of the place at x[at]."""
    c = load_matrix(x, at)
    prime = SEMI_MAJOR_AXIS / math.sqrt(1.0 - ECCENTRICITY_2 * c[8] * c[8])
    level = prime + x[at + 4]
    return -level * c[2], -level * c[5], -(level - ECCENTRICITY_2 * prime) * c[8]


@kernel()
def wander_slope(axis, height):
    """How the angle of the navigation frame against north changes with a level move (rad/m): tan(latitude) / R, along east."""
    k = curvature(axis, height)
    share = -axis[2] * k[0] / (axis[0] * axis[0] + axis[1] * axis[1])
    return -axis[1] * share, axis[0] * share


@kernel()
def level_angle(axis, b0, b1):
    """Angle clockwise from true north of the level direction (b0, b1) of the navigation frame."""
    return math.atan2(b1 * axis[0] - b0 * axis[1], b0 * axis[0] + b1 * axis[1])
