"""Service requests as VISA announces them: on a queue, or to handlers (VPP-4.3, section 3.7).

An event is a request that begins; one that is there when announcing is enabled counts. Where time is simulated
handlers are called amid whatever call lets it pass; where it runs by itself by a thread, as elsewhere.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterator
from threading import Event, Thread
from typing import Any, cast

from pyvisa import errors
from pyvisa.constants import VI_SUCCESS_NCHAIN, EventMechanism, EventType, StatusCode
from pyvisa.typing import VISAEventContext, VISASession

from simrack.wires.visa_session import OpenSession, VisaBench

Handler = Callable[[VISASession, EventType, VISAEventContext, Any], Any]
_LOOK_S = 0.005
"""Wall time between the looks of the thread."""
_KINDS = {EventType.service_request, EventType.all_enabled}


class Announcements:
    """Service requests of a session's instrument."""

    def __init__(self, session: VISASession, opened: OpenSession, contexts: Iterator[int]) -> None:
        self._session, self._opened, self._contexts = session, opened, contexts
        self.handlers: list[tuple[Handler, Any]] = []
        self.mechanisms = 0
        """Those that are enabled."""
        self.queued = 0
        """Events that nobody has waited for yet."""
        self._requested = False

    def enable(self, mechanism: int) -> None:
        """Announce from now on; VisaIOError where no handler is there."""
        if mechanism == EventMechanism.suspend_handler:
            raise errors.VisaIOError(StatusCode.error_nonsupported_mechanism)
        if mechanism & EventMechanism.handler and not self.handlers:
            raise errors.VisaIOError(StatusCode.error_handler_not_installed)
        bench = self._opened.bench
        if not self.mechanisms:
            self._requested = False
            bench.announced.append(self)
        by_itself = not math.isinf(bench.clock.pace) and mechanism & EventMechanism.handler & ~self.mechanisms
        self.mechanisms |= mechanism
        if by_itself:
            Thread(target=self._keep_looking, name="service requests", daemon=True).start()

    def disable(self, mechanism: int) -> None:
        """Stop announcing events by a mechanism."""
        self.mechanisms &= ~mechanism
        if not self.mechanisms and self in self._opened.bench.announced:
            self._opened.bench.announced.remove(self)

    def look(self) -> None:
        """Announce a request that has begun since the last look."""
        with self._opened.bench.lock:
            requested = cast("Any", self._opened.place.device).requests_service()
            begun, self._requested = requested and not self._requested, requested
        if not begun:
            return
        if self.mechanisms & EventMechanism.queue:
            self.queued += 1
        if self.mechanisms & EventMechanism.handler:
            for handler, user in reversed(self.handlers):  # the last that was installed is called first
                context = VISAEventContext(next(self._contexts))
                if handler(self._session, EventType.service_request, context, user) == VI_SUCCESS_NCHAIN:
                    break

    def _keep_looking(self) -> None:
        pause = Event()
        while self.mechanisms & EventMechanism.handler and not pause.wait(_LOOK_S):
            try:
                self.look()
            except Exception:  # noqa: BLE001  (a handler is anyone's code, and the next request is to be heard too)
                traceback.print_exc()

    def wait(self, timeout_s: float) -> None:
        """Wait in bench time for an event and take it from the queue.

        Raises:
            VisaIOError: nothing is queued here, or none came in time.
        """
        if not self.mechanisms & EventMechanism.queue:
            raise errors.VisaIOError(StatusCode.error_not_enabled)
        clock, device = self._opened.bench.clock, self._opened.place.device
        deadline_s = clock.now() + timeout_s
        self.look()
        while not self.queued:
            with self._opened.bench.lock:
                wake_s = device.wake_at()
            instant_s = deadline_s if wake_s is None else min(wake_s, deadline_s)
            if clock.now() >= deadline_s or math.isinf(instant_s):
                raise errors.VisaIOError(StatusCode.error_timeout)
            clock.sleep_until(instant_s)
            self.look()
        self.queued -= 1


def require_kind(event: EventType) -> None:
    """Refuse other events than service requests."""
    if event not in _KINDS:
        raise errors.VisaIOError(StatusCode.error_invalid_event)


def look_everywhere(bench: VisaBench) -> None:
    """Announce what has begun on a bench."""
    for each in tuple(bench.announced):
        each.look()
