"""Channels of the DSO7104B: range, offset, probe, input impedance with its protection."""

from __future__ import annotations

import math
from typing import Any

from simrack import scpi
from simrack.instruments.dso7104b.declarations import VOLTS, clipped
from simrack.instruments.dso7104b.instrument import SimulatedDso7104B
from simrack.scpi.lexer import Token

ROWS = scpi.Rows()


class _Label(scpi.Text, frozen=True):
    """A channel's label: ten capitals are kept (siblings' guide, as quoted by PyMeasure's DSOX1102G)."""

    def parse(self, token: Token) -> str:
        """Return the label as it will be shown."""
        return scpi.Text.parse(self, token)[:10].upper()


def _set_range(model: SimulatedDso7104B, channel: int, volts: float) -> None:
    """Set the full screen: 16 mV to 40 V times the probe; the offset follows its limit."""
    probe = model.state.channel[channel].probe
    model.state.channel[channel].range_v = clipped(model, volts, model.kind.least_range_v * probe, 40.0 * probe)
    reach = _offset_reach(model, channel)
    offset = model.state.channel[channel].offset_v
    model.state.channel[channel].offset_v = min(max(offset, -reach), reach)


def _offset_reach(model: SimulatedDso7104B, channel: int) -> float:
    """Return the largest offset: 5 V below 10 mV/div, 20 V to 200 mV/div, 75 V above (unverified)."""
    probe = model.state.channel[channel].probe
    scale = model.state.channel[channel].range_v / 8.0 / probe
    return float(probe * (5.0 if scale < 0.01 else 20.0 if scale <= 0.2 else 75.0))


def _set_offset(model: SimulatedDso7104B, channel: int, volts: float) -> None:
    reach = _offset_reach(model, channel)
    model.state.channel[channel].offset_v = clipped(model, volts, -reach, reach)


def _set_probe(model: SimulatedDso7104B, channel: int, ratio: float) -> None:
    """Change the attenuation: range and offset scale with it."""
    own = model.state.channel[channel]
    factor = ratio / own.probe
    own.range_v, own.offset_v, own.probe = own.range_v * factor, own.offset_v * factor, ratio


def _set_impedance(model: SimulatedDso7104B, channel: int, word: str) -> None:
    """Change the input resistance; 50 ohm only once the protection is cleared (that number of refusal unverified)."""
    if word == "FIFT" and model.state.channel[channel].protection == "TRIP":
        raise scpi.ScpiError(-221)
    model.state.channel[channel].impedance = word
    model.inputs.terminate(channel, fifty=word == "FIFT")


@ROWS.do("CHANnel<1-4>:PROTection[:CLEar]")
def _clear_protection(model: SimulatedDso7104B, channel: int) -> None:
    model.state.channel[channel].protection = "NORM"


@ROWS.query("CHANnel<1-4>", reads=True)
def _learned(model: SimulatedDso7104B, channel: int) -> str:
    """Return the learn string of one channel, in the shape of a recorded one."""
    own = model.state.channel[channel]
    parts = (
        f":CHAN{channel}:RANG {_engineering(own.range_v, 3)}",
        f"OFFS {own.offset_v:+.5E}",
        f"COUP {own.coupling}",
        f"IMP {own.impedance}",
        f"DISP {scpi.boolean(own.shown)}",
        f"BWL {scpi.boolean(own.bandwidth_limit)}",
        f"INV {scpi.boolean(own.inverted)}",
        f'LAB "{own.label}"',
        f"UNIT {own.unit}",
        f"PROB {_engineering(own.probe, 2)}",
        f"PROB:SKEW {own.skew_s:+.2E}",
        f"STYP {own.probe_type}",
    )
    return ";".join(parts)


def _engineering(value: float, digits: int) -> str:
    """Return `value` with an exponent that is a multiple of three: `+40.0E+00`."""
    exponent = 3 * math.floor(math.log10(abs(value)) / 3) if value else 0
    mantissa = value / 10.0**exponent
    decimals = max(0, digits - len(str(int(abs(mantissa)))))
    return f"{mantissa:+.{decimals}f}E{exponent:+03d}"


def _channel(name: str, parameter: scpi.Parameter, field: str, reply: Any = str, **more: Any) -> scpi.Command:
    """Declare a setting of each channel."""
    return scpi.attribute(f"CHANnel<1-4>:{name}", parameter, f"state.channel[].{field}", reply, **more)


VERTICAL_COMMANDS = (
    *ROWS,
    _channel("RANGe", VOLTS, "range_v", "nr3", do=_set_range),
    scpi.Command(
        "CHANnel<1-4>:SCALe",
        (VOLTS,),
        do=lambda model, channel, volts: _set_range(model, channel, 8.0 * volts),
        query=lambda model, n: model.nr3(model.state.channel[n].range_v / 8.0),
        reads=True,
    ),
    _channel("OFFSet", VOLTS, "offset_v", "nr3", do=_set_offset),
    _channel("PROBe", scpi.Number(limits=scpi.Limits(0.1, 1000.0)), "probe", "nr3", do=_set_probe),
    scpi.Command("CHANnel<1-4>:PROBe:ID", query=lambda *_: "NONE", reads=True),
    _channel("PROBe:SKEW", scpi.Number(unit="S", limits=scpi.Limits(-100e-9, 100e-9)), "skew_s", "nr3"),
    _channel("PROBe:STYPe", scpi.Choice(("DIFFerential", "SINGle")), "probe_type"),
    _channel("BWLimit", scpi.Boolean(), "bandwidth_limit", scpi.boolean),
    _channel("COUPling", scpi.Choice(("AC", "DC")), "coupling"),
    _channel("DISPlay", scpi.Boolean(), "shown", scpi.boolean),
    _channel("IMPedance", scpi.Choice(("ONEMeg", "FIFTy")), "impedance", do=_set_impedance),
    _channel("INVert", scpi.Boolean(), "inverted", scpi.boolean),
    _channel("LABel", _Label(), "label", scpi.quoted),
    scpi.Command("CHANnel<1-4>:PROTection", query=lambda model, n: model.state.channel[n].protection, reads=True),
    _channel("UNITs", scpi.Choice(("VOLT", "AMPere")), "unit"),
    _channel("VERNier", scpi.Boolean(), "vernier", scpi.boolean),
)
"""Commands of :CHANnel<n>. Of the 50 ohm overload the siblings' guides say NORM and TRIP."""
