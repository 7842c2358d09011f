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
from collections.abc import Callable, Iterable, Mapping
from itertools import count
from typing import Any, ClassVar, TypeAlias, cast

from pyvisa import attributes, constants, errors, highlevel, rname
from pyvisa.constants import EventType, ResourceAttribute, StatusCode
from pyvisa.typing import VISAEventContext, VISARMSession, VISASession
from pyvisa.util import LibraryPath

from simrack.clock import Clock
from simrack.device import Device
from simrack.wires import visa_serial
from simrack.wires.visa_events import Announcements, look_everywhere, require_kind
from simrack.wires.visa_session import (
    SUCCESS,
    OpenSession,
    SimulatedInstruments,
    VisaBench,
    available,
    known_attribute,
    take_arrived,
)

_EMBEDDED = "embedded"
_TIMEOUT = ResourceAttribute.timeout_value


Resolver: TypeAlias = Callable[[str], SimulatedInstruments]
"""Makes the simulated bench of a bench file's path, of the embedded paper bench for ""."""


class SimVisaLibrary(highlevel.VisaLibraryBase):
    """The library object of one simulated bench; :meth:`register` benches before opening them by handle."""

    maker: ClassVar[str] = "simrack"
    _benches: ClassVar[dict[str, VisaBench]] = {}
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
        cls._benches[handle] = VisaBench(instruments, clock)

    @classmethod
    def unregister(cls, handle: str) -> None:
        """Forget the bench `handle`; sessions that are open stay usable."""
        cls._benches.pop(handle, None)

    @classmethod
    def install_resolver(cls, resolver: Resolver) -> None:
        """Use `resolver` for benches that are not registered; the last installed one is used."""
        cls._resolvers.append(resolver)

    @staticmethod
    def get_library_paths() -> Iterable[LibraryPath]:
        """Return the one path of the embedded bench."""
        return (LibraryPath(_EMBEDDED),)

    @classmethod
    def get_debug_info(cls) -> dict[str, str]:
        """Return the lines of `pyvisa-info`."""
        return {"Backend": f"simulated instruments of {cls.maker}"}

    def _init(self) -> None:
        self._sessions: dict[int, OpenSession] = {}
        self._numbers = count(1)
        self._announced: dict[int, Announcements] = {}
        self._resolved: VisaBench | None = None
        self._manager: VISARMSession | None = None

    # --- benches and sessions -----------------------------------------------------------------------------

    def _bench(self) -> VisaBench:
        """Return the bench of this library; OSError when nobody knows it."""
        handle = str(self.library_path)
        if handle in self._benches:
            return self._benches[handle]
        if self._resolved is None:
            if not self._resolvers:
                raise OSError(f"no simulated bench {handle!r} is registered")
            self._resolved = VisaBench(*self._resolvers[-1]("" if handle == _EMBEDDED else handle))
        return self._resolved

    @property
    def clock(self) -> Clock:
        """Bench time of this library's bench: ``sleep_until`` lets it pass, where ``time.sleep`` may not."""
        return self._bench().clock

    def _session(self, session: int) -> OpenSession:
        try:
            return self._sessions[session]
        except KeyError:
            raise errors.VisaIOError(StatusCode.error_invalid_object) from None

    def _usable(self, session: VISASession) -> OpenSession:
        """Return the session if nobody else has locked its instrument."""
        opened = self._sessions.get(session) or self._session(session)
        place = opened.place
        if (place.owner is not None or place.sharers) and place.locked_against(session):
            raise errors.VisaIOError(StatusCode.error_resource_locked)
        if opened.bench.announced:  # before what is done now answers the request
            look_everywhere(opened.bench)
        return opened

    def _done(self, session: int, status: StatusCode = SUCCESS) -> StatusCode:
        return self.handle_return_value(cast("VISASession", session), status)

    def open_default_resource_manager(self) -> tuple[VISARMSession, StatusCode]:
        """Open the resource manager; a missing bench is an error at once."""
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
        self._sessions[number] = OpenSession(bench, place, self.maker)
        if access_mode == constants.AccessModes.exclusive_lock:
            self.lock(number, constants.Lock.exclusive, 0)
        return number, self._done(number)

    def close(self, session: VISASession | VISAEventContext | VISARMSession) -> StatusCode:
        """Close a session, an event context or the resource manager, whose bench ends unless it was registered."""
        if session == self._manager:
            self._resolved = None
        if session in self._announced:
            self._announced.pop(session).disable(constants.EventMechanism.all)
        closed = self._sessions.pop(session, None)
        if closed is not None:
            closed.place.owner = None if closed.place.owner == session else closed.place.owner
            closed.place.sharers.discard(cast("VISASession", session))
        self._last_status_in_session.pop(session, None)
        return SUCCESS

    def list_resources(self, session: VISARMSession, query: str = "?*::INSTR") -> tuple[str, ...]:
        """Return the names of the bench's instruments that match the VISA expression `query`."""
        del session
        return rname.filter([place.name for place in self._bench().places.values()], query)

    # --- messages -----------------------------------------------------------------------------------------

    def write(self, session: VISASession, data: bytes) -> tuple[int, StatusCode]:
        """Send bytes, with END after the last unless the session says otherwise."""
        opened = self._usable(session)
        with opened.bench.lock:
            opened.write(data, end=opened.sends_end)
        if opened.bench.announced:
            look_everywhere(opened.bench)
        self._last_status = self._last_status_in_session[session] = SUCCESS
        return len(data), SUCCESS

    def read(self, session: VISASession, count: int) -> tuple[bytes, StatusCode]:
        """Receive up to `count` bytes of the next response; waits in bench time, at most the session's time-out."""
        opened = self._usable(session)
        terminator = opened.terminator
        if not opened.rest:
            with opened.bench.lock:
                data, end = opened.read(count)
            if end and not opened.stream and (terminator is None or data.find(terminator) in (-1, len(data) - 1)):
                # what nearly every read is: a whole response, as it came
                self._last_status = self._last_status_in_session[session] = SUCCESS
                return data, SUCCESS
            opened.rest, opened.offset, opened.ended = data, 0, end
        data, status = self._collect(opened, count, terminator)
        if opened.bench.announced:
            look_everywhere(opened.bench)
        if status is not SUCCESS:
            return data, self._done(session, status)
        self._last_status = self._last_status_in_session[session] = status
        return data, status

    def _collect(self, opened: OpenSession, count: int, terminator: int | None) -> tuple[bytes, StatusCode]:
        """Put a read together from the bytes there and those that come before the time-out."""
        deadline = opened.bench.clock.now() + opened.timeout_s
        parts: list[bytes] = []
        if not opened.rest and not self._await(opened, count, deadline):
            return b"", StatusCode.error_timeout
        while True:
            part, status = take_arrived(opened, count, terminator)
            parts.append(part)
            count -= len(part)
            if status is not None:
                return b"".join(parts), status
            if not self._fetch(opened, count) and not self._await(opened, count, deadline):
                return b"".join(parts), StatusCode.error_timeout

    @staticmethod
    def _fetch(opened: OpenSession, count: int) -> bool:
        """Take the device's present bytes; False when there are none."""
        with opened.bench.lock:
            opened.rest, opened.ended = opened.read(count)
        opened.offset = 0
        return bool(opened.rest)

    def _await(self, opened: OpenSession, count: int, deadline: float) -> bool:
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
    def _will_act(opened: OpenSession) -> bool:
        """Return True if a device will do something by itself; it is not waited for for ever where it will not."""
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
        opened = self._usable(session)
        if opened.stream:
            self._drain(opened)
        else:
            opened.drop_buffer()
            with opened.bench.lock:
                opened.place.device.clear()
        return self._done(session)

    @staticmethod
    def _drain(opened: OpenSession) -> None:
        opened.drop_buffer()
        with opened.bench.lock:
            while opened.read(1 << 20)[0]:
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
        look_everywhere(opened.bench)
        return self._done(session)

    def gpib_control_ren(self, session: VISASession, mode: constants.RENLineOperation) -> StatusCode:
        """Accept: the simulated front panels have no keys to lock."""
        del mode
        self._addressed(session)
        return self._done(session)

    def _addressed(self, session: VISASession) -> OpenSession:
        """Return the session if its interface can address a device out of band."""
        opened = self._usable(session)
        if opened.stream:
            raise errors.VisaIOError(StatusCode.error_nonsupported_operation)
        return opened

    # --- locks --------------------------------------------------------------------------------------------

    def lock(
        self, session: VISASession, lock_type: constants.Lock, timeout: int, requested_key: str | None = None
    ) -> tuple[str, StatusCode]:
        """Take a lock at once, or fail; a shared one is given to every client with any key."""
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
        """Release a lock, the exclusive one first."""
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
        known = known_attribute(opened, attribute)
        if attribute == ResourceAttribute.resource_manager_session:
            return self._manager, self._done(session)
        if attribute == ResourceAttribute.resource_lock_state:
            return opened.place.lock_state(), self._done(session)
        if attribute == ResourceAttribute.asrl_avalaible_number:
            return available(opened), self._done(session)
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
            self._last_status = self._last_status_in_session[session] = SUCCESS
            return SUCCESS
        if not known_attribute(opened, attribute).write:
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
        """Announce service requests, on the queue or to the handlers; nothing else is announced."""
        del context
        announcements, opened = self._announcements(session, event_type), self._addressed(session)
        announcements.enable(mechanism)
        look_everywhere(opened.bench)
        return self._done(session)

    def disable_event(
        self, session: VISASession, event_type: constants.EventType, mechanism: constants.EventMechanism
    ) -> StatusCode:
        """Announce no more; what is queued stays."""
        self._announcements(session, event_type).disable(mechanism)
        return self._done(session)

    def discard_events(
        self, session: VISASession, event_type: constants.EventType, mechanism: constants.EventMechanism
    ) -> StatusCode:
        """Forget what is queued."""
        announcements = self._announcements(session, event_type)
        announcements.queued = 0 if mechanism & constants.EventMechanism.queue else announcements.queued
        return self._done(session)

    def wait_on_event(
        self, session: VISASession, in_event_type: constants.EventType, timeout: int
    ) -> tuple[constants.EventType, VISAEventContext, StatusCode]:
        """Wait in bench time until the instrument requests service."""
        endless = timeout == constants.VI_TMO_INFINITE
        self._announcements(session, in_event_type).wait(math.inf if endless else timeout / 1e3)
        return EventType.service_request, VISAEventContext(next(self._numbers)), self._done(session)

    def install_handler(
        self, session: VISASession, event_type: constants.EventType, handler: Any, user_handle: Any
    ) -> tuple[Any, Any, Any, StatusCode]:
        """Have `handler` called at each service request once that is enabled."""
        self._announcements(session, event_type).handlers.append((handler, user_handle))
        return handler, user_handle, handler, self._done(session)

    def uninstall_handler(
        self, session: VISASession, event_type: constants.EventType, handler: Any, user_handle: Any = None
    ) -> StatusCode:
        """Remove `handler`."""
        self._announcements(session, event_type).handlers.remove((handler, user_handle))
        return self._done(session)

    def _announcements(self, session: VISASession, event_type: constants.EventType) -> Announcements:
        require_kind(event_type)
        opened = self._session(session)
        if session not in self._announced:
            self._announced[session] = Announcements(session, opened, self._numbers)
        return self._announced[session]
