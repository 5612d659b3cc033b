"""What an inertial unit feels on a motion between knots: integrals of rate and specific force, compiled."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from leadline.core import rotation
from leadline.core.compiled import kernel
from leadline.core.geodesy import EARTH_RATE, ECCENTRICITY_2, FLATTENING, SEMI_MAJOR_AXIS
from leadline.simulate.dense import ACCELERATION, GROWTH, POSITION, QUATERNION, RATE, VELOCITY, inside, piece, piece_of
from leadline.simulate.gravity import GRAVITATIONAL_CONSTANT, GRAVITY_EQUATOR, GRAVITY_POLE, GRAVITY_RATIO, SEA_DENSITY

if TYPE_CHECKING:
    from leadline.data.records import Array
    from leadline.simulate.dense import Dense
    from leadline.simulate.trajectory import Place

NODES = (-math.sqrt(0.6), 0.0, math.sqrt(0.6))  # Gauss-Legendre, three points: exact for powers up to five
WEIGHTS = (5 / 18, 8 / 18, 5 / 18)
GROWTH_OF_GRAVITY = (1 - FLATTENING) * GRAVITY_POLE / GRAVITY_EQUATOR - 1
ORIGIN, TURN, SURFACE = 0, 3, 12  # place: Earth-fixed position (3), rotation t to Earth-fixed (9), height of the sea surface


@kernel()
def lift(position, place):
    """Minus gravity (m/s^2), axes of t, at a position in t: Somigliana and TR8350.2 in air, less gradient in the sea."""
    c = (
        place[TURN], place[TURN + 1], place[TURN + 2], place[TURN + 3], place[TURN + 4], place[TURN + 5],
        place[TURN + 6], place[TURN + 7], place[TURN + 8],
    )  # fmt: skip
    moved = rotation.turn(c, position)
    x, y, z = place[ORIGIN] + moved[0], place[ORIGIN + 1] + moved[1], place[ORIGIN + 2] + moved[2]
    level, ratio = math.sqrt(x * x + y * y), 1 - FLATTENING
    p = math.atan2(z, ratio * level)
    latitude = p
    for _ in range(3):  # Bowring, 1976
        s, k = math.sin(p), math.cos(p)
        latitude = math.atan2(
            z + ECCENTRICITY_2 / ratio * SEMI_MAJOR_AXIS * s * s * s, level - ECCENTRICITY_2 * SEMI_MAJOR_AXIS * k * k * k
        )
        p = math.atan2(ratio * math.sin(latitude), math.cos(latitude))
    sine, cosine = math.sin(latitude), math.cos(latitude)
    root = math.sqrt(1 - ECCENTRICITY_2 * sine * sine)
    height = level * cosine + z * sine - SEMI_MAJOR_AXIS * root
    slope = 2 / SEMI_MAJOR_AXIS * (1 + FLATTENING + GRAVITY_RATIO - 2 * FLATTENING * sine * sine)
    free = GRAVITY_EQUATOR * (1 + GROWTH_OF_GRAVITY * sine * sine) / root
    free *= 1 - slope * height + 3 / (SEMI_MAJOR_AXIS * SEMI_MAJOR_AXIS) * height * height
    g = free - 4 * math.pi * GRAVITATIONAL_CONSTANT * SEA_DENSITY * max(place[SURFACE] - height, 0.0)
    outward = cosine / level
    return rotation.turn_back(c, (g * outward * x, g * outward * y, g * sine))


@kernel()
def feel(state, up, spin, arm):
    """Rate against inertial space and specific force, body axes, of the point at `arm`."""
    q = rotation.load4(state, QUATERNION)
    c = rotation.matrix(q[0], q[1], q[2], q[3])
    rate, growth = rotation.load3(state, RATE), rotation.load3(state, GROWTH)
    swing = rotation.cross(rate, arm)
    pull, whirl = rotation.cross(growth, arm), rotation.cross(rate, swing)
    reach = rotation.turn(c, swing)
    v = (state[VELOCITY] + reach[0], state[VELOCITY + 1] + reach[1], state[VELOCITY + 2] + reach[2])
    coriolis = rotation.cross(spin, v)
    f = rotation.turn_back(
        c,
        (
            state[ACCELERATION] + 2 * coriolis[0] + up[0],
            state[ACCELERATION + 1] + 2 * coriolis[1] + up[1],
            state[ACCELERATION + 2] + 2 * coriolis[2] + up[2],
        ),
    )
    earth = rotation.turn_back(c, spin)
    return (rate[0] + earth[0], rate[1] + earth[1], rate[2] + earth[2]), (
        f[0] + pull[0] + whirl[0],
        f[1] + pull[1] + whirl[1],
        f[2] + pull[2] + whirl[2],
    )


@kernel()
def means_between(start, end, begin, h, knots, place, arm, rate, force):
    """Write the means of rate and specific force over (start, end] (n,); an interval is cut where it crosses a knot."""
    c, state, last = np.empty(36), np.empty(19), -1
    spin = (EARTH_RATE * place[TURN + 6], EARTH_RATE * place[TURN + 7], EARTH_RATE * place[TURN + 8])
    lever = (arm[0], arm[1], arm[2])
    for j in range(len(start)):
        whole = end[j] - start[j]
        first, over = start[j], piece_of(start[j], begin, h, len(knots))
        up = (0.0, 0.0, 0.0)
        for i in range(3):
            rate[j, i] = force[j, i] = 0.0
        while True:
            border = begin + (over + 1) * h
            until = end[j] if border >= end[j] or over == len(knots) - 2 else border
            if over != last:
                piece(knots, over, h, c)
                last = over
            for node in range(3):
                moment = first + 0.5 * (until - first) * (1 + NODES[(node + 1) % 3])  # the middle first: gravity is asked there, once
                inside(knots, over, c, moment - (begin + over * h), state)
                if node == 0:
                    q = rotation.load4(state, QUATERNION)
                    reach = rotation.turn(rotation.matrix(q[0], q[1], q[2], q[3]), lever)
                    up = lift((state[POSITION] + reach[0], state[POSITION + 1] + reach[1], state[POSITION + 2] + reach[2]), place)
                w, f = feel(state, up, spin, lever)
                share = WEIGHTS[(node + 1) % 3] * ((until - first) / whole if whole > 0.0 else 1.0)
                for i in range(3):
                    rate[j, i] += share * w[i]
                    force[j, i] += share * f[i]
            if until >= end[j]:
                break
            first, over = until, over + 1


def means_of(law: Dense, place: Place, start: Array, end: Array, arm: Array) -> tuple[Array, Array]:
    """Return the means (n, 3) over (start, end] of inertial rate and specific force, body axes; at equal ends the values."""
    slack = 1e-6 * law.step
    if len(start) and not (law.begin - slack <= np.min(start) and np.max(end) <= law.end + slack):
        law.states(np.array([np.min(start), np.max(end)]))  # says what is wrong
    rate, force = np.empty((len(start), 3)), np.empty((len(start), 3))
    flat = np.concatenate([place.position_e, place.rotation_et.ravel(), [place.surface_height]])
    means_between(
        np.ascontiguousarray(start), np.ascontiguousarray(end), law.begin, law.step, law.knots, flat, np.asarray(arm, float), rate, force
    )
    return rate, force
