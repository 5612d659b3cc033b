"""What a multibeam echo sounder would have recorded above a charted sea bed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self, cast

import numpy as np

from leadline.core.geodesy import ECCENTRICITY_2, SEMI_MAJOR_AXIS, north_east, parallel_radius
from leadline.data import records
from leadline.data.errors import InputError
from leadline.simulate.instrument import Instrument, frozen

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.random import Generator

    from leadline.data.records import Array
    from leadline.sea.terrain import Chart
    from leadline.simulate.trajectory import Kinematics, Trajectory


@dataclass(frozen=True, kw_only=True)
class Multibeam(Instrument[records.Swath]):
    """Ranges along a fan of beams to the first meeting with the bed of a chart, whose origin is where the trajectory starts.

    `beams` beams, equiangular over `swath` (rad, the full angle); that at angle a (positive to starboard) is (0, sin a, cos a) in the
    sensor frame: x forward, y to starboard, z down.  Rows are numbered by `ping` and by `beam` from port to starboard, both from 0.
    A beam that meets nothing between `range_min` and `range_max` (m) has no row.  Straight rays, from the pose at `time`: sound is
    taken to be there and back at once.  The chart's depths count from the sea surface of the trajectory's place.
    Noise is N(0, sigma^2 + (sigma_fraction range)^2) (m).  A fraction of the detections is wrong by 0.5 to 1.5 `outlier_size` (m), short
    or long; the column `outlier` says which (for assessment: no estimator reads it).  `beam_loss` is the chance of a beam to be missing,
    `loss` that of a whole ping.  `quality` is 1: detected.  `output` is "range", or "travel_time": there and back, 2 range / sound_speed.
    """

    seabed: Chart
    beams: int = 256
    swath: float = 2 * np.pi / 3
    range_min: float = 0.0
    range_max: float = 200.0
    sigma: float = 0.0
    sigma_fraction: float = 0.0
    outlier_fraction: float = 0.0
    outlier_size: float = 5.0
    beam_loss: float = 0.0
    sound_speed: float = 1500.0
    output: str = "range"
    first: int = 0  # number of the first ping: of a piece of a dive those before it

    def __post_init__(self) -> None:
        """Refuse a fan that is none."""
        super().__post_init__()
        if self.output not in ("range", "travel_time"):
            raise InputError("Multibeam", f"output is '{self.output}'", "range or travel_time")
        if self.beams < 1 or not 0.0 <= self.swath < 2 * np.pi:
            raise InputError("Multibeam", f"has {self.beams} beams over {self.swath:g} rad", "at least one, over less than a full turn")
        if not 0.0 <= self.range_min < self.range_max:
            raise InputError("Multibeam", f"sees from {self.range_min:g} to {self.range_max:g} m", "0 <= range_min < range_max")

    def going_on(self, moments: Array) -> Self:
        """Return the instrument as it goes on after pings at earlier `moments` (s)."""
        return replace(self, first=len(moments))

    @property
    def angles(self) -> Array:
        """Angle across of each beam (beams,), rad, positive to starboard."""
        return np.linspace(-0.5 * self.swath, 0.5 * self.swath, self.beams) if self.beams > 1 else np.zeros(1)

    @property
    def directions(self) -> Array:
        """Unit vector of each beam (beams, 3), sensor axes."""
        return np.stack([np.zeros(self.beams), np.sin(self.angles), np.cos(self.angles)], axis=1)

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Swath:
        """Return true ranges (m)."""
        state = trajectory.at(time).point(self.lever_arm_b)
        points, rotation = on_chart(state)
        distance = self.seabed.cast_fans(points, rotation @ (state.rotation_nb @ self.rotation_bs), self.directions, self.range_max)
        seen = distance >= self.range_min  # nan is not
        ping, beam = np.repeat(np.arange(float(len(time))), np.sum(seen, axis=1)), np.nonzero(seen)[1]
        return records.Swath(
            time=frozen(time[ping.astype(np.intp)]), beam=frozen(beam.astype(float)), angle_across=frozen(self.angles[beam]),
            range=frozen(distance[seen]), ping=frozen(ping + self.first), quality=frozen(np.ones(len(ping))),
        )  # fmt: skip

    def noisy(self, table: records.Swath, generator: Generator) -> records.Swath:
        """Lose beams, add noise and wrong detections; turn ranges into travel times where asked."""
        if self.beam_loss:
            table = cast("records.Swath", table.select(generator.random(len(table)) >= self.beam_loss))
        true = cast("Array", table.range)
        distance = generator.standard_normal(len(table))
        distance *= np.hypot(self.sigma, self.sigma_fraction * true) if self.sigma_fraction else self.sigma
        distance += true
        extra: dict[str, Array] = {}
        if self.outlier_fraction:
            wrong = np.flatnonzero(generator.random(len(table)) < self.outlier_fraction)
            error = self.outlier_size * generator.uniform(0.5, 1.5, len(wrong)) * generator.choice((-1.0, 1.0), len(wrong))
            error[distance[wrong] + error < self.range_min] *= -1.0  # nothing is heard from so near: long instead
            distance[wrong] += error
            outlier = np.zeros(len(table))
            outlier[wrong] = 1.0
            extra = {"outlier": frozen(outlier)}
        columns: dict[str, Any] = {"range": distance}
        if self.output == "travel_time":
            distance *= 2.0 / self.sound_speed
            columns = {"range": None, "travel_time": distance, "sound_speed": frozen(np.full(len(table), self.sound_speed))}
        frozen(distance)
        return replace(table, **columns, extra=extra)

    def by_look(self, table: records.Swath, draw: Callable[[int], Array]) -> Array:
        """Return a number (rows,) drawn for each ping: it arrives as a whole, or not at all, and has one stamp."""
        ping = cast("Array", table.ping).astype(np.intp) - self.first
        return draw(int(ping.max()) + 1 if len(ping) else 0)[ping]


def on_chart(state: Kinematics) -> tuple[Array, Array]:
    """Return points as a chart has them, north, east, depth (n, 3), and how they move there by a metre north, east, down (n, 3, 3).

    north is the arc M dlat along the meridian, east is r dlon along the point's own parallel of radius r = N cos lat, so that
        d north = M / (M + h) dn,   d east = N / (N + h) de - dlon M sin lat / (M + h) dn,   since dr/dlat = -M sin lat:
    meridians that meet shear the chart by 1.6e-4 for each kilometre east of its origin at 45 degrees.  What is left is the curvature of
    the Earth, s^2 / 2R: 3 mm over 200 m.
    """
    latitude, longitude, height = state.geodetic
    north, east = north_east(latitude, longitude, state.place.latitude, state.place.longitude)
    sine = np.sin(latitude)
    prime = SEMI_MAJOR_AXIS / np.sqrt(1 - ECCENTRICITY_2 * sine**2)
    meridian = prime**3 * (1 - ECCENTRICITY_2) / SEMI_MAJOR_AXIS**2
    moved = np.zeros((len(north), 3, 3))
    moved[:, 0, 0], moved[:, 1, 1], moved[:, 2, 2] = meridian / (meridian + height), prime / (prime + height), 1.0
    moved[:, 1, 0] = -east / parallel_radius(latitude) * meridian * sine / (meridian + height)
    return np.stack([north, east, state.chart_depth], axis=1), moved
