"""Alignment without a heading: the first minutes of a run find it themselves, at rest or on the way.

The heading is observed by whatever turns with it: the Earth's rate in a good gyro (gyrocompassing, at rest or with a Doppler log), or
position fixes against the track that Doppler log and gyro make.  Which of these it is need not be said:
    1. a bank of filters, one per `SPACING` of heading, runs over the first `align_s`; the likelihood of their innovations picks one
    2. the run is linearised there with nothing known of the heading, smoothed, and linearised again at the smoothed start, until it stays
The filter then starts from that heading with nothing known of it: no row is used twice.  It is `aligning` until its own sigma is small.
What the data do not determine is refused.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from leadline.core import attitude
from leadline.core.attitude import wrapped
from leadline.data.errors import InputError
from leadline.data.outcome import Outcome
from leadline.estimate import plan as at
from leadline.estimate.output import solution_of
from leadline.estimate.run import Results
from leadline.estimate.smoother import Smoother
from leadline.estimate.stream import inputs_of, stream_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from leadline.data.log import Log
    from leadline.data.records import Array
    from leadline.data.vehicle import Vehicle
    from leadline.estimate.events import Events
    from leadline.estimate.navigator import Navigator
    from leadline.estimate.start import Start

SPACING = np.pi / 18
UNKNOWN = np.pi / np.sqrt(3.0)  # sigma of an angle of which nothing is known
ENOUGH = np.pi / 6  # a sigma above it determines nothing
MARGIN = 4.6  # of the logarithm of the likelihood against any other mode: 1 in 100
APART = np.pi / 4  # between modes
ROUNDS = 5


def aligned(log: Log, vehicle: Vehicle, start: Start, begin: Callable[[Start], Navigator]) -> Start:
    """Return a start with a heading, found from the first `align_s` seconds of a log; `begin` makes a navigator of a start.

    Raises InputError where these do not determine it.
    """
    navigator = begin(turned(start, 0.0, SPACING))
    end = min(start.time + vehicle.process.align, inputs_of(log, vehicle, navigator).covered)
    events = stream_of(log, vehicle, navigator, times=np.array([start.time]), end=end).events
    headings = np.arange(0.0, 2 * np.pi, SPACING)
    likelihood = np.array([_likelihood(begin(turned(start, h, SPACING)), events) for h in headings])
    best = int(np.argmax(likelihood))
    others = likelihood[np.abs(wrapped(headings - headings[best])) > APART]
    where = f"{log.path or log.name}: [initial]"
    found = f"says no heading, and the first {end - start.time:.0f} s determine none"
    right = "add heading_deg, a compass, position fixes, or a gyro that feels the Earth turn"
    if not np.isfinite(likelihood[best]) or likelihood[best] - others.max() < MARGIN:
        raise InputError(where, found, right)
    heading, sigma = _refined(begin, start, events, float(headings[best]))
    if not sigma < ENOUGH:
        raise InputError(where, found, right)
    return turned(start, heading, float(UNKNOWN))


def turned(start: Start, heading: float, sigma: float) -> Start:
    """Return a start with another heading; a velocity that is not known but in the body turns with it."""
    roll, pitch, before = (float(a) for a in attitude.euler_from_quaternion(start.quaternion_nb))
    velocity = start.velocity_n
    if not start.velocity_known:
        velocity = attitude.matrix_from_euler(0.0, 0.0, heading - before) @ velocity
    quaternion = attitude.quaternion_from_euler(roll, pitch, heading)
    return replace(start, quaternion_nb=quaternion, velocity_n=velocity, sigma_heading=sigma)


def _likelihood(navigator: Navigator, events: Events) -> float:
    """Logarithm of the likelihood of the innovations, up to a constant; what the gate turns away counts as if it lay on the gate."""
    results = Results.room(navigator.composition, int(events.measured.sum()), 1)
    navigator.runner.run(navigator.state, events, results)
    plan, params = navigator.composition.plan, navigator.composition.params
    kind = events.kind[events.measured]
    limit = params[plan[at.CHANNEL + at.CHANNEL_SIZE * kind + at.GATE] + at.LIMIT]
    result = results.result[: len(kind)]
    looked = np.isin(results.outcome, (Outcome.USED, Outcome.GATED, Outcome.REANCHORED)) & np.isfinite(result[:, at.NIS])
    return float(-0.5 * np.sum((np.minimum(result[:, at.NIS], 4.0 * limit) + result[:, at.LOG_DET])[looked]))


def _refined(begin: Callable[[Start], Navigator], start: Start, events: Events, heading: float) -> tuple[float, float]:
    """Heading at the start by all data, linearised there, and its sigma."""
    sigma = np.inf
    for _ in range(ROUNDS):
        navigator = begin(turned(start, heading, float(UNKNOWN)))
        assert navigator.reference is not None
        count = int(events.measured.sum())
        _, results = Smoother(navigator.composition).stretch(navigator.state, events, np.full(count, -1), np.full(count, np.nan))
        solution = solution_of(navigator.reference, navigator.composition, np.array([start.time]), results.output)
        found = float(attitude.euler_from_quaternion(solution.quaternion_nb)[2][0])
        step, heading, sigma = abs(float(wrapped(found - heading))), found, float(solution.sigma[0, 8])
        if step < 0.1 * sigma:
            break
    return heading, sigma


def still_aligning(sigma_heading: Array, limit: float) -> Array:
    """Tell which states (n,) come before the heading is first as good as `limit` (rad), in a run that began without one."""
    reached = np.flatnonzero(sigma_heading <= limit)
    return np.asarray(np.arange(len(sigma_heading)) < (reached[0] if len(reached) else len(sigma_heading)))
