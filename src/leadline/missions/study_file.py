"""A study from file to folder: study.toml in; cells, numbers and a page out, to be gone on with by the same command."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

from leadline.data.errors import InputError
from leadline.data.vehicle_keys import checked
from leadline.formats.atomic import new_file
from leadline.missions.cell_maker import Case
from leadline.missions.configuration import RUN_FILE, beside, configuration_from, configurations_of, read_configuration, smoothed, toml_of
from leadline.missions.mission import read_mission
from leadline.missions.study import Results, study
from leadline.missions.study_keys import ConfigurationKeys, StudyKeys
from leadline.missions.summary import Bar

if TYPE_CHECKING:
    from collections.abc import Callable

    from leadline.missions.configuration import Configuration

NUMBERS, PAGE = "study.json", "study.html"


@dataclass(frozen=True)
class StudyFile:
    """What a study file asks for; cases by name of their missions."""

    name: str
    note: str
    cases: dict[str, Case]
    configurations: tuple[Configuration, ...]
    numbers: tuple[int, ...]
    every: float
    bound: bool
    bars: tuple[Bar, ...]


def read_study(path: str | Path) -> StudyFile:
    """Read a study file; paths in it count from its own folder.

    Raises InputError, one line, which names file and key, for wrong TOML, an unknown key, a mission or a run file that is wrong, and for
    bars that speak of what is not in the study.
    """
    where = Path(path)
    given = checked(StudyKeys, toml_of(where, "a study file"), str(where), "give it")
    missions = [read_mission(beside(where, text)) for text in given.missions]
    names = [mission.name for mission in missions]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"{where}: missions", f"{names.count(twice[0])} are named '{twice[0]}'", "give each a name of its own")
    made = configurations_of(_configuration(raw, where, k) for k, raw in enumerate(given.configurations))
    bars = tuple(
        Bar(
            bar.statistic, bar.mission, bar.configuration, bar.against,
            inf if bar.most is None else bar.most, -inf if bar.least is None else bar.least,
        )
        for bar in given.bars
    )  # fmt: skip
    for k, bar in enumerate(bars):
        bar.check(names, [one.name for one in made], f"{where}: bars[{k}]")
    numbers = tuple(range(given.first_run, given.first_run + given.runs))
    cases = {mission.name: Case.of(mission) for mission in missions}
    if given.smooth:
        made = smoothed(made)
    return StudyFile(given.name or where.stem, given.note, cases, made, numbers, given.every_s, given.bound, bars)


def _configuration(raw: object, where: Path, number: int) -> str | Configuration:
    """Return a configuration of a table, of the path of a run file, or of a word."""
    if isinstance(raw, dict):
        place = f"{where}: configurations[{number}]"
        keys = checked(Inline, raw, place, "give it")
        return replace(configuration_from(keys, where, f"{number + 1}"), where=place)
    text = str(raw)
    return read_configuration(beside(where, text)) if text.endswith(RUN_FILE) else text


class Inline(ConfigurationKeys):
    """A configuration that stands in a study file."""

    outermost = False


def study_folder(
    path: Path,
    out: Path,
    *,
    processes: int = 1,
    progress: Callable[[float], None] | None = None,
) -> tuple[StudyFile, Results]:
    """Do what a study file asks for, and write its numbers and its page into the folder `out`, beside its cells; returns both.

    What lies in `out` already is not done again; a run that is broken off loses only what was not finished.  More runs may be asked for
    later.  Raises InputError before any work where input is wrong, or `out` holds cells of another study.
    """
    wanted = read_study(path)
    found = study(
        wanted.cases, wanted.configurations, wanted.numbers, every=wanted.every, bound=wanted.bound, bars=wanted.bars, out=out,
        processes=processes, progress=progress,
    )  # fmt: skip
    write_results(wanted, found, out)
    return wanted, found


def write_results(wanted: StudyFile, found: Results, out: Path) -> None:
    """Write numbers and page of a study, each whole or not at all."""
    from leadline.report.study import study_page

    told = {"study": wanted.name, "note": wanted.note, "every_s": wanted.every, **found.to_dict()}
    for name, text in ((NUMBERS, json.dumps(told, indent=2, allow_nan=False)), (PAGE, study_page(wanted.name, wanted.note, found))):
        with new_file(out / name) as part:
            part.write_text(text, "utf-8")
