"""How a hull moves in water, compiled: Fossen's equation of six degrees of freedom, integrated by Runge-Kutta of fourth order.

    M_RB nu' + C_RB(nu) nu + M_A nu_r' + C_A(nu_r) nu_r + D(nu_r) nu_r + g(eta) = tau,    nu_r = nu - nu_c,    nu_c = [R^T v_c; 0]

(Fossen, 2021, section 10.3), with v_c the velocity of the water at the body origin.  The acceleration a_c of the water at that place (not
along the body's path: Auton, Hunt and Prud'homme, 1988) acts through nu_c' = [R^T a_c - w x nu_c; 0] and through the gradient of its
pressure, by which the buoyancy is rho V (a_c - g) and not -rho V g: without that, a body as heavy as its water would not go with a wave.

State x: position_t 3 (north, east, down in the tangent frame t at the start, m), quaternion_tb 4, nu 6 (velocity of the body origin over
ground, and rate, against t, body axes), then thrusters (rps) and fins (rad).  A command has one number for each of those.
Site: depth of t's origin (m), radii of curvature to the north and to the east (m), gravity (m/s^2), density of the water (kg/m^3).
Water: the array that leadline.sea.flow reads.  t is taken as an inertial frame: the turning Earth is not felt.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import kernel
from leadline.core.earth import curvature, gravity
from leadline.core.rotation import cross, matrix, turn, turn_back
from leadline.data.errors import InputError
from leadline.data.hull import (
    ADDED,
    BUOYANCY_AT,
    ENCLOSED,
    FIN_ROW,
    FINS,
    GRAVITY_AT,
    HEIGHT,
    INVERSE,
    LENGTH,
    LINEAR,
    MASS,
    QUADRATIC,
    RIGID,
    ROWS_AT,
    TERM_ROW,
    TERMS,
    THRUSTER_ROW,
    THRUSTERS,
    VOLUME,
)
from leadline.sea.flow import elevation, flow

if TYPE_CHECKING:
    from leadline.data.hull import Hull
    from leadline.data.records import Array

NU, ACTUATORS = 7, 13  # places in the state
STILL: Array = np.zeros(1)  # water that does not move
STRIPS = 5  # that a hull is cut into where it can emerge
STEP = 0.02  # s: the step that is taken unless another is asked for


@kernel()
def times(a, i, nu):
    """Product of six numbers of `a` from place i and a generalised vector."""
    return a[i] * nu[0] + a[i + 1] * nu[1] + a[i + 2] * nu[2] + a[i + 3] * nu[3] + a[i + 4] * nu[4] + a[i + 5] * nu[5]


@kernel()
def momentum(a, i, nu):
    """Product of the 6 x 6 matrix from place i and a generalised vector: linear part, angular part."""
    linear = times(a, i, nu), times(a, i + 6, nu), times(a, i + 12, nu)
    return linear, (times(a, i + 18, nu), times(a, i + 24, nu), times(a, i + 30, nu))


@kernel()
def centripetal(p, nu):
    """C(nu) nu of a body with momentum p: [w x p1; w x p2 + v x p1] (Fossen, 2021, eq. 3.46)."""
    v, w = (nu[0], nu[1], nu[2]), (nu[3], nu[4], nu[5])
    force, first, second = cross(w, p[0]), cross(w, p[1]), cross(v, p[0])
    return force[0], force[1], force[2], first[0] + second[0], first[1] + second[1], first[2] + second[2]


@kernel()
def depth_of(north, east, down, site):
    """Depth (m) below the surface, which curves away from the tangent frame."""
    return site[0] + down - 0.5 * (north * north / site[1] + east * east / site[2])


@kernel()
def down_of(north, east, site):
    """Direction of the plumb line at a place, in the axes of the tangent frame."""
    a, b = -north / site[1], -east / site[2]
    s = 1.0 / math.sqrt(1.0 + a * a + b * b)
    return a * s, b * s, s


@kernel()
def toward(value, target, inverse_lag, quickest):
    """Rate of an actuator that follows its target with a lag."""
    return min(max((target - value) * inverse_lag, -quickest), quickest)


@kernel()
def push(dx, force, arm):
    """Add a force and its moment."""
    dx[NU] += force[0]
    dx[NU + 1] += force[1]
    dx[NU + 2] += force[2]
    dx[NU + 3] += arm[0]
    dx[NU + 4] += arm[1]
    dx[NU + 5] += arm[2]


@kernel()
def weigh(x, c, down_b, water_b, raised, hull, site, dx):
    """Add weight, and buoyancy in water that accelerates by water_b.

    Buoyancy is spread over strips along the hull; that of each falls linearly as it emerges from a surface raised (m), so that a hull that
    comes up nose first is righted.
    """
    g, density = site[3], site[4]
    centre = hull[BUOYANCY_AT], hull[BUOYANCY_AT + 1], hull[BUOYANCY_AT + 2]
    weight = hull[MASS] * g
    heavy = weight * down_b[0], weight * down_b[1], weight * down_b[2]
    push(dx, heavy, cross((hull[GRAVITY_AT], hull[GRAVITY_AT + 1], hull[GRAVITY_AT + 2]), heavy))
    at = turn(c, centre)
    depth = depth_of(x[0] + at[0], x[1] + at[1], x[2] + at[2], site) + raised
    deep = depth > 0.5 * (hull[LENGTH] + hull[HEIGHT])
    strips = 1 if deep else STRIPS
    for k in range(strips):
        place = centre if deep else (centre[0] + hull[LENGTH] * ((k + 0.5) / strips - 0.5), centre[1], centre[2])
        if not deep:
            at = turn(c, place)
            depth = depth_of(x[0] + at[0], x[1] + at[1], x[2] + at[2], site) + raised
        wet = density * hull[VOLUME] / strips * min(max(depth / hull[HEIGHT] + 0.5, 0.0), 1.0)
        carried = wet + hull[ENCLOSED] / strips
        light = (carried * water_b[0] - wet * g * down_b[0], carried * water_b[1] - wet * g * down_b[1],
                 carried * water_b[2] - wet * g * down_b[2])  # fmt: skip
        push(dx, light, cross(place, light))


@kernel()
def drive(x, command, nu, hull, dx):
    """Add what thrusters and fins do at the velocity nu through the water, and the rates of their own states."""
    i, at = ACTUATORS, ROWS_AT
    for _ in range(int(hull[THRUSTERS])):
        n, target, most = x[i], command[i - ACTUATORS], hull[at + 15]
        place, axis = (hull[at], hull[at + 1], hull[at + 2]), (hull[at + 3], hull[at + 4], hull[at + 5])
        turning = cross((nu[3], nu[4], nu[5]), place)
        inflow = axis[0] * (nu[0] + turning[0]) + axis[1] * (nu[1] + turning[1]) + axis[2] * (nu[2] + turning[2])
        thrust = (hull[at + 9] if n > 0.0 else hull[at + 10]) * n * abs(n) - hull[at + 11] * abs(n) * inflow
        torque = hull[at + 12] * n * abs(n)
        push(dx, (thrust * axis[0], thrust * axis[1], thrust * axis[2]),
             (thrust * hull[at + 6] + torque * axis[0], thrust * hull[at + 7] + torque * axis[1],
              thrust * hull[at + 8] + torque * axis[2]))  # fmt: skip
        target = 0.0 if abs(target) < hull[at + 14] else min(max(target, -most), most)
        dx[i] = toward(n, target, hull[at + 13], hull[at + 16])
        i, at = i + 1, at + THRUSTER_ROW
    for _ in range(int(hull[FINS])):
        angle, most = x[i], hull[at + 11]
        inflow = nu[0] + nu[4] * hull[at + 2] - nu[5] * hull[at + 1]
        lift = hull[at + 9] * inflow * abs(inflow) * angle
        push(dx, (lift * hull[at + 3], lift * hull[at + 4], lift * hull[at + 5]),
             (lift * hull[at + 6], lift * hull[at + 7], lift * hull[at + 8]))  # fmt: skip
        dx[i] = toward(angle, min(max(command[i - ACTUATORS], -most), most), hull[at + 10], hull[at + 12])
        i, at = i + 1, at + FIN_ROW
    return at


@kernel()
def derivative(time, x, command, hull, site, water, dx):
    """Rate of change dx of the state x at `time` (s) under `command`; dx[7:13] are the accelerations nu'."""
    c = matrix(x[3], x[4], x[5], x[6])
    v, w = (x[NU], x[NU + 1], x[NU + 2]), (x[NU + 3], x[NU + 4], x[NU + 5])
    vn, ve, vd, an, ae, ad = flow(time, x[0], x[1], depth_of(x[0], x[1], x[2], site), water)
    stream, water_b = turn_back(c, (vn, ve, vd)), turn_back(c, (an, ae, ad))
    turned = cross(w, stream)
    change = (water_b[0] - turned[0], water_b[1] - turned[1], water_b[2] - turned[2], 0.0, 0.0, 0.0)
    nu = v[0], v[1], v[2], w[0], w[1], w[2]
    relative = v[0] - stream[0], v[1] - stream[1], v[2] - stream[2], w[0], w[1], w[2]

    own = centripetal(momentum(hull, RIGID, nu), nu)
    around = centripetal(momentum(hull, ADDED, relative), relative)
    for i in range(6):
        drag = times(hull, LINEAR + 6 * i, relative) + hull[QUADRATIC + i] * abs(relative[i]) * relative[i]
        dx[NU + i] = times(hull, ADDED + 6 * i, change) - own[i] - around[i] - drag
    raised = elevation(time, x[0], x[1], water)
    weigh(x, c, turn_back(c, down_of(x[0], x[1], site)), water_b, raised, hull, site, dx)
    at = drive(x, command, relative, hull, dx)
    for _ in range(int(hull[TERMS])):
        first = relative[int(hull[at + 1])]
        first = abs(first) if hull[at + 3] > 0.0 else first
        dx[NU + int(hull[at])] += hull[at + 4] * first * relative[int(hull[at + 2])]
        at += TERM_ROW

    force = dx[NU], dx[NU + 1], dx[NU + 2], dx[NU + 3], dx[NU + 4], dx[NU + 5]
    for i in range(6):
        dx[NU + i] = times(hull, INVERSE + 6 * i, force)
    dx[0], dx[1], dx[2] = turn(c, v)
    q0, q1, q2, q3 = x[3], x[4], x[5], x[6]
    dx[3] = -0.5 * (q1 * w[0] + q2 * w[1] + q3 * w[2])
    dx[4] = 0.5 * (q0 * w[0] + q2 * w[2] - q3 * w[1])
    dx[5] = 0.5 * (q0 * w[1] + q3 * w[0] - q1 * w[2])
    dx[6] = 0.5 * (q0 * w[2] + q1 * w[1] - q2 * w[0])


@kernel()
def advance(x, command, time, step, count, hull, site, water, work):
    """Move the state x on by `count` steps (s) from `time` under a command that holds, in place; returns the time reached.

    work: five times as long as x.  The quaternion is made of length one after each step.
    """
    n = len(x)
    k1, k2, k3, k4, y = work[:n], work[n : 2 * n], work[2 * n : 3 * n], work[3 * n : 4 * n], work[4 * n : 5 * n]
    for done in range(count):
        t = time + done * step
        derivative(t, x, command, hull, site, water, k1)
        for i in range(n):
            y[i] = x[i] + 0.5 * step * k1[i]
        derivative(t + 0.5 * step, y, command, hull, site, water, k2)
        for i in range(n):
            y[i] = x[i] + 0.5 * step * k2[i]
        derivative(t + 0.5 * step, y, command, hull, site, water, k3)
        for i in range(n):
            y[i] = x[i] + step * k3[i]
        derivative(t + step, y, command, hull, site, water, k4)
        for i in range(n):
            x[i] += step / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])
        s = 1.0 / math.sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5] + x[6] * x[6])
        for i in range(3, 7):
            x[i] *= s
    return time + count * step


@kernel()
def travel(x, commands, time, step, every, hull, site, water, work, states, rates):
    """Fill states and rates (their derivatives) at knots `every` steps apart; commands[k] holds from knot k to the next."""
    for k in range(len(states)):
        states[k] = x
        derivative(time, x, commands[k], hull, site, water, rates[k])
        if k + 1 < len(states):
            time = advance(x, commands[k], time, step, every, hull, site, water, work)


@kernel()
def place(sine, cosine, height):
    """Radii of curvature to the north and to the east (m) and gravity (m/s^2) at the surface."""
    axis = (cosine, 0.0, -sine)
    k = curvature(axis, height)
    return 1.0 / (k[0] + k[1] * axis[0] * axis[0]), 1.0 / k[0], gravity(axis, height, 0.0)


def site_at(latitude: float, depth: float = 0.0, density: float = 1025.0) -> Array:
    """Return the site array (5,) of a tangent frame with its origin `depth` (m) below the surface at a latitude (rad)."""
    north, east, g = place(float(np.sin(latitude)), float(np.cos(latitude)), -float(depth))
    return np.array([depth, north, east, g, density])


def at_rest(hull: Hull, position_t: Array | None = None, quaternion_tb: Array | None = None, nu: Array | None = None) -> Array:
    """Return a state with thrusters and fins at zero: at the origin, level, heading north and at rest unless told otherwise."""
    x = np.zeros(hull.states)
    x[3] = 1.0
    for place_of, value in ((slice(0, 3), position_t), (slice(3, 7), quaternion_tb), (slice(NU, ACTUATORS), nu)):
        if value is not None:
            x[place_of] = value
    return x


def accelerations(time: float, x: Array, command: Array, hull: Hull, site: Array, water: Array = STILL) -> Array:
    """Return the accelerations nu' (6,) of a state x (m/s^2, rad/s^2, body axes) under a command."""
    dx = np.empty(hull.states)
    derivative(
        float(time), _flat(x, hull.states), _flat(command, hull.states - ACTUATORS), hull.parameters, _flat(site, 5), _flat(water), dx
    )
    return dx[NU:ACTUATORS]


def motion(
    hull: Hull, x: Array, commands: Array, site: Array, water: Array = STILL, *, time: float = 0.0, step: float = STEP, every: int = 1
) -> tuple[Array, Array]:
    """Return states and their derivatives (knots, states) at time + k every step (s), the first at x.

    commands (knots, actuators): row k holds from knot k to the next.  Raises InputError for lengths that do not fit the hull.
    """
    orders = np.ascontiguousarray(commands, dtype=float)
    if orders.ndim != 2 or orders.shape[1] != hull.states - ACTUATORS:
        raise InputError("motion", f"commands have the shape {orders.shape}", f"(knots, {hull.states - ACTUATORS}) for {hull.name}")
    states, rates = np.empty((len(orders), hull.states)), np.empty((len(orders), hull.states))
    start, work = _flat(x, hull.states).copy(), np.empty(5 * hull.states)
    travel(start, orders, float(time), float(step), int(every), hull.parameters, _flat(site, 5), _flat(water), work, states, rates)
    return states, rates


def _flat(values: Array, length: int | None = None) -> Array:
    """Return numbers as the kernels take them; raises InputError for another length."""
    array: Array = np.ascontiguousarray(values, dtype=float)
    if array.ndim != 1 or (length is not None and len(array) != length):
        raise InputError("dynamics", f"an array of the shape {array.shape}", f"({length},)" if length else "one dimension")
    return array
