"""Weights of particles: normalising, effective number, systematic resampling in place."""

from __future__ import annotations

import math

from leadline.core.compiled import kernel


@kernel()
def normalise(logs):
    """Bring logarithms of weights to a sum of one; returns the effective number, zero where no weight is left."""
    best = -math.inf
    for w in logs:
        best = max(best, w)
    if best == -math.inf:
        return 0.0
    total = 0.0
    for w in logs:
        total += math.exp(w - best)
    shift, squares = best + math.log(total), 0.0
    for i in range(len(logs)):
        logs[i] -= shift
        w = math.exp(logs[i])
        squares += w * w
    return 1.0 / squares


@kernel()
def resample(logs, rows, u):
    """Systematic resampling (Kitagawa, 1996) of rows (N, size) with a number u in (0, 1): equal weights after it.

    Rows that survive stay where they are; further copies take the places of those that do not.
    """
    count, size = rows.shape
    above, i = math.exp(logs[0]), 0
    chosen = 0
    # how often each row is taken stands in its weight, as a number of 1 or more, or 0
    first = logs[0]
    for i in range(count):
        if i == 0:
            above = math.exp(first)
        else:
            above += math.exp(logs[i])
        taken = 0
        while chosen < count and (chosen + u) / count < above:
            taken += 1
            chosen += 1
        logs[i] = taken
    logs[count - 1] += count - chosen  # the sum of weights may end below one by rounding
    free = 0
    for i in range(count):
        while logs[i] > 1.0:
            while logs[free] != 0.0:
                free += 1
            for k in range(size):
                rows[free, k] = rows[i, k]
            logs[free] = 1.0
            logs[i] -= 1.0
    logs[:] = -math.log(count)
