"""Errors of a bench, one class a kind.

::

    BenchError                      exit code 3 unless said otherwise
    |- ConfigError                  2  the bench file, a data file, a record or an option cannot be used
    |- PlanError                    2  the procedure cannot be run as asked
    |- LimitError                      a setting would leave the limits of the bench; nothing was sent
    |- InterlockError                  an interlock or fault of the table forbids motion
    |- MeasurementError                a reading cannot be used (overload, not settled, supply in current limit)
    |- Aborted                      4  stopped by a person or a signal, bench made safe
    |- NotSafe                      5  something could not be made safe; the message names it
    |- TransportError                  the wire failed, not the instrument
    |  |- ConnectFailed                nobody answers at the resource
    |  |- LinkLost                     the connection broke
    |  |- DeadlineExceeded             no answer in time
    |  |- FramingError                 an answer that is not one
    |  `- OutOfSync                    answers belong to other questions; the session is closed
    `- InstrumentError                 the instrument refused; carries its number and words
       `- WrongInstrument              another model or specimen answers at the resource

``str()`` of each is one sentence that a technician can act on. Exit code 1 is no error: a measured value failed its
limits.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar, TypedDict, Unpack

_AT_ONCE_S = 0.001
"""Time below which a failure is said to be at once, s."""


class Where(TypedDict, total=False):
    """Place and time of an error, as :class:`BenchError` takes it."""

    instrument: str | None
    resource: str | None
    command: str | None
    step: str | None
    elapsed_s: float | None
    hint: str | None


class BenchError(Exception):
    """Any error of the bench that is shown to its user; the attributes say where and when it happened.

    `run` is the run that it ended, with the points that were kept (:class:`vcfbench.Run`); None outside of one.
    `of_devices` are the errors of several gyroscopes, by name, where it is made of theirs.

    >>> try:
    ...     vcfbench.load_run("not-there")
    ... except vcfbench.BenchError as error:
    ...     print(type(error).__name__, error.exit_code)
    ConfigError 2
    """

    exit_code: ClassVar[int] = 3
    run: Any = None
    of_devices: Mapping[str, "BenchError"] = MappingProxyType({})

    def __init__(
        self,
        what: str,
        *,
        instrument: str | None = None,
        resource: str | None = None,
        command: str | None = None,
        step: str | None = None,
        elapsed_s: float | None = None,
        hint: str | None = None,
    ) -> None:
        super().__init__(what)
        self.what = what
        self.instrument = instrument
        self.resource = resource
        self.command = command
        self.step = step
        self.elapsed_s = elapsed_s
        self.hint = hint

    def __str__(self) -> str:
        where = (
            f"{self.instrument} at {self.resource}"
            if self.instrument and self.resource
            else self.instrument or self.resource
        )
        parts = [f"{where}: {self.what}" if where else self.what]
        if self.command is not None:
            parts.append(f"command {self.command!r}")
        if self.step is not None:
            parts.append(f"step {self.step}")
        if self.elapsed_s is not None:
            parts.append("at once" if self.elapsed_s < _AT_ONCE_S else f"after {self.elapsed_s:.3g} s")
        text = ", ".join(parts)
        return f"{text}; {self.hint}" if self.hint else text

    @classmethod
    def joined(cls, of_devices: Mapping[str, "BenchError"]) -> "BenchError":
        """Return the error of several devices that all failed: it tells that of each, and is of their kind."""
        kinds = {type(each) for each in of_devices.values()}
        said = "; ".join(f"{name}: {each}" for name, each in of_devices.items())
        error = (kinds.pop() if len(kinds) == 1 else BenchError)(said)
        error.of_devices = dict(of_devices)
        return error


class ConfigError(BenchError):
    """The bench file, a data file, a record or an option cannot be used.

    >>> vcfbench.dry_run("turntable", settings={"samples": 0})
    Traceback (most recent call last):
    vcfbench.errors.ConfigError: settings: procedure.samples: expected a whole number at least 2 and at...
    """

    exit_code = 2


class PlanError(BenchError):
    """The procedure cannot be run as asked on this bench.

    >>> vcfbench.dry_run("turntabel")
    Traceback (most recent call last):
    vcfbench.errors.PlanError: there is no procedure 'turntabel' ('turntable'?); known are...
    """

    exit_code = 2


class LimitError(BenchError):
    """A setting would leave the limits of the bench or of the instrument; nothing was sent.

    >>> bench.rate_table.set_rate(9000.0, acceleration_deg_s2=100.0)
    Traceback (most recent call last):
    vcfbench.errors.LimitError: rate_table at sim://ideal: rate 9000 deg/s is beyond the bench's limit of...
    """


class InterlockError(BenchError):
    """The rate table's interlock or a latched fault forbids motion.

    >>> lab.fault("rate_table", "door")
    >>> bench.rate_table.enable()
    Traceback (most recent call last):
    vcfbench.errors.InterlockError: rate_table at sim://ideal: interlock input 1; remove the cause, then...
    """


class MeasurementError(BenchError):
    """A reading cannot be used: overload, not settled, supply in current limit.

    >>> lab.fault("multimeter", "overload")
    >>> bench.multimeter.configure_dc_voltage(10.0, 10.0)
    >>> bench.multimeter.read_voltage_v()
    Traceback (most recent call last):
    vcfbench.errors.MeasurementError: multimeter at GPIB0::22::INSTR: overload or not measurable (the...
    """


class ClippedRecord(MeasurementError):
    """A record of an oscilloscope reaches beyond its screen."""


class Aborted(BenchError):
    """A person or a signal stopped the run; the bench was made safe.

    >>> control = vcfbench.RunControl()
    >>> control.stop("the technician")
    >>> vcfbench.run("turntable", control=control, runs=None)
    Traceback (most recent call last):
    vcfbench.errors.Aborted: stopped by the technician
    """

    exit_code = 4

    @classmethod
    def behind(cls, error: BaseException) -> "Aborted | None":
        """Return the stop that `error` came of, None where it did not, or something is not safe.

        Code that a signal hits may take it for a mistake of its own, and say so. A stop that was being dealt with when
        `error` came (its ``__context__``), as that of a run before this one, is none of it.
        """
        each: BaseException | None = error
        seen = set[int]()  # nothing keeps anybody from a circle
        while each is not None and not isinstance(each, cls | NotSafe) and id(each) not in seen:
            seen.add(id(each))
            each = each.__cause__
        return each if isinstance(each, cls) else None


class NotSafe(BenchError):
    """Something could not be made safe; the message names it.

    `reports` say what state every instrument was left in (:class:`vcfbench.interfaces.SafeReport`), as far as that is
    known.

    >>> with open_simulated("ideal") as lab:
    ...     lab.fault("rate_table", "unreachable")
    Traceback (most recent call last):
    vcfbench.errors.NotSafe: NOT SAFE: rate_table at sim://ideal: could not be told to stop; last read...
    """

    exit_code = 5
    reports: tuple[Any, ...] = ()


class TransportError(BenchError):
    """The wire failed, not the instrument.

    >>> lab.fault("multimeter", "disconnect")
    >>> try:
    ...     bench.multimeter.identify()
    ... except vcfbench.TransportError as error:
    ...     print(type(error).__name__, error.instrument)
    LinkLost multimeter
    """


class ConnectFailed(TransportError):
    """The resource does not answer.

    >>> try:
    ...     bench.multimeter.check_errors()
    ... except vcfbench.ConnectFailed as error:
    ...     print(f"is {error.instrument} switched on?")
    """


class LinkLost(TransportError):
    """The connection broke.

    >>> lab.fault("multimeter", "disconnect")
    >>> bench.multimeter.identify()
    Traceback (most recent call last):
    vcfbench.errors.LinkLost: multimeter at GPIB0::22::INSTR: the connection broke (the link to the...
    """


class DeadlineExceeded(TransportError):
    """No answer came in time.

    >>> lab.fault("multimeter", "silent")
    >>> bench.multimeter.identify()
    Traceback (most recent call last):
    vcfbench.errors.DeadlineExceeded: multimeter at GPIB0::22::INSTR: no answer, command '*IDN?', after 5 s
    """


class FramingError(TransportError):
    """The received bytes are not an answer of the expected form.

    >>> lab.fault("multimeter", "garbled")
    >>> bench.multimeter.configure_dc_voltage(10.0, 10.0)
    Traceback (most recent call last):
    vcfbench.errors.FramingError: multimeter at GPIB0::22::INSTR: expected ASCII text, ...
    """


class OutOfSync(TransportError):
    """The answers no longer belong to the questions; the session was closed.

    >>> try:
    ...     bench.multimeter.check_errors()
    ... except vcfbench.OutOfSync as error:
    ...     print(f"check the cable of {error.instrument} and open the bench again")
    """


class InstrumentError(BenchError):
    """The instrument refused a command; `number` and `words` are its own.

    >>> lab.fault("multimeter", "error", number=-213)
    >>> bench.multimeter.check_errors()
    Traceback (most recent call last):
    vcfbench.errors.InstrumentError: multimeter at GPIB0::22::INSTR: reports -213 "Init ignored", command 'SYST:ERR?'
    """

    def __init__(
        self, what: str, *, number: int | None = None, words: str | None = None, **where: Unpack[Where]
    ) -> None:
        super().__init__(what, **where)
        self.number = number
        self.words = words


class SettingChanged(InstrumentError):
    """Something else has changed a setting that a run relies on from its first reading to its last.

    Nobody knows since when, so such a run has no results and cannot be resumed.

    >>> bench.multimeter.configure_dc_voltage(10.0, 10.0)
    >>> bench.multimeter.session.write("VOLT:DC:NPLC 0.02")  # as a person, or another program, would
    >>> try:
    ...     bench.multimeter.check_settings()
    ... except vcfbench.SettingChanged as error:
    ...     print(error.what)
    something else has changed a setting: it reads 0.02 and was 10
    """


class WrongInstrument(InstrumentError):
    """Another model or specimen than the bench file says answers at the resource.

    >>> try:
    ...     with vcfbench.open_bench("lab.toml"):
    ...         pass
    ... except vcfbench.WrongInstrument as error:
    ...     print(f"the bench file has another {error.instrument}")
    """
