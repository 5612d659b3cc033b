"""A new vehicle file for a log, and what a vehicle file says, for a person to check."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.data.records import KINDS, AcousticRange, Dvl
from leadline.data.sensor_keys import BY_KIND, COMMON
from leadline.data.vehicle import mounting_deg, presets

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from leadline.data.log import Log
    from leadline.data.records import Table
    from leadline.data.vehicle import SensorConfig, Vehicle

HEAD = """\
# Vehicle file of Leadline: which instruments are aboard, where, and how well they measure.
# One table [sensors.NAME] per instrument; NAME is the name of its table in the log.  Each key ends in its unit.
# A preset fills in data-sheet figures; what stands here itself comes before them.  Lever arms and mountings are yours to measure.
# The figures below are of a middle class of instrument: put your own.  `leadline vehicle check FILE` says what is understood.
"""
THRUSTERS = "is input of the process models dynamics and cruise with a hull, and of no other"
NO_IMU = "# This log has no imu table; the process model `inertial` needs one.\n"
PROCESS = """\
[process]
model = "inertial"              # strapdown navigation, driven by the IMU named next
imu = {imu}
# clones = 1                    # past poses held at once; two-way ranges need one each
"""
SHARED: Mapping[str, str] = {  # by a kind that needs it: what is no instrument's own
    "altimeter": """\
[seabed]
depth = { value_m = 50.0, sigma_m = 100.0, tau_s = 600.0, steady_m = 20.0, length_m = 200.0 }  # of the sea bed below the vehicle
""",
    "water": """\
[water]
current = { sigma_mps = 0.3, tau_s = 3600.0, length_m = 2000.0 }  # north and east
""",
}
AGAINST_WATER = ("water_velocity", "speed")
EXPLAINED: Mapping[str, str] = {
    "kind": "what it measures",
    "preset": "instead of the figures below (delete them): {presets}",
    "lever_arm_m": "from the body origin: forward, right, down",
    "mounting_deg": "roll, pitch, heading of the sensor in the body",
    "rate_hz": "rows per second{of_the_log}",
    "latency_s": "how much too late its times are",
    "repeats": "when equal values at new times are one measurement, held",
    "gate_probability": "a good measurement is accepted so often",
}
# Per kind: key, value and, in a line, what it means.  A key that begins with # is an offer; ## is one instead of a line above.
FIGURES: Mapping[str, tuple[tuple[str, str, str], ...]] = {
    "imu": (
        ("gyro_noise_deg_per_rth", "0.15", "angle random walk"),
        ("gyro_bias_deg_per_h", "10.0", "sigma of the bias at turn-on"),
        ("gyro_bias_instability_deg_per_h", "0.5", "sigma of what the bias wanders by"),
        ("gyro_bias_tau_s", "1000.0", "correlation time of that"),
        ("accel_noise_ug_per_rthz", "120.0", "white noise of the accelerometers"),
        ("accel_bias_ug", "1500.0", "sigma of the bias at turn-on"),
        ("accel_bias_instability_ug", "50.0", "sigma of what the bias wanders by"),
        ("accel_bias_tau_s", "1000.0", "correlation time of that"),
        ("#gap_s", "0.25", "a longer interval is a gap; without it 2.5 intervals of rate_hz"),
    ),
    "dvl": (
        ("sigma_mps", "0.01", "of one axis, one ping, where the row gives none"),
        ("#frame", '"sensor"', "of its velocities: sensor, body, level, ned"),
        ("#use", '"velocity"', "or beams, each judged by itself; then give the two below"),
        ("#beam_azimuth_deg", "[45.0, 135.0, 225.0, 315.0]", "of beam 1, 2, ...: from x towards y"),
        ("#beam_tilt_deg", "25.0", "of the beams, off the z axis"),
        ("speed_max_mps", "10.0", "what is faster is out of range"),
        ("nuisance.scale", "{ sigma_percent = 0.5 }", "constant scale error: sound speed and factory"),
        ("nuisance.mounting", "{ sigma_deg = 0.5 }", "what is left of the mounting error, per axis"),
        ("#nuisance.bias", "{ sigma_mps = 0.005, tau_s = 60.0 }", "an error that wanders, where innovations are correlated in time"),
        ("#altitude_sigma_m", "0.5", "of its altitude, to use it; [seabed] then says what is known of the depth"),
    ),
    "water_velocity": (
        ("sigma_mps", "0.02", "of one axis, one ping, where the row gives none"),
        ("#frame", '"sensor"', "of its velocities: sensor, body, level, ned"),
        ("#use", '"velocity"', "or beams, each judged by itself; then give the two below"),
        ("#beam_azimuth_deg", "[45.0, 135.0, 225.0, 315.0]", "of beam 1, 2, ...: from x towards y"),
        ("#beam_tilt_deg", "25.0", "of the beams, off the z axis"),
        ("nuisance.scale", "{ sigma_percent = 0.5 }", "constant scale error: sound speed and factory"),
    ),
    "speed": (
        ("sigma_mps", "0.1", "of one reading"),
        ("nuisance.scale", "{ sigma_percent = 10.0 }", "true speed = (1 + scale) times the measured one"),
        ("#nuisance.bias", "{ sigma_mps = 0.05 }", "constant error of the speed"),
    ),
    "depth": (
        ("sigma_m", "0.05", "of one reading"),
        ("nuisance.datum", "{ sigma_m = 0.1 }", "constant error: air pressure, calibration"),
    ),
    "pressure": (
        ("sigma_pa", "200.0", "of one reading"),
        ("#density_kgpm3", "1025.0", "of the water; without it that of the standard ocean at its depth"),
        ("#gravity_mps2", "9.81", "without it by the latitude"),
        ("atmosphere_pa", "101325.0", "where the row gives none"),
        ("nuisance.datum", "{ sigma_m = 0.2 }", "constant error: air pressure, calibration"),
        ("#nuisance.scale", "{ sigma_percent = 0.3 }", "constant error of the density"),
    ),
    "altimeter": (
        ("sigma_m", "0.2", "of one distance, where the row gives none: also the roughness of the sea bed"),
        ("#range_max_m", "100.0", "what is farther is out of range"),
        ("#nuisance.bias", "{ sigma_m = 0.1 }", "constant error of the distance"),
    ),
    "yaw_rate": (
        ("noise_deg_per_rth", "0.1", "angle random walk"),
        ("#earth_rate", '"removed"', "where the instrument takes the Earth's rate off itself"),
        ("nuisance.bias", "{ sigma_deg_per_h = 10.0 }", "constant error of the rate"),
    ),
    "navigation": (
        ("use", '"none"', "or increments: how far it went between two rows, never where it is"),
        ("#increment_s", "10.0", "length of an increment"),
        ("#sigma_rate_m_per_rts", "0.1", "sigma of an increment, per root second"),
        ("#sigma_distance_percent", "1.0", "and as a share of the distance"),
        ("#nuisance.scale", "{ sigma_percent = 1.0 }", "its distances = (1 + scale) times the true ones"),
        ("#nuisance.rotation", "{ sigma_deg = 2.0 }", "its displacements are turned by so much, clockwise"),
    ),
    "heading": (
        ("sigma_deg", "1.0", "of one reading"),
        ("#reference", '"magnetic"', "then give the declination, or the model of the field"),
        ("#declination_deg", "0.0", "added to a magnetic heading, positive east"),
        ("##declination", '"wmm"', "instead: by the World Magnetic Model, at the log's epoch and origin"),
        ("#nuisance.swing", "{ sigma_deg = 3.0 }", "deviation over the heading: sine, cosine, and those of twice the heading"),
        ("nuisance.bias", "{ sigma_deg = 2.0 }", "constant error: mounting and, of a compass, the vehicle's iron"),
    ),
    "attitude": (
        ("sigma_tilt_deg", "0.5", "of roll and pitch, one reading"),
        ("sigma_deg", "1.0", "of heading, one reading"),
        ("#reference", '"magnetic"', "then give the declination, or the model of the field"),
        ("#declination_deg", "0.0", "added to a magnetic heading, positive east"),
        ("##declination", '"wmm"', "instead: by the World Magnetic Model, at the log's epoch and origin"),
        ("nuisance.bias", "{ sigma_deg = [0.3, 0.3, 2.0] }", "constant errors of roll, pitch, heading"),
        ("##nuisance.bias", "{ sigma_deg = [0.3, 0.3, 1.0], tau_s = 300.0 }", "instead: errors that wander, as of an AHRS"),
    ),
    "gnss": (
        ("sigma_m", "2.0", "of north and east, where the row gives none"),
        ("vertical", "false", "whether its height is used"),
        ("#sigma_vertical_m", "4.0", "of the height"),
        ("#sigma_velocity_mps", "0.1", "of its velocity, where the row gives none; without any it is not used"),
        ("#sigma_per_hdop_m", "1.5", "where the row gives an hdop and no sigma"),
        ("#surface_depth_m", "0.5", "a fix of an antenna that must be deeper is out of range"),
    ),
    "position_fix": (
        ("sigma_m", "2.0", "of north and east, where the row gives none"),
        ("vertical", "true", "whether its depth is used, if it has one"),
        ("#sigma_depth_m", "2.0", "of the depth"),
        ("#nuisance.bias", "{ sigma_m = 2.0, tau_s = 120.0 }", "error that neighbouring fixes share"),
    ),
    "zero_velocity": (("sigma_mps", "0.01", "of standing still, where the row gives none"),),
    "acoustic_range": (
        ("sigma_m", "0.3", "of one distance, where the row gives none"),
        ("path", '"{path}"', "one_way or two_way, where the row does not say"),
        ("sound_speed_mps", "1500.0", "turns a travel time into a distance"),
        ("range_max_m", "5000.0", "what is farther is out of range"),
        ("nuisance.scale", "{ sigma_percent = 0.5 }", "constant error of the sound speed"),
        ("#nuisance.bias", "{ sigma_m = 0.1 }", "constant error of the distance: clocks, delays"),
    ),
}  # fmt: skip
ONE_SIDE = {"truth": "read by assessment alone: it needs no sensor"}
RATE_MATTERS = 0.2  # a stated rate may be so far from that of the log


@dataclass(frozen=True)
class Entry:
    """One table as the template sees it: rate in 1/s, nan when unknown."""

    name: str
    kind: str
    rate: float = math.nan
    path: str = "two_way"


EXAMPLE = (
    Entry("imu", "imu", 100.0), Entry("dvl", "dvl", 5.0), Entry("depth", "depth", 10.0), Entry("heading", "heading", 10.0),
    Entry("attitude", "attitude", 50.0), Entry("gnss", "gnss", 1.0), Entry("usbl", "position_fix", 0.1),
    Entry("ranges", "acoustic_range", 0.2), Entry("standstill", "zero_velocity"), Entry("magnetometer", "magnetometer", 50.0),
    Entry("yaw_rate", "yaw_rate", 100.0), Entry("speed", "speed", 1.0), Entry("water_velocity", "water_velocity", 5.0),
    Entry("altimeter", "altimeter", 5.0), Entry("pressure", "pressure", 5.0), Entry("navigation", "navigation", 1.0),
)  # fmt: skip


def template(log: Log | None = None) -> str:
    """Return the text of a new vehicle file: each table of the log as a sensor; without a log, one of each kind as an example.

    What no model uses yet is commented out.  A log without an IMU gives a file that has to be completed first, and says so.
    """
    entries = EXAMPLE if log is None else tuple(_entry(name, table) for name, table in log.tables.items())
    imus = [entry.name for entry in entries if entry.kind == "imu"]
    name = "my-vehicle" if log is None else log.vehicle or log.name
    process = PROCESS.format(imu=f"{_text(imus[0]) if imus else _text('imu'):<26}# the name of its table")
    if not imus:
        process += "# The log has no table of kind imu: record one, and name it here.\n"
    kinds = {entry.kind for entry in entries} | ({"water"} if any(entry.kind in AGAINST_WATER for entry in entries) else set())
    blocks = [_block(entry, log is not None) for entry in entries] + [text for kind, text in SHARED.items() if kind in kinds]
    return "\n".join([HEAD if imus else NO_IMU + HEAD, f"name = {_text(name)}\n", process, *blocks])


def _entry(name: str, table: Table) -> Entry:
    path = "two_way"
    if isinstance(table, AcousticRange) and table.path is not None and len(table):
        path = "one_way" if (table.path == "one_way").mean() > 0.5 else "two_way"
    return Entry(name, table.kind, rate_of(table), path)


def rate_of(table: Table) -> float:
    """Return rows with different times per second, by the median interval, to three digits; nan for fewer than three."""
    times = np.unique(table.time[np.isfinite(table.time)])
    return float(f"{1.0 / np.median(np.diff(times)):.3g}") if len(times) > 2 else math.nan


def _block(entry: Entry, from_log: bool) -> str:
    """One table [sensors.NAME], commented out where no model uses its kind yet."""
    key = entry.name if re.fullmatch(r"[A-Za-z0-9_-]+", entry.name) else _text(entry.name)
    if entry.kind in ONE_SIDE:
        return f"# {key}: {ONE_SIDE[entry.kind]}.\n"
    known = entry.kind in FIGURES and entry.kind in BY_KIND
    lines = [f"[sensors.{key}]", *_common(entry, from_log), *(_line(k, v.replace("{path}", entry.path), c) for k, v, c in _figures(entry))]
    if known:
        return "\n".join(lines) + "\n"
    reason = "no model uses this kind yet" if entry.kind in KINDS else "of no kind that Leadline knows: name a model of your own"
    return "\n".join([f"# {key}: {reason}.", *(line if line.startswith("#") else f"# {line}" for line in lines)]) + "\n"


def _figures(entry: Entry) -> tuple[tuple[str, str, str], ...]:
    own = (("#model", '"package.module:function"', "your own sensor model"),)
    return FIGURES.get(entry.kind, own if entry.kind not in KINDS else ())


def _common(entry: Entry, from_log: bool) -> Iterator[str]:
    yield _line("kind", _text(entry.kind), EXPLAINED["kind"])
    names = [name for name, kinds in presets().items() if isinstance(kinds.get(entry.kind), dict)]
    if names:
        yield _line("#preset", _text(names[0]), EXPLAINED["preset"].format(presets=", ".join(names)))
    yield _line("lever_arm_m", "[0.0, 0.0, 0.0]", EXPLAINED["lever_arm_m"])
    yield _line("mounting_deg", "[0.0, 0.0, 0.0]", EXPLAINED["mounting_deg"])
    if math.isfinite(entry.rate):
        yield _line("rate_hz", str(entry.rate), EXPLAINED["rate_hz"].format(of_the_log=", of the log" if from_log else ""))
    yield _line("#latency_s", "0.0", EXPLAINED["latency_s"])
    if entry.kind != "imu":
        yield _line("#repeats", '"held"', EXPLAINED["repeats"])
        yield _line("#gate_probability", "0.999", EXPLAINED["gate_probability"])


def _line(key: str, value: str, comment: str) -> str:
    setting = f"# {key.lstrip('#')} = {value}" if key.startswith("#") else f"{key} = {value}"
    return f"{setting:<48} # {comment}"


def _text(value: str) -> str:
    """A string as TOML writes it."""
    return json.dumps(value, ensure_ascii=False)


@dataclass(frozen=True)
class Description:
    """What a vehicle file says of one sensor, in its own units, for a person."""

    name: str
    kind: str
    preset: str
    lever_arm: str
    mounting: str
    figures: tuple[str, ...]
    nuisances: tuple[str, ...]
    used: str  # empty, or why no model looks at it


def describe(sensor: SensorConfig) -> Description:
    """Return what is understood of a sensor."""
    roll, pitch, heading = (float(f"{angle:.6g}") + 0.0 for angle in np.round(mounting_deg(sensor.rotation_bs), 6))
    carried = sensor.model is None and sensor.kind not in BY_KIND
    figures = [f"{key} = {_shown(value)}" for key, value in sensor.written.items() if key not in COMMON]
    chosen = [
        f"{key} = {_shown(sensor.written[key])}"
        for key in ("latency_s", "clock", "mend_clock", "repeats", "model")
        if key in sensor.written
    ]
    priors = sensor.written.get("nuisance", {})
    return Description(
        sensor.name,
        sensor.kind,
        sensor.preset or "",
        "forward {:g}, right {:g}, down {:g} m".format(*sensor.lever_arm_b),
        f"roll {roll:g}, pitch {pitch:g}, heading {heading:g} deg",
        tuple(figures + chosen),
        tuple(f"{name}: {', '.join(f'{k} = {_shown(v)}' for k, v in keys.items())}" for name, keys in priors.items()),
        (THRUSTERS if sensor.kind == "thruster" else f"no model uses kind '{sensor.kind}' yet") if carried else "",
    )


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(map(_shown, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, (int, float)) else str(value)


def check(vehicle: Vehicle, log: Log | None = None) -> list[str]:
    """Return what is understood of a vehicle, a line per sensor, and then what a person should look at (`notes`)."""
    driven = f", driven by {vehicle.process.imu}" if vehicle.process.model in ("inertial", "body-velocity") else ""
    lines = [f"{vehicle.name}: process model {vehicle.process.model}{driven}"]
    for sensor in map(describe, vehicle.sensors.values()):
        parts = [f"{sensor.name}: {sensor.kind}", f"preset {sensor.preset}" if sensor.preset else "", f"at {sensor.lever_arm}"]
        parts += [sensor.mounting, *sensor.figures, *(f"nuisance {nuisance}" for nuisance in sensor.nuisances)]
        lines.append("; ".join(part for part in parts if part))
    return lines + notes(vehicle, log)


def notes(vehicle: Vehicle, log: Log | None = None) -> list[str]:
    """Return what a person should look at: sensors that nothing uses and, with a log, what one has and the other lacks."""
    found = [f"{s.name}: {s.used}; it is carried" for s in map(describe, vehicle.sensors.values()) if s.used]
    for name, sensor in vehicle.sensors.items():
        if sensor.kind == "imu" and vehicle.process.model in ("inertial", "body-velocity") and name != vehicle.process.imu:
            found.append(f"{name}: a further IMU; the process model is driven by {vehicle.process.imu} alone")
        if sensor.values.get("reference") == "magnetic" and sensor.values.get("declination") is None:
            found.append(f"{name}: its heading is magnetic and it has no declination")
    if log is None:
        return found
    found += [f"{name}: in the vehicle, but the log has no such table" for name in vehicle.sensors if name not in log.tables]
    for name, table in log.tables.items():
        if name in vehicle.sensors:
            found += [f"{name}: {what}" for what in _against(vehicle.sensors[name], table)]
        elif table.kind not in ONE_SIDE:
            found.append(f"{name}: a table of kind {table.kind} in the log that the vehicle does not name; it will not be used")
    return found


def _against(sensor: SensorConfig, table: Table) -> Iterator[str]:
    """Say where a sensor and its table differ."""
    if sensor.kind != table.kind and sensor.model is None:
        yield f"kind {sensor.kind} in the vehicle, {table.kind} in the log"
        return
    stated, rate = sensor.values.get("rate"), rate_of(table)
    if stated is not None and abs(rate / stated - 1.0) > RATE_MATTERS:
        gaps = "; every interval would be a gap" if sensor.kind == "imu" and sensor.values.get("gap", 2.5 / stated) < 1.0 / rate else ""
        yield f"rate_hz = {stated:g}, but the log has {rate:g} rows per second{gaps}"
    if isinstance(table, Dvl) and table.kind == "dvl" and table.beam is None and sensor.values.get("use") == "beams":
        yield "use = beams, but the log has none"
