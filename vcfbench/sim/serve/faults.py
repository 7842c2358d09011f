"""What can go wrong on the wire of a served instrument, at once or at a bench time from a file.

A fault file is TOML::

    [[fault]]
    at_s = 10.0                 # bench time
    instrument = "multimeter"   # a role
    kind = "silent"
    duration_s = 5.0            # bench time; without it the fault lasts until it is cleared
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Literal, get_args

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from vcfbench.sim.serve.instrument import Client

__all__ = ["Fault", "Kind", "answer_fault", "read_faults"]

Kind = Literal["silent", "garbled", "truncated", "disconnect", "unreachable", "error"]
"""silent: answers are lost. garbled: a byte of each answer is noise. truncated: the second half of each answer is
missing. disconnect: every connection is cut once. unreachable: cut, and no new ones. error: `number` is queued."""

_ANSWER_FAULTS = ("silent", "garbled", "truncated")
_NOISE = b"\xfe"


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault of one instrument.

    Raises:
        ValueError: there is no such kind, or a time is negative.
    """

    instrument: str
    """Its role."""
    kind: Kind
    at_s: float = 0.0
    """Bench time at which it begins."""
    duration_s: float | None = None
    """Bench time for which it lasts; None until it is cleared."""
    number: int = -300
    """Error number of the kind `error`."""

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise ValueError(f"a fault is one of {', '.join(get_args(Kind))}, not {self.kind!r}")
        if self.at_s < 0 or (self.duration_s is not None and self.duration_s <= 0):
            raise ValueError("a fault begins at 0 s or later, and lasts")


def read_faults(path: Path) -> list[Fault]:
    """Read a fault file.

    Raises:
        ValueError: it is not TOML, or an entry is no fault; the words say which.
        OSError: it cannot be read.
    """
    entries = tomllib.loads(path.read_text(encoding="utf-8")).get("fault", [])
    return [_fault(entry, f"{path}: fault {number}") for number, entry in enumerate(entries, start=1)]


def _fault(entry: Any, where: str) -> Fault:
    known = {field.name for field in fields(Fault)}
    if not isinstance(entry, dict) or not {"instrument", "kind"} <= set(entry) <= known:
        raise ValueError(f"{where}: expected instrument and kind, and of {', '.join(sorted(known))} no others")
    try:
        return Fault(**entry)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{where}: {error}") from None


def answer_fault(kind: Kind) -> Callable[[Client, bytes, bool], tuple[bytes, bool] | None] | None:
    """Return what `kind` makes of an answer, None for kinds that leave answers alone."""
    return {"silent": _silent, "garbled": _garbled, "truncated": _truncated}.get(kind)


def _silent(_client: Client, _data: bytes, _end: bool) -> None:  # noqa: FBT001  (as an instrument calls it)
    return None


def _garbled(_client: Client, data: bytes, end: bool) -> tuple[bytes, bool]:  # noqa: FBT001
    middle = len(data) // 2
    return data[:middle] + _NOISE + data[middle + 1 :], end


def _truncated(_client: Client, data: bytes, _end: bool) -> tuple[bytes, bool] | None:  # noqa: FBT001
    half = data[: len(data) // 2]
    return (half, False) if half else None
