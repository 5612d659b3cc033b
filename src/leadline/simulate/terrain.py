"""How far the sea bed is from an instrument: a level one, or that of a chart."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.simulate.multibeam import on_chart
from leadline.simulate.surroundings import Surrounding

if TYPE_CHECKING:
    from leadline.data.records import Array
    from leadline.sea.terrain import Chart
    from leadline.simulate.trajectory import Kinematics


def vertical_distance(seabed: Surrounding | Chart, state: Kinematics) -> Array:
    """Return how far (m) the bed lies straight below a point (times,); nan where a chart knows none."""
    if isinstance(seabed, Surrounding):
        return seabed.at(state.time)[:, 0] - state.depth
    return seabed.depth_at(*state.north_east) - state.chart_depth


def distances_down(seabed: Surrounding | Chart, state: Kinematics, rotation_bs: Array, beams: Array, reach: float) -> tuple[Array, Array]:
    """Return slant distances (times, n) in m along unit beams (n, 3), sensor axes, to the bed, and the cosines of beams and vertical.

    nan where a beam meets no bed, on a chart within `reach` (m).  The depth of a level bed counts from the surface of the moment, that of a
    chart from the mean one.
    """
    rotation_ns = state.rotation_nb @ rotation_bs
    down = np.asarray(rotation_ns[:, 2, :] @ beams.T)
    if isinstance(seabed, Surrounding):
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(down > 0.0, vertical_distance(seabed, state)[:, None] / down, np.nan), down
    points, moved = on_chart(state)
    return seabed.cast_fans(points, moved @ rotation_ns, beams, reach), down
