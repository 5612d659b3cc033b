"""A process model of which only the motion is written down: `step` and `view`; transition and Jacobians are central differences.

    Phi e_i = (f(x [+] h e_i) [-] f(x [-] h e_i)) / 2 h        H = Hv (view(x [+] h e_i) [-] view(x [-] h e_i)) / 2 h        Q = density dt
A step costs as many calls of `step` as there are errors, twice; a model that is used every day deserves `push` and `pull` of its own.
The steps are 3 cm of a place, 1e-4 rad of an attitude, 1e-4 of anything else: a rounding of 1e-9 m leaves 1e-7 of a slope.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.core import compiled
from leadline.core.compiled import NOISE, PULL, PUSH, STEP, VIEW, WIDE, call_step, call_view, kernel
from leadline.core.earth import offset
from leadline.core.rotation import load4, logarithm, product
from leadline.models.layout import BLOCK, BLOCK_SIZE, INPUTS, LAYOUT_END, MOTION, NOMINAL, Layout, difference, retract
from leadline.models.process import Process
from leadline.models.view import (
    ATTITUDE_T,
    FORCE_T,
    FORCE_V,
    PLACE_V,
    POSITION_T,
    QUATERNION_V,
    RATE_T,
    RATE_V,
    TANGENT,
    VELOCITY_T,
    VELOCITY_V,
    VIEW_SIZE,
    WATER_T,
    WATER_V,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from leadline.data.records import Array
    from leadline.models.layout import Part
    from leadline.models.process import Pose

# Parameters: two addresses, the head of the layout, by error its density, then those of the model's own.
ADDRESSES = 2
STEP_P, VIEW_P, HEAD_P, DENSITY_P, OWN_P = 0, 1, ADDRESSES, ADDRESSES + LAYOUT_END, ADDRESSES + LAYOUT_END + WIDE
STEPS = (1e-4, 0.03, 1e-4)  # by kind of block
X_M, U_M, READY_M, SPARE_M, PHI_M = 0, 2 * WIDE, 3 * WIDE, 3 * WIDE + 1, 8 * WIDE  # where a step began; its transition


@kernel()
def plan_of(params, plan):
    """The head of the layout of the motion alone."""
    for i in range(LAYOUT_END):
        plan[i] = int(params[HEAD_P + i])


@kernel()
def length_of(plan, i):
    """How far error i is moved for a difference."""
    for b in range(plan[BLOCK - 1]):
        at = BLOCK + BLOCK_SIZE * b
        if plan[at + 2] <= i < plan[at + 2] + plan[at + 3]:
            return STEPS[plan[at]]
    return STEPS[0]


@kernel(STEP)
def step(x, u, dt, params, m):
    """The user's step; where it began is kept for its transition."""
    size = int(params[HEAD_P + NOMINAL])
    m[X_M : X_M + size] = x[:size]
    m[U_M : U_M + INPUTS] = u
    m[READY_M] = 0.0
    call_step(int(params[STEP_P]), x, u, dt, params[OWN_P:], m[SPARE_M:PHI_M])


@kernel()
def linearise(m, dt, params):
    """The transition of the last step, by differences."""
    plan = np.empty(LAYOUT_END, np.int64)
    plan_of(params, plan)
    n, size, own = plan[MOTION], plan[NOMINAL], params[OWN_P:]
    x, u, spare = m[X_M : X_M + size], m[U_M : U_M + INPUTS], m[SPARE_M:PHI_M]
    plus, minus, d, e = np.empty(size), np.empty(size), np.zeros(WIDE), np.zeros(WIDE)
    for i in range(n):
        h = length_of(plan, i)
        plus[:], minus[:] = x, x
        d[:] = 0.0
        d[i] = h
        retract(plan, plus, d, n)
        d[i] = -h
        retract(plan, minus, d, n)
        call_step(int(params[STEP_P]), plus, u, dt, own, spare)
        call_step(int(params[STEP_P]), minus, u, dt, own, spare)
        difference(plan, plus, minus, e)
        for j in range(n):
            m[PHI_M + j * WIDE + i] = e[j] / (2.0 * h)
    m[READY_M] = 1.0


@kernel(PUSH)
def push(m, dt, params, B, A, columns):
    """A = Phi B."""
    if m[READY_M] == 0.0:
        linearise(m, dt, params)
    n = int(params[HEAD_P + MOTION])
    for i in range(n):
        for j in range(columns):
            s = 0.0
            for k in range(n):
                s += m[PHI_M + i * WIDE + k] * B[k * WIDE + j]
            A[i * WIDE + j] = s


@kernel(NOISE)
def noise(m, dt, params, P):
    """P += density dt, error by error."""
    for i in range(int(params[HEAD_P + MOTION])):
        P[i * (WIDE + 1)] += params[DENSITY_P + i] * dt


@kernel(VIEW)
def view(x, u, params, out):
    """The user's view."""
    out[:] = 0.0
    call_view(int(params[VIEW_P]), x, u, params[OWN_P:], out)


@kernel()
def view_difference(a, b, d):
    """D <- a [-] b in the tangent space of views."""
    d[POSITION_T], d[POSITION_T + 1], d[POSITION_T + 2] = offset(a, PLACE_V, b, PLACE_V)
    q = product(load4(a, QUATERNION_V), (b[QUATERNION_V], -b[QUATERNION_V + 1], -b[QUATERNION_V + 2], -b[QUATERNION_V + 3]))
    d[ATTITUDE_T], d[ATTITUDE_T + 1], d[ATTITUDE_T + 2] = logarithm(q[0], q[1], q[2], q[3])
    for i in range(3):
        d[VELOCITY_T + i] = a[VELOCITY_V + i] - b[VELOCITY_V + i]
        d[RATE_T + i] = a[RATE_V + i] - b[RATE_V + i]
        d[FORCE_T + i] = a[FORCE_V + i] - b[FORCE_V + i]
        d[WATER_T + i] = a[WATER_V + i] - b[WATER_V + i]


@kernel(PULL)
def pull(x, u, params, view, Hv, H, rows):
    """Hv times the difference of views."""
    plan = np.empty(LAYOUT_END, np.int64)
    plan_of(params, plan)
    n, size, own = plan[MOTION], plan[NOMINAL], params[OWN_P:]
    plus, minus, a, b = np.empty(size), np.empty(size), np.zeros(VIEW_SIZE), np.zeros(VIEW_SIZE)
    d, e = np.zeros(WIDE), np.zeros(TANGENT)
    for i in range(n):
        h = length_of(plan, i)
        plus[:], minus[:] = x[:size], x[:size]
        d[:] = 0.0
        d[i] = h
        retract(plan, plus, d, n)
        d[i] = -h
        retract(plan, minus, d, n)
        call_view(int(params[VIEW_P]), plus, u, own, a)
        call_view(int(params[VIEW_P]), minus, u, own, b)
        view_difference(a, b, e)
        for r in range(rows):
            s = 0.0
            for k in range(TANGENT):
                s += Hv[r, k] * e[k]
            H[r, i] = s / (2.0 * h)


def numeric(
    name: str,
    parts: tuple[Part, ...],
    step_of: Any,
    view_of: Any,
    density: Array,
    begin: Callable[[Pose], tuple[Array, Array]],
    *,
    defines: frozenset[str],
    parameters: Array | None = None,
    **more: Any,
) -> Process:
    """Return a process model of two kernels: step(x, u, dt, parameters, memory) and view(x, u, parameters, out).

    density (errors,): of the white noise that drives each error, per second.  begin, defines and `more` (feeds, consumes, longest_step,
    reference_b) are those of a Process.  Raises TypeError where a kernel has not the signature STEP or VIEW of core/compiled.py.
    """
    layout = Layout(parts, (), 0, 0)
    spread = np.zeros(WIDE)
    spread[: layout.motion_error] = density
    addresses = [compiled.address(step_of, STEP), compiled.address(view_of, VIEW)]  # below 2^53: exact as a number
    own = np.zeros(0) if parameters is None else np.asarray(parameters, float)
    flat = np.concatenate([np.array(addresses, float), layout.head().astype(float), spread, own])
    return Process(name, parts, flat, step, push, noise, view, pull, defines, begin, volatile=ADDRESSES, held=(step_of, view_of), **more)
