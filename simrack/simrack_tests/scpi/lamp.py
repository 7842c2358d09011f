"""A small instrument for the tests of the interpreter: one of every kind of command."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from simrack.clock import VirtualClock
from simrack.scpi import (
    COMMON_COMMANDS,
    GPIB,
    Block,
    Boolean,
    Choice,
    Command,
    CommandTable,
    Dialect,
    Integer,
    Interface,
    Limits,
    Number,
    Pending,
    Register,
    ScpiEngine,
    ScpiTwin,
    Status,
    Text,
    Word,
    block,
    boolean,
    condition,
    enable,
    event,
    quoted,
    real,
    signed_integer,
)

if TYPE_CHECKING:
    from collections.abc import Callable


class Lamp(ScpiTwin):
    """Remembers what it is told."""

    def __init__(self, interface: Interface = GPIB, dialect: Dialect | None = None) -> None:
        self.clock = VirtualClock()
        self.questionable = Register()
        self.operation = Register()
        self.engine = ScpiEngine(
            self,
            TABLE,
            self.clock,
            dialect=dialect or Dialect(),
            interface=interface,
            status=Status({3: self.questionable, 7: self.operation}),
        )
        self.done_at_s = -math.inf
        self.aborted = 0
        self.triggers = 0
        self.armed: float | None = None
        self.heard: dict[str, object] = {}
        self.level = 1.0

    def identity(self) -> str:
        return "MAKER,LAMP,0,1.0"

    def reset(self) -> None:
        self.level = 0.0

    def abort(self) -> None:
        self.aborted += 1

    def operations_end_s(self) -> float:
        return self.done_at_s


def _answer(value: object) -> Callable[..., object]:
    return lambda *_: value


def _hear(name: str) -> Callable[..., None]:
    def hear(lamp: Lamp, *arguments: object) -> None:
        lamp.heard[name] = arguments

    return hear


def _set_level(lamp: Lamp, level: float) -> None:
    lamp.level = level


def _trigger(lamp: Lamp) -> None:
    lamp.triggers += 1
    lamp.armed = lamp.clock.now() + 1.0


def _arm(lamp: Lamp) -> Pending:
    lamp.armed = None
    return Pending(lambda: lamp.armed, lambda: None)


TABLE = CommandTable(
    *COMMON_COMMANDS,
    Command(
        "[SOURce:]VOLTage[:LEVel][:IMMediate][:AMPLitude]",
        (Number(unit="V", limits=Limits(0.0, 6.0, 1.0), name="level"),),
        do=_set_level,
        query=lambda lamp: lamp.level,
        reply=real(8),
    ),
    Command("[SOURce:]VOLTage:STEP", (Number(unit="V"),), do=_hear("step"), query=_answer(0.5), reply=real(3, 3)),
    Command("FREQuency", (Number(unit="HZ"),), do=_hear("frequency")),
    Command("AMPLitude", (Number(unit=("VPP", "DBM"), with_unit=True),), do=_hear("amplitude")),
    Command("CYCLes", (Number(limits=Limits(0.02, 100), legal=(0.02, 0.2, 1.0, 10.0, 100.0)),), do=_hear("cycles")),
    Command("COUNt", (Integer(limits=Limits(1, 100), words={"INFinity": math.inf}),), do=_hear("count")),
    Command("PLAIn", (Number(),), do=_hear("plain")),
    Command("OUTPut[:STATe]", (Boolean(words=("ONCE",)),), do=_hear("output"), query=_answer(1), reply=boolean),
    Command("TEXT", (Text(limit=12),), do=_hear("text"), query=_answer('say "it"'), reply=quoted),
    Command("CODE", (Word(),), do=_hear("code")),
    Command("DATA", (Block(),), do=_hear("data"), query=_answer(block(bytes(range(16)), 8))),
    Command("SHAPe", (Choice(("SINusoid", "SQUare")),), do=_hear("shape")),
    Command("DIGitize", (Choice(("CHANnel<1-4>",), required=False),), do=_hear("digitize"), repeat=True),
    Command(
        "CHANnel<1-4>:LABel",
        (Text(),),
        do=_hear("label"),
        query=lambda _, channel: channel,
        reply=signed_integer,
    ),
    Command("SLOW", query=_answer(5), query_takes_s=0.5),
    Command("ARM", do=_arm),
    Command("*TRG", do=_trigger, urgent=True),
    event("STATus:QUEStionable[:EVENt]", lambda lamp: lamp.questionable),
    condition("STATus:QUEStionable:CONDition", lambda lamp: lamp.questionable),
    enable("STATus:QUEStionable:ENABle", "questionable"),
)
