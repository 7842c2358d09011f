"""Ends of the messages of a device, and its own calls for them."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TypeAlias

from simrack.device import Device
from simrack.own import OwnBox
from simrack.rate_tables.line import LineDevice
from simrack.rate_tables.stream import FrameDevice
from simrack.scpi import ScpiTwin
from simrack.scpi.lexer import find_message_end

Bytes: TypeAlias = bytes | bytearray

_BLANK = re.compile(rb"[\r\n]*")
NOTHING_EMPTY = re.compile(b"")
"""Finds no empty message: there every one counts."""


def answer_of(device: Device) -> Callable[[bytes], bytes | None]:
    """Return the device's write and read in one."""
    if isinstance(device, ScpiTwin) and (device.write, device.read) == (device.engine.write, device.engine.read):
        return device.engine.answer
    return no_answer


def no_answer(_message: bytes) -> None:
    """Answer nothing in one: each message is written, and its answer read."""


def message_sizes(device: Device) -> tuple[Callable[[Bytes], int], Callable[[Bytes], int]]:
    """Return a function that finds the end of a message for `device`, and of the rest of one that is too long."""
    if isinstance(device, ScpiTwin):
        if device.engine.dialect.takes_blocks:
            return lambda data: find_message_end(data) + 1, _newline_size
        return _newline_size, _newline_size
    if isinstance(device, FrameDevice | OwnBox):
        return device.message_size, device.message_size
    return (_line_size, _line_size) if isinstance(device, LineDevice) else (len, len)


def empty_messages(device: Device) -> re.Pattern[bytes]:
    """Return the pattern of empty messages for `device`, which are dropped."""
    if isinstance(device, ScpiTwin):
        return _BLANK
    if isinstance(device, LineDevice) and device.terminators:
        return re.compile(b"[%b]*" % re.escape(device.terminators))
    return NOTHING_EMPTY


def _newline_size(data: Bytes) -> int:
    return data.find(b"\n") + 1


def _line_size(data: Bytes) -> int:
    """Return the length of the first line in `data`, ended by CR or LF, 0 while it is incomplete."""
    ends = [index for index in (data.find(b"\r"), data.find(b"\n")) if index >= 0]
    return min(ends) + 1 if ends else 0
