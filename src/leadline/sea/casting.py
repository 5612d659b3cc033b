"""Where rays meet the sea bed: bilinear patches between the nodes of a grid, compiled.

A ray is u + s du, v + s dv, z + s dz, with u and v counted in cells north and east from node [0, 0], z the depth (m) and s the distance
(m).  The bed of a cell is z00 + a da + b db + a b dab with a, b in [0, 1], so that along a ray the depth below the bed is a quadratic in
s, solved exactly.  Cells are walked from border to border (Amanatides and Woo, 1987); above them lie blocks of SIZE x SIZE cells that know
their shallowest depth, so that a ray far above the bed passes a block at the cost of a cell.

A ray above the shallowest known depth of the chart meets nothing, over holes and outside the chart alike; below it what is not known
ends the ray.  So the answer does not depend on how cells are gathered into blocks.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import kernel

if TYPE_CHECKING:
    from leadline.data.records import Array

SIZE = 16  # cells along the side of a block: 8 to 32 differ by a tenth, none at all costs two to four times as much
NOTHING = -1.0  # no meeting in this part of the ray
ROUNDING = 1e-9  # m: a start that is not deeper below the bed than this lies on it
CORNER = 1e-10  # m: a cell in which a ray is shorter is left to its neighbours, so that a hole is not met at its corner
TINY = 1e-100  # cells per m: a ray that moves less does not move


@kernel()
def block_floors(depth, shallowest, floors):
    """Write the shallowest depth of each block, of all nodes around its cells; that of the whole chart where a node is not known."""
    rows, columns = depth.shape
    for p in range(floors.shape[0]):
        for q in range(floors.shape[1]):
            least = math.inf
            for i in range(p * SIZE, min((p + 1) * SIZE, rows - 1) + 1):
                for j in range(q * SIZE, min((q + 1) * SIZE, columns - 1) + 1):
                    value = depth[i, j]
                    least = min(least, shallowest if math.isnan(value) else value)
            floors[p, q] = least


@kernel()
def bed(depth, u, v):
    """Depth of the bed at (u, v), and its derivatives by u and v; nan outside and beside what is not known."""
    rows, columns = depth.shape
    if not (0.0 <= u <= rows - 1 and 0.0 <= v <= columns - 1):
        return math.nan, math.nan, math.nan
    i, j = min(int(u), rows - 2), min(int(v), columns - 2)
    a, b = u - i, v - j
    origin = depth[i, j]
    along, across = depth[i + 1, j] - origin, depth[i, j + 1] - origin
    twist = depth[i + 1, j + 1] - origin - along - across
    return origin + a * along + b * across + a * b * twist, along + b * twist, across + a * twist


@kernel()
def first_root(c0, c1, c2, t):
    """The first zero in [0, t] of c0 + c1 x + c2 x^2 with c0 < 0; NOTHING where there is none.

    Either it is not negative at t, or it has a summit before t that is not.  Of the two forms of the root the one without cancellation.
    """
    square = c1 * c1 - 4.0 * c2 * c0
    if c0 + t * (c1 + t * c2) < 0.0 and (c1 <= 0.0 or c1 >= -2.0 * c2 * t or square < 0.0):
        return NOTHING
    width = math.sqrt(max(square, 0.0))
    return min(-2.0 * c0 / (c1 + width) if c1 > 0.0 else (width - c1) / (2.0 * c2), t)


@kernel()
def through_cells(depth, low_i, high_i, low_j, high_j, u, v, z, du, dv, dz, per_u, per_v, s, end):
    """Distance of the first meeting between s and `end` within a block of cells; NOTHING, or nan where the bed is not known."""
    i = min(max(int(u + s * du), low_i), high_i)
    j = min(max(int(v + s * dv), low_j), high_j)
    ahead_u, ahead_v = 1 if du > 0.0 else 0, 1 if dv > 0.0 else 0
    while True:
        leave_u = (i + ahead_u - u) * per_u if du != 0.0 else math.inf
        leave_v = (j + ahead_v - v) * per_v if dv != 0.0 else math.inf
        leave = min(leave_u, leave_v, end)
        if leave - s > CORNER or leave >= end:
            a, b = u + s * du - i, v + s * dv - j
            origin = depth[i, j]
            along, across = depth[i + 1, j] - origin, depth[i, j + 1] - origin
            twist = depth[i + 1, j + 1] - origin - along - across
            c0 = z + s * dz - (origin + a * along + b * (across + a * twist))
            if math.isnan(c0):
                return math.nan
            if c0 >= 0.0:
                return s if s > CORNER or c0 <= ROUNDING else math.nan
            c1 = dz - (along + b * twist) * du - (across + a * twist) * dv
            found = first_root(c0, c1, -twist * du * dv, max(leave - s, 0.0))
            if found != NOTHING:
                return s + found
        if leave >= end:
            return NOTHING
        s = max(leave, s)
        if leave_u <= leave_v:
            i += 2 * ahead_u - 1
            if i < low_i or i > high_i:
                return NOTHING
        else:
            j += 2 * ahead_v - 1
            if j < low_j or j > high_j:
                return NOTHING


@kernel()
def span(depth, shallowest, u, v, z, du, dv, dz, reach):
    """From where to where a ray can meet the bed: below the shallowest depth, inside the chart, within reach; (1, 0) where it cannot."""
    start, end = 0.0, reach
    if dz > 0.0:
        start = max(start, (shallowest - z) / dz)
    elif z < shallowest:
        return 1.0, 0.0
    elif dz < 0.0:
        end = min(end, (shallowest - z) / dz)
    for axis in range(2):
        x, dx, last = (u, du, depth.shape[0] - 1.0) if axis == 0 else (v, dv, depth.shape[1] - 1.0)
        if dx == 0.0:
            if x < 0.0 or x > last:
                return 1.0, 0.0
        else:
            p, q = -x / dx, (last - x) / dx
            if min(p, q) > start:
                return 1.0, 0.0
            end = min(end, max(p, q))
    return start, end


@kernel()
def first_meeting(depth, floors, shallowest, u, v, z, du, dv, dz, reach):
    """Distance along a ray to where it first meets the bed; nan where it does not (see the head of this file)."""
    if not abs(u + v + z + du + dv + dz) < math.inf:
        return math.nan
    du, dv = du if abs(du) > TINY else 0.0, dv if abs(dv) > TINY else 0.0
    if du == 0.0 and dv == 0.0:
        gap = bed(depth, u, v)[0] - z
        below = max(gap, 0.0) / dz if dz > 0.0 and gap >= -ROUNDING else math.nan
        return below if below <= reach else math.nan
    s, end = span(depth, shallowest, u, v, z, du, dv, dz, reach)
    if s > end:
        return math.nan
    per_u, per_v = 1.0 / du if du != 0.0 else 0.0, 1.0 / dv if dv != 0.0 else 0.0
    per_z = 1.0 / dz if dz > 0.0 else 0.0
    last_i, last_j = depth.shape[0] - 2, depth.shape[1] - 2
    p = min(max(int(u + s * du), 0), last_i) // SIZE
    q = min(max(int(v + s * dv), 0), last_j) // SIZE
    while True:
        leave_u = ((p + 1 if du > 0.0 else p) * SIZE - u) * per_u if du != 0.0 else math.inf
        leave_v = ((q + 1 if dv > 0.0 else q) * SIZE - v) * per_v if dv != 0.0 else math.inf
        leave = min(leave_u, leave_v, end)
        floor = floors[p, q]
        start = max(s, (floor - z) * per_z) if dz > 0.0 else s
        wide = leave - s > CORNER or leave >= end
        if wide and start <= leave and (dz > 0.0 or z + s * dz >= floor):
            high_i, high_j = min((p + 1) * SIZE - 1, last_i), min((q + 1) * SIZE - 1, last_j)
            found = through_cells(depth, p * SIZE, high_i, q * SIZE, high_j, u, v, z, du, dv, dz, per_u, per_v, start, leave)
            if found != NOTHING:
                return found
        if leave >= end:
            return math.nan
        s = max(leave, s)
        if leave_u <= leave_v:
            p += 1 if du > 0.0 else -1
        else:
            q += 1 if dv > 0.0 else -1
        if p < 0 or p >= floors.shape[0] or q < 0 or q >= floors.shape[1]:
            return math.nan


@kernel()
def cast_rays(depth, floors, shallowest, frame, points, directions, reach, distance):
    """Distances (n,) of rays from `points` along `directions` (n, 3); `frame` is north, east of node [0, 0] and the steps (m)."""
    for k in range(len(points)):
        distance[k] = first_meeting(
            depth, floors, shallowest, (points[k, 0] - frame[0]) / frame[2], (points[k, 1] - frame[1]) / frame[3], points[k, 2],
            directions[k, 0] / frame[2], directions[k, 1] / frame[3], directions[k, 2], reach,
        )  # fmt: skip


@kernel()
def cast_fans(depth, floors, shallowest, frame, points, rotations, beams, reach, distance):
    """Distances (n, m) from n `points` along the m `beams` turned by each of n `rotations` (3 x 3)."""
    for k in range(len(points)):
        u, v, z = (points[k, 0] - frame[0]) / frame[2], (points[k, 1] - frame[1]) / frame[3], points[k, 2]
        r = rotations[k]
        for m in range(len(beams)):
            x, y, d = beams[m, 0], beams[m, 1], beams[m, 2]
            du = (r[0, 0] * x + r[0, 1] * y + r[0, 2] * d) / frame[2]
            dv = (r[1, 0] * x + r[1, 1] * y + r[1, 2] * d) / frame[3]
            dz = r[2, 0] * x + r[2, 1] * y + r[2, 2] * d
            distance[k, m] = first_meeting(depth, floors, shallowest, u, v, z, du, dv, dz, reach)


@kernel()
def look_down(depth, frame, north, east, values):
    """Write depth and slope d depth / d north, d depth / d east (n, 3) at places (n,)."""
    for k in range(len(north)):
        z, by_u, by_v = bed(depth, (north[k] - frame[0]) / frame[2], (east[k] - frame[1]) / frame[3])
        values[k, 0], values[k, 1], values[k, 2] = z, by_u / frame[2], by_v / frame[3]


def floors_of(depth: Array, shallowest: float) -> Array:
    """Return the shallowest depth (m) of each block of a grid (rows, columns)."""
    floors = np.empty([-(-(n - 1) // SIZE) for n in depth.shape])
    block_floors(depth, shallowest, floors)
    return floors
