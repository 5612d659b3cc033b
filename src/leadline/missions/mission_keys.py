"""Which keys a mission file may hold: one dive in a simulated sea, in the human units in which a person writes it."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from leadline.data.sensor_keys import Finite, Keys, NotNegative, Positive

Pair = Annotated[list[Finite], Field(min_length=2, max_length=2)]
Latitude = Annotated[float, Field(ge=-90, le=90)]
Longitude = Annotated[float, Field(ge=-180, le=360)]
Seed = Annotated[int, Field(ge=0)]
Length = Annotated[float, Field(ge=0.1, allow_inf_nan=False)]  # of what is sailed (m)
NODES = 2.5e7  # that the ground may have: 200 MB


def zoned(value: datetime) -> datetime:
    """Return a date and time; refuses one that does not say of which zone."""
    if value.tzinfo is None:
        raise PydanticCustomError("zone", "give it with Z")
    return value


def placed(pair: list[float]) -> list[float]:
    """Return latitude and longitude; refuses what is none."""
    if not (abs(pair[0]) <= 90.0 and -180.0 <= pair[1] <= 360.0):
        raise PydanticCustomError("placed", "latitude -90 to 90, longitude -180 to 360")
    return pair


def bent(radius: float) -> float:
    """Return a radius; refuses one that is too small to be sailed, to port or to starboard."""
    if not abs(radius) >= 0.1:
        raise PydanticCustomError("bent", "0.1 or more in size")
    return radius


Geographic = Annotated[Pair, AfterValidator(placed)]
Radius = Annotated[float, Field(allow_inf_nan=False), AfterValidator(bent)]
Turns = Annotated[float, Field(ge=0.01, le=1000)]


class Origin(Keys):
    """Where north and east are counted from, and how high the geoid lies there."""

    latitude_deg: Latitude
    longitude_deg: Longitude
    geoid_undulation_m: Finite = 0.0


class Start(Keys):
    """Where the vehicle starts, and how far the stated start of the log lies from that (sigmas)."""

    north_m: Finite = 0.0
    east_m: Finite = 0.0
    depth_m: Finite = 0.0
    heading_deg: Finite = 0.0
    speed_mps: NotNegative = 0.0
    sigma_position_m: NotNegative = 1.0
    sigma_depth_m: NotNegative = 0.1
    sigma_velocity_mps: NotNegative = 0.05
    sigma_tilt_deg: NotNegative = 0.3
    sigma_heading_deg: NotNegative = 2.0


class ShearRow(Keys):
    """Current at one depth."""

    depth_m: Finite
    north_mps: Finite
    east_mps: Finite


class TidalCurrent(Keys):
    """A current that goes round with the tide."""

    major_mps: Finite
    heading_deg: Finite
    minor_mps: Finite = 0.0
    period_h: Positive = 12.4206
    crest_s: Finite = 0.0


class Wandering(Keys):
    """A current that wanders: a Gauss-Markov process of the mission's own seed."""

    sigma_mps: NotNegative
    tau_s: Positive
    seed: Seed = 0


class Current(Keys):
    """The current: uniform, or by depth; and what comes on top."""

    north_mps: Finite | None = None
    east_mps: Finite | None = None
    profile: list[ShearRow] = []
    tides: list[TidalCurrent] = []
    wander: Wandering | None = None


class Waves(Keys):
    """A sea state."""

    height_m: NotNegative
    period_s: Positive
    heading_deg: Finite = 0.0
    gamma: Annotated[float, Field(ge=1, le=10)] = 3.3
    seed: Seed = 0


class Tide(Keys):
    """A constituent of the tide."""

    amplitude_m: NotNegative
    period_h: Positive = 12.4206
    crest_s: Finite = 0.0


class SoundRow(Keys):
    """Speed of sound at one depth."""

    depth_m: Finite
    speed_mps: Annotated[float, Field(ge=1300, le=1700)]


class Square(Keys):
    """A square of ground: its grid is one, and fits into memory."""

    size_m: Positive
    step_m: Positive

    @model_validator(mode="after")
    def _small(self) -> Self:
        if not 4.0 <= (self.size_m / self.step_m + 1.0) ** 2 <= NODES:
            raise PydanticCustomError("nodes", "size_m from one step_m to 4999 of them: the square of that is its number of nodes")
        return self


class Fractal(Square):
    """Ground of a stated roughness: spectrum k^-beta, sigma of the depth or RMS slope, from a seed of its own."""

    depth_m: Positive
    beta: Annotated[float, Field(gt=1, lt=5)] = 3.2
    sigma_m: NotNegative | None = None
    rms_slope: NotNegative | None = None
    seed: Seed = 0
    centre_m: Pair = [0.0, 0.0]


class Plane(Square):
    """A level or sloping ground."""

    depth_m: Positive
    slope_north: Finite = 0.0
    slope_east: Finite = 0.0
    size_m: Positive = 2000.0
    step_m: Positive = 50.0
    centre_m: Pair = [0.0, 0.0]


class Terrain(Keys):
    """The ground: one of a chart, a fractal, a plane."""

    chart: str | None = None
    positive: Literal["down", "up"] = "down"
    geographic: bool | None = None
    fractal: Fractal | None = None
    plane: Plane | None = None


class Sea(Keys):
    """The sea."""

    density_kgpm3: Annotated[float, Field(ge=950, le=1100)] = 1025.0
    current: Current | None = None
    waves: Waves | None = None
    tides: list[Tide] = []
    sound_speed_mps: Annotated[float, Field(ge=1300, le=1700)] | None = None
    sound: list[SoundRow] = []
    terrain: Terrain | None = None


class Surfacing(Keys):
    """Up to the surface on a schedule."""

    every_s: Positive
    stay_s: NotNegative
    stop: bool = False


class PlanKeys(Keys):
    """What the vehicle is to do."""

    legs: list[dict[str, Any]] = Field(min_length=1)
    speed_mps: Positive | None = None
    depth_m: Finite | None = None
    altitude_m: Positive | None = None
    surfacing: Surfacing | None = None
    ascend: bool = False
    stay_s: NotNegative = 0.0


class Leg(Keys):
    """What every leg may say; speed and depth or altitude are those of the plan unless it says its own."""

    shape: str
    speed_mps: Positive | None = None
    depth_m: Finite | None = None
    altitude_m: Positive | None = None
    heading_deg: Finite | None = None


class Placed(Leg):
    """A shape that lies somewhere."""

    at_m: Pair | None = None
    bearing_deg: Finite = 0.0


class Waypoints(Leg):
    """Points to go through, in metres from the origin, or latitude and longitude."""

    through_m: Annotated[list[Pair], Field(min_length=1)] | None = None
    through_deg: Annotated[list[Geographic], Field(min_length=1)] | None = None


class Lawnmower(Placed):
    """Parallel lines."""

    legs: Annotated[int, Field(ge=1, le=500)]
    length_m: Length
    spacing_m: Finite
    square: bool = False


class Sides(Placed):
    """A triangle or a square."""

    length_m: Length
    laps: Annotated[int, Field(ge=1, le=500)] = 1


class Circle(Placed):
    """A circle."""

    radius_m: Radius
    turns: Turns = 1.0


class Spiral(Placed):
    """A helix."""

    radius_m: Radius
    turns: Turns
    end_depth_m: Finite


class Sine(Placed):
    """A sine."""

    length_m: Length
    amplitude_m: Finite
    wavelength_m: Annotated[float, Field(ge=0.5, allow_inf_nan=False)]


class Ell(Placed):
    """An L and back."""

    length_m: Length
    width_m: Finite


class Hold(Leg):
    """Station keeping."""

    for_s: Positive
    at_m: Pair | None = None


class Rotate(Hold):
    """A turn on the spot."""

    angle_deg: Finite


SHAPES: dict[str, type[Leg]] = {
    "waypoints": Waypoints, "lawnmower": Lawnmower, "triangle": Sides, "square": Sides, "circle": Circle, "spiral": Spiral, "sine": Sine,
    "ell": Ell, "hold": Hold, "rotate": Rotate,
}  # fmt: skip


class Beacon(Keys):
    """An acoustic beacon that stays where it is."""

    north_m: Finite | None = None
    east_m: Finite | None = None
    latitude_deg: Latitude | None = None
    longitude_deg: Longitude | None = None
    depth_m: Finite
    sigma_north_m: NotNegative = 0.0
    sigma_east_m: NotNegative = 0.0
    sigma_depth_m: NotNegative = 0.0
    turnaround_s: NotNegative = 0.0


class Platform(Keys):
    """A ship, a buoy or another vehicle that carries transducers and moves."""

    through_m: list[Pair] = Field(min_length=1)
    speed_mps: Positive = 1.0
    drift_north_mps: Finite = 0.0
    drift_east_mps: Finite = 0.0
    heading_deg: Finite = 0.0
    depth_m: Finite = 0.0
    turnaround_s: NotNegative = 0.0
    heave_m: NotNegative = 0.0
    roll_deg: NotNegative = 0.0
    period_s: Positive = 8.0


class Navigation(Keys):
    """What the pilot steers by: the truth, or the estimate of a navigator that runs aboard."""

    steer_by: Literal["truth", "estimate"] = "truth"
    delay_s: NotNegative = 0.0


class MissionKeys(Keys):
    """A whole mission file."""

    outermost: ClassVar[bool] = True
    name: str
    vehicle: str
    hull: str
    note: str = ""
    epoch: Annotated[datetime, AfterValidator(zoned)]
    duration_s: Positive | None = None
    truth_rate_hz: Annotated[float, Field(gt=0, le=2000)] = 10.0
    origin: Origin
    start: Start = Start()
    sea: Sea = Sea()
    plan: PlanKeys
    beacons: dict[str, Beacon] = {}
    platforms: dict[str, Platform] = {}
    instruments: dict[str, dict[str, Any]] = {}
    faults: list[dict[str, Any]] = []
    navigation: Navigation = Navigation()
