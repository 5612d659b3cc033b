"""Process models by name; a user's own by "package.module:function" (or "file.py:function"), which makes a Process as these do."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np

from leadline.data.errors import InputError, suggestion
from leadline.models.plugin import check_kernels, guarded, imported
from leadline.models.process import Process

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from leadline.data.records import Array
    from leadline.data.vehicle import Vehicle
    from leadline.models.process import Pose
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
    where = f"process.model '{model}'"
    own: Process = imported(model, where, Process)(vehicle, context)
    check_kernels(own.kernels(), where)
    return replace(own, begin=_sized(own, where))


def _sized(own: Process, where: str) -> Callable[[Pose], tuple[Array, Array]]:
    """Return the `begin` of a user's model, guarded, with a check of the sizes of what it makes."""
    nominal, error = sum(part.nominal for part in own.parts), sum(part.size for part in own.parts)

    def begin(pose: Pose) -> tuple[Array, Array]:
        x, covariance = guarded(own.begin, where)(pose)
        if np.shape(x) != (nominal,) or np.shape(covariance) != (error, error):
            found = f"begins with {np.shape(x)} numbers and a covariance of {np.shape(covariance)}"
            raise InputError(where, found, f"its parts have {nominal} numbers and {error} errors")
        return x, covariance

    return begin
