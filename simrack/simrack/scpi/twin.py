"""Base of a simulated SCPI instrument: a device that hands everything to its engine."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable
from functools import partial

from simrack.scpi.engine import ScpiEngine


class ScpiTwin:
    """Base of simulated SCPI instruments: a :class:`~simrack.device.Device` around an engine.

    A model sets `engine` in its constructor and overrides what it has of :class:`ScpiModel`.
    """

    engine: ScpiEngine

    # what comes with every message and whenever time passes is the engine's own, kept by those who call it often

    @property
    def write(self) -> Callable[..., None]:
        """Take bytes from the controller."""
        return self.engine.write

    @property
    def read(self) -> Callable[[int], tuple[bytes, bool]]:
        """Return at most `limit` bytes that are ready, and True if END comes with the last."""
        return self.engine.read

    @property
    def wake_at(self) -> Callable[[], float | None]:
        """Return when something happens by itself."""
        return self.engine.wake_at

    def clear(self) -> None:
        """Device clear."""
        self.engine.clear()

    def status_byte(self) -> int:
        """Return the status byte, as a serial poll does."""
        return self.engine.status_byte()

    def requests_service(self) -> bool:
        """True if the instrument pulls SRQ."""
        return self.engine.requests_service()

    def trigger(self) -> None:
        """Group execute trigger."""
        self.engine.trigger()

    def identity(self) -> str:
        """Return the answer to *IDN?."""
        raise NotImplementedError

    def reset(self) -> None:
        """Take the *RST state."""
        raise NotImplementedError

    def service(self) -> None:
        """Bring everything that happens by itself up to now; by default nothing does."""

    def next_event_s(self) -> float | None:
        """Return when :meth:`service` next has something to do."""
        return None

    def abort(self) -> None:
        """End the running measurement; by default there is none."""

    def operations_end_s(self) -> float:
        """Return when pending operations end; by default none is pending."""
        return -math.inf


_SERIAL_NUMBER = re.compile(r"([^,]*,[^,]*,(?!0,)[^,]*?)(\d+),")


def tell_apart(devices: Iterable[object]) -> None:
    """Give each instrument of a bench a serial number of its own, by its place among those of the same; 0 is none."""
    before = Counter[str]()
    for device in devices:
        if isinstance(device, ScpiTwin):
            serial = "".join(device.identity().split(",")[2:3])
            device.identity = partial(_counted_on, device.identity, before[serial])  # type: ignore[method-assign]
            before[serial] += 1


def _counted_on(identity: Callable[[], str], further: int) -> str:
    return _SERIAL_NUMBER.sub(
        lambda found: f"{found[1]}{int(found[2]) + further:0{len(found[2])}},", identity(), count=1
    )
