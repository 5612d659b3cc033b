"""Faults of what is measured by sound: beams that die, a lock on what is not the ground, echoes taken for the direct arrival."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core.attitude import matrix_from_euler, matrix_from_quaternion, quaternion_from_euler
from leadline.data import records
from leadline.simulate.faults import OfSome, OfSpan, marked
from leadline.simulate.instrument import ZERO, Vector
from leadline.simulate.instruments import beam_vectors
from leadline.simulate.usbl import angles, direction
from leadline.simulate.vectors import cross, turned_back

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.log import Log
    from leadline.data.records import Array, Table
    from leadline.simulate.faults import Flags

SOLVABLE = 3  # beams from which a velocity can be solved


@dataclass(frozen=True, kw_only=True)
class BeamLoss(OfSpan):
    """Beams of a Doppler log, counted from 1, that are dead for a while: not valid, empty, without range and correlation.

    A velocity beside the beams, and its error velocity, live on: with three beams there is no error velocity, with fewer no velocity.
    The row is not valid once there is no velocity, or where there was none, once no beam is left.  A log of beams is needed.
    """

    beams: tuple[int, ...]

    def changed(self, table: Table, generator: Generator) -> Table:  # noqa: ARG002  (draws nothing)
        """Return the table with dead beams."""
        if not isinstance(table, records.Dvl) or table.beam is None:
            raise self.refused(f"its table is of kind {table.kind}, or has no beams", "a Doppler log with beams")
        count = table.beam.shape[1]
        if not self.beams or not set(self.beams) <= set(range(1, count + 1)):
            raise self.refused(f"has beams {list(self.beams)}", f"some of 1 to {count}")
        struck = self.inside(table.time)
        dead = struck[:, None] & np.isin(np.arange(1, count + 1), self.beams)
        before = np.isfinite(table.beam).astype(float) if table.beam_valid is None else table.beam_valid
        heard = np.where(dead, 0.0, before)
        columns: dict[str, Any] = {"beam": np.where(dead, np.nan, table.beam), "beam_valid": heard}
        for name in ("range", "beam_correlation"):
            values = getattr(table, name)
            columns[name] = None if values is None else np.where(dead, np.nan, values)
        left = np.count_nonzero(heard > 0.0, axis=1)
        valid = np.ones(len(table)) if table.valid is None else table.valid
        columns["valid"] = np.where(struck & (left < (1 if table.velocity is None else SOLVABLE)), 0.0, valid)
        return replace(table, **columns, **_unsolved(table, struck & (left < SOLVABLE), struck & (left <= SOLVABLE)))


def _unsolved(table: records.Dvl, fewer: Flags, no_more: Flags) -> dict[str, Any]:
    """Return what is solved from the beams of a table, empty in rows with fewer than three of them, and with no more than three."""
    columns: dict[str, Any] = {}
    if table.velocity is not None:
        columns["velocity"] = np.where(fewer[:, None], np.nan, table.velocity)
    if table.error_velocity is not None:
        columns["error_velocity"] = np.where(no_more, np.nan, table.error_velocity)
    return columns


@dataclass(frozen=True, kw_only=True)
class FalseLock(OfSpan):
    """A Doppler log that is locked on a layer in the water, believes that it is the ground, and says that all is well.

    Reported is (1 + scale) (v - R_bs^T R_nb^T c), along beams its component, with v the velocity over ground that it would have reported
    and c = `layer_n` the velocity of the layer over ground (north, east, m/s); altitudes and ranges are `share` times those of the ground.
    The attitude R_nb is that of the log's truth; `mounting_bs` (roll, pitch, heading), `azimuths` and `tilt` of the beams (rad) are those
    of the instrument.  Rows that it did not measure stay empty.  Raises InputError where the layer moves and the log has no attitude in
    its truth, or where there are beams of which no azimuth is known.
    """

    layer_n: tuple[float, float] = (0.0, 0.0)
    scale: float = 0.0
    share: float = 1.0
    mounting_bs: Vector = ZERO
    azimuths: tuple[float, ...] = ()
    tilt: float = 0.0

    def apply(self, log: Log, generator: Generator) -> Log:
        """Return the log with a table of the layer."""
        if any(self.layer_n):
            log = replace(log, tables={**log.tables, self.sensor: self._drifting(log)})
        return super().apply(log, generator)

    def changed(self, table: Table, generator: Generator) -> Table:  # noqa: ARG002  (draws nothing)
        """Return the table with scaled velocities and short altitudes."""
        table, rows = self._doppler(table), self.inside(table.time)
        factors = {"velocity": 1.0 + self.scale, "beam": 1.0 + self.scale, "altitude": self.share, "range": self.share}
        columns: dict[str, Any] = {name: times(getattr(table, name), rows, factor) for name, factor in factors.items()}
        return replace(table, **columns)

    def _doppler(self, table: Table) -> records.Dvl:
        if not isinstance(table, records.Dvl):
            raise self.refused(f"its table is of kind {table.kind}", "a Doppler log")
        if not 0.0 < self.share <= 1.0:
            raise self.refused(f"has the layer at {self.share} of the altitude", "a share above 0, and up to 1")
        return table

    def _drifting(self, log: Log) -> records.Dvl:
        table, truth = self._doppler(log[self.sensor]), log.truth
        if truth is None or truth.roll is None or truth.pitch is None or truth.heading is None:
            raise self.refused("locks on a layer that moves, in a log whose truth has no attitude", "a log with it, or layer_n of zeros")
        if table.beam is not None and len(self.azimuths) != table.beam.shape[1]:
            raise self.refused(f"knows {len(self.azimuths)} azimuths", f"one for each of {table.beam.shape[1]} beams")
        rows = self.inside(table.time)
        flow_n = np.tile([*self.layer_n, 0.0], (len(table), 1))
        flow_b = turned_back(attitude_at(truth, table.time), flow_n)
        flow_s = flow_b @ matrix_from_euler(*self.mounting_bs)
        columns: dict[str, Any] = {}
        if table.velocity is not None:
            frame = np.full((len(table), 1), "sensor") if table.frame is None else table.frame[:, None]
            flow = np.where(frame == "ned", flow_n, np.where(frame == "body", flow_b, flow_s))
            columns["velocity"] = np.where(rows[:, None], table.velocity - flow, table.velocity)
        if table.beam is not None:
            along = flow_s @ beam_vectors(self.azimuths, self.tilt).T
            columns["beam"] = np.where(rows[:, None], table.beam - along, table.beam)
        return replace(table, **columns)


def times(values: Array | None, rows: Flags, factor: float) -> Array | None:
    """Return values multiplied by a factor in some rows; None stays None, and the other rows keep their bits."""
    return None if values is None else np.where(rows.reshape(-1, *[1] * (values.ndim - 1)), factor * values, values)


def attitude_at(truth: records.Truth, time: Array) -> Array:
    """Return rotations (times, 3, 3) from body to north-east-down of a table of truth that has them, between its rows by quaternions."""
    order = np.argsort(truth.time, kind="stable")
    knots = quaternion_from_euler(truth.roll, truth.pitch, truth.heading)[order]  # type: ignore[arg-type]
    turned_over = np.sum(knots[1:] * knots[:-1], axis=1) < 0.0  # q and -q are one rotation: next to each other take those that are near
    knots[1:] *= np.where(np.cumsum(turned_over) % 2 == 1, -1.0, 1.0)[:, None]
    between = np.stack([np.interp(time, truth.time[order], column) for column in knots.T], axis=1)
    return matrix_from_quaternion(between / np.linalg.norm(between, axis=1, keepdims=True))


@dataclass(frozen=True, kw_only=True)
class LateEchoes(OfSome):
    """Ranges of an echo: the way of the sound is longer, so that the range reads U(low, high) m more; column `outlier` marks them.

    One way the arrival is later by size / sound_speed, two ways by twice that: so are `time`, and `received` where it is known.
    """

    low: float
    high: float
    sound_speed: float = 1500.0

    def changed(self, table: Table, generator: Generator) -> Table:
        """Return the table with some ranges too long."""
        if not isinstance(table, records.AcousticRange) or (table.range is None and table.travel_time is None):
            raise self.refused(f"its table is of kind {table.kind}, or has no ranges", "a sensor with acoustic ranges")
        if not 0.0 <= self.low <= self.high:
            raise self.refused(f"is longer by {self.low} to {self.high} m", "0 <= low <= high")
        wild = self.chosen(table, generator)
        size = generator.uniform(self.low, self.high, len(table)) * wild
        return replace(table, **lengthened(table, size, self.sound_speed), extra=marked(table, wild))


@dataclass(frozen=True, kw_only=True)
class WildPings(OfSome):
    """Directions that are off by U(angle_low, angle_high) rad across any way, and ranges longer by U(low, high) m, as those of LateEchoes.

    Column `outlier` marks them.  For tables with azimuth and elevation; of positions that a ship solved, see WildFixes.
    """

    angle_low: float = 0.0
    angle_high: float = 0.0
    low: float = 0.0
    high: float = 0.0
    sound_speed: float = 1500.0

    def changed(self, table: Table, generator: Generator) -> Table:
        """Return the table with some pings wrong."""
        if not isinstance(table, records.AcousticBearing) or table.azimuth is None or table.elevation is None:
            raise self.refused(f"its table is of kind {table.kind}, or has no directions", "a sensor with azimuth and elevation")
        if not (0.0 <= self.low <= self.high and 0.0 <= self.angle_low <= self.angle_high <= np.pi):
            found = f"is off by {self.angle_low} to {self.angle_high} rad, {self.low} to {self.high} m"
            raise self.refused(found, "0 <= low <= high, and angles up to pi")
        wild = self.chosen(table, generator)
        angle, size = generator.uniform((self.angle_low, self.low), (self.angle_high, self.high), (len(table), 2)).T
        way = generator.uniform(0.0, 2 * np.pi, len(table))
        azimuth, elevation = angles(aside(direction(table.azimuth, table.elevation), angle, way))
        off = wild & (angle > 0.0)
        columns = lengthened(table, size * wild, self.sound_speed)
        columns |= {"azimuth": np.where(off, azimuth, table.azimuth), "elevation": np.where(off, elevation, table.elevation)}
        return replace(table, **columns, extra=marked(table, wild))


def aside(unit: Array, angle: Array, way: Array) -> Array:
    """Return unit vectors (rows, 3) turned by an angle, towards that way across them (rad, counted from any start)."""
    least = np.eye(3)[np.argmin(np.abs(unit), axis=1)]
    first = cross(unit, least)
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    across = np.cos(way)[:, None] * first + np.sin(way)[:, None] * cross(unit, first)
    return np.asarray(np.cos(angle)[:, None] * unit + np.sin(angle)[:, None] * across)


def lengthened(table: records.AcousticRange, size: Array, sound_speed: float) -> dict[str, Any]:
    """Return the columns of a table whose ranges read `size` (rows,) m more: ranges or times of flight, and the moments of arrival."""
    both = (
        np.full(len(table), 1.0 if table.turnaround is None else 2.0) if table.path is None else np.where(table.path == "two_way", 2.0, 1.0)
    )
    later = both * size / sound_speed
    columns: dict[str, Any] = {"time": table.time + later}
    for name, more in (("received", later), ("travel_time", later), ("range", size)):
        values = getattr(table, name)
        columns[name] = None if values is None else values + more
    return columns
