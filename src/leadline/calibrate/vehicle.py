"""A hull from a log of its own: drag, thrust, buoyancy and trim fitted by output error (hull_fit.py), and what of it is worth believing."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.calibrate.hull_fit import Fit, fit
from leadline.calibrate.hull_knobs import AXES, current_of, hull_with, knobs_of
from leadline.calibrate.hull_problem import between
from leadline.calibrate.motion_data import recorded
from leadline.core.attitude import matrix_from_quaternion
from leadline.simulate.dynamics import site_at
from leadline.simulate.vectors import turned_back

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from leadline.calibrate.hull_knobs import Knob
    from leadline.calibrate.motion_data import Recorded
    from leadline.data.hull import Hull
    from leadline.data.log import Log
    from leadline.data.records import Array
    from leadline.data.solution import Solution
    from leadline.data.vehicle import Vehicle

SURE, ROUGH = 0.15, 0.5  # sigma after the log, of that before it
READING = 0.004  # of the sigma before the log: thrusters are logged in steps, and straight in between
ALONG = 0.5  # cosine from which a thruster counts as one that drives ahead, or up and down
STEADY = 0.1  # change of speed within a stretch, of the speed, below which it is steady
STRAIGHT = 0.03  # rad/s: the mean turn below which a stretch is straight
SEVERAL = 4  # steady stretches that a line of speed against rps needs
RESTLESS = 2.0  # velocities that stray by so many times their noise: no number is called determined then
ODD = 2.0  # residual of a stretch, in sigmas, from which it is said not to fit


class Verdict(StrEnum):
    """How well a log determines a number."""

    DETERMINED = "determined"
    ROUGHLY = "roughly"
    TOGETHER = "only together with"
    ALIKE = "not run: as the others of its make"
    KEPT = "not shown by this log: kept"


@dataclass(frozen=True)
class Quantity:
    """One number of the hull: in the starting hull, by the log with its sigma, and the verdict (partner: with what together)."""

    name: str
    part: str
    index: int
    unit: str
    start: float
    value: float
    sigma: float
    verdict: Verdict
    partner: str = ""


@dataclass(frozen=True)
class Drag:
    """The drag (N or N m) of an axis at a speed (m/s or rad/s) that the log holds, both coefficients together, with its sigma."""

    axis: str
    speed: float
    value: float
    sigma: float


@dataclass(frozen=True)
class SpeedLine:
    """speed = slope x rps (m per revolution) of the thrusters that drive ahead, with its sigma and the scatter (m/s) about it."""

    slope: float
    sigma: float
    scatter: float
    stretches: int
    slowest: float
    fastest: float


@dataclass(frozen=True)
class Trim:
    """How it keeps its depth: buoyancy less weight (N, positive floats) and its sigma; rps of the vertical thrusters that holds it down
    (negative: up; None: it has none); pitch and stern plane angle (rad) of steady level ahead, None without such stretches.
    """

    buoyancy: float
    sigma: float
    share_of_weight: float
    rps: float | None
    pitch: float | None
    stern: float | None


@dataclass(frozen=True)
class Residual:
    """What is left of one component: rms against the run again, and the share of its change within stretches that the fit explains."""

    channel: str
    component: int
    quantity: str
    rms: float
    explained: float


@dataclass(frozen=True, eq=False)
class VehicleCalibration:
    """A fitted hull, and how well the log (seconds of it were used, cut into stretches) determines each number.

    current (north, east, m/s) with sigmas; amperes: A per rps^2 of each thruster, where motor currents were logged.
    """

    log: str
    seconds: float
    stretches: int
    start: Hull
    hull: Hull
    quantities: tuple[Quantity, ...]
    drags: tuple[Drag, ...]
    line: SpeedLine | None
    trim: Trim
    residuals: tuple[Residual, ...]
    amperes: tuple[float, ...]
    converged: bool
    notes: tuple[str, ...]

    def __getitem__(self, name: str) -> Quantity:
        """Return a number by its name; raises KeyError for one that was not fitted."""
        return next((q for q in self.quantities if q.name == name), None) or _missing(name)

    def to_dict(self) -> dict[str, Any]:
        """Return all but the hulls as plain values, in SI and radians."""
        plain = {name: value for name, value in vars(self).items() if name not in ("start", "hull")}
        for name in ("quantities", "drags", "residuals"):
            plain[name] = [asdict(one) for one in plain[name]]
        return plain | {
            "hull": self.hull.name,
            "line": None if self.line is None else asdict(self.line),
            "trim": asdict(self.trim),
        }


def _missing(name: str) -> Quantity:
    raise KeyError(name)


def calibrate_vehicle(
    log: Log,
    hull: Hull,
    vehicle: Vehicle | None = None,
    solution: Solution | None = None,
    *,
    density: float = 1025.0,
    progress: Callable[[float], None] = lambda _: None,
) -> VehicleCalibration:
    """Fit drag, thrust, lift, buoyancy and trim of a hull to a log of it.

    hull: where to start; its mass, inertia, added mass and geometry are taken as they are.  vehicle: how instruments are mounted (without
    it: at the body origin).  solution: a solution of the log, whose velocity and attitude are then taken.  density (kg/m^3) of the water.
    A steady current is estimated along with it wherever a velocity over ground is used.  Raises InputError where the log has no thruster
    speeds, no velocity or no attitude, where it does not fit the hull, and where it is too short.
    """
    data = recorded(log, hull, vehicle, solution)
    gravity = float(site_at(data.latitude, 0.0, density)[3])
    grounded = any(not channel.water for channel in data.of("velocity"))
    knobs = knobs_of(hull, density, gravity, current=grounded)
    found = fit(data, hull, knobs, density, progress)
    x = np.where([v is Verdict.KEPT for v in verdicts(found)], 0.0, found.x)
    fitted = hull_with(hull, found.problem.knobs, x, density, gravity)
    moved = Moved(found)
    length = found.problem.length
    return VehicleCalibration(
        log=log.name,
        seconds=length * len(found.begin),
        stretches=len(found.begin),
        start=hull,
        hull=fitted,
        quantities=quantities(found),
        drags=_drags(found, moved),
        line=moved.line(),
        trim=_trim(found, moved, fitted),
        residuals=_residuals(found),
        amperes=_amperes(data),
        converged=found.converged,
        notes=data.notes + _notes(found),
    )


def sigmas(found: Fit) -> Array:
    """Return the sigma of x (n,), with what the reading of the thrusters is worth."""
    return np.asarray(np.sqrt(np.diag(found.covariance) + READING**2))


def verdicts(found: Fit) -> list[Verdict]:
    """Return how well each number is determined: by its sigma after the log, and by what the log alone says of it."""
    told = np.diag(found.information) > 1.0
    made = [_verdict(knob, bool(t), float(s)) for knob, t, s in zip(found.problem.knobs, told, sigmas(found), strict=True)]
    doubtful = found.stray > RESTLESS or not found.converged
    return [Verdict.ROUGHLY if doubtful and v is Verdict.DETERMINED else v for v in made]


def _verdict(knob: Knob, told: bool, sigma: float) -> Verdict:
    if not told:
        return Verdict.ALIKE if knob.part in ("ahead", "astern") and sigma < ROUGH else Verdict.KEPT
    if sigma <= SURE:
        return Verdict.DETERMINED
    return Verdict.ROUGHLY if sigma <= ROUGH else Verdict.TOGETHER


def quantities(found: Fit) -> tuple[Quantity, ...]:
    """Return each number with its sigma and verdict; what is kept stands as it was."""
    covariance = found.covariance
    scale = np.sqrt(np.diag(covariance))
    relation = np.abs(covariance / np.outer(scale, scale)) - 2 * np.eye(len(scale))
    knobs, made = found.problem.knobs, []
    for k, (knob, verdict, sigma) in enumerate(zip(knobs, verdicts(found), sigmas(found), strict=True)):
        still, partner = verdict is Verdict.KEPT, knobs[int(np.argmax(relation[k]))].name if verdict is Verdict.TOGETHER else ""
        value = knob.start if still else knob.value(found.x[k])
        made.append(Quantity(knob.name, knob.part, knob.index, knob.unit, knob.start, value, float(knob.spread * sigma), verdict, partner))
    kept = [Quantity(k.name, k.part, k.index, k.unit, k.start, k.start, k.spread, Verdict.KEPT) for k in found.pinned]
    return (*made, *kept)


class Moved:
    """The motion that was found: of each stretch, velocity through the water, rates, angles and inputs at nodes."""

    def __init__(self, found: Fit) -> None:
        """Run all stretches again."""
        problem = found.problem
        states = problem.states(found.x, found.begin)
        self.hull, self.inputs = problem.hull, problem.inputs
        rotation = matrix_from_quaternion(states[:, :, 3:7])
        stream = np.broadcast_to([*current_of(problem.knobs, found.x), 0.0], (*states.shape[:2], 3))
        self.nu = states[:, :, 7:13].copy()
        self.nu[:, :, :3] -= turned_back(rotation, stream)
        self.pitch = np.arcsin(np.clip(-rotation[:, :, 2, 0], -1.0, 1.0))
        self.sinking = (states[:, -1, 2] - states[:, 0, 2]) / problem.length

    def rps(self) -> Array | None:
        """Mean speed (stretches,) of the thrusters that drive ahead, None where there are none."""
        along = np.array([t.direction_b[0] for t in self.hull.thrusters])
        driving = np.abs(along) > ALONG
        return None if not np.any(driving) else np.mean((self.inputs[:, :, : len(along)] * np.sign(along))[:, :, driving], axis=(1, 2))

    def steady(self) -> npt.NDArray[np.bool_]:
        """Which stretches go straight ahead at a steady speed."""
        u = self.nu[:, :, 0]
        mean = np.mean(u, axis=1)
        across = np.mean(np.hypot(self.nu[:, :, 1], self.nu[:, :, 2]), axis=1)
        straight = (mean > 3 * across) & (np.abs(np.mean(self.nu[:, :, 5], axis=1)) < STRAIGHT)
        return np.asarray((np.ptp(u, axis=1) < STEADY * mean) & straight, np.bool_)

    def line(self) -> SpeedLine | None:
        """Return the line of speed against rps, None where fewer than `SEVERAL` stretches are steady."""
        rps = self.rps()
        if rps is None:
            return None
        pick = self.steady() & (rps > 0.0)
        if np.sum(pick) < SEVERAL:
            return None
        n, u = rps[pick], np.mean(self.nu[pick, :, 0], axis=1)
        slope = float(n @ u / (n @ n))
        scatter = float(np.sqrt(np.sum((u - slope * n) ** 2) / (len(n) - 1)))
        return SpeedLine(slope, scatter / float(np.sqrt(n @ n)), scatter, len(n), float(u.min()), float(u.max()))


def _drags(found: Fit, moved: Moved) -> tuple[Drag, ...]:
    """Return the drag of each axis at the speed that it exceeds a tenth of the time."""
    made, knobs = [], found.problem.knobs
    for axis, name in enumerate(AXES):
        speed = float(np.quantile(np.abs(moved.nu[:, :, axis]), 0.9))
        factors = {"linear": speed, "quadratic": speed**2}
        weights = np.array([factors.get(k.part, 0.0) * (k.index == axis) * k.spread for k in knobs])
        value = sum(factors[k.part] * k.value(v) for k, v in zip(knobs, found.x, strict=True) if k.part in factors and k.index == axis)
        if np.any(weights > 0.0):
            made.append(Drag(name, speed, float(value), float(np.hypot(np.sqrt(weights @ found.covariance @ weights), READING * value))))
    return tuple(made)


def _trim(found: Fit, moved: Moved, fitted: Hull) -> Trim:
    one = next(q for q in quantities(found) if q.part == "buoyancy")
    level = moved.steady() & (np.abs(moved.sinking) < 0.03)
    pitch = float(np.mean(moved.pitch[level])) if np.any(level) else None
    sterns = [len(fitted.thrusters) + k for k, fin in enumerate(fitted.fins) if fin.kind == "stern"]
    stern = float(np.mean(moved.inputs[level][:, :, sterns[0]])) if np.any(level) and sterns else None
    weight = fitted.mass * float(found.problem.site[3])
    return Trim(one.value, one.sigma, one.value / weight, _holding(fitted, one.value), pitch, stern)


def _holding(hull: Hull, buoyancy: float) -> float | None:
    """Return the rps, the same for all vertical thrusters, that holds a buoyancy (N): positive where they push down."""
    push = 0.0
    for thruster in hull.thrusters:
        down = thruster.direction_b[2]
        if abs(down) > ALONG:
            push += abs(down) * (thruster.ahead if down * buoyancy > 0 else thruster.astern)
    return float(np.sign(buoyancy) * np.sqrt(abs(buoyancy) / push)) if push > 0 else None


def _residuals(found: Fit) -> tuple[Residual, ...]:
    problem, made = found.problem, []
    states, current = problem.states(found.x, found.begin), current_of(problem.knobs, found.x)
    resting = np.broadcast_to(states[:, :1], states.shape)
    for rows in problem.rows:
        left = rows.channel.residual(rows.index, *between(states, rows), current)
        still = rows.channel.residual(rows.index, *between(resting, rows), current)
        for k in range(rows.channel.width):
            share = 1 - np.mean(left[:, k] ** 2) / max(float(np.mean(still[:, k] ** 2)), 1e-300)
            made.append(Residual(rows.channel.name, k, rows.channel.quantity, float(np.sqrt(np.mean(left[:, k] ** 2))), float(share)))
    return tuple(made)


def _amperes(data: Recorded) -> tuple[float, ...]:
    """Return the motor current for each rps^2 (A), least squares with what flows at rest; empty where it was not logged."""
    if data.motor is None:
        return ()
    time, current = data.motor
    made = []
    for k, own in enumerate(current.T):
        n = np.interp(time, data.time, data.inputs[:, k])
        columns = np.column_stack([n * n, np.ones(len(n))])
        made.append(float(np.linalg.lstsq(columns, np.abs(own), rcond=None)[0][0]))
    return tuple(made)


def _notes(found: Fit) -> tuple[str, ...]:
    notes = []
    if not found.converged:
        what = "the search did not settle: nothing is determined, and sigmas are too small"
        notes.append(f"{what}; is this the right hull to start from, and is the Doppler log calibrated?")
    if found.stray > RESTLESS:
        what = f"velocities stray by {found.stray:.1f} times their noise from the motion that thrusters and drag explain"
        why = "waves, a changing current, errors of a solution that wander"
        notes.append(f"{what} ({why}): nothing is determined, the roll least; a calmer or deeper log says more")
    elif found.widened > 1.2:
        notes.append(f"stretches scatter more than the noise of rows explains: sigmas are widened by {found.widened:.1f}")
    size = (found.problem.residuals(found.x, found.begin) / found.sigma[found.problem.group])[found.problem.order[0]]
    bounds = found.problem.order[1]
    odd = sum(float(np.sqrt(np.mean(size[a:b] ** 2))) > ODD for a, b in pairwise(bounds))
    if odd:
        notes.append(f"{odd} of {len(found.begin)} stretches do not fit (a touch, a tether, an instrument that failed); they count less")
    return tuple(notes)


def changed(quantity: Quantity) -> bool:
    """Return whether the log gave a number a value."""
    return quantity.verdict is not Verdict.KEPT
