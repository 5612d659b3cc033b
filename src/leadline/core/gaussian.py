"""Linear algebra of Gaussian filters on flat row-major matrices with rows of WIDE numbers.  It knows no state and no sensor."""

from __future__ import annotations

import math

from leadline.core.compiled import COMPONENTS, WIDE, kernel


@kernel()
def wrapped(angle):
    """Bring an angle into [-pi, pi)."""
    return angle - 2 * math.pi * math.floor((angle + math.pi) / (2 * math.pi))


@kernel()
def cholesky(A, L, n):
    """A = L L^T for rows of COMPONENTS numbers; false if A is not positive definite."""
    for j in range(n):
        s = A[j * COMPONENTS + j]
        for k in range(j):
            s -= L[j * COMPONENTS + k] * L[j * COMPONENTS + k]
        if not s > 0.0:
            return False
        d = math.sqrt(s)
        L[j * COMPONENTS + j] = d
        for i in range(j + 1, n):
            s = A[i * COMPONENTS + j]
            for k in range(j):
                s -= L[i * COMPONENTS + k] * L[j * COMPONENTS + k]
            L[i * COMPONENTS + j] = s / d
    return True


@kernel()
def whiten(S, L, Y, y, c, n):
    """Y <- L^-1 y and Y <- L^-1 Y in place, with S = L L^T; returns |y|^2, the normalised innovation squared, or nan.

    After it the components are independent with unit variance: the update is a sequence of scalar ones.
    """
    if not cholesky(S, L, c):
        return math.nan
    nis = 0.0
    for i in range(c):
        for k in range(i):
            l = L[i * COMPONENTS + k]
            y[i] -= l * y[k]
            for j in range(n):
                Y[i * WIDE + j] -= l * Y[k * WIDE + j]
        l = 1.0 / L[i * COMPONENTS + i]
        y[i] *= l
        for j in range(n):
            Y[i * WIDE + j] *= l
        nis += y[i] * y[i]
    return nis


@kernel()
def correct(P, Y, y, d, c, n):
    """P <- P - Y^T Y and d = Y^T y, with whitened Y = L^-1 H P and y."""
    w = (n + 7) // 8 * 8
    for j in range(n):
        d[j] = 0.0
    for i in range(c):
        for a in range(n):
            k = Y[i * WIDE + a]
            d[a] += k * y[i]
            for j in range(w):
                P[a * WIDE + j] -= k * Y[i * WIDE + j]


@kernel()
def transpose(A, B, n):
    """B <- A^T in tiles of 4; n a multiple of 4."""
    for j in range(0, n, 4):
        for i in range(0, n, 4):
            for a in range(4):
                for b in range(4):
                    B[(j + a) * WIDE + i + b] = A[(i + b) * WIDE + j + a]


@kernel()
def symmetrise(P, n):
    """P <- (P + P^T) / 2, against the slow growth of rounding errors."""
    for i in range(n):
        for j in range(i):
            P[i * WIDE + j] = P[j * WIDE + i] = 0.5 * (P[i * WIDE + j] + P[j * WIDE + i])
