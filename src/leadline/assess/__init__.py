"""Assessment: errors, consistency, verdict.  The room shares its name with its one door, so it can be called: leadline.assess(...)."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from leadline.assess.assessment import Assessment


class _Room(ModuleType):
    def __call__(self, *arguments: Any, **options: Any) -> Assessment:
        """Assess a solution: see `leadline.assess.assessment.assess`."""
        from leadline.assess.assessment import assess

        return assess(*arguments, **options)


sys.modules[__name__].__class__ = _Room
