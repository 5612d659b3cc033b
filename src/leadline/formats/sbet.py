"""SBET, the smoothed best estimate of trajectory of Applanix POSPac: records of 17 little-endian doubles, without a header.

The frame of velocities is the wander frame, level, with x north, y west and z up when the wander angle is zero, as it is here:
    v_north = x cos w - y sin w,  v_east = -x sin w - y cos w,  v_down = -z,  true heading = platform heading - w
(Applanix, POSPac user's manual, standard navigation record.)
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.attitude import conjugate, euler_from_quaternion, logarithm, matrix_from_quaternion, product
from leadline.data.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from leadline.data.records import Array
    from leadline.formats.track import Track

FIELDS = (
    "time", "latitude", "longitude", "altitude", "velocity_x", "velocity_y", "velocity_z", "roll", "pitch", "heading", "wander",
    "acceleration_x", "acceleration_y", "acceleration_z", "rate_x", "rate_y", "rate_z",
)  # fmt: skip
RECORD = np.dtype([(name, "<f8") for name in FIELDS])
GPS_START = datetime(1980, 1, 6, tzinfo=UTC)
WEEK = 7 * 86400.0
# Days from which UTC is one more second behind GPS time (IERS Bulletin C; none is announced after 2017).
LEAP_DAYS = tuple(
    datetime(year, month, 1, tzinfo=UTC)
    for year, month in (
        (1981, 7), (1982, 7), (1983, 7), (1985, 7), (1988, 1), (1990, 1), (1991, 1), (1992, 7), (1993, 7),
        (1994, 7), (1996, 1), (1997, 7), (1999, 1), (2006, 1), (2009, 1), (2012, 7), (2015, 7), (2017, 1),
    )
)  # fmt: skip
TIMES = ("gps", "utc")


def write_sbet(track: Track, file: Path, scale: str = "gps") -> None:
    """Write a track as SBET; times are seconds of the GPS week, or of the UTC week (without leap seconds) with scale "utc".

    They are counted on from the week in which the track begins, beyond its end as well.  Altitude is above the ellipsoid, angles in rad,
    heading in (-pi, pi].  Acceleration over ground and angular rate against the local level are those of the body,
    differentiated from velocity and attitude; zero in a piece of one state.  Raises InputError for a time before GPS time began.
    """
    s = track.states
    roll, pitch, heading = euler_from_quaternion(s.quaternion_nb)
    table = np.zeros(len(track), RECORD)
    table["time"] = week_seconds(s.epoch, s.time, scale)
    table["latitude"], table["longitude"], table["altitude"] = s.latitude, s.longitude, s.height
    table["velocity_x"], table["velocity_y"], table["velocity_z"] = s.velocity_n[:, 0], -s.velocity_n[:, 1], -s.velocity_n[:, 2]
    table["roll"], table["pitch"], table["heading"] = roll, pitch, heading
    for first, end in track.runs():
        rows = slice(first, end)
        acceleration, rate = _differentiated(s.time[rows], s.velocity_n[rows], s.quaternion_nb[rows])
        for i, axis in enumerate("xyz"):
            table[f"acceleration_{axis}"][rows], table[f"rate_{axis}"][rows] = acceleration[:, i], rate[:, i]
    table.tofile(file)


def leap_seconds(moment: datetime) -> int:
    """Return by how many seconds GPS time is ahead of UTC."""
    return sum(moment >= day for day in LEAP_DAYS)


def week_seconds(epoch: datetime, time: Array, scale: str = "gps") -> Array:
    """Return seconds (n,) of the week in which the first of the times (n,) lies: times count from `epoch`, without leap seconds."""
    if scale not in TIMES:
        raise InputError("--time", f"'{scale}'", f"known: {', '.join(TIMES)}")
    start = epoch.astimezone(UTC)
    if start + timedelta(seconds=float(time[0])) < GPS_START:
        raise InputError("epoch", f"{start:%Y-%m-%d} lies before GPS time began", "give the epoch of the log")
    ahead = leap_seconds(start) if scale == "gps" else 0
    since = (start - GPS_START).total_seconds() + ahead
    return np.asarray(since - WEEK * np.floor((since + time[0]) / WEEK) + time)


def _differentiated(time: Array, velocity_n: Array, quaternion_nb: Array) -> tuple[Array, Array]:
    """Return acceleration and angular rate (n, 3) in the body, by central differences; zero where two times are equal."""
    if len(time) < 2:
        return np.zeros((len(time), 3)), np.zeros((len(time), 3))
    before, after = np.maximum(np.arange(len(time)) - 1, 0), np.minimum(np.arange(len(time)) + 1, len(time) - 1)
    step = (time[after] - time[before])[:, None]
    turn = logarithm(product(conjugate(quaternion_nb[before]), quaternion_nb[after]))
    change_b = np.einsum("nji,nj->ni", matrix_from_quaternion(quaternion_nb), velocity_n[after] - velocity_n[before])
    safe = np.where(step > 0.0, step, np.inf)
    return np.asarray(change_b / safe), np.asarray(turn / safe)
