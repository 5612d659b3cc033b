"""From IMU rows to inputs: rate and force that act over an interval as if constant, with coning and sculling in them.

An input acts from the start of its interval.  Rows may be means over (previous, time], instants, or increments; with a = rate dt
and v = force dt over the interval, and the same of the interval before (prime),
    mean, increment:  a + a' x a / 12,                     v + (a' x v + v' x a) / 12
    instant:          (w' + w) dt / 2 + w' x w dt^2 / 12,  and likewise with forces                 (linear motion in between)
Source: Savage (1998), Strapdown inertial navigation integration algorithm design, parts 1 and 2; error of order dt^4.
An interval longer than `gap` is a gap: an input that says "absent", from the last row to the start of the next.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from leadline.data.outcome import Outcome

if TYPE_CHECKING:
    import numpy.typing as npt

    from leadline.data.records import Array, Imu
    from leadline.data.vehicle import SensorConfig

INPUT_SIZE = 7  # rate 3, force 3, present


@dataclass
class InputStream:
    """Turns IMU rows, in order of time, into inputs; it remembers the row before, so that one row at a time gives the same."""

    rotation_bs: Array
    gap: float
    nominal: float  # the usual interval (s); nan until it is known
    latency: float = 0.0
    last: dict[str, Array] = field(default_factory=dict)  # time (1,), rate, force (1, 3), angle, velocity (1, 3) of the row before

    @classmethod
    def of(cls, config: SensorConfig) -> InputStream:
        """Return the stream of a configured IMU; without a stated rate a gap is a quarter of a second."""
        rate = config.values.get("rate")
        gap = config.values.get("gap") or (2.5 / rate if rate else 0.25)
        return cls(config.rotation_bs, gap, 1.0 / rate if rate else np.nan, config.latency)

    @property
    def covered(self) -> float:
        """The time up to which inputs are known."""
        return float(self.last["time"][0]) if self.last else -np.inf

    def push(self, table: Imu) -> tuple[Array, Array, npt.NDArray[np.int64]]:
        """Return start times (k,), inputs (k, INPUT_SIZE), and the outcome of each row (n,), for rows in order of time.

        Rows that are not numbers, or do not come after the row before, give no input.
        """
        time = table.time - self.latency
        rate, force, interval = self._rates(table)
        good = np.asarray(np.isfinite(np.column_stack([time, rate, force])).all(axis=1), bool)
        good[np.flatnonzero(good)] = np.diff(time[good], prepend=self.covered) > 0.0
        outcome = np.where(good, int(Outcome.USED), int(Outcome.INVALID))
        if not good.any():
            return np.zeros(0), np.zeros((0, INPUT_SIZE)), outcome
        start, data = self._inputs(table, time[good], rate[good], force[good], None if interval is None else interval[good])
        return start, data, outcome

    def _rates(self, table: Imu) -> tuple[Array, Array, Array | None]:
        """Rates and forces in body axes (n, 3); increments are divided by their interval, which is returned too."""
        if table.accel is not None and table.gyro is not None:
            return turned(self.rotation_bs, table.gyro), turned(self.rotation_bs, table.accel), None
        interval = np.asarray(table.interval)
        with np.errstate(divide="ignore", invalid="ignore"):
            rate = np.asarray(table.delta_angle) / interval[:, None]
            force = np.asarray(table.delta_velocity) / interval[:, None]
        return turned(self.rotation_bs, rate), turned(self.rotation_bs, force), interval

    def _inputs(self, table: Imu, time: Array, rate: Array, force: Array, interval: Array | None) -> tuple[Array, Array]:
        first = not self.last
        before = np.concatenate([self.last.get("time", time[:1]), time[:-1]])
        step = time - before if interval is None else np.minimum(interval, time - before)
        gap = time - before > self.gap
        gap[0] |= first
        nominal = _forward_filled(np.where(gap, np.nan, step), self.nominal)
        if interval is not None:
            nominal = np.where(gap, interval, nominal)
        step = np.where(gap, nominal, step)
        instant = table.accel is not None and table.sample == "instant"
        angle, velocity = self._increments(rate, force, step, gap, instant)
        known = np.isfinite(step) & (step > 0.0)
        self.last = {"time": time[-1:], "rate": rate[-1:], "force": force[-1:]} | {
            "angle": (rate * step[:, None])[-1:],
            "velocity": (force * step[:, None])[-1:],
        }
        self.nominal = float(nominal[-1])
        with np.errstate(divide="ignore", invalid="ignore"):
            rows = np.column_stack([angle / step[:, None], velocity / step[:, None], np.ones(len(time))])
        absent = gap & (time - np.where(known, step, 0.0) > before + 1e-9)
        absent[0] &= not first
        start = np.concatenate([(time - step)[known & gap], before[known & ~gap], before[absent]])
        data = np.concatenate([rows[known & gap], rows[known & ~gap], np.zeros((int(absent.sum()), INPUT_SIZE))])
        order = np.argsort(start, kind="stable")
        return start[order], data[order]

    def _increments(self, rate: Array, force: Array, step: Array, gap: npt.NDArray[np.bool_], instant: bool) -> tuple[Array, Array]:
        """Increments of angle and velocity (n, 3) with coning and sculling; after a gap there is no row before."""
        dt, joined = step[:, None], ~gap[:, None]
        if instant:
            w, f = self._shifted("rate", rate), self._shifted("force", force)
            angle = np.where(joined, 0.5 * (w + rate) * dt + cross(w, rate) * dt * dt / 12.0, rate * dt)
            sculling = (cross(w, force) + cross(f, rate)) * dt * dt / 12.0
            return angle, np.where(joined, 0.5 * (f + force) * dt + sculling, force * dt)
        a, v = rate * dt, force * dt
        a0, v0 = self._shifted("angle", a), self._shifted("velocity", v)
        joined = joined & np.isfinite(a0[:, :1])
        angle = np.where(joined, a + cross(a0, a) / 12.0, a)
        return angle, np.where(joined, v + (cross(a0, v) + cross(v0, a)) / 12.0, v)

    def _shifted(self, name: str, value: Array) -> Array:
        """The same quantity one row earlier."""
        return np.concatenate([self.last.get(name, value[:1]), value[:-1]])


def cross(a: Array, b: Array) -> Array:
    """Vector product of rows (n, 3); by element, so that one row gives the same bits as many."""
    return np.stack(
        [a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1], a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2], a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]], axis=1
    )


def turned(rotation: Array, vectors: Array) -> Array:
    """Rows R v (n, 3); by element, so that one row gives the same bits as many."""
    x, y, z = vectors[:, 0], vectors[:, 1], vectors[:, 2]
    return np.stack([rotation[i, 0] * x + rotation[i, 1] * y + rotation[i, 2] * z for i in range(3)], axis=1)


def _forward_filled(values: Array, before: float) -> Array:
    """Replace nan by the last number before it."""
    padded = np.concatenate([[before], values])
    index = np.maximum.accumulate(np.where(np.isfinite(padded), np.arange(len(padded)), 0))
    return padded[index][1:]
