"""KML 2.2 with the track of the extension gx: longitude and latitude in degrees, altitude in m above the sea, time in UTC."""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from leadline.formats.track import Track

HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">
<Document><name>{name}</name><open>1</open>
<description>Altitude is minus the depth below the surface, taken as above sea level; tides are not taken out.</description>
<Style id="track"><LineStyle><color>ff00a5ff</color><width>3</width></LineStyle></Style>
<Schema id="state">
<gx:SimpleArrayField name="depth_m" type="double"><displayName>depth (m)</displayName></gx:SimpleArrayField>
<gx:SimpleArrayField name="sigma_horizontal_m" type="double"><displayName>sigma (m)</displayName></gx:SimpleArrayField>
<gx:SimpleArrayField name="status" type="string"><displayName>status</displayName></gx:SimpleArrayField>
</Schema>
"""
PLACE = """<Placemark><name>{name}</name><description>{text}</description><TimeStamp><when>{when}</when></TimeStamp>
<Point><extrude>1</extrude><altitudeMode>absolute</altitudeMode><coordinates>{lon:.9f},{lat:.9f},{alt:.3f}</coordinates></Point></Placemark>
"""


def write_kml(track: Track, file: Path) -> None:
    """Write a track as KML: a gx:Track for each piece, and placemarks for the start, the end and each change of status.

    The altitude mode is absolute: minus the depth below the surface (m), as KML counts altitude from the sea level.
    """
    with file.open("w", encoding="utf-8") as out:
        out.write(HEAD.format(name=escape(track.name)))
        out.writelines(_tracks(track))
        out.writelines(_places(track))
        out.write("</Document>\n</kml>\n")


def _tracks(track: Track) -> Iterator[str]:
    latitude, longitude = track.degrees
    utc, depth, status, sigma = (column.tolist() for column in (track.utc, track.states.depth, track.status, track.sigma_horizontal))
    places = np.column_stack([longitude, latitude, -track.states.depth]).tolist()
    for number, (first, end) in enumerate(track.runs(), 1):
        rows = range(first, end)
        yield f"<Placemark><name>track {number}</name><styleUrl>#track</styleUrl>\n<gx:Track><altitudeMode>absolute</altitudeMode>\n"
        yield from (f"<when>{utc[k]}</when>\n" for k in rows)
        yield from ("<gx:coord>{:.9f} {:.9f} {:.3f}</gx:coord>\n".format(*places[k]) for k in rows)
        yield '<ExtendedData><SchemaData schemaUrl="#state">\n'
        yield from _array("depth_m", (f"{depth[k]:.3f}" for k in rows))
        yield from _array("sigma_horizontal_m", (f"{sigma[k]:.3f}" for k in rows))
        yield from _array("status", (status[k] for k in rows))
        yield "</SchemaData></ExtendedData>\n</gx:Track></Placemark>\n"


def _array(name: str, values: Iterator[str]) -> Iterator[str]:
    yield f'<gx:SimpleArrayData name="{name}">'
    yield from (f"<gx:value>{value}</gx:value>" for value in values)
    yield "</gx:SimpleArrayData>\n"


def _places(track: Track) -> Iterator[str]:
    latitude, longitude = track.degrees
    utc, status, sigma, depth = track.utc, track.status, track.sigma_horizontal, track.states.depth
    changes = [(first, str(status[first]).replace("_", " ")) for first, _ in track.runs(track.states.status)][1:]
    for row, name in [(0, "start"), *changes, (len(track) - 1, "end")]:
        text = f"{utc[row]}, {str(status[row]).replace('_', ' ')}, depth {depth[row]:.1f} m, sigma {sigma[row]:.2f} m"
        yield PLACE.format(name=name, text=text, when=utc[row], lon=longitude[row], lat=latitude[row], alt=-depth[row])
