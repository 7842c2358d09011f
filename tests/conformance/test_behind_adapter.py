"""The same entries and conversations with each instrument behind a GPIB adapter, through this program's own wire."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

import pytest
from simrack.gpib_adapter import GpibAdapter
from simrack_tests.cells import few

from tests.conformance import test_exchanges, test_walk, walk
from tests.conformance.walk import Bench
from vcfbench.clock import Deadline
from vcfbench.drivers.gpib_adapter import GpibWire, _Adapter
from vcfbench.errors import DeadlineExceeded

if TYPE_CHECKING:
    from collections.abc import Callable

    from simrack.attendance import AttendedClock

ADDRESS = 7
ON_GPIB = (*walk.MODELS, *walk.SUCCESSORS)
"""All with an expectation file: each of them can have GPIB, some as an option or by a module."""
PLENTY_S = 100.0
CHECKS = (
    test_walk.test_reset_state_is_the_manuals,
    test_walk.test_arguments_are_taken,
    test_walk.test_actions_are_taken,
    test_walk.test_queries_with_an_argument_are_answered,
    test_walk.test_arguments_are_refused_and_change_nothing,
    test_walk.test_arguments_are_clipped_and_reported,
    test_walk.test_queries_are_refused,
    test_walk.test_power_on_state_is_the_reset_state,
)


class Stream:
    """The adapter's own bytes: a wait for them takes bench time, and ends where nothing more can come."""

    def __init__(self, adapter: GpibAdapter, clock: AttendedClock) -> None:
        self._adapter, self._clock = adapter, clock

    def send(self, data: bytes, _deadline: Deadline) -> None:
        self._adapter.write(data)

    def receive(self, _deadline: Deadline) -> tuple[bytes, bool]:
        while not (part := self._adapter.read(1 << 16)[0]):
            wake_s = self._adapter.wake_at()
            if wake_s is None:
                raise DeadlineExceeded("nothing comes")
            self._clock.sleep_until(wake_s)
        return part, False

    def close(self) -> None:
        pass


class Behind(Bench):
    """An instrument behind an adapter, and the controller that reaches it by the adapter's words alone."""

    def __init__(self, bench: Bench) -> None:
        super().__init__(bench.device, bench.clock)
        stream: Any = Stream(GpibAdapter({ADDRESS: bench.device}, bench.clock), bench.clock)
        self._wire = GpibWire(_Adapter(stream, self._within()), b"%d" % ADDRESS)
        self._begun = bytearray()
        this: Any = self
        self.device = this  # its clear, trigger and status byte go the same way

    def send(self, data: bytes, *, end: bool) -> None:
        self._begun += data
        if end or data.endswith(b"\n"):
            self._wire.send(bytes(self._begun), self._within())
            self._begun.clear()

    def read(self, timeout_s: float = PLENTY_S) -> str | None:
        deadline, answer = self._within(timeout_s), bytearray()
        while not answer.endswith(b"\n"):
            try:
                answer += self._wire.receive(deadline)[0]
            except DeadlineExceeded:
                return None
        return answer.decode("latin-1").removesuffix("\n")

    def clear(self) -> None:
        self._begun.clear()
        self._wire.clear(self._within())

    def trigger(self) -> None:
        self._wire._open.say(b"++addr %d\n++trg\n" % ADDRESS, self._within())

    def status_byte(self) -> int | None:
        return self._wire.status_byte(self._within())

    def _within(self, timeout_s: float = PLENTY_S) -> Deadline:
        return Deadline.after(self.clock, timeout_s)


@pytest.fixture(autouse=True)
def behind_an_adapter(monkeypatch: pytest.MonkeyPatch) -> None:
    direct = walk.bench

    def behind(model: str, interface: str = "gpib") -> Bench:
        return Behind(direct(model)) if interface == "gpib" else direct(model, interface)

    monkeypatch.setattr(walk, "bench", behind)
    monkeypatch.setattr(test_walk, "instrument", cache(behind))


@pytest.mark.parametrize("model", few(ON_GPIB, "hp34401a"))
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: str(check.__qualname__))
def test_entries_hold_behind_an_adapter(model: str, check: Callable[[str], None]) -> None:
    check(model)


@pytest.mark.parametrize("model", few(ON_GPIB, "hp34401a"))
def test_exchanges_hold_behind_an_adapter(model: str) -> None:
    test_exchanges.test_exchanges(model, "short")
