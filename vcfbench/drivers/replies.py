"""Answers of instruments as values: strict readers that never guess.

Each raises :class:`~vcfbench.errors.FramingError` for anything that is not of its form.
"""

import math
import re
from collections.abc import Sequence

from msgspec import Struct

from vcfbench.errors import FramingError, MeasurementError

OVERLOAD = 9.9e37 * (1.0 - 1e-9)
"""From this magnitude on a number means "no value" (SCPI-99 vol. 1, 7.2.1.4: 9.9E37 infinity, 9.91E37 not a number).

Its last digit is apart: no double holds 9.9E37 to the fifteen decimals of some answers.
"""

_ANY_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_INTEGER = re.compile(r"[+-]?[0-9]+")
_ERROR = re.compile(r'([+-]?[0-9]+)(?:\.0*)?(?:[eE][+-]?0+)? *, *"((?:[^"]|"")*)"')
"""A number that some boxes send as a decimal one, and blanks about the comma that others send, tell nothing else."""
_PLAIN_DATA = re.compile(rb"(?:[^;,\n\"]|\"[^\"\n]*\")*")
"""One item of an answer that is no block; a quoted one may hold separators (IEEE 488.2, 8.7.8)."""

_PROMPT = re.compile(rb"[\w .:/-]{1,40}>(?:\s|$)")
_NUL = re.compile(rb"^\0(?!\0)|(?<!\0)\0$")
"""One at an end of a line; counted replies begin with several."""
_NEGOTIATION = re.compile(rb"\xff[\xfb-\xfe]")
"""WILL, WON'T, DO or DON'T of telnet (RFC 854)."""

_NEWLINE, _BLOCK = b"\n#"
_SHOWN = 60


class NumberForm(Struct, frozen=True):
    """The form in which a model writes numbers: in words for messages, and the pattern that a reply must match whole.

    A reply that lost or gained a character is still a number more often than not; in a fixed form it is none.
    """

    words: str
    pattern: re.Pattern[str]


ANY_NUMBER = NumberForm("a number", _ANY_NUMBER)
"""NR1, NR2 or NR3: where a model promises no form."""


def nr3(decimals: int | None = None, exponent_digits: tuple[int, int] = (2, 2)) -> NumberForm:
    """Return the form ``+d.ddE+dd``: sign, one digit, point, `decimals` digits, capital E, sign, exponent.

    Args:
        decimals: how many digits follow the point; None is any number of them but none.
        exponent_digits: the least and the most digits of the exponent.
    """
    fraction = "+" if decimals is None else f"{{{decimals}}}"
    least, most = exponent_digits
    example = f"+d.{'d...' if decimals is None else 'd' * decimals}E+{'d' * least}"
    return NumberForm(
        f"a number of the form {example}", re.compile(rf"[+-][0-9]\.[0-9]{fraction}E[+-][0-9]{{{least},{most}}}")
    )


def _refuse(expected: str, came: str | bytes) -> FramingError:
    shown = repr(came[:_SHOWN]) + ("..." if len(came) > _SHOWN else "")
    return FramingError(f"expected {expected}, got {shown}")


LINE_SPEED = "check that baud_rate in the bench file equals the instrument's setting"


def likely_cause(came: bytes, asked: str | None, *, on_port: bool) -> str | None:
    """Return the likely cause of such a line in place of an answer to `asked`, and the cure; None if unknown.

    `on_port` says whether it came over a serial port.
    """
    line = came.strip()
    if _NEGOTIATION.search(line):
        return "a terminal server negotiates telnet (IAC): set its port to raw TCP"
    if asked and line == asked.strip().encode("latin-1"):
        return "commands are echoed: switch the echo off, at the instrument, the adapter or the terminal server"
    if _PROMPT.match(line):
        return "a prompt comes: this port is for people (telnet, often 5024), use the port for programs (often 5025)"
    if _NUL.search(line):
        return "a NUL byte comes with the answers, adapters add one: tell it not to (Prologix: ++eot_enable 0)"
    if on_port and not line.isascii():
        return LINE_SPEED
    return None


def text(reply: bytes) -> str:
    """Return a reply line as text; anything but printable ASCII is noise on the line."""
    line = reply.removesuffix(b"\n").removesuffix(b"\r")
    if not line.isascii():
        raise _refuse("ASCII text", reply)
    words = line.decode("ascii")
    if not words.isprintable():
        raise _refuse("printable text", reply)
    return words


def number(reply: str, form: NumberForm = ANY_NUMBER) -> float:
    """Return a decimal number of `form`; 9.9E37 and above are none."""
    if form.pattern.fullmatch(reply) is None or not -OVERLOAD < (value := float(reply)) < OVERLOAD:
        raise _refuse(form.words, reply)
    return value


def reading(reply: str, form: NumberForm = ANY_NUMBER) -> float:
    """Return a measured number; raises MeasurementError for 9.9E37, which means overload or no signal."""
    if form.pattern.fullmatch(reply) is None:
        raise _refuse(form.words, reply)
    value = float(reply)
    if not -OVERLOAD < value < OVERLOAD:
        raise MeasurementError(f"overload or not measurable (the instrument answers {reply})")
    return value


def ohms(reply: str, form: NumberForm = ANY_NUMBER) -> float:
    """Return a resistance, of a load or a lead; 9.9E37 is an open circuit, inf."""
    if form.pattern.fullmatch(reply) is None or (value := float(reply)) <= -OVERLOAD:
        raise _refuse(form.words, reply)
    return value if value < OVERLOAD else math.inf


def numbers(reply: str) -> tuple[float, ...]:
    """Return comma-separated numbers."""
    return tuple(number(field.strip()) for field in reply.split(","))


def integer(reply: str) -> int:
    """Return a whole number, with or without sign."""
    if _INTEGER.fullmatch(reply) is None:
        raise _refuse("a whole number", reply)
    return int(reply)


def boolean(reply: str) -> bool:
    """Return a switch: ``0`` or ``1``."""
    if reply not in ("0", "1"):
        raise _refuse("0 or 1", reply)
    return reply == "1"


def error_entry(reply: str) -> tuple[int, str]:
    """Return number and words of one entry of the error queue, ``-222,"Data out of range"``."""
    found = _ERROR.fullmatch(reply)
    if found is None:
        raise _refuse("an entry of the error queue", reply)
    return int(found[1]), found[2].replace('""', '"')


def identity_fields(reply: str) -> tuple[str, str, str, str]:
    """Return the four fields of ``*IDN?``; the last may hold commas."""
    fields = [field.strip() for field in reply.split(",", 3)]
    if len(fields) != 4 or _PROMPT.match(reply.encode("ascii")):
        raise _refuse("maker,model,serial,firmware", reply)
    return fields[0], fields[1], fields[2], fields[3]


def block_length(head: Sequence[int] | bytes) -> tuple[int, int] | None:
    """Return header length and data length of the definite-length block that begins with `head`.

    ``#800001000...`` gives ``(10, 1000)``. None when `head` is still too short to tell (IEEE 488.2, 8.7.9).
    """
    begin = bytes(head[:11])
    if not begin:
        return None
    if begin[:1] != b"#" or not (begin[1:2] == b"" or begin[1:2] in b"123456789"):
        raise _refuse("a definite-length block", begin)
    if len(begin) < 2:
        return None
    header = 2 + int(begin[1:2])
    digits = begin[2:header]
    if digits and not digits.isdigit():
        raise _refuse("the length of a block", begin)
    return (header, int(digits)) if len(begin) >= header else None


def is_whole(answer: bytes | bytearray, *, ended: bool) -> bool:
    """Return True if an answer is complete: by END, or by its newline, which the data of blocks may hold as well.

    Blocks stand alone or between other items: ``4,0,1000;#800001000...`` answers two questions.
    """
    if ended or not answer:
        return ended
    place = 0
    while place < len(answer):
        try:
            lengths = block_length(answer[place : place + 11]) if answer[place] == _BLOCK else (0, 0)
        except FramingError:  # a text that begins like a block
            lengths = (0, 0)
        item = None if lengths is None else _PLAIN_DATA.match(answer, place + sum(lengths))
        if item is None or item.end() >= len(answer):
            return False
        if answer[item.end()] == _NEWLINE:
            return True
        place = item.end() + 1
    return False
