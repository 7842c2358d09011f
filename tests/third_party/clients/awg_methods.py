"""Run in pylablib's environment: every getter and setter of its Agilent33220A; prints what went wrong as JSON."""

from __future__ import annotations

import sys
from typing import Any

from pylablib.devices import AWG
from walking import Walk, near, same

PAIRS: list[tuple[str, str, Any]] = [
    ("is_output_enabled", "enable_output", True),
    ("is_output_enabled", "enable_output", False),
    ("get_output_polarity", "set_output_polarity", "inv"),
    ("get_output_polarity", "set_output_polarity", "norm"),
    ("is_sync_output_enabled", "enable_sync_output", False),
    ("is_sync_output_enabled", "enable_sync_output", True),
    ("get_load", "set_load", 50.0),
    ("get_load", "set_load", None),
    *[("get_function", "set_function", name) for name in ("square", "ramp", "pulse", "noise", "dc", "user", "sine")],
    ("get_amplitude", "set_amplitude", 0.75),
    ("get_offset", "set_offset", 0.25),
    ("get_output_range", "set_output_range", (-1.0, 1.5)),
    ("get_output_range", "set_output_range", (2.0, 3.0)),
    ("get_frequency", "set_frequency", 2500.0),
    ("get_duty_cycle", "set_duty_cycle", 30.0),
    ("get_ramp_symmetry", "set_ramp_symmetry", 25.0),
    ("get_pulse_width", "set_pulse_width", 2e-5),
    ("is_burst_enabled", "enable_burst", True),
    ("get_burst_mode", "set_burst_mode", "gate"),
    ("get_burst_mode", "set_burst_mode", "trig"),
    ("get_burst_ncycles", "set_burst_ncycles", 5),
    ("get_gate_polarity", "set_gate_polarity", "inv"),
    ("get_trigger_source", "set_trigger_source", "bus"),
    ("get_trigger_source", "set_trigger_source", "ext"),
    ("get_trigger_source", "set_trigger_source", "imm"),
    ("get_trigger_slope", "set_trigger_slope", "neg"),
    ("is_trigger_output_enabled", "enable_trigger_output", False),
    ("get_output_trigger_slope", "set_output_trigger_slope", "neg"),
    ("is_burst_enabled", "enable_burst", False),
    ("get_phase", "set_phase", None),
]


def check(got: Any, wanted: Any) -> None:
    if wanted is None:  # no limit of the load, no phase of a single channel
        same(got in (None, 1e6), wanted is None)
    elif isinstance(wanted, tuple):
        for one, other in zip(got, wanted, strict=True):
            near(one, other)
    elif isinstance(wanted, float):
        near(got, wanted)
    else:
        same(got, wanted)


def main() -> None:
    _, resource = sys.argv[1:]
    source = AWG.Agilent33220A(resource)
    walk = Walk(lambda question: str(source.ask(question)))
    walk.do("reset", source.reset)
    for getter, setter, value in PAIRS:
        walk.do(f"{setter} {value}", lambda setter=setter, value=value: getattr(source, setter)(value))
        walk.do(f"{getter} {value}", lambda getter=getter, value=value: check(getattr(source, getter)(), value))
    for name in ("get_channels_number", "get_current_channel", "sync_phase", "get_id", "get_esr", "get_settings"):
        walk.do(name, getattr(source, name))
    walk.do("set_output_range 1.0", lambda: source.set_output_range(1.0))
    walk.do("get_full_info", source.get_full_info)
    walk.tell()


if __name__ == "__main__":
    main()
