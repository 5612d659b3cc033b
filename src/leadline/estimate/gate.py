"""How a measurement is judged beyond the plain gate: Student's t, a gate that widens, and an estimate that is opened up.

student     noise is Student's t with nu degrees of freedom: R is multiplied by a factor f found from the posterior residual,
            f = (nu + E[e^T R^-1 e]) / (nu + c),  e = z - h(x) after the update   (Piche, Sarkka, Hartikainen 2012, one row at a time)
widening    the gate grows in sigma as 1 + t / T with the time t since the last acceptance
opening     after a run of rejections the estimate is wrong and not the sensor: P <- P + d d^T, with d the correction that the
            measurement asks for, scaled so that H d explains the whole residual; the normalised innovation squared is then about one
"""

from __future__ import annotations

import math

from leadline.core.compiled import COMPONENTS, WIDE, kernel
from leadline.core.gaussian import cholesky
from leadline.estimate.plan import LIMIT, WIDENING

ROUNDS = 6  # of the fixed point of Student's t: its error falls by more than half in each


@kernel()
def limit_of(params, gate, since):
    """Limit of the normalised innovation squared, `since` seconds after the last acceptance (inf: never used)."""
    if not params[gate + WIDENING] > 0.0 or math.isinf(since):
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
def student_factor(R, T, r, dof, scale, c, work):
    """Factor of the noise R (already times `scale`) that Student's t gives a residual r with T = H P H^T; at least nu / (nu + c)."""
    S, L, K = work[0:64], work[64:128], work[128:192]
    e, column = work[192:200], work[200:208]
    factor = 1.0
    for _ in range(ROUNDS):
        for a in range(c):
            for b in range(c):
                S[a * COMPONENTS + b] = T[a * COMPONENTS + b] + factor * scale * R[a, b]
        if not cholesky(S, L, c):
            return 1.0
        # posterior residual e = f R S^-1 r and its covariance T - T S^-1 T: mean of e^T R^-1 e
        for a in range(c):
            e[a] = r[a]
        solve_lower(L, e, c)
        expected = 0.0
        for a in range(c):
            for b in range(c):
                column[b] = T[b * COMPONENTS + a]
            solve_lower(L, column, c)
            for b in range(c):
                K[b * COMPONENTS + a] = column[b]  # L^-1 T
        # with V = L^-1 T: posterior residual r - T S^-1 r = r - V^T e, covariance T - V^T V
        for a in range(c):
            column[a] = r[a]
            for k in range(c):
                column[a] -= K[k * COMPONENTS + a] * e[k]
            for b in range(c):
                s = T[a * COMPONENTS + b]
                for k in range(c):
                    s -= K[k * COMPONENTS + a] * K[k * COMPONENTS + b]
                S[a * COMPONENTS + b] = s
        for a in range(c):
            for b in range(c):
                L[a * COMPONENTS + b] = scale * R[a, b]
        for a in range(c):
            for b in range(c):
                S[a * COMPONENTS + b] += column[a] * column[b]
        if not cholesky(L, K, c):
            return 1.0
        for a in range(c):  # trace of R^-1 (e e^T + covariance)
            for b in range(c):
                e[b] = S[b * COMPONENTS + a]
            solve_lower(K, e, c)
            for k in range(c - 1, -1, -1):
                for j in range(k + 1, c):
                    e[k] -= K[j * COMPONENTS + k] * e[j]
                e[k] /= K[k * COMPONENTS + k]
            expected += e[a]
        factor = (dof + expected) / (dof + c)
    return factor


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
