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
from leadline.simulate.instruments import AcousticRange, Attitude, Depth, Dvl, Gnss, Heading, PositionFix
from leadline.simulate.trajectory import Lawnmower, Place, survey

MOUNTING, LEVER = (radians(3.0), radians(-4.0), radians(45.0)), (-0.6, 0.2, 0.4)
AZIMUTHS, TILT = tuple(radians(a) for a in (0.0, 90.0, 180.0, 270.0)), radians(25.0)
VEHICLE = """
name = "channels"
[process]
model = "none"
[sensors.dvl]
sigma_mps = 0.01
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
[sensors.attitude]
sigma_deg = 1.0
sigma_tilt_deg = 1.0
mounting_deg = [3.0, -4.0, 45.0]
[sensors.gnss]
sigma_m = 1.0
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
TIMES = np.array([20.0, 75.0, 130.0])


@pytest.fixture(scope="module", params=[45.0, -89.9])
def made(request):
    """A dive without noise, and the view of the body origin at some moments."""
    place = Place(radians(request.param), radians(179.9995), depth=20.0, surface_height=12.0)
    trajectory = survey(place, Lawnmower(legs=2, length=80.0, spacing=30.0, speed=1.5, heading=radians(200.0)), duration=150.0)
    beacon = Beacon(north=200.0, east=-150.0, depth=40.0)
    instruments = {
        "dvl": Dvl(rate=0.2, output="both", lever_arm_b=LEVER, mounting_bs=MOUNTING, sigma=0.0, azimuths=AZIMUTHS, tilt=TILT),
        "depth": Depth(rate=0.2, lever_arm_b=(0.7, 0.1, -0.2), sigma=0.0),
        "heading": Heading(rate=0.2, sigma=0.0),
        "attitude": Attitude(rate=0.2, sigma=(0.0, 0.0, 0.0), mounting_bs=MOUNTING),
        "gnss": Gnss(rate=0.2, lever_arm_b=(0.2, 0.1, -0.9), sigma=(0.0, 0.0, 0.0), max_depth=100.0),
        "fix": PositionFix(rate=0.2, lever_arm_b=(0.2, 0.1, -0.9), sigma=0.0, sigma_depth=0.0),
        "ranges": AcousticRange(rate=0.2, lever_arm_b=(0.3, 0.0, 0.5), beacons={"b": beacon}, path="one_way", sigma=0.0),
    }
    log = simulate(trajectory, instruments, seed=0)
    return log, trajectory


def view_at(trajectory, time):
    truth = trajectory.at(np.array([time]))
    latitude, longitude, height = (float(v[0]) for v in truth.geodetic)
    rotation_nb = truth.rotation_nb[0]
    return view_of(latitude, longitude, height, quaternion_from_matrix(rotation_nb), truth.velocity_n[0], truth.rate_eb_b[0]), rotation_nb


def predicted(channel, view, row):
    z, R = np.zeros(COMPONENTS), np.zeros((COMPONENTS, COMPONENTS))
    Hv, Hn = np.zeros((COMPONENTS, 2 * TANGENT)), np.zeros((COMPONENTS, NUISANCES))
    views = np.concatenate([view, np.zeros(VIEW_SIZE)])
    assert channel.predict(views, np.zeros(NUISANCES), row, channel.parameters, z, R, Hv, Hn) == 0
    return z[: len(channel.components)]


def composed(log, name, use="velocity", frame="sensor"):
    context = Context(surface=log.datum.geoid_undulation, origin=log.origin, beacons=log.beacons)
    return compose(vehicle_from_toml(VEHICLE.format(use=use, frame=frame))[name], context)


# The turning of the frame (1e-6 rad/s at a lever arm of 0.8 m) is left to the rate of a view; a level plane leaves the ellipsoid by 4e-8 m
# at the end of a lever arm; positions are good to 1e-8 m.
CASES = {"dvl": 3e-6, "beams": 3e-6, "depth": 1e-7, "heading": 1e-9, "attitude": 1e-9, "gnss": 1e-7, "fix": 1e-7, "ranges": 1e-8}


@pytest.mark.parametrize("case", CASES)
def test_value_at_the_truth_is_what_the_instrument_says(made, case):
    log, trajectory = made
    name = "dvl" if case == "beams" else case
    sensor = composed(log, name, use="beams" if case == "beams" else "velocity")
    seen = 0
    for part in sensor.read(log[name]).rows:
        channel = sensor.channels[part.channel]
        for k in range(0, len(part.row), 3):
            view, _ = view_at(trajectory, log[name].time[part.row[k]])
            residual = part.data[k, : len(channel.components)] - predicted(channel, view, part.data[k])
            if any(channel.angles):
                residual = (residual + np.pi) % (2 * np.pi) - np.pi
            assert np.abs(residual).max() < CASES[case], channel.components
            seen += 1
    assert seen >= (4 if case == "beams" else 1) * 8


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
