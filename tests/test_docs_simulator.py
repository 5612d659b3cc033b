"""The pages of the simulator name what the code has: every key of a mission file, of an instrument and of a hull file, with its default.

What is compared is names, and numbers where both have one: a key that is added, taken off or given another default fails here.
"""

from __future__ import annotations

import math
import re
import tomllib
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import pytest
from test_docs import BLOCK, DOCS, rows_of, words

from leadline.data import hull_keys
from leadline.data.hull import hulls, read_hull
from leadline.missions import equipment_keys
from leadline.missions import instruments as of_vehicle
from leadline.missions import mission_keys as keys
from leadline.missions.equipment import CLASSES
from leadline.simulate import instruments as simulated
from leadline.simulate.drift import Drift
from leadline.simulate.gyros import Triad
from leadline.simulate.pilot import Pilot
from leadline.simulate.reception import Reception

if TYPE_CHECKING:
    from collections.abc import Mapping

    from leadline.data.sensor_keys import Keys

REQUIRED = object()
NUMBER = re.compile(r"-?\d+(\.\d+)?")


def rows_below(page: str, *headings: str) -> dict[str, str]:
    """What is said to hold if a key is left out, by key: of all tables of keys below headings."""
    text = (DOCS / page).read_text("utf-8")
    found: dict[str, str] = {}
    for heading in headings:
        assert text.count(f"\n{heading}\n") == 1, f"{page} has no '{heading}', or two"
        below = re.split(r"\n#", text.partition(f"\n{heading}\n")[2])[0]
        for line in below.splitlines():
            cells = [cell.strip() for cell in line.split("|")[1:-1]]
            for name in words(cells[0]) if len(cells) == 3 and cells[0].startswith("`") else ():
                assert name not in found, f"{page}, {heading}: {name} stands there twice"
                found[name] = cells[2].strip("`")
    return found


def check_default(where: str, said: str, default: Any) -> None:
    """A key that must be given says so and no other does; a number that is said is that of the code."""
    assert (said == "required") == (default is REQUIRED), where
    if isinstance(default, bool):
        assert said == str(default).lower(), where
    elif isinstance(default, (int, float)) and math.isfinite(default):
        assert NUMBER.fullmatch(said), f"{where}: {said}"
        assert float(said) == pytest.approx(default, rel=1e-9), where
    elif NUMBER.fullmatch(said):
        assert isinstance(default, tuple), f"{where}: {said}, and the code has {default}"
        assert set(default) <= {float(said)}, where


# --- The mission file.

TABLES: Mapping[str, tuple[tuple[str, type[Keys]], ...]] = {
    "### Keys of the file": (("", keys.MissionKeys),),
    "### origin": (("", keys.Origin),),
    "### start": (("", keys.Start),),
    "### sea": (("", keys.Sea),),
    "### sea.current": (("", keys.Current), ("tides.", keys.TidalCurrent), ("wander.", keys.Wandering)),
    "### sea.waves": (("", keys.Waves),),
    "### sea.tides": (("", keys.Tide),),
    "### sea.terrain": (("", keys.Terrain), ("fractal.", keys.Fractal), ("plane.", keys.Plane)),
    "### plan": (("", keys.PlanKeys), ("surfacing.", keys.Surfacing)),
    "### beacons": (("", keys.Beacon),),
    "### platforms": (("", keys.Platform),),
    "### navigation": (("", keys.Navigation),),
}


@pytest.mark.parametrize("heading", TABLES)
def test_the_page_of_missions_names_every_key(heading: str) -> None:
    rows = rows_below("simulate.md", heading)
    expected = {f"{prefix}{name}": item for prefix, model in TABLES[heading] for name, item in model.model_fields.items()}
    assert set(rows) == set(expected)
    for name, item in expected.items():
        check_default(f"{heading}: {name}", rows[name], REQUIRED if item.is_required() else item.default)


def test_the_page_of_missions_names_every_shape() -> None:
    rows = rows_of("simulate.md", "### plan.legs")
    assert set(rows) == set(keys.SHAPES)
    for shape, model in keys.SHAPES.items():
        own = {name: item for name, item in model.model_fields.items() if name not in keys.Leg.model_fields}
        assert words(rows[shape][1]) == {name for name, item in own.items() if item.is_required()}, shape
        assert words(rows[shape][2]) == {name for name, item in own.items() if not item.is_required()}, shape
    text = (DOCS / "simulate.md").read_text("utf-8").partition("### plan.legs")[2].partition("\n|")[0]
    assert words(text) >= set(keys.Leg.model_fields)


def test_the_page_of_missions_names_the_columns_of_lists() -> None:
    text = (DOCS / "simulate.md").read_text("utf-8")
    for key, model in (("profile", keys.ShearRow), ("sound", keys.SoundRow)):
        row = next(line for line in text.splitlines() if line.startswith(f"| `{key}` |"))
        assert words(row) == {key, *model.model_fields}


@pytest.mark.parametrize("page", ["simulate.md", "instruments.md"])
def test_the_files_that_the_pages_show_are_right(page: str) -> None:
    """The mission that is shown is one; the instruments that are shown have the keys that they show."""
    for language, text in BLOCK.findall((DOCS / page).read_text("utf-8")):
        if language == "toml":
            raw = tomllib.loads(text)
            if "name" in raw:
                keys.MissionKeys.model_validate(raw)
            for name, own in raw["instruments"].items():
                kind = own.get("kind", name)
                assert equipment_keys.fields_of(ALL[kind], kind, own, name)


# --- Instruments.

ALL: Mapping[str, type[Any]] = {
    **CLASSES,
    "zero_velocity": simulated.ZeroVelocity,
    "navigation": simulated.Navigation,
    "dvl": of_vehicle.Doppler,
    "water_velocity": of_vehicle.WaterDoppler,
    "acoustic_range": of_vehicle.Ranges,
}
SHARED: Mapping[str, tuple[str, ...]] = {
    "water_velocity": ("### dvl",),
    "acoustic_range": ("### Keys of sound",),
    "usbl": ("### Keys of sound",),
    "usbl_fix": ("### Keys of sound", "### usbl"),
}


def known(made: type[Any], units: Mapping[str, str]) -> dict[str, tuple[Any, float]]:
    """Default, SI, and factor of each key of a class of instrument, as the file has it."""
    own = {field.name: (REQUIRED if field.name == "rate" else equipment_keys._default(field)) for field in fields(made)}
    there = {name: unit for name, unit in units.items() if name in own}
    return {equipment_keys._key(name, unit, own[name]): (own[name], equipment_keys.factor(unit)) for name, unit in there.items()}


def check_keys(where: str, rows: Mapping[str, str], expected: Mapping[str, tuple[Any, float]]) -> None:
    assert set(rows) == set(expected), where
    for name, (value, factor) in expected.items():
        plain = value / factor if isinstance(value, float) else value
        check_default(f"{where}: {name}", rows[name], plain)


def test_every_kind_has_its_section() -> None:
    assert set(ALL) == set(equipment_keys.OF_KIND)
    text = (DOCS / "instruments.md").read_text("utf-8")
    assert set(re.findall(r"^### (\w+)$", text, re.MULTILINE)) == set(ALL)


@pytest.mark.parametrize("kind", sorted(ALL))
def test_the_page_of_instruments_names_every_key(kind: str) -> None:
    rows = rows_below("instruments.md", *SHARED.get(kind, ()), f"### {kind}")
    if kind == "usbl_fix":
        del rows["frame"]  # as the page says
    if kind == "imu":
        for name in ("scale_percent", "sigma_scale_percent", "sigma_misalignment_deg", "quantum", "limit"):
            del rows[name]  # of its axes
    if kind == "gnss":
        for name in rows_of_reception():
            del rows[name]
    check_keys(kind, rows, known(ALL[kind], equipment_keys.OF_KIND[kind]))


def rows_of_reception() -> dict[str, str]:
    rows = rows_below("instruments.md", "### gnss")
    return {name: rows[name] for name in rows if name not in known(simulated.Gnss, equipment_keys.OF_KIND["gnss"])}


def test_the_page_of_instruments_names_what_all_have() -> None:
    check_keys("every", rows_below("instruments.md", "## Keys of every instrument"), known(simulated.Depth, equipment_keys.EVERY))


def test_the_page_of_instruments_names_the_keys_of_tables_in_tables() -> None:
    plain = dict.fromkeys((*equipment_keys.DRIFT,), "") | {"tau": "s"}
    check_keys("drift", rows_below("instruments.md", "### Errors that wander"), table_of(Drift, plain))
    axes = {name: said for name, said in rows_below("instruments.md", "### imu").items() if name in table_of(Triad, TRIAD)}
    check_keys("axes", axes, table_of(Triad, TRIAD))
    reception = rows_of_reception()
    assert reception.pop("stages") == '[["single", 0]]'
    check_keys("reception", reception, table_of(Reception, equipment_keys.RECEPTION))


TRIAD = {**equipment_keys.TRIAD, "quantum": "", "limit": ""}


def table_of(made: type[Any], units: Mapping[str, str]) -> dict[str, tuple[Any, float]]:
    own = {field.name: equipment_keys._default(field) for field in fields(made)}
    assert set(units) | ({"stages"} if made is Reception else set()) == set(own), made
    return {f"{name}_{unit}" if unit else name: (own[name], equipment_keys.factor(unit)) for name, unit in units.items()}


# --- Hulls.


def test_the_page_of_hulls_has_their_figures() -> None:
    rows = rows_of("vehicles.md", "## The hulls that come along")
    assert set(rows) == set(hulls())
    for name, row in rows.items():
        hull = read_hull(name)
        pilot = Pilot(hull)
        estimated = sum(origin.startswith("estimated") for origin in hull.origins.values())
        assert row[1] == hull.name
        assert [float(cell) for cell in row[2:5]] == pytest.approx([hull.mass, hull.enclosed, hull.length])
        assert row[5:8] == [str(len(hull.thrusters)), str(len(hull.fins)), "yes" if pilot.hovers else "no"]
        assert float(row[8]) == pytest.approx(pilot.top_speed, abs=0.0051)
        assert row[9] == f"{estimated} of {len(hull.origins)}"


def test_the_page_of_hulls_names_every_key() -> None:
    rows = rows_of("vehicles.md", "## A hull of your own")
    expected = {**hull_keys.ONE, "propellers.NAME": hull_keys.PROPELLER, **hull_keys.MANY}
    assert set(rows) == set(expected)
    for table, own in expected.items():
        assert words(rows[table][1]) == set(own), table
    for table in hull_keys.OPTIONAL:
        assert rows[table][2].endswith("optional"), table
