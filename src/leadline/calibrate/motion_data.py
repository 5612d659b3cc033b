"""What a log says of the motion of its hull: velocities, attitude and depth as channels, and the thruster speeds that drove it.

A channel predicts its rows from states of the body: nu (n, 6), quaternion_nb (n, 4), depth (n,) and a steady current (2,).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core.attitude import conjugate, logarithm, matrix_from_quaternion, product, quaternion_from_euler, quaternion_from_matrix
from leadline.core.water import ATMOSPHERE, depth_of_pressure, surface_gravity
from leadline.data.errors import InputError, suggestion
from leadline.data.records import Attitude, Depth, Dvl, Pressure, Speed, Thruster, WaterVelocity
from leadline.data.vehicle import SensorConfig
from leadline.simulate.vectors import cross, turned, turned_back

if TYPE_CHECKING:
    import numpy.typing as npt

    from leadline.data.hull import Hull
    from leadline.data.log import Log
    from leadline.data.records import Array, Table
    from leadline.data.solution import Solution
    from leadline.data.vehicle import Vehicle

QUICKEST = 10.0  # rows per second that are used: more say little more


@dataclass(frozen=True, eq=False)
class Channel:
    """Rows of one instrument: quantity velocity, attitude or depth; value (n, 3), quaternion_nb (n, 4) or (n, 1).

    water: through the water; frame: sensor, level (along the heading) or ned; axes: how many of the velocity are measured.
    """

    name: str
    quantity: str
    time: Array
    value: Array
    rotation_bs: Array = field(default_factory=lambda: np.eye(3))
    lever_arm_b: Array = field(default_factory=lambda: np.zeros(3))
    water: bool = False
    frame: str = "sensor"
    axes: int = 3

    @property
    def width(self) -> int:
        """Numbers in a row's residual."""
        return {"velocity": self.axes, "attitude": 3, "depth": 1}[self.quantity]

    def residual(self, index: npt.NDArray[np.int64], nu: Array, quaternion: Array, depth: Array, current: Array) -> Array:
        """Return measured less predicted (n, width) of the rows `index`; of an attitude the rotation vector between them, body axes."""
        if self.quantity == "attitude":
            return logarithm(product(conjugate(quaternion), self.value[index]))
        rotation_nb = matrix_from_quaternion(quaternion)
        if self.quantity == "depth":
            return np.asarray(self.value[index] - (depth + rotation_nb[:, 2] @ self.lever_arm_b)[:, None])
        return np.asarray(self.value[index] - self.predicted(nu, rotation_nb, current)[:, : self.axes])

    def predicted(self, nu: Array, rotation_nb: Array, current: Array) -> Array:
        """Return velocities (n, 3) in the frame of the channel."""
        velocity = nu[:, :3] + cross(nu[:, 3:], np.broadcast_to(self.lever_arm_b, (len(nu), 3)))
        if self.water:
            velocity = velocity - turned_back(rotation_nb, np.broadcast_to([*current, 0.0], (len(nu), 3)))
        if self.frame == "sensor":
            return np.asarray(velocity @ self.rotation_bs)
        level = turned(rotation_nb, velocity)
        return level if self.frame == "ned" else turned(_heading_only(rotation_nb), level)

    def velocity_b(self, index: npt.NDArray[np.int64], rotation_nb: Array) -> Array:
        """Return measured velocities (n, 3) in body axes, what is not measured as zero, the lever arm left out."""
        value = np.zeros((len(index), 3))
        value[:, : self.axes] = self.value[index]
        if self.frame == "sensor":
            return np.asarray(value @ self.rotation_bs.T)
        return turned_back(rotation_nb, value if self.frame == "ned" else turned_back(_heading_only(rotation_nb), value))


def _heading_only(rotation_nb: Array) -> Array:
    """Rotations (n, 3, 3) from north-east-down to level axes along the heading."""
    ahead = rotation_nb[:, :2, 0] / np.linalg.norm(rotation_nb[:, :2, 0], axis=1)[:, None]
    found = np.zeros((len(rotation_nb), 3, 3))
    found[:, 0, :2], found[:, 1, 0], found[:, 1, 1], found[:, 2, 2] = ahead, -ahead[:, 1], ahead[:, 0], 1.0
    return found


@dataclass(frozen=True, eq=False)
class Recorded:
    """A log as the fit takes it: time (n,) and inputs (n, actuators), rps of thrusters and rad of fins; channels; notes for a person."""

    name: str
    time: Array
    inputs: Array
    channels: tuple[Channel, ...]
    latitude: float
    notes: tuple[str, ...] = ()
    motor: tuple[Array, Array] | None = None  # times, and currents (n, thrusters) of the motors (A)

    def of(self, quantity: str) -> tuple[Channel, ...]:
        """Return the channels of a quantity."""
        return tuple(channel for channel in self.channels if channel.quantity == quantity)


def recorded(log: Log, hull: Hull, vehicle: Vehicle | None, solution: Solution | None) -> Recorded:
    """Return what a log, and a solution of it, say; velocities are those of Doppler logs, else of a speed log, else of truth.

    Raises InputError where there is no table of kind thruster, where its thrusters or fins are not those of the hull, and where there is
    no velocity or no attitude.
    """
    where, reader = log.path or log.name, _Reader(log, vehicle)
    time, inputs = _inputs(log, hull, str(where))
    if solution is not None:
        channels = _of_solution(solution)
    else:
        channels = [*reader.dopplers()] or [*reader.speeds()]
        channels += [*reader.attitudes()][:1] + [*reader.depths()][:1]
        channels += _of_truth(log, {channel.quantity for channel in channels})
    kept = tuple(thinned(channel) for channel in channels)
    for quantity, right in (("velocity", "a table dvl, water_velocity or speed"), ("attitude", "a table attitude")):
        if not any(channel.quantity == quantity and len(channel.time) for channel in kept):
            raise InputError(where, f"says no {quantity}", f"log {right}, or give the solution of the log with --solution")
    return Recorded(log.name, time, inputs, kept, _latitude(log, solution), tuple(reader.notes), _motor(log, hull))


def thinned(channel: Channel) -> Channel:
    """Return a channel in the order of time with at most `QUICKEST` rows per second."""
    order = np.argsort(channel.time, kind="stable")
    time = channel.time[order]
    gap = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    order = order[:: max(int(1.0 / (QUICKEST * max(gap, 1e-3)) + 1e-6), 1)]
    return replace(channel, time=channel.time[order], value=channel.value[order])


def _inputs(log: Log, hull: Hull, where: str) -> tuple[Array, Array]:
    """Return times and what drove the hull (n, actuators), rows that are not complete left out."""
    table = _longest(log, Thruster)
    if not isinstance(table, Thruster):
        raise InputError(where, "has no table of kind thruster", "log thruster1_rps, thruster2_rps, ... and rudder and stern angles")
    count = table.thruster.shape[1]
    if count != len(hull.thrusters):
        names = ", ".join(t.name for t in hull.thrusters)
        raise InputError(where, f"has the speeds of {count} thrusters", f"{hull.name} has {len(hull.thrusters)} ({names})")
    columns = [table.thruster]
    for fin in hull.fins:
        angle = table.rudder if fin.kind == "rudder" else table.stern
        if angle is None:
            raise InputError(where, f"does not say how the {fin.name} of {hull.name} stood", f"log the angle of the {fin.kind}")
        columns.append(angle[:, None])
    values = np.hstack(columns)
    good = np.isfinite(table.time) & np.all(np.isfinite(values), axis=1) & _valid(table)
    time, first = np.unique(table.time[good], return_index=True)
    return time, values[good][first]


def _motor(log: Log, hull: Hull) -> tuple[Array, Array] | None:
    table: Any = next((t for t in log.tables.values() if t.kind == "motor_current"), None)
    if table is None or table.motor.shape[1] != len(hull.thrusters):
        return None
    good = np.all(np.isfinite(table.motor), axis=1)
    order = np.argsort(table.time[good], kind="stable")
    return table.time[good][order], table.motor[good][order]


def _longest(log: Log, kind: type[Table]) -> Table | None:
    tables = [table for table in log.tables.values() if type(table) is kind and len(table)]
    return max(tables, key=len) if tables else None


def _valid(table: Table) -> npt.NDArray[np.bool_]:
    return np.ones(len(table), bool) if table.valid is None else np.nan_to_num(table.valid) != 0


def _latitude(log: Log, solution: Solution | None) -> float:
    """Return the latitude of the log (rad), for its gravity; in the middle of the range where nothing says it."""
    if solution is not None:
        return float(solution.latitude[0])
    truth = log.truth
    if truth is not None and truth.latitude is not None and np.any(np.isfinite(truth.latitude)):
        return float(np.nanmedian(truth.latitude))
    known = log.initial.latitude if log.origin is None else log.origin.latitude
    return np.pi / 4 if known is None else known


@dataclass(eq=False)
class _Reader:
    """Reads instruments as they are mounted."""

    log: Log
    vehicle: Vehicle | None

    def __post_init__(self) -> None:
        """Begin with nothing to say."""
        self.notes: list[str] = []

    def tables(self, kind: type[Table]) -> list[tuple[str, Any, SensorConfig]]:
        """Return the tables of a kind with their mounting; where the vehicle file names some, those alone."""
        found = [(name, table) for name, table in self.log.tables.items() if type(table) is kind and len(table)]
        known = [(n, t, self.vehicle.sensors[n]) for n, t in found if self.vehicle is not None and n in self.vehicle.sensors]
        if known or not found:
            return known
        name, table = max(found, key=lambda pair: len(pair[1]))
        self.notes.append(f"{name}: no vehicle file says how it is mounted; it is taken to sit at the body origin, along the body axes")
        return [(name, table, SensorConfig(name, kind.kind))]

    def dopplers(self) -> list[Channel]:
        """Return Doppler logs over ground and through the water, a channel for each frame of their rows."""
        found = []
        for kind in (Dvl, WaterVelocity):
            for name, table, config in self.tables(kind):
                if table.velocity is None:
                    self.notes.append(f"{name}: has beams alone, which are not read here")
                    continue
                default = config.value("frame", "sensor")
                words = np.full(len(table), default) if table.frame is None else np.where(table.frame == "", default, table.frame)
                found += [_doppler(name, table, config, str(w), words == w, kind is WaterVelocity) for w in np.unique(words)]
        return [channel for channel in found if len(channel.time)]

    def speeds(self) -> list[Channel]:
        """Return logs of speed through the water."""
        found = []
        for name, table, config in self.tables(Speed):
            good = np.isfinite(table.speed) & _valid(table)
            value = table.speed[good, None] / (1 + _scale(config))
            found.append(Channel(name, "velocity", table.time[good], value, config.rotation_bs, config.lever_arm_b, water=True, axes=1))
        return found

    def attitudes(self) -> list[Channel]:
        """Return attitudes of the body."""
        found = []
        for name, table, config in self.tables(Attitude):
            q = table.quaternion
            q = quaternion_from_euler(table.roll, table.pitch, table.heading) if q is None else q
            good = np.all(np.isfinite(q), axis=1) & _valid(table)
            body = product(q[good], conjugate(quaternion_from_matrix(config.rotation_bs)))
            found.append(Channel(name, "attitude", table.time[good], body))
        return found

    def depths(self) -> list[Channel]:
        """Return depths, else those of pressures."""
        found = []
        for kind in (Depth, Pressure):
            for name, table, config in self.tables(kind):
                value = table.depth if isinstance(table, Depth) else _depth_of(table, _latitude(self.log, None))
                good = np.isfinite(value) & _valid(table)
                found.append(Channel(name, "depth", table.time[good], value[good, None], lever_arm_b=config.lever_arm_b))
        return found


def _doppler(name: str, table: Any, config: SensorConfig, frame: str, rows: npt.NDArray[np.bool_], water: bool) -> Channel:
    """Return the rows of one frame; scale and mounting error that the vehicle file states are taken out of those in sensor axes."""
    if frame not in ("sensor", "body", "level", "ned"):
        raise InputError(f"{name}: frame", f"'{frame}' is not known", suggestion(frame, ("sensor", "body", "level", "ned")))
    good = rows & _valid(table) & np.all(np.isfinite(table.velocity), axis=1)
    value = table.velocity[good] / (1 + _scale(config))
    twist = config.nuisance.get("mounting")
    if twist is not None and frame == "sensor":
        value = value + cross(np.broadcast_to(twist.value, value.shape), value)
    rotation = config.rotation_bs if frame == "sensor" else np.eye(3)
    plain = "sensor" if frame == "body" else frame
    return Channel(name, "velocity", table.time[good], value, rotation, config.lever_arm_b, water=water, frame=plain)


def _scale(config: SensorConfig) -> float:
    prior = config.nuisance.get("scale")
    return 0.0 if prior is None else float(np.ravel(prior.value)[0])


def _depth_of(table: Pressure, latitude: float) -> Array:
    """Return the depth (n,) of absolute pressures in the standard ocean."""
    air = ATMOSPHERE if table.atmosphere is None else np.where(np.isfinite(table.atmosphere), table.atmosphere, ATMOSPHERE)
    g = surface_gravity(float(np.sin(latitude) ** 2))
    return np.array([depth_of_pressure(p, g) for p in table.pressure - air])


def _of_solution(solution: Solution) -> list[Channel]:
    """Return velocity, attitude and depth of the body origin."""
    if "at" in solution.summary:
        raise InputError("--solution", f"holds the states of '{solution.summary['at']}'", "solve without --at: the body origin is needed")
    return [
        Channel("solution", "velocity", solution.time, solution.velocity_n, frame="ned"),
        Channel("solution", "attitude", solution.time, solution.quaternion_nb),
        Channel("solution", "depth", solution.time, solution.depth[:, None]),
    ]


def _of_truth(log: Log, known: set[str]) -> list[Channel]:
    """Return of a truth what no instrument says."""
    truth, found = log.truth, []
    if truth is None:
        return []
    angles = (truth.roll, truth.pitch, truth.heading)
    if truth.velocity is not None and "velocity" not in known:
        good = np.all(np.isfinite(truth.velocity), axis=1)
        found.append(Channel("truth", "velocity", truth.time[good], truth.velocity[good], frame="ned"))
    if not any(angle is None for angle in angles) and "attitude" not in known:
        q = quaternion_from_euler(*(angle for angle in angles if angle is not None))
        good = np.all(np.isfinite(q), axis=1)
        found.append(Channel("truth", "attitude", truth.time[good], q[good]))
    if truth.depth is not None and "depth" not in known:
        good = np.isfinite(truth.depth)
        found.append(Channel("truth", "depth", truth.time[good], truth.depth[good, None]))
    return found
