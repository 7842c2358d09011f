"""From the text of a program message to headers and parameter tokens, without a list of commands.

Text is the message decoded as Latin-1, so that one character is one byte and blocks survive. The error numbers
are those the HP manuals give in their examples (34401A User's Guide p. 173-178).
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from enum import Enum
from typing import NoReturn

from msgspec import Struct
from msgspec.structs import replace

from simrack.scpi.errors import ScpiError

_BLANK = "".join(map(chr, (*range(10), *range(11, 33))))
"""White space: blank and every control character but the newline (IEEE 488.2, 7.4.1.2)."""
_DIGITS = "0123456789"
_MNEMONIC_LIMIT = 12
_HEADER = re.compile(r"(\*?[A-Za-z][A-Za-z0-9_]*(?::[A-Za-z][A-Za-z0-9_]*)*)(\?)?")
_NUMBER = re.compile(r"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))(?:[ \t]*[eE][ \t]*([+-]?[0-9]+))?")
_SUFFIX = re.compile(r"[ \t]*([A-Za-z%][A-Za-z0-9/.%]*)")
_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_BASED = re.compile(r"#(?:[hH]([0-9A-Za-z]*)|[qQ]([0-9A-Za-z]*)|[bB]([0-9A-Za-z]*))")
_STRING = {'"': re.compile(r'"((?:[^"]|"")*)"'), "'": re.compile(r"'((?:[^']|'')*)'")}
_LONGEST_MANTISSA = 255
_LARGEST_EXPONENT = 32000
_LARGEST = sys.float_info.max
_FRAME = re.compile(rb"\"[^\"\n]*\"|'[^'\n]*'|#[0-9]|\n")
_BASES = (16, 8, 2)


class TokenKind(Enum):
    """Kind of a parameter by its spelling."""

    NUMBER = "number"
    WORD = "word"
    STRING = "string"
    BLOCK = "block"
    EXPRESSION = "expression"


class Token(Struct, frozen=True):
    """One parameter: `text` as typed (strings and blocks without delimiters), `number` and `suffix` of numbers."""

    kind: TokenKind
    text: str
    number: float = 0.0
    suffix: str = ""


class Unit(Struct, frozen=True):
    """One program message unit.

    `error` ends the message: nothing after it was understood; without mnemonics not even the header was.
    `rest` is what follows in the message, characters.
    """

    mnemonics: tuple[str, ...] = ()
    tokens: tuple[Token, ...] = ()
    query: bool = False
    common: bool = False
    from_root: bool = False
    error: ScpiError | None = None
    rest: int = 0


def units(text: str) -> Iterator[Unit]:
    """Yield the units of a message; the last one carries the error when the text is malformed."""
    position = 0
    while True:
        position = _skip_blanks(text, position)
        if position >= len(text):
            return
        if text[position] == ";":
            position += 1
            continue
        unit, position = _unit(text, position)
        yield unit
        if unit.error is not None:
            return


def find_message_end(data: bytes | bytearray) -> int:
    """Return the index of the newline that ends the first message in `data`, -1 while it is incomplete.

    A newline within a definite length block is data.
    """
    if b"#" not in data:
        return data.find(b"\n")
    position = 0
    while (match := _FRAME.search(data, position)) is not None:
        found = match.group()
        if found == b"\n":
            return match.start()
        position = match.end()
        if found[:1] == b"#":
            position = _block_end(data, position, int(found[1:]))
            if position < 0:
                return -1
    return -1


def _block_end(data: bytes | bytearray, position: int, digits: int) -> int:
    length = bytes(data[position : position + digits])
    if len(length) < digits:
        return -1
    if not length.isdigit():
        return position
    end = position + digits + int(length)
    return end if end <= len(data) else -1


def _unit(text: str, position: int) -> tuple[Unit, int]:
    try:
        unit, position = _header(text, position)
        if position < len(text) and text[position] not in _BLANK and text[position] != ";":
            character = text[position]
            if character == ",":
                raise ScpiError(-103)  # noqa: TRY301
            raise ScpiError(-102 if character in ":?" else -101)  # noqa: TRY301
        position = _skip_blanks(text, position)
    except ScpiError as error:
        return Unit(error=error), position
    try:
        tokens, position = _tokens(text, position)
    except ScpiError as error:
        return replace(unit, error=error), position
    return replace(unit, tokens=tokens, rest=len(text) - position), position


def _header(text: str, position: int) -> tuple[Unit, int]:
    from_root = text[position] == ":"
    match = _HEADER.match(text, position + from_root)
    if match is None:
        _refuse_character(text, position + from_root)
    mnemonics = tuple(match[1].upper().split(":"))
    common = mnemonics[0].startswith("*")  # after a colon too, which IEEE 488.2, 7.6.1 has not, and boxes take
    _check_blanks_around_colon(text, match.end())
    unit = Unit(mnemonics, query=match[2] is not None, common=common, from_root=from_root)
    return unit, match.end()


def _check_blanks_around_colon(text: str, position: int) -> None:
    if text.startswith(":", _skip_blanks(text, position)):
        raise ScpiError(-102)


def _refuse_character(text: str, position: int) -> NoReturn:
    character = text[position : position + 1]
    raise ScpiError(-102 if not character or character in _BLANK or character in ":;,.+-'\"?(*" else -101)


def _tokens(text: str, position: int) -> tuple[tuple[Token, ...], int]:
    tokens: list[Token] = []
    if position >= len(text) or text[position] == ";":
        return (), position
    while True:
        token, position = _token(text, position)
        tokens.append(token)
        end, position = position, _skip_blanks(text, position)
        if position >= len(text) or text[position] == ";":
            return tuple(tokens), position
        if text[position] != "," or end != position:
            character = text[position]
            if character in ":,":  # a comma comes here after a blank, which the guide forbids
                raise ScpiError(-102)
            raise ScpiError(-103 if character.isalnum() or character in "+-.'\"(" else -101)
        position = _skip_blanks(text, position + 1)


def _token(text: str, position: int) -> tuple[Token, int]:
    character = text[position : position + 1]
    if character.isalpha() and character.isascii():
        match = _WORD.match(text, position)
        assert match is not None  # noqa: S101  (it begins with a letter)
        return Token(TokenKind.WORD, match[0].upper()), match.end()
    if character in _STRING:
        return _string(text, position, character)
    if character == "#":
        return _hash(text, position)
    if character == "(":
        depth = 0
        for end in range(position, len(text)):
            depth += (text[end] == "(") - (text[end] == ")")
            if depth == 0:
                return Token(TokenKind.EXPRESSION, text[position + 1 : end]), end + 1
        raise ScpiError(-171)
    if character and character in "+-.0123456789":
        return _number(text, position)
    _refuse_character(text, position)


def _string(text: str, position: int, quote: str) -> tuple[Token, int]:
    match = _STRING[quote].match(text, position)
    if match is None:
        raise ScpiError(-151)
    return Token(TokenKind.STRING, match[1].replace(quote * 2, quote)), match.end()


def _number(text: str, position: int) -> tuple[Token, int]:
    match = _NUMBER.match(text, position)
    if match is None:
        raise ScpiError(-121)
    # -123, -124 beyond the limits of IEEE 488.2, 7.7.2.4. Infinity is only a word.
    mantissa = match[1]
    exponent = match[2] or "0"
    if len(exponent.lstrip("+-0")) > len(str(_LARGEST_EXPONENT)) or abs(int(exponent)) > _LARGEST_EXPONENT:
        raise ScpiError(-123)
    if len(mantissa.lstrip("+-0").replace(".", "")) > _LONGEST_MANTISSA:
        raise ScpiError(-124)
    number = min(max(float(f"{mantissa}E{exponent}"), -_LARGEST), _LARGEST)
    suffix = _SUFFIX.match(text, match.end())
    end = match.end() if suffix is None else suffix.end()
    if end < len(text) and text[end] in "+-.":
        raise ScpiError(-121)
    unit = "" if suffix is None else suffix[1].upper()
    if len(unit) > _MNEMONIC_LIMIT:
        raise ScpiError(-134)
    return Token(TokenKind.NUMBER, match[0], number, unit), end


def _hash(text: str, position: int) -> tuple[Token, int]:
    if position + 1 < len(text) and text[position + 1] in _DIGITS:
        return _block(text, position)
    match = _BASED.match(text, position)
    if match is None:
        raise ScpiError(-101)
    which = next(index for index, digits in enumerate(match.groups()) if digits is not None)
    return Token(TokenKind.NUMBER, match[0], _based(match.groups()[which], _BASES[which])), match.end()


def _based(digits: str, base: int) -> float:
    if len(digits.lstrip("0")) > _LONGEST_MANTISSA:
        raise ScpiError(-124)
    try:
        return float(int(digits, base))
    except ValueError:
        raise ScpiError(-121) from None


def _block(text: str, position: int) -> tuple[Token, int]:
    digits = int(text[position + 1])
    start = position + 2 + digits
    if digits == 0:
        return Token(TokenKind.BLOCK, text[start:]), len(text)
    length = text[position + 2 : start]
    if len(length) < digits or length.strip(_DIGITS) or start + int(length) > len(text):
        raise ScpiError(-161)
    end = start + int(length)
    return Token(TokenKind.BLOCK, text[start:end]), end


def _skip_blanks(text: str, position: int) -> int:
    while position < len(text) and text[position] in _BLANK:
        position += 1
    return position
