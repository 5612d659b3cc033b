"""All that can be said of a solution: errors where truth is known, misclosures where it is not, consistency, and what became of rows."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import Enum
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.assess.consistency import Consistency, Verdict, consistency
from leadline.assess.errors import BLOCKS, Errors, Misclosure, errors_of, misclosures, spread
from leadline.assess.happenings import Happening, happenings
from leadline.assess.matching import distance
from leadline.assess.timing import timing
from leadline.assess.usage import counts_of, finite

if TYPE_CHECKING:
    from collections.abc import Mapping

    from leadline.data.outcome import Outcome
    from leadline.data.records import Truth
    from leadline.data.solution import Solution

UNIT_OF = {"velocity": "mps", "tilt": "rad", "heading": "rad"}  # of the statistics of errors; all others are metres


@dataclass(frozen=True)
class Assessment:
    """What was found: `errors` is None without truth; `counts` tells rows by sensor instance and outcome; s and m."""

    duration: float
    distance: float
    counts: Mapping[str, Mapping[Outcome, int]]
    consistency: Consistency
    misclosures: tuple[Misclosure, ...]
    errors: Errors | None = None
    happenings: tuple[Happening, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """The answer to whether the errors are those predicted."""
        return self.consistency.verdict

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as plain types that JSON knows, SI and radians, None for what is not a number."""
        found = {
            "verdict": asdict(self.verdict),
            "verdicts": [asdict(verdict) for verdict in self.consistency.verdicts],
            "duration_s": self.duration,
            "distance_m": self.distance,
            "counts": {sensor: {outcome.name.lower(): n for outcome, n in by.items()} for sensor, by in self.counts.items()},
            "misclosures": [
                asdict(m) | {"horizontal": m.horizontal, "percent_of_distance": m.percent_of_distance} for m in self.misclosures
            ],
            "happenings": [asdict(happening) for happening in self.happenings],
            "errors": None if self.errors is None else _errors_dict(self.errors),
        }
        plain: dict[str, Any] = _plain(found)
        return plain


def _errors_dict(errors: Errors) -> dict[str, Any]:
    means = {block: errors.nees(block) for block in BLOCKS}
    return {
        "count": len(errors),
        "left_out": errors.left_out,
        "distance_m": errors.distance,
        "percent_of_distance": errors.percent_of_distance,
        "statistics": {f"{name}_{UNIT_OF.get(name, 'm')}": asdict(s) for name, s in errors.statistics().items()},
        "drift_m_per_km": asdict(spread(errors.drift())),
        "mean_nees": {block: float(np.nanmean(v)) if np.isfinite(v).any() else None for block, v in means.items()},
    }


def _plain(value: Any) -> Any:
    """Return a value with plain keys, lists, numbers and None for what is not finite."""
    if isinstance(value, dict):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, np.generic):
        return _plain(value.item())
    return None if isinstance(value, float) and not isfinite(value) else value


def assess(solution: Solution, truth: Truth | None = None, *, gap: float = 2.0) -> Assessment:
    """Assess a solution, against truth where there is one: rows of truth more than `gap` s from a row of the solution are left out."""
    solution = finite(solution)
    errors = None if truth is None else errors_of(solution, truth, gap=gap)
    happened = [*happenings(solution), *(timing(errors, solution, truth) if errors is not None and truth is not None else ())]
    return Assessment(
        duration=float(solution.time[-1] - solution.time[0]) if len(solution) else 0.0,
        distance=distance(solution),
        counts=counts_of(solution.innovations),
        consistency=consistency(solution, errors),
        misclosures=misclosures(solution),
        errors=errors,
        happenings=tuple(sorted(happened, key=lambda happening: happening.start)),
    )
