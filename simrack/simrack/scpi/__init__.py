"""The device side of SCPI-99 and IEEE 488.2, on which the simulated instruments are written.

A model is a table, a dialect, and handlers. The table reads like the manual's command list::

    def level_limits(model: "Lamp") -> Limits:          # MIN, MAX, DEF may depend on the state
        return Limits(0.0, 12.0 if model.high else 6.0, default=0.0)

    def set_level(model: "Lamp", volts: float) -> None: # handlers get the model, header suffixes, arguments
        model.level_v = volts                           # raise ScpiError(-221) to refuse

    def level(model: "Lamp") -> float:
        return model.level_v

    TABLE = CommandTable(
        *COMMON_COMMANDS,                               # *CLS *ESE *ESR? *IDN? *OPC *PSC *RST *SRE *STB? *WAI SYST:ERR?
        Command("[SOURce:]VOLTage[:LEVel]", (Number(unit="V", limits=level_limits),),
                do=set_level, query=level, reply=real(8)),
                                                        # gives VOLT 3, VOLT 300 MV, VOLT MAX, VOLT?, VOLT? MAX
        Command("OUTPut[:STATe]", (Boolean(),), do=set_output, query=output, reply=boolean, takes_s=0.05),
        Command("CHANnel<1-4>:LABel", (Text(limit=10),), do=set_label, query=label, reply=quoted),
                                                        # set_label(model, channel, text)
        Command("MEASure[:SCALar]", query=measure, query_parameters=(Choice(("CHANnel<1-4>",), required=False),)),
        Command("*TRG", do=trigger, urgent=True),
    )

    class Lamp(ScpiInstrument):
        def __init__(self, world: World) -> None:
            self.engine = ScpiEngine(self, TABLE, world.clock, dialect=Dialect(), interface=GPIB)
            self.reset()
        def identity(self) -> str: ...
        def reset(self) -> None: ...

Parameters: `Number`, `Integer`, `Boolean`, `Choice`, `Text`, `Block`; `required=False, default=...` for optional ones,
`Command(..., repeat=True)` for lists. Replies: `real(8)`, `signed_integer`, `bare_integer`, `boolean`, `quoted`,
`block`; a reply may be `str`, `bytes`, or `Parts` of megabytes.

What takes time: `takes_s` and `query_takes_s` delay a command's action; a handler may return
`Pending.at(instant, finish)` or `Pending(ready_at, finish)`, and later commands wait in the input buffer until then;
what takes this computer long, `Pending.worked_out(slices)`, a generator, so that a server does other things in between.
What happens by itself goes into the model's `service()` and `next_event_s()`; *OPC, *OPC? and *WAI ask
`operations_end_s()`.
"""

from simrack.scpi.attributes import Rows, Settings, attribute, remembered
from simrack.scpi.common import COMMON_COMMANDS, MASK_16, condition, enable, event, next_error, reset, status_commands
from simrack.scpi.dialect import GPIB, LAN, RS232, USB, Dialect, Interface
from simrack.scpi.engine import ScpiEngine, ScpiModel
from simrack.scpi.errors import ERROR_WORDS, ErrorQueue, ScpiError
from simrack.scpi.formats import (
    INFINITY,
    Parts,
    bare_integer,
    block,
    block_header,
    boolean,
    comma_list,
    quoted,
    real,
    signed_integer,
)
from simrack.scpi.mnemonics import Mnemonic
from simrack.scpi.parameters import (
    Block,
    Boolean,
    Choice,
    Integer,
    Limits,
    Number,
    Parameter,
    Quantity,
    Special,
    Text,
    Word,
    clip,
    refuse,
)
from simrack.scpi.pending import Pending
from simrack.scpi.status import Register, Status
from simrack.scpi.table import Command, CommandTable
from simrack.scpi.twin import ScpiTwin

__all__ = [
    "COMMON_COMMANDS",
    "ERROR_WORDS",
    "GPIB",
    "INFINITY",
    "LAN",
    "MASK_16",
    "RS232",
    "USB",
    "Block",
    "Boolean",
    "Choice",
    "Command",
    "CommandTable",
    "Dialect",
    "ErrorQueue",
    "Integer",
    "Interface",
    "Limits",
    "Mnemonic",
    "Number",
    "Parameter",
    "Parts",
    "Pending",
    "Quantity",
    "Register",
    "Rows",
    "ScpiEngine",
    "ScpiError",
    "ScpiModel",
    "ScpiTwin",
    "Settings",
    "Special",
    "Status",
    "Text",
    "Word",
    "attribute",
    "bare_integer",
    "block",
    "block_header",
    "boolean",
    "clip",
    "comma_list",
    "condition",
    "enable",
    "event",
    "next_error",
    "quoted",
    "real",
    "refuse",
    "remembered",
    "reset",
    "signed_integer",
    "status_commands",
]
