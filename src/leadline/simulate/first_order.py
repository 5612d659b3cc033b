"""First-order processes, compiled: what follows with a lag, and the sum of many that makes noise of the spectrum 1/f."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import kernel
from leadline.data.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.random import Generator

    from leadline.data.records import Array

STEP = 0.02  # s, the longest between moments at which what is followed is asked for
CHUNK = 4096  # rows that are made at a time
SPACING = 2.5  # of the time constants of 1/f noise: the spectrum ripples by 0.2 %


@kernel()
def follow_rows(time, driven, tau, x, found):
    """Write x of tau x' = u - x at rows, u straight between them; `x` holds that of the first row, and in the end that of the last."""
    for k in range(len(time)):
        if k > 0:
            a = (time[k] - time[k - 1]) / tau
            e = math.exp(-a)
            share = (1.0 - e) / a if a > 1e-9 else 1.0
            for c in range(len(x)):
                x[c] = e * x[c] + (share - e) * driven[k - 1, c] + (1.0 - share) * driven[k, c]
        for c in range(len(x)):
            found[k, c] = x[c]


@kernel()
def flicker_rows(gap, taus, sigma, normal, x, found):
    """Write the sum of Gauss-Markov processes (rows, axes), all of steady `sigma`; `gap` before each row (s), `x` (axes, taus) goes on."""
    last, stages = -1.0, len(taus)
    keep, drive = np.empty(stages), np.empty(stages)
    for k in range(len(gap)):
        if abs(gap[k] - last) > 1e-6 * last:
            last = gap[k]
            for j in range(stages):
                keep[j] = math.exp(-last / taus[j])
                drive[j] = sigma * math.sqrt(1.0 - keep[j] * keep[j])
        for c in range(len(x)):
            total = 0.0
            for j in range(stages):
                x[c, j] = keep[j] * x[c, j] + drive[j] * normal[k, c, j]
                total += x[c, j]
            found[k, c] = total


def lagging(time: Array, value: Callable[[Array], Array], tau: float, start: Array | None = None) -> Array:
    """Return at ascending times (s) what follows a quantity with a lag: tau x' = value - x.

    value gives rows (times, axes) at times; it is asked at least every 20 ms and taken to be straight in between.  At the first time x is
    `start` (axes,), by default the value itself.  Raises InputError for a time constant `tau` (s) below zero; zero is no lag.
    """
    if tau < 0.0:
        raise InputError("instrument", f"lags by {tau} s", "a lag of 0 s or more")
    if not len(time) or tau == 0.0:
        return value(time)
    whole = max(1, int(np.ceil(np.max(np.diff(time), initial=0.0) / STEP)))
    x = np.ascontiguousarray(value(time[:1])[0] if start is None else start, dtype=float).copy()
    found, rows = np.empty((len(time), len(x))), max(1, CHUNK // whole)
    found[0] = x
    for first in range(0, len(time) - 1, rows):
        part = time[first : first + rows + 1]
        between = part[:-1, None] + np.diff(part)[:, None] * np.arange(whole) / whole
        moments = np.append(between.ravel(), part[-1])
        fine = np.empty((len(moments), len(x)))
        follow_rows(moments, np.ascontiguousarray(value(moments), dtype=float), float(tau), x, fine)
        found[first + 1 : first + len(part)] = fine[whole::whole]
    return found


def flicker(time: Array, axes: int, generator: Generator) -> Array:
    """Return noise (times, axes) of the spectrum 1/f, of unit bias instability, at ascending times (s).

    Two-sided S(f) = 1 / (2 pi |f|), so that the Allan deviation is sqrt(2 ln 2 / pi) = 0.664 at all averaging times, from a few rows to a
    tenth of the whole (IEEE Std 952, 1997, annex C).  It is the sum of Gauss-Markov processes whose time constants lie a factor r
    apart, from the time between rows to twice the whole, all of variance ln r / pi: their spectra 2 s^2 tau / (1 + (2 pi f tau)^2) add up
    to s^2 / (2 ln r f).
    """
    if len(time) < 2:
        return np.zeros((len(time), axes))
    least, most = float(np.median(np.diff(time))), 2.0 * float(time[-1] - time[0])
    taus = least * SPACING ** np.arange(1 + max(0, int(np.ceil(np.log(most / least) / np.log(SPACING)))))
    sigma = float(np.sqrt(np.log(SPACING) / np.pi))
    x = sigma * generator.standard_normal((axes, len(taus)))
    gap, found = np.diff(time, prepend=time[0]), np.empty((len(time), axes))
    for first in range(0, len(time), CHUNK):
        part = gap[first : first + CHUNK]
        normal = generator.standard_normal((len(part), axes, len(taus)))
        flicker_rows(part, taus, sigma, normal, x, found[first : first + CHUNK])
    return found
