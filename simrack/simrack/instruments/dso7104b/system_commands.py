"""Root commands, display, hard copy and system of the DSO7104B."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Any

import msgspec

from simrack.instruments.dso7104b.declarations import (
    OPTIONAL_SOURCE,
    SOURCE,
    SourceParameter,
    nothing,
    registers,
)
from simrack.instruments.dso7104b.math_settings import math_scale, math_trace
from simrack.instruments.dso7104b.settings import CHANNELS, ScopeSettings
from simrack.scpi import (
    Block,
    Boolean,
    Choice,
    Command,
    Integer,
    Limits,
    ScpiError,
    Text,
    attribute,
    block,
    boolean,
    quoted,
    signed_integer,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from simrack.instruments.dso7104b.instrument import SimulatedDso7104B
    from simrack.scpi import Pending

_PLACES = Integer(limits=Limits(0, 9))
_POINTS = 1000
_OPTIONS = "0,0,0,0,MEMUP,0,0,0,0,0,0,0"
"""A field an option, 0 where it is not fitted: memory alone (how many follow is unverified)."""
_MATH = len(CHANNELS) + 1


# --- root


def _digitize(model: SimulatedDso7104B, *sources: str) -> Pending:
    return model.digitize(*sources)


def _show(model: SimulatedDso7104B, source: str, *, shown: bool) -> None:
    model.state.show(source, shown)


def _blank(model: SimulatedDso7104B, source: str | None) -> None:
    for one in (source,) if source else (*(f"CHAN{channel}" for channel in CHANNELS), "FUNC"):
        _show(model, one, shown=False)


def _activity(model: SimulatedDso7104B) -> Any:
    """Return edges and levels, a bit a channel: whether it crosses its trigger level, and is above it at the end."""
    return model.look(lambda: _activity_now(model))


def _activity_now(model: SimulatedDso7104B) -> str:
    edges = levels = 0
    for bit, channel in enumerate(CHANNELS):
        above = model.shown.trace(f"CHAN{channel}").volts >= model.state.levels_v[f"CHAN{channel}"]
        edges |= bool(above.any() and not above.all()) << bit
        levels |= bool(above[-1]) << bit
    return f"{signed_integer(edges)},{signed_integer(levels)}"


ROOT_COMMANDS = (
    Command("*OPT", query=lambda _: _OPTIONS),
    Command("*TST", query=lambda _: 0, reply=signed_integer, query_takes_s=5.0),
    Command("*TRG", do=_digitize),
    Command("*SAV", (_PLACES,), do=lambda model, place: model.save(place)),
    Command("*RCL", (_PLACES,), do=lambda model, place: model.recall(place)),
    Command("*LRN", query=lambda model: b":SYST:SET " + _setup(model)),
    Command("RUN", do=lambda model: model.run_now()),
    Command("STOP", do=lambda model: model.stop()),
    Command("SINGle", do=lambda model: model.single()),
    Command("DIGitize", (SourceParameter(required=False),), do=_digitize, repeat=True),
    Command(
        "AUToscale",
        (Choice(("CHANnel<1-4>",), required=False),),
        do=lambda model, *_: model.autoscale(),
        repeat=True,
    ),
    Command("CDISplay", do=nothing),
    Command("BLANk", (OPTIONAL_SOURCE,), do=_blank),
    Command("VIEW", (SOURCE,), do=lambda model, source: _show(model, source, shown=True)),
    Command(
        "STATus",
        query=lambda model, source: model.state.is_shown(source),
        query_parameters=(SOURCE,),
        reply=boolean,
    ),
    Command("AER", query=lambda model: model.armed(), reply=signed_integer),
    Command("TER", query=lambda model: model.was_triggered(), reply=signed_integer),
    Command("SERial", query=lambda _: "MY49520121"),
    Command("PRINt", do=nothing),
    Command("MERGe", (Choice(("PMEMory<0-9>",)),), do=nothing),
    Command("ACTivity", do=nothing, query=_activity),
    Command("OPERegister:CONDition", query=lambda model: model.operation.condition, reply=signed_integer),
    *registers("OPEE", "OPERegister[:EVENt]", lambda model: model.operation),
    *registers("OVLenable", "OVLRegister", lambda model: model.overload),
    *registers("HWEenable", "HWERegister[:EVENt]", lambda model: model.hardware),
    Command("HWERegister:CONDition", query=lambda model: model.hardware.condition, reply=signed_integer),
    attribute("AUToscale:CHANnels", Choice(("ALL", "DISPlayed")), "state.autoscale_channels"),
)
"""Root and common commands."""


# --- pictures


def _picture(model: SimulatedDso7104B, kind: str, area: str | None, palette: str | None) -> Any:
    """Return the screen; a TIFF is the graticule in two tones (5000 series guide; number of the refusal unverified)."""
    from simrack.instruments.dso7104b.screen import PictureStyle, screenshot  # noqa: PLC0415  # few take one

    if kind == "TIFF" and (area == "SCR" or palette in {"COL", "GRAY"}):
        raise ScpiError(-221)
    look = PictureStyle("MON" if kind == "TIFF" else palette or "COL", ink_saver=model.state.hardcopy.ink_saver)
    return model.look(lambda: block(screenshot(_traces(model), kind, look), 8))


def _traces(model: SimulatedDso7104B) -> dict[int, NDArray[Any]]:
    """Return the shown traces, each -0.5...0.5 of the screen, the math trace as the fifth; none without a record."""
    try:
        record = model.shown.record
    except ScpiError:
        return {}
    shown = [channel for channel in CHANNELS if model.state.channel[channel].shown]
    traces = {
        channel: (model.shown.trace(f"CHAN{channel}").volts - record.views[channel].offset_v)
        / record.views[channel].range_v
        for channel in shown
    }
    if model.state.function.shown:
        range_, offset = math_scale(model.state)
        traces[_MATH] = (math_trace(model.state, record, _POINTS).values - offset) / range_
    return traces


def _hard_copy_learned(model: SimulatedDso7104B) -> str:
    """Return the settings in the shape of a sibling's sample (from memory, unverified)."""
    state = model.state
    return (
        f':HARD:APR "";AREA {state.hardcopy.area};FACT {boolean(state.hardcopy.factors)};'
        f"FFE {boolean(state.hardcopy.form_feed)};INKS {boolean(state.hardcopy.ink_saver)};"
        f"PAL {state.hardcopy.palette};LAY {state.hardcopy.layout}"
    )


# --- system


def _setup(model: SimulatedDso7104B) -> bytes:
    """Return the setup as a block; its inside is ours.

    It is opaque, but of ASCII characters without the end of a line: PyMeasure's tests for a real DSOX1102G read it as
    text and send it back.
    """
    return block(base64.b64encode(msgspec.json.encode(model.state)), 8)


def _set_setup(model: SimulatedDso7104B, data: bytes) -> None:
    try:
        setup = msgspec.json.decode(base64.b64decode(data, validate=True), type=ScopeSettings)
    except (ValueError, msgspec.DecodeError):
        raise ScpiError(-161) from None
    model.restore(setup)


def _set_date(model: SimulatedDso7104B, year: int, month: int, day: int) -> None:
    model.date = (year, month, day)


def _set_time(model: SimulatedDso7104B, hour: int, minute: int, second: int) -> None:
    model.time = (hour, minute, second)


def _list_of(values: tuple[int, ...]) -> str:
    return ",".join(map(signed_integer, values))


def _display_learned(model: SimulatedDso7104B) -> str:
    """Return the settings in the shape of the siblings' sample (from memory, unverified)."""
    own = model.state.display
    connected = boolean(own.vectors)
    return f":DISP:LAB {boolean(own.labels)};CONN {connected};PERS {own.persistence};SOUR {own.memory}"


def _system_learned(model: SimulatedDso7104B) -> str:
    """Return the settings; the reply of a real one is not known."""
    state = model.state
    return f":SYST:LOCK {boolean(state.locked)};PROT:LOCK {boolean(state.protection_locked)}"


SYSTEM_COMMANDS = (
    Command("DISPlay", query=_display_learned),
    attribute("DISPlay:CONNect", Boolean(), "state.display.vectors", boolean),
    attribute("DISPlay:SOURce", Choice(("PMEMory<0-9>",)), "state.display.memory"),
    Command("SYSTem", query=_system_learned),
    attribute("DISPlay:VECTors", Boolean(), "state.display.vectors", boolean),
    attribute("DISPlay:LABel", Boolean(), "state.display.labels", boolean),
    attribute("DISPlay:PERSistence", Choice(("MINimum", "INFinite")), "state.display.persistence"),
    Command("DISPlay:CLEar", do=nothing),
    Command(
        "DISPlay:DATA",
        query=_picture,
        query_parameters=(
            Choice(("PNG", "BMP", "BMP8bit", "TIFF"), required=False, default="PNG"),
            Choice(("SCReen", "GRATicule"), required=False),
            Choice(("COLor", "GRAYscale", "MONochrome"), required=False),
        ),
        reply=bytes,
    ),
    Command("HARDcopy", query=_hard_copy_learned),
    attribute("HARDcopy:AREA", Choice(("SCReen",)), "state.hardcopy.area"),
    attribute("HARDcopy:FACTors", Boolean(), "state.hardcopy.factors", boolean),
    attribute("HARDcopy:FFEed", Boolean(), "state.hardcopy.form_feed", boolean),
    attribute(
        "HARDcopy:FORMat", Choice(("BMP", "BMP8bit", "PNG", "CSV", "ASCiixy", "BINary")), "state.hardcopy.format"
    ),
    attribute("HARDcopy:INKSaver", Boolean(), "state.hardcopy.ink_saver", boolean),
    attribute("HARDcopy:LAYout", Choice(("LANDscape", "PORTrait")), "state.hardcopy.layout"),
    attribute("HARDcopy:PALette", Choice(("COLor", "GRAYscale", "NONE")), "state.hardcopy.palette"),
    Command("HARDcopy[:STARt]", do=nothing),
    Command("SYSTem:SETup", (Block(),), do=_set_setup, query=_setup, reply=bytes),
    attribute("SYSTem:DSP", Text(limit=254), "message", quoted),
    Command(
        "SYSTem:DATE",
        (Integer(limits=Limits(1980, 2099)), Integer(limits=Limits(1, 12)), Integer(limits=Limits(1, 31))),
        do=_set_date,
        query=lambda model: model.date,
        reply=_list_of,
    ),
    Command(
        "SYSTem:TIME",
        (Integer(limits=Limits(0, 23)), Integer(limits=Limits(0, 59)), Integer(limits=Limits(0, 59))),
        do=_set_time,
        query=lambda model: model.time,
        reply=_list_of,
    ),
    attribute("SYSTem:LOCK", Boolean(), "state.locked", boolean),
    attribute("SYSTem:PROTection:LOCK", Boolean(), "state.protection_locked", boolean),
)
"""Display, hard copy and system."""
