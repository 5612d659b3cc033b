"""The depth of the sea bed on a regular grid, and where a straight line meets it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from leadline.data.errors import InputError
from leadline.sea.casting import cast_fans, cast_rays, floors_of, look_down

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from leadline.data.records import Array

Extent: TypeAlias = tuple[float, float, float, float]  # south, north, west, east (m)


@dataclass(frozen=True, eq=False)
class Chart:
    """Depths of the sea bed at the nodes of a grid; between four nodes the bed is bilinear.

    Node [i, j] lies at north + i step_north, east + j step_east (m, counted along meridian and parallel from an origin: the curvilinear
    coordinates of `core.geodesy.north_east`).  `depth` (rows to the north, columns to the east) is in m below the chart's datum, positive
    down; nan is not known.  It is held read-only.  Raises InputError where the grid is smaller than 2 x 2, where a step or the corner is
    no number, or where no depth is known.
    """

    north: float
    east: float
    step_north: float
    step_east: float
    depth: Array

    def __post_init__(self) -> None:
        """Freeze the depths and check the grid."""
        given = self.depth
        owned = isinstance(given, np.ndarray) and given.dtype == np.float64 and given.flags.c_contiguous and not given.flags.writeable
        depth = given if owned and given.base is None else np.array(given, dtype=np.float64, order="C")
        depth.setflags(write=False)
        object.__setattr__(self, "depth", depth)
        if depth.ndim != 2 or min(depth.shape) < 2:
            raise InputError("chart", f"depth has the shape {depth.shape}", "give at least 2 x 2 nodes")
        corner, steps = (self.north, self.east), (self.step_north, self.step_east)
        if not (np.all(np.isfinite([*corner, *steps])) and min(steps) > 0.0):
            raise InputError("chart", f"starts at {corner} m with steps of {steps} m", "finite numbers, steps above zero")
        if np.any(np.isinf(depth)) or np.all(np.isnan(depth)):
            found = "has an infinite depth" if np.any(np.isinf(depth)) else "knows no depth"
            raise InputError("chart", found, "give depths in m, nan where not known")

    @property
    def extent(self) -> Extent:
        """South, north, west and east edge (m)."""
        rows, columns = self.depth.shape
        return self.north, self.north + (rows - 1) * self.step_north, self.east, self.east + (columns - 1) * self.step_east

    @cached_property
    def shallowest(self) -> float:
        """The least depth that is known (m)."""
        return float(np.nanmin(self.depth))

    @cached_property
    def frame(self) -> Array:
        """Corner and steps (north, east, step_north, step_east), as the kernels take them."""
        return np.array([self.north, self.east, self.step_north, self.step_east], float)

    @cached_property
    def floors(self) -> Array:
        """The shallowest depth of each block of cells (m), as the kernels take them."""
        return np.asarray(floors_of(self.depth, self.shallowest))

    def depth_at(self, north: ArrayLike, east: ArrayLike) -> Array:
        """Return the depth (m) of the bed at places (n,); nan outside the chart and beside a node that is not known."""
        return self._below(north, east)[..., 0]

    def slope_at(self, north: ArrayLike, east: ArrayLike) -> Array:
        """Return d depth / d north and d depth / d east (n, 2); on a border between cells that of the cell to the north and east."""
        return self._below(north, east)[..., 1:]

    def _below(self, north: ArrayLike, east: ArrayLike) -> Array:
        n, e = np.broadcast_arrays(np.asarray(north, float), np.asarray(east, float))
        values = np.empty((n.size, 3))
        look_down(self.depth, self.frame, np.ascontiguousarray(n).ravel(), np.ascontiguousarray(e).ravel(), values)
        return values.reshape(*n.shape, 3)

    def cast(self, points: ArrayLike, directions: ArrayLike, reach: float = np.inf) -> Array:
        """Return the distances (n,) in m from points (north, east, depth) along unit vectors (north, east, down) to the bed.

        (n, 3) both, or one row for all.  The first meeting counts; a start on the bed is 0.  nan where the ray meets nothing within
        `reach` (m), starts below the bed, or is deeper than `shallowest` while it is outside the chart or over a hole in it.
        """
        start, way = np.broadcast_arrays(np.atleast_2d(np.asarray(points, float)), np.atleast_2d(np.asarray(directions, float)))
        if start.ndim != 2 or start.shape[1] != 3:
            raise InputError("chart", f"casts rays from points of the shape {start.shape}", "give points and directions (n, 3)")
        distance = np.empty(len(start))
        start, way = np.ascontiguousarray(start), np.ascontiguousarray(way)
        cast_rays(self.depth, self.floors, self.shallowest, self.frame, start, way, float(reach), distance)
        return distance

    def cast_fans(self, points: ArrayLike, rotations: ArrayLike, beams: ArrayLike, reach: float = np.inf) -> Array:
        """Return the distances (n, m) in m from n points along each of m beams, turned by the point's own rotation.

        Points (n, 3), rotations (n, 3, 3) from the beams' axes to north, east, down, beams (m, 3); otherwise as `cast`.
        """
        start, turn, fan = (np.ascontiguousarray(a, dtype=float) for a in (points, rotations, beams))
        if start.shape[1:] != (3,) or turn.shape != (len(start), 3, 3) or fan.shape[1:] != (3,):
            found = f"casts fans from points {start.shape}, rotations {turn.shape}, beams {fan.shape}"
            raise InputError("chart", found, "give (n, 3), (n, 3, 3) and (m, 3)")
        distance = np.empty((len(start), len(fan)))
        cast_fans(self.depth, self.floors, self.shallowest, self.frame, start, turn, fan, float(reach), distance)
        return distance


def nodes(extent: Extent, step: float) -> tuple[int, int]:
    """Return how many nodes, `step` (m) apart, cover an extent from its south-western corner; raises InputError where none do."""
    south, north, west, east = extent
    if not (np.all(np.isfinite([*extent, step])) and step > 0.0 and north > south and east > west):
        raise InputError("chart", f"extent {extent} m with a step of {step} m", "south < north, west < east, a step above zero")
    rows, columns = (int(np.ceil((high - low) / step - 1e-9)) + 1 for low, high in ((south, north), (west, east)))
    return rows, columns


def plane(depth: float, slope_north: float, slope_east: float, extent: Extent, step: float) -> Chart:
    """Return a plane bed: depth + slope_north north + slope_east east (m), over an `extent` (m) in steps of `step` (m)."""
    rows, columns = nodes(extent, step)
    north, east = extent[0] + step * np.arange(rows), extent[2] + step * np.arange(columns)
    return Chart(extent[0], extent[2], step, step, depth + slope_north * north[:, None] + slope_east * east)
