"""What became of every row of a log: the results of a run by name, and the counts by sensor and outcome."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.data.outcome import Outcome
from leadline.data.records import Truth
from leadline.data.solution import Innovations
from leadline.estimate import plan as at

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from leadline.data.log import Log
    from leadline.data.records import Array
    from leadline.data.solution import Solution
    from leadline.data.vehicle import Vehicle
    from leadline.estimate.composition import Composition
    from leadline.estimate.events import Events, Integers

UNSEEN = (Outcome.NOT_CONFIGURED, Outcome.NO_MODEL, Outcome.EXCLUDED)


def looked_at(composition: Composition, events: Events, outcome: Integers, result: Array, first_group: int) -> Innovations:
    """Name the results of a stream: one entry per component of each measurement; groups are numbered from `first_group`."""
    slots = composition.slots
    measured = np.flatnonzero(events.measured)
    slot = events.kind[measured]
    dof = np.array([len(s.channel.components) for s in slots], np.int64)[slot] if len(measured) else np.zeros(0, np.int64)
    group = np.repeat(np.arange(len(measured)), dof)
    component = np.arange(len(group)) - np.repeat(np.cumsum(dof) - dof, dof)
    of, found = measured[group], result[group]
    names = np.array([[*s.channel.components, *[""] * 8][:8] for s in slots] or [[""] * 8])
    looked = np.isfinite(found[:, at.NIS])
    return Innovations(
        sensor=np.array([s.sensor for s in slots] or [""])[events.kind[of]],
        row=events.row[of],
        group=first_group + group,
        time=events.time[of],
        applied=np.where(looked, events.time[of], np.nan),
        component=names[events.kind[of], component],
        residual=np.take_along_axis(found, at.RESIDUAL + component[:, None], 1)[:, 0],
        sigma=np.take_along_axis(found, at.SIGMA + component[:, None], 1)[:, 0],
        nis=found[:, at.NIS],
        dof=dof[group],
        gate_probability=np.array([s.gate_probability for s in slots] or [0.0])[events.kind[of]],
        widened=found[:, at.WIDENED] == 1.0,
        outcome=outcome[group],
    )


def innovations_of(log: Log, vehicle: Vehicle, looked: list[Innovations], outcome: Mapping[str, Integers]) -> Innovations:
    """Put the entries of what was looked at (a list that is emptied) together with one per row that was not, by table and outcome."""
    outcomes = _all_outcomes(log, vehicle, outcome)
    looked += [_unused(name, log, verdicts) for name, verdicts in outcomes.items()]
    return _joined(looked)


def _all_outcomes(log: Log, vehicle: Vehicle, outcome: Mapping[str, Integers]) -> dict[str, Integers]:
    """Outcomes of the rows of every table but truth."""
    return {
        name: outcome.get(name, np.full(len(table), int(_why_not(name, vehicle))))
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


def _joined(parts: list[Innovations]) -> Innovations:
    """Put entries together in order of time, and let go of the parts; groups of rows that were not looked at are numbered on."""
    columns = {name: [getattr(part, name) for part in parts] for name in Innovations.__dataclass_fields__}
    parts.clear()
    time = np.concatenate(columns.pop("time"))
    order = np.argsort(time, kind="stable")
    joined: dict[str, Any] = {"time": time[order]}
    group = np.concatenate(columns.pop("group"))
    unnumbered = group < 0
    group[unnumbered] = (group.max(initial=-1) + 1) + np.arange(int(unnumbered.sum()))
    joined["group"] = group[order]
    for name in list(columns):
        joined[name] = np.concatenate(columns.pop(name))[order]
    return Innovations(**joined)


def summary_of(
    log: Log, vehicle: Vehicle, estimator: str, solution: Solution, innovations: Innovations, fed: frozenset[str]
) -> dict[str, Any]:
    """What was run, and what became of every row; fed: tables whose rows are input, and leave no entry where they are used."""
    from leadline import __version__

    return {
        "leadline": __version__,
        "log": log.name,
        "vehicle": vehicle.name,
        "process": vehicle.process.model,
        "estimator": estimator,
        "start_s": float(solution.time[0]),
        "end_s": float(solution.time[-1]),
        "counts": counts_of(log, innovations, fed),
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


def counts_of(log: Log, innovations: Innovations, fed: frozenset[str] = frozenset()) -> dict[str, dict[str, int]]:
    """Count rows by sensor and outcome; a row of several channels counts as used if any of them was, one of `fed` if it has no entry."""
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
        if name in fed and not np.isin(outcome, UNSEEN).any():
            counts[name] = {"used": len(table) - len(rows), **counts[name]}
    return counts
