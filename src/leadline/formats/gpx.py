"""GPX 1.1: one track; latitude and longitude in degrees, elevation in m, time in UTC."""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

    from leadline.formats.track import Track

HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<gpx version="1.1" creator="Leadline" xmlns="http://www.topografix.com/GPX/1/1" xmlns:leadline="urn:leadline:track"
 xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
 xsi:schemaLocation="http://www.topografix.com/GPX/1/1 http://www.topografix.com/GPX/1/1/gpx.xsd">
<metadata><time>{start}</time></metadata>
<trk><name>{name}</name><desc>Elevation is minus the depth below the surface.</desc>
"""
POINT = (
    '<trkpt lat="{:.9f}" lon="{:.9f}"><ele>{:.3f}</ele><time>{}</time><type>{}</type><extensions>'
    "<leadline:sigma_horizontal_m>{:.3f}</leadline:sigma_horizontal_m><leadline:sigma_depth_m>{:.3f}</leadline:sigma_depth_m>"
    "</extensions></trkpt>\n"
)


def write_gpx(track: Track, file: Path) -> None:
    """Write a track as GPX 1.1: elevation is minus the depth below the surface (m), `type` is the status; sigmas are extensions.

    A new segment begins where lost states were left out, and where the track crosses the date line.
    """
    latitude, longitude = track.degrees
    longitude = np.where(longitude >= 180.0, longitude - 360.0, longitude)  # GPX takes -180, and not 180
    utc = track.utc.tolist()
    columns = (latitude, longitude, -track.states.depth, track.utc, track.status, track.sigma_horizontal, track.states.sigma[:, 2])
    rows = list(zip(*(column.tolist() for column in columns), strict=True))
    crossings = np.cumsum(np.abs(np.diff(longitude, prepend=longitude[0])) > 180.0)
    with file.open("w", encoding="utf-8") as out:
        out.write(HEAD.format(start=utc[0], name=escape(track.name)))
        for first, end in track.runs(crossings):
            out.write("<trkseg>\n")
            out.writelines(POINT.format(*row) for row in rows[first:end])
            out.write("</trkseg>\n")
        out.write("</trk>\n</gpx>\n")
