"""A custom instrument: settings and functions of a class, and the common commands of every instrument.

By itself it has ``*IDN?``, the error queue, status registers, ``*RST``, ``*SAV`` and ``*RCL`` of ten memories,
``*OPC``, ``MIN``, ``MAX`` and ``DEF`` of numbers, units with their prefixes, and all wires. See `docs/own.md`.
"""

from __future__ import annotations

import inspect
import math
import re
import traceback
from collections.abc import Callable, Mapping
from copy import deepcopy
from typing import Any, ClassVar, TypeVar

from simrack import scpi
from simrack.leads import Leads
from simrack.rate_tables.line import LineDevice, SerialTiming
from simrack.scpi import (
    COMMON_COMMANDS,
    GPIB,
    Boolean,
    Choice,
    Command,
    CommandTable,
    Dialect,
    Integer,
    Limits,
    Mnemonic,
    Number,
    Parameter,
    Pending,
    Register,
    ScpiEngine,
    ScpiTwin,
    Status,
    Text,
    status_commands,
)
from simrack.sources import Drive
from simrack.world import World

_Function = TypeVar("_Function", bound="Callable[..., Any]")
_SUFFIX = re.compile(r"<(\d+)-(\d+)>")
_LONGEST = 1 << 16
_MEMORY = Integer(limits=Limits(0, 9), named=False)


class Setting:
    """A setting of an instrument: ``current_a = Setting("CURRent", 0.0, unit="A", low=-100.0, high=100.0)``.

    The kind of its default is its kind: a number, a whole number, on or off, one of `words`, or a text in quotes.
    The attribute is its value; of a header with a number, ``CHANnel<1-4>:LEVel``, a dictionary of values by number.

    Args:
        header: as a manual prints it, `[...]` for what may be left out.
        default: its value after ``*RST``.
        low: least value of a number.
        high: greatest value of a number.
        unit: that may follow a number, with any prefix.
        words: of which it is one, as a manual prints them.
        then: what is done after it was set, a function of the instrument.
        takes_s: bench time that setting it takes, s.
        reply: format of the answer, where the usual one will not do.
    """

    def __init__(
        self,
        header: str,
        default: Any,
        *,
        low: float | None = None,
        high: float | None = None,
        unit: str = "",
        words: tuple[str, ...] = (),
        then: Callable[[Any], Any] | None = None,
        takes_s: float = 0.0,
        reply: Callable[[Any], str] | None = None,
    ) -> None:
        self.default = Mnemonic.parse(default).short if words else default
        limits = None if low is None or high is None else Limits(low, high, default)
        if (low is None) != (high is None) or (limits is not None and not limits.minimum <= default <= limits.maximum):
            raise ValueError(f"{header}: expected low and high with the default between, got {low}, {default}, {high}")
        self._header, self._takes_s = header, takes_s
        self._then = None if then is None else _guarded(then)
        self._parameter, usual = _kind(default, unit, limits, words)
        self._reply = usual if reply is None else reply
        found = _SUFFIX.search(header)
        self.numbers = None if found is None else range(int(found[1]), int(found[2]) + 1)
        self.name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, instrument: Any, owner: type | None = None) -> Any:
        """Return its value, of the class itself."""
        return self if instrument is None else instrument.settings[self.name]

    def __set__(self, instrument: Any, value: Any) -> None:
        """Change its value, from the instrument's own side: limits do not hold there."""
        instrument.settings[self.name] = value

    def first(self) -> Any:
        """Return the value of the attribute after ``*RST``."""
        return self.default if self.numbers is None else dict.fromkeys(self.numbers, self.default)

    def row(self) -> Command:
        """Return its row of the command table."""
        name, numbered = self.name, self.numbers is not None

        def write(instrument: Any, *arguments: Any) -> None:
            held, key = (instrument.settings[name], arguments[0]) if numbered else (instrument.settings, name)
            held[key] = arguments[-1]
            if self._then is not None:
                self._then(instrument)

        def read(instrument: Any, *numbers: Any) -> Any:
            return instrument.settings[name][numbers[0]] if numbered else instrument.settings[name]

        row = (self._header, (self._parameter,))
        return Command(*row, do=write, query=read, reply=self._reply, takes_s=self._takes_s)


def _kind(
    default: Any, unit: str, limits: Limits | None, words: tuple[str, ...]
) -> tuple[Parameter, Callable[[Any], str]]:
    """Return parameter and reply of a setting."""
    if words:
        return Choice(words), str
    if isinstance(default, bool):
        return Boolean(), scpi.boolean
    if isinstance(default, int):
        return Integer(unit=unit, limits=limits), scpi.bare_integer
    if isinstance(default, float):
        return Number(unit=unit, limits=limits), scpi.real(8)
    return Text(), scpi.quoted


def query(
    header: str, *parameters: Parameter, takes_s: float = 0.0, reply: Callable[[Any], str] | None = None, **more: Any
) -> Callable[[_Function], _Function]:
    """Make the method below answer a query; other arguments are those of :class:`~simrack.scpi.Command`.

    It gets the numbers in the header and the parameters, and returns the answer: a text, a number, true or false, or
    several in a list; a float has nine digits.
    """
    formed = reply or _usual
    row = {"query_parameters": parameters, "query_takes_s": takes_s, **more}
    return lambda method: _marked(method, Command(header, query=_guarded(method, header, parameters, formed), **row))


def command(header: str, *parameters: Parameter, **more: Any) -> Callable[[_Function], _Function]:
    """Make the method below a command; arguments are those of :class:`~simrack.scpi.Command`.

    It gets the numbers in the header and the parameters, and may raise :class:`~simrack.scpi.ScpiError`.
    """
    return lambda method: _marked(method, Command(header, parameters, do=_guarded(method, header, parameters), **more))


def _marked(method: _Function, row: Command) -> _Function:
    method.row = row  # type: ignore[attr-defined]  # functions take attributes
    return method


def _guarded(
    method: Any, header: str = "", parameters: tuple[Parameter, ...] = (), formed: Callable[[Any], Any] | None = None
) -> Callable[..., Any]:
    """Return `method` with its mistakes as error -310, and a traceback for its author.

    Raises:
        TypeError: it does not take what the header and the parameters say.
    """
    count = 1 + sum(int(high) > int(low) for low, high in _SUFFIX.findall(header)) + len(parameters)
    try:
        inspect.signature(method).bind(*range(count))
    except TypeError as error:
        raise TypeError(f"{method.__qualname__} is called with {count} arguments by {header!r}: {error}") from None

    def guarded(*arguments: Any) -> Any:
        try:
            value = method(*arguments)
            return value if formed is None or isinstance(value, Pending) else formed(value)
        except scpi.ScpiError:
            raise
        except Exception as error:
            traceback.print_exc()
            words = f"System error; {method.__qualname__}: {type(error).__name__}: {error}"
            raise scpi.ScpiError(-310, words.replace('"', "'")) from error

    return guarded


def _usual(value: Any) -> Any:
    if isinstance(value, bool):
        return scpi.boolean(value)
    if isinstance(value, float):
        return scpi.real(8)(value)
    if isinstance(value, list | tuple):
        return ",".join(map(_usual, value))
    if value is None:
        raise TypeError("it returned None instead of an answer")
    return str(value) if isinstance(value, int) else value


class Terminals:
    """Terminals of a custom instrument: a clock, inputs, outputs.

    Args:
        world: what it looks at.
        nodes: the node that each of `outputs` is on.
        leads: the leads of its `inputs`.
    """

    inputs: ClassVar[tuple[str, ...]] = ()
    """Names of terminals at which it looks."""
    outputs: ClassVar[tuple[str, ...]] = ()
    """Names of terminals that it feeds."""

    def __init__(self, world: World, *, nodes: Mapping[str, str] | None = None, leads: Leads | None = None) -> None:
        self.world = world
        self.clock = world.clock
        self.nodes = {} if nodes is None else dict(nodes)
        self.leads = leads

    def volts(self, terminal: str) -> float:
        """Return the voltage at an input now, V: 0 where it is on no bench."""
        return 0.0 if self.leads is None else self.leads.value_v(terminal)

    def put(self, terminal: str, volts: float, source_ohm: float = 0.0) -> None:
        """Put a voltage on an output from now on, V, behind a resistance, where that leads anywhere."""
        if terminal in self.nodes:
            self.world.drive(self.nodes[terminal], Drive(volts, source_ohm=source_ohm))


class OwnBox(Terminals, LineDevice):
    """Base of a custom instrument without SCPI: lines, binary frames, or unasked messages.

    A subclass overrides :meth:`answer`, :meth:`says`, or both; one with frames :meth:`frame_size` too.
    """

    wires: ClassVar[tuple[str, ...]] = ("TCP", "serial line")
    """What it is served on."""
    by_visa = True
    ends: ClassVar[bytes] = b"\r\n"
    """Bytes each of which ends a message; none where messages are frames."""
    takes_s: ClassVar[float] = 0.0
    """Its own time from the end of a message to the answer, s."""
    every_s: ClassVar[float] = math.inf
    """How often it says something by itself, s."""

    def __init__(self, world: World, **around: Any) -> None:
        Terminals.__init__(self, world, **around)
        timing = SerialTiming(baud=9600.0, processing_s=self.takes_s)
        LineDevice.__init__(self, world, timing, terminators=self.ends, longest=_LONGEST)
        self._due_s = self.clock.now() + self.every_s

    def answer(self, message: bytes) -> bytes | None:
        """Return the answer to a message without its end, in bytes; None for no answer."""
        del message
        return None

    def says(self) -> bytes | None:
        """Return what it says by itself now, every `every_s`."""
        return None

    def frame_size(self, begun: bytes) -> int:
        """Return the length of the frame that `begun` begins with, 0 while unknown, 1 for a stray byte."""
        raise NotImplementedError

    def message_size(self, data: bytes | bytearray) -> int:
        """Return the length of the first message in `data` with its end, 0 while that is incomplete."""
        if self.ends:
            found = self._message_end.search(data)
            return 0 if found is None else found.end()
        size = self.frame_size(bytes(data)) if data else 0
        return size if size <= len(data) else 0

    def _take(self, part: bytes) -> None:
        super()._take(part)
        while not self.ends and (size := self.message_size(self._input)):
            frame = bytes(self._input[:size])
            del self._input[:size]
            self._send(self.answer(frame))

    def _answer(self, message: bytes) -> bytes | None:
        return self.answer(message)

    def _finish_message(self) -> None:
        if self.ends:
            super()._finish_message()

    def _advance(self) -> None:
        now = self.clock.now()
        if now >= self._due_s:  # of what it would have said while nobody looked only the last
            self._due_s = (math.floor(now / self.every_s + 1e-9) + 1) * self.every_s
            self._send(self.says())

    def _own_events_s(self) -> tuple[float, ...]:
        return (self._due_s,)


class OwnInstrument(Terminals, ScpiTwin):
    """Base of a custom instrument with SCPI; arguments are those of :class:`Terminals`."""

    idn: ClassVar[str] = "OWN,INSTRUMENT,0,1.0"
    """The answer to ``*IDN?``."""
    wires: ClassVar[tuple[str, ...]] = ("TCP", "VXI-11", "HiSLIP", "serial line")
    """What it is served on."""
    table: ClassVar[CommandTable]

    def __init_subclass__(cls) -> None:
        """Make the command table from the declarations of the class and its bases."""
        super().__init_subclass__()
        declared = {name: each for base in reversed(cls.__mro__) for name, each in vars(base).items()}
        own = [each.row() if isinstance(each, Setting) else each.row for each in declared.values() if _declares(each)]
        patterns = {row.pattern for row in own}
        cls.table = CommandTable(*own, *(row for row in _BY_ITSELF if row.pattern not in patterns))

    def __init__(self, world: World, **around: Any) -> None:
        super().__init__(world, **around)
        self.operation, self.questionable = Register(), Register()
        status = Status({3: self.questionable, 7: self.operation})
        self.engine = ScpiEngine(self, self.table, world.clock, dialect=Dialect(), interface=GPIB, status=status)
        self.settings: dict[str, Any] = {}
        self.memories: dict[int, dict[str, Any]] = {}
        self.reset()

    def identity(self) -> str:
        """Return the answer to ``*IDN?``."""
        return self.idn

    def reset(self) -> None:
        """Take the ``*RST`` state: the defaults of all settings. Further state goes into an override."""
        known = (getattr(type(self), name) for name in dir(type(self)))
        self.settings = {each.name: deepcopy(each.first()) for each in known if isinstance(each, Setting)}


def _declares(each: object) -> bool:
    return isinstance(each, Setting) or isinstance(getattr(each, "row", None), Command)


def _save(instrument: OwnInstrument, place: int) -> None:
    instrument.memories[place] = deepcopy(instrument.settings)


def _recall(instrument: OwnInstrument, place: int) -> None:
    if place not in instrument.memories:
        raise scpi.ScpiError(-221)
    instrument.settings = deepcopy(instrument.memories[place])


def _preset(instrument: OwnInstrument) -> None:
    instrument.operation.enable = instrument.questionable.enable = 0


_BY_ITSELF = (
    *(row for row in COMMON_COMMANDS if row.pattern != "SYSTem:ERRor"),
    Command("SYSTem:ERRor[:NEXT]", query=scpi.next_error),
    Command("*SAV", (_MEMORY,), do=_save),
    Command("*RCL", (_MEMORY,), do=_recall),
    Command("*TST", query=lambda _: "0"),
    Command("STATus:PRESet", do=_preset),
    Command("SYSTem:VERSion", query=lambda _: "1999.0"),
    *status_commands("OPERation", "operation"),
    *status_commands("QUEStionable", "questionable"),
)
