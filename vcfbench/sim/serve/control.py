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
lead                                                                   bench time; until the connection ends,
                                                                       time passes only as far as it says
sleep_until             instant_s (of bench time)                      bench time
fault                   instrument, kind; the other fields as of       bench time
                        `vcfbench.sim.faults.Fault`, at_s is now
clear_faults            instrument (optional)                          bench time
reset                   seed (optional)                                bench time: 0; the bench as first served
stop                                                                   the server ends
======================  =============================================  ======================================
"""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any, Protocol

from vcfbench.sim.faults import Fault
from vcfbench.sim.serve.clock import MAX_SPEED
from vcfbench.sim.serve.wire import Connection, Listener

if TYPE_CHECKING:
    import socket
    from collections.abc import Callable

    from vcfbench.sim.serve.clock import ServedClock
    from vcfbench.sim.serve.instrument import Passage
    from vcfbench.sim.serve.loop import Loop

__all__ = ["ControlServer", "Controlled", "Refused"]

_LONGEST_REQUEST = 1 << 16


class Refused(Exception):
    """A request that cannot be fulfilled; the words go back to who asked."""


class Controlled(Protocol):
    """What can be controlled: a served bench."""

    loop: Loop
    clock: ServedClock
    passage: Passage

    def status(self) -> dict[str, Any]:
        """Return bench time, how it passes, and who is connected to what."""
        ...

    def listed(self, match: str = ...) -> list[dict[str, Any]]:
        """Return what can be seen and changed whose name contains `match`."""
        ...

    def get(self, name: str) -> Any:
        """Return the value of a quantity."""
        ...

    def set(self, name: str, value: Any) -> Any:
        """Change a quantity; return its value."""
        ...

    def add_fault(self, fault: Fault) -> None:
        """Let something go wrong."""
        ...

    def end_faults(self, role: str | None = ...) -> None:
        """End what goes wrong."""
        ...

    def reset(self, seed: int | None = ...) -> None:
        """Put the bench back to what it was first."""
        ...

    def stop(self) -> None:
        """End the server."""
        ...


class ControlServer:
    """Listens for control connections, on the loopback interface only."""

    def __init__(self, server: Controlled, address: tuple[str, int]) -> None:
        self.server = server
        self.leader: _Control | None = None
        self.connections: set[_Control] = set()
        self._listener = Listener(server.loop, address, self._accept)
        self.port = self._listener.port

    def close(self) -> None:
        """Stop listening and end the connections."""
        self._listener.close()
        for connection in tuple(self.connections):
            connection.close()

    def _accept(self, connection: socket.socket) -> None:
        self.connections.add(_Control(self, connection))


class _Control(Connection):
    """One control connection."""

    def __init__(self, control: ControlServer, connection: socket.socket) -> None:
        self._control = control
        self._server = control.server
        self._input = bytearray()
        self._commands: dict[str, Callable[..., Any]] = {
            "status": self._server.status,
            "list": self._server.listed,
            "get": self._server.get,
            "set": self._server.set,
            "speed": self._speed,
            "pause": lambda: self._pause(paused=True),
            "resume": lambda: self._pause(paused=False),
            "now": self._server.clock.now,
            "advance": self._advance,
            "lead": self._lead,
            "sleep_until": self._sleep_until,
            "fault": self._fault,
            "clear_faults": self._clear_faults,
            "reset": self._reset,
            "stop": self._server.stop,
        }
        super().__init__(self._server.loop, connection)

    def gone(self) -> None:
        """End the lead, if it was this one's."""
        if self._control.leader is self:
            self._control.leader = None
            self._server.clock.led = False
        self._control.connections.discard(self)

    def received(self, data: bytes) -> None:
        """Answer the requests that are complete."""
        self._input += data
        if len(self._input) > _LONGEST_REQUEST:
            self.close()
        while (end := self._input.find(b"\n")) >= 0:
            line = bytes(self._input[:end])
            del self._input[: end + 1]
            # what was sent to an instrument before this request comes before it
            self.loop.call_last(lambda line=line: self._answer(line))  # type: ignore[misc]

    def _answer(self, line: bytes) -> None:
        if self.closed:
            return
        reply: dict[str, Any] = {}
        try:
            request = json.loads(line)
            if isinstance(request, dict) and "id" in request:
                reply["id"] = request.pop("id")
            reply |= {"ok": True, "result": self._obey(request)}
        except Exception as error:  # noqa: BLE001  (whatever a quantity is told, the others are still served)
            reply |= {"ok": False, "error": str(error) or type(error).__name__}
        self.send(json.dumps(reply).encode() + b"\n")

    def _obey(self, request: Any) -> Any:
        if not isinstance(request, dict) or request.get("do") not in self._commands:
            raise Refused(f'a request is an object whose "do" is one of {", ".join(self._commands)}')
        command = self._commands[request.pop("do")]
        return command(**request)

    # --- time ---------------------------------------------------------------------------------------------

    def _speed(self, value: Any) -> Any:
        self._server.clock.start()
        self._server.clock.speed = MAX_SPEED if value == "max" else float(value)
        return "max" if math.isinf(self._server.clock.speed) else self._server.clock.speed

    def _pause(self, *, paused: bool) -> float:
        self._server.clock.start()
        self._server.clock.paused = paused
        return self._server.clock.now()

    def _advance(self, seconds: float) -> float:
        return self._sleep_until(self._server.clock.now() + _positive(seconds))

    def _lead(self) -> float:
        if self._control.leader not in (None, self):
            raise Refused("another connection leads the clock")
        self._control.leader = self
        self._server.clock.start()
        self._server.clock.led = True
        return self._server.clock.now()

    def _sleep_until(self, instant_s: float) -> float:
        if self._control.leader not in (None, self):
            raise Refused("another connection leads the clock")
        self._server.clock.start()
        self._server.passage.jump_to(float(instant_s))
        return self._server.clock.now()

    # --- faults -------------------------------------------------------------------------------------------

    def _fault(self, instrument: str, kind: Any, **when: Any) -> float:
        now = self._server.clock.now()
        self._server.add_fault(Fault(instrument, kind, **{"at_s": now, **when}))
        return now

    def _clear_faults(self, instrument: str | None = None) -> float:
        self._server.end_faults(instrument)
        return self._server.clock.now()

    def _reset(self, seed: int | None = None) -> float:
        if self._control.leader not in (None, self):
            raise Refused("another connection leads the clock")
        if seed is not None and (type(seed) is not int or seed < 0):
            raise Refused(f"a seed is a whole number from 0, not {seed!r}")
        self._server.reset(seed)
        return self._server.clock.now()


def _positive(seconds: float) -> float:
    if not 0 <= seconds < math.inf:
        raise Refused(f"time goes forwards, not by {seconds} s")
    return float(seconds)
