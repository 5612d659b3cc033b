"""The contract of a sensor model, as values: what a sensor is to the navigation loop.

A sensor file offers `compose(config, context) -> Sensor`.  A sensor measures through one or more channels; a channel is one
function `predict(views, nuisance, row, parameters) -> value, covariance, Jacobian per view, Jacobian for nuisances, outcome`, and
`read` turns the sensor's table into flat rows whose first numbers are the measured values.  A measured pose is the origin of its
own tangent space: its measured value is zero, the predicted value the offset from it.

A channel sees views, never a state vector; its nuisances are always complete, whether estimated or constant.  With two epochs the
first view is at the row's time, the second at its `earlier` epoch.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from leadline.core import geodesy
from leadline.data.errors import InputError
from leadline.data.outcome import Outcome
from leadline.data.rows import complete
from leadline.models.nuisance import AXES, Nuisance

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from datetime import datetime

    from leadline.data.log import Beacon, Log, Origin
    from leadline.data.records import Array, Table
    from leadline.data.vehicle import Prior, SensorConfig, Vehicle


@dataclass(frozen=True)
class Context:
    """What a sensor must know beside its own configuration."""

    reference_b: Array = field(default_factory=lambda: np.zeros(3))  # the process model's reference point, from the body origin (m)
    surface: float = 0.0  # height of the mean water surface above the ellipsoid (m)
    origin: Origin | None = None
    beacons: Mapping[str, Beacon] = field(default_factory=dict)
    shared: Mapping[str, Prior] = field(default_factory=dict)  # priors of what is no instrument's own: water.current, seabed.depth
    date: datetime | None = None  # of time zero

    @classmethod
    def of(cls, log: Log, vehicle: Vehicle, reference_b: Array | None = None) -> Context:
        """Return the context of a log solved with a vehicle; reference_b: the point that its process model moves, else the body origin."""
        reference = np.zeros(3) if reference_b is None else reference_b
        return cls(reference, log.datum.geoid_undulation, log.origin, log.beacons, vehicle.shared, log.epoch)

    def lever(self, config: SensorConfig) -> Array:
        """Return a sensor's lever arm counted from the reference point, body axes (3,), m."""
        return config.lever_arm_b - self.reference_b

    def position_e(self, latitude: Array, longitude: Array, depth: Array) -> Array:
        """Return Earth-fixed positions (n, 3) of points at a depth below the surface."""
        return geodesy.ecef_from_geodetic(latitude, longitude, self.surface - depth)

    def geographic(self, north: Array, east: Array, where: str) -> tuple[Array, Array]:
        """Return latitude and longitude of metres from the origin; raises InputError without an origin."""
        if self.origin is None:
            raise InputError(where, "gives north and east, but the log has no origin", "add origin to log.toml")
        return geodesy.from_north_east(north, east, self.origin.latitude, self.origin.longitude)


@dataclass(frozen=True)
class Channel:
    """One way in which a sensor measures."""

    components: tuple[str, ...]
    predict: Callable[..., Any]  # a kernel of the signature SENSOR, or plain Python: (views, nuisance, row) -> value, covariance
    parameters: Array
    row_length: int
    nuisances: tuple[Nuisance, ...] = ()
    angles: tuple[bool, ...] = ()  # which components are angles; empty: none
    epochs: int = 1
    requires: frozenset[str] = frozenset()  # what the process model must define, as in models/view.py
    displacing: Mapping[str, tuple[Nuisance, ...]] = field(default_factory=dict)  # time, offset, drift, lever: filled in by `displaced`
    linear: bool = False  # whether it is linear in the state of a model of the plane
    bounds_drift: bool = False  # whether it holds the horizontal position error (a velocity over ground, a position, a range)


@dataclass(frozen=True)
class Rows:
    """Rows of one channel: index into the table (k,), data (k, row_length), and the earlier epoch (k,) where there is one."""

    channel: int
    row: npt.NDArray[np.int64]
    data: Array
    earlier: Array | None = None


@dataclass(frozen=True)
class Reading:
    """What a sensor makes of a table: rows by channel, and for each table row why it gave none (USED where it did)."""

    rows: tuple[Rows, ...]
    outcome: npt.NDArray[np.int64]


@dataclass(frozen=True)
class Sensor:
    """A sensor instance, composed."""

    config: SensorConfig
    channels: tuple[Channel, ...]
    read: Callable[[Any], Reading]  # of a table of the sensor's kind
    feed: Callable[[Any], Array] | None = None  # makes inputs (n, INPUTS) of a table, nan where a row says nothing
    flight: float = 0.0  # the longest time between two epochs of a row (s)
    before: float = 0.0  # how far back `read` must see earlier rows of the table, to make of the last one what the whole table makes (s)


def reading(table: Table, *rows: Rows, outcome: npt.NDArray[np.int64] | None = None) -> Reading:
    """Return a reading in which table rows that gave no channel a row, and have no outcome yet, are INVALID."""
    result = np.full(len(table), int(Outcome.USED)) if outcome is None else outcome.copy()
    reached = np.zeros(len(table), bool)
    for part in rows:
        reached[part.row] = True
    result[~reached & (result == Outcome.USED)] = Outcome.INVALID
    return Reading(rows, result)


def finite_rows(channel: int, data: Array, keep: npt.NDArray[np.bool_] | None = None, earlier: Array | None = None) -> Rows:
    """Return the rows of `data` (n, row_length) that are all finite (and kept) as rows of a channel."""
    good = complete(data)
    if keep is not None:
        good &= keep
    if earlier is not None:
        good &= np.isfinite(earlier)
    index = np.flatnonzero(good)
    return Rows(channel, index, np.ascontiguousarray(data[index]), None if earlier is None else earlier[index])


def usable(table: Table) -> npt.NDArray[np.bool_]:
    """Return which rows the sensor itself calls valid (all, where it says nothing)."""
    return np.ones(len(table), bool) if table.valid is None else np.nan_to_num(table.valid) != 0


def filled(column: Array | None, default: float, count: int) -> Array:
    """Return a column, with the default where it is absent or not a number."""
    if column is None:
        return np.full(count, default)
    return np.where(np.isfinite(column), column, default)


def sigmas(column: Array | None, default: float, count: int) -> Array:
    """Return a column of sigmas, with the default where it is absent; one that is not positive makes its row unusable (nan)."""
    found = filled(column, default, count)
    return np.where(found > 0.0, found, np.nan)


def displaced(sensor: Sensor, context: Context) -> Sensor:
    """Return a sensor whose channels know what displaces their views: the priors of its lever arm, its time stamps and its clock."""
    config, priors = sensor.config, sensor.config.nuisance
    found = {name: nuisances(config, name, axes, unit) for name, axes, unit in (("time", 1, "s"), ("lever", 3, "m")) if name in priors}
    for name, unit in (("offset", "s"), ("drift", "1")):
        if (prior := context.shared.get(f"clocks.{config.clock}.{name}")) is not None:
            found[name] = nuisances_of(prior, f"clocks.{config.clock}.{name}", 1, unit)
    if not found:
        return sensor
    return replace(sensor, channels=tuple(replace(channel, displacing=found) for channel in sensor.channels))


def nuisances(config: SensorConfig, name: str, axes: int, unit: str, frame: str = "") -> tuple[Nuisance, ...]:
    """Return one nuisance of a sensor, per axis, keyed by instance; without a prior it is a constant zero."""
    return nuisances_of(config.nuisance.get(name), f"{config.name}.{name}", axes, unit, frame)


def shared_nuisances(context: Context, name: str, axes: int, unit: str, frame: str = "") -> tuple[Nuisance, ...]:
    """Return a nuisance that several sensors share (water.current, seabed.depth), per axis; without a prior it is a constant zero."""
    return nuisances_of(context.shared.get(name), name, axes, unit, frame)


def nuisances_of(prior: Prior | None, name: str, axes: int, unit: str, frame: str = "") -> tuple[Nuisance, ...]:
    """Return the nuisances of a prior, per axis."""
    if prior is None:
        return tuple(Nuisance(f"{name}{axis}", unit=unit, frame=frame) for axis in AXES[axes])
    made = []
    for axis, value, s in zip(AXES[axes], np.broadcast_to(prior.value, axes), np.broadcast_to(prior.sigma, axes), strict=True):
        if prior.estimate:
            steady = float(s) if prior.steady is None else prior.steady
            law = {"sigma": float(s), "tau": prior.tau, "steady": steady, "walk": prior.walk, "length": prior.length}
        else:
            law = {"considered": float(s)}
        made.append(Nuisance(f"{name}{axis}", float(value), unit=unit, frame=frame, **law))
    return tuple(made)
