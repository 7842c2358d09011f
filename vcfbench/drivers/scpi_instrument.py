"""Base of the SCPI drivers: identity, errors, and making safe."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, ClassVar, Self

from msgspec import Struct

from vcfbench.arguments import require_number
from vcfbench.clock import Deadline, WallClock, sleep
from vcfbench.drivers import replies
from vcfbench.drivers.conversation import OverWire
from vcfbench.drivers.replies import ANY_NUMBER, NumberForm
from vcfbench.drivers.session import Session
from vcfbench.drivers.wire import SerialLine
from vcfbench.errors import (
    BenchError,
    ConnectFailed,
    FramingError,
    InstrumentError,
    LimitError,
    SettingChanged,
    WrongInstrument,
)
from vcfbench.interfaces import Identity, Instrument, SafeReport, UnprovedCommand
from vcfbench.models import HP_MAKERS, bare_model

_RETURN_S = 3.0
"""Wall time for which a connection that is gone is tried again and again: it may come back."""
_BETWEEN_S = 0.2
_UNKNOWN_HEADER = (-113, -114)
"""Undefined header, and one whose number is that of a channel which is not there."""
_ROUND_OFF = 1.0 + 1e-9
"""Of doubles, when a step of a resolution is held against it."""


class VisaSettings(Struct, frozen=True):
    """Settings of an instrument on VISA besides its resource."""

    timeout_s: float = 5.0
    serial: SerialLine | None = None
    serial_number: str | None = None
    mains_hz: float = 50.0
    probe: float = 1.0
    """What the probes of an oscilloscope divide by."""
    serial_pause_s: float | None = None
    """Pause after a command on RS-232; None is the model's own."""
    upon_connecting: Callable[[Session, tuple[str, ...]], None] | None = None
    """Called with the open session and the driver's safe words before anything is asked."""


class Left(Struct, frozen=True):
    """A setting that an earlier user may have changed: header, needed value, page of the manual.

    Header and value are templates. With `refused` it is not the driver's to set: it is asked for, and another answer
    than the value ends in these words.
    """

    header: str
    value: str
    source: str
    refused: str = ""


class ScpiInstrument(OverWire):
    """An instrument on a session.

    A driver adds its commands, its `make_safe`, for which there is no default, and, if it drives something, its
    `safe_words`.
    """

    model: ClassVar[str]

    safe_words: ClassVar[tuple[str, ...]] = ()
    """The commands that switch off its outputs. They are sent without looking at any answer, and more than once."""
    makers: ClassVar[tuple[str, ...]] = HP_MAKERS
    """Beginnings of the maker's name in ``*IDN?``, in capitals."""

    questions: ClassVar[tuple[tuple[str, NumberForm], ...]] = ()
    """Questions that runs depend on and that may always be asked, each with the form in which it is to be answered."""

    error_question: ClassVar[str] = "SYST:ERR?"
    """Question for refusals: the error queue, or ``*ESR?`` of an instrument that has none."""

    first_answer_s: ClassVar[float] = 0.0
    """Longest time of the first answer after connecting, s, where that is longer than the session's time-out."""

    serial_pause_s: ClassVar[float] = 0.0
    """Pause that the instrument needs after a command on RS-232, s."""

    def __init__(self, session: Session, *, serial_number: str | None = None) -> None:
        super().__init__(session)
        self._session = session
        self._taken_over: set[str] = set()
        self._kept: dict[str, tuple[Callable[[str], object], object]] = {}
        if self.error_question == "*ESR?":
            session.use_event_status()
        # Take over the instrument as it stands: end an earlier exchange, check the identity, drop old errors
        deadline = self._session.deadline(max(self._session.timeout_s, self.first_answer_s))
        self._session.clear(deadline)
        self._take_remote(deadline)
        found = self._identity(deadline)
        wanted = self.model if serial_number is None else f"{self.model} with serial number {serial_number}"
        right_model = bare_model(found.model) == self.model and found.maker.upper().startswith(self.makers)
        if not right_model or found.serial != (serial_number or found.serial):
            session.close()
            what = f"expected {wanted}, found {found.maker} {found.model}, serial number {found.serial}"
            raise self._error(WrongInstrument, what, hint="check the resource in the bench file")
        self._session.send("*CLS", deadline=deadline)
        session.declare_safe(*self._safe_words_here())

    @classmethod
    def opened(cls, session: Session, settings: VisaSettings) -> Self:
        """Return the driver on an open session; one that needs to know more of the station overrides this."""
        return cls(session, serial_number=settings.serial_number)

    @classmethod
    def of_model(cls, model: str, **own: Any) -> type[Self]:
        """Return the driver of a `model` with the class attributes in `own`."""
        return type(cls.__name__, (cls,), {"model": model, **own, "__doc__": cls.__doc__})

    def _disagreement(self, query: str, wanted: str, found: str) -> InstrumentError:
        return self._error(InstrumentError, f"was set to {wanted} but reads back {found}", query)

    def _read_back(
        self, query: str, sent: str, resolution: float, unit: str = "", form: NumberForm = ANY_NUMBER
    ) -> float:
        """Return a setting as it is read back; raises InstrumentError where it is not the number that was `sent`.

        What was wanted may have more digits than were sent: the instrument can answer for these only, to its own
        `resolution`.
        """
        found = self._session.query_number(query, form=form)
        if not abs(found - float(sent)) <= resolution * _ROUND_OFF:
            raise self._disagreement(query, f"{sent} {unit}".rstrip(), f"{found:.12g} {unit}".rstrip())
        return found

    def _take_over(self, left: Sequence[Left], **names: object) -> None:
        """Set or check each setting that a last user may have left; raises InstrumentError if it stays.

        A setting whose header this specimen does not know was left by nobody.
        """
        rows = [(row.header.format(**names), row.value.format(**names), row) for row in left]
        commands = []
        for header, value, row in rows:
            if header in self._taken_over:
                continue
            if not row.refused:
                commands.append(f"{header} {value}".rstrip())
            elif not _alike(found := self._session.query(f"{header}?"), value):
                raise self._error(InstrumentError, f"{row.refused}: {found}, expected {value}", command=f"{header}?")
        try:
            if commands:
                self._session.write(*commands)
        except InstrumentError:
            for command in commands:
                self._set_where_known(command)
        self._taken_over.update(header for header, _, _ in rows)

    def _set_where_known(self, command: str) -> None:
        try:
            self._session.write(command)
        except InstrumentError as error:
            if error.number not in _UNKNOWN_HEADER:
                raise

    @property
    def session(self) -> Session:
        """The conversation itself, for consoles and for commands that the driver has no method for."""
        return self._session

    def _take_remote(self, deadline: Deadline) -> None:
        """Send the commands that the interface needs before the instrument may be spoken to."""

    def _safe_words_here(self) -> tuple[str, ...]:
        """Return the safe words as this interface needs them."""
        return self.safe_words

    def command_safe(self) -> UnprovedCommand:
        """Send the safe words at once, without waiting for an answer; return the last read-back."""
        return self._session.unproved("to switch off" if self.safe_words else "", sent=self._session.command_safe())

    def _tell_safe(self, *words: str, deadline: Deadline) -> None:
        """Send words of making safe; refusals do not count, old ones may come without end: what is read back does."""
        with suppress(InstrumentError):
            self._session.write(*words, deadline=deadline)

    def _identity(self, deadline: Deadline | None) -> Identity:
        return Identity(*self._session.identify(deadline))

    def identify(self) -> Identity:
        """Ask for the identity."""
        return self._identity(None)

    def check_errors(self) -> None:
        """Read the error queue until it is empty; raise InstrumentError with the first entry if there was any."""
        self._session.check_errors()

    def check_settings(self) -> None:
        """Ask once more for what was set for a whole run; raise SettingChanged where something else has changed it."""
        for question, (ask, kept) in self._kept.items():
            if (found := ask(question)) != kept:
                read, was = (f"{each:g}" if isinstance(each, float) else str(each) for each in (found, kept))
                what = f"something else has changed a setting: it reads {read} and was {was}"
                raise self._error(SettingChanged, what, question)

    def answers(self) -> dict[str, str]:
        """Send each query once; return the answers by query.

        Raises:
            FramingError: an answer is not in the form that a run demands.
        """
        found = {question: self._session.query(question) for question, _ in self.questions}
        for question, form in self.questions:
            try:
                replies.number(found[question], form)
            except FramingError as error:
                raise self._error(FramingError, error.what, command=question) from error
        return found

    def close(self) -> None:
        """Give the connection back."""
        self._session.close()


_SHARES = (1.0 / 3.0, 1.0 / 2.0, 1.0)


def safely(
    instrument: Instrument, prove: Callable[[Deadline], str], deadline: Deadline, shares: Sequence[float] = _SHARES
) -> SafeReport:
    """Send the safe words, then run `prove`, again if it fails and time is left; it returns its proof in words.

    There are as many attempts as `shares`, each a share of what is left then, so that one which hangs leaves time for
    another. A connection that is gone is waited for, in wall time. Where nothing can be proved the safe words are sent
    once more.
    """
    instrument.command_safe()
    failure, wall, left = "there was no time left to make it safe", WallClock(), list(shares)
    while left and not deadline.expired():
        try:
            detail = prove(Deadline.after(deadline.clock, deadline.remaining() * left[0]))
        except ConnectFailed as error:
            failure, left = str(error), left if wall.now() < _RETURN_S else left[1:]
            sleep(deadline.clock, min(_BETWEEN_S, deadline.remaining()))
            sleep(wall, _BETWEEN_S - wall.now() % _BETWEEN_S)  # the bench's clock may stand still or jump
        except BenchError as error:
            failure, left = str(error), left[1:]
        else:
            return SafeReport(instrument.name, instrument.resource, safe=True, detail=detail)
    return SafeReport(
        instrument.name, instrument.resource, safe=False, detail=failure, unproved=instrument.command_safe()
    )


def _alike(found: str, wanted: str) -> bool:
    """Return True if two answers say the same: a number in another form is the same number."""
    try:
        return float(found) == float(wanted)
    except ValueError:
        return found.strip('"').upper() == wanted.upper()


def decimal(value: float) -> str:
    """Return `value` as instruments read it: nine digits, shortest form (NRf)."""
    require_number("a value", value)
    return f"{value + 0.0:.9g}"


def require_within(instrument: Instrument, what: str, value: float, limits: tuple[float, float], unit: str) -> None:
    """Raise LimitError unless ``low <= value <= high``; not-a-number is never within."""
    require_number(what, value)
    low, high = limits
    if not low <= value <= high:
        raise LimitError(
            f"{what} of {value:g} {unit} is outside {low:g} ... {high:g} {unit}, nothing was sent",
            instrument=instrument.name,
            resource=instrument.resource,
        )
