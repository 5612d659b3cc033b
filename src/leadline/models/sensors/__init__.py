"""Sensor models: one file per kind of sensor, named like the kind, with a function `compose(config, context) -> Sensor`."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

from leadline.data.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from leadline.data.vehicle import SensorConfig
    from leadline.models.sensor import Context, Sensor


def compose(config: SensorConfig, context: Context) -> Sensor | None:
    """Compose a sensor: a user's own by its `model`, else by the file of its kind; None where no model uses that kind (yet).

    Raises InputError when a user's model cannot be imported.
    """
    if config.model is not None:
        return _imported(config)(config, context)
    home = f"{__name__}.{config.kind}"
    if find_spec(home) is None:
        return None
    composed: Sensor = import_module(home).compose(config, context)
    return composed


def _imported(config: SensorConfig) -> Callable[[SensorConfig, Context], Sensor]:
    module, _, name = (config.model or "").partition(":")
    try:
        found: Callable[[SensorConfig, Context], Sensor] = getattr(import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        right = "'package.module:function' that makes a leadline.models.sensor.Sensor"
        raise InputError(f"sensors.{config.name}.model", f"'{config.model}' cannot be imported ({error})", right) from error
    return found
