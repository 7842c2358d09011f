"""Simulated serial ports in this process: ``serial.serial_for_url("sim://handle")`` opens a registered `Device`.

Reading waits on the bench clock, so a time-out of a simulated port takes simulated time. Importing this module puts
the handler into pyserial's list.
"""

from __future__ import annotations

from typing import Any, Protocol, Self, runtime_checkable

import serial
from msgspec import Struct

from simrack.clock import Clock
from simrack.device import Device
from simrack.wires.serial_line import CharacterFrame, FarEnd, LineEnd, Parity

_SCHEME = "sim://"
_HANDLERS = "simrack.wires.serial_handlers"


class Port(Protocol):
    """The simulated end behind the name of a port."""

    @property
    def device(self) -> FarEnd:
        """The other end."""

    @property
    def clock(self) -> Clock:
        """The clock that reading waits on."""

    def connect(self) -> Port:
        """Return the port once it is open; OSError if it cannot be."""

    def disconnect(self) -> None:
        """Give the connection back."""

    def wait(self, deadline_s: float | None) -> bool:
        """Let time pass until there may be more to read; False once the deadline has passed."""


@runtime_checkable
class _Settable(Protocol):
    """A far end that speed and framing mean something to."""

    def configure(self, frame: CharacterFrame, *, handshake: bool, xonxoff: bool = ...) -> None: ...


class _Port(Struct, frozen=True):
    """A device in this process."""

    device: Device
    clock: Clock

    def connect(self) -> Self:
        return self

    def disconnect(self) -> None:
        """Do nothing: unsent bytes of the device stay with it."""

    def wait(self, deadline_s: float | None) -> bool:
        wake_s = self.device.wake_at()
        if deadline_s is None:
            if wake_s is None:
                raise serial.SerialException("no data, and this read without time-out would never end")
            self.clock.sleep_until(wake_s)
            return True
        now_s = self.clock.now()
        if now_s >= deadline_s:
            return False
        # an instant that has passed has brought nothing: to wait for it would hold bench time where it is
        self.clock.sleep_until(deadline_s if wake_s is None or wake_s <= now_s else min(wake_s, deadline_s))
        return True


_PARITIES: dict[str, Parity] = {serial.PARITY_EVEN: "even", serial.PARITY_ODD: "odd"}

# pyserial opens by name alone, so what a name means must live beside it
_PORTS: dict[str, Port] = {}

if _HANDLERS not in serial.protocol_handler_packages:
    serial.protocol_handler_packages.append(_HANDLERS)


def register(handle: str, device: Device, clock: Clock) -> None:
    """Make `device` reachable as ``sim://handle``; a handle in use is replaced."""
    register_port(handle, _Port(device, clock))


def register_port(handle: str, port: Port) -> None:
    """Make `port` reachable as ``sim://handle``; a handle in use is replaced."""
    _PORTS[handle.strip("/").lower()] = port


def unregister(handle: str) -> None:
    """Forget `handle`; ports that are open stay open."""
    _PORTS.pop(handle.strip("/").lower(), None)


def _lookup(url: str) -> Port:
    handle = url[len(_SCHEME) :].strip("/") if url.lower().startswith(_SCHEME) else url
    port = _PORTS.get(handle.lower())  # pyserial lowers the URL it hands over in some versions
    if port is None:
        raise serial.SerialException(f"could not open port {url!r}: no simulated port of that name")
    return port


class SimulatedSerial(serial.SerialBase):
    """A serial port whose other end is a simulated device.

    Where that is a :class:`~simrack.wires.serial_line.LineEnd`, speed, framing, `dsrdtr`, `xonxoff`, DTR, DSR and
    breaks are what they are on a real line; elsewhere they are accepted and have no effect.
    """

    _port_behind: Port
    _received: bytearray
    _settable: _Settable | None

    def open(self) -> None:
        """Connect to the device named by the URL; raises SerialException if there is none."""
        if self.port is None:
            raise serial.SerialException("Port must be configured before it can be used.")
        if self.is_open:
            raise serial.SerialException("Port is already open.")
        self._port_behind = _lookup(self.port).connect()
        self._received = bytearray()
        device = self._port_behind.device
        self._settable = device if isinstance(device, _Settable) else None
        self.is_open = True
        self._reconfigure_port()
        self._update_dtr_state()

    def close(self) -> None:
        """Close the port."""
        if self.is_open:
            self.is_open = False
            self._port_behind.disconnect()

    def read(self, size: int = 1, /) -> bytes:
        """Return up to `size` bytes, waiting at most the time-out in bench time."""
        port, timeout_s = self._port_behind, self.timeout
        self._pull()
        deadline = None if timeout_s is None else port.clock.now() + timeout_s
        while len(self._received) < size and port.wait(deadline):
            self._pull()
        return self._take(size)

    def write(self, data: Any, /) -> int:
        """Hand all of `data` to the device; a simulated line never blocks."""
        self._require_open()
        raw = bytes(data)
        self._port_behind.device.write(raw)
        return len(raw)

    @property
    def in_waiting(self) -> int:
        """Return the number of bytes that have arrived by now."""
        self._pull()
        return len(self._received)

    @property
    def out_waiting(self) -> int:
        """Return the number of bytes that have not left yet."""
        self._require_open()
        return 0 if self._line is None else self._line.out_waiting

    def flush(self) -> None:
        """Wait in bench time until all bytes have left; SerialException when a handshake holds them for good."""
        clock, device = self._port_behind.clock, self._port_behind.device
        while self.out_waiting:
            wake_s = device.wake_at()
            if wake_s is None:
                raise serial.SerialException("the simulated device takes no bytes: its DTR is false")
            clock.sleep_until(wake_s)

    def reset_input_buffer(self) -> None:
        """Throw away the bytes that have arrived by now."""
        self._pull()
        self._received.clear()

    def reset_output_buffer(self) -> None:
        """Throw away the bytes that have not left yet."""
        self._require_open()
        if self._line is not None:
            self._line.drop_output()

    @property
    def cts(self) -> bool:
        """Return True: the other end is always ready."""
        return True

    @property
    def dsr(self) -> bool:
        """Return the DTR of the other end, True where it has none."""
        self._require_open()
        return True if self._line is None else self._line.dsr

    @property
    def ri(self) -> bool:
        """Return False."""
        return False

    @property
    def cd(self) -> bool:
        """Return True: there is a carrier while the port exists."""
        return True

    @property
    def _line(self) -> LineEnd | None:
        """The line that knows the time and the pins, if there is one."""
        device = self._port_behind.device
        return device if isinstance(device, LineEnd) else None

    def _pull(self) -> None:
        if not self.is_open:
            self._require_open()
        while data := self._port_behind.device.read(65536)[0]:
            self._received += data

    def _take(self, size: int) -> bytes:
        taken = bytes(self._received[:size])
        del self._received[:size]
        return taken

    def _require_open(self) -> None:
        if not self.is_open:
            raise serial.PortNotOpenError

    def _reconfigure_port(self) -> None:
        """Take speed, framing and handshake; pyserial asks for it at each change of a time-out too."""
        device = self._settable
        if device is not None:
            parity = _PARITIES.get(self.parity, "none")
            frame = CharacterFrame(float(self.baudrate), self.bytesize, parity, float(self.stopbits))
            device.configure(frame, handshake=bool(self.dsrdtr), xonxoff=bool(self.xonxoff))

    def _update_rts_state(self) -> None:
        """Accept RTS."""

    def _update_dtr_state(self) -> None:
        """Take DTR."""
        if self._line is not None:
            self._line.dtr = self.dtr

    def _update_break_state(self) -> None:
        """Take a break as it begins."""
        if self._line is not None and self.break_condition:
            self._line.send_break()
