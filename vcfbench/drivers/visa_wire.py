"""Wires that PyVISA opens: any resource string, any VISA library.

PyVISA-py's raw socket is driven directly: its own reading spins on a peer's EOF until the time-out, its writing
to a peer that does not read never ends, and opening a closed port succeeds (seen with 0.8.1). Every other library
and interface goes through viWrite and viRead.
"""

import os
import socket
from contextlib import suppress
from typing import Any

import pyvisa
from pyvisa.constants import (
    BufferOperation,
    ControlFlow,
    InterfaceType,
    Parity,
    ResourceAttribute,
    StatusCode,
    StopBits,
)
from pyvisa.errors import VisaIOError
from pyvisa.resources import MessageBasedResource

from vcfbench.clock import Deadline
from vcfbench.drivers.wire import Interface, SerialLine, Wire, left_s
from vcfbench.errors import BenchError, ConnectFailed, DeadlineExceeded, LinkLost

_CHUNK = 65_536
_BIG_CHUNK = 1 << 20
"""Bytes that VISA is asked for after a full chunk: a waveform is under way. A short answer needs no such buffer."""
_SLACK_S = 0.010
"""Excess of a VISA time-out over the rest of a deadline that is good enough, s: setting one costs more."""

_LOCK_MS = 1
_UNLOCK = "end the other program, or have it unlock the instrument"

_FULL = StatusCode.success_max_count_read
_TIMEOUT = ResourceAttribute.timeout_value
_TIMED_OUT = frozenset({StatusCode.error_timeout})
_INTERFACES: dict[InterfaceType, Interface] = {
    InterfaceType.gpib: "gpib",
    InterfaceType.usb: "usb",
    InterfaceType.asrl: "asrl",
}
_PARITIES = {"none": Parity.none, "even": Parity.even, "odd": Parity.odd}
_STOP_BITS = {1: StopBits.one, 2: StopBits.two}
_FLOWS = {
    "none": ControlFlow.none,
    "dtr_dsr": ControlFlow.dtr_dsr,
    "rts_cts": ControlFlow.rts_cts,
    "xon_xoff": ControlFlow.xon_xoff,
}


def open_wire(resource: str, library: str, deadline: Deadline, serial: SerialLine | None) -> Wire:
    """Open `resource` through the VISA `library` (``"@py"``, a path, ...); raises ConnectFailed."""
    milliseconds = max(1, int(deadline.remaining() * 1000))
    try:
        # The manager is shared by everyone who names the same library, so it is never closed from here.
        manager = pyvisa.ResourceManager(library)
        opened: Any = manager.open_resource(resource, open_timeout=milliseconds)
    except Exception as error:  # a VISA library is anyone's code; PyVISA-py itself raises a bare Exception here
        raise ConnectFailed(_words(error), elapsed_s=deadline.elapsed()) from error
    try:
        interface = _INTERFACES.get(opened.interface_type, "instr")
        interface = "socket" if opened.resource_class == "SOCKET" else interface
        beneath = _socket_beneath(opened) if interface == "socket" else None
        if beneath is not None:
            code = beneath.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
            try:
                beneath.getpeername()
            except OSError as error:
                code = code or error.errno or -1
            if code:
                raise ConnectFailed(f"no instrument answers there ({os.strerror(code)})")  # noqa: TRY301 - the resource is closed
            return SocketWire(opened, beneath)
        try:
            if interface == "asrl" and serial is not None:
                opened.baud_rate, opened.data_bits = serial.baud_rate, serial.data_bits
                opened.parity, opened.stop_bits = _PARITIES[serial.parity], _STOP_BITS[serial.stop_bits]
                opened.flow_control = _FLOWS[serial.flow_control]
            if interface in ("asrl", "socket"):  # a byte stream knows no END: the newline is the only end there is
                opened.set_visa_attribute(ResourceAttribute.termchar, ord("\n"))
                opened.set_visa_attribute(ResourceAttribute.termchar_enabled, True)  # noqa: FBT003 - PyVISA's signature
        except Exception as error:  # a line that the port cannot do is a termios.error, which is a bare Exception too
            raise ConnectFailed(_words(error)) from error
        return VisaWire(opened, interface)
    except BaseException:
        opened.close()
        raise


def _words(error: BaseException) -> str:
    return f"cannot be opened ({' '.join(str(error).split()) or type(error).__name__})"


def _socket_beneath(opened: MessageBasedResource) -> socket.socket | None:
    """Return PyVISA-py's own socket, None under every other library (or when a later PyVISA-py hides it)."""
    sessions = getattr(opened.visalib, "sessions", None)
    entry = sessions.get(opened.session) if isinstance(sessions, dict) else None
    beneath = getattr(entry, "interface", None)
    return beneath if isinstance(beneath, socket.socket) else None


class SocketWire:
    """A raw TCP socket.

    Its waiting is wall time whatever the session's clock, for that is what a peer's answer takes; the seconds left
    of the session's deadline are granted as wall seconds.
    """

    interface: Interface = "socket"

    def __init__(self, opened: MessageBasedResource, beneath: socket.socket) -> None:
        self._opened = opened
        self._socket = beneath
        beneath.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Send all of `data`; a peer that does not read is a DeadlineExceeded, not a hang."""
        try:
            self._socket.settimeout(left_s(deadline))
            self._socket.sendall(data)
        except TimeoutError as error:
            raise DeadlineExceeded("the instrument does not take the command") from error
        except OSError as error:
            raise LinkLost(f"the connection broke ({_reason(error)})") from error

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        """Return the received bytes, waiting for the first."""
        left = deadline.remaining()
        data = self._taken(left) if left > 0.0 else b""
        if not data:
            raise DeadlineExceeded("no answer")
        return data, False

    def pending(self) -> bytes:
        """Take unasked bytes."""
        return self._taken(0.0)

    def _taken(self, wait_s: float) -> bytes:
        """Return the received bytes; none where none came within `wait_s`."""
        try:
            self._socket.settimeout(wait_s)
            data = self._socket.recv(_CHUNK)
        except (TimeoutError, BlockingIOError, InterruptedError):
            return b""
        except OSError as error:
            raise LinkLost(f"the connection broke ({_reason(error)})") from error
        if not data:
            raise LinkLost("the instrument closed the connection")
        return data

    def clear(self, deadline: Deadline) -> None:
        """Drop received bytes; a raw socket has no device clear."""
        while not deadline.expired() and self.pending():
            pass

    def close(self) -> None:
        """Close the socket and PyVISA's resource."""
        _close(self._opened)


def _reason(error: OSError) -> str:
    return error.strerror or str(error) or type(error).__name__


class VisaWire:
    """Any VISA resource, through viWrite and viRead.

    The library is called directly: PyVISA's `read` and `write` spend more time on terminators and logging than a
    simulated instrument spends on its answer.
    """

    def __init__(self, opened: MessageBasedResource, interface: Interface) -> None:
        self.interface: Interface = interface
        self._opened = opened
        self._session = opened.session
        self._viread = opened.visalib.read
        self._viwrite = opened.visalib.write
        self._set = opened.visalib.set_attribute
        self._timeout_s = -1.0
        self._chunk = _CHUNK
        self._knows_end = interface not in ("asrl", "socket")
        # A full chunk is no reason for a warning: `receive` is called until the message has ended.
        self._quiet = opened.ignore_warning(StatusCode.success_max_count_read, StatusCode.success_device_not_present)
        self._quiet.__enter__()

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Write all of `data`."""
        try:
            self._grant(deadline)
            count, _ = self._viwrite(self._session, data)
        except Exception as error:  # whatever anyone's VISA library raises, the wire has failed
            if isinstance(error, VisaIOError) and self._is_locked():
                raise LinkLost("another controller has locked it", hint=_UNLOCK) from error
            raise _failure(error, "the instrument does not take the command") from error
        if count != len(data):
            raise LinkLost(f"only {count} of {len(data)} bytes were taken")

    def _is_locked(self) -> bool:
        """Return True if another controller has locked the instrument; PyVISA-py says that a write failed."""
        try:
            self._opened.lock_excl(timeout=_LOCK_MS)
            self._opened.unlock()
        except VisaIOError as error:
            return error.error_code == StatusCode.error_resource_locked
        except Exception:  # noqa: BLE001  # as above; not every library has locks
            return False
        return False

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        """Read one chunk."""
        try:
            self._grant(deadline)
            data, status = self._viread(self._session, self._chunk)
        except Exception as error:  # as above: bare OSError, RPCError, EOFError, struct.error were seen
            raise _failure(error, "no answer") from error
        self._chunk = _CHUNK if len(data) < _CHUNK else _BIG_CHUNK
        return bytes(data), self._knows_end and status != _FULL

    def pending(self) -> bytes:
        """Return unasked bytes of a serial line; other interfaces of VISA cannot read without waiting."""
        data = b""
        while self.interface == "asrl" and (waiting := self._waiting()):
            try:
                data += bytes(self._viread(self._session, waiting)[0])
            except Exception as error:  # as above
                raise _failure(error, "no answer") from error
        return data

    def _waiting(self) -> int:
        try:
            return int(self._opened.visalib.get_attribute(self._session, ResourceAttribute.asrl_avalaible_number)[0])
        except (VisaIOError, NotImplementedError):  # not every library can tell
            return 0
        except Exception as error:  # as above
            raise _failure(error, "no answer") from error

    def clear(self, deadline: Deadline) -> None:
        """Do a device clear; on a serial line that is Ctrl-C (E3631A guide p. 68; 34401A guide p. 160)."""
        if self.interface == "asrl":
            self.send(b"\x03", deadline)
        self._grant(deadline)
        with suppress(pyvisa.errors.Error, NotImplementedError, OSError):  # not every library has it; resync decides
            if self.interface == "asrl":
                self._opened.flush(BufferOperation.discard_read_buffer)
            else:
                self._opened.clear()

    def close(self) -> None:
        """Close PyVISA's resource."""
        self._quiet.__exit__(None, None, None)
        _close(self._opened)

    def _grant(self, deadline: Deadline) -> None:
        left = deadline.expires_s - deadline.clock.now()  # here and not in left_s: it comes with every message
        if left <= 0.0:
            raise DeadlineExceeded("the time is up")
        if not 0.0 <= self._timeout_s - left <= _SLACK_S:
            # Rounded up: a VISA time-out of 0 ms would mean "do not wait at all".
            milliseconds = int(left * 1000.0) + 1
            self._set(self._session, _TIMEOUT, milliseconds)
            self._timeout_s = milliseconds / 1000.0


def _failure(error: Exception, when_late: str) -> BenchError:
    if isinstance(error, BenchError):  # ours, or one that a signal handler raised amid the library's waiting
        return error
    if isinstance(error, VisaIOError) and error.error_code in _TIMED_OUT:
        return DeadlineExceeded(when_late)
    return LinkLost(f"the connection broke ({' '.join(str(error).split()) or type(error).__name__})")


def _close(opened: MessageBasedResource) -> None:
    # A connection that broke may refuse to be closed; there is nothing left to be done about it.
    with suppress(pyvisa.errors.Error, OSError):
        opened.close()
