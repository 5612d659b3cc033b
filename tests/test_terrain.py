"""Charts of the sea bed: depth and slope, rays against brute force, random beds against what was asked, files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pyproj import Geod
from scipy.interpolate import RegularGridInterpolator

from leadline.data.errors import InputError
from leadline.formats.chart import read_chart, write_chart
from leadline.sea.casting import NOTHING, first_root
from leadline.sea.fractal import fractal
from leadline.sea.terrain import Chart, plane

EXTENT = (-60.0, 60.0, -50.0, 70.0)


def witness(chart: Chart) -> RegularGridInterpolator:
    """The bilinear surface by SciPy; nan outside."""
    rows, columns = chart.depth.shape
    north, east = chart.north + chart.step_north * np.arange(rows), chart.east + chart.step_east * np.arange(columns)
    return RegularGridInterpolator((north, east), chart.depth, bounds_error=False, fill_value=np.nan)


def oblong(seed: int, sigma: float = 4.0) -> Chart:
    """A rough bed whose cells are no squares and whose edges are no whole blocks."""
    rough = fractal((0.0, 61.0, 0.0, 86.0), 1.0, 30.0, beta=2.4, sigma=sigma, seed=seed).depth
    return Chart(-70.0, -30.0, 2.5, 0.7, rough)


def units(generator: np.random.Generator, count: int, *, upward: float = 0.3) -> np.ndarray:
    way = generator.standard_normal((count, 3))
    way[:, 2] = np.abs(way[:, 2]) * np.where(generator.random(count) < upward, -0.2, 1.0)
    return way / np.linalg.norm(way, axis=1)[:, None]


def test_depth_and_slope_are_those_of_the_bilinear_surface():
    chart, generator = oblong(1), np.random.default_rng(2)
    south, north, west, east = chart.extent
    n, e = generator.uniform(south - 5, north + 5, 4000), generator.uniform(west - 5, east + 5, 4000)
    expected = witness(chart)(np.stack([n, e], axis=1))
    np.testing.assert_allclose(chart.depth_at(n, e), expected, atol=1e-11)
    assert 0 < np.isnan(expected).sum() < 3000
    corners = np.array([[south, west], [south, east], [north, west], [north, east]])
    np.testing.assert_allclose(chart.depth_at(*corners.T), chart.depth[[0, 0, -1, -1], [0, -1, 0, -1]], atol=1e-11)
    h = 1e-6  # a central difference within one cell, on which the surface is linear along each axis: rounding alone
    inside = np.abs((np.stack([n - south, e - west], axis=1) / (2.5, 0.7)) % 1 - 0.5).max(axis=1) < 0.49
    n, e = n[inside], e[inside]
    slope = np.stack([chart.depth_at(n + h, e) - chart.depth_at(n - h, e), chart.depth_at(n, e + h) - chart.depth_at(n, e - h)], axis=1) / (
        2 * h
    )
    np.testing.assert_allclose(chart.slope_at(n, e), slope, atol=1e-7)


def test_what_is_not_known_is_nan_and_nothing_else_is():
    chart = plane(20.0, 0.0, 0.0, (0.0, 4.0, 0.0, 4.0), 1.0)
    depth = chart.depth.copy()
    depth[2, 2] = np.nan
    hole = Chart(0.0, 0.0, 1.0, 1.0, depth)
    n, e = np.meshgrid(np.arange(0.5, 4.0), np.arange(0.5, 4.0), indexing="ij")
    known = np.ones((4, 4), bool)
    known[1:3, 1:3] = False
    np.testing.assert_array_equal(np.isfinite(hole.depth_at(n, e)), known)
    assert hole.depth_at(n, e).shape == (4, 4)
    assert hole.slope_at(n, e).shape == (4, 4, 2)
    assert np.isnan(hole.slope_at(1.5, 1.5)).all()


def test_rays_meet_a_plane_where_geometry_says():
    generator = np.random.default_rng(3)
    chart = plane(40.0, 0.11, -0.07, (-400.0, 400.0, -300.0, 500.0), 1.0)
    points = np.stack([generator.uniform(-50, 50, 3000), generator.uniform(50, 150, 3000), np.full(3000, 5.0)], axis=1)
    way = units(generator, 3000)
    normal = np.array([-0.11, 0.07, 1.0])
    with np.errstate(divide="ignore"):
        expected = (40.0 - points @ normal) / (way @ normal)
    found = chart.cast(points, way)
    hit = points + expected[:, None] * way
    inside = (expected > 0) & (np.abs(hit[:, 0]) < 400) & (np.abs(hit[:, 1] - 100) < 400)
    np.testing.assert_array_equal(np.isfinite(found), inside)
    assert inside.sum() > 2000
    np.testing.assert_allclose(found[inside], expected[inside], atol=1e-9)  # 2^-53 x some 1e3 m x the steepest ratio s / z of 1e2
    reached = chart.cast(points, way, reach=60.0)
    np.testing.assert_array_equal(np.isfinite(reached), inside & (expected <= 60.0))


@pytest.mark.parametrize("seed", range(4))
def test_rays_meet_a_rough_bed_first_where_brute_force_does(seed):
    generator = np.random.default_rng(seed)
    chart = oblong(seed + 10, sigma=(2.0, 4.0, 8.0, 8.0)[seed])
    surface = witness(chart)
    south, north, west, east = chart.extent
    points = np.stack([generator.uniform(south, north, 400), generator.uniform(west, east, 400), np.zeros(400)], axis=1)
    points[:, 2] = surface(points[:, :2]) - generator.exponential(5.0, 400)
    way = units(generator, 400)
    found = chart.cast(points, way)
    hits = np.flatnonzero(np.isfinite(found))
    assert len(hits) > 150
    at = points[hits] + found[hits, None] * way[hits]
    np.testing.assert_allclose(at[:, 2], surface(np.clip(at[:, :2], (south, west), (north, east))), atol=1e-9)
    for k in range(400):
        s = np.arange(0.0, found[k] if np.isfinite(found[k]) else 200.0, 0.01)
        line = points[k] + s[:, None] * way[k]
        below = line[:, 2] - surface(line[:, :2])  # nan where it has left the chart
        left = np.flatnonzero(np.isnan(below))
        assert np.isfinite(found[k]) <= (len(left) == 0)
        assert not np.any(below[: left[0] if len(left) else None] > 1e-9)


def test_rays_along_borders_and_through_nodes():
    """Where a ray lies in the border of cells, or passes from corner to corner, either cell gives the same bed."""
    chart = fractal(EXTENT, 1.0, 30.0, beta=3.0, sigma=3.0, seed=5)
    surface = witness(chart)
    diagonal = np.array([1.0, 1.0, 1.0]) / np.sqrt(3)
    ways = [(1, 0, 1), (-1, 0, 1), (0, 1, 1), (0, -1, 1), (1, 1, 2), (-1, -1, 2), (1, -1, 2), (0, 0, 1), diagonal]
    for n, e in [(0.0, 0.0), (16.0, 32.0), (-12.0, 14.0), (3.5, 4.0), (60.0, 70.0), (-60.0, -50.0)]:
        way = np.array([np.asarray(w) / np.linalg.norm(w) for w in ways])
        point = np.array([n, e, 5.0])
        found = chart.cast(point, way)
        assert np.isfinite(found[-2])
        for s, w in zip(found, way, strict=True):
            if np.isfinite(s):
                at = point + s * w
                assert at[2] == pytest.approx(float(surface(np.clip(at[:2], (-60, -50), (60, 70)))[0]), abs=1e-9)
            else:
                assert not -60 <= n + 100 * w[0] <= 60 or not -50 <= e + 100 * w[1] <= 70
    assert np.isfinite(chart.cast([0.0, 0.0, 5.0], [[1e-200, 1e-13, 1.0]])).all()


def test_level_and_rising_rays_meet_a_wall_and_nothing_above_it():
    depth = np.full((100, 100), 50.0)
    depth[60:] = 10.0  # from 50 to 10 m between north 59 and 60
    chart = Chart(0.0, 0.0, 1.0, 1.0, depth)
    point, rise = [5.5, 50.0, 40.0], np.array([0.9, 0.0, -np.sqrt(0.19)])
    assert chart.cast(point, [[1.0, 0.0, 0.0]])[0] == pytest.approx(59.25 - 5.5, abs=1e-12)
    meet = (59 * 40 - 5.5 * 40 - 10) / (0.9 * 40 + rise[2])  # 50 - 40 (n - 59) = d along n = 5.5 + 0.9 s, d = 40 + rise s
    assert meet > 0
    assert np.isnan(chart.cast(point, [[0.5, 0.0, -np.sqrt(0.75)], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])).all()
    shallow = chart.cast([50.0, 50.0, 40.0], rise[None])[0]
    assert shallow == pytest.approx((50 + 40 * 59 - 40 - 40 * 50) / (0.9 * 40 + rise[2]), abs=1e-12)


def test_where_a_ray_finds_nothing():
    chart = plane(20.0, 0.0, 0.0, (0.0, 40.0, 0.0, 40.0), 1.0)
    depth = chart.depth.copy()
    depth[20, 20], depth[0, 0] = np.nan, 12.0
    hole = Chart(0.0, 0.0, 1.0, 1.0, depth)
    down, slant = [0.0, 0.0, 1.0], np.array([0.6, 0.0, 0.8])
    below, on, beside = hole.cast([[30.0, 30.0, 20.1], [30.0, 30.0, 20.0], [20.5, 19.5, 5.0]], down)
    assert np.isnan(below)
    assert on == 0.0
    assert np.isnan(beside)
    over = hole.cast([[20.0 - 0.75 * rise, 20.2, 5.0] for rise in (3.0, 14.0)], slant)  # over the hole at 8 m, above 12 m, and at 19 m
    assert over[0] == pytest.approx(15.0 / 0.8, abs=1e-12)
    assert np.isnan(over[1])
    outside = hole.cast([[-5.0, 30.0, 2.0], [-5.0, 30.0, 13.0], [45.0, 30.0, 2.0], [np.nan, 30.0, 2.0]], slant)
    assert outside[0] == pytest.approx(18.0 / 0.8, abs=1e-12)  # comes in above 12 m
    assert np.isnan(outside[1:]).all()
    assert np.isnan(hole.cast([[5.0, 5.0, 2.0]], [np.nan, 0.0, 1.0]))
    corner = hole.cast([[17.0, 19.0, 13.0]], np.array([1.0, 1.0, 0.5]) / 1.5)  # from corner to corner, one of them of an unknown cell
    assert corner[0] == pytest.approx(21.0, abs=1e-12)


def test_one_shallow_node_far_away_changes_no_ray():
    """Blocks are an index, not a surface: what they hold changes the way to the answer alone."""
    chart, generator = fractal(EXTENT, 1.0, 40.0, beta=3.0, sigma=3.0, seed=6), np.random.default_rng(7)
    depth = chart.depth.copy()
    depth[-1, -1] = 1.0
    points = np.stack([generator.uniform(-40, 0, 500), generator.uniform(-30, 10, 500), generator.uniform(2, 25, 500)], axis=1)
    way = units(generator, 500, upward=0.0)
    near = np.all(np.abs((points + chart.cast(points, way)[:, None] * way)[:, :2] - (0, 10)) < 58, axis=1)
    assert near.sum() > 200
    changed = Chart(chart.north, chart.east, 1.0, 1.0, depth).cast(points, way)
    np.testing.assert_allclose(changed[near], chart.cast(points, way)[near], atol=1e-12)


def test_the_first_root_is_that_of_numpy():
    generator = np.random.default_rng(8)
    for _ in range(2000):
        c0, c1, c2, t = (
            -generator.exponential(),
            generator.normal(),
            generator.normal() * generator.choice([1.0, 1e-9, 0.0]),
            generator.exponential(2.0),
        )
        roots = np.roots([c2, c1, c0]) if c2 else np.array([-c0 / c1])
        real = np.sort(roots[np.abs(roots.imag) < 1e-12].real)
        expected = [r for r in real if 0.0 <= r <= t]
        found = first_root(c0, c1, c2, t)
        if expected:
            assert found == pytest.approx(expected[0], rel=1e-6)  # numpy.roots loses half its digits near a double root
        else:
            assert found == NOTHING


def test_a_fan_is_the_rays_that_it_is_made_of():
    chart, generator = fractal(EXTENT, 1.0, 40.0, sigma=3.0, seed=9), np.random.default_rng(10)
    points = np.stack([generator.uniform(-20, 20, 7), generator.uniform(-20, 20, 7), np.full(7, 10.0)], axis=1)
    turns = np.linalg.qr(generator.standard_normal((7, 3, 3)))[0]
    beams = units(generator, 9)
    expected = [chart.cast(p, beams @ turn.T, reach=50.0) for p, turn in zip(points, turns, strict=True)]
    np.testing.assert_allclose(chart.cast_fans(points, turns, beams, reach=50.0), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"depth": np.zeros((1, 5))}, "shape"),
        ({"depth": np.zeros(5)}, "shape"),
        ({"step_north": 0.0}, "steps"),
        ({"step_east": np.nan}, "steps"),
        ({"north": np.inf}, "steps"),
        ({"depth": np.full((3, 3), np.nan)}, "knows no depth"),
        ({"depth": np.full((3, 3), np.inf)}, "infinite"),
    ],
)
def test_a_chart_that_is_none_is_refused(change, words):
    good = {"north": 0.0, "east": 0.0, "step_north": 1.0, "step_east": 1.0, "depth": np.zeros((3, 3))}
    Chart(**good)
    with pytest.raises(InputError, match=words) as caught:
        Chart(**good | change)
    assert "\n" not in str(caught.value)


def test_a_chart_keeps_its_depths_to_itself():
    depth = np.arange(12.0).reshape(3, 4)
    chart = Chart(0.0, 0.0, 1.0, 1.0, depth)
    depth[:] = 7.0
    assert chart.depth[2, 3] == 11.0
    with pytest.raises(ValueError, match="read-only"):
        chart.depth[0, 0] = 1.0
    with pytest.raises(InputError, match="extent"):
        plane(1.0, 0.0, 0.0, (0.0, -1.0, 0.0, 1.0), 1.0)
    assert plane(1.0, 0.0, 0.0, (0.0, 10.0, -3.0, 1.5), 0.7).depth.shape == (16, 8)
    for wrong in (chart.cast, chart.cast_fans):
        with pytest.raises(InputError, match="give"):
            wrong(np.zeros((4, 2)), *(np.zeros((4, 2)),) * (1 + (wrong == chart.cast_fans)))


@pytest.mark.parametrize("beta", [2.2, 3.0, 4.0])
def test_a_random_bed_has_the_spectrum_that_was_asked_for(beta):
    """Radially averaged periodogram: the slope of its logarithm on log k is -beta; of periodic noise it leaks nothing."""
    step = 2.0
    chart = fractal((0.0, 2.0 * 383, 0.0, 2.0 * 511), step, 100.0, beta=beta, sigma=5.0, seed=11)
    assert chart.depth.shape == (384, 512)
    assert np.std(chart.depth) == pytest.approx(5.0, rel=1e-12)
    assert np.mean(chart.depth) == pytest.approx(100.0, abs=1e-9)
    power = np.abs(np.fft.fft2(chart.depth - 100.0)) ** 2
    k = 2 * np.pi * np.hypot(*np.meshgrid(np.fft.fftfreq(384, step), np.fft.fftfreq(512, step), indexing="ij"))
    edges = np.geomspace(k[0, 4], 2 * np.pi / (2 * step), 25)
    ring = np.digitize(k, edges)
    count = np.array([np.sum(ring == r) for r in range(1, 25)])
    level = np.array([np.mean((power * k**beta)[ring == r]) for r in range(1, 25)])  # flat, if the exponent is right
    centre = np.log(np.sqrt(edges[1:] * edges[:-1]))
    weight = count / 2  # half of the waves are conjugates of the others; each is exponential: var(log mean) = 1 / number
    middle = np.average(centre, weights=weight)
    slope = np.sum(weight * (centre - middle) * np.log(level)) / np.sum(weight * (centre - middle) ** 2)
    assert abs(slope) < 4.0 / np.sqrt(np.sum(weight * (centre - middle) ** 2))


def test_a_random_bed_is_as_steep_as_was_asked_and_level_at_long_waves():
    chart = fractal((0.0, 400.0, 0.0, 300.0), 1.0, 50.0, beta=3.2, rms_slope=0.08, seed=12)
    north, east = np.diff(chart.depth, axis=0), np.diff(chart.depth, axis=1)
    assert np.sqrt(np.mean(north**2) + np.mean(east**2)) == pytest.approx(0.08, rel=1e-12)
    again = fractal((0.0, 400.0, 0.0, 300.0), 1.0, 50.0, beta=3.2, rms_slope=0.08, seed=12)
    np.testing.assert_array_equal(chart.depth, again.depth)
    assert not np.allclose(chart.depth, fractal((0.0, 400.0, 0.0, 300.0), 1.0, 50.0, beta=3.2, rms_slope=0.08, seed=13).depth)
    short = fractal((0.0, 1023.0, 0.0, 1023.0), 1.0, 50.0, beta=4.0, sigma=1.0, longest=30.0, seed=14).depth - 50.0
    power = np.abs(np.fft.fft2(short)) ** 2
    k = 2 * np.pi * np.hypot(*np.meshgrid(np.fft.fftfreq(1024), np.fft.fftfreq(1024), indexing="ij"))
    corner = 2 * np.pi / 30.0
    low, at = power[(k > 0) & (k < 0.2 * corner)], power[np.abs(k / corner - 1) < 0.02]
    # (k^2 + c^2)^-2: four times less at the corner than far below it, where its mean over the disk is 0.925 of the limit
    few = 4.0 * np.sqrt(2 / len(low) + 2 / len(at))
    assert np.log(np.mean(low) / np.mean(at)) == pytest.approx(np.log(4 / (1 + 0.04)), abs=few + 0.04)


@pytest.mark.parametrize(
    "sizes", [{}, {"sigma": 1.0, "rms_slope": 0.1}, {"sigma": -1.0}, {"sigma": np.nan}, {"sigma": 1.0, "longest": 0.0}]
)
def test_a_random_bed_of_no_size_is_refused(sizes):
    with pytest.raises(InputError, match="fractal"):
        fractal(EXTENT, 1.0, 10.0, **sizes)


# Files.


def holed() -> Chart:
    depth = fractal((0.0, 20.0, 0.0, 30.0), 1.0, 15.0, sigma=2.0, seed=15).depth.copy()
    depth[3, 4:9] = np.nan
    return Chart(-12.5, 100.25, 1.0, 1.0, depth)


def same(found: Chart, expected: Chart, tolerance: float) -> None:
    assert found.depth.shape == expected.depth.shape
    np.testing.assert_allclose([*found.extent], [*expected.extent], atol=1e-9)
    np.testing.assert_allclose(found.depth, expected.depth, atol=tolerance)


@pytest.mark.parametrize("steps", [(1.0, 1.0), (0.1, 2.5)])
def test_a_chart_comes_back_from_its_file(tmp_path, steps):
    chart = Chart(-12.5, 100.25, *steps, holed().depth)
    write_chart(chart, tmp_path / "bed.asc")
    same(read_chart(tmp_path / "bed.asc"), chart, 5e-7)
    moved = read_chart(tmp_path / "bed.asc", (-2.5, 100.0), positive="up")
    assert (moved.north, moved.east) == pytest.approx((-10.0, 0.25), abs=1e-12)
    np.testing.assert_allclose(moved.depth, -chart.depth, atol=5e-7)
    assert [p.name for p in tmp_path.iterdir()] == ["bed.asc"]


def test_a_grid_counts_its_corner_at_the_edge_of_a_cell_and_its_rows_from_the_north(tmp_path):
    file = tmp_path / "a.asc"
    file.write_text("NCOLS 3\nNROWS 2\nXLLCORNER 100\nYLLCORNER 200\nCELLSIZE 10\nNODATA_VALUE -32768\n1 2\n3 4 5\n-32768\n")
    chart = read_chart(file)
    assert (chart.north, chart.east, chart.step_north) == (205.0, 105.0, 10.0)
    np.testing.assert_array_equal(chart.depth, [[4.0, 5.0, np.nan], [1.0, 2.0, 3.0]])


@pytest.mark.parametrize(
    ("name", "head", "order", "mark"),
    [
        ("a.xyz", "", (0, 1, 2), " "),
        ("a.txt", "# a survey\n", (0, 1, 2), ", "),
        ("a.csv", "easting,northing,depth\n", (1, 0, 2), ","),
        ("a.csv", "depth_m;north_m;east_m\n", (2, 0, 1), ";"),
        ("a.txt", "x\ty\tz\n", (1, 0, 2), "\t"),
    ],
)
def test_points_make_a_grid_in_any_order(tmp_path, name, head, order, mark):
    chart = holed()
    n, e = np.meshgrid(chart.north + np.arange(21.0), chart.east + np.arange(31.0), indexing="ij")
    table = np.stack([n.ravel(), e.ravel(), chart.depth.ravel()], axis=1)[np.isfinite(chart.depth.ravel())]
    table = np.random.default_rng(16).permutation(table)[:, order]
    (tmp_path / name).write_text(head + "".join(mark.join(f"{v:.6f}" for v in row) + "\n" for row in table) + "\n# end\n")
    same(read_chart(tmp_path / name), chart, 5e-7)


def test_a_grid_in_degrees_lies_where_the_ellipsoid_has_it(tmp_path):
    """Depths linear in latitude and longitude are so between the nodes as well: exact at any node of the chart."""
    lat, lon = 41.18 + 0.0005 * np.arange(41), -8.72 + 0.0005 * np.arange(61)
    depth = 30.0 + 400.0 * (lat - 41.18)[:, None] + 250.0 * (lon + 8.72)
    rows = "\n".join(" ".join(f"{v:.9f}" for v in row) for row in depth[::-1])
    (tmp_path / "d.asc").write_text(f"ncols 61\nnrows 41\nxllcenter -8.72\nyllcenter 41.18\ncellsize 0.0005\n{rows}\n")
    points = "\n".join(f"{x:.6f} {y:.6f} {depth[i, j]:.9f}" for i, y in enumerate(lat) for j, x in enumerate(lon))
    (tmp_path / "d.xyz").write_text(points)
    named = "".join(f"{y:.6f},{x:.6f},{-depth[i, j]:.9f}\n" for i, y in enumerate(lat) for j, x in enumerate(lon))
    (tmp_path / "h.csv").write_text("lat,lon,height\n" + named)
    origin = np.radians([41.19, -8.71])
    geod = Geod(ellps="WGS84")
    for name, positive in (("d.asc", "down"), ("d.xyz", "down"), ("h.csv", "up")):
        chart = read_chart(tmp_path / name, tuple(origin), positive=positive)
        i, j = (a.ravel() for a in np.meshgrid(np.arange(chart.depth.shape[0]), np.arange(chart.depth.shape[1]), indexing="ij"))
        north, east = chart.north + chart.step_north * i, chart.east + chart.step_east * j
        _, there, _ = geod.fwd(np.full(len(i), -8.71), np.full(len(i), 41.19), np.zeros(len(i)), north)
        radius = geod.a * np.cos(np.radians(there)) / np.sqrt(1 - geod.es * np.sin(np.radians(there)) ** 2)
        across = -8.71 + np.degrees(east / radius)
        expected = 30.0 + 400.0 * (there - 41.18) + 250.0 * (across + 8.72)
        found = chart.depth[i, j]
        seen = np.isfinite(found)
        inside = (there > 41.18) & (there < 41.2) & (across > -8.72 + 1e-9) & (across < -8.69 - 1e-9)
        assert seen[inside].all()
        assert seen.mean() > 0.95
        np.testing.assert_allclose(found[seen], expected[seen], atol=1e-6)  # rounding of the file; of a metre along a parallel 3e-9
    with pytest.raises(InputError, match="give the origin"):
        read_chart(tmp_path / "d.asc")
    assert read_chart(tmp_path / "d.asc", geographic=False).step_north == 0.0005


GOOD = "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n"


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.asc", GOOD + "1 2\n3\n", "has 3 values; nrows 2 x ncols 2 is 4"),
        ("a.asc", GOOD + "1 2\n3 4,5\n", r"a\.asc:7: '4,5' is no number"),
        ("a.asc", GOOD, "has 0 values"),
        ("a.asc", GOOD + "-9999 -9999 -9999 -9999", "knows no depth"),
        ("a.asc", GOOD.replace("nrows 2\n", "") + "1 2 3 4", "has no nrows"),
        ("a.asc", GOOD.replace("nrows 2", "nrows 2.5") + "1 2 3 4", "nrows is 2.5"),
        ("a.asc", GOOD.replace("nrows 2", "nrows two") + "1 2 3 4", r"a\.asc:2: 'nrows two'"),
        ("a.asc", GOOD.replace("cellsize 1", "cellsize 0") + "1 2 3 4", "cellsize is 0"),
        ("a.asc", b"\xff\xfe\x00\x01", "cannot be read as text"),
        ("a.xyz", "# nothing\n", "holds no points"),
        ("a.xyz", "x y z\n", "holds no points"),
        ("a.xyz", "0 0 5\n0 1 5\n1 0 x\n", r"a\.xyz:3: 'x' is no number"),
        ("a.xyz", "0 0 5\n\n0 1\n1 0 5\n", r"a\.xyz:3: has 2 columns"),
        ("a.xyz", "0 0\n0 1\n1 0\n1 1\n", "has 2 columns"),
        ("a.xyz", "0 0 5\n0 1 5\n1 0 5\n1.4 1 5\n", r"a\.xyz:3: north 1 lies between"),
        ("a.xyz", "0 0 5\n0 1 5\n", "all its points have one north"),
        ("a.xyz", "0 0 5\n0 1 5\n1 0 5\n1 1 5\n1 0 6\n", r"a\.xyz:\d: a second depth"),
        ("a.xyz", "0 0 5\n0 1 5\n1 nan 5\n1 1 5\n", r"a\.xyz:3: east is no finite number"),
        ("a.csv", "lat,lon,height\n0,0,5\n", "positive='up'"),
        ("a.csv", "a,b,c\n0,0,5\n", "has the columns a, b, c"),
        ("a.csv", "x,y,z\n" + "\n".join(f"{k},{k},1" for k in range(21)) + "\n1e8,0,1\n", "make a grid"),
        ("a.png", "", "has the suffix '.png'"),
        ("b.asc", None, "is not there"),
    ],
)
def test_a_file_that_holds_no_chart_is_refused_in_one_line(tmp_path, name, text, words):
    if text is not None:
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError, match=words) as caught:
        read_chart(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert name in str(caught.value)


def test_a_geotiff_needs_rasterio(tmp_path):
    chart, file = holed(), tmp_path / "a.tif"
    try:
        import rasterio
        from rasterio.transform import from_origin
    except ImportError:
        file.write_bytes(b"II*\0")
        with pytest.raises(InputError, match="pip install rasterio"):
            read_chart(file)
        return
    place = from_origin(chart.east - 0.5, chart.extent[1] + 0.5, 1.0, 1.0)
    grid = np.where(np.isnan(chart.depth), -1e5, chart.depth)[::-1]
    with rasterio.open(
        file, "w", driver="GTiff", height=21, width=31, count=1, dtype="float64", crs="EPSG:32629", transform=place, nodata=-1e5
    ) as out:
        out.write(grid, 1)
    same(read_chart(file), chart, 1e-12)
    Path(file).write_bytes(b"no picture")
    with pytest.raises(InputError, match="cannot be read as GeoTIFF"):
        read_chart(file)
