"""Sensor models: one file per kind of sensor, named like the kind, with a function `compose(config, context) -> Sensor`."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

from leadline.core.compiled import is_kernel
from leadline.models.plugin import guarded, imported
from leadline.models.sensor import Sensor, displaced

if TYPE_CHECKING:
    from collections.abc import Callable

    from leadline.data.vehicle import SensorConfig
    from leadline.models.sensor import Context


def compose(config: SensorConfig, context: Context) -> Sensor | None:
    """Compose a sensor: a user's own by its `model`, else by the file of its kind; None where no model uses that kind (yet).

    Raises InputError when a user's model cannot be imported.
    """
    if config.model is not None:
        return displaced(_imported(config)(config, context), context)
    home = f"{__name__}.{config.kind}"
    if find_spec(home) is None:
        return None
    composed: Sensor = import_module(home).compose(config, context)
    return displaced(composed, context)


def _imported(config: SensorConfig) -> Callable[[SensorConfig, Context], Sensor]:
    """Return a user's `compose`, guarded: what goes wrong in it is said in one line that names it."""
    where = f"sensors.{config.name}.model '{config.model}'"
    make = imported(config.model or "", where, Sensor)

    def composed(config: SensorConfig, context: Context) -> Sensor:
        sensor: Sensor = make(config, context)
        channels = tuple(c if is_kernel(c.predict) else replace(c, predict=guarded(c.predict, where)) for c in sensor.channels)
        return replace(sensor, channels=channels, read=guarded(sensor.read, where))

    return composed
