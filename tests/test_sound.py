"""Sound in layers against witnesses: closed forms, shooting of rays by an ODE solver, Fermat's principle, textbook sums and brentq."""

from __future__ import annotations

from itertools import pairwise

import gsw
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize

from leadline.data.errors import InputError
from leadline.data.records import SoundSpeedProfile
from leadline.sea.sound import SoundProfile

SUMMER_DEPTH = np.array([0.0, 10.0, 20.0, 35.0, 50.0, 80.0, 120.0, 200.0, 400.0, 700.0, 1000.0])
SUMMER_SPEED = np.array([1520.0, 1521.0, 1519.0, 1510.0, 1506.0, 1504.0, 1503.0, 1501.0, 1502.0, 1506.0, 1511.0])
SUMMER = SoundProfile(SUMMER_DEPTH, SUMMER_SPEED)
EPS = np.finfo(float).eps


def time_of(profile: SoundProfile, x: float, a: float, b: float) -> float:
    return float(profile.travel_time(x, a, b).time)


# Straight lines and circles


def test_in_uniform_water_rays_are_straight() -> None:
    rng = np.random.default_rng(1)
    x = np.concatenate([rng.uniform(0.0, 1e4, 300), [0.0, 0.0, 1e4, 1e-3, 5e3, 0.0]])
    a = np.concatenate([rng.uniform(-5.0, 6000.0, 300), [0.0, 10.0, 20.0, 20.0, 20.0, 7.0]])
    b = np.concatenate([rng.uniform(-5.0, 6000.0, 300), [50.0, 10.0, 20.0, 20.001, 20.0 + 1e-9, 7.0]])
    chord = np.hypot(x, b - a)
    for profile in (SoundProfile.uniform(1500.0), SoundProfile([0.0, 30.0, 3000.0], [1500.0] * 3)):
        rays = profile.travel_time(x, a, b)
        assert_allclose(rays.time, chord / 1500.0, rtol=20 * EPS)
        assert_allclose(rays.length, chord, rtol=20 * EPS)
        assert_allclose(rays.angle_a, np.arctan2(b - a, x), atol=20 * EPS)
        assert_array_equal(rays.angle_a, rays.angle_b)


@pytest.mark.parametrize("gradient", [0.017, -0.017, 0.4, -0.4, 1e-6, -1e-9, 1e-12])
def test_in_one_gradient_rays_are_circles(gradient: float) -> None:
    """Time: 2/g asinh(g chord / (2 sqrt(c1 c2))); the circle's centre lies where the speed would be 0."""
    rng = np.random.default_rng(2)
    x, a, b = rng.uniform(0.0, 3000.0, 600), rng.uniform(0.0, 500.0, 600), rng.uniform(0.0, 500.0, 600)
    b[::3] = a[::3]
    ends = np.array([-3000.0, 1500.0])  # no ray goes further up or down
    slope = gradient / np.hypot(1.0, 500.0 * gradient)
    profile = SoundProfile(ends, 1500.0 + slope * ends)
    c1, c2 = 1500.0 + slope * a, 1500.0 + slope * b
    chord = np.hypot(x, b - a)
    rays = profile.travel_time(x, a, b)
    assert_allclose(rays.time, 2.0 / slope * np.arcsinh(slope * chord / (2.0 * np.sqrt(c1 * c2))), rtol=1e-13)
    # rays of one circle: its radius and its centre are the same from both ends, and its arc is as long as it says
    assert_allclose(np.cos(rays.angle_a) / c1, np.cos(rays.angle_b) / c2, rtol=1e-11)
    assert_allclose(rays.angle_a - rays.angle_b, rays.length * slope * np.cos(rays.angle_a) / c1, atol=1e-12)
    across = rays.angle_a - 0.5 * (rays.angle_a - rays.angle_b)  # the chord's elevation is the mean of both ends'
    assert_allclose(across, np.arctan2(b - a, x), atol=1e-11)


# Many layers


def shot(profile: SoundProfile, x: float, start: float, angle: float) -> np.ndarray:
    """Depth, elevation, time, length at horizontal distance x of a ray that leaves downward at an angle: Snell's law as an ODE in x."""
    depth, speed = profile.depth, profile.speed

    def law(_: float, state: np.ndarray) -> list[float]:
        z, theta, _, _ = state
        c = np.interp(z, depth, speed)
        k = int(np.clip(np.searchsorted(depth, z, side="right") - 1, 0, len(depth) - 2))
        g = (speed[k + 1] - speed[k]) / (depth[k + 1] - depth[k]) if depth[0] <= z < depth[-1] else 0.0
        return [np.tan(theta), -g / c, 1.0 / (c * np.cos(theta)), 1.0 / np.cos(theta)]

    return solve_ivp(law, (0.0, x), [start, angle, 0.0, 0.0], rtol=1e-10, atol=1e-12, max_step=x / 300).y[:, -1]


@pytest.mark.parametrize(
    ("x", "a", "b"),
    [(800.0, 5.0, 150.0), (400.0, 20.0, 300.0), (1500.0, 250.0, 250.0), (2500.0, 150.0, 260.0), (600.0, 35.0, 120.0), (60.0, 2.0, 190.0)],
)
def test_many_layers_against_shooting(x: float, a: float, b: float) -> None:
    rays = SUMMER.travel_time(x, a, b)
    depth, angle, time, length = shot(SUMMER, x, a, float(rays.angle_a))
    assert depth == pytest.approx(b, abs=1e-6 * x)  # error of the integration at the corners of the profile
    assert angle == pytest.approx(float(rays.angle_b), abs=1e-6)
    assert time + (b - depth) * np.sin(angle) / np.interp(b, SUMMER_DEPTH, SUMMER_SPEED) == pytest.approx(float(rays.time), abs=1e-9)
    assert length + (b - depth) * np.sin(angle) == pytest.approx(float(rays.length), abs=1e-6)


def test_nearly_vertical_rays() -> None:
    """Straight down the time is the integral of 1 / c; aside it grows by x^2 / (2 integral of c)."""
    c1, c2, h = SUMMER_SPEED[:-1], SUMMER_SPEED[1:], np.diff(SUMMER_DEPTH)
    down = np.sum(h * np.log(c2 / c1) / (c2 - c1))
    along = np.sum(0.5 * (c1 + c2) * h)
    assert time_of(SUMMER, 0.0, 0.0, 1000.0) == pytest.approx(down, rel=1e-14)
    rays = SUMMER.travel_time([1e-6, 1e-2, 1.0], 0.0, 1000.0)
    assert_allclose(rays.time - down, np.array([1e-6, 1e-2, 1.0]) ** 2 / (2 * along), rtol=2e-6, atol=1e-14)
    assert_allclose(0.5 * np.pi - rays.angle_a, SUMMER_SPEED[0] * np.array([1e-6, 1e-2, 1.0]) / along, rtol=1e-6, atol=1e-15)


def test_the_time_is_the_least_of_neighbouring_paths() -> None:
    """Fermat: the horizontal distances at which a path of straight lines crosses 160 levels, chosen for the least time."""
    x, a, b, count = 700.0, 12.0, 180.0, 160
    level = np.linspace(a, b, count + 1)
    slowness = np.array([np.mean(1.0 / SUMMER.speed_at(np.linspace(p, q, 401))) for p, q in pairwise(level)])
    step = np.diff(level)

    def gaps(inside: np.ndarray) -> np.ndarray:
        return np.diff(np.concatenate([[0.0], inside, [x]]))

    def total(inside: np.ndarray) -> float:
        return float(slowness @ np.hypot(gaps(inside), step))

    def slope(inside: np.ndarray) -> np.ndarray:
        pull = slowness * gaps(inside) / np.hypot(gaps(inside), step)
        return pull[:-1] - pull[1:]

    def curvature(inside: np.ndarray) -> np.ndarray:
        stiff = slowness * step**2 / np.hypot(gaps(inside), step) ** 3
        return np.diag(stiff[:-1] + stiff[1:]) - np.diag(stiff[1:-1], 1) - np.diag(stiff[1:-1], -1)

    start = np.linspace(0.0, x, count + 1)[1:-1]
    best = minimize(total, start, jac=slope, hess=curvature, method="trust-exact", options={"gtol": 1e-12, "maxiter": 2000})
    assert np.max(np.abs(slope(best.x))) < 1e-9
    # a line across a level in place of an arc costs (change of direction)^2 / 24 at most: 0.63/s of gradient over 4.4 m of path
    assert time_of(SUMMER, x, a, b) == pytest.approx(best.fun, rel=(0.63 * 4.4 / 1500) ** 2 / 24)
    assert time_of(SUMMER, x, a, b) < best.fun


def sums(profile: SoundProfile, p: float, top: float, bottom: float) -> tuple[float, float]:
    """Distance and time between two depths by the textbook forms with their differences."""
    z = np.concatenate([[top], profile.depth[(profile.depth > top) & (profile.depth < bottom)], [bottom]])
    c = profile.speed_at(z)
    x = t = 0.0
    for h, c1, c2 in zip(np.diff(z), c[:-1], c[1:], strict=True):
        s1, s2 = (np.sqrt(max(1.0 - (p * v) ** 2, 0.0)) for v in (c1, c2))
        if abs(c2 - c1) < 1e-9:
            s1 = max(s1, 1e-150)
            x, t = x + h * p * c1 / s1, t + h / (c1 * s1)
        else:
            x, t = x + (s1 - s2) * h / (p * (c2 - c1)), t + np.log(c2 * (1 + s1) / (c1 * (1 + s2))) * h / (c2 - c1)
    return x, t


def turning_depth(profile: SoundProfile, speed: float, start: float, sign: int) -> float | None:
    """Depth at which the speed is first reached below (sign 1) or above (-1) a depth; None where it is not."""
    beyond = profile.depth[profile.depth > start] if sign > 0 else profile.depth[profile.depth < start][::-1]
    near = start
    for far in beyond:
        c1, c2 = profile.speed_at([near, far])
        if c1 <= speed < c2:
            return float(near + (far - near) * (speed - c1) / (c2 - c1))
        if c1 > speed:
            return None
        near = far
    return None


def family(profile: SoundProfile, kind: int, speed: float, a: float, b: float) -> tuple[float, float]:
    """Distance and time of the ray that is level where sound has that speed: without a turn (0), with one below (1) or above (-1)."""
    upper, lower = min(a, b), max(a, b)
    between = profile.speed_at(np.append(profile.depth[(profile.depth > upper) & (profile.depth < lower)], [a, b]))
    if np.max(between) >= speed:
        return np.nan, np.nan
    x, t = sums(profile, 1.0 / speed, upper, lower) if lower > upper else (0.0, 0.0)
    if kind:
        end = lower if kind > 0 else upper
        turn = turning_depth(profile, speed, end, kind)
        if turn is None:
            return np.nan, np.nan
        more = sums(profile, 1.0 / speed, *sorted((end, turn)))
        x, t = x + 2 * more[0], t + 2 * more[1]
    return x, t


def by_brute_force(profile: SoundProfile, x: float, a: float, b: float) -> float:
    """The least time over all rays of all families, searched on a fine grid."""
    level = float(np.max(profile.speed_at([a, b])))
    corners = [s + np.geomspace(1e-9, 1.0, 30) for s in np.append(profile.speed, profile.speed_at([a, b])) if s >= level]
    grid = np.concatenate([*corners, np.linspace(level, np.max(profile.speed), 300), level * np.geomspace(1.0001, 1e4, 200)])
    speeds, found = np.unique(grid), [np.inf]
    for kind in (0, 1, -1):
        miss = np.array([family(profile, kind, c, a, b)[0] - x for c in speeds])
        for k in np.flatnonzero(np.sign(miss[:-1]) * np.sign(miss[1:]) < 0):
            best = brentq(lambda c, kind=kind: family(profile, kind, c, a, b)[0] - x, speeds[k], speeds[k + 1], xtol=1e-12, rtol=4 * EPS)
            reached, time = family(profile, kind, best, a, b)
            if abs(reached - x) < 1.0:  # a jump is no root
                found.append(time + (x - reached) / best)
    return min(found)


def test_the_fastest_of_several_rays_is_found_and_shadows_are_silent() -> None:
    rng = np.random.default_rng(7)
    shadows = turns = 0
    for case in range(60):
        depth = np.unique(np.round(rng.uniform(0.0, 300.0, rng.integers(2, 8)), 1))
        if len(depth) < 2:
            continue
        profile = SoundProfile(depth, np.round(1500.0 + rng.uniform(-15.0, 15.0, len(depth)), 2))
        a, b = rng.uniform(depth[0] + 0.1, depth[-1] - 0.1, 2)
        if case % 4 == 0:
            a = b
        elif case % 4 == 1:
            a = float(depth[rng.integers(len(depth))])
        x = float(rng.uniform(10.0, 3000.0))
        rays, expected = profile.travel_time(x, a, b), by_brute_force(profile, x, a, b)
        if np.isinf(expected):
            assert np.isnan(rays.time), (case, x, a, b)
            shadows += 1
        else:
            assert float(rays.time) == pytest.approx(expected, abs=1e-9), (case, x, a, b)
            turns += rays.angle_a * rays.angle_b < 0
    assert shadows >= 3
    assert turns >= 10


def test_rays_are_the_same_both_ways() -> None:
    rng = np.random.default_rng(3)
    x, a, b = rng.uniform(0.0, 3000.0, 2000), rng.uniform(0.0, 400.0, 2000), rng.uniform(0.0, 400.0, 2000)
    there, back = SUMMER.travel_time(x, a, b), SUMMER.travel_time(x, b, a)
    assert_array_equal(there.time, back.time)
    assert_array_equal(there.angle_a, -back.angle_b)
    # Snell's law from end to end
    known = np.isfinite(there.time)
    assert np.mean(known) > 0.8
    p = np.cos(there.angle_a) / SUMMER.speed_at(a), np.cos(there.angle_b) / SUMMER.speed_at(b)
    assert_allclose(p[0][known], p[1][known], rtol=1e-12)


def test_times_are_continuous_across_the_boundary_of_a_layer_and_the_first_turn() -> None:
    for x, a, b in ((500.0, 5.0, 120.0), (1000.0, 200.0, 400.0), (800.0, 50.0, 50.0)):
        times = [time_of(SUMMER, x, a, b + shift) for shift in (-1e-7, 0.0, 1e-7)]
        assert_allclose(times, times[1], atol=1e-10)  # 1e-7 m are 7e-11 s
    deep = SoundProfile([0.0, 1000.0], [1490.0, 1507.0])
    edge = brentq(lambda x: float(deep.travel_time(x, 100.0, 101.0).angle_b) - 1e-9, 10.0, 2000.0)
    assert time_of(deep, edge * (1 + 1e-9), 100.0, 101.0) - time_of(deep, edge, 100.0, 101.0) == pytest.approx(
        1e-9 * edge / 1491.0, abs=1e-12
    )


def test_level_water_and_no_water() -> None:
    layered = SoundProfile([0.0, 50.0, 100.0], [1500.0, 1500.0, 1490.0])
    assert time_of(layered, 900.0, 50.0, 50.0) == pytest.approx(0.6, abs=1e-15)  # along the lower face of the level layer
    assert np.isnan(time_of(layered, 5000.0, 60.0, 60.0))  # rays bend down, and nothing turns them
    assert_array_equal(np.isnan(layered.travel_time([np.nan, -1.0, np.inf], 10.0, 20.0).time), True)
    assert layered.travel_time(np.zeros((2, 3)), 0.0, np.ones(3)).time.shape == (2, 3)


# Where profiles come from


def test_profiles_of_tables_and_casts() -> None:
    table = SoundSpeedProfile(
        time=[3.0, 1.0, 2.0, 4.0, 5.0], depth=[20.0, 0.0, 10.0, 10.0, 15.0], sound_speed=[1490.0, 1500.0, 1494.0, 1496.0, np.nan]
    )
    profile = SoundProfile.from_table(table)
    assert_array_equal(profile.depth, [0.0, 10.0, 20.0])
    assert_allclose(profile.speed_at([-5.0, 5.0, 15.0, 99.0]), [1500.0, 1497.5, 1492.5, 1490.0])
    depth, temperature = np.array([0.0, 100.0, 2000.0]), np.array([20.0, 14.0, 4.0])
    cast = SoundProfile.from_ctd(depth, temperature, 36.0, 0.6)
    pressure = gsw.p_from_z(-depth, np.degrees(0.6))
    absolute = gsw.SA_from_SP(36.0, pressure, 0.0, np.degrees(0.6))
    expected = gsw.sound_speed_t_exact(absolute, temperature, pressure)
    assert_allclose(cast.speed, expected, atol=0.5)  # the two equations of state differ by some tenths


@pytest.mark.parametrize(
    ("depth", "speed", "message"),
    [([0.0, 0.0], [1500.0, 1490.0], "ascend"), ([0.0], [1.5], "1.5 m/s"), ([0.0, 1.0], [1500.0], "1 speeds"), ([], [], "0 depths")],
)
def test_what_is_no_profile_is_refused(depth: list[float], speed: list[float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        SoundProfile(depth, speed)
    with pytest.raises(InputError, match="no depth"):
        SoundProfile.from_table(SoundSpeedProfile(time=[0.0], sound_speed=[1500.0]))
