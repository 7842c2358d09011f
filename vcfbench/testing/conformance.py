"""Duties of every driver, built in or custom; run it over a registry."""

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from vcfbench import interfaces
from vcfbench.clock import Deadline, VirtualClock
from vcfbench.drivers.session import Session
from vcfbench.drivers.wire import Interface, Wire
from vcfbench.errors import BenchError, DeadlineExceeded, InstrumentError, LinkLost
from vcfbench.models import Model, driver_of


@dataclass(frozen=True, slots=True)
class ConformanceCase:
    """A driver class, the protocol it fulfils, a function that opens it on a wire, and its instrument's answers.

    `answers` maps questions to answers while all is well; `refusal` are those to `error_question` when the
    instrument has refused something, `settled` is the one when it has nothing more to say.
    """

    model: str
    driver_class: type
    protocol: type
    open_on: Callable[[Wire, VirtualClock], Any]
    answers: dict[str, str]
    error_question: str
    refusal: tuple[str, ...]
    settled: str


def model_case(row: Model) -> ConformanceCase:
    """Return the case of the SCPI driver in `row`."""
    driver_class = driver_of(row)
    answers = {question: answer for question, answer in row.answers.items() if question != driver_class.error_question}
    protocol = _PROTOCOLS[row.roles[0]]
    if driver_class.error_question == "SYST:ERR?":
        return scpi_case(driver_class, protocol, answers)
    return scpi_case(driver_class, protocol, answers, refusal=("32",), settled="0")


_PROTOCOLS: Mapping[str, type] = MappingProxyType(
    {
        "power": interfaces.PowerSupply,
        "rate_source": interfaces.FunctionGenerator,
        "vibration_source": interfaces.FunctionGenerator,
        "multimeter": interfaces.Multimeter,
        "v_vc_meter": interfaces.Multimeter,
        "oscilloscope": interfaces.Oscilloscope,
        "chamber": interfaces.TemperatureChamber,
    }
)


def scpi_case(
    driver_class: Any,
    protocol: type,
    answers: dict[str, str],
    *,
    refusal: tuple[str, ...] = ('-222,"Data out of range"', '-113,"Undefined header"'),
    settled: str = '+0,"No error"',
) -> ConformanceCase:
    """Return the case of a SCPI driver that is called with a session.

    `answers` has at least ``*IDN?``, and what `make_safe` asks while all is well, by its beginning; every other
    question is answered by 1. `refusal` is what the error queue holds when something was refused.
    """
    return ConformanceCase(
        driver_class.model,
        driver_class,
        protocol,
        lambda wire, clock: driver_class(
            Session(wire, name="under test", resource="SCRIPT", clock=clock, timeout_s=1.0)
        ),
        answers,
        driver_class.error_question,
        refusal,
        settled,
    )


class _AnsweringWire:
    """Answers questions by their beginning, refuses everything or falls silent on demand."""

    def __init__(self, case: ConformanceCase, clock: VirtualClock) -> None:
        self.interface: Interface = "gpib"
        self.state = "well"
        self.queue: list[str] = []
        self.sent = b""
        self._case = case
        self._clock = clock
        self._answers = b""

    def send(self, data: bytes, deadline: Deadline) -> None:
        if self.state == "broken":
            raise LinkLost("the connection broke")
        self.sent += data
        message = data.decode("ascii").strip()
        if "?" not in message or self.state == "silent":
            return
        if message == self._case.error_question:
            answer = self.queue.pop(0) if self.queue else self._case.settled
        elif message == ":Status:STB?":
            answer = "128" if self.queue else "0"
        else:
            answer = next((said for known, said in self._case.answers.items() if message.startswith(known)), "1")
        self._answers += answer.encode("ascii") + b"\n"

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        if not self._answers:
            self._clock.sleep_until(deadline.expires_s)
            raise DeadlineExceeded("no answer")
        data, self._answers = self._answers, b""
        return data, True

    def pending(self) -> bytes:
        return b""

    def clear(self, deadline: Deadline) -> None:
        self._answers = b""

    def close(self) -> None:
        self.state = "broken"


def conformance_problems(case: ConformanceCase) -> list[str]:
    """Return the duties that `case`'s driver fails, in words; empty when it conforms."""
    return [
        *_contract_problems(case),
        *_documentation_problems(case),
        *_answer_problems(case),
        *_wire_problems(case),
        *_safety_problems(case),
        *_telling_problems(case),
    ]


def _contract_problems(case: ConformanceCase) -> Iterator[str]:
    for name in sorted({n for base in case.protocol.__mro__ for n in vars(base) if not n.startswith("_")}):
        expected, found = getattr(case.protocol, name), getattr(case.driver_class, name, None)
        if found is None:
            yield f"{name} is missing"
        elif inspect.isfunction(expected):
            wanted, given = inspect.signature(expected).parameters, inspect.signature(found).parameters
            extra = [p for n, p in given.items() if n not in wanted]
            if list(given)[: len(wanted)] != list(wanted) or any(p.default is p.empty for p in extra):
                yield f"{name} is called differently from the protocol's"


def _documentation_problems(case: ConformanceCase) -> Iterator[str]:
    for name, member in inspect.getmembers(case.driver_class):
        function = member.fget if isinstance(member, property) else member
        if name.startswith("_") or not inspect.isfunction(function):
            continue
        if not inspect.getdoc(function):
            yield f"{name} has no docstring"
        hints = function.__annotations__
        if set(inspect.signature(function).parameters) - {"self"} - set(hints) or "return" not in hints:
            yield f"{name} is not fully annotated"


def _opened(case: ConformanceCase) -> tuple[Any, _AnsweringWire, VirtualClock]:
    clock = VirtualClock()
    wire = _AnsweringWire(case, clock)
    return case.open_on(wire, clock), wire, clock


def _answer_problems(case: ConformanceCase) -> Iterator[str]:
    """Yield faults of the identity, and of the errors in the instrument's queue."""
    driver, _, _ = _opened(case)
    if not isinstance(driver.identify(), interfaces.Identity):
        yield "identify() does not return an Identity"
    if driver.name != "under test" or not driver.resource:
        yield "name or resource is not what it was opened with"
    driver, wire, _ = _opened(case)
    driver.check_errors()
    wire.queue = list(case.refusal)
    error = _caught(driver.check_errors)
    if not isinstance(error, InstrumentError):
        yield f"a filled error queue gave {error!r}, not an InstrumentError"
    elif not all(refusal.split(",")[0] in str(error) for refusal in case.refusal) or "under test" not in str(error):
        yield f"the error {error} does not name instrument and all entries"
    if wire.queue:
        yield "check_errors() does not read the queue to its end"


def _caught(call: Callable[[], object]) -> BenchError | None:
    try:
        call()
    except BenchError as error:
        return error
    return None


def _wire_problems(case: ConformanceCase) -> Iterator[str]:
    for state, kind in (("silent", DeadlineExceeded), ("broken", LinkLost)):
        driver, wire, _ = _opened(case)
        wire.state = state
        error = _caught(driver.identify)
        if not isinstance(error, kind) and not (state == "silent" and type(error).__name__ == "OutOfSync"):
            yield f"a {state} wire gave {error!r}, not a {kind.__name__}"
        elif error is None or "under test" not in str(error):
            yield f"the error of a {state} wire does not name the instrument"


def _telling_problems(case: ConformanceCase) -> Iterator[str]:
    switches = ("enable_outputs", "enable_output", "enable_flow", "set_rate")
    drives = any(hasattr(case.driver_class, switch) for switch in switches)
    for state in ("well", "silent", "broken"):
        driver, wire, _ = _opened(case)
        wire.state, wire.sent = state, b""
        try:
            outcome = driver.command_safe()
        except Exception as error:  # noqa: BLE001  # the driver under test is anyone's code
            outcome = error
        if not isinstance(outcome, interfaces.UnprovedCommand):
            yield f"on a wire that is {state}, command_safe() told {outcome!r}"
        elif drives and state != "broken" and not (outcome.sent and wire.sent):
            yield f"on a wire that is {state}, command_safe() sent nothing"
        elif b"?" in wire.sent:
            yield f"on a wire that is {state}, command_safe() asked {wire.sent!r}"


def _safety_problems(case: ConformanceCase) -> Iterator[str]:
    for state, expected in (("well", True), ("silent", False), ("broken", False)):
        driver, wire, clock = _opened(case)
        wire.state = state
        deadline = Deadline.after(clock, 30.0)
        report = driver.make_safe(deadline)
        if not isinstance(report, interfaces.SafeReport) or report.safe is not expected:
            yield f"on a wire that is {state}, make_safe() reported {report}"
        if clock.now() > deadline.expires_s + 5.0:
            yield f"on a wire that is {state}, make_safe() took {clock.now():g} s of 30 s"
