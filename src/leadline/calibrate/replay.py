"""A stretch of a log run again: the motion of a hull from a start, driven by the thruster speeds and fin angles that were recorded.

The equation of motion is that of the simulator (simulate/dynamics.py); only what drives thrusters and fins is not integrated but read.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import kernel
from leadline.simulate.dynamics import ACTUATORS, derivative

if TYPE_CHECKING:
    from leadline.data.hull import Hull
    from leadline.data.records import Array


@kernel()
def slope(x, y, share, k, dx, inputs, row, hull, site, water):
    """Rate of change at x + share k, with the inputs of a moment."""
    for i in range(ACTUATORS):
        y[i] = x[i] + share * k[i]
    for i in range(len(row)):
        y[ACTUATORS + i] = row[i]
    derivative(0.0, y, inputs, hull, site, water, dx)


@kernel()
def run_again(starts, inputs, step, hull, site, water, work, states):
    """Fill states (stretches, nodes, 13) from the starts (stretches, 13) by Runge-Kutta; inputs (stretches, nodes, actuators) are straight
    between nodes, so that the water is asked at time 0 alone: it must not change.
    """
    n = ACTUATORS + inputs.shape[2]
    k1, k2, k3, k4 = work[:n], work[n : 2 * n], work[2 * n : 3 * n], work[3 * n : 4 * n]
    x, y, mid = work[4 * n : 5 * n], work[5 * n : 6 * n], work[6 * n : 7 * n - ACTUATORS]
    for s in range(len(starts)):
        for i in range(ACTUATORS):
            x[i] = starts[s, i]
            k1[i] = 0.0
        for node in range(states.shape[1]):
            for i in range(ACTUATORS):
                states[s, node, i] = x[i]
            if node + 1 == states.shape[1]:
                break
            first, last = inputs[s, node], inputs[s, node + 1]
            for i in range(len(mid)):
                mid[i] = 0.5 * (first[i] + last[i])
            slope(x, y, 0.0, k1, k1, mid, first, hull, site, water)
            slope(x, y, 0.5 * step, k1, k2, mid, mid, hull, site, water)
            slope(x, y, 0.5 * step, k2, k3, mid, mid, hull, site, water)
            slope(x, y, step, k3, k4, mid, last, hull, site, water)
            for i in range(ACTUATORS):
                x[i] += step / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])
            size = (x[3] * x[3] + x[4] * x[4] + x[5] * x[5] + x[6] * x[6]) ** -0.5
            for i in range(3, 7):
                x[i] *= size


def replay(starts: Array, inputs: Array, step: float, hull: Hull, site: Array, water: Array) -> Array:
    """Return states (stretches, nodes, 13): position_t, quaternion_tb and nu of each stretch, `step` seconds apart.

    starts (stretches, 13); inputs (stretches, nodes, actuators): rps and rad as `hull.actuators` names them.  water: a steady one.
    """
    states = np.empty((len(starts), inputs.shape[1], ACTUATORS))
    arrays = [np.ascontiguousarray(a, dtype=float) for a in (starts, inputs)]
    work = np.zeros(8 * hull.states)
    run_again(*arrays, float(step), hull.parameters, np.ascontiguousarray(site), np.ascontiguousarray(water), work, states)
    return states
