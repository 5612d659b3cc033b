"""A hull's equation of motion as an estimator needs it: accelerations and their derivatives, of one flat array (data/hull.py).

    M nu' = T(nu, n, delta) + g(down) - C(nu) nu - D(nu) nu + terms(nu)           M = M_RB + M_A,  nu through the water

The equation is that of the velocity through the water: in water that moves steadily and without turning, the momentum of hull and water
counts from the water, and no current appears.  With [p; h] = M nu,

    C(nu) = [0, -S(p); -S(p), -S(h)]                                              S(a) b = a x b

(Fossen, 2021, eqs. 3.46, 6.43, 10.149).  D is linear and quadratic damping, and scaled by `drag`; `terms` are the hull's products of two
velocities, and are not.  Weight and lift (N) act at their centres; of a hull that emerges the lift's moment along the hull (`lever`, N m,
more than that of its centre) counts as well.  Thrusters and fins are as data/hull.py says, at the speeds and angles
of the input `u`: thrusters, then fins, in the order of the hull.  `thrust` scales force and torque of all thrusters.

Derivatives are against SLOPE numbers: nu 6, down 3 (direction of the plumb line in body axes), drag, thrust, lift (N), lever.
"""

from __future__ import annotations

from leadline.core.compiled import kernel
from leadline.core.rotation import cross
from leadline.data.hull import (
    ADDED,
    BUOYANCY_AT,
    FIN_ROW,
    FINS,
    GRAVITY_AT,
    INVERSE,
    LINEAR,
    QUADRATIC,
    RIGID,
    ROWS_AT,
    TERM_ROW,
    TERMS,
    THRUSTER_ROW,
    THRUSTERS,
)

SLOPE, DOWN_S, DRAG_S, THRUST_S, LIFT_S, LEVER_S = 13, 6, 9, 10, 11, 12
SIX = 6


@kernel()
def mass_times(hull, nu, first):
    """Three rows, from row `first`, of (M_RB + M_A) nu."""
    a, b, c = 0.0, 0.0, 0.0
    for j in range(SIX):
        at = SIX * first + j
        a += (hull[RIGID + at] + hull[ADDED + at]) * nu[j]
        b += (hull[RIGID + at + SIX] + hull[ADDED + at + SIX]) * nu[j]
        c += (hull[RIGID + at + 2 * SIX] + hull[ADDED + at + 2 * SIX]) * nu[j]
    return a, b, c


@kernel()
def put(f, at, force, moment, share):
    """Add a share of a force and a moment to the six numbers at f[at], f[at + SLOPE], ... (a column) of a matrix."""
    for i in range(3):
        f[at + SLOPE * i] += share * force[i]
        f[at + SLOPE * (i + 3)] += share * moment[i]


@kernel()
def along(hull, at, nu):
    """Speed of a thruster's place through the water along its direction: [axis; position x axis] . nu."""
    return (
        hull[at + 3] * nu[0]
        + hull[at + 4] * nu[1]
        + hull[at + 5] * nu[2]
        + hull[at + 6] * nu[3]
        + hull[at + 7] * nu[4]
        + hull[at + 8] * nu[5]
    )


@kernel()
def acceleration(nu, down, u, hull, drag, thrust, weight, lift, lever, out, at):
    """Put nu' (6) at out[at]: nu 6 through the water, down 3, weight and lift (N), both positive."""
    v, w = (nu[0], nu[1], nu[2]), (nu[3], nu[4], nu[5])
    p, h = mass_times(hull, nu, 0), mass_times(hull, nu, 3)
    pw, pv, hw = cross(p, w), cross(p, v), cross(h, w)
    heavy = (hull[GRAVITY_AT], hull[GRAVITY_AT + 1], hull[GRAVITY_AT + 2])
    light = (hull[BUOYANCY_AT], hull[BUOYANCY_AT + 1], hull[BUOYANCY_AT + 2])
    arm = (weight * heavy[0] - lift * light[0] - lever, weight * heavy[1] - lift * light[1], weight * heavy[2] - lift * light[2])
    righting, sinking = cross(arm, down), weight - lift
    f0, f1, f2 = pw[0] + sinking * down[0], pw[1] + sinking * down[1], pw[2] + sinking * down[2]
    f3, f4, f5 = pv[0] + hw[0] + righting[0], pv[1] + hw[1] + righting[1], pv[2] + hw[2] + righting[2]

    row = ROWS_AT
    for k in range(int(hull[THRUSTERS])):
        n = u[k]
        size = abs(n)
        force = thrust * size * ((hull[row + 9] if n > 0.0 else hull[row + 10]) * n - hull[row + 11] * along(hull, row, nu))
        torque = thrust * hull[row + 12] * n * size
        f0, f1, f2 = f0 + force * hull[row + 3], f1 + force * hull[row + 4], f2 + force * hull[row + 5]
        f3 += force * hull[row + 6] + torque * hull[row + 3]
        f4 += force * hull[row + 7] + torque * hull[row + 4]
        f5 += force * hull[row + 8] + torque * hull[row + 5]
        row += THRUSTER_ROW
    for k in range(int(hull[FINS])):
        inflow = nu[0] + w[1] * hull[row + 2] - w[2] * hull[row + 1]
        force = hull[row + 9] * abs(inflow) * inflow * u[int(hull[THRUSTERS]) + k]
        f0, f1, f2 = f0 + force * hull[row + 3], f1 + force * hull[row + 4], f2 + force * hull[row + 5]
        f3, f4, f5 = f3 + force * hull[row + 6], f4 + force * hull[row + 7], f5 + force * hull[row + 8]
        row += FIN_ROW

    for i in range(SIX):
        out[at + i] = 0.0
    for _ in range(int(hull[TERMS])):
        first = nu[int(hull[row + 1])]
        out[at + int(hull[row])] += hull[row + 4] * (abs(first) if hull[row + 3] != 0.0 else first) * nu[int(hull[row + 2])]
        row += TERM_ROW
    for i in range(SIX):
        resistance = hull[QUADRATIC + i] * abs(nu[i]) * nu[i]
        for j in range(SIX):
            resistance += hull[LINEAR + SIX * i + j] * nu[j]
        out[at + i] -= drag * resistance
    f0, f1, f2, f3, f4, f5 = f0 + out[at], f1 + out[at + 1], f2 + out[at + 2], f3 + out[at + 3], f4 + out[at + 4], f5 + out[at + 5]
    for i in range(SIX):
        b = INVERSE + SIX * i
        out[at + i] = hull[b] * f0 + hull[b + 1] * f1 + hull[b + 2] * f2 + hull[b + 3] * f3 + hull[b + 4] * f4 + hull[b + 5] * f5


@kernel()
def slopes(nu, down, u, hull, drag, thrust, weight, lift, lever, out, at):
    """Put d nu' (6, SLOPE), row by row, at out[at]; the arguments are those of `acceleration`."""
    for i in range(SIX * SLOPE):
        out[at + i] = 0.0
    _slope_of_momentum(nu, hull, out, at)
    heavy = (hull[GRAVITY_AT], hull[GRAVITY_AT + 1], hull[GRAVITY_AT + 2])
    light = (hull[BUOYANCY_AT], hull[BUOYANCY_AT + 1], hull[BUOYANCY_AT + 2])
    arm = (weight * heavy[0] - lift * light[0] - lever, weight * heavy[1] - lift * light[1], weight * heavy[2] - lift * light[2])
    for j in range(3):
        e = (1.0 if j == 0 else 0.0, 1.0 if j == 1 else 0.0, 1.0 if j == 2 else 0.0)
        sinking = weight - lift
        put(out, at + DOWN_S + j, (sinking * e[0], sinking * e[1], sinking * e[2]), cross(arm, e), 1.0)
    put(out, at + LIFT_S, down, cross(light, down), -1.0)
    put(out, at + LEVER_S, (0.0, 0.0, 0.0), (0.0, -down[2], down[1]), -1.0)
    row = _slope_of_actuators(nu, u, hull, thrust, out, at)
    for _ in range(int(hull[TERMS])):
        line, first, second = at + SLOPE * int(hull[row]), int(hull[row + 1]), int(hull[row + 2])
        sign = -1.0 if hull[row + 3] != 0.0 and nu[first] < 0.0 else 1.0
        out[line + first] += hull[row + 4] * sign * nu[second]
        out[line + second] += hull[row + 4] * sign * nu[first]
        row += TERM_ROW
    for i in range(SIX):
        line = at + SLOPE * i
        out[line + i] -= 2.0 * drag * hull[QUADRATIC + i] * abs(nu[i])
        resistance = hull[QUADRATIC + i] * abs(nu[i]) * nu[i]
        for j in range(SIX):
            out[line + j] -= drag * hull[LINEAR + SIX * i + j]
            resistance += hull[LINEAR + SIX * i + j] * nu[j]
        out[line + DRAG_S] -= resistance
    for j in range(SLOPE):
        a = at + j
        f = (out[a], out[a + SLOPE], out[a + 2 * SLOPE], out[a + 3 * SLOPE], out[a + 4 * SLOPE], out[a + 5 * SLOPE])
        for i in range(SIX):
            b = INVERSE + SIX * i
            out[a + SLOPE * i] = (hull[b] * f[0] + hull[b + 1] * f[1] + hull[b + 2] * f[2] + hull[b + 3] * f[3] + hull[b + 4] * f[4]
                                  + hull[b + 5] * f[5])  # fmt: skip


@kernel()
def _slope_of_momentum(nu, hull, out, at):
    """Add the derivative of -C(nu) nu: of [p x w; p x v + h x w]."""
    v, w = (nu[0], nu[1], nu[2]), (nu[3], nu[4], nu[5])
    p, h = mass_times(hull, nu, 0), mass_times(hull, nu, 3)
    for j in range(SIX):
        b = RIGID + j
        c = ADDED + j
        dp = (hull[b] + hull[c], hull[b + 6] + hull[c + 6], hull[b + 12] + hull[c + 12])
        dh = (hull[b + 18] + hull[c + 18], hull[b + 24] + hull[c + 24], hull[b + 30] + hull[c + 30])
        pw, pv, hw = cross(dp, w), cross(dp, v), cross(dh, w)
        put(out, at + j, pw, pv, 1.0)
        put(out, at + j, (0.0, 0.0, 0.0), hw, 1.0)
        e = (1.0 if j % 3 == 0 else 0.0, 1.0 if j % 3 == 1 else 0.0, 1.0 if j % 3 == 2 else 0.0)
        if j < 3:
            put(out, at + j, (0.0, 0.0, 0.0), cross(p, e), 1.0)
        else:
            put(out, at + j, cross(p, e), cross(h, e), 1.0)


@kernel()
def _slope_of_actuators(nu, u, hull, thrust, out, at):
    """Add the derivative of what thrusters and fins do; returns the place of the first term in the hull."""
    row = ROWS_AT
    for k in range(int(hull[THRUSTERS])):
        n = u[k]
        size = abs(n)
        force = size * ((hull[row + 9] if n > 0.0 else hull[row + 10]) * n - hull[row + 11] * along(hull, row, nu))
        torque = hull[row + 12] * n * size
        loss = -thrust * size * hull[row + 11]
        axis, arm = (hull[row + 3], hull[row + 4], hull[row + 5]), (hull[row + 6], hull[row + 7], hull[row + 8])
        for j in range(3):
            put(out, at + j, axis, arm, loss * axis[j])
            put(out, at + 3 + j, axis, arm, loss * arm[j])
        put(out, at + THRUST_S, axis, arm, force)
        put(out, at + THRUST_S, (0.0, 0.0, 0.0), axis, torque)
        row += THRUSTER_ROW
    for k in range(int(hull[FINS])):
        inflow = nu[0] + nu[4] * hull[row + 2] - nu[5] * hull[row + 1]
        steep = 2.0 * hull[row + 9] * abs(inflow) * u[int(hull[THRUSTERS]) + k]
        axis, arm = (hull[row + 3], hull[row + 4], hull[row + 5]), (hull[row + 6], hull[row + 7], hull[row + 8])
        put(out, at, axis, arm, steep)
        put(out, at + 4, axis, arm, steep * hull[row + 2])
        put(out, at + 5, axis, arm, -steep * hull[row + 1])
        row += FIN_ROW
    return row
