"""What a simulated dive was, as a table for a person at a terminal and as JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.report.sheet import Sheet
from leadline.report.tables import Grid

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Group

    from leadline.data.log import Log


def summary(log: Log, vehicle: str, hull: str, seed: int, missing: Sequence[str] = ()) -> dict[str, Any]:
    """Return what was simulated: names, how long, how far and how deep, rows by table; missing: sensors that were not."""
    truth = log.truth
    found: dict[str, Any] = {"mission": log.name, "seed": seed, "vehicle": vehicle, "hull": hull}
    if truth is not None and truth.velocity is not None and truth.depth is not None and len(truth) > 1:
        speed = np.linalg.norm(truth.velocity, axis=1)
        distance = float(np.sum(0.5 * (speed[1:] + speed[:-1]) * np.diff(truth.time)))
        found |= {"duration_s": float(truth.time[-1] - truth.time[0]), "distance_m": distance, "deepest_m": float(np.max(truth.depth))}
    found["not_simulated"] = list(missing)
    return found | {"tables": {name: {"kind": table.kind, "rows": len(table)} for name, table in log.tables.items()}}


def text(log: Log, vehicle: str, hull: str, seed: int, missing: Sequence[str] = ()) -> Group:
    """Return the same for a rich console."""
    from rich.console import Group
    from rich.text import Text

    found = summary(log, vehicle, hull, seed)
    head = f"{log.name}, run {seed}: {hull} with the instruments of {vehicle}"
    if "distance_m" in found:
        head += f"; {found['duration_s']:.0f} s, {found['distance_m']:.0f} m, down to {found['deepest_m']:.1f} m"
    if missing:
        head += f"\nnot simulated, for want of a table [instruments.NAME] in the mission: {', '.join(missing)}"
    rows = [(name, one["kind"], str(one["rows"])) for name, one in found["tables"].items()]
    return Group(Text(head), Sheet(Grid(("table", "kind", "rows>"), rows, "Log")))
