"""How the water moves: current and waves, compiled, so that a simulated vehicle can be carried by them.

All the water is one flat array, so that the loop that moves a vehicle is compiled once for every sea.  Linear waves in deep water: a
component of amplitude a, wave number k and angular frequency w (w^2 = g k) that travels along the unit vector d lifts the surface by
a cos(psi), psi = k d.x - w t + phase, and moves the water below by a w exp(-k depth) (d cos(psi), up sin(psi)) (Airy, 1845).
"""

from __future__ import annotations

import math

from leadline.core.compiled import kernel

# The array `water`: eight numbers, then rows of the four lists behind each other.
SHEARS, TIDES, WAVES, SERIES, LEVELS, SERIES_STEP, HEAD = 0, 1, 2, 3, 4, 5, 8  # how many rows each list has; s between rows of the series
SHEAR, TIDE, WAVE, STEP, LEVEL = 3, 6, 6, 2, 3  # numbers in a row:
# a shear: depth, north, east (m, m/s), by depth, straight in between, constant beyond the ends
# a tide: angular frequency (rad/s), north and east of the cosine, north and east of the sine (m/s), unused
# a wave: amplitude (m), wave number (rad/m), angular frequency (rad/s), north and east of its direction, phase (rad)
# a series: north, east (m/s), from time 0 on, straight in between, constant beyond the ends
# a level: amplitude (m), angular frequency (rad/s), phase (rad): the tide lifts the surface by a cos(w t + phase)


@kernel()
def flow(time, north, east, depth, water):
    """Velocity (m/s) and acceleration (m/s^2, of the water at that place) north, east, down; `depth` below the mean surface."""
    if len(water) < HEAD:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    shears, tides, waves, series = int(water[SHEARS]), int(water[TIDES]), int(water[WAVES]), int(water[SERIES])
    vn = ve = vd = an = ae = ad = 0.0
    at = HEAD
    if shears > 0:
        k = 0
        while k < shears - 2 and depth > water[at + SHEAR * (k + 1)]:
            k += 1
        i, j = at + SHEAR * k, at + SHEAR * min(k + 1, shears - 1)
        span = water[j] - water[i]
        share = min(max((depth - water[i]) / span, 0.0), 1.0) if span > 0.0 else 0.0
        vn += water[i + 1] + share * (water[j + 1] - water[i + 1])
        ve += water[i + 2] + share * (water[j + 2] - water[i + 2])
    at += SHEAR * shears
    for k in range(tides):
        i = at + TIDE * k
        w = water[i]
        c, s = math.cos(w * time), math.sin(w * time)
        vn += water[i + 1] * c + water[i + 3] * s
        ve += water[i + 2] * c + water[i + 4] * s
        an += w * (water[i + 3] * c - water[i + 1] * s)
        ae += w * (water[i + 4] * c - water[i + 2] * s)
    at += TIDE * tides
    for k in range(waves):
        i = at + WAVE * k
        size = water[i] * water[i + 2] * math.exp(-water[i + 1] * max(depth, 0.0))
        psi = water[i + 1] * (water[i + 3] * north + water[i + 4] * east) - water[i + 2] * time + water[i + 5]
        c, s = size * math.cos(psi), size * math.sin(psi)
        vn += c * water[i + 3]
        ve += c * water[i + 4]
        vd -= s
        an += water[i + 2] * s * water[i + 3]
        ae += water[i + 2] * s * water[i + 4]
        ad += water[i + 2] * c
    at += WAVE * waves
    if series > 0:
        place = min(max(time / water[SERIES_STEP], 0.0), series - 1.0)
        k = min(int(place), max(series - 2, 0))
        i, j, share = at + STEP * k, at + STEP * min(k + 1, series - 1), place - k
        vn += water[i] + share * (water[j] - water[i])
        ve += water[i + 1] + share * (water[j + 1] - water[i + 1])
    return vn, ve, vd, an, ae, ad


@kernel()
def elevation(time, north, east, water):
    """Height (m) of the water surface, waves and tide, above its mean."""
    if len(water) < HEAD:
        return 0.0
    at = HEAD + SHEAR * int(water[SHEARS]) + TIDE * int(water[TIDES])
    height = level(time, water)
    for k in range(int(water[WAVES])):
        i = at + WAVE * k
        height += water[i] * math.cos(water[i + 1] * (water[i + 3] * north + water[i + 4] * east) - water[i + 2] * time + water[i + 5])
    return height


@kernel()
def level(time, water):
    """Height (m) of the water surface without its waves above its mean: the tide."""
    if len(water) < HEAD:
        return 0.0
    at = HEAD + SHEAR * int(water[SHEARS]) + TIDE * int(water[TIDES]) + WAVE * int(water[WAVES]) + STEP * int(water[SERIES])
    height = 0.0
    for k in range(int(water[LEVELS])):
        i = at + LEVEL * k
        height += water[i] * math.cos(water[i + 1] * time + water[i + 2])
    return height


@kernel()
def wave_pressure(time, north, east, depth, water):
    """Height (m of water) by which waves raise the pressure at a depth: a exp(-k depth) cos(psi), summed."""
    if len(water) < HEAD:
        return 0.0
    at = HEAD + SHEAR * int(water[SHEARS]) + TIDE * int(water[TIDES])
    height = 0.0
    for k in range(int(water[WAVES])):
        i = at + WAVE * k
        psi = water[i + 1] * (water[i + 3] * north + water[i + 4] * east) - water[i + 2] * time + water[i + 5]
        height += water[i] * math.exp(-water[i + 1] * max(depth, 0.0)) * math.cos(psi)
    return height


@kernel()
def flows(time, north, east, depth, water, found):
    """Write velocities (rows, 3) of the water."""
    for i in range(len(time)):
        found[i, 0], found[i, 1], found[i, 2], _, _, _ = flow(time[i], north[i], east[i], depth[i], water)


@kernel()
def levels(time, water, found):
    """Write tides (rows,)."""
    for i in range(len(time)):
        found[i] = level(time[i], water)


@kernel()
def wave_pressures(time, north, east, depth, water, found):
    """Write heights of pressure (rows,)."""
    for i in range(len(time)):
        found[i] = wave_pressure(time[i], north[i], east[i], depth[i], water)
