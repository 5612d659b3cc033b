"""A navigator as a file: all that it knows, so that a run can be resumed with the same bits."""

from __future__ import annotations

import json
from collections import Counter, deque
from dataclasses import asdict, replace
from hashlib import blake2b
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np

from leadline.data.errors import InputError
from leadline.data.log import Origin
from leadline.data.records import KINDS, Imu
from leadline.estimate import plan as at
from leadline.estimate.clocks import Clock, Step
from leadline.estimate.navigator import Checkpoint
from leadline.estimate.window import COLUMNS
from leadline.formats.atomic import new_file

if TYPE_CHECKING:
    from pathlib import Path

    from leadline.estimate.navigator import Navigator

VERSION = 2


def fingerprint(navigator: Navigator) -> str:
    """Return a hash of what a navigator consists of: models, states, sensors as the vehicle file has them, parameters; no addresses."""
    layout, c = navigator.composition.layout, navigator.composition
    names = [
        c.process.name,
        c.estimator.name.partition(":")[0],
        *(p.name for p in layout.motion),
        *(n.name for n in layout.nuisances),
        str(layout.clones),
    ]
    names += [f"{s.config.name} {json.dumps(s.config.written, sort_keys=True, default=str)}" for s in c.sensors]
    epoch = navigator.reference.epoch.isoformat() if navigator.reference is not None else ""
    names += [f"{name} {clock.mend}" for name, clock in sorted(navigator.clocks.items())]
    return blake2b(" ".join([*names, epoch]).encode() + c.params[c.process.volatile :].tobytes(), digest_size=16).hexdigest()


def save(navigator: Navigator, path: Path, arrived: float) -> None:
    """Write a navigator to a file, whole or not at all; `arrived`: when the last row that it has seen did.

    Raises InputError where the file cannot be written.
    """
    _drop_outputs(navigator)
    inputs = navigator.inputs
    arrays: dict[str, Any] = {f"events.{k}": v for k, v in navigator.events.columns().items()}
    arrays |= {"state": navigator.state, "places": np.array([c.place for c in navigator.checkpoints], np.int64)}
    if navigator.checkpoints:
        arrays["states"] = np.stack([c.state for c in navigator.checkpoints])
    told: dict[str, Any] = {
        "version": VERSION, "fingerprint": fingerprint(navigator), "arrived": arrived, "window": navigator.window, "start": navigator.start,
        "origin": None if navigator.reference is None else [navigator.reference.origin.latitude, navigator.reference.origin.longitude],
        "done": navigator.done, "trimmed": navigator.trimmed, "rows": navigator.rows,
        "counts": {k: dict(v) for k, v in navigator.counts.items()},
        "outcomes": [[*key, code] for key, code in navigator.outcomes.items()],
        "turned_away": [[time, *key] for time, key in navigator.turned_away],
        "screens": {k: [[d.hex() for d in s.seen], s.value.hex()] for k, s in navigator.screens.items()},
    }  # fmt: skip
    told["clocks"] = {k: {**asdict(c), "steps": [list(step) for step in c.steps]} for k, c in navigator.clocks.items()}
    arrays |= {f"recent.{k}": s.recent for k, s in navigator.screens.items()}
    if inputs is not None:
        arrays |= {"inputs.first": inputs.first.memory, "inputs.time": inputs.time, "inputs.data": inputs.data}
        told["handed"], told["begun"] = inputs.handed, inputs.begun
        if inputs.waiting is not None:
            waiting = inputs.waiting
            arrays |= {f"waiting.{c.name}": v for c in waiting.columns() if (v := getattr(waiting, c.name)) is not None}
            told["sample"] = waiting.sample
        if inputs.second is not None:
            arrays["inputs.second"] = inputs.second.memory
    for name, table in navigator.recent.items():
        arrays |= {f"rows.{name}.{c.name}": v for c in table.columns() if (v := getattr(table, c.name)) is not None}
    arrays["told"] = np.frombuffer(json.dumps(told).encode(), np.uint8)
    with new_file(path) as part, part.open("wb") as file:
        np.savez(file, **arrays)


def _drop_outputs(navigator: Navigator) -> None:
    """Take the outputs out of the window: they belong to the run that asked for them."""
    events = navigator.events
    outputs = np.flatnonzero(events.kind[: len(events)] == at.IS_OUTPUT)
    if len(outputs):
        for checkpoint in navigator.checkpoints:
            checkpoint.place -= int(np.searchsorted(outputs, checkpoint.place))
        navigator.done -= int(np.searchsorted(outputs, navigator.done))
        events.delete(outputs)


def restore(navigator: Navigator, path: Path) -> float:
    """Bring a navigator of the same vehicle to what a file says; returns when the last row that it has seen arrived.

    Raises InputError where the file is no snapshot or a damaged one, or is one of another vehicle or another log's time.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file.items())
        told = json.loads(arrays.pop("told").tobytes())
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise InputError(path, "is no snapshot" if path.is_file() else "is no file", "give a file that --snapshot wrote") from error
    if told.get("version") != VERSION or told["fingerprint"] != fingerprint(navigator):
        found = "was written by a navigator of other states, parameters or epoch"
        right = "resume with the vehicle file, the --only and --without, and the epoch of log that it was written with"
        raise InputError(path, found, right)
    navigator.state[:] = arrays["state"]
    navigator.window, navigator.start, navigator.done = told["window"], told["start"], told["done"]
    navigator.trimmed, navigator.rows = told["trimmed"], told["rows"]
    if navigator.reference is not None and told["origin"] is not None:
        navigator.reference = replace(navigator.reference, origin=Origin(*told["origin"]))
    navigator.counts = {k: Counter(v) for k, v in told["counts"].items()}
    navigator.outcomes = {(name, row): code for name, row, code in told["outcomes"]}
    navigator.turned_away = deque((time, (name, row)) for time, name, row in told["turned_away"])
    navigator.events.restore({k: arrays[f"events.{k}"] for k in COLUMNS})
    navigator.checkpoints = [Checkpoint(int(p), arrays["states"][i]) for i, p in enumerate(arrays["places"])]
    for name, (seen, value) in told["screens"].items():
        screen = navigator.screens[name]
        screen.seen, screen.value = dict.fromkeys(map(bytes.fromhex, seen)), bytes.fromhex(value)
        screen.recent = arrays[f"recent.{name}"]
    for name, clock in told["clocks"].items():
        known, doubted = ([(stamp, received) for stamp, received in clock[k]] for k in ("known", "doubted"))
        steps = [Step(*step) for step in clock["steps"]]
        navigator.clocks[name] = Clock(clock["mend"], clock["offset"], known, doubted, steps, clock["least"], clock["most"])
    if navigator.inputs is not None:
        navigator.inputs.first.memory, navigator.inputs.handed = arrays["inputs.first"], told["handed"]
        navigator.inputs.begun = told["begun"]
        if "sample" in told:
            rows = {k.removeprefix("waiting."): v for k, v in arrays.items() if k.startswith("waiting.")}
            navigator.inputs.waiting = Imu(**rows, sample=told["sample"])
        navigator.inputs.time, navigator.inputs.data = arrays["inputs.time"], arrays["inputs.data"]
        if navigator.inputs.second is not None:
            navigator.inputs.second.memory = arrays["inputs.second"]
    for name in {key.split(".")[1] for key in arrays if key.startswith("rows.")}:
        kind = KINDS[navigator.kinds[name]]
        prefix = f"rows.{name}."
        navigator.recent[name] = kind(**{k.removeprefix(prefix): v for k, v in arrays.items() if k.startswith(prefix)})
    return float(told["arrived"])
