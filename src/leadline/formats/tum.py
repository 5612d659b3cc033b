"""TUM trajectory: a line `timestamp tx ty tz qx qy qz qw` for each state, for tools that compare trajectories."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

    from leadline.formats.track import Track


def write_tum(track: Track, file: Path) -> None:
    """Write a track as TUM text: Unix time (s, UTC); north, east and depth of the origin (m); body to north-east-down.

    North and east are those of the solution, along meridian and parallel; the quaternion is Hamilton, written x, y, z, w.
    """
    s = track.states
    seconds = s.epoch.timestamp() + s.time
    table = np.column_stack([seconds, s.north, s.east, s.depth, s.quaternion_nb[:, [1, 2, 3, 0]]])
    header = "timestamp tx ty tz qx qy qz qw (Unix time; north, east, down in m; body forward-right-down to north-east-down)"
    np.savetxt(file, table, fmt=["%.6f", *["%.4f"] * 3, *["%.9f"] * 4], header=header, encoding="utf-8")
