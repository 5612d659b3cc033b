"""The sea of a mission, made of the keys of its file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from leadline.data.errors import InputError
from leadline.data.vehicle import DEGREE
from leadline.formats.chart import read_chart
from leadline.sea.fractal import fractal
from leadline.sea.sound import SoundProfile
from leadline.sea.terrain import plane
from leadline.sea.water import Level, TidalCurrent, Wandering, Water, Waves

if TYPE_CHECKING:
    from pathlib import Path

    from leadline.missions import mission_keys as keys
    from leadline.sea.terrain import Chart

HOUR = 3600.0
DAY = 24 * HOUR  # how long a current wanders where the mission does not say how long it lasts


@dataclass(frozen=True, eq=False)
class Sea:
    """The water, the ground (None: deep, or nobody knows), how sound runs (None: straight, at the speed that an instrument takes)."""

    water: Water
    chart: Chart | None = None
    sound: SoundProfile | None = None
    density: float = 1025.0
    weighed: bool = False  # whether the mission states the density: then pressure follows from it


def sea_of(given: keys.Sea, home: tuple[float, float], where: Path, duration: float | None) -> Sea:
    """Return the sea; raises InputError for a current or a ground that is given twice or not at all."""
    weighed = "density_kgpm3" in given.model_fields_set
    return Sea(_water(given, where, duration), _chart(given.terrain, home, where), _sound(given, where), given.density_kgpm3, weighed)


def _water(given: keys.Sea, where: Path, duration: float | None) -> Water:
    current = given.current
    shear: tuple[tuple[float, float, float], ...] = ()
    tides: tuple[TidalCurrent, ...] = ()
    wander = None
    if current is not None:
        uniform = current.north_mps is not None or current.east_mps is not None
        if uniform and current.profile:
            raise InputError(f"{where}: sea.current", "has north_mps or east_mps and a profile", "give one of them")
        if uniform:
            shear = ((0.0, current.north_mps or 0.0, current.east_mps or 0.0),)
        shear = shear or tuple((row.depth_m, row.north_mps, row.east_mps) for row in current.profile)
        tides = tuple(
            TidalCurrent(tide.major_mps, tide.heading_deg * DEGREE, tide.minor_mps, tide.period_h * HOUR, tide.crest_s)
            for tide in current.tides
        )
        wander = None if current.wander is None else Wandering(current.wander.sigma_mps, current.wander.tau_s, current.wander.seed)
    waves = given.waves
    state = None if waves is None else Waves(waves.height_m, waves.period_s, waves.heading_deg * DEGREE, waves.gamma, waves.seed)
    levels = tuple(Level(tide.amplitude_m, tide.period_h * HOUR, tide.crest_s) for tide in given.tides)
    return Water(shear, tides, state, wander, levels, duration or DAY)


def _chart(given: keys.Terrain | None, home: tuple[float, float], where: Path) -> Chart | None:
    if given is None:
        return None
    parts = [name for name in ("chart", "fractal", "plane") if getattr(given, name) is not None]
    if len(parts) != 1:
        raise InputError(f"{where}: sea.terrain", f"has {' and '.join(parts) or 'no ground'}", "give one of chart, fractal, plane")
    if given.chart is not None:
        return read_chart(
            where.parent / given.chart, home if given.geographic else None, positive=given.positive, geographic=given.geographic
        )
    if given.fractal is not None:
        own = given.fractal
        if (own.sigma_m is None) == (own.rms_slope is None):
            raise InputError(f"{where}: sea.terrain.fractal", "has neither sigma_m nor rms_slope, or both", "give one of them")
        return fractal(
            _extent(own.centre_m, own.size_m),
            own.step_m,
            own.depth_m,
            beta=own.beta,
            sigma=own.sigma_m,
            rms_slope=own.rms_slope,
            seed=own.seed,
        )
    assert given.plane is not None
    level = given.plane
    return plane(level.depth_m, level.slope_north, level.slope_east, _extent(level.centre_m, level.size_m), level.step_m)


def _extent(centre: list[float], size: float) -> tuple[float, float, float, float]:
    n, e = centre
    return n - size / 2, n + size / 2, e - size / 2, e + size / 2


def _sound(given: keys.Sea, where: Path) -> SoundProfile | None:
    if given.sound and given.sound_speed_mps is not None:
        raise InputError(f"{where}: sea", "has sound and sound_speed_mps", "give one of them")
    if given.sound_speed_mps is not None:
        return SoundProfile.uniform(given.sound_speed_mps)
    if not given.sound:
        return None
    rows = np.array([(row.depth_m, row.speed_mps) for row in given.sound], float)
    return SoundProfile(rows[:, 0], rows[:, 1])
