"""Compile what can be compiled, by using it: a few seconds of a simulated dive through filter, smoother, live navigator and budget."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pkgutil import iter_modules

from leadline.data.vehicle import vehicle_from_toml
from leadline.estimate.as_live import solve_as_live
from leadline.estimate.budget import budget
from leadline.estimate.solve import solve
from leadline.missions.instruments import instruments_of
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
"""


def warm_up() -> None:
    """Import every sensor model, and run what is compiled on first use."""
    for module in iter_modules(sensors.__path__, f"{sensors.__name__}."):
        import_module(module.name)
    two = vehicle_from_toml(VEHICLE)
    for vehicle in (two, replace(two, process=replace(two.process, standby=None)).without("imu_b")):
        log = Recorder(straight(Place(0.5, 0.1, depth=10.0), 3.0, speed=1.0), instruments_of(vehicle), truth_rate=1.0).draw(0)
        solve(log, vehicle, rate=1.0, smooth=True)
        solve_as_live(log, vehicle, rate=1.0)
        budget(log, vehicle)
