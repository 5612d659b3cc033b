"""What became of rows, and what must be read before any verdict: a sensor of which little was used, a solution that is lost."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.data.outcome import Outcome
from leadline.data.solution import Status

if TYPE_CHECKING:
    from collections.abc import Mapping

    from leadline.data.solution import Innovations, Solution

OUTCOMES = list(Outcome)  # by number
ENOUGH = 0.5  # of a sensor's rows; below that its silence is the first thing to say
MEANT = (Outcome.DUPLICATE, Outcome.HELD, Outcome.EXCLUDED)  # rows that nobody expects to be used
ABSURD = 1e18  # in any unit: what is larger counts as no number


def counts_of(innovations: Innovations) -> dict[str, dict[Outcome, int]]:
    """Return the number of rows by sensor instance and outcome; a row whose parts met different ends counts once for each."""
    counts: dict[str, dict[Outcome, int]] = {}
    sensors, code = np.unique(innovations.sensor, return_inverse=True)
    low = int(innovations.row.min(initial=0))
    span = int(innovations.row.max(initial=0)) - low + 1
    distinct = np.unique((code.ravel() * len(OUTCOMES) + innovations.outcome) * span + innovations.row - low) // span
    for key, n in zip(*np.unique(distinct, return_counts=True), strict=True):
        sensor, outcome = divmod(int(key), len(OUTCOMES))
        counts.setdefault(str(sensors[sensor]), {})[OUTCOMES[outcome]] = int(n)
    return counts


def unused(solution: Solution) -> tuple[str, ...]:
    """Return a sentence for each configured sensor that has no rows, or of which less than half of the rows were used."""
    counts: dict[str, Mapping[Outcome, int]] = dict(counts_of(solution.innovations))
    for sensor, told in _told(solution).items():
        if sum(told.values()) > sum(counts.get(sensor, {}).values()):  # inertial rows that were used stand in the summary alone
            counts[sensor] = told
        counts.setdefault(sensor, told)
    return tuple(sentence for sensor, by in sorted(counts.items()) if (sentence := _unused(sensor, by)))


def _unused(sensor: str, counts: Mapping[Outcome, int]) -> str:
    """Return what is to be said of one sensor, or nothing."""
    if not counts:
        return f"{sensor}: has no rows"
    counted = {outcome: n for outcome, n in counts.items() if outcome not in MEANT}
    used, total = counted.pop(Outcome.USED, 0), sum(n for outcome, n in counts.items() if outcome not in MEANT)
    if used >= ENOUGH * total or set(counted) == {Outcome.NOT_CONFIGURED}:
        return ""
    reason = max(counted, key=lambda outcome: counted[outcome])
    return f"{sensor}: {used} of {total} rows used ({reason.name.lower().replace('_', ' ')})"


def _told(solution: Solution) -> dict[str, dict[Outcome, int]]:
    """Return the counts that the summary of a solution tells, where it tells any."""
    names = {outcome.name.lower(): outcome for outcome in Outcome}
    told = solution.summary.get("counts")
    found: dict[str, Any] = told if isinstance(told, dict) else {}
    return {
        str(sensor): {names[name]: int(n) for name, n in by.items() if name in names and n}
        for sensor, by in found.items()
        if isinstance(by, dict)
    }


def lost_after(solution: Solution) -> float | None:
    """Return the time (s) of the first state that is lost: status LOST, or a position or covariance that is no number."""
    s = solution
    rows = (s.latitude, s.longitude, s.depth, s.north, s.east, s.covariance.reshape(len(s), 81))
    bad = s.status == Status.LOST
    for values in rows:
        if len(values) and values.max() < ABSURD and values.min() > -ABSURD:  # false where there is a nan
            continue
        good = np.isfinite(values) & (np.abs(values) < ABSURD)
        bad = bad | ~(good if good.ndim == 1 else good.all(axis=1))
    return float(s.time[np.argmax(bad)]) if bad.any() else None


def finite(solution: Solution) -> Solution:
    """Return a solution with nan for whatever is infinite or absurd, so that one wild number spoils no statistic."""
    states = {item.name: value for item in fields(solution) if isinstance(value := getattr(solution, item.name), np.ndarray)}
    clean = {name: _clean(value) for name, value in states.items() if value.dtype.kind == "f"}
    table = solution.innovations
    parts = {name: _clean(getattr(table, name)) for name in ("residual", "sigma", "nis")}
    nuisances = {name: replace(n, value=_clean(n.value), sigma=_clean(n.sigma)) for name, n in solution.nuisances.items()}
    return replace(solution, **clean, innovations=replace(table, **parts), nuisances=nuisances)


def _clean(values: Any) -> Any:
    """Return the values with nan for what is infinite or absurd; the array itself where nothing is."""
    if not len(values) or (values.max() < ABSURD and values.min() > -ABSURD):  # false where there is a nan
        return values
    with np.errstate(invalid="ignore"):
        wild = np.abs(values) >= ABSURD
    return np.where(wild, np.nan, values) if wild.any() else values
