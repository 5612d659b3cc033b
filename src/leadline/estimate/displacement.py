"""Where and when a sensor really looks: its view is displaced by an unknown lever arm and by a wrong time stamp.

The sensor stamps t and looked at t - o, with o = own time offset + offset and drift of its clock; it sits at l + dl where the vehicle
file says l.  With w and f the rate and specific force of the view, C = R_nb, dt = -o:
    v' = v + C (w x dl) + a dt     p' = p + C dl + v dt + a dt^2 / 2     R' = exp([C w dt]x) R     a = C f + g - Coriolis
First order in dl and dt but for position; the change of w is left out.  So a sensor model never hears of either.
"""

from __future__ import annotations

from leadline.core.compiled import kernel
from leadline.core.earth import gravity, move, third_row
from leadline.core.geodesy import EARTH_RATE
from leadline.core.rotation import cross, exponential, load3, load4, load_matrix, product, store_quaternion, turn, turn_back
from leadline.estimate.plan import CHANNEL, CHANNEL_SIZE, DRIFT_P, DRIFT_S, GATE, LEVER_P, LEVER_S, OFFSET_P, OFFSET_S, TIME_P, TIME_S
from leadline.models.layout import MOTION, NOMINAL, TIME, X
from leadline.models.view import (
    ATTITUDE_T,
    FORCE_T,
    FORCE_V,
    HEIGHT_V,
    PLACE_V,
    POSITION_T,
    QUATERNION_V,
    RATE_T,
    RATE_V,
    VELOCITY_T,
    VELOCITY_V,
    WATER_T,
    WATER_V,
)


@kernel()
def acceleration(view):
    """Rate of change of the velocity (3), navigation frame; zero where no specific force is known, as in a gap of the input."""
    f = load3(view, FORCE_V)
    if f[0] == 0.0 and f[1] == 0.0 and f[2] == 0.0:
        return 0.0, 0.0, 0.0
    axis = third_row(view[0], view[1], view[2], view[3])
    n = turn(load_matrix(view, QUATERNION_V), f)
    c = cross((2.0 * EARTH_RATE * axis[0], 2.0 * EARTH_RATE * axis[1], 2.0 * EARTH_RATE * axis[2]), load3(view, VELOCITY_V))
    return n[0] - c[0], n[1] - c[1], n[2] - c[2] + gravity(axis, view[HEIGHT_V], view[HEIGHT_V])


@kernel()
def offset_of(plan, params, state, channel):
    """By how much (s) the stamps of a channel are late: its own offset, that of its clock, and its clock's drift since time zero."""
    at, x = CHANNEL + CHANNEL_SIZE * channel, plan[NOMINAL] - plan[MOTION]
    g = plan[at + GATE]
    values = state[plan[X] :]
    own = values[x + plan[at + TIME_S]] if plan[at + TIME_S] >= 0 else params[g + TIME_P]
    clock = values[x + plan[at + OFFSET_S]] if plan[at + OFFSET_S] >= 0 else params[g + OFFSET_P]
    drift = values[x + plan[at + DRIFT_S]] if plan[at + DRIFT_S] >= 0 else params[g + DRIFT_P]
    return own + clock + drift * state[TIME]


@kernel()
def lever_of(plan, params, state, channel):
    """Error of a channel's lever arm (3), body axes (m)."""
    at = CHANNEL + CHANNEL_SIZE * channel
    if plan[at + LEVER_S] < 0:
        return load3(params, plan[at + GATE] + LEVER_P)
    return load3(state[plan[X] :], plan[NOMINAL] - plan[MOTION] + plan[at + LEVER_S])


@kernel()
def displace(view, dt, lever):
    """Bring a view to another moment and to another point of the body, in place."""
    c, w, v, a = load_matrix(view, QUATERNION_V), load3(view, RATE_V), load3(view, VELOCITY_V), acceleration(view)
    arm, swing = turn(c, lever), turn(c, cross(w, lever))
    half = 0.5 * dt * dt
    move(view, PLACE_V, arm[0] + v[0] * dt + a[0] * half, arm[1] + v[1] * dt + a[1] * half, arm[2] + v[2] * dt + a[2] * half)
    for i in range(3):
        step = swing[i] + a[i] * dt
        view[VELOCITY_V + i] += step
        view[WATER_V + i] += step
    store_quaternion(view, QUATERNION_V, product(load4(view, QUATERNION_V), exponential(w[0] * dt, w[1] * dt, w[2] * dt)))


@kernel()
def pull_back(plan, channel, time, view, dt, lever, Hv, H, rows):
    """Turn Jacobians against the displaced view into such against the view, in place, and add the columns of what displaces it to H."""
    at = CHANNEL + CHANNEL_SIZE * channel
    c, w, v, a = load_matrix(view, QUATERNION_V), load3(view, RATE_V), load3(view, VELOCITY_V), acceleration(view)
    arm, swing, turned = turn(c, lever), turn(c, cross(w, lever)), turn(c, w)
    f = turn(c, load3(view, FORCE_V))
    for r in range(rows):
        p, q = load3(Hv[r], POSITION_T), load3(Hv[r], ATTITUDE_T)
        s = (
            Hv[r, VELOCITY_T] + Hv[r, WATER_T],
            Hv[r, VELOCITY_T + 1] + Hv[r, WATER_T + 1],
            Hv[r, VELOCITY_T + 2] + Hv[r, WATER_T + 2],
        )
        along = s[0] * a[0] + s[1] * a[1] + s[2] * a[2]
        for j in range(3):
            along += p[j] * (v[j] + a[j] * dt)
        slope = -(along + q[0] * turned[0] + q[1] * turned[1] + q[2] * turned[2])
        for i, factor in ((plan[at + TIME_S], 1.0), (plan[at + OFFSET_S], 1.0), (plan[at + DRIFT_S], time)):
            if i >= 0:
                H[r, i] += factor * slope
        if plan[at + LEVER_S] >= 0:
            b, d = turn_back(c, p), cross(turn_back(c, s), w)  # s . C (w x l) = l . (C^T s x w)
            for j in range(3):
                H[r, plan[at + LEVER_S] + j] += b[j] + d[j]
        # attitude: d(C y) = dtheta x C y, for the arm (position) and for swing + C f dt (velocity)
        moved = (swing[0] + f[0] * dt, swing[1] + f[1] * dt, swing[2] + f[2] * dt)
        t, u = cross(arm, p), cross(moved, s)
        back_s, back_q = turn_back(c, s), turn_back(c, q)
        k = cross(lever, back_s)
        for j in range(3):
            Hv[r, ATTITUDE_T + j] += t[j] + u[j]
            Hv[r, RATE_T + j] += k[j] + dt * back_q[j]
            Hv[r, FORCE_T + j] += dt * back_s[j]
            Hv[r, VELOCITY_T + j] += dt * p[j]
