"""Cells of a study: what all configurations made of one run of one mission, as a file that is whole or not there."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, NamedTuple
from zipfile import BadZipFile

import numpy as np

from leadline.assess.consistency import Answer
from leadline.data.errors import InputError
from leadline.formats.atomic import new_file
from leadline.missions.montecarlo import Groups, Run

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from leadline.data.records import Array

TOLD, BOUND = "told", "bound"


class Solved(NamedTuple):
    """One configuration on one run: what Monte Carlo keeps, shares of times within 3 sigma (9,), its own verdict, its cost.

    lost: after how many seconds its states were no numbers any more; nan: never.  cost: microseconds per second of the log.
    """

    run: Run
    inside: Array
    answer: Answer
    sentence: str
    lost: float
    cost: float


class Cell(NamedTuple):
    """One run of one mission: the times of its checks (times,), and by configuration what came of it, or why it was refused.

    bound: in place of these the bound (times, 9, 9) of a mission, or why there is none.
    """

    time: Array
    found: Mapping[str, Solved | str]
    bound: Array | str = ""


def write_cell(path: Path, cell: Cell) -> None:
    """Write a cell, whole or not at all."""
    arrays: dict[str, Any] = {"time": cell.time}
    found: dict[str, Any] = {}
    for number, (name, one) in enumerate(cell.found.items()):
        found[name] = {"refused": one} if isinstance(one, str) else _put(arrays, f"{number}.", one)
    told: dict[str, Any] = {"found": found}
    if isinstance(cell.bound, str):
        told[BOUND] = cell.bound
    else:
        arrays[BOUND] = cell.bound
    with new_file(path) as part, part.open("wb") as file:
        np.savez_compressed(file, told=np.array(json.dumps(told)), **arrays)


def _put(arrays: dict[str, Any], before: str, one: Solved) -> dict[str, Any]:
    """Add the arrays of one configuration under names that begin with `before`; returns what is no array."""
    arrays |= {f"{before}error": one.run.error, f"{before}inside": one.inside}
    arrays |= {f"{before}whitened.{block}": z for block, z in one.run.whitened.items()}
    for k, groups in enumerate(one.run.groups.values()):
        arrays |= {f"{before}groups.{k}.{column}": getattr(groups, column) for column in Groups._fields}
    for k, (_, correlation) in enumerate(one.run.correlations.values()):
        arrays[f"{before}correlation.{k}"] = correlation
    return {
        "before": before,
        "blocks": list(one.run.whitened),
        "sensors": list(one.run.groups),
        "components": [[sensor, component, count] for (sensor, component), (count, _) in one.run.correlations.items()],
        "answer": one.answer.value,
        "sentence": one.sentence,
        "lost": one.lost,
        "cost": one.cost,
    }


def read_cell(path: Path, *names: str) -> Cell:
    """Read a cell, of the named configurations alone where there are names; raises InputError where it is none."""
    try:
        with np.load(path) as arrays:
            told = json.loads(str(arrays[TOLD]))
            bound = arrays[BOUND] if BOUND in arrays else told[BOUND]
            found = {name: _taken(arrays, one) for name, one in told["found"].items() if not names or name in names}
            return Cell(arrays["time"], found, bound)
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise InputError(path, f"is no cell of a study ({error})", "take it out: it will be made anew") from error


def _taken(arrays: Mapping[str, Array], told: Mapping[str, Any]) -> Solved | str:
    if "refused" in told:
        return str(told["refused"])
    before = told["before"]
    whitened = {block: arrays[f"{before}whitened.{block}"] for block in told["blocks"]}
    groups: dict[str, Groups] = {}
    for k, sensor in enumerate(told["sensors"]):
        columns: list[Any] = [arrays[f"{before}groups.{k}.{column}"] for column in Groups._fields]
        groups[sensor] = Groups(*columns)
    correlations = {(s, c): (int(count), arrays[f"{before}correlation.{k}"]) for k, (s, c, count) in enumerate(told["components"])}
    run = Run(arrays[f"{before}error"], whitened, groups, correlations)
    return Solved(run, arrays[f"{before}inside"], Answer(told["answer"]), told["sentence"], told["lost"], told["cost"])
