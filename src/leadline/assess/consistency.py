"""Does a solution make the errors that it says it makes?  Tests of innovations and of errors, and a verdict in words.

Every test of a family is judged by Holm (1979) at 1 %, and each answer is one of three: consistent, not consistent, too few data.
Significance is not materiality: with very many innovations any imperfection is significant.  A factor whose simultaneous 99 %
interval reaches [1/1.1, 1.1] counts as consistent ("within 10 %"), as does a largest autocorrelation of at most 0.1; a gate that turns
away more than it should is held against a sensor only where it demonstrably turns away more than half.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum
from math import nan
from typing import TYPE_CHECKING, Protocol

import numpy as np

from leadline.assess.gated import GatedSum, autocorrelation, effective_size
from leadline.assess.intervals import SMALL, Interval, factor_text, interval_of_anees, interval_of_fraction
from leadline.assess.usage import lost_after, unused
from leadline.data.outcome import Outcome

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import ArrayLike

    from leadline.assess.errors import Errors
    from leadline.data.records import Array
    from leadline.data.solution import Innovations, Solution

FAMILY = 0.01  # probability of any false alarm in a family of tests
FEWEST = 20  # scalar innovations below which a sigma wrong by 2 cannot be shown
MATERIAL_FACTOR = 1.1
MATERIAL_CORRELATION = 0.1
LAGS = 10  # of the Ljung-Box test, or a fifth of the values where they are fewer


class Answer(StrEnum):
    """The three answers of a verdict."""

    CONSISTENT = "consistent"
    INCONSISTENT = "not consistent"
    TOO_FEW = "too few data"


@dataclass(frozen=True)
class Verdict:
    """One answer in words, with the numbers that it rests on.

    subject: the sensor instance, the error block, or "" for the whole.  test: nis, gate, whiteness, nees, or "" for the whole.
    count: scalar values judged.  p: of the hypothesis that all is well.  value: mean nis per degree of freedom, gated fraction,
    largest autocorrelation, or mean nees per degree of freedom.  factor: sigma that the data show / sigma stated, with its interval.
    first: sentences that come before the answer, and open `sentence`.  findings: what the answer for the whole rests on, each a sentence.
    """

    answer: Answer
    sentence: str
    subject: str = ""
    test: str = ""
    component: str = ""
    count: int = 0
    p: float = nan
    value: float = nan
    factor: Interval = field(default_factory=Interval)
    first: tuple[str, ...] = ()
    findings: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Subject and component, told once where they are the same word."""
        return named(self.subject, self.component)


def named(subject: str, component: str) -> str:
    """Return a sensor's or block's name and that of its component, told once where they are the same word."""
    return subject if component in ("", subject) else f"{subject} {component}".strip()


class Evidence(Protocol):
    """What one test knows before the family is judged."""

    @property
    def count(self) -> int:
        """Scalar values behind it."""

    @property
    def p(self) -> float:
        """Probability of data as extreme when all is well."""

    def verdict(self, rejected: bool, level: float) -> Verdict:
        """Say what the test says, once the family has judged it, with intervals at the simultaneous `level`."""


def holm(p: Sequence[float], level: float = FAMILY) -> list[bool]:
    """Tell which hypotheses of a family are rejected, with probability at most `level` of any false alarm (Holm, 1979)."""
    rejected = [False] * len(p)
    for done, i in enumerate(np.argsort(p, kind="stable")):
        if not p[i] <= level / (len(p) - done):
            break
        rejected[i] = True
    return rejected


def judge(family: Sequence[Evidence], level: float = FAMILY) -> tuple[Verdict, ...]:
    """Return the verdicts of a family of tests, in its order: Holm decides, intervals are simultaneous (Bonferroni).

    Evidence on fewer than 20 values can never confirm; errors against truth (NEES) can be refuted by fewer, innovations cannot.
    """
    able = [evidence for evidence in family if evidence.count >= FEWEST or (evidence.count and isinstance(evidence, NeesEvidence))]
    rejected = dict(zip(map(id, able), holm([evidence.p for evidence in able], level), strict=True))
    each = 1.0 - level / max(len(able), 1)
    return tuple(_cautious(evidence.verdict(rejected.get(id(evidence), False), each)) for evidence in family)


def _cautious(verdict: Verdict) -> Verdict:
    """Return a verdict that confirms nothing from too few values."""
    if verdict.count >= FEWEST or verdict.answer == Answer.INCONSISTENT:
        return verdict
    sentence = f"{verdict.name}: too few data ({verdict.count} values; fewer than {FEWEST} cannot show a sigma wrong by 2)"
    return replace(verdict, answer=Answer.TOO_FEW, sentence=sentence)


def _by_factor(name: str, what: str, rejected: bool, factor: Interval) -> tuple[Answer, str]:
    """Return answer and sentence of a test on a factor."""
    within = factor.reaches(MATERIAL_FACTOR, at_least=1.0 / MATERIAL_FACTOR)
    size = f"{what} {factor.as_factor} times as large as predicted"
    if np.isfinite(factor.estimate) and factor.high >= SMALL:
        size = f"{what} {factor_text(factor.estimate)} times as large as predicted ({factor.as_factor})"
    if not rejected:
        return Answer.CONSISTENT, f"{name}: consistent, {size}"
    if within:
        return Answer.CONSISTENT, f"{name}: consistent within 10 %, {size}"
    wrong = "too small" if factor.low > 1.0 else "too large"
    return Answer.INCONSISTENT, f"{name}: not consistent, {size}: its sigma is {wrong}"


@dataclass(frozen=True)
class NisEvidence:
    """Normalised innovations squared of one sensor's used groups."""

    sensor: str
    count: int
    mean: float  # of nis per degree of freedom
    groups: GatedSum

    @property
    def p(self) -> float:
        """Two-sided probability of the mean NIS."""
        return self.groups.p

    def verdict(self, rejected: bool, level: float) -> Verdict:
        """Name the factor by which the sigma of the innovations is wrong."""
        factor = self.groups.factor(level) if self.count else Interval()
        answer, sentence = _by_factor(self.sensor, "innovations", rejected, factor)
        return Verdict(answer, sentence, self.sensor, "nis", "", self.count, self.p if self.count else nan, self.mean, factor)


@dataclass(frozen=True)
class GateEvidence:
    """How many of one sensor's groups the gate turned away, against how many it should."""

    sensor: str
    count: int
    gated: int
    expected: float  # fraction

    @property
    def p(self) -> float:
        """Probability of as many gated groups or more."""
        from scipy.special import bdtrc

        if not self.count:
            return nan
        return float(bdtrc(self.gated - 1, self.count, self.expected)) if self.gated else 1.0

    def verdict(self, rejected: bool, level: float) -> Verdict:
        """Hold it against the sensor only where more than half of its groups are turned away."""
        fraction = interval_of_fraction(self.gated, self.count, level) if self.count else Interval()
        size = f"the gate turned away {100 * fraction.estimate:.3g} % of {self.count}, where {100 * self.expected:.2g} % are to be expected"
        bad = rejected and fraction.low > 0.5
        answer = Answer.INCONSISTENT if bad else Answer.CONSISTENT
        words = f"{answer.value}, {size}" + (" (outliers, or a sigma too small)" if rejected and not bad else "")
        return Verdict(answer, f"{self.sensor}: {words}", self.sensor, "gate", "", self.count, self.p, fraction.estimate)


@dataclass(frozen=True)
class WhitenessEvidence:
    """Autocorrelations (lags,) about zero of one component's standardised residuals, in order of time."""

    sensor: str
    component: str
    count: int
    correlations: Array

    @property
    def p(self) -> float:
        """Probability of the Ljung-Box statistic n (n + 2) sum r_k^2 / (n - k) or more (Ljung and Box, 1978)."""
        from scipy.special import gammaincc

        lags, n = np.arange(1, len(self.correlations) + 1), self.count
        statistic = n * (n + 2) * np.sum(self.correlations**2 / (n - lags))
        return float(gammaincc(0.5 * len(lags), 0.5 * statistic)) if len(lags) else nan

    def verdict(self, rejected: bool, level: float) -> Verdict:  # noqa: ARG002  (one contract for all evidence)
        """Name the lag of the largest autocorrelation."""
        at = int(np.argmax(np.abs(self.correlations))) if len(self.correlations) else 0
        largest = float(self.correlations[at]) if len(self.correlations) else nan
        size = f"the largest autocorrelation of its innovations is {largest:.2f}, at lag {at + 1} of {len(self.correlations)}"
        bad = rejected and abs(largest) > MATERIAL_CORRELATION
        answer = Answer.INCONSISTENT if bad else Answer.CONSISTENT
        words = "not consistent, innovations are correlated: " if bad else "consistent, "
        sentence = f"{named(self.sensor, self.component)}: {words}{size}"
        return Verdict(answer, sentence, self.sensor, "whiteness", self.component, self.count, self.p, largest)


@dataclass(frozen=True)
class NeesEvidence:
    """Normalised estimation errors squared of one block, over one run or several."""

    block: str
    dof: int
    mean: float
    effective: float  # independent vectors

    @property
    def count(self) -> int:
        """Independent scalar errors."""
        return int(self.effective * self.dof)

    @property
    def p(self) -> float:
        """Two-sided probability of the mean NEES: effective * mean is chi-square with effective * dof degrees of freedom."""
        from scipy.special import gammainc

        below = float(gammainc(0.5 * self.effective * self.dof, 0.5 * self.effective * self.mean))
        return min(1.0, 2.0 * min(below, 1.0 - below))

    def verdict(self, rejected: bool, level: float) -> Verdict:
        """Name the factor by which the sigma of the errors is wrong."""
        anees = interval_of_anees(self.mean, self.effective, self.dof, level) if self.effective else Interval()
        low, high, estimate = (float(np.sqrt(v / self.dof)) for v in (anees.low, anees.high, anees.estimate))
        factor = Interval(low, high, estimate, level)
        answer, sentence = _by_factor(self.block, "errors against truth", rejected, factor)
        return Verdict(answer, sentence, self.block, "nees", "", self.count, self.p, self.mean / self.dof, factor)


def nees_evidence(whitened: ArrayLike, block: str) -> NeesEvidence:
    """Return the evidence of whitened errors P^-1/2 e, of shape (times, dof) for one run or (runs, times, dof).

    Runs are independent; the times of a run count as n / (1 + 2 sum r_k), with r_k the square of the autocorrelation of the whitened
    errors about zero (the NEES of a Gaussian error is correlated as its square), or the autocorrelation of the NEES about its own mean,
    whichever leaves fewer: an error that keeps its size and changes its sign fools the first, one that never changes the second.
    """
    z = np.asarray(whitened, float)
    z = z[None] if z.ndim == 2 else z
    runs = [run[np.isfinite(run).all(axis=1)] for run in z]
    runs = [run for run in runs if len(run)]
    dof = z.shape[2]
    if not runs:
        return NeesEvidence(block, dof, nan, 0.0)
    shortest = min(map(len, runs))
    total = sum(map(len, runs))
    mean = float(sum(np.sum(run**2) for run in runs)) / total
    of_errors = np.mean([autocorrelation(run)[:shortest] for run in runs], axis=0) ** 2
    of_nees = np.mean([autocorrelation(np.sum(run**2, axis=1) - mean)[:shortest] for run in runs], axis=0)
    return NeesEvidence(block, dof, mean, min(effective_size(of_errors, total), effective_size(of_nees, total)))


def innovation_evidence(innovations: Innovations) -> Iterator[Evidence]:
    """Yield the tests of each sensor instance: NIS, gate, and the whiteness of each component."""
    sensors, code = np.unique(innovations.sensor, return_inverse=True)
    judged = (innovations.component != "") & np.isfinite(innovations.nis) & (innovations.dof > 0) & ~innovations.widened
    judged &= np.isin(innovations.outcome, (Outcome.USED, Outcome.GATED))
    for number, sensor in enumerate(sensors):
        mine = np.flatnonzero(judged & (code == number))
        if len(mine):
            yield from _sensor_evidence(str(sensor), innovations.select(mine[np.argsort(innovations.time[mine], kind="stable")]))


def _sensor_evidence(sensor: str, mine: Innovations) -> Iterator[Evidence]:
    groups = mine.select(np.sort(np.unique(mine.group, return_index=True)[1]))
    yield nis_evidence(sensor, groups.select(groups.outcome == Outcome.USED))
    probability = groups.gate_probability
    gating = np.isfinite(probability) & (probability < 1.0)
    gated = int(np.sum(groups.outcome[gating] == Outcome.GATED))
    if gating.any():
        yield GateEvidence(sensor, int(gating.sum()), gated, float(np.mean(1.0 - probability[gating])))
    used = mine.select((mine.outcome == Outcome.USED) & (mine.sigma > 0.0))
    for component in np.unique(used.component):
        picked = used.component == component
        yield whiteness_evidence(sensor, str(component), used.residual[picked] / used.sigma[picked])


def nis_evidence(sensor: str, groups: Innovations) -> NisEvidence:
    """Return the evidence of used groups, one entry each, in order of time."""
    from scipy.special import gammaincinv

    if not len(groups):
        return NisEvidence(sensor, 0, nan, GatedSum(0.0, np.empty((0, 2)), np.empty(0), 0.0))
    probability = np.where(np.isfinite(groups.gate_probability), groups.gate_probability, 1.0)
    pairs, inverse, counts = np.unique(np.stack([groups.dof, probability], axis=1), axis=0, return_inverse=True, return_counts=True)
    kinds = np.stack([pairs[:, 0], 2.0 * gammaincinv(0.5 * pairs[:, 0], pairs[:, 1])], axis=1)
    total = GatedSum(float(groups.nis.sum()), kinds, counts.astype(float), float(len(groups)))
    scale = np.bincount(inverse.ravel(), groups.nis) / counts
    correlation = autocorrelation(groups.nis - scale[inverse.ravel()])
    effective = effective_size(correlation, len(groups))
    scalars = int(groups.dof.sum())
    return NisEvidence(sensor, scalars, total.total / scalars, GatedSum(total.total, kinds, total.counts, effective))


def whiteness_evidence(sensor: str, component: str, standardised: Array, lags: int = LAGS) -> WhitenessEvidence:
    """Return the evidence of a component's standardised residuals (n,), over `lags` or n // 5 lags, whichever is fewer."""
    count = len(standardised)
    return WhitenessEvidence(
        sensor, component, count, autocorrelation(standardised)[1 : 1 + min(lags, count // 5)] if count else np.empty(0)
    )


@dataclass(frozen=True)
class Consistency:
    """The verdict on a whole solution and those that it rests on."""

    verdict: Verdict
    verdicts: tuple[Verdict, ...]

    def of(self, subject: str) -> tuple[Verdict, ...]:
        """Return the verdicts on one sensor instance or error block."""
        return tuple(v for v in self.verdicts if v.subject == subject)


def consistency(solution: Solution, errors: Errors | None = None) -> Consistency:
    """Judge the innovations of a solution, and its errors where truth is known, as one family of tests."""
    family = list(innovation_evidence(solution.innovations))
    if errors is not None and len(errors):
        blocks = [nees_evidence(errors.whitened(block), block) for block in ("position", "horizontal", "velocity", "attitude")]
        seen = [evidence for evidence in blocks if evidence.effective]
        family += [e for e in seen if e.block != "horizontal" or all(other.block != "position" for other in seen)]
    verdicts = judge(family)
    return Consistency(_opened(_overall(verdicts), solution), verdicts)


def _opened(verdict: Verdict, solution: Solution) -> Verdict:
    """Return the verdict with what must be read first: a solution that is lost, which is never consistent, and sensors hardly used."""
    first, lost = unused(solution), lost_after(solution)
    if lost is not None:
        first = (f"The solution is lost after {lost:.6g} s", *first)
        if verdict.answer != Answer.INCONSISTENT:
            sentence = "Not consistent: a lost solution makes no claim that could be tested."
            verdict = replace(verdict, answer=Answer.INCONSISTENT, sentence=sentence)
    return replace(verdict, first=first, sentence=". ".join((*first, verdict.sentence)))


def _overall(verdicts: Sequence[Verdict]) -> Verdict:
    """Sum up: one inconsistency is enough; without any test that had data enough, there are too few."""
    count = sum(v.count for v in verdicts if v.test in ("nis", "nees"))
    wrong = [v for v in verdicts if v.answer == Answer.INCONSISTENT]
    if wrong:
        findings = tuple(map(_short, wrong))
        sentence = "Not consistent: " + "; ".join(findings) + "."
        return Verdict(Answer.INCONSISTENT, sentence, count=count, p=min(v.p for v in wrong), findings=findings)
    few = sorted({v.subject for v in verdicts if v.answer == Answer.TOO_FEW and v.test in ("nis", "nees")})
    right = sorted({v.subject for v in verdicts if v.answer == Answer.CONSISTENT and v.test in ("nis", "nees")})
    if not right:
        return Verdict(Answer.TOO_FEW, "Too few data to judge whether the errors are those predicted.", count=count)
    tail = f"; too few data of {', '.join(few)}" if few else ""
    return Verdict(Answer.CONSISTENT, f"Consistent: the errors of {', '.join(right)} are those predicted{tail}.", count=count)


def _short(verdict: Verdict) -> str:
    return verdict.sentence.replace(": not consistent, ", " ", 1)
