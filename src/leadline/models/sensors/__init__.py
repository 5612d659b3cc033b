"""Sensor models: one file per kind of sensor, named like the kind, with a function `compose(config, context) -> Sensor`."""

from __future__ import annotations

import traceback
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from leadline.core.compiled import is_kernel
from leadline.data.errors import InputError
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
    module, _, name = (config.model or "").partition(":")
    where = f"sensors.{config.name}.model '{config.model}'"
    try:
        found = getattr(import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        right = "give 'package.module:function' that makes a leadline.models.sensor.Sensor, with its folder on PYTHONPATH"
        raise InputError(where, f"cannot be imported ({error})", right) from error

    def composed(config: SensorConfig, context: Context) -> Sensor:
        sensor = guarded(found, where)(config, context)
        if not isinstance(sensor, Sensor):
            raise InputError(where, f"made a {type(sensor).__name__}", "return a leadline.models.sensor.Sensor")
        channels = tuple(c if is_kernel(c.predict) else replace(c, predict=guarded(c.predict, where)) for c in sensor.channels)
        return replace(sensor, channels=channels, read=guarded(sensor.read, where))

    return composed


def guarded(function: Callable[..., Any], where: str) -> Callable[..., Any]:
    """Return a user's function whose exceptions become an InputError that names place, exception and line."""

    def call(*arguments: Any) -> Any:
        try:
            return function(*arguments)
        except InputError:
            raise
        except Exception as error:
            line = traceback.extract_tb(error.__traceback__)[-1]
            raise InputError(where, f"raised {type(error).__name__}: {error} ({line.filename}, line {line.lineno})", "mend it") from error

    return call
