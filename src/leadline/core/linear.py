"""Small dense linear algebra on flat row-major matrices, compiled."""

from __future__ import annotations

from leadline.core.compiled import kernel


@kernel()
def inverse(A, B, n, stride):
    """B <- A^-1 for n x n matrices with rows of `stride` numbers (Gauss-Jordan, pivots by row); A is destroyed; false if it is singular."""
    for i in range(n):
        for j in range(n):
            B[i * stride + j] = 1.0 if i == j else 0.0
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(A[i * stride + k]) > abs(A[pivot * stride + k]):
                pivot = i
        if A[pivot * stride + k] == 0.0:
            return False
        if pivot != k:
            for j in range(n):
                A[k * stride + j], A[pivot * stride + j] = A[pivot * stride + j], A[k * stride + j]
                B[k * stride + j], B[pivot * stride + j] = B[pivot * stride + j], B[k * stride + j]
        scale = 1.0 / A[k * stride + k]
        for j in range(n):
            A[k * stride + j] *= scale
            B[k * stride + j] *= scale
        for i in range(n):
            factor = A[i * stride + k]
            if i != k and factor != 0.0:
                for j in range(n):
                    A[i * stride + j] -= factor * A[k * stride + j]
                    B[i * stride + j] -= factor * B[k * stride + j]
    return True


@kernel()
def congruent(F, A, B, n, m, stride, work):
    """B <- F^T A F for F (n x n, rows of n numbers) that is dense in its first m rows and columns and diagonal beyond.

    A, B and `work` have rows of `stride` numbers; A and B may be the same.
    """
    for i in range(n):
        for j in range(m):
            work[i * stride + j] = 0.0
        for k in range(m):
            a = A[i * stride + k]
            for j in range(m):
                work[i * stride + j] += a * F[k * n + j]
        for j in range(m, n):
            work[i * stride + j] = A[i * stride + j] * F[j * n + j]
    for i in range(m):
        for j in range(n):
            B[i * stride + j] = 0.0
    for k in range(m):
        for i in range(m):
            f = F[k * n + i]
            if f != 0.0:
                for j in range(n):
                    B[i * stride + j] += f * work[k * stride + j]
    for i in range(m, n):
        f = F[i * n + i]
        for j in range(n):
            B[i * stride + j] = f * work[i * stride + j]
