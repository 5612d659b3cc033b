"""Current, waves and tide: each against its definition, written anew here."""

from __future__ import annotations

import numpy as np
import pytest

from leadline.data.errors import InputError
from leadline.sea import flow
from leadline.sea.water import CALM, SERIES_STEP, Level, TidalCurrent, Wandering, Water, Waves

ZERO = np.zeros(1)


def velocity(water: Water, time: float = 0.0, north: float = 0.0, east: float = 0.0, depth: float = 0.0) -> np.ndarray:
    return water.velocity_n(*(np.array([v]) for v in (time, north, east, depth)))[0]


def test_a_calm_sea_stands_still() -> None:
    assert velocity(CALM, 12.0, 3.0, 4.0, 5.0) == pytest.approx(0.0, abs=0.0)
    assert flow.flow(1.0, 2.0, 3.0, 4.0, np.zeros(1)) == (0.0,) * 6
    assert flow.elevation(1.0, 2.0, 3.0, CALM.parameters) == 0.0


def test_a_sheared_current_is_straight_between_its_rows_and_constant_beyond() -> None:
    rows = ((2.0, 0.4, 0.0), (10.0, 0.2, 0.1), (30.0, -0.1, 0.3))
    water = Water(shear=rows)
    for depth in (0.0, 2.0, 5.0, 10.0, 17.0, 30.0, 99.0):
        right = [np.interp(depth, [r[0] for r in rows], [r[k] for r in rows]) for k in (1, 2)]
        assert velocity(water, depth=depth)[:2] == pytest.approx(right, abs=1e-15)
    assert velocity(Water(shear=((7.0, 0.3, -0.2),)), depth=50.0) == pytest.approx([0.3, -0.2, 0.0])


def test_depths_of_a_current_ascend() -> None:
    with pytest.raises(InputError, match="ascending"):
        Water(shear=((5.0, 0.0, 0.0), (5.0, 1.0, 0.0)))


def test_a_tide_runs_along_its_heading_at_its_crest_and_to_starboard_a_quarter_later() -> None:
    tide = TidalCurrent(major=0.5, heading=0.7, minor=0.2, period=40000.0, crest=3000.0)
    water = Water(tides=(tide,))
    assert velocity(water, 3000.0) == pytest.approx([0.5 * np.cos(0.7), 0.5 * np.sin(0.7), 0.0])
    assert velocity(water, 13000.0) == pytest.approx([0.2 * np.cos(0.7 + np.pi / 2), 0.2 * np.sin(0.7 + np.pi / 2), 0.0])
    assert velocity(water, 23000.0) == pytest.approx([-0.5 * np.cos(0.7), -0.5 * np.sin(0.7), 0.0])


def test_accelerations_are_the_slopes_of_velocities() -> None:
    water = Water(tides=(TidalCurrent(0.5, 0.3, 0.1, 600.0),), waves=Waves(1.5, 6.0, 1.0)).parameters
    h = 1e-3
    for time in (0.0, 5.3, 71.0):
        before, now, after = (flow.flow(t, 10.0, -4.0, 1.5, water) for t in (time - h, time, time + h))
        slope = (np.array(after[:3]) - np.array(before[:3])) / (2 * h)
        assert now[3:] == pytest.approx(slope, abs=1e-5)  # h^2 / 6 w^3 a w = 1e-6


def test_water_at_the_surface_rises_with_the_waves() -> None:
    waves = Waves(1.0, 7.0, 0.4)
    water, h = Water(waves=waves).parameters, 1e-3
    rise = (flow.elevation(3.0 + h, 8.0, 9.0, water) - flow.elevation(3.0 - h, 8.0, 9.0, water)) / (2 * h)
    assert -flow.flow(3.0, 8.0, 9.0, 0.0, water)[2] == pytest.approx(rise, abs=1e-5)


def test_waves_do_not_squeeze_water_nor_spin_it() -> None:
    """Linear waves are free of divergence and of rotation, below the surface: a wrong sign of any part shows."""
    water, h, at = Water(waves=Waves(1.0, 7.0, 0.4)).parameters, 1e-2, np.array([8.0, 9.0, 3.0])
    jacobian = np.array([
        (np.array(flow.flow(2.0, *(at + step), water)[:3]) - np.array(flow.flow(2.0, *(at - step), water)[:3])) / (2 * h)
        for step in h * np.eye(3)
    ]).T  # fmt: skip
    size = np.abs(jacobian).max()
    assert size > 0.01
    assert np.trace(jacobian) == pytest.approx(0.0, abs=1e-4 * size)
    assert jacobian == pytest.approx(jacobian.T, abs=1e-4 * size)


def test_a_sea_state_has_its_height_and_its_period_and_dies_out_with_depth() -> None:
    waves = Waves(2.0, 8.0, 1.0, seed=3)
    assert 4 * np.sqrt(0.5 * np.sum(waves.rows[:, 0] ** 2)) == pytest.approx(2.0)
    peak = waves.rows[np.argmax(waves.rows[:, 0] ** 2 / np.gradient(waves.rows[:, 2])), 2]
    assert 2 * np.pi / peak == pytest.approx(8.0, rel=0.05)
    assert waves.rows[:, 1] * 9.81 == pytest.approx(waves.rows[:, 2] ** 2)  # deep water
    mean = np.arctan2(np.mean(waves.rows[:, 4]), np.mean(waves.rows[:, 3]))
    assert mean == pytest.approx(1.0, abs=0.3)  # 40 directions of sigma 0.57 rad: three standard errors
    time = np.linspace(0.0, 600.0, 2000)
    at = [np.std(Water(waves=waves).velocity_n(time, 0 * time, 0 * time, np.full(2000, d))[:, 2]) for d in (0.0, 25.0)]
    assert at[1] < 0.35 * at[0]  # a wave of 8 s is 100 m long: exp(-2 pi 25 / 100) = 0.21
    assert not np.array_equal(Waves(2.0, 8.0, seed=4).rows, Waves(2.0, 8.0, seed=5).rows)


def test_waves_press_as_they_stand_and_less_with_depth() -> None:
    water = Water(waves=Waves(1.0, 6.0))
    surface = flow.elevation(4.0, 1.0, 2.0, water.parameters)
    at = [water.wave_pressure(np.array([4.0]), np.array([1.0]), np.array([2.0]), np.array([d]))[0] for d in (0.0, 30.0)]
    assert at[0] == pytest.approx(surface)
    assert abs(at[1]) < 0.1


def test_a_current_wanders_as_it_should() -> None:
    many = np.stack([Wandering(0.1, 200.0, seed).series(2000.0) for seed in range(400)])
    assert np.std(many, axis=(0, 2)) == pytest.approx(0.1, rel=0.15)  # 800 draws: 2.5 %, the largest of 200 moments
    lag = round(200.0 / SERIES_STEP)
    found = np.mean(many[:, 50, :] * many[:, 50 + lag, :]) / 0.01
    assert found == pytest.approx(np.exp(-1.0), abs=0.12)  # 3.4 standard errors of 800 products
    water = Water(wandering=Wandering(0.1, 200.0, 7), duration=2000.0)
    series = Wandering(0.1, 200.0, 7).series(2000.0)
    assert velocity(water, 35.0)[:2] == pytest.approx(0.5 * (series[3] + series[4]))
    assert velocity(water, 1e6)[:2] == pytest.approx(series[-1])


def test_the_tide_lifts_the_surface() -> None:
    water = Water(levels=(Level(1.2, 40000.0, 100.0), Level(0.3, 20000.0)))
    time = np.array([100.0, 20100.0, 5.0])
    right = 1.2 * np.cos(2 * np.pi * (time - 100.0) / 40000.0) + 0.3 * np.cos(2 * np.pi * time / 20000.0)
    assert water.level(time) == pytest.approx(right)
    assert flow.elevation(5.0, 0.0, 0.0, water.parameters) == pytest.approx(right[2])


def test_parts_add_up_whatever_else_there_is() -> None:
    parts = {
        "shear": ((0.0, 0.1, 0.2), (10.0, 0.0, -0.1)), "tides": (TidalCurrent(0.3, 0.2, 0.1), TidalCurrent(0.1, 1.2)),
        "waves": Waves(1.0, 5.0), "wandering": Wandering(0.1, 300.0), "levels": (Level(1.0),),
    }  # fmt: skip
    whole = Water(**parts, duration=100.0)  # type: ignore[arg-type]
    alone = [Water(**{name: part}, duration=100.0) for name, part in parts.items()]  # type: ignore[arg-type]
    place = (42.0, 3.0, -7.0, 4.0)
    assert velocity(whole, *place) == pytest.approx(sum(velocity(one, *place) for one in alone))
    assert whole.level(np.array([42.0])) == pytest.approx(sum(one.level(np.array([42.0])) for one in alone))
