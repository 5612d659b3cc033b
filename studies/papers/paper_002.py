"""Paper 002 (Allotta et al.: IMU, depth and GPS at resurfacing, EKF against UKF) as a study.

    python studies/papers/paper_002.py [PART ...] [--runs N] [--second] [--processes N] [--json]

`kinematic`: a triangle of 190 m in a current that is drawn for each run; what each state is worth.  `window`, `current`: the same with
other windows of GPS and currents.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import radians
from typing import Any

import numpy as np

import sailing
from leadline.missions.cell_maker import Case
from leadline.missions.configuration import Configuration
from leadline.simulate.dive import StartSigmas
from leadline.simulate.instruments import Gnss
from leadline.simulate.trajectory import Place
from sailing import Line, anees, bound_rms, bounded, exactly, level, nis, of, published, rms

LA_SPEZIA = Place(radians(44.03), radians(9.82), depth=4.5)
EVERY, LENGTH = 10.0, 1150.0  # s
START = StartSigmas(position=3.0, depth=0.1, velocity=1.0, tilt=0.002, heading=radians(30.0))
WAYS = ("no current state", "current", "current, bias and scale", "smoothed")


@dataclass(frozen=True, kw_only=True)
class Resurfacing(Gnss):
    """GPS that is heard for `window` seconds each `each` seconds, from time zero on."""

    each: float = 150.0
    window: float = 10.0

    def sampling(self, duration: float, generator: np.random.Generator) -> Any:
        """Return the moments (s) at which it looks: those at which it hears."""
        time = super().sampling(duration, generator)
        return time[time % self.each < self.window]


def kinematic_case(name: str = "002-kinematic", *, window: float = 10.0, sigma: float = 3.0, current: float = 0.1) -> Case:
    """Return the kinematic reduction: three sides of 190 m at 0.6 m/s for 1150 s; a current (m/s) per axis, GPS with sigma (m)."""
    trajectory = sailing.sides(LA_SPEZIA, 190.0, radians(120.0), 0.6, 30.0, LENGTH)
    aboard = sailing.vehicle("triangle")
    gnss = Resurfacing(rate=1.0, offset=0.5, sigma=(sigma, sigma, sigma), window=window)
    return sailing.case(name, trajectory, aboard, START, {"gnss": gnss})


def ways() -> list[Configuration]:
    """Return what is compared: as published, and with one state after the other."""
    return [
        Configuration(WAYS[2]),
        published("no_current", name=WAYS[0]),
        published("current_alone", name=WAYS[1]),
        Configuration(WAYS[3], smooth=True),
    ]


def kinematic(runs: Sequence[int], processes: int = 1) -> list[Line]:
    """Return the table of the kinematic reduction with its bars."""
    one = kinematic_case()
    found = sailing.solved(one, ways(), runs, every=EVERY, processes=processes)
    by = {way: of(found, way) for way in WAYS}
    full = by[WAYS[2]]
    lines = [Line("triangle", way, "RMSE", rms(level(by[way])), unit="m", **LIMITS.get(way, {})) for way in WAYS]
    lines += [Line("triangle", way, "ANEES(2)", anees(by[way]), **NEES.get(way, {})) for way in WAYS]
    late = [Line("triangle", way, "RMSE after 160 s", rms(level(by[way], 160.0)), unit="m", **LATE.get(way, {})) for way in WAYS]
    before = (full.time % 150.0 == 0.0) & (full.time > 0.0)
    within = np.all(np.abs(full.whitened["position"][:, before, :2]) <= 3.0, axis=2)
    return [
        *lines,
        *late,
        Line("triangle", WAYS[2], "bound", exactly(bound_rms(full)), unit="m"),
        Line("triangle", WAYS[2], "bound after 160 s", exactly(bound_rms(full, 160.0)), unit="m"),
        Line("triangle", WAYS[2], "RMSE over bound", bounded(full), most=1.05),
        Line("triangle", WAYS[2], "NIS of GPS", nis(full, "gnss"), most=1.0, least=1.0),
        Line("triangle", WAYS[2], "within 3 sigma at surfacing", sailing.share(within), least=0.99),
    ]


LIMITS = {WAYS[0]: {"least": 13.0, "most": 20.0}, WAYS[2]: {"most": 6.7}, WAYS[3]: {"most": 2.0}}
NEES = {WAYS[0]: {"least": 50.0}, WAYS[2]: {"least": 1.61, "most": 2.39}}
LATE = {WAYS[2]: {"most": 5.2}}
PARTS = {"kinematic": kinematic}

if __name__ == "__main__":
    sailing.main(__doc__.splitlines()[0], PARTS, 100)
