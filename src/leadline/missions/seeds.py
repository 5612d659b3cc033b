"""Seeds of runs: a name and a number, and nothing of what else is simulated."""

from __future__ import annotations

from hashlib import blake2b


def seed_of(mission: str, run: int) -> int:
    """Return the seed of a run of a mission."""
    return int.from_bytes(blake2b(f"{mission}/{run}".encode(), digest_size=6).digest())
