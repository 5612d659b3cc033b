"""Which keys each kind of fault may have in a mission file, with their types and ranges, and the fault that is made of them."""

from __future__ import annotations

from math import atan2, cos, sin
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from leadline.core.attitude import euler_from_quaternion, quaternion_from_matrix
from leadline.data.sensor_keys import Finite, NotNegative, Positive
from leadline.data.vehicle_keys import shown
from leadline.missions.fault_windows import Bounds, Ending, FaultKeys, Lasting, Share, Target
from leadline.simulate.faults import ClockJump, CompassSwinging, EmptyRows, LateDelivery, Loss, OfSome, Outage, Repeats, WildFixes
from leadline.simulate.faults_of_echoes import BeamLoss, FalseLock, LateEchoes, WildPings
from leadline.simulate.faults_of_values import (
    COLUMNS,
    AccelBiasJump,
    DepthDrift,
    FixJump,
    GyroBiasJump,
    NoiseBurst,
    ScaleJump,
    StuckValue,
    TideJump,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from leadline.data.vehicle import SensorConfig
    from leadline.simulate.faults import Fault

HOUR = 3600.0


Axis = Literal["x", "y", "z"]
Rows = Literal["invalid", "absent"]
AXES: tuple[Axis, ...] = ("x", "y", "z")


class Sometimes(Ending):
    """A fault of some rows: in the whole dive, where no window is given."""

    makes: ClassVar[type[OfSome]]

    fraction: Share

    def fault(self, target: Target) -> Fault:
        """Return the fault."""
        return self.makes(**self.span(target), fraction=self.fraction)


class DvlLoss(Lasting):
    """A Doppler log that does not find the ground."""

    usual, kinds = "dvl", ("dvl", "water_velocity")
    rows: Rows = "invalid"

    def fault(self, target: Target) -> Fault:
        """Return the outage."""
        return Outage(**self.span(target), rows=self.rows)


class BeamLosses(Lasting):
    """Beams of a Doppler log that hear nothing, counted from 1."""

    usual, kinds = "dvl", ("dvl", "water_velocity")
    beams: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=1)]

    def fault(self, target: Target) -> Fault:
        """Return the loss of beams."""
        return BeamLoss(**self.span(target), beams=tuple(sorted(set(self.beams))))


class FalseLocks(Lasting):
    """A Doppler log that takes a layer of the water, which moves over ground, for the ground."""

    usual, kinds = "dvl", ("dvl",)
    north_mps: Finite = 0.0
    east_mps: Finite = 0.0
    scale_percent: Finite = 0.0
    altitude_fraction: Annotated[float, Field(gt=0, le=1)] = 0.5

    def fault(self, target: Target) -> Fault:
        """Return the lock, with the geometry of the vehicle file."""
        geometry = {} if target.config is None else geometry_of(target.config)
        layer = (self.north_mps, self.east_mps)
        return FalseLock(**self.span(target), layer_n=layer, scale=self.si("scale_percent"), share=self.altitude_fraction, **geometry)


def geometry_of(config: SensorConfig) -> dict[str, Any]:
    """Return mounting and beams of a Doppler log (rad), as the simulator names them."""
    mounting = tuple(float(angle) for angle in euler_from_quaternion(quaternion_from_matrix(config.rotation_bs)))
    return {"mounting_bs": mounting, "azimuths": tuple(config.value("beam_azimuth", ())), "tilt": config.value("beam_tilt", 0.0)}


class UsblOutliers(Sometimes):
    """Wrong fixes; of a sensor of kind usbl wrong directions and ranges."""

    usual, kinds = "usbl", ("position_fix", "usbl", "gnss")
    size_m: Bounds = Field(default=[20.0, 60.0])
    size_deg: Bounds | None = None

    def fault(self, target: Target) -> Fault:
        """Return wild fixes, or where angles are given, or the sensor gives them, wild pings."""
        low, high = self.size_m
        pings = target.config.kind == "usbl" if target.config is not None else self.size_deg is not None
        if not pings and self.size_deg is not None:
            raise target.refused("size_deg", shown(self.size_deg), f"'{target.sensor}' measures no angles: take it out")
        if not pings:
            return WildFixes(**self.span(target), fraction=self.fraction, low=low, high=high)
        smallest, largest = self.si("size_deg") if self.size_deg is not None else (0.0, 0.0)
        given: dict[str, Any] = {"fraction": self.fraction, "low": low, "high": high, "angle_low": smallest, "angle_high": largest}
        return WildPings(**self.span(target), **given, **sound_of(target))


def sound_of(target: Target) -> dict[str, Any]:
    """Return the speed of sound (m/s) that a sensor counts with, where it is known."""
    return {} if target.config is None else {"sound_speed": float(target.config.value("sound_speed", 1500.0))}


class Late(Ending):
    """Rows that arrive late."""

    delay_s: Bounds = Field(default=[2.0, 8.0])

    def fault(self, target: Target) -> Fault:
        """Return the late delivery."""
        return LateDelivery(**self.span(target), low=self.delay_s[0], high=self.delay_s[1])


class LateUsbl(Late):
    """Fixes that arrive late."""

    usual, kinds = "usbl", ("position_fix", "usbl")


class CompassSwing(Lasting):
    """A compass that is off, and swings."""

    usual, kinds = "heading", ("heading", "attitude")
    size_deg: Finite | None = None
    amplitude_deg: Positive | None = None
    period_s: Positive = 60.0

    def fault(self, target: Target) -> Fault:
        """Return the swing, with a constant step where one is given."""
        if self.size_deg is None and self.amplitude_deg is None:
            raise target.refused("", "has no size", "give size_deg, amplitude_deg, or both")
        sizes = {
            name: self.si(key) for name, key in (("step", "size_deg"), ("amplitude", "amplitude_deg")) if getattr(self, key) is not None
        }
        return CompassSwinging(**self.span(target), period=self.period_s, **sizes)


class GyroBias(Lasting):
    """A gyro whose bias jumps."""

    usual, kinds = "imu", ("imu", "yaw_rate")
    size_deg_per_h: Finite
    axis: Axis = "z"

    def fault(self, target: Target) -> Fault:
        """Return the jump."""
        if target.config is not None and target.config.kind == "yaw_rate" and self.axis != "z":
            raise target.refused("axis", shown(self.axis), f"'{target.sensor}' is a single gyro, about its z axis")
        return GyroBiasJump(**self.span(target), size=self.si("size_deg_per_h"), axis=AXES.index(self.axis))


class AccelBias(Lasting):
    """An accelerometer whose bias jumps."""

    usual, kinds = "imu", ("imu",)
    size_ug: Finite
    axis: Axis = "z"

    def fault(self, target: Target) -> Fault:
        """Return the jump."""
        return AccelBiasJump(**self.span(target), size=self.si("size_ug"), axis=AXES.index(self.axis))


class GnssJump(Lasting):
    """Satellite positions that are displaced, and drawn away at a rate: on a bearing, or where none is given the way of the jump."""

    usual, kinds = "gnss", ("gnss", "position_fix")
    north_m: Finite = 0.0
    east_m: Finite = 0.0
    rate_mps: Finite = 0.0
    bearing_deg: Finite | None = None

    def fault(self, target: Target) -> Fault:
        """Return the jump and the drag."""
        jumps = bool(self.north_m or self.east_m)
        if not (jumps or self.rate_mps):
            raise target.refused("", "has no size", "give one of north_m, east_m, rate_mps")
        if self.rate_mps and not jumps and self.bearing_deg is None:
            raise target.refused("", "has a rate_mps, and no direction", "give bearing_deg")
        bearing = atan2(self.east_m, self.north_m) if self.bearing_deg is None else self.si("bearing_deg")
        drag = (self.rate_mps * cos(bearing), self.rate_mps * sin(bearing))
        return FixJump(**self.span(target), jump_n=(self.north_m, self.east_m), drag_n=drag)


class ClockJumps(Lasting):
    """A device clock that steps."""

    usual = "dvl"
    step_s: Finite

    def fault(self, target: Target) -> Fault:
        """Return the step."""
        return ClockJump(**self.span(target), step=self.step_s)


class DepthDrifts(Lasting):
    """A depth or pressure sensor that drifts."""

    usual, kinds = "depth", ("depth", "pressure")
    rate_mps: Finite | None = None
    rate_m_per_h: Finite | None = None

    def fault(self, target: Target) -> Fault:
        """Return the drift."""
        key = self.one_of(("rate_mps", "rate_m_per_h"), target)
        rate = getattr(self, key) / (HOUR if key == "rate_m_per_h" else 1.0)
        return DepthDrift(**self.span(target), rate=rate)


class TideJumps(Lasting):
    """A sea surface that rises: all depth and pressure sensors of the log."""

    usual, kinds = "depth", ("depth", "pressure")
    size_m: Finite

    def fault(self, target: Target) -> Fault:
        """Return the step."""
        return TideJump(**self.span(target), size=self.size_m)


class ImuGap(Lasting):
    """An inertial unit that is silent for a while."""

    usual, kinds = "imu", ("imu",)

    def fault(self, target: Target) -> Fault:
        """Return the gap."""
        return Outage(**self.span(target), rows="absent")


class Stuck(Lasting):
    """A sensor that repeats its last good value."""

    def fault(self, target: Target) -> Fault:
        """Return the fault."""
        return StuckValue(**self.span(target))


class ScaleJumps(Lasting):
    """A log of speed whose scale jumps."""

    usual, kinds = "dvl", tuple(COLUMNS["speed"])
    size_percent: Finite

    def fault(self, target: Target) -> Fault:
        """Return the jump."""
        return ScaleJump(**self.span(target), scale=self.si("size_percent"))


class Noise(Lasting):
    """A sensor with more noise."""

    sigma_m: NotNegative | None = None
    sigma_mps: NotNegative | None = None
    sigma_deg: NotNegative | None = None
    sigma_degps: NotNegative | None = None
    sigma_mps2: NotNegative | None = None
    sigma_pa: NotNegative | None = None

    def fault(self, target: Target) -> Fault:
        """Return the burst of noise."""
        key = self.one_of(tuple(QUANTITIES), target)
        kind, quantity = None if target.config is None else target.config.kind, QUANTITIES[key]
        if kind is not None and kind not in COLUMNS[quantity]:
            fitting = [name for name, of in QUANTITIES.items() if kind in COLUMNS[of]]
            found = f"is no noise of a sensor of kind {kind}"
            raise target.refused(key, found, f"give {' or '.join(fitting)}" if fitting else "another sensor: to this one none can be added")
        return NoiseBurst(**self.span(target), sigma=self.si(key), quantity=quantity, **sound_of(target))


QUANTITIES: Mapping[str, str] = {
    "sigma_m": "distance", "sigma_mps": "speed", "sigma_deg": "angle", "sigma_degps": "rate", "sigma_mps2": "force", "sigma_pa": "pressure",
}  # fmt: skip


class SensorDead(FaultKeys):
    """A sensor that dies for good."""

    from_s: Finite
    rows: Rows = "absent"

    def fault(self, target: Target) -> Fault:
        """Return the outage without an end."""
        return Outage(**self.span(target), rows=self.rows)


class Losses(Sometimes):
    """Rows that never arrive."""

    makes = Loss


class RepeatedRows(Sometimes):
    """Rows that come twice."""

    makes = Repeats


class Empty(Sometimes):
    """Rows that hold nothing and do not say so."""

    makes = EmptyRows


class RangeOutliers(Sometimes):
    """Ranges of echoes."""

    usual, kinds = "acoustic_range", ("acoustic_range", "usbl")
    size_m: Bounds = Field(default=[5.0, 50.0])

    def fault(self, target: Target) -> Fault:
        """Return the late echoes."""
        return LateEchoes(**self.span(target), fraction=self.fraction, low=self.size_m[0], high=self.size_m[1], **sound_of(target))


FAULTS: Mapping[str, type[FaultKeys]] = {
    "dvl_loss": DvlLoss, "beam_loss": BeamLosses, "false_lock": FalseLocks, "scale_jump": ScaleJumps, "usbl_outliers": UsblOutliers,
    "late_usbl": LateUsbl, "range_outliers": RangeOutliers, "compass_swing": CompassSwing, "gyro_bias_jump": GyroBias,
    "accel_bias_jump": AccelBias, "imu_gap": ImuGap, "gnss_jump": GnssJump, "depth_drift": DepthDrifts, "tide_jump": TideJumps,
    "clock_jump": ClockJumps, "stuck_value": Stuck, "noise_burst": Noise, "sensor_dead": SensorDead, "loss": Losses,
    "repeats": RepeatedRows, "empty": Empty, "late": Late,
}  # fmt: skip
