"""Process model `inertial` with more of the inertial unit in the state: scale, misalignment, and a second unit that stands in.

A unit measures w_m = w + M w_m + b (and likewise the force), with M the scale errors on its diagonal and misalignments beside it, taken
times what is measured: to first order.  Each entry of M that has a prior is one more state.  The second unit has biases, noise and
entries of its own; it measures at its own place, and its forces are brought to that of the first before they come here (models/imu.py).
The input says which unit it is of; the states of the other stand still but for the wandering of its biases.

All else is models/inertial.py: its kernels are handed the input as corrected, and their rows of the two biases stand for
    bias + sum over entries of (measured value) x (entry)
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import NOISE, PULL, PUSH, STEP, VIEW, WIDE, kernel
from leadline.data.errors import InputError
from leadline.models.inertial import (
    BA_DENSITY,
    BA_RATE,
    BG_DENSITY,
    BG_RATE,
    DEVICE_U,
    FORCE_U,
    PARAMETERS,
    PARTS,
    RATE_U,
    begin_with,
    inertial,
    parameters_of,
)
from leadline.models.inertial import noise as noise_of_one
from leadline.models.inertial import pull as pull_of_one
from leadline.models.inertial import push as push_of_one
from leadline.models.inertial import step as step_of_one
from leadline.models.inertial import view as view_of_one
from leadline.models.layout import INPUTS, Block, Part
from leadline.models.nuisance import AXES

if TYPE_CHECKING:
    from leadline.data.vehicle import SensorConfig, Vehicle
    from leadline.models.process import Process
    from leadline.models.sensor import Context

# Parameters: those of `inertial` for each of two units, then: units, entries, and by entry its unit, row of bias, column of input.
UNITS_P = 2 * PARAMETERS
ENTRIES_P, ENTRY_P, ENTRY_SIZE = UNITS_P + 1, UNITS_P + 2, 3
BIAS_E, BIAS_X = 9, 12  # of the first unit: where the errors and the numbers of its biases are
SECOND_E, SECOND_X = 15, 18  # of the second unit
INPUT_M = 64  # places in the memory: the input as corrected, the device, rows of `B` kept aside
DEVICE_M, KEPT_M = INPUT_M + INPUTS, 128
NAMES = ("gyro_scale", "accel_scale", "gyro_misalignment", "accel_misalignment")


@kernel()
def corrected(x, u, params, out):
    """Input without what entries and the second unit's biases explain, so that subtracting the first unit's biases is right."""
    device, units = u[DEVICE_U], params[UNITS_P]
    out[:INPUTS] = u[:INPUTS]
    first = SECOND_X if units == 1.0 else SECOND_X + 6
    for e in range(int(params[ENTRIES_P])):
        at = ENTRY_P + ENTRY_SIZE * e
        if params[at] == device:
            out[int(params[at + 1])] -= x[first + e] * u[int(params[at + 2])]
    if device == 1.0:
        for i in range(6):
            out[i] += x[BIAS_X + i] - x[SECOND_X + i]


@kernel()
def decay_of(params, unit, i, dt):
    """What is left of a bias of a unit (0 to 2 gyros, 3 to 5 accelerometers) after a step."""
    rate = params[PARAMETERS * unit + (BG_RATE if i < 3 else BA_RATE)]
    return math.exp(-dt * rate) if rate > 0.0 else 1.0


@kernel(STEP)
def step(x, u, dt, params, m):
    """One step with the corrected input of the unit at hand."""
    seen = m[INPUT_M : INPUT_M + INPUTS]
    corrected(x, u, params, seen)
    device = 1 if u[DEVICE_U] == 1.0 else 0
    for i in range(6):
        m[KEPT_M + i] = x[BIAS_X + i]
    step_of_one(x, seen, dt, params[PARAMETERS * device : PARAMETERS * (device + 1)], m)
    for i in range(6):
        seen[i] = u[i]  # for `push`: the entries act on what was measured
        x[BIAS_X + i] = m[KEPT_M + i] * decay_of(params, 0, i, dt)
        if params[UNITS_P] == 2.0:
            x[SECOND_X + i] *= decay_of(params, 1, i, dt)
    m[DEVICE_M] = device


@kernel(PUSH)
def push(m, dt, params, B, A, columns):
    """A = Phi B, with the rows of the biases as that of the errors of what is measured; B is the same after it as before."""
    device, entries = int(m[DEVICE_M]), int(params[ENTRIES_P])
    first = SECOND_E if params[UNITS_P] == 1.0 else SECOND_E + 6
    kept, W = m[KEPT_M:], WIDE
    for i in range(6):
        own = BIAS_E + i if device == 0 else SECOND_E + i
        for j in range(columns):
            kept[i * W + j] = B[(BIAS_E + i) * W + j]
        for j in range(columns):
            B[(BIAS_E + i) * W + j] = B[own * W + j]
    for e in range(entries):
        at = ENTRY_P + ENTRY_SIZE * e
        if params[at] == device:
            row, factor = BIAS_E + int(params[at + 1]), m[INPUT_M + int(params[at + 2])]
            for j in range(columns):
                B[row * W + j] += factor * B[(first + e) * W + j]
    push_of_one(m, dt, params[PARAMETERS * device : PARAMETERS * (device + 1)], B, A, columns)
    for i in range(6):
        decay = decay_of(params, 0, i, dt)
        for j in range(columns):
            B[(BIAS_E + i) * W + j] = kept[i * W + j]
            A[(BIAS_E + i) * W + j] = decay * kept[i * W + j]
    if params[UNITS_P] == 2.0:
        for i in range(6):
            decay = decay_of(params, 1, i, dt)
            for j in range(columns):
                A[(SECOND_E + i) * W + j] = decay * B[(SECOND_E + i) * W + j]
    for e in range(entries):
        for j in range(columns):
            A[(first + e) * W + j] = B[(first + e) * W + j]


@kernel(NOISE)
def noise(m, dt, params, P):
    """P += Q: that of the unit at hand, and the wandering of the other's biases."""
    device = int(m[DEVICE_M])
    own = params[PARAMETERS * device : PARAMETERS * (device + 1)]
    noise_of_one(m, dt, own, P)
    for i in range(3):  # the kernel has driven the first unit's biases by the densities of the unit at hand
        P[(BIAS_E + i) * (WIDE + 1)] += (params[BG_DENSITY] - own[BG_DENSITY]) * dt
        P[(BIAS_E + 3 + i) * (WIDE + 1)] += (params[BA_DENSITY] - own[BA_DENSITY]) * dt
        if params[UNITS_P] == 2.0:
            P[(SECOND_E + i) * (WIDE + 1)] += params[PARAMETERS + BG_DENSITY] * dt
            P[(SECOND_E + 3 + i) * (WIDE + 1)] += params[PARAMETERS + BA_DENSITY] * dt


@kernel(VIEW)
def view(x, u, params, out):
    """The view of `inertial` with the corrected input."""
    seen = np.zeros(INPUTS)
    corrected(x, u, params, seen)
    device = 1 if u[DEVICE_U] == 1.0 else 0
    view_of_one(x, seen, params[PARAMETERS * device : PARAMETERS * (device + 1)], out)


@kernel(PULL)
def pull(x, u, params, view, Hv, H, rows):
    """That of `inertial`; the columns of its biases are those of the unit at hand, and each entry's is its input times them."""
    pull_of_one(x, u, params, view, Hv, H, rows)
    device, units = u[DEVICE_U], params[UNITS_P]
    first = SECOND_E if units == 1.0 else SECOND_E + 6
    for r in range(rows):
        for e in range(int(params[ENTRIES_P])):
            at = ENTRY_P + ENTRY_SIZE * e
            own = H[r, BIAS_E + int(params[at + 1])] if params[at] == device else 0.0
            H[r, first + e] = own * u[int(params[at + 2])]
        if units == 2.0:
            for i in range(6):
                column = H[r, BIAS_E + i]
                H[r, SECOND_E + i] = column if device == 1.0 else 0.0
                if device == 1.0:
                    H[r, BIAS_E + i] = 0.0


def compose(vehicle: Vehicle, context: Context) -> Process:
    """Return the process model `inertial` of a vehicle."""
    standby = vehicle.process.standby
    return inertial_units(vehicle[vehicle.process.imu], None if standby is None else vehicle[standby], context.surface)


def inertial_units(imu: SensorConfig, standby: SensorConfig | None, surface: float) -> Process:
    """Return the process model `inertial` of an IMU, of one that stands in for it, and of those of their errors that have a prior."""
    units = [imu] if standby is None else [imu, standby]
    entries = [entry for number, unit in enumerate(units) for entry in _entries(number, unit)]
    if len(units) == 1 and not entries:
        return inertial(imu, surface)
    own = [parameters_of(unit, surface) for unit in (imu, standby or imu)]
    table = [float(v) for number, _, row, column in entries for v in (number, row, column)]
    parameters = np.array([*own[0], *own[1], len(units), len(entries), *table])
    parts = list(PARTS[:3])
    for unit in units:
        parts += [Part(f"{unit.name}.{p.name}", p.block, p.size, p.unit, p.frame) for p in PARTS[3:]]
    parts += [Part(name, Block.VECTOR, 1, "1", "body") for _, name, _, _ in entries]
    base = inertial(imu, surface)
    values, sigmas = initial_units(imu, standby)
    return replace(
        base, parts=tuple(parts), parameters=parameters, step=step, push=push, noise=noise, view=view, pull=pull,
        begin=partial(begin_with, values=np.array(values), sigmas=np.array(sigmas)),
    )  # fmt: skip


def _entries(number: int, unit: SensorConfig) -> list[tuple[int, str, int, int]]:
    """Unit, name of the state, row (0 to 5: which bias it acts like) and column (of the input that it multiplies), by entry."""
    found = []
    for name in NAMES:
        prior = unit.nuisance.get(name)
        if prior is None:
            continue
        if not prior.estimate:
            raise InputError(f"sensors.{unit.name}.nuisance.{name}", "is not to be estimated", "take it out: it can only be estimated")
        if np.isfinite(prior.tau) or np.isfinite(prior.length) or prior.walk:
            raise InputError(f"sensors.{unit.name}.nuisance.{name}", "wanders", "give value and sigma alone: it is a constant")
        offset = RATE_U if name.startswith("gyro") else FORCE_U
        axes = [(i, i) for i in range(3)] if name.endswith("scale") else [(i, j) for i in range(3) for j in range(3) if i != j]
        for axis, (i, j) in zip(AXES[len(axes)], axes, strict=True):
            found.append((number, f"{unit.name}.{name}{axis}", offset + i, offset + j))
    return found


def initial_units(imu: SensorConfig, standby: SensorConfig | None) -> tuple[list[float], list[float]]:
    """Return values and sigmas of all states beyond position, velocity and attitude, in their order."""
    units = [imu] if standby is None else [imu, standby]
    values, sigmas = [], []
    for unit in units:
        values += [0.0] * 6
        sigmas += [unit.value("gyro_bias")] * 3 + [unit.value("accel_bias")] * 3
    for unit in units:
        for name in NAMES:
            prior = unit.nuisance.get(name)
            if prior is not None and prior.estimate:
                values += list(map(float, prior.value))
                sigmas += list(map(float, prior.sigma))
    return values, sigmas
