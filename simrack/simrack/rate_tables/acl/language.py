"""The ACUTROL command language (ACL) as the controller reads it: messages in, resolved requests out.

Source: Acutronic TM-8004-C, sections 2.1 to 2.5 (mnemonics, tree traversal, message length) and the examples of
section 4. The manual lets mnemonics be cut short without saying which cut wins when several fit; its own examples
settle ``:INT:``/``:I:`` (Interlock, not Interface) and ``:R:V`` (Read:Vector). Here the first node in the order of
:data:`COMMANDS` wins, which gives both; the other collisions are unverified.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from functools import lru_cache

from msgspec import Struct, field

PARSING = 1
OUT_OF_RANGE = 2
TOO_LONG = 3
LOCAL = 4
WORDS = {
    0: "NO ERROR",
    PARSING: "COMMAND PARSING ERROR",
    OUT_OF_RANGE: "PARAMETER OUT OF RANGE",
    TOO_LONG: "MESSAGE TOO LONG",
    LOCAL: "REMOTE NOT ACTIVE",
}


class Refusal(Exception):
    """A command that parses but cannot be done; `code` is the error number."""

    def __init__(self, code: int) -> None:
        super().__init__(WORDS[code])
        self.code = code


MAX_MESSAGE_CHARS = 32768
"""Longest message; a longer one overflows the read buffer and is lost (TM-8004-C 2.5)."""

COMMANDS = (
    "Configure:Oscillator",
    "Demand:Rate",
    "Demand:Position",
    "Demand:Acceleration",
    "Demand:DeltaPosition",
    "Demand:Oscillator",
    "Demand:InputVariable|IVariable",
    "Demand:ShortVector|SVector",
    "Demand:Vector",
    "Interlock",
    "Interlock:Close",
    "Interlock:Open",
    "Interlock:Reset",
    "Interface:RS232",
    "Limit",
    "Limit:Acceleration",
    "Limit:Rate",
    "Limit:Vtrip|VelocityTrip",
    "Limit:HighPosition|HPosition|HiPosition",
    "Limit:LowPosition|LPosition|LoPosition",
    "Limit:Jerk",
    "Limit:Absolute",
    "Limit:Global",
    "Mode",
    "Mode:Position",
    "Mode:Rate",
    "Mode:Off",
    "Mode:Synthesis",
    "Mode:Arate",
    "Mode:Track",
    "Mode:Home",
    "Query:System",
    "Query:Error",
    "Query:TotalVariables|VarNum",
    "Read:Position",
    "Read:Rate",
    "Read:Acceleration",
    "Read:Vector",
    "Read:ShortVector|SVector",
    "Read:Variable",
    "Status:CSR",
    "Status:ESR",
    "Status:ESE",
    "Status:MSG",
    "Status:MSGClr",
    "Status:STB",
    "Utility:Lockout|LockoutMode",
    "Utility:RemoteLockout",
    "Utility:Format",
)
"""Every command the simulated controller knows; where a cut mnemonic fits several, the first listed wins."""


class BadCommand(Exception):
    """A command that does not parse; its text is the offending command."""


class AclRequest(Struct, frozen=True):
    """One command of a message: full path (``Demand:Rate`` or ``*IDN``), True if it is a query, its arguments."""

    path: str
    query: bool
    arguments: tuple[str, ...]


class _Node(Struct):
    """One mnemonic of the tree; `leaf` tells that it is a command itself."""

    path: str
    spellings: tuple[str, ...]
    leaf: bool = False
    children: list[_Node] = field(default_factory=list)

    def child(self, mnemonic: str) -> _Node | None:
        """Return the child that `mnemonic` names: in full if possible, else the first that begins with it."""
        wanted = mnemonic.upper()
        exact = (node for node in self.children if wanted in node.spellings)
        cut = (node for node in self.children if any(s.startswith(wanted) for s in node.spellings))
        return next(exact, None) or next(cut, None)


def _grow(root: _Node, command: str) -> None:
    node = root
    for mnemonic in command.split(":"):
        names = mnemonic.split("|")
        spellings = tuple(name.upper() for name in names)
        found = next((child for child in node.children if child.spellings[0] == spellings[0]), None)
        if found is None:
            found = _Node(f"{node.path}:{names[0]}" if node.path else names[0], spellings)
            node.children.append(found)
        node = found
    node.leaf = True


def _tree() -> _Node:
    root = _Node("", ())
    for command in COMMANDS:
        _grow(root, command)
    return root


_ROOT = _tree()
_MESSAGES_KEPT = 64
_COMMAND = re.compile(r"(?P<header>\*?[A-Za-z:][A-Za-z0-9:]*)(?P<query>\s*\?)?(?:\s+(?P<rest>\S.*))?")


def parse_message(text: str) -> list[AclRequest | BadCommand]:
    """Return the requests of one message in order; a command that does not parse is a `BadCommand` in its place.

    A leading colon starts from the root, ``;`` stays at the level of the command before, ``;:`` goes back to the
    root (TM-8004-C 2.3). A failed command leaves the level as it was (unverified).
    """
    return list(_parsed(text))


@lru_cache(maxsize=_MESSAGES_KEPT)
def _parsed(text: str) -> tuple[AclRequest | BadCommand, ...]:
    """Return the requests of a message; kept, since a controller is asked the same again and again."""
    level, requests = _ROOT, list[AclRequest | BadCommand]()
    for command in text.split(";"):
        stripped = command.strip()
        if not stripped:
            continue
        try:
            request, level = _parse_command(stripped, level)
        except BadCommand as fault:
            requests.append(fault)
        else:
            requests.append(request)
    return tuple(requests)


def _parse_command(command: str, level: _Node) -> tuple[AclRequest, _Node]:
    match = _COMMAND.fullmatch(command)
    if match is None:
        raise BadCommand(command)
    header, query, rest = match["header"], match["query"] is not None, match["rest"] or ""
    # the manual also prints the question mark after the blank: ":Read:Acceleration ?<axis>"
    if rest.startswith("?"):
        query, rest = True, rest[1:].strip()
    arguments = tuple(part.strip() for part in rest.split(",")) if rest else ()
    if header.startswith("*"):
        return AclRequest(header.upper(), query, arguments), level
    node, parent = _resolve(header, level, command)
    return AclRequest(node.path, query, arguments), parent


def _resolve(header: str, level: _Node, command: str) -> tuple[_Node, _Node]:
    parent = node = _ROOT if header.startswith(":") else level
    for mnemonic in header.removeprefix(":").split(":"):
        found = node.child(mnemonic) if mnemonic else None
        if found is None:
            raise BadCommand(command)
        parent, node = node, found
    if not node.leaf:
        raise BadCommand(command)
    return node, parent


Arguments = tuple[str, ...]
Action = Callable[[Arguments], None]
Query = Callable[[Arguments], str]

MODES = ("Position", "Rate", "Arate", "Synthesis", "Track", "Abort", "Off")
"""In the order of TM-8004-C 4.7; their place is taken as the code in A1STATE bits 0-3 (inferred)."""


def counted(arguments: Arguments, count: int) -> Arguments:
    """Return the arguments, which must be `count`."""
    if len(arguments) != count:
        raise Refusal(OUT_OF_RANGE)
    return arguments


def one(arguments: Arguments) -> str:
    """Return the only argument."""
    return counted(arguments, 1)[0]


def check_axis(arguments: Arguments, *, most: int = 1, everything: bool = True) -> None:
    """Refuse an axis that does not exist; ALL is for commands only."""
    if not 1 <= len(arguments) <= most:
        raise Refusal(OUT_OF_RANGE)
    if arguments[0] != "1" and not (everything and arguments[0].upper() == "ALL"):
        raise Refusal(OUT_OF_RANGE)


def axis_values(arguments: Arguments, count: int) -> tuple[float, ...]:
    """Return the `count` numbers that follow the axis."""
    axis, *values = counted(arguments, count + 1)
    check_axis((axis,))
    return tuple(number(value) for value in values)


def number(text: str) -> float:
    """Return a number: NRf with blanks allowed around the exponent, no suffix, no infinity (TM-8004-C 2.6.1.2)."""
    compact = "".join(text.split())
    if not compact or not set(compact) <= set("+-.0123456789eE"):
        raise Refusal(OUT_OF_RANGE)
    try:
        value = float(compact)
    except ValueError:
        raise Refusal(OUT_OF_RANGE) from None
    if abs(value) > 1e30:
        raise Refusal(OUT_OF_RANGE)
    return value


def integer(text: str, low: int, high: int) -> int:
    """Return a whole number from `low` to `high`."""
    value = number(text)
    if value != int(value) or not low <= value <= high:
        raise Refusal(OUT_OF_RANGE)
    return int(value)


def check_within(value: float, high: float) -> None:
    """Refuse values that are negative or above `high`."""
    # zero is taken, and inhibits every change of motion: the manual only says "should never be commanded"
    if not 0.0 <= value <= high:
        raise Refusal(OUT_OF_RANGE)


def word(text: str, words: tuple[str, ...]) -> str:
    """Return the first of `words` that begins with `text`."""
    found = next((each for each in words if text and each.upper().startswith(text.upper())), None)
    if found is None:
        raise Refusal(OUT_OF_RANGE)
    return found


def switch(arguments: Arguments) -> bool:
    """Return True if the only argument is ON, and not OFF."""
    text = one(arguments).upper()
    if text not in {"ON", "OFF"}:
        raise Refusal(OUT_OF_RANGE)
    return text == "ON"


ANGLE, RATE, ACCELERATION = 180.0, 11250.0, 703125.0
"""Weight of the top bit in BINARY format: deg, deg/s, deg/s2 (TM-8004-C 5.1.2)."""


def decimal(value: float) -> str:
    """Return a number with five decimals."""
    # adding zero turns a rounded -0.0 into 0.0: the controller sends no bare minus
    return f"{round(value, 5) + 0.0:.5f}"


def listed(arguments: Arguments, *values: float) -> str:
    """Return several numbers of the axis that `arguments` name."""
    check_axis(arguments, everything=False)
    return ",".join(decimal(value) for value in values)


def _scaled(value: float, weight: float) -> bytes:
    # least significant byte first (TM-8004-C 2.4)
    return struct.pack("<i", (round(value / weight * 2**31) + 2**31) % 2**32 - 2**31)


class StateFormat:
    """The format of motion states: FLOAT or BINARY."""

    def __init__(self) -> None:
        self._binary = False

    def of_axis(self, arguments: Arguments, *states: tuple[float, float]) -> str:
        """Return the motion states of the axis, each (value, weight of the top bit in BINARY format)."""
        check_axis(arguments, everything=False)
        if not self._binary:
            return ";".join(decimal(value) for value, _ in states)
        block = b"".join(_scaled(value, weight) for value, weight in states)
        length = str(len(block))
        return f"#{len(length)}{length}" + block.decode("latin-1")

    def commands(self) -> dict[str, Action]:
        """Return the commands of the format."""
        return {"Utility:Format": self._choose}

    def queries(self) -> dict[str, Query]:
        """Return the queries of the format."""
        return {"Utility:Format": lambda _: "BINARY" if self._binary else "FLOAT"}

    def _choose(self, arguments: Arguments) -> None:
        self._binary = word(one(arguments), ("Float", "Binary")) == "Binary"
