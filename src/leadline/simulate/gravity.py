"""Gravity that a simulated vehicle feels: normal gravity of WGS 84 in air and in the sea, from its published constants."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.core.geodesy import ECCENTRICITY_2, FLATTENING, SEMI_MAJOR_AXIS

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from leadline.data.records import Array

GRAVITY_EQUATOR, GRAVITY_POLE = 9.7803253359, 9.8321849378  # m/s^2 on the ellipsoid, NIMA TR8350.2 (2000), table 3.4
GRAVITY_RATIO = 0.00344978650684  # omega^2 a^2 b / GM, the same
GRAVITATIONAL_CONSTANT, SEA_DENSITY = 6.6743e-11, 1028.0  # m^3/(kg s^2), CODATA 2018; kg/m^3


def free_air_gravity(latitude: ArrayLike, height: ArrayLike) -> Array:
    """Return normal gravity (m/s^2) at latitudes (rad) and ellipsoidal heights (m), outside all masses.

    Somigliana on the ellipsoid, second order in height: NIMA TR8350.2 (2000), equations 4-1 and 4-3.
    """
    sine_2, h = np.sin(np.asarray(latitude, float)) ** 2, np.asarray(height, float)
    growth = (1 - FLATTENING) * GRAVITY_POLE / GRAVITY_EQUATOR - 1
    surface = GRAVITY_EQUATOR * (1 + growth * sine_2) / np.sqrt(1 - ECCENTRICITY_2 * sine_2)
    slope = 2 / SEMI_MAJOR_AXIS * (1 + FLATTENING + GRAVITY_RATIO - 2 * FLATTENING * sine_2)
    return np.asarray(surface * (1 - slope * h + 3 / SEMI_MAJOR_AXIS**2 * h * h))


def gravity(latitude: ArrayLike, height: ArrayLike, surface_height: float = 0.0) -> Array:
    """Return plumb gravity (m/s^2) in air and in the sea, whose surface lies at `surface_height` (m above the ellipsoid).

    g = free_air(height) - 4 pi G rho depth below the surface: the water above no longer pulls down (its layer counts twice,
    Dahlen, 1982), so that gravity grows by 2.2e-6 per metre of depth where free air alone would give 3.1e-6.
    """
    depth = np.maximum(surface_height - np.asarray(height, float), 0.0)
    return np.asarray(free_air_gravity(latitude, height) - 4 * np.pi * GRAVITATIONAL_CONSTANT * SEA_DENSITY * depth)
