"""Which keys a run file and a study file may hold: how a log is solved, and what is to be solved how many times and compared."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import Field

from leadline.data.sensor_keys import Finite, Keys, NotNegative, Positive

Table = dict[str, Any]
Names = list[str]


class ConfigurationKeys(Keys):
    """One way to solve a log: process model, estimator, and keys that come before those of the vehicle file."""

    outermost: ClassVar[bool] = True
    name: Annotated[str, Field(min_length=1, max_length=60)] | None = None
    note: str = ""
    process: str | None = None
    estimator: str = "ekf"
    vehicle: str | None = None
    calibration: Names = Field(default_factory=list)
    smooth: bool = False
    as_live: bool = False
    window_s: NotNegative = 30.0
    only: Names = Field(default_factory=list)
    without: Names = Field(default_factory=list)
    set: Table = Field(default_factory=dict)
    sensors: Table = Field(default_factory=dict)
    water: Table = Field(default_factory=dict)
    seabed: Table = Field(default_factory=dict)
    clocks: Table = Field(default_factory=dict)
    points: Table = Field(default_factory=dict)


class BarKeys(Keys):
    """A limit that a statistic of a study must reach: at most `most`, at least `least`."""

    statistic: str
    mission: str | None = None
    configuration: str | None = None
    against: str | None = None
    most: Finite | None = None
    least: Finite | None = None


class StudyKeys(Keys):
    """Missions, configurations and how many runs of each."""

    outermost: ClassVar[bool] = True
    name: str | None = None
    note: str = ""
    missions: Annotated[list[str], Field(min_length=1)]
    configurations: Annotated[list[str | Table], Field(min_length=1)]
    runs: Annotated[int, Field(ge=1)] = 100
    first_run: Annotated[int, Field(ge=0)] = 0
    every_s: Positive = 10.0
    smooth: bool = False
    bound: bool = True
    bars: list[BarKeys] = Field(default_factory=list)
