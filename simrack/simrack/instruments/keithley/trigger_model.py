"""Trigger models of the simulated DMM6500: SimpleLoop, and models of blocks.

Source: the Reference Manual's list of words (see its manual's page), pages of the 2461's and the DMM7510's for their
arguments, users' code. Unverified: errors, and that going back to a block takes 0.1 ms. Of the events that WAIT may
name, a command (``*TRG``) and the external trigger come here; a count without end is -222.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from functools import partial
from typing import Any, NamedTuple

from simrack import scpi
from simrack.instruments.keithley.reading_buffer import NAMED, BufferingMeter, require_buffer

ROWS = scpi.Rows()

_BACK_S = 1e-4
_BUFFER = "defbuffer1"
_PLACE = scpi.Integer(limits=scpi.Limits(1, 255), named=False)
_COUNT = scpi.Integer(limits=scpi.Limits(1, 268_435_455), named=False)
_EVENTS = (
    *("NONE", "COMMand", "EXTernal", "DISPlay", "ATRigger", "SLIMit", "NOTify<1-8>", "TIMer<1-4>", "DIGio<1-6>"),
    *("LAN<1-8>", "BLENder<1-2>", "TSPLink<1-3>"),
)
_GOAL = scpi.Integer(limits=scpi.Limits(0, 255), named=False)
_SECONDS = scpi.Number(unit="S", limits=scpi.Limits(0.0, 10_000.0))
_READINGS = scpi.Integer(
    limits=scpi.Limits(0, 55_000_000), named=False, required=False, words={"INFinity": math.inf, "AUTO": 0.0}
)
_CLEARS = scpi.Choice(("ENTer", "NEVer"), required=False)

Ready = Callable[[], float | None]
"""Returns the bench time at which a model goes on, None while that is not known."""


class Block(NamedTuple):
    """A block of a model: its kind, its words in a list, and what it does with."""

    kind: str
    words: str
    arguments: tuple[Any, ...]


_NOTHING = Block("NOP", "", ())


class ModelledMeter(BufferingMeter):
    """A meter with a trigger model."""

    def reset(self) -> None:
        """*RST."""
        self.loop: tuple[int, float] | None = None
        """Count and delay of SimpleLoop, where that is loaded."""
        self.blocks: dict[int, Block] = {}
        self.end_model()
        super().reset()

    def end_model(self) -> None:
        """Go idle."""
        self.place = 1
        self._run: Generator[Ready, None, None] | None = None
        self._ready: Ready = lambda: None
        self.awaited = ""
        """Event that a block waits for."""

    def forget(self) -> None:
        """A setting changes: the measurement ends."""
        super().forget()
        self.end_model()

    def abort(self) -> None:
        """Device clear."""
        super().abort()
        self.end_model()

    def begin_model(self) -> None:
        """Begin with the first block."""
        self.place, self._run, self._ready = 1, self._running(), lambda: -math.inf
        self.service()

    def event(self, name: str) -> None:
        """Take an event that a block may wait for."""
        if self.awaited == name:
            self.awaited = ""
            self.service()

    def external_trigger(self) -> None:
        """Take the external trigger."""
        super().external_trigger()
        self.event("EXT")

    def state(self) -> str:
        """Return the word of TRIGger:STATe?."""
        if self.awaited:
            return "WAITING"
        return "IDLE" if self._run is None and self.triggering.sequence is None else "RUNNING"

    def service(self) -> None:
        """Go on with what is due."""
        super().service()
        while self._run is not None and (at_s := self._ready()) is not None and at_s <= self.clock.now():
            try:
                ready = next(self._run, None)
            except scpi.ScpiError as error:
                self.engine.report(error)
                ready = None
            self._run, self._ready = (None, self._ready) if ready is None else (self._run, ready)

    def next_event_s(self) -> float | None:
        """Return when the reading ends, or a block."""
        own, of_block = super().next_event_s(), self._ready() if self._run is not None else None
        return of_block if own is None else own if of_block is None else min(own, of_block)

    def operations_end_s(self) -> float:
        """*OPC, *OPC? and *WAI wait for a model."""
        return super().operations_end_s() if self._run is None else math.inf

    def _running(self) -> Generator[Ready, None, None]:
        """Go through the blocks; yields whenever something is waited for."""
        counts = dict[int, int]()
        while True:
            block, follows, instant = self.blocks.get(self.place, _NOTHING), self.place + 1, self.clock.now()
            match block.kind:
                case "BUFFER_CLEAR":
                    self.stored.clear()
                case "MEASURE_DIGITIZE":
                    self.begin(block.arguments[1] or self.count, arming_s=0.0)
                    yield lambda: None if self.triggering.sequence else self.clock.now()
                case "DELAY_CONSTANT":
                    yield lambda until=instant + block.arguments[0]: until  # type: ignore[misc]
                case "WAIT":
                    self.awaited = block.arguments[0]
                    yield lambda: None if self.awaited else self.clock.now()
                case "BRANCH_ALWAYS":
                    follows = block.arguments[0]
                case "BRANCH_COUNTER":
                    count, goal = block.arguments
                    counts[self.place] = (counts.get(self.place, 0) + 1) % count
                    follows = goal if counts[self.place] else follows
            if follows <= self.place:
                yield lambda until=instant + _BACK_S: until  # type: ignore[misc]
            if not 0 < follows <= max(self.blocks, default=0):
                return
            self.place = follows


def _block(kind: str, words: Callable[..., str], meter: ModelledMeter, place: int, *arguments: Any) -> None:
    """Define a block; SimpleLoop is no longer what INITiate begins."""
    if words is _of_buffer:
        require_buffer(meter, arguments[0])
    meter.loop = None
    meter.blocks[place] = Block(kind, f"{kind} {words(*arguments)}".rstrip(), arguments)


def _of_buffer(buffer: str | None, count: float | None = None) -> str:
    said = "" if count is None else f" COUNT: {count:g}" if count else " COUNT: AUTO"
    return f"BUFFER: {buffer or _BUFFER}{said}"


def _row(header: str, parameters: tuple[scpi.Parameter, ...], kind: str, words: Callable[..., str]) -> None:
    ROWS.append(scpi.Command(f"TRIGger:BLOCk:{header}", (_PLACE, *parameters), do=partial(_block, kind, words)))


_row("NOP", (), "NOP", lambda: "")
_row("NOTify", (scpi.Integer(limits=scpi.Limits(1, 8), named=False),), "NOTIFY", lambda number: f"ID: {number}")
_row("BUFFer:CLEar", NAMED, "BUFFER_CLEAR", _of_buffer)
_row("DELay:CONStant", (_SECONDS,), "DELAY_CONSTANT", lambda delay_s: f"DELAY: {delay_s:.9f}")
_row("BRANch:ALWays", (_GOAL,), "BRANCH_ALWAYS", lambda goal: f"BRANCH_BLOCK: {goal}")
_row("BRANch:COUNter", (_COUNT, _GOAL), "BRANCH_COUNTER", lambda count, goal: f"VALUE: {count} BRANCH_BLOCK: {goal}")
_row("WAIT", (scpi.Choice(_EVENTS), _CLEARS), "WAIT", lambda event, _clears: f"EVENT: {event}")


@ROWS.do("TRIGger:BLOCk:MDIGitize", (_PLACE, *NAMED, _READINGS))
def _measure_block(meter: ModelledMeter, place: int, buffer: str | None, count: float | None) -> None:
    """TRIGger:BLOCk:MDIGitize: one reading where none says how many."""
    if count == math.inf:
        raise scpi.ScpiError(-222)
    _block("MEASURE_DIGITIZE", _of_buffer, meter, place, buffer, 1 if count is None else int(count))


@ROWS.query("TRIGger:BLOCk:LIST", reads=True)
def _list(meter: ModelledMeter) -> str:
    """TRIGger:BLOCk:LIST?: a line a block, as a page of the 2461's manual shows them."""
    return "\n".join(f"{place}) {block.words}" for place, block in sorted(meter.blocks.items())) or "Empty"


@ROWS.query("TRIGger:STATe", reads=True)
def _state(meter: ModelledMeter) -> str:
    return f"{meter.state()};{meter.state()};{meter.place}"


@ROWS.do("ABORt")
def _abort(meter: ModelledMeter) -> None:
    meter.forget()


@ROWS.do("*TRG", urgent=True)
def _trigger(meter: ModelledMeter) -> None:
    meter.triggering.fire()
    meter.event("COMM")


@ROWS.do(
    "TRIGger:LOAD",
    (
        *(scpi.Text(), scpi.Integer(limits=scpi.Limits(1, 268_435_455), named=False, required=False)),
        *(scpi.Number(unit="S", limits=scpi.Limits(0.0, 10_000.0), required=False), scpi.Text(required=False)),
    ),
)
def _load(meter: ModelledMeter, model: str, count: int | None, delay_s: float | None, buffer: str | None) -> None:
    require_buffer(meter, buffer)
    if model.upper() == "EMPTY":
        meter.loop, meter.blocks = None, {}
        return
    if model.upper() != "SIMPLELOOP":
        raise scpi.ScpiError(-224)
    if count is None:
        raise scpi.ScpiError(-109)
    meter.loop = (count, delay_s or 0.0)
    meter.blocks = {
        1: Block("BUFFER_CLEAR", f"BUFFER_CLEAR {_of_buffer(buffer)}", (buffer,)),
        2: Block("DELAY_CONSTANT", f"DELAY_CONSTANT DELAY: {delay_s or 0.0:.9f}", (delay_s or 0.0,)),
        3: Block("MEASURE_DIGITIZE", f"MEASURE_DIGITIZE {_of_buffer(buffer, 1)}", (buffer, 1)),
        4: Block("BRANCH_COUNTER", f"BRANCH_COUNTER VALUE: {count} BRANCH_BLOCK: 2", (count, 2)),
    }


@ROWS.do("INITiate[:IMMediate]")
def _initiate(meter: ModelledMeter) -> None:
    if meter.state() != "IDLE":
        raise scpi.ScpiError(-213)
    if meter.loop is None:
        if not meter.blocks:
            raise scpi.ScpiError(-221)
        meter.begin_model()
        return
    count, delay_s = meter.loop
    meter.batch = 1
    meter.triggering.sample_count, meter.triggering.trigger_count = 1, float(count)
    meter.triggering.delay_s, meter.triggering.delay_auto = delay_s, False
    meter.triggering.start(stored=True)
