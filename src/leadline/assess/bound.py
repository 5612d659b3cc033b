"""The Cramér-Rao bound of a state that is driven by noise and seen by sensors, along the truth."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from leadline.data.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import ArrayLike

    from leadline.data.records import Array

    Measurements: TypeAlias = Sequence[tuple[ArrayLike, ArrayLike]]


def bound(initial_covariance: ArrayLike, steps: Iterable[tuple[ArrayLike, ArrayLike, Measurements]]) -> Array:
    """Return the smallest covariance (k, d, d) that an unbiased estimator can reach after each of k steps.

    Information adds, noise takes away:  Y = (A Y^-1 A^T + Q)^-1 + sum H^T R^-1 H  (Tichavsky, Muravchik and Nehorai, 1998, eq. 21,
    with Jacobians at the truth).  It is carried as covariance over the noise and as information over the measurements, so that
    neither Q nor the covariance need be invertible: a parameter without noise and a start that is known exactly are both allowed.

    initial_covariance: (d, d).  steps: (transition A (d, d), process_noise Q (d, d), [(jacobian H (m, d), covariance R (m, m)), ...]).
    Raises InputError where the initial covariance is not finite: give a large number for what is not known.
    """
    covariance = np.array(initial_covariance, float)
    if not np.isfinite(covariance).all():
        raise InputError("initial covariance", "is not finite", "give a large variance for what is not known")
    reached = []
    for transition, process_noise, measurements in steps:
        a = np.asarray(transition, float)
        covariance = informed(a @ covariance @ a.T + np.asarray(process_noise, float), measurements)
        reached.append(covariance)
    return np.array(reached).reshape(-1, *covariance.shape)


def informed(covariance: Array, measurements: Measurements) -> Array:
    """Return (P^-1 + J)^-1 with J = sum H^T R^-1 H, for any P = L L^T, singular or not, as L (1 + L^T J L)^-1 L^T."""
    root = _root(covariance)
    columns = [_whitened(jacobian, noise) @ root for jacobian, noise in measurements]
    information = sum((c.T @ c for c in columns), np.eye(len(root)))
    half = np.linalg.solve(np.linalg.cholesky(information), root.T)
    return np.asarray(half.T @ half)


def _whitened(jacobian: ArrayLike, noise: ArrayLike) -> Array:
    """Return the rows of H in units of their standard deviations."""
    return np.linalg.solve(np.linalg.cholesky(np.atleast_2d(np.asarray(noise, float))), np.atleast_2d(np.asarray(jacobian, float)))


def _root(covariance: Array) -> Array:
    """Return L with L L^T = P, for P positive semidefinite; columns are scaled first, as metres and radians stand side by side."""
    sigma = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    unit = np.where(sigma > 0.0, sigma, 1.0)
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T) / np.outer(unit, unit))
    return np.asarray(unit[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))
