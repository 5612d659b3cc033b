"""A two-way range from a moving vehicle: two epochs are unbiased; one epoch is wrong by half of speed times flight.

The vehicle runs at 2 m/s straight away from a beacon 3 km off, so that sound is on its way for about 4 s.  The start is
known to 2 m: with one beacon the position across the range is not seen, and its square over twice the range (1 mm here, 7 cm at 20 m)
would be a bias of the linearisation.
"""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from leadline.assess.errors import errors_of
from leadline.assess.intervals import interval_of_mean
from leadline.data.log import Beacon
from leadline.data.outcome import Outcome
from leadline.data.vehicle import vehicle_from_toml
from leadline.estimate.solve import solve
from leadline.missions.bound import ideal_log
from leadline.missions.instruments import instruments_of
from leadline.missions.montecarlo import seed_of
from leadline.models.sensor import Reading
from leadline.models.sensors import acoustic_range
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.plans import straight
from leadline.simulate.trajectory import Place

SPEED, RANGE, SOUND = 2.0, 3000.0, 1500.0
FLIGHT = 2 * RANGE / SOUND
PLACE = Place(radians(50.0), radians(-5.0), depth=20.0)
BEACONS = {"behind": Beacon(north=-RANGE, east=0.0, depth=30.0, turnaround=0.05)}
RUNS = 200

VEHICLE = """
name = "ranging"
[sensors.imu]
rate_hz = 50.0
gyro_noise_deg_per_rth = 0.012
gyro_bias_deg_per_h = 0.1
accel_noise_ug_per_rthz = 50.0
accel_bias_ug = 100.0
[sensors.dvl]
rate_hz = 2.0
sigma_mps = 0.01
[sensors.depth]
rate_hz = 2.0
sigma_m = 0.05
[sensors.ranges]
kind = "acoustic_range"
rate_hz = 0.1
sigma_m = 0.1
path = "two_way"
lever_arm_m = [0.8, 0.0, -0.2]
"""


def one_epoch(config, context):
    """Half the round trip, taken as the distance at reception: the wrong model, through the public contract of a sensor."""
    right = acoustic_range.compose(config, context)
    (one, _) = right.channels

    def read(table):
        found = right.read(table)
        return Reading(tuple(replace(rows, channel=0, earlier=None) for rows in found.rows), found.outcome)

    return replace(right, channels=(one,), read=read, flight=0.0)


@pytest.fixture(scope="module")
def vehicle():
    return vehicle_from_toml(VEHICLE)


@pytest.fixture(scope="module")
def recorder(vehicle):
    trajectory = straight(PLACE, 120.0, speed=SPEED)
    start = StartSigmas(position=2.0, depth=0.1, velocity=0.02, tilt=0.001, heading=0.002)
    return Recorder(trajectory, instruments_of(vehicle, beacons=BEACONS), truth_rate=0.1, start=start)


def wrong(vehicle):
    ranges = replace(vehicle["ranges"], model=f"{__name__}:one_epoch")
    return replace(vehicle, sensors={**vehicle.sensors, "ranges": ranges})


def range_residuals(solution):
    """Residuals (rows,) of the ranges that were looked at, and which of them were used."""
    looked = solution.innovations
    mine = looked.select((looked.sensor == "ranges") & np.isfinite(looked.nis))
    return mine.residual, mine.outcome == Outcome.USED


def exact(recorder):
    """The ideal log, started so surely that ranges move nothing: their residuals are those of the model at the true state."""
    return ideal_log(replace(recorder, start=StartSigmas(1e-3, 1e-3, 1e-4, 1e-6, 1e-6)))


def test_residual_at_the_true_state_is_below_a_millimetre(recorder, vehicle):
    residual, used = range_residuals(solve(exact(recorder), vehicle))
    assert len(residual) == 12
    assert used.all()
    assert np.abs(residual).max() < 1e-3


def test_one_epoch_is_wrong_by_half_of_speed_times_flight(recorder, vehicle):
    log = exact(recorder)
    residual, _ = range_residuals(solve(log, wrong(vehicle)))
    flown = (log["ranges"].time - log["ranges"].transmit)[: len(residual)]  # the last one arrives after the end
    assert len(flown) == 12
    assert flown.min() > FLIGHT
    np.testing.assert_allclose(residual, -0.5 * SPEED * flown, rtol=0.03)  # the weave changes the speed


@pytest.fixture(scope="module")
def ends(recorder, vehicle):
    """True minus estimated position along the range at the end of each run (runs,), by two epochs and by one."""
    along = {"two": [], "one": []}
    for run in range(RUNS):
        log = recorder.draw(seed_of("two-way range", run))
        for name, used in (("two", vehicle), ("one", wrong(vehicle))):
            along[name].append(errors_of(solve(log, used, times=log.truth.time), log.truth).error[-1, 0])
    return {name: np.array(values) for name, values in along.items()}


def test_two_epochs_are_unbiased(ends):
    assert interval_of_mean(ends["two"]).reaches(0.0, at_least=0.0), interval_of_mean(ends["two"])


def test_one_epoch_biases_the_position(ends):
    biased = interval_of_mean(ends["one"])
    assert biased.reaches(1.1 * 0.5 * SPEED * FLIGHT, at_least=0.9 * 0.5 * SPEED * FLIGHT), biased
    assert biased.low > 1.0
