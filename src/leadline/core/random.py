"""Random numbers that are a function of a key, a counter and an index, compiled: what was drawn can be drawn again, in any order.

A number is the SplitMix64 scrambling (Steele, Lea and Flood, 2014) of the three; normal ones come in pairs by Box and Muller (1958).
"""

from __future__ import annotations

import math

import numpy as np

from leadline.core.compiled import kernel

STRIDE, FIRST, SECOND = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
S30, S27, S31, S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)


@kernel()
def scrambled(z):
    """Scramble 64 bits."""
    z = (z ^ (z >> S30)) * FIRST
    z = (z ^ (z >> S27)) * SECOND
    return z ^ (z >> S31)


@kernel()
def uniform(key, counter, index):
    """A number in (0, 1)."""
    z = scrambled(np.uint64(key) + STRIDE)
    z = scrambled((z ^ np.uint64(counter)) + STRIDE)
    z = scrambled((z ^ np.uint64(index)) + STRIDE)
    return (np.float64(z >> S11) + 0.5) * (1.0 / 9007199254740992.0)


@kernel()
def normal_pair(key, counter, index):
    """Two independent standard normal numbers."""
    a, b = uniform(key, counter, 2 * index), uniform(key, counter, 2 * index + 1)
    length, angle = math.sqrt(-2.0 * math.log(a)), 2.0 * math.pi * b
    return length * math.cos(angle), length * math.sin(angle)


@kernel()
def fill_normal(key, counter, index, out, n):
    """Fill in n standard normal numbers, those of one index."""
    for k in range(0, n, 2):
        a, b = normal_pair(key, counter, index * 64 + k // 2)
        out[k] = a
        if k + 1 < n:
            out[k + 1] = b
