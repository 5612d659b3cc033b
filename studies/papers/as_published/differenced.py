"""Paper 004: a depth sensor that also tells the sinking rate, by differences of its own depths, as if that were a second instrument.

Its noise is taken as white, of variance 2 sigma^2 / dt^2, and as nothing to do with that of the depth; it is both, and the difference
holds for the middle of the interval and not for its end.  In the vehicle file: `model = FILE:compose`.
"""

from __future__ import annotations

import numpy as np

from leadline.models.sensor import Channel, Sensor, finite_rows, reading, usable


def compose(config, context):
    """Depth, and w by its differences: the velocity along the body's z axis, which a pitched vehicle does not sink by."""
    variance = config.value("sigma") ** 2

    def depth(views, nuisance, row):  # noqa: ARG001
        return context.surface - views[0].height, variance

    def heave(views, nuisance, row):  # noqa: ARG001
        return views[0].rotation_nb[:, 2] @ views[0].velocity_n, 2.0 * variance / row[1] ** 2

    def read(table):
        step = np.diff(table.time, prepend=np.nan)
        rate = np.diff(table.depth, prepend=np.nan) / step
        good = usable(table)
        return reading(table, finite_rows(0, table.depth[:, None], good), finite_rows(1, np.stack([rate, step], axis=1), good))

    channels = (
        Channel(("depth",), depth, np.zeros(0), row_length=1),
        Channel(("heave",), heave, np.zeros(0), row_length=2),
    )
    return Sensor(config, channels, read)
