"""Run in PyMeasure's environment: every property and method of one driver; prints what went wrong as JSON."""

from __future__ import annotations

import importlib
import json
import logging
import sys
from typing import Any

logging.disable(logging.CRITICAL)

WHERE = {
    "Agilent33220A": "pymeasure.instruments.agilent",
    "KeysightE3631A": "pymeasure.instruments.keysight",
    "HP34401A": "pymeasure.instruments.hp",
}
GENERATOR: list[tuple[str, Any]] = [
    *[("shape", shape) for shape in ("SINUSOID", "SIN", "SQUARE", "RAMP", "PULSE", "NOISE", "DC", "USER", "SIN")],
    ("frequency", 1e3), ("frequency", 2.5e6), ("amplitude", 1.5), ("amplitude_unit", "VRMS"), ("amplitude_unit", "VPP"),
    ("offset", 0.25), ("voltage_high", 1.5), ("voltage_low", -1.5), ("square_dutycycle", 30), ("ramp_symmetry", 25),
    ("frequency", 1e3), ("shape", "PULSE"), ("pulse_period", 0.01), ("pulse_hold", "DCYC"), ("pulse_hold", "WIDT"),
    ("pulse_width", 0.002), ("pulse_dutycycle", 25), ("pulse_transition", 2e-8), ("shape", "SIN"), ("frequency", 1e3),
    ("output", True), ("burst_state", True), ("burst_mode", "GATED"), ("burst_mode", "TRIG"), ("burst_ncycles", 5),
    ("trigger_source", "BUS"), ("trigger_state", True), ("beeper_state", True), ("output", True),
]  # fmt: skip
SUPPLY: list[tuple[str, Any]] = [("tracking_enabled", False), ("output_enabled", True), ("output_enabled", False)]
METER: list[tuple[str, Any]] = [
    *[("function_", name) for name in ("DCV_RATIO", "ACV", "DCI", "ACI", "R2W", "R4W", "FREQ", "PERIOD")],
    *[("function_", name) for name in ("CONTINUITY", "DIODE", "DCV")],
    ("range_", 10), ("autorange", True), ("autorange", False), ("resolution", 1e-4), ("nplc", 10), ("nplc", 0.2),
    ("detector_bandwidth", 200), ("autozero_enabled", False), ("autozero_enabled", True),
    ("auto_input_impedance_enabled", True), ("auto_input_impedance_enabled", False), ("trigger_source", "EXT"),
    ("trigger_source", "IMM"), ("trigger_delay", 0.5), ("trigger_auto_delay_enabled", True), ("sample_count", 3),
    ("trigger_count", 2), ("display_enabled", False), ("display_enabled", True), ("displayed_text", "HELLO"),
    ("beeper_enabled", True),
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
            self.seen[name] = f"{type(error).__name__}: {error}"
            self.queue()
        else:
            self.seen[name] = "; ".join(errors) or None

    def queue(self) -> list[str]:
        entries = []
        while not (entry := self.instrument.ask("SYST:ERR?").strip()).startswith("+0,"):
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
    for name, value in GENERATOR:
        walk.set_and_get(source, name, value)
    walk.do("trigger", source.trigger)
    walk.do("wait_for_trigger", lambda: source.wait_for_trigger(timeout=10))
    for state in ("LOCAL", "REMOTE", "RWLOCK", "REM"):
        walk.do(f"remote_local_state = {state}", lambda state=state: setattr(source, "remote_local_state", state))
    walk.do("beep", source.beep)
    walk.do("id", lambda: source.id)
    walk.do("check_errors", source.check_errors)


def supply(walk: Walk) -> None:
    power = walk.instrument
    levels = {1: (5.0, 2.0), 2: (12.0, 0.5), 3: (-12.0, 0.5)}
    for number, (volts, amps) in levels.items():
        channel = power.channels[number]
        walk.set_and_get(channel, "voltage_setpoint", volts, f"ch_{number}.voltage_setpoint")
        walk.set_and_get(channel, "current_limit", amps, f"ch_{number}.current_limit")
        walk.do(f"ch_{number}.voltage", lambda channel=channel: float(channel.voltage))
        walk.do(f"ch_{number}.current", lambda channel=channel: float(channel.current))
        walk.do(f"ch_{number}.output_enabled read", lambda channel=channel: channel.output_enabled)
        walk.do(f"ch_{number}.output_enabled = True", lambda channel=channel: setattr(channel, "output_enabled", True))
    for name, value in SUPPLY:
        walk.set_and_get(power, name, value)
    for name in ("id", "status", "complete", "options"):
        walk.do(name, lambda name=name: getattr(power, name))
    walk.do("check_errors", power.check_errors)


def meter(walk: Walk) -> None:
    dmm = walk.instrument
    for name, value in METER:
        walk.set_and_get(dmm, name, value)
    for name in ("terminals_used", "stored_readings_count", "self_test_result", "scpi_version", "id", "complete"):
        walk.do(name, lambda name=name: getattr(dmm, name))
    walk.do("reading", lambda: dmm.reading)
    walk.do("init_trigger", dmm.init_trigger)
    walk.do("stored_reading", lambda: dmm.stored_reading)
    walk.do("beep", dmm.beep)
    for name in ("remote_control_enabled", "remote_lock_enabled"):
        walk.do(f"{name} = True", lambda name=name: setattr(dmm, name, True))


KINDS = {"Agilent33220A": generator, "KeysightE3631A": supply, "HP34401A": meter}


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
