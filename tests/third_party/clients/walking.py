"""What the clients have in common: one thing after the other, the error queue read after each."""

from __future__ import annotations

import json
import sys
import time
from typing import TYPE_CHECKING, Any

import pyvisa

if TYPE_CHECKING:
    from collections.abc import Callable

TIMEOUT_MS = 3_000


def opened(resource: str) -> Any:
    """Open a resource as a program would that ends lines itself; `library!resource` names the VISA library."""
    library, _, name = resource.rpartition("!")
    return pyvisa.ResourceManager(library or "@py").open_resource(
        name,
        read_termination=None if name.startswith(("TCPIP", "GPIB", "USB")) and name.endswith("INSTR") else "\n",
        write_termination="\n",
        timeout=TIMEOUT_MS,
    )


class Walk:
    """Does one thing after the other and keeps what went wrong, by its name."""

    def __init__(self, ask: Callable[[str], str], clear: Callable[[], object] = lambda: None) -> None:
        self.ask = ask
        self.clear = clear
        self.seen: dict[str, str | None] = {}

    def do(self, name: str, act: Callable[[], object]) -> Any:
        """Return what `act` returns; None when it raised."""
        name = name if name not in self.seen else f"{name} #{len(self.seen)}"
        value = None
        try:
            value = act()
            self.seen[name] = "; ".join(self.queue()) or None
        except (Exception, SystemExit) as error:  # noqa: BLE001  # whatever it is, it is the answer
            self.seen[name] = f"{type(error).__name__}: {error}"[:300]
            self.clear()
            self.queue()
        return value

    def queue(self) -> list[str]:
        """Read the error queue to its end."""
        entries = []
        while not (entry := self.ask("SYST:ERR?").strip()).startswith("+0,"):
            entries.append(entry)
        return entries

    def tell(self) -> None:
        """Print what was seen, as the last line of the output."""
        sys.stdout.write(json.dumps(self.seen) + "\n")


def no_pauses() -> None:
    """Let drivers wait no more: what they leave to a real instrument's mechanics and self-test takes no time here."""
    time.sleep = lambda _seconds: None  # noqa: TID251


def near(got: float, wanted: float, relative: float = 1e-3, absolute: float = 1e-9) -> None:
    """Raise unless the two agree."""
    if got != wanted and not abs(got - wanted) <= max(relative * abs(wanted), absolute):
        raise AssertionError(f"expected {wanted!r}, got {got!r}")


def same(got: object, wanted: object) -> None:
    """Raise unless the two are equal."""
    if got != wanted:
        raise AssertionError(f"expected {wanted!r}, got {got!r}")
