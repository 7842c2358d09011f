"""Run in PyMeasure's environment: every property of its drivers of newer models; prints what went wrong as JSON."""

from __future__ import annotations

import importlib
import json
import logging
import sys
from typing import Any

logging.disable(logging.CRITICAL)

WHERE = {
    "Agilent33500": "pymeasure.instruments.agilent.agilent33500",
    "KeysightE36312A": "pymeasure.instruments.keysight",
    "Keithley2000": "pymeasure.instruments.keithley",
    "KeithleyDMM6500": "pymeasure.instruments.keithley",
}
GENERATOR: list[tuple[str, Any]] = [
    *[("shape", shape) for shape in ("SIN", "SQU", "TRI", "RAMP", "PULS", "PRBS", "NOIS", "ARB", "DC", "SIN")],
    ("frequency", 1e3), ("frequency", 2.5e6), ("amplitude", 1.5), ("amplitude_unit", "VRMS"), ("amplitude_unit", "VPP"),
    ("offset", 0.25), ("voltage_high", 1.5), ("voltage_low", -1.5), ("phase", 45), ("frequency", 1e3),
    ("square_dutycycle", 30), ("ramp_symmetry", 25), ("shape", "PULS"), ("pulse_period", 0.01), ("pulse_hold", "DCYC"),
    ("pulse_hold", "WIDT"), ("pulse_width", 0.002), ("pulse_dutycycle", 25), ("pulse_transition", 2e-8),
    ("shape", "SIN"), ("frequency", 1e3), ("output", True), ("output", False), ("output_load", 50),
    ("burst_state", True), ("burst_mode", "GATED"), ("burst_mode", "TRIG"), ("burst_period", 0.5), ("burst_ncycles", 5),
    ("burst_state", False), ("arb_filter", "OFF"), ("arb_filter", "NORM"), ("arb_advance", "SRAT"), ("arb_srate", 1e5),
]  # fmt: skip
METER: list[tuple[str, Any]] = [
    *[("mode", name) for name in ("voltage ac", "resistance", "resistance 4W", "voltage")],
    ("voltage_range", 10), ("voltage_nplc", 1), ("voltage_nplc", 0.1),
]  # fmt: skip
OF_2000: list[tuple[str, Any]] = [
    ("voltage_reference", 0.5), ("voltage_reference", 0), ("voltage_digits", 6), ("resistance_range", 1e4),
    ("resistance_4W_range", 1e4), ("trigger_count", 2), ("trigger_count", 1), ("trigger_delay", 0.1),
    ("beep_state", "disabled"), ("beep_state", "enabled"),
]  # fmt: skip


class Walk:
    """Does one thing after the other and keeps what went wrong."""

    def __init__(self, instrument: Any) -> None:
        self.instrument = instrument
        self.seen: dict[str, str | None] = {}

    def do(self, name: str, act: Any) -> None:
        name = name if name not in self.seen else f"{name} #{len(self.seen)}"
        try:
            act()
            errors = self.queue()
        except Exception as error:  # noqa: BLE001  # whatever it is, it is the answer
            self.seen[name] = f"{type(error).__name__}: {error}; {'; '.join(self.queue())}"
        else:
            self.seen[name] = "; ".join(errors) or None

    def queue(self) -> list[str]:
        entries = []
        while int((entry := self.instrument.ask("SYST:ERR?").strip()).partition(",")[0]):
            entries.append(entry)
        return entries

    def set_and_get(self, owner: Any, name: str, value: Any, label: str = "") -> None:
        self.do(f"{label or name} = {value}", lambda: self._set_and_get(owner, name, value))

    def _set_and_get(self, owner: Any, name: str, value: Any) -> None:
        setattr(owner, name, value)
        got = getattr(owner, name)
        same = got == value or (isinstance(got, str) and str(value).startswith(got))
        if not same and not (isinstance(got, float) and abs(got - value) <= 1e-6 * abs(value)):
            raise AssertionError(f"set {value!r}, read {got!r}")


def generator(walk: Walk) -> None:
    source = walk.instrument
    for owner, label in ((source, ""), (source.channels[1], "ch_1.")):
        for name, value in GENERATOR:
            walk.set_and_get(owner, name, value, f"{label}{name}")
        walk.do(f"{label}data_arb", lambda owner=owner: owner.data_arb("ramp", range(-32000, 32001, 1000)))
        walk.do(f"{label}arb_file", lambda owner=owner: setattr(owner, "arb_file", "ramp"))
        walk.do(f"{label}data_volatile_clear", owner.data_volatile_clear)
    walk.do("beep", source.beep)
    walk.do("id", lambda: source.id)


def supply(walk: Walk) -> None:
    power = walk.instrument
    for number, (volts, amps) in {1: (5.0, 2.0), 2: (12.0, 0.5), 3: (12.0, 0.5)}.items():
        channel = power.channels[number]
        walk.set_and_get(channel, "voltage_setpoint", volts, f"ch_{number}.voltage_setpoint")
        walk.set_and_get(channel, "current_limit", amps, f"ch_{number}.current_limit")
        walk.set_and_get(channel, "output_enabled", value=True, label=f"ch_{number}.output_enabled")
        walk.do(f"ch_{number}.voltage", lambda channel=channel: float(channel.voltage))
        walk.do(f"ch_{number}.current", lambda channel=channel: float(channel.current))
        walk.set_and_get(channel, "output_enabled", value=False, label=f"ch_{number}.output_enabled")
    for name in ("id", "status", "complete"):
        walk.do(name, lambda name=name: getattr(power, name))


def meter(walk: Walk) -> None:
    dmm = walk.instrument
    for name, value in METER:
        walk.set_and_get(dmm, name, value)
    walk.do("measure_voltage", lambda: dmm.measure_voltage(10))
    walk.do("voltage", lambda: float(dmm.voltage))
    walk.do("auto_range", lambda: dmm.auto_range("voltage"))
    walk.do("enable_filter", lambda: dmm.enable_filter("voltage", "repeat", 2))
    walk.do("disable_filter", lambda: dmm.disable_filter("voltage"))
    walk.do("measure_resistance", lambda: dmm.measure_resistance(1e4, wires=2))
    walk.do("beep", lambda: dmm.beep(1000, 0.1))


def keithley_2000(walk: Walk) -> None:
    dmm = walk.instrument
    meter(walk)
    for name, value in OF_2000:
        walk.set_and_get(dmm, name, value)
    walk.do("enable_reference", lambda: dmm.enable_reference("voltage"))
    walk.do("disable_reference", lambda: dmm.disable_reference("voltage"))
    walk.do("local", dmm.local)
    walk.do("remote", dmm.remote)
    walk.do("reset", dmm.reset)


def dmm_6500(walk: Walk) -> None:
    dmm = walk.instrument
    meter(walk)
    walk.do("line_frequency", lambda: dmm.line_frequency)
    walk.do("terminals_used", lambda: dmm.terminals_used)
    walk.do("command_set", lambda: dmm.command_set)
    walk.do("displayed_text", lambda: dmm.displayed_text("HELLO", "THERE"))
    walk.do("trigger_single_autozero", dmm.trigger_single_autozero)
    walk.do("enable_relative", lambda: dmm.enable_relative("voltage"))
    walk.do("disable_relative", lambda: dmm.disable_relative("voltage"))
    walk.do("id", lambda: dmm.id)


KINDS = {
    "Agilent33500": generator,
    "KeysightE36312A": supply,
    "Keithley2000": keithley_2000,
    "KeithleyDMM6500": dmm_6500,
}


def main() -> None:
    name, resource = sys.argv[1:]
    driver = getattr(importlib.import_module(WHERE[name]), name)
    instrument = driver(resource, visa_library="@py", read_termination="\n", write_termination="\n", timeout=20000)
    instrument.write("*RST;*CLS")
    walk = Walk(instrument)
    KINDS[name](walk)
    sys.stdout.write(json.dumps(walk.seen) + "\n")


if __name__ == "__main__":
    main()
