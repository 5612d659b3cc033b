"""An error budget for a terminal: the largest sources of each kind of error, in shares of its variance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from rich.console import Group

    from leadline.estimate.budget import Budget, Share

FACTORS = {"tilt": (180.0 / np.pi, "deg"), "heading": (180.0 / np.pi, "deg"), "horizontal velocity": (1.0, "m/s")}
# What drives and begins the states of the process model, in words.
WORDS = {
    ("attitude", "drive"): "gyro noise",
    ("velocity", "drive"): "accelerometer noise",
    ("gyro_bias", "drive"): "gyro bias, as it wanders",
    ("accel_bias", "drive"): "accelerometer bias, as it wanders",
    ("gyro_bias", "start"): "gyro bias, from turn-on",
    ("accel_bias", "start"): "accelerometer bias, from turn-on",
}
MOST = 12


def source_of(share: Share) -> str:
    """Return a source in words."""
    if (share.source, share.kind) in WORDS:
        return WORDS[share.source, share.kind]
    ends = {"start": "at the start", "drive": "as it wanders", "noise": "noise", "constant": "taken for known"}
    return f"{share.source}, {ends[share.kind]}"


def text(found: Budget) -> Group:
    """Return a table: sources by row, kinds of error by column, and what the sigmas are."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(title=f"Error budget at {found.time:.6g} s: share of the variance, %")
    table.add_column("source")
    for group in found.total:
        table.add_column(group, justify="right")
    largest = sorted(found.shares, key=lambda s: -max(s.variance[g] / found.total[g] for g in found.total))
    for share in largest[:MOST]:
        table.add_row(source_of(share), *(_percent(share.variance[g] / found.total[g]) for g in found.total))
    rest = largest[MOST:]
    if rest:
        table.add_row(f"{len(rest)} more", *(_percent(sum(s.variance[g] for s in rest) / found.total[g]) for g in found.total))
    lines = [
        f"{name}: {_sigma(name, found.stated[name])} as the filter states, {_sigma(name, found.total[name])} in all" for name in found.total
    ]
    return Group(table, Text("\n".join(lines)))


def _percent(value: float) -> str:
    return f"{100.0 * value:.1f}"


def _sigma(group: str, variance: float) -> str:
    factor, unit = FACTORS.get(group, (1.0, "m"))
    return f"sigma {factor * np.sqrt(max(variance, 0.0)):.3g} {unit}"
