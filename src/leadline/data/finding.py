"""What an inspection finds, and the columns that it looks at."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from leadline.data.records import UNITS, expand

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from leadline.data.records import Array, Table


@dataclass(frozen=True)
class Finding:
    """One thing that a person should know: `severity` is problem (mend it), suspicion (look at it) or note; no `table`: the whole log."""

    severity: str
    table: str
    sentence: str
    numbers: Mapping[str, float] = field(default_factory=dict)  # keys end in their unit


def numeric_columns(table: Table) -> Iterator[tuple[str, str, Array]]:
    """Yield field, file column and values, in the unit that the column's name ends in, of all columns that hold numbers."""
    for item in table.columns():
        value, pattern = getattr(table, item.name), item.metadata["pattern"]
        if value is None or item.metadata["text"]:
            continue
        parts = value.T if value.ndim > 1 else [value]
        names = [pattern.replace("{i}", str(i + 1)) for i in range(len(parts))] if "{i}" in pattern else expand(pattern, [])
        for name, part in zip(names, parts, strict=True):
            factor = UNITS.get(name.rpartition("_")[2], 1.0)
            yield item.name, name, part if factor == 1.0 else part / factor
    yield from ((name, name, np.asarray(v, float)) for name, v in table.extra.items() if v.dtype.kind == "f")


def value_fields(table: Table) -> list[str]:
    """Return the fields that hold what the sensor measures: those that the kind requires, or one of its alternatives."""
    needed = {item.name for item in table.columns() if item.metadata["required"] and not item.metadata["text"]}
    needed |= {name for group in table.alternatives for name in group}
    return [name for name in sorted(needed - {"time"}) if getattr(table, name) is not None]
