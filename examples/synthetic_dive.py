"""Make the log of a 30-minute survey dive: surface with GNSS, dive to 20 m, six legs, up again.

    python examples/synthetic_dive.py OUT [--seed N]

Instruments of the middle class: a tactical IMU, a DVL with a scale and a mounting error that loses the bottom for a minute, depth,
a heading with a bias, a few USBL fixes (some of them wrong), and two-way ranges to two beacons.
"""

from __future__ import annotations

import argparse
from math import radians
from typing import Any

from leadline.data.log import Beacon
from leadline.formats.folder import write_log
from leadline.simulate.dive import StartSigmas, simulate
from leadline.simulate.instruments import AcousticRange, Depth, Drift, Dvl, Gnss, Heading, Imu, Instrument, PositionFix
from leadline.simulate.plans import Lawnmower, survey
from leadline.simulate.trajectory import Place

DURATION = 1800.0
HARBOUR = Place(radians(32.84), radians(34.92), depth=0.3, surface_height=17.0)
PLAN = Lawnmower(legs=6, length=255.0, spacing=40.0, speed=1.5, heading=radians(20.0), surface_time=60.0, dive=20.0, ascend=True)
BEACONS = {
    "north": Beacon(north=290.0, east=-40.0, depth=30.0, sigma_north=0.1, sigma_east=0.1, sigma_depth=0.1, turnaround=0.1),
    "east": Beacon(north=150.0, east=330.0, depth=32.0, sigma_north=0.1, sigma_east=0.1, sigma_depth=0.1, turnaround=0.1),
}
INSTRUMENTS: dict[str, Instrument[Any]] = {
    "imu": Imu(
        rate=100.0,
        lever_arm_b=(0.3, 0.0, -0.05),
        gyro_density=radians(0.1) / 60,  # 0.1 deg/sqrt(h)
        accel_density=1e-3,
        gyro_bias=Drift(turn_on=radians(2.0) / 3600, steady=radians(1.0) / 3600, tau=1000.0),
        accel_bias=Drift(turn_on=5e-3, steady=5e-4, tau=1000.0),
    ),
    "dvl": Dvl(
        rate=5.0,
        lever_arm_b=(-0.5, 0.0, 0.2),
        mounting_bs=(0.0, 0.0, radians(45.0)),
        sigma=0.01,
        scale=0.004,
        sigma_scale=0.002,
        sigma_mounting=radians(0.5),
        outages=((900.0, 960.0),),
    ),
    "depth": Depth(rate=10.0, lever_arm_b=(0.6, 0.0, 0.0), sigma=0.02, bias=Drift(turn_on=0.02)),
    "heading": Heading(rate=10.0, sigma=radians(0.3), bias=Drift(constant=radians(1.0), turn_on=radians(0.5))),
    "gnss": Gnss(rate=1.0, lever_arm_b=(0.1, 0.0, -0.9), sigma=(1.0, 1.0, 2.0), stop=60.0, max_depth=0.0),
    "usbl": PositionFix(
        rate=1 / 60, offset=200.0, stop=1450.0, latency=1.2, latency_jitter=0.3, lever_arm_b=(0.0, 0.0, -0.3),
        sigma=1.5, sigma_depth=0.5, outlier_fraction=0.15, outlier_size=40.0,
    ),
    "ranges": AcousticRange(
        rate=0.2, offset=130.0, stop=1450.0, lever_arm_b=(0.8, 0.0, -0.2), beacons=BEACONS,
        sigma=2e-4, outlier_fraction=0.03, loss=0.1,
    ),
}  # fmt: skip


def main() -> None:
    """Write the log."""
    parser = argparse.ArgumentParser(description="Write the log of a simulated 30-minute survey dive.")
    parser.add_argument("out", help="the folder to make")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    trajectory = survey(HARBOUR, PLAN, duration=DURATION)
    start = StartSigmas(position=2.0, depth=0.2, velocity=0.1, tilt=radians(0.5), heading=radians(2.0))
    log = simulate(trajectory, INSTRUMENTS, seed=arguments.seed, start=start, name="synthetic-dive")
    write_log(log, arguments.out)
    print(f"{arguments.out}: " + ", ".join(f"{name} {len(table)}" for name, table in log.tables.items()))


if __name__ == "__main__":
    main()
