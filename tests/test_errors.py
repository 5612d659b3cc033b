"""Errors against truth: zero where there are none, the right ones where they are put, at the pole and across the date line too."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solutions import EPOCH, HAIFA, group_rows, innovations, lawnmower, solution, straight, survey, truth_of

from leadline.assess.assessment import assess
from leadline.assess.errors import errors_of, misclosures
from leadline.assess.matching import north_turn, states_at, travelled
from leadline.core import attitude, geodesy
from leadline.data.log import Origin
from leadline.data.outcome import Outcome
from leadline.data.records import Truth
from leadline.data.solution import Solution

TIME = np.arange(0.0, 100.0)
PLACES = [
    HAIFA,
    Origin(np.radians(89.9), np.radians(10.0)),
    Origin(np.radians(-89.9), np.radians(-170.0)),
    Origin(np.radians(-17.0), np.radians(179.9999)),
    Origin(0.0, 0.0),
]


@pytest.mark.parametrize("origin", PLACES)
def test_no_error_is_zero_at_rows(origin):
    run = straight(TIME, origin=origin)
    found = errors_of(run, truth_of(run))
    assert len(found) == len(TIME)
    np.testing.assert_allclose(found.error[:, :3], 0.0, atol=2e-8)
    np.testing.assert_allclose(found.error[:, 3:], 0.0, atol=1e-12)


@pytest.mark.parametrize("origin", PLACES)
def test_known_errors_come_back_in_metres_at_the_truth(origin):
    run = straight(TIME, origin=origin)
    truth = truth_of(run)
    lat = truth.latitude + 3.0 / _meridian_radius(truth.latitude, truth.depth)
    lon = truth.longitude + 4.0 / (geodesy.parallel_radius(lat) * (1 + (17.0 - truth.depth) / 6.37e6))
    moved = replace(truth, latitude=lat, longitude=attitude.wrapped(lon), depth=truth.depth - 2.0)
    error = errors_of(run, moved).error[:, :3]
    np.testing.assert_allclose(error, np.tile([3.0, 4.0, -2.0], (len(TIME), 1)), atol=3e-3)


def _meridian_radius(latitude, depth):
    sine = np.sin(latitude)
    return geodesy.SEMI_MAJOR_AXIS * (1 - geodesy.ECCENTRICITY_2) / (1 - geodesy.ECCENTRICITY_2 * sine**2) ** 1.5 + 17.0 - depth


def test_attitude_near_the_pole_is_free_of_convergence():
    """One body, seen from two points 500 m apart at 89.9 degrees: headings differ by 2.6 degrees, the attitude by nothing but tilt."""
    place = PLACES[1]
    run = straight(TIME[:3], origin=place, speed=0.0)
    shift = 500.0 / geodesy.parallel_radius(place.latitude)
    truth = truth_of(run)
    there = replace(truth, longitude=truth.longitude + shift)
    seen_e = geodesy.rotation_en(run.latitude, run.longitude) @ attitude.matrix_from_quaternion(run.quaternion_nb)
    seen_n = np.swapaxes(geodesy.rotation_en(there.latitude, there.longitude), 1, 2) @ seen_e
    roll, pitch, heading = attitude.euler_from_quaternion(attitude.quaternion_from_matrix(seen_n))
    assert np.degrees(heading[0] - truth.heading[0]) == pytest.approx(np.degrees(shift), rel=1e-3)
    error = errors_of(run, replace(there, roll=roll, pitch=pitch, heading=heading)).error
    np.testing.assert_allclose(error[:, 8], 0.0, atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(error[:, 6:8], axis=1), 500.0 / 6.39e6, rtol=2e-2)
    np.testing.assert_allclose(error[:, 3:5], 0.0, atol=1e-12)


def test_north_turn_nearby_is_change_of_longitude_times_sine_of_latitude():
    turn = north_turn(np.array([0.8]), np.array([3.1415]), np.array([0.8001]), np.array([-3.1415]))
    assert turn[0] == pytest.approx((2 * np.pi - 6.283) * np.sin(0.80005), rel=1e-6)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(-0.1, 0.1), min_size=3, max_size=3), st.floats(-3.0, 3.0), st.floats(-1.2, 1.2))
def test_attitude_error_is_the_rotation_on_the_left(vector, heading, pitch):
    run = straight(TIME[:2], heading=heading, pitch=pitch)
    true = attitude.product(attitude.exponential(vector), run.quaternion_nb)
    roll, pitch_, heading_ = attitude.euler_from_quaternion(true)
    error = errors_of(run, replace(truth_of(run), roll=roll, pitch=pitch_, heading=heading_)).error
    np.testing.assert_allclose(error[:, 6:], np.tile(vector, (2, 1)), atol=1e-7)


def test_truth_between_rows_of_a_turning_vehicle():
    fine = np.arange(0.0, 600.0, 0.1)
    north, east, velocity, heading = lawnmower(fine)
    whole = solution(fine, north, east, 5.0 + 0.01 * fine, velocity + np.array([0, 0, 0.01]), heading)
    coarse = _rows(whole, slice(None, None, 20))
    error = errors_of(coarse, truth_of(whole, slice(0, 5980))).error
    assert np.abs(error[:, :3]).max() < 5e-3  # where a leg meets a turn the acceleration jumps
    assert np.abs(error[:, 8]).max() < 0.0251  # likewise the rate of turn: 0.05 rad/s times a quarter of the interval
    np.testing.assert_allclose(error[:, 6:8], 0.0, atol=1e-7)


def _rows(run, index):
    names = ("time", "latitude", "longitude", "height", "depth", "north", "east", "velocity_n", "quaternion_nb", "covariance", "status")
    return replace(run, **{name: getattr(run, name)[index] for name in names})


def test_interpolation_is_of_third_order_or_better():
    def worst(step):
        time = np.arange(0.0, 40.0 + step, step)
        angle = 0.1 * time
        velocity = np.stack([np.cos(angle), np.sin(angle), 0 * time], axis=1)
        run = solution(time, 10 * np.sin(angle), 10 * (1 - np.cos(angle)), 5.0, velocity, angle)
        at = np.arange(0.05, 39.9, 0.1)
        states = states_at(run, at)
        lat, lon = geodesy.from_north_east(10 * np.sin(0.1 * at), 10 * (1 - np.cos(0.1 * at)), HAIFA.latitude, HAIFA.longitude)
        return np.abs(states.latitude - lat).max() * 6.4e6 + np.abs(states.longitude - lon).max() * 5e6

    assert worst(2.0) / worst(1.0) > 7.0


def test_a_step_of_the_track_is_not_smoothed_into_overshoot():
    run = straight(TIME, speed=1.0, heading=0.0)
    jump = np.where(TIME >= 50, 30.0, 0.0)
    lat, lon = geodesy.from_north_east(run.north, run.east + jump, HAIFA.latitude, HAIFA.longitude)
    states = states_at(replace(run, latitude=lat, longitude=lon), np.linspace(49.0, 50.0, 11))
    _, east = geodesy.north_east(states.latitude, states.longitude, HAIFA.latitude, HAIFA.longitude)
    np.testing.assert_allclose(east, np.linspace(0.0, 30.0, 11), atol=1e-3)


def test_rows_left_out_are_counted_by_reason():
    run = _rows(straight(TIME), np.r_[0:40, 60:100])
    truth = truth_of(straight(TIME))
    outlier = np.zeros(100)
    outlier[3] = 1
    depth, lat = np.array(truth.depth), np.array(truth.latitude)
    depth[5] = lat[5] = np.nan
    silent = replace(truth, depth=depth, latitude=lat, roll=None, pitch=None, heading=None, velocity=None, outlier=outlier)
    shifted = replace(silent, time=truth.time + 0.5)
    found = errors_of(run, shifted)
    assert found.left_out == {"outlier": 1, "empty": 1, "outside": 1, "gap": 21, "thinned": 0}  # all 21 lie between rows 21 s apart
    assert len(found) == 100 - 24
    np.testing.assert_allclose(found.horizontal, 0.75, atol=1e-3)


def test_sparse_partial_truth_by_metres_and_height():
    run = straight(TIME)
    truth = Truth(
        time=np.array([80.0, 10.5, np.nan]),
        north=[run.north[80] + 1.0, np.nan, 0.0],
        east=[run.east[80], np.nan, 0.0],
        height=[np.nan, -2.0, 0.0],
    )
    found = errors_of(run, truth)
    np.testing.assert_allclose(found.time, [10.5, 80.0])
    np.testing.assert_allclose(found.error[1, :2], [1.0, 0.0], atol=1e-5)
    np.testing.assert_allclose(found.error[0, 2], -1.0, atol=1e-6)  # one metre above the estimate of 3 m below the ellipsoid
    assert np.isnan(found.error[0, :2]).all()
    assert np.isnan(found.error[:, 3:]).all()
    assert np.isnan(found.nees("all")).all()
    assert found.distance == pytest.approx(1.5 * 69.5, rel=1e-5)  # too sparse to measure a path: the solution's


def test_heading_alone():
    run = straight(TIME[:5], roll=0.1, pitch=-0.2)
    truth = Truth(time=TIME[:5], heading=np.full(5, 0.75))
    error = errors_of(run, truth).error
    np.testing.assert_allclose(error[:, 8], 0.05, atol=1e-9)
    assert np.isnan(error[:, 6:8]).all()


def test_truth_outside_or_empty_solution():
    run = straight(TIME)
    assert len(errors_of(run, replace(truth_of(run), time=TIME + 500.0))) == 0
    found = errors_of(_rows(run, slice(0, 0)), truth_of(run))
    assert len(found) == 0
    assert found.left_out["outside"] == 100
    assert found.statistics()["horizontal"].count == 0
    assert not len(found.drift())
    one = errors_of(_rows(run, slice(4, 5)), truth_of(run))
    assert one.time.tolist() == [4.0]
    assert np.isnan(one.percent_of_distance)


def test_statistics_and_drift_of_an_error_that_grows_with_distance():
    time = np.arange(0.0, 3000.0)
    run = straight(time, heading=0.0)
    truth = truth_of(run)
    lat, lon = geodesy.from_north_east(run.north * 1.003, run.east, HAIFA.latitude, HAIFA.longitude)
    found = errors_of(run, replace(truth, latitude=lat, longitude=lon))
    assert found.distance == pytest.approx(1.003 * run.north[-1], rel=1e-4)
    assert found.percent_of_distance == pytest.approx(0.3 / 1.003, rel=1e-3)
    drift = found.drift()
    assert len(drift) == 4
    np.testing.assert_allclose(drift, 3.0 / 1.003, rtol=1e-3)
    horizontal = found.statistics()["horizontal"]
    assert horizontal.maximum == horizontal.end == pytest.approx(0.003 * run.north[-1], rel=1e-3)
    assert horizontal.rms == pytest.approx(horizontal.end / np.sqrt(3), rel=1e-2)
    assert horizontal.median == pytest.approx(horizontal.end / 2, rel=1e-2)
    assert horizontal.p95 == pytest.approx(horizontal.end * 0.95, rel=1e-2)


def test_nees_counts_covariance_of_solution_and_truth():
    rng = np.random.default_rng(3)
    root = np.linalg.cholesky(np.cov(rng.standard_normal((9, 40))))
    run = straight(TIME[:10], covariance=np.tile(root @ root.T, (10, 1, 1)))
    truth = truth_of(run)
    moved = replace(truth, depth=truth.depth + 2.0, velocity=truth.velocity + 0.5)
    found = errors_of(run, moved)
    for block, part in (("position", slice(0, 3)), ("velocity", slice(3, 6)), ("all", slice(0, 9))):
        e = found.error[:, part]
        expected = np.einsum("ki,ij,kj->k", e, np.linalg.inv((root @ root.T)[part, part]), e)
        np.testing.assert_allclose(found.nees(block), expected, rtol=1e-7)
    alone = replace(truth, depth=truth.depth + 2.0, sigma_axes=np.tile([np.nan, 0.0, 3.0], (10, 1)))
    still = straight(TIME[:10], covariance=np.tile(np.eye(9), (10, 1, 1)))
    np.testing.assert_allclose(errors_of(still, alone).nees("position"), 4.0 / 10.0, rtol=1e-6)


def test_nees_is_nan_where_the_covariance_is_singular():
    run = straight(TIME[:4], covariance=np.zeros((4, 9, 9)))
    assert np.isnan(errors_of(run, truth_of(run)).nees("position")).all()


def test_truth_is_not_sorted_in_place_and_order_does_not_matter():
    run = straight(TIME)
    truth = truth_of(run)
    shuffled = truth.select(np.random.default_rng(0).permutation(100))
    before = shuffled.time.copy()
    np.testing.assert_array_equal(errors_of(run, shuffled).error, errors_of(run, truth).error)
    np.testing.assert_array_equal(shuffled.time, before)


def test_travelled_ignores_noise_and_closes_a_circle():
    angle = np.linspace(0, 2 * np.pi, 2000)
    rng = np.random.default_rng(0)
    north, east = 100 * np.sin(angle), 100 * np.cos(angle)
    lat, lon = geodesy.from_north_east(north, east, 0.5, np.pi)
    assert travelled(lat, lon)[-1] == pytest.approx(200 * np.pi, rel=1e-3)
    lat, lon = geodesy.from_north_east(north + 0.05 * rng.standard_normal(2000), east, 0.5, np.pi)
    assert travelled(lat, lon)[-1] == pytest.approx(200 * np.pi, rel=5e-3)


def test_misclosure_is_the_first_used_fix_after_a_gap():
    run = straight(np.arange(0.0, 1000.0))
    fixes = group_rows("usbl", [100.0, 110.0, 120.0, 500.0, 510.0], [[3.0, 4.0]] * 5, [5.0, 5.0], ["north", "east"])
    gated = np.where(fixes.row == 3, Outcome.GATED, fixes.outcome)
    table = innovations([replace(fixes, outcome=gated), group_rows("dvl", [300.0], [[0.1]], [0.1], ["x"])])
    found = misclosures(replace(run, innovations=table))
    assert [(m.sensor, m.row, m.time) for m in found] == [("usbl", 0, 100.0), ("usbl", 4, 510.0)]
    assert found[1].horizontal == pytest.approx(5.0)
    assert found[1].distance == pytest.approx(1.5 * 390, rel=1e-3)
    assert found[1].percent_of_distance == pytest.approx(100 * 5 / 585, rel=1e-3)
    assert np.isnan(found[1].down)


def test_assessment_of_a_survey_is_plain_and_complete():
    import json

    estimate, truth = survey(minutes=10)
    found = assess(estimate, truth)
    text = json.dumps(found.to_dict(), allow_nan=False)
    assert json.loads(text) == found.to_dict()
    assert found.counts["usbl"][Outcome.GATED] == 3
    assert found.counts["modem"] == {Outcome.NOT_CONFIGURED: 7}
    assert sum(found.counts["dvl"].values()) == len(np.arange(1.0, estimate.time[-1], 0.5))
    assert found.to_dict()["errors"]["statistics"]["heading_rad"]["rms"] < 0.05
    assert found.distance == pytest.approx(found.errors.distance, rel=0.05)


def test_assessment_of_nothing():
    run = straight(TIME)
    for nothing in (run, _rows(run, slice(0, 0)), _rows(run, slice(0, 1))):
        assert assess(nothing).to_dict()["verdict"]["answer"] == "too few data"
    assert isinstance(run, Solution)
    assert run.epoch == EPOCH
