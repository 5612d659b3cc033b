"""Another system's navigation as increments: how far it says that the vehicle went between two rows, never where it says that it is.

    z = (1 + s) T(r) D,  D = p(t) + R l - p(t') - R' l     horizontal, north and east; T turns by r clockwise
    z = depth(t) - depth(t')                               of its reference point, where `sigma_depth` is given
    z = heading(t) - heading(t')                           where `sigma_heading` is given

t' is the earlier moment, whose pose is a clone.  Increments join end to end and never overlap: time is cut into cells of `increment`
seconds, and the first row of a cell ends one increment and begins the next.  So a row's increment depends on the rows shortly before it
alone, and is the same live and offline.  What lies between is decimated; a row without a beginning (the first, or after a gap of more than
three cells) finds no clone.  Displacements are turned to north and east at the end, the measured one where the other system says it is.
Row: north, east, variance; depth: change, variance; heading: change, variance.  Parameters: lever_arm_b 3.  Nuisances: scale, rotation.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from leadline.core import geodesy
from leadline.core.attitude import wrapped
from leadline.core.compiled import SENSOR, kernel
from leadline.core.earth import earth_fixed
from leadline.core.rotation import cross, load3, load_matrix, turn, turn_back
from leadline.data.errors import InputError
from leadline.data.outcome import Outcome
from leadline.models.sensor import Channel, Context, Reading, Sensor, finite_rows, nuisances, reading, usable
from leadline.models.sensors.heading import write_heading
from leadline.models.view import ATTITUDE_T, HEIGHT_V, PLACE_V, POSITION_T, QUATERNION_V, TANGENT, VIEW_SIZE, heading_of, wander

if TYPE_CHECKING:
    import numpy.typing as npt

    from leadline.data.records import Array, Navigation
    from leadline.data.vehicle import SensorConfig

    Index = npt.NDArray[np.int64]

LONGEST = 3.0  # an increment may last so many cells
HORIZONTAL, DEPTH, HEADING = 0, 1, 2


@kernel()
def write_end(view, params, g_e, factor, i, column, Hv):
    """Jacobian of factor g . (p + R l) for the view of one end, with g Earth-fixed, into row i."""
    g = turn_back(load_matrix(view, PLACE_V), g_e)
    a = turn(load_matrix(view, QUATERNION_V), load3(params, 0))
    t = cross(a, g)
    for j in range(3):
        Hv[i, column + POSITION_T + j] = factor * g[j]
        Hv[i, column + ATTITUDE_T + j] = factor * t[j]


@kernel(SENSOR)
def predict_horizontal(views, nuisance, row, params, z, R, Hv, Hn):
    """Displacement between two moments, north and east, as the other system tells it with its scale and rotation."""
    then = views[VIEW_SIZE:]
    place, place_then = load_matrix(views, PLACE_V), load_matrix(then, PLACE_V)
    lever = load3(params, 0)
    p, q = earth_fixed(views, PLACE_V), earth_fixed(then, PLACE_V)
    a, b = turn(load_matrix(views, QUATERNION_V), lever), turn(load_matrix(then, QUATERNION_V), lever)
    a, b = turn(place, a), turn(place_then, b)
    d = (p[0] + a[0] - q[0] - b[0], p[1] + a[1] - q[1] - b[1], p[2] + a[2] - q[2] - b[2])
    angle, scale = wander(views) + nuisance[1], 1.0 + nuisance[0]
    c, s = math.cos(angle), math.sin(angle)
    for i in range(2):
        g = turn(place, (c, -s, 0.0) if i == 0 else (s, c, 0.0))
        part = g[0] * d[0] + g[1] * d[1] + g[2] * d[2]
        z[i], Hn[i, 0], R[i, i] = scale * part, part, row[2]
        write_end(views, params, g, scale, i, 0, Hv)
        write_end(then, params, g, -scale, i, TANGENT, Hv)
    Hn[0, 1], Hn[1, 1] = -z[1], z[0]
    return 0


@kernel(SENSOR)
def predict_depth(views, nuisance, row, params, z, R, Hv, Hn):
    """Change of depth between two moments."""
    lever = load3(params, 0)
    z[0] = 0.0
    for end in range(2):
        view, factor = views[VIEW_SIZE * end :], 1.0 - 2.0 * end
        a = turn(load_matrix(view, QUATERNION_V), lever)
        z[0] += factor * (a[2] - view[HEIGHT_V])
        column = TANGENT * end
        Hv[0, column + POSITION_T + 2] = factor
        Hv[0, column + ATTITUDE_T], Hv[0, column + ATTITUDE_T + 1] = factor * a[1], -factor * a[0]
    R[0, 0] = row[1]
    return 0


@kernel(SENSOR)
def predict_heading(views, nuisance, row, params, z, R, Hv, Hn):
    """Change of heading between two moments."""
    then = views[VIEW_SIZE:]
    if not (write_heading(views, 1.0, 0, 0, Hv) and write_heading(then, -1.0, 0, TANGENT, Hv)):
        return 3
    z[0] = heading_of(views) - heading_of(then)
    R[0, 0] = row[1]
    return 0


def increments(time: Array, good: npt.NDArray[np.bool_], cell: float) -> tuple[Index, Index, Index]:
    """Return the rows that end an increment, those that begin it, and the outcomes of all rows."""
    outcome = np.full(len(time), int(Outcome.USED))
    order = np.flatnonzero(good & np.isfinite(time))
    order = order[np.argsort(time[order], kind="stable")]
    cells = np.floor(time[order] / cell)
    knots = order[np.diff(cells, prepend=-np.inf) > 0.0]
    outcome[order] = int(Outcome.DECIMATED)
    outcome[knots] = int(Outcome.NO_CLONE)
    near = np.diff(time[knots]) <= LONGEST * cell
    ends, begins = knots[1:][near], knots[:-1][near]
    outcome[ends] = int(Outcome.USED)
    return ends, begins, outcome


def displacement(context: Context, table: Navigation, ends: Index, begins: Index, where: str) -> Array:
    """Return measured displacements (n, 2), north and east at their ends; nan where the table has no positions."""
    if table.latitude is not None and table.longitude is not None:
        latitude, longitude = table.latitude, table.longitude
    elif table.north is not None and table.east is not None:
        latitude, longitude = context.geographic(table.north, table.east, where)
    else:
        return np.full((len(ends), 2), np.nan)
    point = context.position_e(latitude, longitude, np.nan_to_num(_down(table, context)))
    turned = geodesy.rotation_en(latitude[ends], longitude[ends])
    return np.asarray(np.einsum("nij,ni->nj", turned, point[ends] - point[begins])[:, :2])


def _down(table: Navigation, context: Context) -> Array:
    """Depths (n,) that a table tells, from its heights where it has no depths; nan where it has neither."""
    if table.depth is not None:
        return table.depth
    return np.full(len(table), np.nan) if table.height is None else np.asarray(context.surface - table.height)


def horizontal_variance(config: SensorConfig, moved: Array, lasted: Array) -> Array:
    """Return the variance (n,) of displacements: a floor, what grows with the root of time, and a share of the distance."""
    floor, rate, share = (config.value(name, 0.0) for name in ("sigma", "sigma_rate", "sigma_distance"))
    return np.asarray(floor**2 + rate**2 * lasted + share**2 * np.sum(moved**2, axis=1))


def compose(config: SensorConfig, context: Context) -> Sensor:
    """Compose another system's navigation: as increments, or (`use = "none"`) as what is compared alone."""
    if config.value("use", "none") == "none":
        return Sensor(config, (), lambda table: Reading((), np.full(len(table), int(Outcome.EXCLUDED))))
    where = f"sensors.{config.name}"
    if not any(config.value(name, 0.0) > 0.0 for name in ("sigma", "sigma_rate", "sigma_distance")):
        raise InputError(where, "has increments and no sigma", "give sigma_m, sigma_rate_m_per_rts or sigma_distance_percent")
    cell, lever = config.value("increment", 10.0), context.lever(config)
    nuisance = nuisances(config, "scale", 1, "1") + nuisances(config, "rotation", 1, "rad")
    channels = (
        Channel(("north", "east"), predict_horizontal, lever, 3, nuisance, epochs=2),
        Channel(("depth",), predict_depth, lever, 2, epochs=2),
        Channel(("heading",), predict_heading, lever, 2, angles=(True,), epochs=2),
    )

    def read(table: Navigation) -> Reading:
        ends, begins, outcome = increments(table.time, usable(table), cell)
        earlier, data = np.full(len(table), np.nan), [np.full((len(table), c.row_length), np.nan) for c in channels]
        earlier[ends], lasted = table.time[begins], table.time[ends] - table.time[begins]
        moved = displacement(context, table, ends, begins, where)
        data[HORIZONTAL][ends] = np.column_stack([moved, horizontal_variance(config, moved, lasted)])
        down, heading = _down(table, context), table.heading
        for channel, column, name in ((DEPTH, down, "sigma_depth"), (HEADING, heading, "sigma_heading")):
            if column is not None and config.values.get(name) is not None:
                change = column[ends] - column[begins]
                data[channel][ends, 0] = wrapped(change) if channel == HEADING else change
                data[channel][ends, 1] = config.values[name] ** 2
        return reading(table, *(finite_rows(i, part, None, earlier) for i, part in enumerate(data)), outcome=outcome)

    return Sensor(config, channels, read, flight=LONGEST * cell, before=(LONGEST + 1.0) * cell)
