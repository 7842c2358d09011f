"""PULSe and FUNCtion:PULSe: period, width, duty cycle and edges."""

from __future__ import annotations

from simrack.instruments.agilent33220a.declarations import TUNE_S, nr3, part_of_period, setting
from simrack.instruments.agilent33220a.rules import longest_edge_s, width_limits_s
from simrack.scpi import Choice, Command, Limits, Number

COMMANDS = (
    Command(
        "[SOURce:]PULSe:PERiod",
        (Number(unit="S", limits=Limits(200e-9, 2000.0)),),
        do=lambda model, seconds: model.set_frequency(1.0 / seconds),
        query=lambda model: 1.0 / model.state.frequency_hz,
        reply=nr3,
        takes_s=TUNE_S,
        reads=True,
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
    part_of_period("[SOURce:]FUNCtion:PULSe:DCYCle", "width_s", width_limits_s, "pulse duty cycle limited by period"),
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
