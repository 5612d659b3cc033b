"""Paper 002 (Allotta et al.: IMU, depth and GPS at resurfacing, EKF against UKF) as a study.

    python studies/papers/paper_002.py [PART ...] [--runs N] [--second] [--processes N] [--json]

`kinematic`: a triangle of 190 m in a current that is drawn for each run; what each state is worth.  `variants`: the same with other
currents, other windows and another sigma of GPS.  `dynamics`: the sailed mission with the hull's equation, by EKF and UKF, beside table 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import radians
from typing import Any

import numpy as np
import sailing
import triangle_002
from sailing import Line, anees, bound_rms, bounded, exactly, level, nis, of, published, ratio, rms

from leadline.assess.intervals import interval_of_mean
from leadline.missions.cell_maker import Case
from leadline.missions.configuration import Configuration
from leadline.simulate.dive import StartSigmas
from leadline.simulate.instruments import Gnss
from leadline.simulate.trajectory import Place

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
    """Return the kinematic reduction: three sides of 190 m at 0.6 m/s for 1150 s.

    A current (m/s) per axis is drawn for each run; GPS of sigma (m) is heard for `window` (s) each 150 s.
    """
    trajectory = sailing.sides(LA_SPEZIA, 190.0, radians(120.0), 0.6, 30.0, LENGTH)
    aboard = sailing.vehicle("triangle", over(sigma, current))
    gnss = Resurfacing(rate=1.0, offset=0.5, sigma=(sigma, sigma, sigma), window=window)
    return sailing.case(name, trajectory, aboard, START, {"gnss": gnss})


def over(sigma: float = 3.0, current: float = 0.1) -> dict[str, Any]:
    """Return the keys of a vehicle file that a variant changes."""
    return {"water": {"current": {"sigma_mps": current, "tau_s": 1800.0}}, "sensors": {"gnss": {"sigma_m": sigma}}}


def ways(keys: dict[str, Any] | None = None) -> list[Configuration]:
    """Return what is compared: as published, and with one state after the other."""
    return [
        Configuration(WAYS[2]),
        published("no_current", keys, name=WAYS[0]),
        published("current_alone", keys, name=WAYS[1]),
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


def variants(runs: Sequence[int], processes: int = 1) -> list[Line]:
    """Return RMSE and bound with other currents, windows and sigmas of GPS."""
    lines = []
    for named, keys in VARIANTS.items():
        one = kinematic_case(**keys)
        changed = {k: v for k, v in keys.items() if k != "window"}
        found = sailing.solved(one, ways(over(**changed)), runs, every=EVERY, processes=processes)
        lines += [Line(named, way, "RMSE", rms(level(of(found, way))), unit="m") for way in WAYS]
        full = of(found, WAYS[2])
        lines.append(Line(named, WAYS[2], "ANEES(2)", anees(full), least=1.61, most=2.39))
        lines.append(Line(named, WAYS[2], "bound", exactly(bound_rms(full)), unit="m"))
        lines.append(Line(named, WAYS[2], "RMSE over bound", bounded(full), most=1.05))
    return lines


def dynamics(runs: Sequence[int], processes: int = 1) -> list[Line]:
    """Return the table of the sailed triangle with the hull's equation, and the paper's table 1 beside it."""
    found = triangle_002.solved(runs, list(triangle_002.ways()))
    size = {way: np.linalg.norm(one.error, axis=2) for way, one in found.items()}
    reported = {way: np.sqrt(np.trace(one.covariance, axis1=2, axis2=3)) for way, one in found.items()}
    lines = []
    for way, one in found.items():
        nees = np.einsum("rti,rtij,rtj->rt", one.error, np.linalg.inv(one.covariance), one.error)
        bar = {"least": 50.0} if way.startswith("no current") else {}
        lines.append(Line("sailed triangle", way, "RMSE", rms(size[way]), unit="m"))
        lines.append(Line("sailed triangle", way, "mean NEES(2)", interval_of_mean(np.mean(nees, axis=1)), **bar))
    full, bare = size["EKF"], size["no current, EKF"]
    within = np.all(np.abs(found["EKF"].surfacing) <= 3.0, axis=1).reshape(len(runs), -1)
    lines += [
        Line("sailed triangle", "EKF", "RMSE over reported sigma", ratio(full, reported["EKF"]), most=1.05),
        Line("sailed triangle", "EKF", "RMSE over that of the UKF", ratio(full, size["UKF"]), least=0.97, most=1.03),
        Line("sailed triangle", "no current, EKF", "RMSE over that of the UKF", ratio(bare, size["no current, UKF"])),
        Line("sailed triangle", "no current, EKF", "RMSE over that with states", ratio(bare, full), least=2.5),
        Line("sailed triangle", "EKF", "RMSE over smoothed", ratio(full, size["smoothed"]), least=2.5),
        Line("sailed triangle", "EKF", "within 3 sigma at surfacing", sailing.share(within), least=0.99),
        Line("sailed triangle", "EKF", "NIS of GPS", interval_of_mean(found["EKF"].nis)),
    ]
    return lines + table_1(found)


def table_1(found: dict[str, triangle_002.Way]) -> list[Line]:
    """Return distances to the fixes of the USBL, whose own error is in them, beside those of the paper."""
    lines = []
    for name, published_there in triangle_002.PUBLISHED.items():
        there = np.array(published_there)
        lines.append(Line("table 1", f"paper, {name}", "RMS of 11 fixes", exactly(float(np.sqrt(np.mean(there**2)))), unit="m"))
        lines.append(Line("table 1", f"paper, {name}", "largest", exactly(float(np.max(there))), unit="m"))
    for way, one in found.items():
        square = np.nanmean(one.usbl**2, axis=1)
        lines.append(Line("table 1", way, "RMS of 11 fixes", rms(np.sqrt(square)[:, None]), unit="m"))
        lines.append(Line("table 1", way, "largest, mean over runs", interval_of_mean(np.nanmax(one.usbl, axis=1)), unit="m"))
        for k in range(one.usbl.shape[1]):
            there = " ".join(f"{name} {row[k]:.1f}" for name, row in triangle_002.PUBLISHED.items())
            lines.append(Line("table 1", way, f"fix {k + 1} (paper: {there})", rms(known(one.usbl[:, k])), unit="m"))
    return lines


def known(column: Any) -> Any:
    """Return the numbers of a column (n, 1)."""
    return column[np.isfinite(column)][:, None]


VARIANTS: dict[str, dict[str, Any]] = {
    "current 0.05 m/s": {"current": 0.05},
    "current 0.15 m/s": {"current": 0.15},
    "GPS for 30 s": {"window": 30.0},
    "GPS of 5 m": {"sigma": 5.0},
}
LIMITS = {WAYS[0]: {"least": 13.0, "most": 20.0}, WAYS[2]: {"most": 6.7}, WAYS[3]: {"most": 2.0}}
NEES = {WAYS[0]: {"least": 50.0}, WAYS[2]: {"least": 1.61, "most": 2.39}}
LATE = {WAYS[2]: {"most": 5.2}}
PARTS = {"kinematic": kinematic, "variants": variants, "dynamics": dynamics}

if __name__ == "__main__":
    sailing.main(__doc__.splitlines()[0], PARTS, 100)
