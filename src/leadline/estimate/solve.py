"""solve: a log and a vehicle become a Solution.  The engine is the Navigator; here its stream is built and its results are named."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core import attitude, geodesy
from leadline.data.errors import InputError, suggestion
from leadline.data.log import Log, Origin
from leadline.data.outcome import Outcome
from leadline.data.records import Imu, Truth
from leadline.data.solution import Innovations, Solution, Status
from leadline.data.vehicle import Vehicle
from leadline.estimate import kalman
from leadline.estimate import plan as at
from leadline.estimate.composition import Composition, room_for_clones
from leadline.estimate.events import Batch, Events, Screen, agreed, measurements, ordered
from leadline.estimate.navigator import Navigator, Results
from leadline.estimate.output import Reference, solution_of
from leadline.estimate.start import Start, origin_of, start_of
from leadline.models.imu import InputStream, rates_of
from leadline.models.inertial_units import inertial_units, initial_units
from leadline.models.layout import MOST_CLONES
from leadline.models.sensor import Context
from leadline.models.sensors import compose

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from leadline.data.records import Array
    from leadline.data.vehicle import SensorConfig
    from leadline.estimate.events import Integers
    from leadline.models.sensor import Sensor

ESTIMATORS: Mapping[str, Any] = {"ekf": kalman}
DEFAULT_RATE = 10.0
AIDED_FOR = 10.0  # s
MOST_STATES = 3_000_000
UNSEEN = (Outcome.NOT_CONFIGURED, Outcome.NO_MODEL, Outcome.EXCLUDED)


@dataclass(frozen=True)
class Stream:
    """The events of a log, and for each table the outcome of the rows that gave none (USED: it gave some)."""

    events: Events
    outcome: Mapping[str, Integers]
    times: Array  # of the outputs


def solve(
    log: Log,
    vehicle: Vehicle,
    *,
    estimator: str = "ekf",
    rate: float = DEFAULT_RATE,
    times: Array | None = None,
    end: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> Solution:
    """Navigate a whole log, every measurement at its time of validity.

    rate (Hz) or `times` (s, from the log's epoch) say when states are wanted: asking for more changes no estimate.
    `progress` is called with the fraction done.  Raises InputError for what cannot be run: a missing position or heading at the
    start, a process model without its input, a sensor that the process model cannot serve.
    """
    for value, kind, right in ((log, Log, "leadline.read_log(path)"), (vehicle, Vehicle, "leadline.read_vehicle(path)")):
        if not isinstance(value, kind):
            raise InputError("solve", f"was given a {type(value).__name__} for the {kind.__name__.lower()}", f"give {right}")
    navigator, _, _ = navigator_for(log, vehicle, estimator=estimator)
    stream = stream_of(log, vehicle, navigator, rate=rate, times=times, end=end)
    results = navigator.run(stream.events, len(stream.times), progress)
    reference = navigator.reference or Reference(log.epoch, Origin(0.0, 0.0), Context())
    solution = solution_of(reference, navigator.composition, stream.times, results.output)
    innovations = innovations_of(log, vehicle, navigator.composition, stream, results)
    status = np.maximum(solution.status, _status(navigator, stream, results))
    summary = _summary(log, vehicle, estimator, solution, innovations)
    return replace(solution, innovations=innovations, status=status, summary=summary)


def _status(navigator: Navigator, stream: Stream, results: Results) -> Integers:
    """Aided while something that bounds the drift has been used within `AIDED_FOR`, else dead reckoning (n,)."""
    events = stream.events
    measured = np.flatnonzero(events.measured)
    holds = navigator.composition.drift_bounding[events.kind[measured]] if len(measured) else np.zeros(0, bool)
    last = np.concatenate([[navigator.start], events.time[measured][holds & (results.outcome[: len(measured)] == Outcome.USED)]])
    since = stream.times - last[np.maximum(np.searchsorted(last, stream.times, side="right") - 1, 0)]
    return np.where(since <= AIDED_FOR, int(Status.AIDED), int(Status.DEAD_RECKONING))


def navigator_for(log: Log, vehicle: Vehicle, *, estimator: str = "ekf", window: float = 30.0) -> tuple[Navigator, Start, Context]:
    """Return a navigator at the start of a log, that start, and the context of the sensors."""
    if estimator not in ESTIMATORS:
        raise InputError("estimator", f"'{estimator}' is not known", suggestion(estimator, ESTIMATORS))
    if vehicle.process.model != "inertial":
        raise InputError("process.model", f"'{vehicle.process.model}' is not known", "known: inertial")
    context = Context.of(log, vehicle)
    imu = vehicle[vehicle.process.imu]
    sensors = tuple(s for config in vehicle.sensors.values() if (s := compose(config, context)) is not None)
    process = inertial_units(imu, standby_of(vehicle), context.surface)
    clones = vehicle.process.clones
    if clones is None:
        clones = min(MOST_CLONES, room_for_clones(process, sensors), _clones_needed(sensors, log))
    composition = Composition(process, sensors, ESTIMATORS[estimator], clones)
    start = start_of(log, vehicle, context, sensors)
    state = composition.layout.start(start.time, *_initial(start, vehicle, log))
    reference = Reference(log.epoch, origin_of(log, start), context)
    unmodelled = frozenset(vehicle.sensors) - {s.config.name for s in sensors} - {vehicle.process.imu}
    return Navigator(composition, state, InputStream.of(imu), window, reference, unmodelled), start, context


def _clones_needed(sensors: tuple[Sensor, ...], log: Log) -> int:
    """How many poses at earlier epochs the rows of all sensors need at once; one where no row has come yet."""
    twice = [sensor for sensor in sensors if any(channel.epochs == 2 for channel in sensor.channels)]
    if not twice:
        return 0
    tables = [(sensor, log.tables[sensor.config.name]) for sensor in twice if sensor.config.name in log.tables]
    rows = [(r.earlier, table.time[r.row], s.flight) for s, table in tables for r in s.read(table).rows if r.earlier is not None]
    awaited = [(earlier[time - earlier <= flight], time[time - earlier <= flight]) for earlier, time, flight in rows]
    if not sum(len(time) for _, time in awaited):
        return 1
    earlier, time = (np.concatenate(part) for part in zip(*awaited, strict=True))
    first, which = np.unique(earlier, return_inverse=True)
    last = np.full(len(first), -np.inf)
    np.maximum.at(last, which, time)
    begun, ended = np.arange(1, len(first) + 1), np.searchsorted(np.sort(last), first, side="right")
    return int(max(1, (begun - ended).max()))


def _initial(start: Start, vehicle: Vehicle, log: Log) -> tuple[Array, Array]:
    """Nominal motion and its covariance at the IMU, from the start of the body origin."""
    imu = vehicle[vehicle.process.imu]
    rotation = attitude.matrix_from_quaternion(start.quaternion_nb)
    lever = rotation @ imu.lever_arm_b
    turning = rotation @ np.cross(_first_rate(log, vehicle, start), imu.lever_arm_b)
    place = geodesy.ecef_from_geodetic(start.latitude, start.longitude, start.height)
    point = place + geodesy.rotation_en(start.latitude, start.longitude) @ lever
    latitude, longitude, height = geodesy.geodetic_from_ecef(point)
    q_en = attitude.quaternion_from_matrix(geodesy.rotation_en(latitude, longitude))
    values, bias = initial_units(imu, standby_of(vehicle))
    x = np.concatenate([q_en, [float(height)], start.velocity_n + turning, start.quaternion_nb, values])
    tilt = [start.sigma_tilt, start.sigma_tilt, start.sigma_heading]
    sigma = np.array([start.sigma_position, start.sigma_position, start.sigma_depth, *[start.sigma_velocity] * 3, *tilt, *bias])
    shift = np.eye(len(sigma))
    shift[0:3, 6:9], shift[3:6, 6:9] = -_skew(lever), -_skew(turning)
    return x, shift @ np.diag(sigma**2) @ shift.T


def standby_of(vehicle: Vehicle) -> SensorConfig | None:
    """Return the inertial unit that stands in for the first, where there is one."""
    return None if vehicle.process.standby is None else vehicle[vehicle.process.standby]


def _skew(a: Array) -> Array:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _first_rate(log: Log, vehicle: Vehicle, start: Start) -> Array:
    """Angular rate of the body against the Earth at the start (3,): a line through the gyro's rows of a fifth of a second."""
    imu, config = log.tables.get(vehicle.process.imu), vehicle[vehicle.process.imu]
    if not isinstance(imu, Imu):
        return np.zeros(3)
    rates, _, _ = rates_of(imu)
    near = np.flatnonzero(np.isfinite(rates).all(axis=1) & (np.abs(imu.time - start.time) < 0.1))
    near = near[np.argsort(imu.time[near], kind="stable")]  # the order of rows carries no meaning, down to the rounding of a sum
    if not len(near):
        return np.zeros(3)
    time = imu.time[near] - start.time
    line = np.polynomial.polynomial.polyfit(time, rates[near], min(1, len(np.unique(time)) - 1))
    earth = np.array([np.cos(start.latitude), 0.0, -np.sin(start.latitude)]) * geodesy.EARTH_RATE
    return np.asarray(config.rotation_bs @ line[0] - attitude.matrix_from_quaternion(start.quaternion_nb).T @ earth)


def _imu_table(log: Log, vehicle: Vehicle) -> Imu:
    table = log[vehicle.process.imu]
    if not isinstance(table, Imu):
        where = f"{log.path or log.name}: {vehicle.process.imu}"
        raise InputError(where, f"is a table of kind '{table.kind}'", "process.imu needs kind imu")
    return table


def stream_of(
    log: Log, vehicle: Vehicle, navigator: Navigator, *, rate: float = DEFAULT_RATE, times: Array | None = None, end: float | None = None
) -> Stream:
    """Build the stream of a log for a navigator at its start."""
    if navigator.inputs is None:
        raise InputError("solve", "needs a navigator with an input stream")
    start = navigator.start
    when, data, imu_outcome, covered = _inputs_of(log, vehicle)
    outcome: dict[str, Integers] = {vehicle.process.imu: imu_outcome}
    if end is not None and end > covered:
        raise InputError("end", f"{end} s lies after the last inertial row", f"at most {covered} s")
    last = covered if end is None else end
    if last <= start:
        where = f"{log.path or log.name}: [initial] time_s"
        raise InputError(where, f"{start} lies after the last inertial row at {last}", "start earlier")
    inside = (when < last) & (np.arange(len(when)) >= np.searchsorted(when, start) - 1)
    batches = [Batch(at.IS_INPUT, when[inside], data[inside])]
    batches += _measured(log, navigator, start, last, outcome)
    moments = _output_times(start, last, rate) if times is None else np.asarray(times, float)
    if not len(moments) or not (moments.min() >= start and moments.max() <= last):
        found = f"{moments.min()} to {moments.max()} s" if len(moments) else "none"
        raise InputError("times", found, f"the run is from {start} to {last} s")
    batches.append(Batch(at.IS_OUTPUT, np.sort(moments), np.zeros((len(moments), 0))))
    return Stream(ordered(agreed(batches)), outcome, np.sort(moments))


def _inputs_of(log: Log, vehicle: Vehicle) -> tuple[Array, Array, Integers, float]:
    """Start times and inputs of the IMU, the outcome of each of its rows, and the time up to which they reach.

    A last row beyond a gap has no neighbour to confirm its time: it is invalid, or one wrong stamp would lead the run astray.
    """
    table, config = _imu_table(log, vehicle), vehicle[vehicle.process.imu]
    inputs, order = InputStream.of(config), np.argsort(table.time, kind="stable")
    when, data, sorted_outcome = inputs.push(table.select(order))  # type: ignore[arg-type]
    used = np.flatnonzero(sorted_outcome == Outcome.USED)
    time = table.time[order[used]] - config.latency
    if len(used) < 2 or not len(when):
        where = f"{log.path or log.name}: {vehicle.process.imu}"
        raise InputError(where, "gives no interval to navigate over", "at least two valid rows")
    covered = float(time[-1])
    if len(used) > 2 and time[-1] - time[-2] > inputs.gap:
        covered, sorted_outcome[used[-1]] = float(time[-2]), int(Outcome.INVALID)
    outcome = np.empty_like(sorted_outcome)
    outcome[order] = sorted_outcome
    return when[when < covered], data[when < covered], outcome, covered


def _measured(log: Log, navigator: Navigator, start: float, last: float, outcome: dict[str, Integers]) -> list[Batch]:
    """Batches of all sensors; `outcome` gains an entry per table."""
    batches = []
    for sensor in navigator.composition.sensors:
        name = sensor.config.name
        first = navigator.composition.first_slot[name]
        found, outcome[name] = measurements(sensor, first, log[name], Screen(sensor.config.repeats, sensor.config.latency), start, last)
        batches += found
    return batches


def _output_times(start: float, last: float, rate: float) -> Array:
    """Multiples of the output interval inside the run, and both ends."""
    if not 0.0 < rate < np.inf:
        raise InputError("rate", f"{rate} Hz", "give a positive number of states per second")
    if (last - start) * rate > MOST_STATES:
        found = f"{rate} Hz from {start} to {last} s gives {(last - start) * rate:.0f} states"
        raise InputError("rate", found, f"at most {MOST_STATES}: is time_s in seconds? or ask for fewer")
    first, final = int(np.ceil(start * rate - 1e-9)), int(np.floor(last * rate + 1e-9))
    return np.unique(np.clip(np.concatenate([[start], np.arange(first, final + 1) / rate, [last]]), start, last))


def innovations_of(log: Log, vehicle: Vehicle, composition: Composition, stream: Stream, results: Results) -> Innovations:
    """Name the results: one entry per component of each measurement looked at, one per row that was not."""
    events, slots = stream.events, composition.slots
    measured = np.flatnonzero(events.measured)
    slot = events.kind[measured]
    dof = np.array([len(s.channel.components) for s in slots], np.int64)[slot] if len(measured) else np.zeros(0, np.int64)
    group = np.repeat(np.arange(len(measured)), dof)
    component = np.concatenate([np.arange(d) for d in dof]) if len(dof) else np.zeros(0, np.int64)
    of, result = measured[group], results.result[group]
    names = np.array([[*s.channel.components, *[""] * 8][:8] for s in slots] or [[""] * 8])
    looked = np.isfinite(result[:, at.NIS])
    looked_at = Innovations(
        sensor=np.array([s.sensor for s in slots] or [""])[events.kind[of]],
        row=events.row[of],
        group=group,
        time=events.time[of],
        applied=np.where(looked, events.time[of], np.nan),
        component=names[events.kind[of], component],
        residual=np.take_along_axis(result, at.RESIDUAL + component[:, None], 1)[:, 0],
        sigma=np.take_along_axis(result, at.SIGMA + component[:, None], 1)[:, 0],
        nis=result[:, at.NIS],
        dof=dof[group],
        gate_probability=np.array([s.gate_probability for s in slots] or [0.0])[events.kind[of]],
        widened=result[:, at.WIDENED] == 1.0,
        outcome=results.outcome[group],
    )
    return _joined(looked_at, [_unused(name, log, verdicts) for name, verdicts in _all_outcomes(log, vehicle, stream).items()])


def _all_outcomes(log: Log, vehicle: Vehicle, stream: Stream) -> dict[str, Integers]:
    """Outcomes of the rows of every table but truth."""
    return {
        name: stream.outcome.get(name, np.full(len(table), int(_why_not(name, vehicle))))
        for name, table in log.tables.items()
        if not isinstance(table, Truth)
    }


def _why_not(name: str, vehicle: Vehicle) -> Outcome:
    """Why a table was not looked at."""
    if name in vehicle.excluded:
        return Outcome.EXCLUDED
    return Outcome.NO_MODEL if name in vehicle.sensors else Outcome.NOT_CONFIGURED


def _unused(name: str, log: Log, verdicts: Integers) -> Innovations:
    """Entries for the rows that gave no measurement."""
    row = np.flatnonzero(verdicts != Outcome.USED)
    count = len(row)
    none = np.full(count, np.nan)
    return Innovations(
        sensor=np.full(count, name, dtype=f"<U{max(1, len(name))}"),
        row=row,
        group=np.full(count, -1),
        time=log[name].time[row],
        applied=none,
        component=np.full(count, "", dtype="<U1"),
        residual=none,
        sigma=none,
        nis=none,
        dof=np.zeros(count, np.int64),
        gate_probability=none,
        widened=np.zeros(count, bool),
        outcome=verdicts[row],
    )


def _joined(first: Innovations, others: list[Innovations]) -> Innovations:
    """Put entries together in order of time; groups of rows that were not looked at are numbered on."""
    parts = [first, *others]
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in Innovations.__dataclass_fields__}
    unnumbered = joined["group"] < 0
    joined["group"][unnumbered] = (joined["group"].max(initial=-1) + 1) + np.arange(int(unnumbered.sum()))
    return Innovations(**joined).select(np.argsort(joined["time"], kind="stable"))


def _summary(log: Log, vehicle: Vehicle, estimator: str, solution: Solution, innovations: Innovations) -> dict[str, Any]:
    """What was run, and what became of every row."""
    from leadline import __version__

    return {
        "leadline": __version__,
        "log": log.name,
        "vehicle": vehicle.name,
        "process": vehicle.process.model,
        "estimator": estimator,
        "start_s": float(solution.time[0]),
        "end_s": float(solution.time[-1]),
        "counts": counts_of(log, innovations),
        "inputs": {str(path): file_hash(path) for path in _inputs(log, vehicle)},
    }


def _inputs(log: Log, vehicle: Vehicle) -> list[Path]:
    """The files that went in, where they came from files."""
    folder = sorted(log.path.iterdir()) if log.path is not None and log.path.is_dir() else []
    tables = [path for path in folder if path.stem in log.tables or path.name == "log.toml"]
    return tables + ([vehicle.path] if vehicle.path is not None and vehicle.path.is_file() else [])


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def counts_of(log: Log, innovations: Innovations) -> dict[str, dict[str, int]]:
    """Count rows by sensor and outcome; a row of several channels counts as used if any of them was."""
    counts: dict[str, dict[str, int]] = {}
    for name, table in log.tables.items():
        if isinstance(table, Truth):
            continue
        mine = innovations.select(innovations.sensor == name)
        rows, which = np.unique(mine.row, return_inverse=True)
        outcome = np.full(len(rows), max(Outcome))
        np.minimum.at(outcome, which, mine.outcome)
        codes, number = np.unique(outcome, return_counts=True)
        counts[name] = {Outcome(int(c)).name.lower(): int(k) for c, k in zip(codes, number, strict=True)}
        if isinstance(table, Imu) and not np.isin(outcome, UNSEEN).any():
            counts[name] = {"used": len(table) - len(rows), **counts[name]}
    return counts
