"""A voyage: a hull, steered along a plan through a sea, becomes a trajectory; the loop that is closed on truth.

Ten times a second the pilot looks and commands; in between the body is integrated in steps of 20 ms.  Each look leaves a knot of the
trajectory (dense.py), so that instruments see one smooth motion.  The loop is compiled; `Voyage.tick` runs it a stretch at a time, with
whatever the pilot is to believe in the place of the truth.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.attitude import matrix_from_euler, matrix_from_quaternion, quaternion_from_matrix
from leadline.core.geodesy import (
    ecef_from_geodetic,
    from_north_east,
    meridian_arc,
    rotation_en,
)
from leadline.data.errors import InputError
from leadline.simulate import steering
from leadline.simulate.dense import ACCELERATION, POSITION, QUATERNION, RATE, VELOCITY, WIDTH, Dense
from leadline.simulate.dynamics import ACTUATORS, NU, at_rest, site_at
from leadline.simulate.pilot import Pilot
from leadline.simulate.routes import ALTITUDE, EAST, NORTH, VERTICAL, between, duration_of
from leadline.simulate.sailing import AGROUND, LOST, OFF_DEPTH, ON, PATIENCE, STUCK, TICK, TIME_UP, TOLERANCE, sail
from leadline.simulate.trajectory import Trajectory

if TYPE_CHECKING:
    from collections.abc import Callable

    from leadline.data.hull import Hull
    from leadline.data.records import Array
    from leadline.sea.terrain import Chart
    from leadline.simulate.routes import Plan
    from leadline.simulate.trajectory import Place

STRETCH = 600  # ticks that are run at a time: a minute
LEAD, TAIL = 10, 100  # ticks before time 0 and after the end, so that an interval or an echo there is whole
LONGEST = 7 * 86400.0  # s that a plan may take which nobody has given an end


@dataclass(eq=False)
class Voyage:
    """A vehicle under way.

    place: the origin of north and east, of depths and of t, with its water; the plan says where the vehicle starts, at `depth` (m),
    `heading` (rad) and `speed` (m/s).  chart: the ground, or None: none anywhere.  Raises InputError where the hull cannot follow the plan,
    or the ground is in the way.
    """

    hull: Hull
    plan: Plan
    place: Place
    chart: Chart | None = None
    depth: float = 0.0
    heading: float = 0.0
    speed: float = 0.0
    density: float = 1025.0
    limit: float | None = None  # s after which it ends, whatever the plan says
    ticks: int = 0
    ended: int = ON
    over: int = 0  # tick at which it ended; 0: it has not
    knots: list[Array] = field(default_factory=list)
    moved: list[Array] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Work out what the kernels read."""
        self.pilot = Pilot(self.hull)
        self.pilot.check(self.plan)
        self.route = self.plan.route
        self.check_ground()
        self.parameters = self.pilot.parameters(self.plan)
        place = self.place
        home = [place.surface_height, 0.0, place.longitude, float(meridian_arc(place.latitude))]
        self.frame = np.concatenate([place.position_e, place.rotation_et.ravel(), home])
        self.grid = np.full((2, 2), np.nan) if self.chart is None else self.chart.depth
        self.corner = np.array([0.0, 0.0, 1.0, 1.0]) if self.chart is None else self.chart.frame
        self.site = site_at(place.latitude, place.depth, self.density)
        self.x = self.start()
        self.knots, self.moved = [self.before()], [np.tile(self.x[ACTUATORS:], (LEAD, 1))]
        if self.limit is None and self.expected > LONGEST:
            raise InputError("plan", f"takes {self.expected / 3600:.0f} h", "a shorter one, or duration_s")
        self.memory = np.zeros(steering.MEMORY)
        self.work = np.zeros(6 * self.hull.states)
        self.state = np.zeros(20 + self.hull.states - ACTUATORS)

    def start(self) -> Array:
        """Return the state at time 0."""
        place = self.place
        latitude, longitude = from_north_east(*self.plan.start, place.latitude, place.longitude)
        height = place.surface_height + float(place.water.level(np.zeros(1))[0]) - self.depth
        turn = place.rotation_et.T
        position = turn @ (ecef_from_geodetic(latitude, longitude, height) - place.position_e)
        rotation_tb = turn @ rotation_en(latitude, longitude) @ matrix_from_euler(0.0, 0.0, self.heading)
        nu = np.array([self.speed, 0.0, 0.0, 0.0, 0.0, 0.0])
        x = at_rest(self.hull, position, quaternion_from_matrix(rotation_tb), nu)
        x[ACTUATORS : ACTUATORS + len(self.hull.thrusters)] = self.pilot.turning(self.speed)
        return x

    def before(self) -> Array:
        """Return the knots of the second before time 0: straight on as it starts."""
        knots = np.zeros((LEAD, WIDTH))
        velocity = matrix_from_quaternion(self.x[3:7]) @ self.x[NU : NU + 3]
        knots[:, POSITION:VELOCITY] = self.x[:3] + TICK * np.arange(-LEAD, 0)[:, None] * velocity
        knots[:, VELOCITY:ACCELERATION], knots[:, QUATERNION:RATE] = velocity, self.x[3:7]
        return knots

    def check_ground(self) -> None:
        """Refuse a route that leads through the ground, follows one that is not there, or starts in the air."""
        if self.depth < -self.hull.height:
            raise InputError("start", f"lies {-self.depth:g} m above the surface", "depth_m of 0 or more")
        if self.chart is None:
            if np.any(self.route[:, ALTITUDE] > 0.0):
                raise InputError("plan", "follows the ground (altitude_m), and the sea has none", "add [sea.terrain], or give depth_m")
            return
        route = between(self.route, 5.0)
        ground = self.chart.depth_at(route[:, NORTH], route[:, EAST])
        low = np.flatnonzero((route[:, ALTITUDE] == 0.0) & (route[:, VERTICAL] >= ground))
        if len(low):
            n, e, wanted = (float(v) for v in route[low[0], [NORTH, EAST, VERTICAL]])
            found = f"leads to {wanted:g} m at north {n:.0f} m, east {e:.0f} m, where the ground lies at {ground[low[0]]:.1f} m"
            raise InputError("plan", found, "a lesser depth, or an altitude")
        blind = np.flatnonzero((route[:, ALTITUDE] > 0.0) & ~np.isfinite(ground))
        if len(blind):
            n, e = (float(v) for v in route[blind[0], [NORTH, EAST]])
            raise InputError("plan", f"follows the ground at north {n:.0f} m, east {e:.0f} m, where the chart knows none", "a larger chart")

    @property
    def expected(self) -> float:
        """How long (s) the plan takes, roughly."""
        stays = self.plan.stay
        surfacing = self.plan.surfacing
        whole = duration_of(self.route)
        if surfacing is not None and surfacing.stop:
            whole *= 1 + (surfacing.stay + 60.0) / surfacing.every
        return whole + stays + 120.0

    @property
    def time(self) -> float:
        """Time (s) of the next tick."""
        return self.ticks * TICK

    def tick(self, count: int, believed: Array | None = None) -> bool:
        """Run up to `count` ticks, on the truth or on what is believed (14 numbers, as steering.py's nav); return whether it goes on."""
        if self.ended != ON:
            return False
        if self.limit is not None:
            count = min(count, round(self.limit / TICK) + 1 - self.ticks)
        self.ended = self._sail(count, self.parameters, np.zeros(0) if believed is None else believed)
        if self.ended == ON and self.limit is not None and self.ticks > round(self.limit / TICK):
            self.ended = TIME_UP
        return self.ended == ON

    def _sail(self, count: int, pilot: Array, believed: Array) -> int:
        knots, moved = np.empty((count, WIDTH)), np.empty((count, self.hull.states - ACTUATORS))
        arrays = (self.hull.parameters, self.site, self.place.water.parameters, self.frame, self.grid, self.corner)
        steered = (self.route, pilot, self.memory, believed, self.work)
        done, why = sail(self.ticks, count, self.x, *arrays, *steered, knots, moved, self.state)
        self.knots.append(knots[:done])
        self.moved.append(moved[:done])
        self.ticks += done
        return int(why)

    def run(self, progress: Callable[[float], None] | None = None) -> Trajectory:
        """Run to the end; raises InputError where the vehicle runs aground or does not get on."""
        while self.tick(STRETCH):
            if progress is not None:
                progress(min(self.time / (self.limit or self.expected), 0.99))
        return self.trajectory()

    def trajectory(self) -> Trajectory:
        """Return the trajectory so far; raises InputError where the voyage came to grief."""
        if self.ended in GRIEF:
            raise InputError("mission", self.grief(), GRIEF[self.ended])
        if self.ended != ON and not self.over:
            self.over = self.ticks
            patient = self.parameters.copy()
            patient[steering.AT_END] = np.inf
            self.memory[steering.BEST_FROM] = self.memory[steering.AT_DEPTH] = np.inf
            self._sail(TAIL, patient, np.zeros(0))
        knots = np.concatenate(self.knots)
        last = (self.over or self.ticks) - 1
        return Trajectory(self.place, Dense(-LEAD * TICK, TICK, np.ascontiguousarray(knots)), TICK * last)

    def grief(self) -> str:
        """Say where and when it ended before its end."""
        n, e, depth = self.state[1:4]
        leg = int(self.memory[steering.AT_LEG])
        found = f"at {self.time:.0f} s, in leg {leg}, {self.hull.name} at north {n:.0f} m, east {e:.0f} m, depth {depth:.1f} m"
        return f"{found} {WORDS[self.ended]}"

    def actuators(self) -> tuple[Array, Array]:
        """Return times (s) and speeds of thrusters (rps) and angles of fins (rad), as `hull.actuators` names them, at each tick."""
        moved = np.concatenate(self.moved)
        return np.asarray(TICK * (np.arange(len(moved)) - LEAD)), moved


WORDS = {
    AGROUND: "ran aground",
    STUCK: f"has not got on for {PATIENCE:.0f} s",
    OFF_DEPTH: f"has been off its depth by more than {TOLERANCE:.0f} m for {PATIENCE:.0f} s",
    LOST: "was lost: its motion is no longer finite",
}
GRIEF = {
    AGROUND: "plan less depth or more altitude there",
    STUCK: "a current that it can stem, a speed that it can make, corners that it can turn",
    OFF_DEPTH: "a depth that it can reach at that speed, in water of the density that it is ballasted for",
    LOST: "check the hull file",
}
