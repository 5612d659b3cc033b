"""What the runs of one mission by one configuration come to: statistics by name, each with its interval; and bars that they must reach."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from leadline.assess.consistency import Answer, NisEvidence
from leadline.assess.intervals import Interval, interval_of_anees, interval_of_fraction, interval_of_mean
from leadline.assess.statistic import QUANTITIES, Paired, over_bound, paired, rmse_of
from leadline.data.errors import InputError, suggestion
from leadline.missions.cells import Solved
from leadline.missions.montecarlo import JUDGED, study_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from leadline.assess.consistency import Verdict
    from leadline.data.records import Array
    from leadline.missions.montecarlo import Study

RATIO = "ratio_"
SINGLE = ("consistent", "refused", "lost", "cost_us_per_s")


class Taken(NamedTuple):
    """All runs of one mission by one configuration: those that were solved, by number, and why others were not."""

    solved: Mapping[int, Solved]
    refused: Mapping[int, str]
    time: Array

    @property
    def sound(self) -> dict[int, Solved]:
        """The runs whose states are numbers to the end."""
        return {number: one for number, one in self.solved.items() if not np.isfinite(one.lost)}


@dataclass(frozen=True, eq=False)
class Summary:
    """Statistics of the runs of a mission by a configuration.

    Of runs that were solved and are not lost: `statistics` by name, `errors` (runs, times, 9) of the runs `numbers` at the checks `time`.
    refused: sentences and how many runs met each.  verdicts: of all runs together; findings: what they hold against the vehicle file.
    bound_sigma: (times, 9) of the Cramér-Rao bound; None without one, and then `no_bound` says why.
    nees, bands: mean NEES (times,) of a block and the two ends of its 95 % band.
    """

    mission: str
    configuration: str
    runs: int
    numbers: tuple[int, ...] = ()
    time: Array = field(default_factory=lambda: np.empty(0))
    errors: Array = field(default_factory=lambda: np.empty((0, 0, 9)))
    statistics: Mapping[str, Interval] = field(default_factory=dict)
    refused: Mapping[str, int] = field(default_factory=dict)
    lost: int = 0
    answer: Answer = Answer.TOO_FEW
    findings: tuple[str, ...] = ()
    no_bound: str = ""
    bound_sigma: Array | None = None
    nees: Mapping[str, Array] = field(default_factory=dict)
    bands: Mapping[str, tuple[Array, Array]] = field(default_factory=dict)

    @property
    def rmse(self) -> Array:
        """Root mean square over runs of each error at each time (times, 9)."""
        return np.asarray(np.sqrt(np.mean(self.errors**2, axis=0)))


def study_from(mission: str, seeds: tuple[int, ...], runs: Sequence[Solved], time: Array, bound: Array | None) -> Study:
    """Put runs together as a Monte Carlo study; times beyond the end of the shortest run are left out."""
    least = min(len(time), *(len(one.run.error) for one in runs))
    cut = [one.run._replace(error=one.run.error[:least], whitened={b: z[:least] for b, z in one.run.whitened.items()}) for one in runs]
    limit = np.full((least, 9, 9), np.nan) if bound is None else bound[:least]
    return study_of(mission, seeds, time[:least], limit, cut)


def summary_of(mission: str, configuration: str, taken: Taken, study: Study | None, bound: Array | str) -> Summary:
    """Return the summary of runs; study: of those that are sound, None where there are none."""
    count = len(taken.solved) + len(taken.refused)
    refused, lost = dict(Counter(taken.refused.values())), len(taken.solved) - len(taken.sound)
    plain = {"refused": interval_of_fraction(len(taken.refused), count), "lost": interval_of_fraction(lost, count)}
    no_bound = bound if isinstance(bound, str) else ""
    if study is None:
        return Summary(mission, configuration, count, statistics=plain, refused=refused, lost=lost, no_bound=no_bound)
    verdicts = study.verdicts()
    sigma = None if isinstance(bound, str) else study.bound_sigma
    statistics = dict(_statistics(study, list(taken.sound.values()), sigma))
    return Summary(
        mission, configuration, count, tuple(taken.sound), study.time, study.error, {**statistics, **plain}, refused, lost,
        _answer(verdicts), tuple(v.sentence for v in verdicts if v.answer == Answer.INCONSISTENT), no_bound, sigma,
        {block: study.nees(block) for block in JUDGED}, {block: study.band(block) for block in JUDGED},
    )  # fmt: skip


def _answer(verdicts: Sequence[Verdict]) -> Answer:
    """Return the answer of all tests together: one inconsistency is enough."""
    answers = {v.answer for v in verdicts if v.test in ("nis", "nees") or v.answer == Answer.INCONSISTENT}
    return next((a for a in (Answer.INCONSISTENT, Answer.CONSISTENT) if a in answers), Answer.TOO_FEW)


def _statistics(study: Study, runs: Sequence[Solved], sigma: Array | None) -> Iterator[tuple[str, Interval]]:
    """Yield each statistic by its name."""
    for name, columns in QUANTITIES.items():
        yield f"rmse_{name}", rmse_of(study.error, name)
        yield f"end_{name}", rmse_of(study.error[:, -1:], name)
        yield f"within_{name}", interval_of_mean([np.mean(one.inside[list(columns)]) for one in runs])
        if sigma is not None:
            yield f"rmse_{name}_over_bound", over_bound(study.error, sigma, name)
    for block in JUDGED:
        yield f"anees_{block}", anees_of(study, block)
        yield f"in_band_{block}", study.in_band(block)
    for evidence in study.evidence():
        if isinstance(evidence, NisEvidence):
            factor = evidence.groups.factor(0.99) if evidence.count else Interval()
            yield f"nis_{evidence.sensor}", Interval(factor.low**2, factor.high**2, factor.estimate**2, factor.level)
    yield "consistent", interval_of_fraction(sum(one.answer == Answer.CONSISTENT for one in runs), len(runs))
    yield "cost_us_per_s", interval_of_mean([one.cost for one in runs])


def anees_of(study: Study, block: str) -> Interval:
    """Return the mean NEES of a block per degree of freedom over all runs and times, with its interval; 1 is to be expected."""
    evidence = study.evidence_of(block)
    if not evidence.effective > 0.0:
        return Interval()
    found = interval_of_anees(evidence.mean, evidence.effective, evidence.dof)
    return Interval(found.low / evidence.dof, found.high / evidence.dof, found.estimate / evidence.dof, found.level)


@dataclass(frozen=True)
class Bar:
    """A limit: the 99 % interval of a statistic must reach it.  No mission or configuration means each of them.

    against: for a ratio, the configuration below the line.
    """

    statistic: str
    mission: str | None = None
    configuration: str | None = None
    against: str | None = None
    most: float = inf
    least: float = -inf

    def check(self, missions: Sequence[str], configurations: Sequence[str], where: str) -> None:
        """Raise InputError, naming the key, for a bar that says nothing or speaks of what is not there."""
        if self.most == inf and self.least == -inf:
            raise InputError(where, f"has no limit for '{self.statistic}'", "give most or least")
        if self.least > self.most:
            raise InputError(where, f"least = {self.least:g} lies above most = {self.most:g}", "give one of them, or a range")
        for key, value, known in (
            ("mission", self.mission, missions), ("configuration", self.configuration, configurations),
            ("against", self.against, configurations),
        ):  # fmt: skip
            if value is not None and value not in known:
                raise InputError(f"{where}.{key}", f"'{value}' is not in the study", suggestion(value, known))
        if self.statistic.startswith(RATIO) != (self.against is not None):
            raise InputError(f"{where}.against", "is given" if self.against else "is not given", "a ratio_... has it, and nothing else")
        known = statistic_names()
        if self.statistic not in known and not self.statistic.startswith("nis_"):
            raise InputError(f"{where}.statistic", f"'{self.statistic}' is not known", suggestion(self.statistic, [*known, "nis_SENSOR"]))


def statistic_names() -> tuple[str, ...]:
    """Return the names of all statistics but those of single sensors, `nis_SENSOR`."""
    by_quantity = [f"{family}{name}" for family in ("rmse_", "end_", "within_", RATIO) for name in QUANTITIES]
    over = [f"rmse_{name}_over_bound" for name in QUANTITIES]
    by_block = [f"{family}{block}" for family in ("anees_", "in_band_") for block in JUDGED]
    return (*by_quantity, *over, *by_block, *SINGLE)


class Outcome(NamedTuple):
    """What became of a bar at one mission and configuration; held: None where there was nothing to judge."""

    bar: Bar
    mission: str
    configuration: str
    value: Interval
    held: bool | None
    sentence: str


def outcomes_of(bars: Sequence[Bar], summaries: Mapping[tuple[str, str], Summary]) -> Iterator[Outcome]:
    """Judge bars, each at all missions and configurations that it speaks of."""
    for bar in bars:
        for (mission, configuration), summary in summaries.items():
            if bar.mission in (None, mission) and bar.configuration in (None, configuration) and bar.against != configuration:
                other = None if bar.against is None else summaries[mission, bar.against]
                yield _judged(bar, summary, other)


def _judged(bar: Bar, summary: Summary, other: Summary | None) -> Outcome:
    if other is None:
        value = summary.statistics.get(bar.statistic, Interval())
    else:
        value = ratio_of(summary, other, bar.statistic.removeprefix(RATIO)).ratio
    limits = [f"at most {bar.most:g}"] * (bar.most < inf) + [f"at least {bar.least:g}"] * (bar.least > -inf)
    against = "" if bar.against is None else f" against {bar.against}"
    name = f"{summary.mission}, {summary.configuration}: {bar.statistic}{against}"
    if not np.isfinite(value.estimate):
        why = f": no bound, {summary.no_bound}" if summary.no_bound and bar.statistic.endswith("over_bound") else ""
        return Outcome(bar, summary.mission, summary.configuration, value, None, f"{name}: cannot be judged{why}")
    held = value.reaches(bar.most, at_least=bar.least)
    size = f"{value.estimate:.3g} ({value}), {' and '.join(limits)}"
    return Outcome(bar, summary.mission, summary.configuration, value, held, f"{name}: {'held' if held else 'MISSED'}: {size}")


def ratio_of(summary: Summary, other: Summary, quantity: str) -> Paired:
    """Return the RMSE of one configuration over that of another, on the runs that both solved."""
    common = [number for number in summary.numbers if number in set(other.numbers)]
    if not common:
        return Paired(Interval())
    least = min(summary.errors.shape[1], other.errors.shape[1])
    one, two = (s.errors[[s.numbers.index(number) for number in common], :least] for s in (summary, other))
    return paired(one, two, quantity)
