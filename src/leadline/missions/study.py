"""Studies: missions, configurations and many runs.  Each run is drawn once and solved by every configuration, so that all are paired.

A study with a folder goes on where it was broken off: a cell, which is one run of one mission, is written as soon as it is there.
"""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.assess.consistency import holm
from leadline.data.errors import InputError
from leadline.estimate.estimators import estimator_of
from leadline.formats.atomic import new_file
from leadline.missions.cell_maker import Case, Shelf, Task, Work, done
from leadline.missions.cells import Solved
from leadline.missions.configuration import Configuration, configurations_of
from leadline.missions.fingerprint import digest_of, digest_of_program
from leadline.missions.seeds import seed_of
from leadline.missions.summary import Bar, Outcome, Summary, Taken, outcomes_of, ratio_of, study_from, summary_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from leadline.assess.statistic import Paired
    from leadline.data.records import Array
    from leadline.data.vehicle import Vehicle
    from leadline.missions.montecarlo import Study

CELLS, KEY = "cells", "key.json"
COMPARED = ("horizontal", "depth", "velocity", "heading")
SMOOTHED = "a smoother knows what comes after, and the bound does not"
UNASKED = "it was not asked for"


@dataclass(frozen=True)
class Pair:
    """One configuration against the first on the same runs; differs: by Holm at 1 % over all pairs of the study."""

    mission: str
    configuration: str
    against: str
    quantity: str
    found: Paired
    differs: bool


@dataclass(frozen=True, eq=False)
class Results:
    """What a study found.  bounds: by mission and configuration the name of a bound on the shelf, or why there is none."""

    missions: tuple[str, ...]
    configurations: tuple[Configuration, ...]
    numbers: tuple[int, ...]
    shelf: Shelf
    bounds: Mapping[tuple[str, str], Task | str]
    names: Mapping[str, str] = field(default_factory=dict)  # from which seeds are made, by mission
    bars: tuple[Bar, ...] = ()

    def taken(self, mission: str, configuration: str) -> Taken:
        """Return all runs of a mission by a configuration."""
        solved: dict[int, Solved] = {}
        refused: dict[int, str] = {}
        time = np.empty(0)
        for number in self.numbers:
            cell = self.shelf.get(Task(mission, number), configuration)
            found = cell.found[configuration]
            if isinstance(found, str):
                refused[number] = found
            else:
                solved[number], time = found, cell.time if not len(time) or len(cell.time) < len(time) else time
        return Taken(solved, refused, time)

    def bound(self, mission: str, configuration: str) -> Array | str:
        """Return the bound (times, 9, 9) of a mission for the vehicle of a configuration, or why there is none."""
        task = self.bounds[mission, configuration]
        return task if isinstance(task, str) else self.shelf.get(task).bound

    def study(self, mission: str, configuration: str) -> Study | None:
        """Return the runs that are solved and not lost as a Monte Carlo study, with all arrays; None where there are none."""
        return self._study(mission, self.taken(mission, configuration), self.bound(mission, configuration))

    def _study(self, mission: str, taken: Taken, bound: Array | str) -> Study | None:
        if not taken.sound:
            return None
        seeds = tuple(seed_of(self.names[mission], number) for number in taken.sound)
        return study_from(mission, seeds, list(taken.sound.values()), taken.time, None if isinstance(bound, str) else bound)

    @cached_property
    def summaries(self) -> dict[tuple[str, str], Summary]:
        """The summary of each mission and configuration."""
        found = {}
        for mission, one in product(self.missions, self.configurations):
            taken, bound = self.taken(mission, one.name), self.bound(mission, one.name)
            found[mission, one.name] = summary_of(mission, one.name, taken, self._study(mission, taken, bound), bound)
        return found

    @cached_property
    def pairs(self) -> tuple[Pair, ...]:
        """Each configuration against the first, on the runs that both solved, judged together."""
        first = self.configurations[0].name
        wanted = [(m, one.name, q) for m in self.missions for one in self.configurations[1:] for q in COMPARED]
        found = [ratio_of(self.summaries[m, name], self.summaries[m, first], q) for m, name, q in wanted]
        able = [k for k, one in enumerate(found) if np.isfinite(one.p)]
        differs = dict(zip(able, holm([found[k].p for k in able]), strict=True))
        return tuple(Pair(m, n, first, q, found[k], differs.get(k, False)) for k, (m, n, q) in enumerate(wanted))

    @cached_property
    def outcomes(self) -> tuple[Outcome, ...]:
        """What became of the bars."""
        return tuple(outcomes_of(self.bars, self.summaries))

    def to_dict(self) -> dict[str, Any]:
        """Return all but the arrays as plain types that JSON knows, SI and radians."""
        from leadline.formats.solution import plain

        summaries = [
            {
                "mission": s.mission, "configuration": s.configuration, "runs": s.runs, "solved": len(s.numbers), "lost": s.lost,
                "refused": [{"sentence": why, "runs": count} for why, count in s.refused.items()],
                "answer": s.answer.value, "findings": s.findings, "no_bound": s.no_bound or None,
                "statistics": {name: _interval(value) for name, value in s.statistics.items()},
            }
            for s in self.summaries.values()
        ]  # fmt: skip
        pairs = [
            {
                "mission": p.mission, "configuration": p.configuration, "against": p.against, "quantity": p.quantity,
                "ratio": _interval(p.found.ratio), "p": p.found.p, "runs": p.found.runs, "differs": p.differs,
            }
            for p in self.pairs
        ]  # fmt: skip
        bars = [
            {
                "mission": o.mission, "configuration": o.configuration, "statistic": o.bar.statistic, "against": o.bar.against,
                "most": o.bar.most, "least": o.bar.least, "value": _interval(o.value), "held": o.held, "sentence": o.sentence,
            }
            for o in self.outcomes
        ]  # fmt: skip
        found: dict[str, Any] = plain({"runs": list(self.numbers), "summaries": summaries, "pairs": pairs, "bars": bars})
        return found


def _interval(value: Any) -> dict[str, float]:
    return {"estimate": value.estimate, "low": value.low, "high": value.high, "level": value.level}


def study(
    cases: Mapping[str, Case],
    configurations: Sequence[str | Configuration],
    runs: Iterable[int],
    *,
    every: float = 10.0,
    bound: bool = True,
    bars: Sequence[Bar] = (),
    out: Path | None = None,
    processes: int = 1,
    progress: Callable[[float], None] | None = None,
) -> Results:
    """Draw each case once per number in `runs`, solve it by every configuration, and compare with truth every `every` seconds.

    cases: by the name to show.  bound: make the Cramér-Rao bound of each case as well.  out: a folder in which finished cells are kept,
    and found again by a later call; without one they are kept in memory.  With more than one process the caller's main module must be
    importable (a script guards its last lines by `if __name__ == "__main__"`).
    Raises InputError for no runs, for a folder of another study, and for a configuration that can navigate none of the cases.
    """
    made, numbers = configurations_of(configurations), tuple(runs)
    _check(cases, numbers)
    for bar in bars:
        bar.check(list(cases), [one.name for one in made], "bars")
    parts = {
        "the program": digest_of_program(),
        "every": repr(float(every)),
        **{f"mission {name}": case.digest for name, case in cases.items()},
    }
    parts |= {f"configuration {one.name}": one.digest for one in made}
    shelf = Shelf(None if out is None else shelf_in(out, parts))
    for one in made:
        estimator_of(one.estimator)  # a name that is misspelt is refused now, and not by every run
    vehicles = _vehicles(cases, made)
    wanted = {key: _bounded(cases[key[0]], one, vehicles[key], bound) for one in made for key in product(cases, [one.name])}
    bounds = {key: value if isinstance(value, str) else _bound_task(key[0], value) for key, value in wanted.items()}
    found = Results(tuple(cases), made, numbers, shelf, bounds, {name: case.name for name, case in cases.items()}, tuple(bars))
    aboard = {(key[0], _bound_task(key[0], v).bound): v for key, v in wanted.items() if not isinstance(v, str)}
    tasks = [Task(name, number) for name in cases for number in numbers]
    tasks += [Task(mission, -1, digest) for mission, digest in aboard]
    left = [task for task in tasks if not shelf.has(task)]
    used = {task.case for task in left}
    ready = {name: case.ready(every) for name, case in cases.items() if name in used}
    work = Work(ready, made, vehicles, aboard, every, shelf)
    with closing(done(work, left, processes)) as finished:
        for count, _ in enumerate(finished, 1 + len(tasks) - len(left)):
            if progress is not None:
                progress(count / len(tasks))
    return found


def _check(cases: Mapping[str, Case], numbers: tuple[int, ...]) -> None:
    if not cases or not numbers:
        raise InputError("study", f"{len(cases)} missions and {len(numbers)} runs", "give at least one of each")
    if len(set(numbers)) != len(numbers):
        raise InputError("runs", "a number is there twice", "give each once")
    names = [case.name for case in cases.values()]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError("missions", f"{names.count(twice[0])} are named '{twice[0]}'", "give each a name of its own: seeds are made of it")


def _vehicles(cases: Mapping[str, Case], made: Sequence[Configuration]) -> dict[tuple[str, str], Vehicle | str]:
    """Return the vehicle of each case and configuration, or why there is none; raises where a configuration has none at all."""
    found: dict[tuple[str, str], Vehicle | str] = {}
    for one in made:
        refusals = []
        for name, case in cases.items():
            try:
                found[name, one.name] = one.aboard(case.vehicle)
            except InputError as error:
                found[name, one.name] = str(error)
                refusals.append(error)
        if len(refusals) == len(cases):
            raise refusals[0]
    return found


def _bounded(case: Case, one: Configuration, vehicle: Vehicle | str, asked: bool) -> Vehicle | str:
    """Return the vehicle of which the bound is made, as it was built and not as the configuration takes it, or why there is no bound."""
    if isinstance(vehicle, str):
        return vehicle
    if one.smooth or not asked:
        return SMOOTHED if one.smooth else UNASKED
    try:
        return one.as_built.aboard(case.vehicle)
    except InputError as error:
        return str(error)


def _bound_task(mission: str, vehicle: Vehicle) -> Task:
    """Return the task of a bound, the same for all configurations that come to the same vehicle."""
    return Task(mission, -1, digest_of(replace(vehicle, path=None))[:12])


def shelf_in(out: Path, parts: Mapping[str, str]) -> Path:
    """Return the folder of cells of a study's folder, made for what determines them.

    Raises InputError, naming what differs, where it holds cells of another study, and where it is somebody's own folder.
    """
    folder = out / CELLS
    key = folder / KEY
    if key.is_file():
        known = json.loads(key.read_text("utf-8"))
        other = sorted(name for name in {*known, *parts} if known.get(name) != parts.get(name))
        if other:
            more = f" and {len(other) - 1} more" if len(other) > 1 else ""
            raise InputError(out, f"holds cells of another study: {other[0]}{more} changed since", "name a new folder, or undo the change")
        return folder
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(out, f"is there already, and holds no {CELLS}/{KEY}", "name a new folder")
    with new_file(key) as part:
        part.write_text(json.dumps(dict(parts), indent=2), "utf-8")
    return folder
