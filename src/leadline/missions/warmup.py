"""Compile what can be compiled, by using it: a few seconds of a simulated dive through all models and estimators, smoother and budget.

And a few seconds of a mission, in a sea with everything in it.
"""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from tempfile import TemporaryDirectory

import numpy as np

from leadline.data.records import Thruster
from leadline.data.vehicle import vehicle_from_toml
from leadline.estimate.as_live import solve_as_live
from leadline.estimate.budget import budget
from leadline.estimate.solve import solve
from leadline.missions.instruments import instruments_of
from leadline.missions.simulation import simulate_folder
from leadline.models import sensors
from leadline.simulate.dive import Recorder
from leadline.simulate.plans import straight
from leadline.simulate.trajectory import Place

VEHICLE = """
name = "warmup"
[process]
standby = "imu_b"
[sensors.imu]
preset = "kvh-1775"
rate_hz = 50.0
[sensors.imu_b]
kind = "imu"
preset = "kvh-1775"
rate_hz = 50.0
[sensors.dvl]
rate_hz = 5.0
sigma_mps = 0.01
student_dof = 5.0
nuisance = { lever = { sigma_m = 0.1 } }
[sensors.depth]
rate_hz = 5.0
sigma_m = 0.1
[sensors.attitude]
rate_hz = 2.0
sigma_deg = 1.0
sigma_tilt_deg = 0.5
[sensors.thrusters]
kind = "thruster"
rate_hz = 2.0
[process.dynamics]
hull = "typhoon"
"""
PROCESSES = ("body-velocity", "cruise", "planar", "dynamics")
ESTIMATORS = ("ukf", "srukf", "pf:particles=20")

MISSION = """
name = "warmup"
vehicle = "vehicle.toml"
hull = "rexrov"
epoch = 2025-01-01T00:00:00Z
duration_s = 3.0
[origin]
latitude_deg = 40.0
longitude_deg = 5.0
[start]
depth_m = 3.0
[sea]
sound = [{ depth_m = 0.0, speed_mps = 1520.0 }, { depth_m = 40.0, speed_mps = 1505.0 }]
current.north_mps = 0.1
waves = { height_m = 0.2, period_s = 4.0 }
terrain.plane = { depth_m = 30.0 }
tides = [{ amplitude_m = 0.1 }]
[plan]
speed_mps = 0.4
altitude_m = 20.0
[[plan.legs]]
shape = "waypoints"
through_m = [[20.0, 0.0]]
[beacons.one]
north_m = 30.0
east_m = 5.0
depth_m = 20.0
[instruments.imu]
gyro_bias = { flicker_deg_per_h = 1.0 }
[instruments.swath]
kind = "swath"
rate_hz = 1.0
beams = 4
[instruments.ahrs]
kind = "attitude"
rate_hz = 2.0
tilt_gain = 1.0
[instruments.fog]
kind = "yaw_rate"
rate_hz = 2.0
lag_s = 0.1
[instruments.pressure]
kind = "pressure"
rate_hz = 1.0
[instruments.usbl]
kind = "usbl"
rate_hz = 1.0
"""


def warm_up() -> None:
    """Import every sensor model, and run what is compiled on first use."""
    for module in iter_modules(sensors.__path__, f"{sensors.__name__}."):
        import_module(module.name)
    two = vehicle_from_toml(VEHICLE)
    alone = replace(two, process=replace(two.process, standby=None)).without("imu_b")
    path = straight(Place(0.5, 0.1, depth=10.0), 3.0, speed=1.0)
    for vehicle in (two, alone):
        log = Recorder(path, instruments_of(vehicle.without("thrusters")), truth_rate=1.0).draw(0)
        solve(log, vehicle, rate=1.0, smooth=True)
        solve_as_live(log, vehicle, rate=1.0)
        budget(log, vehicle)
    log = replace(log, tables={**log.tables, "thrusters": Thruster(time=np.arange(3.0), thruster=np.zeros((3, 6)))})
    for process in PROCESSES:
        solve(log, alone, process=process, rate=1.0, smooth=True)
    for estimator in ESTIMATORS:
        solve(log, alone.without("imu", "attitude"), process="cruise", estimator=estimator, rate=1.0)
    with TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "vehicle.toml").write_text(VEHICLE, "utf-8")
        (place / "mission.toml").write_text(MISSION, "utf-8")
        simulate_folder(place / "mission.toml", place / "log")
