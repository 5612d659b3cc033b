"""Doppler log over the bottom, as a vector or beam by beam; and the kernels that it shares with one through the water.

    y = R_bs^T R_nb^T v,  a = R_bs^T (w x l)     velocity over ground of the reference point, and of the transducer against it
    z = (1 + s) (y - e x y) + a + b              vector: scale s, small mounting error e (rad), bias b (m/s), sensor axes
    z = d . ((1 + s) (y - e x y) + a + b) + c    beam with outward direction d: positive when the sensor moves along it; bias c (m/s)
    z = seabed - depth of the transducer         altitude, vertical, where `altitude_sigma` is given (altimeter.py)

Scale and mounting act on y alone: the noise of the rate in a would meet itself in their Jacobian and pull them away, ping by ping;
what this leaves out is the scale error of a few centimetres per second.

Vector row: velocity 3, covariance xx yy zz xy xz yz.  Beam row: velocity, variance, direction 3.  Parameters: rotation_bs 9,
lever_arm_b 3, and for levelled velocities whether their first axis is north (1) or the heading (0).  Nuisances: scale,
mounting 3, bias 3 (levelled velocities: scale alone), of a beam its own bias, and last the current 2 of a log through the water.
The mounting error is to first order: 1e-4 of the speed at one degree.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from leadline.core.compiled import SENSOR, kernel
from leadline.core.rotation import cross, load3, load_matrix, turn, turn_back
from leadline.data.errors import InputError
from leadline.data.outcome import Outcome
from leadline.models.sensor import Channel, Context, Reading, Rows, Sensor, filled, finite_rows, nuisances, nuisances_of, reading, usable
from leadline.models.sensors import altimeter
from leadline.models.view import (
    ATTITUDE_T,
    POSITION_T,
    QUATERNION_V,
    RATE,
    RATE_T,
    RATE_V,
    VELOCITY,
    VELOCITY_T,
    VELOCITY_V,
    heading_of,
    north_slope,
    wander,
)

if TYPE_CHECKING:
    import numpy.typing as npt

    from leadline.data.records import Array, Dvl
    from leadline.data.vehicle import SensorConfig
    from leadline.models.nuisance import Nuisance

Kernels: TypeAlias = tuple[Any, Any, Any]  # for a vector in sensor axes, for one in level axes, for a beam
LEVER_P, NORTH_P = 9, 12
BEAM_N = 7  # place of the bias of a beam among its nuisances
FRAMES = ("sensor", "body", "level", "ned")  # channel by frame
BEAM_CHANNEL = len(FRAMES)


@kernel()
def mounting_of(params):
    """The nine numbers of rotation_bs at the start of the parameters."""
    return params[0], params[1], params[2], params[3], params[4], params[5], params[6], params[7], params[8]


@kernel()
def read_covariance(row, at, R):
    """R of a row that holds xx yy zz xy xz yz from place `at`."""
    for i in range(3):
        R[i, i] = row[at + i]
    R[0, 1] = R[1, 0] = row[at + 3]
    R[0, 2] = R[2, 0] = row[at + 4]
    R[1, 2] = R[2, 1] = row[at + 5]


@kernel()
def over_ground(views):
    """Velocity of the reference point over ground, navigation frame."""
    return load3(views, VELOCITY_V)


@kernel()
def write_row(Hv, i, v, views, lever, g, h):
    """Jacobian of g . R_nb^T v + h . (w x l), with g and h in body axes, into row i."""
    n = turn(load_matrix(views, QUATERNION_V), g)
    t = cross(n, v)
    r = cross(lever, h)
    for j in range(3):
        Hv[i, VELOCITY_T + j] = n[j]
        Hv[i, ATTITUDE_T + j] = t[j]
        Hv[i, RATE_T + j] = r[j]


@kernel()
def along(d, v, views, nuisance, params, i, Hv, Hn):
    """Velocity along the direction d of the sensor frame, with v that of the reference point; its Jacobians go to row i."""
    mounting, lever = mounting_of(params), load3(params, LEVER_P)
    body, arm = turn_back(load_matrix(views, QUATERNION_V), v), cross(load3(views, RATE_V), lever)
    y, a = turn_back(mounting, body), turn_back(mounting, arm)
    scale, e = 1.0 + nuisance[0], load3(nuisance, 1)
    de, ue = cross(d, y), cross(d, e)  # d . -(e x y) = e . (d x y) = y . (e x d)
    part = d[0] * y[0] + d[1] * y[1] + d[2] * y[2] + e[0] * de[0] + e[1] * de[1] + e[2] * de[2]
    Hn[i, 0] = part
    for j in range(3):
        Hn[i, 1 + j] = scale * de[j]
        Hn[i, 4 + j] = d[j]
    g = (scale * (d[0] - ue[0]), scale * (d[1] - ue[1]), scale * (d[2] - ue[2]))
    write_row(Hv, i, v, views, lever, turn(mounting, g), turn(mounting, d))
    rest = (a[0] + nuisance[4], a[1] + nuisance[5], a[2] + nuisance[6])
    return scale * part + d[0] * rest[0] + d[1] * rest[1] + d[2] * rest[2]


@kernel()
def vector(v, views, nuisance, row, params, z, R, Hv, Hn):
    """Velocity in the axes of the sensor."""
    z[0] = along((1.0, 0.0, 0.0), v, views, nuisance, params, 0, Hv, Hn)
    z[1] = along((0.0, 1.0, 0.0), v, views, nuisance, params, 1, Hv, Hn)
    z[2] = along((0.0, 0.0, 1.0), v, views, nuisance, params, 2, Hv, Hn)
    read_covariance(row, 3, R)


@kernel()
def beam(v, views, nuisance, row, params, z, R, Hv, Hn):
    """Velocity along one beam."""
    z[0] = along(load3(row, 2), v, views, nuisance, params, 0, Hv, Hn) + nuisance[BEAM_N]
    Hn[0, BEAM_N] = 1.0
    R[0, 0] = row[1]


@kernel()
def level(v, views, nuisance, row, params, z, R, Hv, Hn):
    """Velocity in level axes, along north and east or along the heading and to starboard of it; scale alone applies."""
    c = load_matrix(views, QUATERNION_V)
    lever = turn(c, cross(load3(views, RATE_V), load3(params, LEVER_P)))
    north = params[NORTH_P] != 0.0
    angle = wander(views) if north else wander(views) - heading_of(views)
    cosine, sine = np.cos(angle), np.sin(angle)
    ahead, starboard, down = (cosine, -sine, 0.0), (sine, cosine, 0.0), (0.0, 0.0, 1.0)
    scale = 1.0 + nuisance[0]
    for i in range(3):
        g = ahead if i == 0 else (starboard if i == 1 else down)
        value = g[0] * v[0] + g[1] * v[1] + g[2] * v[2]
        z[i], Hn[i, 0] = scale * value + g[0] * lever[0] + g[1] * lever[1] + g[2] * lever[2], value
        t = cross(lever, g)  # the lever arm's part turns with the attitude, the velocity does not
        r = cross(load3(params, LEVER_P), turn_back(c, g))
        for j in range(3):
            Hv[i, VELOCITY_T + j] = scale * g[j]
            Hv[i, ATTITUDE_T + j] = t[j]
            Hv[i, RATE_T + j] = r[j]
    slope = north_slope(views)
    for j in range(2):
        if north:
            Hv[0, POSITION_T + j], Hv[1, POSITION_T + j] = -z[1] * slope[j], z[0] * slope[j]
    if not north:  # the level axes turn with the heading: d ahead = starboard, d starboard = -ahead
        square = c[0] * c[0] + c[3] * c[3]
        for i in range(2):
            turned = z[1] if i == 0 else -z[0]
            Hv[i, ATTITUDE_T] -= turned * c[0] * c[6] / square
            Hv[i, ATTITUDE_T + 1] -= turned * c[3] * c[6] / square
            Hv[i, ATTITUDE_T + 2] += turned
    read_covariance(row, 3, R)


@kernel(SENSOR)
def predict_vector(views, nuisance, row, params, z, R, Hv, Hn):
    """Velocity over ground in the axes of the sensor."""
    vector(over_ground(views), views, nuisance, row, params, z, R, Hv, Hn)
    return 0


@kernel(SENSOR)
def predict_beam(views, nuisance, row, params, z, R, Hv, Hn):
    """Velocity over ground along one beam."""
    beam(over_ground(views), views, nuisance, row, params, z, R, Hv, Hn)
    return 0


@kernel(SENSOR)
def predict_level(views, nuisance, row, params, z, R, Hv, Hn):
    """Velocity over ground in level axes."""
    level(over_ground(views), views, nuisance, row, params, z, R, Hv, Hn)
    return 0


def beam_directions(config: SensorConfig, count: int) -> Array:
    """Outward unit vectors of the beams in the sensor frame (count, 3), from azimuth (x towards y) and tilt off the z axis."""
    azimuth, tilt = config.values.get("beam_azimuth"), config.values.get("beam_tilt")
    if azimuth is None or tilt is None:
        right = "give beam_azimuth_deg and beam_tilt_deg"
        raise InputError(f"sensors.{config.name}", "uses beams and does not say where they point", right)
    if len(azimuth) != count:
        raise InputError(f"sensors.{config.name}.beam_azimuth_deg", f"has {len(azimuth)} beams", f"the table has {count}")
    a = np.asarray(azimuth)
    return np.stack([np.sin(tilt) * np.cos(a), np.sin(tilt) * np.sin(a), np.full(count, np.cos(tilt))], axis=1)


def _covariance(config: SensorConfig, table: Dvl) -> Array:
    """Covariance (n, 6) as xx yy zz xy xz yz: from the row where given, else by its figure of merit where asked, else as configured."""
    given, per_fom = table.sigma, config.values.get("sigma_per_fom")
    default = np.full(len(table), config.value("sigma"))
    if per_fom is not None and table.fom is not None:
        default = np.where(np.isfinite(table.fom), per_fom * table.fom, default)
    own = np.full((len(table), 3), np.nan) if given is None else np.asarray(given)
    sigma = np.where(np.isfinite(own), own, default[:, None])
    mixed = np.zeros((len(table), 3)) if table.covariance is None else np.nan_to_num(table.covariance)
    return np.column_stack([np.where(sigma > 0.0, sigma, np.nan) ** 2, mixed])


def _vector_rows(config: SensorConfig, table: Dvl, good: npt.NDArray[np.bool_]) -> tuple[Rows, ...]:
    """Rows by frame: as the row says, else as configured."""
    data = np.column_stack([np.asarray(table.velocity), _covariance(config, table)])
    default = config.value("frame", "sensor")
    frame = np.full(len(table), default) if table.frame is None else np.where(table.frame == "", default, table.frame)
    return tuple(finite_rows(i, data, good & (frame == name)) for i, name in enumerate(FRAMES) if (frame == name).any())


def _beam_rows(config: SensorConfig, table: Dvl, good: npt.NDArray[np.bool_]) -> tuple[Rows, ...]:
    """One set of rows per beam: each beam is judged by itself, so that one may fail and the others serve."""
    beam = np.asarray(table.beam)
    directions = beam_directions(config, beam.shape[1])
    valid = sound_beams(config, table)
    valid = np.ones(beam.shape, bool) if valid is None else valid
    if valid.shape != beam.shape:
        right = f"its columns of validity or correlation are of {valid.shape[1]}"
        raise InputError(f"sensors.{config.name}", f"has {beam.shape[1]} beams", right)
    variance = config.value("beam_sigma", config.value("sigma")) ** 2
    parts = []
    for i, direction in enumerate(directions):
        data = np.column_stack([beam[:, i], filled(None, variance, len(table)), np.tile(direction, (len(table), 1))])
        parts.append(finite_rows(BEAM_CHANNEL + i, data, good & valid[:, i]))
    return tuple(parts)


def sound_beams(config: SensorConfig, table: Dvl) -> npt.NDArray[np.bool_] | None:
    """Return which beams (n, beams) the instrument calls valid and whose correlation is large enough; None where it says nothing.

    Raises InputError where validity and correlation are of different numbers of beams.
    """
    least, valid = config.values.get("correlation_min"), table.beam_valid
    parts = [] if valid is None else [np.nan_to_num(valid) != 0]
    if least is not None and table.beam_correlation is not None:
        parts.append(~(table.beam_correlation < least))
    if len({part.shape for part in parts}) > 1:
        counts = " and ".join(str(part.shape[1]) for part in parts)
        raise InputError(f"sensors.{config.name}", f"has validity and correlation of {counts} beams", "give them for each beam")
    return None if not parts else np.asarray(np.logical_and.reduce(parts))


def trusted(config: SensorConfig, table: Dvl) -> npt.NDArray[np.bool_]:
    """Return which rows (n,) the instrument calls valid, with figure of merit and error velocity small enough, a vector of sound beams."""
    good = usable(table)
    for name, column in (("fom_max", table.fom), ("error_velocity_max", table.error_velocity)):
        if config.values.get(name) is not None and column is not None:
            good = good & ~(np.abs(column) > config.values[name])
    least, by_vector = config.values.get("correlation_min"), config.value("use", "velocity") == "velocity" and table.velocity is not None
    if least is not None and by_vector and table.beam_correlation is not None:  # a vector is solved from three beams or more
        good = good & (np.sum(~(table.beam_correlation < least), axis=1) >= 3)
    return np.asarray(good)


def beam_biases(config: SensorConfig, count: int) -> list[tuple[Nuisance, ...]]:
    """Return the bias of each beam as a nuisance of its own, beam_bias1, beam_bias2, ...

    Raises InputError for a prior that would switch on states which no row can see.
    """
    prior, names = config.nuisance.get("beam_bias"), [f"{config.name}.beam_bias{i + 1}" for i in range(count)]
    if prior is not None and config.value("use", "velocity") != "beams":
        raise InputError(f"sensors.{config.name}.nuisance.beam_bias", "is of single beams, and use is 'velocity'", 'set use = "beams"')
    if prior is not None and count > len(prior.value):
        raise InputError(f"sensors.{config.name}.nuisance.beam_bias", f"is of {count} beams", f"at most {len(prior.value)}")
    own = [None if prior is None else replace(prior, value=prior.value[i : i + 1], sigma=prior.sigma[i : i + 1]) for i in range(count)]
    return [nuisances_of(alone, name, 1, "m/s") for alone, name in zip(own, names, strict=True)]


def doppler_channels(config: SensorConfig, context: Context, kernels: Kernels, current: tuple[Nuisance, ...]) -> tuple[Channel, ...]:
    """Return the channels of a Doppler log: a vector by frame, then beams; `kernels` for vector, level and beam, `current` last."""
    lever, scale = context.lever(config), nuisances(config, "scale", 1, "1")
    own = scale + nuisances(config, "mounting", 3, "rad", "sensor") + nuisances(config, "bias", 3, "m/s", "sensor")
    vector, level, beam = kernels

    def channel(components: tuple[str, ...], predict: Any, rotation: Array, north: float, more: tuple[Nuisance, ...] = ()) -> Channel:
        parameters = np.array([*rotation.ravel(), *lever, north])
        length = 5 if len(components) == 1 else 9
        needs, grounded = frozenset({VELOCITY, RATE}), not current
        plain = config.value("frame", "sensor") == "ned" and not {"scale", "mounting"} & set(config.nuisance)
        return Channel(components, predict, parameters, length, own + more + current, requires=needs, linear=plain, bounds_drift=grounded)

    axes = ("velocity_x", "velocity_y", "velocity_z")
    beams = beam_biases(config, len(config.values.get("beam_azimuth") or ()))
    return (
        channel(axes, vector, config.rotation_bs, 0.0),
        channel(axes, vector, np.eye(3), 0.0),
        channel(axes, level, np.eye(3), 0.0),
        channel(("velocity_north", "velocity_east", "velocity_down"), level, np.eye(3), 1.0),
        *(channel((f"beam{i + 1}",), beam, config.rotation_bs, 0.0, bias) for i, bias in enumerate(beams)),
    )


def doppler_rows(config: SensorConfig, table: Dvl) -> tuple[tuple[Rows, ...], npt.NDArray[np.int64]]:
    """Return the rows of a Doppler log by channel, and the outcome of each row of the table so far."""
    by_beam = config.value("use", "velocity") == "beams" or table.velocity is None
    if by_beam and table.beam is None:
        raise InputError(f"sensors.{config.name}.use", "is 'beams'", "the table has no beam1_mps, beam2_mps, ...")
    values = np.asarray(table.beam if by_beam else table.velocity)
    fast = np.nanmax(np.abs(np.nan_to_num(values)), axis=1) > config.value("speed_max", 10.0)
    parts = (_beam_rows if by_beam else _vector_rows)(config, table, trusted(config, table) & ~fast)
    return parts, np.where(fast, int(Outcome.OUT_OF_RANGE), int(Outcome.USED))


def compose(config: SensorConfig, context: Context) -> Sensor:
    """Compose a Doppler log over the bottom; its altitude is used where `altitude_sigma` is given."""
    channels = doppler_channels(config, context, (predict_vector, predict_level, predict_beam), ())
    sigma, at = config.values.get("altitude_sigma"), len(channels)
    if sigma is not None:
        channels = (*channels, altimeter.altitude_channel(config, context))

    def read(table: Dvl) -> Reading:
        parts, outcome = doppler_rows(config, table)
        if sigma is not None and table.altitude is not None:
            altitude = np.where(table.altitude > 0.0, table.altitude, np.nan)
            heights = np.column_stack([altitude, np.full(len(table), sigma**2)])
            parts = (*parts, finite_rows(at, heights, usable(table) & (outcome == Outcome.USED)))
        return reading(table, *parts, outcome=outcome)

    return Sensor(config, channels, read)
