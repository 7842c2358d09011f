"""Every language on wires that bring its bytes as serial lines and gateways do: singly, in pairs, in packets."""

from __future__ import annotations

from collections import deque
from itertools import product
from typing import TYPE_CHECKING, Any

import pytest

from tests.cells import few
from tests.drivers.rate_table import DIALECTS
from tests.drivers.rate_table.test_dialects import Bench
from vcfbench.clock import Deadline, VirtualClock
from vcfbench.drivers.rate_table.dialect import TableDialect, TableSettings
from vcfbench.drivers.rate_table.driver import RateTableDriver
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.drivers.trace import BEHIND
from vcfbench.errors import DeadlineExceeded, InstrumentError, LimitError
from vcfbench.interfaces import Identity

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from vcfbench.clock import Clock
    from vcfbench.drivers.trace import Connect
    from vcfbench.drivers.wire import Interface, Wire

PACES = {"singly": 1, "in pairs": 2, "in 16-ms packets": 15}
"""Bytes of a piece."""
GREETINGS = {
    "nothing": b"",
    "a bare line end": b"\r\n",
    "half a line end": b"\n",
    "words": b"Acme gateway 2.1\r\nport 3 ready\r\n",
    "telnet": b"\xff\xfd\x03\xff\xfb\x01\xff\xfb\x03",
}
WAYS = tuple(product(PACES, GREETINGS))


class PacedWire:
    """A wire that brings what came over another in pieces, each its time after the one before."""

    interface: Interface = "serial"

    def __init__(self, wire: Wire, clock: Clock, pace: tuple[int, float], greeting: bytes = b"") -> None:
        self._wire = wire
        self._clock = clock
        self._size, self._gap_s = pace
        self._free_s = clock.now()
        self._coming: deque[tuple[float, bytes]] = deque()
        self._take(greeting)

    def _take(self, data: bytes) -> None:
        for start in range(0, len(data), self._size):
            self._free_s = max(self._free_s, self._clock.now()) + self._gap_s
            self._coming.append((self._free_s, data[start : start + self._size]))

    def send(self, data: bytes, deadline: Deadline) -> None:
        self._wire.send(data, deadline)

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        while True:
            if not self._coming:
                self._take(self._wire.receive(deadline)[0])
            if self._coming[0][0] <= self._clock.now():
                return self._coming.popleft()[1], False
            if self._coming[0][0] > deadline.expires_s:
                self._clock.sleep_until(deadline.expires_s)
                raise DeadlineExceeded("no answer")
            self._clock.sleep_until(self._coming[0][0])

    def pending(self) -> bytes:
        self._take(self._wire.pending())
        data = b""
        while self._coming and self._coming[0][0] <= self._clock.now():
            data += self._coming.popleft()[1]
        return data

    def clear(self, deadline: Deadline) -> None:
        self._wire.clear(deadline)

    def close(self) -> None:
        self._wire.close()


@pytest.fixture
def paced(request: pytest.FixtureRequest, name: str) -> Iterator[None]:
    pace, greeting = request.param
    byte_s = 0.0 if name in ("ruya", "aaaa") else 10.0 / 9600.0  # who never falls silent is cut, and not held up

    def behind(_name: str, _resource: str, clock: Clock, connect: Connect) -> Connect:
        return lambda deadline: PacedWire(
            connect(deadline), clock, (PACES[pace], PACES[pace] * byte_s), GREETINGS[greeting]
        )

    token = BEHIND.set((*BEHIND.get(), behind))
    yield
    BEHIND.reset(token)


def beyond(language: Any, line: TableLine, soon: Deadline) -> None:
    language.demand_rate(line, 1e5, 100.0, soon)


REFUSED: dict[str, Callable[[Any, TableLine, Deadline], object]] = {
    "acl": lambda language, line, soon: language.command(line, ":Demand:Nonsense 1,0", soon),
    "esp": lambda language, line, soon: language._command(line, "1XX5", soon),
    "zaber": lambda language, line, soon: language._ask(line, "get nonsense", soon),
    "atl": lambda language, line, soon: language._command(line, "XYZ1", soon),
}


@pytest.mark.parametrize(
    ("paced", "name"),
    few(
        product(WAYS, DIALECTS), *((way, name) for each, way in enumerate(WAYS) for name in [*DIALECTS][each % 8 :: 8])
    ),
    indirect=["paced"],
    ids=lambda each: each if isinstance(each, str) else " after ".join(each),
)
@pytest.mark.usefixtures("paced")
def test_an_answer_belongs_to_its_question_however_its_bytes_come(name: str) -> None:
    bench = Bench(name)
    bench.driver.enable()
    bench.reach(10.0)
    for _ in range(8):
        line, refused = bench.driver.line, REFUSED.get(name, beyond)
        with pytest.raises((InstrumentError, LimitError)):
            refused(bench.driver.dialect, line, line.deadline())
        assert bench.driver.rate_deg_s() == pytest.approx(10.0, abs=2e-3)
        before_deg = bench.world.table.angle_deg()
        angle_deg = bench.driver.angle_deg()
        turned_deg = bench.world.table.angle_deg() - before_deg
        assert -0.5 <= (angle_deg - before_deg + 180.0) % 360.0 - 180.0 <= turned_deg + 0.5
        bench.driver.check_errors()
    report = bench.driver.make_safe(Deadline.after(bench.clock, 20.0))
    assert report.safe, report.detail
    assert not bench.world.table.servo_closed


def test_late_line_feed_belongs_to_carriage_return() -> None:
    clock = VirtualClock()
    wire = Answering(clock, b"12.5\r")
    line = TableLine(wire, name="t", resource="x", clock=clock, timeout_s=1.0)
    assert line.take_line(line.deadline()) == b"12.5"
    wire.coming += [b"\n7\r\n\r", b"\n", b"\n8\n"]
    assert [line.take_line(line.deadline()) for _ in range(4)] == [b"7", b"", b"", b"8"]


class Answering:
    """A table that answers each line; without an angle of its own it stands wherever it turned to."""

    interface: Interface = "serial"

    def __init__(self, clock: Clock, *said: bytes) -> None:
        self.demand_deg_s = self.rate_deg_s = 0.0
        self.servo = False
        self._clock = clock
        self.coming: list[bytes] = list(said)

    def send(self, data: bytes, deadline: Deadline) -> None:
        del deadline
        for command in data.decode("ascii").split():
            self.coming.append(f"{self._answer(command)}\r\n".encode("ascii"))

    def _answer(self, command: str) -> str:
        match command[0], command[1:]:
            case "V", "?":
                return f"{self.rate_deg_s:.3f}"
            case "S", "?":
                return str(int(self.servo))
            case "I", "?":
                return "Acme 7"
            case "P", "?":
                return "1.25"
            case "V", value:
                self.rate_deg_s = float(value)
            case "S", value:
                self.servo = value == "1"
            case _:
                return "ERR"
        return "OK"

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        if not self.coming:
            self._clock.sleep_until(deadline.expires_s)
            raise DeadlineExceeded("no answer")
        return self.coming.pop(0), False

    def pending(self) -> bytes:
        data, self.coming = b"".join(self.coming), []
        return data

    def clear(self, deadline: Deadline) -> None: ...

    def close(self) -> None: ...


class AskingDialect(TableDialect):
    """A language as its author writes it from the seam alone."""

    rate_quantum_deg_s = 1e-3

    def said(self, line: TableLine, message: str, deadline: Deadline) -> str:
        return line.ask(self, message.encode("ascii") + b"\r\n", deadline)

    def done(self, line: TableLine, message: str, deadline: Deadline) -> None:
        if (answer := self.said(line, message, deadline)) != "OK":
            raise InstrumentError(f"refused ({answer})")

    def identify(self, line: TableLine, deadline: Deadline) -> Identity:
        maker, model = self.said(line, "I?", deadline).split()
        return Identity(maker, model, "", "")

    def stop_words(self, acceleration_deg_s2: float | None) -> tuple[bytes, ...]:
        del acceleration_deg_s2
        return (b"\r\nV0\r\n",)

    def close_servo(self, line: TableLine, deadline: Deadline) -> None:
        self.done(line, "V0", deadline)
        self.done(line, "S1", deadline)

    def hold(self, line: TableLine, deadline: Deadline) -> None:
        self.done(line, "V0", deadline)

    def open_servo(self, line: TableLine, deadline: Deadline) -> None:
        self.done(line, "S0", deadline)

    def demand_rate(self, line: TableLine, rate_deg_s: float, acceleration_deg_s2: float, deadline: Deadline) -> None:
        del acceleration_deg_s2
        self.done(line, f"V{rate_deg_s:.3f}", deadline)

    def servo_closed(self, line: TableLine, deadline: Deadline) -> bool:
        return self.said(line, "S?", deadline) == "1"

    def at_rate(self, line: TableLine, deadline: Deadline) -> bool:
        del line, deadline
        return True

    def rate_deg_s(self, line: TableLine, deadline: Deadline) -> float:
        return float(self.said(line, "V?", deadline))

    def angle_deg(self, line: TableLine, deadline: Deadline) -> float:
        return float(self.said(line, "P?", deadline))


class SpeltOutDialect(AskingDialect):
    """The same of an author who only sends and takes lines."""

    def said(self, line: TableLine, message: str, deadline: Deadline) -> str:
        line.send(message.encode("ascii") + b"\r\n", deadline)
        return line.take_line(deadline).decode("ascii")


@pytest.mark.parametrize("language", [AskingDialect, SpeltOutDialect])
@pytest.mark.parametrize("pace", PACES)
def test_language_with_protocol_alone_works_on_healthy_table(language: type[AskingDialect], pace: str) -> None:
    clock = VirtualClock()
    table = Answering(clock)
    wire = PacedWire(table, clock, (PACES[pace], PACES[pace] / 960.0))
    line = TableLine(wire, name="rate_table", resource="x", clock=clock, timeout_s=2.0)
    driver = RateTableDriver(line, language(), TableSettings(300.0, 100.0))
    driver.enable()
    for rate_deg_s in (10.0, -20.5, 128.0):
        driver.set_rate(rate_deg_s, 50.0)
        for _ in range(5):
            assert driver.rate_deg_s() == rate_deg_s
            assert driver.angle_deg() == 1.25
        driver.command_safe()
        assert driver.rate_deg_s() == 0.0
        with pytest.raises(InstrumentError, match=r"rate_table at x: refused \(ERR\), command 'X'"):
            driver._command(lambda on, deadline: driver.dialect.done(on, "X", deadline))
        assert driver.angle_deg() == 1.25
    driver.set_rate(50.0, 50.0)
    report = driver.make_safe(Deadline.after(clock, 20.0))
    assert report.safe, report.detail
    assert not table.servo
