"""Log: what a dive left behind, as frozen tables by sensor instance, with the frame of reference that they share."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from leadline.data.errors import InputError, suggestion
from leadline.data.records import Table, Truth

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


@dataclass(frozen=True)
class Origin:
    """The point from which north and east are counted, along meridian and parallel (rad)."""

    latitude: float
    longitude: float


@dataclass(frozen=True)
class Datum:
    """Vertical reference: height of the geoid above the ellipsoid (m), and what the map's depths refer to."""

    geoid_undulation: float = 0.0
    map: str = "surface"  # surface | msl | lat | ellipsoid


@dataclass(frozen=True)
class Initial:
    """What is known of the start; None is "not known".  SI and radians; position geographic or north and east of the origin."""

    time: float | None = None
    latitude: float | None = None
    longitude: float | None = None
    north: float | None = None
    east: float | None = None
    depth: float | None = None
    velocity_north: float | None = None
    velocity_east: float | None = None
    velocity_down: float | None = None
    roll: float | None = None
    pitch: float | None = None
    heading: float | None = None
    sigma_position: float | None = None
    sigma_depth: float | None = None
    sigma_velocity: float | None = None
    sigma_tilt: float | None = None
    sigma_heading: float | None = None


@dataclass(frozen=True)
class Beacon:
    """A fixed acoustic beacon: geographic (rad) or north and east of the origin (m), depth below the surface (m)."""

    latitude: float | None = None
    longitude: float | None = None
    north: float | None = None
    east: float | None = None
    depth: float = 0.0
    sigma_north: float = 0.0
    sigma_east: float = 0.0
    sigma_depth: float = 0.0
    turnaround: float = 0.0


@dataclass(frozen=True)
class Log:
    """Tables by sensor instance in one time scale, counted in seconds from `epoch` (UTC at that moment)."""

    name: str
    tables: Mapping[str, Table]
    epoch: datetime = datetime(2000, 1, 1, tzinfo=UTC)
    origin: Origin | None = None
    vehicle: str | None = None
    clocks: Mapping[str, str] = field(default_factory=dict)  # sensor instance -> device | host | pps
    datum: Datum = field(default_factory=Datum)
    initial: Initial = field(default_factory=Initial)
    beacons: Mapping[str, Beacon] = field(default_factory=dict)
    path: Path | None = None  # the folder it was read from, for messages and for the hash of the inputs

    def __getitem__(self, name: str) -> Table:
        """Return the table of a sensor instance; raises InputError when the log lacks it."""
        if name not in self.tables:
            raise InputError(self.path or self.name, f"has no table '{name}'", suggestion(name, self.tables))
        return self.tables[name]

    @property
    def truth(self) -> Truth | None:
        """The first table of kind truth, or None."""
        return next((t for t in self.tables.values() if isinstance(t, Truth)), None)

    def without(self, *names: str) -> Log:
        """Return the log without the named tables."""
        from dataclasses import replace

        return replace(self, tables={k: v for k, v in self.tables.items() if k not in names})
