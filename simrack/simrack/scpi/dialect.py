"""Differences between models (dialect) and between the connectors of one model (interface)."""

from __future__ import annotations

from collections.abc import Callable

from msgspec import Struct, field

from simrack.scpi.formats import signed_integer
from simrack.scpi.parameters import Limits, Violation, refuse


class Interface(Struct, frozen=True):
    """A connector: the end of its messages, and its rules of message exchange.

    Args:
        name: as in a constructor's `interface`.
        terminator: end of a response message.
        message_exchange: IEEE 488.2 rules apply: an unread answer is lost to the next message (-410), a read with
            nothing to say is -420. A UART or a socket just sends what it has.
        break_byte: byte that acts as device clear (Ctrl-C on RS-232).
    """

    name: str
    terminator: bytes = b"\n"
    message_exchange: bool = True
    break_byte: bytes = b""


GPIB = Interface("gpib")


USB = Interface("usb")


LAN = Interface("lan", message_exchange=False)


RS232 = Interface("rs232", b"\r\n", message_exchange=False, break_byte=b"\x03")


class Dialect(Struct, frozen=True):
    """Properties of a model's parser.

    Args:
        queue_depth: entries of the error queue.
        words: error words that differ from the standard ones.
        number_not_allowed: error for a number where a word or string is due.
        out_of_range: what becomes of a number beyond its limits (`refuse` or `clip`).
        integer: reply format of registers and counts.
        error_number: reply format of an error's number.
        error_suffix: what follows the words of an error: of its number and the bench time at which it happened.
        input_limit: longest message, bytes.
        input_overflow: error when it is longer.
        input_buffer: characters that are held while the parser waits for its answers to be fetched (-430 beyond).
        output_queue: characters of answers that are held until they are fetched. Unverified for every model.
        takes_blocks: whether any command has a block; where none has, a newline within one ends the message.
        xonxoff: whether the handshake of its RS-232 is XON and XOFF instead of DTR.
    """

    queue_depth: int = 20
    words: dict[int, str] = field(default_factory=dict)
    number_not_allowed: int = -128
    out_of_range: Callable[[float, Limits, str], Violation] = refuse
    integer: Callable[[float], str] = signed_integer
    error_number: Callable[[float], str] = signed_integer
    error_suffix: Callable[[int, float], str] = lambda _number, _instant_s: ""
    input_limit: int = 1 << 16
    input_overflow: int = 521
    input_buffer: int = 1 << 14
    output_queue: int = 1 << 14
    takes_blocks: bool = True
    xonxoff: bool = False
