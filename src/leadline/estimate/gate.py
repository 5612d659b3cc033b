"""How a measurement is judged beyond the plain gate: Student's t, a gate that widens, and an estimate that is opened up.

student     noise is Student's t with nu degrees of freedom: Gaussian with f R, f inverse-gamma.  R is multiplied by the likeliest f,
            max over u = log f of  -log det(T + f R) - r^T (T + f R)^-1 r - nu (u + 1/f);  where T = H P H^T is small against R that is
            (nu + r^T R^-1 r) / (nu + c).  There can be two maxima, the row believed or not: the higher one counts
widening    the gate grows in sigma as 1 + t / T with the time t since the last acceptance
opening     after a run of rejections the estimate is wrong and not the sensor: P <- P + d d^T, with d the correction that the
            measurement asks for, scaled so that H d explains the whole residual; the normalised innovation squared is then about one
"""

from __future__ import annotations

import math

from leadline.core.compiled import COMPONENTS, WIDE, kernel
from leadline.core.gaussian import cholesky
from leadline.estimate.plan import LIMIT, WIDENING

FINEST, COARSE, LARGEST = 1e-3, 0.5, 30.0  # of the logarithm of a factor: how well it is found, steps of the first look, up to where


@kernel()
def limit_of(params, gate, since):
    """Limit of the normalised innovation squared, `since` seconds after the last acceptance or the beginning of the run."""
    if not params[gate + WIDENING] > 0.0:
        return params[gate + LIMIT]
    grown = 1.0 + since / params[gate + WIDENING]
    return params[gate + LIMIT] * grown * grown


@kernel()
def solve_lower(L, b, c):
    """B <- L^-1 b in place, for rows of COMPONENTS numbers."""
    for i in range(c):
        for k in range(i):
            b[i] -= L[i * COMPONENTS + k] * b[k]
        b[i] /= L[i * COMPONENTS + i]


@kernel()
def student_likelihood(u, R, T, r, dof, scale, c, work):
    """Logarithm of the likelihood of the residual with noise exp(u) R, and of u under Student's t (twice, up to a constant)."""
    S, L, e = work[0:64], work[64:128], work[128:136]
    factor = math.exp(u)
    for a in range(c):
        e[a] = r[a]
        for b in range(c):
            S[a * COMPONENTS + b] = T[a * COMPONENTS + b] + factor * scale * R[a, b]
    if not cholesky(S, L, c):
        return -math.inf
    solve_lower(L, e, c)
    total = -dof * (u + 1.0 / factor)
    for a in range(c):
        total -= 2.0 * math.log(L[a * COMPONENTS + a]) + e[a] * e[a]
    return total


@kernel()
def student_factor(R, T, r, dof, scale, c, work):
    """Factor of the noise R (already times `scale`) that is likeliest for a residual r with T = H P H^T: first a look, then by thirds."""
    best, most, u = 0.0, -math.inf, -1.0
    while u <= LARGEST:
        found = student_likelihood(u, R, T, r, dof, scale, c, work)
        if found > most:
            best, most = u, found
        u += COARSE
    low, high = best - COARSE, best + COARSE
    while high - low > FINEST:
        left, right = low + (high - low) / 3.0, high - (high - low) / 3.0
        if student_likelihood(left, R, T, r, dof, scale, c, work) < student_likelihood(right, R, T, r, dof, scale, c, work):
            low = left
        else:
            high = right
    return math.exp(0.5 * (low + high))


@kernel()
def opened(P, H, L, Y, y, nis, d, c, n, e):
    """P <- P + d d^T with d along the correction Y^T y that the whitened residual asks for, so long that it explains the residual."""
    for j in range(n):
        d[j] = 0.0
        for a in range(c):
            d[j] += Y[a * WIDE + j] * y[a]
    for a in range(c):
        e[a] = 0.0
        for j in range(n):
            e[a] += H[a, j] * d[j]
    solve_lower(L, e, c)
    share = 0.0
    for a in range(c):
        share += y[a] * e[a]
    scale = nis / share if share > 1e-12 * nis else 1.0
    for i in range(n):
        for j in range(n):
            P[i * WIDE + j] += scale * scale * (d[i] * d[j])
