"""Paper 004 (Radojevic: EKF of Nessie, constant speed in five degrees of freedom, FOG, DVL and LBL) as a study.

python studies/papers/paper_004.py [PART ...] [--runs N] [--second] [--processes N] [--json]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import degrees, radians
from typing import Any

import numpy as np
import sailing
from sailing import Line, anees, bound_rms, bounded, exactly, level, of, published, ratio, rms

from leadline.assess.intervals import Interval, interval_of_mean
from leadline.data.log import Log
from leadline.data.outcome import Outcome
from leadline.missions.cell_maker import Case
from leadline.missions.configuration import Configuration
from leadline.missions.mission import read_mission
from leadline.missions.montecarlo import Study
from leadline.simulate.dive import StartSigmas
from leadline.simulate.faults import Fault, WildFixes
from leadline.simulate.plans import Place, Weave, driven
from leadline.simulate.profiles import Ramp, Sinusoid

ROOT = sailing.HOME.parents[1]
EARN = Place(radians(56.385), radians(-4.215), depth=5.0)
EVERY, LENGTH, SPEED = 2.0, 100.0, 0.8
START = StartSigmas(position=1.0, depth=0.05, velocity=1.0, tilt=0.002, heading=radians(30.0))
OFFSET, WHITE, WIDE_WHITE, ALONE = "offset and drift", "SDyaw 0.01 (as published)", "SDyaw 0.2 (as published)", "dead reckoning"
WAYS = (OFFSET, WHITE, WIDE_WHITE, ALONE)


def course(shape: str) -> Any:
    """Return 80 m straight on 40 degrees, or a square of 10 m, twice, at 0.8 m/s."""
    if shape == "straight":
        return sailing.sides(EARN, 80.0, 0.0, SPEED, 0.0, LENGTH, radians(40.0))
    return sailing.sides(EARN, 10.0, radians(90.0), SPEED, 8.0, LENGTH)


def planar_case(shape: str, name: str = "", faults: Sequence[Fault] = (), **lbl: Any) -> Case:
    """Return a planar case; lbl: what is other of the LBL fixes (sigma, latency)."""
    aboard = sailing.vehicle("loch")
    made = sailing.instruments_of(aboard)
    fixes = replace(made["lbl"], sigma_depth=0.0, **lbl)  # so that rows state no sigma, and that of the vehicle file counts
    return sailing.case(name or f"004-{shape}", course(shape), aboard, START, {"lbl": fixes}, faults)


def ways() -> list[Configuration]:
    """Return what is compared without outliers and delays."""
    return [
        Configuration(OFFSET),
        published("fog_white_01", name=WHITE),
        published("fog_white_2", name=WIDE_WHITE),
        Configuration(ALONE, without=("lbl",)),
    ]


def heading(runs: Study, after: float) -> Interval:
    """Return the root mean square of the heading error after a time, degrees."""
    found = rms(np.abs(runs.error[:, runs.time > after, 8]))
    return Interval(*(degrees(v) for v in (found.low, found.high, found.estimate)))


def clean(runs: Sequence[int], processes: int = 1) -> list[Line]:
    """Return the table without outliers and delays: straight and square."""
    lines = []
    for shape in ("straight", "square"):
        found = sailing.solved(planar_case(shape), ways(), runs, every=EVERY, processes=processes)
        by = {way: of(found, way) for way in WAYS}
        bars: Any = CLEAN[shape]
        for way, one in by.items():
            ours = bars if way == OFFSET else {}
            lines += [
                Line(shape, way, "RMSE", rms(level(one)), unit="m", **ours.get("rmse", {})),
                Line(shape, way, "ANEES(2)", anees(one), **ours.get("anees", {})),
                Line(shape, way, "heading, second half", heading(one, LENGTH / 2), unit="deg", **ours.get("heading", {})),
            ]
        best = by[OFFSET]
        lines.append(Line(shape, OFFSET, "bound", exactly(bound_rms(best)), unit="m"))
        lines.append(Line(shape, OFFSET, "RMSE over bound", bounded(best), most=1.08))
        lines.append(Line(shape, WHITE, "RMSE over that with offset", ratio(level(by[WHITE]), level(best))))
        lines.append(Line(shape, WIDE_WHITE, "RMSE over that with offset", ratio(level(by[WIDE_WHITE]), level(best))))
    return lines


GATED, WIDENING = "gate 9.21", "gate 9.21 that widens"
OUTLIERS = {
    GATED: lambda: Configuration(GATED, over=lbl({"gate_probability": 0.99})),
    WIDENING: lambda: Configuration(WIDENING, over=lbl({"gate_probability": 0.99, "gate_widening_s": 40.0})),
    "Student's t, 4": lambda: Configuration("Student's t, 4", over=lbl({"student_dof": 4.0})),
    "sigma of 3 m, no gate": lambda: published("three_metres", name="sigma of 3 m, no gate"),
    "no gate": lambda: published("raw_fixes", name="no gate"),
    WIDE_WHITE: lambda: published("fog_white_2", name=WIDE_WHITE),
    "median of 11, 6 m": lambda: Configuration(
        "median of 11, 6 m", over=lbl({"model": plugin("median_of_fixes"), "gate_probability": 1.0})
    ),
}


def lbl(keys: dict[str, Any]) -> dict[str, Any]:
    """Return keys of the LBL fixes as a run file holds them."""
    return {"sensors": {"lbl": keys}}


def plugin(name: str, function: str = "compose") -> str:
    """Return how a vehicle file names a sensor of `as_published`."""
    return f"{sailing.HOME / 'as_published' / name}.py:{function}"


def outliers(runs: Sequence[int], processes: int = 1) -> list[Line]:
    """Return what wrong fixes do: 10 % and 30 % of them off by 4 to 20 m, straight."""
    gated = GATED
    base = of(sailing.solved(planar_case("straight"), [OUTLIERS[gated]()], runs, every=EVERY, processes=processes), gated)
    refused = [[o == Outcome.GATED for o in run] for run in by_run(base, "lbl", len(runs))]
    lines = [
        Line("no outliers", gated, "RMSE", rms(level(base)), unit="m"),
        Line("no outliers", gated, "good fixes turned away", interval_of_mean([np.mean(run) for run in refused]), most=0.02),
    ]
    for fraction, most in ((0.1, 1.12), (0.3, 1.3)):
        wild = WildFixes(sensor="lbl", fraction=fraction, low=4.0, high=20.0)
        named = f"{100 * fraction:.0f} % wrong"
        one = planar_case("straight", faults=[wild])
        found = sailing.solved(one, [make() for make in OUTLIERS.values()], runs, every=EVERY, bound=False, processes=processes)
        for way in OUTLIERS:
            part = of(found, way)
            lines.append(Line(named, way, "RMSE", rms(level(part)), unit="m"))
            lines.append(Line(named, way, "ANEES(2)", anees(part)))
        for way in (gated, WIDENING):
            over = ratio(level(of(found, way)), level(base))
            lines.append(Line(named, way, "RMSE over that without outliers", over, most=most))
    return lines


def by_run(runs: Study, sensor: str, count: int) -> Any:
    """Return the outcomes of the rows of a sensor, by run, where each run has as many."""
    return np.reshape(runs.groups[sensor].outcome, (count, -1))


@dataclass(frozen=True)
class Shuffled:
    """The rows of all tables in an order that is drawn, as a logger may write them."""

    sensor: str = "lbl"

    def apply(self, log: Log, generator: np.random.Generator) -> Log:
        """Return the log with rows in another order; the truth keeps its own."""
        mixed = {name: one.select(generator.permutation(len(one))) for name, one in log.tables.items() if name != "truth"}
        return replace(log, tables={**log.tables, **mixed})


def delay(runs: Sequence[int], processes: int = 1) -> list[Line]:
    """Return what a delay of 1.5 s of good fixes (0.3 m) costs, ignored and handled, and what synchronous fusion costs."""
    lines = []
    good = {"sigma": 0.3}
    fine = lbl({"sigma_m": 0.3})
    plain, live, old = "at their times", "as they arrive, window 30 s", "delay ignored"
    ways = [Configuration(plain, over=fine), Configuration(live, over=fine, as_live=True), published("latency_ignored", fine, name=old)]
    sync = [Configuration(f"sync {tick} s", over={**fine, "process": {"sync_s": tick}}) for tick in (0.23, 0.25, 1.0)]
    for shape in ("straight", "square"):
        lines += ticks(shape, runs, processes)
        prompt = sailing.solved(planar_case(shape, **good), [ways[0], *sync], runs, every=EVERY, bound=False, processes=processes)
        late = sailing.solved(planar_case(shape, **good, latency=1.5), ways, runs, every=EVERY, bound=False, processes=processes)
        mixed = sailing.solved(
            planar_case(shape, **good, latency=1.5, faults=[Shuffled()]), ways[:1], runs, every=EVERY, bound=False, processes=processes
        )
        best = of(prompt, plain)
        named = f"{shape}, prompt"
        lines += [Line(named, plain, "RMSE", rms(level(best)), unit="m"), Line(named, plain, "ANEES(2)", anees(best))]
        for one in sync:
            part = of(prompt, one.name)
            lines.append(Line(named, one.name, "RMSE over that at their times", ratio(level(part), level(best))))
            lines.append(Line(named, one.name, "heading, second half", heading(part, LENGTH / 2), unit="deg"))
        named = f"{shape}, 1.5 s late"
        for way, bar in ((live, {"most": 1.1}), (old, {})):
            part = of(late, way)
            lines += [Line(named, way, "RMSE", rms(level(part)), unit="m"), Line(named, way, "ANEES(2)", anees(part))]
            lines.append(Line(named, way, "RMSE over that of prompt fixes", ratio(level(part), level(best)), **bar))
            lines.append(Line(named, way, "heading, second half", heading(part, LENGTH / 2), unit="deg"))
        apart = float(np.nanmax(np.abs(of(late, live).error - of(late, plain).error)))
        lines.append(Line(named, live, "largest difference to in order", exactly(apart), most=1e-9))
        apart = float(np.nanmax(np.abs(of(mixed, plain).error - of(late, plain).error)))
        lines.append(Line(named, "shuffled log", "largest difference to in order", exactly(apart), most=1e-9))
    return lines


def ticks(shape: str, runs: Sequence[int], processes: int = 1) -> list[Line]:
    """Return what it costs to let measurements wait for ticks of 0.23 s, with fixes of 1 m."""
    ways = [Configuration("at their times"), Configuration("sync 0.23 s", over={"process": {"sync_s": 0.23}})]
    found = sailing.solved(planar_case(shape), ways, runs, every=EVERY, bound=False, processes=processes)
    plain, late = (level(of(found, one.name)) for one in ways)
    return [Line(f"{shape}, fixes of 1 m", "sync 0.23 s", "RMSE over that at their times", ratio(late, plain), most=1.1)]


def pitched(runs: Sequence[int], processes: int = 1) -> list[Line]:
    """Return what differenced depths do to a vehicle that pitches by 20 degrees: they are no velocity along its z axis."""
    swing = driven(
        replace(EARN, depth=20.0), LENGTH, forward=Ramp(SPEED), heading=Ramp(0.7), pitch=Sinusoid(radians(20.0), 60.0), weave=Weave()
    )
    aboard = sailing.vehicle("loch", {"sensors": {"tilt": TILT, "dvl": {"model": plugin("differenced", "ahead")}}})
    tilt = replace(sailing.instruments_of(aboard)["tilt"], sigma=(radians(0.1), radians(0.1), 0.0))
    one = sailing.case("004-pitched", swing, aboard, START, {"tilt": tilt})
    right, wrong = "depth alone", "depth and its differences"
    kept = {"tilt": TILT, "dvl": {"model": plugin("differenced", "ahead"), "gate_probability": 1.0}}
    depth = {"sensors": {**kept, "depth": {"model": plugin("differenced"), "gate_probability": 1.0}}}
    found = sailing.solved(
        one, [Configuration(right), Configuration(wrong, over=depth)], runs, every=EVERY, bound=False, processes=processes
    )
    by = {way: of(found, way) for way in (right, wrong)}
    late = by[right].time > 10.0  # the start knows no velocity
    deep = {way: np.abs(one.error[:, late, 2]) for way, one in by.items()}
    lines = []
    for way, one in by.items():
        nees = np.mean(one.whitened["position"][:, late, 2] ** 2, axis=1)
        lines.append(Line("pitched by 20 deg", way, "RMSE of depth", rms(deep[way]), unit="m"))
        lines.append(Line("pitched by 20 deg", way, "mean NEES of depth", interval_of_mean(nees)))
    lines.append(Line("pitched by 20 deg", wrong, "RMSE of depth over that alone", ratio(deep[wrong], deep[right])))
    return lines


def turned(value: Interval) -> Interval:
    """Return an interval in degrees."""
    return Interval(*(degrees(v) for v in (value.low, value.high, value.estimate)))


def sailed(runs: Sequence[int], processes: int = 1) -> list[Line]:
    """Return the other experiments of the thesis on their missions: cruise without the inertial unit, by EKF and UKF."""
    lines = []
    for name in MISSIONS:
        one = Case.of(read_mission(ROOT / "missions" / "papers" / f"004-{name}.toml"))
        made = [
            Configuration(k, e, "cruise", without=("imu",))
            for k, e in (("EKF", "ekf"), ("UKF", "ukf"), ("UKF, kappa -0.5", "ukf:kappa=-0.5"))
        ]
        if name == "spiral":
            fixes = {"every": lbl({"gate_probability": 1.0}), "median": lbl({"gate_probability": 1.0, "model": plugin("median_of_fixes")})}
            made.append(Configuration("EKF, every fix", "ekf", "cruise", over=fixes["every"], without=("imu",)))
            made.append(Configuration("EKF, median of 11", "ekf", "cruise", over=fixes["median"], without=("imu",)))
        found = sailing.solved(one, made, runs, every=EVERY, bound=False, processes=processes)
        for way in made:
            told = found.summaries[one.name, way.name].statistics
            lines += [
                Line(name, way.name, "RMSE", told["rmse_horizontal"], unit="m"),
                Line(name, way.name, "ANEES of position per dof", told["anees_position"]),
                Line(name, way.name, "heading", turned(told["rmse_heading"]), unit="deg"),
            ]
            if name.startswith("rotation"):
                after = heading(of(found, way.name), 60.0)
                lines.append(Line(name, way.name, "heading after 60 s", after, unit="deg"))
                lines.append(Line(name, way.name, "heading within 3 sigma", told["within_heading"], least=0.99))
        both = [level(of(found, way)) for way in ("EKF", "UKF")]
        lines.append(Line(name, "EKF", "RMSE over that of the UKF", ratio(*both), least=0.97, most=1.03))
    return lines


TILT = {"kind": "attitude", "rate_hz": 5.0, "sigma_tilt_deg": 0.1, "sigma_deg": 3600.0}  # pitch of the compass; not its heading
MISSIONS = (
    "square-gps", "square-without-gps", "spiral", "pipe", "rotation-without-compass", "rotation-without-fog", "compass-disturbed",
)  # fmt: skip
BAND = {"least": 1.72, "most": 2.28}
CLEAN = {
    "straight": {"rmse": {"most": 0.66}, "anees": BAND, "heading": {"most": 0.9}},
    "square": {"anees": BAND},
}
PARTS = {"clean": clean, "outliers": outliers, "delay": delay, "pitched": pitched, "sailed": sailed}

if __name__ == "__main__":
    sailing.main(__doc__.splitlines()[0], PARTS, 200)
