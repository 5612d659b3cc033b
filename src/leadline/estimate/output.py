"""From the numbers of the loop to a Solution: body origin, north-east-down, every nuisance by name."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core import attitude, geodesy
from leadline.data.solution import Estimate, Innovations, Solution, Status
from leadline.estimate import plan as at
from leadline.models.nuisance import AXES
from leadline.models.view import HEIGHT_V, PLACE_V, QUATERNION_V, RATE_V, RATE_VARIANCE_V, VELOCITY_V, VIEW_SIZE

if TYPE_CHECKING:
    from datetime import datetime

    from leadline.data.log import Origin
    from leadline.data.records import Array
    from leadline.estimate.composition import Composition
    from leadline.models.sensor import Context

POSE_PARTS = ("position", "velocity", "attitude")  # parts of the motion that a solution holds anyway
UPPER = np.triu_indices(9)
EMPTY = Innovations(*(np.zeros(0, kind) for kind in ("U1", int, int, float, float, "U1", float, float, float, int, float, bool, int)))


@dataclass(frozen=True)
class Reference:
    """What estimates are expressed against: the moment of time zero, the origin of north and east, the sensors' context, and of what.

    point_b: the point whose states are told, counted from the body origin (m).
    """

    epoch: datetime
    origin: Origin
    context: Context
    point_b: Array = field(default_factory=lambda: np.zeros(3))


def solution_of(reference: Reference, composition: Composition, time: Array, output: Array) -> Solution:
    """Make a Solution, without innovations yet, of outputs (n, size) at `time` (n,); where they are no numbers the status is LOST."""
    origin, context, output = reference.origin, reference.context, output[: len(time)]
    view = output[:, at.OUT_VIEW : at.OUT_VIEW + VIEW_SIZE]
    lever_b = reference.point_b - context.reference_b  # from the process model's reference point to the one asked for
    with np.errstate(invalid="ignore", over="ignore"):
        point = shifted(view, unpacked(output[:, at.OUT_COV : at.OUT_X]), lever_b)
    lost = ~np.isfinite(output).all(axis=1)
    found, depth = estimates(composition, output), context.surface - point[2]
    bottom = found.get("seabed.depth")
    north, east = geodesy.north_east(point[0], point[1], origin.latitude, origin.longitude)
    return Solution(
        epoch=reference.epoch,
        origin=origin,
        time=time,
        latitude=point[0],
        longitude=point[1],
        height=point[2],
        depth=depth,
        north=north,
        east=east,
        velocity_n=point[3],
        quaternion_nb=point[4],
        covariance=point[5],
        status=np.where(lost, int(Status.LOST), int(Status.AIDED)),
        innovations=EMPTY,
        nuisances=found,
        altitude=None if bottom is None else bottom.value - depth,
    )


class Track:
    """A solution that is put together stretch by stretch, in any order, in arrays of its final size."""

    def __init__(self, time: Array) -> None:
        """Make room for states at `time` (n,)."""
        self.time = time
        self.first: Solution | None = None
        self.arrays: dict[str, Any] = {}
        self.nuisances: dict[str, tuple[Array, Array]] = {}

    def put(self, at: int, part: Solution) -> None:
        """Put a stretch at its place: its first state is number `at`."""
        count, whole = len(part), len(self.time)
        if not self.arrays:
            self.first = part
            states = {item.name: getattr(part, item.name) for item in fields(part)}
            self.arrays = {k: np.empty((whole, *v.shape[1:]), v.dtype) for k, v in states.items() if isinstance(v, np.ndarray)}
            self.nuisances = {name: (np.empty(whole), np.empty(whole)) for name in part.nuisances}
        for name, values in self.arrays.items():
            values[at : at + count] = getattr(part, name)
        for name, (value, sigma) in self.nuisances.items():
            value[at : at + count], sigma[at : at + count] = part.nuisances[name].value, part.nuisances[name].sigma

    def solution(self) -> Solution:
        """Return the whole."""
        assert self.first is not None
        told = self.first.nuisances
        nuisances = {name: replace(told[name], value=value, sigma=sigma) for name, (value, sigma) in self.nuisances.items()}
        return replace(self.first, **self.arrays, nuisances=nuisances)


def unpacked(packed: Array) -> Array:
    """Return symmetric matrices (n, 9, 9) of their packed upper triangles (n, 45)."""
    full = np.zeros((len(packed), 9, 9))
    full[:, UPPER[0], UPPER[1]] = packed
    full[:, UPPER[1], UPPER[0]] = packed
    return full


def shifted(view: Array, covariance: Array, lever_b: Array) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Return latitude, longitude, height, velocity, quaternion, covariance of the point at `lever_b`, turned to north-east-down.

    p' = p + R l,  v' = v + R (w x l);  errors: dp' = dp - [R l]x dtheta,  dv' = dv - [R (w x l)]x dtheta - [R l]x (noise of w).
    """
    rotation_en = attitude.matrix_from_quaternion(view[:, PLACE_V:HEIGHT_V])
    rotation_nb = attitude.matrix_from_quaternion(view[:, QUATERNION_V:RATE_V])
    lever = rotation_nb @ lever_b
    turning = np.einsum("nij,nj->ni", rotation_nb, np.cross(view[:, RATE_V : RATE_V + 3], lever_b))
    place = geodesy.ecef_from_geodetic(*_geographic(rotation_en), view[:, HEIGHT_V])
    latitude, longitude, height = geodesy.geodetic_from_ecef(place + np.einsum("nij,nj->ni", rotation_en, lever))
    level = np.swapaxes(geodesy.rotation_en(latitude, longitude), 1, 2) @ rotation_en  # north is that of the new point
    angle = np.arctan2(level[:, 1, 0], level[:, 0, 0])
    turn = attitude.matrix_from_euler(np.zeros_like(angle), np.zeros_like(angle), angle)
    velocity = np.einsum("nij,nj->ni", turn, view[:, VELOCITY_V:QUATERNION_V] + turning)
    north = attitude.quaternion_from_euler(np.zeros_like(angle), np.zeros_like(angle), angle)
    jacobian = np.zeros_like(covariance)
    for block in (slice(0, 3), slice(3, 6), slice(6, 9)):
        jacobian[:, block, block] = turn
    jacobian[:, 0:3, 6:9] = -turn @ _skew(lever)
    jacobian[:, 3:6, 6:9] = -turn @ _skew(turning)
    quaternion = attitude.product(north, view[:, QUATERNION_V:RATE_V])
    moved = jacobian @ covariance @ np.swapaxes(jacobian, 1, 2)
    arm = _skew(np.einsum("nij,nj->ni", turn, lever))
    moved[:, 3:6, 3:6] += view[:, RATE_VARIANCE_V, None, None] * arm @ np.swapaxes(arm, 1, 2)
    return latitude, longitude, height, velocity, quaternion, moved


def _geographic(rotation_en: Array) -> tuple[Array, Array]:
    up = -rotation_en[:, :, 2]
    return np.arctan2(up[:, 2], np.hypot(up[:, 0], up[:, 1])), np.arctan2(up[:, 1], up[:, 0])


def _skew(a: Array) -> Array:
    full = np.zeros((len(a), 3, 3))
    full[:, 0, 1], full[:, 0, 2], full[:, 1, 2] = -a[:, 2], a[:, 1], -a[:, 0]
    return full - np.swapaxes(full, 1, 2)


def estimates(composition: Composition, output: Array) -> dict[str, Estimate]:
    """Return every estimated state beyond position, velocity and attitude, by name."""
    layout, found = composition.layout, {}
    x, variances = at.OUT_X, at.OUT_X + layout.motion_nominal + len(layout.nuisances)
    for part in (p for p in layout.motion if p.name not in POSE_PARTS):
        nominal, error = layout.nominal_of(part.name), layout.error_of(part.name)
        for i, axis in enumerate(AXES[part.size]):
            sigma = np.sqrt(np.maximum(output[:, variances + error.start + i], 0.0))
            name = f"{part.name if '.' in part.name else f'{composition.process.consumes or composition.process.name}.{part.name}'}{axis}"
            found[name] = Estimate(output[:, x + nominal.start + i], sigma, part.unit, part.frame)
    for i, nuisance in enumerate(layout.nuisances):
        sigma = np.sqrt(np.maximum(output[:, variances + layout.motion_error + i], 0.0))
        found[nuisance.name] = Estimate(output[:, x + layout.motion_nominal + i], sigma, nuisance.unit, nuisance.frame)
    return found
