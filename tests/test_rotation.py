"""Single compiled rotations: group laws, and SciPy's Rotation as second implementation."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from leadline.core import attitude
from leadline.core.rotation import cross, exponential, logarithm, matrix, product, store_quaternion, turn, turn_back

component = st.floats(-1.0, 1.0, allow_nan=False)
vectors = st.tuples(component, component, component)
quaternions = st.tuples(component, component, component, component).filter(lambda q: np.linalg.norm(q) > 0.1).map(lambda q: unit(q))
lengths = st.one_of(st.floats(0.0, pi - 1e-6), st.floats(0.0, 1e-6), st.floats(0.12, 0.13))  # 0.126: where the series ends


def unit(q: tuple[float, ...]) -> tuple[float, ...]:
    return tuple((np.asarray(q) / np.linalg.norm(q)).tolist())


def scipy_of(q: tuple[float, ...]) -> Rotation:
    return Rotation.from_quat(np.asarray(q), scalar_first=True)


@given(p=quaternions, q=quaternions, r=quaternions)
def test_group(p: tuple, q: tuple, r: tuple) -> None:
    """Products are associative, and a quaternion times its conjugate is one."""
    assert_allclose(product(product(p, q), r), product(p, product(q, r)), atol=1e-15)
    assert_allclose(product(q, (q[0], -q[1], -q[2], -q[3])), (1.0, 0.0, 0.0, 0.0), atol=1e-15)


@given(p=quaternions, q=quaternions, a=vectors)
def test_matrices_represent(p: tuple, q: tuple, a: tuple) -> None:
    """The matrix of a product is the product of matrices, as SciPy has them; `turn_back` undoes `turn`."""
    assert_allclose(np.reshape(matrix(*p), (3, 3)), scipy_of(p).as_matrix(), atol=1e-15)
    assert_allclose(np.reshape(matrix(*product(p, q)), (3, 3)), (scipy_of(p) * scipy_of(q)).as_matrix(), atol=2e-15)
    c = matrix(*q)
    assert_allclose(turn(c, a), scipy_of(q).apply(a), atol=1e-15)
    assert_allclose(turn_back(c, turn(c, a)), a, atol=2e-15)


@given(v=vectors, length=lengths)
def test_exponential_and_logarithm(v: tuple, length: float) -> None:
    """Both equal SciPy's and each other's inverse, for tiny angles, where the series ends, and up to pi."""
    norm = sqrt(sum(x * x for x in v))
    vector = np.array(v) * (length / norm if norm > 1e-3 else 0.0)
    q = exponential(*vector)
    assert_allclose(np.linalg.norm(q), 1.0, atol=4e-16)
    assert_allclose(np.reshape(matrix(*q), (3, 3)), Rotation.from_rotvec(vector).as_matrix(), atol=1e-15)
    assert_allclose(logarithm(*q), vector, atol=2e-15, rtol=1e-14)
    assert_allclose(logarithm(*(-x for x in q)), vector, atol=2e-15, rtol=1e-14)


@given(v=vectors, s=st.floats(-1.0, 1.0), t=st.floats(-1.0, 1.0))
def test_one_parameter_subgroup(v: tuple, s: float, t: float) -> None:
    """exp(s v) exp(t v) = exp((s + t) v): what lets a measurement split an interval."""
    a, b, c = (exponential(*(k * x for x in v)) for k in (s, t, s + t))
    assert_allclose(product(a, b), c, atol=1e-15)


@given(q=quaternions, v=vectors)
def test_adjoint(q: tuple, v: tuple) -> None:
    """exp(R v) q = q exp(v): an error on the left is the turned error on the right."""
    assert_allclose(product(exponential(*turn(matrix(*q), v)), q), product(q, exponential(*v)), atol=2e-15)


@given(a=vectors, b=vectors)
def test_cross(a: tuple, b: tuple) -> None:
    """As NumPy's."""
    assert_allclose(cross(a, b), np.cross(a, b), atol=1e-16)


@given(q=quaternions, scale=st.floats(0.5, 2.0))
def test_store_brings_back_to_unit_length(q: tuple, scale: float) -> None:
    """What is stored has unit length, and lies in its four places alone."""
    x = np.full(6, 7.0)
    store_quaternion(x, 1, tuple(scale * v for v in q))
    assert_allclose(x, [7.0, *q, 7.0], atol=3e-16)


@given(q=quaternions, v=vectors)
def test_single_equals_many(q: tuple, v: tuple) -> None:
    """core/attitude.py, for many rows, gives the same as the kernels."""
    assert_allclose(attitude.matrix_from_quaternion(q).ravel(), matrix(*q), atol=1e-15)
    assert_allclose(attitude.exponential(v), exponential(*v), atol=1e-15)
    assert_allclose(attitude.product(q, attitude.exponential(v)), product(q, exponential(*v)), atol=1e-15)
