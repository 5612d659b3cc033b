"""The loop of a voyage, compiled: look, steer, move, write down."""

from __future__ import annotations

import math

from leadline.core import rotation
from leadline.core.compiled import kernel
from leadline.core.geodesy import ECCENTRICITY_2, FLATTENING, SEMI_MAJOR_AXIS
from leadline.sea.casting import bed
from leadline.sea.flow import level
from leadline.simulate import steering
from leadline.simulate.dense import ACCELERATION, GROWTH, POSITION, QUATERNION, RATE, VELOCITY
from leadline.simulate.dynamics import ACTUATORS, NU, advance, derivative
from leadline.simulate.places import geodetic

TICK, STEPS = 0.1, 5  # s between looks of the pilot; steps of the integrator between two
PATIENCE = 300.0  # s without getting on, or off the depth, after which a voyage is given up
TOLERANCE = 3.0  # m off the depth that is wanted
ON, FINISHED, AGROUND, STUCK, LOST, TIME_UP, OFF_DEPTH = range(7)  # why a stretch ended
# The array `frame`: Earth-fixed origin of t 3, rotation t to Earth-fixed 9, height of the mean sea surface, unused, longitude of the
# origin, and meridian arc there.


@kernel()
def arc_of(latitude):
    """Length (m) of the meridian from the equator: third order in the third flattening, 0.02 mm (Kawase, 2011)."""
    n = FLATTENING / (2 - FLATTENING)
    a0 = 1 + n * n / 4 + n**4 / 64
    a2 = -1.5 * (n - n**3 / 8)
    a4 = 15 / 16 * (n * n - n**4 / 4)
    a6 = -35 / 48 * n**3
    a8 = 315 / 512 * n**4
    s = math.sin(2 * latitude) * a2 + math.sin(4 * latitude) * a4 + math.sin(6 * latitude) * a6 + math.sin(8 * latitude) * a8
    return SEMI_MAJOR_AXIS / (1 + n) * (a0 * latitude + s)


@kernel()
def where(x, y, z, frame):
    """North and east (m) of the origin, height (m), latitude, longitude (rad), of a position in t."""
    c = frame[3], frame[4], frame[5], frame[6], frame[7], frame[8], frame[9], frame[10], frame[11]
    moved = rotation.turn(c, (x, y, z))
    ex, ey, ez = frame[0] + moved[0], frame[1] + moved[1], frame[2] + moved[2]
    latitude, longitude, height = geodetic(ex, ey, ez)
    s, k = math.sin(latitude), math.cos(latitude)
    root = math.sqrt(1 - ECCENTRICITY_2 * s * s)
    gap = (longitude - frame[14] + math.pi) % (2 * math.pi) - math.pi
    return arc_of(latitude) - frame[15], SEMI_MAJOR_AXIS / root * k * gap, height, latitude, longitude


@kernel()
def look(time, x, frame, water, chart, corner, nav):
    """Write what a pilot sees who sees the truth; returns the depth of the ground below (nan: not known)."""
    north, east, height, latitude, longitude = where(x[0], x[1], x[2], frame)
    sl, cl, so, co = math.sin(latitude), math.cos(latitude), math.sin(longitude), math.cos(longitude)
    c = frame[3], frame[4], frame[5], frame[6], frame[7], frame[8], frame[9], frame[10], frame[11]
    q = rotation.matrix(x[3], x[4], x[5], x[6])
    forward, right = rotation.turn(c, (q[0], q[3], q[6])), rotation.turn(c, (q[1], q[4], q[7]))
    down = rotation.turn(c, (q[2], q[5], q[8]))
    n_axis, e_axis, d_axis = (-sl * co, -sl * so, cl), (-so, co, 0.0), (-cl * co, -cl * so, -sl)
    f_n = forward[0] * n_axis[0] + forward[1] * n_axis[1] + forward[2] * n_axis[2]
    f_e = forward[0] * e_axis[0] + forward[1] * e_axis[1]
    f_d = forward[0] * d_axis[0] + forward[1] * d_axis[1] + forward[2] * d_axis[2]
    r_d = right[0] * d_axis[0] + right[1] * d_axis[1] + right[2] * d_axis[2]
    d_d = down[0] * d_axis[0] + down[1] * d_axis[1] + down[2] * d_axis[2]
    v = rotation.turn(c, rotation.turn(q, (x[NU], x[NU + 1], x[NU + 2])))
    nav[0], nav[1], nav[2] = time, north, east
    nav[3] = frame[12] + level(time, water) - height
    nav[5], nav[6], nav[7] = math.atan2(r_d, d_d), math.atan2(-f_d, math.sqrt(f_n * f_n + f_e * f_e)), math.atan2(f_e, f_n)
    nav[8] = v[0] * n_axis[0] + v[1] * n_axis[1] + v[2] * n_axis[2]
    nav[9] = v[0] * e_axis[0] + v[1] * e_axis[1]
    nav[10] = v[0] * d_axis[0] + v[1] * d_axis[1] + v[2] * d_axis[2]
    nav[11], nav[12], nav[13] = x[NU + 3], x[NU + 4], x[NU + 5]
    ground, _, _ = bed(chart, (north - corner[0]) / corner[2], (east - corner[1]) / corner[3])
    nav[4] = ground - (frame[12] - height)
    return ground


@kernel()
def write_knot(x, dx, knot):
    """Write a knot of the trajectory from a state and its derivative."""
    w = (x[NU + 3], x[NU + 4], x[NU + 5])
    c = rotation.matrix(x[3], x[4], x[5], x[6])
    turned = rotation.cross(w, (x[NU], x[NU + 1], x[NU + 2]))
    acceleration = rotation.turn(c, (dx[NU] + turned[0], dx[NU + 1] + turned[1], dx[NU + 2] + turned[2]))
    for i in range(3):
        knot[POSITION + i], knot[VELOCITY + i], knot[ACCELERATION + i] = x[i], dx[i], acceleration[i]
        knot[RATE + i], knot[GROWTH + i] = x[NU + 3 + i], dx[NU + 3 + i]
    for i in range(4):
        knot[QUATERNION + i] = x[3 + i]


@kernel()
def sail(first, count, x, hull, site, water, frame, chart, corner, route, pilot, memory, believed, work, knots, actuators, state):
    """Run `count` ticks from tick `first` on; write knots and the states of the actuators; return how many, and why they ended.

    believed: what the pilot believes instead of the truth, moved on by nothing; empty: it sees the truth.  state: nav 14, force 6, command.
    """
    nav, force, command, dx = state[:14], state[14:20], state[20:], work[5 * len(x) :]
    n = len(x) - ACTUATORS
    for k in range(count):
        time = (first + k) * TICK
        ground = look(time, x, frame, water, chart, corner, nav)
        depth = nav[3]
        if not abs(x[0] + x[1] + x[2] + x[NU] + x[NU + 1] + x[NU + 2] + x[NU + 3] + x[NU + 4] + x[NU + 5]) < 1e9:
            return k, LOST
        if nav[4] <= 0.0 and ground == ground:
            return k, AGROUND
        if len(believed):
            for i in range(1, 14):
                nav[i] = believed[i]
        steering.steer(nav, route, pilot, memory, TICK, force, command)
        derivative(time, x, command, hull, site, water, dx)
        write_knot(x, dx, knots[k])
        for i in range(n):
            actuators[k, i] = x[ACTUATORS + i]
        advance(x, command, time, TICK / STEPS, STEPS, hull, site, water, work[: 5 * len(x)])
        if steering.finished(time, pilot, memory):
            return k + 1, FINISHED
        if abs(depth - memory[steering.TARGET]) < TOLERANCE or memory[steering.MODE] != steering.UNDER_WAY:
            memory[steering.AT_DEPTH] = time
        if time - memory[steering.BEST_FROM] > PATIENCE:
            return k + 1, STUCK
        if time - memory[steering.AT_DEPTH] > PATIENCE:
            return k + 1, OFF_DEPTH
        if depth > 1e5:
            return k + 1, LOST
    return count, ON
