"""The faults of a mission file: a table [[faults]] for each, by name and window, made into values of the simulator."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from leadline.data.errors import InputError, suggestion
from leadline.data.vehicle_keys import checked, shown
from leadline.missions.fault_kinds import FAULTS
from leadline.missions.fault_windows import Target

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from leadline.data.vehicle import SensorConfig, Vehicle
    from leadline.missions.fault_windows import FaultKeys
    from leadline.simulate.faults import Fault

__all__ = ["FAULTS", "faults_of"]


def faults_of(
    raw: Sequence[Any], where: str, vehicle: Vehicle | None = None, added: Mapping[str, SensorConfig] | None = None
) -> tuple[Fault, ...]:
    """Return the faults (SI) of the tables [[faults]] of a mission file called `where`, in their order.

    With a `vehicle` sensors are looked up in it, then in what the mission has `added`, and the geometry of a Doppler log is that of its
    file; without, names are taken as they are, and a mounting is none.  Raises InputError, which names the key, for an unknown kind or
    key, a value of the wrong type or out of range, a window that ends before it begins, and a sensor that is not aboard or cannot have
    the fault.
    """
    return tuple(_fault(keys, f"{where}: faults[{number}]", vehicle, added or {}) for number, keys in enumerate(raw))


def _fault(raw: Any, where: str, vehicle: Vehicle | None, added: Mapping[str, SensorConfig]) -> Fault:
    if not isinstance(raw, dict):
        raise InputError(where, shown(raw), "a table of keys")
    kind = raw.get("kind")
    if kind is None:
        raise InputError(where, "has no 'kind'", suggestion("", FAULTS))
    if not isinstance(kind, str) or kind not in FAULTS:
        raise InputError(f"{where}.kind", f"{shown(kind)} is not known", suggestion(str(kind), FAULTS))
    keys = checked(FAULTS[kind], raw, where, "give it")
    return keys.fault(_target(keys, where, vehicle, added))


def _target(keys: FaultKeys, where: str, vehicle: Vehicle | None, added: Mapping[str, SensorConfig]) -> Target:
    """Return the sensor that a fault befalls."""
    if vehicle is None:
        if not (keys.sensor or keys.usual):
            raise InputError(where, "has no 'sensor'", "give the name of one")
        return Target(keys.sensor or keys.usual, None, where)
    own, more = (_fitting(keys, sensors) for sensors in (vehicle.sensors, added))
    known, fitting = {**added, **vehicle.sensors}, more | own
    name = keys.sensor or _likely(keys, own) or _likely(keys, fitting)
    if name is None:
        right = f"give one of {', '.join(fitting)}" if fitting else f"{vehicle.name} has none of kind {' or '.join(keys.kinds)}"
        raise InputError(where, "has no 'sensor'", right)
    if name not in known:
        raise InputError(f"{where}.sensor", f"'{name}' is no sensor of {vehicle.name}", suggestion(name, fitting))
    if name not in fitting:
        raise InputError(f"{where}.sensor", f"'{name}' is of kind {known[name].kind}", f"a sensor of kind {' or '.join(keys.kinds)}")
    return Target(name, known[name], where)


def _fitting(keys: FaultKeys, sensors: Mapping[str, SensorConfig]) -> dict[str, str]:
    """Return by name the kinds of the sensors that can have a fault."""
    return {name: config.kind for name, config in sensors.items() if not keys.kinds or config.kind in keys.kinds}


def _likely(keys: FaultKeys, fitting: Mapping[str, str]) -> str | None:
    """Return of sensors (name, kind) the one of the usual name, else the only one of the usual kind or of the first, else the only one."""
    if not keys.usual or keys.usual in fitting:
        return keys.usual or None
    for kind in (keys.usual, *keys.kinds[:1]):
        alike = [name for name, its in fitting.items() if its == kind]
        if len(alike) == 1:
            return alike[0]
    return next(iter(fitting)) if len(fitting) == 1 else None
