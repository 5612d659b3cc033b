"""Records: one frozen table type per kind of sensor; SI units and radians inside.

Each field declares the file columns that it is made of (docs/formats.md), so that this page is the whole schema:
`{x,y,z}` makes a field of shape (rows, 3), `{i}` a field of shape (rows, n) for as many numbered columns as there are.
The unit suffix of a column name decides the conversion at the border (`UNITS`); inside there is none.
"""

from __future__ import annotations

import re
from dataclasses import Field, dataclass, field, fields
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import numpy as np
import numpy.typing as npt

from leadline.data.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

Array: TypeAlias = npt.NDArray[np.float64]
Text: TypeAlias = npt.NDArray[np.str_]

# File unit -> factor to the unit used inside.  Revolutions, volts, decibels, degrees Celsius and practical salinity stay as they are.
UNITS: Mapping[str, float] = {
    "s": 1.0, "m": 1.0, "m2": 1.0, "mps": 1.0, "m2ps2": 1.0, "mps2": 1.0, "radps": 1.0, "rad": 1.0, "deg": np.pi / 180.0,
    "ut": 1e-6, "pa": 1.0, "rps": 1.0, "a": 1.0, "v": 1.0, "db": 1.0, "degc": 1.0, "psu": 1.0,
}  # fmt: skip
UNITLESS = frozenset({
    "valid", "beacon", "transmitter", "receiver", "source", "sequence", "ping", "beam", "path", "frame", "quality", "fix_type",
    "satellites", "outlier", "status", "outcome", "name", "peak", "row", "dof", "nis", "moving", "value", "head", "reference", "hdop",
    "correlation",
})  # fmt: skip


def column(pattern: str, *, required: bool = False, text: bool = False) -> Any:
    """Declare the file columns of one field of a table."""
    return field(default=None, metadata={"pattern": pattern, "required": required, "text": text})


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """Rows of one sensor instance: `time` is the time of validity in seconds from the log's epoch.

    Arrays are made read-only float64 (text columns: str).  Raises InputError where lengths differ, where a required field
    is missing, or where none of the alternatives of the kind is complete.
    """

    kind: ClassVar[str] = ""
    alternatives: ClassVar[tuple[tuple[str, ...], ...]] = ()  # at least one of these groups of fields is complete

    time: Array = column("time_s", required=True)
    received: Array | None = column("received_s")
    device_time: Array | None = column("device_time_s")
    sequence: Array | None = column("sequence")
    valid: Array | None = column("valid")
    extra: Mapping[str, Array | Text] = field(default_factory=dict)  # columns that the kind does not name, as read

    def __post_init__(self) -> None:
        """Freeze the arrays and check the table against its own declaration."""
        for item in self.columns():
            object.__setattr__(self, item.name, _frozen(getattr(self, item.name), item.metadata["text"]))
        object.__setattr__(self, "extra", {k: _frozen(v, np.asarray(v).dtype.kind in "UO") for k, v in self.extra.items()})
        self._check()

    def _check(self) -> None:
        if self.time is None:
            raise InputError(self.kind, "has no time", "give time_s")
        for item in self.columns():
            value = getattr(self, item.name)
            if value is None and item.metadata["required"]:
                raise InputError(self.kind, f"has no {item.name}", f"give {item.metadata['pattern']}")
            if value is not None and len(value) != len(self.time):
                raise InputError(self.kind, f"{item.name} has {len(value)} rows", f"time has {len(self.time)}")
        if self.alternatives and not any(all(getattr(self, n) is not None for n in group) for group in self.alternatives):
            raise InputError(self.kind, "has no value columns", "give " + ", or ".join(self.patterns(g) for g in self.alternatives))

    @classmethod
    def patterns(cls, names: tuple[str, ...]) -> str:
        """Return the file columns of the named fields, for a message."""
        by_name = {item.name: item.metadata["pattern"] for item in cls.columns()}
        return " and ".join(by_name[name] for name in names)

    @classmethod
    def columns(cls) -> Iterator[Field[Any]]:
        """Iterate over the fields that are made of file columns."""
        return (item for item in fields(cls) if "pattern" in item.metadata)

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.time)

    def select(self, index: Any) -> Table:
        """Return a table of the rows that `index` (mask, slice or indices) selects."""
        chosen = {item.name: _chosen(getattr(self, item.name), index) for item in self.columns()}
        other = {item.name: getattr(self, item.name) for item in fields(self) if "pattern" not in item.metadata and item.name != "extra"}
        return type(self)(**chosen, **other, extra={k: v[index] for k, v in self.extra.items()})


def after(first: Table, second: Table) -> Table:
    """Return the rows of a table followed by those of another of its kind; a column that one of them lacks is not measured there."""
    columns = {
        item.name: _stacked(getattr(first, item.name), getattr(second, item.name), len(first), len(second)) for item in first.columns()
    }
    other = {item.name: getattr(second, item.name) for item in fields(second) if "pattern" not in item.metadata and item.name != "extra"}
    extra = {k: _stacked(first.extra.get(k), second.extra.get(k), len(first), len(second)) for k in {**first.extra, **second.extra}}
    return type(second)(**columns, **other, extra=extra)


def _stacked(a: Any, b: Any, rows_a: int, rows_b: int) -> Any:
    if a is None and b is None:
        return None
    like = a if a is not None else b
    blank = "" if like.dtype.kind == "U" else np.nan
    parts = [np.full((n, *like.shape[1:]), blank, like.dtype) if v is None else v for v, n in ((a, rows_a), (b, rows_b))]
    return np.concatenate(parts)


def _frozen(value: Any, text: bool) -> Any:
    if value is None:
        return None
    if isinstance(value, np.ndarray) and value.base is None and not value.flags.writeable and value.dtype.kind == ("U" if text else "f"):
        return value  # frozen already
    array = np.array(value, dtype=np.str_ if text else np.float64)
    array.setflags(write=False)
    return array


def _chosen(value: Any, index: Any) -> Any:
    if value is None:
        return None
    chosen = value[index]
    if chosen.base is None:  # a copy, ours alone
        chosen.setflags(write=False)
    return chosen


@dataclass(frozen=True, kw_only=True, eq=False)
class Imu(Table):
    """Specific force and angular rate, or their increments, in the sensor frame (m/s^2, rad/s, m/s, rad)."""

    kind = "imu"
    alternatives = (("accel", "gyro"), ("delta_velocity", "delta_angle", "interval"))
    accel: Array | None = column("accel_{x,y,z}_mps2")
    gyro: Array | None = column("gyro_{x,y,z}_radps")
    delta_velocity: Array | None = column("delta_velocity_{x,y,z}_mps")
    delta_angle: Array | None = column("delta_angle_{x,y,z}_rad")
    interval: Array | None = column("interval_s")
    temperature: Array | None = column("temperature_degc")
    sample: str = "mean"  # "mean" over (previous, time], "instant", or "increment"


@dataclass(frozen=True, kw_only=True, eq=False)
class Magnetometer(Table):
    """Magnetic flux density in the sensor frame (T)."""

    kind = "magnetometer"
    field: Array = column("field_{x,y,z}_ut", required=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Attitude(Table):
    """Attitude of the sensor frame against north-east-down (rad), Z-Y-X angles or a quaternion sensor -> NED, scalar first."""

    kind = "attitude"
    alternatives = (("roll", "pitch", "heading"), ("quaternion",))
    roll: Array | None = column("roll_deg")
    pitch: Array | None = column("pitch_deg")
    heading: Array | None = column("heading_deg")
    quaternion: Array | None = column("quaternion_{w,x,y,z}")
    sigma: Array | None = column("sigma_{roll,pitch,heading}_deg")


@dataclass(frozen=True, kw_only=True, eq=False)
class Heading(Table):
    """Heading clockwise from north (rad), magnetic or true as the vehicle file says."""

    kind = "heading"
    heading: Array = column("heading_deg", required=True)
    sigma: Array | None = column("sigma_deg")


@dataclass(frozen=True, kw_only=True, eq=False)
class YawRate(Table):
    """Angular rate about the sensor's axis (rad/s), against inertial space unless the vehicle file says otherwise."""

    kind = "yaw_rate"
    yaw_rate: Array = column("yaw_rate_radps", required=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Dvl(Table):
    """Velocity of the vehicle over the bottom (m/s): a vector in `frame`, or along beams, positive towards the outward beam."""

    kind = "dvl"
    alternatives = (("velocity",), ("beam",))
    velocity: Array | None = column("velocity_{x,y,z}_mps")
    beam: Array | None = column("beam{i}_mps")
    sigma: Array | None = column("sigma_{x,y,z}_mps")
    covariance: Array | None = column("cov_{xy,xz,yz}_m2ps2")
    error_velocity: Array | None = column("error_velocity_mps")
    fom: Array | None = column("fom_mps")
    altitude: Array | None = column("altitude_m")
    range: Array | None = column("range{i}_m")
    beam_valid: Array | None = column("beam{i}_valid")
    beam_correlation: Array | None = column("beam{i}_correlation")
    sound_speed: Array | None = column("sound_speed_mps")
    frame: Text | None = column("frame", text=True)
    transmit: Array | None = column("transmit_s")


@dataclass(frozen=True, kw_only=True, eq=False)
class WaterVelocity(Dvl):
    """Velocity of the vehicle through the water (m/s), as Dvl."""

    kind = "water_velocity"
    cell_start: Array | None = column("cell_start_m")
    cell_end: Array | None = column("cell_end_m")


@dataclass(frozen=True, kw_only=True, eq=False)
class Speed(Table):
    """Speed through the water, forward (m/s)."""

    kind = "speed"
    speed: Array = column("speed_mps", required=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Depth(Table):
    """Depth below the instantaneous mean water surface, positive down (m)."""

    kind = "depth"
    depth: Array = column("depth_m", required=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Pressure(Table):
    """Absolute pressure (Pa)."""

    kind = "pressure"
    pressure: Array = column("pressure_pa", required=True)
    atmosphere: Array | None = column("atmosphere_pa")
    temperature: Array | None = column("temperature_degc")


@dataclass(frozen=True, kw_only=True, eq=False)
class Altimeter(Table):
    """Range along the sensor's axis (m)."""

    kind = "altimeter"
    range: Array = column("range_m", required=True)
    sigma: Array | None = column("sigma_m")


@dataclass(frozen=True, kw_only=True, eq=False)
class Gnss(Table):
    """Satellite position of the antenna (rad, rad, m above the ellipsoid) and velocity (m/s, NED)."""

    kind = "gnss"
    latitude: Array = column("latitude_deg", required=True)
    longitude: Array = column("longitude_deg", required=True)
    height: Array | None = column("height_m")
    sigma_axes: Array | None = column("sigma_{north,east,down}_m")
    sigma: Array | None = column("sigma_m")
    hdop: Array | None = column("hdop")
    fix_type: Text | None = column("fix_type", text=True)
    satellites: Array | None = column("satellites")
    velocity: Array | None = column("velocity_{north,east,down}_mps")
    sigma_velocity: Array | None = column("sigma_velocity_mps")


@dataclass(frozen=True, kw_only=True, eq=False)
class PositionFix(Table):
    """A position solved elsewhere (USBL, LBL, SBL, landmark): geographic (rad) or north and east of the origin (m)."""

    kind = "position_fix"
    alternatives = (("latitude", "longitude"), ("north", "east"))
    latitude: Array | None = column("latitude_deg")
    longitude: Array | None = column("longitude_deg")
    north: Array | None = column("north_m")
    east: Array | None = column("east_m")
    depth: Array | None = column("depth_m")
    sigma_axes: Array | None = column("sigma_{north,east,depth}_m")
    sigma: Array | None = column("sigma_m")
    cov_north_east: Array | None = column("cov_north_east_m2")
    source: Text | None = column("source", text=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class ZeroVelocity(Table):
    """Moments at which the vehicle is known to stand still over the ground, with the sigma of that (m/s)."""

    kind = "zero_velocity"
    sigma: Array | None = column("sigma_mps")


@dataclass(frozen=True, kw_only=True, eq=False)
class Navigation(Table):
    """Another system's filtered output: compared, or used as increments; never as independent fixes."""

    kind = "navigation"
    latitude: Array | None = column("latitude_deg")
    longitude: Array | None = column("longitude_deg")
    north: Array | None = column("north_m")
    east: Array | None = column("east_m")
    depth: Array | None = column("depth_m")
    height: Array | None = column("height_m")
    velocity: Array | None = column("velocity_{north,east,down}_mps")
    roll: Array | None = column("roll_deg")
    pitch: Array | None = column("pitch_deg")
    heading: Array | None = column("heading_deg")
    sigma_position: Array | None = column("sigma_{north,east,depth}_m")
    sigma_velocity: Array | None = column("sigma_velocity_{north,east,down}_mps")
    sigma_attitude: Array | None = column("sigma_{roll,pitch,heading}_deg")


@dataclass(frozen=True, kw_only=True, eq=False)
class AcousticRange(Table):
    """Distance or travel time between a beacon (`transmitter`) and a receiver; `time` is the reception."""

    kind = "acoustic_range"
    alternatives: ClassVar[tuple[tuple[str, ...], ...]] = (("range",), ("travel_time",))
    transmitter: Text = column("transmitter", required=True, text=True)
    range: Array | None = column("range_m")
    travel_time: Array | None = column("travel_time_s")
    receiver: Text | None = column("receiver", text=True)
    path: Text | None = column("path", text=True)
    transmit: Array | None = column("transmit_s")
    turnaround: Array | None = column("turnaround_s")
    reference: Text | None = column("reference", text=True)
    sigma: Array | None = column("sigma_m")
    snr: Array | None = column("snr_db")
    peak: Array | None = column("peak")
    beacon_latitude: Array | None = column("beacon_latitude_deg")
    beacon_longitude: Array | None = column("beacon_longitude_deg")
    beacon_north: Array | None = column("beacon_north_m")
    beacon_east: Array | None = column("beacon_east_m")
    beacon_depth: Array | None = column("beacon_depth_m")
    beacon_sigma: Array | None = column("beacon_sigma_m")
    beacon_velocity: Array | None = column("beacon_velocity_{north,east}_mps")


@dataclass(frozen=True, kw_only=True, eq=False)
class AcousticBearing(AcousticRange):
    """Direction to a transmitter (rad): azimuth from x towards y, elevation from the xy plane, positive towards z."""

    kind = "acoustic_bearing"
    alternatives: ClassVar[tuple[tuple[str, ...], ...]] = (("azimuth",),)
    azimuth: Array | None = column("azimuth_deg", required=True)
    elevation: Array | None = column("elevation_deg")
    sigma_angle: Array | None = column("sigma_angle_deg")
    frame: Text | None = column("frame", text=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Usbl(AcousticBearing):
    """Direction (rad) and range or travel time to a transmitter, one row per ping."""

    kind = "usbl"
    alternatives = (("azimuth", "elevation", "range"), ("azimuth", "elevation", "travel_time"))


@dataclass(frozen=True, kw_only=True, eq=False)
class Platform(Table):
    """Pose of a ship, buoy or other vehicle that carries transducers."""

    kind = "platform"
    name: Text = column("name", required=True, text=True)
    latitude: Array | None = column("latitude_deg")
    longitude: Array | None = column("longitude_deg")
    north: Array | None = column("north_m")
    east: Array | None = column("east_m")
    depth: Array | None = column("depth_m")
    height: Array | None = column("height_m")
    roll: Array | None = column("roll_deg")
    pitch: Array | None = column("pitch_deg")
    heading: Array | None = column("heading_deg")
    sigma: Array | None = column("sigma_m")
    sigma_attitude: Array | None = column("sigma_{roll,pitch,heading}_deg")


@dataclass(frozen=True, kw_only=True, eq=False)
class Swath(Table):
    """Multibeam ranges (m) or travel times (s) by angle across, positive to starboard (rad)."""

    kind = "swath"
    alternatives = (("range",), ("travel_time",))
    beam: Array = column("beam", required=True)
    angle_across: Array = column("angle_across_deg", required=True)
    range: Array | None = column("range_m")
    travel_time: Array | None = column("travel_time_s")
    ping: Array | None = column("ping")
    angle_along: Array | None = column("angle_along_deg")
    sound_speed: Array | None = column("sound_speed_mps")
    quality: Array | None = column("quality")
    sigma: Array | None = column("sigma_m")
    head: Text | None = column("head", text=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Sounding(Table):
    """Soundings in the sensor frame (m), ray-traced by the instrument."""

    kind = "sounding"
    beam: Array = column("beam", required=True)
    position: Array = column("{x,y,z}_m", required=True)
    ping: Array | None = column("ping")


@dataclass(frozen=True, kw_only=True, eq=False)
class Thruster(Table):
    """Thruster speeds (revolutions per second) and fin angles (rad)."""

    kind = "thruster"
    thruster: Array = column("thruster{i}_rps", required=True)
    rudder: Array | None = column("rudder_deg")
    stern: Array | None = column("stern_deg")


@dataclass(frozen=True, kw_only=True, eq=False)
class MotorCurrent(Table):
    """Electric currents of the motors (A)."""

    kind = "motor_current"
    motor: Array = column("motor{i}_a", required=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class WaterCurrent(Table):
    """Velocity of the water over the ground (m/s)."""

    kind = "water_current"
    current: Array = column("current_{north,east}_mps", required=True)
    current_down: Array | None = column("current_down_mps")
    depth: Array | None = column("depth_m")
    sigma: Array | None = column("sigma_mps")


@dataclass(frozen=True, kw_only=True, eq=False)
class SoundSpeed(Table):
    """Speed of sound in the water (m/s)."""

    kind = "sound_speed"
    sound_speed: Array = column("sound_speed_mps", required=True)
    depth: Array | None = column("depth_m")
    temperature: Array | None = column("temperature_degc")
    salinity: Array | None = column("salinity_psu")


@dataclass(frozen=True, kw_only=True, eq=False)
class SoundSpeedProfile(SoundSpeed):
    """Speed of sound (m/s) against depth (m)."""

    kind = "sound_speed_profile"


@dataclass(frozen=True, kw_only=True, eq=False)
class WaterLevel(Table):
    """Water level above the map's datum (m)."""

    kind = "water_level"
    water_level: Array = column("water_level_m", required=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class ScalarField(Table):
    """A scalar in the unit that the vehicle file names."""

    kind = "scalar_field"
    value: Array = column("value", required=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth(Table):
    """Reference positions, attitudes and velocities; may be sparse; read by assessment alone."""

    kind = "truth"
    latitude: Array | None = column("latitude_deg")
    longitude: Array | None = column("longitude_deg")
    north: Array | None = column("north_m")
    east: Array | None = column("east_m")
    depth: Array | None = column("depth_m")
    height: Array | None = column("height_m")
    roll: Array | None = column("roll_deg")
    pitch: Array | None = column("pitch_deg")
    heading: Array | None = column("heading_deg")
    velocity: Array | None = column("velocity_{north,east,down}_mps")
    sigma: Array | None = column("sigma_m")
    sigma_axes: Array | None = column("sigma_{north,east,depth}_m")
    outlier: Array | None = column("outlier")


@dataclass(frozen=True, kw_only=True, eq=False)
class Other(Table):
    """A table of a kind that Leadline does not know: its columns are carried for a user's own sensor model."""

    kind = "other"


KINDS: Mapping[str, type[Table]] = {
    record.kind: record
    for record in (
        Imu, Magnetometer, Attitude, Heading, YawRate, Dvl, WaterVelocity, Speed, Depth, Pressure, Altimeter, Gnss, PositionFix,
        ZeroVelocity, Navigation, AcousticRange, Usbl, AcousticBearing, Platform, Swath, Sounding, Thruster, MotorCurrent,
        WaterCurrent, SoundSpeed, SoundSpeedProfile, WaterLevel, ScalarField, Truth,
    )
}  # fmt: skip


def expand(pattern: str, present: Iterator[str] | list[str]) -> list[str]:
    """Return the file columns of a pattern: `{x,y,z}` as listed, `{i}` as many numbered ones as are `present`, in order."""
    if "{i}" in pattern:
        before, after = map(re.escape, pattern.split("{i}"))
        found = [(int(m[1]), name) for name in present if (m := re.fullmatch(rf"{before}(\d+){after}", name))]
        return [name for _, name in sorted(found)]
    if match := re.search(r"\{([^}]*)\}", pattern):
        return [pattern.replace(match[0], part) for part in match[1].split(",")]
    return [pattern]
