"""Run in InstrumentKit's environment: every property and method of three classes; prints what went wrong as JSON."""

# ruff: noqa: B023, FBT003  # what a walk is given is called at once; expected values are positional

from __future__ import annotations

import sys
from typing import Any

import instruments
from walking import Walk, near, no_pauses, same


def set_and_get(walk: Walk, owner: Any, name: str, value: Any) -> None:
    def act() -> None:
        setattr(owner, name, value)
        got = getattr(owner, name)
        got = getattr(got, "magnitude", got)
        near(float(got), value) if isinstance(value, float) else same(got, value)

    walk.do(f"{name} = {value}", act)


def scpi(walk: Walk, device: Any) -> None:
    for name in ("name", "scpi_version", "op_complete", "power_on_status"):
        walk.do(name, lambda name=name: getattr(device, name))
    walk.do("self_test_ok", lambda: same(device.self_test_ok, True))
    for name in ("clear", "reset", "wait_to_continue", "check_error_queue"):
        walk.do(name, getattr(device, name))
    for state in device.PowerOnFlag if hasattr(device, "PowerOnFlag") else (True, False):
        set_and_get(walk, device, "power_on_status", state)


def generator(walk: Walk, source: Any) -> None:
    scpi(walk, source)
    for function in source.Function:
        walk.do(f"function = {function}", lambda function=function: setattr(source, "function", function))
    walk.do("FUNC SIN", lambda: source.sendcmd("FUNC SIN"))
    walk.do("function", lambda: same(source.function, source.Function.sinusoid))
    set_and_get(walk, source, "frequency", 2500.0)
    walk.do("amplitude = 1.5", lambda: setattr(source, "amplitude", (1.5, source.VoltageMode.peak_to_peak)))
    walk.do("amplitude", lambda: near(float(source.amplitude[0]), 1.5))
    walk.do("amplitude in dBm", lambda: setattr(source, "amplitude", (1.0, source.VoltageMode.dBm)))
    walk.do("amplitude in dBm read", lambda: near(float(source.amplitude[0]), 1.0))
    walk.do("amplitude in V rms", lambda: setattr(source, "amplitude", (0.5, source.VoltageMode.rms)))
    set_and_get(walk, source, "offset", 0.25)
    set_and_get(walk, source, "duty_cycle", 30)
    set_and_get(walk, source, "ramp_symmetry", 25)
    for name in ("output", "output_sync"):
        for state in (True, False):
            set_and_get(walk, source, name, state)
    for polarity in source.OutputPolarity:
        set_and_get(walk, source, "output_polarity", polarity)
    for load in (50.0, source.LoadResistance.high_impedance):
        walk.do(f"load_resistance = {load}", lambda load=load: setattr(source, "load_resistance", load))
        walk.do(f"load_resistance of {load}", lambda: source.load_resistance)


def meter(walk: Walk, dmm: Any) -> None:
    scpi(walk, dmm)
    for mode in dmm.Mode:
        set_and_get(walk, dmm, "mode", mode)
    dmm.sendcmd("*RST")
    for mode in dmm.TriggerMode:
        set_and_get(walk, dmm, "trigger_mode", mode)
    dmm.trigger_mode = dmm.TriggerMode.immediate
    set_and_get(walk, dmm, "input_range", 10.0)
    set_and_get(walk, dmm, "resolution", 1e-4)
    for count in (1, 10):
        set_and_get(walk, dmm, "sample_count", count)
        set_and_get(walk, dmm, "trigger_count", count)
    walk.do("trigger_count = inf", lambda: setattr(dmm, "trigger_count", dmm.TriggerCount.infinity))
    walk.do("trigger_count of infinity", lambda: same(dmm.trigger_count, dmm.TriggerCount.infinity))
    dmm.sendcmd("*RST")
    set_and_get(walk, dmm, "trigger_delay", 0.5)
    for name in ("sample_source", "sample_timer", "data_point_count"):
        walk.do(name, lambda name=name: getattr(dmm, name))
    dmm.sendcmd("*RST")
    for mode in (dmm.Mode.voltage_dc, dmm.Mode.voltage_ac, dmm.Mode.resistance, dmm.Mode.current_dc):
        walk.do(f"measure {mode}", lambda mode=mode: float(dmm.measure(mode)))
    dmm.sendcmd("*RST")
    walk.do("init", dmm.init)
    walk.do("fetch", lambda: same(len(dmm.fetch()), 1))
    walk.do("read_meter", lambda: float(dmm.read_meter()))
    walk.do("abort", dmm.abort)
    walk.do("clear_memory", dmm.clear_memory)
    walk.do("read_last_data", dmm.read_last_data)
    walk.do("read_data_nvmem", dmm.read_data_nvmem)
    walk.do("read_data", lambda: dmm.read_data(1))
    walk.do("r", lambda: dmm.r(1))


def supply(walk: Walk, power: Any) -> None:
    walk.do("SYST:REM of the constructor", lambda: None)
    scpi(walk, power)
    for number, volts, amps in ((1, 5.0, 2.0), (2, 12.0, 0.5), (3, -12.0, 0.5)):
        channel = power.channel[number]
        walk.do(f"channelid {number}", lambda number=number: same(power.channelid, number))
        walk.do(f"voltage_range {number}", lambda: (channel.voltage_range, channel.voltage_min, channel.voltage_max))
        walk.do(f"current_max {number}", lambda: (channel.current_min, channel.current_max))
        set_and_get(walk, channel, "voltage", volts)
        set_and_get(walk, channel, "current", amps)
        walk.do(f"voltage_sense {number}", lambda: float(channel.voltage_sense))
        walk.do(f"current_sense {number}", lambda: float(channel.current_sense))


KINDS = {
    "Agilent33220a": (instruments.agilent.Agilent33220a, generator),
    "Agilent34410a": (instruments.agilent.Agilent34410a, meter),
    "HPe3631a": (instruments.hp.HPe3631a, supply),
}


def main() -> None:
    no_pauses()
    name, resource = sys.argv[1:]
    _, host, port, _ = resource.split("::")
    driver, act = KINDS[name]
    device = driver.open_tcpip(host, int(port))
    device.timeout = 2
    walk = Walk(lambda question: str(device.query(question)))
    act(walk, device)
    walk.tell()


if __name__ == "__main__":
    main()
