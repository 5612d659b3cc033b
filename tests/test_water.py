"""Sea water against the check values of its standards, and against the equation of state of 2010 (gsw)."""

import gsw
import numpy as np
import pytest

from leadline.core.water import depth_of_pressure, pressure_of_depth, sound_speed, sound_speed_mackenzie, surface_gravity


def test_depth_has_the_check_value_of_its_standard():
    """Fofonoff and Millard (1983), p. 28: 10000 decibars at 30 degrees are 9712.653 m."""
    assert depth_of_pressure(1e8, surface_gravity(0.25)) == pytest.approx(9712.653, abs=5e-4)


def test_sound_speed_has_the_check_value_of_its_standard():
    """Fofonoff and Millard (1983), p. 46: 1731.995 m/s at 40 degrees Celsius, salinity 40, 10000 decibars."""
    assert sound_speed(40.0, 40.0, 1e8) == pytest.approx(1731.995, abs=5e-4)


@pytest.mark.parametrize("latitude", [-70.0, 0.0, 32.0, 89.0])
@pytest.mark.parametrize("depth", [-1.0, 0.0, 3.0, 250.0, 3000.0, 11000.0])
def test_pressure_is_the_inverse_of_depth(latitude, depth):
    gravity = surface_gravity(np.sin(np.radians(latitude)) ** 2)
    pressure, slope = pressure_of_depth(depth, gravity)
    assert depth_of_pressure(pressure, gravity) == pytest.approx(depth, abs=1e-9)
    ahead, behind = pressure_of_depth(depth + 0.5, gravity)[0], pressure_of_depth(depth - 0.5, gravity)[0]
    assert slope == pytest.approx(ahead - behind, rel=1e-9)


@pytest.mark.parametrize("latitude", [0.0, 45.0, 80.0])
def test_a_column_of_standard_water_agrees_with_the_equation_of_state_of_2010(latitude):
    """Down to 6000 m within 0.3 m: the standards differ in gravity (normal gravity of 1967 and 1980) and in the water."""
    gravity = surface_gravity(np.sin(np.radians(latitude)) ** 2)
    for pressure in (10.0, 100.0, 1000.0, 6000.0):
        expected = -gsw.z_from_p(pressure, latitude)
        assert depth_of_pressure(pressure * 1e4, gravity) == pytest.approx(expected, abs=1e-3 + 5e-5 * expected)


@pytest.mark.parametrize(
    ("temperature", "salinity", "depth"), [(2.0, 35.0, 3000.0), (10.0, 35.0, 100.0), (25.0, 37.0, 20.0), (13.0, 38.5, 1000.0)]
)
def test_sound_speeds_agree_with_the_equation_of_state_of_2010(temperature, salinity, depth):
    """Chen and Millero is up to 0.6 m/s too fast at great pressure (Millero and Li, 1994); Mackenzie is fitted to another set."""
    pressure = gsw.p_from_z(-depth, 30.0)
    absolute = gsw.SA_from_SP(salinity, pressure, -30.0, 30.0)
    expected = gsw.sound_speed_t_exact(absolute, temperature, pressure)
    assert sound_speed(temperature * 1.00024, salinity, pressure * 1e4) == pytest.approx(expected, abs=0.1 + 2e-4 * depth)
    assert sound_speed_mackenzie(temperature, salinity, depth) == pytest.approx(expected, abs=0.35)
