"""Finds instruments: lists VISA resources and serial ports, and asks each for its identity.

Nothing is sent to a serial port unless that is asked for: what is on it is not known, and a byte can move a table.
"""

import re
import warnings
from collections.abc import Callable, Sequence
from contextvars import copy_context
from itertools import product
from typing import Any, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from vcfbench.clock import Deadline, WallClock, within
from vcfbench.drivers.rate_table.acl import take_counted
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.drivers.serial_wire import Link, serial_port
from vcfbench.drivers.session import Session, visa_resource
from vcfbench.drivers.wire import SerialLine, adapters, behind, is_simulated
from vcfbench.errors import BenchError, ConnectFailed, DeadlineExceeded, TransportError
from vcfbench.models import find_language, find_model, recognised
from vcfbench.station.writing import value_text

_T = TypeVar("_T")

_REAL = "@py"
_SOCKET = re.compile(r"TCPIP\d*::(?P<host>[^:]+)::(?P<port>\d+)::SOCKET", re.IGNORECASE)
_GRACE_S = 2.0
_LISTING_S = 10.0
_BAUD_RATES = (9600, 115_200, 19_200)
"""As controllers and instruments are shipped: 9600 the older ones, 115200 Zaber's, 19200 Newport's (unverified)."""

_QUESTIONS = (b"*IDN?\n", b"/get deviceid\n", b"VE?\r")
"""Instruments and ACL tables, Zaber, Newport: each only reads, and whom it is not meant for refuses it."""


class DiscoveredInstrument(Struct, frozen=True):
    """A resource and the instrument that answers there.

    `answer` are its words, `model` the model or dialect that a bench file can name (None: not recognised), `problem`
    why it said nothing, `baud_rate` the speed of a serial port at which it was asked.
    """

    resource: str
    answer: str | None = None
    model: str | None = None
    problem: str | None = None
    baud_rate: int | None = None

    @property
    def serial_number(self) -> str | None:
        """The serial number in the answer; "" of models that answer 0."""
        fields = (self.answer or "").split(",")
        number = fields[2].strip() if len(fields) >= 4 else ""
        return number if number not in {"", "0"} else None


class SerialPort(Struct, frozen=True):
    """A serial port of this computer; `found` is the instrument that answers, None when it was not asked."""

    port: str
    description: str
    found: DiscoveredInstrument | None


class Discovery(Struct, frozen=True):
    """Everything that was found, and the resources that were asked for by name."""

    library: str
    resources: tuple[DiscoveredInstrument, ...]
    serial_ports: tuple[SerialPort, ...]
    tried: tuple[DiscoveredInstrument, ...]

    def answering(self) -> list[DiscoveredInstrument]:
        """Return the instruments that answered, wherever they were."""
        asked = [port.found for port in self.serial_ports if port.found is not None]
        return [each for each in (*self.resources, *asked, *self.tried) if each.answer is not None]


def discover(
    library: str, tries: Sequence[str] = (), *, timeout_s: float = 1.0, serial_probe: bool = False
) -> Discovery:
    """Return the instruments on the resources of the VISA `library`, on serial ports, and on those in `tries`.

    Each resource is given `timeout_s` of wall time. Serial ports are asked only for `serial_probe`. What is in `tries`
    was named by a person: it is asked wherever it is, and is real whatever the library.

    Raises:
        BenchError: the library cannot be loaded.
    """
    names = _listed(library) + [
        f"GPIB{board}::{address}::INSTR"
        for board, adapter in adapters(library).items()
        for address in _occupied(adapter)
    ]
    ports = []
    if not is_simulated(library):
        from serial.tools import list_ports  # noqa: PLC0415  # loaded when first needed

        ports = [(port.device, port.description or "") for port in sorted(list_ports.comports())]
    # a resource on a serial port, an adapter on such a port included, is asked only by name
    safe = [each for each in names if each.upper().endswith(("::INSTR", "::SOCKET")) and "ASRL" not in each.upper()]
    asked = names if is_simulated(library) else safe
    real = _REAL if is_simulated(library) else library
    return Discovery(
        library,
        tuple(_ask(name, library, timeout_s) for name in asked),
        tuple(SerialPort(port, words, _ask_port(port, timeout_s) if serial_probe else None) for port, words in ports),
        tuple(_ask(name, real, timeout_s) if "::" in name else _ask_port(name, timeout_s) for name in tries),
    )


def _occupied(adapter: str) -> list[int]:
    """Return the addresses behind a GPIB adapter, which was named by a person; each is polled, and then asked."""
    from vcfbench.drivers.gpib_adapter import occupied  # noqa: PLC0415  # loaded when first needed

    try:
        return _within(_LISTING_S, lambda: occupied(adapter, Deadline.after(WallClock(), _LISTING_S)))
    except TransportError as error:
        error.resource = adapter
        raise


def _listed(library: str) -> list[str]:
    """Return the names of all resources; a library that lists for ever is given up."""
    import pyvisa  # noqa: PLC0415  # loaded when first needed

    def names() -> list[str]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # PyVISA-py tells every time which of its extras are not installed
            return sorted(set(pyvisa.ResourceManager(behind("", library)[1]).list_resources("?*")))

    try:
        return _within(_LISTING_S, names)
    except Exception as error:  # a VISA library is anyone's code
        raise BenchError(f"VISA library {library} cannot be used: {_words(error)}") from error


def _within(seconds: float, act: Callable[[], _T]) -> _T:
    """Run `act` in a thread, because a library's open may hang for ever; DeadlineExceeded when it does."""
    done: list[_T] = []
    failed: list[BaseException] = []
    context = copy_context()  # what is traced here, is there

    def run() -> None:
        try:
            done.append(context.run(act))
        except BaseException as error:  # noqa: BLE001  # it is raised again in the thread that waits
            failed.append(error)

    within(seconds, run)
    if failed:
        raise failed[0]
    if not done:
        raise DeadlineExceeded("the VISA library does not come back")
    return done[0]


def _ask(resource: str, library: str, timeout_s: float) -> DiscoveredInstrument:
    """Ask a VISA resource for its identity."""

    def answer() -> str:
        connect = visa_resource(resource, library, SerialLine() if resource.upper().startswith("ASRL") else None)
        clock = WallClock()
        with Session.opened(connect, name=resource, resource=resource, clock=clock, timeout_s=timeout_s) as session:
            return session.query("*IDN?")

    return _found(resource, answer, timeout_s)


def _found(resource: str, answer: Callable[[], str], timeout_s: float) -> DiscoveredInstrument:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # VISA libraries warn of what they then raise
            said = _within(2.0 * timeout_s + _GRACE_S, answer)
    except TransportError as error:
        return DiscoveredInstrument(resource, problem=error.what)
    except Exception as error:  # noqa: BLE001  # a VISA library is anyone's code, and one resource must not end it all
        return DiscoveredInstrument(resource, problem=_words(error))
    return DiscoveredInstrument(resource, said, recognise(said))


def _words(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _ask_port(url: str, timeout_s: float) -> DiscoveredInstrument:
    """Ask for the identity on a serial port, or on a URL of pyserial's, which has no speed."""
    found = DiscoveredInstrument(url, problem="no answer")
    speeds = _BAUD_RATES[:1] if "://" in url else _BAUD_RATES
    for baud_rate, question in product(speeds, _QUESTIONS):
        found = _found(url, lambda: _asked(url, baud_rate, question, timeout_s), timeout_s)  # noqa: B023  # run at once
        if found.answer is not None:
            return found if "://" in url else replace(found, baud_rate=baud_rate)
        if found.problem is not None and "cannot be opened" in found.problem:
            return found
    return found


def _asked(url: str, baud_rate: int, question: bytes, timeout_s: float) -> str:
    clock = WallClock()
    connect = serial_port(url, Link(baud=baud_rate), clock, timeout_s)
    line = TableLine.opened(connect, name=url, resource=url, clock=clock, timeout_s=timeout_s)
    try:
        deadline = Deadline.after(clock, timeout_s)
        line.take_unasked()
        line.send(question, deadline)
        counted = take_counted(line, deadline)  # which need not end as a line does
        reply = line.take_line(deadline) if counted is None else counted
        words = reply.decode("latin-1").strip()
        if not words or not (words.isascii() and words.isprintable()):
            raise ConnectFailed(f"the reply {reply[:20]!r} is not text")
        return words
    finally:
        line.close()


def recognise(answer: str) -> str | None:
    """Return the model or dialect for an identity in a bench file, or None."""
    if answer.startswith("@") and " OK " in answer:
        return "zaber"
    if answer.upper().startswith("ESP") and "VERSION" in answer.upper():
        return "esp"
    maker, comma, rest = answer.partition(",")
    if not comma:
        return None
    row = recognised(maker.strip(), rest.partition(",")[0].strip())
    return None if row is None else row.name


def stanza(discovery: Discovery) -> str:
    """Return the recognised instruments as a piece of a bench file; one that has no role left is there as a comment."""
    lines: list[str] = []
    if discovery.library != _REAL:
        lines += [f"visa_library = {value_text(discovery.library)}", ""]
    taken: set[str] = set()
    for found in discovery.answering():
        role = next((each for each in places(found.model) if each not in taken), None)
        taken |= {role or ""}
        if role is None:
            what = "not recognised" if found.model is None else f"another {found.model}"
            lines += [f"# {what}: {found.answer}", f"# resource = {value_text(found.resource)}", ""]
            continue
        lines.append(f"[{role}]  # {found.answer}")
        for key, value in taken_over(role, found).items():
            below = value if isinstance(value, dict) else {}
            lines += [f"{key}.{name} = {value_text(each)}" for name, each in below.items()]
            lines += [] if below else [f"{key} = {value_text(value)}"]
        if found.model == "zaber":
            lines.append("steps_per_deg = 0  # put the stage's microsteps per degree")
        if found.serial_number is not None and role != "rate_table":
            lines.append(f"# serial_number = {value_text(found.serial_number)}  # refuse any other instrument")
        lines.append("")
    return "\n".join(lines)


def places(model: str | None) -> tuple[str, ...]:
    """Return the places on a bench for an instrument recognised as `model`."""
    if model is None:
        return ()
    row = find_model(model)
    return ("rate_table",) if row is None else row.places


def taken_over(role: str, found: DiscoveredInstrument) -> dict[str, Any]:
    """Return the keys of `found` as `role` for a bench file: model or dialect, resource, an unusual speed."""
    table, resource, language = role == "rate_table", found.resource, find_language(found.model or "")
    if not table:
        resource = _as_visa(resource)
    elif socket := _SOCKET.fullmatch(resource):  # pyserial has a name of its own for it
        resource = f"socket://{socket['host']}:{socket['port']}"
    keys: dict[str, Any] = {"dialect" if table else "model": found.model or "", "resource": resource}
    if found.baud_rate not in {None, 9600 if language is None else language.baud_rate}:  # which need not be named
        keys |= {"baud_rate": found.baud_rate} if table else {"serial": {"baud_rate": found.baud_rate}}
    return keys


def _as_visa(resource: str) -> str:
    """Return the VISA name of a resource asked as a serial port; PyVISA-py calls Windows' COM3 ASRL3."""
    if "::" in resource:
        return resource
    host, colon, port = resource.removeprefix("socket://").rpartition(":")
    if resource.startswith("socket://") and colon:
        return f"TCPIP0::{host.strip('[]')}::{port}::SOCKET"
    return f"ASRL{resource[3:] if resource.upper().startswith('COM') else resource}::INSTR"
