"""The ACUTROL command language (ACL) as the controller reads it: messages in, resolved requests out.

Source: Acutronic TM-8004-C, sections 2.1 to 2.5 (mnemonics, tree traversal, message length) and the examples of
section 4. The manual lets mnemonics be cut short without saying which cut wins when several fit; its own examples
settle ``:INT:``/``:I:`` (Interlock, not Interface) and ``:R:V`` (Read:Vector). Here the first node in the order of
:data:`COMMANDS` wins, which gives both; the other collisions are unverified.
"""

from __future__ import annotations

import re
from functools import lru_cache

from msgspec import Struct, field

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
    """One command of a message: full path (``Demand:Rate`` or ``*IDN``), whether it is a query, its arguments."""

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
    """Return the requests of one message in order; what does not parse stands in its place as a `BadCommand`.

    A leading colon starts from the root, ``;`` stays at the level of the command before, ``;:`` goes back to the
    root (TM-8004-C 2.3). A failed command leaves the level as it was (unverified).
    """
    return list(_parsed(text))


@lru_cache(maxsize=_MESSAGES_KEPT)
def _parsed(text: str) -> tuple[AclRequest | BadCommand, ...]:
    """Return what a message asks for; kept, since a controller is asked the same again and again."""
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
