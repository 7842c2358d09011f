"""Time base and acquisition of the DSO7104B."""

from __future__ import annotations

from simrack.instruments.dso7104b.declarations import clipped, learned
from simrack.instruments.dso7104b.instrument import SimulatedDso7104B
from simrack.instruments.dso7104b.sampling import memory_points, sample_rate_hz
from simrack.scpi import (
    Boolean,
    Choice,
    Command,
    Integer,
    Limits,
    Number,
    Rows,
    ScpiError,
    attribute,
    boolean,
    signed_integer,
)

ROWS = Rows()

_RANGE = Number(unit="S", limits=Limits(5e-9, 500.0))
_SCALE = Number(unit="S", limits=Limits(500e-12, 50.0))
_POSITION = Number(unit="S", limits=Limits(-500.0, 500.0))


def _scale(pattern: str, name: str) -> Command:
    """Declare a scale, a tenth of the range of the same window."""

    def write(model: SimulatedDso7104B, seconds: float) -> None:
        setattr(model.state.timebase, name, 10.0 * seconds)

    return Command(
        pattern,
        (_SCALE,),
        do=write,
        query=lambda model: model.nr3(getattr(model.state.timebase, name) / 10.0),
        reads=True,
    )


@ROWS.attribute("ACQuire:SEGMented:INDex", Integer(), "state.acquire.segment", signed_integer)
def _set_index(model: SimulatedDso7104B, index: float) -> None:
    """Show another segment: one of those that were acquired."""
    model.state.acquire.segment = int(clipped(model, index, 1, max(1, model.shown.segments())))


@ROWS.do("ACQuire:SEGMented:ANALyze")
def _analyze(model: SimulatedDso7104B) -> None:
    """Measure over all segments; without any the settings are in conflict (number of the refusal unverified)."""
    if not model.shown.segments():
        raise ScpiError(-221)
    model.shown.analysed = True


TIMING_COMMANDS = (
    *ROWS,
    learned(
        "TIMebase",
        ":TIM:MODE {0.timebase.mode};REF {0.timebase.reference};"
        "MAIN:RANG {0.timebase.range_s:+.2E};POS {0.timebase.position_s:+.1E}",
    ),
    learned(  # in the shape of the siblings' guides (unverified for this model)
        "ACQuire",
        ":ACQ:MODE {0.acquire.mode};TYPE {0.acquire.type};COMP {0.acquire.complete_percent};"
        "COUN {0.acquire.count};SEGM:COUN {0.acquire.segments}",
    ),
    attribute("TIMebase:MODE", Choice(("MAIN", "WINDow", "XY", "ROLL")), "state.timebase.mode"),
    attribute("TIMebase[:MAIN]:RANGe", _RANGE, "state.timebase.range_s", "nr3"),
    _scale("TIMebase:SCALe", "range_s"),
    attribute("TIMebase[:MAIN]:POSition", _POSITION, "state.timebase.position_s", "nr3"),
    attribute("TIMebase:DELay", _POSITION, "state.timebase.position_s", "nr3"),
    attribute("TIMebase:REFerence", Choice(("LEFT", "CENTer", "RIGHt")), "state.timebase.reference"),
    attribute("TIMebase:VERNier", Boolean(), "state.timebase.vernier", boolean),
    attribute("TIMebase:WINDow:POSition", _POSITION, "state.timebase.window_position_s", "nr3"),
    attribute("TIMebase:WINDow:RANGe", _RANGE, "state.timebase.window_range_s", "nr3"),
    _scale("TIMebase:WINDow:SCALe", "window_range_s"),
    attribute("ACQuire:TYPE", Choice(("NORMal", "AVERage", "HRESolution", "PEAK")), "state.acquire.type"),
    attribute("ACQuire:MODE", Choice(("RTIMe", "ETIMe", "SEGMented")), "state.acquire.mode"),
    attribute("ACQuire:COUNt", Integer(limits=Limits(2, 65536)), "state.acquire.count", signed_integer),
    attribute("ACQuire:COMPlete", Integer(limits=Limits(0, 100)), "state.acquire.complete_percent", signed_integer),
    attribute("ACQuire:SEGMented:COUNt", Integer(limits=Limits(2, 2000)), "state.acquire.segments", signed_integer),
    Command(
        "ACQuire:POINts", query=lambda model: memory_points(model.state, model.kind), reply=signed_integer, reads=True
    ),
    Command("ACQuire:SRATe", query=lambda model: model.nr3(sample_rate_hz(model.state, model.kind)), reads=True),
)
"""What is said to :TIMebase and :ACQuire."""
