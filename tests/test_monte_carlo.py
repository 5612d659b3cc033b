"""Are the errors those that the filter states?  A hundred dives of half an hour with a MEMS and with a fibre-optic unit, and the bound.

Each vehicle file describes the filter's model and the simulated instruments at once.  Bars, each with the 99 % interval reaching it:
NEES of position, velocity and attitude, and NIS, gate and whiteness of each sensor, judged as one family (Holm, 1 %); mean NEES inside
its 95 % band at 90 % of the check times at least; RMSE at most 1.1 of the Cramér-Rao bound for each of the nine errors.
"""

from dataclasses import replace
from math import radians

import numpy as np
import pytest
from scipy.stats import chi2

from leadline.assess.consistency import Answer
from leadline.data.errors import InputError
from leadline.data.log import Beacon
from leadline.data.outcome import Outcome
from leadline.data.vehicle import Prior, vehicle_from_toml
from leadline.estimate.solve import solve
from leadline.missions.bound import bound_of, ideal_log
from leadline.missions.instruments import instruments_of
from leadline.missions.montecarlo import Groups, Study, monte_carlo, run_once, seed_of
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.plans import Lawnmower, survey
from leadline.simulate.trajectory import Place

RUNS = 100
START = StartSigmas(position=2.0, depth=0.2, velocity=0.05, tilt=radians(0.3), heading=radians(1.0))
PLACE = Place(radians(45.0), radians(10.0), depth=20.0, surface_height=10.0)
PLAN = Lawnmower(legs=6, length=250.0, spacing=40.0, speed=1.5, heading=radians(30.0))

VEHICLE = """
name = "{name}"
[sensors.imu]
preset = "{name}"
rate_hz = 100.0
lever_arm_m = [0.3, 0.0, -0.05]
[sensors.dvl]
rate_hz = 5.0
sigma_mps = 0.01
lever_arm_m = [-0.6, 0.1, 0.3]
mounting_deg = [0.0, 0.0, 45.0]
[sensors.dvl.nuisance]
scale = {{ sigma_percent = 0.3 }}
mounting = {{ sigma_deg = 0.5 }}
[sensors.depth]
rate_hz = 5.0
sigma_m = 0.05
lever_arm_m = [0.7, 0.0, -0.1]
nuisance = {{ datum = {{ sigma_m = 0.1 }} }}
[sensors.heading]
{heading}
[sensors.usbl]
kind = "position_fix"
rate_hz = {fixes}
sigma_m = {sigma}
vertical = false
lever_arm_m = [0.2, 0.0, -0.3]
"""
# a compass beside the MEMS unit, as good as the heading of its data sheet; a gyrocompass beside the fibre-optic one
COMPASS = "rate_hz = 5.0\nsigma_deg = 1.0\nnuisance = { bias = { sigma_deg = 1.0 } }"
GYROCOMPASS = "rate_hz = 1.0\nsigma_deg = 0.2\nnuisance = { bias = { sigma_deg = 0.5 } }"
VEHICLES = {
    "xsens-mti-30": VEHICLE.format(name="xsens-mti-30", heading=COMPASS, fixes=1 / 60, sigma=2.0),
    "kvh-1775": VEHICLE.format(name="kvh-1775", heading=GYROCOMPASS, fixes=1 / 90, sigma=1.0),
}


def vehicle(name):
    return vehicle_from_toml(VEHICLES[name])


def short(processes=1, runs=(0, 1, 2), **keywords):
    """A study of a minute at 50 Hz."""
    text = VEHICLES["kvh-1775"].replace("rate_hz = 100.0", "rate_hz = 50.0")
    trajectory = survey(PLACE, PLAN, duration=60.0)
    return monte_carlo(trajectory, vehicle_from_toml(text), runs, start=START, processes=processes, **keywords)


@pytest.mark.slow
@pytest.mark.parametrize("name", VEHICLES)
def test_errors_are_those_that_the_filter_states(name):
    study = monte_carlo(survey(PLACE, PLAN, duration=1800.0), vehicle(name), range(RUNS), start=START, mission="survey", processes=2)
    wrong = [verdict.sentence for verdict in study.verdicts() if verdict.answer != Answer.CONSISTENT]
    assert not wrong
    for block in ("position", "velocity", "attitude"):
        assert study.in_band(block).reaches(at_least=0.9), block
    for axis, ratio in enumerate(study.efficiency()):
        assert ratio.reaches(1.1), f"error {axis}: {ratio}"


@pytest.mark.parametrize("name", VEHICLES)
def test_bound_is_the_covariance_of_a_filter_that_knows_the_truth(name):
    """The information recursion and the filter's covariance are written twice; on a run without noise they must agree to 1e-4.

    What is left between them is where they linearise: the filter at its estimate.  So that this is the truth, the IMU is the body's
    origin (from elsewhere its speed at the start is known only as well as the first angular rate), and pings fall between its samples.
    """
    used = vehicle_from_toml(VEHICLES[name].replace("lever_arm_m = [0.3, 0.0, -0.05]\n", ""))
    made = instruments_of(used)
    made["dvl"] = replace(made["dvl"], offset=0.105)
    recorder = Recorder(survey(PLACE, PLAN, duration=300.0), made, truth_rate=0.1, start=START)
    times = recorder.truth.time
    stated = solve(ideal_log(recorder), used, times=times).covariance
    limit = bound_of(recorder, used, times)
    sigma = np.sqrt(np.diagonal(limit, axis1=1, axis2=2))
    assert np.abs((stated - limit) / (sigma[:, :, None] * sigma[:, None, :])).max() < 1e-4


def test_runs_are_the_same_in_any_order_and_in_any_process():
    plain, shared = short(), short(processes=2, runs=(2, 0, 1))
    assert shared.seeds == tuple(seed_of("mission", run) for run in (2, 0, 1))
    assert np.array_equal(plain.error[[2, 0, 1]], shared.error)
    assert np.array_equal(plain.bound, shared.bound)
    for sensor, groups in plain.groups.items():
        assert sorted(groups.nis) == sorted(shared.groups[sensor].nis)


def test_progress_and_seeds():
    seen = []
    study = short(runs=(5, 6), mission="other", progress=seen.append)
    assert seen == [1, 2]
    assert len({seed_of(mission, run) for mission in ("a", "b") for run in range(50)}) == 100
    assert study.time[-1] == 60.0
    assert study.rmse.shape == study.bound_sigma.shape == (7, 9)


def test_noise_is_paired_over_vehicles():
    """A vehicle that lacks an instrument meets the same noise in the others."""
    trajectory, whole = survey(PLACE, PLAN, duration=20.0), vehicle("kvh-1775")
    logs = [Recorder(trajectory, instruments_of(used), start=START).draw(3) for used in (whole, whole.without("usbl"))]
    assert np.array_equal(logs[0]["dvl"].velocity, logs[1]["dvl"].velocity)
    assert logs[0].initial == logs[1].initial


def test_no_runs_are_refused():
    with pytest.raises(InputError, match="there are none"):
        short(runs=())


def test_an_overconfident_vehicle_file_is_found_out():
    """The same instruments, navigated by a file that halves the sigma of the Doppler log."""
    text = VEHICLES["kvh-1775"].replace("rate_hz = 100.0", "rate_hz = 50.0")
    used = vehicle_from_toml(text.replace("sigma_mps = 0.01", "sigma_mps = 0.005"))
    instruments = instruments_of(vehicle_from_toml(text))
    study = monte_carlo(survey(PLACE, PLAN, duration=120.0), used, range(3), start=START, instruments=instruments)
    wrong = {verdict.subject: verdict for verdict in study.verdicts() if verdict.answer == Answer.INCONSISTENT}
    assert wrong["dvl"].factor.low > 1.5


def synthetic(scale, runs=60, times=50):
    """A study of errors that are constant within a run, but for their sign, and `scale` times as large as stated."""
    rng = np.random.default_rng(5)
    sign = np.where(np.arange(times) % 2, 1.0, -1.0)
    error = scale * rng.standard_normal((runs, 1, 9)) * sign[:, None]
    whitened = {block: error[:, :, part] for block, part in (("position", slice(0, 3)), ("velocity", slice(3, 6)))}
    whitened |= {"attitude": error[:, :, 6:], "all": error, "horizontal": error[:, :, :2]}
    groups = Groups(np.ones(0), np.ones(0, int), np.ones(0), np.ones(0, int))
    return Study("m", tuple(range(runs)), np.arange(times) * 1.0, error, whitened, np.tile(np.eye(9), (times, 1, 1)), {"x": groups}, {})


def test_times_of_a_run_whose_error_only_changes_sign_count_once():
    evidence = synthetic(1.0).evidence_of("position")
    assert 30 < evidence.effective < 120  # of 60 runs
    assert evidence.p > 0.01
    assert synthetic(1.5).evidence_of("position").p < 1e-4


def test_band_and_efficiency_of_known_errors():
    study = synthetic(1.0)
    inside = study.in_band("all")
    assert inside.estimate in (0.0, 1.0)  # one draw, seen at all times
    assert sum(ratio.reaches(1.0, at_least=1.0) for ratio in study.efficiency()) >= 8  # of nine, at 99 % each
    assert not any(ratio.reaches(1.1) for ratio in synthetic(2.0).efficiency())
    low, high = chi2.ppf([0.025, 0.975], 60 * 3) / 60
    assert (low <= study.nees("position")[0] <= high) == (study.in_band("position").estimate == 1.0)


def test_instruments_are_what_the_vehicle_file_says():
    made = instruments_of(vehicle("xsens-mti-30"))
    assert made["imu"].gyro_density == pytest.approx(radians(1.8) / 60)
    assert made["imu"].accel_density == pytest.approx(60 * 9.80665e-6)
    assert made["imu"].gyro_bias.turn_on == pytest.approx(radians(720.0) / 3600)
    assert made["imu"].gyro_bias.walk == pytest.approx(radians(18.0) / 3600 / np.sqrt(600.0))
    assert made["dvl"].sigma_scale == pytest.approx(0.003)
    assert made["dvl"].sigma_mounting == pytest.approx(radians(0.5))
    assert made["dvl"].mounting_bs == pytest.approx((0.0, 0.0, radians(45.0)))
    assert made["depth"].lever_arm_b == (0.7, 0.0, -0.1)
    assert made["usbl"].rate == pytest.approx(1 / 60)


EVERY = """
name = "every kind"
[sensors.imu]
preset = "kvh-1775"
rate_hz = 50.0
[sensors.dvl]
rate_hz = 5.0
sigma_mps = 0.01
beam_azimuth_deg = [0.0, 90.0, 180.0, 270.0]
beam_tilt_deg = 30.0
use = "beams"
[sensors.dvl.nuisance]
scale = { value_percent = 1.0, sigma_percent = 0.2 }
mounting = { value_deg = 1.0, sigma_deg = 0.2 }
bias = { sigma_mps = [0.01, 0.02, 0.01] }
[sensors.pressure_depth]
kind = "depth"
rate_hz = 5.0
sigma_m = 0.05
nuisance = { datum = { sigma_m = 0.3, tau_s = 100.0 } }
[sensors.heading]
rate_hz = 5.0
sigma_deg = 0.5
mounting_deg = [0.0, 0.0, 30.0]
reference = "magnetic"
declination_deg = 4.0
[sensors.ahrs]
kind = "attitude"
rate_hz = 10.0
sigma_deg = 1.0
sigma_tilt_deg = 0.3
mounting_deg = [0.0, 0.0, 90.0]
nuisance = { bias = { sigma_deg = [0.1, 0.2, 0.5], walk_deg_per_rts = 0.001 } }
[sensors.ranges]
kind = "acoustic_range"
rate_hz = 0.5
sigma_m = 0.2
path = "two_way"
nuisance = { scale = { sigma_percent = 0.2 }, bias = { sigma_m = 0.3 } }
[sensors.gnss]
rate_hz = 1.0
sigma_m = 1.0
"""
BEACONS = {"b": Beacon(north=300.0, east=200.0, depth=40.0, turnaround=0.1)}


@pytest.mark.parametrize("left_out", ["dvl", "ahrs"])  # with both there are more nuisances than a state holds
def test_every_kind_of_instrument_fits_its_sensor_model(left_out):
    """Drawn and navigated, each kind's innovations are of the size that the filter predicts."""
    used = vehicle_from_toml(EVERY).without(left_out)
    made = instruments_of(used, beacons=BEACONS)
    made["gnss"] = replace(made["gnss"], max_depth=1e3)
    recorder = Recorder(survey(PLACE, PLAN, duration=120.0), made, truth_rate=0.1, start=START)
    runs = [run_once(recorder, used, seed_of("kinds", run)) for run in range(6)]
    for sensor in used.sensors.keys() - {"imu"}:
        nis = np.concatenate([run.groups[sensor].nis for run in runs])
        dof = np.concatenate([run.groups[sensor].dof for run in runs])
        outcome = np.concatenate([run.groups[sensor].outcome for run in runs])
        assert np.mean(outcome == Outcome.USED) > 0.98, sensor
        total, expected = nis.sum(), dof.sum()
        assert abs(total - expected) < 5.0 * np.sqrt(2.0 * expected), (sensor, total / expected)


@pytest.mark.parametrize(
    ("sensor", "change", "message"),
    [
        ("dvl", {"latency": 0.1}, "latency"),
        ("dvl", {"values": {"sigma": 0.01, "frame": "ned", "rate": 5.0}}, "levels no velocities"),
        ("dvl", {"nuisance": {"scale": Prior(np.zeros(1), np.ones(1), tau=100.0)}}, "draws a constant"),
        ("pressure_depth", {"nuisance": {"datum": Prior(np.ones(1), np.ones(1), tau=100.0)}}, "steady sigma"),
        ("ranges", {"nuisance": {"scale": Prior(np.ones(1), np.ones(1))}}, "true speed"),
        ("gnss", {"values": {"sigma": 1.0}}, "has no rate"),
    ],
)
def test_what_the_simulator_cannot_draw_is_refused(sensor, change, message):
    used = vehicle_from_toml(EVERY)
    changed = replace(used, sensors={**used.sensors, sensor: replace(used[sensor], **change)})
    with pytest.raises(InputError, match=message):
        instruments_of(changed, beacons=BEACONS)


def test_bound_of_two_epochs_is_refused():
    used = vehicle_from_toml(EVERY).without("ahrs")
    recorder = Recorder(survey(PLACE, PLAN, duration=20.0), instruments_of(used, beacons=BEACONS), truth_rate=0.1, start=START)
    with pytest.raises(InputError, match="two epochs"):
        bound_of(recorder, used, recorder.truth.time)


def table(mission):
    """Yield the rows of the table of docs/accuracy.md for one set of seeds."""
    for name in VEHICLES:
        study = monte_carlo(survey(PLACE, PLAN, duration=1800.0), vehicle(name), range(RUNS), start=START, mission=mission, processes=2)
        blocks = ("position", "velocity", "attitude")
        nees = " / ".join(f"{np.mean(study.nees(block)):.2f}" for block in blocks)
        band = " / ".join(f"{study.in_band(block).estimate:.2f}" for block in blocks)
        ratio = ", ".join(f"{interval.estimate:.2f}" for interval in study.efficiency())
        verdicts = {verdict.answer.name.lower() for verdict in study.verdicts()}
        yield f"| {name} | {mission} | {nees} | {band} | {ratio} | {', '.join(sorted(verdicts))} |"


if __name__ == "__main__":
    import sys

    print("| vehicle | seeds | NEES (3) position / velocity / attitude | share in band | RMSE over bound, nine errors | verdicts |")
    print("|---|---|---|---|---|---|")
    for seeds in sys.argv[1:] or ["survey"]:
        print("\n".join(table(seeds)), flush=True)
