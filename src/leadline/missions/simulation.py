"""A mission, simulated: the vehicle sails, its instruments look, faults befall them, and a log is what is left."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

from leadline.formats.atomic import check_place
from leadline.formats.chart import write_chart
from leadline.formats.folder import write_log
from leadline.missions.equipment import equip
from leadline.missions.mission import read_mission
from leadline.missions.seeds import seed_of
from leadline.simulate.dive import Recorder
from leadline.simulate.faults import troubled

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from leadline.data.log import Log
    from leadline.missions.mission import Mission
    from leadline.simulate.voyage import Voyage

CHART, MISSION, VEHICLE = "chart.asc", "mission.toml", "vehicle.toml"  # what lies beside the tables of a log


@dataclass(frozen=True, eq=False)
class Simulation:
    """A mission that has been sailed, with the loop closed on truth: the motion is one, the noise is another for each seed."""

    mission: Mission
    voyage: Voyage

    @cached_property
    def recorder(self) -> Recorder:
        """The truth, and the instruments that looked at it."""
        mission = self.mission
        trajectory = self.voyage.trajectory()
        instruments = equip(mission, self.voyage)
        return Recorder(trajectory, instruments, truth_rate=mission.truth_rate, start=mission.start, name=mission.name, epoch=mission.epoch)

    def healthy(self, number: int, *, keep: bool = True) -> Log:
        """Return the log of run `number` before its faults; keep: for further runs."""
        log = self.recorder.draw(seed_of(self.mission.name, number), keep=keep)
        return replace(log, vehicle=self.mission.vehicle.name)

    def log(self, number: int, *, keep: bool = True) -> Log:
        """Return the log of run `number`: every instrument and fault draws from a stream of mission, name and number."""
        return troubled(self.healthy(number, keep=keep), self.mission.faults, seed_of(self.mission.name, number))


def sailed(mission: Mission, progress: Callable[[float], None] | None = None) -> Simulation:
    """Sail a mission; raises InputError where the vehicle comes to grief."""
    voyage = mission.voyage()
    voyage.run(progress)
    return Simulation(mission, voyage)


def drawn(mission: Mission, number: int, progress: Callable[[float], None] | None = None) -> Log:
    """Return the log of run `number` of a mission, steered by truth or by the estimate of a navigator, as the mission says."""
    if mission.steer_by == "truth":
        return sailed(mission, progress).log(number, keep=False)
    from leadline.missions.closed_loop import sail_by_estimate

    return sail_by_estimate(mission, seed_of(mission.name, number), progress)[1]


def simulate_folder(
    path: Path, out: Path, number: int = 0, *, parquet: bool = True, progress: Callable[[float], None] | None = None
) -> tuple[Mission, Log]:
    """Simulate a mission file and write the folder of its log; returns both.

    Beside its tables lie the mission and its vehicle, `mission.toml` and `vehicle.toml`, and with a ground its chart, `chart.asc`.
    Raises InputError, before anything is written, for a wrong mission file or place.
    """
    mission = read_mission(path)
    check_place(out, MISSION)  # a log that was simulated may be replaced; a recorded one has no mission
    log = drawn(mission, number, progress)

    def beside(folder: Path) -> None:
        (folder / MISSION).write_text(_at_home(mission), "utf-8")
        if mission.vehicle.path is not None:
            (folder / VEHICLE).write_text(mission.vehicle.path.read_text("utf-8"), "utf-8")
        if mission.sea.chart is not None:
            write_chart(mission.sea.chart, folder / CHART)

    write_log(log, out, parquet=parquet, beside=beside, marker=MISSION)
    return mission, log


def _at_home(mission: Mission) -> str:
    """Return the text of the mission file with the vehicle file beside it."""
    text = mission.path.read_text("utf-8")
    return re.sub(r"^vehicle\s*=.*$", f'vehicle = "{VEHICLE}"', text, count=1, flags=re.MULTILINE)
