"""SWEep, the frequencies it runs between, and MARKer."""

from __future__ import annotations

from collections.abc import Callable

from simrack.instruments.agilent33220a.declarations import FIRST_HZ, frequency_limits, mode_switch, nr3, setting
from simrack.instruments.agilent33220a.instrument import SimulatedAgilent33220A as _Model
from simrack.scpi import Boolean, Choice, Command, Limits, Number, boolean


def _sweep(pattern: str, read: Callable[[float, float], float], write: Callable[..., tuple[float, float]]) -> Command:
    """Declare one of STARt, STOP, CENTer, SPAN, which share two numbers."""

    def limits(model: _Model) -> Limits:
        high = model.kind.frequency_hz[model.state.function][1]
        return Limits(-high, high)

    def do(model: _Model, value: float) -> None:
        low, high = FIRST_HZ, model.kind.frequency_hz[model.state.function][1]
        wanted = write(model.state.start_hz, model.state.stop_hz, value)
        model.state.start_hz, model.state.stop_hz = (min(max(hz, low), high) for hz in wanted)
        model.restart()

    return Command(
        pattern,
        (Number(unit="HZ", limits=limits),),
        do=do,
        query=lambda model: read(model.state.start_hz, model.state.stop_hz),
        reply=nr3,
        reads=True,
    )


COMMANDS = (
    _sweep("[SOURce:]FREQuency:STARt", lambda start, _: start, lambda _, stop, value: (value, stop)),
    _sweep("[SOURce:]FREQuency:STOP", lambda _, stop: stop, lambda start, _, value: (start, value)),
    _sweep(
        "[SOURce:]FREQuency:CENTer",
        lambda start, stop: (start + stop) / 2.0,
        lambda start, stop, value: (value - (stop - start) / 2.0, value + (stop - start) / 2.0),
    ),
    _sweep(
        "[SOURce:]FREQuency:SPAN",
        lambda start, stop: stop - start,
        lambda start, stop, value: ((start + stop - value) / 2.0, (start + stop + value) / 2.0),
    ),
    setting("[SOURce:]SWEep:SPACing", Choice(("LINear", "LOGarithmic")), "state.spacing"),
    setting("[SOURce:]SWEep:TIME", Number(unit="S", limits=Limits(1e-3, 500.0)), "state.sweep_s", nr3),
    mode_switch("[SOURce:]SWEep:STATe", "SWE"),
    setting("MARKer:FREQuency", Number(unit="HZ", limits=frequency_limits), "state.marker_hz", nr3),
    setting("MARKer[:STATe]", Boolean(), "state.marker_on", boolean),
)
