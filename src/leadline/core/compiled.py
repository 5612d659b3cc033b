"""How kernels are compiled, cached and called: the one file that knows Numba's machinery.

A kernel is a function that Numba compiles.  Kernels that fulfil a contract (a process model's `step`, a sensor's `predict`, ...)
carry one of the signatures below and are called by the address of their machine code, which a composition holds in an integer
array.  So the navigation loop is compiled once, whatever is plugged into it, and a new sensor costs one small compilation.

The cache has one folder per module, named by a hash of that module's source and of all that it imports: an edit of a constant or
of a callee in another module can never leave a stale kernel behind (tests/test_compiled.py edits one and looks).
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import sys
import time
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numba
from numba import njit, types
from numba.core import cgutils
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.extending import intrinsic

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

f8, i8 = types.float64, types.int64
F, F2, I = f8[::1], f8[:, ::1], i8[::1]

WIDE = 48  # row length of every covariance-sized matrix: a constant, or the loops do not vectorise
COMPONENTS = 8  # most components that one measurement can have
NUISANCES = 12  # most nuisance values that one sensor can have
SLOT_NUISANCE = 24  # place of the first nuisance index in a channel's row of the plan

# Contract of a process model.            arguments
STEP = types.void(F, F, f8, F, F)  #      x, u, dt, params, memory            x forward in place; memory: what the transition needs
PUSH = types.void(F, f8, F, F, F, i8)  #  memory, dt, params, B, A, columns   A = Phi B
NOISE = types.void(F, f8, F, F)  #        memory, dt, params, P               P += Q
VIEW = types.void(F, F, F, F)  #          x, u, params, view
PULL = types.void(F, F, F, F, F2, F2, i8)  # x, u, params, view, Hv, H, rows  H = Hv dview/dx
# Contract of a sensor model.             views, nuisance, row, params, z, R, Hv, Hn -> outcome
SENSOR = i8(F, F, F, F, F, F2, F2, F2)
# Contract of an estimator.
SETTLE = types.void(I, F, F, F)  #                 plan, params, state, work         state and covariance brought up to date for an output
PROPAGATE = types.void(I, F, F, f8, F, F2, F)  #   plan, params, state, dt, work, points, tape
POINTS = i8(I, F, F, i8, F, F, F2, F2, F2)  #      plan, params, state, channel, row, work, points, V, N -> how many points; 0: none
UPDATE = i8(
    I, F, F, i8, F, F2, F2, F2, F2, F, F2, F, F
)  # plan, params, state, channel, row, Z, R, Hv, Hn, work, points, tape, result -> outcome


def cache_root() -> Path:
    """Return the folder of compiled kernels: LEADLINE_CACHE, or the user's cache folder."""
    default = Path(os.environ.get("XDG_CACHE_HOME", "~/.cache")).expanduser() / "leadline"
    return Path(os.environ.get("LEADLINE_CACHE", default))


def kernel(signature: Any = None, *, inline: bool = False) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function, from the cache where it can be.

    With a `signature` it is compiled at once, for that signature alone; without, on first use.  `inline` puts its code into
    its callers.  Contraction of a*b+c to one rounding is allowed, reordering is not; division by zero gives inf or nan.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        options: dict[str, Any] = {"fastmath": {"contract"}, "error_model": "numpy", "inline": "always" if inline else "never"}
        dispatcher = njit(**options)(function)
        dispatcher._cache = KernelCache(function)
        if signature is not None:
            dispatcher.compile(signature)
            dispatcher.disable_compile()
        return dispatcher

    return decorate


def address(dispatcher: Any, contract: Any) -> int:
    """Return where the machine code of a kernel lies; it is valid in this process, for as long as the kernel is referenced.

    Raises TypeError when the kernel does not fulfil `contract`: called by address, it would corrupt memory.
    """
    if getattr(dispatcher, "nopython_signatures", None) != [contract]:
        found = getattr(dispatcher, "nopython_signatures", type(dispatcher).__name__)
        raise TypeError(f"{getattr(dispatcher, '__name__', dispatcher)} has the signature {found}; the contract is {contract}")
    compiled = dispatcher.overloads[dispatcher.signatures[0]]
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))


def is_kernel(function: Any) -> bool:
    """Say whether a function is compiled."""
    return hasattr(function, "nopython_signatures")


def caller(contract: Any) -> Any:
    """Return an intrinsic f(address, *arguments) that calls machine code of the signature `contract`."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ARG001
        kind = context.call_conv.get_function_type(contract.return_type, contract.args)
        pointer = builder.inttoptr(arguments[0], kind.as_pointer())
        status, result = context.call_conv.call_function(builder, pointer, contract.return_type, contract.args, arguments[1:])
        with cgutils.if_unlikely(builder, status.is_error):
            context.call_conv.return_status_propagate(builder, status)
        return context.get_dummy_value() if contract.return_type == types.void else result

    names = ", ".join(f"a{i}" for i in range(len(contract.args)))  # Numba reads the number of arguments off the definition
    space: dict[str, Any] = {"contract": contract, "codegen": codegen, "i8": i8}
    exec(f"def call(typingctx, address, {names}):\n    return contract.return_type(i8, *contract.args), codegen", space)
    return intrinsic(space["call"])


call_step, call_push, call_noise, call_view, call_pull = map(caller, (STEP, PUSH, NOISE, VIEW, PULL))
call_sensor, call_propagate, call_points, call_update, call_settle = map(caller, (SENSOR, PROPAGATE, POINTS, UPDATE, SETTLE))


class KernelLocator(_CacheLocator):  # type: ignore[misc]
    """Where Numba keeps the kernels of one module: a folder named by the hash of all sources that they are made of."""

    def __init__(self, module: str) -> None:
        """Locate the cache of the named module."""
        self.stamp = source_hash(module)
        self.folder = cache_root() / f"{module}-{self.stamp}"

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> KernelLocator | None:
        """Locate the cache of a function's module; None where it has no source file (an interactive prompt)."""
        return cls(py_func.__module__) if Path(py_file).exists() else None

    def ensure_cache_path(self) -> None:
        """Make the folder, and remove what older versions of the module left behind more than a week ago."""
        if not self.folder.exists():
            self.folder.mkdir(parents=True, exist_ok=True)
            for old in self.folder.parent.glob(f"{self.folder.name.rpartition('-')[0]}-*"):
                if old.stat().st_mtime < time.time() - 7 * 86400:
                    shutil.rmtree(old, ignore_errors=True)

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(self.folder)

    def get_source_stamp(self) -> str:
        """Return the hash that the folder is named by."""
        return self.stamp

    def get_disambiguator(self) -> str:
        """Return nothing: the names of kernels differ within a module."""
        return "k"


class _KernelCacheImpl(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = (KernelLocator,)


class KernelCache(FunctionCache):  # type: ignore[misc]
    """Numba's cache of one function, in our folder.  A folder that cannot be written to is read from all the same."""

    _impl_class = _KernelCacheImpl

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load compiled code; a cache that cannot be read costs a compilation, nothing else."""
        try:
            return super().load_overload(sig, target_context)
        except OSError:
            self.disable()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save compiled code; a read-only or full disk costs time at the next start, nothing else."""
        try:
            super().save_overload(sig, data)
        except OSError:
            self.disable()


@cache
def source_hash(module: str) -> str:
    """Return a hash of the sources of a module and of everything of its package, and of Leadline, that it imports."""
    digest = hashlib.blake2b(digest_size=8)
    digest.update(f"{numba.__version__} {sys.version_info[:2]} {numba.config.BOUNDSCHECK}".encode())
    for path in sorted(_sources(module)):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _sources(module: str) -> set[Path]:
    """Return the source files that a module is built on, itself included: import statements followed to the end."""
    packages = {module.partition(".")[0], "leadline"}
    start = _file_of(module)
    beside = start.parent if start is not None and "." not in module and start.name != "__init__.py" else None  # modules without a package
    found: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        ours = name.partition(".")[0] in packages
        path = _file_of(name) if ours or beside is not None else None
        if name in found or path is None or not (ours or (beside is not None and path.is_relative_to(beside))):
            continue
        found[name] = path
        waiting += _imports(path, name, path.name == "__init__.py")
    return set(found.values())


def _file_of(module: str) -> Path | None:
    if module in sys.modules:
        name = getattr(sys.modules[module], "__file__", None)
        return Path(name) if name and name.endswith(".py") else None
    try:
        spec = find_spec(module)
    except (ImportError, ValueError):
        return None
    return Path(spec.origin) if spec and spec.origin and spec.origin.endswith(".py") else None


IMPORT = re.compile(r"^[ \t]*(?:from[ \t]+(\S+)[ \t]+import[ \t]+(\([^)]*\)|[^\n#;]*)|import[ \t]+([^\n#;]*))", re.MULTILINE)


@cache
def _statements(path: Path) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Return the import statements of a file, wherever they stand: (module as written, names) or ("", modules)."""
    found, text = [], path.read_text("utf-8")
    for origin, names, modules in IMPORT.findall(re.sub(r"#[^\n]*", "", text)):
        listed = (names or modules).strip("() \n").split(",")
        found.append((origin, tuple(part.split()[0] for part in listed if part.split())))
    return tuple(found)


def _imports(path: Path, module: str, package: bool) -> Iterator[str]:
    """Yield the names of all modules that a source may import, relative imports resolved (those of a package start at itself)."""
    parts = module.split(".")
    for origin, names in _statements(path):
        if not origin:
            yield from names
            continue
        level = len(origin) - len(origin.lstrip("."))
        base = parts[: len(parts) + package - level] if level else []
        name = ".".join([*base, origin.lstrip(".")] if origin.lstrip(".") else base)
        yield name
        yield from (f"{name}.{part}" for part in names)
