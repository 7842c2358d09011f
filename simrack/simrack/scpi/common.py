"""The commands that every SCPI instrument has: IEEE 488.2 section 10, SYSTem:ERRor?."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter
from typing import Any

from simrack.scpi.attributes import attribute
from simrack.scpi.dialect import RS232
from simrack.scpi.engine import ScpiModel
from simrack.scpi.errors import ScpiError
from simrack.scpi.formats import boolean
from simrack.scpi.parameters import Integer, Limits
from simrack.scpi.status import Register
from simrack.scpi.table import Command

_INTEGER = "engine.dialect.integer"
_MASK_8 = Integer(limits=Limits(0, 255), named=False)
MASK_16 = Integer(limits=Limits(0, 32767), named=False)
"""Parameter of an enable register."""
_FLAG = Integer(limits=Limits(-32767, 32767), named=False)
"""Parameter of *PSC: a number, not ON or OFF; anything but 0 is on (IEEE 488.2, 10.25)."""


def reset(model: ScpiModel) -> None:
    """*RST, and presets of a model with other words."""
    model.engine.remembered.clear()
    model.reset()


def next_error(model: ScpiModel) -> str:
    """SYSTem:ERRor?: take the oldest error, as `-113,"Undefined header"`."""
    number, words = model.engine.errors.pop()
    return f'{model.engine.dialect.error_number(number)},"{words}"'


COMMON_COMMANDS = (
    Command("*CLS", do=lambda model: model.engine.clear_status()),
    attribute("*ESE", _MASK_8, "engine.status.ese", _INTEGER, query_parameters=()),
    Command("*ESR", query=lambda model: model.engine.dialect.integer(model.engine.status.read_esr())),
    Command("*IDN", query=lambda model: model.identity(), indefinite=True, reads=True),
    Command(
        "*OPC",
        do=lambda model: model.engine.announce_completion(),
        query=lambda model: model.engine.when_operations_end(lambda: "1"),
    ),
    attribute("*PSC", _FLAG, "engine.clears_masks_at_power_on", boolean, convert=bool, query_parameters=()),
    Command("*RST", do=reset),
    attribute("*SRE", _MASK_8, "engine.status.sre", _INTEGER, convert=lambda mask: mask & ~64, query_parameters=()),
    Command(
        "*STB",
        query=lambda model: model.engine.dialect.integer(model.engine.status.master(model.engine.status_now())),
        reads=True,
    ),
    Command("*WAI", do=lambda model: model.engine.when_operations_end(lambda: None)),
    Command("SYSTem:ERRor", query=next_error),
)
"""Mandatory common commands and the error queue. *TRG, *TST?, *SAV and *RCL stand in the models' own tables."""


def _switched_over(*, local: bool) -> Callable[[Any], None]:
    def switch(model: Any) -> None:
        if model.engine.interface is not RS232:
            raise ScpiError(514)
        model.local = local

    return switch


SERIAL_COMMANDS = (
    Command("SYSTem:LOCal", do=_switched_over(local=True)),
    Command("SYSTem:REMote", do=_switched_over(local=False)),
    Command("SYSTem:RWLock", do=_switched_over(local=False)),
)
"""The way into remote, and back, of what was built before IEEE 488.2 knew RS-232: its bus has lines for them."""


def event(pattern: str, register: Callable[[Any], Register]) -> Command:
    """Declare the query that reads and clears an event register."""
    return Command(pattern, query=lambda model: model.engine.dialect.integer(register(model).read_event()))


def condition(pattern: str, register: Callable[[Any], Register]) -> Command:
    """Declare the query of a condition register."""
    return Command(pattern, query=lambda model: model.engine.dialect.integer(register(model).condition), reads=True)


def enable(pattern: str, register: str) -> Command:
    """Declare command and query of an enable register (0 to 32767); `register` is its path from the model on."""
    return attribute(pattern, MASK_16, f"{register}.enable", _INTEGER, query_parameters=())


def status_commands(name: str, register: str, *, lacking: tuple[str, ...] = ()) -> tuple[Command, ...]:
    """Declare the nodes that SCPI-99 demands of STATus:OPERation or QUEStionable: event, condition and enable.

    Args:
        name: `OPERation` or `QUEStionable`.
        register: path of the register from the model on.
        lacking: those of `event`, `condition`, `enable` that the model has not.
    """
    of = attrgetter(register)
    rows = {
        "event": event(f"STATus:{name}[:EVENt]", of),
        "condition": condition(f"STATus:{name}:CONDition", of),
        "enable": enable(f"STATus:{name}:ENABle", register),
    }
    return tuple(row for kind, row in rows.items() if kind not in lacking)
