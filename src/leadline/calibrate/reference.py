"""What a log is held against when an instrument is calibrated: fixes that the vehicle file names, a table of fixes, or truth."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from leadline.data.errors import InputError
from leadline.data.records import Gnss, PositionFix, Truth
from leadline.data.vehicle import Gate, SensorConfig

if TYPE_CHECKING:
    from leadline.data.log import Log
    from leadline.data.records import Array, Table
    from leadline.data.vehicle import Vehicle

NAME = "reference"
EVERY = 20.0  # s between rows of truth that are used: its errors are correlated
SIGMA = 1.0  # m, of a reference that states none
KINDS = ("gnss", "position_fix")


def referenced(log: Log, vehicle: Vehicle, reference: str, fixes: Table | None = None) -> tuple[Log, Vehicle]:
    """Return a log and a vehicle that aid with a reference: "fixes" of the vehicle file, "ends" or "truth" of the log's truth, or a table.

    "ends" takes the first and the last row of truth alone.  Raises InputError where the log has no such reference.
    """
    where = f"{log.path or log.name}"
    if fixes is not None:
        return _with(log, vehicle, fixes)
    if reference == "fixes":
        known = [n for n, c in vehicle.sensors.items() if c.kind in KINDS and len(log.tables.get(n, ())) >= 2]
        if not known:
            raise InputError(
                where, "has no gnss or position_fix that the vehicle file names with two rows", "give --reference truth or a FILE"
            )
        return log, vehicle
    if reference not in ("truth", "ends"):
        raise InputError("reference", f"'{reference}' is not known", "give fixes, truth, ends, or a table of fixes")
    truth = log.truth
    if truth is None:
        raise InputError(where, "has no table of kind truth", "give --reference fixes or a FILE")
    return _with(log, vehicle, _of_truth(truth, ends=reference == "ends"))


def _of_truth(truth: Truth, *, ends: bool) -> PositionFix:
    """Rows of truth as fixes: the first and the last, or one in `EVERY` seconds."""
    known = np.flatnonzero(np.isfinite(truth.time) & _known(truth))
    known = known[np.argsort(truth.time[known], kind="stable")]
    if truth.outlier is not None:
        known = known[np.nan_to_num(truth.outlier[known]) == 0]
    slot = np.floor((truth.time[known] - truth.time[known[0]]) / EVERY) if len(known) else np.zeros(0)
    chosen = known[[0, -1]] if ends and len(known) > 1 else known[np.unique(slot, return_index=True)[1]]
    part = truth.select(chosen)
    assert isinstance(part, Truth)
    sigma = np.full(len(part), SIGMA) if part.sigma is None else np.where(np.isfinite(part.sigma), part.sigma, SIGMA)
    return PositionFix(
        time=part.time, latitude=part.latitude, longitude=part.longitude, north=part.north, east=part.east, sigma=np.maximum(sigma, 0.01)
    )


def _known(truth: Truth) -> Array:
    first, second = (truth.latitude, truth.longitude) if truth.latitude is not None else (truth.north, truth.east)
    if first is None or second is None:
        raise InputError("truth", "has no position", "give latitude_deg and longitude_deg, or north_m and east_m")
    return np.asarray(np.isfinite(first) & np.isfinite(second))


def _with(log: Log, vehicle: Vehicle, fixes: Table) -> tuple[Log, Vehicle]:
    if not isinstance(fixes, PositionFix | Gnss) or len(fixes) < 2:
        raise InputError(
            NAME, f"is a table of kind '{fixes.kind}' with {len(fixes)} rows", "give at least two fixes, as gnss or position_fix"
        )
    values = {"sigma": SIGMA, "vertical": False}
    config = SensorConfig(NAME, fixes.kind, gate=Gate(0.999999), values=values)
    others = {n: c for n, c in vehicle.sensors.items() if c.kind not in KINDS}
    return replace(log, tables={**log.tables, NAME: fixes}), replace(vehicle, sensors={**others, NAME: config})
