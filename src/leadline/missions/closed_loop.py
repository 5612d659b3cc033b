"""A vehicle that steers by what it believes: voyage, instruments and navigator, each a step ahead of the next.

Five times a second the vehicle sails on by what its navigator said last; then its instruments look at what it did, the navigator is
handed their rows as they arrive, and says where the vehicle is.  An error of the navigator so becomes an error of the way, as at sea.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core.attitude import euler_from_quaternion
from leadline.data.errors import InputError
from leadline.data.log import Log
from leadline.data.records import Imu, Table, after
from leadline.estimate.output import solution_of
from leadline.estimate.plan import OUT_VIEW
from leadline.estimate.solve import navigator_for
from leadline.missions.equipment import DRAWN, IDLE, equip
from leadline.models.view import RATE_V
from leadline.simulate import instruments as simulated
from leadline.simulate.acoustics import Acoustic
from leadline.simulate.dense import Dense
from leadline.simulate.dive import Recorder, stream
from leadline.simulate.faults import ClockJump
from leadline.simulate.faults_of_values import StuckValue
from leadline.simulate.machinery import Machinery
from leadline.simulate.sailing import TICK
from leadline.simulate.settled import settled
from leadline.simulate.trajectory import Trajectory
from leadline.simulate.voyage import LEAD

if TYPE_CHECKING:
    from collections.abc import Callable

    from leadline.data.records import Array
    from leadline.estimate.navigator import Navigator
    from leadline.missions.mission import Mission
    from leadline.simulate.faults import Fault
    from leadline.simulate.instrument import Instrument
    from leadline.simulate.voyage import Voyage

STEP = 2  # ticks between words of the navigator
REACH = 6.0  # s that an acoustic instrument is behind, with the longest turn-around on top: an echo that takes longer is lost
MEMORY = 60.0  # s of the past that instruments can look at: those that low-pass need some of it


@dataclass(eq=False)
class Eye:
    """One instrument that looks at a dive piece by piece."""

    name: str
    instrument: Instrument[Any]
    moments: Array
    behind: float
    seed: int
    faults: tuple[Fault, ...] = ()
    done: int = 0
    healthy: Table | None = None  # all that it saw, where faults befall it that remember
    pieces: list[Table] = field(default_factory=list)

    def look(self, trajectory: Trajectory, now: float) -> Table | None:
        """Return the rows of all moments up to now that it has not looked at yet; None: there are none."""
        last = int(np.searchsorted(self.moments, now - self.behind, side="right"))
        if last == self.done:
            return None
        first = int(np.searchsorted(self.moments, self.moments[self.done] - 0.5 * MEMORY)) if self.instrument_remembers else self.done
        instrument = self.instrument.going_on(self.moments[:first])
        seen: Table = instrument.ideal(trajectory, self.moments[first:last])
        if first < self.done:
            seen = seen.select(seen.time > self.moments[self.done - 1])
        if not len(seen):
            self.done = last
            return None
        table: Table = instrument.record(seen, stream(self.seed, f"piece/{self.name}/{self.done}"))
        table, self.done = self.befallen(table) if self.faults else table, last
        if not len(table):
            return None
        self.pieces.append(table)
        return table

    def befallen(self, piece: Table) -> Table:
        """Return a piece as the faults leave it; they are shown what came before, but for an inertial unit, of which there is too much."""
        known = piece if self.healthy is None or isinstance(piece, Imu) else after(self.healthy, piece)
        before, self.healthy = len(known) - len(piece), known
        log = Log(self.name, {self.name: replace(known, sequence=np.arange(float(len(known))))})
        for number, fault in enumerate(self.faults):
            log = fault.apply(log, stream(self.seed, f"fault/{type(fault).__name__}/{self.name}/{number}/{self.done}"))
        table = log.tables[self.name]
        kept = table.select(np.asarray(table.sequence, float) >= before)
        return kept if any(isinstance(fault, ClockJump) for fault in self.faults) else replace(kept, sequence=None)

    @property
    def instrument_remembers(self) -> bool:
        """Whether what it shows depends on what it saw before."""
        return bool(getattr(self.instrument, "tilt_gain", 0.0) or getattr(self.instrument, "lag", 0.0))


def sail_by_estimate(mission: Mission, seed: int, progress: Callable[[float], None] | None = None) -> tuple[Voyage, Log]:
    """Sail a mission by its navigator's estimate; returns the voyage and the log that it leaves.

    Raises InputError where the vehicle comes to grief, and for instruments and faults that cannot be drawn piece by piece.
    """
    rehearsal = mission.voyage()
    rehearsal.run()
    template = Recorder(rehearsal.trajectory(), equip(mission, rehearsal), start=mission.start, name=mission.name, epoch=mission.epoch)
    longest = 3 * rehearsal.time + 600.0 if mission.duration is None else mission.duration
    voyage = replace(mission.voyage(), limit=longest)
    known = template.draw(seed)
    navigator, _, _ = navigator_for(known, mission.vehicle)
    _check(mission, navigator, known)
    helm = Helm(mission, voyage, navigator, eyes_of(template, mission, longest, seed))
    helm.run(progress)
    return voyage, helm.log(known)


def _check(mission: Mission, navigator: Navigator, known: Log) -> None:
    """Refuse a navigator that cannot go along: one that waits for ticks, and one whose process model nothing drives."""
    if mission.vehicle.process.sync is not None:
        found = f"{mission.vehicle.process.sync} s, of a vehicle that steers by its estimate"
        raise InputError("process.sync_s", found, "take it out: a tick is known only afterwards")
    for feed in navigator.composition.process.feeds:
        if feed.sensor not in known.tables:
            found = f"carries no '{feed.sensor}', which drives the process model '{navigator.composition.process.name}'"
            raise InputError(f"{mission.path}: instruments", found, "give it a rate_hz, here or in the vehicle file")


def eyes_of(recorder: Recorder, mission: Mission, longest: float, seed: int) -> list[Eye]:
    """Return what looks, the inertial unit last: rows before the inputs that cover them."""
    found = []
    for name, instrument in recorder.instruments.items():
        own = instrument.among(lambda what: what.drawn(longest, stream(seed, f"sea/{what.name}")))
        still = settled(own, name, longest, stream(seed, f"settled/{name}"))
        moments = still.sampling(longest, stream(seed, f"sampling/{name}"))
        faults = tuple(fault for fault in mission.faults if fault.sensor == name)
        if isinstance(still, simulated.Imu) and any(isinstance(fault, StuckValue) for fault in faults):
            problem = f"stuck_value of '{name}': its rows are too many to remember where the vehicle steers by its estimate"
            raise InputError(f"{mission.path}: faults", problem, "another sensor")
        found.append(Eye(name, still, moments, behind(still), seed, faults))
    return sorted(found, key=lambda eye: eye.name == mission.vehicle.process.imu)


def behind(instrument: Instrument[Any]) -> float:
    """Return by how much (s) an instrument is looked at late, so that its echoes are back; at most half of what is remembered."""
    if not isinstance(instrument, Acoustic):
        return 0.0
    partners = [*instrument.beacons.values(), *instrument.platforms.values()]
    waits = [float(partner.turnaround) for partner in partners] + [float(getattr(instrument, "turnaround", 0.0))]
    return min(REACH + max(waits), 0.5 * MEMORY)


def recent_of(parts: list[Array]) -> Array:
    """Return the rows of the last minute, one each tick."""
    found: list[Array] = []
    rows = 0
    for part in reversed(parts):
        found.append(part)
        rows += len(part)
        if rows >= MEMORY / TICK:
            break
    return np.ascontiguousarray(np.concatenate(found[::-1]))


@dataclass(eq=False)
class Helm:
    """What steers: the voyage, the navigator aboard, and the instruments between them."""

    mission: Mission
    voyage: Voyage
    navigator: Navigator
    eyes: list[Eye]
    believed: Array | None = None
    waiting: deque[tuple[float, Array]] = field(default_factory=deque)  # what was believed, and when it reaches the pilot
    arriving: list[tuple[float, int, str, Table]] = field(default_factory=list)
    altitude: float = np.nan
    count: int = 0

    def run(self, progress: Callable[[float], None] | None) -> None:
        """Sail to the end; the first second is steered by truth, until the navigator has a word to say."""
        voyage = self.voyage
        voyage.tick(LEAD + STEP)
        while voyage.tick(STEP, self.believed):
            self.listen(voyage.time - TICK)
            if progress is not None and voyage.ticks % 500 == 0:
                progress(min(voyage.time / voyage.expected, 0.99))
        self.listen(voyage.time - TICK)

    def machinery(self) -> Machinery:
        """Return what thrusters and fins did in the last minute."""
        recent = recent_of(self.voyage.moved)
        time = np.asarray(TICK * (self.voyage.ticks - len(recent) + np.arange(len(recent))))
        return Machinery.of(self.mission.hull, time, recent, idle=IDLE, drawn=DRAWN)

    def path(self) -> Trajectory:
        """Return the last minute of what was sailed."""
        recent = recent_of(self.voyage.knots)
        begin = TICK * (self.voyage.ticks - len(recent))
        return Trajectory(self.voyage.place, Dense(begin, TICK, recent), self.voyage.time)

    def listen(self, now: float) -> None:
        """Let all instruments look, hand over what has arrived, and ask the navigator."""
        path = self.path()
        for eye in self.eyes:
            if getattr(eye.instrument, "machinery", None) is not None:
                moved: dict[str, Any] = {"machinery": self.machinery()}
                eye.instrument = replace(eye.instrument, **moved)
            table = eye.look(path, now)
            if table is not None and eye.name in self.mission.vehicle.sensors:
                self.expect(eye.name, table)
        self.arriving.sort(key=lambda item: item[:2])
        while self.arriving and self.arriving[0][0] <= now + 1e-9:
            _, _, name, rows = self.arriving.pop(0)
            self.navigator.receive(name, rows)
            self.hear(rows)
        self.ask(now)

    def expect(self, name: str, table: Table) -> None:
        """Put rows where they wait to arrive: those that come at once together, late ones each by itself."""
        if table.received is None:
            batches = [(float(table.time[-1]), table)]
        else:
            batches = [(float(when), table.select(slice(k, k + 1))) for k, when in enumerate(table.received)]
        for when, rows in batches:
            self.count += 1
            last = isinstance(rows, Imu)
            self.arriving.append((max(when, 0.0), self.count + (10**12 if last else 0), name, rows))

    def hear(self, rows: Table) -> None:
        """Keep the altitude that a Doppler log or an altimeter tells."""
        seen = getattr(rows, "altitude", None)
        seen = getattr(rows, "range", None) if seen is None and rows.kind == "altimeter" else seen
        if seen is not None and len(seen) and np.isfinite(seen[-1]):
            self.altitude = float(seen[-1])

    def ask(self, now: float) -> None:
        """Take down what the navigator believes, and let the pilot have what it believed `delay` ago."""
        if self.navigator.time <= self.navigator.start:
            return
        navigator = self.navigator
        assert navigator.reference is not None
        moment = max(now, navigator.time)
        out = navigator.output(moment)
        found = solution_of(navigator.reference, navigator.composition, np.array([moment]), out[None])
        self.waiting.append((moment + self.mission.delay, self.nav_of(moment, found, out[OUT_VIEW + RATE_V :][:3])))
        while self.waiting and self.waiting[0][0] <= now + 1e-9:
            self.believed = self.waiting.popleft()[1]

    def nav_of(self, moment: float, found: Any, rate_b: Array) -> Array:
        """Return what the pilot reads, steering.py's nav; rate_b: as the process model has it, where there are no gyros."""
        roll, pitch, heading = (float(angle[0]) for angle in euler_from_quaternion(found.quaternion_nb))
        place = found.north[0], found.east[0], found.depth[0], self.altitude
        return np.array([moment, *place, roll, pitch, heading, *found.velocity_n[0], *self.rate(rate_b)], float)

    def rate(self, rate_b: Array) -> Array:
        """Return the angular rate (3,), body axes, as the gyros felt it last; Earth rate and biases are small against any turn.

        rate_b: what is returned where the vehicle has no gyros.
        """
        eye = next((eye for eye in self.eyes if eye.name == self.mission.vehicle.process.imu), None)
        if eye is None:
            return rate_b
        if not eye.pieces:
            return np.zeros(3)
        last, turn = eye.pieces[-1], self.mission.vehicle[eye.name].rotation_bs
        assert isinstance(last, Imu)
        gyro = last.gyro if last.gyro is not None else last.delta_angle / last.interval[:, None]  # type: ignore[operator, index]
        return np.asarray(turn @ np.mean(gyro, axis=0))

    def log(self, template: Log) -> Log:
        """Return what was recorded, with the truth of what was sailed."""
        trajectory = self.voyage.trajectory()
        tables = {eye.name: reduce(after, eye.pieces) for eye in self.eyes if eye.pieces}
        kept = {name: table.select(table.time <= trajectory.duration) for name, table in tables.items()}
        rate = self.mission.truth_rate
        times = np.arange(int(np.floor(trajectory.duration * rate + 1e-6)) + 1) / rate
        return replace(template, tables={**kept, "truth": trajectory.truth(times)}, vehicle=self.mission.vehicle.name)
