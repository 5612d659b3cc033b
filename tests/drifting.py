"""A process model of the smallest kind, for tests: a place at rest that drifts in the plane, everything else known."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import NOISE, PULL, PUSH, STEP, VIEW, WIDE, kernel
from leadline.models.layout import Block, Part
from leadline.models.process import Process
from leadline.models.view import VELOCITY

if TYPE_CHECKING:
    from leadline.data.vehicle import Vehicle
    from leadline.models.process import Pose
    from leadline.models.sensor import Context

DRIFT = 0.3  # m per root of a second


@kernel(STEP)
def step(x, u, dt, params, m):
    """Nothing moves."""


@kernel(PUSH)
def push(m, dt, params, B, A, columns):
    """The transition is one."""
    for i in range(3):
        for j in range(columns):
            A[i * WIDE + j] = B[i * WIDE + j]


@kernel(NOISE)
def noise(m, dt, params, P):
    """A random walk in the plane."""
    P[0] += params[0] * dt
    P[WIDE + 1] += params[0] * dt


@kernel(VIEW)
def view(x, u, params, out):
    """The place; at rest, level, facing the first axis."""
    out[:] = 0.0
    out[:5] = x[:5]
    out[8] = 1.0


@kernel(PULL)
def pull(x, u, params, view, Hv, H, rows):
    """Position is the state."""
    for i in range(rows):
        for j in range(3):
            H[i, j] = Hv[i, j]


def begin(pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    """The place of a pose, with the variances of its position; depth is all but known."""
    return np.concatenate([pose.quaternion_en, [pose.height]]), np.diag([*np.diag(pose.covariance)[:2], 1e-8])


def compose(vehicle: Vehicle, context: Context) -> Process:
    """The process model."""
    del vehicle, context
    parts = (Part("position", Block.PLACE, 3, "m"),)
    return Process(
        "drifting", parts, np.array([DRIFT**2]), step, push, noise, view, pull, frozenset({VELOCITY}), begin=begin, linear=True,
        longest_step=100.0,
    )  # fmt: skip
