"""Which keys a vehicle file may hold, with their types and ranges, in the human units in which they are written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from leadline.data.errors import InputError, suggestion
from leadline.data.records import KINDS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from pydantic_core import ErrorDetails

Model = TypeVar("Model", bound=BaseModel)
Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Probability = Annotated[float, Field(gt=0, lt=1)]
Vector = Annotated[list[Finite], Field(min_length=3, max_length=3)]


class Keys(BaseModel):
    """A table of a vehicle file: unknown keys are refused, nothing is converted silently."""

    model_config = ConfigDict(extra="forbid", strict=True)


class Process(Keys):
    """The table [process]: the inertial unit that drives the model, and the one that stands in while it is silent."""

    model: str = "inertial"
    imu: str = "imu"
    standby: str | None = None
    clones: Annotated[int, Field(ge=0, le=4)] | None = None
    align_s: Positive = 300.0
    aligned_sigma_heading_deg: Positive = 5.0


class Point(Keys):
    """A named point of the vehicle, at which states can be asked for."""

    lever_arm_m: Vector


class Top(Keys):
    """A whole vehicle file; what is not an instrument's own (water, sea bed, clocks) stands in tables of priors."""

    name: str
    process: Process = Process()
    sensors: dict[str, Any] = Field(min_length=1)
    water: dict[str, Any] = {}
    seabed: dict[str, Any] = {}
    clocks: dict[str, dict[str, Any]] = {}
    points: dict[str, Point] = {}


class Sensor(Keys):
    """What every sensor may say."""

    kind: str | None = None
    preset: str | None = None
    model: str | None = None
    lever_arm_m: Vector = [0.0, 0.0, 0.0]
    mounting_deg: Vector = [0.0, 0.0, 0.0]
    mounting_matrix: Annotated[list[Vector], Field(min_length=3, max_length=3)] | None = None
    gate_probability: Probability = 0.999
    student_dof: Positive | None = None
    gate_widening_s: Positive | None = None
    reanchor_after: Annotated[int, Field(ge=2)] | None = None
    every_s: Positive | None = None
    standby_for: str | None = None
    standby_after_s: Positive = 2.0
    latency_s: Finite = 0.0
    clock: str | None = None
    repeats: Literal["new", "held"] = "new"
    rate_hz: Positive | None = None
    nuisance: dict[str, Any] = {}


COMMON = frozenset(Sensor.model_fields) - {"rate_hz"}


class Imu(Sensor):
    """Noise as densities, biases as turn-on sigma and as the in-run instability that they wander by.

    A bias is a random constant that walks by its instability within tau, or (`gauss_markov`) a stationary process of its sigma and tau.
    """

    gyro_noise_deg_per_rth: NotNegative
    gyro_bias_deg_per_h: NotNegative
    gyro_bias_instability_deg_per_h: NotNegative = 0.0
    gyro_bias_tau_s: Positive = 3600.0
    gyro_bias_process: Literal["random_walk", "gauss_markov"] = "random_walk"
    accel_noise_ug_per_rthz: NotNegative
    accel_bias_ug: NotNegative
    accel_bias_instability_ug: NotNegative = 0.0
    accel_bias_tau_s: Positive = 3600.0
    accel_bias_process: Literal["random_walk", "gauss_markov"] = "random_walk"
    gap_s: Positive | None = None
    gap_accel_mps2_per_rthz: Positive = 0.3
    gap_rate_degps_per_rthz: Positive = 3.0


class Dvl(Sensor):
    """A Doppler log.  `use` says whether the vector or the single beams are taken."""

    sigma_mps: Positive
    use: Literal["velocity", "beams"] = "velocity"
    frame: Literal["sensor", "body", "level", "ned"] = "sensor"
    beam_azimuth_deg: list[Finite] | None = None
    beam_tilt_deg: Annotated[float, Field(gt=0, lt=90)] | None = None
    beam_sigma_mps: Positive | None = None
    phased_array: bool = False
    speed_max_mps: Positive = 10.0


class Depth(Sensor):
    """A depth sensor."""

    sigma_m: Positive


class Heading(Sensor):
    """A compass or gyrocompass; `declination_deg` is added to a magnetic heading."""

    sigma_deg: Positive
    reference: Literal["true", "magnetic"] = "true"
    declination_deg: Finite | None = None


class Attitude(Heading):
    """An attitude and heading reference: sigma of heading, and of roll and pitch."""

    sigma_tilt_deg: Positive


class Gnss(Sensor):
    """Satellite positions; the height is used only when asked for."""

    sigma_m: Positive
    vertical: bool = False
    sigma_vertical_m: Positive | None = None


class PositionFix(Sensor):
    """Positions solved elsewhere."""

    sigma_m: Positive
    sigma_depth_m: Positive | None = None
    vertical: bool = True


class ZeroVelocity(Sensor):
    """Moments of rest."""

    sigma_mps: Positive


class AcousticRange(Sensor):
    """Ranges to beacons; `range_max_m` says how long a two-way flight is awaited."""

    sigma_m: Positive
    sound_speed_mps: Positive = 1500.0
    range_max_m: Positive = 5000.0
    path: Literal["one_way", "two_way"] = "one_way"


class Carried(Sensor):
    """A sensor that no model of Leadline uses yet, or a user's own (`model`): any further key is handed to it."""

    model_config = ConfigDict(extra="allow", strict=True)


BY_KIND: Mapping[str, type[Sensor]] = {
    "imu": Imu, "dvl": Dvl, "depth": Depth, "heading": Heading, "attitude": Attitude, "gnss": Gnss, "position_fix": PositionFix,
    "zero_velocity": ZeroVelocity, "acoustic_range": AcousticRange,
}  # fmt: skip


@dataclass(frozen=True)
class NuisanceKeys:
    """One nuisance that a kind of sensor can have: unit of its keys, and number of axes."""

    unit: str
    axes: int = 1


OF_ALL: Mapping[str, NuisanceKeys] = {"time": NuisanceKeys("s"), "lever": NuisanceKeys("m", 3)}  # of every kind but the inertial unit
SHARED: Mapping[str, Mapping[str, NuisanceKeys]] = {
    "water": {"current": NuisanceKeys("mps", 2)},
    "seabed": {"depth": NuisanceKeys("m")},
    "clocks": {"offset": NuisanceKeys("s"), "drift": NuisanceKeys("ppm")},
}
NUISANCES: Mapping[str, Mapping[str, NuisanceKeys]] = {
    "imu": {
        "gyro_scale": NuisanceKeys("percent", 3),
        "accel_scale": NuisanceKeys("percent", 3),
        "gyro_misalignment": NuisanceKeys("deg", 6),
        "accel_misalignment": NuisanceKeys("deg", 6),
    },
    "dvl": {"scale": NuisanceKeys("percent"), "mounting": NuisanceKeys("deg", 3), "bias": NuisanceKeys("mps", 3)},
    "depth": {"datum": NuisanceKeys("m")},
    "heading": {"bias": NuisanceKeys("deg")},
    "attitude": {"bias": NuisanceKeys("deg", 3)},
    "acoustic_range": {"bias": NuisanceKeys("m"), "scale": NuisanceKeys("percent")},
}


def check_top(raw: Mapping[str, Any], where: str) -> Top:
    """Check the outermost table of a vehicle file."""
    return _checked(Top, raw, where)


def check_head(raw: Any, where: str) -> dict[str, Any]:
    """Check what must be known of a sensor before its kind is: that it is a table, and the types of the keys that choose."""
    if not isinstance(raw, dict):
        raise InputError(where, shown(raw), "a table of keys")
    for key in ("kind", "preset", "model"):
        if not isinstance(raw.get(key, ""), str):
            raise InputError(f"{where}.{key}", shown(raw[key]), RIGHT["string_type"])
    if not isinstance(raw.get("nuisance", {}), dict):
        raise InputError(f"{where}.nuisance", shown(raw["nuisance"]), "a table of priors by name")
    if "mounting_deg" in raw and "mounting_matrix" in raw:
        raise InputError(where, "has both 'mounting_deg' and 'mounting_matrix'", "give one of them")
    return dict(raw)


def check_kind(kind: str, model: str | None, where: str) -> None:
    """Refuse a kind that nobody knows."""
    if kind not in KINDS and model is None:
        raise InputError(f"{where}.kind", f"'{kind}' is not known", suggestion(kind, KINDS) + ", or give model = 'package.module:function'")


def check_sensor(raw: Mapping[str, Any], kind: str, where: str) -> dict[str, Any]:
    """Check the keys of one sensor; returns them with defaults filled in, still in human units."""
    keys = Carried if raw.get("model") else BY_KIND.get(kind, Carried)
    checked = _checked(keys, raw, where).model_dump()
    for key, value in checked.items():
        if _is_noise(key) and isinstance(value, (int, float)) and value < 0:
            raise InputError(f"{where}.{key}", shown(value), "0 or more")
    return checked


def _is_noise(key: str) -> bool:
    """A carried key is known by its name alone."""
    return key.startswith("sigma") or "noise" in key.split("_")


def nuisance_of(kind: str, name: str, where: str) -> NuisanceKeys:
    """Return what is known of a nuisance; raises InputError where the kind of sensor has none of that name."""
    known = {**NUISANCES.get(kind, {}), **({} if kind == "imu" else OF_ALL)}
    if name not in known:
        raise InputError(f"{where}.nuisance.{name}", f"is no nuisance of kind '{kind}'", suggestion(name, known) or "it has none")
    return known[name]


def shared_of(table: str, name: str, where: str) -> NuisanceKeys:
    """Return what is known of a nuisance that is no instrument's own; raises InputError where the table has none of that name."""
    known = SHARED[table]
    if name not in known:
        raise InputError(f"{where}.{name}", f"is nothing that [{table}] can hold", suggestion(name, known))
    return known[name]


def check_prior(raw: Any, spec: NuisanceKeys, where: str) -> dict[str, Any]:
    """Check the prior of one nuisance: value, sigma, tau, length, steady, walk, each with the unit of the nuisance.

    `estimate = false` keeps it a constant for the filter: its sigma counts in an error budget alone.
    """
    if not isinstance(raw, dict):
        raise InputError(where, shown(raw), f"a table such as {{ sigma_{spec.unit} = 1.0 }}")
    value, sigma = f"value_{spec.unit}", f"sigma_{spec.unit}"
    by_axis = {key for key in (value, sigma) if spec.axes > 1 and isinstance(raw.get(key), list)}
    length = Field(min_length=spec.axes, max_length=spec.axes)
    fields: dict[str, Any] = {
        value: (Annotated[list[Finite], length] if value in by_axis else Finite, None),
        sigma: (Annotated[list[NotNegative], length] if sigma in by_axis else NotNegative, None),
        "tau_s": (Positive, None),
        "length_m": (Positive, None),
        "estimate": (bool, None),
        f"steady_{spec.unit}": (NotNegative, None),
        f"walk_{spec.unit}_per_rts": (NotNegative, None),
    }
    model: type[BaseModel] = create_model("PriorKeys", __base__=Keys, **fields)
    return {key: value for key, value in _checked(model, raw, where).model_dump().items() if value is not None}


# What would be right, by the type of a complaint.
RIGHT: Mapping[str, str] = {
    "float_type": "a number", "int_type": "a whole number", "string_type": "a text in quotes", "bool_type": "true or false",
    "list_type": "a list of numbers", "dict_type": "tables of keys", "model_type": "a table of keys", "finite_number": "a finite number",
    "greater_than": "a number above {gt:g}", "greater_than_equal": "{ge:g} or more",
    "less_than": "a number below {lt:g}", "less_than_equal": "{le:g} or less",
    "too_short": "at least {min_length} of them", "too_long": "at most {max_length} of them", "literal_error": "{expected}",
}  # fmt: skip
MISSING: Mapping[str, str] = {"name": "give the vehicle a name", "sensors": "add a table [sensors.NAME] for each instrument"}


def shown(value: Any) -> str:
    """Return a value as one short line, for a message."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _checked(model: type[Model], raw: Mapping[str, Any], where: str) -> Model:
    """Validate, and turn the first complaint into one line that names key, value and what would be right."""
    try:
        return model.model_validate(dict(raw))
    except ValidationError as error:
        first = min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")  # a misspelt key explains a missing one
        raise _complaint(first, model, where) from error


def _complaint(error: ErrorDetails, model: type[BaseModel], where: str) -> InputError:
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in error["loc"]).removeprefix(".")
    separator = ": " if model is Top else "."
    if error["type"] == "extra_forbidden":
        table, _, last = key.rpartition(".")
        tables: dict[str, type[BaseModel]] = {"process": Process, "points": Point}
        known = tables.get(table.partition(".")[0], model).model_fields
        place = f"{where}{separator}{table}" if table else where
        return InputError(place, f"unknown key '{last}' ({shown(error['input'])})", suggestion(last, known))
    if error["type"] == "missing":
        return InputError(where, f"has no '{key}'", MISSING.get(key, "give it, or a preset that does"))
    right = RIGHT.get(error["type"], error["msg"]).format(**error.get("ctx", {}))
    return InputError(f"{where}{separator}{key}", shown(error["input"]), right)
