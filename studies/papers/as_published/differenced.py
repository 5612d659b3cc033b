"""Paper 004: a depth sensor that also tells the velocity along the body's z axis, by differences of its own depths.

Its noise is taken as white, of variance 2 sigma^2 / dt^2, and as nothing to do with that of the depth; it is both, and the difference
holds for the middle of the interval and not for its end; above all a pitched vehicle sinks by its speed ahead, u sin(pitch), too.
In the vehicle file: `model = FILE:compose`.  `ahead` is the Doppler log of the thesis, of which only u and v are taken.
"""

from __future__ import annotations

import numpy as np

from leadline.models.sensor import Channel, Sensor, finite_rows, reading, usable


def compose(config, context):
    """Return depth, and w by its differences."""
    variance = config.value("sigma") ** 2

    def depth(views, nuisance, row):
        return context.surface - views[0].height, variance

    def heave(views, nuisance, row):
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


def ahead(config, context):
    """Return velocities over ground along the body's x and y axes."""
    noise = config.value("sigma") ** 2 * np.eye(2)

    def predict(views, nuisance, row):
        return views[0].rotation_nb[:, :2].T @ views[0].velocity_n, noise

    def read(table):
        return reading(table, finite_rows(0, table.velocity[:, :2], usable(table)))

    return Sensor(config, (Channel(("x", "y"), predict, np.zeros(0), row_length=2),), read)
