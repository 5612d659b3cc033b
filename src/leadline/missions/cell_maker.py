"""Work of a study: one run of a mission is drawn once, and solved by every configuration; here, or in processes of their own."""

from __future__ import annotations

import signal
import threading
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from leadline.assess.consistency import consistency
from leadline.assess.usage import finite, lost_after
from leadline.data.errors import InputError
from leadline.data.records import Truth
from leadline.missions.bound import bound_of
from leadline.missions.cells import Cell, Solved, read_cell, write_cell
from leadline.missions.closed_loop import sail_by_estimate
from leadline.missions.fingerprint import digest_of
from leadline.missions.mission import Mission
from leadline.missions.montecarlo import compared, run_of
from leadline.missions.seeds import seed_of
from leadline.missions.simulation import sailed
from leadline.missions.trials import inside_of
from leadline.simulate.dive import Recorder
from leadline.simulate.faults import troubled

if TYPE_CHECKING:
    from collections.abc import Generator, Mapping, Sequence
    from pathlib import Path

    from leadline.data.log import Log
    from leadline.data.records import Array
    from leadline.data.vehicle import Vehicle
    from leadline.missions.configuration import Configuration
    from leadline.simulate.faults import Fault

MICRO = 1e6
GRACE = 1e-6  # s


@dataclass(frozen=True, eq=False)
class Case:
    """A dive that a study draws: a mission, or a recorder with the faults that befall its logs; vehicle: the file that navigates it."""

    source: Recorder | Mission
    vehicle: Vehicle
    faults: tuple[Fault, ...] = ()

    @classmethod
    def of(cls, mission: Mission) -> Case:
        """Return the case of a mission, navigated by its own vehicle file."""
        return cls(mission, mission.vehicle, mission.faults)

    @property
    def name(self) -> str:
        """The name from which seeds are made."""
        return self.source.name

    @property
    def digest(self) -> str:
        """A digest of what determines the case."""
        return digest_of((self.source, self.vehicle, self.faults))

    def ready(self, every: float) -> Case:
        """Return the case with its motion sailed, where it is the same in each run, and truth every so many seconds."""
        source = self.source
        if isinstance(source, Mission) and source.steer_by == "truth":
            source = sailed(source).recorder
        return replace(self, source=replace(source, truth_rate=1.0 / every) if isinstance(source, Recorder) else source)

    def log(self, number: int) -> Log:
        """Return the log of run `number`."""
        seed = seed_of(self.name, number)
        if isinstance(self.source, Mission):
            return sail_by_estimate(self.source, seed)[1]
        return troubled(self.source.draw(seed), self.faults, seed)


class Task(NamedTuple):
    """A cell to make: run `number` of a case; or with `bound`, which names it, the bound of a case and a vehicle."""

    case: str
    number: int
    bound: str = ""


@dataclass(frozen=True)
class Shelf:
    """Where cells lie: files of a folder, or memory."""

    folder: Path | None = None
    kept: dict[Task, Cell] = field(default_factory=dict)

    def path(self, task: Task) -> Path:
        """Return the file of a task."""
        assert self.folder is not None
        return self.folder / (f"{task.case}-bound-{task.bound}.npz" if task.bound else f"{task.case}-{task.number:05d}.npz")

    def has(self, task: Task) -> bool:
        """Tell whether a task is done."""
        return task in self.kept if self.folder is None else self.path(task).is_file()

    def put(self, task: Task, cell: Cell) -> None:
        """Keep what came of a task."""
        if self.folder is None:
            self.kept[task] = cell
        else:
            write_cell(self.path(task), cell)

    def get(self, task: Task, *names: str) -> Cell:
        """Return what came of a task, of the named configurations alone where there are names."""
        if self.folder is None:
            cell = self.kept[task]
            return Cell(cell.time, {k: v for k, v in cell.found.items() if not names or k in names}, cell.bound)
        return read_cell(self.path(task), *names)


@dataclass(frozen=True)
class Work:
    """All that a worker must know.  vehicles: by case and configuration, or why there is none.  bounds: which vehicle a bound is of."""

    cases: Mapping[str, Case]
    configurations: Sequence[Configuration]
    vehicles: Mapping[tuple[str, str], Vehicle | str]
    bounds: Mapping[tuple[str, str], Vehicle]
    every: float
    shelf: Shelf


class Maker:
    """Makes cells one after the other; what one case's instruments saw without errors is kept until the next case comes."""

    def __init__(self, work: Work) -> None:
        """Begin with nothing compiled."""
        self.work, self.name = work, ""
        self.case: Case | None = None
        self.warm: set[tuple[str, str]] = set()

    def __call__(self, task: Task) -> Cell | None:
        """Do a task; returns what came of it, or None where it lies on the shelf already."""
        if task.case != self.name or self.case is None:
            found = self.work.cases[task.case]
            source = replace(found.source) if isinstance(found.source, Recorder) else found.source
            self.name, self.case = task.case, replace(found, source=source)
        cell = self._bound(self.case, task) if task.bound else self._cell(self.case, task)
        if self.work.shelf.folder is None:
            return cell
        self.work.shelf.put(task, cell)
        return None

    def _cell(self, case: Case, task: Task) -> Cell:
        names = [one.name for one in self.work.configurations]
        try:
            log = case.log(task.number)
        except InputError as error:
            return Cell(np.empty(0), dict.fromkeys(names, f"not drawn: {error}"))
        assert log.truth is not None
        truth = log.truth.select(checks(log.truth.time, self.work.every))
        assert isinstance(truth, Truth)
        return Cell(truth.time, {one.name: self._solved(one, log, truth) for one in self.work.configurations})

    def _solved(self, configuration: Configuration, log: Log, truth: Truth) -> Solved | str:
        vehicle = self.work.vehicles[self.name, configuration.name]
        if isinstance(vehicle, str):
            return vehicle
        try:
            if (self.name, configuration.name) not in self.warm:
                configuration.warm(log, vehicle)
                self.warm.add((self.name, configuration.name))
            begun = perf_counter()
            solution = configuration.solve(log, vehicle, times=truth.time)
            elapsed = perf_counter() - begun
            lost = lost_after(solution)
            errors = compared(finite(solution), truth)
        except InputError as error:
            return str(error)
        judged = consistency(solution, errors).verdict
        cost = MICRO * elapsed / (float(truth.time[-1] - truth.time[0]) or np.nan)
        after = np.nan if lost is None else lost
        return Solved(run_of(solution, vehicle, errors), inside_of(errors), judged.answer, judged.sentence, after, cost)

    def _bound(self, case: Case, task: Task) -> Cell:
        source = case.source
        if not isinstance(source, Recorder):
            return Cell(np.empty(0), {}, "the vehicle is steered by its estimate, and moves otherwise in each run")
        try:
            return Cell(source.truth.time, {}, bound_of(source, self.work.bounds[task.case, task.bound], source.truth.time))
        except InputError as error:
            return Cell(np.empty(0), {}, str(error))


def checks(time: Array, every: float) -> Array:
    """Return which rows of truth are compared: the first at or after each multiple of so many seconds."""
    wanted = time[0] + every * np.arange(int((time[-1] - time[0] + GRACE) / every) + 1)
    return np.unique(np.searchsorted(time, wanted - GRACE))


_maker: Maker | None = None  # of a worker: what it must know is sent once, not with each task


def begin(work: Work) -> None:
    """Make a process a worker; Ctrl-C reaches it while it works, and not while it waits."""
    global _maker
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _maker = Maker(work)


def work_on(task: Task) -> Cell | None:
    """Do a task in a worker."""
    assert _maker is not None
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return _maker(task)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def done(work: Work, tasks: Sequence[Task], processes: int) -> Generator[Task, None, None]:
    """Do tasks here or in processes of their own, and yield each once it lies on the shelf, in whatever order they end."""
    if processes <= 1 or len(tasks) < 2:
        maker = Maker(work)
        for task in tasks:
            yield _shelved(work, task, maker(task))
        return
    from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
    from multiprocessing import get_context

    left, running = list(tasks)[::-1], dict[Future[Cell | None], Task]()
    with ProcessPoolExecutor(min(processes, len(tasks)), get_context("spawn"), begin, (work,)) as pool:
        while left or running:
            with _deaf():  # workers are made here, and would be interrupted before they know what to do then
                while left and len(running) < processes:  # none waits in a worker's queue, so that Ctrl-C ends all there is
                    task = left.pop()
                    running[pool.submit(work_on, task)] = task
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield _shelved(work, running.pop(future), future.result())


@contextmanager
def _deaf() -> Generator[None, None, None]:
    """Ignore Ctrl-C for a moment, in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _shelved(work: Work, task: Task, cell: Cell | None) -> Task:
    if cell is not None:
        work.shelf.put(task, cell)
    return task
