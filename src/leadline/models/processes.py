"""Process models by name; a user's own by "package.module:function" (or "file.py:function"), which makes a Process as these do."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from leadline.data.errors import InputError, suggestion
from leadline.models.plugin import imported
from leadline.models.process import Process

if TYPE_CHECKING:
    from collections.abc import Mapping

    from leadline.data.vehicle import Vehicle
    from leadline.models.sensor import Context

HOMES: Mapping[str, str] = {
    "inertial": "inertial_units", "body-velocity": "body_velocity", "cruise": "cruise", "planar": "planar", "dynamics": "dynamics",
}  # fmt: skip


def compose_process(vehicle: Vehicle, context: Context) -> Process:
    """Return the process model of a vehicle; raises InputError where it is not known, or lacks what it needs."""
    model = vehicle.process.model
    if model in HOMES:
        made: Process = import_module(f"leadline.models.{HOMES[model]}").compose(vehicle, context)
        return made
    if ":" not in model:
        raise InputError("process.model", f"'{model}' is not known", suggestion(model, HOMES) + ", or give 'package.module:function'")
    own: Process = imported(model, f"process.model '{model}'", Process)(vehicle, context)
    return own
