"""Plans of motion with analytic truth: at rest, straight, circle, figure of eight, lawnmower survey."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leadline.data.errors import InputError
from leadline.simulate.laws import Driven, Path
from leadline.simulate.profiles import Profile, Ramp, Sinusoid, Steps, Sum
from leadline.simulate.trajectory import Place, Trajectory


@dataclass(frozen=True)
class Weave:
    """The gentle motion on top of a plan: amplitude and period (s) of each angle (rad) and each body speed (m/s)."""

    roll: tuple[float, float] = (0.0, 6.1)
    pitch: tuple[float, float] = (0.0, 7.3)
    heading: tuple[float, float] = (0.0, 23.0)
    forward: tuple[float, float] = (0.0, 31.0)
    starboard: tuple[float, float] = (0.0, 11.0)
    down: tuple[float, float] = (0.0, 8.9)


GENTLE = Weave((0.03, 6.1), (0.015, 7.3), (0.02, 23.0), (0.05, 31.0), (0.04, 11.0), (0.03, 8.9))


def driven(
    place: Place, duration: float, *, forward: Profile, heading: Profile, pitch: Profile, roll: Profile | None = None, weave: Weave
) -> Trajectory:
    """Return the trajectory of planned speed and angles with a weave on top."""
    plan = {"roll": roll or Ramp(), "pitch": pitch, "heading": heading, "forward": forward, "starboard": Ramp(), "down": Ramp()}
    woven: dict[str, Profile] = {}
    for k, (name, profile) in enumerate(plan.items()):
        amplitude, period = getattr(weave, name)
        woven[name] = Sum((profile, Sinusoid(amplitude, period, float(k)))) if amplitude else profile
    return Trajectory(place, Driven(**woven, duration=duration), duration)


def still(place: Place, duration: float, *, heading: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> Trajectory:
    """Return a vehicle at rest on the Earth."""
    return driven(place, duration, forward=Ramp(), heading=Ramp(heading), pitch=Ramp(pitch), roll=Ramp(roll), weave=Weave())


def straight(place: Place, duration: float, *, speed: float, heading: float = 0.0, weave: Weave = GENTLE) -> Trajectory:
    """Return a straight line of the tangent frame (it rises from the ellipsoid by s^2 / 2R: 8 cm at 1 km)."""
    return driven(place, duration, forward=Ramp(speed), heading=Ramp(heading), pitch=Ramp(), weave=weave)


def circle(place: Place, duration: float, *, speed: float, radius: float, heading: float = 0.0, weave: Weave = GENTLE) -> Trajectory:
    """Return a circle to starboard (radius > 0) or to port (radius < 0), starting on `heading`."""
    return driven(place, duration, forward=Ramp(speed), heading=Ramp(heading, speed / radius), pitch=Ramp(), weave=weave)


def figure_eight(
    place: Place, duration: float, *, speed: float, length: float, width: float, weave: Weave = GENTLE, heave: float = 0.5
) -> Trajectory:
    """Return a figure of eight in closed form: north length/2 sin(wt), east width/2 sin(2wt), at a mean of `speed` (m/s)."""
    phase = np.linspace(0, 2 * np.pi, 4096, endpoint=False)
    circuit = 2 * np.pi * np.mean(np.hypot(0.5 * length * np.cos(phase), width * np.cos(2 * phase)))
    period = float(circuit / speed)
    bob = Sum((Ramp(heave), Sinusoid(-heave, period / 3, np.pi / 2)))  # starts at rest, then goes down and comes back
    law = Path(Sinusoid(length / 2, period), Sinusoid(width / 2, period / 2), bob, Sinusoid(*weave.roll), Sinusoid(*weave.pitch))
    return Trajectory(place, law, duration)


@dataclass(frozen=True)
class Lawnmower:
    """A plan of parallel legs: lengths in m, times in s, angles in rad."""

    legs: int = 6
    length: float = 250.0
    spacing: float = 40.0  # between neighbouring legs; the first turn goes to starboard
    speed: float = 1.5
    heading: float = 0.0  # of the first leg
    surface_time: float = 60.0  # before the dive and along the first heading
    dive: float = 20.0  # metres down before the first leg
    dive_pitch: float = 0.3
    ascend: bool = False  # to the surface again after the last leg

    @property
    def turn_time(self) -> float:
        """Duration of the half turn that moves the vehicle sideways by one spacing."""
        return self.spacing / (self.speed * _step_mean(np.pi))

    def dive_times(self) -> tuple[float, float]:
        """Return the durations of one pitch manoeuvre and of the stretch at constant pitch between two."""
        manoeuvre = 10.0
        lost = 2 * manoeuvre * self.speed * _step_mean(self.dive_pitch)
        if lost > self.dive:
            raise InputError("Lawnmower", f"dives {self.dive} m, less than two pitch manoeuvres take ({lost:.1f} m)", "pitch less")
        return manoeuvre, (self.dive - lost) / (self.speed * np.sin(self.dive_pitch))


def _step_mean(angle: float) -> float:
    """Return the mean over one smooth step from 0 to `angle` of the sine."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    step = Steps((0.0,), (1.0,), (0.0, 1.0))(0.5 * (1 + nodes), 1)[0]
    return float(0.5 * weights @ np.sin(angle * step))


def survey(place: Place, plan: Lawnmower | None = None, *, duration: float | None = None, weave: Weave = GENTLE) -> Trajectory:
    """Return a lawnmower survey: surface, dive, legs joined by smooth half turns, and after the last leg straight on.

    `duration` (s) is by default that of the plan.
    """
    plan = plan or Lawnmower()
    manoeuvre, slope = plan.dive_times()
    leg, turn, down = plan.length / plan.speed, plan.turn_time, 2 * manoeuvre + slope
    first = plan.surface_time + down
    turns = tuple(first + leg + k * (leg + turn) for k in range(plan.legs - 1))
    last = first + plan.legs * leg + (plan.legs - 1) * turn
    headings = tuple(plan.heading + np.pi * (k % 2) for k in range(plan.legs))
    heading = Steps(turns, (turn,) * len(turns), headings) if turns else Ramp(plan.heading)
    dives = [(plan.surface_time, -plan.dive_pitch)] + ([(last, plan.dive_pitch)] if plan.ascend else [])
    starts = tuple(t for start, _ in dives for t in (start, start + manoeuvre + slope))
    pitches = (0.0, *(p for _, pitch in dives for p in (pitch, 0.0)))
    pitch = Steps(starts, (manoeuvre,) * len(starts), pitches)
    end = duration if duration is not None else last + (down if plan.ascend else 0.0)
    return driven(place, float(end), forward=Ramp(plan.speed), heading=heading, pitch=pitch, weave=weave)
