"""What the studies of papers 002 and 004 share: planar missions with exact truth, runs by seed set, statistics, and bars.

A bar is held where the 99 % interval of its statistic, over runs, reaches the limit.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np

from leadline.assess.intervals import Interval, interval_of_anees, interval_of_mean, interval_of_rmse_ratio
from leadline.data.vehicle import Vehicle, read_vehicle
from leadline.missions.cell_maker import Case
from leadline.missions.configuration import Configuration, read_configuration
from leadline.missions.instruments import instruments_of
from leadline.missions.montecarlo import Study
from leadline.missions.study import Results, study
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.faults import Fault
from leadline.simulate.instruments import Instrument
from leadline.simulate.plans import Weave, driven
from leadline.simulate.profiles import Ramp, Steps
from leadline.simulate.trajectory import Place, Trajectory

HOME = Path(__file__).parent
SECOND = 10_000  # number of the first run of the second seed set
EARLIEST = -inf
FLOATING = 1e-9


def vehicle(name: str, over: Mapping[str, Any] | None = None) -> Vehicle:
    """Return a vehicle file of these studies, with keys in place of its own."""
    return read_vehicle(HOME / "vehicles" / f"{name}.toml", over=over or {})


def published(file: str, over: Mapping[str, Any] | None = None, **changes: Any) -> Configuration:
    """Return what a paper does, as a run file of `as_published`, over a vehicle that has the keys `over` in place of its own."""
    one = read_configuration(HOME / "as_published" / f"{file}.toml")
    return replace(one, over=laid(over or {}, one.over), **changes)


def laid(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Return tables of keys laid over others."""
    both = {k: laid(below[k], v) if isinstance(v, Mapping) and isinstance(below.get(k), Mapping) else v for k, v in above.items()}
    return {**below, **both}


def sides(place: Place, side: float, corner: float, speed: float, turn: float, duration: float, heading: float = 0.0) -> Trajectory:
    """Return a polygon at constant speed: sides (m) joined by smooth turns by `corner` (rad) that last `turn` seconds."""
    if not corner:
        return driven(place, duration, forward=Ramp(speed), heading=Ramp(heading), pitch=Ramp(), weave=Weave())
    leg = side / speed
    starts = tuple(np.arange(leg - 0.5 * turn, duration, leg))
    headings = tuple(heading + corner * np.arange(len(starts) + 1))
    steps = Steps(starts, (turn,) * len(starts), headings)
    return driven(place, duration, forward=Ramp(speed), heading=steps, pitch=Ramp(), weave=Weave())


def case(
    name: str,
    trajectory: Trajectory,
    aboard: Vehicle,
    start: StartSigmas,
    instruments: Mapping[str, Instrument[Any]] | None = None,
    faults: Sequence[Fault] = (),
) -> Case:
    """Return the case of a trajectory: instruments as the vehicle file describes them, but for those that are given."""
    made = {**instruments_of(aboard), **(instruments or {})}
    return Case(Recorder(trajectory, made, start=start, name=name), aboard, tuple(faults))


def solved(
    one: Case, ways: Sequence[Configuration | str], runs: Sequence[int], *, every: float, processes: int = 1, **more: Any
) -> Results:
    """Solve the runs of one case in several ways."""
    return study({one.name: one}, ways, runs, every=every, processes=processes, **more)


def of(found: Results, way: str) -> Study:
    """Return the runs of one way; raises ValueError with the reason where there are none."""
    (mission,) = found.missions
    runs = found.study(mission, way)
    taken = found.taken(mission, way)
    if runs is None or taken.refused:
        raise ValueError(f"{mission}, {way}: {sorted(set(taken.refused.values())) or 'all runs are lost'}")
    return runs


# ---- statistics -----------------------------------------------------------------------------------------------------------------


def level(runs: Study, after: float = EARLIEST, before: float = inf) -> Any:
    """Return horizontal errors (runs, times) in m at the times after `after` up to `before` (s)."""
    kept = (runs.time > after) & (runs.time <= before)
    return np.linalg.norm(runs.error[:, kept, :2], axis=2)


def rms(size: Any) -> Interval:
    """Return the root mean square of sizes (runs, times), with its interval over runs."""
    return interval_of_rmse_ratio(size, np.ones_like(size))


def ratio(one: Any, other: Any) -> Interval:
    """Return the ratio of the root mean squares of paired sizes (runs, times)."""
    return interval_of_rmse_ratio(one, other)


def bounded(runs: Study, after: float = EARLIEST) -> Interval:
    """Return RMSE over bound: sqrt(mean of horizontal squares / mean of the bound's), over runs and times after `after` (s)."""
    kept = runs.time > after
    size = np.sqrt(np.sum(runs.bound_sigma[kept, :2] ** 2, axis=1))
    return interval_of_rmse_ratio(level(runs, after), np.tile(size, (len(runs.error), 1)))


def bound_rms(runs: Study, after: float = EARLIEST) -> float:
    """Return the root mean square over times of the horizontal bound (m)."""
    return float(np.sqrt(np.mean(np.sum(runs.bound_sigma[runs.time > after, :2] ** 2, axis=1))))


def anees(runs: Study) -> Interval:
    """Return the mean of e^T P^-1 e of the horizontal position; 2 is to be expected.  (Depth is all but uncorrelated with it.)

    Runs are independent, the times of one are not: as many times count as the variance over runs of their mean is worth.
    """
    nees = np.sum(runs.whitened["position"][:, :, :2] ** 2, axis=2)
    by_run = np.nanmean(nees, axis=1)
    if len(by_run) < 2 or not np.var(by_run) > 0.0:
        return Interval(-inf, inf, float(np.mean(by_run)))
    mean = float(np.mean(by_run))
    worth = 2.0 * mean**2 / 2.0 / float(np.var(by_run, ddof=1))  # var of a chi-square mean with 2 dof: 2 * 2 * (mean / 2)^2 / n
    return interval_of_anees(mean, max(worth, 1.0) * len(by_run), 2)


def share(flags: Any) -> Interval:
    """Return the mean over runs of the share of flags (runs, times) that are set."""
    return interval_of_mean(np.mean(np.asarray(flags, float), axis=1))


def nis(runs: Study, sensor: str) -> Interval:
    """Return the mean normalised innovation squared of a sensor per degree of freedom, by run; 1 is to be expected."""
    groups = runs.groups[sensor]
    return interval_of_mean(groups.nis / groups.dof)


# ---- bars and tables ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Line:
    """One line of a table: a statistic with its interval, and the limits that it must reach; by default it has none."""

    case: str
    way: str
    what: str
    value: Interval
    most: float = inf
    least: float = -inf
    unit: str = ""

    @property
    def held(self) -> bool | None:
        """Whether the bar is held; None without one."""
        if self.most == inf and self.least == -inf:
            return None
        return isfinite(self.value.estimate) and self.value.reaches(self.most, at_least=self.least)

    def __str__(self) -> str:
        """Write the line with three figures."""
        limits = [f">= {self.least:.4g}"] * (self.least > -inf) + [f"<= {self.most:.4g}"] * (self.most < inf)
        mark = {None: "", True: "held", False: "MISSED"}[self.held]
        between = f"({self.value.low:.3g} to {self.value.high:.3g})"
        size = f"{self.value.estimate:9.4g} {self.unit:4s}{between:22s}"
        return f"{self.case:22s} {self.way:26s} {self.what:34s} {size} {' and '.join(limits):22s} {mark}".rstrip()

    def to_dict(self) -> dict[str, Any]:
        """Return plain types for JSON."""
        limits = {"most": self.most if isfinite(self.most) else None, "least": self.least if isfinite(self.least) else None}
        ends = [self.value.estimate, *(v if isfinite(v) else None for v in (self.value.low, self.value.high))]
        return {"case": self.case, "way": self.way, "what": self.what, "value": ends, "unit": self.unit, **limits, "held": self.held}


def exactly(value: float) -> Interval:
    """Return a number that is no estimate as an interval of no width."""
    return Interval(value, value, value)


Part = Callable[[Sequence[int], int], list[Line]]


def main(what: str, parts: Mapping[str, Part], usual: int) -> None:
    """Run the parts of a study from the command line, and print a table or JSON."""
    parser = argparse.ArgumentParser(description=what)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(parts)}; by default all")
    parser.add_argument("--runs", type=int, default=usual, help=f"of each case ({usual})")
    parser.add_argument("--second", action="store_true", help="the second set of seeds")
    parser.add_argument("--processes", type=int, default=1, help="that share the runs (1)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    asked = parser.parse_args()
    wrong = sorted(set(asked.parts) - set(parts))
    if wrong:
        parser.error(f"no part {wrong[0]}: give some of {', '.join(parts)}")
    first = SECOND if asked.second else 0
    runs = range(first, first + asked.runs)
    lines = []
    for name in asked.parts or parts:
        found = parts[name](runs, asked.processes)
        lines += found
        if not asked.json:
            print("\n".join([f"-- {name}", *map(str, found)]), flush=True)
    if asked.json:
        print(json.dumps([line.to_dict() for line in lines], indent=1))
