"""A user's sensor in plain Python: evaluated between the estimator's points and its update, with a numeric Jacobian.

`predict(views, nuisance, row) -> (value, covariance)`: views, one NavigationView per epoch; nuisance (k,) complete; row (length,),
its first numbers measured; value (c,) predicted, covariance (c,) or (c, c) of the measurement's noise.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core.gaussian import wrapped
from leadline.data.errors import InputError
from leadline.data.outcome import Outcome
from leadline.estimate import loop
from leadline.models.view import TANGENT, VIEW_SIZE, NavigationView, retract_view

if TYPE_CHECKING:
    from leadline.data.records import Array
    from leadline.estimate.composition import Composition, Workspace
    from leadline.models.sensor import Channel

STEP = 1e-4  # of the central difference: rounding of a position to 1e-9 m stays below 1e-5 of the slope


def evaluate(composition: Composition, work: Workspace, state: Array, slot: int, row: Array, result: Array) -> int:
    """Ask the sensor at the estimator's points and update; returns the outcome."""
    plan, params = composition.plan, composition.params
    outcome = int(loop.withheld(plan, params, state, slot)) or _looked(composition, work, state, slot, row, result)
    loop.remember(plan, state, slot, outcome)
    return outcome


def _looked(composition: Composition, work: Workspace, state: Array, slot: int, row: Array, result: Array) -> int:
    channel, estimator = composition.slots[slot].channel, composition.estimator
    k = estimator.points(composition.plan, composition.params, state, slot, row, work.work, work.points, work.V, work.N)
    if k == 0:
        return int(Outcome.NO_CLONE)
    work.Hv[:], work.Hn[:], work.R[:] = 0.0, 0.0, 0.0
    own = row[: channel.row_length]
    c = len(channel.components)
    for i in range(k - 1, -1, -1):  # the estimate itself comes last: the noise is that at it
        work.Z[i, :c], work.R[:c, :c] = checked(ask(channel, work.V[i], work.N[i], own), c, composition.slots[slot].sensor)
    if not (np.isfinite(work.Z[0, :c]).all() and np.isfinite(work.R[:c, :c]).all()):
        return int(Outcome.INVALID)
    work.Hv[:c, : TANGENT * channel.epochs], work.Hn[:c, : len(channel.nuisances)] = jacobians(channel, work.V[0], work.N[0], own)
    arrays = (work.Z, work.R, work.Hv, work.Hn, work.work, work.points, work.tape, result)
    return int(estimator.update(composition.plan, composition.params, state, slot, row, *arrays))


def checked(answer: tuple[Array, Array], count: int, sensor: str) -> tuple[Array, Array]:
    """Return value (c,) and covariance (c, c) of an answer; raises InputError where they have other sizes, or no positive variance."""
    value, covariance = answer
    full = np.diag(covariance) if covariance.ndim == 1 else covariance
    if value.shape != (count,) or full.shape != (count, count):
        found = f"predicts {value.shape} with a covariance {covariance.shape}"
        raise InputError(f"sensors.{sensor}.model", found, f"its components ask for ({count},) and ({count},) or ({count}, {count})")
    if not (np.diagonal(full) > 0.0).all() and np.isfinite(full).all():
        raise InputError(f"sensors.{sensor}.model", f"predicts the variances {np.diagonal(full).tolist()}", "they must be positive")
    return value, full


def ask(channel: Channel, views: Array, nuisance: Array, row: Array) -> tuple[Array, Array]:
    """Return the predicted value (c,) and the covariance of a plain-Python channel."""
    seen = tuple(NavigationView(views[VIEW_SIZE * i : VIEW_SIZE * (i + 1)]) for i in range(channel.epochs))
    value, covariance = channel.predict(seen, nuisance[: len(channel.nuisances)], row)
    return np.atleast_1d(np.asarray(value, float)), np.atleast_1d(np.asarray(covariance, float))


def jacobians(channel: Channel, views: Array, nuisance: Array, row: Array) -> tuple[Array, Array]:
    """Return Hv (c, TANGENT epochs) and Hn (c, nuisances) by central differences."""
    count = TANGENT * channel.epochs
    return (
        _differences(channel, count, lambda j, h: ask(channel, _moved(views, j, h), nuisance, row)[0]),
        _differences(channel, len(channel.nuisances), lambda j, h: ask(channel, views, _shifted(nuisance, j, h), row)[0]),
    )


def _differences(channel: Channel, count: int, value: Any) -> Array:
    if not count:
        return np.zeros((len(channel.components), 0))
    columns = np.stack([value(j, STEP) - value(j, -STEP) for j in range(count)], axis=1)
    for i, angle in enumerate(channel.angles):
        if angle:
            columns[i] = [wrapped(v) for v in columns[i]]
    return np.asarray(columns / (2 * STEP))


def _moved(views: Array, j: int, h: float) -> Array:
    moved, d = views.copy(), np.zeros(TANGENT)
    d[j % TANGENT] = h
    retract_view(moved[VIEW_SIZE * (j // TANGENT) : VIEW_SIZE * (j // TANGENT + 1)], d)
    return moved


def _shifted(nuisance: Array, j: int, h: float) -> Array:
    shifted = nuisance.copy()
    shifted[j] += h
    return shifted
