"""The Earth's magnetic field by the World Magnetic Model of the day (NOAA and BGS), as the package pygeomag holds it."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.data.errors import InputError

if TYPE_CHECKING:
    from datetime import datetime

    from leadline.data.records import Array

# First year of each model; each holds for five years.
MODELS = {2010: "WMM_2010.COF", 2015: "WMM_2015v2.COF", 2020: "WMM_2020.COF", 2025: "WMM_2025.COF"}


def declination(latitude: float, longitude: float, height: float, date: datetime, where: str) -> float:
    """Return the angle of the horizontal field clockwise from true north (rad), at a place (rad, rad, m) and date.

    Raises InputError, naming `where`, for a date without a model, and near the magnetic poles, where a compass points nowhere.
    Source: Chulliat et al., The World Magnetic Model (2025); good to about half a degree, more where the field lies steep.
    """
    field = modelled(latitude, longitude, height, date, where)
    if field.in_blackout_zone:
        raise InputError(where, "is near a magnetic pole, where a compass points nowhere", "do without it")
    return math.radians(field.d)


def field_n(latitude: float, longitude: float, height: float, date: datetime, where: str) -> Array:
    """Return the magnetic flux density (3,), north, east, down (T), at a place (rad, rad, m) and date.

    Raises InputError, naming `where`, for a date without a model.  Source: as `declination`; good to about 0.15 uT, without what
    rocks and the sun's weather add.
    """
    field = modelled(latitude, longitude, height, date, where)
    return 1e-9 * np.array([field.x, field.y, field.z])


@lru_cache(maxsize=1024)  # asked for each row that arrives, and always the same
def modelled(latitude: float, longitude: float, height: float, date: datetime, where: str) -> Any:
    """Return the field as the package gives it, in degrees and nT; raises InputError for a date without a model."""
    from pygeomag import GeoMag

    first = date.year - date.year % 5
    if first not in MODELS:
        right = f"{min(MODELS)} to {max(MODELS) + 4}: set epoch in log.toml, or give declination_deg"
        raise InputError(where, f"the magnetic field of {date.year} is not known", right)
    start, end = date.replace(month=1, day=1, hour=0, minute=0, second=0, microsecond=0), date.replace(month=12, day=31, hour=23, minute=59)
    year = date.year + (date - start) / (end - start)
    model = GeoMag(coefficients_file=f"wmm/{MODELS[first]}")
    return model.calculate(math.degrees(latitude), math.degrees(longitude), height / 1000.0, min(year, first + 4.9999))
