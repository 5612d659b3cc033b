"""A sensor of one's own in plain Python: an echo sounder that looks up at the sea surface, in place of a depth sensor.

The vehicle file names it by `model = "own_sensor:compose"`; its table holds what the columns say, here those of an altimeter.
"""

from __future__ import annotations

from dataclasses import replace
from math import radians

import numpy as np

from leadline import solve
from leadline.assess.assessment import assess
from leadline.data.records import Altimeter
from leadline.data.vehicle import vehicle_from_toml
from leadline.models.sensor import Channel, Sensor, finite_rows, reading, usable
from leadline.simulate.dive import simulate
from leadline.simulate.instruments import Dvl, Imu
from leadline.simulate.plans import Lawnmower, Place, survey

VEHICLE = """
name = "one-with-an-echo-sounder"
sensors.imu = { preset = "fog-tactical", rate_hz = 50.0 }
sensors.dvl = { sigma_mps = 0.01 }
sensors.sounder = { kind = "altimeter", model = "own_sensor:compose", lever_arm_m = [0.4, 0.0, -0.1], sigma_m = 0.05 }
"""


def compose(config, context):
    """Range along the body's up axis to a level surface: z = (surface - height + (R l)_down) / R_33."""
    lever_b, variance = context.lever(config), config.value("sigma") ** 2

    def predict(views, nuisance, row):  # noqa: ARG001
        view = views[0]
        depth = context.surface - view.height + view.rotation_nb[2] @ lever_b
        return depth / view.rotation_nb[2, 2], variance

    def read(table):
        return reading(table, finite_rows(0, table.range[:, None], usable(table)))

    return Sensor(config, (Channel(("range",), predict, np.zeros(0), row_length=1),), read)


def main() -> None:
    """Dive for two minutes with it, and compare with the truth."""
    instruments = {"imu": Imu(rate=50.0), "dvl": Dvl(rate=5.0, sigma=0.01)}
    trajectory = survey(Place(radians(32.8), radians(34.9), depth=2.0), Lawnmower(surface_time=20.0), duration=120.0)
    log = simulate(trajectory, instruments, seed=1)
    body = trajectory.at(np.arange(0.0, 120.0, 0.5))
    ranges = body.point((0.4, 0.0, -0.1)).depth / body.rotation_nb[:, 2, 2]
    noise = 0.05 * np.random.default_rng(1).standard_normal(len(ranges))
    log = replace(log, tables={**log.tables, "sounder": Altimeter(time=body.time, range=ranges + noise)})
    solution = solve(log, vehicle_from_toml(VEHICLE))
    print(f"{solution.summary['counts']['sounder']}, deepest {solution.depth.max():.1f} m")
    print(f"depth: {assess(solution, log.truth).errors.statistics()['down'].rms:.3f} m rms from the truth")


if __name__ == "__main__":
    main()
