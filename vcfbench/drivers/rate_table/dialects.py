"""The languages of rate tables by name: built in, shipped as a profile, or told by a TOML file of one's own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from vcfbench.clock import Deadline, sleep
from vcfbench.drivers.rate_table.acl import AclDialect, Header
from vcfbench.drivers.rate_table.line import SerialWire, TableLine
from vcfbench.drivers.rate_table.names import BUILT_IN, DIALECTS, SHIPPED
from vcfbench.errors import ConfigError, ConnectFailed, TransportError

if TYPE_CHECKING:
    import serial

    from vcfbench.clock import Clock
    from vcfbench.drivers.rate_table.dialect import TableDialect
    from vcfbench.drivers.rate_table.profile import Link
    from vcfbench.drivers.wire import Wire

__all__ = ["BUILT_IN", "DIALECTS", "SHIPPED", "Spoken", "is_dialect", "open_serial", "spoken"]

_BAUD: Final = {"acl": 9_600, "zaber": 115_200, "atl": 9_600, "esp": 19_200}
"""8N1 all; 19 200 Bd of the ESP is unverified."""


@dataclass(frozen=True, slots=True)
class Spoken:
    """A dialect for one axis, and the line that it is spoken on."""

    dialect: TableDialect
    link: Link


def is_dialect(name: str) -> bool:
    """Tell whether `name` can be the dialect of a table: a known one, or a TOML file."""
    return name in DIALECTS or name.endswith(".toml")


def spoken(name: str, *, axis: int = 1, header: Header = "auto", steps_per_deg: float | None = None) -> Spoken:
    """Return the dialect `name` for an axis.

    Raises:
        ConfigError: there is none of that name, its profile is wrong, or something that it needs is not told.
    """
    from vcfbench.drivers.rate_table.profile import Link, load_profile  # noqa: PLC0415 - what few benches need

    if name not in BUILT_IN:
        from vcfbench.drivers.rate_table.configurable import ConfigurableDialect  # noqa: PLC0415 - when first needed

        profile = load_profile(name)
        return Spoken(ConfigurableDialect(profile, axis), profile.link)
    return Spoken(_built_in(name, axis, header, steps_per_deg), Link(baud=_BAUD[name]))


def _built_in(name: str, axis: int, header: Header, steps_per_deg: float | None) -> TableDialect:
    from vcfbench.drivers.rate_table.atl import AtlDialect  # noqa: PLC0415
    from vcfbench.drivers.rate_table.esp import EspDialect  # noqa: PLC0415
    from vcfbench.drivers.rate_table.zaber import ZaberDialect  # noqa: PLC0415

    if name == "zaber":
        if steps_per_deg is None:
            raise ConfigError("rate_table.steps_per_deg: expected the stage's microsteps per degree, came nothing")
        return ZaberDialect(steps_per_deg, axis)
    if name == "atl":
        return AtlDialect()
    return EspDialect(axis) if name == "esp" else AclDialect(axis, header)


def open_serial(
    url: str, link: Link, *, clock: Clock, name: str, timeout_s: float, baud_rate: int | None = None
) -> TableLine:
    """Open a port with all that `link` says of it; `baud_rate` overrides its speed.

    Raises:
        ConnectFailed: there is no such port, it is in use, or nobody answers there.
    """

    def connect(_: Deadline) -> Wire:
        port = _open_port(url, link, baud_rate or link.baud, timeout_s)
        sleep(clock, link.open_delay_s)  # some tables begin anew when a port is opened
        return SerialWire(port)

    try:
        wire = connect(Deadline.after(clock, timeout_s))
    except TransportError as error:
        error.instrument, error.resource = name, url
        raise
    return TableLine(wire, name=name, resource=url, clock=clock, timeout_s=timeout_s, reconnect=connect)


def _open_port(url: str, link: Link, baud_rate: int, timeout_s: float) -> serial.Serial:
    import serial  # noqa: PLC0415 - loaded when first needed

    try:
        port = serial.serial_for_url(url, do_not_open=True, timeout=timeout_s, write_timeout=timeout_s)
        port.baudrate, port.bytesize = baud_rate, link.data_bits
        port.parity, port.stopbits = link.parity[0].upper(), link.stop_bits
        port.rtscts, port.dsrdtr = link.flow == "rts_cts", link.flow == "dsr_dtr"
        port.xonxoff = link.flow == "xon_xoff"
        _set_levels(port, link)
        if isinstance(port, serial.Serial):
            port.exclusive = True  # one owner a connection; only real ports know how
        port.open()
    except Exception as error:  # termios.error is no OSError, and the handler of a URL is anyone's code
        raise ConnectFailed(f"cannot be opened ({' '.join(str(error).split())})") from error
    return port


def _set_levels(port: serial.Serial, link: Link) -> None:
    """Set DTR and RTS before the port is opened: their edge resets some controllers."""
    if link.dtr is not None:
        port.dtr = link.dtr
    if link.rts is not None:
        port.rts = link.rts
