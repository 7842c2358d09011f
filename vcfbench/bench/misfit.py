"""A value of a bench file that does not fit."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Misfit"]


@dataclass(frozen=True, slots=True)
class Misfit:
    """A value that cannot be, or that contradicts another: its key path, what was expected there and what came."""

    path: str
    expected: str
    came: object
