"""The report: one document, without network, whole, of bounded size, and in words."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from solutions import group_rows, innovations, no_innovations, straight, survey, truth_of

from leadline.assess.assessment import assess
from leadline.data.errors import InputError
from leadline.data.outcome import Outcome
from leadline.data.records import Truth
from leadline.data.solution import Estimate, Status
from leadline.report import figures, tables
from leadline.report.drawing import band, clock_of, extremes, packed, spaced
from leadline.report.html import report_page, write_report
from leadline.report.text import assessment_text, summary_text

SECTIONS = (
    "happenings", "run", "map", "depth", "velocity", "attitude", "uncertainty", "nuisance", "errors", "misclosure", "residuals", "nis",
    "outcomes", "tests",
)  # fmt: skip


@pytest.fixture(scope="module")
def found():
    estimate, truth = survey()
    return estimate, truth, assess(estimate, truth)


@pytest.fixture(scope="module")
def page(found):
    estimate, truth, assessment = found
    return report_page(estimate, assessment=assessment, truth=truth, log_name="Survey <07>")


def without_library(page):
    """The page less the inlined plotly, which is full of addresses that it does not load."""
    scripts = re.findall(r"<script>.*?</script>", page, re.S)
    return page.replace(max(scripts, key=len), "")


def figure_texts(page):
    return re.findall(r'<script type="application/json">(.*?)</script>', page, re.S)


def test_page_is_one_document_with_every_section(page):
    assert page.startswith("<!DOCTYPE html>")
    assert page.count("</html>") == 1
    assert re.findall(r'<section id="(\w+)"', page) == list(SECTIONS)
    assert "Survey &lt;07&gt;" in page
    assert "<07>" not in page


def test_page_loads_nothing(page):
    own = without_library(page)
    assert not re.findall(r"https?://|//cdn|@import|url\(", own)
    assert not re.findall(r"<(?:link|img|iframe|object|embed)\b", own)
    assert not re.findall(r"<script[^>]*\ssrc=", page)
    assert "showSendToCloud: false" in own
    assert page.count("plotly.js v") == 1
    assert len(page.encode()) < 8e6


def test_page_says_the_verdict_and_what_was_run(page, found):
    own = without_library(page)
    sentence = found[2].verdict.sentence
    assert "pressure" in sentence
    assert sentence.partition(": ")[2][1:] in own
    for word in ("Not consistent", "12d3aa54c0ff", "inertial", "leadline solve survey", "R95", Outcome.NOT_CONFIGURED.sentence):
        assert word in own


def test_figures_are_json_with_as_many_numbers_on_both_axes(page):
    texts = figure_texts(page)
    assert len(texts) == 14  # map, 4 of motion, nuisance, 3 of errors, 4 sensors, nis
    for text in texts:
        for trace in json.loads(text)["data"]:
            assert len(trace["x"]["bdata"]) == len(trace["y"]["bdata"])
            assert trace["type"] == "scatter"


def test_gated_points_say_why(page):
    told = [text for body in figure_texts(page) for t in json.loads(body)["data"] for text in t.get("text", [])]
    assert sum(Outcome.GATED.sentence in text for text in told) >= 4
    assert any(text.startswith("usbl, not used: row 7 at 230.0 s") for text in told)


def test_report_is_written_whole_or_not_at_all(tmp_path, found):
    estimate, truth, assessment = found
    write_report(estimate, tmp_path / "report.html", assessment=assessment, truth=truth)
    first = (tmp_path / "report.html").read_bytes()
    write_report(estimate, tmp_path / "report.html", assessment=assessment, truth=truth)
    assert (tmp_path / "report.html").read_bytes() == first
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
    with pytest.raises(InputError):
        write_report(estimate, tmp_path, assessment=assessment)


def test_report_without_truth_innovations_or_states():
    run = straight(np.arange(0.0, 100.0))
    none = {name: getattr(run, name)[:0] for name in ("time", "latitude", "longitude", "height", "depth", "north", "east", "velocity_n")}
    none |= {name: getattr(run, name)[:0] for name in ("quaternion_nb", "covariance", "status")}
    for bare in (run, replace(run, **none), replace(run, **{name: getattr(run, name)[:1] for name in none})):
        assert not len(no_innovations())
        text = without_library(report_page(bare, assessment=assess(bare)))
        assert "Too few data" in text
        assert "No measurement was looked at" in text


def test_report_with_nan_and_sparse_truth():
    run = straight(np.arange(0.0, 100.0))
    north = run.north.copy()
    north[40:50] = np.nan
    covariance = run.covariance.copy()
    covariance[45] = np.nan
    odd = replace(run, north=north, covariance=covariance, nuisances={"x": Estimate(north, north, "m")}, altitude=np.full(100, np.nan))
    truth = Truth(time=[10.0, 90.0], north=[1.0, 2.0], east=[3.0, np.nan], depth=[np.nan, 20.0], outlier=[0.0, 0.0])
    page = report_page(odd, assessment=assess(odd, truth), truth=truth)
    for text in figure_texts(page):
        json.loads(text, parse_constant=pytest.fail)


def test_long_log_stays_small():
    time = np.arange(0.0, 86_400.0)
    rng = np.random.default_rng(0)
    states = {f"state_{k}": Estimate(rng.standard_normal(len(time)), np.ones(len(time)), "m") for k in range(30)}
    rows = np.arange(0.0, 86_400.0, 2.0)
    parts = [
        group_rows(name, rows, rng.standard_normal((len(rows), 3)), [1.0] * 3, ["north", "east", "down"], gate=0.9)
        for name in ("a", "b", "c")
    ]
    run = straight(time, nuisances=states, table=innovations(parts), status=(time // 5 % 5).astype(np.int64))
    page = report_page(run, assessment=assess(run, truth_of(run)), truth=truth_of(run))
    assert len(page.encode()) < 8e6
    assert "6 further states" in page


def test_extremes_keep_every_spike():
    values = np.zeros(100_000)
    values[[777, 50_000]] = [5.0, -5.0]
    values[3] = np.nan
    index = extremes(values, 1000)
    assert {777, 50_000, 0, 99_999} <= set(index.tolist())
    assert len(index) <= 1002
    assert (np.diff(index) > 0).all()
    assert spaced(10, 4).tolist() == [0, 3, 6, 9]
    assert spaced(11, 4).tolist() == [0, 3, 6, 9, 10]
    assert spaced(0, 4).tolist() == []
    assert extremes(np.empty(0), 10).tolist() == []


def test_band_is_interrupted_where_nothing_is_known():
    x = np.arange(5.0)
    low = np.array([0.0, 0.0, np.nan, 1.0, 1.0])
    trace = band(x, low, low + 1)
    assert trace["x"] == packed(np.array([0, 1, 1, 0, np.nan, 3, 4, 4, 3, np.nan]))


def test_angle_sigma_against_a_sample():
    from leadline.core import attitude

    rng = np.random.default_rng(2)
    root = 0.002 * rng.standard_normal((3, 3))
    covariance = np.zeros((1, 9, 9))
    covariance[0, 6:, 6:] = root @ root.T
    run = straight([0.0], heading=2.5, pitch=0.6, roll=-0.3, covariance=covariance)
    sample = attitude.product(attitude.exponential(rng.standard_normal((200_000, 3)) @ root.T), run.quaternion_nb)
    angles = np.stack(attitude.euler_from_quaternion(sample), axis=1)
    np.testing.assert_allclose(figures.angle_sigma(run)[0], angles.std(axis=0), rtol=0.01)


@pytest.mark.parametrize(("seconds", "unit"), [(100.0, "(s)"), (3000.0, "(min)"), (90_000.0, "(h)")])
def test_time_axis_has_a_fitting_unit(seconds, unit):
    run = straight([0.0, seconds])
    assert clock_of(run.time, run.epoch).title.endswith(unit)


def test_numbers_as_a_person_reads_them():
    assert [tables.number(v) for v in (0.0, 1.23456, 12345.6, 1e-7, np.nan)] == ["0", "1.23", "12,346", "1.0e-07", "–"]
    assert tables.length(1234.0) == "1,234 m"
    assert tables.length(12_340.0) == "12.34 km"
    assert tables.duration(3725.4) == "1 h 02 min"
    assert tables.duration(59.6) == "1 min 00 s"


def test_text_for_a_terminal(found, capsys):
    from rich.console import Console

    estimate, _, assessment = found
    console = Console(width=150, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(assessment_text(assessment), summary_text(replace(estimate, status=np.full(len(estimate), Status.LOST))))
    text = console.export_text()
    for word in (
        "Not consistent: pressure",
        "whiteness",
        "CEP50",
        "the vehicle file does not name this sensor",
        "100.0 % lost",
        "12d3aa54c0ff",
    ):
        assert word in text
    empty = straight([0.0])
    console.print(assessment_text(assess(empty)), summary_text(empty))
    assert "Too few data" in console.export_text()
    assert capsys.readouterr().out == ""


def wild(estimate, value, row=500):
    """A solution that has gone wild from a row on, innovations and all."""

    def put(values, late):
        result = values.copy()
        result[late:] = value
        return result

    names = ("latitude", "longitude", "height", "depth", "north", "east", "velocity_n", "quaternion_nb", "covariance")
    table = estimate.innovations
    late = table.time > estimate.time[row]
    table = replace(table, **{name: np.where(late, value, getattr(table, name)) for name in ("residual", "sigma", "nis")})
    states = {name: replace(s, value=put(s.value, row), sigma=put(s.sigma, row)) for name, s in estimate.nuisances.items()}
    return replace(estimate, innovations=table, nuisances=states, **{name: put(getattr(estimate, name), row) for name in names})


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300, -1e200, 1e60, 1e20])
@pytest.mark.parametrize("row", [0, 1, 500])
def test_a_lost_solution_is_told_first_and_warns_of_nothing(found, value, row):
    from io import StringIO

    from rich.console import Console

    estimate, truth, _ = found
    odd = wild(estimate, value, row)
    assessment = assess(odd, truth)
    page = without_library(report_page(odd, assessment=assessment, truth=truth))
    console = Console(width=80, file=StringIO())
    console.print(assessment_text(assessment), summary_text(odd))
    told = f"The solution is lost after {odd.time[row]:g} s"
    assert f'<p class="first">{told}</p>' in page
    assert page.index(told) < page.index("Not consistent</div>")
    assert console.file.getvalue().startswith(told)
    assert assessment.to_dict()["verdict"]["sentence"].startswith(told)
    assert assessment.to_dict()["verdict"]["answer"] == "not consistent"


def test_findings_stand_each_on_a_line(found):
    from leadline.assess.consistency import Answer, Verdict

    verdict = Verdict(Answer.INCONSISTENT, "dvl: has no rows. Not consistent: a; b.", first=("dvl: has no rows",), findings=("a", "b"))
    assert tables.verdict_lines(verdict) == ["dvl: has no rows", "Not consistent:", "a", "b"]
    alone = replace(verdict, sentence="Not consistent: a.", first=(), findings=("a",))
    assert tables.verdict_lines(alone) == ["Not consistent: a."]


def test_what_has_no_value_makes_no_headline(found):
    estimate, truth, _ = found
    silent = Truth(time=truth.time, heading=truth.heading)
    assert [label for label, _ in tables.headlines(assess(estimate, silent))] == ["duration", "distance travelled"]


def test_what_was_run_tells_the_distance_that_the_assessment_measures(found):
    summary = {"distance_m": 1234.56789, "start_s": 0.1234567, "verdict": {"answer": "consistent"}, "counts": {}, "epochs": [1.23456789]}
    assert tables.run_grid(summary, 987.654).rows == [("distance (m)", "987.7"), ("start (s)", "0.1235"), ("epochs", "1.235")]


@pytest.mark.parametrize("width", [70, 80, 100, 120])
def test_no_number_is_broken_on_a_terminal(found, width):
    from io import StringIO

    from rich.console import Console

    estimate, _, assessment = found
    console = Console(width=width, file=StringIO())
    console.print(assessment_text(assessment), summary_text(estimate))
    shown = console.file.getvalue()
    assert "…" not in shown.replace("a row …", "")
    assert all(len(line) <= width for line in shown.splitlines())
    for name, test, answer, *_ in tables.verdict_grid(assessment).rows:
        assert re.search(rf"\b{name} +{re.escape(test)} +{answer}\b", shown)


def test_report_rooms_are_light_to_import():
    import subprocess
    import sys

    rooms = "leadline.assess.assessment, leadline.assess.bound, leadline.report.html, leadline.report.text"
    code = f"import sys, {rooms}; print(sorted({{'scipy', 'plotly', 'jinja2', 'rich'}} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"
