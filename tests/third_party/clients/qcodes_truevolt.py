"""Run in QCoDeS's environment: every parameter and method of its Keysight_34465A; prints what went wrong as JSON."""

from __future__ import annotations

import json
import sys

from qcodes.instrument_drivers import Keysight
from qcodes_methods import Walk


def main() -> None:
    name, resource = sys.argv[1:]
    meter = getattr(Keysight, name)("meter", resource, visalib="@py", terminator="\n", timeout=60, silent=True)
    walk = Walk(meter)
    walk.do("reset", lambda: meter.write("*RST"))
    for value in (0.1, 1.0, 10.0, 100.0, 1000.0, 10.0):
        walk.set_and_get("range", value)
    for value in meter.NPLC_list:
        walk.set_and_get("NPLC", value)
    for value in (3e-5, 1.5e-5, 7e-6, 3e-6, 1e-6):
        walk.set_and_get("resolution", value)
    for value in ("OFF", "ON"):
        walk.set_and_get("autorange", value)
        walk.set_and_get("autozero", value)
        walk.set_and_get("aperture_mode", value)
    walk.set_and_get("aperture_time", 0.25)
    walk.set_and_get("NPLC", 1)
    for value in ("AC Voltage", "2 Wire Resistance", "4 Wire Resistance", "DC Voltage"):
        walk.set_and_get("sense_function", value)
    walk.do("autorange_once", meter.autorange_once)
    walk.do("line_frequency", lambda: meter.line_frequency() == 50 or 1 / 0)
    walk.do("trigger.count", lambda: meter.trigger.count(2))
    walk.do("trigger.count = 1", lambda: meter.trigger.count(1))
    walk.do("trigger.delay", lambda: meter.trigger.delay(0.001))
    walk.do("trigger.auto_delay_enabled", lambda: isinstance(meter.trigger.auto_delay_enabled(), bool) or 1 / 0)
    walk.do("trigger.slope", lambda: meter.trigger.slope("POS"))
    walk.do("sample.count", lambda: meter.sample.count(4))
    walk.do("read", lambda: len(meter.read()) == 4 or 1 / 0)
    walk.do("fetch", lambda: len(meter.fetch()) == 4 or 1 / 0)
    walk.do("trigger.source", lambda: meter.trigger.source("BUS"))
    walk.do("init_measurement", meter.init_measurement)
    walk.do("trigger.force", meter.trigger.force)
    walk.do("fetch after a trigger", lambda: len(meter.fetch()) == 4 or 1 / 0)
    walk.do("init_measurement again", meter.init_measurement)
    walk.do("abort_measurement", meter.abort_measurement)
    walk.do("trigger.source = IMM", lambda: meter.trigger.source("IMM"))
    walk.do("volt", lambda: float(meter.volt()))
    walk.do("res", lambda: float(meter.res()))
    walk.do("display.text", lambda: meter.display.text("VCF"))
    walk.do("display.clear", meter.display.clear)
    walk.do("display.enabled", lambda: meter.display.enabled() or 1 / 0)
    walk.do("get_idn", lambda: meter.get_idn()["model"] == "34465A" or 1 / 0)
    walk.do("options", lambda: meter._options() == () or 1 / 0)
    meter.close()
    sys.stdout.write(json.dumps(walk.seen) + "\n")


if __name__ == "__main__":
    main()
