"""The control port: reads and changes the World while it is served, from outside the instruments' wires.

A request is one line of JSON, an object with the command under `do` and its arguments beside it; the reply is one line,
``{"ok": true, "result": ...}`` or ``{"ok": false, "error": "..."}``. Requests of a connection are answered in order;
an ``id`` beside the command comes back with the reply.

======================  =============================================  ======================================
do                      arguments                                      result
======================  =============================================  ======================================
status                                                                 bench time, speed, instruments
list                    match (part of a name, optional)               name, unit, meaning, writable
get                     name                                           value
set                     name, value                                    value
speed                   value (a number, or "max")                     speed
pause, resume                                                          bench time
now                                                                    bench time
advance                 seconds (of bench time)                        bench time
lead                    awaits (optional: true of a leader that says   bench time; until the connection ends,
                        by `await` when it waits for unasked words)    time passes only as far as it says
sleep_until             instant_s (of bench time)                      bench time
hear                    instrument, address (a client's TCP port, or   bytes taken from that wire and said to it by
                        the path of a pseudo-terminal)                 now; from now on time waits for `await` there
await                   instrument, address, taken, said (bytes that   bytes said; as soon as more are, or at
                        were sent there and have come by now),         `until_s`, which is now by default
                        until_s (of bench time)
fault                   instrument, kind; the other fields as of       bench time
                        `simrack.faults.Fault`, at_s is now
clear_faults            instrument (optional)                          bench time
reset                   seed (optional)                                bench time: 0; the bench as first served
stop                                                                   the server ends
======================  =============================================  ======================================
"""

from __future__ import annotations

import json
import math
import socket
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol

from simrack.faults import fault_from
from simrack.handlers import Handlers
from simrack.serve.clock import MAX_SPEED, ServedClock
from simrack.serve.instrument import Client, ServedInstrument
from simrack.serve.loop import Loop, Timer
from simrack.serve.passage import AttendedPassage
from simrack.serve.peer import is_welcome
from simrack.serve.served_faults import ServedFaults
from simrack.serve.wire import Connection, Listener

_LONGEST_REQUEST = 1 << 16
_MOST_REQUESTS = 1 << 16
"""That wait on one connection: who sends more does not wait for answers, and gets none."""
_MOST_STEPS = 1000
"""Things that happen by themselves between two turns of the loop while time jumps: the others are served meanwhile."""
_LONGEST_S = 1e9
_UNWELCOME = b'{"ok": false, "error": "this bench is served by another user, who alone may control it"}\n'
_AT_ONCE = 100
"""Requests of a connection that are answered before the others have their turn."""
_OBJECT = 'a request is an object whose "do" is one of'
_LOOK_AGAIN_S = 0.001
_PATIENCE_S = 5.0
"""Wall time for what was sent on another wire, or for a connection, to arrive."""


class Refused(Exception):
    """A request that cannot be fulfilled; its words are the reply."""


class _NotYet(Exception):
    """A request that must wait, for so many wall seconds before it is looked at again."""

    def __init__(self, seconds: float, words: str) -> None:
        super().__init__(words)
        self.seconds = seconds


class Controlled(Protocol):
    """A served bench as the control port sees it."""

    instruments: dict[str, ServedInstrument]
    faults: ServedFaults
    loop: Loop
    clock: ServedClock
    passage: AttendedPassage

    def status(self) -> dict[str, Any]:
        """Return bench time, its speed, and the connections of each instrument."""

    def listed(self, match: str = ...) -> list[dict[str, Any]]:
        """Return the adjustments whose name contains `match`."""

    def get(self, name: str) -> Any:
        """Return the value of a quantity."""

    def set(self, name: str, value: Any) -> Any:
        """Change a quantity; return its value."""

    def reset(self, seed: int | None = ...) -> None:
        """Put the bench back to its first state."""

    def begin_anew(self) -> None:
        """Reset the bench if no client has used it."""

    def stop(self) -> None:
        """End the server."""


class ControlServer:
    """Listens for control connections, on the loopback interface only."""

    def __init__(self, server: Controlled, address: tuple[str, int]) -> None:
        self.server = server
        self.leader: _Control | None = None
        self.connections: set[_Control] = set()
        self._listener = Listener(
            server.loop, address, lambda connection: self.connections.add(_Control(self, connection))
        )
        self.port = self._listener.port

    def close(self) -> None:
        """Stop listening and end the connections."""
        self._listener.close()
        for connection in tuple(self.connections):
            connection.close()


class _Control(Connection):
    """One control connection."""

    _COMMANDS = Handlers()

    def __init__(self, control: ControlServer, connection: socket.socket) -> None:
        self._control = control
        self._server = control.server
        self._input = bytearray()
        self._requests: deque[bytes] = deque()
        self._goal_s: float | None = None
        self._waited_s = 0.0
        self._again: Timer | None = None
        self._heard: set[Client] = set()
        self._welcome = False
        self._commands: dict[str, Callable[..., Any]] = {
            "status": self._server.status,
            "list": self._server.listed,
            "get": self._server.get,
            "set": self._server.set,
            **self._COMMANDS.bound(self),
            "pause": lambda: self._pause(paused=True),
            "resume": lambda: self._pause(paused=False),
            "now": self._server.clock.now,
            "stop": self._server.stop,
        }
        super().__init__(self._server.loop, connection)

    def gone(self) -> None:
        """End the lead, if it was this one's."""
        if self._control.leader is self:
            self._control.leader = None
            self._server.clock.lockstep = self._server.passage.tells = False
        for client in self._heard:
            client.heard = False
        if self._again is not None:
            self._again.cancel()
        self._control.connections.discard(self)

    def received(self, data: bytes) -> None:
        """Answer the complete requests of a permitted client; a mere connection costs nothing."""
        if not self._welcome and not self._admitted():
            return
        idle = not self._requests
        *lines, rest = (self._input + data).split(b"\n")
        self._input = rest
        self._requests += map(bytes, lines)
        if len(rest) > _LONGEST_REQUEST or len(self._requests) > _MOST_REQUESTS:
            self.close()
        elif idle and self._requests:
            self._soon()

    def _admitted(self) -> bool:
        self._welcome = is_welcome(self._socket)
        if not self._welcome:
            self.send(_UNWELCOME)
            self.close()
        return self._welcome

    def relieved(self) -> None:
        """Go on once the client has taken its replies."""
        self._soon()

    def _soon(self) -> None:
        """Go on when the earlier bytes to instruments have been dealt with: they come first."""
        self.loop.call_last(self._work)

    def _work(self) -> None:
        for _ in range(_AT_ONCE):
            if self.closed or self.blocked or not self._requests:
                return
            try:
                reply = self._reply(self._requests[0])
            except _NotYet as wait:
                self._waited_s += wait.seconds
                self._again = self.loop.call_later(wait.seconds, self._soon) if wait.seconds else None
                if self._again is None:
                    self._soon()
                return
            self._requests.popleft()
            self._waited_s, self._goal_s = 0.0, None
            self.send(reply + b"\n")
        self._soon()

    def _reply(self, line: bytes) -> bytes:
        reply: dict[str, Any] = {}
        try:
            request = _parsed(line)
            if "id" in request:
                reply["id"] = _plain(request.pop("id"))
            command = self._commands.get(str(request.pop("do", None)))
            if command is None:
                raise Refused(f"{_OBJECT} {', '.join(self._commands)}")  # noqa: TRY301
            for name, value in request.items():
                if isinstance(value, float) and not math.isfinite(value):
                    raise Refused(f"{name} cannot be {value}")  # noqa: TRY301
            return json.dumps({**reply, "ok": True, "result": command(**request)}).encode()
        except _NotYet:
            raise
        except Exception as error:  # noqa: BLE001  (whatever a quantity is told, the others are still served)
            return json.dumps({**reply, "ok": False, "error": str(error) or type(error).__name__}).encode()

    # --- time ---------------------------------------------------------------------------------------------

    @_COMMANDS.of("speed")
    def _speed(self, value: Any) -> Any:
        speed = MAX_SPEED if value == "max" else _number(value, "speed")
        self._server.clock.start()
        self._server.clock.speed = speed
        return "max" if math.isinf(self._server.clock.speed) else self._server.clock.speed

    def _pause(self, *, paused: bool) -> float:
        self._server.clock.start()
        self._server.clock.paused = paused
        return self._server.clock.now()

    @_COMMANDS.of("advance")
    def _advance(self, seconds: float) -> float:
        if self._goal_s is None:
            self._goal_s = self._server.clock.now() + _positive(seconds)
        return self._sleep_until(self._goal_s)

    @_COMMANDS.of("lead")
    def _lead(self, awaits: Any = False) -> float:  # noqa: FBT002  (a word of a request)
        self._require_lead()
        self._control.leader = self
        self._server.passage.tells = awaits is True
        self._server.begin_anew()
        self._server.clock.start()
        self._server.clock.lockstep = True
        return self._server.clock.now()

    def _require_lead(self) -> None:
        if self._control.leader not in (None, self):
            raise Refused("another connection leads the clock")

    @_COMMANDS.of("sleep_until")
    def _sleep_until(self, instant_s: float) -> float:
        self._require_lead()
        self._server.clock.start()
        self._pass_until(lambda: False, instant_s)
        return self._server.clock.now()

    def _pass_until(self, done: Callable[[], bool], instant_s: float) -> None:
        if not -_LONGEST_S <= _number(instant_s, "an instant") <= _LONGEST_S:
            raise Refused(f"expected an instant that bench time can reach, got {instant_s:g} s")
        if not self._server.passage.pass_until(done, float(instant_s), _MOST_STEPS):
            raise _NotYet(0.0, "time passes")

    # --- wires on which the leader waits ------------------------------------------------------------------

    @_COMMANDS.of("hear")
    def _hear(self, instrument: str, address: Any) -> dict[str, int]:
        self._require_lead()
        client = self._wire(instrument, address)
        self._heard.add(client)
        client.heard = True
        return {"taken": client.taken, "said": client.said}

    @_COMMANDS.of("await")
    def _await(self, instrument: str, address: Any, taken: int, said: int, until_s: float | None = None) -> int:
        """Let time pass until more than `said` bytes were sent to a wire; the bytes from there come first."""
        self._require_lead()
        client = self._wire(instrument, address)
        if client.taken < taken and not client.closed:
            raise self._still_to_come(f"of {taken} bytes {client.taken} have come from {address}")
        if until_s is not None:
            self._pass_until(lambda: client.said > said or client.lost, until_s)
        if client.lost and client.said <= said:
            raise Refused(f"the connection from {address} has ended")
        return client.said

    def _wire(self, instrument: str, address: Any) -> Client:
        if instrument not in self._server.instruments:
            raise Refused(f"the bench has no {instrument!r}, only {', '.join(self._server.instruments)}")
        if not isinstance(address, (int, str)):
            raise Refused(f"an address is the number of a port or the path of a terminal, not {address!r}")
        known = (*self._heard, *self._server.instruments[instrument].clients)
        found = [client for client in known if client.address == address and client.instrument.role == instrument]
        if not found:
            raise self._still_to_come(f"{instrument} has no connection from {address!r}")
        return found[0]

    def _still_to_come(self, words: str) -> Exception:
        return _NotYet(_LOOK_AGAIN_S, words) if self._waited_s < _PATIENCE_S else Refused(words)

    # --- faults -------------------------------------------------------------------------------------------

    @_COMMANDS.of("fault")
    def _fault(self, instrument: str, kind: Any, **when: Any) -> float:
        self._server.clock.start()
        now = self._server.clock.now()
        self._server.faults.add(fault_from({"instrument": instrument, "kind": kind, "at_s": now, **when}))
        return now

    @_COMMANDS.of("clear_faults")
    def _clear_faults(self, instrument: str | None = None) -> float:
        self._server.faults.end(instrument)
        return self._server.clock.now()

    @_COMMANDS.of("reset")
    def _reset(self, seed: int | None = None) -> float:
        self._require_lead()
        if seed is not None and (type(seed) is not int or not 0 <= seed < 1 << 63):
            raise Refused(f"a seed is a whole number from 0 to {(1 << 63) - 1}, not {seed!r}")
        self._server.reset(seed)
        return self._server.clock.now()


def _parsed(line: bytes) -> dict[str, Any]:
    request = json.loads(line)
    if not isinstance(request, dict):
        raise Refused(_OBJECT)
    return request


def _plain(number: Any) -> Any:
    """Return the identity of a request, if it is as simple as that."""
    if isinstance(number, (str, int)):
        return number
    raise Refused("an id is a whole number or a string")


def _number(value: Any, name: str) -> float:
    """Return a number of a request; true, false and texts are none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise Refused(f"{name} is a number, not {value!r}")
    return float(value)


def _positive(seconds: Any) -> float:
    if not 0 <= _number(seconds, "seconds") < math.inf:
        raise Refused(f"time goes forwards, not by {seconds} s")
    return float(seconds)
