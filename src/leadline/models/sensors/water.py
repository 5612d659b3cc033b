"""The moving water, as sensors see it that measure against it: velocity through the water = velocity over ground - current.

The current is a nuisance of two values, north and east (m/s), shared by all such sensors: `water.current`.
"""

from __future__ import annotations

import math

from leadline.core.compiled import kernel
from leadline.models.view import POSITION_T, VELOCITY_T, VELOCITY_V, north_slope, wander


@kernel()
def current_of(views, nuisance, at):
    """Current in the navigation frame, level."""
    angle = wander(views)
    c, s = math.cos(angle), math.sin(angle)
    return c * nuisance[at] + s * nuisance[at + 1], c * nuisance[at + 1] - s * nuisance[at]


@kernel()
def through_water(views, nuisance, at):
    """Velocity of the reference point through the water, navigation frame; the current stands at place `at` of the nuisances."""
    current = current_of(views, nuisance, at)
    return views[VELOCITY_V] - current[0], views[VELOCITY_V + 1] - current[1], views[VELOCITY_V + 2]


@kernel()
def write_current(views, nuisance, at, i, Hv, Hn):
    """Jacobian of row i for the current, and for the place at which it is turned, from that for the velocity."""
    angle, current, slope = wander(views), current_of(views, nuisance, at), north_slope(views)
    c, s = math.cos(angle), math.sin(angle)
    n0, n1 = Hv[i, VELOCITY_T], Hv[i, VELOCITY_T + 1]
    Hn[i, at], Hn[i, at + 1] = -(c * n0 - s * n1), -(s * n0 + c * n1)
    turned = n0 * current[1] - n1 * current[0]
    for j in range(2):
        Hv[i, POSITION_T + j] -= turned * slope[j]
