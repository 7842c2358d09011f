"""Opening of instruments: the one way from a name and a resource to a driver."""

import inspect
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from msgspec import Struct

from vcfbench.clock import Clock
from vcfbench.drivers.rate_table.dialect import TableSettings, spoken
from vcfbench.drivers.rate_table.driver import RateTableDriver
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.drivers.scpi_instrument import ScpiInstrument, VisaSettings
from vcfbench.drivers.serial_wire import serial_port
from vcfbench.drivers.session import Session, visa_resource
from vcfbench.drivers.streams.description import Stream
from vcfbench.drivers.streams.reader import StreamReader, stream_port
from vcfbench.errors import BenchError, ConfigError
from vcfbench.interfaces import Instrument
from vcfbench.models import driver_of, find_language, find_model, model_names

_S = TypeVar("_S")


Opener = Callable[[str, str, str, "Clock", Mapping[str, Any]], "Instrument"]
"""Called with role, resource, VISA library, clock and settings."""


class Driver(Struct, frozen=True):
    """A registered driver: the model's or dialect's name, its class and the function that opens it."""

    model: str
    driver_class: type
    opener: Opener

    def __post_init__(self) -> None:
        name = self.driver_class.__name__
        for method in ("make_safe", "command_safe", "identify", "check_errors", "close"):
            if not inspect.isfunction(getattr(self.driver_class, method, None)):
                raise TypeError(f"{name} has no {method}() and cannot be registered")
        drives = any(hasattr(self.driver_class, switch) for switch in ("enable_outputs", "enable_output", "set_rate"))
        inherited = getattr(self.driver_class, "command_safe", None) is ScpiInstrument.command_safe
        if drives and inherited and not getattr(self.driver_class, "safe_words", ()):
            raise TypeError(f"{name} drives something and has no safe_words, it cannot be registered")


def find_driver(model: str, like: str | None = None) -> Driver:
    """Return the driver of `model`, a name of :mod:`vcfbench.models` or the path of a table profile, ``FILE.toml``.

    `like` names the model whose words it speaks, where it is not known by itself.

    Raises:
        ConfigError: there is none; the words name those there are.
    """
    if model == "stream":
        return Driver(model, StreamReader, _stream)
    if model.endswith(".toml") or find_language(model) is not None:
        return _table(model)
    row = find_model(like or model)
    if row is None:
        raise ConfigError(f"no driver for {like or model!r}; there are {', '.join(sorted(model_names()))}")
    driver = driver_of(row)
    if isinstance(driver, Driver):
        return driver
    if not (isinstance(driver, type) and issubclass(driver, ScpiInstrument)):
        raise ConfigError(f"the entry registered as driver of {row.name!r} is not a driver: {driver!r}")
    # Of another model that speaks the same words anybody may be the maker
    return visa_driver(model, driver if model == row.name else driver.of_model(model, makers=("",)))


def _table(name: str) -> Driver:
    def opener(role: str, resource: str, library: str, clock: Clock, settings: Mapping[str, Any]) -> RateTableDriver:
        del library  # pyserial opens tables
        parsed = _settings(TableSettings, role, settings)
        dialect, link = spoken(name, parsed)
        connect = serial_port(parsed.port or resource, link, clock, parsed.timeout_s, parsed.baud_rate)
        line = TableLine.opened(connect, name=role, resource=resource, clock=clock, timeout_s=parsed.timeout_s)
        try:
            if parsed.upon_connecting is not None:
                parsed.upon_connecting(line, dialect)
            return RateTableDriver(line, dialect, parsed)
        except BaseException:
            line.close()
            raise

    return Driver(name, RateTableDriver, opener)


def _stream(role: str, resource: str, library: str, clock: Clock, settings: Mapping[str, Any]) -> StreamReader:
    del library  # pyserial opens streams
    stream: Stream = settings["stream"]
    connect = stream_port(stream, settings.get("port"), clock)
    if share := settings.get("shared"):
        connect = share(resource, connect)
    return StreamReader(role, resource, connect, stream, clock)


def visa_driver(model: str, driver_class: type[ScpiInstrument]) -> Driver:
    """Return the function that opens the SCPI instrument `model` on VISA."""

    def opener(role: str, resource: str, library: str, clock: Clock, settings: Mapping[str, Any]) -> Instrument:
        parsed = _settings(VisaSettings, role, settings)
        pause_s = driver_class.serial_pause_s if parsed.serial_pause_s is None else parsed.serial_pause_s
        session = Session.opened(
            visa_resource(resource, library, parsed.serial),
            name=role,
            resource=resource,
            clock=clock,
            timeout_s=parsed.timeout_s,
            open_timeout_s=max(parsed.timeout_s, driver_class.first_answer_s),
            write_pause_s=pause_s if resource.upper().startswith("ASRL") else 0.0,
        )
        try:
            if parsed.upon_connecting is not None:
                parsed.upon_connecting(session, driver_class.safe_words)
            made: Any = driver_class.opened(session, parsed)
        except BaseException:
            session.close()
            raise
        return made  # type: ignore[no-any-return]  # that it can be registered shows that it is an instrument

    return Driver(model, driver_class, opener)


def _settings(kind: Callable[..., _S], role: str, settings: Mapping[str, Any]) -> _S:
    try:
        return kind(**settings)
    except TypeError as error:  # a setting too many or too few; the words name it
        words = str(error).removeprefix("VisaSettings.__init__() ").removeprefix("TableSettings.__init__() ")
        raise ConfigError(f"the settings of {role} do not fit: {words}") from error


def open_instrument(
    role: str,
    model: str,
    resource: str,
    *,
    library: str,
    clock: Clock,
    settings: Mapping[str, Any],
    like: str | None = None,
) -> Instrument:
    """Open the instrument of `role` and prove that it is a `model`.

    Args:
        role: its name on the bench, for messages: ``multimeter``.
        model: a name of :mod:`vcfbench.models`, or for tables the path of a profile, ``FILE.toml``.
        resource: a VISA resource string, or for tables the name or URL of a serial port.
        library: the VISA library.
        clock: the bench's.
        settings: the fields of :class:`VisaSettings` or :class:`TableSettings`.
        like: the model whose words it speaks, where `model` is not known by itself.

    Raises:
        ConfigError: there is no such model, or a setting that it does not have.
        ConnectFailed: nobody answers there.
        WrongInstrument: something else does.
    """
    try:
        return find_driver(model, like).opener(role, resource, library, clock, settings)
    except BenchError as error:
        error.instrument = error.instrument or role
        error.resource = error.resource or resource
        raise
