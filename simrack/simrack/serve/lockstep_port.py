"""The client's end of a rate table's wire while this program leads the served bench's clock: ``sim://RESOURCE``.

Nothing on such a wire shows that its reader waits, so the server is told, and told how many bytes have been sent: what
is on its way on one socket or pseudo-terminal may arrive after what was sent on another later. So a run waits for the
same instants, and finds the same bytes there, as a run in one process.
"""

from __future__ import annotations

import socket
from typing import Any

import serial

from simrack.clock import Clock
from simrack.serve.remote import Control, ControlError
from simrack.wires.serial_line import CharacterFrame

_ARRIVAL_S = 10.0
"""Wall time for what has been sent already."""
_DAY_S = 86400.0


class LockstepPort:
    """A wire to an instrument that says things unasked.

    Args:
        control: the connection that leads the clock.
        clock: the clock that it leads.
        role: the instrument at the other end.
        resource: what pyserial opens: ``socket://host:port``, or the path of a pseudo-terminal.
    """

    def __init__(self, control: Control, clock: Clock, role: str, resource: str) -> None:
        self._control = control
        self.clock = clock
        self._resource = resource
        self._wire: Any = None
        self._wanted = {"instrument": role, "address": None}
        self._taken = self._said = 0

    @property
    def device(self) -> LockstepPort:
        """The other end, which this one writes to and reads from."""
        return self

    def connect(self) -> LockstepPort:
        """Open the wire; raises SerialException."""
        self._wire = _opened(self._resource)
        self._wanted["address"] = _address(self._wire, self._resource)
        heard = self._request("hear", **self._wanted)
        self._taken, self._said = heard["taken"], heard["said"]
        return self

    def disconnect(self) -> None:
        """Close the wire."""
        self._wire.close()

    def configure(self, frame: CharacterFrame, *, handshake: bool, xonxoff: bool = False) -> None:
        """Set the speed and framing of the wire; a handshake is not needed where the leader waits for each byte."""
        del handshake, xonxoff
        self._wire.baudrate, self._wire.bytesize = int(frame.baud), frame.data_bits
        self._wire.parity, self._wire.stopbits = frame.parity[0].upper(), frame.stop_bits

    def write(self, data: bytes) -> None:
        """Send all of `data`."""
        self._wire.write(data)
        self._taken += len(data)
        self._await()  # time goes no further before the instrument has it

    def read(self, limit: int) -> tuple[bytes, bool]:
        """Return the bytes that have been sent here by now."""
        waiting = self._await() - self._said
        data = self._wire.read(min(waiting, limit)) if waiting else b""
        if len(data) < min(waiting, limit):
            raise serial.SerialException(f"{waiting} bytes were sent here, {len(data)} came")
        self._said += len(data)
        return data, False

    def wake_at(self) -> None:
        """Return None: only the server knows."""

    def wait(self, deadline_s: float | None) -> bool:
        """Let time pass until something is said here; False once the deadline has passed."""
        now_s = self.clock.now()
        if deadline_s is not None and now_s >= deadline_s:
            return False
        self._await(until_s=now_s + _DAY_S if deadline_s is None else deadline_s)
        return True

    def _await(self, **until: float) -> int:
        return int(self._request("await", **self._wanted, taken=self._taken, said=self._said, **until))

    def _request(self, do: str, **arguments: Any) -> Any:
        try:
            return self._control.request(do, **arguments)
        except ControlError as error:
            raise serial.SerialException(str(error)) from error


def _opened(resource: str) -> Any:
    wire = serial.serial_for_url(resource, do_not_open=True, timeout=_ARRIVAL_S, write_timeout=_ARRIVAL_S)
    if isinstance(wire, serial.Serial):
        wire.exclusive = True  # one owner a connection; only real ports know how
    wire.open()
    return wire


def _address(wire: Any, resource: str) -> Any:
    """Return the server's name of the wire; a socket is told to send at once."""
    connection = getattr(wire, "_socket", None)  # pyserial shows it in no other way
    if connection is None:
        return resource
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection.getsockname()[1]
