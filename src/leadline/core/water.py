"""Sea water: pressure of a column and speed of sound, compiled.

Pressures are gauge pressures (Pa): that of the water alone, without the atmosphere.  Depths are positive down (m).
The column is the standard ocean (35 practical salinity, 0 degrees Celsius); a real one differs by up to some parts in a thousand.
"""

from __future__ import annotations

import math

from leadline.core.compiled import kernel

DECIBAR = 1e4  # Pa
ATMOSPHERE = 101325.0  # Pa, the standard one
GRAVITY_SLOPE = 1.092e-6  # m/s^2 per decibar: gravity grows with depth


@kernel()
def surface_gravity(sine2):
    """Gravity (m/s^2) at the surface, from the square of the sine of the latitude (Fofonoff and Millard, 1983, p. 28)."""
    return 9.780318 * (1.0 + (5.2788e-3 + 2.36e-5 * sine2) * sine2)


@kernel()
def depth_of_pressure(pressure, gravity):
    """Depth (m) of a gauge pressure (Pa) with `gravity` at the surface (Fofonoff and Millard, 1983, p. 28)."""
    p = pressure / DECIBAR
    column = (((-1.82e-15 * p + 2.279e-10) * p - 2.2512e-5) * p + 9.72659) * p
    return column / (gravity + GRAVITY_SLOPE * p)


@kernel()
def pressure_of_depth(depth, gravity):
    """Gauge pressure (Pa) at a depth (m), and how it grows with it (Pa/m): the inverse of `depth_of_pressure`, by Newton to rounding."""
    p = depth * gravity / 9.72659
    slope = gravity / 9.72659
    for _ in range(4):
        column = (((-1.82e-15 * p + 2.279e-10) * p - 2.2512e-5) * p + 9.72659) * p
        steep = ((-7.28e-15 * p + 6.837e-10) * p - 4.5024e-5) * p + 9.72659
        weight = gravity + GRAVITY_SLOPE * p
        slope = weight * weight / (steep * weight - column * GRAVITY_SLOPE)
        p -= (column / weight - depth) * slope
    return p * DECIBAR, slope * DECIBAR


@kernel()
def sound_speed_mackenzie(temperature, salinity, depth):
    """Speed of sound (m/s) by nine terms, from degrees Celsius, practical salinity and depth (m) (Mackenzie, 1981).

    Good to 0.07 m/s from 2 to 30 degrees Celsius, for 25 to 40 practical salinity and down to 8000 m.
    """
    t, s, d = temperature, salinity - 35.0, depth
    warm = 1448.96 + (4.591 + (-5.304e-2 + 2.374e-4 * t) * t) * t
    return warm + 1.340 * s + (1.630e-2 + 1.675e-7 * d) * d - 1.025e-2 * t * s - 7.139e-13 * t * d * d * d


@kernel()
def sound_speed(temperature, salinity, pressure):
    """Speed of sound (m/s), from degrees Celsius (IPTS-68), practical salinity and gauge pressure (Pa) (Chen and Millero, 1977).

    As in Fofonoff and Millard (1983, p. 46): 0 to 40 degrees Celsius, 0 to 40 practical salinity, down to 10 km.
    """
    t, s, p = temperature, salinity, pressure / 1e5
    c0 = ((((3.1464e-9 * t - 1.47800e-6) * t + 3.3420e-4) * t - 5.80852e-2) * t + 5.03711) * t + 1402.388
    c1 = (((-6.1185e-10 * t + 1.3621e-7) * t - 8.1788e-6) * t + 6.8982e-4) * t + 0.153563
    c2 = (((1.0405e-12 * t - 2.5335e-10) * t + 2.5974e-8) * t - 1.7107e-6) * t + 3.1260e-5
    c3 = (-2.3643e-12 * t + 3.8504e-10) * t - 9.7729e-9
    a0 = (((-3.21e-8 * t + 2.006e-6) * t + 7.164e-5) * t - 1.262e-2) * t + 1.389
    a1 = (((-2.0122e-10 * t + 1.0507e-8) * t - 6.4885e-8) * t - 1.2580e-5) * t + 9.4742e-5
    a2 = ((7.988e-12 * t - 1.6002e-10) * t + 9.1041e-9) * t - 3.9064e-7
    a3 = (-3.389e-13 * t + 6.649e-12) * t + 1.100e-10
    pure, salt = ((c3 * p + c2) * p + c1) * p + c0, ((a3 * p + a2) * p + a1) * p + a0
    b = -1.922e-2 - 4.42e-5 * t + (7.3637e-5 + 1.7945e-7 * t) * p
    d = 1.727e-3 - 7.9836e-6 * p
    return pure + (salt + b * math.sqrt(s) + d * s) * s
