"""Shares of the error: they add up to what the filter states, and each is what an experiment with that source alone shows."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from leadline import cli
from leadline.data.errors import InputError
from leadline.data.log import Beacon
from leadline.data.vehicle import vehicle_from_toml
from leadline.estimate.assembly import navigator_for
from leadline.estimate.budget import GROUPS, budget
from leadline.estimate.solve import solve
from leadline.formats.folder import write_log
from leadline.missions.bound import ideal_log
from leadline.missions.instruments import instruments_of
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.plans import Lawnmower, survey
from leadline.simulate.trajectory import Place

VEHICLE = """
name = "budget"
[sensors.imu]
preset = "kvh-1775"
rate_hz = 50.0
[sensors.dvl]
rate_hz = 2.0
sigma_mps = 0.02
[sensors.dvl.nuisance]
scale = { sigma_percent = 0.5, estimate = false }
bias = { sigma_mps = 0.01, tau_s = 60.0 }
[sensors.depth]
rate_hz = 2.0
sigma_m = 0.05
[sensors.heading]
rate_hz = 1.0
sigma_deg = 0.5
[sensors.ranges]
kind = "acoustic_range"
rate_hz = 0.1
sigma_m = 1.0
path = "two_way"
"""
BEACONS = {"b": Beacon(north=150.0, east=100.0, depth=40.0, turnaround=0.1)}
PLACE = Place(radians(45.0), radians(10.0), depth=10.0)
START = StartSigmas(position=2.0, depth=0.2, velocity=0.05, tilt=radians(0.3), heading=radians(1.0))
ABOARD = vehicle_from_toml(VEHICLE)


def recorder(aboard=ABOARD):
    made = instruments_of(aboard, beacons=BEACONS)
    return Recorder(
        survey(PLACE, Lawnmower(legs=2, length=100.0, spacing=30.0, speed=1.5), duration=240.0), made, truth_rate=0.1, start=START
    )


@pytest.mark.parametrize("ranges", [True, False], ids=["with clones", "without"])
def test_shares_add_up_to_what_the_filter_states(ranges):
    aboard = ABOARD if ranges else ABOARD.without("ranges")
    log = recorder(aboard).draw(1)
    found, solution = budget(log, aboard), solve(log, aboard, rate=1.0)
    assert found.time == solution.time[-1]
    assert found.stated["horizontal position"] == pytest.approx(
        np.sum(solution.sigma[-1, :2] ** 2), rel=0.02
    )  # levers of the attitude apart
    assert found.stated["heading"] == pytest.approx(solution.sigma[-1, 8] ** 2, rel=1e-6)
    for group in GROUPS:
        own = sum(s.variance[group] for s in found.shares if s.kind != "constant")
        assert own == pytest.approx(found.stated[group], rel=0.01), group
        assert found.left[group] == pytest.approx(1.0 - own / found.stated[group])
        assert found.total[group] >= found.stated[group]
    assert {s.source for s in found.shares if s.kind == "noise"} == set(aboard.sensors) - {"imu"}


def test_a_root_is_read_as_one():
    """The square-root filter carries a root in the covariance's place; its budget is that of the same filter without."""
    log = recorder(ABOARD.without("ranges")).draw(1)
    plain, rooted = (budget(log, ABOARD.without("ranges"), until=60.0, estimator=e) for e in ("ukf", "srukf"))
    for group in GROUPS:
        assert rooted.stated[group] == pytest.approx(plain.stated[group], rel=1e-6)
        assert rooted.left[group] == pytest.approx(plain.left[group], abs=1e-6)


def test_particles_have_no_budget():
    with pytest.raises(InputError, match="'pf' leaves no gains"):
        budget(recorder(ABOARD).draw(1), ABOARD.moved_by("cruise").without("imu", "ranges"), until=10.0, estimator="pf")


def test_a_constant_that_is_taken_for_known_brings_what_it_does():
    """On a dive without any error but that of the Doppler scale the position is off by the root of its share, times error / sigma."""
    aboard = ABOARD.without("ranges")
    ideal = ideal_log(recorder(aboard))
    share = next(s for s in budget(ideal, aboard).shares if s.kind == "constant")
    assert share.source == "dvl.scale"
    exact, wrong = solve(ideal, aboard, rate=1.0), None
    scaled = replace(ideal["dvl"], velocity=ideal["dvl"].velocity * 1.005)
    wrong = solve(replace(ideal, tables={**ideal.tables, "dvl": scaled}), aboard, rate=1.0)
    moved = wrong.position_n[-1, :2] - exact.position_n[-1, :2]
    assert np.linalg.norm(moved) == pytest.approx(np.sqrt(share.variance["horizontal position"]), rel=0.03)


def test_one_noisy_instrument_brings_its_share():
    """Runs in which the compass alone is noisy scatter by its share: 40 of them, held against chi-square."""
    aboard = ABOARD.without("ranges")
    quiet = recorder(aboard)
    ideal = ideal_log(quiet)
    share = next(s for s in budget(ideal, aboard).shares if s.source == "heading" and s.kind == "noise").variance["heading"]
    exact, generator = solve(ideal, aboard, rate=0.1), np.random.default_rng(3)
    squares = []
    for _ in range(40):
        noisy = replace(
            ideal["heading"], heading=ideal["heading"].heading + radians(0.5) * generator.standard_normal(len(ideal["heading"]))
        )
        found = solve(replace(ideal, tables={**ideal.tables, "heading": noisy}), aboard, rate=0.1)
        turn = np.arctan2(*_heading_difference(found, exact))
        squares.append(turn**2)
    assert 0.5 < np.mean(squares) / share < 1.75  # chi-square with 40 degrees of freedom: 0.1 % on either side


def _heading_difference(a, b):
    from leadline.core.attitude import euler_from_quaternion

    turn = euler_from_quaternion(a.quaternion_nb[-1])[2] - euler_from_quaternion(b.quaternion_nb[-1])[2]
    return np.array([np.sin(turn), np.cos(turn)])


def test_the_command(tmp_path, capsys):
    write_log(recorder().draw(1), tmp_path / "dive")
    (tmp_path / "v.toml").write_text(VEHICLE)
    assert cli.run(["budget", str(tmp_path / "dive"), "--vehicle", str(tmp_path / "v.toml"), "--until", "100"]) == 0
    told = capsys.readouterr().out
    assert "dvl.scale" in told
    assert "depth, noise" in told
    assert cli.run(["budget", str(tmp_path / "dive"), "--vehicle", str(tmp_path / "v.toml"), "--until", "1e6"]) == 2
    assert "lies after" in capsys.readouterr().err


def test_what_is_not_estimated_is_no_state():
    navigator, _, _ = navigator_for(recorder().draw(1), ABOARD)
    assert "dvl.scale" not in [n.name for n in navigator.composition.layout.nuisances]
