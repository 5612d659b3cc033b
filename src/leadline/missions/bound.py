"""The Cramér-Rao bound of a mission: what no filter can beat that is given this vehicle's instruments on this trajectory.

The composition's models are evaluated along the truth: transition and process noise between measurements (`push` of the identity
and `noise`, at a nominal state that the ideal log carries along the truth), and each sensor's Jacobian and covariance at the true
view.  On these runs the information recursion of assess/bound.py, which shares nothing with the filter's covariance.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from leadline.assess.bound import bound
from leadline.core.attitude import matrix_from_euler, matrix_from_quaternion, quaternion_from_matrix
from leadline.core.compiled import COMPONENTS, NUISANCES, WIDE
from leadline.core.geodesy import rotation_en
from leadline.data.errors import InputError
from leadline.data.log import Datum, Log, Origin
from leadline.estimate import plan as at
from leadline.estimate.assembly import navigator_for
from leadline.estimate.output import shifted
from leadline.estimate.stream import stream_of
from leadline.models.layout import INPUTS, NOW_U
from leadline.models.process import Pose
from leadline.models.view import RATE_T, RATE_VARIANCE_V, TANGENT, VIEW_SIZE
from leadline.simulate.dive import StartSigmas, initial
from leadline.simulate.instruments import Dvl

if TYPE_CHECKING:
    from collections.abc import Iterator

    from leadline.data import records
    from leadline.data.log import Initial
    from leadline.data.records import Array, Table
    from leadline.data.vehicle import Vehicle
    from leadline.estimate.composition import Composition
    from leadline.simulate.dive import Recorder
    from leadline.simulate.trajectory import Kinematics, Trajectory

    Step = tuple[Array, Array, list[tuple[Array, Array]]]

ANCHOR = 10.0  # s between returns of the nominal state to the truth


def ideal_log(recorder: Recorder) -> Log:
    """Return the log that instruments without noise would leave, with an exact start that still states its sigmas."""
    place = recorder.trajectory.place
    return Log(
        name=recorder.name,
        tables={name: _ideal(recorder, name) for name in recorder.instruments} | {"truth": recorder.truth},
        epoch=recorder.epoch,
        origin=Origin(place.latitude, place.longitude),
        datum=Datum(geoid_undulation=place.surface_height),
        initial=exact_start(recorder.trajectory, recorder.start),
        beacons=recorder.beacons,
    )


def _ideal(recorder: Recorder, name: str) -> Table:
    """The table of an instrument without errors; a Doppler log's beams are made where its errors would be."""
    instrument, table = recorder.instruments[name], recorder.ideal(name)
    if not isinstance(instrument, Dvl):
        return table
    exact = replace(instrument, sigma=0.0, sigma_scale=0.0, sigma_mounting=0.0, beam_sigma=0.0, beam_loss=0.0)
    return exact.noisy(cast("records.Dvl", table), np.random.default_rng(0))


def exact_start(trajectory: Trajectory, sigmas: StartSigmas) -> Initial:
    """Return the true start, with the sigmas that a drawn one would state."""
    exact = initial(trajectory, StartSigmas(0.0, 0.0, 0.0, 0.0, 0.0), np.random.default_rng(0))
    return replace(
        exact, sigma_position=sigmas.position, sigma_depth=sigmas.depth, sigma_velocity=sigmas.velocity,
        sigma_tilt=sigmas.tilt, sigma_heading=sigmas.heading,
    )  # fmt: skip


def bound_of(recorder: Recorder, vehicle: Vehicle, times: Array) -> Array:
    """Return the smallest covariance (times, 9, 9) of position, velocity and attitude of the body origin, north-east-down.

    times: ascending (s).  All nuisance states are estimated beside.  Raises InputError for a sensor that looks at two epochs.
    """
    log = ideal_log(recorder)
    navigator, _, context = navigator_for(log, vehicle)
    stream = stream_of(log, vehicle, navigator, times=times)
    walk = Walk(navigator.composition, recorder.trajectory, navigator.state.copy())
    layout = navigator.composition.layout
    covariance = navigator.state[layout.covariance].reshape(-1, WIDE)[: layout.fixed, : layout.fixed].copy()
    reached, views = [], []
    for steps, view, pose in walk.legs(stream.events):
        covariance = bound(covariance, steps)[-1]
        reached.append(pose @ covariance @ pose.T)
        views.append(view)
    return shifted(np.array(views), np.array(reached), -context.reference_b)[5]


@dataclass
class Walk:
    """The nominal state on its way along the truth, and the transition and noise gathered since the last measurement."""

    composition: Composition
    trajectory: Trajectory
    state: Array
    u: Array = field(default_factory=lambda: np.zeros(INPUTS))
    memory: Array = field(default_factory=lambda: np.zeros(WIDE * WIDE))
    anchored: float = -np.inf

    def __post_init__(self) -> None:
        """Start where the navigator would."""
        layout, process = self.composition.layout, self.composition.process
        self.n, self.m, self.time = layout.fixed, layout.motion_error, float(self.state[0])
        self.x = self.state[layout.x][: layout.motion_nominal].copy()
        self.values = np.array([nuisance.value for nuisance in layout.nuisances])
        self.rates = np.array([nuisance.rate for nuisance in layout.nuisances])
        self.densities = np.array([nuisance.density for nuisance in layout.nuisances])
        self.longest = process.longest_step
        self._fresh()

    def _fresh(self) -> None:
        self.transition, self.noise = np.eye(WIDE), np.zeros((WIDE, WIDE))

    def legs(self, events: Any) -> Iterator[tuple[list[Step], Array, Array]]:
        """Yield for each output the steps of the recursion since the output before, the view at it, and its Jacobian (9, n)."""
        steps: list[Step] = []
        for e in range(len(events)):
            kind, row = int(events.kind[e]), events.data[events.start[e] : events.stop[e]]
            self._advance(float(events.time[e]))
            if kind == at.IS_INPUT:
                self.u[: len(row)] = np.where(np.isnan(row), self.u[: len(row)], row)
            elif kind == at.IS_OUTPUT:
                steps.append(self._step([]))
                yield steps, *self._pose()
                steps = []
            elif kind >= 0:
                steps.append(self._step([self._look(kind, row)]))
            else:
                raise InputError("bound", "a sensor looks at two epochs", "leave it out: the recursion holds no pose of before")

    def _advance(self, time: float) -> None:
        while self.time < time:
            dt = min(time - self.time, self.longest)
            self.u[NOW_U] = self.time
            self._move(dt)
            self.time = time if time - self.time <= self.longest else self.time + dt
        self.u[NOW_U] = self.time
        if self.time >= self.anchored + ANCHOR:
            self._anchor()

    def _move(self, dt: float) -> None:
        """One step: A <- Phi A, Q <- Phi Q Phi^T + noise, with decaying nuisances beside the motion."""
        process, p = self.composition.process, self.composition.process.parameters
        process.step(self.x, self.u, dt, p, self.memory)
        decay = np.exp(-self.rates * dt)
        self.transition = self._pushed(self.transition, dt, decay)
        noise = self._pushed(np.ascontiguousarray(self._pushed(self.noise, dt, decay).T), dt, decay)
        process.noise(self.memory, dt, p, noise.reshape(-1))
        nuisance = np.arange(self.m, self.n)
        noise[nuisance, nuisance] += self.densities * dt
        self.noise = noise

    def _pushed(self, matrix: Array, dt: float, decay: Array) -> Array:
        """Phi B for a matrix (WIDE, WIDE): the process model's part, and nuisances that decay by themselves."""
        result = np.zeros((WIDE, WIDE))
        self.composition.process.push(self.memory, dt, self.composition.process.parameters, matrix.reshape(-1), result.reshape(-1), WIDE)
        result[self.m : self.n] = decay[:, None] * matrix[self.m : self.n]
        return result

    def _step(self, measurements: list[tuple[Array, Array]]) -> Step:
        """Hand over what was gathered."""
        gathered = self.transition[: self.n, : self.n], self.noise[: self.n, : self.n], measurements
        self._fresh()
        return gathered

    def _view(self) -> Array:
        view = np.zeros(VIEW_SIZE)
        self.composition.process.view(self.x, self.u, self.composition.process.parameters, view)
        return view

    def _pose(self) -> tuple[Array, Array]:
        """The view, and the Jacobian (9, n) of its position, velocity and attitude."""
        view, process = self._view(), self.composition.process
        unit, jacobian = np.zeros((9, 2 * TANGENT)), np.zeros((9, WIDE))
        unit[:, :9] = np.eye(9)
        process.pull(self.x, self.u, process.parameters, view, unit, jacobian, 9)
        return view, jacobian[:, : self.n]

    def _look(self, kind: int, row: Array) -> tuple[Array, Array]:
        """Jacobian (c, n) and covariance (c, c) of a channel at the truth."""
        channel, process, layout = self.composition.slots[kind].channel, self.composition.process, self.composition.layout
        view, count = self._view(), len(channel.components)
        index = [layout.nuisance_error(nuisance.name) for nuisance in channel.nuisances]
        known = np.array([nuisance.value for nuisance in channel.nuisances] + [0.0] * (NUISANCES - len(index)))
        z, noise = np.zeros(COMPONENTS), np.zeros((COMPONENTS, COMPONENTS))
        by_view, by_nuisance = np.zeros((COMPONENTS, 2 * TANGENT)), np.zeros((COMPONENTS, NUISANCES))
        channel.predict(view, known, row, channel.parameters, z, noise, by_view, by_nuisance)
        by_rate = by_view[:, RATE_T : RATE_T + 3]
        noise += view[RATE_VARIANCE_V] * by_rate @ by_rate.T  # the gyro's noise at the end of a lever arm
        jacobian = np.zeros((COMPONENTS, WIDE))
        process.pull(self.x, self.u, process.parameters, view, by_view, jacobian, count)
        for k, i in enumerate(index):
            if i >= 0:
                jacobian[:, i] += by_nuisance[:, k]
        return jacobian[:count, : self.n], noise[:count, :count]

    def _anchor(self) -> None:
        """Bring the motion back to the truth, in the navigation frame as it has wandered by now."""
        layout, process = self.composition.layout, self.composition.process
        part: Kinematics = self.trajectory.at(self.time).point(process.reference_b)
        latitude, longitude, height = (float(v[0]) for v in part.geodetic)
        place = matrix_from_quaternion(self.x[layout.nominal_of("position")][:4])
        wander = np.arctan2(-place[2, 1], place[2, 0])
        rotation = rotation_en(latitude, longitude) @ matrix_from_euler(0.0, 0.0, wander)
        self.x[:] = process.begin(
            Pose(
                quaternion_from_matrix(rotation),
                height,
                rotation.T @ part.velocity_e[0],
                quaternion_from_matrix(rotation.T @ part.rotation_eb[0]),
                part.rate_eb_b[0],
                np.zeros((9, 9)),
                self.time,
            )
        )[0]
        self.anchored = self.time
