"""A configuration: one way to solve a log.  Written as a run file (TOML), or in a word: `ukf`, `cruise`, `cruise+ukf`."""

from __future__ import annotations

import re
import tomllib
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from leadline.data.errors import InputError
from leadline.data.vehicle import Vehicle, read_vehicle
from leadline.data.vehicle_keys import checked
from leadline.estimate.as_live import WINDOW, solve_as_live
from leadline.estimate.solve import DEFAULT_RATE, solve
from leadline.missions.dive import Run
from leadline.missions.fingerprint import digest_of
from leadline.missions.study_keys import ConfigurationKeys
from leadline.models.processes import HOMES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from leadline.data.log import Log
    from leadline.data.records import Array
    from leadline.data.solution import Solution

RUN_FILE = ".toml"
FIRST = 5.0  # s of a log that are solved beforehand, so that compiling is not counted
OVERLAID = ("sensors", "water", "seabed", "clocks", "points")  # tables of a vehicle file that a run file may hold
UNFIT = re.compile(r"[^A-Za-z0-9._=,-]+")  # in the name of a folder


@dataclass(frozen=True)
class Configuration:
    """One way to solve a log.

    process, estimator: as `leadline.solve` takes them; None: the vehicle file's own process model.  vehicle: a file instead of the one
    that is given.  fragments, over: files and keys that come before those of the vehicle file.  window (s): of a run as live.
    only, without: sensors to aid with, or to leave out.  where: what the configuration was read from.
    """

    name: str
    estimator: str = "ekf"
    process: str | None = None
    vehicle: Path | None = None
    fragments: tuple[Path, ...] = ()
    over: Mapping[str, Any] = field(default_factory=dict)
    smooth: bool = False
    as_live: bool = False
    window: float = WINDOW
    only: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    where: str = ""

    @property
    def folder(self) -> str:
        """The name as that of a folder."""
        return UNFIT.sub("-", self.name).strip(".-") or "run"

    @property
    def digest(self) -> str:
        """A digest of what determines what it makes of a log: its keys, and the files that it names."""
        file, colon, _ = (self.process or "").rpartition(":")
        return digest_of((replace(self, where=""), Path(file) if colon and file.endswith(".py") else None))

    @property
    def as_built(self) -> Configuration:
        """The configuration without what it believes of the instruments: with its sensors and its process model alone."""
        process = {"process": self.over["process"]} if "process" in self.over else {}
        return self if self.vehicle is not None else replace(self, fragments=(), over=process)

    def aboard(self, given: Path | Vehicle | None) -> Vehicle:
        """Return the vehicle that is navigated: the configuration's own or the given one, with its keys, process model and sensors.

        Raises InputError where there is none, or where the vehicle cannot be so.
        """
        kept = Run(only=self.only, without=self.without)
        if isinstance(given, Vehicle) and not (self.vehicle or self.fragments or self.over):
            return kept.aboard(given if self.process is None else given.moved_by(self.process))
        path = self.vehicle or (given.path if isinstance(given, Vehicle) else given)
        if path is None:
            raise InputError(self.where or self.name, "has no vehicle file to put its keys over", "give vehicle = FILE, or --vehicle FILE")
        over = {**self.over}
        if self.process is not None:
            over["process"] = {**over.get("process", {}), "model": self.process}
        try:
            return kept.aboard(read_vehicle(path, *self.fragments, over=over))
        except InputError as error:
            if not self.over:
                raise
            raise InputError(f"{error.where} (under {self.where or self.name})", error.found, error.right) from error

    def solve(
        self,
        log: Log,
        vehicle: Vehicle,
        *,
        rate: float = DEFAULT_RATE,
        times: Array | None = None,
        end: float | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> Solution:
        """Solve a log with a vehicle that `aboard` returned; arguments as `leadline.solve`."""
        wanted: dict[str, Any] = {"estimator": self.estimator, "rate": rate, "times": times, "end": end, "progress": progress}
        if self.as_live:
            return solve_as_live(log, vehicle, window=self.window, **wanted)
        return solve(log, vehicle, smooth=self.smooth, **wanted)

    def warm(self, log: Log, vehicle: Vehicle) -> None:
        """Solve the first seconds of a log, so that what compiles on first use is compiled; a log may begin before its first position."""
        with suppress(InputError):
            self.solve(log, vehicle, rate=1.0, end=_start(log) + FIRST)


def _start(log: Log) -> float:
    """Return when a log begins (s): by its start, else by the first row of its longest table."""
    if log.initial is not None and log.initial.time is not None:
        return float(log.initial.time)
    longest = max((table.time for name, table in log.tables.items() if name != "truth"), key=len, default=())
    return float(min(longest, default=0.0))


def read_configuration(path: str | Path) -> Configuration:
    """Read a run file; paths in it count from its own folder.

    Raises InputError, one line, which names file and key, for a missing file, wrong TOML, an unknown key, or what does not go together.
    """
    where = Path(path)
    return configuration_from(checked(ConfigurationKeys, toml_of(where, "a run file"), str(where), "give it"), where, where.stem)


def configuration_from(keys: ConfigurationKeys, home: Path, name: str) -> Configuration:
    """Make a configuration of the keys of a run file at the place `home`; `name` where they hold none."""
    if keys.smooth and keys.as_live:
        raise InputError(home, "has smooth and as_live", "a smoother looks ahead: take one out")
    tables = {table: value for table in OVERLAID if (value := getattr(keys, table))}
    twice = sorted(set(tables) & set(keys.set))
    if twice:
        raise InputError(f"{home}: set.{twice[0]}", f"stands beside [{twice[0]}]", "give one of them")
    if not isinstance(keys.set.get("process", {}), dict):
        raise InputError(f"{home}: set.process", f"{keys.set['process']!r}", "a table of keys")
    return Configuration(
        keys.name or name,
        keys.estimator,
        _process(keys.process, home),
        None if keys.vehicle is None else beside(home, keys.vehicle),
        tuple(beside(home, part) for part in keys.calibration),
        {**keys.set, **tables},
        keys.smooth,
        keys.as_live,
        keys.window_s,
        tuple(keys.only),
        tuple(keys.without),
        str(home),
    )


def _process(text: str | None, home: Path) -> str | None:
    """Return a process model; one that stands in a file by a path from anywhere."""
    file, colon, function = (text or "").rpartition(":")
    return f"{beside(home, file)}:{function}" if colon and file.endswith(".py") else text


def configuration_of(text: str) -> Configuration:
    """Return what a word of a command line means: a run file, an estimator, a process model, or PROCESS+ESTIMATOR."""
    if text.endswith(RUN_FILE):
        return read_configuration(text)
    first, plus, second = text.partition("+")
    if plus:
        return Configuration(text, second, first, where=text)
    is_process = text in HOMES or ".py:" in text
    return Configuration(text, process=text, where=text) if is_process else Configuration(text, text, where=text)


def configurations_of(found: Iterable[str | Configuration]) -> tuple[Configuration, ...]:
    """Return configurations of words, or as they are; raises InputError where there are none, or two of one name."""
    made = tuple(configuration_of(one) if isinstance(one, str) else one for one in found)
    if not made:
        raise InputError("runs", "there are none", "give run files (TOML), estimators, or PROCESS+ESTIMATOR")
    for which in ("name", "folder"):
        names = [getattr(one, which) for one in made]
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise InputError(f"run '{twice[0]}'", f"there are {names.count(twice[0])} of that {which}", "give each a name of its own")
    return made


def smoothed(configurations: Iterable[Configuration]) -> tuple[Configuration, ...]:
    """Return configurations with each state by all data, but for those that are as live."""
    return tuple(replace(one, smooth=not one.as_live) for one in configurations)


def beside(home: Path, path: str) -> Path:
    """Return a path that counts from the folder of the file `home`."""
    return (home.parent / path).resolve()


def toml_of(path: Path, what: str) -> dict[str, Any]:
    """Read a TOML file; raises InputError, one line, where there is none or it is wrong."""
    try:
        return tomllib.loads(path.read_text("utf-8"))
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", f"give {what} in TOML") from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(path, f"is not TOML: {error}", "mend it") from error
