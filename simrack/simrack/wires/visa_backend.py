"""PyVISA backend whose instruments are simulated.

A library object serves one bench: the handle before the `@` names one that was registered in this process, anything
else is given to the resolver (a bench file, or nothing for the embedded bench). Reads wait on the bench's clock, so a
simulated time-out takes simulated time and no other.

VISA semantics follow the VPP-4.3 specification: a read ends at END, at the termination character when enabled, or at
the count. A serial session ends reads at its termination character even without it being enabled
(VI_ATTR_ASRL_END_IN), a SOCKET has no END at all: without a termination character its text reads time out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import count
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeAlias, cast

from pyvisa import attributes, constants, errors, highlevel, rname
from pyvisa.constants import AccessModes, EventType, InterfaceType, ResourceAttribute, StatusCode
from pyvisa.typing import VISAEventContext, VISARMSession, VISASession
from pyvisa.util import LibraryPath

from simrack.attendance import AttendedClock
from simrack.wires import visa_serial
from simrack.wires.serial_line import HandshakeLine

if TYPE_CHECKING:
    from collections.abc import Iterable

    from simrack.clock import Clock
    from simrack.device import Device

_EMBEDDED = "embedded"
_LINE_FEED = 10
_SUCCESS = StatusCode.success
_FULL = StatusCode.success_max_count_read
_TERMINATED = StatusCode.success_termination_character_read
_TIMEOUT = ResourceAttribute.timeout_value
"""Looked up once: Python 3.11 takes long to find a member of an enumeration, and these come with every message."""
_DEFAULT_TIMEOUT_MS = 2000


class SimulatedInstruments(NamedTuple):
    """The instruments of a simulated bench by resource name, and the clock of its World."""

    instruments: Mapping[str, Device]
    clock: Clock


Resolver: TypeAlias = Callable[[str], SimulatedInstruments]
"""Makes the simulated bench of a bench file's path, of the embedded paper bench for ""."""


class _Place:
    """A device where VISA finds it."""

    __slots__ = ("device", "name", "owner", "parsed", "sharers")

    def __init__(self, name: str, device: Device) -> None:
        self.parsed = rname.ResourceName.from_string(name)
        self.name = str(self.parsed)
        self.device = device
        self.owner: VISASession | None = None
        self.sharers: set[VISASession] = set()

    def locked_against(self, session: VISASession) -> bool:
        """Tell whether somebody else holds a lock in which `session` has no part."""
        if self.owner is not None:
            return self.owner != session
        return bool(self.sharers) and session not in self.sharers

    def lock_state(self) -> AccessModes:
        """Return how it is locked."""
        if self.owner is not None:
            return AccessModes.exclusive_lock
        return AccessModes.shared_lock if self.sharers else AccessModes.no_lock


class _Bench:
    """The instruments behind one handle."""

    __slots__ = ("clock", "lock", "places")

    def __init__(self, instruments: Mapping[str, Device], clock: Clock) -> None:
        places = [_Place(name, device) for name, device in instruments.items()]
        self.places = {place.name.upper(): place for place in places}
        self.clock = clock if isinstance(clock, AttendedClock) else AttendedClock(clock)
        self.clock.attend(*instruments.values())
        self.lock = self.clock.held


class _Session:
    """An open resource."""

    __slots__ = (
        *("attributes", "bench", "ended", "kind", "line", "offset", "place", "rest", "sends_end", "stream"),
        *("terminator", "timeout_s"),
    )

    def __init__(self, bench: _Bench, place: _Place, maker: str) -> None:
        self.bench = bench
        self.place = place
        self.kind = (place.parsed.interface_type_const, place.parsed.resource_class)
        self.stream = self.kind[0] is InterfaceType.asrl or self.kind[1] == "SOCKET"
        self.timeout_s = _DEFAULT_TIMEOUT_MS / 1e3
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
            ResourceAttribute.timeout_value: _DEFAULT_TIMEOUT_MS,
            ResourceAttribute.termchar: _LINE_FEED,
            ResourceAttribute.termchar_enabled: constants.VI_FALSE,
            ResourceAttribute.send_end_enabled: constants.VI_TRUE,
        }
        if self.kind[0] is InterfaceType.asrl:
            self.attributes[ResourceAttribute.asrl_end_in] = constants.SerialTermination.termination_char
        parsed, known = self.place.parsed, self.attributes
        for attribute, field, convert in _NAME_ATTRIBUTES:
            value = getattr(parsed, field, None)
            if value is not None and attributes.AttributesByID[attribute].in_resource(self.kind):
                known[attribute] = convert(value)
        self.terminator: int | None = None
        """The byte that ends a read, None when only END does."""
        self.sends_end = True
        """Whether END comes with the last byte of a write."""
        self.learn_ends()
        self.line = place.device if isinstance(place.device, HandshakeLine) else None
        if self.line is not None:
            visa_serial.configure(self.line, self.attributes)

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


def _number(text: str) -> int:
    return int(text, 0)


_NAME_ATTRIBUTES: tuple[tuple[ResourceAttribute, str, Callable[[str], Any]], ...] = (
    (ResourceAttribute.gpib_primary_address, "primary_address", _number),
    (ResourceAttribute.manufacturer_id, "manufacturer_id", _number),
    (ResourceAttribute.model_code, "model_code", _number),
    (ResourceAttribute.usb_serial_number, "serial_number", str),
    (ResourceAttribute.tcpip_address, "host_address", str),
    (ResourceAttribute.tcpip_port, "port", _number),
    (ResourceAttribute.tcpip_device_name, "lan_device_name", str),
)


class SimVisaLibrary(highlevel.VisaLibraryBase):
    """The library object of one simulated bench; :meth:`register` benches before opening them by handle."""

    maker: ClassVar[str] = "simrack"
    _benches: ClassVar[dict[str, _Bench]] = {}
    _resolvers: ClassVar[list[Resolver]] = []

    def __init_subclass__(cls) -> None:
        """Give each front door its own benches that are not registered."""
        super().__init_subclass__()
        cls._resolvers = []

    @classmethod
    def register(cls, handle: str, instruments: Mapping[str, Device], clock: Clock) -> None:
        """Make `instruments` (resource name to device) reachable under `handle`, as ``f"{handle}@simrack"``.

        Raises:
            ValueError: the handle is taken, or a resource name is not one.
        """
        if handle in cls._benches:
            raise ValueError(f"simulated bench {handle!r} is registered already")
        cls._benches[handle] = _Bench(instruments, clock)

    @classmethod
    def unregister(cls, handle: str) -> None:
        """Forget the bench `handle`; sessions that are open stay usable."""
        cls._benches.pop(handle, None)

    @classmethod
    def install_resolver(cls, resolver: Resolver) -> None:
        """Let `resolver` make the benches that are not registered; the last one installed is asked."""
        cls._resolvers.append(resolver)

    @staticmethod
    def get_library_paths() -> Iterable[LibraryPath]:
        """Return the one path that stands for the embedded bench."""
        return (LibraryPath(_EMBEDDED),)

    @classmethod
    def get_debug_info(cls) -> dict[str, str]:
        """Return the lines of `pyvisa-info`."""
        return {"Backend": f"simulated instruments of {cls.maker}"}

    def _init(self) -> None:
        self._sessions: dict[int, _Session] = {}
        self._contexts: set[int] = set()
        self._numbers = count(1)
        self._resolved: _Bench | None = None
        self._manager: VISARMSession | None = None

    # --- benches and sessions -----------------------------------------------------------------------------

    def _bench(self) -> _Bench:
        """Return the bench of this library; OSError when nobody knows it."""
        handle = str(self.library_path)
        if handle in self._benches:
            return self._benches[handle]
        if self._resolved is None:
            if not self._resolvers:
                raise OSError(f"no simulated bench {handle!r} is registered")
            self._resolved = _Bench(*self._resolvers[-1]("" if handle == _EMBEDDED else handle))
        return self._resolved

    @property
    def clock(self) -> Clock:
        """Bench time of this library's bench: ``sleep_until`` lets it pass, where ``time.sleep`` may not."""
        return self._bench().clock

    def _session(self, session: int) -> _Session:
        try:
            return self._sessions[session]
        except KeyError:
            raise errors.VisaIOError(StatusCode.error_invalid_object) from None

    def _done(self, session: int, status: StatusCode = _SUCCESS) -> StatusCode:
        return self.handle_return_value(cast("VISASession", session), status)

    def open_default_resource_manager(self) -> tuple[VISARMSession, StatusCode]:
        """Open the resource manager; the bench is made or looked up now, so that a missing one is told at once."""
        self._bench()
        self._manager = VISARMSession(next(self._numbers))
        return self._manager, self._done(self._manager)

    def open(
        self,
        session: VISARMSession,
        resource_name: str,
        access_mode: constants.AccessModes = constants.AccessModes.no_lock,
        open_timeout: int | None = constants.VI_TMO_IMMEDIATE,
    ) -> tuple[VISASession, StatusCode]:
        """Open a resource: VI_ERROR_RSRC_NFOUND when the bench has none of that name."""
        del session, open_timeout
        try:
            name = str(rname.ResourceName.from_string(resource_name.upper()))
        except rname.InvalidResourceName:
            raise errors.VisaIOError(StatusCode.error_invalid_resource_name) from None
        bench = self._bench()
        place = bench.places.get(name.upper())
        if place is None:
            raise errors.VisaIOError(StatusCode.error_resource_not_found)
        number = VISASession(next(self._numbers))
        self._sessions[number] = _Session(bench, place, self.maker)
        if access_mode == constants.AccessModes.exclusive_lock:
            self.lock(number, constants.Lock.exclusive, 0)
        return number, self._done(number)

    def close(self, session: VISASession | VISAEventContext | VISARMSession) -> StatusCode:
        """Close a session, an event context or the resource manager, whose bench ends unless it was registered."""
        if session == self._manager:
            self._resolved = None
        closed = self._sessions.pop(session, None)
        if closed is not None:
            closed.place.owner = None if closed.place.owner == session else closed.place.owner
            closed.place.sharers.discard(cast("VISASession", session))
        self._contexts.discard(session)
        self._last_status_in_session.pop(session, None)
        return _SUCCESS

    def list_resources(self, session: VISARMSession, query: str = "?*::INSTR") -> tuple[str, ...]:
        """Return the names of the bench's instruments that match the VISA expression `query`."""
        del session
        return rname.filter([place.name for place in self._bench().places.values()], query)

    # --- messages -----------------------------------------------------------------------------------------

    def write(self, session: VISASession, data: bytes) -> tuple[int, StatusCode]:
        """Send bytes, with END after the last unless the session says otherwise."""
        opened = self._session(session)
        self._check_owner(session, opened)
        with opened.bench.lock:
            opened.place.device.write(data, end=opened.sends_end)
        self._last_status = self._last_status_in_session[session] = _SUCCESS
        return len(data), _SUCCESS

    def read(self, session: VISASession, count: int) -> tuple[bytes, StatusCode]:
        """Receive up to `count` bytes of the next response; waits in bench time, at most the session's time-out."""
        opened = self._session(session)
        self._check_owner(session, opened)
        terminator = opened.terminator
        if not opened.rest:
            with opened.bench.lock:
                data, end = opened.place.device.read(count)
            if end and not opened.stream and (terminator is None or data.find(terminator) in (-1, len(data) - 1)):
                # what nearly every read is: a whole response, as it came
                self._last_status = self._last_status_in_session[session] = _SUCCESS
                return data, _SUCCESS
            opened.rest, opened.offset, opened.ended = data, 0, end
        data, status = self._collect(opened, count, terminator)
        if status is not _SUCCESS:
            return data, self._done(session, status)
        self._last_status = self._last_status_in_session[session] = status
        return data, status

    def _collect(self, opened: _Session, count: int, terminator: int | None) -> tuple[bytes, StatusCode]:
        """Put a read together from the bytes there and those that come before the time-out."""
        deadline = opened.bench.clock.now() + opened.timeout_s
        parts: list[bytes] = []
        if not opened.rest and not self._await(opened, count, deadline):
            return b"", StatusCode.error_timeout
        while True:
            part, status = _take(opened, count, terminator)
            parts.append(part)
            count -= len(part)
            if status is not None:
                return b"".join(parts), status
            if not self._fetch(opened, count) and not self._await(opened, count, deadline):
                return b"".join(parts), StatusCode.error_timeout

    @staticmethod
    def _fetch(opened: _Session, count: int) -> bool:
        """Take the device's present bytes; False when there are none."""
        with opened.bench.lock:
            opened.rest, opened.ended = opened.place.device.read(count)
        opened.offset = 0
        return bool(opened.rest)

    def _await(self, opened: _Session, count: int, deadline: float) -> bool:
        """Wait until a device that is silent now says something; False when it does not before `deadline`."""
        clock = opened.bench.clock
        while clock.now() < deadline:
            if math.isinf(deadline) and not self._will_act(opened):
                return False
            clock.sleep_to_next(deadline)
            if self._fetch(opened, count):
                return True
        return False

    @staticmethod
    def _will_act(opened: _Session) -> bool:
        """Tell whether a device will do something by itself; it is not waited for for ever where it will not."""
        with opened.bench.lock:
            wake_s = opened.place.device.wake_at()
        return wake_s is not None and opened.bench.clock.now() < wake_s < math.inf

    def buffer_read(self, session: VISASession, count: int) -> tuple[bytes, StatusCode]:
        """Receive like :meth:`read`: there is no formatted buffer in between."""
        return self.read(session, count)

    def buffer_write(self, session: VISASession, data: bytes) -> tuple[int, StatusCode]:
        """Send like :meth:`write`."""
        return self.write(session, data)

    def flush(self, session: VISASession, mask: constants.BufferOperation) -> StatusCode:
        """Drop received bytes if `mask` asks for it; output is never held back."""
        opened = self._session(session)
        if mask & (constants.BufferOperation.discard_read_buffer | constants.BufferOperation.discard_receive_buffer):
            self._drain(opened)
        return self._done(session)

    def clear(self, session: VISASession) -> StatusCode:
        """Device clear; a SOCKET or serial session has none and only drops received bytes."""
        opened = self._session(session)
        self._check_owner(session, opened)
        if opened.stream:
            self._drain(opened)
        else:
            opened.drop_buffer()
            with opened.bench.lock:
                opened.place.device.clear()
        return self._done(session)

    @staticmethod
    def _drain(opened: _Session) -> None:
        opened.drop_buffer()
        with opened.bench.lock:
            while opened.place.device.read(1 << 20)[0]:
                pass

    def read_stb(self, session: VISASession) -> tuple[int, StatusCode]:
        """Serial poll; VI_ERROR_NSUP_OPER on a SOCKET or serial session."""
        opened = self._addressed(session)
        with opened.bench.lock:
            return opened.place.device.status_byte(), self._done(session)

    def assert_trigger(self, session: VISASession, protocol: constants.TriggerProtocol) -> StatusCode:
        """Group execute trigger; VI_ERROR_NSUP_OPER on a SOCKET or serial session."""
        del protocol
        opened = self._addressed(session)
        with opened.bench.lock:
            opened.place.device.trigger()
        return self._done(session)

    def gpib_control_ren(self, session: VISASession, mode: constants.RENLineOperation) -> StatusCode:
        """Accept: the simulated front panels have no keys to lock."""
        del mode
        self._addressed(session)
        return self._done(session)

    def _addressed(self, session: VISASession) -> _Session:
        """Return the session if its interface can address a device out of band."""
        opened = self._session(session)
        if opened.stream:
            raise errors.VisaIOError(StatusCode.error_nonsupported_operation)
        self._check_owner(session, opened)
        return opened

    # --- locks --------------------------------------------------------------------------------------------

    @staticmethod
    def _check_owner(session: VISASession, opened: _Session) -> None:
        place = opened.place
        if (place.owner is not None or place.sharers) and place.locked_against(session):
            raise errors.VisaIOError(StatusCode.error_resource_locked)

    def lock(
        self, session: VISASession, lock_type: constants.Lock, timeout: int, requested_key: str | None = None
    ) -> tuple[str, StatusCode]:
        """Take a lock, at once or not at all; a shared one is given to everybody, whatever their key."""
        del timeout
        opened = self._session(session)
        place = opened.place
        exclusive = lock_type == constants.Lock.exclusive
        if place.owner not in {None, session} or (exclusive and place.sharers - {session}):
            raise errors.VisaIOError(StatusCode.error_resource_locked)
        if exclusive:
            place.owner = session
        else:
            place.sharers.add(session)
        return requested_key or "", self._done(session)

    def unlock(self, session: VISASession) -> StatusCode:
        """Give a lock back, the exclusive one first."""
        place = self._session(session).place
        if place.owner == session:
            place.owner = None
        elif session in place.sharers:
            place.sharers.discard(session)
        else:
            raise errors.VisaIOError(StatusCode.error_session_not_locked)
        return self._done(session)

    # --- attributes ---------------------------------------------------------------------------------------

    def get_attribute(
        self,
        session: VISASession | VISAEventContext | VISARMSession,
        attribute: constants.ResourceAttribute | constants.EventAttribute,
    ) -> tuple[Any, StatusCode]:
        """Return an attribute, its VISA default when it was never set."""
        opened = self._session(session)
        known = _known_attribute(opened, attribute)
        if attribute == ResourceAttribute.resource_lock_state:
            return opened.place.lock_state(), self._done(session)
        if attribute == ResourceAttribute.asrl_avalaible_number:
            return _available(opened), self._done(session)
        pin = None if opened.line is None else visa_serial.pin(opened.line, attribute)
        if pin is not None:
            return pin, self._done(session)
        if attribute in opened.attributes:
            return opened.attributes[attribute], self._done(session)
        if known.default is attributes.NotAvailable:
            raise errors.VisaIOError(StatusCode.error_nonsupported_attribute)
        return known.default, self._done(session)

    def set_attribute(
        self, session: VISASession, attribute: constants.ResourceAttribute, attribute_state: Any
    ) -> StatusCode:
        """Set an attribute; VI_ERROR_ATTR_READONLY for one that cannot be."""
        opened = self._session(session)
        if attribute == _TIMEOUT:  # what drivers set before nearly every exchange
            opened.attributes[attribute] = attribute_state
            opened.timeout_s = math.inf if attribute_state == constants.VI_TMO_INFINITE else attribute_state / 1e3
            self._last_status = self._last_status_in_session[session] = _SUCCESS
            return _SUCCESS
        if not _known_attribute(opened, attribute).write:
            raise errors.VisaIOError(StatusCode.error_attribute_read_only)
        opened.attributes[attribute] = attribute_state
        opened.learn_ends()
        if opened.line is not None:
            visa_serial.changed(opened.line, opened.attributes, attribute)
        return self._done(session)

    # --- events -------------------------------------------------------------------------------------------

    def enable_event(
        self,
        session: VISASession,
        event_type: constants.EventType,
        mechanism: constants.EventMechanism,
        context: None = None,
    ) -> StatusCode:
        """Accept service requests on the queue; nothing else is announced."""
        del mechanism, context
        if event_type != EventType.service_request:
            raise errors.VisaIOError(StatusCode.error_invalid_event)
        self._addressed(session)
        return self._done(session)

    def disable_event(
        self, session: VISASession, event_type: constants.EventType, mechanism: constants.EventMechanism
    ) -> StatusCode:
        """Accept: nothing is kept between waits."""
        del event_type, mechanism
        return self._done(session)

    def discard_events(
        self, session: VISASession, event_type: constants.EventType, mechanism: constants.EventMechanism
    ) -> StatusCode:
        """Accept: nothing is kept between waits."""
        del event_type, mechanism
        return self._done(session)

    def wait_on_event(
        self, session: VISASession, in_event_type: constants.EventType, timeout: int
    ) -> tuple[constants.EventType, VISAEventContext, StatusCode]:
        """Wait in bench time until the instrument requests service."""
        opened = self._addressed(session)
        clock, device = opened.bench.clock, opened.place.device
        deadline = math.inf if timeout == constants.VI_TMO_INFINITE else clock.now() + timeout / 1e3
        while not cast("Any", device).requests_service():
            wake = device.wake_at()
            instant = deadline if wake is None else min(wake, deadline)
            if clock.now() >= deadline or math.isinf(instant):
                raise errors.VisaIOError(StatusCode.error_timeout)
            clock.sleep_until(instant)
        context = VISAEventContext(next(self._numbers))
        self._contexts.add(context)
        return in_event_type, context, self._done(session)


def _take(opened: _Session, count: int, terminator: int | None) -> tuple[bytes, StatusCode | None]:
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
        return part, _SUCCESS
    if found >= 0:
        return part, _TERMINATED
    return part, _FULL if len(part) == count else None


def _available(opened: _Session) -> int:
    """Return how many received bytes wait to be read."""
    if not opened.rest:
        with opened.bench.lock:
            opened.rest, opened.ended = opened.place.device.read(1 << 20)
        opened.offset = 0
    return len(opened.rest) - opened.offset


def _known_attribute(opened: _Session, attribute: int) -> type[attributes.Attribute[Any]]:
    known = attributes.AttributesByID.get(attribute)
    if known is None or not known.in_resource(opened.kind):
        raise errors.VisaIOError(StatusCode.error_nonsupported_attribute)
    return known
