"""What can be tuned: the sigmas of a vehicle file that rows and process noise depend on, and where each of them acts.

Which rows a key acts on is found by trying: a sensor is asked for its rows once more with the key doubled, and what has changed is that
key's share of the variance.  So a sensor of one's own needs nothing of its own here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from leadline.calibrate.likelihood import Change
from leadline.data.records import Imu
from leadline.data.vehicle import si
from leadline.estimate import plan as at
from leadline.models.inertial import ACCEL_DENSITY, BA_DENSITY, BG_DENSITY, GYRO_DENSITY, PARAMETERS
from leadline.models.sensor import Context
from leadline.models.sensors import compose

if TYPE_CHECKING:
    from collections.abc import Sequence

    from leadline.calibrate.likelihood import Recording
    from leadline.data.records import Array
    from leadline.data.vehicle import SensorConfig, Vehicle
    from leadline.models.sensor import Rows

# Densities of the process model by the key that they come from; a bias that is a Gauss-Markov process has none of its own.
PROCESS = {
    "gyro_noise": GYRO_DENSITY,
    "accel_noise": ACCEL_DENSITY,
    "gyro_bias_instability": BG_DENSITY,
    "accel_bias_instability": BA_DENSITY,
}
TRIED = (2.0, 3.0)  # times a key


@dataclass(frozen=True)
class Knob:
    """One sigma to tune.  key: as the vehicle file writes it, or "" for a column of the table; value: what the file says, in its unit.

    part: components that a column is the sigma of.  slots: channels whose rows tell of it; stated: how many of these carry a sigma of
    their own, that no key moves.  process: whether it drives the motion.
    """

    sensor: str
    key: str
    value: float = float("nan")
    part: str = ""
    slots: tuple[int, ...] = ()
    stated: int = 0
    process: bool = False


def knobs_of(vehicle: Vehicle, recordings: Sequence[Recording], sensors: Sequence[str], *, process: bool) -> list[Knob]:
    """Return what can be tuned of the named sensors (an inertial unit: its noise), and let each recording know where it acts."""
    found: dict[tuple[str, str, str], Knob] = {}
    by_log: list[dict[tuple[str, str, str], list[Change]]] = []
    for recording in recordings:
        own = {}
        for knob, changes in _in_log(vehicle, recording, sensors, process):
            name = knob.sensor, knob.key, knob.part
            known = found.get(name, replace(knob, stated=0))
            found[name] = replace(known, slots=tuple(sorted({*known.slots, *knob.slots})), stated=known.stated + knob.stated)
            own[name] = changes
        by_log.append(own)
    for recording, own in zip(recordings, by_log, strict=True):
        recording.hold([own.get(name, []) for name in found])
    return list(found.values())


def _in_log(vehicle: Vehicle, recording: Recording, sensors: Sequence[str], process: bool) -> list[tuple[Knob, list[Change]]]:
    found = []
    for name in sensors:
        if name in recording.composition.slots_of:
            found += _of_sensor(vehicle[name], vehicle, recording)
    units = [vehicle.process.imu, *([vehicle.process.standby] if vehicle.process.standby else [])]
    for number, name in enumerate(units):
        if (process or name in sensors) and isinstance(recording.log.tables.get(name), Imu):
            found += _of_unit(vehicle[name], number, recording)
    return found


def written(config: SensorConfig, name: str) -> tuple[str, float] | None:
    """Return key and value of a figure as the vehicle file or the preset writes it, or None where neither does."""
    for key, value in config.written.items():
        if si(key, value)[0] == name and isinstance(value, int | float) and not isinstance(value, bool) and value > 0.0:
            return key, float(value)
    return None


def _of_unit(unit: SensorConfig, number: int, recording: Recording) -> list[tuple[Knob, list[Change]]]:
    """The noise of an inertial unit, and the wandering of its biases."""
    params, found = recording.composition.params, []
    for name, density in PROCESS.items():
        place = np.array([recording.composition.plan[at.MOTION_PARAMS] + PARAMETERS * number + density])
        wanders = name.endswith("instability") and unit.values.get(name.replace("instability", "process")) == "gauss_markov"
        if (key := written(unit, name)) is not None and not wanders:
            knob = Knob(unit.name, *key, slots=tuple(range(len(recording.composition.slots))), process=True)
            found.append((knob, [Change(params, place, params[place].copy())]))
    return found


def _of_sensor(config: SensorConfig, vehicle: Vehicle, recording: Recording) -> list[tuple[Knob, list[Change]]]:
    """The sigmas of a sensor, by key; where no key acts on the rows of a channel, the noise of the whole channel."""
    composition, present = recording.composition, set(np.unique(recording.slot).tolist())
    found, reached = [], set()
    for name in config.values:
        parts = name.split("_")
        if not ("sigma" in parts or "noise" in parts) or (key := written(config, name)) is None:
            continue
        changes = _of_key(config, name, vehicle, recording)
        if changes:
            slots = tuple(sorted({slot for slot, _, _ in changes}))
            stated = int(np.isin(recording.slot, slots).sum()) - sum(count for _, count, _ in changes)
            found.append((Knob(config.name, *key, slots=slots, stated=stated), [change for _, _, change in changes]))
            reached |= set(slots)
    for slot in composition.slots_of[config.name]:
        if slot in present and slot not in reached:
            place = np.array([composition.plan[at.CHANNEL + at.CHANNEL_SIZE * slot + at.GATE] + at.NOISE_FACTOR])
            part = " ".join(composition.slots[slot].channel.components)
            found.append((Knob(config.name, "", part=part, slots=(slot,)), [Change(composition.params, place, np.ones(1))]))
    return found


def _of_key(config: SensorConfig, name: str, vehicle: Vehicle, recording: Recording) -> list[tuple[int, int, Change]]:
    """Channels, numbers and places of the rows that a key acts on; none where it does not act as a variance."""
    context, table = Context.of(recording.log, vehicle), recording.log[config.name]
    read = []
    for times in (1.0, *TRIED):
        tried = compose(replace(config, values={**config.values, name: times * config.values[name]}), context)
        assert tried is not None
        read.append({rows.channel: rows for rows in tried.read(table).rows})
    first, found = recording.composition.first_slot[config.name], []
    for channel, rows in read[0].items():
        others = [tried[channel] for tried in read[1:] if channel in tried]
        amount = _amount(rows, others)
        if amount is not None:
            found += _placed(first + channel, rows, amount, recording)
    return found


def _amount(rows: Rows, others: Sequence[Rows]) -> Array | None:
    """What (n, length) grows with the square of a key; None where nothing does, or not as a square."""
    if len(others) < len(TRIED) or any(len(o.row) != len(rows.row) or (o.row != rows.row).any() for o in others):
        return None
    shares = [(o.data - rows.data) / (times**2 - 1.0) for o, times in zip(others, TRIED, strict=True)]
    if not shares[0].any() or not np.allclose(shares[0], shares[1], rtol=1e-6, atol=0.0):
        return None
    return shares[0]


def _placed(slot: int, rows: Rows, amount: Array, recording: Recording) -> list[tuple[int, int, Change]]:
    """The rows of a channel that are acted on, where they stand among the events: by stretch the channel, how many, and their places."""
    found, place = [], np.zeros(rows.row.max(initial=0) + 1, np.int64)
    place[rows.row] = np.arange(len(rows.row))
    for events in recording.events:
        mine = np.flatnonzero(events.kind == slot)
        share = amount[place[events.row[mine]]]
        row, column = np.nonzero(share)
        if len(row):
            change = Change(events.data, events.start[mine][row] + column, share[row, column])
            found.append((slot, len(np.unique(row)), change))
    return found
