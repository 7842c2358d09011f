"""The languages of rate tables by name: built in, shipped as a profile, or told by a TOML file of one's own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from msgspec import Struct

from vcfbench.clock import Deadline, sleep
from vcfbench.drivers.rate_table.dialect import AxisSettings
from vcfbench.drivers.rate_table.line import Link, SerialWire, TableLine
from vcfbench.drivers.trace import attending, tapping
from vcfbench.errors import ConnectFailed, TransportError
from vcfbench.models import LANGUAGES, find_language, resolve

if TYPE_CHECKING:
    import serial

    from vcfbench.clock import Clock
    from vcfbench.drivers.rate_table.dialect import TableDialect
    from vcfbench.drivers.wire import Wire

DIALECTS: Final = tuple(row.name for row in LANGUAGES)
"""The languages that come with the project."""
SHIPPED: Final = tuple(row.name for row in LANGUAGES if row.dialect is None)
"""Those of them that a profile tells."""


class Spoken(Struct, frozen=True):
    """A dialect for one axis, and the line that it is spoken on."""

    dialect: TableDialect
    link: Link


def spoken(name: str, settings: AxisSettings | None = None) -> Spoken:
    """Return the dialect `name` for an axis.

    Raises:
        ConfigError: there is none of that name, its profile is wrong, or something that it needs is not told.
    """
    wanted = settings or AxisSettings()
    row = find_language(name)
    if row is not None and row.dialect is not None:
        return Spoken(resolve(row.dialect).for_axis(wanted), Link(baud=row.baud_rate))
    from vcfbench.drivers.rate_table.configurable import ConfigurableDialect  # noqa: PLC0415 - few benches need it
    from vcfbench.drivers.rate_table.profile import load_profile  # noqa: PLC0415 - as above

    profile = load_profile(name)
    return Spoken(ConfigurableDialect(profile, wanted.axis), profile.link)


def open_serial(
    url: str,
    link: Link,
    *,
    clock: Clock,
    name: str,
    timeout_s: float,
    baud_rate: int | None = None,
    resource: str | None = None,
) -> TableLine:
    """Open a port with all that `link` says of it; `baud_rate` overrides its speed.

    Messages name `resource`, by default the `url`.

    Raises:
        ConnectFailed: there is no such port, it is in use, or nobody answers there.
    """
    tap = tapping(name, resource or url, clock)

    def connect(_: Deadline) -> Wire:
        port = _open_port(url, link, baud_rate or link.baud, timeout_s)
        sleep(clock, link.open_delay_s)  # some tables begin anew when a port is opened
        return tap(SerialWire(port))

    reach = attending(name, connect)
    try:
        wire = reach(Deadline.after(clock, timeout_s))
    except TransportError as error:
        error.instrument, error.resource = name, resource or url
        raise
    return TableLine(wire, name=name, resource=resource or url, clock=clock, timeout_s=timeout_s, reconnect=reach)


def _open_port(url: str, link: Link, baud_rate: int, timeout_s: float) -> serial.Serial:
    import serial  # noqa: PLC0415 - loaded when first needed

    try:
        port = serial.serial_for_url(url, do_not_open=True, timeout=timeout_s, write_timeout=timeout_s)
        port.baudrate, port.bytesize = baud_rate, link.data_bits
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
        raise ConnectFailed(f"cannot be opened ({' '.join(str(error).split())})") from error
    return port
