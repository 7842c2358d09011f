"""VOLTage and OUTPut:LOAD: amplitude, offset, levels, and the load and unit they are said for."""

from __future__ import annotations

import math

from simrack.instruments.agilent33220a.declarations import LEVEL_S, nr3
from simrack.instruments.agilent33220a.instrument import SimulatedAgilent33220A as _Model
from simrack.instruments.agilent33220a.settings import MAX_PEAK_V, conflict
from simrack.scpi import Boolean, Choice, Limits, Number, Quantity, Rows, attribute, boolean

ROWS = Rows()


def _amplitude_limits(model: _Model) -> Limits:
    unit = model.state.unit
    low, high, default = (
        model.levels.in_unit(oc * model.levels.share, unit)
        for oc in (model.kind.least_vpp, 2 * MAX_PEAK_V, 0.1 / model.levels.share)
    )
    return Limits(low, high, default=default)


def _offset_limits(model: _Model) -> Limits:
    room = model.levels.room_v() * model.levels.share
    return Limits(-room, room, default=0.0)


def _level_limits(model: _Model) -> Limits:
    return Limits(-model.levels.max_v(), model.levels.max_v())


def vpp_of(model: _Model, given: Quantity) -> float:
    """Return an amplitude argument in Vpp as shown, within the limits of the instrument."""
    unit = given.unit or model.state.unit
    if unit == "V":
        unit = "VPP"
    if unit == "DBM" and math.isinf(model.state.load_ohm):
        raise conflict("amplitude units changed to Vpp due to high-Z load")
    if unit != "DBM" and given.value <= 0.0:
        return model.levels.clipped(
            given.value, Limits(model.kind.least_vpp * model.levels.share, math.inf), "amplitude"
        )
    vpp = model.levels.in_vpp(given.value, unit)
    low, high = model.kind.least_vpp * model.levels.share, 2.0 * model.levels.max_v()
    if not low * (1 - 1e-12) <= vpp <= high * (1 + 1e-12):
        return model.levels.clipped(vpp, Limits(low, high), "amplitude")
    return model.levels.in_vpp(model.levels.rounded(given.value), unit)


def amplitude_shown(model: _Model) -> float:
    """Return the amplitude in the unit in use."""
    return model.levels.in_unit(model.levels.amplitude_vpp(), model.state.unit)


def offset_shown(model: _Model) -> float:
    """Return the offset into the assumed load, V."""
    return model.levels.offset_v()


def _levels(model: _Model) -> tuple[float, float]:
    """Return low and high level as shown."""
    half = model.levels.amplitude_vpp() / 2.0
    return offset_shown(model) - half, offset_shown(model) + half


@ROWS.do(
    "[SOURce:]VOLTage:HIGH",
    (Number(unit="V", limits=_level_limits, name="high level"),),
    query=lambda model: _levels(model)[1],
    reply=nr3,
    takes_s=LEVEL_S,
    reads=True,
)
def _set_high(model: _Model, high: float) -> None:
    low, gap = _levels(model)[0], model.kind.least_vpp * model.levels.share
    high = model.levels.rounded(high)
    if high - low < gap:
        low = max(high - gap, -model.levels.max_v())
        high = max(high, low + gap)
        model.engine.report(conflict("low level changed due to high level"))
    model.levels.set_high_and_low(high, low)
    model.update()


@ROWS.do(
    "[SOURce:]VOLTage:LOW",
    (Number(unit="V", limits=_level_limits, name="low level"),),
    query=lambda model: _levels(model)[0],
    reply=nr3,
    takes_s=LEVEL_S,
    reads=True,
)
def _set_low(model: _Model, low: float) -> None:
    high, gap = _levels(model)[1], model.kind.least_vpp * model.levels.share
    low = model.levels.rounded(low)
    if high - low < gap:
        high = min(low + gap, model.levels.max_v())
        low = min(low, high - gap)
        model.engine.report(conflict("high level changed due to low level"))
    model.levels.set_high_and_low(high, low)
    model.update()


def _set_unit(model: _Model, unit: str) -> None:
    if unit == "DBM" and math.isinf(model.state.load_ohm):
        unit = "VPP"
        model.engine.report(conflict("amplitude units changed to Vpp due to high-Z load"))
    model.state.unit = unit


@ROWS.attribute("[SOURce:]VOLTage:RANGe:AUTO", Boolean(words=("ONCE",)), "state.range_auto", boolean)
def _set_range_auto(model: _Model, state: object) -> None:
    model.state.range_auto = True
    model.update()
    model.state.range_auto = state is True


AMPLITUDE_UNITS = ("VPP", "VRMS", "DBM", "V")
AMPLITUDE = Number(unit=AMPLITUDE_UNITS, limits=_amplitude_limits, with_unit=True)
LOAD = Number(unit="OHM", limits=Limits(1.0, 10000.0, 50.0), words={"INFinity": math.inf})
OFFSET = Number(unit="V", limits=_offset_limits, name="offset")


@ROWS.do("[SOURce:]VOLTage", (AMPLITUDE,), query=amplitude_shown, reply=nr3, takes_s=LEVEL_S, reads=True)
def _set_amplitude(model: _Model, given: Quantity) -> None:
    model.levels.set_amplitude(vpp_of(model, given))
    model.update()


@ROWS.do("[SOURce:]VOLTage:OFFSet", (OFFSET,), query=offset_shown, reply=nr3, takes_s=LEVEL_S, reads=True)
def _set_offset(model: _Model, volts: float) -> None:
    model.levels.set_offset(model.levels.rounded(volts))
    model.update()


@ROWS.attribute("OUTPut:LOAD", LOAD, "state.load_ohm", nr3)
def _set_load(model: _Model, ohm: float) -> None:
    """Change the load that voltages are shown for; the output stays."""
    model.state.load_ohm = ohm
    if math.isinf(ohm) and model.state.unit == "DBM":
        _set_unit(model, "DBM")


COMMANDS = (
    *ROWS,
    attribute("[SOURce:]VOLTage:UNIT", Choice(("VPP", "VRMS", "DBM")), "state.unit", do=_set_unit),
)
