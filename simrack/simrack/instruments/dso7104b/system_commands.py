"""Root commands, display, hard copy and system of the DSO7104B."""

from __future__ import annotations

import base64
from collections.abc import Generator
from typing import Any

import msgspec
from numpy.typing import NDArray

from simrack import scpi
from simrack.instruments.dso7104b import declarations
from simrack.instruments.dso7104b.instrument import SimulatedDso7104B
from simrack.instruments.dso7104b.math_settings import math_scale, math_trace
from simrack.instruments.dso7104b.settings import CHANNELS, ScopeSettings
from simrack.scpi import Pending

ROWS = scpi.Rows()

_PLACES = scpi.Integer(limits=scpi.Limits(0, 9))
_POINTS = 1000
_OPTIONS = "0,0,0,0,MEMUP,0,0,0,0,0,0,0"
"""A field an option, 0 where it is not fitted: memory alone (how many follow is unverified)."""
_MENU = scpi.Choice(("MASK", "MEASure", "SEGMented", "LISTer", "POWer"))
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
    return model.look(lambda: scpi.Pending.worked_out(_activity_now(model)))


def _activity_now(model: SimulatedDso7104B) -> Generator[None, None, str]:
    edges = levels = 0
    for bit, channel in enumerate(CHANNELS):
        trace = yield from model.shown.tracing(f"CHAN{channel}")
        above = trace.volts >= model.state.levels_v[f"CHAN{channel}"]
        edges |= bool(above.any() and not above.all()) << bit
        levels |= bool(above[-1]) << bit
    return f"{scpi.signed_integer(edges)},{scpi.signed_integer(levels)}"


ROOT_COMMANDS = (
    scpi.Command("*OPT", query=lambda _: _OPTIONS, reads=True),
    scpi.Command("*TST", query=lambda _: 0, reply=scpi.signed_integer, query_takes_s=5.0),
    scpi.Command("*TRG", do=_digitize),
    scpi.Command("*SAV", (_PLACES,), do=lambda model, place: model.save(place)),
    scpi.Command("*RCL", (_PLACES,), do=lambda model, place: model.recall(place)),
    scpi.Command("*LRN", query=lambda model: b":SYST:SET " + _setup(model)),
    scpi.Command("RUN", do=lambda model: model.run_now()),
    scpi.Command("STOP", do=lambda model: model.stop()),
    scpi.Command("SINGle", do=lambda model: model.single()),
    scpi.Command("DIGitize", (declarations.SourceParameter(required=False),), do=_digitize, repeat=True),
    scpi.Command(
        "AUToscale",
        (scpi.Choice(("CHANnel<1-4>",), required=False),),
        do=lambda model, *_: model.autoscale(),
        repeat=True,
    ),
    scpi.Command("CDISplay", do=declarations.nothing),
    scpi.Command("BLANk", (declarations.OPTIONAL_SOURCE,), do=_blank),
    scpi.Command("VIEW", (declarations.SOURCE,), do=lambda model, source: _show(model, source, shown=True)),
    scpi.Command(
        "STATus",
        query=lambda model, source: model.state.is_shown(source),
        query_parameters=(declarations.SOURCE,),
        reply=scpi.boolean,
    ),
    scpi.Command("AER", query=lambda model: model.armed(), reply=scpi.signed_integer),
    scpi.Command("TER", query=lambda model: model.was_triggered(), reply=scpi.signed_integer),
    scpi.Command("SERial", query=lambda model: model.identity().split(",")[2], reads=True),
    scpi.Command("PRINt", do=declarations.nothing),
    scpi.Command("MERGe", (scpi.Choice(("PMEMory<0-9>",)),), do=declarations.nothing),
    scpi.Command("ACTivity", do=declarations.nothing, query=_activity),
    scpi.Command(
        "OPERegister:CONDition", query=lambda model: model.operation.condition, reply=scpi.signed_integer, reads=True
    ),
    *declarations.registers("OPEE", "OPERegister[:EVENt]", lambda model: model.operation),
    *declarations.registers("OVLenable", "OVLRegister", lambda model: model.overload),
    *declarations.registers("HWEenable", "HWERegister[:EVENt]", lambda model: model.hardware),
    scpi.Command(
        "HWERegister:CONDition", query=lambda model: model.hardware.condition, reply=scpi.signed_integer, reads=True
    ),
    scpi.attribute("AUToscale:CHANnels", scpi.Choice(("ALL", "DISPlayed")), "state.autoscale_channels"),
)
"""Root and common commands."""


# --- pictures


@ROWS.query(
    "DISPlay:DATA",
    query_parameters=(
        scpi.Choice(("PNG", "BMP", "BMP8bit", "TIFF"), required=False, default="PNG"),
        scpi.Choice(("SCReen", "GRATicule"), required=False),
        scpi.Choice(("COLor", "GRAYscale", "MONochrome"), required=False),
    ),
    reply=bytes,
)
def _picture(model: SimulatedDso7104B, kind: str, area: str | None, palette: str | None) -> Any:
    """Return the screen; a TIFF is the graticule in two tones (5000 series guide; number of the refusal unverified)."""
    from simrack.instruments.dso7104b.screen import PictureStyle, screenshot  # noqa: PLC0415  # few take one

    if kind == "TIFF" and (area == "SCR" or palette in {"COL", "GRAY"}):
        raise scpi.ScpiError(-221)
    look = PictureStyle("MON" if kind == "TIFF" else palette or "COL", ink_saver=model.state.hardcopy.ink_saver)

    def taking() -> Generator[None, None, bytes]:
        traces = yield from _traces(model)
        return scpi.block((yield from screenshot(traces, kind, look)), 8)

    return model.look(lambda: scpi.Pending.worked_out(taking()))


def _traces(model: SimulatedDso7104B) -> Generator[None, None, dict[int, NDArray[Any]]]:
    """Return the shown traces, each -0.5...0.5 of the screen, the math trace as the fifth; none without a record."""
    try:
        record = model.shown.record
    except scpi.ScpiError:
        return {}
    traces = {}
    for channel in CHANNELS:
        if model.state.channel[channel].shown:
            view, trace = record.views[channel], (yield from model.shown.tracing(f"CHAN{channel}"))
            traces[channel] = (trace.volts - view.offset_v) / view.range_v
            yield
    if model.state.function.shown:
        range_, offset = math_scale(model.state)
        traces[_MATH] = (math_trace(model.state, record, _POINTS).values - offset) / range_
    return traces


# --- system


def _setup(model: SimulatedDso7104B) -> bytes:
    """Return the setup as a block; its inside is ours.

    It is opaque, but of ASCII characters without the end of a line: PyMeasure's tests for a real DSOX1102G read it as
    text and send it back.
    """
    return scpi.block(base64.b64encode(msgspec.json.encode(model.state)), 8)


@ROWS.do("SYSTem:SETup", (scpi.Block(),), query=_setup, reply=bytes)
def _set_setup(model: SimulatedDso7104B, data: bytes) -> None:
    try:
        setup = msgspec.json.decode(base64.b64decode(data, validate=True), type=ScopeSettings)
    except (ValueError, msgspec.DecodeError):
        raise scpi.ScpiError(-161) from None
    model.restore(setup)


def _moment(name: str, *limits: tuple[int, int]) -> scpi.Command:
    """Declare a date or a time: three whole numbers."""
    return scpi.Command(
        f"SYSTem:{name.upper()}",
        tuple(scpi.Integer(limits=scpi.Limits(*each)) for each in limits),
        do=lambda model, *values: setattr(model, name, values),
        query=lambda model: getattr(model, name),
        reply=scpi.comma_list(scpi.signed_integer),
        reads=True,
    )


SYSTEM_COMMANDS = (
    *ROWS,
    # the shapes of the siblings' samples, from memory; the system's is not known
    declarations.learned(
        "HARDcopy",
        ':HARD:APR "";AREA {0.hardcopy.area};FACT {0.hardcopy.factors:d};FFE {0.hardcopy.form_feed:d};'
        "INKS {0.hardcopy.ink_saver:d};PAL {0.hardcopy.palette};LAY {0.hardcopy.layout}",
    ),
    declarations.learned(
        "DISPlay",
        ":DISP:LAB {0.display.labels:d};CONN {0.display.vectors:d};"
        "PERS {0.display.persistence};SOUR {0.display.memory}",
    ),
    declarations.learned("SYSTem", ":SYST:LOCK {0.locked:d};PROT:LOCK {0.protection_locked:d}"),
    scpi.attribute("DISPlay:CONNect", scpi.Boolean(), "state.display.vectors", scpi.boolean),
    scpi.attribute("DISPlay:SOURce", scpi.Choice(("PMEMory<0-9>",)), "state.display.memory"),
    scpi.attribute("DISPlay:VECTors", scpi.Boolean(), "state.display.vectors", scpi.boolean),
    scpi.attribute("DISPlay:LABel", scpi.Boolean(), "state.display.labels", scpi.boolean),
    scpi.attribute("DISPlay:PERSistence", scpi.Choice(("MINimum", "INFinite")), "state.display.persistence"),
    scpi.Command("DISPlay:CLEar", do=declarations.nothing),
    scpi.attribute("HARDcopy:AREA", scpi.Choice(("SCReen",)), "state.hardcopy.area"),
    scpi.attribute("HARDcopy:FACTors", scpi.Boolean(), "state.hardcopy.factors", scpi.boolean),
    scpi.attribute("HARDcopy:FFEed", scpi.Boolean(), "state.hardcopy.form_feed", scpi.boolean),
    scpi.attribute(
        "HARDcopy:FORMat", scpi.Choice(("BMP", "BMP8bit", "PNG", "CSV", "ASCiixy", "BINary")), "state.hardcopy.format"
    ),
    scpi.attribute("HARDcopy:INKSaver", scpi.Boolean(), "state.hardcopy.ink_saver", scpi.boolean),
    scpi.attribute("HARDcopy:LAYout", scpi.Choice(("LANDscape", "PORTrait")), "state.hardcopy.layout"),
    scpi.attribute("HARDcopy:PALette", scpi.Choice(("COLor", "GRAYscale", "NONE")), "state.hardcopy.palette"),
    scpi.Command("HARDcopy[:STARt]", do=declarations.nothing),
    scpi.Command("SYSTem:MENU", (_MENU,), do=declarations.nothing),
    scpi.Command("SYSTem:PRESet", do=scpi.reset),
    scpi.attribute("SYSTem:DSP", scpi.Text(limit=254), "message", scpi.quoted),
    _moment("date", (1980, 2099), (1, 12), (1, 31)),
    _moment("time", (0, 23), (0, 59), (0, 59)),
    scpi.attribute("SYSTem:LOCK", scpi.Boolean(), "state.locked", scpi.boolean),
    scpi.attribute("SYSTem:PROTection:LOCK", scpi.Boolean(), "state.protection_locked", scpi.boolean),
)
"""Display, hard copy and system."""
