"""The vehicle file: which instruments are aboard, where and how well they measure.  TOML in human units, converted once, here.

Each key ends in its unit (`sigma_mps`, `lever_arm_m`, `gyro_noise_deg_per_rth`); inside, the suffix is gone and the value is SI.
A sensor is keyed by its instance name, which is the name of its table in the log.  `preset` fills in the data-sheet figures of an
instrument (data/presets.toml); what the file says itself comes before them, key by key, and nuisance by nuisance.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core import attitude
from leadline.data.errors import InputError, suggestion
from leadline.data.process_config import ProcessConfig, known_model, process_of
from leadline.data.records import KINDS, UNITS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from leadline.data.records import Array

MICRO_G = 9.80665e-6
DEGREE = UNITS["deg"]
HUMAN_UNITS: Mapping[str, float] = {
    **UNITS,
    "degps": DEGREE, "deg_per_h": DEGREE / 3600, "deg_per_rth": DEGREE / 60, "deg_per_rts": DEGREE, "degps_per_rthz": DEGREE,
    "ug": MICRO_G, "ug_per_rthz": MICRO_G, "mps2_per_rthz": 1.0, "mps_per_rth": 1 / 60, "mps_per_rts": 1.0, "m_per_rts": 1.0,
    "percent": 0.01, "percent_per_rts": 0.01, "ppm": 1e-6, "ppm_per_rts": 1e-6, "hz": 1.0, "h": 3600.0,
    "deg_per_h_per_rts": DEGREE / 3600, "s_per_rts": 1.0, "kgpm3": 1.0, "degps_per_rts": DEGREE, "mps2_per_rts": 1.0, "n": 1.0,
    "n_per_rts": 1.0,
}  # fmt: skip


@dataclass(frozen=True)
class Prior:
    """What is known of one nuisance before the dive: value, sigma of it, and how it wanders (SI); scalar or one per axis."""

    value: Array
    sigma: Array
    tau: float = np.inf
    length: float = np.inf  # distance travelled over which it changes (m)
    estimate: bool = True  # False: a constant for the filter, and a source of the error budget
    steady: float | None = None  # sigma that a Gauss-Markov process settles at; None: the largest prior sigma
    walk: float = 0.0


@dataclass(frozen=True)
class Gate:
    """How a sensor's measurements are judged.

    probability: of a good measurement to pass.  student_dof: with it the noise is Student's t, and outliers count less instead of
    being turned away.  widening: the gate doubles in sigma for each such time (s) without an acceptance.  reanchor_after: so many
    rejections in a row say that the estimate is wrong and not the sensor.
    """

    probability: float = 0.999
    student_dof: float | None = None
    widening: float | None = None
    reanchor_after: int | None = None


@dataclass(frozen=True)
class SensorConfig:
    """One instrument as mounted: SI and radians.

    lever_arm_b (3,) from the body origin; rotation_bs (3, 3) sensor to body; values: the instrument's figures by name without
    unit suffix; nuisance: priors by name; written: what file and preset say, in the units of the file, for a person to read.
    """

    name: str
    kind: str
    lever_arm_b: Array = field(default_factory=lambda: np.zeros(3))
    rotation_bs: Array = field(default_factory=lambda: np.eye(3))
    gate: Gate = Gate()
    latency: float = 0.0
    every: float = 0.0  # s between rows that are used: what comes sooner is decimated
    standby_for: str | None = None  # used only while that sensor has been silent for `standby_after` (s)
    standby_after: float = 2.0
    clock: str | None = None
    mend_clock: bool = True  # stamps after a step of its clock are put right, where times of arrival show it
    repeats: str = "new"
    model: str | None = None
    values: Mapping[str, Any] = field(default_factory=dict)
    nuisance: Mapping[str, Prior] = field(default_factory=dict)
    preset: str | None = None
    written: Mapping[str, Any] = field(default_factory=dict)

    def value(self, name: str, default: Any = None) -> Any:
        """Return a figure of the instrument; raises InputError where it is neither given nor has a default."""
        found = self.values.get(name, default)
        if found is None:
            raise InputError(f"sensors.{self.name}", f"has no {name}", "give it, or a preset that does")
        return found


@dataclass(frozen=True)
class Vehicle:
    """A vehicle: process model and instruments by instance name."""

    name: str
    sensors: Mapping[str, SensorConfig]
    process: ProcessConfig = field(default_factory=ProcessConfig)
    path: Path | None = None
    excluded: frozenset[str] = frozenset()  # instruments that were left out on request
    shared: Mapping[str, Prior] = field(default_factory=dict)  # of no one instrument: water.current, seabed.depth, clocks.NAME.offset
    points: Mapping[str, Array] = field(default_factory=dict)  # named points (3,) from the body origin (m)

    def __getitem__(self, name: str) -> SensorConfig:
        """Return an instrument; raises InputError when the vehicle lacks it."""
        if name not in self.sensors:
            raise InputError(self.path or self.name, f"has no sensor '{name}'", suggestion(name, self.sensors))
        return self.sensors[name]

    def only(self, *names: str) -> Vehicle:
        """Return the vehicle with the named instruments alone."""
        for name in names:
            self[name]
        return self.without(*(name for name in self.sensors if name not in names))

    def moved_by(self, model: str) -> Vehicle:
        """Return the vehicle with another process model; raises InputError for one that is not known."""
        return replace(self, process=replace(self.process, model=known_model(model, "process")))

    def without(self, *names: str) -> Vehicle:
        """Return the vehicle without the named instruments."""
        for name in names:
            self[name]
        kept = {k: v for k, v in self.sensors.items() if k not in names}
        standby = None if self.process.standby in names else self.process.standby
        return replace(self, sensors=kept, excluded=self.excluded | set(names), process=replace(self.process, standby=standby))


def read_vehicle(path: str | Path, *fragments: str | Path, over: Mapping[str, Any] | None = None) -> Vehicle:
    """Read a vehicle file; `fragments` are files of the same form that come before it, key by key, as calibration and tuning write them.

    over: keys as such a file has them, which come before all.
    Raises InputError, naming file, key and value, for a missing file, wrong TOML, an unknown key or preset, a value of the wrong
    type or outside its range, and a mounting that is no rotation.
    """
    texts = [_text(Path(p)) for p in (path, *fragments)]
    raw = _toml(texts[0], str(path))
    for place, text in zip(fragments, texts[1:], strict=True):
        raw = _over(raw, _toml(text, str(place)))
    return _vehicle(_over(raw, over or {}), Path(path), " with ".join(map(str, (path, *fragments))))


def _text(path: Path) -> str:
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "give a vehicle file; `leadline vehicle new` writes one") from error
    except UnicodeDecodeError as error:
        raise InputError(path, f"is not text in UTF-8 (byte {error.start})", "give a vehicle file in TOML") from error
    return text


def _over(raw: Mapping[str, Any], more: Mapping[str, Any], within: str = "") -> dict[str, Any]:
    """Put the keys of `more` over those of `raw`; tables are merged, but for priors, which are taken whole.  within: name of the table."""
    merged = dict(raw)
    for key, value in more.items():
        known = merged.get(key)
        prior = isinstance(value, dict) and within != "sensors" and any(part.startswith(("value_", "sigma_")) for part in value)
        merged[key] = _over(known, value, key) if isinstance(value, dict) and isinstance(known, dict) and not prior else value
    return merged


def _toml(text: str, where: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise _syntax(text, where, str(error)) from error


def vehicle_from_toml(text: str, path: Path | None = None) -> Vehicle:
    """Make a vehicle of the text of a vehicle file; raises as `read_vehicle`."""
    return _vehicle(_toml(text, str(path or "vehicle")), path)


def _vehicle(raw: dict[str, Any], path: Path | None, where: str | None = None) -> Vehicle:
    from leadline.data import vehicle_keys

    where = where or str(path or "vehicle")
    top = vehicle_keys.check_top(raw, where)
    sensors = {name: _sensor(name, keys, f"{where}: sensors.{name}") for name, keys in top.sensors.items()}
    imus = [name for name, sensor in sensors.items() if sensor.kind == "imu"]
    if top.process.model in ("inertial", "body-velocity") and top.process.imu not in imus:
        right = suggestion(top.process.imu, imus) or f"add one: the process model '{top.process.model}' is driven by it"
        raise InputError(f"{where}: process.imu", f"'{top.process.imu}' is no sensor of kind imu", right)
    if top.process.standby is not None and (top.process.standby not in imus or top.process.standby == top.process.imu):
        others = [name for name in imus if name != top.process.imu]
        raise InputError(f"{where}: process.standby", f"'{top.process.standby}' is no other sensor of kind imu", suggestion("", others))
    _check_references(sensors, top.clocks, where)
    _check_driving(top, where)
    process = process_of(top.process, where)
    points = {name: np.array(point.lever_arm_m, float) for name, point in top.points.items()}
    return Vehicle(top.name, sensors, process, path, shared=_shared(top, where), points=points)


def _check_driving(top: Any, where: str) -> None:
    """Refuse how an inertial unit is to be judged, where it drives the process model and is not."""
    if top.process.model not in ("inertial", "body-velocity"):
        return
    for name in filter(None, (top.process.imu, top.process.standby)):
        for key in ("student_dof", "gate_widening_s", "reanchor_after", "every_s"):
            if key in top.sensors[name]:
                found = f"{top.sensors[name][key]!r} would do nothing: it drives the process model, and is not judged"
                raise InputError(f"{where}: sensors.{name}.{key}", found, "take it out")


def _check_references(sensors: Mapping[str, SensorConfig], clocks: Mapping[str, Any], where: str) -> None:
    """Refuse a sensor that stands in for one that is not there."""
    for name, config in sensors.items():
        if config.standby_for is not None and (config.standby_for not in sensors or config.standby_for == name):
            others = [other for other in sensors if other != name]
            where_key = f"{where}: sensors.{name}.standby_for"
            raise InputError(where_key, f"'{config.standby_for}' is no other sensor", suggestion(config.standby_for, others))
    used = {config.clock for config in sensors.values() if config.clock is not None}
    for clock in clocks:
        if clock not in used:
            raise InputError(f"{where}: clocks.{clock}", "is the clock of no sensor", f'give a sensor clock = "{clock}"')


def _shared(top: Any, where: str) -> dict[str, Prior]:
    """Return the priors of what is no instrument's own, by table and name."""
    from leadline.data import vehicle_keys

    tables = {"water": top.water, "seabed": top.seabed, **{f"clocks.{name}": keys for name, keys in top.clocks.items()}}
    found = {}
    for table, keys in tables.items():
        for name, value in keys.items():
            spec = vehicle_keys.shared_of(table.partition(".")[0], name, f"{where}: {table}")
            found[f"{table}.{name}"] = prior_of(spec, value, f"{where}: {table}.{name}")
    return found


def _syntax(text: str, where: str, message: str) -> InputError:
    """Say which line is no TOML, and show it."""
    place = re.search(r" \(at line (\d+), column (\d+)\)", message)
    if place is None:
        return InputError(where, f"is not TOML: {message[:1].lower()}{message[1:]}")
    lines = text.splitlines()
    line = lines[int(place[1]) - 1].strip() if int(place[1]) <= len(lines) else ""
    problem = message.replace(place[0], "")
    return InputError(f"{where}: line {place[1]}, column {place[2]}", f"{line[:60]!r} is not TOML", f"{problem[:1].lower()}{problem[1:]}")


def _sensor(name: str, given: Any, where: str) -> SensorConfig:
    from leadline.data import sensor_keys, vehicle_keys

    keys = vehicle_keys.check_head(given, where)
    kind = keys.get("kind", name if name in KINDS else None) or _kind_of_preset(keys.get("preset"), where)
    vehicle_keys.check_kind(kind, keys.get("model"), where)
    _check_idle(keys, kind, where)
    filled = _merged(_preset(keys.get("preset"), kind, where), keys)
    checked = vehicle_keys.check_sensor(filled, kind, where)
    common = {k: checked[k] for k in ("clock", "mend_clock", "repeats", "model", "preset", "standby_for") if checked.get(k) is not None}
    names = ("gate_probability", "student_dof", "gate_widening_s", "reanchor_after")
    return SensorConfig(
        name=name,
        kind=kind,
        lever_arm_b=np.array(checked["lever_arm_m"], float),
        rotation_bs=_rotation(checked, where),
        gate=Gate(*(checked[name] for name in names)),
        latency=checked["latency_s"],
        every=checked["every_s"] or 0.0,
        standby_after=checked["standby_after_s"],
        values=dict(si(key, value) for key, value in checked.items() if key not in sensor_keys.COMMON and value is not None),
        nuisance={key: _prior(kind, key, value, where) for key, value in checked["nuisance"].items()},
        written=filled,
        **common,
    )


def _check_idle(keys: Mapping[str, Any], kind: str, where: str) -> None:
    """Refuse keys that would do nothing."""
    idle: tuple[str, ...] = ("standby_for", "clock", "repeats") if kind == "imu" else ()
    why = "an inertial unit is no such sensor"
    if "student_dof" in keys:
        idle, why = ("gate_probability", "gate_widening_s", "reanchor_after"), "with student_dof no row is turned away"
    for key in idle:
        if key in keys:
            raise InputError(f"{where}.{key}", f"{keys[key]!r} would do nothing: {why}", "take it out")


def _merged(preset: Mapping[str, Any], keys: Mapping[str, Any]) -> dict[str, Any]:
    """Put the file's keys before the preset's; of the nuisances each by itself, so that naming one keeps the others.

    A phased array has a scale only where the file itself says so.
    """
    merged = {**preset, **keys}
    if "nuisance" in merged:
        own = dict(preset.get("nuisance", {}))
        if merged.get("phased_array") is True:  # its horizontal velocities do not depend on the sound speed
            own.pop("scale", None)
        merged["nuisance"] = {**own, **keys.get("nuisance", {})}
    return merged


def si(key: str, value: Any) -> tuple[str, Any]:
    """Return a key without its unit suffix and its value in SI; keys without unit, and what is no number, stay as they are."""
    if not _numeric(value):
        return key, value
    for size in (5, 4, 3, 2, 1):
        parts = key.split("_")
        suffix = "_".join(parts[-size:])
        if len(parts) > size and suffix in HUMAN_UNITS:
            return "_".join(parts[:-size]), _times(value, HUMAN_UNITS[suffix])
    return key, value


def _numeric(value: Any) -> bool:
    if isinstance(value, list):
        return all(_numeric(item) for item in value)
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _times(value: Any, factor: float) -> Any:
    return [_times(item, factor) for item in value] if isinstance(value, list) else value * factor


def mounting_deg(rotation_bs: Array) -> Array:
    """Return roll, pitch and heading of a sensor in the body (deg), as `mounting_deg` writes them."""
    angles = attitude.euler_from_quaternion(attitude.quaternion_from_matrix(rotation_bs))
    return np.array(angles, float) / DEGREE


def _rotation(keys: Mapping[str, Any], where: str) -> Array:
    """Return sensor -> body from `mounting_deg` (roll, pitch, heading) or `mounting_matrix`.

    A matrix written with three decimals or more is taken as the rotation nearest to it.
    """
    if keys.get("mounting_matrix") is None:
        return attitude.matrix_from_euler(*np.radians(keys["mounting_deg"]))
    matrix = np.array(keys["mounting_matrix"], float)
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > 2e-3 or np.linalg.det(matrix) < 0:
        raise InputError(
            f"{where}.mounting_matrix", f"{keys['mounting_matrix']} is no rotation", "three orthogonal unit rows, right-handed"
        )
    u, _, vt = np.linalg.svd(matrix)
    nearest: Array = u @ vt
    return nearest


def _prior(kind: str, name: str, keys: Mapping[str, Any], where: str) -> Prior:
    from leadline.data import vehicle_keys

    return prior_of(vehicle_keys.nuisance_of(kind, name, where), keys, f"{where}.nuisance.{name}")


def prior_of(spec: Any, keys: Mapping[str, Any], where: str) -> Prior:
    """Return the prior that checked keys of a nuisance make."""
    from leadline.data import vehicle_keys

    checked = vehicle_keys.check_prior(keys, spec, where)
    found = dict(si(key, value) for key, value in checked.items())
    shape = np.ones(spec.axes)
    return Prior(
        value=shape * found.get("value", 0.0),
        sigma=shape * found.get("sigma", 0.0),
        tau=found.get("tau", np.inf),
        length=found.get("length", np.inf),
        estimate=checked.get("estimate", True),
        steady=found.get("steady"),
        walk=found.get("walk", 0.0),
    )


@cache
def presets() -> Mapping[str, Mapping[str, Any]]:
    """Return the presets of instruments: name -> kind -> keys of a vehicle file, with `title` and `source`."""
    return tomllib.loads((Path(__file__).parent / "presets.toml").read_text(encoding="utf-8"))


def _preset(name: str | None, kind: str, where: str) -> Mapping[str, Any]:
    if name is None:
        return {}
    if name not in presets():
        raise InputError(f"{where}.preset", f"'{name}' is not known", suggestion(name, presets()))
    kinds = {k: v for k, v in presets()[name].items() if isinstance(v, dict)}
    if kind not in kinds:
        raise InputError(f"{where}.preset", f"'{name}' has no figures for kind '{kind}'", f"it has: {', '.join(sorted(kinds))}")
    return dict(kinds[kind])


def _kind_of_preset(name: str | None, where: str) -> str:
    if name is not None and name not in presets():
        raise InputError(f"{where}.preset", f"'{name}' is not known", suggestion(name, presets()))
    kinds = [k for k, v in presets().get(name or "", {}).items() if isinstance(v, dict)]
    if len(kinds) != 1:
        raise InputError(where, "has no 'kind'", f"add kind = one of {', '.join(kinds or KINDS)}")
    return kinds[0]
