"""Sigma points on flat matrices with rows of WIDE numbers: what a function makes of a Gaussian, by its values at points around the mean.

With P = L L^T, points x +- g L_i, g^2 = alpha^2 (n + kappa), and the differences d+ and d- of a function against f(x) at a pair of them:
    D_i = (d+ - d-) / 2 g            s_i = (d+ + d-) / 2           mu = sum s_i / g^2
    mean f(x) + mu      covariance sum D_i D_i^T + sum s_i s_i^T / g^2 + (beta - alpha^2) mu mu^T      with x: sum L_i D_i^T
which is the scaled unscented transform (Julier, 2002; Wan and van der Merwe, 2000) without its large weights of opposite sign;
alpha = 1, beta = kappa = 0 is the cubature rule of third degree (Arasaratnam and Haykin, 2009).  So H = D L^-1 is the slope of a
statistical linearisation, and what the covariance holds beside D D^T is its error: both go where a Jacobian and its noise would go.
"""

from __future__ import annotations

import math

from leadline.core.compiled import WIDE, kernel

NEGLIGIBLE = 1e-12  # of a variance: what is left of it beside the columns before is taken for rounding


@kernel()
def root(P, L, n):
    """L <- lower triangular root of P (n x n); a direction of which nothing is left has a column of zeros.  False where P is indefinite."""
    W = WIDE
    definite = True
    for j in range(n):
        d = P[j * W + j]
        for k in range(j):
            d -= L[j * W + k] * L[j * W + k]
        if d < -1e-6 * abs(P[j * W + j]):
            definite = False
        keep = d > NEGLIGIBLE * P[j * W + j]
        d = math.sqrt(d) if keep else 0.0
        for i in range(j):
            L[i * W + j] = 0.0
        L[j * W + j] = d
        for i in range(j + 1, n):
            s = 0.0
            if keep:
                s = P[i * W + j]
                for k in range(j):
                    s -= L[i * W + k] * L[j * W + k]
                s /= d
            L[i * W + j] = s
    return definite


@kernel()
def solve_right(D, L, H, c, n):
    """H <- D L^-1 for c rows of WIDE numbers; a column of L that is zero says nothing, and neither does H there."""
    W = WIDE
    for a in range(c):
        for j in range(n - 1, -1, -1):
            s = 0.0
            if L[j * W + j] > 0.0:
                s = D[a * W + j]
                for k in range(j + 1, n):
                    s -= H[a * W + k] * L[k * W + j]
                s /= L[j * W + j]
            H[a * W + j] = s


@kernel()
def lower(A, n, m, stride):
    """Bring A (n x m, rows of `stride` numbers, m >= n) to lower triangular form by reflections of its columns: A A^T stays.

    The diagonal comes out not negative.  Source: Golub and Van Loan (2013), section 5.2, on the transpose.
    """
    for i in range(n):
        row = i * stride
        square = 0.0
        for k in range(i + 1, m):
            square += A[row + k] * A[row + k]
        head = A[row + i]
        if square > 0.0:
            length = math.sqrt(head * head + square)
            v = head - length if head <= 0.0 else -square / (head + length)
            scale = 2.0 * v * v / (square + v * v)
            A[row + i] = length
            for r in range(i + 1, n):
                s = A[r * stride + i]
                for k in range(i + 1, m):
                    s += A[r * stride + k] * A[row + k] / v
                s *= scale
                A[r * stride + i] -= s
                for k in range(i + 1, m):
                    A[r * stride + k] -= s * A[row + k] / v
            for k in range(i + 1, m):
                A[row + k] = 0.0
        elif head < 0.0:
            for r in range(i, n):
                A[r * stride + i] = -A[r * stride + i]
