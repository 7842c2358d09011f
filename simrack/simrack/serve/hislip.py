"""HiSLIP 1.0 (IVI-6.1): the synchronous and the asynchronous channel of a session, in both of its modes.

Sessions start in synchronised mode, where an answer that was not read when the next message comes is lost with an
*interrupted* exchange; a client may choose overlapped mode at a device clear.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable, Iterator, Mapping
from itertools import count
from typing import NamedTuple

from simrack.handlers import Handlers
from simrack.serve.embodied import HISLIP
from simrack.serve.instrument import Client, ServedInstrument
from simrack.serve.loop import Loop
from simrack.serve.wire import Connection, Listener

_HEADER = struct.Struct("!2sBBIQ")
_PROLOGUE = b"HS"
_MAX_PAYLOAD = 1 << 20
"""Of a message to the instrument, and of one from it until the client says what it takes."""
_LARGEST_PAYLOAD = 1 << 28
_SMALLEST_PAYLOAD = 16
"""However little the client says that it takes; a waveform in messages of a byte would be 17 times as long."""
_HELD_BACK = 1024
"""Messages that wait for the instrument before no more are received."""
_COPIED = 1 << 16
"""Answers up to here are put together with their header; longer ones are sent from where they are."""
_VERSION = 0x0100
_VENDOR = int.from_bytes(b"VB", "big")
_FIRST_ID = 0xFFFF_FF00
_ID_MASK = 0xFFFF_FFFF

_INITIALIZE, _INITIALIZE_RESPONSE, _FATAL_ERROR, _ERROR = 0, 1, 2, 3
_ASYNC_LOCK, _ASYNC_LOCK_RESPONSE, _DATA, _DATA_END = 4, 5, 6, 7
_CLEAR_COMPLETE, _CLEAR_ACKNOWLEDGE, _REMOTE_LOCAL, _REMOTE_LOCAL_RESPONSE = 8, 9, 10, 11
_TRIGGER, _INTERRUPTED, _ASYNC_INTERRUPTED = 12, 13, 14
_MAX_SIZE, _MAX_SIZE_RESPONSE, _ASYNC_INITIALIZE, _ASYNC_INITIALIZE_RESPONSE = 15, 16, 17, 18
_ASYNC_CLEAR, _SERVICE_REQUEST, _STATUS_QUERY, _STATUS_RESPONSE = 19, 20, 21, 22
_ASYNC_CLEAR_ACKNOWLEDGE, _LOCK_INFO, _LOCK_INFO_RESPONSE = 23, 24, 25
_BAD_HEADER, _NOT_BOTH_CHANNELS, _BAD_INITIALIZATION = 1, 2, 3
_UNKNOWN_TYPE, _TOO_LARGE = 1, 4
_LOCK_FAILED, _LOCK_GRANTED, _LOCK_SHARED, _LOCK_ERROR = 0, 1, 2, 3


class _Message(NamedTuple):
    kind: int
    control: int
    parameter: int
    payload: bytes


class _Channel(Connection):
    """One of the two connections of a session; until its first message it is neither."""

    def __init__(self, server: HislipServer, connection: socket.socket) -> None:
        self.server = server
        self.session: _Session | None = None
        self.handle: Callable[[_Message], None] = self._introduce
        self._input = bytearray()
        self._skip = 0
        super().__init__(server.loop, connection)

    def post(self, kind: int, control: int = 0, parameter: int = 0, payload: bytes | memoryview = b"") -> None:
        """Send a message."""
        self.send(_HEADER.pack(_PROLOGUE, kind, control, parameter, len(payload)) + payload)

    def fail(self, code: int, words: str) -> None:
        """Send a fatal error and end the connection."""
        self.post(_FATAL_ERROR, code, 0, words.encode())
        self.close()

    def gone(self) -> None:
        """End the session too."""
        self.server.channels.discard(self)
        if self.session is not None:
            self.session.end()

    def relieved(self) -> None:
        """Resume the session."""
        if self.session is not None:
            self.session.instrument.resume(self.session)

    def received(self, data: bytes) -> None:
        """Handle the messages that are complete."""
        self._input += data
        while not self.closed and (message := self._next_message()) is not None:
            self.handle(message)

    def _next_message(self) -> _Message | None:
        dropped = min(self._skip, len(self._input))
        del self._input[:dropped]
        self._skip -= dropped
        if self._skip or len(self._input) < _HEADER.size:
            return None
        prologue, kind, control, parameter, size = _HEADER.unpack_from(self._input)
        if prologue != _PROLOGUE:
            self.fail(_BAD_HEADER, "poorly formed message header")
            return None
        if size > _MAX_PAYLOAD + _HEADER.size:
            self.post(_ERROR, _TOO_LARGE, 0, b"message too large")
            del self._input[: _HEADER.size]
            self._skip = size
            return self._next_message()
        end = _HEADER.size + size
        if len(self._input) < end:
            return None
        payload = bytes(self._input[_HEADER.size : end])
        del self._input[:end]
        return _Message(kind, control, parameter, payload)

    def _introduce(self, message: _Message) -> None:
        """Take the first message, which says the kind of this connection."""
        if message.kind == _INITIALIZE:
            self.server.begin(self, message)
        elif message.kind == _ASYNC_INITIALIZE:
            self.server.join(self, message)
        else:
            self.fail(_BAD_INITIALIZATION, "invalid initialization sequence")


class _Session(Client):
    """A session: answers are pushed on the synchronous channel."""

    _ASYNC = Handlers()

    def __init__(self, server: HislipServer, instrument: ServedInstrument, channel: _Channel, number: int) -> None:
        super().__init__(instrument, HISLIP)
        self.number = number
        self._server = server
        self._sync = channel
        self._async: _Channel | None = None
        self._max_payload = _MAX_PAYLOAD
        self._overlapped = False
        self._clearing = False
        self._unread = False
        self._ids = count(_FIRST_ID, 2)
        self._shared_key: str | None = None
        self._actions: dict[int, Callable[[_Channel, _Message], None]] = self._ASYNC.bound(self)

    @property
    def blocked(self) -> bool:
        """True if the client does not take its answers, or another holds the lock."""
        return self._sync.blocked or self._locked_out()

    def _locked_out(self) -> bool:
        instrument = self.instrument
        sharers = self._server.sharers(instrument)
        return instrument.lock not in (None, self) or (bool(sharers) and self not in sharers)

    def relieved(self) -> None:
        """Receive again."""
        self._sync.hold(held=False)

    @property
    def complete(self) -> bool:
        """True if it has both its channels."""
        return self._async is not None

    def attach(self, channel: _Channel) -> None:
        """Take the asynchronous channel; from here on the instrument can be talked to."""
        self._async = channel
        channel.handle = self._on_async
        self.instrument.watches_service = True

    def end(self) -> None:
        """End both channels and be forgotten."""
        if self.closed:
            return
        self.closed = True
        self._server.sessions.pop(self.number, None)
        for channel in (self._sync, self._async):
            if channel is not None:
                channel.close()
        if self._shared_key is not None:
            self._server.share(self.instrument, self, None)
        self.leave()

    def start_anew(self) -> None:
        """Forget the message under way."""
        super().start_anew()
        self._unread = False

    def cut(self) -> None:
        """Lose the connection."""
        self.end()

    def freeze(self) -> list[socket.socket]:
        """Serve both channels no more, but leave them open."""
        channels = [each for each in (self._sync, self._async) if each is not None and not each.closed]
        dead = [channel.detach() for channel in channels]
        self._server.channels.difference_update(channels)
        self.end()
        return dead

    # --- synchronous channel ------------------------------------------------------------------------------

    def on_sync(self, message: _Message) -> None:
        """Take a message on the synchronous channel."""
        if self._async is None:
            self._sync.fail(_NOT_BOTH_CHANNELS, "the asynchronous channel is not established")
        elif message.kind == _CLEAR_COMPLETE:
            self._clearing = self._unread = False
            self._overlapped = bool(message.control & 1)
            self._ids = count(_FIRST_ID, 2)
            self._sync.post(_CLEAR_ACKNOWLEDGE, message.control & 1)
        elif self._clearing:
            return  # abandoned by the client, as everything until its device clear is complete
        elif message.kind in (_DATA, _DATA_END):
            self._check_interrupted(message)
            self.take(message.payload, end=message.kind == _DATA_END, tag=message.parameter)
            self._sync.hold(held=len(self.backlog) > _HELD_BACK)
        elif message.kind == _TRIGGER:
            self._check_interrupted(message)
            self.tag = message.parameter
            self.instrument.trigger(self)
        elif message.kind not in (_FATAL_ERROR, _ERROR):
            self._sync.post(_ERROR, _UNKNOWN_TYPE, 0, b"unrecognized message type")

    def deliver(self, data: bytes, *, end: bool) -> None:
        """Send a response, in as many messages as the client's limit asks for."""
        if len(data) <= min(self._max_payload, _COPIED):
            self._sync.post(_DATA_END if end else _DATA, 0, self._message_id(), data)
        else:
            self._sync.send_parts(self._messages(data, end=end))
        self._unread = True

    def _messages(self, data: bytes, *, end: bool) -> Iterator[bytes | memoryview]:
        view, size = memoryview(data), self._max_payload
        for start in range(0, len(data), size):
            part = view[start : start + size]
            kind = _DATA_END if end and start + size >= len(data) else _DATA
            yield _HEADER.pack(_PROLOGUE, kind, 0, self._message_id(), len(part))
            yield part

    def _message_id(self) -> int:
        return next(self._ids) & _ID_MASK if self._overlapped else self.tag or 0

    def _check_interrupted(self, message: _Message) -> None:
        """In synchronised mode, a message from a client that has not read its answer loses it."""
        unread, self._unread = self._unread and not message.control & 1, False
        if unread and not self._overlapped and self._async is not None:
            self._sync.post(_INTERRUPTED, 0, message.parameter)
            self._async.post(_ASYNC_INTERRUPTED, 0, message.parameter)
            self.instrument.complain(-410)

    # --- asynchronous channel -----------------------------------------------------------------------------

    def _on_async(self, message: _Message) -> None:
        action = self._actions.get(message.kind)
        if not self._sync.blocked and not self._sync.held:
            self._sync.receive()  # what was sent there before comes before
        if self._async is None or self.closed or message.kind in (_FATAL_ERROR, _ERROR):
            return
        if action is None:
            self._async.post(_ERROR, _UNKNOWN_TYPE, 0, b"unrecognized message type")
        else:
            action(self._async, message)

    @_ASYNC.of(_MAX_SIZE)
    def _limit(self, channel: _Channel, message: _Message) -> None:
        if len(message.payload) == 8:
            (size,) = struct.unpack("!Q", message.payload)
            self._max_payload = max(_SMALLEST_PAYLOAD, min(size - _HEADER.size, _LARGEST_PAYLOAD))
        channel.post(_MAX_SIZE_RESPONSE, 0, 0, struct.pack("!Q", _MAX_PAYLOAD + _HEADER.size))

    @_ASYNC.of(_STATUS_QUERY)
    def _status(self, channel: _Channel, message: _Message) -> None:
        if message.control & 1:
            self._unread = False
        byte = self.instrument.status_byte()
        channel.post(_STATUS_RESPONSE, byte | 16 if self._unread else byte)

    @_ASYNC.of(_ASYNC_CLEAR)
    def _clear(self, channel: _Channel, _message: _Message) -> None:
        self._clearing = True
        self.instrument.clear(self)
        channel.post(_ASYNC_CLEAR_ACKNOWLEDGE, 0)

    @_ASYNC.of(_REMOTE_LOCAL)
    def _remote_local(self, channel: _Channel, _message: _Message) -> None:
        """Accept: the simulated front panels have no keys to lock."""
        channel.post(_REMOTE_LOCAL_RESPONSE)

    def service_requested(self) -> None:
        """Send the client a service request; bit 6 stays set until it reads the status byte."""
        engine = self.instrument.engine
        if self._async is not None and engine is not None:
            self._async.post(_SERVICE_REQUEST, engine.status_now() | 64)

    # --- locks --------------------------------------------------------------------------------------------

    @_ASYNC.of(_ASYNC_LOCK)
    def _lock(self, channel: _Channel, message: _Message) -> None:
        if message.control & 1 == 0:
            channel.post(_ASYNC_LOCK_RESPONSE, self._release_lock())
        elif self.instrument.lock is self:
            channel.post(_ASYNC_LOCK_RESPONSE, _LOCK_ERROR)
        else:
            self._seek_lock(channel, message.payload.decode("latin-1"), message.parameter / 1e3)

    def _release_lock(self) -> int:
        if self.instrument.lock is self:
            self.instrument.unlock()
            return _LOCK_GRANTED
        if self._shared_key is not None:
            self._shared_key = None
            self._server.share(self.instrument, self, None)
            return _LOCK_SHARED
        return _LOCK_ERROR

    def _seek_lock(self, channel: _Channel, key: str, seconds: float) -> None:
        """Take the lock, now or as soon as it is free within `seconds`."""
        if self._try_lock(key):
            channel.post(_ASYNC_LOCK_RESPONSE, _LOCK_GRANTED)
            return
        if seconds <= 0:
            channel.post(_ASYNC_LOCK_RESPONSE, _LOCK_FAILED)
            return
        waiters = self.instrument.lock_waiters

        def give_up() -> None:
            if retry in waiters:
                waiters.remove(retry)
            channel.post(_ASYNC_LOCK_RESPONSE, _LOCK_FAILED)

        def retry() -> None:
            if self.closed:
                timer.cancel()
            elif self._try_lock(key):
                timer.cancel()
                channel.post(_ASYNC_LOCK_RESPONSE, _LOCK_GRANTED)
            else:
                self.instrument.lock_waiters.append(retry)

        timer = self._server.loop.call_later(seconds, give_up)
        waiters.append(retry)

    def _try_lock(self, key: str) -> bool:
        """Take an exclusive lock without a key (a sharer may too), a shared one with it."""
        sharers = self._server.sharers(self.instrument)
        if self.instrument.lock is not None:
            return False
        if not key:
            if sharers and self not in sharers:
                return False
            self.instrument.lock = self
            return True
        if any(other != key for other in sharers.values()):
            return False
        self._shared_key = key
        self._server.share(self.instrument, self, key)
        return True

    @_ASYNC.of(_LOCK_INFO)
    def _lock_info(self, channel: _Channel, _message: _Message) -> None:
        exclusive = self.instrument.lock is not None
        holders = len(self._server.sharers(self.instrument)) + exclusive
        channel.post(_LOCK_INFO_RESPONSE, int(exclusive), holders)


class HislipServer:
    """Offers instruments by sub-address (`hislip0`)."""

    def __init__(self, loop: Loop, address: tuple[str, int], instruments: Mapping[str, ServedInstrument]) -> None:
        self.loop = loop
        self.instruments = {name.lower(): each for name, each in instruments.items()}
        self.sessions: dict[int, _Session] = {}
        self.channels: set[_Channel] = set()
        self._numbers = count(1)
        self._shares: dict[ServedInstrument, dict[_Session, str]] = {}
        self.listener = Listener(loop, address, lambda connection: self.channels.add(_Channel(self, connection)))
        self.port = self.listener.port

    def close(self) -> None:
        """Stop listening and end the sessions."""
        self.listener.close()
        for channel in tuple(self.channels):
            channel.close()

    def begin(self, channel: _Channel, message: _Message) -> None:
        """Open a session on its synchronous channel."""
        name = message.payload.decode("latin-1").lower() or "hislip0"
        instrument = self.instruments.get(name)
        if instrument is None:
            channel.fail(_BAD_INITIALIZATION, f"there is no {name!r} here")
            return
        number = next(free for each in self._numbers if (free := each & 0xFFFF) not in self.sessions)
        session = _Session(self, instrument, channel, number)
        self.sessions[number] = session
        channel.session = session
        channel.handle = session.on_sync
        channel.post(_INITIALIZE_RESPONSE, 0, _VERSION << 16 | number)

    def join(self, channel: _Channel, message: _Message) -> None:
        """Give a session its asynchronous channel."""
        session = self.sessions.get(message.parameter & 0xFFFF)
        if session is None or session.complete:
            channel.fail(_BAD_INITIALIZATION, "there is no such session that waits for its second channel")
            return
        channel.session = session
        session.attach(channel)
        channel.post(_ASYNC_INITIALIZE_RESPONSE, 0, _VENDOR)

    def sharers(self, instrument: ServedInstrument) -> dict[_Session, str]:
        """Return the sessions that share a lock on `instrument`, and its key."""
        return self._shares.setdefault(instrument, {})

    def share(self, instrument: ServedInstrument, session: _Session, key: str | None) -> None:
        """Note that `session` shares a lock on `instrument`, or no longer does."""
        if key is None:
            self.sharers(instrument).pop(session, None)
            if instrument.lock is None:
                instrument.unlock()
        else:
            self.sharers(instrument)[session] = key
