"""Single rotations, compiled.  Quaternions are Hamilton, scalar first, body to navigation; attitude errors are rotation vectors
in the navigation frame, on the left.  Values go in and out as tuples of numbers, so that they stay in registers.
For many rows at once in NumPy see core/attitude.py.
"""

from __future__ import annotations

import math

from leadline.core.compiled import kernel


@kernel()
def matrix(q0, q1, q2, q3):
    """Rotation matrix, row by row, of a unit quaternion."""
    return (1 - 2 * (q2 * q2 + q3 * q3), 2 * (q1 * q2 - q0 * q3), 2 * (q1 * q3 + q0 * q2),
            2 * (q1 * q2 + q0 * q3), 1 - 2 * (q1 * q1 + q3 * q3), 2 * (q2 * q3 - q0 * q1),
            2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), 1 - 2 * (q1 * q1 + q2 * q2))  # fmt: skip


@kernel()
def exponential(a, b, c):
    """Quaternion of the rotation vector (a, b, c): cos(t/2), sin(t/2)/t v.  A series where it is exact in double precision."""
    h = 0.25 * (a * a + b * b + c * c)
    if h < 4e-3:  # the next terms are below 1e-18
        cosine = 1.0 - h * (1 / 2 - h * (1 / 24 - h * (1 / 720 - h * (1 / 40320))))
        s = 0.5 - h * (1 / 12 - h * (1 / 240 - h * (1 / 10080 - h * (1 / 725760))))
        return cosine, s * a, s * b, s * c
    t = math.sqrt(h)
    s = 0.5 * math.sin(t) / t
    return math.cos(t), s * a, s * b, s * c


@kernel()
def product(p, q):
    """Hamilton product p q."""
    p0, p1, p2, p3 = p
    q0, q1, q2, q3 = q
    return (p0 * q0 - p1 * q1 - p2 * q2 - p3 * q3, p0 * q1 + p1 * q0 + p2 * q3 - p3 * q2,
            p0 * q2 - p1 * q3 + p2 * q0 + p3 * q1, p0 * q3 + p1 * q2 - p2 * q1 + p3 * q0)  # fmt: skip


@kernel()
def logarithm(q0, q1, q2, q3):
    """Rotation vector, at most pi long."""
    if q0 < 0.0:
        q0, q1, q2, q3 = -q0, -q1, -q2, -q3
    n = math.sqrt(q1 * q1 + q2 * q2 + q3 * q3)
    s = 2.0 if n < 1e-8 else 2.0 * math.atan2(n, q0) / n
    return s * q1, s * q2, s * q3


@kernel()
def turn(c, a):
    """C a, with C row by row."""
    return (c[0] * a[0] + c[1] * a[1] + c[2] * a[2], c[3] * a[0] + c[4] * a[1] + c[5] * a[2], c[6] * a[0] + c[7] * a[1] + c[8] * a[2])


@kernel()
def turn_back(c, a):
    """C^T a, with C row by row."""
    return (c[0] * a[0] + c[3] * a[1] + c[6] * a[2], c[1] * a[0] + c[4] * a[1] + c[7] * a[2], c[2] * a[0] + c[5] * a[1] + c[8] * a[2])


@kernel()
def cross(a, b):
    """a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel()
def load3(x, i):
    """Three numbers from place i."""
    return x[i], x[i + 1], x[i + 2]


@kernel()
def load4(x, i):
    """Four numbers from place i."""
    return x[i], x[i + 1], x[i + 2], x[i + 3]


@kernel()
def load_matrix(x, i):
    """Rotation matrix of the quaternion at place i."""
    return matrix(x[i], x[i + 1], x[i + 2], x[i + 3])


@kernel()
def store3(x, i, a):
    """Put three numbers at place i."""
    x[i], x[i + 1], x[i + 2] = a


@kernel()
def store_quaternion(x, i, q):
    """Put a quaternion at place i, brought back to unit length."""
    a, b, c, d = q
    square = a * a + b * b + c * c + d * d
    s = 1.5 - 0.5 * square if abs(square - 1.0) < 1e-8 else 1.0 / math.sqrt(square)  # one step of Newton is exact there
    x[i], x[i + 1], x[i + 2], x[i + 3] = a * s, b * s, c * s, d * s
