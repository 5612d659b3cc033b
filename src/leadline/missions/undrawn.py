"""Priors of a vehicle file that the simulator does not draw: a stated value of theirs would silently come to nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.data.errors import InputError
from leadline.data.vehicle_keys import shown

if TYPE_CHECKING:
    from leadline.data.vehicle import Prior, Vehicle

NOT_DRAWN = ("time", "lever", "gyro_scale", "accel_scale", "gyro_misalignment", "accel_misalignment")  # nuisances of a sensor
CLOCKS = "clocks."  # shared ones


def check_undrawn(vehicle: Vehicle) -> None:
    """Raise InputError where a prior that is not drawn states a value other than zero: it names the sensor, or the clock."""
    for config in vehicle.sensors.values():
        for name in NOT_DRAWN:
            _check(f"sensors.{config.name}.nuisance.{name}", config.nuisance.get(name))
    for name, prior in vehicle.shared.items():
        if name.startswith(CLOCKS):
            _check(name, prior)


def _check(where: str, prior: Prior | None) -> None:
    if prior is not None and np.any(prior.value):
        right = "a sigma alone: the simulator does not draw it, [instruments] has keys for its like"
        raise InputError(where, f"has the value {shown(np.ravel(prior.value).tolist())}", right)
