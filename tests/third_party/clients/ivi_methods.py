"""Run in python-ivi's environment: every property, read and written back, and every method of one driver.

The driver gets an interface of its own kind, which here is a PyVISA resource.
"""

# ruff: noqa: B023, FBT003  # what a walk is given is called at once; expected values are positional

from __future__ import annotations

import importlib
import sys
from typing import TYPE_CHECKING, Any

from walking import Walk, near, no_pauses, opened, same

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


class Interface:
    """What python-ivi asks of an interface, on a PyVISA resource."""

    def __init__(self, instrument: Any) -> None:
        self.instrument = instrument

    def write_raw(self, data: bytes) -> None:
        self.instrument.write_raw(data if data.endswith(b"\n") else data + b"\n")

    def read_raw(self, num: int = -1) -> bytes:
        del num
        return bytes(self.instrument.read_raw())

    def ask_raw(self, data: bytes, num: int = -1) -> bytes:
        self.write_raw(data)
        return self.read_raw(num)

    def write(self, message: str, encoding: str = "utf-8") -> None:
        self.write_raw(message.encode(encoding))

    def read(self, num: int = -1, encoding: str = "utf-8") -> str:
        return self.read_raw(num).decode(encoding).rstrip("\r\n")

    def ask(self, message: str, num: int = -1, encoding: str = "utf-8") -> str:
        self.write(message, encoding)
        return self.read(num, encoding)

    def clear(self) -> None:
        self.instrument.clear()

    def close(self) -> None:
        self.instrument.close()


def properties(owner: Any, path: str = "") -> Iterator[tuple[str, Callable[[], Any], Callable[[Any], None] | None]]:
    """Yield path, getter and setter of every property under `owner`, the driver's tree of collections."""
    kind = type(owner).__name__
    if kind == "IndexedPropertyCollection":
        for number in range(len(owner)):
            yield from properties(owner[number], f"{path}[{number}].")
        return
    members = object.__getattribute__(owner, "__dict__")
    for name, (get, put, _) in sorted(members.get("_props", {}).items()):
        yield path + name, get, put
    for name, member in sorted(members.items()):
        if type(member).__name__ in {"PropertyCollection", "IndexedPropertyCollection"}:
            yield from properties(member, f"{path}{name}" + ("." if type(member).__name__[0] == "P" else ""))


def every_property(walk: Walk, driver: Any) -> None:
    for path, get, put in properties(driver):
        if path.startswith(("driver_operation.", "initialized")):
            continue
        value = walk.do(path, get)
        if put is not None and walk.seen[path] is None:
            walk.do(f"{path} = as read", lambda put=put, value=value: put(value))


def set_and_get(walk: Walk, owner: Any, name: str, value: Any) -> None:
    def act() -> None:
        setattr(owner, name, value)
        got = getattr(owner, name)
        near(got, value) if isinstance(value, float) else same(got, value)

    walk.do(f"{name} = {value}", act)


def common_methods(walk: Walk, driver: Any) -> None:
    walk.do("utility.reset", driver.utility.reset)
    walk.do("utility.self_test", lambda: same(driver.utility.self_test()[0], 0))
    walk.do("utility.error_query", lambda: same(driver.utility.error_query()[0], 0))


def meter(walk: Walk, dmm: Any) -> None:
    every_property(walk, dmm)
    for name in ("ac_volts", "dc_current", "ac_current", "two_wire_resistance", "four_wire_resistance", "frequency"):
        set_and_get(walk, dmm, "measurement_function", name)
    for name in ("period", "continuity", "diode", "dc_volts"):
        set_and_get(walk, dmm, "measurement_function", name)
    for volts in (0.1, 1.0, 10.0, 100.0, 1000.0, 10.0):
        set_and_get(walk, dmm, "range", volts)
    set_and_get(walk, dmm, "resolution", 1e-4)
    for state in ("on", "off"):
        set_and_get(walk, dmm, "auto_range", state)
    set_and_get(walk, dmm.trigger, "delay", 0.5)
    set_and_get(walk, dmm.trigger, "delay_auto", True)
    for name in ("bus", "external", "immediate"):
        set_and_get(walk, dmm.trigger, "source", name)
    set_and_get(walk, dmm.trigger.multi_point, "sample_count", 3)
    set_and_get(walk, dmm.trigger.multi_point, "count", 2)
    set_and_get(walk, dmm.trigger.multi_point, "count", float("inf"))
    walk.do("utility.reset, again", dmm.utility.reset)
    walk.do("measurement.read", lambda: float(dmm.measurement.read(1000)))
    walk.do("measurement.initiate", dmm.measurement.initiate)
    walk.do("measurement.fetch", lambda: float(dmm.measurement.fetch(1000)))
    walk.do("measurement.abort", dmm.measurement.abort)
    dmm.trigger.source = "bus"
    walk.do("software trigger", lambda: (dmm.measurement.initiate(), dmm.send_software_trigger()))
    walk.do("fetch of it", lambda: float(dmm.measurement.fetch(1000)))
    common_methods(walk, dmm)


def supply(walk: Walk, power: Any) -> None:
    every_property(walk, power)
    for number, (volts, amps) in enumerate([(5.0, 2.0), (12.0, 0.5), (-12.0, 0.5)]):
        output = power.outputs[number]
        walk.do(f"outputs[{number}].voltage_level = {volts}", lambda: setattr(output, "voltage_level", volts))
        walk.do(f"outputs[{number}].current_limit = {amps}", lambda: setattr(output, "current_limit", amps))
        walk.do(f"outputs[{number}].enabled = True", lambda: setattr(output, "enabled", True))
        walk.do(f"outputs[{number}].measure voltage", lambda: float(output.measure("voltage")))
        walk.do(f"outputs[{number}].measure current", lambda: float(output.measure("current")))
        for state in ("constant_voltage", "constant_current", "over_voltage", "over_current", "unregulated"):
            walk.do(f"outputs[{number}].query_output_state {state}", lambda: output.query_output_state(state))
        walk.do(f"outputs[{number}].configure_range", lambda: output.configure_range("voltage", volts))
        walk.do(f"outputs[{number}].reset_output_protection", output.reset_output_protection)
        walk.do(f"outputs[{number}].trigger_source = bus", lambda: setattr(output, "trigger_source", "bus"))
    walk.do("trigger.initiate", power.trigger.initiate)
    walk.do("send_software_trigger", power.send_software_trigger)
    walk.do("trigger.abort", power.trigger.abort)
    walk.do("memory.save 0", lambda: power.memory.save(0))
    walk.do("memory.recall 0", lambda: power.memory.recall(0))
    common_methods(walk, power)


def waveform(channel: Any, points: int) -> None:
    data = channel.measurement.fetch_waveform()
    pairs = list(zip(data.t, data.y, strict=True)) if hasattr(data, "y") else list(data)
    same(len(pairs), points)


def scope(walk: Walk, dso: Any) -> None:
    scope_settings(walk, dso)
    scope_readings(walk, dso)
    scope_memories(walk, dso)


def scope_settings(walk: Walk, dso: Any) -> None:
    common_methods(walk, dso)
    every_property(walk, dso)
    walk.do("utility.reset, again", dso.utility.reset)
    for kind in ("edge", "glitch", "width", "tv", "ac_line"):
        set_and_get(walk, dso.trigger, "type", kind)
    dso.utility.reset()
    for slope in ("negative", "either", "alternating", "positive"):
        set_and_get(walk, dso.trigger.edge, "slope", slope)
    for coupling in ("ac", "lf_reject", "hf_reject", "noise_reject", "dc"):
        set_and_get(walk, dso.trigger, "coupling", coupling)
    for modifier in ("auto", "none", "auto"):
        set_and_get(walk, dso.trigger, "modifier", modifier)
    for source in ("channel2", "channel1"):
        set_and_get(walk, dso.trigger, "source", source)
    set_and_get(walk, dso.trigger, "level", 0.25)
    set_and_get(walk, dso.trigger, "holdoff", 1e-3)
    for kind in ("peak_detect", "high_resolution", "average", "normal"):
        set_and_get(walk, dso.acquisition, "type", kind)
    for mode in ("equivalent_time", "segmented", "real_time"):
        set_and_get(walk, dso.acquisition, "sample_mode", mode)
    set_and_get(walk, dso.acquisition, "time_per_record", 2e-3)
    set_and_get(walk, dso.timebase, "scale", 1e-4)
    set_and_get(walk, dso.timebase, "position", 1e-4)
    for number in range(4):
        channel = dso.channels[number]
        set_and_get(walk, channel, "range", 8.0)
        set_and_get(walk, channel, "offset", 0.5)
        set_and_get(walk, channel, "enabled", True)
        set_and_get(walk, channel, "coupling", "ac")
        set_and_get(walk, channel, "coupling", "dc")
        set_and_get(walk, channel, "label", "SENSE")


def scope_readings(walk: Walk, dso: Any) -> None:
    walk.do("measurement.auto_setup", dso.measurement.auto_setup)
    walk.do("measurement.initiate", dso.measurement.initiate)
    walk.do("measurement.status", lambda: dso.measurement.status)
    walk.do("measurement.abort", dso.measurement.abort)
    walk.do("channels[0].measurement.fetch_waveform", lambda: waveform(dso.channels[0], 1000))
    walk.do("channels[0].measurement.read_waveform", lambda: dso.channels[0].measurement.read_waveform(10_000))
    for name in (
        "rise_time", "fall_time", "frequency", "period", "voltage_rms", "voltage_peak_to_peak", "voltage_max",
        "voltage_min", "voltage_high", "voltage_low", "voltage_average", "width_negative", "width_positive",
        "duty_cycle_positive", "amplitude", "voltage_cycle_rms", "voltage_cycle_average", "overshoot", "preshoot",
    ):  # fmt: skip
        walk.do(f"measure {name}", lambda: float(dso.channels[0].measurement.fetch_waveform_measurement(name)))
    for name in ("ratio", "phase", "delay"):
        walk.do(
            f"measure {name}",
            lambda: float(dso.channels[0].measurement.fetch_waveform_measurement(name, "channel2")),
        )


def scope_memories(walk: Walk, dso: Any) -> None:
    for kind in ("png", "bmp", "bmp8"):
        walk.do(f"display.fetch_screenshot {kind}", lambda: same(len(dso.display.fetch_screenshot(kind)) > 1000, True))
    walk.do("display.clear", dso.display.clear)
    setup = walk.do("system.fetch_setup", dso.system.fetch_setup)
    walk.do("system.load_setup", lambda: dso.system.load_setup(setup))
    walk.do("system.display_string", lambda: dso.system.display_string("HELLO"))
    walk.do("memory.save 1", lambda: dso.memory.save(1))
    walk.do("memory.recall 1", lambda: dso.memory.recall(1))


KINDS = {"agilent34401A": meter, "agilentE3631A": supply, "agilentDSO7104B": scope}


def main() -> None:
    no_pauses()
    name, resource = sys.argv[1:]
    interface = Interface(opened(resource))
    driver = getattr(importlib.import_module(f"ivi.agilent.{name}"), name)(interface, cache=False)
    walk = Walk(interface.ask, interface.clear)
    driver.utility.reset()
    KINDS[name](walk, driver)
    walk.tell()


if __name__ == "__main__":
    main()
