"""Solutions as folders: all that leaves a run comes back, and the angles' sigmas agree with a finite difference."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from pyarrow import csv, parquet

from leadline.core.attitude import euler_from_quaternion, exponential, product, quaternion_from_euler, wrapped
from leadline.data.errors import InputError
from leadline.data.log import Origin
from leadline.data.outcome import Outcome
from leadline.data.solution import ERROR_NAMES, Estimate, Innovations, Solution, Status
from leadline.formats.solution import attitude_covariance, read_solution, write_solution


def innovations(rows: int, rng: np.random.Generator) -> Innovations:
    outcomes = np.array([int(o) for o in Outcome])
    return Innovations(
        sensor=np.array(["dvl", "depth"])[rng.integers(0, 2, rows)],
        row=np.arange(rows),
        group=np.arange(rows) // 3,
        time=np.arange(rows) * 0.1,
        applied=np.where(np.arange(rows) % 2, np.nan, 1.0),
        component=np.array(["x", ""])[rng.integers(0, 2, rows)],
        residual=rng.normal(size=rows),
        sigma=rng.uniform(1, 2, rows),
        nis=rng.chisquare(3, rows),
        dof=rng.integers(1, 4, rows),
        gate_probability=np.full(rows, 0.999),
        widened=rng.random(rows) > 0.5,
        outcome=outcomes[rng.integers(0, len(outcomes), rows)],
    )


def solution(rows: int = 7, seed: int = 1) -> Solution:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(rows, 9, 9))
    covariance = root @ np.swapaxes(root, 1, 2) * 1e-2
    quaternion = rng.normal(size=(rows, 4))
    one = dict.fromkeys(("height", "depth", "north", "east", "altitude"))
    return Solution(
        epoch=datetime(2022, 6, 8, 9, 30, 0, 123456, UTC),
        origin=Origin(0.573, -2.9),
        time=np.arange(rows) / 3,
        latitude=rng.uniform(-1.5, 1.5, rows),
        longitude=rng.uniform(-3, 3, rows),
        **{name: rng.normal(size=rows) * 100 for name in one},
        velocity_n=rng.normal(size=(rows, 3)),
        quaternion_nb=quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True),
        covariance=0.5 * (covariance + np.swapaxes(covariance, 1, 2)),
        status=rng.integers(0, len(Status), rows),
        innovations=innovations(2 * rows, rng),
        nuisances={
            "dvl.scale": Estimate(rng.normal(size=rows), np.full(rows, 0.01), "1", "sensor"),
            'a "b"': Estimate(np.zeros(rows), np.ones(rows), "m/s"),
        },
        summary={"version": "0.1.0", "counts": {"dvl": {"used": 3}}, "distance_m": 12.5},
    )


def assert_same(a: Solution, b: Solution) -> None:
    for item in fields(Solution):
        one, two = getattr(a, item.name), getattr(b, item.name)
        if isinstance(one, np.ndarray):
            np.testing.assert_allclose(two, one, rtol=1e-12, atol=0, err_msg=item.name)
    assert (b.epoch, b.summary) == (a.epoch, a.summary)
    assert (b.origin.latitude, b.origin.longitude) == pytest.approx((a.origin.latitude, a.origin.longitude), rel=1e-14)
    for item in fields(Innovations):
        one, two = getattr(a.innovations, item.name), getattr(b.innovations, item.name)
        np.testing.assert_array_equal(one, two, err_msg=item.name)
        assert one.dtype.kind == two.dtype.kind, item.name
    assert list(a.nuisances) == list(b.nuisances)
    for name, one in a.nuisances.items():
        two = b.nuisances[name]
        assert (one.unit, one.frame) == (two.unit, two.frame)
        np.testing.assert_array_equal(np.stack([one.value, one.sigma]), np.stack([two.value, two.sigma]))


@pytest.mark.parametrize("as_csv", [False, True], ids=["parquet", "csv"])
@pytest.mark.parametrize("rows", [0, 1, 7])
def test_a_solution_comes_back_as_it_was(tmp_path: Path, rows: int, as_csv: bool) -> None:
    given = solution(rows)
    write_solution(given, tmp_path / "out", csv=as_csv)
    assert_same(given, read_solution(tmp_path / "out"))
    table = "solution.csv" if as_csv else "solution.parquet"
    names = ["covariance.parquet", "innovations.parquet", table, "states.toml", "summary.json"]
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == sorted(names)


def test_without_altitude_nuisances_or_innovations(tmp_path: Path) -> None:
    given = solution(2)
    given = replace(given, altitude=None, nuisances={}, innovations=given.innovations.select(slice(0, 0)))
    write_solution(given, tmp_path / "out")
    back = read_solution(tmp_path / "out")
    assert back.altitude is None
    assert_same(given, back)


def test_other_programs_find_the_documented_columns(tmp_path: Path) -> None:
    given = solution()
    write_solution(given, tmp_path / "out", csv=True)
    states = csv.read_csv(tmp_path / "out" / "solution.csv")
    documented = {"time_s", "altitude_m", "cov_north_east_m2", "status", "dvl.scale", "sigma_dvl.scale"}
    documented |= {f"{name}_deg" for name in ("latitude", "longitude", "roll", "pitch", "heading")}
    documented |= {f"{name}_m" for name in ("height", "depth", "north", "east", "sigma_north", "sigma_east", "sigma_depth")}
    documented |= {f"{prefix}velocity_{axis}_mps" for prefix in ("", "sigma_") for axis in ("north", "east", "down")}
    documented |= {f"sigma_{name}_deg" for name in ("roll", "pitch", "heading")}
    assert documented <= set(states.column_names)
    np.testing.assert_allclose(states["latitude_deg"], given.latitude * 180 / np.pi)
    np.testing.assert_allclose(states["sigma_depth_m"], np.sqrt(given.covariance[:, 2, 2]))
    assert states["status"].to_pylist() == [Status(s).name.lower() for s in given.status]
    heading = states["heading_deg"].to_numpy()
    assert ((heading >= 0) & (heading < 360)).all()
    covariance = parquet.read_table(tmp_path / "out" / "covariance.parquet")
    assert len(covariance.column_names) == 1 + 45
    np.testing.assert_array_equal(covariance["cov_velocity_north__rotation_down"], given.covariance[:, 3, 8])
    found = parquet.read_table(tmp_path / "out" / "innovations.parquet")
    assert found["outcome"].to_pylist() == [Outcome(o).name.lower() for o in given.innovations.outcome]
    assert "gated" in {o.name.lower() for o in Outcome}


def test_the_covariance_of_the_angles_is_that_of_small_turns() -> None:
    """Against the angles of exp([e]x) R for small e: a finite difference of the error's own definition."""
    rng = np.random.default_rng(3)
    angles = rng.uniform([-3, -1.3, -3], [3, 1.3, 3], (50, 3)).T
    root = rng.normal(size=(50, 3, 3))
    covariance = root @ np.swapaxes(root, 1, 2)
    quaternion = quaternion_from_euler(*angles)
    columns = []
    for axis in np.eye(3):
        plus, minus = (np.stack(euler_from_quaternion(product(exponential(s * 1e-6 * axis), quaternion))) for s in (1, -1))
        columns.append(wrapped(plus - minus).T / 2e-6)
    jacobian = np.stack(columns, axis=2)
    expected = jacobian @ covariance @ np.swapaxes(jacobian, 1, 2)
    np.testing.assert_allclose(attitude_covariance(covariance, *angles), expected, rtol=1e-6, atol=1e-6)


def test_a_summary_holds_plain_json(tmp_path: Path) -> None:
    odd = {"rms": np.float64(1.5), "n": np.int64(3), "nan": float("nan"), "path": Path("a"), "list": np.arange(2), "ok": np.bool_(True)}
    write_solution(replace(solution(), summary=odd), tmp_path / "out")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert {k: summary[k] for k in odd} == {"rms": 1.5, "n": 3, "nan": None, "path": "a", "list": [0, 1], "ok": True}
    assert summary["epoch"].startswith("2022-06-08T09:30")
    assert summary["origin"]["latitude_deg"] == pytest.approx(0.573 * 180 / np.pi)


@pytest.mark.parametrize("file", ["covariance.parquet", "innovations.parquet", "solution.parquet", "states.toml", "summary.json"])
@pytest.mark.parametrize("how", ["missing", "nonsense"])
def test_a_broken_folder_is_refused_by_the_name_of_the_file(tmp_path: Path, file: str, how: str) -> None:
    write_solution(solution(), tmp_path / "out")
    path = tmp_path / "out" / file
    path.unlink() if how == "missing" else path.write_text("]nonsense")
    with pytest.raises(InputError) as caught:
        read_solution(tmp_path / "out")
    assert file in str(caught.value)
    assert "\n" not in str(caught.value)


def test_wrong_rows_words_and_columns_are_refused(tmp_path: Path) -> None:
    write_solution(solution(), tmp_path / "out")
    write_solution(solution(3), tmp_path / "short")
    states = tmp_path / "out" / "solution.parquet"
    table = parquet.read_table(states)
    parquet.write_table(table.drop_columns("depth_m"), states)
    with pytest.raises(InputError, match=r"solution\.parquet: has no column 'depth_m'"):
        read_solution(tmp_path / "out")
    parquet.write_table(table.set_column(table.column_names.index("status"), "status", [["good"] * 7]), states)
    with pytest.raises(InputError, match=r"column 'status' holds 'good'; known: aligning, aided"):
        read_solution(tmp_path / "out")
    parquet.write_table(table, states)
    (tmp_path / "short" / "covariance.parquet").replace(tmp_path / "out" / "covariance.parquet")
    with pytest.raises(InputError, match=r"covariance\.parquet: has 3 rows; the solution has 7"):
        read_solution(tmp_path / "out")
    with pytest.raises(InputError, match="is not a folder"):
        read_solution(tmp_path / "nowhere")


def test_nothing_but_a_solution_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "log.toml").write_text("")
    with pytest.raises(InputError, match="name a new or an empty folder"):
        write_solution(solution(), tmp_path)
    write_solution(solution(), tmp_path / "out")
    write_solution(solution(2), tmp_path / "out")
    assert len(read_solution(tmp_path / "out")) == 2
    assert len(ERROR_NAMES) == 9
