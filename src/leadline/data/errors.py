"""Wrong input: the one exception family that a user of Leadline may meet before work starts."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


class InputError(ValueError):
    """What a user handed in cannot be used.

    The message is one line: where it is, what was found, what would be right.
    """

    def __init__(self, where: object, found: str, right: str = "") -> None:
        """Say `where` (file, line, key), what was `found`, and what would be `right`."""
        self.where, self.found, self.right = str(where), found, right
        super().__init__(f"{where}: {found}" + (f"; {right}" if right else ""))


def suggestion(word: str, known: Iterable[str]) -> str:
    """Name the known word nearest to `word`, for the `right` of an `InputError`: one that lacks only its unit comes first."""
    words = sorted(known)
    near = [other for other in words if other.startswith(f"{word}_")] or get_close_matches(word, words, n=1)
    if near:
        return f"did you mean '{near[0]}'?"
    return f"known: {', '.join(words)}" if words else ""
