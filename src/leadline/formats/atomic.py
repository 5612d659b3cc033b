"""Output that is whole or not there: written under a temporary name beside its place, renamed when the block ends well."""

from __future__ import annotations

import os
import shutil
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING
from uuid import uuid4

from leadline.data.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

WRITTEN = frozenset({".asc", ".csv", ".html", ".json", ".parquet", ".toml"})  # what Leadline writes into its folders


@contextmanager
def new_file(path: str | Path) -> Iterator[Path]:
    """Yield a temporary sibling of `path` to write; it takes the place of `path` when the block ends well.

    Nothing is left behind when the block raises.  Raises InputError where the system refuses to write.
    """
    place = Path(path).resolve()
    if place.is_dir():
        raise InputError(path, "is a folder", "name a file")
    part = place.with_name(f".{place.stem}.{uuid4().hex[:8]}{place.suffix}")
    try:
        with _refusals(path):
            place.parent.mkdir(parents=True, exist_ok=True)
            yield part
            part.replace(place)
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


@contextmanager
def new_folder(path: str | Path, marker: str = "summary.json") -> Iterator[Path]:
    """Yield a temporary sibling folder to fill; it takes the place of `path` when the block ends well.

    An existing folder is replaced only when it is empty, or when it holds the file `marker` and nothing but plain files of
    the kinds that Leadline writes: nobody's own folder is ever destroyed.  Nothing is left behind when the block raises.
    Raises InputError where the place is taken, or where the system refuses to write.
    """
    place = Path(path).resolve()
    with _refusals(path):
        check_place(place, marker)
        place.parent.mkdir(parents=True, exist_ok=True)
        part = Path(mkdtemp(prefix=f".{place.name}.", dir=place.parent))
    try:
        with _refusals(path):
            part.chmod(0o777 & ~_umask())
            yield part
            check_place(place, marker)
            _exchange(part, place)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def check_place(path: str | Path, marker: str = "summary.json") -> None:
    """Raise InputError where a folder may not be written to `path`, as `new_folder` will: to be known before the work starts."""
    place = Path(path)
    home = next(parent for parent in place.resolve().parents if parent.exists())
    if not os.access(home, os.W_OK):
        raise InputError(path, f"cannot be written: {home} is read-only", "choose another place")
    if not place.exists():
        return
    if not place.is_dir():
        raise InputError(path, "is a file", "name a folder")
    entries = list(place.iterdir())
    if not entries:
        return
    if not any(entry.name == marker for entry in entries):
        raise InputError(path, f"exists and holds no {marker}", "name a new or an empty folder")
    foreign = sorted(e.name for e in entries if not e.is_file() or e.is_symlink() or e.suffix not in WRITTEN)
    if foreign:
        raise InputError(path, f"exists and holds '{foreign[0]}', which Leadline did not write", "name a new or an empty folder")


def _exchange(part: Path, place: Path) -> None:
    """Put `part` at `place`; what was there is removed last, and put back if the new one does not arrive."""
    if not place.exists():
        part.rename(place)
        return
    old = place.with_name(f".{place.name}.{uuid4().hex[:8]}.old")
    place.rename(old)
    try:
        part.rename(place)
    except BaseException:
        old.rename(place)
        raise
    shutil.rmtree(old, ignore_errors=True)


@contextmanager
def _refusals(path: str | Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error).partition("\n")[0]
        raise InputError(path, f"cannot be written: {reason}", "choose another place, or make room") from error


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
