"""Run in QCoDeS's environment: every parameter and method of its Agilent34401A; prints what went wrong as JSON."""

from __future__ import annotations

import json
import math
import sys
from typing import Any

from qcodes.instrument_drivers import agilent


class Walk:
    """Does one thing after the other and keeps what went wrong."""

    def __init__(self, instrument: Any) -> None:
        self.instrument = instrument
        self.seen: dict[str, str | None] = {}

    def do(self, name: str, act: Any) -> None:
        try:
            act()
            entry = self.instrument.ask("SYST:ERR?")
            self.seen[name] = None if entry.startswith("+0,") else entry
        except Exception as error:  # noqa: BLE001  # whatever it is, it is the answer
            self.seen[name] = f"{type(error).__name__}: {error}"

    def set_and_get(self, name: str, value: Any) -> None:
        self.do(f"{name} = {value}", lambda: self._set_and_get(name, value))

    def _set_and_get(self, name: str, value: Any) -> None:
        parameter = getattr(self.instrument, name)
        parameter(value)
        got = parameter.get()
        if got != value and not (isinstance(got, float) and math.isclose(got, value, rel_tol=1e-6)):
            raise AssertionError(f"set {value!r}, read {got!r}")


def main() -> None:
    name, resource = sys.argv[1:]
    meter = getattr(agilent, name)("meter", resource, visalib="@py", terminator="\n", timeout=60)
    walk = Walk(meter)
    walk.do("reset", meter.reset)
    for value in (0.1, 1.0, 10.0, 100.0, 1000.0, 10.0):
        walk.set_and_get("range", value)
    for value in (0.02, 0.2, 1.0, 10.0, 100.0):
        walk.set_and_get("NPLC", value)
    for value in (1e-3, 1e-4, 3e-5, 1e-5, 3e-6):
        walk.set_and_get("resolution", value)
    walk.set_and_get("range_auto", "off")
    walk.set_and_get("range_auto", "on")
    walk.do("volt", lambda: float(meter.volt()))
    walk.do("init_measurement", meter.init_measurement)
    walk.do("fetch", lambda: float(meter.fetch()))
    walk.do("terminals", meter.terminals)
    walk.do("display_clear", meter.display_clear)
    walk.do("clear_errors", meter.clear_errors)
    walk.do("get_idn", lambda: meter.get_idn()["model"] == "34401A" or 1 / 0)
    walk.do("snapshot", lambda: meter.snapshot(update=True))
    meter.close()
    sys.stdout.write(json.dumps(walk.seen) + "\n")


if __name__ == "__main__":
    main()
