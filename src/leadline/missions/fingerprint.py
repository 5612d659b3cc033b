"""Digests of what determines a result: of values by what they hold, of files with the files that they name."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache, cached_property
from hashlib import blake2b
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

SIZE = 16  # bytes
DETERMINING = ("core", "data", "sea", "models", "estimate", "simulate", "assess", "missions")  # rooms
DEEPEST = 3  # files that name files that name files


@cache
def digest_of_program() -> str:
    """Return the digest of the program's own source, of all that a solution or a simulated log can depend on."""
    found, home = blake2b(digest_size=SIZE), Path(__file__).parent.parent
    for room in DETERMINING:
        for path in sorted(p for p in (home / room).rglob("*") if p.suffix in (".py", ".toml")):
            found.update(path.relative_to(home).as_posix().encode() + b";" + path.read_bytes())
    return found.hexdigest()


def digest_of(value: Any) -> str:
    """Return the digest of a value: of numbers, texts, arrays, and what is made of them; a path counts by what its file holds."""
    found = blake2b(digest_size=SIZE)
    for part in _parts(value):
        found.update(part)
    return found.hexdigest()


def _parts(value: Any) -> Iterator[bytes]:
    """Yield what a value is made of, each part with its kind, so that no two values run into each other."""
    if isinstance(value, Path):
        yield f"file {digest_of_file(value)};".encode()
    elif isinstance(value, np.ndarray):
        yield f"array {value.dtype} {value.shape};".encode() + np.ascontiguousarray(value).tobytes()
    elif isinstance(value, Mapping):
        for key in sorted(value, key=repr):
            yield f"key {key!r};".encode()
            yield from _parts(value[key])
        yield b"end;"
    elif isinstance(value, list | tuple):
        for part in value:
            yield from _parts(part)
        yield f"end {type(value).__name__};".encode()
    elif isinstance(value, set | frozenset):
        yield repr(sorted(value, key=repr)).encode()
    elif is_dataclass(value) and not isinstance(value, type):
        yield f"{type(value).__qualname__};".encode()
        yield from _parts({item.name: getattr(value, item.name) for item in fields(value) if item.compare or item.repr})
    elif callable(value):
        yield f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', type(value).__qualname__)};".encode()
    elif "__repr__" not in {name for kind in type(value).__mro__[:-1] for name in vars(kind)}:
        yield f"{type(value).__qualname__};".encode()
        yield from _parts(_own(value))
    else:
        yield f"{type(value).__name__} {value!r};".encode()


def _own(value: Any) -> dict[str, Any]:
    """Return the attributes of an object but those that it has worked out from others and keeps."""
    own = getattr(value, "__dict__", {})
    return {name: part for name, part in own.items() if not isinstance(getattr(type(value), name, None), cached_property)}


def digest_of_file(path: Path, depth: int = DEEPEST) -> str:
    """Return the digest of a file and, where it is TOML, of the files beside it that it names; of one that is not there, of its name."""
    found = blake2b(digest_size=SIZE)
    if not path.is_file():
        return f"no {path.name}"
    content = path.read_bytes()
    found.update(content)
    if path.suffix == ".toml" and depth > 0:
        try:
            named = sorted(set(_texts(tomllib.loads(content.decode("utf-8")))))
        except ValueError:
            named = []
        for name in named:
            if name and len(name) < 256 and "\n" not in name and "\0" not in name and (path.parent / name).is_file():
                found.update(digest_of_file(path.parent / name, depth - 1).encode())
    return found.hexdigest()


def _texts(value: Any) -> Iterator[str]:
    """Yield all texts of a TOML value, a function's file without its function."""
    if isinstance(value, str):
        yield value.rpartition(":")[0] if ".py:" in value else value
    elif isinstance(value, dict):
        for part in value.values():
            yield from _texts(part)
    elif isinstance(value, list):
        for part in value:
            yield from _texts(part)
