"""The client's end of the control port: requests, and a clock that is a served bench's.

A program that waits on :class:`RemoteClock` instead of the wall clock sees the bench time of the server, and its waits
take no wall time: a run over real wires then gives the results of the same run in one process.
"""

from __future__ import annotations

import json
import socket
import threading
from itertools import count
from types import TracebackType
from typing import Any, Self

_CHUNK = 1 << 16


class ControlError(Exception):
    """The server refused a request, or has gone; the words are its."""


class Control:
    """A connection to a control port; threads may share it.

    Requests are numbered. A request that was broken off (a signal, a time-out) leaves its reply behind, which is never
    taken for the reply to the next.
    """

    def __init__(self, port: int, host: str = "127.0.0.1", timeout_s: float | None = 60.0) -> None:
        try:
            self._socket = socket.create_connection((host, port), timeout=timeout_s)
        except OSError as error:
            raise ControlError(f"no bench is served with its control port at {host}:{port} ({error})") from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._numbers = count(1)
        self._received = b""
        self._lock = threading.Lock()

    def request(self, do: str, **arguments: Any) -> Any:
        """Send a request; return its result.

        Raises:
            ControlError: it was refused, or the connection has ended.
        """
        with self._lock:
            number = next(self._numbers)
            try:
                self._socket.sendall(json.dumps({"do": do, "id": number, **arguments}).encode() + b"\n")
                while (reply := json.loads(self._line())).get("id") != number:
                    if "id" not in reply and reply.get("ok") is False:  # it concerns the connection, not a request
                        raise ControlError(str(reply.get("error")))
            except OSError as error:
                raise ControlError(f"the control port does not answer ({error})") from error
            except (ValueError, RecursionError, AttributeError) as error:
                raise ControlError("the port answers, but not as the control port of a served bench") from error
        if not reply["ok"]:
            raise ControlError(reply["error"])
        return reply["result"]

    def _line(self) -> bytes:
        while (end := self._received.find(b"\n")) < 0:
            data = self._socket.recv(_CHUNK)
            if not data:
                raise ControlError("the server closed the connection")
            self._received += data
        line, self._received = self._received[:end], self._received[end + 1 :]
        return line

    def close(self) -> None:
        """End the connection."""
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class RemoteClock:
    """The bench time of a served bench, led by this program for as long as it is open: a `simrack.clock.Clock`.

    Args:
        control: the connection that leads.
        awaits: whether the program says so when it waits for what an instrument says unasked
            (:class:`~simrack.serve.lockstep_port.LockstepPort`); else the server guesses.
    """

    def __init__(self, control: Control, *, awaits: bool = False) -> None:
        self._control = control
        control.request("lead", awaits=awaits)

    def now(self) -> float:
        """Return the bench time, s."""
        return float(self._control.request("now"))

    def sleep_until(self, instant_s: float) -> None:
        """Let bench time jump to `instant_s`, with everything that happens in between."""
        if instant_s > 0.0:  # "since ever" is an instant too, which JSON cannot say
            self._control.request("sleep_until", instant_s=instant_s)
