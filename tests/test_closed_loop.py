"""Steered by its own estimate: what the navigator gets wrong the vehicle sails wrong, and what it leaves is a log like any other."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, reduce
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from leadline.assess.assessment import assess
from leadline.assess.consistency import Answer
from leadline.core.geodesy import north_east
from leadline.data.errors import InputError
from leadline.data.log import Beacon, Log
from leadline.data.records import after
from leadline.data.vehicle import vehicle_from_toml
from leadline.estimate.solve import solve
from leadline.missions.closed_loop import Eye, behind, sail_by_estimate
from leadline.missions.mission import Mission, read_mission
from leadline.missions.montecarlo import compared
from leadline.missions.simulation import drawn
from leadline.sea.terrain import plane
from leadline.simulate.acoustics import AcousticRange
from leadline.simulate.drift import Drift
from leadline.simulate.faults import Outage
from leadline.simulate.faults_of_values import StuckValue
from leadline.simulate.instrument import Instrument
from leadline.simulate.instruments import Depth, Dvl, Gnss, Imu, Triad
from leadline.simulate.multibeam import Multibeam
from leadline.simulate.plans import Weave, driven, still
from leadline.simulate.profiles import Ramp
from leadline.simulate.reception import Reception
from leadline.simulate.routes import Plan, Waypoints
from leadline.simulate.settled import settled
from leadline.simulate.trajectory import Place, Trajectory

SURVEY = Path(__file__).parent.parent / "missions" / "survey.toml"


def short() -> Mission:
    """One line of the survey, without the ship and in calm: nothing but dead reckoning once it is under water."""
    mission = read_mission(SURVEY)
    legs = (Waypoints(through=((25.0, 9.0),), speed=1.5, depth=0.0), Waypoints(through=((170.0, 62.0),), speed=1.5, depth=8.0))
    vehicle = mission.vehicle.without("usbl", "ranges")
    return replace(mission, plan=Plan(legs), vehicle=vehicle, instruments={}, faults=(), steer_by="estimate")


@cache
def loop() -> Log:
    return drawn(short(), 0)


def known(log: Log, mission: Mission) -> Log:
    return log.without(*(name for name in log.tables if name not in mission.vehicle.sensors and name != "truth"))


def test_the_log_it_leaves_fits_the_vehicle_file() -> None:
    """Innovations as large as predicted and white; errors within three sigmas (of one dive alone more cannot be said of its biases)."""
    log, mission = loop(), short()
    assert set(mission.vehicle.sensors) <= set(log.tables)
    solution = solve(known(log, mission), mission.vehicle, times=log.truth.time)  # type: ignore[union-attr]
    assert assess(solution, None).verdict.answer is not Answer.INCONSISTENT
    assert np.mean(np.abs(compared(solution, log.truth).error) < 3 * compared(solution, log.truth).sigma) > 0.97  # type: ignore[arg-type]


def test_the_way_is_wrong_by_what_the_navigator_gets_wrong() -> None:
    """With a Doppler log turned by five degrees and no satellites the vehicle believes to be on its line, and is metres off it."""
    mission = short()
    turned = {"dvl": {"mounting_deg": [0.0, 0.0, 50.0]}}
    mission = replace(mission, vehicle=mission.vehicle.without("gnss"), instruments=turned)
    log = drawn(mission, 0)
    truth = log.truth
    assert truth is not None
    solution = solve(known(log, mission), mission.vehicle, times=truth.time)
    start, end = mission.voyage().route[-2:, :2]
    along = (end - start) / np.linalg.norm(end - start)
    across = np.array([-along[1], along[0]])
    believed = np.stack([solution.north, solution.east], axis=1) - start
    north, east = north_east(truth.latitude, truth.longitude, mission.place.latitude, mission.place.longitude)  # type: ignore[arg-type]
    true = np.stack([north, east], axis=1) - start
    late = (believed @ along > 80.0) & (believed @ along < 140.0)
    assert np.abs(believed[late] @ across).max() < 1.5
    assert np.abs(true[late] @ across).min() > 3.0


def test_another_run_sails_another_way() -> None:
    first, other, truly = (log.truth for log in (loop(), drawn(short(), 1), drawn(replace(short(), steer_by="truth"), 0)))
    for one in (other, truly):
        assert one is not None
        assert first is not None
        rows = min(len(first), len(one))
        assert np.abs(first.latitude[:rows] - one.latitude[:rows]).max() * 6.4e6 > 0.05  # type: ignore[index]


def test_a_run_is_reproducible_to_the_bit() -> None:
    again = drawn(short(), 0)
    for name, table in loop().tables.items():
        for column in table.columns():
            a, b = getattr(table, column.name), getattr(again[name], column.name)
            assert (a is None) == (b is None)
            if a is not None:
                assert np.array_equal(a, b, equal_nan=not column.metadata["text"]), (name, column.name)


def test_lasting_errors_are_drawn_once() -> None:
    """Pieces of a settled instrument share their bias and scale; their spread over many dives is the sigma that was stated."""
    depth = Depth(rate=1.0, bias=Drift(turn_on=0.3))
    time = np.arange(5.0)
    drawn_values = []
    for seed in range(300):
        generator = np.random.default_rng(seed)
        still = settled(depth, "depth", 100.0, generator)
        one, two = (still.bias.draw(time + 20.0 * k, 1, generator)[:, 0] for k in (0, 1))
        assert one == pytest.approx(two)
        drawn_values.append(one[0])
    assert np.std(drawn_values) == pytest.approx(0.3, rel=0.12)  # three standard errors of a sigma of 300
    scales = [settled(Dvl(rate=1.0, sigma_scale=0.01), "dvl", 10.0, np.random.default_rng(s)).scale for s in range(300)]
    assert np.std(scales) == pytest.approx(0.01, rel=0.12)
    tilts = [settled(Dvl(rate=1.0, sigma_mounting=0.01), "dvl", 10.0, np.random.default_rng(s)).mounting_bs for s in range(300)]
    assert np.std(tilts, axis=0) == pytest.approx(0.01, rel=0.2)
    wander = settled(Depth(rate=1.0, bias=Drift(steady=0.5, tau=30.0)), "depth", 5000.0, np.random.default_rng(1))
    series = wander.bias.draw(np.arange(0.0, 5000.0, 1.0), 1, np.random.default_rng(2))[:, 0]
    assert np.std(series) == pytest.approx(0.5, rel=0.3)  # 83 independent values


def test_what_cannot_be_settled_is_refused() -> None:
    imu = Imu(rate=100.0, gyro_axes=Triad(sigma_misalignment=0.001))
    with pytest.raises(InputError, match="misalignment that is drawn once"):
        settled(imu, "imu", 10.0, np.random.default_rng(0))


def test_a_delay_of_the_navigator_is_felt() -> None:
    """A pilot that hears of the past steers worse: with three seconds of delay the vehicle weaves about its line."""
    late, _ = sail_by_estimate(replace(short(), delay=3.0), 5)
    prompt, _ = sail_by_estimate(short(), 5)
    weave = [np.std(np.concatenate(v.moved)[400:1100, 1]) for v in (late, prompt)]  # the rudder
    assert weave[0] > 1.2 * weave[1]


def test_the_navigator_aboard_meets_the_faults() -> None:
    """A Doppler log lost for good and a depth sensor that sticks: the log has them, whatever pieces it was made of."""
    lost = Outage(sensor="dvl", begin=40.0)
    stuck = StuckValue(sensor="depth", begin=60.0)
    log = drawn(replace(short(), faults=(lost, stuck)), 0)
    dvl, depth = log["dvl"], log["depth"]
    assert np.all(dvl.valid[dvl.time >= 40.0] == 0)  # type: ignore[index]
    assert np.all(dvl.valid[dvl.time < 40.0] == 1)  # type: ignore[index]
    held = depth.depth[depth.time >= 60.0]  # type: ignore[attr-defined]
    assert np.ptp(held) == 0.0
    assert held[0] == depth.depth[depth.time < 60.0][-1]  # type: ignore[attr-defined]  # across the pieces
    assert not depth.extra


def test_an_inertial_unit_cannot_be_stuck_on_the_way() -> None:
    with pytest.raises(InputError, match="too many to remember"):
        drawn(replace(short(), faults=(StuckValue(sensor="imu", begin=10.0),)), 0)


def test_thrusters_tell_of_the_dive_and_not_of_a_rehearsal() -> None:
    mission = replace(short(), instruments={"thrusters": {"kind": "thruster", "rate_hz": 5.0}})
    voyage, log = sail_by_estimate(mission, 3)
    time, moved = voyage.actuators()
    table = log["thrusters"]
    assert table.thruster[:, 0] == pytest.approx(np.interp(table.time, time, moved[:, 0]), abs=1e-9)  # type: ignore[attr-defined]
    assert table.rudder == pytest.approx(np.interp(table.time, time, moved[:, 1]), abs=1e-9)  # type: ignore[attr-defined]


HERE = Place(0.57, 0.61, 2.0, 17.0)


def heaving() -> Trajectory:
    """Up and down by some metres in 40 s."""
    return driven(
        HERE, 120.0, forward=Ramp(1.0), heading=Ramp(0.3, 0.05), pitch=Ramp(0.0), weave=Weave(down=(0.32, 40.0), heading=(0.2, 7.0))
    )


def piecewise(instrument: Instrument[Any], trajectory: Trajectory, seed: int = 0) -> Any:
    """What an instrument says that looks five times a second."""
    still_one = settled(instrument, "it", trajectory.duration, np.random.default_rng(seed))
    eye = Eye("it", still_one, still_one.sampling(trajectory.duration, np.random.default_rng(1)), behind(still_one), seed)
    for now in np.arange(0.0, trajectory.duration + 40.0, 0.2):
        eye.look(trajectory, now)
    return reduce(after, eye.pieces)


def at_once(instrument: Instrument[Any], trajectory: Trajectory) -> Any:
    seen = instrument.ideal(trajectory, instrument.sampling(trajectory.duration, np.random.default_rng(1)))
    return instrument.record(seen, np.random.default_rng(2))


def test_pieces_have_the_partners_and_the_pings_of_the_whole() -> None:
    trajectory = heaving()
    beacons = {name: Beacon(north=40.0 * k, east=20.0, depth=30.0, turnaround=9.0) for k, name in enumerate("abc")}
    ranges = AcousticRange(rate=0.7, beacons=beacons)
    pieces, whole = piecewise(ranges, trajectory), at_once(ranges, trajectory)
    assert set(pieces.transmitter) == set("abc")
    assert np.array_equal(pieces.transmitter, whole.transmitter)
    assert pieces.travel_time == pytest.approx(whole.travel_time, abs=1e-11)
    swath = Multibeam(rate=2.0, seabed=plane(30.0, 0.0, 0.0, (-300.0, 300.0, -300.0, 300.0), 5.0), beams=5)
    assert np.array_equal(piecewise(swath, trajectory).ping, at_once(swath, trajectory).ping)


def test_pieces_have_the_fixes_of_the_whole() -> None:
    """With delays that are sure: cold 3 s, then, after dives of 20 s, 1 s."""
    stages = (("single", 0.0), ("fixed", 6.0))
    reception = Reception(cold=3.0, least=3.0, hot=1.0, hot_least=1.0, hot_for=100.0, stages=stages)
    gnss = Gnss(rate=2.0, max_depth=2.0, reception=reception)
    trajectory = heaving()
    pieces, whole = piecewise(gnss, trajectory), at_once(gnss, trajectory)
    assert np.array_equal(pieces.time, whole.time)
    assert set(whole.fix_type) == {"none", "single", "fixed"}
    assert np.array_equal(pieces.fix_type, whole.fix_type)
    slow = replace(gnss, reception=replace(reception, hot=4.0))
    counts = [np.sum(piecewise(slow, trajectory, seed).fix_type == "none") for seed in range(4)]
    assert len(set(counts)) > 1  # each run waits for other times


def test_increments_carry_what_is_left_over_and_reach_back_to_the_row_before() -> None:
    """Sums of what is shown are within half a quantum of sums of what was felt, however many pieces there were."""
    quantum = 1e-3
    axes = Triad(quantum=quantum)
    imu = Imu(rate=50.0, sample="increment", jitter=0.004, gyro_axes=axes, accel_axes=axes)
    trajectory = heaving()
    clean = at_once(replace(imu, gyro_axes=Triad(), accel_axes=Triad()), trajectory)
    pieces = piecewise(imu, trajectory)
    assert pieces.interval == pytest.approx(clean.interval, abs=1e-12)
    for shown, felt in ((pieces.delta_angle, clean.delta_angle), (pieces.delta_velocity, clean.delta_velocity)):
        off = np.cumsum(shown, axis=0) - np.cumsum(felt, axis=0)
        assert np.max(np.abs(off)) < 0.5 * quantum / 50.0 + 1e-9


def test_the_first_interval_begins_where_the_motion_does() -> None:
    """A motion that is known from -10 s on, and an inertial unit whose rows are 20 s apart."""
    imu = Imu(rate=0.05, sample="increment")
    table = at_once(imu, still(HERE, 60.0))
    assert table.interval == pytest.approx([10.0, 20.0, 20.0, 20.0])
    assert table.delta_velocity[:, 2] == pytest.approx(-9.8 * table.interval, rel=2e-3)  # gravity of that latitude


def test_without_gyros_the_process_model_says_how_fast_it_turns() -> None:
    """A vehicle whose process model needs no inertial unit carries none, and goes its way on the surface by satellites and compass."""
    mission = short()
    legs = (Waypoints(through=((15.0, 5.0),), speed=1.5, depth=0.0),)
    vehicle = mission.vehicle.moved_by("cruise").without("imu")
    log = sail_by_estimate(replace(mission, plan=Plan(legs), vehicle=vehicle), 0)[1]
    assert "imu" not in log.tables
    assert log.truth is not None
    assert log.truth.time[-1] > 5.0


def test_a_navigator_that_cannot_go_along_is_refused() -> None:
    """One that waits for ticks, and one whose process model hears nothing of the thrusters: in a line that names the key."""
    mission = short()
    waiting = replace(mission.vehicle, process=replace(mission.vehicle.process, sync=1.0))
    with pytest.raises(InputError, match=r"process\.sync_s: 1\.0 s"):
        sail_by_estimate(replace(mission, vehicle=waiting), 0)
    process = replace(mission.vehicle.process, model="dynamics", written={"dynamics": {"hull": "remus-100"}})
    thrusters = vehicle_from_toml('name = "x"\n[process]\nmodel = "cruise"\n[sensors.thrusters]\nkind = "thruster"\n')["thrusters"]
    deaf = replace(mission.vehicle, process=process, sensors={**mission.vehicle.sensors, "thrusters": thrusters})
    with pytest.raises(InputError, match="carries no 'thrusters'"):
        sail_by_estimate(replace(mission, vehicle=deaf), 0)
