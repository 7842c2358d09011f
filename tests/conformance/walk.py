"""Reads an expectation file and walks it through a simulated instrument, on virtual time.

An expectation file is TOML, one a model, written from the manual. Its tables:

``[[command]]``
    ``header``    as in the manual: short form in capitals, ``[optional]`` nodes, ``<n>`` a suffix out of ``suffixes``,
                  ``{A|B}`` one command each.
    ``grade``     how sure the facts of this entry are; it is part of the test's name.
    ``arrange``   messages after *RST that make the case.
    ``reset``     reply to the query after *RST (and ``arrange``).
    ``reply``     reply to the query; for what *RST does not define.
    ``query``     the query, where it is not the header with a question mark; "" where there is none.
    ``accepts``   pairs of argument and reply to the query (or to ``readback``) thereafter; no error.
    ``does``      arguments that are taken without error.
    ``asks``      pairs of a query's argument and its reply.
    ``refuses``   pairs of argument and error number; the reply to the query stays what it was.
    ``clips``     triples of argument, reply to the query thereafter, and error number.
    ``ask_refuses`` pairs of a query's argument and error number; nothing is answered.
    ``fresh``     true where the instrument remembers what *RST does not undo: each case has one just switched on.
    ``collides``  misspellings of this header that are another command.
    ``kind``      "number", "boolean", "word" or "string": what the manual says of every parameter of that kind follows.

``[[absent]]``  ``messages`` of which each queues one of ``number`` and nothing else.

``[[exchange]]``  ``talk``, step by step: ``> message``; ``< reply``; ``! number`` next in the error queue, "0" for
    none; ``poll n`` serial poll; ``trigger``; ``clear``; ``wait s``; ``silence [s]`` nothing is answered for s;
    ``soon s silence`` the same, for a reply that comes later; ``later < reply``; ``repeat n step``; ``bytes x``.
    ``long = true``: only when it is asked for, ``-m exhaustive``.

A reply is literal, ``/a regular expression/``, ``~a number`` in NR3 form, or ``bit n set|clear``.
"""

from __future__ import annotations

import itertools
import re
import tomllib
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simrack.attendance import AttendedClock
from simrack.instruments.agilent33220a import Agilent33220ATwin, GeneratorErrors
from simrack.instruments.dso7104b import Dso7104BTwin, ScopeErrors
from simrack.instruments.e3631a import E3631ATwin, SupplyErrors
from simrack.instruments.e36312a import E36312ATwin
from simrack.instruments.hp34401a import Hp34401ATwin, MeterErrors
from simrack.instruments.infiniivision import InfiniiVisionXTwin, XSeriesErrors
from simrack.instruments.keithley import Keithley2000Twin, KeithleyDMM6500Twin
from simrack.instruments.trueform import TrueformErrors, TrueformTwin
from simrack.instruments.truevolt import Keysight34461ATwin, Keysight34465ATwin

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from simrack.device import Device

EXPECTATIONS = Path(__file__).parent / "expectations"
MODELS = ("e3631a", "hp34401a", "agilent33220a", "dso7104b", "keysight34461a", "keysight34465a")
SUCCESSORS = ("keysight33622a", "e36312a", "keithley2000", "dmm6500", "dsox3024a")
"""Models that share parser and error queue with one of those: what is their own is walked."""

_NR3 = re.compile(r"[+-]?\d+(\.\d+)?E[+-]\d{2,3}")


@dataclass
class Bench:
    """One instrument on a World of its own, and the controller that talks to it."""

    device: Device
    clock: AttendedClock

    def write(self, message: str) -> None:
        self.send(message.encode("latin-1") + b"\n", end=True)

    def send(self, data: bytes, *, end: bool) -> None:
        self.device.write(data, end=end)

    def read(self, timeout_s: float = 60.0) -> str | None:
        """Return the next response without its final newline, None when none comes in time."""
        deadline, parts = self.clock.now() + timeout_s, bytearray()
        while True:
            data, end = self.device.read(1 << 20)
            parts += data
            if end or (data and parts.endswith(b"\n")):
                return parts.decode("latin-1").removesuffix("\n")
            if data:
                continue  # a long answer comes in parts
            wake = self.device.wake_at()
            if wake is None or wake > deadline:
                self.clock.sleep_until(deadline)
                return None
            self.clock.sleep_until(wake)

    def ask(self, message: str) -> str | None:
        self.write(message)
        return self.read()

    def error(self) -> int:
        """Take the next entry off the error queue and return its number."""
        entry = (self.ask("SYST:ERR?") or "").rstrip("\r")
        assert re.fullmatch(r'[+-]?\d+,"[^"]{1,254}"', entry), f"the error queue answered {entry!r}"
        return int(entry.partition(",")[0])

    def begin(self, arrange: list[str]) -> None:
        """Bring the instrument to its reset state, then to what the case asks for."""
        self.write("*RST;*CLS")
        for message in arrange:
            self.write(message)
        number = self.error()
        assert number == 0, f"{arrange} was refused: {number}"


_DEVICES: dict[str, Callable[[World, str], Device]] = {
    "e3631a": lambda world, interface: E3631ATwin(
        world, rails={"P25V": "positive", "N25V": "negative"}, errors=SupplyErrors.none(), interface=interface
    ),
    "e36312a": lambda world, _interface: E36312ATwin(world, errors=SupplyErrors.none()),
    "hp34401a": lambda world, interface: Hp34401ATwin(
        world, node="output", errors=MeterErrors.none(), interface=interface
    ),
    "keysight34461a": lambda world, interface: Keysight34461ATwin(
        world, node="output", errors=MeterErrors.none(), interface=interface
    ),
    "keysight34465a": lambda world, interface: Keysight34465ATwin(
        world, node="output", errors=MeterErrors.none(), interface=interface
    ),
    "keithley2000": lambda world, _interface: Keithley2000Twin(world, errors=MeterErrors.none()),
    "dmm6500": lambda world, _interface: KeithleyDMM6500Twin(world, errors=MeterErrors.none()),
    "agilent33220a": lambda world, _interface: Agilent33220ATwin(world, GeneratorErrors.none(), node="v_vc"),
    "keysight33622a": lambda world, _interface: TrueformTwin.of_model("33622A", 120e6)(
        world, TrueformErrors.none(), node="v_vc"
    ),
    "dsox3024a": lambda world, _interface: InfiniiVisionXTwin.of_model("DSOX3024A")(
        world, {1: "drive", 2: "carrier", 3: "sense", 4: "output"}, XSeriesErrors.none()
    ),
    "dso7104b": lambda world, _interface: Dso7104BTwin(
        world, {1: "drive", 2: "carrier", 3: "sense", 4: "output"}, ScopeErrors.none()
    ),
}


def bench(model: str, interface: str = "gpib") -> Bench:
    """Switch an ideal instrument on, on a World of its own."""
    clock = AttendedClock(VirtualClock())
    device = _DEVICES[model](World(clock, ideal_bench(), 0), interface)
    clock.attend(device)
    made = Bench(device, clock)
    made.write("SYST:REM" if interface == "rs232" else "*CLS")
    made.write("SYST:LOC" if interface == "rs232" else "*CLS")
    made.write("*CLS")
    return made


# ------------------------------------------------------------------------------------------------ expectations


@dataclass(frozen=True)
class Command:
    """An entry of an expectation file."""

    header: str
    grade: str
    name: str = ""
    kind: str = ""
    unit: str = ""
    arrange: list[str] = field(default_factory=list)
    reset: str | None = None
    reply: str | None = None
    query: str | None = None
    readback: str | None = None
    accepts: list[list[str]] = field(default_factory=list)
    does: list[str] = field(default_factory=list)
    asks: list[list[str]] = field(default_factory=list)
    refuses: list[list[Any]] = field(default_factory=list)
    clips: list[list[Any]] = field(default_factory=list)
    ask_refuses: list[list[Any]] = field(default_factory=list)
    suffixes: list[int] = field(default_factory=list)
    number_error: int = -128
    only_spellings: list[str] = field(default_factory=list)
    collides: list[str] = field(default_factory=list)
    fresh: bool = False

    @property
    def plain(self) -> str:
        """The header in its short form, without optional nodes."""
        return self.only_spellings[0] if self.only_spellings else next(spellings(self.header))

    @property
    def question(self) -> str | None:
        """The query, None when there is none."""
        if self.query is not None:
            return self.query or None
        set_here = (self.accepts or self.clips) and self.readback is None
        asked = self.reset is not None or self.reply is not None or set_here
        return f"{self.plain}?" if asked else self.readback


@cache
def load(model: str) -> dict[str, Any]:
    return tomllib.loads((EXPECTATIONS / f"{model}.toml").read_text(encoding="utf-8"))


@cache
def commands(model: str) -> tuple[tuple[str, Command], ...]:
    """Return every entry under a name for its test, alternatives and suffixes written out."""
    return tuple(
        (f"{single['header']} {single.get('name', '')} [{single['grade']}]", Command(**_completed(single)))
        for entry in load(model)["command"]
        for single in _singles(entry)
    )


def _singles(entry: dict[str, Any]) -> Iterator[dict[str, Any]]:
    alternatives = re.search(r"\{(.*)\}", entry["header"])
    for choice in alternatives[1].split("|") if alternatives else [""]:
        for suffix in entry.get("suffixes", [0]):
            yield _written_out(entry, choice, str(suffix))


def _written_out(value: Any, choice: str, suffix: str) -> Any:
    if isinstance(value, str):
        return re.sub(r"\{[A-Za-z]+\|[^}]*\}", choice, value).replace("<n>", suffix)
    if isinstance(value, list):
        return [_written_out(part, choice, suffix) for part in value]
    return (
        {key: _written_out(part, choice, suffix) for key, part in value.items()} if isinstance(value, dict) else value
    )


def _completed(entry: dict[str, Any]) -> dict[str, Any]:
    return {**entry, "accepts": entry.get("accepts", []) + _of_kind(entry)}


def _of_kind(entry: dict[str, Any]) -> list[list[str]]:
    booleans = [["ON", "1"], ["OFF", "0"], ["1", "1"], ["0", "0"], ["on", "1"], ["Off", "0"]]
    return booleans if entry.get("kind") == "boolean" else []


# ------------------------------------------------------------------------------------------------ spellings


@dataclass(frozen=True)
class Node:
    short: str
    long: str
    suffix: str
    optional: bool

    def forms(self) -> list[str]:
        """Return every spelling of the node, "" for its absence last."""
        forms = list(dict.fromkeys([self.short + self.suffix, self.long + self.suffix]))
        return [*([""] if self.optional else []), *forms]


def nodes(header: str) -> list[Node]:
    """Take a header of the manual apart: ``[SOURce:]VOLTage`` is an optional node and one that must be there."""
    found = re.findall(r"(\[?):?(\*?[A-Za-z]+)(\d*):?\]?", header)
    return [
        Node("".join(filter(lambda letter: not letter.islower(), word)), word.upper(), digits, bool(bracket))
        for bracket, word, digits in found
    ]


def spellings(header: str) -> Iterator[str]:
    """Yield every spelling in capitals, the shortest first."""
    for parts in itertools.product(*(node.forms() for node in nodes(header))):
        yield ":".join(filter(None, parts))


def cased(spelling: str, number: int) -> str:
    """Return the spelling in capitals, small letters or both, in turn."""
    mixed = "".join(letter.lower() if place % 2 else letter for place, letter in enumerate(spelling))
    return (spelling, spelling.lower(), mixed)[number % 3]


def misspellings(header: str) -> Iterator[str]:
    """Yield the header with one node abbreviated or drawn out as the manual does not allow, for each node."""
    whole = nodes(header)
    for node in whole:
        for wrong in _wrong_forms(node):
            yield ":".join(wrong + other.suffix if other is node else other.short + other.suffix for other in whole)


def _wrong_forms(node: Node) -> list[str]:
    short, long = node.short, node.long
    between = [long[:length] for length in range(len(short) + 1, len(long))]
    return [short[:-1], *between, f"{long}X"] if len(short) > 1 and not short.startswith("*") else []


# ------------------------------------------------------------------------------------------------ replies


def matches(reply: str | None, expected: str) -> bool:
    """Whether a reply is what an expectation file says of it."""
    if reply is None:
        return False
    if expected.startswith("/"):
        return re.fullmatch(expected[1:-1], reply) is not None
    if expected.startswith("~"):
        return _NR3.fullmatch(reply) is not None and _near(float(reply), float(expected[1:]))
    if expected.startswith("bit "):
        _, bit, state = expected.split()
        return bool(int(reply) >> int(bit) & 1) is (state == "set")
    return reply == expected


def _near(value: float, wanted: float) -> bool:
    return abs(value - wanted) <= max(1e-6 * abs(wanted), 1e-15)


# ------------------------------------------------------------------------------------------------ kinds


def refusals_of_kind(command: Command, *, hp: bool) -> list[tuple[str, tuple[int, ...]]]:
    """Return what the manual refuses for every parameter of this kind."""
    return _KINDS.get(command.kind, lambda _command, _hp: [])(command, hp) + (_of_all(command) if hp else [])


def _of_all(command: Command) -> list[tuple[str, tuple[int, ...]]]:
    if command.kind not in {"number", "boolean", "word"}:
        return []
    first = command.accepts[0][0]
    return [
        ("", (-109,)),
        (f"{first},{first}", (-108,)),
        ("#13abc", (-160, -161, -168)),
        ("(1)", (-170, -171, -178)),
        ("'ON", (-151,)),
    ]


def _number(command: Command, hp: bool) -> list[tuple[str, tuple[int, ...]]]:  # noqa: FBT001
    wrong = [("'zero'", (-158,)), ("FOO", (-104, -141, -148, -224))]
    if not hp:
        return wrong
    return [*wrong, ("1 XYZ", (-131, -138)), *([] if command.unit else [("1 SEC", (-131, -138))])]


def _boolean(_command: Command, _hp: bool) -> list[tuple[str, tuple[int, ...]]]:  # noqa: FBT001
    return [("'ON'", (-158,)), ("MAYBE", (-224,))]


def _word(_command: Command, _hp: bool) -> list[tuple[str, tuple[int, ...]]]:  # noqa: FBT001
    return [("'FOO'", (-158,)), ("FOO", (-224,)), ("12", (-104, -128, -224))]


def _string(command: Command, _hp: bool) -> list[tuple[str, tuple[int, ...]]]:  # noqa: FBT001
    return [("ON", (-148,)), ("5.0", (command.number_error,)), ("'ON", (-151,))]


_KINDS: dict[str, Callable[[Command, bool], list[tuple[str, tuple[int, ...]]]]] = {
    "number": _number,
    "boolean": _boolean,
    "word": _word,
    "string": _string,
}
