"""Commands of the E3631A's outputs and trigger.

Source: Keysight E3631A User's Guide E3631-90002, ed. 10, 2018 (p. 84-96).
"""

from __future__ import annotations

from operator import methodcaller
from typing import Any

from msgspec.structs import replace

from simrack import scpi
from simrack.instruments.e3631a.instrument import SimulatedE3631A
from simrack.instruments.e3631a.kinds import KINDS
from simrack.instruments.e3631a.system_commands import remote, remote_only

ROWS = scpi.Rows()

_PROGRAMMING_S = 0.05
"""From a programming command to the change at the output: the guide gives it as less than this (p. 187)."""
_READBACK_S = 0.1
"""MEASure?: the guide gives it as less than this (p. 187)."""

_VOLT_LIMITS = {kind.name: kind.volts._replace(default=None) for kind in KINDS}
_AMP_LIMITS = {kind.name: kind.amps._replace(default=None) for kind in KINDS}
"""Without DEF, which is a word of APPLy only (p. 91)."""


@remote_only
def _set_volts(supply: SimulatedE3631A, volts: float) -> None:
    supply.program(supply.selected, volts=volts)


@remote_only
def _set_amps(supply: SimulatedE3631A, amps: float) -> None:
    supply.program(supply.selected, amps=amps)


def _triggered_volts(supply: SimulatedE3631A) -> float:
    pending = supply.output.triggered_volts
    return supply.output.volts if pending is None else pending


def _triggered_amps(supply: SimulatedE3631A) -> float:
    pending = supply.output.triggered_amps
    return supply.output.amps if pending is None else pending


@remote_only
def _apply(supply: SimulatedE3631A, name: str, volts: Any, amps: Any) -> None:
    kind = supply.outputs[name].kind
    volts = None if volts is None else scpi.Number(unit="V", limits=kind.volts).settle(volts, supply)
    amps = None if amps is None else scpi.Number(unit="A", limits=kind.amps).settle(amps, supply)
    supply.selected = name
    supply.program(name, volts=volts, amps=amps)


@remote_only
def _select_number(supply: SimulatedE3631A, number: int) -> None:
    supply.selected = KINDS[number - 1].name


@remote_only
def _couple(supply: SimulatedE3631A, *names: str) -> None:
    if ("ALL" in names or "NONE" in names) and len(names) > 1:
        raise scpi.ScpiError(-108)
    wanted = tuple(kind.name for kind in KINDS if kind.name in names or "ALL" in names)
    if supply.tracking and {"P25V", "N25V"} <= set(wanted):
        raise scpi.ScpiError(800)
    supply.coupled = wanted


@remote_only
def _track(supply: SimulatedE3631A, state: object) -> None:
    if state and {"P25V", "N25V"} <= set(supply.coupled):
        raise scpi.ScpiError(801)
    supply.tracking = bool(state)
    if state:
        supply.program("P25V", volts=supply.outputs["P25V"].volts)
    supply.drive()


@remote_only
def _initiate(supply: SimulatedE3631A) -> None:
    if supply.initiated or supply.transfer_at_s is not None:
        raise scpi.ScpiError(-213)
    if supply.trigger_source == "IMM":
        supply.transfer()
    else:
        supply.initiated = True


def _trigger(supply: SimulatedE3631A) -> None:
    if not supply.initiated:
        raise scpi.ScpiError(-211)
    supply.initiated = False
    supply.transfer_at_s = supply.world.clock.now() + supply.trigger_delay_s
    supply.plan()
    supply.service()


_NR3 = scpi.real(8)
_OUTPUT = scpi.Choice(("P6V", "P25V", "N25V"))
_OUTPUT_OR_SELECTED = (scpi.Choice(("P6V", "P25V", "N25V"), required=False),)
_VOLTS = scpi.Number(unit="V", limits=lambda supply: _VOLT_LIMITS[supply.selected])
_AMPS = scpi.Number(unit="A", limits=lambda supply: _AMP_LIMITS[supply.selected])


@ROWS.query(
    "APPLy",
    (
        _OUTPUT,
        scpi.Number(unit="V", required=False, deferred=True),
        scpi.Number(unit="A", required=False, deferred=True),
    ),
    do=_apply,
    query_parameters=_OUTPUT_OR_SELECTED,
    reply=scpi.quoted,
    takes_s=_PROGRAMMING_S,
    reads=True,
)
def _applied(supply: SimulatedE3631A, name: str | None) -> str:
    output = supply.outputs[name or supply.selected]
    return f"{output.volts:.6f},{output.amps:.6f}"


@ROWS.query("MEASure[:VOLTage][:DC]", query_parameters=_OUTPUT_OR_SELECTED, reply=_NR3, query_takes_s=_READBACK_S)
def _measure_volts(supply: SimulatedE3631A, name: str | None) -> float:
    supply.observe()
    return supply.outputs[name or supply.selected].voltage_reading()


@ROWS.query("MEASure:CURRent[:DC]", query_parameters=_OUTPUT_OR_SELECTED, reply=_NR3, query_takes_s=_READBACK_S)
def _measure_amps(supply: SimulatedE3631A, name: str | None) -> float:
    supply.observe()
    return supply.outputs[name or supply.selected].current_reading()


OUTPUT_COMMANDS = (
    *ROWS,
    remote(scpi.attribute("INSTrument[:SELect]", _OUTPUT, "selected")),
    scpi.attribute(
        "INSTrument:NSELect",
        scpi.Integer(limits=scpi.Limits(1, 3), named=False),
        "output.kind.number",
        scpi.bare_integer,
        do=_select_number,
        query_parameters=(),
    ),
    scpi.Command(
        "INSTrument:COUPle[:TRIGger]",
        (scpi.Choice(("ALL", "NONE", "P6V", "P25V", "N25V")),),
        do=_couple,
        query=lambda supply: "ALL" if len(supply.coupled) == len(KINDS) else ",".join(supply.coupled) or "NONE",
        repeat=True,
        reads=True,
    ),
    remote(
        scpi.attribute(
            "OUTPut[:STATe]",
            scpi.Boolean(),
            "output_on",
            scpi.boolean,
            then=methodcaller("drive"),
            takes_s=_PROGRAMMING_S,
        )
    ),
    scpi.attribute("OUTPut:TRACk[:STATe]", scpi.Boolean(), "tracking", scpi.boolean, do=_track, takes_s=_PROGRAMMING_S),
    scpi.attribute(
        "[SOURce:]CURRent[:LEVel][:IMMediate][:AMPLitude]",
        _AMPS,
        "output.amps",
        _NR3,
        do=_set_amps,
        takes_s=_PROGRAMMING_S,
    ),
    replace(
        remote(scpi.attribute("[SOURce:]CURRent[:LEVel]:TRIGgered[:AMPLitude]", _AMPS, "output.triggered_amps", _NR3)),
        query=_triggered_amps,
    ),
    scpi.attribute(
        "[SOURce:]VOLTage[:LEVel][:IMMediate][:AMPLitude]",
        _VOLTS,
        "output.volts",
        _NR3,
        do=_set_volts,
        takes_s=_PROGRAMMING_S,
    ),
    replace(
        remote(
            scpi.attribute("[SOURce:]VOLTage[:LEVel]:TRIGgered[:AMPLitude]", _VOLTS, "output.triggered_volts", _NR3)
        ),
        query=_triggered_volts,
    ),
)

TRIGGER_COMMANDS = (
    scpi.Command("INITiate[:IMMediate]", do=_initiate),
    remote(
        scpi.attribute(
            "TRIGger[:SEQuence]:DELay", scpi.Number(unit="S", limits=scpi.Limits(0.0, 3600.0)), "trigger_delay_s", _NR3
        )
    ),
    remote(scpi.attribute("TRIGger[:SEQuence]:SOURce", scpi.Choice(("BUS", "IMMediate")), "trigger_source")),
    scpi.Command("*TRG", do=_trigger),
)
