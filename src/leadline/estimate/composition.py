"""Composition: process model + sensors + nuisance priors + estimator -> layout, plan, parameters, workspaces.

Sizes are checked here, once: in a kernel, out of bounds is silent.  Addresses are valid in this process only, so a composition is
never saved; the state array is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import chi2

from leadline.core import compiled
from leadline.core.compiled import COMPONENTS, NUISANCES, SLOT_NUISANCE, WIDE
from leadline.data.errors import InputError
from leadline.estimate import plan as at
from leadline.models.layout import CLONE_ERROR, Layout
from leadline.models.view import TANGENT, VIEW_SIZE

if TYPE_CHECKING:
    import numpy.typing as npt

    from leadline.data.records import Array
    from leadline.models.nuisance import Nuisance
    from leadline.models.process import Process
    from leadline.models.sensor import Channel, Sensor


@dataclass(frozen=True)
class Slot:
    """A channel in its place: the number that events carry."""

    sensor: str
    channel: Channel
    gate_probability: float


class Composition:
    """All that a navigator consists of, but for its state.

    Raises InputError where the state would be too large, where equal nuisance names have different priors, and where a sensor
    requires what the process model does not define.
    """

    def __init__(self, process: Process, sensors: tuple[Sensor, ...], estimator: Any, clones: int) -> None:
        """Compose; `estimator` is a module with the kernels propagate, points and update."""
        self.process, self.sensors, self.estimator = process, sensors, estimator
        self.slots = tuple(Slot(s.config.name, c, s.config.gate_probability) for s in sensors for c in s.channels)
        for slot in self.slots:
            _check(slot, process)
            if slot.channel.epochs == 2 and clones == 0:
                where = f"sensors.{slot.sensor}"
                raise InputError(where, "looks at an earlier pose, and there are no clones", "set process.clones to 1 or more")
        self.layout = Layout(process.parts, _states(self.slots), clones, len(self.slots))
        self.first_slot = dict(zip((s.config.name for s in sensors), _starts(sensors), strict=True))
        self.params, self.plan = self._compile()
        self.drift_bounding = np.array([slot.channel.bounds_drift for slot in self.slots], bool)

    def _compile(self) -> tuple[Array, npt.NDArray[np.int64]]:
        """Lay out parameters and plan."""
        params: list[float] = [*self.process.parameters]
        plan = np.zeros(at.CHANNEL + at.CHANNEL_SIZE * max(1, len(self.slots)), np.int64)
        plan[: len(self.layout.head())] = self.layout.head()
        plan[at.STEP_AT : at.PROPAGATE_AT] = [compiled.address(*pair) for pair in self.process.kernels()]
        contracts = (compiled.PROPAGATE, compiled.POINTS, compiled.UPDATE)
        names = ("propagate", "points", "update")
        plan[at.PROPAGATE_AT : at.MOTION_PARAMS] = [
            compiled.address(getattr(self.estimator, n), c) for n, c in zip(names, contracts, strict=True)
        ]
        plan[at.MOTION_PARAMS], plan[at.MOTION_END], plan[at.DECAY_PARAMS] = 0, len(params), len(params)
        for state in self.layout.nuisances:
            params += [state.rate, state.density]
        plan[at.LONGEST_STEP] = len(params)
        params.append(self.process.longest_step)
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
        params.append(float(chi2.ppf(slot.gate_probability, len(channel.components))))
        row[SLOT_NUISANCE : SLOT_NUISANCE + len(channel.nuisances)] = [self.layout.nuisance_error(n.name) for n in channel.nuisances]


class Workspace:
    """The arrays that the loop works in: allocated once."""

    def __init__(self, layout: Layout) -> None:
        """Allocate for a layout."""
        width = max(WIDE, 2 * TANGENT)
        self.work = np.zeros(3 * WIDE * WIDE)
        self.points = np.zeros((2 * TANGENT + 2, width))
        self.V, self.N = np.zeros((1, 2 * VIEW_SIZE)), np.zeros((1, NUISANCES))
        self.Z, self.R = np.zeros((1, COMPONENTS)), np.zeros((COMPONENTS, COMPONENTS))
        self.Hv, self.Hn = np.zeros((COMPONENTS, 2 * TANGENT)), np.zeros((COMPONENTS, NUISANCES))
        self.scratch = np.zeros(layout.size)

    @property
    def arrays(self) -> tuple[Array, ...]:
        """The arrays in the order in which `loop.run` takes them."""
        return self.work, self.points, self.V, self.N, self.Z, self.R, self.Hv, self.Hn, self.scratch


def output_size(layout: Layout) -> int:
    """Return how many numbers one output holds."""
    return at.OUT_X + layout.motion_nominal + len(layout.nuisances) + layout.fixed


def room_for_clones(process: Process, sensors: tuple[Sensor, ...]) -> int:
    """Return how many clones fit beside the motion and the nuisances of sensors; at least one is always asked for."""
    slots = tuple(Slot(s.config.name, c, s.config.gate_probability) for s in sensors for c in s.channels)
    fixed = sum(part.size for part in process.parts) + len(_states(slots))
    return max(1, (WIDE - fixed) // CLONE_ERROR)


def _starts(sensors: tuple[Sensor, ...]) -> list[int]:
    return [sum(len(s.channels) for s in sensors[:i]) for i in range(len(sensors))]


def _states(slots: tuple[Slot, ...]) -> tuple[Nuisance, ...]:
    """The nuisances that are states, each once; equal names must have equal priors."""
    found: dict[str, Nuisance] = {}
    for slot in slots:
        for nuisance in slot.channel.nuisances:
            known = found.setdefault(nuisance.name, nuisance)
            if known != nuisance:
                raise InputError(f"nuisance {nuisance.name}", "has two different priors", "equal names are one state: give one prior")
    return tuple(n for n in found.values() if n.sigma > 0.0 or n.density > 0.0)


def _check(slot: Slot, process: Process) -> None:
    """Refuse what does not fit, in one sentence."""
    where = f"sensors.{slot.sensor}"
    if missing := slot.channel.requires - process.defines:
        raise InputError(where, f"needs {', '.join(sorted(missing))}", f"which process model '{process.name}' does not define")
    for count, most, what in (
        (len(slot.channel.components), COMPONENTS, "components"),
        (len(slot.channel.nuisances), NUISANCES, "nuisances"),
    ):
        if count > most:
            raise InputError(where, f"has {count} {what} in one measurement", f"at most {most}")
