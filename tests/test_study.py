"""Studies: paired, resumable, the same in any order and any process; and statistics that are those of other hands."""

from __future__ import annotations

import json
from dataclasses import replace
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy import stats

from leadline import cli
from leadline.assess.consistency import Answer
from leadline.assess.intervals import Interval
from leadline.assess.statistic import over_bound, paired, rmse_of
from leadline.data.errors import InputError
from leadline.data.vehicle import Vehicle, read_vehicle, vehicle_from_toml
from leadline.missions import cell_maker
from leadline.missions.cell_maker import Case, Shelf, Task, checks
from leadline.missions.cells import Cell, Solved, read_cell, write_cell
from leadline.missions.configuration import Configuration
from leadline.missions.fingerprint import digest_of
from leadline.missions.instruments import instruments_of
from leadline.missions.mission import read_mission
from leadline.missions.montecarlo import Groups, Run, monte_carlo
from leadline.missions.study import Results, study
from leadline.missions.study_file import NUMBERS, PAGE, read_study, study_folder
from leadline.missions.summary import Bar, Summary, Taken, outcomes_of, ratio_of, study_from, summary_of
from leadline.missions.warmup import MISSION
from leadline.missions.warmup import VEHICLE as OF_MISSION
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.plans import Lawnmower, survey
from leadline.simulate.trajectory import Place

if TYPE_CHECKING:
    from collections.abc import Sequence

ROOT = Path(__file__).parent.parent
VEHICLE = """
name = "small"
[sensors.imu]
preset = "kvh-1775"
rate_hz = 50.0
[sensors.dvl]
rate_hz = 5.0
sigma_mps = 0.01
[sensors.depth]
rate_hz = 2.0
sigma_m = 0.05
[sensors.heading]
rate_hz = 1.0
sigma_deg = 0.3
"""
START = StartSigmas(position=1.0)
TRAJECTORY = survey(Place(radians(45.0), radians(10.0), depth=20.0), Lawnmower(legs=2, length=60.0, speed=1.5), duration=30.0)
PLAIN, DEAF = Configuration("plain"), Configuration("deaf", without=("heading",))


def small() -> Vehicle:
    return vehicle_from_toml(VEHICLE)


def case(name: str = "small") -> Case:
    return Case(Recorder(TRAJECTORY, instruments_of(small()), start=START, name=name), small())


def made(runs: Sequence[int] = (0, 1, 2), configurations: Sequence[Any] = (PLAIN, DEAF), **keywords: Any) -> Results:
    return study({"small": case()}, configurations, runs, every=5.0, **keywords)


def same(one: Results, other: Results) -> bool:
    """Tell whether two studies found the same, bit by bit, but for the time it took."""

    def told(found: Results) -> Any:
        whole = found.to_dict()
        for summary in whole["summaries"]:
            summary["statistics"].pop("cost_us_per_s")
        return whole

    return bool(told(one) == told(other))


def test_a_study_is_a_monte_carlo_with_more_than_one_configuration() -> None:
    found = made()
    plain, alone = found.study("small", "plain"), monte_carlo(TRAJECTORY, small(), range(3), start=START, every=5.0, mission="small")
    assert plain is not None
    assert plain.seeds == alone.seeds
    assert np.array_equal(plain.error, alone.error)
    assert np.array_equal(plain.bound, alone.bound)
    assert all(np.array_equal(plain.groups[name].nis, alone.groups[name].nis) for name in alone.groups)
    assert [v.sentence for v in plain.verdicts()] == [v.sentence for v in alone.verdicts()]
    deaf = found.study("small", "deaf")
    assert deaf is not None
    assert np.array_equal(
        deaf.error, monte_carlo(TRAJECTORY, small().without("heading"), range(3), start=START, every=5.0, mission="small").error
    )
    assert set(found.summaries) == {("small", "plain"), ("small", "deaf")}
    summary = found.summaries["small", "plain"]
    assert summary.statistics["rmse_heading"].estimate == pytest.approx(np.sqrt(np.mean(alone.error[:, :, 8] ** 2)), rel=1e-12)
    assert summary.statistics["rmse_heading_over_bound"].estimate == pytest.approx(alone.efficiency()[8].estimate, rel=1e-12)


def test_each_run_is_drawn_once(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    draw = Recorder.draw
    monkeypatch.setattr(Recorder, "draw", lambda self, seed, keep=True: seen.append(seed) or draw(self, seed, keep=keep))
    made((4, 7), [PLAIN, DEAF, Configuration("third")], bound=False)
    assert len(seen) == len(set(seen)) == 2


def test_processes_change_nothing(tmp_path: Path) -> None:
    one, two = made(), made(processes=2, out=tmp_path / "two")
    assert same(one, two)


def test_what_is_finished_is_kept_and_not_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"

    def interrupt(_: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        made(out=out, progress=interrupt)
    assert [path.name for path in sorted((out / "cells").glob("*.npz"))] == ["small-00000.npz"]
    seen: list[int] = []
    log = Case.log
    monkeypatch.setattr(Case, "log", lambda self, number: seen.append(number) or log(self, number))
    told: list[float] = []
    found = made(out=out, progress=told.append)
    assert seen == [1, 2]
    assert told[-1] == 1.0
    assert told == sorted(told)
    assert same(found, made())
    seen.clear()
    assert same(made(out=out), found)
    made((0, 1, 2, 3), out=out)  # more runs of the same study
    assert seen == [0, 1, 2, 3][-1:]


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"configurations": (PLAIN, replace(DEAF, smooth=True))}, "configuration deaf changed"),
        ({"configurations": (PLAIN,)}, "configuration deaf changed"),
        ({"every": 2.0}, "every changed"),
    ],
)
def test_a_changed_study_is_refused(keywords: dict[str, Any], message: str, tmp_path: Path) -> None:
    made((0,), out=tmp_path / "out", bound=False)
    with pytest.raises(InputError, match=message):
        study({"small": case()}, **{"configurations": (PLAIN, DEAF), "runs": (0,), "every": 5.0, "out": tmp_path / "out"} | keywords)


def test_a_changed_mission_and_a_strange_folder_are_refused(tmp_path: Path) -> None:
    made((0,), out=tmp_path / "out", bound=False)
    other = case()
    assert isinstance(other.source, Recorder)
    louder = replace(other, source=replace(other.source, start=StartSigmas(position=2.0)))
    with pytest.raises(InputError, match="mission small changed"):
        study({"small": louder}, (PLAIN, DEAF), (0,), every=5.0, out=tmp_path / "out")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("dear")
    with pytest.raises(InputError, match="is there already"):
        made(out=tmp_path / "mine")
    (tmp_path / "out" / "cells" / "small-00000.npz").write_bytes(b"torn")
    with pytest.raises(InputError, match="is no cell of a study"):
        _ = made((0,), out=tmp_path / "out", bound=False).summaries


def test_what_cannot_be_studied_is_refused() -> None:
    with pytest.raises(InputError, match="1 missions and 0 runs"):
        made(())
    with pytest.raises(InputError, match="a number is there twice"):
        made((1, 1))
    with pytest.raises(InputError, match="2 are named 'small'"):
        study({"a": case(), "b": case()}, [PLAIN], (0,))
    with pytest.raises(InputError, match="has no sensor 'sonar'"):
        made(configurations=[PLAIN, Configuration("x", without=("sonar",))])


def test_refusals_are_counted_and_named() -> None:
    silent = replace(case("silent"), vehicle=small().without("heading"))
    found = study({"small": case(), "silent": silent}, [PLAIN, DEAF, Configuration("linear", "kf")], (0, 1), every=5.0)
    assert found.summaries["small", "deaf"].refused == {}
    refused = found.summaries["silent", "deaf"]
    assert list(refused.refused.values()) == [2]
    assert "has no sensor 'heading'" in next(iter(refused.refused))
    assert refused.statistics["refused"].estimate == 1.0
    assert found.summaries["small", "linear"].refused.keys() == found.summaries["silent", "linear"].refused.keys()
    assert found.study("silent", "deaf") is None
    assert {p.mission for p in found.pairs if np.isfinite(p.found.ratio.estimate)} == {"small"}


def test_a_misspelt_name_is_refused_before_any_work() -> None:
    for wrong in (Configuration("nonesuch", "nonesuch"), Configuration("setting", "ukf:alpa=1"), Configuration("model", process="kruise")):
        with pytest.raises(InputError, match=r"nonesuch|alpa|kruise"):
            study({"small": case()}, [PLAIN, wrong], (0,), every=5.0)


def run(error: np.ndarray, lost: float = np.nan) -> Solved:
    blocks = {"position": slice(0, 3), "velocity": slice(3, 6), "attitude": slice(6, 9), "horizontal": slice(0, 2), "all": slice(0, 9)}
    nothing = Run(error, {name: error[:, part] for name, part in blocks.items()}, {}, {})
    return Solved(nothing, np.full(9, 0.5), Answer.CONSISTENT, "Consistent.", lost, 10.0)


def summary(errors: np.ndarray, name: str = "one", **refused: str) -> Summary:
    taken = Taken(
        {k: run(error) for k, error in enumerate(errors)},
        {100 + k: why for k, why in enumerate(refused.values())},
        np.arange(errors.shape[1]) * 1.0,
    )
    seeds = tuple(range(len(errors)))
    return summary_of("m", name, taken, study_from("m", seeds, list(taken.solved.values()), taken.time, None), "no reason")


def test_lost_runs_and_shorter_ones() -> None:
    rng = np.random.default_rng(1)
    runs = {0: run(rng.standard_normal((6, 9))), 1: run(np.full((6, 9), np.nan), lost=3.0), 2: run(rng.standard_normal((5, 9)))}
    taken = Taken(runs, {3: "no start"}, np.arange(5.0))
    found = summary_of("m", "c", taken, study_from("m", (0, 2), list(taken.sound.values()), taken.time, None), "no reason")
    assert (found.runs, found.lost, found.numbers, found.refused) == (4, 1, (0, 2), {"no start": 1})
    assert found.errors.shape == (2, 5, 9)
    assert np.isfinite(found.statistics["rmse_horizontal"].estimate)
    assert found.statistics["lost"].estimate == 0.25
    assert "rmse_horizontal_over_bound" not in found.statistics
    nothing = summary_of("m", "c", Taken({}, {0: "no start"}, np.empty(0)), None, "no reason")
    assert nothing.statistics["refused"].estimate == 1.0
    assert nothing.answer == Answer.TOO_FEW


def test_statistics_of_known_errors() -> None:
    rng = np.random.default_rng(2)
    error = rng.standard_normal((200, 30, 9)) * np.arange(1.0, 10.0)
    found = summary(error)
    assert found.statistics["rmse_velocity"].estimate == pytest.approx(np.sqrt(np.mean(np.sum(error[:, :, 3:6] ** 2, axis=2))), rel=1e-12)
    assert found.statistics["end_depth"].estimate == pytest.approx(np.sqrt(np.mean(error[:, -1, 2] ** 2)), rel=1e-12)
    assert found.statistics["anees_position"].estimate == pytest.approx(np.mean(error[:, :, :3] ** 2), rel=1e-12)
    assert found.statistics["within_heading"].estimate == 0.5
    assert found.statistics["cost_us_per_s"].estimate == 10.0
    sigma = np.tile(np.arange(1.0, 10.0), (30, 1))
    ratio = over_bound(error, sigma, "velocity")
    assert ratio.estimate == pytest.approx(np.sqrt(np.mean((error[:, :, 3:6] / sigma[:, 3:6]) ** 2)), rel=1e-12)
    assert ratio.reaches(1.0, at_least=1.0)
    assert np.isnan(rmse_of(np.full((3, 4, 9), np.nan), "tilt").estimate)
    assert rmse_of(np.zeros((3, 4, 9)), "tilt") == Interval(0.0, 0.0, 0.0)


def test_intervals_hold_what_they_should() -> None:
    """Of 400 studies the interval at 90 % misses 40, if the times of a run, which are all but one, count as one.

    Two-sided coverage by the delta method is off by the order of 1 / runs, 0.5 %; a binomial of 10.5 % is beyond 68 in one of 10,000.
    """
    rng = np.random.default_rng(7)
    error = rng.standard_normal((400, 200, 1, 9)) + 0.1 * rng.standard_normal((400, 200, 8, 9))
    true = np.sqrt(2.0 * 1.01)
    missed = sum(not rmse_of(one, "horizontal", 0.9).reaches(true, at_least=true) for one in error)
    assert stats.binom.ppf(1e-4, 400, 0.095) <= missed <= stats.binom.ppf(1 - 1e-4, 400, 0.105)


def test_paired_ratios_are_judged_as_a_t_test_of_the_influences() -> None:
    rng = np.random.default_rng(5)
    common = rng.standard_normal((40, 12, 9))
    one, two = 1.1 * common + 0.2 * rng.standard_normal(common.shape), common
    found = paired(one, two, "horizontal")
    a, b = (np.mean(np.sum(e[:, :, :2] ** 2, axis=2), axis=1) for e in (one, two))
    ratio = 0.5 * np.log(a.mean() / b.mean())
    influence = 0.5 * (a / a.mean() - b / b.mean())
    assert found.ratio.estimate == pytest.approx(np.exp(ratio), rel=1e-12)
    assert found.p == pytest.approx(stats.ttest_1samp(influence + ratio, 0.0).pvalue, rel=1e-9)
    assert found.ratio.low > 1.0
    assert paired(two, two, "heading").p == 1.0
    assert paired(two, two, "heading").ratio.estimate == 1.0
    fewer = replace(summary(one), numbers=tuple(range(5, 45)))
    both = ratio_of(fewer, summary(two), "horizontal")  # runs 5 to 39 are common
    assert both.runs == 35
    assert both.ratio.estimate == paired(one[:35], two[5:], "horizontal").ratio.estimate


def test_bars() -> None:
    rng = np.random.default_rng(11)
    error = rng.standard_normal((50, 10, 9))
    summaries = {("m", "one"): summary(error), ("m", "two"): summary(2.0 * error, "two")}
    bars = [
        Bar("rmse_depth", most=1.0), Bar("ratio_depth", configuration="two", against="one", most=1.5),
        Bar("rmse_depth_over_bound", configuration="one", most=1.1), Bar("ratio_depth", against="one", least=2.0, most=2.0),
    ]  # fmt: skip
    found = list(outcomes_of(bars, summaries))
    assert [(o.configuration, o.held) for o in found] == [("one", True), ("two", False), ("two", False), ("one", None), ("two", True)]
    assert "no bound, no reason" in found[3].sentence
    assert found[4].value.estimate == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("bar", "message"),
    [
        (Bar("rmse_depth"), "has no limit"),
        (Bar("rmse_dept", most=1.0), "did you mean 'rmse_depth'"),
        (Bar("rmse_depth", mission="x", most=1.0), "'x' is not in the study"),
        (Bar("ratio_depth", most=1.0), "against: is not given"),
        (Bar("rmse_depth", against="plain", most=1.0), "against: is given"),
    ],
)
def test_a_wrong_bar_is_refused(bar: Bar, message: str) -> None:
    with pytest.raises(InputError, match=message):
        made(bars=[bar])


def test_a_cell_is_read_as_it_was_written(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    groups = Groups(rng.random(4), np.array([1, 2, 3, 1]), np.full(4, 0.999), np.array([0, 0, 1, 0]))
    plain = run(rng.standard_normal((3, 9)))
    full = plain._replace(run=plain.run._replace(groups={"dvl": groups}, correlations={("dvl", "x"): (4, rng.random(10))}))
    cell = Cell(np.arange(3.0), {"a": full, "b": "refused: it", "bound": plain}, rng.random((3, 9, 9)))
    write_cell(tmp_path / "c.npz", cell)
    found = read_cell(tmp_path / "c.npz")
    assert list(found.found) == ["a", "b", "bound"]
    assert found.found["b"] == "refused: it"
    assert np.array_equal(found.bound, cell.bound)
    one = found.found["a"]
    assert isinstance(one, Solved)
    assert np.array_equal(one.run.error, full.run.error)
    assert all(np.array_equal(got, put) for got, put in zip(one.run.groups["dvl"], groups, strict=True))
    assert one.run.correlations["dvl", "x"][0] == 4
    assert (one.answer, one.sentence, one.cost) == (full.answer, full.sentence, full.cost)
    assert np.isnan(one.lost)
    assert list(read_cell(tmp_path / "c.npz", "b").found) == ["b"]


def test_checks_are_the_first_rows_at_or_after_each_time() -> None:
    time = np.arange(101) / 10.0
    assert np.allclose(time[checks(time, 2.5)], [0.0, 2.5, 5.0, 7.5, 10.0])
    assert np.allclose(time[checks(time, 0.25)][:4], [0.0, 0.3, 0.5, 0.8])
    assert len(checks(time, 1e3)) == 1


def test_digests() -> None:
    one = {"a": np.arange(3.0), "b": (1, "x")}
    assert digest_of(one) == digest_of({"b": (1, "x"), "a": np.arange(3.0)})
    others = [{"a": np.arange(3.0), "b": (1, "y")}, {"a": np.arange(4.0), "b": (1, "x")}, {"a": np.arange(3), "b": (1, "x")}]
    assert len({digest_of(value) for value in (one, *others)}) == 4
    assert digest_of(case()) == digest_of(case())
    survey_mission = ROOT / "missions" / "survey.toml"
    assert Case.of(read_mission(survey_mission)).digest == Case.of(read_mission(survey_mission)).digest


@pytest.fixture
def place(tmp_path: Path) -> Path:
    (tmp_path / "vehicle.toml").write_text(OF_MISSION)
    (tmp_path / "mission.toml").write_text(MISSION)
    (tmp_path / "loose.toml").write_text("[sensors.dvl]\nsigma_mps = 0.1\n")
    return tmp_path


STUDY = """
missions = ["mission.toml"]
configurations = ["ekf", "loose.toml", { name = "smooth", smooth = true }]
runs = 2
every_s = 1.0
[[bars]]
configuration = "loose"
statistic = "ratio_horizontal"
against = "ekf"
most = 1e3
[[bars]]
configuration = "ekf"
statistic = "rmse_horizontal"
most = 1e-9
"""


def test_the_command(place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(place)
    (place / "study.toml").write_text(STUDY)
    assert cli.run(["study", "study.toml", "--out", "out", "--processes", "1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [s["configuration"] for s in told["summaries"]] == ["ekf", "loose", "smooth"]
    assert [s["solved"] for s in told["summaries"]] == [2, 2, 2]
    assert [bar["held"] for bar in told["bars"]] == [True, False]
    assert "a smoother knows" in told["summaries"][2]["no_bound"]
    written = json.loads((place / "out" / NUMBERS).read_text())
    assert written["summaries"] == told["summaries"]
    assert "http" not in (place / "out" / PAGE).read_text("utf-8").partition("<script>")[0]
    assert cli.run(["study", "study.toml", "--out", "out", "--processes", "1"]) == 0
    shown = capsys.readouterr().out
    assert "warmup: errors" in shown
    assert "MISSED" in shown
    assert "smooth: a smoother knows what comes after" in " ".join(shown.split())
    (place / "study.toml").write_text(STUDY.replace("every_s = 1.0", "every_s = 0.5"))
    assert cli.run(["study", "study.toml", "--out", "out"]) == 2
    assert "every changed" in capsys.readouterr().err


def test_the_command_says_that_what_is_finished_is_kept(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("leadline.missions.study_file.study", interrupted)
    (place / "study.toml").write_text(STUDY)
    assert cli.run(["study", str(place / "study.toml"), "--out", str(place / "out")]) == 130
    assert "finished runs are kept" in capsys.readouterr().err


def test_a_mission_steered_by_its_estimate_has_no_bound(place: Path) -> None:
    plain = MISSION.partition("[instruments.imu]")[0]
    (place / "mission.toml").write_text(plain + '[navigation]\nsteer_by = "estimate"\n')
    (place / "study.toml").write_text('missions = ["mission.toml"]\nconfigurations = ["ekf"]\nruns = 1\nevery_s = 1.0\n')
    _, found = study_folder(place / "study.toml", place / "out")
    summary = found.summaries["warmup", "ekf"]
    assert summary.refused == {}
    assert "steered by its estimate" in summary.no_bound
    assert len(summary.time) >= 3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("runs = 2", "runz = 2"), "unknown key 'runz'"),
        (('{ name = "smooth", smooth = true }', "{ smoth = true }"), r"configurations\[2\].*unknown key 'smoth'"),
        (("smooth = true", "smooth = true, as_live = true"), "smooth and as_live"),
        (('missions = ["mission.toml"]', 'missions = ["mission.toml", "mission.toml"]'), "2 are named 'warmup'"),
        (("runs = 2", "runs = 0"), "1 or more"),
        (("most = 1e-9", ""), r"bars\[1\].*has no limit"),
        (("loose.toml", "nonesuch.toml"), "cannot be read"),
    ],
)
def test_a_wrong_study_file_is_refused_in_one_line(change: tuple[str, str], message: str, place: Path) -> None:
    (place / "study.toml").write_text(STUDY.replace(*change))
    with pytest.raises(InputError, match=message) as error:
        read_study(place / "study.toml")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("path", sorted((ROOT / "studies").glob("*.toml")), ids=lambda path: path.stem)
def test_the_studies_that_come_along_can_be_read(path: Path) -> None:
    found = read_study(path)
    for one in found.configurations:
        for mission in found.cases.values():
            one.aboard(mission.vehicle)


def test_one_worker_makes_what_the_other_makes() -> None:
    """A maker that goes from case to case and back forgets nothing and keeps nothing of the case before."""
    cases = {name: case(name).ready(5.0) for name in ("a", "b")}
    vehicles: dict[tuple[str, str], Vehicle | str] = {(name, "plain"): small() for name in cases}
    work = cell_maker.Work(cases, (PLAIN,), vehicles, {}, 5.0, Shelf())
    maker = cell_maker.Maker(work)
    first, _, again = (maker(Task(name, 0)) for name in ("a", "b", "a"))
    assert first is not None
    assert again is not None
    one, two = first.found["plain"], again.found["plain"]
    assert isinstance(one, Solved)
    assert isinstance(two, Solved)
    assert np.array_equal(one.run.error, two.run.error)


def test_a_bound_is_of_the_instruments_and_not_of_what_is_believed_of_them(tmp_path: Path) -> None:
    (tmp_path / "vehicle.toml").write_text(VEHICLE)
    aboard = replace(case(), vehicle=read_vehicle(tmp_path / "vehicle.toml"))
    sure = Configuration("sure", over={"sensors": {"dvl": {"sigma_mps": 0.006}}})
    found = study({"small": aboard}, [PLAIN, sure, DEAF], (0, 1), every=10.0)
    plain, believed, deaf = (found.bound("small", name) for name in ("plain", "sure", "deaf"))
    assert not isinstance(plain, str)
    assert np.array_equal(plain, believed)
    assert (np.diagonal(deaf, axis1=1, axis2=2)[-1, 8] > np.diagonal(plain, axis1=1, axis2=2)[-1, 8]).all()
    factor = (0.01 / 0.006) ** 2  # of the noise; what the filter does not know of the velocity beforehand is small beside it
    assert found.summaries["small", "sure"].statistics["nis_dvl"].reaches(factor, at_least=0.8 * factor)
    assert found.summaries["small", "plain"].statistics["nis_dvl"].reaches(1.0, at_least=1.0)


def test_errors_that_are_not_defined_spoil_nothing_else() -> None:
    """A process model that knows no attitude, and one whose sigmas are zero at times."""
    error = np.random.default_rng(3).standard_normal((30, 10, 9))
    error[:, :, 6:] = np.nan
    error[:, :4, 3] = np.nan
    found = summary(error)
    for name in ("rmse_heading", "anees_attitude", "in_band_attitude", "anees_all"):
        assert np.isnan(found.statistics[name].estimate), name
    assert found.statistics["anees_position"].estimate == pytest.approx(np.mean(error[:, :, :3] ** 2), rel=1e-12)
    assert found.statistics["anees_velocity"].estimate == pytest.approx(np.mean(error[:, 4:, 3:6] ** 2), rel=1e-12)
    assert found.statistics["rmse_velocity"].estimate == pytest.approx(np.sqrt(np.mean(np.sum(error[:, 4:, 3:6] ** 2, axis=2))), rel=1e-12)
    low, high = stats.chi2.ppf([0.025, 0.975], 30 * 3) / 30
    nees = np.mean(np.sum(error[:, :, :3] ** 2, axis=2), axis=0)
    assert found.statistics["in_band_position"].estimate == np.mean((low <= nees) & (nees <= high))
