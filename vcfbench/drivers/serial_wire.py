"""Wires on serial ports, opened by pyserial by name or URL, with deadlines."""

from typing import Annotated, Any, Literal

from msgspec import Meta, Struct

from vcfbench import errors
from vcfbench.clock import Clock, Deadline, sleep
from vcfbench.drivers.trace import Connect
from vcfbench.drivers.wire import Interface, Wire, left_s

_MOST_AT_ONCE = 32_768

Pause = Annotated[float, Meta(ge=0.0, le=60.0)]
"""A wait that a profile may ask for, s."""


class Link(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of a serial line."""

    baud: Annotated[int, Meta(ge=300, le=921_600)] = 9600  # the bench file's `baud_rate` overrides it
    data_bits: Literal[7, 8] = 8  # bits per character
    parity: Literal["none", "even", "odd"] = "none"  # parity bit
    stop_bits: Literal[1, 2] = 1  # stop bits
    flow: Literal["none", "rts_cts", "dsr_dtr", "xon_xoff"] = "none"  # flow control
    dtr: bool | None = None  # level when the port is opened; some controllers restart on an edge
    rts: bool | None = None  # the same of RTS
    open_delay_s: Pause = 0.0  # pause after opening, s


def serial_port(url: str, link: Link, clock: Clock, timeout_s: float, baud_rate: int | None = None) -> Connect:
    """Return a function that opens a port by its name or URL (``/dev/ttyUSB0``, ``COM3``, ``socket://host:port``).

    The port is set as `link` says, `baud_rate` overrides its speed. What it returns raises ConnectFailed: there is no
    such port, it is in use, or nobody answers there.
    """

    def connect(_: Deadline) -> Wire:
        import serial  # noqa: PLC0415 - loaded when first needed

        try:
            port = serial.serial_for_url(url, do_not_open=True, timeout=timeout_s, write_timeout=timeout_s)
            port.baudrate, port.bytesize = baud_rate or link.baud, link.data_bits
            port.parity, port.stopbits = link.parity[0].upper(), link.stop_bits
            port.rtscts, port.dsrdtr = link.flow == "rts_cts", link.flow == "dsr_dtr"
            port.xonxoff = link.flow == "xon_xoff"
            # Set DTR and RTS before the port is opened: their edge resets some controllers
            if link.dtr is not None:
                port.dtr = link.dtr
            if link.rts is not None:
                port.rts = link.rts
            if isinstance(port, serial.Serial):
                port.exclusive = True  # one owner a connection; only real ports know how
            port.open()
        except Exception as error:  # termios.error is no OSError, and the handler of a URL is anyone's code
            raise errors.ConnectFailed(f"cannot be opened ({' '.join(str(error).split())})") from error
        sleep(clock, link.open_delay_s)  # some tables begin anew when a port is opened
        return SerialWire(port, serial.SerialTimeoutException)

    return connect


class SerialWire:
    """A wire over an open pyserial port, which raises `late` where writing takes too long."""

    interface: Interface = "serial"

    def __init__(self, port: Any, late: type[OSError]) -> None:
        self._port = port
        self._late = late
        self._on_socket = type(port).__module__ == "serial.urlhandler.protocol_socket"

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Write all of `data`."""
        try:
            self._port.write_timeout = left_s(deadline)
            self._port.write(data)
        except self._late as error:
            raise errors.DeadlineExceeded("the other end does not take the command") from error
        except OSError as error:
            raise _lost(error) from error

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        """Return the received bytes, waiting for the first."""
        try:
            self._port.timeout = left_s(deadline)
            first = self._port.read(1)
            data = first + self._waiting() if first else first
        except OSError as error:
            raise _lost(error) from error
        if not data:
            raise errors.DeadlineExceeded("no answer")
        return data, False

    def _waiting(self) -> bytes:
        """Return the bytes that are there; a port on a socket never says that more than one byte waits."""
        if not self._on_socket:
            return bytes(self._port.read(self._port.in_waiting))
        self._port.timeout = 0
        return bytes(self._port.read(_MOST_AT_ONCE))

    def pending(self) -> bytes:
        """Take unasked bytes."""
        data = b""
        try:
            while len(data) < _MOST_AT_ONCE and (more := self._waiting()):
                data += more
        except OSError as error:
            raise _lost(error) from error
        return data

    def clear(self, deadline: Deadline) -> None:
        """Drop received bytes; tables know no device clear."""
        while not deadline.expired() and self.pending():
            pass

    def close(self) -> None:
        """Close the port."""
        self._port.close()


def _lost(error: OSError) -> errors.LinkLost:
    return errors.LinkLost(f"the connection broke ({' '.join(str(error).split()) or type(error).__name__})")
