"""Paper 001 (Wang and Pang, 2014: IMU, DVL and SBL with EKF and UKF) as a study: what is right, and what is published in it.

    python studies/papers/paper_001.py [--runs 200] [--second] [--bars] [--json] [--processes 1]

docs/paper-001.md says what is asked and what came of it.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from as_published_001 import published
from common import PLANAR, ROOT, Solved, Verdict, judged, mean_bound, mse, over_bound, plain, scaled, solved, table, whitened
from paths_001 import EXACT, PATHS, case

from leadline.assess.intervals import Interval, interval_of_rmse_ratio
from leadline.data.vehicle import read_vehicle
from leadline.missions.cell_maker import Case
from leadline.missions.configuration import Configuration
from leadline.missions.mission import read_mission
from leadline.missions.study import study
from leadline.missions.summary import anees_of
from leadline.simulate.dive import Recorder

if TYPE_CHECKING:
    from collections.abc import Sequence

    from leadline.data.records import Array
    from leadline.missions.study import Results

MODEL, EVERY, PATTERNS = "body-velocity", 1.0, 50  # s between checks; draws of the moments of fixes of which the bound is the mean
ESTIMATORS = ("ekf", "ukf", "ckf", "srukf")
WITHOUT = {"C1": ("sbl",), "C2": ()}
# MSE (m^2) of table IV, X and Y; its labels East and North are swapped (SCENARIOS: what it calls East behaves as X).
TABLE_IV = {
    ("ekf", "sine", "C1"): (194.42, 0.4700), ("ekf", "sine", "C2"): (0.4410, 2.3405),
    ("ekf", "circle", "C1"): (20.971, 2.3818), ("ekf", "circle", "C2"): (0.4253, 0.2852),
    ("ekf", "straight", "C1"): (0.0659, 0.1242), ("ekf", "straight", "C2"): (0.4704, 0.0215),
    ("ukf", "sine", "C1"): (174.18, 0.4829), ("ukf", "sine", "C2"): (0.4633, 2.3414),
    ("ukf", "circle", "C1"): (21.667, 2.7862), ("ukf", "circle", "C2"): (0.4314, 0.2870),
    ("ukf", "straight", "C1"): (0.2606, 0.1256), ("ukf", "straight", "C2"): (0.4731, 0.022),
}  # fmt: skip
CLOSURE = {"C1": 4.98, "C2": 1.25}  # m, section III-D


class Row(NamedTuple):
    """A path by a configuration and an estimator: of X and Y the MSE (m^2), that of the bound, and RMSE over bound; then consistency.

    anees, in_band: by number of states, 9 and 5 (X, Y, their velocities, heading; nan where it was not asked for), per state.
    """

    path: str
    configuration: str
    estimator: str
    mse: Sequence[Interval]
    bound: Sequence[float]
    over: Sequence[Interval]
    anees: dict[int, Interval]
    in_band: dict[int, Interval]
    nis: dict[str, Interval]


def configuration(which: str, estimator: str = "ekf") -> Configuration:
    """Return configuration C1 or C2 of the paper."""
    return Configuration(f"{which} {estimator}", estimator, MODEL, without=WITHOUT[which])


def on_the_paths(runs: Sequence[int], processes: int = 1, estimators: Sequence[str] = ESTIMATORS) -> Results:
    """Return the study of the three paths."""
    cases = {name: case(f"001-{name}", course) for name, course in PATHS.items()}
    return study(cases, [configuration(c, e) for c in WITHOUT for e in estimators], runs, every=EVERY, bound=False, processes=processes)


def bounds(patterns: int = PATTERNS) -> dict[tuple[str, str], Array]:
    """Return the bound (times, 9, 9) by path and configuration."""
    found = {}
    for name, course in PATHS.items():
        ready = case(f"001-{name}", course).ready(EVERY)
        assert isinstance(ready.source, Recorder)
        for which in WITHOUT:
            vehicle = configuration(which).aboard(ready.vehicle)
            found[name, which] = mean_bound(ready.source, vehicle, ready.source.truth.time, patterns)
    return found


def row_of(results: Results, path: str, which: str, estimator: str, bound: Array, planar: Solved | None) -> Row:
    """Return what is told of one path, configuration and estimator; planar: the same runs with their covariances."""
    name = f"{which} {estimator}"
    found, told = results.study(path, name), results.summaries[path, name].statistics
    assert found is not None
    error, own = found.error[:, :, :2], np.diagonal(bound, axis1=1, axis2=2)[:, :2].mean(axis=0)
    anees, in_band = {9: told["anees_all"]}, {9: told["in_band_all"]}
    if planar is not None:
        other = replace(found, whitened={"planar": whitened(planar, PLANAR)})
        anees[5], in_band[5] = anees_of(other, "planar"), other.in_band("planar")
    nis = {k.removeprefix("nis_"): v for k, v in told.items() if k.startswith("nis_")}
    return Row(path, which, estimator, mse(error), tuple(map(float, own)), over_bound(error, bound[:, :2, :2]), anees, in_band, nis)


def rows_of(results: Results, limits: dict[tuple[str, str], Array], runs: Sequence[int]) -> list[Row]:
    """Return all rows; the five states of the plane are asked of the EKF alone."""
    rows = []
    for (path, which), bound in limits.items():
        planar = solved(case(f"001-{path}", PATHS[path]), configuration(which), runs, EVERY)
        names = [one.estimator for one in results.configurations if one.name.startswith(which)]
        rows += [row_of(results, path, which, e, bound, planar if e == "ekf" else None) for e in names]
    return rows


def differences(results: Results, path: str) -> dict[str, float]:
    """Return by configuration and estimator how far its position was ever from that of the EKF (m), over runs and checks."""
    found = {}
    for one in results.configurations:
        mine, ekf = results.study(path, one.name), results.study(path, f"{one.name.split()[0]} ekf")
        if mine is not None and ekf is not None and one.estimator != "ekf":
            found[one.name] = float(np.max(np.linalg.norm(mine.error[:, :, :3] - ekf.error[:, :, :3], axis=2)))
    return found


def exact_start(runs: Sequence[int], processes: int = 1) -> dict[str, list[Interval]]:
    """Return by path the MSE of X and Y of C1 from an exact start, as the paper has it."""
    cases = {name: case(f"001-{name}-exact", course, start=EXACT) for name, course in PATHS.items()}
    results = study(cases, [configuration("C1")], runs, every=EVERY, bound=False, processes=processes)
    return {name: mse(results.study(name, "C1 ekf").error[:, :, :2]) for name in PATHS}  # type: ignore[union-attr]


def pool(runs: Sequence[int]) -> dict[str, Interval]:
    """Return by configuration the RMS over runs of the gap between end and start of the track that the true one does not have (m)."""
    mission = read_mission(ROOT / "missions" / "papers" / "001-pool.toml")
    one = Case(mission, read_vehicle(ROOT / "missions" / "vehicles" / "yellowfin-sbl.toml"))
    found = {}
    for which in WITHOUT:
        error = solved(one, configuration(which), runs, EVERY).error
        gap = np.linalg.norm(error[:, -1, :2] - error[:, 0, :2], axis=1)
        found[which] = interval_of_rmse_ratio(gap, np.ones(len(gap)))
    return found


def bars(rows: Sequence[Row], results: Results, exact: dict[str, list[Interval]]) -> list[Verdict]:
    """Return the verdicts on what is right."""
    found = []
    for row in rows:
        where = f"{row.path}, {row.configuration} {row.estimator}"
        for axis, (value, limit) in enumerate(zip(row.mse, row.bound, strict=True)):
            if row.configuration == "C2":
                found += [judged(f"{where}: MSE {'XY'[axis]} over bound at most 1.10", scaled(value, 1 / limit), 1.10)]
                found += [judged(f"{where}: MSE {'XY'[axis]} at most 0.0030 m2", value, 0.0030)]
        for states, share in row.in_band.items():
            found += [judged(f"{where}: NEES({states}) in its band at 0.90 of times", share, at_least=0.90)]
        found += [judged(f"{where}: NIS of {name} is 1", value, 1.0, 1.0) for name, value in row.nis.items()]
    for path, both in exact.items():
        found += [judged(f"{path}, C1 ekf, exact start: MSE {'XY'[k]} at most 0.003 m2", v, 0.003) for k, v in enumerate(both)]
    for path in results.missions:
        for name, far in differences(results, path).items():
            found += [judged(f"{path}, {name}: never 0.01 m from the EKF", Interval(far, far, far), 0.01)]
        for axis, ratio in enumerate(gained(results, path)):
            found += [judged(f"{path}, ekf: RMSE {'XY'[axis]} of C2 over that of C1 at most 1", ratio, 1.0)]
    return found


def gained(results: Results, path: str) -> list[Interval]:
    """Return the RMSE of C2 over that of C1 in X and Y, on the same runs."""
    one, two = results.study(path, "C1 ekf"), results.study(path, "C2 ekf")
    assert one is not None
    assert two is not None
    return [interval_of_rmse_ratio(two.error[:, :, k], one.error[:, :, k]) for k in range(2)]


def measured(runs: Sequence[int], processes: int = 1) -> dict[str, Any]:
    """Return all that the study finds."""
    results = on_the_paths(runs, processes)
    rows, exact = rows_of(results, bounds(), runs), exact_start(runs, processes)
    cases = published(runs)
    return {
        "runs": list(runs), "rows": rows, "exact": exact, "far": {p: differences(results, p) for p in results.missions},
        "pool": pool(runs),
        "published": cases.rows, "verdicts": [*bars(rows, results, exact), *cases.verdicts],
    }  # fmt: skip


def text_of(found: dict[str, Any], *, every_bar: bool = False) -> str:
    """Write what was found as tables; every_bar: with the bars that are held."""
    head = ("path, configuration", "MSE X", "99 %", "MSE Y", "99 %", "bound X", "bound Y", "over X", "over Y",
            "NEES(9)", "in band", "NEES(5)", "in band", "paper X", "paper Y")  # fmt: skip
    lines = []
    for r in found["rows"]:
        paper = TABLE_IV.get((r.estimator, r.path, r.configuration), ("", ""))
        states = [f"{part[n].estimate:.3g}" if n in part else "" for n in (9, 5) for part in (r.anees, r.in_band)]
        lines.append((f"{r.path}, {r.configuration} {r.estimator}", *(t for v in r.mse for t in (f"{v.estimate:.5f}", str(v))),
                      *(f"{b:.5f}" for b in r.bound), *(f"{v.estimate:.3f}" for v in r.over), *states, *map(str, paper)))  # fmt: skip
    exact = [(f"{path}, C1 ekf", *(t for v in both for t in (f"{v.estimate:.5f}", str(v)))) for path, both in found["exact"].items()]
    nis = [(f"{r.path}, {r.configuration}", *(f"{name} {v.estimate:.4f} ({v})" for name, v in sorted(r.nis.items())))
           for r in found["rows"] if r.estimator == "ekf"]  # fmt: skip
    gaps = [(which, f"{v.estimate:.3f}", str(v), f"{CLOSURE[which]}") for which, v in found["pool"].items()]
    far = [(path, *(f"{name} {value:.1e}" for name, value in both.items())) for path, both in found["far"].items()]
    return "\n\n".join((
        f"MSE (m2) over {len(found['runs'])} runs, and table IV; NEES per state", table(head, lines),
        "From an exact start", table(("", "MSE X", "99 %", "MSE Y", "99 %"), exact),
        "NIS per component, EKF", "\n".join("  ".join(line) for line in nis),
        "Farthest from the EKF (m)", "\n".join("  ".join(line) for line in far),
        "As published",
        table(("", "MSE X", "99 %", "MSE Y", "99 %", "along / v2", "NEES(5)", "NEES(9)"), [r.words for r in found["published"]]),
        "Pool: gap between end and start (m)", table(("", "ours", "99 %", "paper"), gaps),
        "\n".join(str(v) for v in found["verdicts"] if every_bar or not v.held),
        f"{sum(v.held for v in found['verdicts'])} of {len(found['verdicts'])} bars held",
    ))  # fmt: skip


def jsonable(value: Any) -> Any:
    """Return what was found as plain types."""
    if isinstance(value, Interval):
        return plain(value)
    if hasattr(value, "_asdict"):
        return jsonable(value._asdict())
    if isinstance(value, dict):
        return {str(k): jsonable(v) for k, v in value.items()}
    return [jsonable(v) for v in value] if isinstance(value, list | tuple) else value


def main() -> None:
    """Do the study; a second set of seeds tells whether the first one was lucky."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--second", action="store_true", help="the second set of seeds")
    parser.add_argument("--bars", action="store_true", help="name the bars that are held as well")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--processes", type=int, default=1)
    given = parser.parse_args()
    first = given.runs if given.second else 0
    found = measured(range(first, first + given.runs), given.processes)
    print(json.dumps(jsonable(found), indent=1) if given.json else text_of(found, every_bar=given.bars))


if __name__ == "__main__":
    main()
