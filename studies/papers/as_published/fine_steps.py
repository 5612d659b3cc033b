"""Process model `body-velocity` in steps of 0.02 s: how much of what parts the EKF from a UKF is the step, to first order, of 0.1 s."""

from __future__ import annotations

from dataclasses import replace

from leadline.models import body_velocity

LONGEST = 0.02  # s


def compose(vehicle, context):
    """Return `body-velocity` in shorter steps."""
    return replace(body_velocity.compose(vehicle, context), longest_step=LONGEST)
