"""A user's own part: imported by name, guarded so that what goes wrong in it is said in one line that names it."""

from __future__ import annotations

import sys
import traceback
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import TYPE_CHECKING, Any

from leadline.core import compiled
from leadline.data.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from types import ModuleType


def imported(name: str, where: str, kind: type) -> Callable[..., Any]:
    """Return a user's function "package.module:function" or "file.py:function", which must make a `kind`; raises InputError."""
    module, _, attribute = name.rpartition(":")
    try:
        found = getattr(_module(module), attribute)
    except Exception as error:  # a user's module may fail in any way as it is imported
        asked = f"{kind.__module__}.{kind.__name__}"
        right = f"give 'package.module:function', with its folder on PYTHONPATH, or 'file.py:function', that makes a {asked}"
        raise InputError(where, f"cannot be imported ({error})", right) from error

    def made(*arguments: Any) -> Any:
        value = guarded(found, where)(*arguments)
        if not isinstance(value, kind):
            raise InputError(where, f"made a {type(value).__name__}", f"return a {kind.__module__}.{kind.__name__}")
        return value

    return made


def _module(name: str) -> ModuleType:
    """Import a module by its name, or from the file that it names."""
    if not name.endswith(".py"):
        return import_module(name)
    path = Path(name).resolve()
    if str(path.parent) not in sys.path:  # modules beside it can be imported, by workers as well
        sys.path.append(str(path.parent))
    known = sys.modules.get(path.stem)
    if known is not None and Path(getattr(known, "__file__", None) or "").resolve() == path:
        return known
    spec = spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None or not path.exists():
        raise ImportError(f"no file {name}")
    module = module_from_spec(spec)
    sys.modules[path.stem] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:  # what is half made must not be found by the next import
        del sys.modules[path.stem]
        raise
    return module


def check_kernels(kernels: Iterable[tuple[Any, Any]], where: str) -> None:
    """Raise InputError where a kernel does not fulfil its contract; kernels: pairs of the two."""
    for kernel, contract in kernels:
        try:
            compiled.address(kernel, contract)
        except TypeError as error:
            raise InputError(where, f"has a kernel that does not fit: {error}", "give each @kernel its contract") from error


def guarded(function: Callable[..., Any], where: str) -> Callable[..., Any]:
    """Return a user's function whose exceptions become an InputError that names place, exception and line."""

    def call(*arguments: Any) -> Any:
        try:
            return function(*arguments)
        except InputError:
            raise
        except Exception as error:
            line = traceback.extract_tb(error.__traceback__)[-1]
            raise InputError(where, f"raised {type(error).__name__}: {error} ({line.filename}, line {line.lineno})", "mend it") from error

    return call
