"""Channels of the DSO7104B: range, offset, probe, input impedance with its protection."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from simrack.instruments.dso7104b.declarations import VOLTS, clipped, of_channel
from simrack.scpi import Boolean, Choice, Command, Limits, Number, ScpiError, Text, boolean, quoted

if TYPE_CHECKING:
    from simrack.instruments.dso7104b.instrument import SimulatedDso7104B
    from simrack.scpi.lexer import Token


class _Label(Text, frozen=True):
    """A channel's label: ten capitals are kept (siblings' guide, as quoted by PyMeasure's DSOX1102G)."""

    def parse(self, token: Token) -> str:
        """Return the label as it will be shown."""
        return Text.parse(self, token)[:10].upper()


def _set_range(model: SimulatedDso7104B, channel: int, volts: float) -> None:
    """Set the full screen: 16 mV to 40 V times the probe; the offset follows its limit."""
    probe = model.state[f"CHAN{channel}:PROB"]
    model.state[f"CHAN{channel}:RANG"] = clipped(model, volts, model.kind.least_range_v * probe, 40.0 * probe)
    reach = _offset_reach(model, channel)
    offset = model.state[f"CHAN{channel}:OFFS"]
    model.state[f"CHAN{channel}:OFFS"] = min(max(offset, -reach), reach)


def _set_scale(model: SimulatedDso7104B, channel: int, volts: float) -> None:
    _set_range(model, channel, 8.0 * volts)


def _offset_reach(model: SimulatedDso7104B, channel: int) -> float:
    """Return the largest offset: 5 V below 10 mV/div, 20 V to 200 mV/div, 75 V above (unverified)."""
    probe = model.state[f"CHAN{channel}:PROB"]
    scale = model.state[f"CHAN{channel}:RANG"] / 8.0 / probe
    return float(probe * (5.0 if scale < 0.01 else 20.0 if scale <= 0.2 else 75.0))


def _set_offset(model: SimulatedDso7104B, channel: int, volts: float) -> None:
    reach = _offset_reach(model, channel)
    model.state[f"CHAN{channel}:OFFS"] = clipped(model, volts, -reach, reach)


def _set_probe(model: SimulatedDso7104B, channel: int, ratio: float) -> None:
    """Change the attenuation: range and offset scale with it."""
    factor = ratio / model.state[f"CHAN{channel}:PROB"]
    for key in ("RANG", "OFFS"):
        model.state[f"CHAN{channel}:{key}"] *= factor
    model.state[f"CHAN{channel}:PROB"] = ratio


def _set_impedance(model: SimulatedDso7104B, channel: int, word: str) -> None:
    """Change the input resistance; 50 ohm only once the protection is cleared (that number of refusal unverified)."""
    if word == "FIFT" and model.state[f"CHAN{channel}:PROT"] == "TRIP":
        raise ScpiError(-221)
    model.state[f"CHAN{channel}:IMP"] = word
    model.inputs.terminate(channel, fifty=word == "FIFT")


def _clear_protection(model: SimulatedDso7104B, channel: int) -> None:
    model.state[f"CHAN{channel}:PROT"] = "NORM"


def _of(model: SimulatedDso7104B, channel: int, key: str) -> str:
    return model.nr3(model.state[f"CHAN{channel}:{key}"])


def _learned(model: SimulatedDso7104B, channel: int) -> str:
    """Return the learn string of one channel, in the shape of a recorded one."""

    def of(key: str) -> Any:
        return model.state[f"CHAN{channel}:{key}"]

    parts = (
        f":CHAN{channel}:RANG {_engineering(of('RANG'), 3)}",
        f"OFFS {of('OFFS'):+.5E}",
        f"COUP {of('COUP')}",
        f"IMP {of('IMP')}",
        f"DISP {boolean(of('DISP'))}",
        f"BWL {boolean(of('BWL'))}",
        f"INV {boolean(of('INV'))}",
        f'LAB "{of("LAB")}"',
        f"UNIT {of('UNIT')}",
        f"PROB {_engineering(of('PROB'), 2)}",
        f"PROB:SKEW {of('SKEW'):+.2E}",
        f"STYP {of('STYP')}",
    )
    return ";".join(parts)


def _engineering(value: float, digits: int) -> str:
    """Return `value` with an exponent that is a multiple of three: `+40.0E+00`."""
    exponent = 3 * math.floor(math.log10(abs(value)) / 3) if value else 0
    mantissa = value / 10.0**exponent
    decimals = max(0, digits - len(str(int(abs(mantissa)))))
    return f"{mantissa:+.{decimals}f}E{exponent:+03d}"


VERTICAL_COMMANDS = (
    Command("CHANnel<1-4>", query=_learned),
    Command("CHANnel<1-4>:RANGe", (VOLTS,), do=_set_range, query=lambda model, n: _of(model, n, "RANG")),
    Command(
        "CHANnel<1-4>:SCALe",
        (VOLTS,),
        do=_set_scale,
        query=lambda model, n: model.nr3(model.state[f"CHAN{n}:RANG"] / 8.0),
    ),
    Command("CHANnel<1-4>:OFFSet", (VOLTS,), do=_set_offset, query=lambda model, n: _of(model, n, "OFFS")),
    Command(
        "CHANnel<1-4>:PROBe",
        (Number(limits=Limits(0.1, 1000.0)),),
        do=_set_probe,
        query=lambda model, n: _of(model, n, "PROB"),
        query_parameters=(),
    ),
    Command("CHANnel<1-4>:PROBe:ID", query=lambda *_: "NONE"),
    Command(
        "CHANnel<1-4>:PROBe:SKEW",
        (Number(unit="S", limits=Limits(-100e-9, 100e-9)),),
        do=lambda model, n, seconds: model.state.update({f"CHAN{n}:SKEW": seconds}),
        query=lambda model, n: _of(model, n, "SKEW"),
        query_parameters=(),
    ),
    of_channel("STYP", "PROBe:STYPe", Choice(("DIFFerential", "SINGle"))),
    of_channel("BWL", "BWLimit", Boolean(), boolean),
    of_channel("COUP", "COUPling", Choice(("AC", "DC"))),
    of_channel("DISP", "DISPlay", Boolean(), boolean),
    Command(
        "CHANnel<1-4>:IMPedance",
        (Choice(("ONEMeg", "FIFTy")),),
        do=_set_impedance,
        query=lambda model, n: model.state[f"CHAN{n}:IMP"],
    ),
    of_channel("INV", "INVert", Boolean(), boolean),
    of_channel("LAB", "LABel", _Label(), quoted),
    Command("CHANnel<1-4>:PROTection[:CLEar]", do=_clear_protection),
    Command("CHANnel<1-4>:PROTection", query=lambda model, n: model.state[f"CHAN{n}:PROT"]),
    of_channel("UNIT", "UNITs", Choice(("VOLT", "AMPere"))),
    of_channel("VERN", "VERNier", Boolean(), boolean),
)
"""What is said to :CHANnel<n>. Of the 50 ohm overload the siblings' guides say NORM and TRIP."""
