"""What is published in paper 001, brought in through public contracts alone, and what each piece does to the errors."""

from __future__ import annotations

from dataclasses import replace
from math import radians
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from common import AS_PUBLISHED, PLANAR, Solved, Verdict, judged, mse, nees, scaled, solved
from held_fixes import HeldFixes
from paths_001 import EXACT_PLACE, HEADING_SIGMA, PATHS, RATE, SBL_SIGMA, TILT_SIGMA, WIDE_SINE, Course, case, vehicle
from slope_heading import SlopeAttitude

from leadline.assess.intervals import Interval, interval_of_mean
from leadline.missions.configuration import Configuration
from leadline.simulate.instruments import Attitude, Drift

if TYPE_CHECKING:
    from collections.abc import Sequence

    from leadline.data.records import Array
    from leadline.missions.cell_maker import Case

MODEL = "body-velocity"
PUBLISHED = f"{AS_PUBLISHED / 'published_motion.py'}:compose"
# The weights of the paper's alpha = 1e-3, beta = 2 and lambda = 1 taken together: lambda / (9 + lambda) in the mean, and in the covariance
# 1 - alpha^2 + beta on top; alpha^2 (9 + kappa) - 9 = 1 at alpha = 1, and its own beta makes the same sum.
LAMBDA_ONE = "ukf:alpha=1,beta=2.999999,kappa=1"
BIAS = 0.5  # deg
TRUSTED = 0.02  # m: fixes of which the filter is told that they are better than all else
WITH = {"rate": RATE, "sigma": (TILT_SIGMA, TILT_SIGMA, HEADING_SIGMA)}
EVERY = 1.0


class Row(NamedTuple):
    """What a piece does on a path: MSE of X and Y (m^2), along the way over the mean square speed (s^2), mean NEES of 5 and 9 states."""

    name: str
    mse: Sequence[Interval]
    along: Interval
    nees: Interval
    nees_all: Interval

    @property
    def words(self) -> tuple[str, ...]:
        """Return the row as words of a table."""
        both = (t for v in self.mse for t in (f"{v.estimate:.5g}", str(v)))
        return (self.name, *both, f"{self.along.estimate:.3f}", f"{self.nees.estimate:.4g}", f"{self.nees_all.estimate:.4g}")


class Published(NamedTuple):
    """All pieces and the verdicts on their marks."""

    rows: list[Row]
    verdicts: list[Verdict]


def row_of(name: str, course: Course, found: Solved) -> Row:
    """Return what was found on a path."""
    speed = course.trajectory.at(found.time).velocity_t[:, :2]
    square = float(np.mean(np.sum(speed**2, axis=1)))
    along = np.einsum("rtk,tk->rt", found.error[:, :, :2], speed / np.linalg.norm(speed, axis=1, keepdims=True))
    ratio = scaled(mse(along[:, :, None])[0], 1.0 / square)
    return Row(name, mse(found.error[:, :, :2]), ratio, _mean(nees(found, PLANAR)), _mean(nees(found, range(9))))


def _mean(values: Array) -> Interval:
    return interval_of_mean(values.mean(axis=1))


def run(name: str, course: Course, one: Case, runs: Sequence[int], process: str = MODEL, *, sbl: bool = False) -> Row:
    """Solve a case by a process model, with or without the fixes."""
    return row_of(name, course, solved(one, Configuration(name, process=process, without=() if sbl else ("sbl",)), runs, EVERY))


def held_fixes(path: str, runs: Sequence[int], sigma: float = SBL_SIGMA) -> Row:
    """Return what fixes do that are held and taken as new; sigma: what the filter is told of them (m)."""
    fixes = HeldFixes(sigma=SBL_SIGMA, sigma_depth=SBL_SIGMA)
    one = replace(case(f"001-{path}-held", PATHS[path], gated=False, sbl=fixes), vehicle=vehicle(gated=False, sbl_sigma=sigma))
    return run(f"{path}, C2, fixes held, told {sigma:g} m", PATHS[path], one, runs, sbl=True)


def told_better(row: Row) -> bool:
    """Tell whether the filter trusted the fixes of a row above all else."""
    return row.name.endswith(f"told {TRUSTED:g} m")


def without_transport(path: str, course: Course, runs: Sequence[int], process: str = PUBLISHED) -> Row:
    """Return what a motion without w x v does."""
    which = "no w x v" if process == PUBLISHED else "the same data, right"
    return run(f"{path}, C1, {which}", course, case(f"001-{path}-transport", course, gated=False), runs, process)


def slope_heading(path: str, course: Course, runs: Sequence[int]) -> Row:
    """Return what the headings of table III do."""
    attitude = SlopeAttitude(form=course.form, amplitude=course.amplitude, omega=course.omega, **WITH)
    return run(f"{path}, C1, heading of table III", course, case(f"001-{path}-slope", course, gated=False, attitude=attitude), runs)


def biased_heading(runs: Sequence[int], degrees: float = BIAS) -> Row:
    """Return what a heading does that is always off by so many degrees, on the straight path from an exact place."""
    course, attitude = PATHS["straight"], Attitude(bias=Drift(constant=(0.0, 0.0, radians(degrees))), **WITH)
    one = case("001-straight-bias", course, start=EXACT_PLACE, gated=False, attitude=attitude)
    return run(f"straight, C1, heading off by {degrees:g} deg", course, one, runs)


def apart(path: str, runs: Sequence[int], estimator: str, process: str = MODEL, *, sbl: bool = True) -> float:
    """Return how far an estimator is ever from the EKF (m), over runs and checks."""
    one, without = case(f"001-{path}", PATHS[path]), () if sbl else ("sbl",)
    both = [solved(one, Configuration(e, e, process, without=without), runs, EVERY).error[:, :, :3] for e in ("ekf", estimator)]
    return float(np.max(np.linalg.norm(both[1] - both[0], axis=2)))


def published(runs: Sequence[int]) -> Published:
    """Return all pieces on all paths."""
    held = [held_fixes(path, runs, sigma) for sigma in (SBL_SIGMA, TRUSTED) for path in PATHS]
    wide, right = (without_transport("sine A 30 w .25", WIDE_SINE, runs, process) for process in (PUBLISHED, MODEL))
    printed = [without_transport(path, course, runs) for path, course in PATHS.items()]
    slopes = [slope_heading(path, course, runs) for path, course in PATHS.items()]
    slopes += [slope_heading("sine A 30 w .25", WIDE_SINE, runs)]
    bias = biased_heading(runs)
    rows = [*held, *printed, wide, right, *slopes, bias]
    judgeable = [r for r in held if "straight" in r.name or told_better(r)]
    return Published(rows, [
        *(judged(f"{r.name}: along-track MSE in 0.30 to 0.70 v2", r.along, 0.70, 0.30) for r in judgeable),
        *(judged(f"{r.name}: NEES(5) above 100", r.nees, at_least=100.0) for r in held),
        judged(f"{wide.name}: MSE X in 150 to 215 m2", wide.mse[0], 215.0, 150.0),
        judged(f"{wide.name}: MSE Y below 1 m2", wide.mse[1], 1.0),
        judged(f"{wide.name}: NEES(5) above 1500", wide.nees, at_least=1500.0),
        judged(f"{right.name}: MSE X at most 0.03 m2", right.mse[0], 0.03),
        *(judged(f"{r.name}: NEES(5) above 100", r.nees, at_least=100.0) for r in slopes if "straight" not in r.name),
        judged(f"{bias.name}: MSE Y in 0.07 to 0.12 m2", bias.mse[1], 0.12, 0.07),
        *(judged(f"{p}, C2: UKF with the paper's alpha and lambda, never 0.01 m from the EKF", Interval(d, d, d), 0.01)
          for p in PATHS for d in [apart(p, runs, LAMBDA_ONE)]),
    ])  # fmt: skip
