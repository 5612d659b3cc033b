"""The simulated instruments that a vehicle file describes: one file, read once by the filter and once by the simulator.

What the filter takes for Gaussian with a sigma is drawn with that sigma: a bias as a turn-on value and a random walk of density
instability / sqrt(tau), a nuisance by its prior, white noise by its density.  What the simulator cannot make is refused; priors of lever
arms, times and clocks, and of scale and misalignment of an inertial unit, are not drawn, and refused where they state a value.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from leadline.core.attitude import euler_from_quaternion, exponential, matrix_from_quaternion, quaternion_from_matrix
from leadline.data.errors import InputError
from leadline.data.vehicle import Prior
from leadline.missions.undrawn import check_undrawn
from leadline.simulate import instruments as simulated
from leadline.simulate.instruments import STILL, Drift, Surrounding

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from datetime import datetime

    from numpy.random import Generator

    from leadline.data import records
    from leadline.data.log import Beacon
    from leadline.data.records import Array
    from leadline.data.vehicle import SensorConfig, Vehicle

    Beacons = Mapping[str, Beacon]

NOTHING = Prior(np.zeros(1), np.zeros(1))


def instruments_of(
    vehicle: Vehicle, rates: Mapping[str, float] | None = None, beacons: Beacons | None = None, sea: datetime | None = None
) -> dict[str, simulated.Instrument[Any]]:
    """Return by name the simulated instruments that match a vehicle, for the kinds that the simulator can make.

    rates: Hz by sensor, before the `rate_hz` of the vehicle file; to change anything else, `dataclasses.replace` an instrument.
    beacons: those that acoustic ranges are taken to, where they truly are.  sea: the date, where the trajectory has a sea of its own, whose
    water and magnetic field are looked at; else current and sea bed are drawn from the priors of the vehicle file.  Raises InputError for a
    sensor without a rate, and for a prior that the simulator cannot draw from.
    """
    given, around = rates or {}, Around(beacons or {}, vehicle.shared, sea)
    check_undrawn(vehicle)
    return {
        name: MAKERS[config.kind](config, given.get(name) or float(config.value("rate")), around)
        for name, config in vehicle.sensors.items()
        if config.kind in MAKERS
    }


@dataclass(frozen=True)
class Around:
    """What lies around the vehicle: beacons where they truly are, and the priors of current and sea bed."""

    beacons: Beacons
    shared: Mapping[str, Prior]
    date: datetime | None = None  # of a sea that is the trajectory's own

    def surrounding(self, name: str, axes: int) -> Surrounding:
        """Return the current or the sea bed as its prior describes it; raises InputError where it changes along the way."""
        prior = self.shared.get(name, Prior(np.zeros(axes), np.zeros(axes)))
        if np.isfinite(prior.length):
            raise InputError(name, f"changes over {prior.length} m", "no length_m: the simulator's sea changes in time alone")
        drift = drift_of(replace(prior, value=np.zeros(axes)), name)
        return Surrounding(name, tuple(map(float, prior.value)), drift)

    @property
    def current(self) -> Surrounding:
        """The current, north and east, on top of the water of the trajectory's own sea."""
        if self.date is not None:
            return STILL
        return self.surrounding("water.current", 2)

    @property
    def seabed(self) -> Surrounding | None:
        """The depth of the sea bed, where the vehicle file speaks of it."""
        return self.surrounding("seabed.depth", 1) if "seabed.depth" in self.shared and self.date is None else None


@dataclass(frozen=True)
class Axes(Drift):
    """A drift whose turn-on sigma differs by axis."""

    sigma: tuple[float, ...] = ()

    def draw(self, time: Array, axes: int, generator: Generator) -> Array:
        """Return the error (times, axes)."""
        return super().draw(time, axes, generator) + np.asarray(self.sigma) * generator.standard_normal(axes)


@dataclass(frozen=True, kw_only=True)
class Ranges(simulated.AcousticRange):
    """Acoustic ranges with a constant scale error and bias: z = (1 + scale) distance + bias (m), as timed at `sound_speed`."""

    sigma_scale: float = 0.0
    bias: Drift = field(default_factory=Drift)

    def noisy(self, table: records.AcousticRange, generator: Generator) -> records.AcousticRange:
        """Add scale and bias to the times of flight, then what every range suffers; the moment of reception stays the true one."""
        travel = cast("Array", table.travel_time)
        turnaround = 0.0 if table.turnaround is None else table.turnaround
        ways = 1.0 if table.turnaround is None else 2.0
        own, rest = generator.spawn(2)
        bias = ways / self.sound_speed * self.bias.draw(table.time, 1, own)[:, 0]
        longer = self.sigma_scale * own.standard_normal() * (travel - turnaround) + bias
        return super().noisy(replace(table, travel_time=travel + longer), rest)


@dataclass(frozen=True, kw_only=True)
class Doppler(simulated.Dvl):
    """A Doppler log whose velocities, and so its beams, are off by a bias in sensor axes (m/s)."""

    bias: Drift = field(default_factory=Drift)
    beam_bias: Drift = field(default_factory=Drift)

    def noisy(self, table: records.Dvl, generator: Generator) -> records.Dvl:
        """Add the biases to what the instrument measures otherwise."""
        return _biased(self, super().noisy(table, generator), generator)


@dataclass(frozen=True, kw_only=True)
class WaterDoppler(simulated.WaterVelocity):
    """The same of a Doppler log through the water."""

    bias: Drift = field(default_factory=Drift)
    beam_bias: Drift = field(default_factory=Drift)

    def noisy(self, table: records.Dvl, generator: Generator) -> records.Dvl:
        """Add the biases to what the instrument measures otherwise."""
        return _biased(self, super().noisy(table, generator), generator)


def _biased(log: Doppler | WaterDoppler, found: records.Dvl, generator: Generator) -> records.Dvl:
    own, each = generator.spawn(2)
    bias = log.bias.draw(found.time, 3, own)
    velocity = None if found.velocity is None else found.velocity + bias
    if found.beam is None:
        return replace(found, velocity=velocity)
    beams = bias @ simulated.beam_vectors(log.azimuths, log.tilt).T + log.beam_bias.draw(found.time, len(log.azimuths), each)
    return replace(found, velocity=velocity, beam=found.beam + beams)


def _placed(config: SensorConfig, rate: float) -> dict[str, Any]:
    """When and where an instrument measures."""
    if config.latency:
        raise InputError(f"sensors.{config.name}.latency_s", f"{config.latency}", "0: a simulated row bears its true time")
    return {"rate": rate, "lever_arm_b": tuple(map(float, config.lever_arm_b)), "mounting_bs": _angles(config.rotation_bs)}


def _angles(rotation: Array) -> simulated.Vector:
    roll, pitch, heading = (float(angle) for angle in euler_from_quaternion(quaternion_from_matrix(rotation)))
    return roll, pitch, heading


def _prior(config: SensorConfig, name: str) -> Prior:
    return config.nuisance.get(name, NOTHING)


def drift_of(prior: Prior, where: str) -> Drift:
    """Return what a prior describes: a constant that may walk, or with a finite tau a Gauss-Markov process in its steady state."""
    sigma = tuple(map(float, prior.sigma))
    value = tuple(map(float, prior.value))
    if np.isinf(prior.tau):
        return Axes(constant=value, walk=prior.walk, sigma=sigma)
    steady = max(sigma) if prior.steady is None else prior.steady
    if any(value) or any(s != steady for s in sigma):
        raise InputError(where, f"starts at {value} with sigma {sigma}", "with tau the simulator starts at 0 with the steady sigma")
    return Drift(steady=steady, tau=prior.tau)


def _constant(config: SensorConfig, name: str) -> tuple[Array, float]:
    """Value and sigma of a nuisance that the simulator draws once, equally for all axes."""
    prior = _prior(config, name)
    where = f"sensors.{config.name}.nuisance.{name}"
    if not np.isinf(prior.tau) or prior.walk or np.ptp(prior.sigma):
        raise InputError(where, "wanders, or differs by axis", "a value and one sigma: the simulator draws a constant")
    return prior.value, float(prior.sigma[0])


def _bias(sigma: float, instability: float, tau: float, process: str) -> Drift:
    if process == "gauss_markov":
        return Drift(steady=sigma, tau=tau)
    return Drift(turn_on=sigma, walk=float(instability / np.sqrt(tau)))


def _imu(config: SensorConfig, rate: float, around: Around) -> simulated.Imu:  # noqa: ARG001  (one contract for all makers)
    names = ("bias", "bias_instability", "bias_tau", "bias_process")
    gyro, accel = (_bias(*(config.value(f"{unit}_{name}") for name in names)) for unit in ("gyro", "accel"))
    return simulated.Imu(
        **_placed(config, rate),
        gyro_density=config.value("gyro_noise"),
        accel_density=config.value("accel_noise"),
        gyro_bias=gyro,
        accel_bias=accel,
    )


def _doppler(config: SensorConfig, rate: float, around: Around) -> dict[str, Any]:
    """What Doppler logs over ground and through the water have in common."""
    frame, beams = config.value("frame", "sensor"), config.value("use", "velocity") == "beams"
    if frame not in ("sensor", "body"):
        raise InputError(f"sensors.{config.name}.frame", f"'{frame}'", "sensor or body: the simulator levels no velocities")
    scale, sigma_scale = _constant(config, "scale")
    twist, sigma_mounting = _constant(config, "mounting")
    rotation = (config.rotation_bs if frame == "sensor" or beams else np.eye(3)) @ matrix_from_quaternion(exponential(twist * np.ones(3)))
    head: dict[str, Any] = {"sigma": config.value("sigma")}
    if around.date is not None and config.values.get("beam_azimuth"):  # it sees the ground by its beams, whatever is taken of it
        head |= {"azimuths": tuple(config.value("beam_azimuth")), "tilt": config.value("beam_tilt")}
    if beams:
        azimuths, sigma = tuple(config.value("beam_azimuth")), config.value("beam_sigma", config.value("sigma"))
        head = {"output": "beams", "azimuths": azimuths, "tilt": config.value("beam_tilt"), "beam_sigma": sigma}
        head["beam_bias"] = _first(_drift(config, "beam_bias", 4), len(azimuths))
    placed = _placed(config, rate) | {"mounting_bs": _angles(rotation)}
    errors: dict[str, Any] = {"scale": float(scale[0]), "sigma_scale": sigma_scale, "sigma_mounting": sigma_mounting}
    return placed | head | errors | {"bias": _drift(config, "bias", 3)}


def _first(drift: Drift, count: int) -> Drift:
    """The same drift of so many axes alone."""
    constant = drift.constant[:count] if isinstance(drift.constant, tuple) else drift.constant
    return replace(drift, constant=constant, sigma=drift.sigma[:count]) if isinstance(drift, Axes) else replace(drift, constant=constant)


def _dvl(config: SensorConfig, rate: float, around: Around) -> Doppler:
    sigma = config.values.get("altitude_sigma")
    below: dict[str, Any] = {} if sigma is None else {"seabed": around.seabed, "sigma_altitude": sigma}
    below["phased"] = bool(config.value("phased_array", False))
    return Doppler(**_doppler(config, rate, around), **below)


def _water_velocity(config: SensorConfig, rate: float, around: Around) -> WaterDoppler:
    return WaterDoppler(**_doppler(config, rate, around), current=around.current)


def _speed(config: SensorConfig, rate: float, around: Around) -> simulated.Speed:
    scale, sigma_scale = _constant(config, "scale")
    return simulated.Speed(
        **_placed(config, rate),
        current=around.current,
        scale=float(scale[0]),
        sigma_scale=sigma_scale,
        sigma=config.value("sigma"),
        bias=_drift(config, "bias"),
    )


def _pressure(config: SensorConfig, rate: float, around: Around) -> simulated.Pressure:  # noqa: ARG001
    scale, sigma_scale = _constant(config, "scale")
    return simulated.Pressure(
        **_placed(config, rate),
        sigma=config.value("sigma"),
        datum=_drift(config, "datum"),
        atmosphere=config.value("atmosphere"),
        density=config.values.get("density"),
        gravity=config.values.get("gravity"),
        scale=float(scale[0]),
        sigma_scale=sigma_scale,
    )


def _altimeter(config: SensorConfig, rate: float, around: Around) -> simulated.Altimeter:
    return simulated.Altimeter(**_placed(config, rate), seabed=around.seabed, sigma=config.value("sigma"), bias=_drift(config, "bias"))


def _yaw_rate(config: SensorConfig, rate: float, around: Around) -> simulated.YawRate:  # noqa: ARG001
    scale, sigma_scale = _constant(config, "scale")
    return simulated.YawRate(
        **_placed(config, rate),
        earth_removed=config.value("earth_rate") == "removed",
        scale=float(scale[0]),
        sigma_scale=sigma_scale,
        sigma=config.value("noise") * float(np.sqrt(config.value("rate", rate))),  # as the filter takes it, whatever the rate here
        bias=_drift(config, "bias"),
    )


def _navigation(config: SensorConfig, rate: float, around: Around) -> simulated.Navigation:  # noqa: ARG001
    (scale, sigma_scale), (rotation, sigma_rotation) = _constant(config, "scale"), _constant(config, "rotation")
    if sigma_scale or sigma_rotation or config.value("sigma", 0.0) or config.value("sigma_distance", 0.0):
        raise InputError(f"sensors.{config.name}", "has errors that the simulator does not draw", "sigma_rate_m_per_rts alone")
    half = np.sqrt(0.5)  # a difference of two readings
    return simulated.Navigation(
        **_placed(config, rate),
        scale=float(scale[0]),
        rotation=float(rotation[0]),
        walk=config.value("sigma_rate", 0.0),
        sigma_depth=half * config.value("sigma_depth", 0.0),
        sigma_heading=half * config.value("sigma_heading", 0.0),
    )


def _depth(config: SensorConfig, rate: float, around: Around) -> simulated.Depth:  # noqa: ARG001
    return simulated.Depth(**_placed(config, rate), sigma=config.value("sigma"), bias=_drift(config, "datum"))


def _drift(config: SensorConfig, name: str, axes: int = 1) -> Drift:
    prior = _prior(config, name)
    whole = replace(prior, value=prior.value * np.ones(axes), sigma=prior.sigma * np.ones(axes))
    return drift_of(whole, f"sensors.{config.name}.nuisance.{name}")


def _shifted(drift: Drift, offset: float) -> Drift:
    """The same drift about another value of its last axis: a reference that is not true north."""
    constant = np.atleast_1d(np.asarray(drift.constant, float)) + np.zeros(1)
    constant[-1] += offset
    return replace(drift, constant=tuple(map(float, constant)))


def _heading(config: SensorConfig, rate: float, around: Around) -> simulated.Heading:
    offset, swing = _angles(config.rotation_bs)[2] - _declination(config, around), _prior(config, "swing")
    drift, sigma_drift = _constant(config, "drift")
    if not np.isinf(swing.tau) or swing.walk:
        raise InputError(f"sensors.{config.name}.nuisance.swing", "wanders", "a value and a sigma: the simulator draws a constant")
    return simulated.Heading(
        **_placed(config, rate),
        sigma=config.value("sigma"),
        bias=_shifted(_drift(config, "bias"), offset),
        swing=tuple(map(float, swing.value * np.ones(4))),
        sigma_swing=tuple(map(float, swing.sigma * np.ones(4))),
        drift_rate=float(drift[0]),
        sigma_drift_rate=sigma_drift,
        date=_date(config, around),
    )


def _date(config: SensorConfig, around: Around) -> datetime | None:
    """The date whose magnetic field an instrument is turned by; None: it reads true north, or its declination is given."""
    by_model = config.value("reference", "true") == "magnetic" and config.value("declination") == "wmm"
    return around.date if by_model else None


def _declination(config: SensorConfig, around: Around) -> float:
    if config.value("reference", "true") != "magnetic" or _date(config, around) is not None:
        return 0.0
    if config.value("declination") == "wmm":
        raise InputError(f"sensors.{config.name}.declination", "'wmm'", "declination_deg: the simulator knows no magnetic field")
    return float(config.value("declination"))


def _attitude(config: SensorConfig, rate: float, around: Around) -> simulated.Attitude:
    tilt, heading = config.value("sigma_tilt"), config.value("sigma")
    if "swing" in config.nuisance:
        raise InputError(f"sensors.{config.name}.nuisance.swing", "is of an attitude", "none: the simulator draws that of a heading")
    bias = _shifted(_drift(config, "bias", 3), -_declination(config, around))
    return simulated.Attitude(**_placed(config, rate), sigma=(tilt, tilt, heading), bias=bias, date=_date(config, around))


def _gnss(config: SensorConfig, rate: float, around: Around) -> simulated.Gnss:  # noqa: ARG001
    sigma, bias = config.value("sigma"), _prior(config, "bias")
    if config.value("vertical", False) and (bias.walk or not np.isinf(bias.tau)):
        raise InputError(f"sensors.{config.name}.nuisance.bias", "wanders", "a constant, or vertical = false: height would wander too")
    level = bias if "bias" in config.nuisance else Prior(np.zeros(2), np.zeros(2))
    down = Prior(np.append(level.value, 0.0), np.append(level.sigma, 0.0)) if np.isinf(level.tau) else level
    return simulated.Gnss(
        **_placed(config, rate),
        sigma=(sigma, sigma, config.value("sigma_vertical", 2.0 * sigma)),
        sigma_velocity=config.values.get("sigma_velocity"),
        max_depth=config.value("surface_depth", 0.0),
        drift=drift_of(replace(level, value=down.value, sigma=down.sigma), f"sensors.{config.name}.nuisance.bias"),
    )


def _position_fix(config: SensorConfig, rate: float, around: Around) -> simulated.PositionFix:  # noqa: ARG001
    sigma = config.value("sigma")
    down = config.value("sigma_depth", sigma)
    own: dict[str, Any] = {"bias": _drift(config, "bias", 2)} if "bias" in config.nuisance else {}
    return simulated.PositionFix(**_placed(config, rate), depth=config.value("vertical", True), sigma=sigma, sigma_depth=down, **own)


def _zero_velocity(config: SensorConfig, rate: float, around: Around) -> simulated.ZeroVelocity:  # noqa: ARG001
    return simulated.ZeroVelocity(**_placed(config, rate), sigma=config.value("sigma"))


def _acoustic_range(config: SensorConfig, rate: float, around: Around) -> Ranges:
    path, speed = config.value("path", "one_way"), config.value("sound_speed", 1500.0)
    scale, sigma_scale = _constant(config, "scale")
    if np.any(scale):
        raise InputError(f"sensors.{config.name}.nuisance.scale", f"has the value {scale[0]}", "0: the simulator times at the true speed")
    return Ranges(
        **_placed(config, rate),
        beacons=around.beacons,
        path=path,
        sound_speed=speed,
        sigma=config.value("sigma") * (2.0 if path == "two_way" else 1.0) / speed,
        sigma_scale=sigma_scale,
        bias=_drift(config, "bias"),
    )


MAKERS: Mapping[str, Callable[[SensorConfig, float, Around], simulated.Instrument[Any]]] = {
    "imu": _imu, "dvl": _dvl, "depth": _depth, "heading": _heading, "attitude": _attitude, "gnss": _gnss,
    "position_fix": _position_fix, "zero_velocity": _zero_velocity, "acoustic_range": _acoustic_range, "water_velocity": _water_velocity,
    "speed": _speed, "pressure": _pressure, "altimeter": _altimeter, "yaw_rate": _yaw_rate, "navigation": _navigation,
}  # fmt: skip
