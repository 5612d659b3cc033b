"""Motion between knots: what an integrator left at equal steps, made smooth, so that an instrument can look at any moment.

Between two knots position is the quintic that meets position, velocity and acceleration at both; rotation is R_k exp([theta]x), with
theta the quintic that meets the rotation, the rate and its derivative at both.  All that is asked of the motion is the exact derivative of
these two; so the truth is consistent with itself to rounding, whatever the step of the integrator was.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from leadline.core import rotation
from leadline.core.compiled import kernel
from leadline.data.errors import InputError
from leadline.simulate.trajectory import Motion

if TYPE_CHECKING:
    from leadline.data.records import Array

POSITION, VELOCITY, ACCELERATION, QUATERNION, RATE, GROWTH, WIDTH = 0, 3, 6, 9, 13, 16, 19  # columns of a knot


@kernel()
def curvature(square):
    """A = (1 - cos t) / t^2, B = (t - sin t) / t^3, and their derivatives with respect to t^2, of t^2."""
    if square < 0.25:  # the next terms are below 1e-16
        a = 1 / 2 - square * (1 / 24 - square * (1 / 720 - square * (1 / 40320 - square * (1 / 3628800 - square / 479001600))))
        b = 1 / 6 - square * (1 / 120 - square * (1 / 5040 - square * (1 / 362880 - square * (1 / 39916800 - square / 6227020800))))
        da = -1 / 24 + square * (1 / 360 - square * (3 / 40320 - square * (4 / 3628800 - square * 5 / 479001600)))
        db = -1 / 120 + square * (1 / 2520 - square * (3 / 362880 - square * (4 / 39916800 - square * 5 / 6227020800)))
        return a, b, da, db
    t = math.sqrt(square)
    a, b = (1 - math.cos(t)) / square, (t - math.sin(t)) / (square * t)
    return a, b, 0.5 * (math.sin(t) / t - 2 * a) / square, 0.5 * (a - 3 * b) / square


@kernel()
def body_turn(theta, slope, growth):
    """Rate and its derivative (body axes) of R = R_0 exp([theta]x), from theta and its first two derivatives.

    rate = J theta' with J = I - A [theta]x + B [theta]x^2 (Chirikjian, 2012, section 10.7).
    """
    a, b, da, db = curvature(theta[0] * theta[0] + theta[1] * theta[1] + theta[2] * theta[2])
    once = rotation.cross(theta, slope)
    twice = rotation.cross(theta, once)
    once_more = rotation.cross(theta, growth)
    twice_more = rotation.cross(theta, once_more)
    bend = rotation.cross(slope, once)
    along = 2 * (theta[0] * slope[0] + theta[1] * slope[1] + theta[2] * slope[2])
    r = (slope[0] - a * once[0] + b * twice[0], slope[1] - a * once[1] + b * twice[1], slope[2] - a * once[2] + b * twice[2])
    g = (
        growth[0] - a * once_more[0] + b * twice_more[0] - da * along * once[0] + db * along * twice[0] + b * bend[0],
        growth[1] - a * once_more[1] + b * twice_more[1] - da * along * once[1] + db * along * twice[1] + b * bend[1],
        growth[2] - a * once_more[2] + b * twice_more[2] - da * along * once[2] + db * along * twice[2] + b * bend[2],
    )
    return r, g


@kernel()
def vector_slopes(theta, rate, growth):
    """theta' and theta'' from rate and its derivative: the inverse of `body_turn`, by fixed point to rounding (|theta| well below 1)."""
    slope, second = rate, growth
    for _ in range(60):
        r, _g = body_turn(theta, slope, second)
        step = (rate[0] - r[0], rate[1] - r[1], rate[2] - r[2])
        slope = (slope[0] + step[0], slope[1] + step[1], slope[2] + step[2])
        if abs(step[0]) + abs(step[1]) + abs(step[2]) < 1e-16:
            break
    for _ in range(60):
        _r, g = body_turn(theta, slope, second)
        step = (growth[0] - g[0], growth[1] - g[1], growth[2] - g[2])
        second = (second[0] + step[0], second[1] + step[1], second[2] + step[2])
        if abs(step[0]) + abs(step[1]) + abs(step[2]) < 1e-16:
            break
    return slope, second


@kernel()
def quintic(c, i, h, p0, v0, a0, p1, v1, a1):
    """Write at c[i] the six coefficients, in powers of the time from the first knot, of the quintic through two knots h apart."""
    p, v, a = (p1 - p0 - h * (v0 + 0.5 * h * a0)) / (h * h * h), (v1 - v0 - h * a0) / (h * h), (a1 - a0) / h
    c[i], c[i + 1], c[i + 2] = p0, v0, 0.5 * a0
    c[i + 3] = 10 * p - 4 * v + 0.5 * a
    c[i + 4] = (-15 * p + 7 * v - a) / h
    c[i + 5] = (6 * p - 3 * v + 0.5 * a) / (h * h)


@kernel()
def piece(knots, k, h, c):
    """Write the coefficients (36,) of position (18) and rotation vector (18) between knots k and k + 1."""
    q, r = rotation.load4(knots[k], QUATERNION), rotation.load4(knots[k + 1], QUATERNION)
    turned = rotation.product((q[0], -q[1], -q[2], -q[3]), r)
    theta = rotation.logarithm(turned[0], turned[1], turned[2], turned[3])
    slope, second = vector_slopes(theta, rotation.load3(knots[k + 1], RATE), rotation.load3(knots[k + 1], GROWTH))
    for i in range(3):
        a, b = knots[k], knots[k + 1]
        quintic(c, 6 * i, h, a[POSITION + i], a[VELOCITY + i], a[ACCELERATION + i], b[POSITION + i], b[VELOCITY + i], b[ACCELERATION + i])
    quintic(c, 18, h, 0.0, knots[k, RATE], knots[k, GROWTH], theta[0], slope[0], second[0])
    quintic(c, 24, h, 0.0, knots[k, RATE + 1], knots[k, GROWTH + 1], theta[1], slope[1], second[1])
    quintic(c, 30, h, 0.0, knots[k, RATE + 2], knots[k, GROWTH + 2], theta[2], slope[2], second[2])


@kernel()
def polynomial(c, i, s):
    """Value and first two derivatives of the quintic at c[i]."""
    value = c[i] + s * (c[i + 1] + s * (c[i + 2] + s * (c[i + 3] + s * (c[i + 4] + s * c[i + 5]))))
    slope = c[i + 1] + s * (2 * c[i + 2] + s * (3 * c[i + 3] + s * (4 * c[i + 4] + s * 5 * c[i + 5])))
    return value, slope, 2 * c[i + 2] + s * (6 * c[i + 3] + s * (12 * c[i + 4] + s * 20 * c[i + 5]))


@kernel()
def inside(knots, k, c, s, found):
    """Write the state (19,) of a knot, `s` seconds after knot k, from the coefficients of its piece."""
    for i in range(3):
        found[POSITION + i], found[VELOCITY + i], found[ACCELERATION + i] = polynomial(c, 6 * i, s)
    x, dx, ddx = polynomial(c, 18, s)
    y, dy, ddy = polynomial(c, 24, s)
    z, dz, ddz = polynomial(c, 30, s)
    rate, growth = body_turn((x, y, z), (dx, dy, dz), (ddx, ddy, ddz))
    rotation.store3(found, RATE, rate)
    rotation.store3(found, GROWTH, growth)
    q = rotation.product(rotation.load4(knots[k], QUATERNION), rotation.exponential(x, y, z))
    found[QUATERNION], found[QUATERNION + 1], found[QUATERNION + 2], found[QUATERNION + 3] = q


@kernel()
def piece_of(time, begin, h, count):
    """Number of the piece in which a time lies."""
    return min(max(int((time - begin) / h), 0), count - 2)


@kernel()
def states_at(time, begin, h, knots, found):
    """Write the state (times, 19) at times in any order."""
    c, last = np.empty(36), -1
    for j in range(len(time)):
        k = piece_of(time[j], begin, h, len(knots))
        if k != last:
            piece(knots, k, h, c)
            last = k
        inside(knots, k, c, time[j] - (begin + k * h), found[j])


@dataclass(frozen=True, eq=False)
class Dense:
    """The law of motion through `knots` (n, 19), `step` (s) apart from the time `begin` on.

    Columns of a knot: position (3), velocity (3) and acceleration (3) in t, quaternion body to t (4), rate (3) against t and its
    derivative (3) in body axes; SI, rad.
    """

    begin: float
    step: float
    knots: Array

    def __post_init__(self) -> None:
        """Refuse what is no motion."""
        if self.knots.ndim != 2 or self.knots.shape[1] != WIDTH or len(self.knots) < 2 or not np.isfinite(self.knots).all():
            raise InputError("motion", f"has knots of shape {self.knots.shape}", f"two or more rows of {WIDTH} finite numbers")

    @property
    def end(self) -> float:
        """Time (s) of the last knot."""
        return self.begin + self.step * (len(self.knots) - 1)

    def states(self, time: Array) -> Array:
        """Return the state (times, 19) at times (s), columns as those of a knot; raises InputError before the first and after the last."""
        slack = 1e-6 * self.step
        if len(time) and not (self.begin - slack <= np.min(time) and np.max(time) <= self.end + slack):
            raise InputError("trajectory", f"is asked for times {np.min(time)} to {np.max(time)} s", f"it lasts {self.end} s")
        found = np.empty((len(time), WIDTH))
        states_at(np.ascontiguousarray(time, float), self.begin, self.step, self.knots, found)
        return found

    def __call__(self, time: Array) -> Motion:
        """Return the motion at times (s)."""
        from leadline.core.attitude import matrix_from_quaternion

        s = self.states(time)
        place, velocity, acceleration = s[:, POSITION:VELOCITY], s[:, VELOCITY:ACCELERATION], s[:, ACCELERATION:QUATERNION]
        turn = matrix_from_quaternion(s[:, QUATERNION:RATE])
        return Motion(place, velocity, acceleration, turn, s[:, RATE:GROWTH], s[:, GROWTH:])
