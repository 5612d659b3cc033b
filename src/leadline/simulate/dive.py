"""A simulated dive: a trajectory and instruments make a Log, reproducibly from one seed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from hashlib import blake2b
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core.attitude import exponential, matrix_from_quaternion
from leadline.core.geodesy import geodetic_from_ecef, rotation_en
from leadline.data.errors import InputError
from leadline.data.log import Datum, Initial, Log, Origin
from leadline.simulate.acoustics import Acoustic, beacon_position_e
from leadline.simulate.positions import displaced
from leadline.simulate.trajectory import euler

if TYPE_CHECKING:
    from collections.abc import Mapping

    from leadline.data.log import Beacon
    from leadline.data.records import Array, Table
    from leadline.simulate.instruments import Instrument
    from leadline.simulate.trajectory import Trajectory


@dataclass(frozen=True)
class StartSigmas:
    """How far the stated start lies from the truth: sigmas per axis (m, m, m/s, rad, rad)."""

    position: float = 1.0
    depth: float = 0.1
    velocity: float = 0.05
    tilt: float = 0.005
    heading: float = 0.03


def stream(seed: int, name: str) -> np.random.Generator:
    """Return the noise stream of a name: it depends on the seed and on the name, not on what else is simulated."""
    return np.random.default_rng(np.random.SeedSequence([seed, int.from_bytes(blake2b(name.encode(), digest_size=8).digest())]))


@dataclass(frozen=True)
class Recorder:
    """A dive whose truth is evaluated once, and whose noise is drawn anew for each seed.

    An instrument whose sampling jitters looks at other moments for each seed, and is evaluated anew.
    """

    trajectory: Trajectory
    instruments: Mapping[str, Instrument[Any]]
    duration: float | None = None  # s; by default that of the trajectory
    truth_rate: float = 10.0
    start: StartSigmas = field(default_factory=StartSigmas)
    name: str = "synthetic"
    epoch: datetime = datetime(2025, 1, 1, tzinfo=UTC)

    @property
    def length(self) -> float:
        """Duration of the log (s)."""
        return self.trajectory.duration if self.duration is None else self.duration

    def ideal(self, name: str, seed: int = 0) -> Table:
        """Return the table of an instrument without errors."""
        instrument = self.instruments[name]
        table: Table = instrument.ideal(self.trajectory, instrument.sampling(self.length, stream(seed, f"sampling/{name}")))
        return table

    @cached_property
    def steady(self) -> Mapping[str, Table]:
        """The tables without errors of all instruments that look at the same moments for each seed."""
        return {name: self.ideal(name) for name, instrument in self.instruments.items() if not instrument.jitter}

    @cached_property
    def truth(self) -> Table:
        """The table of truth."""
        return self.trajectory.truth(np.arange(int(np.floor(self.length * self.truth_rate + 1e-6)) + 1) / self.truth_rate)

    @cached_property
    def beacons(self) -> Mapping[str, Beacon]:
        """All beacons, where they truly are; raises InputError where two instruments disagree."""
        found: dict[str, Beacon] = {}
        for name, instrument in self.instruments.items():
            for label, beacon in instrument.beacons.items() if isinstance(instrument, Acoustic) else ():
                if found.setdefault(label, beacon) != beacon:
                    raise InputError(name, f"beacon '{label}' is elsewhere than that of another instrument", "give it one place")
        return found

    def draw(self, seed: int, *, keep: bool = True) -> Log:
        """Return the log of one seed; keep: what instruments saw without errors is kept for the next seed (it takes as much memory)."""
        if "truth" in self.instruments:
            raise InputError("instruments", "one is named 'truth'", "give it another name")
        tables = {
            name: instrument.record(self._seen(name, seed, keep), stream(seed, f"noise/{name}"))
            for name, instrument in self.instruments.items()
        }
        place = self.trajectory.place
        return Log(
            name=self.name,
            tables=tables | {"truth": self.truth},
            epoch=self.epoch,
            origin=Origin(place.latitude, place.longitude),
            datum=Datum(geoid_undulation=place.surface_height),
            initial=initial(self.trajectory, self.start, stream(seed, "initial")),
            beacons={name: self._surveyed(beacon, stream(seed, f"beacon/{name}")) for name, beacon in self.beacons.items()},
        )

    def _seen(self, name: str, seed: int, keep: bool = True) -> Table:
        """Return the table of an instrument without errors, in the sea of a seed."""
        instrument = self.instruments[name]
        own = instrument.among(lambda what: what.drawn(self.length, stream(seed, f"sea/{what.name}")))
        if own is not instrument:
            seen: Table = own.ideal(self.trajectory, own.sampling(self.length, stream(seed, f"sampling/{name}")))
            return seen
        return self.steady[name] if keep and name in self.steady else self.ideal(name, seed)

    def _surveyed(self, beacon: Beacon, generator: np.random.Generator) -> Beacon:
        """Return the beacon as the log states it: off its true place by the sigmas that it carries."""
        latitude, longitude, height = geodetic_from_ecef(beacon_position_e(beacon, self.trajectory.place)[None])
        error = generator.standard_normal(3) * (beacon.sigma_north, beacon.sigma_east, beacon.sigma_depth)
        latitude, longitude, height = displaced(latitude, longitude, height, error[None])
        depth = self.trajectory.place.surface_height - float(height[0])
        return replace(beacon, latitude=float(latitude[0]), longitude=float(longitude[0]), north=None, east=None, depth=depth)


def initial(trajectory: Trajectory, sigmas: StartSigmas, generator: np.random.Generator) -> Initial:
    """Return an estimate of the start, drawn around the truth: true = estimate [+] error, attitude R_true = exp([error]x) R_estimate."""
    state = trajectory.at(0.0)
    draws: Array = generator.standard_normal((3, 3))
    offset = draws[0] * (sigmas.position, sigmas.position, sigmas.depth)
    latitude, longitude, height = (float(v[0]) for v in displaced(*state.geodetic, -offset[None]))
    tilt = matrix_from_quaternion(exponential(draws[1] * (sigmas.tilt, sigmas.tilt, sigmas.heading)))
    velocity = rotation_en(latitude, longitude).T @ state.velocity_e[0] - sigmas.velocity * draws[2]
    roll, pitch, heading = (float(angle) for angle in euler(tilt.T @ state.rotation_nb[0]))
    tide = float(trajectory.place.water.level(np.zeros(1))[0])
    return Initial(
        time=0.0, latitude=latitude, longitude=longitude, depth=trajectory.place.surface_height + tide - height,
        velocity_north=float(velocity[0]), velocity_east=float(velocity[1]), velocity_down=float(velocity[2]),
        roll=roll, pitch=pitch, heading=heading,
        sigma_position=sigmas.position, sigma_depth=sigmas.depth, sigma_velocity=sigmas.velocity,
        sigma_tilt=sigmas.tilt, sigma_heading=sigmas.heading,
    )  # fmt: skip


def simulate(
    trajectory: Trajectory,
    instruments: Mapping[str, Instrument[Any]],
    *,
    seed: int = 0,
    duration: float | None = None,
    truth_rate: float = 10.0,
    start: StartSigmas | None = None,
    name: str = "synthetic",
) -> Log:
    """Return the log of a dive (times in s from 0 to `duration`, truth at `truth_rate` in Hz); for many seeds keep a `Recorder`."""
    return Recorder(trajectory, instruments, duration, truth_rate, start or StartSigmas(), name).draw(seed)
