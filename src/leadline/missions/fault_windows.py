"""What every fault of a mission file may say: whom it befalls, and from when to when."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import AfterValidator, Field, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from leadline.data.errors import InputError
from leadline.data.sensor_keys import Finite, Keys, NotNegative
from leadline.data.vehicle import si

if TYPE_CHECKING:
    from collections.abc import Sequence

    from leadline.data.vehicle import SensorConfig
    from leadline.simulate.faults import Fault


def ordered(pair: list[float]) -> list[float]:
    """Return a pair of bounds; refuses one whose lower one is not the first."""
    if pair[0] > pair[1]:
        raise PydanticCustomError("ordered", "the lower one first")
    return pair


Share = Annotated[float, Field(ge=0, le=1)]
Bounds = Annotated[list[NotNegative], Field(min_length=2, max_length=2), AfterValidator(ordered)]


@dataclass(frozen=True)
class Target:
    """Whom a fault befalls: the name of the sensor, what the vehicle file says of it where that is known, and where it was written."""

    sensor: str
    config: SensorConfig | None
    where: str

    def refused(self, key: str, found: str, right: str) -> InputError:
        """Return the error of a key."""
        return InputError(f"{self.where}.{key}" if key else self.where, found, right)


class FaultKeys(Keys):
    """What every fault may say.  Without a `sensor` it befalls that of the `usual` name; see faults_of for vehicles that have none."""

    usual: ClassVar[str] = ""
    kinds: ClassVar[tuple[str, ...]] = ()  # of sensors that can have it; none named: all

    kind: str
    sensor: str | None = None
    from_s: Finite | None = None

    def span(self, target: Target) -> dict[str, Any]:
        """Return sensor, begin and end (s) of the fault."""
        return {"sensor": target.sensor, "begin": -inf if self.from_s is None else self.from_s}

    def si(self, key: str) -> Any:
        """Return the value of a key in SI."""
        return si(key, getattr(self, key))[1]

    def one_of(self, names: Sequence[str], target: Target) -> str:
        """Return which of some keys is given; raises InputError for none, and for more than one."""
        given = [name for name in names if getattr(self, name) is not None]
        if len(given) > 1:
            raise target.refused("", f"has both '{given[0]}' and '{given[1]}'", "give one of them")
        if not given:
            raise target.refused("", "has no size", f"give one of {', '.join(names)}")
        return given[0]

    def fault(self, target: Target) -> Fault:
        """Return the fault, in SI."""
        raise NotImplementedError


class Ending(FaultKeys):
    """A fault that ends, where an end is given."""

    to_s: Finite | None = None

    @field_validator("to_s")
    @classmethod
    def _later(cls, value: float | None, info: ValidationInfo) -> float | None:
        begin = info.data.get("from_s")
        if value is not None and begin is not None and value <= begin:
            raise PydanticCustomError("later", "a time after from_s")
        return value

    def span(self, target: Target) -> dict[str, Any]:
        """Return sensor, begin and end (s) of the fault."""
        return super().span(target) | {"end": inf if self.to_s is None else self.to_s}


class Lasting(Ending):
    """A fault that begins at a time."""

    from_s: Finite
