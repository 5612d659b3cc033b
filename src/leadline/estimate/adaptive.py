"""Noise that is learnt from innovations: a factor on that of each channel, and one on that of the motion.

For a residual r with covariance T + f R (T = H P H^T, f R the noise) the ratios
    rho_R = mean over components of (r_a^2 - T_aa) / (f R_aa)        rho_Q = mean of (r_a^2 - f R_aa) / T_aa
have the mean one if f, and the noise of the motion, are right.  Each factor follows its ratio: f <- f (1 + (rho - 1) / N), N the
memory in measurements, rho cut off at `MOST`, so that one outlier adds at most a few N-ths.  What a gate turned away counts as well, or
noise that is far too small would never be found.  Covariance matching: Mehra (1972), IEEE Trans. Automatic Control 17(5).
"""

from __future__ import annotations

from leadline.core.compiled import COMPONENTS, kernel
from leadline.estimate.plan import ADAPT_Q, ADAPT_R, ESTIMATOR, MEMORY_E
from leadline.models.layout import CHANNELS_N, LAST_USED, X

MOST, SMALLEST, LARGEST = 9.0, 1e-2, 1e4


@kernel()
def noise_factor(plan, state, channel):
    """By how much the noise of a channel has been found larger than stated (1 unless it is learnt)."""
    return state[LAST_USED + 2 * plan[CHANNELS_N] + channel]


@kernel()
def followed(factor, ratio, memory):
    """The factor after one more ratio."""
    ratio = min(max(ratio, -MOST), MOST)
    return min(max(factor * (1.0 + (ratio - 1.0) / memory), SMALLEST), LARGEST)


@kernel()
def learn(plan, params, state, channel, r, T, R, factor, c):
    """Follow one residual of a channel: T = H P H^T (rows of COMPONENTS), noise factor x R."""
    own = plan[ESTIMATOR]
    by_noise, by_motion = params[own + ADAPT_R] != 0.0, params[own + ADAPT_Q] != 0.0
    if not (by_noise or by_motion):
        return
    of_noise = of_motion = 0.0
    for a in range(c):
        square, stated, predicted = r[a] * r[a], factor * R[a, a], T[a * COMPONENTS + a]
        of_noise += (square - predicted) / stated / c
        of_motion += (square - stated) / predicted / c if predicted > 0.0 else 1.0 / c
    if by_noise:
        i = LAST_USED + 2 * plan[CHANNELS_N] + channel
        state[i] = followed(state[i], of_noise, params[own + MEMORY_E])
    if by_motion:
        i = plan[X] - 1
        state[i] = followed(state[i], of_motion, params[own + MEMORY_E])
