"""Estimators by name, with settings: "ekf", "ukf:alpha=0.5,beta=2", "pf:particles=4000"; a user's own by "package.module:function"."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import WIDE
from leadline.data.errors import InputError, suggestion
from leadline.estimate import kalman
from leadline.estimate.estimator import Estimator
from leadline.models.plugin import check_kernels, imported

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from leadline.models.layout import Layout


MOST_OF_PARTICLES = 20  # states: those of `planar`, with the biases of a gyro
MEMORY = 50.0  # measurements over which noise is learnt
ADAPTIVE = {"": (0.0, 0.0), "r": (1.0, 0.0), "q": (0.0, 1.0), "rq": (1.0, 1.0)}


def estimator_of(spec: str) -> Estimator:
    """Return the estimator of a text "name:setting=value,..."; raises InputError for a name or a setting that is not known."""
    name, _, rest = spec.partition(":")
    if name not in KNOWN:
        if ":" in spec and ("." in name or "/" in name):
            own: Estimator = imported(spec, f"estimator '{spec}'", Estimator)()
            check_kernels(own.kernels(), f"estimator '{spec}'")
            return own
        raise InputError("estimator", f"'{name}' is not known", suggestion(name, KNOWN) + ", or give 'package.module:function'")
    return KNOWN[name](spec, _settings(spec, rest))


def _settings(spec: str, rest: str) -> dict[str, str]:
    found = {}
    for part in filter(None, rest.split(",")):
        key, equals, value = part.partition("=")
        if not equals or not value:
            raise InputError(f"estimator '{spec}'", f"'{part}' is no setting", "give name:setting=value,setting=value")
        if key.strip() in found:
            raise InputError(f"estimator '{spec}'", f"has '{key.strip()}' twice", "give each setting once")
        found[key.strip()] = value.strip()
    return found


class Settings:
    """Settings of one estimator, taken one by one; what is left over in the end is refused."""

    def __init__(self, spec: str, given: Mapping[str, str]) -> None:
        """Take those that were given."""
        self.spec, self.given, self.known = spec, dict(given), []  # type: ignore[var-annotated]

    def number(self, name: str, default: float, least: float = -np.inf, most: float = np.inf) -> float:
        """Return a number; raises InputError for what is none, or lies outside its range."""
        self.known.append(name)
        text = self.given.pop(name, None)
        if text is None:
            return default
        try:
            value = float(text)
        except ValueError:
            value = np.nan
        if not least <= value <= most:
            raise InputError(f"estimator '{self.spec}'", f"{name} = {text}", f"a number from {least:g} to {most:g}")
        return value

    def choice(self, name: str, default: str, choices: tuple[str, ...]) -> str:
        """Return one of several words."""
        self.known.append(name)
        text = self.given.pop(name, default)
        if text not in choices:
            raise InputError(f"estimator '{self.spec}'", f"{name} = {text}", "one of " + ", ".join(filter(None, choices)))
        return text

    def common(self) -> list[float]:
        """Return what every estimator has (plan.py): what is learnt, and over how many measurements."""
        learnt = ADAPTIVE[self.choice("adaptive", "", tuple(ADAPTIVE))]
        return [*learnt, self.number("memory", MEMORY, 10.0, 1e6)]

    def done(self) -> None:
        """Refuse settings that nobody asked for."""
        for name in self.given:
            raise InputError(f"estimator '{self.spec}'", f"has no setting '{name}'", suggestion(name, self.known))


def _ekf(spec: str, given: Mapping[str, str]) -> Estimator:
    settings = Settings(spec, given)
    parameters = np.array(settings.common())
    settings.done()
    return Estimator(spec, kalman.propagate, kalman.points, kalman.update, parameters=parameters, linear=spec.startswith("kf"))


def _ukf(spec: str, given: Mapping[str, str]) -> Estimator:
    """The scaled unscented filter; cubature is one of its settings, `ekf-ukf` moves by Jacobians and corrects by points."""
    from leadline.estimate import square_root, unscented  # compiled where they are asked for

    settings = Settings(spec, given)
    name = spec.partition(":")[0]
    common, cubature = settings.common(), name in ("ckf", "srckf")
    alpha = 1.0 if cubature else settings.number("alpha", 1.0, 1e-3, 10.0)
    beta, kappa = (0.0, 0.0) if cubature else (settings.number("beta", 2.0, -10.0, 10.0), settings.number("kappa", np.nan, -100.0, 100.0))
    augmented = settings.choice("noise", "additive", ("additive", "augmented")) == "augmented"
    settings.done()
    if augmented and common[1]:
        raise InputError(f"estimator '{spec}'", "noise = augmented, adaptive = q", "learn the noise of the motion with noise = additive")
    rooted = name.startswith("sr")
    mend = partial(_check_weights, spec, (alpha, beta, kappa), rooted, augmented)
    parameters = np.array([*common, alpha, beta, kappa, float(augmented)])
    home = square_root if rooted else unscented
    forward = kalman.propagate if name == "ekf-ukf" else home.propagate
    made = Estimator(spec, forward, home.points, home.update, parameters=parameters, count=_pairs, pointed=True, check=mend)
    return replace(made, settle=square_root.settle, prepare=square_root.prepare, root=True) if rooted else made


def _pf(spec: str, given: Mapping[str, str]) -> Estimator:
    """The particle filter."""
    from leadline.estimate import particle

    settings = Settings(spec, given)
    common, count = settings.common(), int(settings.number("particles", 5000.0, 10.0, 1e6))
    own = [count, settings.number("threshold", 0.5, 0.0, 1.0), settings.number("jitter", 0.1, 0.0, 1.0)]
    own.append(settings.number("seed", 0.0, 0.0, 2.0**31))
    settings.done()
    return Estimator(
        spec, particle.propagate, particle.points, particle.update, particle.settle, np.array([*common, *own]), lambda _: 1 + count,
        extra=partial(particle.room, count), prepare=particle.prepare, clones=False, smooths=False, check=partial(_small, spec),
    )  # fmt: skip


def _small(spec: str, layout: Layout) -> None:
    """Refuse states that no number of particles fills."""
    if layout.fixed > MOST_OF_PARTICLES:
        names = ", ".join(nuisance.name for nuisance in layout.nuisances)
        found = f"{layout.fixed} states: {layout.motion_error} of motion" + (f" and {names}" if names else "")
        right = f"at most {MOST_OF_PARTICLES}: leave sensors out that bring such states (--without), or take a Gaussian estimator (ukf)"
        raise InputError(f"estimator '{spec}'", found, right)


def _pairs(layout: Layout) -> int:
    """The estimate and two points for each error."""
    return 1 + 2 * layout.error


def _check_weights(spec: str, weights: tuple[float, float, float], rooted: bool, augmented: bool, layout: Layout) -> None:
    """Refuse a spread that is no length, and for a root weights that would take more off the covariance than there is."""
    n, (alpha, beta, kappa) = layout.error, weights
    if augmented and 2 * layout.motion_error > WIDE:
        found = f"noise = augmented with {layout.motion_error} states of motion"
        raise InputError(f"estimator '{spec}'", found, f"at most {WIDE // 2} have room: noise = additive")
    if n + kappa <= 0.0:
        raise InputError(f"estimator '{spec}'", f"kappa = {kappa:g} with {n} states", f"more than {-n}")
    square = alpha**2 * (3.0 if np.isnan(kappa) else n + kappa)
    if rooted and beta - alpha**2 < -square / n * (0.5 if augmented else 1.0) - 1e-12:
        right = f"beta of {alpha**2 - square / (2 * n):.3g} or more: a root cannot be taken of less than nothing"
        raise InputError(f"estimator '{spec}'", f"beta = {beta:g}", right)


KNOWN: Mapping[str, Callable[[str, Mapping[str, str]], Estimator]] = {
    "ekf": _ekf, "kf": _ekf, "ukf": _ukf, "ckf": _ukf, "ekf-ukf": _ukf, "srukf": _ukf, "srckf": _ukf, "pf": _pf,
}  # fmt: skip
