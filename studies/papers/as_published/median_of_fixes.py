"""Paper 004: a fix is turned away where it lies far from the median of the last eleven (in the vehicle file: `model = FILE:compose`).

The median of past positions lags behind a vehicle that moves: at 0.8 m/s and a fix each 4 s by 16 m, so that good fixes are turned away.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from leadline.core.geodesy import north_east
from leadline.models.sensors import position_fix

LAST, THRESHOLD = 11, 6.0  # fixes, m


def compose(config, context):
    """Compose positions solved elsewhere behind the median."""
    plain = position_fix.compose(config, context)

    def read(table):
        north, east = north_east(table.latitude, table.longitude, table.latitude[0], table.longitude[0])
        return plain.read(replace(table, valid=near(np.stack([north, east], axis=1)).astype(float)))

    return replace(plain, read=read)


def near(fixes):
    """Return which fixes (n, 2), m, lie within the threshold of the median of the last eleven, themselves among them."""
    medians = [np.median(fixes[max(0, k + 1 - LAST) : k + 1], axis=0) for k in range(len(fixes))]
    return np.linalg.norm(fixes - np.reshape(medians, (-1, 2)), axis=1) <= THRESHOLD
