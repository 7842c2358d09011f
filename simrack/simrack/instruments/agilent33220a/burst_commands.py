"""BURSt and TRIGger."""

from __future__ import annotations

import math

from simrack.instruments.agilent33220a.declarations import POLARITIES, SLOPES, angle, mode_switch, nr3, setting
from simrack.instruments.agilent33220a.instrument import SimulatedAgilent33220A as _Model
from simrack.instruments.agilent33220a.settings import conflict
from simrack.scpi import Choice, Command, Limits, Number, Rows, ScpiError, attribute

ROWS = Rows()


def _fit_burst_mode(model: _Model) -> None:
    """Triggered bursts of noise are none: the burst is off then."""
    model.rules.select(model.state.function)
    model.restart()


@ROWS.attribute(
    "[SOURce:]BURSt:NCYCles",
    Number(limits=Limits(1, 50000), words={"INFinity": math.inf}, name="burst count"),
    "state.cycles",
    nr3,
)
def _set_cycles(model: _Model, cycles: float) -> None:
    model.state.cycles = cycles
    if math.isinf(cycles) and model.state.trigger == "IMM":
        model.state.trigger = "BUS"
        model.engine.report(conflict("infinite burst changed trigger source to MANUAL"))
        model.restart()
    model.settle()


@ROWS.attribute("TRIGger:SOURce", Choice(("IMMediate", "EXTernal", "BUS")), "state.trigger")
def _set_trigger(model: _Model, source: str) -> None:
    if source == "IMM" and math.isinf(model.state.cycles):
        model.state.cycles = 50000.0
        model.engine.report(conflict("turned off infinite burst to allow immediate trigger source"))
    model.state.trigger = source
    model.restart()


@ROWS.do("*TRG", urgent=True)
def _bus_trigger(model: _Model) -> None:
    if model.state.trigger != "BUS":
        raise ScpiError(-211)
    model.fire()


COMMANDS = (
    *ROWS,
    attribute("[SOURce:]BURSt:MODE", Choice(("TRIGgered", "GATed")), "state.burst_mode", then=_fit_burst_mode),
    setting(
        "[SOURce:]BURSt:INTernal:PERiod",
        Number(unit="S", limits=Limits(1e-6, 500.0), name="burst period"),
        "state.burst_period_s",
        nr3,
    ),
    angle("[SOURce:]BURSt:PHASe", "state.burst_phase_deg", -360.0, 360.0),
    mode_switch("[SOURce:]BURSt:STATe", "BURS"),
    setting("[SOURce:]BURSt:GATE:POLarity", POLARITIES, "state.gate"),
    setting("TRIGger:SLOPe", SLOPES, "state.slope"),
    setting("TRIGger:DELay", Number(unit="S", limits=Limits(0.0, 85.0), name="trigger delay"), "state.delay_s", nr3),
    Command("TRIGger", do=lambda model: model.fire()),
)
