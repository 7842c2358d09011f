"""One instrument behind many connections: whose message it executes, and the client that gets the answer.

An instrument has one parser and one output. Connections take turns, a message each, and while a query of one is
being answered the messages of the others wait. Each message is executed with the personality of the connector it came
through (terminator, IEEE 488.2 message exchange), as in a box with several.
"""

from __future__ import annotations

import math
import socket
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol

from simrack.device import Device
from simrack.scpi import Interface
from simrack.serve.clock import ServedClock
from simrack.serve.embodied import CONVERTER, SOCKET, EmbodiedDevice
from simrack.serve.framing import NOTHING_EMPTY
from simrack.serve.wire import DelayingWire

WHOLE_RESPONSE = 1 << 25
_PASSED_WHILE_BUSY = 256
_TRIGGER = b"*TRG"
_CLEAR = b"++clr"
"""What GPIB converters (Prologix and those like it) take for themselves: selected device clear."""
_NOTHING = math.inf


class Client:
    """A connection to an instrument. Subclasses carry the bytes.

    Args:
        instrument: what it is connected to.
        interface: the personality that the instrument shows it.
    """

    pushes = True
    """Whether answers are sent as soon as they are there; otherwise they stay in the instrument until fetched."""

    comes_and_goes = True
    """Whether it is there because somebody connected; a serial line always is."""

    address: object = None
    """What its other end calls itself, if that has a name: the number of a TCP port, the path of a terminal."""

    def __init__(self, instrument: ServedInstrument, interface: Interface) -> None:
        self.instrument = instrument
        self.taken = self.said = 0
        """Bytes that came from the other end, and bytes that were sent there."""
        self.heard = False
        """Whether who leads the clock asks on the control port for what is said to it, and time waits for that."""
        self.lost = False
        """Whether the other end can see that the connection has ended."""
        self.interface = interface
        self.backlog: deque[tuple[bytes, bool, Any]] = deque()
        self.partial = bytearray()
        self.overlong = b""
        self.queued = False
        self.closed = False
        self.tag: Any = None
        instrument.clients.add(self)
        if self.comes_and_goes:
            instrument.clock.start()

    @property
    def blocked(self) -> bool:
        """True if its messages must wait because it does not take its answers."""
        return False

    @property
    def awaits(self) -> bool:
        """True if it waits for the answer that it is owed, so that time may jump there."""
        return self.pushes and not self.heard and not self.blocked

    @property
    def listens(self) -> bool:
        """True if the client receives the instrument's unasked messages."""
        return self.pushes and not self.blocked

    def deliver(self, data: bytes, *, end: bool) -> None:
        """Take (a part of) a response; here it goes nowhere, as of a question whose asker has left."""

    def refill(self) -> None:
        """Called when the instrument has gone on: a pending read may find something now."""

    def relieved(self) -> None:
        """Called when none of its messages waits any more."""

    def service_requested(self) -> None:
        """Called when the instrument begins to request service."""

    def take(self, data: bytes, *, end: bool = False, tag: Any = None) -> None:
        """Cut bytes into messages and hand those over; the rest stays until its end comes."""
        instrument = self.instrument
        if self.overlong:
            data = self._skip(data, end=end, tag=tag)
        self.partial += data
        blank = instrument.blank if self.pushes else NOTHING_EMPTY  # elsewhere even an empty message interrupts
        while True:
            if (found := blank.match(self.partial)) is not None and found.end():
                del self.partial[: found.end()]
            if (size := instrument.message_size(self.partial)) <= 0:
                break
            message = bytes(self.partial[:size])
            del self.partial[:size]
            instrument.submit(self, message, tag)
        if end and self.partial:
            message = bytes(self.partial)
            self.partial.clear()
            instrument.submit(self, message, tag)
        elif len(self.partial) > instrument.longest:
            # enough to be refused for its length; what is still to come of it changes nothing
            self.overlong = bytes(self.partial[: instrument.longest])
            self.partial.clear()

    def _skip(self, data: bytes, *, end: bool, tag: Any) -> bytes:
        """Drop the rest of a message that is too long, hand over its beginning; return the bytes after it."""
        size = self.instrument.line_size(data)
        if not size and not end:
            return b""
        message, self.overlong = self.overlong + b"\n", b""
        self.instrument.submit(self, message, tag)
        return data[size:] if size else b""

    def start_anew(self) -> None:
        """Forget the messages under way."""
        self.backlog.clear()
        self.partial.clear()
        self.overlong = b""
        self.queued = False
        self.relieved()

    def cut(self) -> None:
        """Lose the connection."""

    def freeze(self) -> list[socket.socket]:
        """Stop serving the connection, but leave its sockets open, and return them."""
        return []

    def leave(self) -> None:
        """Be forgotten by the instrument."""
        self.closed = True
        self.backlog.clear()
        self.partial.clear()
        self.instrument.forget(self)


class PassingTime(Protocol):
    """Passing of bench time, for an instrument that does something by itself."""

    next_due_s: float
    """When the next of all instruments does something, inf for never."""

    working: list[ServedInstrument]
    """Those that work something out, a slice a turn."""


class ServedInstrument(EmbodiedDevice):
    """A device and its connections.

    Args:
        role: its role on the bench.
        device: the simulated instrument.
        clock: bench time.
    """

    def __init__(self, role: str, device: Device, clock: ServedClock) -> None:
        self.due_s = _NOTHING
        self.clients: set[Client] = set()
        self.holder: Client | None = None
        """The connection whose query is being answered, or whose answer it has not fetched."""
        self.waiting: deque[Client] = deque()
        self.lock: Client | None = None
        self.lock_waiters: list[Callable[[], None]] = []
        self.fault: Callable[[bytes, bool], tuple[bytes, bool, float]] | None = None
        """What goes wrong with answers: what is left of one, its end, and how late that is, s."""
        self.late: deque[tuple[float, Client, bytes, bool]] = deque()
        """Answers on their way, and the bench times at which they arrive."""
        self.passage: PassingTime | None = None
        self.lines: list[DelayingWire] = []
        """Serial lines whose characters take time."""
        self.watches_service = False
        self._requested = False
        self._passed = 0
        super().__init__(role, device, clock)

    def _embody(self, device: Device) -> None:
        super()._embody(device)
        if self.engine is not None:
            self.engine.hand_over = self._hand_over

    def replace(self, device: Device) -> None:
        """Replace the instrument by another unit: pending answers are dropped; connections and locks stay."""
        self.waiting.clear()
        self.late.clear()
        self.holder = None
        self._requested, self._passed = False, 0
        self._embody(device)
        for client in tuple(self.clients):
            client.start_anew()

    # --- messages -----------------------------------------------------------------------------------------

    def submit(self, client: Client, message: bytes, tag: Any = None) -> None:
        """Execute `message` now, or when its turn comes."""
        if client.interface is CONVERTER and message.strip().lower() == _CLEAR:
            rest = bytes(client.partial)  # the converter passes on what stands behind
            self.clear(client)
            client.partial += rest
            return
        asks = self.asks(message)
        if client.heard and self.holder is client:  # its answers come in order, whatever it asks meanwhile
            self.execute(client, message, tag, asks=asks)
            return
        if self._open() and not self.waiting and not client.blocked:
            self.execute(client, message, tag, asks=asks)
            return
        # Whether `message` is a trigger, which must reach a measurement that waits for one
        if self.engine is not None and message.strip().upper() == _TRIGGER:
            self.device.write(message, end=True)  # with the personality of whose measurement waits for it
            self.serve()
            return
        client.backlog.append((message, asks, tag))
        self.resume(client)

    def resume(self, client: Client) -> None:
        """Give `client` its turn if it has something to say."""
        if client.backlog and not client.queued and not client.blocked:
            client.queued = True
            self.waiting.append(client)
        if self.holder is client:
            self._drain()
            self.touched()
        self.turn()

    def execute(self, client: Client, message: bytes, tag: Any = None, *, asks: bool) -> None:
        """Hand `message` to the device, and the answer to `client` if it is there at once."""
        client.tag = tag
        worker = self.engine
        if worker is not None:
            worker.interface = client.interface
        whole = self._answer(message) if asks and client.pushes else None
        if whole and self.fault is None and not self.late and not self.lines:
            client.deliver(whole, end=True)
            return  # what is answered at once begins nothing
        if whole is None:
            self._write(message, end=True)
        if whole:
            self._hand_out(client, whole, end=True)
        elif not asks:
            self._passed += self.busy
        elif not client.pushes:
            self.holder = client
        elif self.speaks:
            self._say_unasked()  # nothing that it says is an answer
        else:
            data, end = self._read(WHOLE_RESPONSE)
            if data:
                self._hand_out(client, data, end=end)
            if not end or (self.busy if worker is None else worker.busy):
                self.holder = client
                self._drain()
        self.touched()

    def collect(self, client: Client, limit: int) -> tuple[bytes, bool]:
        """Fetch up to `limit` bytes of the response to `client`, which keeps it in the instrument."""
        if self.holder is not client and self.holder is not None:
            return b"", False
        if self.engine is not None:
            self.engine.interface = client.interface
        data, whole = self.device.read(limit)
        end = whole
        if data and (self.fault is not None or self.late):
            data, end = self._spoil(client, data, end=whole)
        if whole:
            self.release()
        else:
            self.touched()
        return data, end

    def release(self) -> None:
        """Release the instrument: the response has been fetched."""
        if not self.busy:
            self.holder = None
        self.touched()
        self.turn()

    def turn(self) -> None:
        """Execute messages that waited, one of each connection in turn."""
        while self.waiting and self._available():
            client = self.waiting.popleft()
            message, asks, tag = client.backlog.popleft()
            client.queued = bool(client.backlog) and not client.blocked
            if client.queued:
                self.waiting.append(client)
            elif not client.backlog:
                client.relieved()
            self.execute(client, message, tag, asks=asks)

    def serve(self) -> None:
        """Do everything due, deliver finished answers, let the next in."""
        self.device.wake_at()
        self._drain()
        while self.late and self.late[0][0] <= self.clock.now():
            _, client, data, end = self.late.popleft()
            if not client.closed:
                client.deliver(data, end=end)
                client.refill()
        if self.holder is not None and not self.holder.pushes:
            self.holder.refill()
        self.turn()
        for line in self.lines:
            line.go_on()
        self.touched()

    def _hand_over(self) -> None:
        """Have long work done between the others' turns."""
        if self.passage is not None and self not in self.passage.working:
            self.passage.working.append(self)

    def work(self) -> bool:
        """Work out a slice of the pending reply; return True if there is more."""
        if self.engine is None or not self.engine.working:
            return False
        self.engine.work()
        if self.engine.working:
            return True
        self.serve()
        return self.engine.working

    def clear(self, client: Client) -> None:
        """Device clear from `client`: end all operations, and drop all answers."""
        client.partial.clear()
        client.backlog.clear()
        self._lose_turn(client)
        client.relieved()
        if self.engine is not None:
            self.engine.interface = client.interface
        self.device.clear()
        self.late.clear()
        self.holder = None
        self._passed = 0
        self.turn()
        self.touched()

    def trigger(self, client: Client) -> None:
        """Group execute trigger from `client`, in any state."""
        if self.engine is not None and self.holder is None:
            self.engine.interface = client.interface
        self.device.trigger()
        self.serve()

    def status_byte(self) -> int:
        """Serial poll."""
        byte = self.device.status_byte()
        self._requested = False
        self.touched()
        return byte

    def forget(self, client: Client) -> None:
        """Do without `client`; the answer that it is owed goes nowhere."""
        self.clients.discard(client)
        self._lose_turn(client)
        if self.holder is client:
            nobody = Client(self, SOCKET)
            self.clients.discard(nobody)
            self.holder = nobody
            self._drain()
        if self.lock is client:
            self.unlock()
        self.turn()
        self.touched()

    def _lose_turn(self, client: Client) -> None:
        if client.queued:
            self.waiting.remove(client)
            client.queued = False

    def unlock(self) -> None:
        """Give the lock back and let its waiters try again."""
        self.lock = None
        waiters, self.lock_waiters = self.lock_waiters, []
        for retry in waiters:
            retry()
        for client in tuple(self.clients):
            self.resume(client)

    # --- time ---------------------------------------------------------------------------------------------

    @property
    def engaged(self) -> bool:
        """True if a message may have to wait for its turn."""
        return self.holder is not None or bool(self.waiting) or self._passed > 0

    @property
    def awaited(self) -> bool:
        """True if a client waits for the device to go on."""
        if self.waiting or self.late or any(line.awaited for line in self.lines):
            return True
        return self.holder is not None and self.holder.awaits

    @property
    def listened_to(self) -> bool:
        """True if a client may wait for its unasked messages."""
        return self.speaks and any(client.listens for client in self.clients)

    def touched(self) -> None:
        """Note when the device next does something by itself."""
        wake = self._wake_at()
        if self.late or self.lines:
            # `wake`, or when something that is on its way arrives if that comes first
            arrivals = [line.next_s for line in self.lines if line.next_s < _NOTHING]
            arrivals += [arrives_s for arrives_s, *_ in self.late][:1]
            if wake is not None and wake > self.clock.now():
                arrivals.append(wake)
            wake = min(arrivals, default=wake)
        if wake is None or wake <= self.clock.now():
            self.due_s = _NOTHING
        else:
            self.due_s = wake
            if self.passage is not None and wake < self.passage.next_due_s:
                self.passage.next_due_s = wake
        if self.watches_service:
            requested = self.engine is not None and self.engine.requests_service()
            if requested and not self._requested:
                for client in tuple(self.clients):
                    client.service_requested()
            self._requested = requested

    # --- whose turn it is ---------------------------------------------------------------------------------

    def _open(self) -> bool:
        """True if a message can be handed over now: nobody is owed an answer."""
        if self.holder is not None:
            return False
        if self._passed and not self.busy:
            self._passed = 0
        return self._passed < _PASSED_WHILE_BUSY

    def _available(self) -> bool:
        """True if the next in the queue can have its turn; an answer that lies unread is put aside for its owner."""
        holder = self.holder
        if holder is None or holder.pushes:
            return self._open()
        if self.waiting[0] is holder:
            return True  # its own business: an unread answer is lost to the next message
        if self.busy:
            return False
        if self.engine is None or self.engine.status_now() & 16:
            data, end = self.device.read(WHOLE_RESPONSE)
            if data:
                self._hand_out(holder, data, end=end)
        self.holder = None
        return self._open()

    def _drain(self) -> None:
        """Hand a pushing holder the ready bytes; let go of it when there is nothing more to come."""
        holder = self.holder
        if holder is None and self.engine is None:
            self._say_unasked()
        if holder is None or not holder.pushes:
            return
        while not holder.blocked:  # else what it does not take would pile up
            data, end = self.device.read(WHOLE_RESPONSE)
            if not data:
                break
            self._hand_out(holder, data, end=end)
        if not self.busy:
            self.holder = None

    def _say_unasked(self) -> None:
        """Hand unasked messages to every listener, as on one line; to the others they are lost."""
        while True:
            data, end = self._read(WHOLE_RESPONSE)
            if not data:
                return
            for client in tuple(self.clients):
                if client.listens:
                    self._hand_out(client, data, end=end)

    def _hand_out(self, client: Client, data: bytes, *, end: bool) -> None:
        if self.fault is not None or self.late:
            data, end = self._spoil(client, data, end=end)
        if data:
            client.deliver(data, end=end)

    def _spoil(self, client: Client, data: bytes, *, end: bool) -> tuple[bytes, bool]:
        """Return an answer that arrives now after its faults; one that is late is kept, and none overtakes it."""
        late_s = 0.0
        if self.fault is not None:
            data, end, late_s = self.fault(data, end)
        if not data or not (late_s or self.late):
            return data, end
        arrives_s = max(self.clock.now() + late_s, self.late[-1][0] if self.late else 0.0)
        self.late.append((arrives_s, client, data, end))
        return b"", False
