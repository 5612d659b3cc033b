"""What acoustic instruments would have recorded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from leadline.core.geodesy import ecef_from_geodetic, from_north_east
from leadline.data import records
from leadline.data.errors import InputError
from leadline.simulate.instrument import Instrument

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.log import Beacon
    from leadline.data.records import Array
    from leadline.simulate.trajectory import Place, Trajectory


@dataclass(frozen=True, kw_only=True)
class AcousticRange(Instrument[records.AcousticRange]):
    """Ranges between the vehicle's transducer and fixed beacons, each in its turn; straight rays, one speed of sound c.

    one_way   the beacon transmits at t0, the vehicle receives at t3:        |r(t3) - b| = c (t3 - t0)
    two_way   the vehicle transmits at t0, the beacon receives at t1 and replies a turnaround later, the vehicle, having moved,
              receives at t3:   |r(t0) - b| = c (t1 - t0),   |r(t3) - b| = c (t3 - t1 - turnaround)
    r is the transducer (body origin + lever arm at the pose of that moment), distances are taken in ECEF.  `time` = t3 and
    `transmit` = t0 (pings at offset + k / rate).  travel_time = t3 - t0 CONTAINS THE TURNAROUND, which has its own column.
    `output` "range" gives instead c (t3 - t0) one way and c (t3 - t0 - turnaround) / 2 two ways.
    `sigma` (s) is noise of the measured travel time and so of t3; a fraction of the arrivals comes late by an exponential delay.
    """

    beacons: Mapping[str, Beacon] = field(default_factory=dict)
    path: str = "two_way"
    sound_speed: float = 1500.0
    sigma: float = 0.0
    outlier_fraction: float = 0.0
    outlier_delay: float = 0.02
    output: str = "travel_time"

    def ideal(self, trajectory: Trajectory, time: Array) -> records.AcousticRange:
        """Return true travel times, solved to 1e-12 s."""
        if self.path not in ("one_way", "two_way") or not self.beacons or self.output not in ("travel_time", "range"):
            found = f"path '{self.path}', output '{self.output}', {len(self.beacons)} beacons"
            raise InputError("AcousticRange", found, "one_way or two_way, travel_time or range, at least one beacon")
        names, turn = sorted(self.beacons), np.arange(len(time)) % len(self.beacons)
        beacon_e = np.stack([beacon_position_e(self.beacons[name], trajectory.place) for name in names])[turn]
        turnaround, sent = np.array([self.beacons[name].turnaround for name in names])[turn], time
        if self.path == "two_way":
            sent = time + self.delay(trajectory, time, beacon_e) + turnaround
        arrival = sent + self.delay(trajectory, sent, beacon_e)
        for _ in range(20):
            previous, arrival = arrival, sent + self.delay(trajectory, arrival, beacon_e)
            if np.all(np.abs(arrival - previous) < 1e-12):
                break
        columns: dict[str, Any] = {"turnaround": turnaround} if self.path == "two_way" else {}
        return records.AcousticRange(
            time=arrival, transmit=time, travel_time=arrival - time, transmitter=np.asarray(names)[turn],
            path=np.full(len(time), self.path), **columns,
        )  # fmt: skip

    def delay(self, trajectory: Trajectory, time: Array, beacon_e: Array) -> Array:
        """Return the time (s) that sound needs between the transducer at `time` and the beacon."""
        gap = trajectory.at(time).point(self.lever_arm_b).position_e - beacon_e
        return np.asarray(np.sqrt(np.sum(gap * gap, axis=-1)) / self.sound_speed)

    def noisy(self, table: records.AcousticRange, generator: Generator) -> records.AcousticRange:
        """Add noise and late arrivals; turn times into ranges where asked."""
        late = (generator.random(len(table)) < self.outlier_fraction) * generator.exponential(self.outlier_delay, len(table))
        error = self.sigma * generator.standard_normal(len(table)) + late
        travel = cast("Array", table.travel_time) + error
        columns: dict[str, Any] = {"travel_time": travel}
        if self.output == "range":
            distance = travel if table.turnaround is None else 0.5 * (travel - table.turnaround)
            columns = {"travel_time": None, "range": self.sound_speed * distance}
        return replace(table, time=table.time + error, **columns)


def beacon_position_e(beacon: Beacon, place: Place) -> Array:
    """Return the Earth-fixed position (3,) of a beacon; north and east count from `place`, depth from its sea surface."""
    if beacon.latitude is not None and beacon.longitude is not None:
        latitude, longitude = np.asarray(beacon.latitude), np.asarray(beacon.longitude)
    elif beacon.north is not None and beacon.east is not None:
        latitude, longitude = from_north_east(beacon.north, beacon.east, place.latitude, place.longitude)
    else:
        raise InputError("beacon", "has no position", "give latitude and longitude, or north and east")
    return ecef_from_geodetic(latitude, longitude, place.surface_height - beacon.depth)
