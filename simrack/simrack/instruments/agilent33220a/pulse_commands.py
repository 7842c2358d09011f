"""PULSe and FUNCtion:PULSe: period, width, duty cycle and edges."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.instruments.agilent33220a.declarations import TUNE_S, nr3, setting
from simrack.instruments.agilent33220a.rules import longest_edge_s, width_limits_s
from simrack.scpi import Choice, Command, Limits, Number

if TYPE_CHECKING:
    from simrack.instruments.agilent33220a.instrument import SimulatedAgilent33220A as _Model


def _duty_of_pulse_limits(model: _Model) -> Limits:
    shortest, longest = width_limits_s(model.state, model.kind)
    return Limits(100.0 * shortest * model.state.frequency_hz, 100.0 * longest * model.state.frequency_hz)


def _set_pulse_duty(model: _Model, percent: float) -> None:
    model.state.width_s = percent / 100.0 / model.state.frequency_hz
    model.settle()


COMMANDS = (
    Command(
        "[SOURce:]PULSe:PERiod",
        (Number(unit="S", limits=Limits(200e-9, 2000.0)),),
        do=lambda model, seconds: model.set_frequency(1.0 / seconds),
        query=lambda model: 1.0 / model.state.frequency_hz,
        reply=nr3,
        takes_s=TUNE_S,
    ),
    # Widths that fit the period, s
    setting(
        "[SOURce:]FUNCtion:PULSe:WIDTh",
        Number(
            unit="S",
            limits=lambda model: Limits(*width_limits_s(model.state, model.kind)),
            name="pulse width limited by period",
        ),
        "state.width_s",
        nr3,
    ),
    Command(
        "[SOURce:]FUNCtion:PULSe:DCYCle",
        (Number(unit="PCT", limits=_duty_of_pulse_limits, name="pulse duty cycle limited by period"),),
        do=_set_pulse_duty,
        query=lambda model: 100.0 * model.state.width_s * model.state.frequency_hz,
        reply=nr3,
    ),
    setting("[SOURce:]FUNCtion:PULSe:HOLD", Choice(("WIDTh", "DCYCle")), "state.hold"),
    setting(
        "[SOURce:]FUNCtion:PULSe:TRANsition",
        Number(
            unit="S",
            limits=lambda model: Limits(model.kind.edge_s[0], longest_edge_s(model.state, model.kind)),
            name="pulse edge time",
        ),
        "state.edge_s",
        nr3,
    ),
)
