"""Solutions of one log side by side: what each makes wrong, what it says of that, and how far it lies from the first."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import nan
from typing import TYPE_CHECKING

import numpy as np

from leadline.assess.errors import BLOCKS, Errors, Spread, errors_of, spread
from leadline.assess.usage import finite
from leadline.core.attitude import euler_from_quaternion
from leadline.data.records import Truth

if TYPE_CHECKING:
    from collections.abc import Mapping

    from leadline.assess.assessment import Assessment
    from leadline.data.solution import Solution

SIGMAS = 3.0
SIZES = {"horizontal": "horizontal", "depth": "down", "velocity": "velocity", "heading": "heading"}  # as told -> as `Errors` names them
COLUMNS = {"horizontal": (0, 1), "depth": (2,), "velocity": (3, 4, 5), "heading": (8,)}


@dataclass(frozen=True)
class Score:
    """What is told of one solution, over horizontal, depth, velocity and heading (m, m, m/s, rad).

    errors: against truth, empty without one.  inside: share of moments within 3 sigma.  nees: mean per degree of freedom, by block; 1 is
    to be expected.  misclosure: of the fixes after a gap (m).  apart: from the reference solution, empty for itself.
    """

    errors: Mapping[str, Spread] = field(default_factory=dict)
    inside: Mapping[str, float] = field(default_factory=dict)
    nees: Mapping[str, float] = field(default_factory=dict)
    misclosure: Spread | None = None
    apart: Mapping[str, Spread] = field(default_factory=dict)


def score_of(solution: Solution, assessment: Assessment, reference: Solution | None = None) -> Score:
    """Return the score of a solution, with how far it lies from a reference where one is given."""
    errors = assessment.errors
    known = errors is not None and len(errors) > 0
    missed = spread(np.array([m.horizontal for m in assessment.misclosures])) if assessment.misclosures else None
    apart = {} if reference is None else differences(solution, reference)
    if errors is None or not known:
        return Score(misclosure=missed, apart=apart)
    return Score(_sizes(errors), inside_of(errors), nees_of(errors), missed, apart)


def _sizes(errors: Errors) -> dict[str, Spread]:
    statistics = errors.statistics()
    return {name: statistics[key] for name, key in SIZES.items() if statistics[key].count}


def inside_of(errors: Errors) -> dict[str, float]:
    """Return the share of components at all moments that are at most three sigma; nan where none is known."""
    scaled = np.abs(errors.error) / np.where(errors.sigma > 0.0, errors.sigma, np.nan)
    found = {name: scaled[:, list(columns)] for name, columns in COLUMNS.items()}
    seen = {name: part[np.isfinite(part)] for name, part in found.items()}
    return {name: float(np.mean(part <= SIGMAS)) if len(part) else nan for name, part in seen.items()}


def nees_of(errors: Errors) -> dict[str, float]:
    """Return the mean NEES of each block per degree of freedom; blocks of which truth says nothing are left out."""
    found = {block: errors.whitened(block) for block in BLOCKS}
    seen = {block: z[np.isfinite(z).all(axis=1)] for block, z in found.items()}
    return {block: float(np.mean(z**2)) for block, z in seen.items() if len(z)}


def differences(solution: Solution, reference: Solution) -> dict[str, Spread]:
    """Return how far a solution lies from a reference, at the times of the reference that it has as well."""
    return _sizes(errors_of(finite(solution), as_truth(finite(reference))))


def as_truth(solution: Solution) -> Truth:
    """Return the states of a solution as a table of truth."""
    roll, pitch, heading = euler_from_quaternion(solution.quaternion_nb)
    return Truth(
        time=solution.time, latitude=solution.latitude, longitude=solution.longitude, depth=solution.depth,
        roll=roll, pitch=pitch, heading=heading, velocity=solution.velocity_n,
    )  # fmt: skip
