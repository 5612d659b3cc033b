"""What a simulated vehicle carries: the instruments of its vehicle file, with what a mission and `simulated` tables say beyond it.

An instrument of the vehicle file is drawn with the errors that the filter takes for granted (instruments.py).  `simulated` in the vehicle
file, or in its preset, and [instruments.NAME] in the mission change fields of it, the mission last; a table of a name that the vehicle file
does not have makes one more instrument, of the `kind` that it states.  All of it is checked before the vehicle sails (`carried`).
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core.attitude import euler_from_quaternion, quaternion_from_matrix
from leadline.data.errors import InputError, suggestion
from leadline.data.vehicle import SensorConfig
from leadline.data.vehicle_keys import shown
from leadline.missions.equipment_keys import HUGE, fields_of, placed_at, with_keys
from leadline.missions.instruments import instruments_of
from leadline.simulate import instruments as simulated
from leadline.simulate.machinery import Machinery
from leadline.simulate.multibeam import Multibeam
from leadline.simulate.platforms import PlatformPose
from leadline.simulate.usbl import ShortBaseline, Usbl, UsblFix

if TYPE_CHECKING:
    from collections.abc import Mapping

    from leadline.missions.mission import Mission
    from leadline.simulate.instrument import Instrument
    from leadline.simulate.voyage import Voyage

CLASSES: Mapping[str, type[Instrument[Any]]] = {
    "imu": simulated.Imu, "magnetometer": simulated.Magnetometer, "attitude": simulated.Attitude, "heading": simulated.Heading,
    "yaw_rate": simulated.YawRate, "depth": simulated.Depth, "pressure": simulated.Pressure, "altimeter": simulated.Altimeter,
    "gnss": simulated.Gnss, "position_fix": simulated.PositionFix, "dvl": simulated.Dvl, "water_velocity": simulated.WaterVelocity,
    "speed": simulated.Speed, "swath": Multibeam, "acoustic_range": simulated.AcousticRange, "usbl": Usbl, "usbl_fix": UsblFix,
    "short_baseline": ShortBaseline, "platform": PlatformPose, "thruster": simulated.ThrusterSpeeds,
    "motor_current": simulated.MotorCurrents, "water_level": simulated.WaterLevel, "water_current": simulated.CurrentMeter,
    "sound_speed": simulated.SoundSpeedMeter, "sound_speed_profile": simulated.SoundProfileCast,
}  # fmt: skip
SOUNDING = (simulated.AcousticRange, Usbl, UsblFix, ShortBaseline)  # whose rays a profile bends
ROWS: Mapping[str, tuple[str, ...]] = {"usbl_fix": ("position_fix",), "short_baseline": ("position_fix", "acoustic_range")}
IDLE, DRAWN = 0.1, 2e-4  # A, and A per (rps)^power: a small motor, where a mission asks for currents and says nothing of them


def equip(mission: Mission, voyage: Voyage) -> dict[str, Instrument[Any]]:
    """Return by name what the vehicle of a mission carries, after its voyage (machinery tells what it did).

    Raises InputError, which names the key, for an unknown kind or field, and for an instrument that lacks what it looks at.
    """
    return _aboard(mission, Machinery.of(mission.hull, *voyage.actuators(), idle=IDLE, drawn=DRAWN))


def carried(mission: Mission) -> dict[str, Instrument[Any]]:
    """Return by name what the vehicle of a mission would carry, before it has sailed, with machinery at rest; raises as `equip`."""
    actuators = len(mission.hull.thrusters) + len(mission.hull.fins)
    found = _aboard(mission, Machinery.of(mission.hull, np.zeros(1), np.zeros((1, actuators)), idle=IDLE, drawn=DRAWN))
    for name, instrument in found.items():
        _check(instrument, f"{mission.path}: instruments.{name}")
    return found


def added(mission: Mission, instruments: Mapping[str, Instrument[Any]]) -> dict[str, SensorConfig]:
    """Return by name what the mission's file alone says of `instruments`, as a vehicle file would; kind: that of their rows."""
    found = {}
    for name, instrument in instruments.items():
        raw = mission.instruments.get(name, {})
        if name in mission.vehicle.sensors or "kind" not in raw:
            continue
        rows = ROWS.get(raw["kind"], (raw["kind"],))
        kind = rows[-1] if getattr(instrument, "output", "") == "range" else rows[0]
        names = {"beam_azimuth": "azimuths", "beam_tilt": "tilt", "sound_speed": "sound_speed"}
        values = {key: getattr(instrument, field) for key, field in names.items() if hasattr(instrument, field)}
        found[name] = SensorConfig(name, kind, np.array(instrument.lever_arm_b), instrument.rotation_bs, values=values)
    return found


def _aboard(mission: Mission, machinery: Machinery) -> dict[str, Instrument[Any]]:
    found = instruments_of(mission.vehicle, _rates(mission), mission.beacons, mission.epoch)
    for name, instrument in found.items():
        aboard = mission.vehicle[name]
        own = aboard.written.get("simulated", {})
        found[name] = with_keys(instrument, aboard.kind, own, f"{mission.vehicle.path}: sensors.{name}.simulated")
    for name, raw in mission.instruments.items():
        where = f"{mission.path}: instruments.{name}"
        if not isinstance(raw.get("aboard", True), bool):
            raise InputError(f"{where}.aboard", shown(raw["aboard"]), "true or false")
        config = mission.vehicle.sensors.get(name)
        if name in found and config is not None and raw.get("kind", config.kind) == config.kind:
            found[name] = with_keys(found[name], config.kind, raw, where)
        elif raw.get("aboard", True):
            found[name] = _made(raw, where, mission, machinery, config)
    kept = {name: one for name, one in found.items() if mission.instruments.get(name, {}).get("aboard", True)}
    return {name: _looking(instrument, name, mission, machinery) for name, instrument in kept.items()}


def _rates(mission: Mission) -> dict[str, float]:
    """Return the rates (Hz) that the mission states; what is none is refused later, with its key."""
    stated: dict[str, Any] = {name: own.get("rate_hz") for name, own in mission.instruments.items()}
    return {name: float(rate) for name, rate in stated.items() if type(rate) in (int, float) and 0.0 < rate <= HUGE}


def _check(instrument: Instrument[Any], where: str) -> None:
    """Refuse an instrument whose fields do not go together, or that lacks whom it speaks with."""
    for low, high in (("range_min", "range_max"), ("interval_min", "interval_max"), ("cell_start", "cell_end")):
        least, most = getattr(instrument, low, 0.0), getattr(instrument, high, np.inf)
        if least > most:
            raise InputError(where, f"has {low} {least:g} and {high} {most:g}", "the lower one first")
    if isinstance(instrument, simulated.Imu) and instrument.rate < 1.0:
        raise InputError(f"{where}.rate_hz", f"{instrument.rate:g}", "1 or more, of an inertial unit")
    if isinstance(instrument, simulated.Dvl):
        _check_beams(instrument, where)
    if isinstance(instrument, SOUNDING):
        _check_sounding(instrument, where)
    if isinstance(instrument, PlatformPose) and not instrument.platforms:
        raise InputError(where, "tells of no platform", "add [platforms.NAME]")


def _check_beams(log: simulated.Dvl, where: str) -> None:
    count = len(log.azimuths)
    turned = np.unique(np.round(np.mod(log.azimuths, 2 * np.pi), 6))
    if count and (count < 3 or len(turned) < count):
        raise InputError(f"{where}.azimuths_deg", f"{count} beams, {len(turned)} of them apart", "three or more that differ, or none")
    if count and not log.tilt > 0.0:
        raise InputError(where, "has beams without a tilt", "give tilt_deg")
    if log.error_velocity and count != 4:
        raise InputError(f"{where}.error_velocity", f"true, of {count} beams", "four azimuths_deg")
    if log.output != "velocity" and not count:
        raise InputError(f"{where}.output", f"'{log.output}', without azimuths", "velocity, or give azimuths_deg")


def _check_sounding(instrument: Instrument[Any], where: str) -> None:
    own: Any = instrument
    if isinstance(instrument, ShortBaseline):
        placed = [one for one in instrument.transducers.values() if one.north is not None and one.east is not None]
        if len(placed) < 3 or len(placed) < len(instrument.transducers):
            found = f"has {len(placed)} transducers with north and east"
            raise InputError(f"{where}.transducers", found, "three beacons or more, all of them with north_m and east_m")
        return
    ship = getattr(own, "ship", None)
    if isinstance(instrument, UsblFix) and ship is None:
        raise InputError(where, "has no 'receiver'", "give the platform that carries the head")
    if ship is None and not (own.beacons or own.platforms):
        raise InputError(where, "speaks with nobody", "add [beacons.NAME], or name platforms")
    both = set(own.beacons) & set(own.platforms)
    if both:
        raise InputError(where, f"'{min(both)}' is a beacon and a platform", "give each a name of its own")
    if own.path == "difference" and (own.reference not in own.receivers or len(own.receivers) < 2):
        right = "two or more in receivers_m, one of them the reference"
        raise InputError(where, f"has the reference '{own.reference}' and {len(own.receivers)} receivers", right)


def _made(
    raw: Mapping[str, Any], where: str, mission: Mission, machinery: Machinery, config: SensorConfig | None = None
) -> Instrument[Any]:
    """Return an instrument that is not simulated from the vehicle file; if that speaks of it, it says where it sits, and its rate."""
    kind = raw.get("kind", None if config is None else config.kind)
    if not isinstance(kind, str) or kind not in CLASSES:
        found = "has no 'kind', and the vehicle file has no such sensor" if kind is None else f"the kind '{kind}' is not known"
        raise InputError(where, found, suggestion(str(kind), CLASSES))
    if config is not None and config.kind != kind and config.kind not in ROWS.get(kind, ()):
        fitting = [other for other, rows in ROWS.items() if config.kind in rows]
        right = " or ".join([config.kind, *fitting]) + ", or another name"
        raise InputError(f"{where}.kind", f"'{kind}', and the vehicle file has a {config.kind} of that name", right)
    made = CLASSES[kind]
    values = ({} if config is None else _seat(config)) | fields_of(made, kind, raw, where)
    if kind != "short_baseline" and "rate" not in values:
        raise InputError(where, "has no 'rate_hz'", "give it")
    given: dict[str, Any] = {}
    if made is Multibeam:
        if mission.sea.chart is None:
            raise InputError(where, "looks at the ground, and the sea has none", "add [sea.terrain]")
        given["seabed"] = mission.sea.chart
    if made in (simulated.ThrusterSpeeds, simulated.MotorCurrents):
        given["machinery"] = machinery
    if made in (simulated.SoundSpeedMeter, simulated.SoundProfileCast):
        if mission.sea.sound is None:
            raise InputError(where, "measures the speed of sound, and the sea says nothing of it", "add sound or sound_speed_mps to [sea]")
        given["profile"] = mission.sea.sound
    if made is simulated.SoundProfileCast:
        given["depths"] = tuple(float(z) for z in mission.sea.sound.depth) if mission.sea.sound is not None else ()
    given |= _partners(made, raw, where, mission)
    with placed_at(where):
        return made(**values, **given)


def _seat(config: SensorConfig) -> dict[str, Any]:
    """Return where an instrument of the vehicle file sits, and its rate where it has one."""
    angles = euler_from_quaternion(quaternion_from_matrix(config.rotation_bs))
    seat: dict[str, Any] = {
        "lever_arm_b": tuple(map(float, config.lever_arm_b)), "mounting_bs": tuple(float(angle) for angle in angles),
    }  # fmt: skip
    rate = config.values.get("rate")
    return seat | ({} if rate is None else {"rate": float(rate)})


def _partners(made: type[Instrument[Any]], raw: Mapping[str, Any], where: str, mission: Mission) -> dict[str, Any]:
    """Return whom an acoustic instrument speaks with: the beacons and platforms that it names, or all."""
    found: dict[str, Any] = {}
    own = {field.name for field in fields(made)}
    if "ship" in own and raw.get("receiver"):
        ship = raw["receiver"]  # a text: it has been read as a field
        if ship not in mission.platforms:
            raise InputError(f"{where}.receiver", f"'{ship}' is no platform", suggestion(str(ship), mission.platforms))
        return {"ship": mission.platforms[ship]}
    lists: tuple[tuple[str, Mapping[str, Any]], ...]
    lists = ("beacons", mission.beacons), ("platforms", mission.platforms), ("transducers", mission.beacons)
    for key, known in lists:
        if key not in own:
            continue
        wanted = raw.get(key, list(known) if key != "platforms" or made is PlatformPose else [])
        if not isinstance(wanted, list) or not all(isinstance(one, str) for one in wanted):
            raise InputError(f"{where}.{key}", shown(wanted), "a list of names in quotes")
        for one in wanted:
            if one not in known:
                raise InputError(f"{where}.{key}", f"'{one}' is not known", suggestion(str(one), known))
        found[key] = {one: known[one] for one in wanted}
    if "receivers_m" in raw:
        found["receivers"] = _receivers(raw["receivers_m"], f"{where}.receivers_m", own)
    return found


def _receivers(given: Any, where: str, own: set[str]) -> dict[str, tuple[float, ...]]:
    """Return hydrophones of an instrument by name: their lever arms (m)."""
    if "receivers" not in own:
        raise InputError(where, "is no key of this kind", "an acoustic_range has it")
    right = "a table of lever arms, such as { fore = [0.5, 0.0, 0.0], aft = [-0.5, 0.0, 0.0] }"
    if not isinstance(given, dict) or not all(_is_arm(arm) for arm in given.values()):
        raise InputError(where, shown(given), right)
    return {name: tuple(map(float, arm)) for name, arm in given.items()}


def _is_arm(arm: Any) -> bool:
    return isinstance(arm, list) and len(arm) == 3 and all(type(v) in (int, float) and abs(v) <= HUGE for v in arm)


def _looking(instrument: Instrument[Any], name: str, mission: Mission, machinery: Machinery) -> Instrument[Any]:
    """Return an instrument in the sea and on the vehicle of a mission: what it can see of them, it sees."""
    own = {field.name for field in fields(instrument)}
    given: dict[str, Any] = {}
    where = f"{mission.path}: instruments.{name}"
    if isinstance(instrument, simulated.Magnetometer):
        given["date"] = mission.epoch
        given["machinery"] = machinery if instrument.motor_coupling else None
        motors = machinery.thrusters.shape[1]
        if any(len(row) != motors for row in instrument.motor_coupling):
            raise InputError(
                f"{where}.motor_coupling_ut", f"has rows of {len(instrument.motor_coupling[0])}", f"of {motors}: one per motor"
            )
    if isinstance(instrument, simulated.Pressure) and instrument.density is None and mission.sea.weighed:
        given["density"] = mission.sea.density
    if "seabed" in own and mission.sea.chart is not None and not isinstance(instrument, Multibeam):
        given["seabed"] = mission.sea.chart
    if mission.sea.sound is not None and isinstance(instrument, SOUNDING):
        given["profile"] = mission.sea.sound
    raw = mission.instruments.get(name, {})
    if isinstance(instrument, simulated.Dvl) and mission.sea.sound is not None and _reckons(name, raw, mission):
        given["profile"] = mission.sea.sound
    if isinstance(instrument, simulated.AcousticRange) and name in mission.vehicle.sensors and {"beacons", "platforms"} & set(raw):
        given |= _partners(type(instrument), raw, where, mission)
    return replace(instrument, **given) if given else instrument


def _reckons(name: str, raw: Mapping[str, Any], mission: Mission) -> bool:
    """Whether a Doppler log is said to reckon with a speed of sound of its own: then it is off where the water has another."""
    config = mission.vehicle.sensors.get(name)
    stated = {} if config is None else config.written.get("simulated", {})
    return "sound_speed_mps" in raw or "sound_speed_mps" in stated
