"""Which keys each kind of sensor may have in a vehicle file, with their types and ranges, in the human units in which they are written."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

if TYPE_CHECKING:
    from collections.abc import Mapping

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Probability = Annotated[float, Field(gt=0, le=1)]
Vector = Annotated[list[Finite], Field(min_length=3, max_length=3)]


class Keys(BaseModel):
    """A table of a vehicle file: unknown keys are refused, nothing is converted silently."""

    model_config = ConfigDict(extra="forbid", strict=True, defer_build=True)  # of a vehicle with few kinds few are built


class Sensor(Keys):
    """What every sensor may say."""

    kind: str | None = None
    preset: str | None = None
    model: str | None = None
    lever_arm_m: Vector = [0.0, 0.0, 0.0]
    mounting_deg: Vector = [0.0, 0.0, 0.0]
    mounting_matrix: Annotated[list[Vector], Field(min_length=3, max_length=3)] | None = None
    gate_probability: Probability = 0.999
    student_dof: Positive | None = None
    gate_widening_s: Positive | None = None
    reanchor_after: Annotated[int, Field(ge=2)] | None = None
    every_s: Positive | None = None
    standby_for: str | None = None
    standby_after_s: Positive = 2.0
    latency_s: Finite = 0.0
    clock: str | None = None
    mend_clock: bool = True
    repeats: Literal["new", "held"] = "new"
    rate_hz: Positive | None = None
    nuisance: dict[str, Any] = {}
    simulated: dict[str, Any] = {}  # what a simulator adds; no filter reads it


COMMON = frozenset(Sensor.model_fields) - {"rate_hz"}


class Imu(Sensor):
    """Noise as densities, biases as turn-on sigma and as the in-run instability that they wander by.

    A bias is a random constant that walks by its instability within tau, or (`gauss_markov`) a stationary process of its sigma and tau.
    """

    gyro_noise_deg_per_rth: NotNegative
    gyro_bias_deg_per_h: NotNegative
    gyro_bias_instability_deg_per_h: NotNegative = 0.0
    gyro_bias_tau_s: Positive = 3600.0
    gyro_bias_process: Literal["random_walk", "gauss_markov"] = "random_walk"
    accel_noise_ug_per_rthz: NotNegative
    accel_bias_ug: NotNegative
    accel_bias_instability_ug: NotNegative = 0.0
    accel_bias_tau_s: Positive = 3600.0
    accel_bias_process: Literal["random_walk", "gauss_markov"] = "random_walk"
    sigma_level_mps2: Positive = 0.2
    gap_s: Positive | None = None
    gap_accel_mps2_per_rthz: Positive = 0.3
    gap_rate_degps_per_rthz: Positive = 3.0


class Doppler(Sensor):
    """A Doppler log.  `use` says whether the vector or the single beams are taken."""

    sigma_mps: Positive
    use: Literal["velocity", "beams"] = "velocity"
    frame: Literal["sensor", "body", "level", "ned"] = "sensor"
    beam_azimuth_deg: list[Finite] | None = None
    beam_tilt_deg: Annotated[float, Field(gt=0, lt=90)] | None = None
    beam_sigma_mps: Positive | None = None
    phased_array: bool = False
    speed_max_mps: Positive = 10.0
    sigma_per_fom: Positive | None = None
    fom_max_mps: Positive | None = None
    error_velocity_max_mps: Positive | None = None
    correlation_min: NotNegative | None = None


class Dvl(Doppler):
    """A Doppler log over the bottom; its altitude is used only when it has a sigma."""

    altitude_sigma_m: Positive | None = None


class WaterVelocity(Doppler):
    """A Doppler log through the water."""


class Speed(Sensor):
    """A log of speed through the water, along the sensor's x axis."""

    sigma_mps: Positive
    speed_max_mps: Positive = 10.0


class Depth(Sensor):
    """A depth sensor."""

    sigma_m: Positive


class Pressure(Sensor):
    """A sensor of absolute pressure; density and gravity are those of the standard ocean and of the latitude unless given."""

    sigma_pa: Positive
    full_scale_pa: Positive | None = None
    density_kgpm3: Positive | None = None
    gravity_mps2: Positive | None = None
    atmosphere_pa: Positive = 101325.0


class Altimeter(Sensor):
    """An echo sounder along the sensor's z axis."""

    sigma_m: Positive
    range_max_m: Positive | None = None


class YawRate(Sensor):
    """A single gyro about the sensor's z axis; noise as a density, so `rate_hz` is needed."""

    noise_deg_per_rth: Positive
    rate_max_degps: Positive | None = None
    earth_rate: Literal["felt", "removed"] = "felt"


class Heading(Sensor):
    """A compass or gyrocompass; the declination is added to a magnetic heading."""

    sigma_deg: Positive
    reference: Literal["true", "magnetic"] = "true"
    declination_deg: Finite | None = None
    declination: Literal["wmm"] | None = None


class Attitude(Heading):
    """An attitude and heading reference: sigma of heading, and of roll and pitch."""

    sigma_tilt_deg: Positive


class Gnss(Sensor):
    """Satellite positions; the height is used only when asked for, the velocity when it has a sigma."""

    sigma_m: Positive
    sigma_single_m: Positive | None = None
    sigma_dgps_m: Positive | None = None
    sigma_float_m: Positive | None = None
    sigma_fixed_m: Positive | None = None
    sigma_per_hdop_m: Positive | None = None
    sigma_velocity_mps: Positive | None = None
    surface_depth_m: Finite | None = None
    vertical: bool = False
    sigma_vertical_m: Positive | None = None


class PositionFix(Sensor):
    """Positions solved elsewhere."""

    sigma_m: Positive
    sigma_depth_m: Positive | None = None
    vertical: bool = True


class ZeroVelocity(Sensor):
    """Moments of rest."""

    sigma_mps: Positive


class AcousticRange(Sensor):
    """Ranges to beacons; `range_max_m` says how long a two-way flight is awaited."""

    sigma_m: Positive
    sound_speed_mps: Positive = 1500.0
    range_max_m: Positive = 5000.0
    path: Literal["one_way", "two_way"] = "one_way"


class Navigation(Sensor):
    """Another system's navigation: compared alone, or used as increments."""

    use: Literal["none", "increments"] = "none"
    increment_s: Positive = 10.0
    sigma_m: NotNegative = 0.0
    sigma_rate_m_per_rts: NotNegative = 0.0
    sigma_distance_percent: NotNegative = 0.0
    sigma_depth_m: Positive | None = None
    sigma_heading_deg: Positive | None = None


class Carried(Sensor):
    """A sensor that no model of Leadline uses yet, or a user's own (`model`): any further key is handed to it."""

    model_config = ConfigDict(extra="allow", strict=True)


BY_KIND: Mapping[str, type[Sensor]] = {
    "imu": Imu, "dvl": Dvl, "depth": Depth, "heading": Heading, "attitude": Attitude, "gnss": Gnss, "position_fix": PositionFix,
    "zero_velocity": ZeroVelocity, "acoustic_range": AcousticRange, "water_velocity": WaterVelocity, "speed": Speed,
    "pressure": Pressure, "altimeter": Altimeter, "yaw_rate": YawRate, "navigation": Navigation,
}  # fmt: skip
