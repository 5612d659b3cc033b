"""Roots, triangular forms and slopes (core/sigma.py), random numbers (core/random.py) and weights (core/particles.py), against NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import chi2, kstest, norm

from leadline.core.compiled import WIDE
from leadline.core.particles import normalise, resample
from leadline.core.random import fill_normal, normal_pair, uniform
from leadline.core.sigma import lower, root, solve_right

EPS = np.finfo(float).eps


def flat(matrix: np.ndarray, stride: int = WIDE) -> np.ndarray:
    """A matrix in rows of `stride` numbers, with something else behind each row."""
    full = np.full((len(matrix) + 1, stride), 7.0)
    full[: len(matrix), : matrix.shape[1]] = matrix
    return full.ravel()


def definite(n: int, decades: float, seed: int) -> np.ndarray:
    """A covariance whose sigmas span so many decades."""
    generator = np.random.default_rng(seed)
    sigma = 10.0 ** np.linspace(0.0, decades, n)[generator.permutation(n)]
    A = np.linalg.qr(generator.standard_normal((n, n)))[0]
    C = A @ np.diag(np.linspace(0.2, 2.0, n)) @ A.T
    return sigma[:, None] * C * sigma


@pytest.mark.parametrize("n", [1, 2, 9, 17, 48])
@pytest.mark.parametrize("decades", [0.0, 8.0])
def test_root_is_choleskys(n: int, decades: float) -> None:
    """Row by row to rounding, whatever the units: a root scales with its rows."""
    P = definite(n, decades, n)
    L = np.full(WIDE * (WIDE + 1), np.nan)
    assert root(flat(P), L, n)
    found = np.tril(L[: n * WIDE].reshape(n, WIDE)[:, :n])
    sigma = np.sqrt(np.diag(P))
    assert_allclose(found / sigma[:, None], np.linalg.cholesky(P) / sigma[:, None], atol=20 * n * EPS * 10.0)  # condition of C: 10


@pytest.mark.parametrize("rank", [1, 4, 8])
def test_root_of_a_semidefinite_matrix(rank: int) -> None:
    """L L^T is the matrix, a state without error has a row and a column of zeros, and no more columns are left than its rank."""
    generator = np.random.default_rng(rank)
    half = generator.standard_normal((9, rank))
    half[3] = 0.0
    P, L = half @ half.T, np.zeros(WIDE * WIDE)
    assert root(flat(P), L, 9)
    found = np.tril(L.reshape(WIDE, WIDE)[:9, :9])
    assert np.abs(found @ found.T - P).max() < 1e-11 * np.abs(P).max()  # NEGLIGIBLE of a variance may be dropped in each direction
    assert not found[:, 3].any()
    assert np.count_nonzero(found.any(axis=0)) == min(rank, 8)


def test_root_of_an_indefinite_matrix() -> None:
    """It is told."""
    P = np.diag([1.0, 2.0, -0.5])
    assert not root(flat(P), np.zeros(WIDE * WIDE), 3)
    assert not root(flat(np.array([[1.0, 1.1], [1.1, 1.0]])), np.zeros(WIDE * WIDE), 2)


@pytest.mark.parametrize(("n", "m"), [(1, 1), (3, 3), (5, 12), (17, 49), (48, 144)])
@pytest.mark.parametrize("spread", [0.0, 8.0])
def test_lower_is_the_triangle_of_qr(n: int, m: int, spread: float) -> None:
    """That of NumPy on the transpose, with signs such that the diagonal is not negative; rows may differ by eight decades."""
    generator = np.random.default_rng(n * m)
    A = generator.standard_normal((n, m)) * 10.0 ** np.linspace(0.0, spread, n)[:, None]
    stride = m + 3
    work = flat(A, stride)
    lower(work, n, m, stride)
    found = work.reshape(-1, stride)[:n, :n]
    R = np.linalg.qr(A.T, mode="r")
    expected = (R * np.sign(np.diag(R))[:, None]).T
    size = np.linalg.norm(A, axis=1)[:, None]
    condition = np.linalg.cond(A / size)
    assert (np.diag(found) >= 0.0).all()
    assert_allclose(np.tril(found) / size, expected / size, atol=10 * m * condition * EPS)
    assert_allclose(np.tril(found) @ np.tril(found).T / (size * size.T), A @ A.T / (size * size.T), atol=10 * m * EPS)


def test_lower_of_what_is_not_of_full_rank() -> None:
    """A direction that is twice the same, and an empty row, leave zeros and no NaN."""
    A = np.array([[1.0, 2.0, 3.0, 4.0], [2.0, 4.0, 6.0, 8.0], [0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 1.0]])
    work = flat(A, 6)
    lower(work, 4, 4, 6)
    found = np.tril(work.reshape(-1, 6)[:4, :4])
    assert_allclose(found @ found.T, A @ A.T, atol=1e-13)
    assert (np.diag(found) >= 0.0).all()


def test_slope_of_what_is_linear() -> None:
    """D = H L gives H back, but for the column of a state without error."""
    generator = np.random.default_rng(3)
    H, P = generator.standard_normal((4, 6)), definite(6, 2.0, 6)
    P[2, :] = P[:, 2] = 0.0
    L = np.zeros(WIDE * WIDE)
    assert root(flat(P), L, 6)
    tri = np.tril(L.reshape(WIDE, WIDE)[:6, :6])
    D, found = np.zeros((8, WIDE)), np.zeros(8 * WIDE)
    D[:4, :6] = H @ tri
    solve_right(D.ravel(), L, found, 4, 6)
    got = found.reshape(8, WIDE)[:4, :6]
    expected = H.copy()
    expected[:, 2] = 0.0
    assert_allclose(got, expected, rtol=1e-10, atol=1e-12)


def test_uniform_numbers() -> None:
    """Over counters and over indices: uniform (Kolmogorov and Smirnov at 0.1 %), within (0, 1), neighbours unrelated, high and low bits."""
    n = 20_000
    key = np.uint64(12345)
    by_counter = np.array([uniform(key, np.uint64(c), np.uint64(3)) for c in range(n)])
    by_index = np.array([uniform(key, np.uint64(3), np.uint64(i)) for i in range(n)])
    by_key = np.array([uniform(np.uint64(k), np.uint64(3), np.uint64(3)) for k in range(n)])
    for drawn in (by_counter, by_index, by_key):
        assert drawn.min() > 0.0
        assert drawn.max() < 1.0
        assert kstest(drawn, "uniform").pvalue > 1e-3
        for lag in (1, 2, 7):
            assert abs(np.corrcoef(drawn[lag:], drawn[:-lag])[0, 1]) < norm.ppf(1 - 5e-4) / np.sqrt(n)
        pairs, _, _ = np.histogram2d(drawn[1:], drawn[:-1], bins=16, range=((0, 1), (0, 1)))
        assert ((pairs - (n - 1) / 256) ** 2 / ((n - 1) / 256)).sum() < chi2.ppf(0.999, 255)
        assert kstest(drawn * 4096 % 1.0, "uniform").pvalue > 1e-3  # bits further down
    for one, other in ((by_counter, by_index), (by_index, by_key), (by_counter, by_key)):
        keep = np.arange(n) != 3
        assert abs(np.corrcoef(one[keep], other[keep])[0, 1]) < norm.ppf(1 - 5e-4) / np.sqrt(n)


def test_counter_and_index_are_not_one_number() -> None:
    """On a square of counters and indices no number comes twice, along diagonals neither."""
    grid = np.array([[uniform(np.uint64(1), np.uint64(c), np.uint64(i)) for i in range(128)] for c in range(128)])
    assert len(np.unique(grid)) == grid.size
    assert np.abs(np.corrcoef(grid) - np.eye(128)).max() < norm.ppf(1 - 1e-3 / 128**2) / np.sqrt(128)


def test_normal_numbers() -> None:
    """Normal, in pairs that are independent; a row of them has no relation with that of the next index or counter, and comes again."""
    key, n = np.uint64(99), 4000
    pairs = np.array([normal_pair(key, np.uint64(c), np.uint64(0)) for c in range(n)])
    for column in pairs.T:
        assert kstest(column, "norm").pvalue > 1e-3
    assert abs(np.corrcoef(pairs.T)[0, 1]) < norm.ppf(1 - 5e-4) / np.sqrt(n)
    assert abs(np.corrcoef(pairs.T**2)[0, 1]) < norm.ppf(1 - 5e-4) / np.sqrt(n)
    rows = np.zeros((3000, 9))
    out = np.full(12, 5.0)
    for i in range(len(rows)):
        fill_normal(key, np.uint64(7), np.uint64(i), out, 9)
        rows[i] = out[:9]
    assert (out[9:] == 5.0).all()  # nothing beyond what was asked for
    assert kstest(rows.ravel(), "norm").pvalue > 1e-3
    related = np.corrcoef(np.hstack([rows[:-1], rows[1:]]).T) - np.eye(18)
    assert np.abs(related).max() < norm.ppf(1 - 1e-3 / 18**2) / np.sqrt(2999)
    again = np.zeros(12)
    fill_normal(key, np.uint64(7), np.uint64(2999), again, 9)
    assert_array_equal(again[:9], rows[-1])


def test_weights() -> None:
    """A sum of one, and the effective number 1 / sum w^2, however small the likelihoods; nothing where none is left."""
    generator = np.random.default_rng(0)
    logs = generator.normal(size=500) * 5.0 - 4000.0
    expected = np.exp(logs - logs.max())
    expected /= expected.sum()
    effective = normalise(logs)
    assert_allclose(np.exp(logs).sum(), 1.0, rtol=1e-13)
    assert_allclose(np.exp(logs), expected, rtol=1e-10)
    assert_allclose(effective, 1.0 / (expected**2).sum(), rtol=1e-10)
    assert normalise(np.full(4, -np.inf)) == 0.0


def test_resampling_counts() -> None:
    """Every particle is copied floor or ceil of N w times, on average over u N w times (99.9 % of the binomial bound), weights equal."""
    generator = np.random.default_rng(5)
    n, draws = 50, 2000
    w = generator.random(n) ** 4
    w /= w.sum()
    total = np.zeros(n)
    for u in (np.arange(draws) + 0.5) / draws:
        logs, rows = np.log(w), np.column_stack([np.arange(n, dtype=float), np.arange(n) * 10.0])
        resample(logs, rows, u)
        counts = np.bincount(rows[:, 0].astype(int), minlength=n)
        assert (counts >= np.floor(n * w - 1e-9)).all()
        assert (counts <= np.ceil(n * w + 1e-9)).all()
        assert_array_equal(rows[:, 1], 10.0 * rows[:, 0])  # rows stay whole
        assert_allclose(np.exp(logs), 1.0 / n, rtol=1e-12)
        total += counts
    # over a regular grid of u the mean count is N w to within two grid steps per boundary
    assert_allclose(total / draws, n * w, atol=2.0 / draws + 1e-9)
