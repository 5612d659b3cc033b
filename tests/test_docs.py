"""The pages are true: every example on them runs, their tables are those of the code, their links lead somewhere.

In one temporary folder per page, prepared with the log `dive`, `vehicle.toml` and `examples`, the ```python blocks of a page run in
order and in one namespace, and of its ```sh blocks the lines that begin with `leadline`.
"""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from short_dive import write_short_dive

from leadline import cli
from leadline.data.log import Beacon, Datum, Initial, Origin
from leadline.data.outcome import Outcome
from leadline.data.records import KINDS, UNITLESS, UNITS, Table
from leadline.data.sensor_keys import BY_KIND, Sensor
from leadline.data.vehicle import presets
from leadline.data.vehicle_keys import NUISANCES

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(page: Path) -> Iterator[tuple[str, str, int]]:
    """Language, text and first line of each block."""
    text = page.read_text("utf-8")
    for match in BLOCK.finditer(text):
        yield match[1], match[2], text.count("\n", 0, match.start()) + 2


def commands(text: str) -> Iterator[list[str]]:
    """The arguments of each `leadline` command of a block, joined where a line goes on."""
    for line in text.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if words[:1] == ["leadline"] and "|" not in words:
            yield words[1:]


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("docs")
    write_short_dive(place)
    return place


@pytest.mark.parametrize("page", PAGES, ids=[page.name for page in PAGES])
def test_what_a_page_shows_runs(page: Path, prepared: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "page"
    shutil.copytree(prepared, place)
    monkeypatch.chdir(place)
    monkeypatch.syspath_prepend(str(place / "examples"))
    names: dict[str, Any] = {"__name__": "page"}
    for language, text, line in blocks(page):
        if language == "python":
            with contextlib.redirect_stdout(io.StringIO()):
                exec(compile("\n" * (line - 1) + text, str(page), "exec"), names)
        elif language == "sh":
            for arguments in commands(text):
                errors = io.StringIO()
                with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(errors):
                    code = cli.run(arguments)
                assert code == 0, f"{page.name}, line {line}: leadline {' '.join(arguments)}: {errors.getvalue()}"


@pytest.mark.parametrize("page", PAGES, ids=[page.name for page in PAGES])
def test_links_of_a_page_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text("utf-8")):
        if not target.startswith(("http://", "https://")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def rows_of(page: str, heading: str) -> dict[str, list[str]]:
    """Rows of the first table below a heading, by what stands in their first cell."""
    text = (DOCS / page).read_text("utf-8")
    assert f"\n{heading}\n" in text, f"{page} has no '{heading}'"
    below = re.split(r"\n#", text.partition(f"\n{heading}\n")[2])[0]
    table = re.search(r"(^\|.*\n)+", below, re.MULTILINE)
    assert table is not None, f"no table below '{heading}'"
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table[0].splitlines()]
    return {row[0].strip("`"): row for row in cells[2:]}


def words(cell: str) -> set[str]:
    return set(re.findall(r"`([^`]+)`", cell))


def patterns(record: type[Table], *, required: bool) -> set[str]:
    common = {item.name for item in Table.columns()}
    needed = {item.name for item in record.columns() if item.metadata["required"]} | {n for g in record.alternatives for n in g}
    return {item.metadata["pattern"] for item in record.columns() if item.name not in common and (item.name in needed) == required}


def test_the_page_of_formats_names_every_kind_and_column() -> None:
    rows = rows_of("formats.md", "## Tables by kind")
    assert set(rows) == set(KINDS)
    for kind, record in KINDS.items():
        assert words(rows[kind][2]) == patterns(record, required=True), kind
        assert words(rows[kind][3]) == patterns(record, required=False), kind
    common = rows_of("formats.md", "### Columns that every table may have")
    assert set(common) == {item.metadata["pattern"] for item in Table.columns()}


def test_the_page_of_formats_names_every_unit_and_outcome() -> None:
    assert set(rows_of("formats.md", "### Units")) == {f"_{unit}" for unit in UNITS}
    text = (DOCS / "formats.md").read_text("utf-8")
    line = next(line for line in text.splitlines() if line.startswith("Without a unit:"))
    assert words(line) == UNITLESS
    outcomes = rows_of("formats.md", "### Outcomes")
    assert {name: row[1] for name, row in outcomes.items()} == {o.name.lower(): o.sentence for o in Outcome}


def test_the_page_of_formats_names_every_key_of_the_manifest() -> None:
    from leadline.formats.folder import KEYS, _key

    rows = rows_of("formats.md", "### Keys of log.toml")
    assert {name.partition(".")[0] for name in rows} == set(KEYS)
    for section, kind in (("origin", Origin), ("datum", Datum), ("initial", Initial), ("beacons.NAME", Beacon)):
        assert words(rows[section][1]) >= {_key(name) for name in kind.__dataclass_fields__}, section


def test_the_page_of_vehicles_names_every_preset() -> None:
    rows = rows_of("vehicle.md", "## Presets")
    assert {name: row[1] for name, row in rows.items()} == {name: entry["title"] for name, entry in presets().items()}
    for name, entry in presets().items():
        assert words(rows[name][2]) == {kind for kind, keys in entry.items() if isinstance(keys, dict)}


def test_the_page_of_vehicles_names_every_key_and_nuisance() -> None:
    assert set(rows_of("vehicle.md", "## Keys of every sensor")) == set(Sensor.model_fields)
    rows = rows_of("vehicle.md", "## Keys by kind")
    assert set(rows) == set(BY_KIND)
    for kind, keys in BY_KIND.items():
        own = {name for name in keys.model_fields if name not in Sensor.model_fields}
        assert words(rows[kind][1]) | words(rows[kind][2]) == own, kind
        assert words(rows[kind][1]) == {name for name in own if keys.model_fields[name].is_required()}, kind
    named = rows_of("vehicle.md", "## Nuisance states")
    assert set(named) == {f"{kind}.{name}" for kind, names in NUISANCES.items() for name in names}
    for kind, names in NUISANCES.items():
        assert all(named[f"{kind}.{name}"][1].strip("`") == keys.unit for name, keys in names.items())


def test_the_page_of_commands_names_every_command_and_option() -> None:
    text = (DOCS / "command-line.md").read_text("utf-8")
    for command in cli.app.registered_commands + cli.vehicle_app.registered_commands:
        name = command.name or command.callback.__name__  # type: ignore[union-attr]
        assert f"leadline {name}" in text or f"leadline vehicle {name}" in text
    for option in re.findall(r'"(--[a-z-]+)', Path(cli.__file__).read_text("utf-8")):
        assert f"`{option}" in text, option
