"""A process model of one's own: a float that drifts with the water, level and of unknown heading, told where it is by fixes and its depth.

`leadline solve LOG --vehicle FILE --process own_process.py:compose` moves any vehicle by it; `own` in [process] is its table.
"""

from math import radians

import numpy as np

from leadline import solve
from leadline.assess.errors import errors_of
from leadline.core.compiled import STEP, VIEW, kernel
from leadline.core.earth import move
from leadline.data.vehicle import vehicle_from_toml
from leadline.models.layout import Block, Part
from leadline.models.numeric import numeric
from leadline.models.view import VELOCITY
from leadline.simulate.dive import StartSigmas, simulate
from leadline.simulate.instruments import Depth, PositionFix
from leadline.simulate.plans import Place, straight

VEHICLE = """
name = "float"
process = { model = "own_process:compose", own = { wander_mps_per_rts = 0.01 } }
sensors.depth = { sigma_m = 0.1 }
sensors.usbl = { kind = "position_fix", sigma_m = 2.0, vertical = false }
"""


@kernel(STEP)
def step(x, u, dt, parameters, memory):  # noqa: ARG001
    """The place (5 numbers) moves with the velocity (3), which wanders."""
    move(x, 0, x[5] * dt, x[6] * dt, x[7] * dt)


@kernel(VIEW)
def view(x, u, parameters, out):  # noqa: ARG001
    """Place and velocity; level, as the float hangs on its line."""
    out[:8] = x[:8]
    out[8] = 1.0


def begin(pose):
    """Start where the log says, with the velocity that it says."""
    return np.concatenate([pose.quaternion_en, [pose.height], pose.velocity_n]), pose.covariance[:6, :6]


def compose(vehicle, context):  # noqa: ARG001
    """Six errors: position and velocity."""
    parts = (Part("position", Block.PLACE, 3, "m"), Part("velocity", Block.VECTOR, 3, "m/s", "navigation"))
    wander = vehicle.process.figures(vehicle.process.model)[0].get("wander_mps_per_rts", 0.01)
    return numeric("float", parts, step, view, np.array([0.0] * 3 + [wander**2] * 3), begin, defines=frozenset({VELOCITY}))


if __name__ == "__main__":
    drift = straight(Place(radians(36.7), radians(-122.0), depth=50.0), 600.0, speed=0.2, heading=1.0)
    log = simulate(drift, {"depth": Depth(rate=1.0, sigma=0.1), "usbl": PositionFix(rate=0.1, sigma=2.0)}, seed=1, start=StartSigmas(5.0))
    for estimator in ("ekf", "ukf", "pf"):
        error = errors_of(solve(log, vehicle_from_toml(VEHICLE), estimator=estimator), log.truth)
        print(f"{estimator}: {error.statistics()['north'].rms:.2f} m rms north")
