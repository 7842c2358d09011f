"""Run in PyMeasure's environment: every property of drivers is asked, and set to what it answered.

Prints what went wrong by driver, as JSON; the words are DRIVER=RESOURCE. The properties of
channels too; what can only be set is left out.
"""

from __future__ import annotations

import importlib
import json
import logging
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

logging.disable(logging.CRITICAL)

LEFT_OUT = ("shutdown", "adapter", "SCPI", "status", "complete", "instrument", "next_error")
"""What is no setting of an instrument, or is asked by every other test."""
OF_A_SCANNER = ("scan", "ch_")
"""What a DMM6500 has only with a scanner card in it."""


def properties(owner: Any, label: str = "") -> Iterator[tuple[str, Any, str, property]]:
    """Yield the properties of an instrument and of its channels: a label, its owner, its name, itself."""
    for name in sorted(dir(type(owner))):
        found = getattr(type(owner), name)
        if isinstance(found, property) and not name.startswith("_") and name not in LEFT_OUT:
            yield f"{label}{name}", owner, name, found
    for number, channel in getattr(owner, "channels", {}).items():
        yield from properties(channel, f"ch_{number}.")


def alike(one: Any, other: Any) -> bool:
    return one == other or (isinstance(one, float) and abs(one - other) <= 1e-6 * abs(one))


class Walk:
    """Asks and sets one property after the other and keeps what went wrong."""

    def __init__(self, instrument: Any) -> None:
        self.instrument = instrument
        self.seen: dict[str, str | None] = {}

    def queue(self) -> list[str]:
        entries = []
        while int((entry := self.instrument.ask("SYST:ERR?").strip()).partition(",")[0]):
            entries.append(entry)
        return entries

    def ask_and_set(self, label: str, owner: Any, name: str, found: property) -> None:
        try:
            value = getattr(owner, name)
            if found.fset is not None:
                try:
                    setattr(owner, name, value)
                except LookupError:  # it can only be asked
                    pass
                else:
                    again = getattr(owner, name)
                    assert alike(value, again), f"set {value!r}, read {again!r}"
            self.seen[label] = "; ".join(self.queue()) or None
        except LookupError as error:
            if "can not be read" not in str(error):
                self.seen[label] = f"{type(error).__name__}: {error}"
        except Exception as error:  # noqa: BLE001  # whatever it is, it is the answer
            self.seen[label] = f"{type(error).__name__}: {error}; {'; '.join(self.queue())}"


def walked(name: str, resource: str) -> dict[str, str | None]:
    module, _, kind = name.rpartition(".")
    driver = getattr(importlib.import_module(f"pymeasure.instruments.{module}"), kind)
    instrument = driver(resource, visa_library="@py", read_termination="\n", write_termination="\n")
    instrument.adapter.connection.timeout = 3000
    instrument.write("*RST;*CLS")
    walk = Walk(instrument)
    for label, *rest in properties(instrument):
        if not (kind == "KeithleyDMM6500" and label.startswith(OF_A_SCANNER)):
            walk.ask_and_set(label, *rest)
    return walk.seen


def main() -> None:
    pairs = (word.split("=") for word in sys.argv[1:])
    sys.stdout.write(json.dumps({name: walked(name, resource) for name, resource in pairs}) + "\n")


if __name__ == "__main__":
    main()
