"""Sea beds that look like sea beds: random surfaces with the power-law spectrum of real terrain."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.data.errors import InputError
from leadline.sea.terrain import Chart, Extent, nodes

if TYPE_CHECKING:
    from leadline.data.records import Array


def fractal(
    extent: Extent,
    step: float,
    depth: float,
    *,
    beta: float = 3.0,
    sigma: float | None = None,
    rms_slope: float | None = None,
    longest: float = np.inf,
    seed: int = 0,
) -> Chart:
    """Return a random bed of mean `depth` (m) over an `extent` (m) in steps of `step` (m), the same for the same seed.

    Gaussian, isotropic, with the spectral density S(k) ~ (k^2 + (2 pi / longest)^2)^(-beta / 2) over the PLANE of wavenumbers: `beta` is
    the two-dimensional exponent, 2 + 2H for a Hurst exponent H and 8 - 2D for a fractal dimension D of the surface; the spectrum along a
    straight track falls with beta - 1.  Wavelengths above `longest` (m) are damped to a level.  Measured sea beds have 3 to 4.
    By FFT of white noise, so that opposite edges fit to each other.  Scaled so that the nodes have exactly the standard deviation `sigma`
    (m), or the root-mean-square steepness `rms_slope` (of the differences between neighbours, both directions together).
    Raises InputError unless just one of the two is given.  Sources: Turcotte, Fractals and Chaos in Geology and Geophysics (1997),
    chapter 7; Goff and Jordan (1988), for the level at long waves.
    """
    if (sigma is None) == (rms_slope is None):
        raise InputError("fractal", f"sigma is {sigma} and rms_slope is {rms_slope}", "give one of the two")
    size = float((sigma if sigma is not None else rms_slope) or 0.0)
    if not (np.isfinite([beta, depth, size]).all() and longest > 0.0 and size >= 0.0):
        found = f"depth {depth}, beta {beta}, longest {longest}, sigma {sigma}, rms_slope {rms_slope}"
        raise InputError("fractal", found, "finite numbers, longest above zero, sigma or rms_slope not below")
    bed = rough(nodes(extent, step), step, beta, longest, seed)
    bed *= size / (np.std(bed) if sigma is not None else steepness(bed, step))
    return Chart(extent[0], extent[2], step, step, bed + depth)


def rough(shape: tuple[int, int], step: float, beta: float, longest: float, seed: int) -> Array:
    """Return a surface (rows, columns) of zero mean and arbitrary scale with the spectrum of `fractal`."""
    waves = np.fft.rfft2(np.random.default_rng(seed).standard_normal(shape))
    north, east = 2 * np.pi * np.fft.fftfreq(shape[0], step), 2 * np.pi * np.fft.rfftfreq(shape[1], step)
    square = north[:, None] ** 2 + east**2 + (2 * np.pi / longest) ** 2
    square[0, 0] = 1.0  # of any size: the mean is taken out
    waves *= square ** (-beta / 4)
    waves[0, 0] = 0.0
    return np.asarray(np.fft.irfft2(waves, shape))


def steepness(bed: Array, step: float) -> float:
    """Return the root of the mean squared slope between neighbouring nodes, north and east together."""
    return float(np.hypot(*(np.sqrt(np.mean(np.diff(bed, axis=axis) ** 2)) for axis in (0, 1))) / step)
