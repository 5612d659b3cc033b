"""A tuning for a terminal: each sigma in the file and by the logs, with its interval, and what there is to say of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Group

    from leadline.calibrate.tune import Tuned, Tuning

COLUMNS = (("sensor", "left"), ("key", "left"), ("in the file", "right"), ("by the logs", "right"), ("95 %", "right"), ("rows", "right"))


def tuning_text(found: Tuning) -> Group:
    """Return a table with a row per sigma, remarks on each, and what the estimates are worth to the likelihood."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(title=f"sigmas by the innovations of {', '.join(found.logs)}")
    for heading, side in COLUMNS:
        table.add_column(heading, justify=side)  # type: ignore[arg-type]
    for sigma in found.sigmas:
        table.add_row(*_row(sigma))
    remarks = [Text(f"{sigma.sensor} {sigma.key or sigma.part}: {'; '.join(sigma.remarks)}") for sigma in found.sigmas]
    remarks += [Text(f"{sensor}: {words}; its sigma then stands for more than noise") for sensor, words in found.not_white.items()]
    gain = Text(f"These sigmas raise the log-likelihood of the innovations by {found.gain:.4g} against those of the file.")
    return Group(table, *remarks, gain, Text(""))


def _row(sigma: Tuned) -> tuple[str, ...]:
    interval = f"{sigma.low:.4g} to {sigma.high:.4g}" if sigma.determined else ""
    times = "" if sigma.key else "x "
    estimate = f"{times}{sigma.estimate:.4g}" if sigma.determined else ""
    key, value = (sigma.key, f"{sigma.value:.4g}") if sigma.key else (f"column ({sigma.part})", "")
    return sigma.sensor, key, value, estimate, interval, str(sigma.rows)
