"""Suspicions: units, axes and clocks that a log's own numbers speak against.

Each test asks for a clear case, so that a good log brings none; a test that lacks what it needs is silent.
Angles are in radians here; a sentence for a person says them in file units (`UNITS`).
"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core.attitude import conjugate, logarithm, product, quaternion_from_euler, wrapped
from leadline.core.geodesy import SEMI_MAJOR_AXIS, north_east
from leadline.data.finding import Finding, numeric_columns, value_fields
from leadline.data.records import UNITS, Attitude, Depth, Dvl, Gnss, Heading, Imu, PositionFix, Speed, Truth
from leadline.data.rows import ascending, complete

if TYPE_CHECKING:
    from collections.abc import Iterator

    from leadline.data.log import Log
    from leadline.data.records import Array, Table

GRAVITY = 9.8
SENTINELS = (-32768.0, 32767.0, -32.768, 32.767, -327.68, 327.67, -999.0, 999.0, -9999.0, 9999.0, -99999.0, 99999.0)
SLOW_IMU, SLOW = 0.5, 50.0  # s between rows: of an IMU, and of a DVL, a heading or an attitude where there is no IMU
SAME_ANGLE, SAME_PLACE, TOGETHER = 1e-4, 0.01, 1e-3  # rad, m, s: two instruments differ by more at the same moments
FAR = 1e5  # m: farther from the origin than any dive


def suspicions(log: Log) -> Iterator[Finding]:
    """Yield what looks like a wrong unit, axis, sign or clock, or like one instrument recorded twice."""
    for name, table in log.tables.items():
        for test in (_time, _sentinels, _gravity, _rate, _depth, _velocity, _heading_unit):
            yield from test(name, table)
        yield from _place(name, table, log)
        yield from _course(name, table, log)
    yield from _time_scales(log)
    yield from _slow(log)
    yield from _same_hardware(log)
    yield from _same_heading(log)
    yield from _same_place(log)


def _finite(values: Any) -> Array:
    array = np.asarray(values, float)
    good = complete(array)
    return array if good.all() else array[good]


def _time(name: str, table: Table) -> Iterator[Finding]:
    """Times since 1970 in seconds, milliseconds or nanoseconds instead of seconds since the log's epoch."""
    time = _finite(table.time)
    middle = float(np.median(time)) if len(time) else 0.0
    for unit, factor in (("seconds", 1.0), ("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)):
        if 6e8 < middle / factor < 4e9:
            sentence = f"time_s looks like {unit} since 1970; count seconds from the log's epoch"
            yield Finding("problem", name, sentence, {"median_s": middle})


def _time_scales(log: Log) -> Iterator[Finding]:
    """Tables whose times do not meet those of the others, or run a thousand times as fast."""
    spans = {n: (t.min(), t.max()) for n, table in log.tables.items() if len(t := _finite(table.time)) > 2 and t.max() > t.min()}
    for name, (first, last) in spans.items():
        others = [span for other, span in spans.items() if other != name]
        lengths = [b - a for a, b in others]
        if len(others) < 2:
            continue
        ratio = (last - first) / float(np.median(lengths))
        if 300.0 < ratio < 3000.0:
            yield Finding(
                "problem", name, f"lasts {ratio:.0f} times as long as the other tables: is time_s in milliseconds?", {"ratio": ratio}
            )
        elif all(first > b or last < a for a, b in others):
            sentence = f"its times, {first:.6g} to {last:.6g} s, meet those of no other table"
            yield Finding("problem", name, sentence, {"first_s": first, "last_s": last})


def _slow(log: Log) -> Iterator[Finding]:
    """Rates a thousandth of what such instruments have: all times in milliseconds at once, which no other table gives away."""
    times = {name: t for name, table in log.tables.items() if len(t := ascending(_finite(table.time))) >= 10 and t[-1] < 6e8}
    steps = {name: float(np.median(np.diff(t))) for name, t in times.items()}
    imus = [name for name in steps if isinstance(log.tables[name], Imu)]
    prompt = imus or [name for name in steps if isinstance(log.tables[name], Dvl | Heading | Attitude)]
    slow = [name for name in prompt if steps[name] > (SLOW_IMU if imus else SLOW)]
    usual = np.median([np.ptp(t) for t in times.values()]) if times else 0.0
    if len(slow) < len(prompt) or any(np.ptp(times[name]) > 300.0 * usual for name in slow):
        return  # one table alone is compared with the others
    for name in slow:
        sentence = f"has a row only every {steps[name]:.4g} s, too slow for its kind: is time_s in milliseconds?"
        yield Finding("problem", name, sentence, {"interval_s": steps[name]})


def _sentinels(name: str, table: Table) -> Iterator[Finding]:
    """Numbers that stand for "no number", far from all others."""
    for field, column, values in numeric_columns(table):
        if field in ("time", "received", "device_time", "sequence"):
            continue
        low, high = (f(values, initial=0.0, where=np.isfinite(values)) for f in (np.min, np.max))
        for sentinel in (s for s in SENTINELS if low * (1.0 + 1e-9) <= s <= high * (1.0 + 1e-9)):
            found = np.isclose(values, sentinel, rtol=1e-9, atol=0.0)
            rest = _finite(values[~found]) if found.any() else np.full(1, np.inf)
            if not len(rest) or abs(sentinel) > 3.0 * np.abs(rest[np.isin(rest, SENTINELS, invert=True)]).max(initial=0.0):
                sentence = f"{column} is {sentinel:g} in {found.sum()} rows: does it mean 'not measured'? leave the cell empty"
                yield Finding("suspicion", name, sentence, {"value": sentinel, "rows": int(found.sum())})


def _specific_force(table: Imu) -> Array | None:
    if table.accel is not None:
        return _finite(table.accel)
    if table.delta_velocity is None or table.interval is None:
        return None
    return _finite(table.delta_velocity / np.where(table.interval > 0.0, table.interval, np.nan)[:, None])


def _gravity(name: str, table: Table) -> Iterator[Finding]:
    """Specific force must be 9.8 m/s^2 long on average, upward: on -z for a sensor forward-right-down."""
    force = _specific_force(table) if isinstance(table, Imu) else None
    if force is None or not len(force):
        return
    size = float(np.median(np.linalg.norm(force, axis=1)))
    mean = np.mean(force, axis=0)
    numbers = {"median_mps2": size} | {f"mean_{axis}_mps2": float(m) for axis, m in zip("xyz", mean, strict=True)}
    if abs(size / GRAVITY - 1.0) > 0.1:
        units = {"g": 1.0, "milli-g": 1e3, "cm/s^2": 980.0, "ft/s^2": 32.2}
        near = min(units, key=lambda unit: abs(size / units[unit] - 1.0))
        hint = ": is gravity taken out? specific force contains it" if size < 3.0 else ""
        hint = f": is it in {near}?" if abs(size / units[near] - 1.0) < 0.03 else hint
        yield Finding("problem", name, f"acceleration is {size:.4g} m/s^2 at the median, not 9.8{hint}", numbers)
        return
    axis = int(np.argmax(np.abs(mean)))
    if abs(mean[axis]) < 0.8 * GRAVITY or (axis == 2 and mean[2] < 0.0):
        return
    sign = "+" if mean[axis] > 0.0 else "-"
    sentence = (
        f"specific force averages {mean[axis]:+.2f} m/s^2 on {'xyz'[axis]}: its {sign}{'xyz'[axis]} axis points up, or the sign is wrong; "
    )
    yield Finding(
        "suspicion", name, sentence + "a sensor forward-right-down shows -9.8 on z (the mounting in the vehicle file can say it)", numbers
    )


def _rate(name: str, table: Table) -> Iterator[Finding]:
    """Angular rates in degrees per second read as radians: gravity turns 57 times less than they say, or no vehicle has them."""
    if not isinstance(table, Imu) or table.gyro is None or table.accel is None:
        return
    rows = _finite(np.column_stack([table.time, table.accel, table.gyro]))
    if len(rows) < 10:
        return
    high = float(np.quantile(np.linalg.norm(rows[:, 4:], axis=1), 0.95))
    ratio, likeness = _turning(rows)
    if high > 15.0 or (30.0 < ratio < 100.0 and likeness > 0.7):
        sentence = f"angular rate is {high:.3g} rad/s at the 95th percentile: is it in degrees per second?"
        yield Finding("suspicion", name, sentence, {"high_radps": high, "gyro_to_gravity_ratio": ratio})
    elif likeness < -0.7:
        sentence = "gravity turns against the angular rate: the signs or axes of acceleration and rate do not fit together"
        yield Finding("suspicion", name, sentence, {"correlation": likeness})


def _turning(rows: Array) -> tuple[float, float]:
    """Return how many times as far the gyro turns as the direction of gravity does over half a second, and their correlation.

    Rows of time, specific force and rate.  Across the direction u of specific force: u x u' = -(rate - u (u . rate)) T.
    """
    interval = float(np.median(np.diff(rows[:, 0])))
    size = max(1, round(0.5 / interval)) if interval > 0.0 else 1
    blocks = np.mean(rows[: len(rows) // size * size].reshape(-1, size, rows.shape[1]), axis=1)
    force = blocks[:, 1:4] / np.maximum(np.linalg.norm(blocks[:, 1:4], axis=1, keepdims=True), 1e-9)
    seen = -np.cross(force[:-1], force[1:])
    turn = 0.5 * (blocks[:-1, 4:] + blocks[1:, 4:]) * np.diff(blocks[:, 0])[:, None]
    turn = turn - force[:-1] * np.sum(force[:-1] * turn, axis=1, keepdims=True)
    both, one, two = np.sum(seen * turn), np.sum(turn**2), np.sum(seen**2)
    return (float(one / both), float(both / np.sqrt(one * two))) if both != 0.0 else (np.inf, 0.0)


def _depth(name: str, table: Table) -> Iterator[Finding]:
    if isinstance(table, Depth) and len(depth := _finite(table.depth)) and np.median(depth) < -0.5:
        middle = float(np.median(depth))
        yield Finding("problem", name, f"depth is {middle:.4g} m at the median: it is positive down", {"median_m": middle})


def _velocity(name: str, table: Table) -> Iterator[Finding]:
    """Speeds that no underwater vehicle has, as of mm/s or cm/s."""
    values = table.velocity if isinstance(table, Dvl) else table.speed[:, None] if isinstance(table, Speed) else None
    if isinstance(table, Dvl) and values is None:
        values = table.beam
    if values is None or not len(good := _finite(values)):
        return
    size = float(np.median(np.linalg.norm(good, axis=1)))
    if size > 15.0:
        unit = "mm/s" if size > 200.0 else "cm/s"
        yield Finding("problem", name, f"speed is {size:.4g} m/s at the median: is it in {unit}?", {"median_mps": size})


def _heading_unit(name: str, table: Table) -> Iterator[Finding]:
    """Headings that turn by 2 pi where they should turn by 360: radians in a column of degrees."""
    heading = getattr(table, "heading", None)
    if heading is None or len(values := _finite(heading) / UNITS["deg"]) < 3:
        return
    if values.min() < -3.2 or values.max() > 6.3:
        return
    wraps = np.abs(np.abs(np.diff(values)) - 2.0 * np.pi) < 0.3
    if wraps.any() or (values.min() >= 0.0 and np.ptp(values) > 5.0):
        sentence = f"heading stays within {values.min():.3g} to {values.max():.3g} degrees and wraps there: is it in radians?"
        yield Finding("problem", name, sentence, {"wraps": int(wraps.sum())})


def _place(name: str, table: Table, log: Log) -> Iterator[Finding]:
    """Positions at (0, 0), swapped, in radians, or in another part of the world than the log's origin."""
    if getattr(table, "latitude", None) is None or getattr(table, "longitude", None) is None:
        return
    place = _finite(np.stack([table.latitude, table.longitude], axis=1))  # type: ignore[attr-defined]
    zero = np.all(np.abs(place) < 1e-9, axis=1)
    if zero.any():
        sentence = f"{zero.sum()} positions are (0, 0): does it mean 'no fix'? leave the cells empty"
        yield Finding("suspicion", name, sentence, {"rows": int(zero.sum())})
    if not len(place := place[~zero]):
        return
    latitude, longitude = np.median(place, axis=0)
    if np.abs(place[:, 0]).max() > np.pi / 2:
        yield Finding("problem", name, "latitude lies beyond the pole: are latitude and longitude swapped?", {"latitude_rad": latitude})
        return
    reference = _reference(log)
    if reference is None:
        if np.all(np.abs(place) < np.array([np.pi / 2, np.pi]) * UNITS["deg"]):
            yield Finding("suspicion", name, "all positions lie near (0, 0): are they in radians?", {"latitude_rad": latitude})
        return
    away = _distance(latitude, longitude, *reference)
    if away > FAR:
        yield Finding("problem", name, _elsewhere(latitude, longitude, away, reference), {"distance_m": away})


def _elsewhere(latitude: float, longitude: float, away: float, reference: tuple[float, float]) -> str:
    sentence = f"positions lie {away / 1e3:.0f} km from the log's origin"
    if _distance(longitude, latitude, *reference) < FAR:
        return sentence + ": are latitude and longitude swapped?"
    if _distance(latitude / UNITS["deg"], longitude / UNITS["deg"], *reference) < FAR:
        return sentence + ": are they in radians?"
    return sentence


def _reference(log: Log) -> tuple[float, float] | None:
    if log.origin is not None:
        return log.origin.latitude, log.origin.longitude
    if log.initial.latitude is not None and log.initial.longitude is not None:
        return log.initial.latitude, log.initial.longitude
    return None


def _distance(latitude: float, longitude: float, other_latitude: float, other_longitude: float) -> float:
    """Return the great-circle distance (m), to a percent, on a sphere."""
    half = np.sin((latitude - other_latitude) / 2) ** 2
    half += np.cos(latitude) * np.cos(other_latitude) * np.sin((longitude - other_longitude) / 2) ** 2
    return float(2.0 * SEMI_MAJOR_AXIS * np.arcsin(np.sqrt(np.clip(half, 0.0, 1.0))))


def _course(name: str, table: Table, log: Log) -> Iterator[Finding]:
    """A heading that is turned, reversed or mirrored against the course that the position fixes show."""
    if not isinstance(table, Heading | Attitude) or table.heading is None:
        return
    for other, fixes in log.tables.items():
        if not isinstance(fixes, Gnss | PositionFix):
            continue
        time, course = _legs(fixes)
        heading = _heading_at(table, time)
        good = np.isfinite(heading)
        if good.sum() >= 20:
            yield from _compare_course(name, other, course[good], heading[good])


def _legs(fixes: Gnss | PositionFix) -> tuple[Array, Array]:
    """Return the middle times and the courses (rad) of the legs between fixes that lie far enough apart to have one."""
    if fixes.latitude is not None and fixes.longitude is not None:
        known = _finite(np.stack([fixes.latitude, fixes.longitude], axis=1))
        start = np.median(known, axis=0) if len(known) else np.zeros(2)
        north, east = north_east(fixes.latitude, fixes.longitude, float(start[0]), float(start[1]))
    else:
        north, east = np.asarray(fixes.north, float), np.asarray(fixes.east, float)
    rows = _finite(np.stack([fixes.time, north, east], axis=1))
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    sigma = float(np.nanmedian(fixes.sigma)) if fixes.sigma is not None and np.isfinite(fixes.sigma).any() else 1.0
    kept = [0] if len(rows) else []
    for row in range(1, len(rows)):
        if np.hypot(*(rows[row, 1:] - rows[kept[-1], 1:])) > 5.0 * max(sigma, 0.5):
            kept.append(row)
    leg = np.diff(rows[kept], axis=0)
    prompt = leg[:, 0] < 30.0
    return (rows[kept][:-1, 0] + leg[:, 0] / 2)[prompt], np.arctan2(leg[:, 2], leg[:, 1])[prompt]


def _heading_at(table: Heading | Attitude, time: Array) -> Array:
    """Return the heading (rad) at given times, between rows at most 2 s apart; nan elsewhere."""
    rows = _finite(np.stack([table.time, np.asarray(table.heading)], axis=1))
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    if len(rows) < 2:
        return np.full(len(time), np.nan)
    after = np.clip(np.searchsorted(rows[:, 0], time), 1, len(rows) - 1)
    covered = (rows[after, 0] - rows[after - 1, 0] < 2.0) & (time >= rows[0, 0]) & (time <= rows[-1, 0])
    return np.where(covered, np.interp(time, rows[:, 0], np.unwrap(rows[:, 1])), np.nan)


def _compare_course(name: str, other: str, course: Array, heading: Array) -> Iterator[Finding]:
    same, mirrored = np.mean(np.exp(1j * (course - heading))), np.mean(np.exp(1j * (course + heading)))
    radian = np.mean(np.exp(1j * (course - heading / UNITS["deg"])))
    spread = abs(np.mean(np.exp(1j * course)))  # near 1: the course hardly turns, and nothing but an offset can be seen
    offset = float(wrapped(np.angle(same)))
    numbers = {"offset_rad": offset, "agreement": float(abs(same)), "legs": len(course)}
    if abs(same) > 0.8 and abs(offset) > np.pi / 12:
        words = "reversed against" if abs(offset) > 0.9 * np.pi else f"turned by {offset / UNITS['deg']:+.0f} degrees from"
        yield Finding("suspicion", name, f"heading is {words} the course of '{other}' over {len(course)} legs", numbers)
    elif abs(same) < 0.6 and abs(mirrored) > max(0.8, abs(same) + 0.3) and spread < 0.8:
        yield Finding("suspicion", name, f"heading runs against the course of '{other}': is it counter-clockwise?", numbers)
    elif abs(radian) > 0.8 and np.abs(heading).max() < 2.0 * np.pi * UNITS["deg"] and spread < 0.8:
        yield Finding("problem", name, f"heading follows the course of '{other}' only when read as radians: is it in radians?", numbers)
    elif abs(same) < 0.3 and spread < 0.8:
        yield Finding("suspicion", name, f"heading does not follow the course of '{other}'", numbers)


def _same_hardware(log: Log) -> Iterator[Finding]:
    """One instrument under two names: equal IMU tables, or attitudes whose rates repeat the noise of a gyro."""
    imus = {name: table for name, table in log.tables.items() if isinstance(table, Imu)}
    for (one, a), (two, b) in combinations(imus.items(), 2):
        if all(_equal(getattr(a, name), getattr(b, name)) for name in value_fields(a)):
            yield Finding("suspicion", two, f"equals '{one}' in all values: one instrument recorded twice counts once", {})
    for name, attitude in log.tables.items():
        for other, imu in imus.items():
            likeness = _likeness(attitude, imu) if isinstance(attitude, Attitude) else 0.0
            if likeness > 0.98:
                sentence = f"its rates repeat the noise of the gyro '{other}' (correlation {likeness:.4f}): one instrument, not two"
                yield Finding("suspicion", name, sentence, {"correlation": likeness})


def _same_heading(log: Log) -> Iterator[Finding]:
    """One heading under two names, which a constant turn between them (declination, mounting) does not hide."""
    tables = {n: t for n, t in log.tables.items() if isinstance(t, Heading | Attitude) and t.heading is not None}
    for (one, a), (two, b) in combinations(tables.items(), 2):
        first, second = _at_same_times(a, [a.heading], b, [b.heading])
        turn = wrapped((first - second - first[:1] + second[:1])[:, 0])
        if len(first) >= 20 and np.ptp(first) > SAME_ANGLE and np.mean(np.abs(turn - np.median(turn)) < SAME_ANGLE) > 0.9:
            name, other = (two, one) if isinstance(b, Heading) else (one, two)
            yield Finding("suspicion", name, f"its heading repeats that of '{other}': one instrument, not two", {"rows": len(first)})


def _same_place(log: Log) -> Iterator[Finding]:
    """Fixes that are the reference as well: truth that a solution has already used."""
    for name, table in log.tables.items():
        for other, fixes in log.tables.items():
            if not isinstance(table, Truth) or not isinstance(fixes, Gnss | PositionFix):
                continue
            first, second = _at_same_times(table, [table.latitude, table.longitude], fixes, [fixes.latitude, fixes.longitude])
            if len(first) >= 10 and np.mean(np.abs(first - second).max(axis=1) < SAME_PLACE / SEMI_MAJOR_AXIS) > 0.5:
                sentence = f"repeats the positions of '{other}': it tells no errors of a solution that used them"
                yield Finding("note", name, sentence, {"rows": len(first)})


def _at_same_times(a: Table, of_a: list[Array | None], b: Table, of_b: list[Array | None]) -> tuple[Array, Array]:
    """Return the values (n, d) of two tables at the moments that both have, to a millisecond; none where one lacks a column."""
    if any(values is None for values in (*of_a, *of_b)) or not len(a) or not len(b):
        return np.empty((0, 1)), np.empty((0, 1))
    one, two = (_finite(np.column_stack([t.time, *columns])) for t, columns in ((a, of_a), (b, of_b)))  # type: ignore[list-item]
    if not len(two):
        return two[:, 1:], two[:, 1:]
    two = two[np.argsort(two[:, 0], kind="stable")]
    after = np.clip(np.searchsorted(two[:, 0], one[:, 0] - TOGETHER), 0, len(two) - 1)
    met = np.abs(two[after, 0] - one[:, 0]) <= TOGETHER
    return one[met, 1:], two[after[met], 1:]


def _equal(a: Array | None, b: Array | None) -> bool:
    return a is not None and b is not None and len(a) > 2 and a.shape == b.shape and bool(np.array_equal(a, b, equal_nan=True))


def _likeness(attitude: Attitude, imu: Imu) -> float:
    """Return the correlation of what is fastest in two angular rates: the second differences of their lengths.

    Motion is common to two instruments, noise is not; the length of the rate does not depend on how they are mounted.
    """
    time, rate = _rates(attitude)
    if imu.gyro is None or len(time) < 200 or np.median(np.diff(time)) > 0.25:
        return 0.0
    rows = _finite(np.column_stack([imu.time, imu.gyro]))
    rows = rows[np.unique(rows[:, 0], return_index=True)[1]]
    turned = np.vstack([np.zeros(3), np.cumsum(rows[1:, 1:] * np.diff(rows[:, 0])[:, None], axis=0)])
    angle = np.column_stack([np.interp(time, rows[:, 0], column) for column in turned.T])
    mean = np.linalg.norm(np.diff(angle, axis=0) / np.diff(time)[:, None], axis=1)
    a, b = np.diff(mean, 2), np.diff(np.linalg.norm(rate, axis=1), 2)
    return float(np.corrcoef(a, b)[0, 1]) if np.std(a) > 0.0 and np.std(b) > 0.0 else 0.0


def _rates(attitude: Attitude) -> tuple[Array, Array]:
    """Return the times (n,) of an attitude's rows, and the mean angular rates (n - 1, 3) between them."""
    quaternion = attitude.quaternion
    if quaternion is None:
        quaternion = quaternion_from_euler(attitude.roll, attitude.pitch, attitude.heading)  # type: ignore[arg-type]
    rows = _finite(np.column_stack([attitude.time, quaternion]))
    rows = rows[np.unique(rows[:, 0], return_index=True)[1]]
    turn = logarithm(product(conjugate(rows[:-1, 1:]), rows[1:, 1:]))
    return rows[:, 0], turn / np.diff(rows[:, 0])[:, None]
