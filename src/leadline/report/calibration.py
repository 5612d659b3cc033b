"""A calibration for a terminal: by log and together, with a traffic light."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from rich.console import Group

    from leadline.calibrate.dvl import DvlCalibration

# Heading of each quantity, and the factor from SI to what is printed.
COLUMNS = (("scale %", 100.0), *((f"mounting {a} deg", 180.0 / np.pi) for a in "xyz"), *((f"lever {a} m", 1.0) for a in "xyz"))


def dvl_text(found: DvlCalibration) -> Group:
    """Return a table with a row per log and one for all, and the light with its sentence."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(title=f"{found.sensor}: by log, and together")
    table.add_column("log")
    for name, _ in COLUMNS:
        table.add_column(name, justify="right")
    rows = [*zip(found.logs, found.by_log, found.sigma_by_log, strict=True), ("together", found.value, found.sigma)]
    for name, value, sigma in rows:
        table.add_row(name, *(f"{f * v:.3f} ± {f * s:.3f}" for (_, f), v, s in zip(COLUMNS, value, sigma, strict=True)))
    light = Text.assemble((f"{found.light.value}: ", f"bold {found.light.value}"), found.sentence)
    return Group(table, light, Text(""))
