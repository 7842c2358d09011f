"""Sessions of the VISA backend: benches, places on them, what is open and what has arrived."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from pyvisa import attributes, constants, errors, rname
from pyvisa.constants import AccessModes, InterfaceType, ResourceAttribute, StatusCode
from pyvisa.typing import VISASession

from simrack.attendance import AttendedClock
from simrack.clock import Clock
from simrack.device import Device
from simrack.scpi import ScpiTwin
from simrack.wires import visa_serial
from simrack.wires.handshake_line import HandshakeLine

LINE_FEED = 10
SUCCESS = StatusCode.success
FULL = StatusCode.success_max_count_read
TERMINATED = StatusCode.success_termination_character_read
"""Looked up once: Python 3.11 takes long to find a member of an enumeration, and these come with every message."""
DEFAULT_TIMEOUT_MS = 2000
_MAKER = ResourceAttribute.resource_manufacturer_name
_VERSION = 0x00300000
_BUFFER = 4096


def number(text: str) -> int:
    """Return the number that a part of a resource's name says."""
    return int(text, 0)


NAME_ATTRIBUTES: tuple[tuple[ResourceAttribute, str, Callable[[str], Any]], ...] = (
    (ResourceAttribute.gpib_primary_address, "primary_address", number),
    (ResourceAttribute.manufacturer_id, "manufacturer_id", number),
    (ResourceAttribute.model_code, "model_code", number),
    (ResourceAttribute.usb_serial_number, "serial_number", str),
    (ResourceAttribute.tcpip_address, "host_address", str),
    (ResourceAttribute.tcpip_port, "port", number),
    (ResourceAttribute.tcpip_device_name, "lan_device_name", str),
)


class SimulatedInstruments(NamedTuple):
    """The instruments of a simulated bench by resource name, and the clock of its World."""

    instruments: Mapping[str, Device]
    clock: Clock


class VisaPlace:
    """A device where VISA finds it."""

    __slots__ = ("device", "name", "owner", "parsed", "sharers")

    def __init__(self, name: str, device: Device) -> None:
        self.parsed = rname.ResourceName.from_string(name)
        self.name = str(self.parsed)
        self.device = device
        self.owner: VISASession | None = None
        self.sharers: set[VISASession] = set()

    def locked_against(self, session: VISASession) -> bool:
        """Return True if another session holds a lock that `session` does not share."""
        if self.owner is not None:
            return self.owner != session
        return bool(self.sharers) and session not in self.sharers

    def lock_state(self) -> AccessModes:
        """Return the state of its lock."""
        if self.owner is not None:
            return AccessModes.exclusive_lock
        return AccessModes.shared_lock if self.sharers else AccessModes.no_lock


class VisaBench:
    """The instruments behind one handle."""

    __slots__ = ("announced", "clock", "lock", "places")

    def __init__(self, instruments: Mapping[str, Device], clock: Clock) -> None:
        places = [VisaPlace(name, device) for name, device in instruments.items()]
        self.places = {place.name.upper(): place for place in places}
        self.clock = clock if isinstance(clock, AttendedClock) else AttendedClock(clock)
        self.clock.attend(*instruments.values())
        self.lock = self.clock.held
        self.announced: list[Any] = []
        """The :class:`~simrack.wires.visa_events.Announcements` that are enabled."""


class OpenSession:
    """An open resource."""

    __slots__ = (
        *("attributes", "bench", "ended", "kind", "line", "offset", "place", "read", "rest", "sends_end", "stream"),
        *("terminator", "timeout_s", "write"),
    )

    def __init__(self, bench: VisaBench, place: VisaPlace, maker: str) -> None:
        self.bench = bench
        self.place = place
        self.write, self.read = place.device.write, place.device.read
        self.kind = (place.parsed.interface_type_const, place.parsed.resource_class)
        self.stream = self.kind[0] is InterfaceType.asrl or self.kind[1] == "SOCKET"
        self.timeout_s = DEFAULT_TIMEOUT_MS / 1e3
        self.rest = b""
        self.offset = 0
        self.ended = False
        board = str(getattr(place.parsed, "board", "0"))
        self.attributes: dict[int, Any] = {
            ResourceAttribute.resource_name: place.name,
            ResourceAttribute.resource_class: place.parsed.resource_class,
            ResourceAttribute.interface_type: place.parsed.interface_type_const,
            ResourceAttribute.interface_number: (int(board) if board.isdigit() else 0),
            ResourceAttribute.resource_manufacturer_name: maker,
            ResourceAttribute.timeout_value: DEFAULT_TIMEOUT_MS,
            ResourceAttribute.termchar: LINE_FEED,
            ResourceAttribute.termchar_enabled: constants.VI_FALSE,
            ResourceAttribute.send_end_enabled: constants.VI_TRUE,
        }
        if self.kind[0] is InterfaceType.asrl:
            self.attributes[ResourceAttribute.asrl_end_in] = constants.SerialTermination.termination_char
        parsed, known = self.place.parsed, self.attributes
        for attribute, field, convert in NAME_ATTRIBUTES:
            value = getattr(parsed, field, None)
            if value is not None and attributes.AttributesByID[attribute].in_resource(self.kind):
                known[attribute] = convert(value)
        self._describe(known)
        self.terminator: int | None = None
        """The byte that ends a read, None when only END does."""
        self.sends_end = True
        """Whether END comes with the last byte of a write."""
        self.learn_ends()
        self.line = place.device if isinstance(place.device, HandshakeLine) else None
        if self.line is not None:
            visa_serial.configure(self.line, self.attributes)

    def _describe(self, known: dict[int, Any]) -> None:
        """Fill in what is stated of interface and instrument, where the session has such an attribute."""
        parsed, twin = self.place.parsed, self.place.device
        identity = twin.identity().split(",") if isinstance(twin, ScpiTwin) else []
        device = str(getattr(parsed, "lan_device_name", ""))
        stated = {
            ResourceAttribute.interface_instrument_name: f"{parsed.interface_type} of {known[_MAKER]}",
            ResourceAttribute.resource_impl_version: _VERSION,
            ResourceAttribute.read_buffer_size: _BUFFER,
            ResourceAttribute.write_buffer_size: _BUFFER,
            ResourceAttribute.tcpip_hostname: getattr(parsed, "host_address", None),
            ResourceAttribute.tcpip_is_hislip: device.startswith("hislip"),
            ResourceAttribute.gpib_secondary_address: constants.VI_NO_SEC_ADDR,
            ResourceAttribute.gpib_ren_state: constants.LineState.asserted,
            ResourceAttribute.is_4882_compliant: True,
            ResourceAttribute.manufacturer_name: identity[0] if identity else None,
            ResourceAttribute.model_name: identity[1] if len(identity) > 1 else None,
        }
        for attribute, value in stated.items():
            if value is not None and attributes.AttributesByID[attribute].in_resource(self.kind):
                known.setdefault(attribute, value)

    def learn_ends(self) -> None:
        """Work out the ends of a read, and of a write."""
        known = self.attributes
        ends_at_character = known.get(ResourceAttribute.asrl_end_in) == constants.SerialTermination.termination_char
        enabled = known[ResourceAttribute.termchar_enabled] or ends_at_character
        self.terminator = known[ResourceAttribute.termchar] if enabled else None
        self.sends_end = bool(known[ResourceAttribute.send_end_enabled]) and not self.stream

    def drop_buffer(self) -> None:
        """Forget received and unread bytes."""
        self.rest = b""
        self.offset = 0
        self.ended = False


def take_arrived(opened: OpenSession, count: int, terminator: int | None) -> tuple[bytes, StatusCode | None]:
    """Take up to `count` bytes from the session's buffer, and why the read ends with them (None: it does not)."""
    rest, start = opened.rest, opened.offset
    stop = min(len(rest), start + count)
    found = -1 if terminator is None else rest.find(terminator, start, stop)
    if found >= 0:
        stop = found + 1
    part = rest if start == 0 and stop == len(rest) else rest[start:stop]
    opened.offset = stop
    exhausted = stop == len(rest)
    if exhausted:
        opened.rest, opened.offset = b"", 0
    if exhausted and opened.ended and part and not opened.stream:
        opened.ended = False
        return part, SUCCESS
    if found >= 0:
        return part, TERMINATED
    return part, FULL if len(part) == count else None


def available(opened: OpenSession) -> int:
    """Return the number of received bytes that wait to be read."""
    if not opened.rest:
        with opened.bench.lock:
            opened.rest, opened.ended = opened.read(1 << 20)
        opened.offset = 0
    return len(opened.rest) - opened.offset


def known_attribute(opened: OpenSession, attribute: int) -> type[attributes.Attribute[Any]]:
    """Return an attribute that the session has; VisaIOError if it has none such."""
    known = attributes.AttributesByID.get(attribute)
    if known is None or not known.in_resource(opened.kind):
        raise errors.VisaIOError(StatusCode.error_nonsupported_attribute)
    return known
