"""ONC remote procedure calls over TCP and UDP (RFC 5531) with XDR (RFC 4506): all that VXI-11 and port mapper need."""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import NamedTuple

from simrack.serve.loop import Loop
from simrack.serve.wire import Bound, Connection, family_of

Programs = Mapping[tuple[int, int], Mapping[int, Callable[["Call"], bytes | None]]]
"""Procedures by number, of a program and version: each returns its result, None if that comes later."""

_LAST = 0x8000_0000
_LONGEST_RECORD = 1 << 24
_LONGEST_DATAGRAM = 1 << 16
_WAITING = 1 << 18
"""Bytes of calls that may wait while another is being served."""
_CALL, _RPC_VERSION = 0, 2
_WORD = struct.Struct(">I")
_CALL_HEADER = struct.Struct(">6I")
_NO_CREDENTIALS = bytes(16)
_ACCEPTED = struct.Struct(">6I")
_SUCCESS, _NO_PROGRAM, _VERSION_MISMATCH, _NO_PROCEDURE, _GARBAGE = 0, 1, 2, 3, 4


class BadArguments(Exception):
    """The arguments of a call do not decode."""


class Unpacker:
    """Reads XDR items one after the other."""

    __slots__ = ("_data", "_position")

    def __init__(self, data: bytes, position: int = 0) -> None:
        self._data = data
        self._position = position

    def words(self, layout: struct.Struct) -> tuple[int, ...]:
        """Return integers laid out as `layout`."""
        try:
            values = layout.unpack_from(self._data, self._position)
        except struct.error:
            raise BadArguments from None
        self._position += layout.size
        return values

    def opaque(self) -> bytes:
        """Return bytes of variable length."""
        (size,) = self.words(_WORD)
        start = self._position
        if start + size > len(self._data):
            raise BadArguments
        self._position = start + size + (-size & 3)
        return self._data[start : start + size]


class Call(NamedTuple):
    """A call: its number, program and procedure, and its arguments."""

    xid: int
    program: int
    version: int
    procedure: int
    arguments: Unpacker


def opaque(data: bytes) -> bytes:
    """Return `data` as XDR bytes of variable length."""
    size = len(data)
    return _WORD.pack(size) + data + bytes(-size & 3)


def parse_call(record: bytes) -> Call:
    """Decode a call; its credentials are skipped.

    Raises:
        BadArguments: it is no call of this version of the protocol.
    """
    unpacker = Unpacker(record)
    xid, kind, rpc_version, program, version, procedure = unpacker.words(_CALL_HEADER)
    if (kind, rpc_version) != (_CALL, _RPC_VERSION):
        raise BadArguments
    for _ in ("credentials", "verifier"):
        unpacker.words(_WORD)
        unpacker.opaque()
    return Call(xid, program, version, procedure, unpacker)


def call_record(xid: int, program: int, version: int, procedure: int, arguments: bytes) -> bytes:
    """Return the record of a call without credentials."""
    return _CALL_HEADER.pack(xid, _CALL, _RPC_VERSION, program, version, procedure) + _NO_CREDENTIALS + arguments


def reply(xid: int, result: bytes, status: int = _SUCCESS) -> bytes:
    """Return the record of an accepted call's reply."""
    return _ACCEPTED.pack(xid, 1, 0, 0, 0, status) + result


def marked(record: bytes) -> bytes:
    """Return `record` with the mark of a last fragment."""
    return _WORD.pack(_LAST | len(record)) + record


def dispatch(programs: Programs, call: Call) -> tuple[bytes | None, int]:
    """Return the result of a call, None if it comes later, and the status of its acceptance."""
    procedures = programs.get((call.program, call.version))
    if procedures is None:
        versions = [version for program, version in programs if program == call.program]
        if versions:
            return struct.pack(">2I", min(versions), max(versions)), _VERSION_MISMATCH
        return b"", _NO_PROGRAM
    procedure = procedures.get(call.procedure)
    if procedure is None:
        return b"", _SUCCESS if call.procedure == 0 else _NO_PROCEDURE
    try:
        return procedure(call), _SUCCESS
    except BadArguments:
        return b"", _GARBAGE


class RpcDatagrams(Bound):
    """A socket on which calls and replies are datagrams (UDP); every procedure answers at once."""

    def __init__(self, loop: Loop, address: tuple[str, int], programs: Programs) -> None:
        bound = socket.socket(family_of(address), socket.SOCK_DGRAM)
        bound.bind(address)
        super().__init__(loop, bound)
        self._programs = programs

    def _ready(self, _mask: int) -> None:
        with suppress(BlockingIOError, ConnectionError, BadArguments):
            data, caller = self._socket.recvfrom(_LONGEST_DATAGRAM)
            call = parse_call(data)
            result, status = dispatch(self._programs, call)
            if result is not None:
                self._socket.sendto(reply(call.xid, result, status), caller)


class RpcConnection(Connection):
    """A client's connection: calls are answered one after the other, in order.

    A procedure of `programs` that returns None answers later through :meth:`answer`.
    """

    def __init__(self, loop: Loop, connection: socket.socket) -> None:
        self.programs: Programs = {}
        self._input = bytearray()
        self._record = bytearray()
        self._calling: int | None = None
        super().__init__(loop, connection)

    def received(self, data: bytes) -> None:
        """Serve the calls that are complete."""
        self._input += data
        self._next_calls()

    def answer(self, xid: int, result: bytes, status: int = _SUCCESS) -> None:
        """Send the reply to call `xid`, and go on with the next when this one is no longer being served."""
        self._calling = None
        self.send(marked(reply(xid, result, status)))
        if self._input:
            self.loop.call_later(0.0, self._next_calls)

    def _next_calls(self) -> None:
        while not self.closed and self._calling is None and (record := self._next_record()) is not None:
            self._serve(record)
        # Receive no more while a call is being served and others wait already
        self.hold(held=self._calling is not None and len(self._input) > _WAITING)

    def _next_record(self) -> bytes | None:
        """Put the fragments of a record together; None while it is incomplete."""
        while len(self._input) >= 4:
            (mark,) = _WORD.unpack_from(self._input)
            size = mark & ~_LAST
            if size + len(self._record) > _LONGEST_RECORD:
                self.close()
                return None
            if len(self._input) < 4 + size:
                return None
            fragment = bytes(self._input[4 : 4 + size])
            del self._input[: 4 + size]
            if mark & _LAST and not self._record:
                return fragment
            self._record += fragment
            if mark & _LAST:
                record, self._record = bytes(self._record), bytearray()
                return record
        return None

    def _serve(self, record: bytes) -> None:
        try:
            call = parse_call(record)
        except BadArguments:
            self.close()
            return
        self._calling = call.xid
        result, status = dispatch(self.programs, call)
        if result is not None:
            self.answer(call.xid, result, status)
