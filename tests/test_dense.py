"""Motion between knots: consistent with itself, near what it was sampled from, and felt by an inertial unit as by quadrature."""

from __future__ import annotations

import itertools
from math import radians

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from leadline.core.attitude import matrix_from_quaternion, quaternion_from_matrix
from leadline.data.errors import InputError
from leadline.simulate.dense import WIDTH, Dense
from leadline.simulate.gyros import means
from leadline.simulate.laws import Driven
from leadline.simulate.plans import Lawnmower, circle, survey
from leadline.simulate.profiles import Ramp, Sinusoid
from leadline.simulate.trajectory import Place, Trajectory

PLACE = Place(radians(47.0), radians(-5.0), depth=3.0, surface_height=50.0)


def sampled(trajectory: Trajectory, step: float, duration: float) -> Trajectory:
    """The same motion, known at knots alone."""
    time = step * np.arange(round(duration / step) + 1)
    m = trajectory.law(time)
    quaternion = quaternion_from_matrix(m.rotation_tb)
    knots = np.column_stack([m.position_t, m.velocity_t, m.acceleration_t, quaternion, m.rate_b, m.angular_acceleration_b])
    return Trajectory(trajectory.place, Dense(0.0, step, np.ascontiguousarray(knots)), duration)


def tumbling() -> Trajectory:
    """A vehicle that rolls over and stands on its head: pitch and roll pass a right angle."""
    law = Driven(
        roll=Sinusoid(2.5, 17.0), pitch=Sinusoid(1.9, 23.0, 0.4), heading=Ramp(0.2, 0.3),
        forward=Ramp(1.0), starboard=Sinusoid(0.3, 7.0), down=Sinusoid(0.2, 5.0), duration=40.0,
    )  # fmt: skip
    return Trajectory(PLACE, law, 40.0)


@pytest.mark.parametrize("trajectory", [circle(PLACE, 40.0, speed=1.5, radius=20.0), tumbling()], ids=["circle", "tumbling"])
def test_it_meets_the_motion_that_it_was_sampled_from_with_the_order_of_a_quintic(trajectory: Trajectory) -> None:
    time = np.linspace(0.3, 39.7, 991)
    errors = []
    for step in (0.4, 0.2):
        found, true = sampled(trajectory, step, 40.0).law(time), trajectory.law(time)
        turn = Rotation.from_matrix(found.rotation_tb @ np.swapaxes(true.rotation_tb, 1, 2)).magnitude()
        errors.append((np.abs(found.position_t - true.position_t).max(), turn.max()))
    for coarse, fine in zip(*errors, strict=True):
        assert 45 < coarse / fine < 80  # 2^6


def test_velocity_rate_and_their_derivatives_are_those_of_position_and_rotation() -> None:
    law, h = sampled(tumbling(), 0.5, 40.0).law, 1e-4  # far between knots: the interpolant itself is judged
    time = np.linspace(0.3, 39.7, 500) + 1e-3
    m, before, after = law(time), law(time - h), law(time + h)
    scale = 1e-16 / h  # rounding of a difference, per unit
    assert m.velocity_t == pytest.approx((after.position_t - before.position_t) / (2 * h), abs=40 * scale + 5e-8)
    assert m.acceleration_t == pytest.approx((after.velocity_t - before.velocity_t) / (2 * h), abs=5e-8)
    turn = Rotation.from_matrix(np.swapaxes(before.rotation_tb, 1, 2) @ after.rotation_tb).as_rotvec() / (2 * h)
    assert m.rate_b == pytest.approx(turn, abs=5e-8)
    assert m.angular_acceleration_b == pytest.approx((after.rate_b - before.rate_b) / (2 * h), abs=5e-8)


def test_knots_are_met() -> None:
    trajectory = tumbling()
    time = 0.5 * np.arange(79)
    found, true = sampled(trajectory, 0.5, 40.0).law(time), trajectory.law(time)
    for a, b in zip(found, true, strict=True):
        assert a == pytest.approx(b, abs=1e-12)


def test_a_unit_feels_what_quadrature_says() -> None:
    """The compiled integral against a fine sum over the NumPy path: another formula for gravity, rotation and lever arm."""
    dense = sampled(tumbling(), 0.25, 40.0)
    edges = np.linspace(0.1, 39.0, 60)  # intervals of 0.66 s: each crosses knots
    arm = (0.4, -0.2, 0.1)
    rate, force = means(dense, edges[:-1], edges[1:], arm)
    for j, (a, b) in enumerate(itertools.pairwise(edges)):
        inner = np.arange(np.floor(a / 0.25) + 1, np.ceil(b / 0.25)) * 0.25
        cuts = np.concatenate([[a], inner, [b]])
        nodes, weights = np.polynomial.legendre.leggauss(12)
        w, f = np.zeros(3), np.zeros(3)
        for lo, hi in itertools.pairwise(cuts):
            state = dense.at(lo + 0.5 * (hi - lo) * (1 + nodes)).point(arm)
            w += 0.5 * (hi - lo) * weights @ state.rate_ib_b
            f += 0.5 * (hi - lo) * weights @ state.specific_force_b
        assert rate[j] == pytest.approx(w / (b - a), abs=3e-9)  # three nodes on pieces of 0.25 s of a tumbling body
        assert force[j] == pytest.approx(f / (b - a), abs=3e-8)


def test_at_a_hundred_hertz_the_integral_is_exact_to_rounding() -> None:
    dense = sampled(survey(PLACE, Lawnmower(legs=1, surface_time=5.0), duration=60.0), 0.1, 50.0)
    end = 0.01 * np.arange(1, 4001)
    rate, force = means(dense, end - 0.01, end, (0.3, 0.0, -0.1))
    points, weights = np.polynomial.legendre.leggauss(7)
    inside = (end - 0.01)[:, None] + 0.005 * (1 + points)
    state = dense.at(inside.ravel()).point((0.3, 0.0, -0.1))
    assert rate == pytest.approx(np.einsum("kjc,j->kc", state.rate_ib_b.reshape(*inside.shape, 3), 0.5 * weights), abs=1e-13)
    assert force == pytest.approx(np.einsum("kjc,j->kc", state.specific_force_b.reshape(*inside.shape, 3), 0.5 * weights), abs=2e-11)


def test_equal_ends_are_a_moment() -> None:
    dense = sampled(tumbling(), 0.25, 40.0)
    time = np.array([0.25, 3.1, 20.0])
    rate, force = means(dense, time, time, nodes=1)
    state = dense.at(time)
    assert rate == pytest.approx(state.rate_ib_b, abs=1e-12)
    assert force == pytest.approx(state.specific_force_b, abs=1e-10)


def test_a_quaternion_and_its_negative_are_one_rotation() -> None:
    dense = sampled(tumbling(), 0.25, 40.0).law
    assert isinstance(dense, Dense)
    knots = dense.knots.copy()
    knots[::2, 9:13] *= -1
    time = np.linspace(0.0, 39.9, 400)
    assert Dense(0.0, 0.25, knots)(time).rate_b == pytest.approx(dense(time).rate_b, abs=1e-12)
    assert matrix_from_quaternion(knots[:, 9:13]) == pytest.approx(dense(0.25 * np.arange(161)).rotation_tb, abs=1e-12)


def test_what_is_no_motion_is_refused() -> None:
    with pytest.raises(InputError, match="knots"):
        Dense(0.0, 0.1, np.zeros((1, WIDTH)))
    with pytest.raises(InputError, match="lasts"):
        sampled(tumbling(), 0.25, 40.0).at(41.0)
