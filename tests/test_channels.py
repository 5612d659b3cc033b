"""Every channel's value at the true pose against the simulator, which was written from the specification alone, or plain geometry."""

from math import radians

import numpy as np
import pytest

from leadline.core.attitude import matrix_from_euler, quaternion_from_matrix
from leadline.core.compiled import COMPONENTS, NUISANCES
from leadline.data.log import Beacon
from leadline.data.vehicle import vehicle_from_toml
from leadline.models.sensor import Context
from leadline.models.sensors import compose
from leadline.models.view import TANGENT, VIEW_SIZE, view_of
from leadline.simulate.dive import simulate
from leadline.simulate.instruments import (
    AcousticRange,
    Altimeter,
    Attitude,
    Depth,
    Drift,
    Dvl,
    Gnss,
    Heading,
    Navigation,
    PositionFix,
    Pressure,
    Speed,
    Surrounding,
    WaterVelocity,
    YawRate,
)
from leadline.simulate.plans import Lawnmower, survey
from leadline.simulate.trajectory import Place

MOUNTING, LEVER = (radians(3.0), radians(-4.0), radians(45.0)), (-0.6, 0.2, 0.4)
AZIMUTHS, TILT = tuple(radians(a) for a in (0.0, 90.0, 180.0, 270.0)), radians(25.0)
VEHICLE = """
name = "channels"
[process]
model = "cruise"
[sensors.dvl]
sigma_mps = 0.01
altitude_sigma_m = 0.1
use = "{use}"
frame = "{frame}"
lever_arm_m = [-0.6, 0.2, 0.4]
mounting_deg = [3.0, -4.0, 45.0]
beam_azimuth_deg = [0.0, 90.0, 180.0, 270.0]
beam_tilt_deg = 25.0
[sensors.depth]
sigma_m = 0.1
lever_arm_m = [0.7, 0.1, -0.2]
[sensors.heading]
sigma_deg = 1.0
nuisance.swing = {{ value_deg = [20.0, -8.0, 3.0, 2.0] }}
[sensors.water_velocity]
sigma_mps = 0.01
use = "{use}"
frame = "{frame}"
lever_arm_m = [-0.6, 0.2, 0.4]
mounting_deg = [3.0, -4.0, 45.0]
beam_azimuth_deg = [0.0, 90.0, 180.0, 270.0]
beam_tilt_deg = 25.0
[sensors.speed]
sigma_mps = 0.01
lever_arm_m = [-0.6, 0.2, 0.4]
mounting_deg = [3.0, -4.0, 45.0]
nuisance.scale = {{ value_percent = -40.0 }}
nuisance.bias = {{ value_mps = 0.05 }}
[sensors.pressure]
sigma_pa = 10.0
lever_arm_m = [0.7, 0.1, -0.2]
[sensors.lake]
kind = "pressure"
sigma_pa = 10.0
density_kgpm3 = 998.0
gravity_mps2 = 9.79
atmosphere_pa = 95000.0
nuisance.scale = {{ value_percent = 0.3 }}
nuisance.datum = {{ value_m = 0.5 }}
[sensors.altimeter]
sigma_m = 0.1
lever_arm_m = [0.7, 0.1, -0.2]
mounting_deg = [3.0, -4.0, 45.0]
[sensors.gyro]
kind = "yaw_rate"
noise_deg_per_rth = 0.1
rate_hz = 0.2
mounting_deg = [3.0, -4.0, 45.0]
[sensors.level_gyro]
kind = "yaw_rate"
noise_deg_per_rth = 0.1
rate_hz = 0.2
mounting_deg = [3.0, -4.0, 45.0]
earth_rate = "removed"
nuisance.scale = {{ value_percent = 2.0 }}
nuisance.bias = {{ value_deg_per_h = 36.0 }}
[sensors.other]
kind = "navigation"
use = "increments"
increment_s = 10.0
sigma_m = 0.1
sigma_depth_m = 0.1
sigma_heading_deg = 0.1
lever_arm_m = [0.2, 0.1, -0.9]
[water]
current = {{ value_mps = [0.3, -0.2] }}
[seabed]
depth = {{ value_m = 60.0 }}
[sensors.attitude]
sigma_deg = 1.0
sigma_tilt_deg = 1.0
mounting_deg = [3.0, -4.0, 45.0]
[sensors.gnss]
sigma_m = 1.0
sigma_velocity_mps = 0.1
vertical = true
lever_arm_m = [0.2, 0.1, -0.9]
[sensors.fix]
kind = "position_fix"
sigma_m = 1.0
lever_arm_m = [0.2, 0.1, -0.9]
[sensors.ranges]
kind = "acoustic_range"
sigma_m = 1.0
range_max_m = 2000.0
lever_arm_m = [0.3, 0.0, 0.5]
"""
CURRENT, SEABED = Surrounding("water.current", (0.3, -0.2)), Surrounding("seabed.depth", (60.0,))
SWING = (radians(20.0), radians(-8.0), radians(3.0), radians(2.0))
TIMES = np.array([20.0, 75.0, 130.0])


@pytest.fixture(scope="module", params=[45.0, -89.9])
def made(request):
    """A dive without noise, and the view of the body origin at some moments."""
    place = Place(radians(request.param), radians(179.9995), depth=20.0, surface_height=12.0)
    trajectory = survey(place, Lawnmower(legs=2, length=80.0, spacing=30.0, speed=1.5, heading=radians(200.0)), duration=150.0)
    beacon = Beacon(north=200.0, east=-150.0, depth=40.0)
    instruments = {
        "dvl": Dvl(
            rate=0.2, output="both", lever_arm_b=LEVER, mounting_bs=MOUNTING, sigma=0.0, azimuths=AZIMUTHS, tilt=TILT, seabed=SEABED
        ),
        "depth": Depth(rate=0.2, lever_arm_b=(0.7, 0.1, -0.2), sigma=0.0),
        "heading": Heading(rate=0.2, sigma=0.0, swing=SWING),
        "water_velocity": WaterVelocity(
            rate=0.2, output="both", lever_arm_b=LEVER, mounting_bs=MOUNTING, sigma=0.0, azimuths=AZIMUTHS, tilt=TILT, current=CURRENT
        ),
        "speed": Speed(rate=0.2, lever_arm_b=LEVER, mounting_bs=MOUNTING, scale=-0.4, bias=Drift(constant=0.05), current=CURRENT),
        "pressure": Pressure(rate=0.2, lever_arm_b=(0.7, 0.1, -0.2)),
        "lake": Pressure(rate=0.2, density=998.0, gravity=9.79, atmosphere=95000.0, scale=0.003, datum=Drift(constant=0.5)),
        "altimeter": Altimeter(rate=0.2, lever_arm_b=(0.7, 0.1, -0.2), mounting_bs=MOUNTING, seabed=SEABED),
        "gyro": YawRate(rate=0.2, mounting_bs=MOUNTING),
        "level_gyro": YawRate(rate=0.2, mounting_bs=MOUNTING, earth_removed=True, scale=0.02, bias=Drift(constant=radians(0.01))),
        "other": Navigation(rate=0.2, lever_arm_b=(0.2, 0.1, -0.9)),
        "attitude": Attitude(rate=0.2, sigma=(0.0, 0.0, 0.0), mounting_bs=MOUNTING),
        "gnss": Gnss(rate=0.2, lever_arm_b=(0.2, 0.1, -0.9), sigma=(0.0, 0.0, 0.0), sigma_velocity=0.0, max_depth=100.0),
        "fix": PositionFix(rate=0.2, lever_arm_b=(0.2, 0.1, -0.9), sigma=0.0, sigma_depth=0.0),
        "ranges": AcousticRange(rate=0.2, lever_arm_b=(0.3, 0.0, 0.5), beacons={"b": beacon}, path="one_way", sigma=0.0),
    }
    log = simulate(trajectory, instruments, seed=0)
    return log, trajectory


def view_at(trajectory, time):
    truth = trajectory.at(np.array([time]))
    latitude, longitude, height = (float(v[0]) for v in truth.geodetic)
    rotation_nb, velocity = truth.rotation_nb[0], truth.velocity_n[0]
    root = 1.0 - 0.00669437999014 * np.sin(latitude) ** 2  # WGS 84
    prime, meridian = 6378137.0 / np.sqrt(root), 6378137.0 * (1.0 - 0.00669437999014) / root**1.5
    transport = np.array([velocity[1] / (prime + height), -velocity[0] / (meridian + height), 0.0])  # never about the vertical
    rate = truth.rate_eb_b[0] - rotation_nb.T @ transport
    return view_of(latitude, longitude, height, quaternion_from_matrix(rotation_nb), velocity, rate), rotation_nb


def predicted(channel, view, row, then=None):
    z, R = np.zeros(COMPONENTS), np.zeros((COMPONENTS, COMPONENTS))
    Hv, Hn = np.zeros((COMPONENTS, 2 * TANGENT)), np.zeros((COMPONENTS, NUISANCES))
    views = np.concatenate([view, np.zeros(VIEW_SIZE) if then is None else then])
    nuisance = np.array([*(n.value for n in channel.nuisances), *np.zeros(NUISANCES)])[:NUISANCES]
    assert channel.predict(views, nuisance, row, channel.parameters, z, R, Hv, Hn) == 0
    return z[: len(channel.components)]


def composed(log, name, use="velocity", frame="sensor"):
    found = vehicle_from_toml(VEHICLE.format(use=use, frame=frame))
    context = Context(surface=log.datum.geoid_undulation, origin=log.origin, beacons=log.beacons, shared=found.shared)
    return compose(found[name], context)


# A level plane leaves the ellipsoid by 4e-8 m at the end of a lever arm; positions are good to 1e-8 m.  Pressures are as good as depths,
# by 1e4 Pa/m.  The vertical at the end of a lever arm is another one by 1e-7: seen at a sea bed 40 m below.  So is north: by 1e-7, and
# near the pole by 1e-4, of a speed or of the length of an increment.
CASES = {
    "dvl": 1e-6, "beams": 1e-6, "depth": 1e-7, "heading": 1e-9, "attitude": 1e-9, "gnss": (3e-7, 1e-4), "fix": 1e-7, "ranges": 1e-8,
    "water_velocity": (1e-6, 1e-4), "water beams": (1e-6, 1e-4), "speed": (1e-6, 1e-4), "pressure": 1e-3, "lake": 1e-3, "altimeter": 3e-6,
    "gyro": 1e-12, "level_gyro": 1e-12, "other": (2e-6, 2e-3),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_value_at_the_truth_is_what_the_instrument_says(made, case):
    log, trajectory = made
    beams = case.endswith("beams")
    name = {"beams": "dvl", "water beams": "water_velocity"}.get(case, case)
    sensor = composed(log, name, use="beams" if beams else "velocity")
    bars = np.broadcast_to(CASES[case], 2)
    seen, bar = 0, bars[0] if abs(log.origin.latitude) < 1.5 else bars[1]
    for part in sensor.read(log[name]).rows:
        channel = sensor.channels[part.channel]
        for k in range(0, len(part.row), 3):
            view, _ = view_at(trajectory, log[name].time[part.row[k]])
            then = None if part.earlier is None else view_at(trajectory, part.earlier[k])[0]
            residual = part.data[k, : len(channel.components)] - predicted(channel, view, part.data[k], then)
            if any(channel.angles):
                residual = (residual + np.pi) % (2 * np.pi) - np.pi
            assert np.abs(residual).max() < bar, channel.components
            seen += 1
    assert seen >= (4 if beams else 1) * 8


@pytest.mark.parametrize("frame", ["level", "ned"])
def test_levelled_velocities(made, frame):
    """The velocity of the transducer, turned by the true heading or not at all."""
    log, trajectory = made
    channel = composed(log, "dvl", frame=frame).channels[2 if frame == "level" else 3]
    for time in TIMES:
        view, rotation = view_at(trajectory, time)
        truth = trajectory.at(np.array([time])).point(np.array(LEVER))
        velocity = truth.velocity_n[0]
        heading = np.arctan2(rotation[1, 0], rotation[0, 0])
        expected = matrix_from_euler(0.0, 0.0, heading).T @ velocity if frame == "level" else velocity
        apart = 3e-6 if abs(log.origin.latitude) < 1.5 else 1e-4  # near the pole north is another one at the end of a lever arm
        np.testing.assert_allclose(predicted(channel, view, np.zeros(9)), expected, atol=apart)
