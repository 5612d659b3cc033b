"""Which keys the table of each process model may hold in a vehicle file ([process.cruise], ...), in human units, with defaults.

Noise of a velocity or of a rate is the root of the density of the random walk that it makes within a root of a second.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pydantic import Field

from leadline.data.sensor_keys import Keys, NotNegative, Positive
from leadline.data.vehicle_keys import NuisanceKeys

if TYPE_CHECKING:
    from collections.abc import Mapping


class Inertial(Keys):
    """Strapdown navigation: its noise stands with the inertial unit."""


class BodyVelocity(Keys):
    """Nine states driven by an inertial unit, whose noise it takes; what its biases do within a time counts as noise."""

    bias_s: NotNegative = 10.0


class Cruise(Keys):
    """Constant speed in five degrees of freedom; with a hull, its thrusters drive it."""

    surge_noise_mps_per_rts: Positive = 0.05
    sway_noise_mps_per_rts: Positive = 0.03
    heave_noise_mps_per_rts: Positive = 0.03
    pitch_noise_degps_per_rts: Positive = 1.0
    turn_noise_degps_per_rts: Positive = 2.0
    sigma_rate_degps: Positive = 3.0
    sigma_roll_deg: NotNegative = 3.0
    roll_s: Positive = 5.0
    hull: str | None = None
    thrusters: str = "thrusters"
    density_kgpm3: Positive = 1025.0


class Planar(Keys):
    """Constant acceleration and turn rate in the plane; depth and tilt are supplied by the named sensors, else by the first of a kind."""

    depth: str | None = None
    attitude: str | None = None
    accel_noise_mps2_per_rts: Positive = 0.1
    turn_noise_degps_per_rts: Positive = 2.0
    sigma_accel_mps2: Positive = 0.2
    sigma_rate_degps: Positive = 3.0
    sigma_tilt_deg: Positive = 2.0


class Dynamics(Keys):
    """Six degrees of freedom driven by thrusters; noise is what the hull's equation does not know."""

    hull: str
    thrusters: str = "thrusters"
    density_kgpm3: Positive = 1025.0
    surge_noise_mps_per_rts: Positive = 0.005
    sway_noise_mps_per_rts: Positive = 0.01
    heave_noise_mps_per_rts: Positive = 0.01
    roll_noise_degps_per_rts: Positive = 1.0
    pitch_noise_degps_per_rts: Positive = 0.5
    turn_noise_degps_per_rts: Positive = 0.5
    sigma_rate_degps: Positive = 3.0
    nuisance: dict[str, Any] = Field(default_factory=dict)


MODELS: Mapping[str, type[Keys]] = {
    "inertial": Inertial, "body-velocity": BodyVelocity, "cruise": Cruise, "planar": Planar, "dynamics": Dynamics,
}  # fmt: skip
NUISANCES: Mapping[str, Mapping[str, NuisanceKeys]] = {
    "dynamics": {"drag": NuisanceKeys("percent"), "thrust": NuisanceKeys("percent"), "buoyancy": NuisanceKeys("n")},
}
