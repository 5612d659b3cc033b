"""THE state layout: which number of the state is what.  No other file holds an integer index into a composed state.

A state is a flat array: time, active size, the input in force, the epochs of clones, when each channel was last used and how often in a
row it has been rejected, the nominal state x, and the covariance P (rows of constant length).  So a checkpoint is a copy, and whatever
runs live runs offline.

    x      = [motion | nuisances | clones]      error = [motion | nuisances | clones]

Motion belongs to the process model, nuisances to whoever brings them, clones are poses at earlier epochs (place and attitude) for
measurements that look at the vehicle twice.  Clones come last and only the active ones are carried: without any, they cost nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import WIDE, kernel
from leadline.core.earth import PLACE, move, offset
from leadline.core.rotation import exponential, load4, logarithm, product, store_quaternion
from leadline.data.errors import InputError
from leadline.models.nuisance import AXES

if TYPE_CHECKING:
    import numpy.typing as npt

    from leadline.data.records import Array
    from leadline.models.nuisance import Nuisance

# The head of the integer array `plan`: sizes, and the blocks of which motion and nuisances consist (kind, nominal, error, length).
MOTION, NOMINAL, NUISANCES_N, CLONES, ERROR, X, COV, CHANNELS_N, BLOCK_COUNT, BLOCK = range(10)
BLOCK_SIZE, MOST_BLOCKS = 4, 12
LAYOUT_END = BLOCK + BLOCK_SIZE * MOST_BLOCKS

# The head of the float array `state`.
TIME, ACTIVE, INPUT, INPUTS, CLONE_TIME, MOST_CLONES = 0, 1, 2, 16, 18, 4
NOW_U = INPUTS - 1  # place in an input of the moment at hand (s): the start of a step, or that of a view
BEGUN = CLONE_TIME + MOST_CLONES  # when the run began
LAST_USED = BEGUN + 1  # then, also by channel, the number of rejections in a row, and by how much its noise has been found larger
BY_CHANNEL = 3  # numbers of each channel
CLONE_NOMINAL, CLONE_ERROR = PLACE + 4, 6


class Block(IntEnum):
    """What kind of space a block of the state lives in."""

    VECTOR = 0  # as many errors as numbers
    PLACE = 1  # navigation frame and height: 5 numbers, 3 errors in metres
    ATTITUDE = 2  # quaternion: 4 numbers, 3 errors as rotation vector on the left


VECTOR_BLOCK, PLACE_BLOCK, ATTITUDE_BLOCK = (int(b) for b in Block)


@dataclass(frozen=True)
class Part:
    """One named part of a process model's state."""

    name: str
    block: Block
    size: int  # errors
    unit: str = ""
    frame: str = ""

    @property
    def nominal(self) -> int:
        """Numbers in the nominal state."""
        return {Block.VECTOR: self.size, Block.PLACE: PLACE, Block.ATTITUDE: 4}[self.block]

    @property
    def components(self) -> tuple[str, ...]:
        """Names of its single errors."""
        return tuple(self.name + axis for axis in AXES[self.size])


@dataclass(frozen=True)
class Layout:
    """Sizes and names of a composed state."""

    motion: tuple[Part, ...]
    nuisances: tuple[Nuisance, ...]
    clones: int
    channels: int
    extra: int = 0  # numbers that an estimator keeps behind the covariance

    def __post_init__(self) -> None:
        """Refuse what the workspaces cannot hold: in a kernel, out of bounds is silent."""
        if self.error > WIDE:
            raise InputError(
                "composition",
                f"{self.error} error states: {self.motion_error} of motion, {len(self.nuisances)} nuisances, {self.clones} clones of 6",
                f"at most {WIDE}; estimate less, or lower `clones` in the vehicle file",
            )
        if self.clones > MOST_CLONES:
            raise InputError("composition", f"{self.clones} clones", f"at most {MOST_CLONES}")

    @property
    def motion_error(self) -> int:
        """Error states of the motion."""
        return sum(part.size for part in self.motion)

    @property
    def motion_nominal(self) -> int:
        """Numbers of the motion's nominal state."""
        return sum(part.nominal for part in self.motion)

    @property
    def fixed(self) -> int:
        """Error states without clones."""
        return self.motion_error + len(self.nuisances)

    @property
    def error(self) -> int:
        """Error states, all clones included."""
        return self.fixed + CLONE_ERROR * self.clones

    @property
    def nominal(self) -> int:
        """Numbers of the nominal state."""
        return self.motion_nominal + len(self.nuisances) + CLONE_NOMINAL * self.clones

    @property
    def x(self) -> slice:
        """Where the nominal state lies in the flat state."""
        start = LAST_USED + BY_CHANNEL * self.channels + 1  # then, by how much the process noise has been found larger
        return slice(start, start + self.nominal)

    @property
    def covariance(self) -> slice:
        """Where the covariance lies in the flat state: `error` rows of `WIDE` numbers."""
        return slice(self.x.stop, self.x.stop + self.error * WIDE)

    @property
    def size(self) -> int:
        """Length of the flat state."""
        return int(self.covariance.stop) + self.extra

    def nominal_of(self, name: str) -> slice:
        """Where a part of the motion lies in x."""
        return self._span(name, [part.nominal for part in self.motion])

    def error_of(self, name: str) -> slice:
        """Where the errors of a part of the motion lie."""
        return self._span(name, [part.size for part in self.motion])

    def _span(self, name: str, sizes: list[int]) -> slice:
        i = [part.name for part in self.motion].index(name)
        return slice(sum(sizes[:i]), sum(sizes[: i + 1]))

    def nuisance_error(self, name: str) -> int:
        """Index of the error of a nuisance state, or of a part of the motion that has its name; -1 if it is none."""
        names = [*shared_names(self.motion), *(nuisance.name for nuisance in self.nuisances)]
        return names.index(name) if name in names else -1

    def head(self) -> npt.NDArray[np.int64]:
        """Return the head of the plan."""
        plan = np.zeros(LAYOUT_END, np.int64)
        parts = _joined([*self.motion, Part("nuisances", Block.VECTOR, len(self.nuisances))])
        sizes = (self.motion_error, self.motion_nominal, len(self.nuisances), self.clones, self.error, self.x.start, self.covariance.start)
        plan[:BLOCK] = *sizes, self.channels, len(parts)
        nominal = error = 0
        for i, part in enumerate(parts):
            plan[BLOCK + BLOCK_SIZE * i :][:BLOCK_SIZE] = part.block, nominal, error, part.size
            nominal, error = nominal + part.nominal, error + part.size
        return plan

    def start(self, time: float, x: Array, covariance: Array) -> Array:
        """Return the flat state of a start: motion and nuisances as given, no clone, no channel used yet."""
        state = np.zeros(self.size)
        state[TIME], state[ACTIVE] = time, self.fixed
        state[CLONE_TIME : CLONE_TIME + MOST_CLONES], state[BEGUN] = np.nan, time
        state[LAST_USED : LAST_USED + self.channels] = -np.inf
        state[LAST_USED + (BY_CHANNEL - 1) * self.channels : self.x.start] = 1.0
        values = np.concatenate([x, [nuisance.value for nuisance in self.nuisances]])
        state[self.x.start : self.x.start + len(values)] = values
        full = state[self.covariance].reshape(self.error, WIDE)
        m = self.motion_error
        full[:m, :m] = covariance
        for i, nuisance in enumerate(self.nuisances):
            full[m + i, m + i] = nuisance.sigma**2
        for clone in range(self.clones):  # unused quaternions stay valid ones
            at = self.x.start + self.motion_nominal + len(self.nuisances) + CLONE_NOMINAL * clone
            state[at] = state[at + PLACE] = 1.0
        return state


def shared_names(motion: tuple[Part, ...]) -> list[str]:
    """Return the names of the motion's errors, one by one, as sensors may ask for them."""
    return [name for part in motion for name in part.components]


def _joined(parts: list[Part]) -> list[Part]:
    """Parts with neighbouring vectors as one: what moves alike is one block."""
    joined: list[Part] = []
    for part in parts:
        if joined and joined[-1].block == part.block == Block.VECTOR:
            joined[-1] = Part(joined[-1].name, Block.VECTOR, joined[-1].size + part.size)
        else:
            joined.append(part)
    return joined


@kernel()
def _retract_pose(x, at, d, error):
    """Retract a place followed by a quaternion, as in a clone."""
    move(x, at, d[error], d[error + 1], d[error + 2])
    q = product(exponential(d[error + 3], d[error + 4], d[error + 5]), load4(x, at + PLACE))
    store_quaternion(x, at + PLACE, q)


@kernel()
def retract(plan, x, d, n):
    """X <- x [+] d for the first n errors of a composed state."""
    for b in range(plan[BLOCK_COUNT]):
        at = BLOCK + BLOCK_SIZE * b
        nominal, error = plan[at + 1], plan[at + 2]
        if plan[at] == VECTOR_BLOCK:
            for i in range(plan[at + 3]):
                x[nominal + i] += d[error + i]
        elif plan[at] == PLACE_BLOCK:
            move(x, nominal, d[error], d[error + 1], d[error + 2])
        else:
            q = product(exponential(d[error], d[error + 1], d[error + 2]), load4(x, nominal))
            store_quaternion(x, nominal, q)
    nominal, error = plan[NOMINAL] + plan[NUISANCES_N], plan[MOTION] + plan[NUISANCES_N]
    while error < n:
        _retract_pose(x, nominal, d, error)
        nominal += CLONE_NOMINAL
        error += CLONE_ERROR


@kernel()
def difference(plan, x, y, d):
    """D = x [-] y, in the tangent space at y, for motion and nuisances."""
    for b in range(plan[BLOCK_COUNT]):
        at = BLOCK + BLOCK_SIZE * b
        nominal, error = plan[at + 1], plan[at + 2]
        if plan[at] == VECTOR_BLOCK:
            for i in range(plan[at + 3]):
                d[error + i] = x[nominal + i] - y[nominal + i]
        elif plan[at] == PLACE_BLOCK:
            d[error], d[error + 1], d[error + 2] = offset(x, nominal, y, nominal)
        else:
            p = (y[nominal], -y[nominal + 1], -y[nominal + 2], -y[nominal + 3])
            q = product(load4(x, nominal), p)
            d[error], d[error + 1], d[error + 2] = logarithm(q[0], q[1], q[2], q[3])
