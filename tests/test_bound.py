"""The Cramér-Rao recursion against closed forms."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from leadline.assess.bound import bound, informed
from leadline.data.errors import InputError


def test_static_parameter_falls_as_one_over_n():
    steps = [(1.0, 0.0, [([[1.0]], [[4.0]])])] * 50
    variance = bound([[1e12]], [(np.eye(1) * a, np.eye(1) * q, m) for a, q, m in steps])[:, 0, 0]
    np.testing.assert_allclose(variance, 4.0 / np.arange(1, 51), rtol=1e-9)


def test_random_walk_with_position_reaches_its_steady_state():
    q, r = 0.3, 2.0
    variance = bound([[9.0]], [(np.eye(1), [[q]], [([[1.0]], [[r]])])] * 200)[-1, 0, 0]
    predicted = 0.5 * (q + np.sqrt(q * q + 4 * q * r))  # p = q + p r / (p + r), before the measurement
    assert variance == pytest.approx(predicted - q, rel=1e-12)


def test_constant_velocity_reaches_the_riccati_solution():
    dt, q, r = 0.5, 0.2, 1.5
    a, h = np.array([[1.0, dt], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    noise = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    last = bound(np.diag([100.0, 10.0]), [(a, noise, [(h, [[r]])])] * 500)[-1]
    predicted = solve_discrete_are(a.T, h.T, noise, [[r]])
    expected = np.linalg.inv(np.linalg.inv(predicted) + h.T @ h / r)
    np.testing.assert_allclose(last, expected, rtol=1e-9)


def test_constant_velocity_without_noise_is_a_straight_line_fit():
    dt, n, r = 0.5, 30, 0.7
    a = np.array([[1.0, dt], [0.0, 1.0]])
    last = bound(1e10 * np.eye(2), [(a, np.zeros((2, 2)), [([1.0, 0.0], r)])] * n)[-1]
    design = np.stack([np.ones(n), dt * np.arange(1 - n, 1)], axis=1)
    np.testing.assert_allclose(last, r * np.linalg.inv(design.T @ design), rtol=1e-6)


def test_several_sensors_at_once_are_worth_their_information():
    rng = np.random.default_rng(1)
    p = np.cov(rng.standard_normal((3, 20)))
    h1, h2 = rng.standard_normal((2, 3)), rng.standard_normal((1, 3))
    r1, r2 = np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([[0.3]])
    expected = np.linalg.inv(np.linalg.inv(p) + h1.T @ np.linalg.inv(r1) @ h1 + h2.T @ h2 / 0.3)
    np.testing.assert_allclose(informed(p, [(h1, r1), (h2, r2)]), expected, rtol=1e-10)


def test_known_start_and_no_measurement():
    q = np.diag([0.0, 0.04])
    steps = [(np.array([[1.0, 1.0], [0.0, 1.0]]), q, [])] * 3
    reached = bound(np.zeros((2, 2)), steps)
    np.testing.assert_allclose(reached[0], q, atol=1e-15)
    np.testing.assert_allclose(reached[2], [[0.04 * 5, 0.04 * 3], [0.04 * 3, 0.04 * 3]], atol=1e-14)


def test_units_of_very_different_size_keep_their_figures():
    start = np.diag([1e4, 1e-12])
    got = bound(start, [(np.eye(2), np.zeros((2, 2)), [([[1.0, 0.0]], [[1.0]]), ([[0.0, 1.0]], [[1e-12]])])])[0]
    np.testing.assert_allclose(np.diagonal(got), [1e4 / 10001, 0.5e-12], rtol=1e-9)


def test_no_steps_and_unknown_start():
    assert bound(np.eye(2), []).shape == (0, 2, 2)
    with pytest.raises(InputError, match="large variance"):
        bound([[np.inf]], [])
