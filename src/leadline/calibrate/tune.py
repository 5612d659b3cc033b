"""Sigmas of sensors and of the process noise from what logs' innovations say, as a fragment of a vehicle file.

The likelihood is that of likelihood.py, its maximum and the intervals are found in fit.py.  An interval is that of a sigma from as many
independent values as the variance v of its logarithm is worth: chi-square with 1 / (2 v) degrees of freedom.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from leadline.calibrate.fit import Fit
from leadline.calibrate.knobs import knobs_of
from leadline.calibrate.likelihood import Recording
from leadline.data.errors import InputError, suggestion

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from leadline.calibrate.knobs import Knob
    from leadline.calibrate.likelihood import Inside, Looked
    from leadline.data.log import Log
    from leadline.data.records import Array
    from leadline.data.vehicle import Vehicle

LEVEL = 0.95
FEWEST = 20  # rows below which a sigma wrong by 2 cannot be shown
WIDEST = 2.0  # an interval that reaches further to either side of the estimate determines nothing
FAR = 100.0  # a factor that is not worth a figure
NOTHING = 3.0  # so much less in the logarithm counts as no process noise at all
MOST_OFTEN = 2.71  # twice the log-likelihood by which a variance must beat zero: 5 %, one-sided
CORRELATED, CERTAIN, LAGS = 0.1, 4.0, 10  # material, and in standard errors; over so many lags
UNLIKELY = 0.999  # more rows outside the gate than in so many of as many cases
MENTIONED = 1.1  # times by which an interval is enlarged
RUNS = 30  # of all logs that a fit of one sigma takes, about; for the bar of progress


@dataclass(frozen=True)
class Tuned:
    """One sigma: its key and its value in the vehicle file, and by the logs an estimate with a 95 % interval, all in the key's unit.

    key: "" where the table has a column of its own; values are then factors on that column.  rows: used, and left out by the gate.
    enlarged: by how much correlation in time has widened the interval.  determined: whether it goes into the fragment.
    """

    sensor: str
    key: str
    part: str
    value: float
    estimate: float
    low: float
    high: float
    rows: int
    left_out: int
    enlarged: float
    determined: bool
    remarks: tuple[str, ...] = ()

    @property
    def ratio(self) -> float:
        """Estimate over the value in the file."""
        return self.estimate / self.value


@dataclass(frozen=True)
class Tuning:
    """What logs say of the sigmas of a vehicle file, and of its sensors (by name) whose innovations are not white: in words."""

    logs: tuple[str, ...]
    sigmas: tuple[Tuned, ...]
    not_white: dict[str, str]
    gain: float  # of the log-likelihood against the file

    def __getitem__(self, name: str) -> Tuned:
        """Return the sigma of "sensor.key"; raises InputError where there is none."""
        known = {f"{s.sensor}.{s.key or s.part}": s for s in self.sigmas}
        if name not in known:
            raise InputError("tuning", f"has no '{name}'", suggestion(name, known))
        return known[name]


def tune(
    logs: Sequence[Log],
    vehicle: Vehicle,
    *,
    sensors: Sequence[str] = (),
    process: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Tuning:
    """Estimate the sigmas of sensors (all that have rows, if none is named) and, with `process`, the process noise, from logs.

    An inertial unit that is named is asked for its noise.  Raises InputError for a sensor that the vehicle lacks, for logs in which none
    of them has rows, and for a log that cannot be run.
    """
    if not logs:
        raise InputError("tune", "has no log", "give at least one")
    for name in sensors:
        vehicle[name]
    recordings = [Recording(log, vehicle) for log in logs]
    units = (vehicle.process.imu, vehicle.process.standby)
    knobs = knobs_of(vehicle, recordings, sensors or [name for name in vehicle.sensors if name not in units], process=process)
    where = logs[0].path or logs[0].name
    for name in sensors:
        if all(knob.sensor != name for knob in knobs):
            raise InputError(f"{where}: {name}", "gives no row that tells of a sigma", "leave it out")
    if not knobs or not any(len(recording.slot) for recording in recordings):
        raise InputError(where, "has no row of a sensor that could be held against the motion", "give a log with aiding")
    fit = Fit(recordings, knobs, _counted(progress, len(knobs))).fit()
    return _told(fit, logs)


def _counted(progress: Callable[[float], None] | None, count: int) -> Callable[[], None]:
    """What to call after each run: it tells about which fraction is done."""
    done, expected = [0], RUNS * count + count**2

    def told() -> None:
        done[0] += 1
        if progress is not None:
            progress(min(0.99, done[0] / expected))

    return told


def _told(fit: Fit, logs: Sequence[Log]) -> Tuning:
    found = fit.looked(fit.theta)
    white = {name: words for name in dict.fromkeys(k.sensor for k in fit.knobs if not k.process) if (words := _coloured(fit, found, name))}
    gain = fit.value(fit.theta) - fit.value(np.zeros(len(fit.theta)))
    sigmas = tuple(_tuned(fit, k) for k in range(len(fit.knobs)))
    return Tuning(tuple(log.name for log in logs), sigmas, white, float(gain))


def interval(variance: float) -> tuple[float, float]:
    """Return the factors by which a sigma may be smaller and larger than its estimate, from the variance of its logarithm."""
    from scipy.special import chdtri

    dof, tail = 0.5 / variance, 0.5 * (1.0 - LEVEL)
    low, high = (float(chdtri(dof, p)) for p in (tail, 1.0 - tail))  # of chi-square: exceeded with these probabilities
    return float(np.sqrt(dof / low)), float(np.sqrt(dof / high)) if high > 0.0 else float("inf")


def _tuned(fit: Fit, k: int) -> Tuned:
    knob = fit.knobs[k]
    rows, left = (int(n) for n in np.sum([_counts(knob, r, i) for r, i in zip(fit.recordings, fit.inside, strict=True)], axis=0))
    ratio, (down, up) = float(np.exp(fit.theta[k])), interval(float(fit.covariance[k, k]))
    value = 1.0 if not knob.key else knob.value
    why = _undetermined(fit, k, rows - knob.stated, max(1.0 / down, up))
    remarks = [why] if why else [_against_file(ratio, down, up)]
    if not knob.key:
        remarks.append("its rows carry a sigma of their own, and no key scales it: scale the column, or leave it out")
    if knob.stated:
        remarks.append(f"{knob.stated} more rows do not depend on it (a sigma of their own, or another key)")
    if left and not knob.process:
        remarks.append(_left_words(fit, knob, left, rows))
    if fit.enlarged[k] > MENTIONED and not why:
        remarks.append(f"the interval is {fit.enlarged[k]:.2g} times as wide as that of as many independent Gaussian rows")
    shown = (value * ratio, value * ratio * down, value * ratio * up)
    return Tuned(knob.sensor, knob.key, knob.part, value, *shown, rows, left, float(fit.enlarged[k]), not why, tuple(remarks))


def _left_words(fit: Fit, knob: Knob, left: int, rows: int) -> str:
    """Say how many rows the gate has left out, and whether that is more than it would of Gaussian errors."""
    from scipy.special import pdtr

    shares = [1.0 - slot.config.gate.probability for slot in fit.recordings[0].composition.slots]
    expected = sum(shares[slot] * (r.slot == slot).sum() for r in fit.recordings for slot in knob.slots)
    words = f"{left} of {left + rows} rows lie outside the gate and were left out"
    return words if pdtr(left - 1, expected) < UNLIKELY else f"{words}, where {expected:.2g} are to be expected: outliers, or heavy tails"


def _counts(knob: Knob, recording: Recording, inside: Inside) -> tuple[int, int]:
    """How many rows of a log tell of a sigma, and how many the gate has left out."""
    mine = np.isin(recording.slot, knob.slots)
    return int((mine & inside.rows).sum()), int((mine & (recording.asked[0] >= 0)).sum())


def _undetermined(fit: Fit, k: int, rows: int, reach: float) -> str:
    """Say why a sigma is not determined; nothing where it is."""
    if rows < FEWEST:
        return f"not determined: {rows} rows (fewer than {FEWEST} cannot show a sigma wrong by 2)"
    if reach > WIDEST:
        return f"not determined: the interval reaches a factor of {reach:.2g} from the estimate" if reach < FAR else "not determined"
    if fit.knobs[k].process:
        without = fit.theta.copy()
        without[k] -= NOTHING
        refitted, _ = fit.maximise(without, held=k)
        if 2.0 * (fit.value(fit.theta) - fit.value(refitted)) < MOST_OFTEN:
            return "not determined: the logs cannot tell it from zero"
    return ""


def _against_file(ratio: float, down: float, up: float) -> str:
    if down * ratio <= 1.0 <= up * ratio:
        return "agrees with the file"
    return f"the file's is {ratio if ratio > 1.0 else 1.0 / ratio:.2g} times too {'small' if ratio > 1.0 else 'large'}"


def _coloured(fit: Fit, found: Sequence[Looked], sensor: str) -> str:
    """Say where the innovations of a sensor are not white; nothing where they are, or are too few."""
    worst, words = 0.0, ""
    for slot in sorted({s for knob in fit.knobs if knob.sensor == sensor for s in knob.slots}):
        components = fit.recordings[0].composition.slots[slot].channel.components
        for a, component in enumerate(components):
            parts = []
            for recording, looked, inside in zip(fit.recordings, found, fit.inside, strict=True):
                mine = (recording.slot == slot) & inside.rows & np.isfinite(looked.nis)
                parts.append(looked.residual[mine, a] / looked.sigma[mine, a])
            value, lag, count = _autocorrelation(parts)
            if count >= FEWEST and abs(value) > max(worst, CORRELATED, CERTAIN / np.sqrt(count)):
                worst, words = abs(value), f"innovations of {component} are not white: autocorrelation {value:.2f} at lag {lag}"
    return words


def _autocorrelation(parts: Sequence[Array]) -> tuple[float, int, int]:
    """Return the autocorrelation about zero that is largest in size, its lag, and the number of values."""
    count, square = sum(map(len, parts)), sum(float(z @ z) for z in parts)
    if count < FEWEST or not square > 0.0:
        return 0.0, 0, count
    values = [sum(float(z[lag:] @ z[:-lag]) for z in parts if len(z) > lag) / square for lag in range(1, LAGS + 1)]
    largest = int(np.argmax(np.abs(values)))
    return values[largest], largest + 1, count


def fragment(found: Tuning) -> str:
    """Return what was determined as a fragment of a vehicle file; what was not stands in it as a comment."""
    lines = [f"# tuned by the innovations of {', '.join(found.logs)}; intervals of 95 %"]
    for sensor in dict.fromkeys(sigma.sensor for sigma in found.sigmas):
        mine = [sigma for sigma in found.sigmas if sigma.sensor == sensor]
        if any(sigma.determined and sigma.key for sigma in mine):
            lines.append(f"[sensors.{sensor if re.fullmatch(r'[A-Za-z0-9_-]+', sensor) else _quoted(sensor)}]")
        for sigma in sorted(mine, key=lambda s: not (s.determined and s.key)):
            left = f", {sigma.left_out} left out" if sigma.left_out else ""
            own = f"{sigma.low:.4g} to {sigma.high:.4g}, was {sigma.value:.4g}, {sigma.rows} rows{left}"
            if sigma.determined and sigma.key:
                lines.append(f"{sigma.key} = {_number(sigma.estimate)}  # {own}")
            elif sigma.key or not sigma.determined:
                lines.append(f"# {sensor}.{sigma.key or sigma.part}: {sigma.remarks[0]}")
            else:
                factor = f"{sigma.estimate:.4g} ({sigma.low:.4g} to {sigma.high:.4g})"
                lines.append(f"# {sensor}: the sigmas that its rows carry ({sigma.part}) times {factor}")
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    """A number of four figures, as TOML writes a float."""
    text = f"{value:.4g}"
    return text if "." in text or "e" in text else f"{text}.0"


def _quoted(name: str) -> str:
    return '"' + name.replace("\\", "\\\\").replace('"', '\\"') + '"'
