"""Time base and acquisition of the DSO7104B."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.instruments.dso7104b.declarations import clipped, number, setting
from simrack.instruments.dso7104b.sampling import memory_points, sample_rate_hz
from simrack.scpi import Boolean, Choice, Command, Integer, Limits, Number, ScpiError, boolean, signed_integer

if TYPE_CHECKING:
    from simrack.instruments.dso7104b.instrument import SimulatedDso7104B

_RANGE = Number(unit="S", limits=Limits(5e-9, 500.0))
_SCALE = Number(unit="S", limits=Limits(500e-12, 50.0))
_POSITION = Number(unit="S", limits=Limits(-500.0, 500.0))


def _scale(name: str, key: str) -> Command:
    """Declare a scale, a tenth of the range of the same window."""

    def write(model: SimulatedDso7104B, seconds: float) -> None:
        model.state[key] = 10.0 * seconds

    return Command(
        name, (_SCALE,), do=write, query=lambda model: model.nr3(model.state[key] / 10.0), query_parameters=()
    )


def _learned(model: SimulatedDso7104B) -> str:
    state = model.state
    return (
        f":TIM:MODE {state['TIM:MODE']};REF {state['TIM:REF']};"
        f"MAIN:RANG {state['TIM:RANG']:+.2E};POS {state['TIM:POS']:+.1E}"
    )


def _set_index(model: SimulatedDso7104B, index: float) -> None:
    """Show another segment: one of those that were acquired."""
    model.state["SEGM:IND"] = int(clipped(model, index, 1, max(1, model.shown.segments())))


def _analyze(model: SimulatedDso7104B) -> None:
    """Measure over all segments; without any the settings are in conflict (number of the refusal unverified)."""
    if not model.shown.segments():
        raise ScpiError(-221)
    model.shown.analysed = True


def _acquire_learned(model: SimulatedDso7104B) -> str:
    """Return how it acquires, in the shape of the siblings' guides (unverified for this model)."""
    state = model.state
    return (
        f":ACQ:MODE {state['ACQ:MODE']};TYPE {state['ACQ:TYPE']};COMP {state['ACQ:COMP']};"
        f"COUN {state['ACQ:COUN']};SEGM:COUN {state['SEGM:COUN']}"
    )


TIMING_COMMANDS = (
    Command("ACQuire", query=_acquire_learned),
    Command("TIMebase", query=_learned),
    setting("TIMebase:MODE", "TIM:MODE", Choice(("MAIN", "WINDow", "XY", "ROLL"))),
    number("TIMebase[:MAIN]:RANGe", "TIM:RANG", _RANGE),
    _scale("TIMebase:SCALe", "TIM:RANG"),
    number("TIMebase[:MAIN]:POSition", "TIM:POS", _POSITION),
    number("TIMebase:DELay", "TIM:POS", _POSITION),
    setting("TIMebase:REFerence", "TIM:REF", Choice(("LEFT", "CENTer", "RIGHt"))),
    setting("TIMebase:VERNier", "TIM:VERN", Boolean(), boolean),
    number("TIMebase:WINDow:POSition", "WIND:POS", _POSITION),
    number("TIMebase:WINDow:RANGe", "WIND:RANG", _RANGE),
    _scale("TIMebase:WINDow:SCALe", "WIND:RANG"),
    setting("ACQuire:TYPE", "ACQ:TYPE", Choice(("NORMal", "AVERage", "HRESolution", "PEAK"))),
    setting("ACQuire:MODE", "ACQ:MODE", Choice(("RTIMe", "ETIMe", "SEGMented"))),
    setting("ACQuire:COUNt", "ACQ:COUN", Integer(limits=Limits(2, 65536)), signed_integer),
    setting("ACQuire:COMPlete", "ACQ:COMP", Integer(limits=Limits(0, 100)), signed_integer),
    setting("ACQuire:SEGMented:COUNt", "SEGM:COUN", Integer(limits=Limits(2, 2000)), signed_integer),
    Command(
        "ACQuire:SEGMented:INDex",
        (Integer(),),
        do=_set_index,
        query=lambda model: model.state["SEGM:IND"],
        reply=signed_integer,
    ),
    Command("ACQuire:SEGMented:ANALyze", do=_analyze),
    Command("ACQuire:POINts", query=lambda model: memory_points(model.state, model.kind), reply=signed_integer),
    Command("ACQuire:SRATe", query=lambda model: model.nr3(sample_rate_hz(model.state, model.kind))),
)
"""What is said to :TIMebase and :ACQuire."""
