"""Run in QCoDeS's environment: every parameter of a driver is asked, and set to what it answered.

Prints what went wrong as JSON. The parameters of its channels and other submodules too, in the order of their names.
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


def main() -> None:
    name, resource = sys.argv[1:]
    module, _, kind = name.rpartition(".")
    driver = getattr(importlib.import_module(f"qcodes.instrument_drivers.{module}"), kind)
    device = driver("device", resource, visalib="@py", terminator="\n", timeout=20)
    device.write("*RST")
    device.write("*CLS")
    walk = Errors(device)
    for label, parameter in parameters(device):
        walk.do(label, lambda parameter=parameter: asked_and_set(parameter))
    device.close()
    sys.stdout.write(json.dumps(walk.seen) + "\n")


if __name__ == "__main__":
    main()
