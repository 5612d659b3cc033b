"""Which process model moves a vehicle, with its figures: the table [process] of a vehicle file."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from leadline.data.errors import InputError, suggestion
from leadline.data.records import UNITS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from leadline.data.vehicle import Prior


@dataclass(frozen=True)
class ProcessConfig:
    """Which process model moves the vehicle, what drives it, and how many poses at earlier epochs it can hold."""

    model: str = "inertial"
    imu: str = "imu"
    standby: str | None = None
    clones: int | None = None
    align: float = 300.0  # s that may be spent on finding an unknown heading
    aligned_sigma_heading: float = 0.0873  # rad: above it a run that began without a heading is still aligning
    sync: float | None = None  # s: measurements wait for the next tick, and of each channel the newest is used
    written: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # tables of the models, in the units of the file
    where: str = ""  # of a message: the file

    def figures(self, model: str) -> tuple[dict[str, Any], dict[str, Prior]]:
        """Return the figures of a process model, with defaults filled in (SI, by name without unit), and the priors of its own states.

        Raises InputError for a key that the model does not know, or lacks.
        """
        from leadline.data import process_keys, vehicle_keys
        from leadline.data.vehicle import prior_of, si

        keys = process_keys.MODELS.get(model)
        if keys is None:
            return dict(self.written.get("own", {})), {}
        where = f"{self.where}process.{model}"
        found = vehicle_keys.checked(keys, self.written.get(model, {}), where, "the process model needs it").model_dump()
        known, priors = process_keys.NUISANCES.get(model, {}), {}
        for name, prior in found.pop("nuisance", {}).items():
            if name not in known:
                raise InputError(f"{where}.nuisance.{name}", f"is no nuisance of '{model}'", suggestion(name, known) or "it has none")
            priors[name] = prior_of(known[name], prior, f"{where}.nuisance.{name}")
        return dict(si(key, value) for key, value in found.items() if value is not None), priors


def known_model(model: str, where: str) -> str:
    """Return the name of a process model; raises InputError for one that is not known, and no user's own."""
    from leadline.data.process_keys import MODELS

    if model not in MODELS and ":" not in model:
        raise InputError(where, f"'{model}' is not known", suggestion(model, MODELS) + ", or give 'package.module:function'")
    return model


def process_of(keys: Any, where: str) -> ProcessConfig:
    """Return the configuration that the checked table [process] makes; raises InputError for a model or a key that is not known."""
    made = ProcessConfig(
        known_model(keys.model, f"{where}: process.model"),
        keys.imu,
        keys.standby,
        keys.clones,
        keys.align_s,
        keys.aligned_sigma_heading_deg * UNITS["deg"],
        keys.sync_s,
        _models(keys),
        f"{where}: ",
    )
    for model in made.written:
        made.figures(model)
    return made


def _models(process: Any) -> dict[str, Mapping[str, Any]]:
    """Return the tables of process models, as written."""
    return {
        field.alias or name: value
        for name, field in type(process).model_fields.items()
        if (value := getattr(process, name)) and isinstance(value, dict)
    }
