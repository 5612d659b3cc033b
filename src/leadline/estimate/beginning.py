"""The start of the motion from that of the pose: to first order, by sigma points, or drawn.

Where the heading is known to a radian and the vehicle moves, the velocity in body axes is no Gaussian about that of the stated heading:
to first order a heading that is wrong by 60 degrees makes it longer, and a Doppler log would then tell the heading.  So estimators that
do not linearise begin with what the process model makes of poses that are off, not with its covariance at one pose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from leadline.core import attitude
from leadline.core.compiled import WIDE
from leadline.core.earth import move
from leadline.models.layout import Layout, difference, retract

if TYPE_CHECKING:
    from leadline.data.records import Array
    from leadline.models.process import Pose, Process

SPREAD = 3.0  # g^2 of the sigma points


@dataclass(frozen=True)
class Beginning:
    """A process model and the pose that a run begins at."""

    process: Process
    pose: Pose

    @cached_property
    def root(self) -> Array:
        """Root (9, 9) of the covariance of the pose; directions without spread have none."""
        values, vectors = np.linalg.eigh(self.pose.covariance)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))

    @cached_property
    def rest(self) -> Array:
        """Covariance of the motion where the pose is known."""
        return self.process.begin(replace(self.pose, covariance=np.zeros((9, 9))))[1]

    def mean(self) -> tuple[Array, Array]:
        """Return the motion (nominal,) and its covariance (error, error), to first order."""
        return self.process.begin(self.pose)

    def at(self, error: Array) -> Array:
        """Return the motion (nominal,) of the pose that is off by an error (9,)."""
        place = np.array([*self.pose.quaternion_en, self.pose.height])
        move(place, 0, error[0], error[1], error[2])
        turned = attitude.product(attitude.exponential(error[6:9]), self.pose.quaternion_nb)
        pose = replace(
            self.pose, quaternion_en=place[:4], height=float(place[4]), velocity_n=self.pose.velocity_n + error[3:6], quaternion_nb=turned
        )
        return self.process.begin(pose)[0]

    def by_points(self) -> tuple[Array, Array]:
        """Return the motion and its covariance by pairs of sigma points of the pose (core/sigma.py)."""
        x, _ = self.mean()
        layout = Layout(self.process.parts, (), 0, 0)
        plan, n, g = layout.head(), layout.motion_error, np.sqrt(SPREAD)
        apart = np.zeros((2, 9, n))
        for sign, of_sign in zip((1.0, -1.0), apart, strict=True):
            for column, d in zip(self.root.T, of_sign, strict=True):
                found = np.zeros(WIDE)
                difference(plan, np.ascontiguousarray(self.at(sign * g * column)), x, found)
                d[:] = found[:n]
        slope, bent = (apart[0] - apart[1]) / (2.0 * g), 0.5 * (apart[0] + apart[1])
        shift = bent.sum(axis=0) / SPREAD
        covariance = slope.T @ slope + bent.T @ bent / SPREAD + np.outer(shift, shift) + self.rest
        moved, d = x.copy(), np.zeros(WIDE)
        d[:n] = shift
        retract(plan, moved, d, n)
        return moved, covariance

    def drawn(self, generator: np.random.Generator) -> Array:
        """Return one draw of the motion (nominal,)."""
        x = np.ascontiguousarray(self.at(self.root @ generator.standard_normal(9)))
        values, vectors = np.linalg.eigh(self.rest)
        d, plan = np.zeros(WIDE), Layout(self.process.parts, (), 0, 0).head()
        n = len(values)
        d[:n] = vectors @ (np.sqrt(np.maximum(values, 0.0)) * generator.standard_normal(n))
        retract(plan, x, d, n)
        return x
