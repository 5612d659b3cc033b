"""The rules of the house: who imports whom, where a degree may stand, who may print, what is documented, how long things are."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "src" / "leadline"
FILES = sorted(PACKAGE.rglob("*.py"))
IDS = [str(file.relative_to(PACKAGE)) for file in FILES]

# In the order in which data flows: a room imports from those before it, and from itself.
ROOMS = ("core", "data", "sea", "formats", "models", "estimate", "simulate", "calibrate", "assess", "report", "missions", "live", "cli")
# Wrong input is one family of exceptions, raised everywhere; what a type checker alone sees is no dependence at run time.
EVERYWHERE = {"leadline.data.errors", "leadline"}
# Pairs that never meet, whatever the order says: truth is made by its own dynamics, and a run is judged by what it left.
STRANGERS = {("simulate", "estimate"), ("assess", "estimate"), ("assess", "simulate"), ("assess", "models")}


@cache
def tree_of(file: Path) -> ast.Module:
    return ast.parse(file.read_text("utf-8"))


def room_of(module: str) -> str:
    return module.split(".")[1]


def imports_at_run_time(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and module of every import but those under `if TYPE_CHECKING`."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            continue
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: a relative import"
            yield from _from(node)
        else:
            yield from imports_at_run_time(node)


def _from(node: ast.ImportFrom) -> Iterator[tuple[int, str]]:
    """`from leadline.models import at` imports a module, `from leadline.data.log import Log` a name of one."""
    for alias in node.names:
        path = ROOT / "src" / Path(*f"{node.module}.{alias.name}".split("."))
        is_module = path.is_dir() or path.with_suffix(".py").exists()
        yield node.lineno, f"{node.module}.{alias.name}" if is_module else str(node.module)


def test_every_room_has_its_place() -> None:
    found = {entry.stem for entry in PACKAGE.iterdir() if entry.is_dir() and any(entry.glob("*.py"))}
    found |= {file.stem for file in PACKAGE.glob("*.py")} - {"__init__"}
    assert found <= set(ROOMS)


@pytest.mark.parametrize("file", FILES, ids=IDS)
def test_a_room_imports_only_from_rooms_above_it(file: Path) -> None:
    module = ".".join(file.relative_to(ROOT / "src").with_suffix("").parts).removesuffix(".__init__")
    if module == "leadline":  # public names, resolved on first use
        assert [name for _, name in imports_at_run_time(tree_of(file)) if name.startswith("leadline.")] == []
        return
    own = room_of(module)
    for line, name in imports_at_run_time(tree_of(file)):
        if not name.startswith("leadline") or (name in EVERYWHERE and own != "core"):
            continue
        other = room_of(name)
        assert ROOMS.index(other) <= ROOMS.index(own), f"{file}:{line} imports {name}"
        assert (own, other) not in STRANGERS, f"{file}:{line} imports {name}"


# Degrees stand at the border alone.  Each exception says what it does with one.
BORDER = {
    "formats": "files",
    "report": "for a person",
    "cli.py": "arguments",
    "data/records.py": "UNITS: what the suffix of a file column means",
    "data/vehicle.py": "keys of the vehicle file",
    "data/vehicle_keys.py": "keys of the vehicle file",
    "data/sensor_keys.py": "keys of the vehicle file",
    "data/process_keys.py": "keys of the vehicle file",
    "data/process_config.py": "keys of the vehicle file",
    "data/vehicle_template.py": "keys of the vehicle file",
    "data/presets.toml": "keys of the vehicle file",
    "missions/mission_keys.py": "keys of the mission file",
    "missions/warmup.py": "a mission file in small",
    "missions/mission.py": "keys of the mission file",
    "missions/sea_of.py": "keys of the mission file",
    "missions/equipment_keys.py": "keys of the mission file",
    "missions/fault_kinds.py": "keys of the mission file",
    "calibrate/dvl.py": "writes a fragment of a vehicle file",
    "data/inspection.py": "says ranges in the unit of the file, by UNITS",
    "sea/magnetic.py": "what the World Magnetic Model takes and gives",
    "data/suspicion.py": "says in file units what looks wrong, and looks for radians where degrees belong",
}
DEGREE = re.compile(
    r"""\b(degrees|radians|deg2rad|rad2deg)\b\(     # a call
    |180(\.0*)?\s*/\s*(\w+\.)?pi|pi\s*/\s*180   # by hand
    |57\.29|0\.01745
    |\w_deg\b|\bdeg_per|\bdegps\b|UNITS\["deg"\]""",
    re.VERBOSE,
)


def code_of(file: Path) -> Iterator[tuple[int, str]]:
    """Lines without comments, docstrings and sentences in quotes: prose may speak of a degree."""
    prose: set[int] = set()
    for node in ast.walk(tree_of(file)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            prose |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    for number, line in enumerate(file.read_text("utf-8").splitlines(), 1):
        if number not in prose:
            literals = re.sub(r'"[^"]*"', lambda m: m[0] if " " not in m[0] else '""', line)
            yield number, literals.partition("  #")[0]


@pytest.mark.parametrize("file", FILES, ids=IDS)
def test_a_degree_stands_at_the_border_alone(file: Path) -> None:
    place = file.relative_to(PACKAGE)
    if str(place) in BORDER or place.parts[0] in BORDER:
        return
    lines = [(number, line) for number, line in code_of(file) if "InputError(" not in line]  # it names the key that is wrong
    found = [f"{file}:{number}: {line.strip()}" for number, line in lines if DEGREE.search(line)]
    assert found == []


def test_the_search_for_degrees_finds_them() -> None:
    for line in ("np.degrees(x)", "radians(3.0)", "x * 180 / pi", "x * math.pi / 180.0", "heading_deg = 1", "57.2958 * x", "UNITS['deg']"):
        assert DEGREE.search(line.replace("'", '"')), line
    for line in ("heading_rad = 1", "degree of freedom", "dof / 180.0", "degenerate()"):
        assert not DEGREE.search(line), line


@pytest.mark.parametrize("file", [f for f in FILES if f.name != "cli.py"], ids=[i for i in IDS if i != "cli.py"])
def test_the_library_neither_prints_nor_leaves(file: Path) -> None:
    for node in ast.walk(tree_of(file)):
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            assert called not in {"print", "exit", "quit", "sys.exit", "os._exit", "input", "breakpoint"}, f"{file}:{node.lineno}"
            assert not called.startswith(("sys.stdout", "sys.stderr", "warnings.warn", "logging.")), f"{file}:{node.lineno}"
        if isinstance(node, ast.Raise) and node.exc is not None:
            assert "SystemExit" not in ast.unparse(node.exc), f"{file}:{node.lineno}"


HEAVY = ("numba", "llvmlite", "scipy", "pyarrow", "plotly", "jinja2", "pydantic", "numpy")


HELP = """
import contextlib, io
from leadline import cli
with contextlib.redirect_stdout(io.StringIO()):
    assert cli.run(["--help"]) == 0
"""


@pytest.mark.parametrize("statement", ["import leadline", "import leadline.cli", HELP])
def test_heavy_imports_wait_until_they_are_needed(statement: str) -> None:
    code = f"{statement}\nimport sys\nprint(*(name for name in {HEAVY!r} if name in sys.modules))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert found.stdout.split() == []


def test_every_public_name_can_be_had() -> None:
    import leadline

    assert set(leadline.__all__) == set(leadline._HOMES)
    assert all(callable(getattr(leadline, name)) for name in leadline.__all__)
    with pytest.raises(AttributeError, match="'speed'"):
        _ = leadline.speed


@pytest.mark.parametrize("before", ["", "import leadline.assess.errors", "import leadline; leadline.assess"])
def test_a_public_name_is_itself_whatever_was_imported_before(before: str) -> None:
    """The room `assess` and the function `assess` share a name: it is the function that a user means."""
    code = f"{before}\nfrom leadline import assess, solve\nimport leadline\nassert callable(assess) and callable(leadline.assess)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert found.returncode == 0, found.stderr


def definitions(tree: ast.Module, *, inside: bool = False) -> Iterator[ast.FunctionDef | ast.ClassDef]:
    """Functions and classes of a module and of its classes; with `inside` those in functions too."""
    for node in ast.walk(tree) if inside else tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node
            if isinstance(node, ast.ClassDef) and not inside:
                yield from (part for part in node.body if isinstance(part, ast.FunctionDef))


@pytest.mark.parametrize("file", FILES, ids=IDS)
def test_what_is_public_says_what_it_is(file: Path) -> None:
    tree = tree_of(file)
    assert ast.get_docstring(tree) or not tree.body, f"{file} says nothing of itself"
    for node in definitions(tree):
        own = not node.name.startswith("_") or (node.name.startswith("__") and node.name.endswith("__"))
        overload = any("overload" in ast.unparse(d) for d in node.decorator_list)
        if own and not overload:
            text = ast.get_docstring(node)
            assert text, f"{file}:{node.lineno} {node.name} has no docstring"
            assert re.search(r"[.:]( |$|\n)", text), f"{file}:{node.lineno} {node.name}: not a sentence"


LONGEST_FUNCTION, LONGEST_FILE = 60, 400
LONG_FILES = {
    "cli.py": "all commands on one page: arguments in, one call, what is printed",
    "data/records.py": "the schema: one table type per kind, all on one page",
}


def is_kernel(node: ast.AST) -> bool:
    return isinstance(node, ast.FunctionDef) and any(ast.unparse(d).startswith("kernel") for d in node.decorator_list)


def lines_of_code(file: Path, node: ast.FunctionDef) -> int:
    """Lines of a function without its docstring, comments and empty lines."""
    first = node.body[1] if ast.get_docstring(node) and len(node.body) > 1 else node.body[0]
    lines = file.read_text("utf-8").splitlines()[first.lineno - 1 : node.end_lineno]
    return sum(1 for line in lines if line.strip() and not line.strip().startswith("#"))


@pytest.mark.parametrize("file", FILES, ids=IDS)
def test_the_budget_of_lines(file: Path) -> None:
    count = len(file.read_text("utf-8").splitlines())
    assert count <= LONGEST_FILE or str(file.relative_to(PACKAGE)) in LONG_FILES, f"{file} has {count} lines"
    for node in definitions(tree_of(file), inside=True):
        if isinstance(node, ast.FunctionDef) and not is_kernel(node):
            assert lines_of_code(file, node) <= LONGEST_FUNCTION, f"{file}:{node.lineno} {node.name}"


def test_exceptions_are_still_needed() -> None:
    for name in LONG_FILES:
        assert len((PACKAGE / name).read_text("utf-8").splitlines()) > LONGEST_FILE, f"{name} is short now: take it off the list"
    for name in BORDER:
        assert (PACKAGE / name).exists(), f"{name} is gone: take it off the list"


def test_most_functions_are_short() -> None:
    nodes = [(file, node) for file in FILES for node in definitions(tree_of(file), inside=True)]
    lengths = sorted(lines_of_code(f, n) for f, n in nodes if isinstance(n, ast.FunctionDef) and not is_kernel(n))
    assert lengths[len(lengths) // 2] <= 8
    assert lengths[len(lengths) * 9 // 10] <= 30


NO_NAMES = {"utils", "util", "helpers", "misc", "common", "tools"}


def test_no_file_is_named_after_nothing() -> None:
    assert [file for file in FILES if file.stem in NO_NAMES] == []


# Places that are true on one machine alone, and hosts from which somebody's machine installs.
PLACES = [
    r"(?<![A-Za-z0-9_.])/(home|Users|root|work|mnt|srv)/[A-Za-z0-9_.-]+",
    r"\b[A-Z]:\\\\?(Users|Temp)",
    r"--(extra-)?index-url",
    r"\b(localhost|127\.0\.0\.1|10\.\d+\.\d+\.\d+|192\.168\.\d+\.\d+)\b",
    r"https?://[^\s/]*(artifactory|nexus|mirror|proxy|pypi|registry)[^\s]*",
]
MACHINE = re.compile("|".join(PLACES))


def tracked() -> list[Path]:
    try:
        found = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True).stdout.decode()
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a checkout")
    return [ROOT / name for name in found.split("\0") if name and (ROOT / name).is_file()]


def test_no_file_names_somebodys_machine() -> None:
    found = []
    for file in tracked():
        if file == Path(__file__):
            continue
        try:
            text = file.read_text("utf-8")
        except UnicodeDecodeError:
            continue
        found += [f"{file.relative_to(ROOT)}: {m[0]}" for m in MACHINE.finditer(text)]
    assert found == []


def test_the_search_for_machines_finds_them() -> None:
    for text in ("/home/ann/log", "C:\\Users\\ann", "--index-url x", "https://pypi.org/simple", "192.168.0.1"):
        assert MACHINE.search(text), text
    for text in ("/usr/bin/env", "https://doi.org/10.1109/x", "homework/x.py", "at home"):
        assert not MACHINE.search(text), text
