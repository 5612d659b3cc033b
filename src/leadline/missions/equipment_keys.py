"""Which keys an instrument of the simulator may have, in human units: [instruments.NAME] of a mission, `simulated` in a vehicle file.

A key is the name of a field and its unit; so each class below lists its fields with their units.  A field that wanders (`Drift`) is a
table of its own: constant, turn_on, steady, tau_s, walk, flicker, each in the unit of the field.
"""

from __future__ import annotations

from dataclasses import MISSING, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.data.errors import InputError, suggestion
from leadline.data.vehicle import HUMAN_UNITS
from leadline.data.vehicle_keys import shown
from leadline.simulate.drift import Drift
from leadline.simulate.gyros import Triad
from leadline.simulate.reception import Reception

if TYPE_CHECKING:
    from collections.abc import Mapping
    from dataclasses import Field

    from leadline.simulate.instrument import Instrument

Units = dict[str, str]

PLAIN = ""  # no unit: a fraction, a count, a word, yes or no
ALIASES = {"lever_arm_b": "lever_arm", "mounting_bs": "mounting", "transponder_b": "transponder_lever_arm"}
EVERY: Units = {
    "rate": "hz", "offset": "s", "stop": "s", "jitter": "s", "latency": "s", "latency_jitter": "s", "loss": PLAIN,
    "stamp_offset": "s", "stamp_drift": "ppm", "stamp_jitter": "s", "lever_arm_b": "m", "mounting_bs": "deg",
}  # fmt: skip
SOUND: Units = {
    "path": PLAIN, "sound_speed": "mps", "sigma": "s", "sigma_turnaround": "s", "clock_offset": "s", "clock_drift": "ppm", "quantum": "s",
    "beacon_sigma": "m", "dropout": PLAIN, "range_50": "m", "range_width": "m", "range_max": "m", "output": PLAIN,
}  # fmt: skip
DOPPLER: Units = {
    "output": PLAIN, "scale": "percent", "sigma_scale": "percent", "sigma_mounting": "deg", "sigma": "mps", "sigma_fraction": PLAIN,
    "azimuths": "deg", "tilt": "deg", "beam_sigma": "mps", "beam_loss": PLAIN, "error_velocity": PLAIN, "range_min": "m", "range_max": "m",
    "sigma_range": "m", "sigma_range_fraction": PLAIN, "sigma_altitude": "m", "sound_speed": "mps", "phased": PLAIN, "bias": "mps",
    "quantum": "mps", "limit": "mps",
}  # fmt: skip
HEAD: Units = {
    **SOUND, "receiver": PLAIN, "transponder": PLAIN, "transponder_b": "m", "turnaround": "s", "sigma_angle": "deg",
}  # fmt: skip
OF_KIND: Mapping[str, Units] = {
    "imu": {
        "sample": PLAIN, "gyro_density": "deg_per_rth", "accel_density": "ug_per_rthz", "gyro_bias": "deg_per_h", "accel_bias": "ug",
        "gyro_axes": "degps", "accel_axes": "mps2", "g_sensitivity": "deg_per_h_per_g", "sigma_g_sensitivity": "deg_per_h_per_g",
    },
    "magnetometer": {
        "soft_iron": PLAIN, "sigma_soft": PLAIN, "hard_iron": "ut", "sigma_hard": "ut", "motor_coupling": "ut", "bias": "ut",
        "sigma": "ut", "quantum": "ut", "limit": "ut",
    },
    "attitude": {"sigma": "deg", "bias": "deg", "tilt_gain": PLAIN, "tilt_tau": "s", "quantum": "deg"},
    "heading": {"sigma": "deg", "bias": "deg", "swing": "deg", "sigma_swing": "deg", "tilt_gain": PLAIN, "tilt_tau": "s", "quantum": "deg"},
    "yaw_rate": {
        "earth_removed": PLAIN, "lag": "s", "scale": "percent", "sigma_scale": "percent", "sigma": "degps", "bias": "deg_per_h",
        "quantum": "degps", "limit": "degps",
    },
    "depth": {"sigma": "m", "bias": "m", "quantum": "m", "limit": "m"},
    "pressure": {
        "sigma": "pa", "datum": "m", "atmosphere": "pa", "weather": "pa", "density": "kgpm3", "scale": "percent", "sigma_scale": "percent",
        "quantum": "pa", "limit": "pa",
    },
    "altimeter": {"opening": "deg", "range_min": "m", "range_max": "m", "sigma": "m", "bias": "m", "quantum": "m", "limit": "m"},
    "gnss": {"sigma": "m", "drift": "m", "sigma_velocity": "mps", "max_depth": "m", "reception": "s", "sigmas": "m"},
    "position_fix": {
        "output": PLAIN, "depth": PLAIN, "sigma": "m", "sigma_depth": "m", "outlier_fraction": PLAIN, "outlier_size": "m", "bias": "m",
    },
    "dvl": DOPPLER,
    "water_velocity": {**DOPPLER, "cell_start": "m", "cell_end": "m"},
    "speed": {"scale": "percent", "sigma_scale": "percent", "sigma": "mps", "bias": "mps", "quantum": "mps", "limit": "mps"},
    "swath": {
        "beams": PLAIN, "swath": "deg", "range_min": "m", "range_max": "m", "sigma": "m", "sigma_fraction": PLAIN,
        "outlier_fraction": PLAIN, "outlier_size": "m", "beam_loss": PLAIN, "sound_speed": "mps", "output": PLAIN,
    },
    "acoustic_range": {
        **SOUND, "reference": PLAIN, "outlier_fraction": PLAIN, "outlier_delay": "s", "echo_fraction": PLAIN, "echo_delay": "s",
        "peaks": PLAIN, "snr": "db",
    },
    "usbl": {**HEAD, "frame": PLAIN},
    "usbl_fix": {**HEAD, "sigma_position": "m", "sigma_attitude": "deg", "sigma_scale": "percent"},
    "short_baseline": {
        "interval_min": "s", "interval_max": "s", "sound_speed": "mps", "sigma": "s", "dropout": PLAIN, "output": PLAIN,
    },
    "platform": {"sigma": "m", "sigma_attitude": "deg"},
    "thruster": {"sigma": "rps", "sigma_angle": "deg", "quantum": "rps", "limit": "rps"},
    "motor_current": {"sigma": "a", "sigma_scale": "percent", "quantum": "a", "limit": "a"},
    "water_level": {"mean": "m", "sigma": "m", "bias": "m", "quantum": "m"},
    "water_current": {"depth": "m", "vertical": PLAIN, "sigma": "mps", "bias": "mps", "quantum": "mps"},
    "sound_speed": {"sigma": "mps", "sigma_depth": "m", "bias": "mps", "quantum": "mps"},
    "sound_speed_profile": {"fall": "mps", "sigma": "mps", "sigma_depth": "m", "bias": "mps", "quantum": "mps"},
    "zero_velocity": {"sigma": "mps"},
    "navigation": {},
}  # fmt: skip
DRIFT = ("constant", "turn_on", "steady", "walk", "flicker")
TRIAD: Units = {"scale": "percent", "sigma_scale": "percent", "sigma_misalignment": "deg"}
RECEPTION: Units = {
    "cold": "s",
    "least": "s",
    "hot": "s",
    "hot_least": "s",
    "hot_for": "s",
    "lapse": PLAIN,
    "wash": PLAIN,
    "satellites": PLAIN,
}


def with_keys(instrument: Instrument[Any], kind: str, raw: Mapping[str, Any], where: str) -> Instrument[Any]:
    """Return an instrument with the fields that the keys of a file set.

    Raises InputError, which names the key, for one that the kind does not have and for a value of another type.
    """
    return replace(instrument, **fields_of(type(instrument), kind, raw, where))


def fields_of(made: type[Instrument[Any]], kind: str, raw: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return the fields (SI) of a class of instrument that keys of a file set; raises as `with_keys`."""
    own = {field.name: _default(field) for field in fields(made)}
    units = {name: unit for name, unit in {**EVERY, **OF_KIND[kind]}.items() if name in own}
    known = {_key(name, unit, own[name]): name for name, unit in units.items()}
    found = {}
    for key, value in raw.items():
        if key in ("kind", "aboard", "platforms", "beacons", "transducers", "receivers_m"):
            continue
        if key not in known:
            raise InputError(f"{where}.{key}", f"is no key of an instrument of kind '{kind}'", suggestion(key, known))
        name = known[key]
        found[name] = _value(value, own[name], units[name], f"{where}.{key}")
    return found


def _default(field: Field[Any]) -> Any:
    return field.default_factory() if field.default_factory is not MISSING else field.default


def _key(name: str, unit: str, default: Any) -> str:
    """Return the key of a field: tables have no unit of their own."""
    plain = ALIASES.get(name, name)
    return plain if not unit or isinstance(default, (Drift, Triad)) or name in ("reception", "sigmas") else f"{plain}_{unit}"


def _value(value: Any, default: Any, unit: str, where: str) -> Any:
    if isinstance(default, Drift):
        drift_units = {**dict.fromkeys(DRIFT, unit), "walk": f"{unit}_per_rts", "tau": "s"}
        return Drift(**_table(value, drift_units, where))
    if isinstance(default, Triad):
        return Triad(**_table(value, {**TRIAD, "quantum": unit, "limit": unit}, where))
    if where.endswith(".reception"):
        return _reception(value, where)
    if where.endswith(".sigmas"):
        return {name: _numbers(row, 1.0, f"{where}.{name}") for name, row in _dict(value, where).items()}
    if isinstance(default, bool) or (isinstance(default, str) and not unit):
        if type(value) is not type(default):
            raise InputError(where, shown(value), "true or false" if isinstance(default, bool) else "a text in quotes")
        return value
    if isinstance(default, int) and not unit:
        if type(value) is not int:
            raise InputError(where, shown(value), "a whole number")
        return value
    found = _numbers(value, factor(unit), where)
    if isinstance(default, tuple) and not isinstance(found, tuple):
        if default and len(default) == 3 and all(isinstance(v, float) for v in default):
            return (found,) * len(default)
        raise InputError(where, shown(value), "a list of numbers")
    return found


def _reception(value: Any, where: str) -> Reception:
    raw = dict(_dict(value, where))
    stages = raw.pop("stages", None)
    found = _table(raw, RECEPTION, where)
    if stages is not None:
        if not isinstance(stages, list) or not all(isinstance(s, list) and len(s) == 2 and isinstance(s[0], str) for s in stages):
            raise InputError(
                f"{where}.stages", shown(stages), '[["single", 0.0], ["fixed", 30.0]]: fix types and seconds after the first fix'
            )
        found["stages"] = tuple((name, float(after)) for name, after in stages)
    return Reception(**found)


def _table(value: Any, units: Mapping[str, str], where: str) -> dict[str, Any]:
    known = {f"{name}_{unit}" if unit else name: (name, unit) for name, unit in units.items()}
    found = {}
    for key, part in _dict(value, where).items():
        if key not in known:
            raise InputError(f"{where}.{key}", "is not known", suggestion(key, known))
        name, unit = known[key]
        found[name] = _numbers(part, factor(unit), f"{where}.{key}")
    return found


def factor(unit: str) -> float:
    """Return what a value in a unit is multiplied by to be SI; raises KeyError for one that is none."""
    if not unit:
        return 1.0
    if unit in HUMAN_UNITS:
        return HUMAN_UNITS[unit]
    plain = unit.removesuffix("_per_rts")
    return HUMAN_UNITS[plain] if plain in HUMAN_UNITS else HUMAN_UNITS["deg_per_h"] / 9.80665  # deg_per_h_per_g


def _dict(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise InputError(where, shown(value), "a table of keys")
    return value


def _numbers(value: Any, scale: float, where: str) -> Any:
    if isinstance(value, list):
        return tuple(_numbers(part, scale, where) for part in value)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not np.isfinite(value):
        raise InputError(where, shown(value), "a finite number")
    return float(value) * scale
