"""Which keys a vehicle file may hold beside those of its sensors, what priors may stand in it, and what is said of a wrong one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeVar, get_args

from pydantic import BaseModel, Field, ValidationError, create_model

from leadline.data.errors import InputError, suggestion
from leadline.data.records import KINDS
from leadline.data.sensor_keys import BY_KIND, Carried, Finite, Keys, NotNegative, Positive, Vector

if TYPE_CHECKING:
    from collections.abc import Mapping

    from pydantic_core import ErrorDetails

Model = TypeVar("Model", bound=BaseModel)


class Process(Keys):
    """The table [process]: the model, the inertial unit that may drive it, and the one that stands in while it is silent.

    `own` is handed to a model of the user's own, as it is; each other model has a table of its name (data/process_keys.py).
    """

    model: str = "inertial"
    imu: str = "imu"
    standby: str | None = None
    clones: Annotated[int, Field(ge=0, le=4)] | None = None
    align_s: Positive = 300.0
    aligned_sigma_heading_deg: Positive = 5.0
    sync_s: Annotated[float, Field(gt=0, le=60)] | None = None
    inertial: dict[str, Any] = Field(default_factory=dict)
    body_velocity: dict[str, Any] = Field(default_factory=dict, alias="body-velocity")
    cruise: dict[str, Any] = Field(default_factory=dict)
    planar: dict[str, Any] = Field(default_factory=dict)
    dynamics: dict[str, Any] = Field(default_factory=dict)
    own: dict[str, Any] = Field(default_factory=dict)


class Point(Keys):
    """A named point of the vehicle, at which states can be asked for."""

    lever_arm_m: Vector


class Top(Keys):
    """A whole vehicle file; what is not an instrument's own (water, sea bed, clocks) stands in tables of priors."""

    outermost: ClassVar[bool] = True
    name: str
    process: Process = Process()
    sensors: dict[str, Any] = Field(min_length=1)
    water: dict[str, Any] = Field(default_factory=dict)
    seabed: dict[str, Any] = Field(default_factory=dict)
    clocks: dict[str, dict[str, Any]] = Field(default_factory=dict)
    points: dict[str, Point] = Field(default_factory=dict)


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
DOPPLER: Mapping[str, NuisanceKeys] = {
    "scale": NuisanceKeys("percent"),
    "mounting": NuisanceKeys("deg", 3),
    "bias": NuisanceKeys("mps", 3),
    "beam_bias": NuisanceKeys("mps", 4),
}
NUISANCES: Mapping[str, Mapping[str, NuisanceKeys]] = {
    "imu": {
        "gyro_scale": NuisanceKeys("percent", 3),
        "accel_scale": NuisanceKeys("percent", 3),
        "gyro_misalignment": NuisanceKeys("deg", 6),
        "accel_misalignment": NuisanceKeys("deg", 6),
    },
    "dvl": DOPPLER,
    "water_velocity": DOPPLER,
    "speed": {"scale": NuisanceKeys("percent"), "bias": NuisanceKeys("mps")},
    "depth": {"datum": NuisanceKeys("m")},
    "pressure": {"datum": NuisanceKeys("m"), "scale": NuisanceKeys("percent")},
    "altimeter": {"bias": NuisanceKeys("m")},
    "yaw_rate": {"bias": NuisanceKeys("deg_per_h"), "scale": NuisanceKeys("percent")},
    "heading": {"bias": NuisanceKeys("deg"), "swing": NuisanceKeys("deg", 4), "drift": NuisanceKeys("deg_per_h")},
    "attitude": {"bias": NuisanceKeys("deg", 3), "swing": NuisanceKeys("deg", 4)},
    "gnss": {"bias": NuisanceKeys("m", 2)},
    "position_fix": {"bias": NuisanceKeys("m", 2)},
    "navigation": {"scale": NuisanceKeys("percent"), "rotation": NuisanceKeys("deg")},
    "acoustic_range": {"bias": NuisanceKeys("m"), "scale": NuisanceKeys("percent")},
}


def check_top(raw: Mapping[str, Any], where: str) -> Top:
    """Check the outermost table of a vehicle file."""
    return checked(Top, raw, where)


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
    found = checked(keys, raw, where).model_dump()
    for key, value in found.items():
        if _is_noise(key) and isinstance(value, (int, float)) and value < 0:
            raise InputError(f"{where}.{key}", shown(value), "0 or more")
    if found.get("declination") is not None and found.get("declination_deg") is not None:
        raise InputError(where, "has both 'declination' and 'declination_deg'", "give one of them")
    if found.get("reference") == "true" and (found.get("declination") or found.get("declination_deg")):
        raise InputError(where, "has a declination, and its reference is 'true'", 'set reference = "magnetic", or leave it out')
    return found


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
    return {key: value for key, value in checked(model, raw, where).model_dump().items() if value is not None}


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


def checked(model: type[Model], raw: Mapping[str, Any], where: str, missing: str = "give it, or a preset that does") -> Model:
    """Validate, and turn the first complaint into one line that names key, value and what would be right."""
    try:
        return model.model_validate(dict(raw))
    except ValidationError as error:
        first = min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")  # a misspelt key explains a missing one
        raise _complaint(first, model, where, missing) from error


def _model_at(model: type[BaseModel], path: tuple[int | str, ...]) -> type[BaseModel]:
    """Return the model of the table at a path of keys."""
    for part in path:
        field = model.model_fields.get(str(part))
        if field is not None:
            model = next(iter(_models_in(field.annotation)), model)
    return model


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    """Return the models that a type is made of."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [found for part in get_args(annotation) for found in _models_in(part)]


def _complaint(error: ErrorDetails, model: type[BaseModel], where: str, missing: str) -> InputError:
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in error["loc"]).removeprefix(".")
    separator = ": " if getattr(model, "outermost", False) else "."
    if error["type"] == "extra_forbidden":
        table, _, last = key.rpartition(".")
        place = f"{where}{separator}{table}" if table else where
        known = [field.alias or name for name, field in _model_at(model, error["loc"][:-1]).model_fields.items()]
        return InputError(place, f"unknown key '{last}' ({shown(error['input'])})", suggestion(last, known))
    if error["type"] == "missing":
        return InputError(where, f"has no '{key}'", MISSING.get(key, missing))
    right = RIGHT.get(error["type"], error["msg"]).format(**error.get("ctx", {}))
    return InputError(f"{where}{separator}{key}", shown(error["input"]), right)
