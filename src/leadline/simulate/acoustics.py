"""What acoustic instruments would have recorded: how sound passes between a vehicle and others, and ranges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Self, TypeVar, cast

import numpy as np

from leadline.core.geodesy import geodetic_from_ecef
from leadline.data import records
from leadline.data.errors import InputError
from leadline.data.log import Beacon
from leadline.simulate.instrument import Flags, Instrument, Vector
from leadline.simulate.platforms import Carrier, Fixed, Moving, beacon_position_e, surface_at
from leadline.simulate.positions import displaced

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.random import Generator

    from leadline.data.records import Array, Text
    from leadline.sea.sound import Rays, SoundProfile
    from leadline.simulate.trajectory import Place, Trajectory

__all__ = ["Acoustic", "AcousticRange", "Exchange", "Turns", "beacon_position_e", "solved"]

T = TypeVar("T", bound=records.Table)
R = TypeVar("R", bound=records.AcousticRange)
FADING = 6.0  # dB that each further arrival is weaker


def solved(start: Array, flight: Callable[[Array], Array]) -> Array:
    """Return arrivals t = start + flight(t) to 1e-12 s, by iteration; nan where sound does not arrive."""
    arrival = start + flight(start)
    for _ in range(20):
        previous, arrival = arrival, start + flight(np.where(np.isfinite(arrival), arrival, start))
        if not np.any(np.abs(arrival - previous) >= 1e-12):
            break
    return arrival


@dataclass(frozen=True, eq=False)
class Turns:
    """Those who are spoken to, each in its turn: row k is with carriers[turn[k]]."""

    names: tuple[str, ...]
    carriers: tuple[Carrier, ...]
    turn: Any  # integers (rows,)

    @property
    def transmitter(self) -> Text:
        """Name by row."""
        return np.asarray(np.asarray(self.names)[self.turn])

    @property
    def turnaround(self) -> Array:
        """Time between ping and reply by row (s)."""
        return np.asarray(np.array([carrier.turnaround for carrier in self.carriers])[self.turn])

    @property
    def ends(self) -> Array:
        """Time by row up to which it is known where they are (s)."""
        return np.asarray(np.array([carrier.end for carrier in self.carriers])[self.turn])

    @property
    def afloat(self) -> Flags:
        """Which rows are with something that says itself where it is."""
        return np.asarray(np.array([not isinstance(carrier, Fixed) for carrier in self.carriers])[self.turn])

    def position_e(self, time: Array) -> Array:
        """Return Earth-fixed positions (rows, 3) of their transducers, at a time (s) for each row, at most that of their ends."""
        place = np.empty((len(time), 3))
        for k, carrier in enumerate(self.carriers):
            place[self.turn == k] = carrier.transducer_e(np.minimum(time[self.turn == k], carrier.end))
        return place


@dataclass(frozen=True, eq=False)
class Exchange:
    """Pings: when the other one sent or replied, where it was then (ECEF, m), and when that was heard; nan where it was not."""

    replied: Array
    place_e: Array
    arrival: Array


@dataclass(frozen=True, kw_only=True)
class Acoustic(Instrument[T]):
    """What all have in common that measure by sound with others: `beacons` that stand in the log, `platforms` that say where they are.

    Sound runs straight at `sound_speed` (m/s); with a `profile` along the fastest direct ray, over the horizontal distance that with
    the difference in depth makes up the chord, so that a uniform profile changes nothing; where there is no direct ray there is no row.
    (Layers follow no curve of the Earth: in 0.017/s of gradient 4 mm at 3 km, 0.15 m at 10 km.)  `sound_speed` alone turns times into
    ranges, where `output` is "range".  A sound that is not there before the end of what is known of both motions has no row.
    Lost is a fraction `dropout`, and beyond that 1 / (1 + exp(-(distance - range_50) / range_width)), and all beyond `range_max` (m).
    The turn-around is off by N(0, `sigma_turnaround`) (s), its column is not.  One way, the other clock shows `clock_offset` +
    `clock_drift` t (s, s/s) more than ours at our t, and stamps the transmission.  Times of flight are whole multiples of `quantum` (s).
    Platforms state their positions at their own event with an error of `beacon_sigma` (m) north, east and down.
    """

    beacons: Mapping[str, Beacon] = field(default_factory=dict)
    platforms: Mapping[str, Moving | Fixed] = field(default_factory=dict)
    path: str = "two_way"
    sound_speed: float = 1500.0
    profile: SoundProfile | None = None
    sigma: float = 0.0
    sigma_turnaround: float = 0.0
    clock_offset: float = 0.0
    clock_drift: float = 0.0
    quantum: float = 0.0
    beacon_sigma: float = 0.0
    dropout: float = 0.0
    range_50: float = np.inf
    range_width: float = 50.0
    range_max: float = np.inf
    output: str = "travel_time"
    first: int = 0  # number of the first ping: of a piece of a dive those before it

    def going_on(self, moments: Array) -> Self:
        """Return the instrument as it goes on after pings at earlier `moments` (s): whose turn it is."""
        return replace(self, first=len(moments))

    def turns(self, place: Place, rows: int) -> Turns:
        """Return who is spoken to in each row; raises InputError where a name stands for two."""
        both = set(self.beacons) & set(self.platforms)
        if both:
            raise InputError(type(self).__name__, f"'{min(both)}' is a beacon and a platform", "give each a name of its own")
        afloat = {name: one.afloat_on(place) if isinstance(one, Moving) else one for name, one in self.platforms.items()}
        known: dict[str, Carrier] = {**{name: Fixed(beacon, place) for name, beacon in self.beacons.items()}, **afloat}
        names = tuple(sorted(known))
        return Turns(names, tuple(known[name] for name in names), np.arange(self.first, self.first + rows) % len(names))

    def rays(self, a_e: Array, b_e: Array, surface_height: float) -> tuple[Rays, Array, Array]:
        """Return bent rays between ECEF points (rows, 3), and the horizontal distances and differences in depth that they span (m)."""
        if self.profile is None:
            raise InputError(type(self).__name__, "has no profile", "give one")
        depth_a, depth_b = (surface_height - geodetic_from_ecef(p)[2] for p in (a_e, b_e))
        down = depth_b - depth_a
        level = np.sqrt(np.maximum(np.sum((a_e - b_e) ** 2, axis=-1) - down * down, 0.0))
        return self.profile.travel_time(level, depth_a, depth_b), level, down

    def flight(self, a_e: Array, b_e: Array, surface_height: float) -> Array:
        """Return the time (s) that sound needs between Earth-fixed points (rows, 3); nan where there is no direct ray."""
        if self.profile is not None:
            return self.rays(a_e, b_e, surface_height)[0].time
        gap = a_e - b_e
        return np.asarray(np.sqrt(np.sum(gap * gap, axis=-1)) / self.sound_speed)

    def exchange(self, time: Array, ours: Callable[[Array], Array], turns: Turns, surface_height: float, end: float = np.inf) -> Exchange:
        """Return pings at `time` between our point and those who are spoken to: their events, their places then, the arrivals at ours.

        Two ways, ours sends at `time` and the other one replies a turn-around after it has heard; else the other one sends at `time`.
        What comes after `end` (s), up to which our motion is known, or after that of theirs, does not arrive.
        """
        replied = time
        if self.path == "two_way":
            start = ours(np.minimum(time, end))
            replied = solved(time, lambda t: self.flight(turns.position_e(t), start, surface_height)) + turns.turnaround
        known = np.where(np.isfinite(replied), replied, time)
        place = turns.position_e(known)
        arrival = solved(known, lambda t: self.flight(ours(np.minimum(t, end)), place, surface_height))
        return Exchange(replied, place, np.where((replied <= turns.ends) & (arrival <= end), arrival, np.nan))

    def told(self, turns: Turns, event: Array, place_e: Array, sea: Place) -> dict[str, Any]:
        """Return the columns of where platforms are at their event (s), without errors; none where there are only beacons."""
        if not self.platforms:
            return {}
        latitude, longitude, height = (np.where(turns.afloat, v, np.nan) for v in geodetic_from_ecef(place_e))
        return {"beacon_latitude": latitude, "beacon_longitude": longitude, "beacon_depth": surface_at(sea, event) - height}

    def told_wrong(self, table: R, generator: Generator) -> R:
        """Return the table with the errors of the platforms' own positions."""
        if table.beacon_latitude is None or not self.beacon_sigma:
            return table
        error = self.beacon_sigma * generator.standard_normal((len(table), 3))
        depth, longitude = cast("Array", table.beacon_depth), cast("Array", table.beacon_longitude)
        latitude, longitude, height = displaced(table.beacon_latitude, longitude, -depth, error)
        sigma = np.where(np.isfinite(latitude), self.beacon_sigma, np.nan)
        return replace(table, beacon_latitude=latitude, beacon_longitude=longitude, beacon_depth=-height, beacon_sigma=sigma)

    def distance(self, table: records.AcousticRange) -> Array:
        """Return the distances (m) of a table without errors, one way, by its times."""
        flown = table.time - cast("Array", table.transmit)
        flown = flown if table.turnaround is None else 0.5 * (flown - table.turnaround)
        return np.asarray(self.sound_speed * flown)

    def kept(self, distance: Array, generator: Generator) -> Flags:
        """Return which pings over distances (m) are heard."""
        first, second = generator.random((2, len(distance)))
        faint = 0.5 * (1.0 + np.tanh(0.5 * (distance - self.range_50) / self.range_width))
        return np.asarray((first >= self.dropout) & (second >= faint) & (distance <= self.range_max))

    def timed(self, table: R, error: Array, late_start: Array | None = None) -> R:
        """Return the table with errors (s) of its arrivals, and of the moment that they count from, by its clocks and in its unit."""
        columns: dict[str, Any] = {}
        start = np.zeros(len(table)) if late_start is None else late_start
        if self.path == "one_way" and (self.clock_offset or self.clock_drift):
            sent = cast("Array", table.transmit)
            start = start + self.clock_offset + self.clock_drift * sent
            columns["transmit"] = sent + start
        travel = cast("Array", table.travel_time) + error - start
        if self.quantum:
            whole = self.quantum * np.round(travel / self.quantum)
            error, travel = error + whole - travel, whole
        columns["travel_time"] = travel
        if self.output == "range":
            distance = travel if table.turnaround is None else 0.5 * (travel - table.turnaround)
            columns |= {"travel_time": None, "range": self.sound_speed * distance}
        return replace(table, time=table.time + error, **columns)


@dataclass(frozen=True, kw_only=True)
class AcousticRange(Acoustic[records.AcousticRange]):
    """Ranges between the vehicle's transducer and beacons or platforms, each in its turn; c is the speed of sound.

    one_way   the beacon transmits at t0, the vehicle receives at t3:        |r(t3) - b(t0)| = c (t3 - t0)
    two_way   the vehicle transmits at t0, the beacon receives at t1 and replies a turnaround later at t2, the vehicle, having moved,
              receives at t3:   |r(t0) - b(t1)| = c (t1 - t0),   |r(t3) - b(t2)| = c (t3 - t2)
    difference  the beacon transmits, hydrophones at lever arms `receivers` (m) hear it, each compared with the `reference`:
              a row for each of the others, travel_time = t_receiver - t_reference, time = t_receiver
    r is the transducer (body origin + lever arm at the pose of that moment), distances are taken in ECEF.  `time` = t3 and
    `transmit` = t0 (pings at offset + k / rate).  travel_time = t3 - t0 CONTAINS THE TURNAROUND, which has its own column.
    `output` "range" gives instead c (t3 - t0) one way and c (t3 - t0 - turnaround) / 2 two ways.
    `sigma` (s) is noise of the measured travel time and so of t3; a fraction of the arrivals comes late by an exponential delay.
    Each arrival has echoes, each later than the one before by an exponential delay of mean `echo_delay` (s); with `echo_fraction` the
    direct one is missed.  The first `peaks` of those that are heard are rows, ranked by `peak` where there is more than one.
    `snr` (dB) is that at 1 km: it grows by 20 log10 towards the source, and each further peak has 6 dB less.
    """

    receivers: Mapping[str, Vector] = field(default_factory=dict)
    reference: str = ""
    outlier_fraction: float = 0.0
    outlier_delay: float = 0.02
    echo_fraction: float = 0.0
    echo_delay: float = 0.02
    peaks: int = 1
    snr: float | None = None

    def ideal(self, trajectory: Trajectory, time: Array) -> records.AcousticRange:
        """Return true travel times, solved to 1e-12 s."""
        self._check()
        turns, surface = self.turns(trajectory.place, len(time)), trajectory.place.surface_height
        if self.path == "difference":
            return self._differences(trajectory, time, turns)
        pings = self.exchange(time, lambda t: self._transducer_e(trajectory, t), turns, surface, trajectory.end)
        columns: dict[str, Any] = {"turnaround": turns.turnaround} if self.path == "two_way" else {}
        table = records.AcousticRange(
            time=pings.arrival, transmit=time, travel_time=pings.arrival - time, transmitter=turns.transmitter,
            path=np.full(len(time), self.path), **columns, **self.told(turns, pings.replied, pings.place_e, trajectory.place),
        )  # fmt: skip
        return _heard(table)

    def _check(self) -> None:
        paths = ("one_way", "two_way", "difference")
        if self.path not in paths or not (self.beacons or self.platforms) or self.output not in ("travel_time", "range"):
            found = f"path '{self.path}', output '{self.output}', {len(self.beacons) + len(self.platforms)} beacons and platforms"
            raise InputError("AcousticRange", found, "one_way, two_way or difference, travel_time or range, at least one beacon")
        if self.path == "difference" and (self.reference not in self.receivers or len(self.receivers) < 2):
            found = f"reference '{self.reference}', {len(self.receivers)} receivers"
            raise InputError("AcousticRange", found, "a difference needs two receivers, one of them the reference")
        if self.peaks < 1:
            raise InputError("AcousticRange", f"peaks {self.peaks}", "give one at least")

    def _transducer_e(self, trajectory: Trajectory, time: Array) -> Array:
        return trajectory.at(time).point(self.lever_arm_b).position_e

    def _differences(self, trajectory: Trajectory, time: Array, turns: Turns) -> records.AcousticRange:
        surface, place = trajectory.place.surface_height, turns.position_e(time)

        def arrival(name: str) -> Array:
            def there(moment: Array) -> Array:
                return trajectory.at(np.minimum(moment, trajectory.end)).point(self.receivers[name]).position_e

            heard = solved(time, lambda t: self.flight(there(t), place, surface))
            return np.where((heard <= trajectory.end) & (time <= turns.ends), heard, np.nan)

        names = [name for name in sorted(self.receivers) if name != self.reference]
        heard, first = np.stack([arrival(name) for name in names], axis=1), arrival(self.reference)[:, None]
        each, rows = len(names), len(time) * len(names)
        told: dict[str, Any] = {key: np.repeat(value, each) for key, value in self.told(turns, time, place, trajectory.place).items()}
        table = records.AcousticRange(
            time=heard.ravel(), transmit=np.repeat(time, each), travel_time=(heard - first).ravel(),
            transmitter=np.repeat(turns.transmitter, each), receiver=np.tile(names, len(time)),
            reference=np.full(rows, self.reference), path=np.full(rows, self.path), **told,
        )  # fmt: skip
        return _heard(table)

    def noisy(self, table: records.AcousticRange, generator: Generator) -> records.AcousticRange:
        """Add noise, late arrivals, echoes and losses, errors of clocks; turn times into ranges where asked.

        Of a difference the moment of transmission is taken out: the vehicle does not know it.
        """
        rows = len(table)
        late = (generator.random(rows) < self.outlier_fraction) * generator.exponential(self.outlier_delay, rows)
        error = self.sigma * generator.standard_normal(rows) + late
        losses, turning, echoes, reference, stated = generator.spawn(5)
        distance = self.distance(table)
        heard = self.kept(distance, losses)
        if self.sigma_turnaround and table.turnaround is not None:
            error = error + self.sigma_turnaround * turning.standard_normal(rows)
        index, errors, peak = self._arrivals(error, echoes)
        start = self._reference_error(table, reference)[index] if self.path == "difference" else None
        columns: dict[str, Any] = {"peak": peak + 1.0} if self.peaks > 1 else {}
        if self.snr is not None:
            columns["snr"] = self.snr - 20.0 * np.log10(np.maximum(distance, 1.0) / 1000.0)[index] - FADING * peak
        told = cast("records.AcousticRange", self.told_wrong(table, stated).select(index))
        result = replace(self.timed(told, errors, start), **columns)
        if self.path == "difference":
            result = replace(result, transmit=None)
        return result if np.all(heard) else cast("records.AcousticRange", result.select(heard[index]))

    def _arrivals(self, error: Array, generator: Generator) -> tuple[Any, Array, Array]:
        """Return by row of the result: which ping, by how much it is late, how many arrivals before it were heard."""
        rows = len(error)
        missed = generator.random(rows) < self.echo_fraction
        echoes = np.cumsum(generator.exponential(self.echo_delay, (rows, self.peaks)), axis=1)
        direct = np.column_stack([np.zeros(rows), echoes[:, :-1]])
        noise = self.sigma * generator.standard_normal((rows, self.peaks))
        noise[:, 0] = error
        errors = np.where(missed[:, None], echoes, direct) + noise
        return np.repeat(np.arange(rows), self.peaks), errors.ravel(), np.tile(np.arange(float(self.peaks)), rows)

    def _reference_error(self, table: records.AcousticRange, generator: Generator) -> Array:
        """Return the errors (s) of the reference, one for each ping, by row."""
        _, ping = np.unique(cast("Array", table.transmit), return_inverse=True)
        return np.asarray((self.sigma * generator.standard_normal(len(table)))[ping])


def _heard(table: records.AcousticRange) -> records.AcousticRange:
    """The rows that sound reached."""
    flown = np.isfinite(cast("Array", table.travel_time))
    return table if np.all(flown) else cast("records.AcousticRange", table.select(flown))
