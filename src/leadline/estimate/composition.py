"""Composition: process model + sensors + nuisance priors + estimator -> layout, plan, parameters, workspaces.

Sizes are checked here, once: in a kernel, out of bounds is silent.  Addresses are valid in this process only, so a composition is
never saved; the state array is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import gammaincinv

from leadline.core import compiled
from leadline.core.compiled import COMPONENTS, NUISANCES, SLOT_NUISANCE, WIDE
from leadline.data.errors import InputError
from leadline.estimate import plan as at
from leadline.models.layout import CLONE_ERROR, Layout, shared_names
from leadline.models.view import TANGENT, VIEW_SIZE

if TYPE_CHECKING:
    import numpy.typing as npt

    from leadline.data.records import Array
    from leadline.data.vehicle import SensorConfig
    from leadline.estimate.estimator import Estimator
    from leadline.models.nuisance import Nuisance
    from leadline.models.process import Process
    from leadline.models.sensor import Channel, Sensor


WORK = 20 * WIDE * WIDE  # numbers that an estimator may work in
# What displaces the views of a channel: its place in the plan, and that of its values behind GATE.
DISPLACING = {"time": at.TIME_S, "offset": at.OFFSET_S, "drift": at.DRIFT_S, "lever": at.LEVER_S}
DISPLACING_VALUE = {"time": at.TIME_P, "offset": at.OFFSET_P, "drift": at.DRIFT_P, "lever": at.LEVER_P}


@dataclass(frozen=True)
class Slot:
    """A channel in its place: the number that events carry."""

    config: SensorConfig
    channel: Channel

    @property
    def sensor(self) -> str:
        """Name of the sensor."""
        return self.config.name

    @property
    def gate_probability(self) -> float:
        """Probability of a good measurement to pass the gate; with Student's t none is turned away."""
        return 1.0 if self.config.gate.student_dof else self.config.gate.probability


class Composition:
    """All that a navigator consists of, but for its state.

    Raises InputError where the state would be too large, where equal nuisance names have different priors, and where a sensor
    requires what the process model does not define.
    """

    def __init__(self, process: Process, sensors: tuple[Sensor, ...], estimator: Estimator, clones: int) -> None:
        """Compose."""
        self.process, self.sensors, self.estimator = process, sensors, estimator
        self.slots = slots_of(sensors)
        if estimator.linear and not process.linear:
            right = "take a linear one (planar), or another estimator (ekf, ukf)"
            raise InputError("estimator", f"'{estimator.name}' wants linear models; process model '{process.name}' is none", right)
        for sensor in sensors:
            _check_epochs(sensor, estimator)
        for slot in self.slots:
            _check(slot, process, estimator, clones)
        layout = Layout(process.parts, states_of(self.slots, process), clones, len(self.slots))
        estimator.check(layout)
        self.layout = replace(layout, extra=estimator.extra(layout))
        self.first_slot = dict(zip((s.config.name for s in sensors), _starts(sensors), strict=True))
        self.slots_of = {
            s.config.name: range(self.first_slot[s.config.name], self.first_slot[s.config.name] + len(s.channels)) for s in sensors
        }
        self.params, self.plan = self._compile()
        self.drift_bounding = np.array([slot.channel.bounds_drift for slot in self.slots], bool)

    def _compile(self) -> tuple[Array, npt.NDArray[np.int64]]:
        """Lay out parameters and plan."""
        params: list[float] = [*self.process.parameters]
        plan = np.zeros(at.CHANNEL + at.CHANNEL_SIZE * max(1, len(self.slots)), np.int64)
        plan[: len(self.layout.head())] = self.layout.head()
        plan[at.STEP_AT : at.PROPAGATE_AT] = [compiled.address(*pair) for pair in self.process.kernels()]
        plan[at.PROPAGATE_AT : at.SETTLE_AT] = [compiled.address(*pair) for pair in self.estimator.kernels()]
        if self.estimator.settle is not None:
            plan[at.SETTLE_AT] = compiled.address(self.estimator.settle, compiled.SETTLE)
        plan[at.ROOT] = self.estimator.root
        plan[at.MOTION_PARAMS], plan[at.MOTION_END], plan[at.DECAY_PARAMS] = 0, len(params), len(params)
        for state in self.layout.nuisances:
            params += [state.rate, state.density, state.per_metre, state.density_per_metre, state.value]
        plan[at.FIELDS] = sum(state.per_metre > 0.0 for state in self.layout.nuisances)
        plan[at.LONGEST_STEP] = len(params)
        params.append(self.process.longest_step)
        plan[at.ESTIMATOR] = len(params)
        params += [float(value) for value in self.estimator.parameters]
        for i, slot in enumerate(self.slots):
            row = plan[at.CHANNEL + at.CHANNEL_SIZE * i :][: at.CHANNEL_SIZE]
            self._compile_channel(row, params, slot)
        return np.array(params, float), plan

    def _compile_channel(self, row: npt.NDArray[np.int64], params: list[float], slot: Slot) -> None:
        channel = slot.channel
        is_kernel = compiled.is_kernel(channel.predict)
        row[at.SENSOR_AT] = compiled.address(channel.predict, compiled.SENSOR) if is_kernel else 0
        row[at.PARAMS], row[at.PARAMS_END] = len(params), len(params) + len(channel.parameters)
        params += [float(value) for value in channel.parameters]
        row[at.COMPONENTS_N], row[at.EPOCHS] = len(channel.components), channel.epochs
        row[at.ANGLES] = sum(1 << i for i, angle in enumerate(channel.angles) if angle)
        row[at.VALUES_N], row[at.VALUES] = len(channel.nuisances), len(params)
        params += [nuisance.value for nuisance in channel.nuisances]
        row[at.GATE] = len(params)
        params += _gate_parameters(slot)
        stands_for = self.slots_of.get(slot.config.standby_for or "", range(0))
        row[at.STANDBY_FIRST], row[at.STANDBY_END] = stands_for.start, stands_for.stop
        names = {name: nuisances for name, nuisances in slot.channel.displacing.items() if nuisances}
        row[at.DISPLACED] = any(n.value or self.layout.nuisance_error(n.name) >= 0 for nuisances in names.values() for n in nuisances)
        for name, place in DISPLACING.items():
            row[place] = self.layout.nuisance_error(names[name][0].name) if name in names else -1
            for i, nuisance in enumerate(names.get(name, ())):
                params[row[at.GATE] + DISPLACING_VALUE[name] + i] = nuisance.value
        row[SLOT_NUISANCE : SLOT_NUISANCE + len(channel.nuisances)] = [self.layout.nuisance_error(n.name) for n in channel.nuisances]


class Workspace:
    """The arrays that the loop works in: allocated once.  An empty tape records nothing."""

    def __init__(self, layout: Layout, count: int = 1) -> None:
        """Allocate for a layout, and an estimator that asks at so many points."""
        width = max(WIDE, 2 * TANGENT)
        self.work = np.zeros(WORK)
        self.points = np.zeros((2 * TANGENT + 2, width))
        self.V, self.N = np.zeros((count, 2 * VIEW_SIZE)), np.zeros((count, NUISANCES))
        self.Z, self.R = np.zeros((count, COMPONENTS)), np.zeros((COMPONENTS, COMPONENTS))
        self.Hv, self.Hn = np.zeros((COMPONENTS, 2 * TANGENT)), np.zeros((COMPONENTS, NUISANCES))
        self.scratch, self.tape = np.zeros(layout.size), np.zeros(0)

    @property
    def arrays(self) -> tuple[Array, ...]:
        """The arrays in the order in which `loop.run` takes them."""
        return self.work, self.points, self.V, self.N, self.Z, self.R, self.Hv, self.Hn, self.scratch, self.tape


def output_size(layout: Layout) -> int:
    """Return how many numbers one output holds."""
    return at.OUT_X + layout.motion_nominal + len(layout.nuisances) + layout.fixed


def room_for_clones(process: Process, sensors: tuple[Sensor, ...]) -> int:
    """Return how many clones fit beside the motion and the nuisances of sensors; at least one is always asked for."""
    slots = slots_of(sensors)
    fixed = sum(part.size for part in process.parts) + len(states_of(slots, process))
    return max(1, (WIDE - fixed) // CLONE_ERROR)


def slots_of(sensors: tuple[Sensor, ...]) -> tuple[Slot, ...]:
    """Return the channels of sensors in their places."""
    return tuple(Slot(sensor.config, channel) for sensor in sensors for channel in sensor.channels)


def _starts(sensors: tuple[Sensor, ...]) -> list[int]:
    return [sum(len(s.channels) for s in sensors[:i]) for i in range(len(sensors))]


def states_of(slots: tuple[Slot, ...], process: Process) -> tuple[Nuisance, ...]:
    """Return the nuisances that are states, each once; equal names must have equal priors.  What the motion holds itself is its own."""
    found: dict[str, Nuisance] = {}
    for slot in slots:
        for nuisance in (*slot.channel.nuisances, *(n for part in slot.channel.displacing.values() for n in part)):
            known = found.setdefault(nuisance.name, nuisance)
            if known != nuisance:
                raise InputError(f"nuisance {nuisance.name}", "has two different priors", "equal names are one state: give one prior")
    own = frozenset(shared_names(process.parts))
    return tuple(n for n in found.values() if n.name not in own and (n.sigma > 0.0 or n.density > 0.0 or n.density_per_metre > 0.0))


def _gate_parameters(slot: Slot) -> list[float]:
    """Parameters from GATE on (plan.py)."""
    gate, parameters = slot.config.gate, [0.0] * at.GATE_SIZE
    parameters[at.LIMIT] = 2.0 * float(gammaincinv(0.5 * len(slot.channel.components), slot.gate_probability))
    parameters[at.WIDENING], parameters[at.STUDENT_DOF] = gate.widening or 0.0, gate.student_dof or 0.0
    parameters[at.REANCHOR_AFTER] = float(gate.reanchor_after or 0)
    parameters[at.EVERY], parameters[at.STANDBY_AFTER] = slot.config.every, slot.config.standby_after
    parameters[at.NOISE_FACTOR] = 1.0
    return parameters


def _check_epochs(sensor: Sensor, estimator: Estimator) -> None:
    """Refuse a sensor that only ever looks at an earlier pose, where none is held."""
    if sensor.channels and not estimator.clones and all(channel.epochs == 2 for channel in sensor.channels):
        found, right = "looks at an earlier pose", f"estimator '{estimator.name}' holds none: leave it out, or take another (ekf, ukf)"
        raise InputError(f"sensors.{sensor.config.name}", found, right)


def _check(slot: Slot, process: Process, estimator: Estimator, clones: int) -> None:
    """Refuse what does not fit, in one sentence."""
    where = f"sensors.{slot.sensor}"
    if estimator.linear and not slot.channel.linear:
        found = f"measures {', '.join(slot.channel.components)}, which is not linear in the state"
        raise InputError(where, found, f"estimator '{estimator.name}' cannot use it: leave it out, or take another (ekf, ukf)")
    if slot.channel.epochs == 2 and not estimator.clones:
        return  # its rows find no pose, and say so
    if slot.channel.epochs == 2 and clones == 0:
        raise InputError(where, "looks at an earlier pose, and there are no clones", "set process.clones to 1 or more")
    if slot.channel.epochs == 2 and any(slot.channel.displacing.values()):
        raise InputError(where, "looks at an earlier pose, and has an unknown lever arm, time offset or clock", "give these no prior")
    if missing := slot.channel.requires - process.defines:
        raise InputError(where, f"needs {', '.join(sorted(missing))}", f"which process model '{process.name}' does not define")
    for count, most, what in (
        (len(slot.channel.components), COMPONENTS, "components"),
        (len(slot.channel.nuisances), NUISANCES, "nuisances"),
    ):
        if count > most:
            raise InputError(where, f"has {count} {what} in one measurement", f"at most {most}")
