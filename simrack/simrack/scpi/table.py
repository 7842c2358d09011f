"""Command tables: declared as the manual prints them, compiled to a tree, messages compiled against it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

from msgspec import Struct, field

from simrack.scpi.errors import ScpiError
from simrack.scpi.formats import Parts
from simrack.scpi.lexer import Token, TokenKind, Unit, units
from simrack.scpi.mnemonics import Mnemonic
from simrack.scpi.parameters import Choice, Number, Parameter, Special

_WORD_LIMIT = 12


def _as_it_is(value: Any) -> str | bytes | Parts:
    """Reply with text or bytes as they are, with anything else as Python writes it."""
    return value if isinstance(value, (bytes, Parts)) else str(value)


class Command(Struct, frozen=True):
    """One line of a manual's command list.

    Args:
        pattern: header as printed: `[SOURce:]VOLTage[:LEVel]`, `CHANnel<1-4>:SCALe`, `*OPC`. Without a question mark.
            Of `SENSe<1-1>` the 1 may be written, of `SOURce<2-2>` the 2 must be: handlers do not get them.
        parameters: what follows the header in the command form.
        do: what the command form does: `do(model, *suffixes, *arguments)`; None if there is only a query.
            It may return a :class:`~simrack.scpi.engine.Pending`, raise ScpiError, else returns nothing.
        query: what the query form answers, likewise; None if there is no query.
        query_parameters: what may follow the question mark. None: nothing, or MIN, MAX or DEF when the command's only
            parameter is a Number with limits.
        reply: format of the query's value.
        repeat: the last parameter may be given any number of times more (its `required` says whether zero is allowed);
            of a row with both forms the command's alone.
        takes_s: simulated time before the command form acts, s.
        query_takes_s: simulated time before the query answers, s.
        indefinite: the reply has no definite end, so a query after it in the same message is refused with -440.
        urgent: executed even while an earlier command keeps the parser busy.
        part: attribute of the model that handlers and limits are given instead of it (a further channel).
        reads: the query only reads: by it nothing is measured, begun, cleared, taken out of a queue, saved or moved, in
            the real instrument either. A program may ask it at a stranger's bench.
    """

    pattern: str
    parameters: tuple[Parameter, ...] = ()
    do: Callable[..., Any] | None = None
    query: Callable[..., Any] | None = None
    query_parameters: tuple[Parameter, ...] | None = None
    reply: Callable[[Any], str | bytes | Parts] = _as_it_is
    repeat: bool = False
    takes_s: float = 0.0
    query_takes_s: float = 0.0
    indefinite: bool = False
    urgent: bool = False
    part: str = ""
    reads: bool = False

    def parts(self) -> Iterator[tuple[tuple[Mnemonic, ...], bool]]:
        """Yield the parts of the header: the mnemonics of each, and True if it may be left out."""
        for index, piece in enumerate(self.pattern.replace("]", "[").split("[")):
            words = piece.strip(":")
            if words:
                yield _mnemonics(words), index % 2 == 1


@cache  # the same few hundred stand in all tables, and reading them took a third of making a table
def _mnemonics(words: str) -> tuple[Mnemonic, ...]:
    return tuple(map(Mnemonic.parse, words.split(":")))


class CompiledUnit:
    """One unit of a compiled message, ready to be executed again and again."""

    __slots__ = (
        "arguments",
        "at_once",
        "error",
        "handler",
        "indefinite",
        "is_query",
        "part",
        "reply",
        "rest",
        "settling",
        "takes_s",
        "urgent",
    )

    def __init__(self, handler: Callable[..., Any], arguments: tuple[Any, ...], command: Command, unit: Unit) -> None:
        part = self.part = command.part
        self.handler: Callable[..., Any] = handler
        if part:
            self.handler = lambda model, *given: handler(getattr(model, part), *given)
        self.arguments = arguments
        self.settling: tuple[tuple[int, Parameter], ...] = ()
        self.is_query = unit.query
        self.reply = command.reply
        self.takes_s = command.query_takes_s if unit.query else command.takes_s
        self.indefinite = command.indefinite and unit.query
        self.urgent = command.urgent
        self.at_once = self.takes_s == 0.0
        self.rest = unit.rest
        self.error: ScpiError | None = None

    def resolve(self, model: Any) -> list[Any]:
        """Return the arguments with limits and MIN, MAX, DEF applied."""
        arguments = list(self.arguments)
        about = getattr(model, self.part) if self.part else model
        for index, parameter in self.settling:
            if arguments[index] is not None:
                arguments[index] = parameter.settle(arguments[index], about)
        return arguments


Program = tuple[CompiledUnit, ...]
"""A compiled message."""


def _nothing(model: object) -> None:
    del model


_NOTHING = Command("NOTHing", do=_nothing)


def _failed(error: ScpiError) -> CompiledUnit:
    step = CompiledUnit(_nothing, (), _NOTHING, Unit())
    step.error, step.at_once = error, False
    return step


class _Node(Struct):
    children: dict[str, list[tuple[Mnemonic, _Node]]] = field(default_factory=dict)
    doing: Command | None = None
    asking: Command | None = None

    def child(self, mnemonic: Mnemonic) -> _Node:
        for known, node in self.children.get(mnemonic.short, []):
            if known == mnemonic:
                return node
        node = _Node()
        for spelling in mnemonic.spellings:
            self.children.setdefault(spelling, []).append((mnemonic, node))
        return node

    def below(self, mnemonics: tuple[Mnemonic, ...]) -> _Node:
        node = self
        for mnemonic in mnemonics:
            node = node.child(mnemonic)
        return node

    def attach(self, command: Command) -> None:
        if (command.do and self.doing) or (command.query and self.asking):
            raise ValueError(f"{command.pattern} is declared twice")
        self.doing = command if command.do else self.doing
        self.asking = command if command.query else self.asking


class CommandTable:
    """The commands of a model.

    Args:
        commands: the declarations; one header may have its command and its query form declared apart.
        limit_queries: whether numbers with limits answer `? MIN`, `? MAX` and `? DEF`.

    Raises:
        ValueError: a header is declared twice.
    """

    def __init__(self, *commands: Command, limit_queries: bool = True) -> None:
        self.commands = commands
        self._limit_queries = limit_queries
        self._root = _Node()
        for command in commands:
            nodes = [self._root]
            for mnemonics, optional in command.parts():
                there = [node.below(mnemonics) for node in nodes]
                nodes = there + nodes if optional else there
            for node in nodes:
                node.attach(command)

    def compile(self, text: str, number_not_allowed: int = -128) -> Program:
        """Return the steps of a message (without its terminator).

        Refusals are steps, because what stands before them in the message is executed first.
        `number_not_allowed` is the model's error for a number where a word or string is due.
        """
        steps: list[CompiledUnit] = []
        path: tuple[str, ...] = ()
        for unit in units(text):
            step, path = self._step(unit, path)
            if any(earlier.indefinite for earlier in steps) and step.is_query:
                step = _failed(ScpiError(-440))
            if step.error is not None and step.error.__class__ is not ScpiError:
                step.error = ScpiError(number_not_allowed)
            steps.append(step)
            if step.error is not None and not -299 <= step.error.number <= -200:
                break
        return tuple(steps)

    def asked(self, question: str) -> Command | None:
        """Return the row that answers the first query of a message, or None."""
        unit = next(iter(units(question)))
        try:
            return self._find(unit.mnemonics, unit)[0]
        except ScpiError:
            return None

    def _step(self, unit: Unit, path: tuple[str, ...]) -> tuple[CompiledUnit, tuple[str, ...]]:
        if unit.error is not None and not unit.mnemonics:
            return _failed(unit.error), path
        full = unit.mnemonics if unit.common or unit.from_root else path + unit.mnemonics
        try:
            return self._bind(unit, full), path if unit.common else full[:-1]
        except ScpiError as error:
            return _failed(error), path if unit.common else full[:-1]

    def _bind(self, unit: Unit, full: tuple[str, ...]) -> CompiledUnit:
        command, suffixes = self._find(full, unit)
        if unit.error is not None:
            raise unit.error
        handler = command.query if unit.query else command.do
        if handler is None:
            raise ScpiError(-113)
        query_limit = _limit_query(command) if unit.query and unit.tokens and self._limit_queries else None
        if query_limit is not None:
            if len(unit.tokens) > 1:
                raise ScpiError(-108)
            word = _SPECIALS.parse(unit.tokens[0])
            return CompiledUnit(lambda model, which: query_limit.special(which, model), (Special[word],), command, unit)
        parameters = (command.query_parameters or ()) if unit.query else command.parameters
        repeats = command.repeat and not (unit.query and command.do is not None)
        wanted = _spread(parameters, len(unit.tokens), repeats=repeats)
        arguments = [_argument(parameter, token) for parameter, token in _pairs(wanted, unit.tokens)]
        step = CompiledUnit(handler, (*suffixes, *arguments), command, unit)
        step.settling = tuple(
            (index, parameter) for index, parameter in enumerate(wanted, len(suffixes)) if not parameter.fixed
        )
        return step

    def _find(self, full: tuple[str, ...], unit: Unit) -> tuple[Command, tuple[int, ...]]:
        node, suffixes = self._root, []
        for word in full:
            mnemonic, node = _next(node, word)
            if mnemonic.suffixes is not None:
                number = mnemonic.match(word)
                if number is None:
                    raise ScpiError(-114)
                if mnemonic.suffixes[0] < mnemonic.suffixes[1]:
                    suffixes.append(number)
        command = node.asking if unit.query else node.doing
        if command is None:
            raise ScpiError(-113)
        return command, tuple(suffixes)


def _next(node: _Node, word: str) -> tuple[Mnemonic, _Node]:
    numbered = node.children.get(word.rstrip("0123456789"), [])
    known = node.children.get(word) or [each for each in numbered if each[0].suffixes is not None]
    if not known:  # a word of a manual may be longer than IEEE 488.2 has them: INPutimpedance
        raise ScpiError(-112 if len(word) > _WORD_LIMIT else -113)
    return next((each for each in known if each[0].match(word) is not None), known[0])


def _spread(parameters: tuple[Parameter, ...], given: int, *, repeats: bool) -> tuple[Parameter, ...]:
    """Return the parameters for `given` tokens; -108 for too many, -109 for too few."""
    if repeats and parameters and given > len(parameters):
        parameters = parameters + parameters[-1:] * (given - len(parameters))
    if given > len(parameters):
        raise ScpiError(-108)
    if any(parameter.required for parameter in parameters[given:]):
        raise ScpiError(-109)
    return parameters[:given] if repeats else parameters


def _pairs(wanted: tuple[Parameter, ...], tokens: tuple[Token, ...]) -> Iterator[tuple[Parameter, Token | None]]:
    """Yield each parameter with its token; words that may be left out may be so in the middle, too."""
    left = list(tokens)
    for index, parameter in enumerate(wanted):
        later = wanted[index + 1 :] if len(left) < len(wanted) - index else ()
        may_be_left_out = left and later and isinstance(parameter, Choice) and not parameter.required
        left_out = may_be_left_out and not _fits(parameter, left[0]) and any(_fits(each, left[0]) for each in later)
        yield parameter, left.pop(0) if left and not left_out else None


def _fits(parameter: Parameter, token: Token) -> bool:
    try:
        return isinstance(parameter, Choice) and parameter.parse(token) is not None
    except ScpiError:
        return False


def _argument(parameter: Parameter, token: Token | None) -> Any:
    if token is None:
        return parameter.default
    if token.kind is TokenKind.WORD and len(token.text) > _WORD_LIMIT:
        raise ScpiError(parameter.word_too_long)
    return parameter.parse(token)


def _limit_query(command: Command) -> Number | None:
    """Return the number whose MIN, MAX and DEF the query form answers."""
    if command.query_parameters is None and len(command.parameters) == 1:
        parameter = command.parameters[0]
        if isinstance(parameter, Number) and parameter.limits is not None:
            return parameter
    return None


_SPECIALS = Choice(tuple(special.value for special in Special))
