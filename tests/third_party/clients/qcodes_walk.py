"""Run in QCoDeS's environment: every parameter of drivers is asked, and set to what it answered.

Prints what went wrong by driver, as JSON; the words are DRIVER=RESOURCE. The parameters of
channels and other submodules too, in the order of their names.
"""

from __future__ import annotations

import importlib
import json
import sys
from typing import Any

from qcodes_methods import Walk


def parameters(owner: Any, label: str = "") -> list[tuple[str, Any]]:
    """Return the parameters of an instrument and of what belongs to it, by name."""
    found = [(f"{label}{name}", each) for name, each in sorted(owner.parameters.items())]
    for name, part in sorted(owner.submodules.items()):
        found += parameters(part, f"{label}{name}.") if hasattr(part, "parameters") else []
    return found


def asked_and_set(parameter: Any) -> None:
    value = parameter.get() if parameter.gettable else None
    if parameter.settable and value is not None:
        parameter.set(value)
        again = parameter.get()
        if again != value:
            raise AssertionError(f"set {value!r}, read {again!r}")


class Errors(Walk):
    """Whatever the error queue calls no error."""

    def do(self, name: str, act: Any) -> None:
        super().do(name, act)
        entry = self.seen[name]
        self.seen[name] = None if entry is not None and entry.startswith("0,") else entry
        while int(self.instrument.ask("SYST:ERR?").partition(",")[0]):  # of what had no answer
            pass


def walked(name: str, resource: str) -> dict[str, str | None]:
    module, _, kind = name.rpartition(".")
    driver = getattr(importlib.import_module(f"qcodes.instrument_drivers.{module}"), kind)
    device = driver(kind, resource, visalib="@py", terminator="\n", timeout=3)
    device.write("*RST")
    device.write("*CLS")
    walk = Errors(device)
    for label, parameter in parameters(device):
        walk.do(label, lambda parameter=parameter: asked_and_set(parameter))
    device.close()
    return walk.seen


def main() -> None:
    pairs = (word.split("=") for word in sys.argv[1:])
    sys.stdout.write(json.dumps({name: walked(name, resource) for name, resource in pairs}) + "\n")


if __name__ == "__main__":
    main()
