"""The kernel machinery: contracts are checked, and the cache is fast, never stale, and may be read-only."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from leadline.core.compiled import NOISE, SENSOR, STEP, F, address, kernel
from leadline.models.inertial import noise, step

SOURCE = Path(__file__).parents[1] / "src"
CONSTANTS = "FACTOR = 2.0\n"
CALLEE = (
    "from leadline.core.compiled import kernel\nfrom {package}constants import FACTOR\n\n@kernel()\ndef scaled(a):\n    return FACTOR * a\n"
)
CALLER = (
    "from leadline.core.compiled import F, f8, kernel\nfrom {package}callee import scaled\n\n"
    "@kernel(f8(f8))\ndef total(a):\n    return scaled(a) + 1.0\n\n"
    "if __name__ != '__main__':\n    print(total(5.0), sum(total.stats.cache_hits.values()), sum(total.stats.cache_misses.values()))\n"
)


def test_the_contract_is_checked() -> None:
    """A kernel of the contract has an address; one of another signature, a lazy one, and a plain function have none."""
    assert address(step, STEP) > 0
    for wrong, contract in ((noise, STEP), (step, SENSOR), (kernel()(lambda x: None), NOISE), (print, STEP)):
        with pytest.raises(TypeError, match="the contract is"):
            address(wrong, contract)


def test_a_kernel_that_would_return_something_else() -> None:
    """The signature names the result too: a kernel without outcome does not pass for a sensor."""
    silent = kernel(STEP)(lambda x, u, dt, params, memory: None)
    with pytest.raises(TypeError):
        address(silent, SENSOR)
    assert F in silent.nopython_signatures[0].args


def package(folder: Path, name: str = "tiny", style: str = "absolute") -> None:
    """Write a package of three modules: constants <- callee <- caller; `style` says how they import each other."""
    home = folder / name if name else folder
    home.mkdir(parents=True, exist_ok=True)
    prefix = {"absolute": f"{name}." if name else "", "relative": ".", "through the package": "."}[style]
    if name:
        (home / "__init__.py").write_text("from .constants import FACTOR\n" if style == "through the package" else "")
    (home / "constants.py").write_text(CONSTANTS)
    callee = CALLEE.format(package=prefix)
    if style == "through the package":
        callee = callee.replace("from .constants", f"from {name}")
    (home / "callee.py").write_text(callee)
    (home / "caller.py").write_text(CALLER.format(package=prefix))


def run(folder: Path, module: str, cache: Path, **more: str) -> tuple[float, int, int]:
    """Import a module in a process of its own; returns the result, cache hits and cache misses that it prints."""
    environment: Mapping[str, str] = {**os.environ, "PYTHONPATH": f"{SOURCE}:{folder}", "LEADLINE_CACHE": str(cache), **more}
    done = subprocess.run([sys.executable, "-B", "-c", f"import {module}"], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    value, hits, misses = done.stdout.split()
    return float(value), int(hits), int(misses)


@pytest.mark.parametrize(
    ("name", "style"), [("tiny", "absolute"), ("tiny", "relative"), ("tiny", "through the package"), ("", "absolute")],
    ids=["absolute", "relative", "through the package", "modules without a package"],
)  # fmt: skip
def test_an_edit_of_what_a_kernel_is_made_of_is_seen(tmp_path: Path, name: str, style: str) -> None:
    """Unchanged sources hit the cache; a constant edited two modules away changes the result at once."""
    package(tmp_path, name, style)
    module, cache = f"{name}.caller" if name else "caller", tmp_path / "cache"
    assert run(tmp_path, module, cache) == (11.0, 0, 1)
    assert run(tmp_path, module, cache) == (11.0, 1, 0)
    home = tmp_path / name if name else tmp_path
    (home / "constants.py").write_text("FACTOR = 3.0\n")
    assert run(tmp_path, module, cache) == (16.0, 0, 1)


def test_an_edit_of_a_callee_is_seen(tmp_path: Path) -> None:
    """As above, for the code of a function."""
    package(tmp_path)
    assert run(tmp_path, "tiny.caller", tmp_path / "cache")[0] == 11.0
    callee = tmp_path / "tiny" / "callee.py"
    callee.write_text(callee.read_text().replace("FACTOR * a", "FACTOR * a * a"))
    assert run(tmp_path, "tiny.caller", tmp_path / "cache")[0] == 51.0


def test_bounds_checked_kernels_have_their_own_cache(tmp_path: Path) -> None:
    """NUMBA_BOUNDSCHECK=1 does not find, nor leave behind, what was compiled without it."""
    package(tmp_path)
    cache = tmp_path / "cache"
    assert run(tmp_path, "tiny.caller", cache)[1:] == (0, 1)
    assert run(tmp_path, "tiny.caller", cache, NUMBA_BOUNDSCHECK="1")[1:] == (0, 1)
    assert run(tmp_path, "tiny.caller", cache)[1:] == (1, 0)


def test_a_cache_that_cannot_be_written(tmp_path: Path) -> None:
    """A read-only cache that holds the kernels is used; an empty one, or a path that is no folder, costs a compilation and no more."""
    package(tmp_path)
    cache, empty, no_folder, nowhere = tmp_path / "cache", tmp_path / "empty", tmp_path / "file", Path("/proc/leadline")
    run(tmp_path, "tiny.caller", cache)
    empty.mkdir()
    no_folder.write_text("not a folder")
    for path in (*cache.rglob("*"), cache, empty):
        path.chmod(0o555 if path.is_dir() else 0o444)
    try:
        assert run(tmp_path, "tiny.caller", cache) == (11.0, 1, 0)
        assert run(tmp_path, "tiny.caller", empty)[0] == 11.0
        assert run(tmp_path, "tiny.caller", nowhere)[0] == 11.0  # even root cannot make it
        assert run(tmp_path, "tiny.caller", no_folder)[0] == 11.0
    finally:
        for path in (cache, empty, *cache.rglob("*")):
            path.chmod(0o755 if path.is_dir() else 0o644)
