"""What is moved in the simulation, or the closed form, for the sensitivities in the table of parts, by name."""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from msgspec import structs

from tests.procedures.parts import closed
from tests.procedures.parts.held import flicker, readings, readings_of_v_vc
from tests.procedures.parts.simulated import KNOWN, Change, turned, warmer

if TYPE_CHECKING:
    from tests.procedures.parts.held import Moves


def _table(**changed: float) -> Any:
    return lambda at: structs.replace(at, table=structs.replace(at.table, **changed))


def _meter(role: str, name: str) -> Change:
    return Change(1e-4, {role: {name: 1e-4}})


def _generator(gain: float, offset_v: float) -> Change:
    """Return a generator all of whose levels are off."""
    ranges = [{"upper_v": 10.0, "gain_error": gain, "offset_error_v": offset_v}]
    return Change(gain + offset_v, {"rate_source": {"ranges": ranges}})


def _late(*channels: int) -> tuple[Change, ...]:
    """Return channels of the oscilloscope that are late, one at a time."""
    skews = [[1e-7 * (each == late) for each in range(1, 5)] for late in channels]
    return tuple(Change(1e-7, {"oscilloscope": {"skew_s": each}}) for each in skews)


def _supply(step: float, name: str, *outputs: str) -> Change:
    return Change(step, {"power": {each: {name: step} for each in outputs}})


_TILT_DEG = KNOWN["misalignment_deg"]
_TILTED = Change(1.0 - math.cos(math.radians(_TILT_DEG)), parameters=_table(misalignment_deg=_TILT_DEG))

MOVED: MappingProxyType[str, Change | tuple[Change, ...] | Moves] = MappingProxyType(
    {
        "meter: gain": _meter("multimeter", "gain_error"),
        "meter: offset": _meter("multimeter", "offset_v"),
        "meter: gain of ohms": Change(1e-4, {"multimeter": {"ohms": {"reading_share": 1.0}}}),
        "leads: longer": Change(0.2, {"multimeter": {"ohms": {"lead_ohm": 0.2}}}),
        "V_Vc meter: gain": _meter("v_vc_meter", "gain_error"),
        "V_Vc meter: offset": _meter("v_vc_meter", "offset_v"),
        "generator: gain": _generator(1e-3, 0.0),
        "generator: offset": _generator(0.0, 1e-3),
        "generator: time base": Change(1e-3, {"rate_source": {"frequency_error": 1e-3}}),
        "oscilloscope: time base": Change(1e-3, {"oscilloscope": {"time_base_error": 1e-3}}),
        "oscilloscope: channels 1 and 2 late": _late(1, 2),
        "oscilloscope: channels 1 and 3 late": _late(1, 3),
        "P25V: ammeter's gain": _supply(0.01, "current_readback_gain", "p25v"),
        "N25V: ammeter's gain": _supply(0.01, "current_readback_gain", "n25v"),
        "P25V: ammeter's offset": _supply(1e-3, "current_readback_offset_a", "p25v"),
        "N25V: ammeter's offset": _supply(1e-3, "current_readback_offset_a", "n25v"),
        "supply: gain of read-backs": _supply(2e-3, "readback_gain", "p25v", "n25v"),
        "chamber: warmer than it reads": Change(4.0, {"chamber": {"air_offset_k": 4.0, "device_offset_k": 0.0}}),
        "table: rate": Change(1e-4, parameters=_table(rate_error=1e-4)),
        "table: tilted axis": _TILTED,
        "room: warmer": Change(0.1, parameters=warmer(0.1)),
        "carrier: phase": Change(0.1, parameters=turned(carrier_deg=0.1)),
        "demodulator: phase": Change(0.1, parameters=turned(demodulator_deg=0.1)),
        "setting: split_hz": Change(0.01, settings={"split_hz": 0.01}),
        "setting: q": Change(1.0, settings={"q": 1.0}),
        "setting: in_phase_share": Change(1e-3, settings={"in_phase_share": 1e-3}),
        "readings": readings(),
        "readings on the table": readings(1),
        "readings by V_Vc": readings(3),
        "readings, by the scale factor": closed.by_scale_factor(readings()),
        "readings on the table, by the scale factor": closed.by_scale_factor(readings(1)),
        "readings of V_Vc": readings_of_v_vc,
        "flicker": flicker,
        "readings, over the static response": closed.over_static(readings()),
        "readings of V_Vc, over the static response": closed.over_static(readings_of_v_vc),
        "flicker, over the static response": closed.over_static(flicker),
        "records: decays": closed.scatter_of_decays,
        "records: phases": closed.scatter_of_phases,
        "records: carrier": closed.u_of_phase("carrier"),
        "records: coriolis": closed.u_of_phase("coriolis"),
        "records: virtual": closed.u_of_phase("virtual"),
        "records: demodulator": closed.u_of_phase("demodulator"),
        "cosines: coriolis": closed.of_cosines("coriolis"),
        "cosines: virtual": closed.of_cosines("virtual"),
        "cosines: demodulator": closed.of_cosines("demodulator"),
        "between readings": closed.between_readings,
        "curvature of the parabola": closed.of_curvature,
        "records: drive": closed.of_drive,
        "range of the ohms": closed.ranges_ohm,
        "over gravity": closed.over_gravity,
        "volts, over gravity": closed.volts_over_gravity,
        "the other axes": closed.across,
        "in proportion": closed.in_proportion,
        "as it is": closed.alike,
        "over the scale factor as told": closed.over_scale_factor,
        "over K_Vc": closed.over_k_vc,
    }
)
