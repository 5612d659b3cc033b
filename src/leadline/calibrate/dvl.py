"""Scale, mounting and lever arm of a Doppler log, from logs that have a reference for position.

Each log is navigated with these as states of which little is known; what its data say is what the filter knows at the end
less what it was told at the start.  Logs are independent, so their information adds:
    I_k = P_k^-1 - P_0^-1,     P = (P_0^-1 + sum I_k)^-1,     x = P (P_0^-1 x_0 + sum (P_k^-1 x_k - P_0^-1 x_0))
and the logs are held against each other: chi-square of their estimates about the common one; where it is too large the sigma grows by
its root (Birge, 1932).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from leadline.calibrate.reference import referenced
from leadline.core.compiled import WIDE
from leadline.data.errors import InputError, suggestion
from leadline.data.vehicle import DEGREE, Prior
from leadline.estimate.assembly import navigator_for
from leadline.estimate.run import Results
from leadline.estimate.stream import stream_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from leadline.data.log import Log
    from leadline.data.records import Array, Table
    from leadline.data.vehicle import Vehicle

QUANTITIES = ("scale", "mounting_x", "mounting_y", "mounting_z", "lever_x", "lever_y", "lever_z")
BROAD = np.array([0.05, 0.05, 0.05, 0.1, 1.0, 1.0, 1.0])  # sigma before any log: scale (1), mounting (rad), lever arm (m)
SCALE, HEADING = 0, 3
GOOD, FAIR = (0.001, 0.002), (0.003, 0.006)  # sigma of scale, and of the mounting's heading, that a survey needs, and that are of use
UNLIKELY = 0.01
LEVER_KNOWN = 0.15  # m


class Light(StrEnum):
    """How good a calibration is."""

    GREEN = "green"
    YELLOW = "yellow"
    RED = "red"


@dataclass(frozen=True)
class DvlCalibration:
    """Errors over `QUANTITIES` with covariance (7, 7), and by log its own (logs, 7) with sigma: scale (1), mounting (rad, sensor axes),
    lever arm (m, body axes, beyond that of the vehicle file).

    p: probability of logs that differ as much as these; where it is small the covariance has been enlarged by `enlarged`.
    """

    sensor: str
    value: Array
    covariance: Array
    logs: tuple[str, ...]
    by_log: Array
    sigma_by_log: Array
    p: float
    enlarged: float
    light: Light
    sentence: str

    @property
    def sigma(self) -> Array:
        """Standard deviations (7,)."""
        return np.sqrt(np.diag(self.covariance))


def calibrate_dvl(
    logs: Sequence[Log],
    vehicle: Vehicle,
    *,
    sensor: str = "dvl",
    reference: str = "truth",
    fixes: Sequence[Table | None] = (),
    progress: Callable[[float], None] | None = None,
) -> DvlCalibration:
    """Estimate scale, mounting and lever arm of a Doppler log from several logs at once.

    reference: "fixes" that the vehicle file names, "truth", or "ends" of the truth; `fixes` holds for each log a table to take instead.
    Raises InputError for a sensor that is no Doppler log, and for a log without the reference.
    """
    if not logs:
        raise InputError("calibrate dvl", "has no log", "give at least one")
    if sensor not in vehicle.sensors or vehicle[sensor].kind not in ("dvl", "water_velocity"):
        known = [n for n, c in vehicle.sensors.items() if c.kind in ("dvl", "water_velocity")]
        raise InputError(f"{vehicle.path or vehicle.name}", f"has no Doppler log '{sensor}'", suggestion(sensor, known))
    told = vehicle[sensor].nuisance
    centre = np.array([_value(told.get("scale"), 1)[0], *_value(told.get("mounting"), 3), *_value(told.get("lever"), 3)])
    broad = _broadened(vehicle, sensor, centre)
    found = []
    for k, log in enumerate(logs):
        found.append(_learned(*referenced(log, broad, reference, fixes[k] if k < len(fixes) else None), sensor))
        if progress is not None:
            progress((k + 1) / len(logs))
    return combined(sensor, [log.name for log in logs], centre, found)


def _value(prior: Prior | None, axes: int) -> Array:
    return np.zeros(axes) if prior is None else np.broadcast_to(prior.value, axes)


def _broadened(vehicle: Vehicle, sensor: str, centre: Array) -> Vehicle:
    """The vehicle with a Doppler log of which little is known."""
    config = vehicle[sensor]
    parts = {"scale": slice(0, 1), "mounting": slice(1, 4), "lever": slice(4, 7)}
    priors = {name: Prior(centre[part], BROAD[part]) for name, part in parts.items()}
    return replace(vehicle, sensors={**vehicle.sensors, sensor: replace(config, nuisance={**config.nuisance, **priors})})


def _learned(log: Log, vehicle: Vehicle, sensor: str) -> tuple[Array, Array]:
    """Estimate (7,) and covariance (7, 7) at the end of a log."""
    navigator, _, _ = navigator_for(log, vehicle)
    layout = navigator.composition.layout
    index = np.array([layout.nuisance_error(f"{sensor}.{name}") for name in QUANTITIES])
    stream = stream_of(log, vehicle, navigator, rate=0.1)
    for events in stream:
        navigator.runner.run(navigator.state, events, Results.room(navigator.composition, int(events.measured.sum()), len(stream.times)))
    x = navigator.state[layout.x][layout.motion_nominal - layout.motion_error + index]
    full = navigator.state[layout.covariance].reshape(layout.error, WIDE)
    return x.copy(), full[np.ix_(index, index)].copy()


def combined(sensor: str, names: Sequence[str], centre: Array, found: Sequence[tuple[Array, Array]]) -> DvlCalibration:
    """Put what several logs say together, and say how good it is."""
    from scipy.special import gammaincc

    told = np.diag(BROAD**-2)
    information = [np.linalg.inv(p) - told for _, p in found]
    vectors = [np.linalg.inv(p) @ x - told @ centre for x, p in found]
    covariance = np.linalg.inv(told + sum(information, np.zeros_like(told)))
    value = covariance @ (told @ centre + sum(vectors, np.zeros(len(BROAD))))
    square, dof = 0.0, 0
    for i, v in zip(information, vectors, strict=True):  # (x_k - x)^T I_k (x_k - x) in units of the prior, where the log says something
        w, e = np.linalg.eigh(0.5 * (i + i.T) * np.outer(BROAD, BROAD))
        strong = w > 1.0
        square += float(np.sum(((e.T @ (BROAD * (v - i @ value)))[strong] ** 2) / w[strong]))
        dof += int(strong.sum())
    together = 0.5 * (sum(information) + sum(information).T) * np.outer(BROAD, BROAD)  # type: ignore[union-attr]
    dof = max(0, dof - int((np.linalg.eigvalsh(together) > 1.0).sum()))
    p = float(gammaincc(0.5 * dof, 0.5 * square)) if dof and len(found) > 1 else 1.0
    enlarged = float(np.sqrt(max(1.0, square / dof))) if p < UNLIKELY else 1.0
    covariance = covariance * enlarged**2
    light, sentence = judged(value, np.sqrt(np.diag(covariance)), p, len(found))
    by_log = np.array([x for x, _ in found])
    sigma_by_log = np.array([np.sqrt(np.diag(q)) for _, q in found])
    return DvlCalibration(sensor, value, covariance, tuple(names), by_log, sigma_by_log, p, enlarged, light, sentence)


def judged(value: Array, sigma: Array, p: float, logs: int) -> tuple[Light, str]:
    """Return the traffic light and a sentence that says why."""
    own = sigma[[SCALE, HEADING]]
    along, across = 1000.0 * own
    attained = f"attained {along:.2g} m per km along the track and {across:.2g} m per km across it"
    if np.any(np.abs(value) > 3.0 * BROAD):
        return Light.RED, f"an error is far larger than any instrument's: is the mounting right? ({attained})"
    if np.any(own > FAIR):
        return Light.RED, f"the logs do not determine it: {attained}; more logs, longer legs on opposite headings, or a better reference"
    if p < UNLIKELY:
        return Light.YELLOW, f"the logs disagree (p = {p:.1g}), and the sigmas were enlarged: {attained}"
    if np.any(own > GOOD):
        return Light.YELLOW, f"usable: {attained}; a survey wants 1 and 2"
    if logs == 1:
        return Light.YELLOW, f"{attained}, from one log alone: nothing confirms it"
    return Light.GREEN, f"{attained}, and the logs agree"


def fragment(found: DvlCalibration, vehicle: Vehicle) -> str:
    """Return a calibration as a fragment of a vehicle file; the lever arm only where the logs have determined it."""
    turn, value, sigma = 1.0 / DEGREE, found.value, found.sigma
    lines = [
        f"# {found.light.value}: {found.sentence}",
        f"# from {', '.join(found.logs)}",
        f"[sensors.{found.sensor}]",
    ]
    known = bool(np.all(sigma[4:] < LEVER_KNOWN))
    if known:
        arm = vehicle[found.sensor].lever_arm_b + value[4:]
        lines.append(f"lever_arm_m = {_listed(arm, 3)}  # sigma {_listed(sigma[4:], 3)}")
    lines += [
        f"[sensors.{found.sensor}.nuisance]",
        *(["lever = { value_m = [0.0, 0.0, 0.0] }"] if known and "lever" in vehicle[found.sensor].nuisance else []),
        f"scale = {{ value_percent = {100.0 * value[0]:.4f}, sigma_percent = {100.0 * sigma[0]:.4f} }}",
        f"mounting = {{ value_deg = {_listed(turn * value[1:4], 4)}, sigma_deg = {_listed(turn * sigma[1:4], 4)} }}",
    ]
    return "\n".join(lines) + "\n"


def _listed(values: Array, digits: int) -> str:
    return "[" + ", ".join(f"{v:.{digits}f}" for v in values) + "]"
