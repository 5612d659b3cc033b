"""Which keys an instrument of the simulator may have, in human units: [instruments.NAME] of a mission, `simulated` in a vehicle file.

A key is the name of a field and its unit; so each class below lists its fields with their units.  A field that wanders (`Drift`) is a
table of its own: constant, turn_on, steady, tau_s, walk, flicker, each in the unit of the field.  How many numbers a key takes follows from
its default, or stands in `SHAPES` and `AXES`; between which bounds they lie, in `BOUNDS`: a name means the same in every kind.
"""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import MISSING, fields, replace
from typing import TYPE_CHECKING, Any

from leadline.data.errors import InputError, suggestion
from leadline.data.vehicle import HUMAN_UNITS
from leadline.data.vehicle_keys import shown
from leadline.simulate.drift import Drift
from leadline.simulate.gyros import Triad
from leadline.simulate.reception import ORDER, Reception

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
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
    "heading": {
        "sigma": "deg", "bias": "deg", "swing": "deg", "sigma_swing": "deg", "drift_rate": "deg_per_h", "sigma_drift_rate": "deg_per_h",
        "tilt_gain": PLAIN, "tilt_tau": "s", "quantum": "deg",
    },
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


TINY, HUGE = 1e-9, 1e12  # what is above zero, and what no instrument is, in whatever unit
Span = tuple[float, float]
ABOVE, NOT_BELOW, SHARE, ANY = (TINY, HUGE), (0.0, HUGE), (0.0, 1.0), (-HUGE, HUGE)
BOUNDS: Mapping[Span, str] = {  # in the unit of the key; of names that begin with sigma: 0 or more
    ABOVE: "tau tilt_tau range_50 range_width range_max limit fall",
    NOT_BELOW: """
        offset jitter latency latency_jitter stamp_jitter quantum turn_on steady walk flicker gyro_density accel_density lag atmosphere
        opening range_min beam_sigma beacon_sigma outlier_size outlier_delay echo_delay turnaround cell_start cell_end
        cold least hot hot_least hot_for stages""",
    SHARE: "loss dropout beam_loss outlier_fraction echo_fraction lapse wash tilt_gain",
    ANY: """
        stop stamp_offset stamp_drift clock_offset clock_drift lever_arm_b mounting_bs transponder_b scale constant g_sensitivity hard_iron
        soft_iron motor_coupling swing drift_rate azimuths max_depth mean depth snr""",
    (1e-5, 2000.0): "rate", (5e-4, HUGE): "interval_min interval_max", (1000.0, 2000.0): "sound_speed", (500.0, 2000.0): "density",
    (1.0, 89.0): "tilt", (1, 4096): "beams", (1, 20): "peaks", (0.0, 359.0): "swath", (4.0, 100.0): "satellites",
}  # fmt: skip
SPANS: Mapping[str, Span] = {name: span for span, names in BOUNDS.items() for name in names.split()}
Shape = tuple[int, ...]  # lengths of lists in lists; -1: any length
SHAPES: Mapping[str, Shape] = {"soft_iron": (3, 3), "motor_coupling": (3, -1), "azimuths": (-1,)}
AXES: Mapping[str, int] = {  # of what wanders; of others one
    "imu": 3, "magnetometer": 3, "attitude": 3, "gnss": 3, "position_fix": 2, "dvl": 3, "water_velocity": 3, "water_current": 3,
}  # fmt: skip
PATHS = ("one_way", "two_way")
TIMES = ("travel_time", "range")
VELOCITIES = ("velocity", "beams", "both")
WORDS: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "imu": {"sample": ("mean", "instant", "increment")}, "position_fix": {"output": ("geographic", "local")},
    "dvl": {"output": VELOCITIES}, "water_velocity": {"output": VELOCITIES}, "swath": {"output": TIMES},
    "acoustic_range": {"path": (*PATHS, "difference"), "output": TIMES},
    "usbl": {"path": PATHS, "output": TIMES, "frame": ("sensor", "level")},
    "usbl_fix": {"path": PATHS, "output": TIMES}, "short_baseline": {"output": ("fix", "range")},
}  # fmt: skip
PARTNERS = ("kind", "aboard", "platforms", "beacons", "transducers", "receivers_m")  # no fields of an instrument: equipment.py reads them


def span_of(name: str) -> Span:
    """Return between which bounds (in the unit of its key) a field lies; raises KeyError for one that is no number."""
    return NOT_BELOW if name.startswith("sigma") else SPANS[name]


def with_keys(instrument: Instrument[Any], kind: str, raw: Mapping[str, Any], where: str) -> Instrument[Any]:
    """Return an instrument with the fields that the keys of a file set.

    Raises InputError, which names the key, for one that the kind does not have, for a value of another type or shape or out of its bounds,
    and for values that do not go together.
    """
    found = fields_of(type(instrument), kind, raw, where)
    with placed_at(where):
        return replace(instrument, **found)


@contextmanager
def placed_at(where: str) -> Iterator[None]:
    """Let an InputError that is raised within say where in a file its cause stands."""
    try:
        yield
    except InputError as error:
        raise InputError(where, error.found, error.right) from error


def fields_of(made: type[Instrument[Any]], kind: str, raw: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return the fields (SI) of a class of instrument that keys of a file set; raises as `with_keys`."""
    own = {field.name: _default(field) for field in fields(made)}
    units = {name: unit for name, unit in {**EVERY, **OF_KIND[kind]}.items() if name in own}
    known = {_key(name, unit, own[name]): name for name, unit in units.items()}
    found = {}
    for key, value in raw.items():
        if key in PARTNERS:
            continue
        if key not in known:
            raise InputError(f"{where}.{key}", f"is no key of an instrument of kind '{kind}'", suggestion(key, known))
        name = known[key]
        words = WORDS.get(kind, {}).get(name)
        if words and value not in words:
            raise InputError(f"{where}.{key}", shown(value), f"one of {', '.join(words)}")
        found[name] = _value(value, own[name], name, units[name], f"{where}.{key}", AXES.get(kind, 1))
    return found


def _default(field: Field[Any]) -> Any:
    return field.default_factory() if field.default_factory is not MISSING else field.default


def _key(name: str, unit: str, default: Any) -> str:
    """Return the key of a field: tables have no unit of their own."""
    plain = ALIASES.get(name, name)
    return plain if not unit or isinstance(default, (Drift, Triad)) or name in ("reception", "sigmas") else f"{plain}_{unit}"


def _value(value: Any, default: Any, name: str, unit: str, where: str, axes: int) -> Any:
    if isinstance(default, Drift):
        drift_units = {**dict.fromkeys(DRIFT, unit), "walk": f"{unit}_per_rts", "tau": "s"}
        return Drift(**_table(value, drift_units, where, {"constant": axes}))
    if isinstance(default, Triad):
        return Triad(**_table(value, {**TRIAD, "quantum": unit, "limit": unit}, where, {"scale": 3}))
    if name == "reception":
        return _reception(value, where)
    if name == "sigmas":
        return _sigmas(value, where)
    if isinstance(default, bool) or (isinstance(default, str) and not unit):
        if type(value) is not type(default):
            raise InputError(where, shown(value), "true or false" if isinstance(default, bool) else "a text in quotes")
        return value
    if isinstance(default, int) and not unit and type(value) is not int:
        raise InputError(where, shown(value), "a whole number")
    shape = SHAPES.get(name, (len(default),) if isinstance(default, tuple) else ())
    if shape and name.startswith("sigma") and not isinstance(value, list):
        value = [value] * shape[0]  # the same for all
    found = _numbers(value, span_of(name), factor(unit), where, shape)
    return int(found) if isinstance(default, int) and not isinstance(default, bool) and not unit else found


def _reception(value: Any, where: str) -> Reception:
    raw = dict(_dict(value, where))
    stages = raw.pop("stages", None)
    found = _table(raw, RECEPTION, where)
    if stages is not None:
        if not isinstance(stages, list) or not all(isinstance(s, list) and len(s) == 2 and isinstance(s[0], str) for s in stages):
            raise InputError(
                f"{where}.stages", shown(stages), '[["single", 0.0], ["fixed", 30.0]]: fix types and seconds after the first fix'
            )
        found["stages"] = tuple((name, _numbers(after, NOT_BELOW, 1.0, f"{where}.stages")) for name, after in stages)
    with placed_at(where):
        return Reception(**found)


def _sigmas(value: Any, where: str) -> dict[str, Any]:
    found = {}
    for name, row in _dict(value, where).items():
        if name not in ORDER[1:]:
            raise InputError(f"{where}.{name}", "is no kind of fix", suggestion(name, ORDER[1:]))
        found[name] = _numbers(row, NOT_BELOW, 1.0, f"{where}.{name}", (3,))
    return found


def _table(value: Any, units: Mapping[str, str], where: str, many: Mapping[str, int] | None = None) -> dict[str, Any]:
    """Return the fields of a table of numbers; many: how many a list of some of them has."""
    known = {f"{name}_{unit}" if unit else name: (name, unit) for name, unit in units.items()}
    found = {}
    for key, part in _dict(value, where).items():
        if key not in known:
            raise InputError(f"{where}.{key}", "is not known", suggestion(key, known))
        name, unit = known[key]
        count = (many or {}).get(name, 0)
        each = [part] * count if name == "scale" and not isinstance(part, list) else part
        shape = (count,) if count and isinstance(each, list) else ()
        found[name] = _numbers(each, span_of(name), factor(unit), f"{where}.{key}", shape)
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


def _numbers(value: Any, span: Span, scale: float, where: str, shape: Shape = ()) -> Any:
    """Return a number, or lists in lists of the lengths `shape`, times `scale`; raises InputError for another shape, and beyond `span`."""
    if shape:
        if not isinstance(value, list) or shape[0] not in (-1, len(value)):
            raise InputError(where, shown(value), _listed(shape))
        found = tuple(_numbers(part, span, scale, where, shape[1:]) for part in value)
        if len(shape) > 1 and len({len(row) for row in found}) > 1:
            raise InputError(where, shown(value), "rows of one length")
        return found
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= HUGE:
        raise InputError(where, shown(value), "a finite number")
    if not span[0] <= value <= span[1]:
        raise InputError(where, shown(value), _bounded(span))
    return float(value) * scale


def _listed(shape: Shape) -> str:
    count = "" if shape[0] < 0 else f"{shape[0]} "
    if len(shape) == 1:
        return f"a list of {count}numbers"
    return f"a list of {count}rows of numbers" if shape[1] < 0 else f"a list of {count}rows of {shape[1]} numbers"


def _bounded(span: Span) -> str:
    """Return bounds in words."""
    low, high = span
    if high < HUGE:
        return f"{low:g} to {high:g}"
    return "above 0" if low == TINY else f"{low:g} or more"
