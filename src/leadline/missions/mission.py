"""A mission: one file that says where, in which sea, with which vehicle, along which plan, under which faults a dive is simulated."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core.geodesy import from_north_east, north_east
from leadline.data.errors import InputError, suggestion
from leadline.data.hull import read_hull
from leadline.data.log import Beacon
from leadline.data.vehicle import DEGREE, read_vehicle, si
from leadline.data.vehicle_keys import checked
from leadline.missions import mission_keys as keys
from leadline.missions.equipment import added, carried
from leadline.missions.fault_keys import faults_of
from leadline.missions.sea_of import Sea, sea_of
from leadline.simulate.dive import StartSigmas
from leadline.simulate.platforms import Moving, Steady
from leadline.simulate.platforms import Waves as Sway
from leadline.simulate.platforms import Waypoints as Track
from leadline.simulate.routes import LEGS, Plan, Polygon, Surfacing
from leadline.simulate.trajectory import Place
from leadline.simulate.voyage import Voyage

if TYPE_CHECKING:
    from collections.abc import Mapping
    from datetime import datetime

    from leadline.data.hull import Hull
    from leadline.data.vehicle import Vehicle
    from leadline.simulate.faults import Fault
    from leadline.simulate.routes import Leg


@dataclass(frozen=True, eq=False)
class Mission:
    """All that a simulated dive is made of (SI, rad); the plan's places count from `place`, which is the origin of the log as well."""

    name: str
    path: Path
    epoch: datetime
    place: Place
    sea: Sea
    vehicle: Vehicle
    hull: Hull
    plan: Plan
    depth: float
    heading: float
    speed: float
    start: StartSigmas
    duration: float | None = None
    truth_rate: float = 10.0
    beacons: Mapping[str, Beacon] = field(default_factory=dict)
    platforms: Mapping[str, Moving] = field(default_factory=dict)
    instruments: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    faults: tuple[Fault, ...] = ()
    steer_by: str = "truth"
    delay: float = 0.0
    note: str = ""

    @property
    def not_simulated(self) -> tuple[str, ...]:
        """Names of sensors of the vehicle file that no log will hold: of kinds that are simulated only where the mission says more."""
        ashore = {name for name, own in self.instruments.items() if not own.get("aboard", True)}
        return tuple(sorted(set(self.vehicle.sensors) - set(carried(self)) - ashore))

    def voyage(self) -> Voyage:
        """Return the voyage, at its start; raises InputError where the hull cannot follow the plan, and as `carried` for instruments."""
        carried(self)
        return Voyage(
            self.hull, self.plan, self.place, self.sea.chart, self.depth, self.heading, self.speed, self.sea.density, self.duration
        )


def read_mission(path: str | Path) -> Mission:
    """Read a mission file; paths in it count from its own folder.

    Raises InputError, one line, which names the file and the key, for wrong TOML, an unknown key, a value out of range, an unknown hull,
    vehicle or shape, for instruments that are none, that do not fit the vehicle or lack whom they speak with, and for faults that befall
    nothing aboard.
    """
    where = Path(path)
    given = checked(keys.MissionKeys, _toml(where), str(where), "give it")
    vehicle = read_vehicle(_beside(where, given.vehicle))
    hull = read_hull(given.hull if not given.hull.endswith(".toml") else _beside(where, given.hull))
    home = given.origin.latitude_deg * DEGREE, given.origin.longitude_deg * DEGREE
    sea = sea_of(given.sea, home, where, given.duration_s)
    place = Place(*home, 0.0, given.origin.geoid_undulation_m, sea.water)
    start = given.start
    mission = Mission(
        name=given.name,
        path=where,
        epoch=given.epoch,
        place=place,
        sea=sea,
        vehicle=vehicle,
        hull=hull,
        plan=_plan(given.plan, (start.north_m, start.east_m), home, where),
        depth=start.depth_m,
        heading=start.heading_deg * DEGREE,
        speed=start.speed_mps,
        start=StartSigmas(
            start.sigma_position_m,
            start.sigma_depth_m,
            start.sigma_velocity_mps,
            start.sigma_tilt_deg * DEGREE,
            start.sigma_heading_deg * DEGREE,
        ),
        duration=given.duration_s,
        truth_rate=given.truth_rate_hz,
        beacons={name: Beacon(**values(one)) for name, one in given.beacons.items()},
        platforms={name: _platform(one, place) for name, one in given.platforms.items()},
        instruments=given.instruments,
        steer_by=given.navigation.steer_by,
        delay=given.navigation.delay_s,
        note=given.note,
    )
    return replace(mission, faults=faults_of(given.faults, str(where), vehicle, added(mission, carried(mission))))


def values(model: Any) -> dict[str, Any]:
    """Return the keys of a checked table without their units, in SI; those that were not given are left out."""
    return dict(si(key, value) for key, value in model.model_dump().items() if value is not None)


def _toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "give a mission file") from error
    except UnicodeDecodeError as error:
        raise InputError(path, f"is not text in UTF-8 (byte {error.start})", "give a mission file in TOML") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(path, f"is not TOML: {error}") from error


def _beside(mission: Path, name: str) -> Path:
    return mission.parent / name


def _plan(given: keys.PlanKeys, start: tuple[float, float], home: tuple[float, float], where: Path) -> Plan:
    legs = tuple(_leg(raw, given, home, f"{where}: plan.legs[{k}]") for k, raw in enumerate(given.legs))
    surfacing = Surfacing(given.surfacing.every_s, given.surfacing.stay_s, given.surfacing.stop) if given.surfacing else None
    return Plan(legs, start, surfacing, given.ascend, given.stay_s)


def _leg(raw: Mapping[str, Any], plan: keys.PlanKeys, home: tuple[float, float], where: str) -> Leg:
    """Return one leg: its own speed, depth and altitude before those of the plan."""
    shape = raw.get("shape")
    if not isinstance(shape, str) or shape not in keys.SHAPES:
        raise InputError(
            f"{where}.shape", "is missing" if shape is None else f"'{shape}' is not known", suggestion(str(shape), keys.SHAPES)
        )
    given = checked(keys.SHAPES[shape], raw, where, "give it")
    found = values(given)
    found.pop("shape")
    if isinstance(given, keys.Waypoints):
        found.pop("through", None)
        found |= {"through_m": given.through_m, "through_deg": given.through_deg}
    if "depth" not in found and "altitude" not in found:
        found |= {name: value for name, value in (("depth", plan.depth_m), ("altitude", plan.altitude_m)) if value is not None}
    if "speed" not in found and plan.speed_mps is not None:
        found["speed"] = plan.speed_mps
    if "speed" not in found:
        raise InputError(where, "has no 'speed_mps', nor has [plan]", "give it in one of them")
    if ("depth" in found and "altitude" in found) or not {"depth", "altitude"} & set(found):
        raise InputError(where, "has neither a depth nor an altitude, or both", "give depth_m or altitude_m, here or in [plan]")
    return _made(shape, found, home, where)


def _made(shape: str, found: dict[str, Any], home: tuple[float, float], where: str) -> Leg:
    if "at" in found:
        found["at"] = tuple(found["at"])
    if shape == "waypoints":
        found["through"] = _through(found, home, where)
    if "for" in found:
        found["seconds"] = found.pop("for")
    if shape in ("triangle", "square"):
        return Polygon(**found, sides=3 if shape == "triangle" else 4)
    return LEGS[shape](**found)


def _through(found: dict[str, Any], home: tuple[float, float], where: str) -> tuple[tuple[float, float], ...]:
    """Return waypoints north and east of the origin, from `through_m` or from `through_deg`."""
    metres, angles = found.pop("through_m", None), found.pop("through_deg", None)
    if (metres is None) == (angles is None):
        problem = "has no points" if metres is None else "has its points twice"
        raise InputError(where, problem, "give through_m = [[north, east], ...] or through_deg = [[latitude, longitude], ...]")
    if metres is not None:
        return tuple((float(n), float(e)) for n, e in metres)
    latitude, longitude = (DEGREE * np.array(angles, float)).T
    north, east = north_east(latitude, longitude, *home)
    return tuple((float(n), float(e)) for n, e in zip(north, east, strict=True))


def _platform(given: keys.Platform, place: Place) -> Moving:
    """Return a ship or a buoy: along its points at its speed, and on beyond the last; or drifting from one point."""
    points = np.array(given.through_m, float)
    latitude, longitude = (float(v) for v in from_north_east(points[0, 0], points[0, 1], place.latitude, place.longitude))
    at = Place(latitude, longitude, given.depth_m, place.surface_height)
    sway = Sway((given.roll_deg * DEGREE, given.period_s), (0.5 * given.roll_deg * DEGREE, given.period_s), (given.heave_m, given.period_s))
    if len(points) == 1:
        drift = Steady(given.drift_north_mps, given.drift_east_mps, given.heading_deg * DEGREE)
        return Moving(motion=drift, place=at, waves=sway, turnaround=given.turnaround_s)
    gaps = np.hypot(*np.diff(points, axis=0).T)
    time = np.concatenate([[0.0], np.cumsum(gaps / given.speed_mps)])
    track = Track(tuple(time), tuple(points[:, 0] - points[0, 0]), tuple(points[:, 1] - points[0, 1]))
    return Moving(motion=track, place=at, waves=sway, turnaround=given.turnaround_s)
