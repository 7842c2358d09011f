"""Parameter kinds of a command table, each with the refusals a real parser has for a wrong one.

A parameter is used in two stages. `parse` turns a token into a value when a message is first seen, and its result is
kept with the message; `settle` turns that into the handler's argument each time the message is executed, because
limits, MIN, MAX and DEF may depend on the instrument's state.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any, ClassVar, NamedTuple

from msgspec import Struct, field

from simrack.scpi.errors import ScpiError
from simrack.scpi.lexer import Token, TokenKind
from simrack.scpi.mnemonics import Mnemonic


class Special(Enum):
    """A word in place of a number."""

    MIN = "MINimum"
    MAX = "MAXimum"
    DEF = "DEFault"


class Limits(NamedTuple):
    """Bounds of a number, and the meaning of DEF (None: DEF is not accepted)."""

    minimum: float
    maximum: float
    default: float | None = None


class Quantity(NamedTuple):
    """A number with the unit it was given in, "" when none was."""

    value: float
    unit: str


class Violation(NamedTuple):
    """A number beyond a limit, and the model's substitute. `value` None refuses the command."""

    value: float | None
    error: ScpiError


def refuse(value: float, limits: Limits, word: str) -> Violation:
    """Refuse a number out of range and change nothing (34401A, E3631A)."""
    del value, limits, word
    return Violation(None, ScpiError(-222))


def clip(value: float, limits: Limits, word: str) -> Violation:
    """Clip a number to its limit and say so (33220A; the wording is not verified)."""
    upper = value > limits.maximum
    side = "upper" if upper else "lower"
    parts = ["Data out of range", *([word] if word else []), f"value clipped to {side} limit"]
    return Violation(limits.maximum if upper else limits.minimum, ScpiError(-222, "; ".join(parts)))


class Parameter(Struct, frozen=True, kw_only=True):
    """Base of all parameters: its default, a mark if it is required, and a refusal."""

    required: bool = True
    default: Any = None
    word_too_long: int = -144

    refusals: ClassVar[Mapping[TokenKind, int]] = {
        TokenKind.NUMBER: -128,
        TokenKind.WORD: -148,
        TokenKind.STRING: -158,
        TokenKind.BLOCK: -168,
        TokenKind.EXPRESSION: -178,
    }

    @property
    def fixed(self) -> bool:
        """True if `settle` leaves the parsed value alone."""
        return True

    def parse(self, token: Token) -> Any:
        """Return the value of `token`, or raise ScpiError."""
        raise ScpiError(self.refusals[token.kind])

    def settle(self, parsed: Any, model: Any) -> Any:
        """Return the handler's argument; may raise ScpiError."""
        del model
        return parsed

    def refuse_kind(self, token: Token) -> ScpiError:
        """Return the error for a token of a kind that is not allowed here."""
        return ScpiError(self.refusals[token.kind])


_MULTIPLIERS = {
    "EX": 1e18,
    "PE": 1e15,
    "T": 1e12,
    "G": 1e9,
    "MA": 1e6,
    "K": 1e3,
    "": 1.0,
    "M": 1e-3,
    "U": 1e-6,
    "N": 1e-9,
    "P": 1e-12,
    "F": 1e-15,
    "A": 1e-18,
}
_MEGA_UNITS = ("HZ", "OHM")
_PLAIN_UNITS = ("DBM", "PCT", "DEG", "RAD")


def _suffixes(unit: str) -> dict[str, Quantity]:
    """Return the suffixes that mean `unit`; a plain M is milli but in MHZ and MOHM (SCPI-99 volume 1, 7.4)."""
    if unit in _PLAIN_UNITS:
        return {unit: Quantity(1.0, unit)}
    table = {prefix + unit: Quantity(factor, unit) for prefix, factor in _MULTIPLIERS.items()}
    if unit in _MEGA_UNITS:
        table["M" + unit] = Quantity(1e6, unit)
    return table


class Number(Parameter, frozen=True, kw_only=True):
    """A decimal number with an optional unit suffix, or MIN, MAX, DEF where there are limits.

    Args:
        unit: unit that may follow, e.g. "V" (then MV, UV, KV ... too), or several; "" for none.
        limits: the limits, or a function of the model that returns them; None for no check here.
        legal: discrete legal values; the number is rounded to one after the check of its limits (34401A guide p. 159).
        words: further words and the numbers they stand for, e.g. `{"INFinity": math.inf}`.
        name: what the value is called in a message about clipping, or what says so for a model.
        with_unit: hand over a :class:`Quantity` instead of a float.
        deferred: hand over what was parsed, a number or a Special; the handler settles it with another Number
            (when the limits depend on an earlier parameter).
        named: whether MIN, MAX and DEF stand for numbers here; a mask or the number of a memory takes no word.
    """

    unit: str | tuple[str, ...] = ""
    limits: Limits | Callable[[Any], Limits] | None = None
    legal: tuple[float, ...] = ()
    words: Mapping[str, float] = field(default_factory=dict)
    name: str | Callable[[Any], str] = ""
    with_unit: bool = False
    deferred: bool = False
    named: bool = True

    @property
    def suffixes(self) -> Mapping[str, Quantity]:
        """Factors and units of the suffixes."""
        names = (self.unit,) if isinstance(self.unit, str) else self.unit
        return {suffix: each for name in filter(None, names) for suffix, each in _suffixes(name).items()}

    @property
    def specials(self) -> Mapping[str, Any]:
        """Values of its words, long or short."""
        pairs: list[tuple[str, Any]] = [*self.words.items()]
        if self.named and (self.limits is not None or self.deferred):
            pairs += [(special.value, special) for special in Special]
        return {spelling: meaning for word, meaning in pairs for spelling in Mnemonic.parse(word).spellings}

    @property
    def fixed(self) -> bool:
        """A number without limits, words or legal values needs no second look."""
        return self.deferred or (self.limits is None and not self.legal)

    def parse(self, token: Token) -> Any:
        """Return a Quantity, a Special, or a float for a word."""
        if token.kind is TokenKind.WORD:
            specials = self.specials
            if not specials:
                raise self.refuse_kind(token)
            if token.text not in specials:
                raise ScpiError(-224)
            value = specials[token.text]
            return Quantity(value, "") if self.with_unit and not isinstance(value, Special) else value
        if token.kind is not TokenKind.NUMBER:
            raise self.refuse_kind(token)
        quantity = self._scale(token)
        return quantity if self.with_unit else self.rounded(quantity.value)

    def rounded(self, value: float) -> float:
        """Return `value` as a number in the steps of the parameter."""
        return value

    def bounds(self, model: Any) -> Limits:
        """Return the limits now; ValueError where there are none."""
        limits = self.limits(model) if callable(self.limits) else self.limits
        if limits is None:
            raise ValueError(f"{self} has no limits")
        return limits

    def special(self, which: Special, model: Any) -> float:
        """Return the present value of MIN, MAX or DEF."""
        bounds = self.bounds(model)
        value = {Special.MIN: bounds.minimum, Special.MAX: bounds.maximum, Special.DEF: bounds.default}[which]
        if value is None:
            raise ScpiError(-224)
        return value

    def settle(self, parsed: Any, model: Any) -> Any:
        """Return the number within its limits, by the model's policy, and rounded to a legal one."""
        if isinstance(parsed, Quantity):
            return parsed
        if isinstance(parsed, Special):
            value = self.special(parsed, model)
            return Quantity(value, "") if self.with_unit else value
        if self.limits is not None and parsed not in self.words.values():
            parsed = self._within(parsed, self.bounds(model), model)
        return nearest(parsed, self.legal) if self.legal else parsed

    def _within(self, value: float, limits: Limits, model: Any) -> float:
        low, high = sorted(limits[:2])
        if low <= value <= high:
            return value
        word = self.name(model) if callable(self.name) else self.name
        violation: Violation = model.engine.dialect.out_of_range(value, Limits(low, high), word)
        if violation.value is None:
            raise violation.error
        model.engine.report(violation.error)
        return violation.value

    def _scale(self, token: Token) -> Quantity:
        if not token.suffix:
            return Quantity(token.number, "")
        suffixes = self.suffixes
        if not suffixes:
            raise ScpiError(-138)
        if token.suffix not in suffixes:
            raise ScpiError(-131)
        factor, unit = suffixes[token.suffix]
        return Quantity(token.number * factor, unit)


def nearest(value: float, legal: tuple[float, ...]) -> float:
    """Return the legal value nearest to `value` by ratio; infinity is returned unchanged."""
    if math.isinf(value):
        return value
    return min(legal, key=lambda candidate: abs(math.log(max(abs(value), 1e-300) / candidate)))


class Integer(Number, frozen=True, kw_only=True):
    """A number rounded to an integer; handed over as `int`."""

    def rounded(self, value: float) -> float:
        """Round half away from zero (IEEE 488.2, 7.7.2.4)."""
        return math.copysign(math.floor(abs(value) + 0.5), value) + 0.0 if math.isfinite(value) else value

    def settle(self, parsed: Any, model: Any) -> Any:
        """Return an int; infinities stay floats."""
        value = Number.settle(self, parsed, model)
        return int(value) if isinstance(value, float) and math.isfinite(value) else value

    @property
    def fixed(self) -> bool:
        """An integer is made at execution."""
        return False


class Boolean(Parameter, frozen=True, kw_only=True):
    """ON, OFF or a number, which is rounded; anything but 0 is on. `words` adds others, e.g. ("ONCE",)."""

    words: tuple[str, ...] = ()

    def parse(self, token: Token) -> Any:
        """Return a bool, or the word as given."""
        if token.kind is TokenKind.NUMBER:
            if token.suffix:
                raise ScpiError(-138)
            return abs(token.number) >= 0.5
        if token.kind is not TokenKind.WORD:
            raise self.refuse_kind(token)
        if token.text in ("ON", "OFF"):
            return token.text == "ON"
        if token.text in self.words:
            return token.text
        raise ScpiError(-224)


class _NumberNotAllowed(ScpiError):
    """A number where none may be; its number differs by model (see `Dialect.number_not_allowed`)."""

    def __init__(self) -> None:
        super().__init__(-128)


class Choice(Parameter, frozen=True):
    """One of some words, long or short; handed over in the short form, with its suffix: `Choice(("CHANnel<1-4>",))`."""

    words: tuple[str, ...] = ()

    @property
    def mnemonics(self) -> tuple[Mnemonic, ...]:
        """The words as the manual spells them."""
        return tuple(map(Mnemonic.parse, self.words))

    def parse(self, token: Token) -> str:
        """Return the short form in upper case."""
        if token.kind is TokenKind.NUMBER:
            raise _NumberNotAllowed
        if token.kind is not TokenKind.WORD:
            raise self.refuse_kind(token)
        for mnemonic in self.mnemonics:
            suffix = mnemonic.match(token.text)
            if suffix is not None:
                return mnemonic.short + ("" if mnemonic.suffixes is None else str(suffix))
        raise ScpiError(-224)


class Text(Parameter, frozen=True, kw_only=True):
    """A quoted string of at most `limit` characters (-223 beyond)."""

    limit: int | None = None

    def parse(self, token: Token) -> str:
        """Return the characters between the quotes."""
        if token.kind is TokenKind.NUMBER:
            raise _NumberNotAllowed
        if token.kind is not TokenKind.STRING:
            raise self.refuse_kind(token)
        if self.limit is not None and len(token.text) > self.limit:
            raise ScpiError(-223)
        return token.text


class Word(Parameter, frozen=True, kw_only=True):
    """Any unquoted word, in upper case (security codes)."""

    def parse(self, token: Token) -> str:
        """Return the word."""
        if token.kind is TokenKind.NUMBER:
            raise _NumberNotAllowed
        if token.kind is not TokenKind.WORD:
            raise self.refuse_kind(token)
        return token.text


class Block(Parameter, frozen=True, kw_only=True):
    """A block of bytes."""

    def parse(self, token: Token) -> bytes:
        """Return the bytes."""
        if token.kind is not TokenKind.BLOCK:
            raise ScpiError(-104 if token.kind is TokenKind.NUMBER else self.refusals[token.kind])
        return token.text.encode("latin-1")
