"""From IMU rows to inputs: rate and force that act over an interval as if constant, with coning and sculling in them.

An input acts from the start of its interval.  Rows may be means over (previous, time], instants, or increments; with a = rate dt
and v = force dt over the interval, and the same of the interval before (prime),
    mean, increment:  a + a' x a / 12,                     v + (a' x v + v' x a) / 12
    instant:          (w' + w) dt / 2 + w' x w dt^2 / 12,  and likewise with forces                 (linear motion in between)
Means and increments are of third order, instants of second (tests/test_noise_free.py).
Source: Savage (1998), Strapdown inertial navigation integration algorithm design, parts 1 and 2.
An interval longer than `gap` is a gap: an input that says "absent", from the last row to the start of the next.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import kernel
from leadline.core.rotation import cross, load3, store3
from leadline.data.outcome import Outcome

if TYPE_CHECKING:
    import numpy.typing as npt

    from leadline.data.records import Array, Imu
    from leadline.data.vehicle import SensorConfig

RATE_I, FORCE_I, PRESENT_I, INTERVAL_I, INPUT_SIZE = 0, 3, 6, 7, 9  # rate 3, force 3, present, interval, number of the unit
# What is remembered of the row before: time, usual interval, rate, force, increments of angle and velocity, rate of the input.
TIME_M, NOMINAL_M, RATE_M, FORCE_M, ANGLE_M, VELOCITY_M, TURNING_M, MEMORY = 0, 1, 2, 5, 8, 11, 14, 17
USED, INVALID, DUPLICATE = int(Outcome.USED), int(Outcome.INVALID), int(Outcome.DUPLICATE)
NO_INTERVAL = np.zeros(0)


@kernel()
def turned(r, a):
    """R a of a matrix and three numbers."""
    return (
        r[0, 0] * a[0] + r[0, 1] * a[1] + r[0, 2] * a[2],
        r[1, 0] * a[0] + r[1, 1] * a[1] + r[1, 2] * a[2],
        r[2, 0] * a[0] + r[2, 1] * a[1] + r[2, 2] * a[2],
    )


@kernel()
def joined(m, rate, force, step, instant):
    """Increments of angle and velocity of a row that follows the one before without a gap."""
    if instant:
        w, f = load3(m, RATE_M), load3(m, FORCE_M)
        p, q, r = cross(w, rate), cross(w, force), cross(f, rate)
        half, twelfth = 0.5 * step, step * step / 12.0
        return (
            ((w[0] + rate[0]) * half + p[0] * twelfth, (w[1] + rate[1]) * half + p[1] * twelfth, (w[2] + rate[2]) * half + p[2] * twelfth),
            (
                (f[0] + force[0]) * half + (q[0] + r[0]) * twelfth,
                (f[1] + force[1]) * half + (q[1] + r[1]) * twelfth,
                (f[2] + force[2]) * half + (q[2] + r[2]) * twelfth,
            ),
        )
    a, v = (rate[0] * step, rate[1] * step, rate[2] * step), (force[0] * step, force[1] * step, force[2] * step)
    if math.isnan(m[ANGLE_M]):
        return a, v
    b, u = load3(m, ANGLE_M), load3(m, VELOCITY_M)
    p, q, r = cross(b, a), cross(b, v), cross(u, a)
    return (
        (a[0] + p[0] / 12.0, a[1] + p[1] / 12.0, a[2] + p[2] / 12.0),
        (v[0] + (q[0] + r[0]) / 12.0, v[1] + (q[1] + r[1]) / 12.0, v[2] + (q[2] + r[2]) / 12.0),
    )


@kernel()
def condition(time, rates, forces, interval, instant, rotation_bs, gap, m, start, data, outcome):
    """Turn rows into inputs, remembering in `m`; returns how many inputs there are.  Without increments `interval` is empty."""
    count = 0
    for i in range(len(time)):
        rate, force = turned(rotation_bs, rates[i]), turned(rotation_bs, forces[i])
        total = rate[0] + rate[1] + rate[2] + force[0] + force[1] + force[2] + time[i]
        if not (math.isfinite(total) and time[i] > m[TIME_M]) or (len(interval) and not interval[i] > 0.0):
            same = time[i] == m[TIME_M] and rate == load3(m, RATE_M) and force == load3(m, FORCE_M)
            outcome[i] = DUPLICATE if same else INVALID
            continue
        outcome[i] = USED
        first, elapsed = math.isinf(m[TIME_M]), time[i] - m[TIME_M]
        own = interval[i] if len(interval) else elapsed
        broken = first or elapsed > gap
        if broken:
            step = interval[i] if len(interval) else m[NOMINAL_M]
            a, v = (rate[0] * step, rate[1] * step, rate[2] * step), (force[0] * step, force[1] * step, force[2] * step)
            if not first and not time[i] - step <= m[TIME_M] + 1e-9:
                start[count] = m[TIME_M]
                data[count, :] = 0.0
                count += 1
        else:
            step = min(own, elapsed)
            m[NOMINAL_M] = step
            a, v = joined(m, rate, force, step, instant)
        if step > 0.0:
            start[count] = time[i] - step if broken else m[TIME_M]
            store3(data[count], 0, (a[0] / step, a[1] / step, a[2] / step))
            store3(data[count], 3, (v[0] / step, v[1] / step, v[2] / step))
            data[count, 6], data[count, 7], data[count, 8] = 1.0, step, 0.0
            count += 1
        m[TIME_M] = time[i]
        store3(m, RATE_M, rate)
        store3(m, FORCE_M, force)
        store3(m, ANGLE_M, (rate[0] * step, rate[1] * step, rate[2] * step))
        store3(m, VELOCITY_M, (force[0] * step, force[1] * step, force[2] * step))
    return count


def nothing_before(nominal: float) -> Array:
    """Return the memory of a stream that has seen no row."""
    memory = np.full(MEMORY, np.nan)
    memory[TIME_M], memory[NOMINAL_M] = -np.inf, nominal
    return memory


@dataclass
class InputStream:
    """Turns IMU rows, in order of time, into inputs; it remembers the row before, so that one row at a time gives the same."""

    rotation_bs: Array
    gap: float
    name: str = "imu"  # of the sensor
    nominal: float = np.nan  # the usual interval (s); nan until it is known
    latency: float = 0.0
    arm_b: Array = field(default_factory=lambda: np.zeros(3))  # from the process model's reference point (m)
    memory: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        """Start with nothing remembered."""
        self.memory = nothing_before(self.nominal)

    @classmethod
    def of(cls, config: SensorConfig, arm_b: Array | None = None) -> InputStream:
        """Return the stream of a configured IMU; without a stated rate a gap is a quarter of a second.

        arm_b: where it is, counted from the process model's reference point; the forces are brought there.
        """
        rate = config.values.get("rate")
        gap = config.values.get("gap") or (2.5 / rate if rate else 0.25)
        arm = np.zeros(3) if arm_b is None else np.asarray(arm_b, float)
        return cls(np.ascontiguousarray(config.rotation_bs, float), gap, config.name, 1.0 / rate if rate else np.nan, config.latency, arm)

    @property
    def covered(self) -> float:
        """The time up to which inputs are known."""
        return float(self.memory[TIME_M])

    def push(self, table: Imu) -> tuple[Array, Array, npt.NDArray[np.int64]]:
        """Return start times (k,), inputs (k, INPUT_SIZE), and the outcome of each row (n,), for rows in order of time.

        Rows that are not numbers, that the sensor itself calls invalid, or that do not come after the row before, give no input.
        """
        rates, forces, interval = rates_of(table)
        if table.valid is not None:
            rates = np.where((np.nan_to_num(table.valid) != 0)[:, None], rates, np.nan)
        count = len(table)
        start, data = np.empty(2 * count), np.empty((2 * count, INPUT_SIZE))
        outcome = np.empty(count, np.int64)
        time = table.time - self.latency
        instant = table.accel is not None and table.sample == "instant"
        made = condition(time, rates, forces, interval, instant, self.rotation_bs, self.gap, self.memory, start, data, outcome)
        if self.arm_b.any():
            self._move(data[:made])
        return start[:made], data[:made], outcome

    def _move(self, data: Array) -> None:
        """Bring forces from the unit's place to the reference point, in place: f - w' x l - w x (w x l).

        w' is the difference from the input before over the interval: half an interval late, but its integral is exact.
        """
        before = self.memory[TURNING_M : TURNING_M + 3]
        rate = data[:, RATE_I : RATE_I + 3]
        turned = np.where(data[:, PRESENT_I, None] != 0.0, rate, np.nan)  # of what came before a gap nothing is known
        known = np.concatenate([before[None], turned[:-1]]) if len(rate) else rate
        follows = (data[:, PRESENT_I] != 0.0) & np.isfinite(known).all(axis=1)
        step = np.where(data[:, INTERVAL_I] > 0.0, data[:, INTERVAL_I], 1.0)[:, None]
        turning = np.where(follows[:, None], (rate - known) / step, 0.0)
        pull = np.cross(turning, self.arm_b) + np.cross(rate, np.cross(rate, self.arm_b))
        data[:, FORCE_I : FORCE_I + 3] -= np.where(data[:, PRESENT_I, None] != 0.0, pull, 0.0)
        if len(rate):
            self.memory[TURNING_M : TURNING_M + 3] = turned[-1]


def rates_of(table: Imu) -> tuple[Array, Array, Array]:
    """Return rates and forces (n, 3) in the sensor frame, and the intervals of increments (n,), empty without."""
    if table.accel is not None and table.gyro is not None:
        return table.gyro.copy(), table.accel.copy(), NO_INTERVAL
    interval = np.asarray(table.interval).copy()
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(table.delta_angle) / interval[:, None], np.asarray(table.delta_velocity) / interval[:, None], interval
