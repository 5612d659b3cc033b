"""GeoJSON (RFC 7946): lines by status, and a point for each state; longitude and latitude in degrees, height above the ellipsoid in m."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core.attitude import euler_from_quaternion

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from leadline.data.records import Array
    from leadline.formats.track import Track


def write_geojson(track: Track, file: Path) -> None:
    """Write a track as a FeatureCollection: a line for each stretch of one status, and a point with sigmas for each state.

    A line that crosses the date line is cut there into a MultiLineString (RFC 7946, 3.1.9).  `coordinates` have the height above
    the ellipsoid (RFC 7946, 3.1.1); the depth below the surface is a property.
    """
    features = [*_lines(track), *_points(track)]
    head = json.dumps({"type": "FeatureCollection", "name": track.name})[:-1]
    with file.open("w", encoding="utf-8") as out:
        out.write(head + ', "features": [\n')
        out.write(",\n".join(json.dumps(feature, allow_nan=False) for feature in features))
        out.write("\n]}\n")


def _lines(track: Track) -> Iterator[dict[str, Any]]:
    latitude, longitude = track.degrees
    points = np.stack([longitude, latitude, track.states.height], axis=1)
    utc, status, sigma = track.utc, track.status, track.sigma_horizontal
    for first, end in track.runs(track.states.status):
        joined = end < len(track) and track.piece[end] == track.piece[first]  # to the first point of the next stretch
        parts = cut_at_date_line(points[first : end + joined])
        if not parts:
            continue
        lines = [[_rounded(point) for point in part.tolist()] for part in parts]
        geometry = {"type": "LineString", "coordinates": lines[0]} if len(lines) == 1 else {"type": "MultiLineString", "coordinates": lines}
        told: dict[str, Any] = {"kind": "track", "status": str(status[first]), "start": str(utc[first]), "end": str(utc[end - 1])}
        told |= {"states": end - first, "sigma_horizontal_m": _number(np.max(sigma[first:end]))}
        yield {"type": "Feature", "geometry": geometry, "properties": told}


def _points(track: Track) -> Iterator[dict[str, Any]]:
    s, (latitude, longitude) = track.states, track.degrees
    roll, pitch, heading = (np.degrees(angle) for angle in euler_from_quaternion(s.quaternion_nb))
    numbers = {
        "time_s": s.time,
        "depth_m": s.depth,
        "heading_deg": heading % 360.0,
        "pitch_deg": pitch,
        "roll_deg": roll,
        "speed_mps": np.hypot(s.velocity_n[:, 0], s.velocity_n[:, 1]),
        "sigma_north_m": s.sigma[:, 0],
        "sigma_east_m": s.sigma[:, 1],
        "sigma_depth_m": s.sigma[:, 2],
        "sigma_horizontal_m": track.sigma_horizontal,
    }
    columns = [[_number(value) for value in values.tolist()] for values in numbers.values()]
    places = np.stack([longitude, latitude, s.height], axis=1).tolist()
    for place, utc, status, *values in zip(places, track.utc.tolist(), track.status.tolist(), *columns, strict=True):
        told = {"kind": "state", "time": utc, "status": status, **dict(zip(numbers, values, strict=True))}
        yield {"type": "Feature", "geometry": {"type": "Point", "coordinates": _rounded(place)}, "properties": told}


def cut_at_date_line(points: Array) -> list[Array]:
    """Cut a line (n, 3) of longitude, latitude (degrees) and height (m) where it crosses 180 degrees; parts of one point are left out."""
    step = np.diff(points[:, 0])
    parts, start = [], points[:1]
    first = 0
    for k in np.flatnonzero(np.abs(step) > 180.0).tolist():
        edge = 180.0 if step[k] < 0.0 else -180.0  # on the near side
        there = points[k + 1, 0] + 2 * edge  # the next point, as seen from this side
        share = (edge - points[k, 0]) / (there - points[k, 0])
        between = points[k] + share * (points[k + 1] - points[k])
        near, far = np.array([edge, *between[1:]]), np.array([-edge, *between[1:]])
        parts.append(np.concatenate([start, points[first + 1 : k + 1], near[None]]))
        start, first = far[None], k
    parts.append(np.concatenate([start, points[first + 1 :]]))
    distinct = [part[np.append(True, (np.diff(part, axis=0) != 0.0).any(axis=1))] for part in parts]
    return [part for part in distinct if len(part) > 1]


def _rounded(point: list[float]) -> list[float]:
    """Write degrees to 0.1 mm, and metres to 1 mm."""
    return [round(point[0], 9), round(point[1], 9), round(point[2], 3)]


def _number(value: float) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None
