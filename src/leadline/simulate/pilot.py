"""A pilot for a hull: gains and allocation, worked out from what the hull is, as the array that the kernels of steering.py read."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from leadline.data.errors import InputError
from leadline.simulate import steering as at
from leadline.simulate.dynamics import ACTUATORS, NU, accelerations, at_rest, site_at
from leadline.simulate.routes import SPEED

if TYPE_CHECKING:
    from leadline.data.hull import Hull
    from leadline.data.records import Array
    from leadline.simulate.routes import Plan

BANDS = (0.5, 0.5, 0.6, 1.0, 2.0, 2.0)  # 1/s of the inner loops, unless actuators or forces are too weak for them
OUTER = (0.0, 0.0, 0.25, 0.4, 0.4, 0.4)  # 1/s of the outer loops, at the bands above
ORDER = (0, 2, 5, 1, 4, 3)  # in which thrusters are given axes: surge, heave, yaw, sway, pitch, roll
BRISK = (0.3, 0.15, 0.15, 0.5, 0.5, 0.5)  # m/s or rad/s: a step that an inner loop should be able to answer at full force
PITCH_MAX, TURN_MAX = 0.35, 0.3  # rad, rad/s
QUICK = 0.35  # bandwidth of an inner loop, of the inverse lag of the actuators
RESERVE = 0.9  # of the top speed that a plan may ask for


@dataclass(frozen=True, eq=False)
class Pilot:
    """What steers a hull.

    hovers: it can stay where it is (thrusters turn it); otherwise it turns by fins, and must keep moving.
    """

    hull: Hull

    @cached_property
    def columns(self) -> Array:
        """Force and moment (6, thrusters) of each thruster for a thrust of one newton."""
        rows = [np.concatenate([t.direction_b, np.cross(t.position_b, t.direction_b)]) for t in self.hull.thrusters]
        return np.array(rows, float).reshape(-1, 6).T

    @cached_property
    def strength(self) -> Array:
        """Thrust (N) of each thruster at full speed the weaker way."""
        return np.array([min(t.ahead, t.astern) * t.most**2 for t in self.hull.thrusters], float)

    @cached_property
    def axes(self) -> tuple[int, ...]:
        """The axes (0 to 5) that thrusters can push independently, in the order of their importance."""
        chosen: list[int] = []
        scaled = self.columns * self.strength
        for axis in ORDER:
            row = scaled[axis]
            rest = row - (np.linalg.pinv(scaled[chosen]) @ scaled[chosen]).T @ row if chosen else row
            lever = 1.0 if axis < 3 else self.hull.length / 4
            if np.linalg.norm(rest) > 0.1 * lever * np.max(self.strength, initial=0.0) and not self._rights_itself(axis):
                chosen.append(axis)
        return tuple(chosen)

    @property
    def lag(self) -> float:
        """Lag (s) of the slowest actuator."""
        return max([*(t.lag for t in self.hull.thrusters), *(f.lag for f in self.hull.fins)], default=0.1)

    def _rights_itself(self, axis: int) -> bool:
        """Whether weight below buoyancy rights a roll or a pitch quicker than thrusters could: it is left to them."""
        if axis not in (at.ROLL, at.PITCH):
            return False
        below = self.hull.gravity_centre_b[2] - self.hull.buoyancy_centre_b[2]
        natural = np.sqrt(max(self.hull.mass * 9.81 * below, 0.0) / self.masses[axis])
        return bool(natural > 2 * min(BANDS[axis], QUICK / self.lag))

    @cached_property
    def shares(self) -> Array:
        """Thrusts (thrusters, 6) for a force of one in each axis: the least effort, each thruster in units of its strength."""
        shares, chosen = np.zeros((len(self.hull.thrusters), 6)), list(self.axes)
        if chosen:
            rows = self.columns[chosen]
            effort = self.strength**2
            shares[:, chosen] = (effort[:, None] * rows.T) @ np.linalg.inv((rows * effort) @ rows.T)
        return shares

    @cached_property
    def fin_moments(self) -> Array:
        """Pitch and yaw moment (2, fins) for one radian of each fin at one metre per second."""
        rows = [f.lift * np.cross(f.position_b, f.axis_b)[1:] for f in self.hull.fins]
        return np.array(rows, float).reshape(-1, 2).T

    @cached_property
    def fin_shares(self) -> Array:
        """Angles (fins, 2) at one metre per second for one newton metre of pitch and of yaw; zero where thrusters give it."""
        shares = np.linalg.pinv(self.fin_moments) if self.hull.fins else np.zeros((0, 2))
        for k, axis in enumerate((at.PITCH, at.YAW)):
            if axis in self.axes:
                shares[:, k] = 0.0
        return np.asarray(shares)

    @property
    def hovers(self) -> bool:
        """Whether thrusters can turn it and move it up and down without way on."""
        return at.YAW in self.axes and at.VERTICALLY in self.axes

    @cached_property
    def top_speed(self) -> float:
        """Speed (m/s) ahead through still water at full thrust."""
        x, site = at_rest(self.hull), site_at(0.5, depth=50.0)
        ahead = [t.most * float(np.sign(t.direction_b[0])) if abs(t.direction_b[0]) > 0.1 else 0.0 for t in self.hull.thrusters]
        x[ACTUATORS : ACTUATORS + len(ahead)] = ahead
        idle = np.zeros(self.hull.states - ACTUATORS)

        def pull(speed: float) -> float:
            moving = x.copy()
            moving[NU] = speed
            return float(accelerations(0.0, moving, idle, self.hull, site)[0])

        if pull(0.0) <= 0.0:
            return 0.0
        low, high = 0.0, 40.0
        for _ in range(60):  # halving: it is one number, and SciPy's optimisers take a third of a second to load
            middle = 0.5 * (low + high)
            low, high = (middle, high) if pull(middle) > 0.0 else (low, middle)
        return low

    def turning(self, speed: float) -> Array:
        """Return the speeds (rps) of the thrusters that roughly keep a speed (m/s) ahead through the water."""
        drag = self.hull.linear_damping[0, 0] * speed + self.hull.quadratic_damping[0] * speed * abs(speed)
        thrust = self.shares[:, 0] * drag
        along = [speed * float(t.direction_b[0]) for t in self.hull.thrusters]
        found = np.zeros(len(thrust))
        for i, (t, wanted) in enumerate(zip(self.hull.thrusters, thrust, strict=True)):
            if wanted:  # k n^2 - decay n u = T, the greater root
                k, lost = (t.ahead if wanted > 0 else t.astern), t.decay * abs(along[i])
                found[i] = np.sign(wanted) * min((lost + np.sqrt(lost**2 + 4 * k * abs(wanted))) / (2 * k), t.most)
        return found

    @property
    def side_speed(self) -> float:
        """Speed (m/s) sideways that a third of the force keeps up against the drag."""
        force, straight, square = 0.3 * self.forces[1], self.hull.linear_damping[1, 1], self.hull.quadratic_damping[1]
        if square > 0:
            return float((np.sqrt(straight**2 + 4 * square * force) - straight) / (2 * square))
        return float(force / straight) if straight > 0 else 1.0

    @cached_property
    def forces(self) -> Array:
        """Largest force (6,) in each axis that thrusters or fins (at top speed) give."""
        found = np.zeros(6)
        for axis in self.axes:
            found[axis] = 0.8 / np.max(np.abs(self.shares[:, axis]) / self.strength)
        for k, axis in enumerate((at.PITCH, at.YAW)):
            if axis not in self.axes and self.hull.fins:
                most = np.array([f.most for f in self.hull.fins])
                found[axis] = np.sum(np.abs(self.fin_moments[k]) * most) * self.top_speed**2
        return found

    @property
    def masses(self) -> Array:
        """Mass and inertia (6,) of each axis with what moves along."""
        return np.asarray(np.diag(self.hull.rigid_mass + self.hull.added_mass))

    @cached_property
    def bands(self) -> Array:
        """Bandwidth (1/s, 6) of the inner loops: not quicker than actuators follow, nor than the forces carry."""
        return np.array([
            min(band, QUICK / self.lag, max(force / (mass * brisk), 0.05)) if force > 0 else 0.0
            for band, force, mass, brisk in zip(BANDS, self.forces, self.masses, BRISK, strict=True)
        ])  # fmt: skip

    def check(self, plan: Plan) -> None:
        """Refuse a plan that this hull cannot follow; raises InputError."""
        route = plan.route
        fastest = float(route[:, SPEED].max())
        if fastest > RESERVE * self.top_speed:
            right = f"{RESERVE * self.top_speed:.2f} m/s or less"
            raise InputError("plan", f"asks for {fastest} m/s, and {self.hull.name} makes {self.top_speed:.2f} m/s at full thrust", right)
        if at.SIDE not in self.axes and any(leg.heading is not None for leg in plan.legs):
            found = f"asks {self.hull.name} for a heading of its own along the way, and it cannot push sideways"
            raise InputError("plan", found, "no heading_deg, or a hull with thrusters to the side")
        if not self.hovers:
            for leg in plan.legs:
                if leg.needs_hover:
                    found = f"'{leg.name}' asks {self.hull.name} to stay in one place, and it must keep moving to steer"
                    raise InputError("plan", found, "take a hull with thrusters that turn it, or a circle")
            if plan.surfacing is not None and plan.surfacing.stop:
                raise InputError("plan.surfacing", f"stops {self.hull.name}, which must keep moving to steer", "stop = false")

    def parameters(self, plan: Plan, deepest: float = 1e4) -> Array:
        """Return the flat array that the kernels read, for a plan (checked before); deepest: m that terrain following may reach."""
        hull, route, surfacing = self.hull, plan.route, plan.surfacing
        slowest = float(route[:, SPEED].min())
        descent = (0.25 if at.PITCH in self.axes else 0.15) if self.hovers else 0.7 * slowest * np.sin(PITCH_MAX)
        head = np.zeros(at.AXES)
        head[at.LOOKAHEAD] = max(2.0, 1.5 * hull.length) if self.hovers else 5 * hull.length
        head[at.ARRIVE] = max(0.4, 0.3 * hull.length) if self.hovers else 2.5 * hull.length
        head[at.ACCELERATION] = 0.1
        head[at.DESCENT], head[at.PITCH_MAX], head[at.TURN_MAX] = descent, PITCH_MAX, TURN_MAX
        head[at.SWAY], head[at.HEAVE], head[at.SPINS] = at.SIDE in self.axes, at.VERTICALLY in self.axes, self.hovers
        if surfacing is not None:
            head[at.EVERY], head[at.STAY], head[at.STOP] = surfacing.every, surfacing.stay, surfacing.stop
        head[at.ASCEND], head[at.AT_END] = plan.ascend, plan.stay
        head[at.AFLOAT], head[at.KEEL], head[at.DEEPEST] = hull.height, hull.height, deepest
        head[at.THRUSTERS], head[at.FINS], head[at.SIDE_MAX] = len(hull.thrusters), len(hull.fins), self.side_speed
        outer = np.array(OUTER) * np.where(self.bands > 0, self.bands / np.array(BANDS), 1.0)
        slow = np.where(np.isin(np.arange(6), self.axes), 0.3, 0.1)  # fins are weak at low speed: an integral would overshoot
        drags = np.diag(hull.linear_damping), hull.quadratic_damping
        axes = np.column_stack([self.masses, self.bands, outer, *drags, self.forces, slow])
        axes[3:, 3:5] = 0.0  # moments: the integral does it
        laws = [(t.ahead, t.astern, t.most, t.dead_band) for t in hull.thrusters]
        fins = [(*share, fin.most) for share, fin in zip(self.fin_shares, hull.fins, strict=True)]
        parts = (head, axes, self.shares, np.array(laws, float), np.array(fins, float))
        return np.concatenate([np.ravel(part) for part in parts])
