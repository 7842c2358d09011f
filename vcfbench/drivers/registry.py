"""Which driver speaks for which model, and the one way to open an instrument."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, Literal, TypeVar

from vcfbench.drivers.agilent33220a import Agilent33220A
from vcfbench.drivers.dso7104b import Dso7104B
from vcfbench.drivers.e3631a import E3631A
from vcfbench.drivers.hp34401a import Hp34401A
from vcfbench.drivers.installed import installed_driver, installed_models
from vcfbench.drivers.rate_table.dialect import TableLimits
from vcfbench.drivers.rate_table.dialects import DIALECTS, is_dialect, open_serial, spoken
from vcfbench.drivers.rate_table.driver import RateTableDriver
from vcfbench.drivers.scpi_instrument import ScpiInstrument
from vcfbench.drivers.session import Session, open_session
from vcfbench.errors import BenchError, ConfigError

if TYPE_CHECKING:
    from vcfbench.clock import Clock
    from vcfbench.drivers.rate_table.acl import Header
    from vcfbench.drivers.visa_wire import SerialParameters
    from vcfbench.interfaces import Instrument

__all__ = [
    "DRIVERS",
    "Driver",
    "Registry",
    "TableSettings",
    "VisaSettings",
    "open_instrument",
    "visa_driver",
]

_S = TypeVar("_S")


@dataclass(frozen=True, slots=True)
class VisaSettings:
    """What an instrument on VISA may be told besides its resource."""

    timeout_s: float = 5.0
    serial: SerialParameters | None = None
    serial_number: str | None = None
    mains_hz: float = 50.0
    serial_pause_s: float | None = None
    """Pause after a command on RS-232; None is what the model needs."""


@dataclass(frozen=True, slots=True)
class TableSettings:
    """What a rate table may be told besides its port; without limits here its own stay as they are."""

    max_rate_deg_s: float = math.inf
    max_acceleration_deg_s2: float = math.inf
    timeout_s: float = 2.0
    axis: int = 1
    axis_sign: Literal[1, -1] = 1
    baud_rate: int | None = None
    reply_header: Header = "auto"
    steps_per_deg: float | None = None
    rest_tolerance_deg_s: float = 0.05


Opener = Callable[[str, str, str, "Clock", Mapping[str, Any]], "Instrument"]
"""Called with role, resource, VISA library, clock and settings."""


@dataclass(frozen=True, slots=True)
class Driver:
    """A registered driver: the model's or dialect's name, its class and how it is opened."""

    model: str
    driver_class: type
    opener: Opener

    def __post_init__(self) -> None:
        name = self.driver_class.__name__
        for method in ("make_safe", "command_safe", "identify", "check_errors", "close"):
            if not inspect.isfunction(getattr(self.driver_class, method, None)):
                raise TypeError(f"{name} has no {method}() and cannot be registered")
        if self._drives() and not self._has_words():
            raise TypeError(f"{name} drives something and has no safe_words, it cannot be registered")

    def _drives(self) -> bool:
        return any(hasattr(self.driver_class, switch) for switch in ("enable_outputs", "enable_output", "set_rate"))

    def _has_words(self) -> bool:
        inherited = getattr(self.driver_class, "command_safe", None) is ScpiInstrument.command_safe
        return not inherited or bool(getattr(self.driver_class, "safe_words", ()))


@dataclass(frozen=True, slots=True)
class Registry:
    """The drivers that a bench can name."""

    drivers: Mapping[str, Driver] = field(default_factory=lambda: MappingProxyType({}))

    def having(self, *drivers: Driver) -> Registry:
        """Return a registry that knows `drivers` too."""
        return Registry(MappingProxyType({**self.drivers, **{driver.model: driver for driver in drivers}}))

    def find(self, model: str) -> Driver:
        """Return the driver of `model`; raises ConfigError naming those there are.

        Tables have one driver: where it is registered for ACL, it speaks every other dialect too. Models that other
        packages register (:mod:`vcfbench.drivers.installed`) are known to every registry.
        """
        if model in self.drivers:
            return self.drivers[model]
        dialects = DIALECTS if "acl" in self.drivers else ()
        if dialects and is_dialect(model):
            return _table(model)
        if (own := installed_driver(model)) is not None:
            return _checked(model, own)
        others = (each for each in (*dialects, *installed_models()) if each not in self.drivers)
        raise ConfigError(f"no driver for {model!r}; there are {', '.join((*sorted(self.drivers), *others))}")


def _checked(model: str, own: object) -> Driver:
    if isinstance(own, Driver) and own.model == model:
        return own
    raise ConfigError(f"what is registered for {model!r} is no vcfbench.drivers.registry.Driver of that model")


def _table(name: str) -> Driver:
    def opener(role: str, resource: str, library: str, clock: Clock, settings: Mapping[str, Any]) -> RateTableDriver:
        del library  # pyserial opens tables
        told = _settings(TableSettings, role, settings)
        speech = spoken(name, axis=told.axis, header=told.reply_header, steps_per_deg=told.steps_per_deg)
        line = open_serial(
            resource, speech.link, clock=clock, name=role, timeout_s=told.timeout_s, baud_rate=told.baud_rate
        )
        try:
            return RateTableDriver(
                line,
                speech.dialect,
                limits=TableLimits(told.max_rate_deg_s, told.max_acceleration_deg_s2),
                axis_sign=told.axis_sign,
                rest_tolerance_deg_s=told.rest_tolerance_deg_s,
            )
        except BaseException:
            line.close()
            raise

    return Driver(name, RateTableDriver, opener)


def visa_driver(
    model: str,
    driver_class: type[ScpiInstrument],
    make: Callable[[Session, VisaSettings], Instrument] | None = None,
) -> Driver:
    """Return the driver of a SCPI instrument on VISA, to be registered.

    Args:
        model: what the bench file calls it.
        driver_class: its driver.
        make: makes one on an open session; without it the class is called with session and `serial_number`.
    """

    def plainly(session: Session, told: VisaSettings) -> Instrument:
        made: Any = driver_class(session, serial_number=told.serial_number)
        return made  # type: ignore[no-any-return]  # that it can be registered shows that it is an instrument

    def opener(role: str, resource: str, library: str, clock: Clock, settings: Mapping[str, Any]) -> Instrument:
        told = _settings(VisaSettings, role, settings)
        session = open_session(
            resource,
            library=library,
            clock=clock,
            name=role,
            timeout_s=told.timeout_s,
            open_timeout_s=max(told.timeout_s, driver_class.first_answer_s),
            serial=told.serial,
            write_pause_s=_pause_s(driver_class, resource, told.serial_pause_s),
        )
        try:
            return (make or plainly)(session, told)
        except BaseException:
            session.close()
            raise

    return Driver(model, driver_class, opener)


def _pause_s(driver_class: type[ScpiInstrument], resource: str, told_s: float | None) -> float:
    if not resource.upper().startswith("ASRL"):
        return 0.0
    return driver_class.serial_pause_s if told_s is None else told_s


def _settings(kind: Callable[..., _S], role: str, settings: Mapping[str, Any]) -> _S:
    try:
        return kind(**settings)
    except TypeError as error:  # a setting too many or too few; the words name it
        words = str(error).removeprefix("VisaSettings.__init__() ").removeprefix("TableSettings.__init__() ")
        raise ConfigError(f"the settings of {role} do not fit: {words}") from error


DRIVERS: Final = Registry().having(
    visa_driver("E3631A", E3631A),
    visa_driver("33220A", Agilent33220A),
    visa_driver(
        "34401A",
        Hp34401A,
        lambda session, told: Hp34401A(session, mains_hz=told.mains_hz, serial_number=told.serial_number),
    ),
    visa_driver("DSO7104B", Dso7104B),
    _table("acl"),
)
"""The drivers that come with the project."""


def open_instrument(
    role: str,
    model: str,
    resource: str,
    *,
    library: str,
    clock: Clock,
    settings: Mapping[str, Any],
    registry: Registry = DRIVERS,
) -> Instrument:
    """Open the instrument of `role` and prove that it is a `model`.

    Args:
        role: its name on the bench, for messages: ``multimeter``.
        model: ``E3631A``, ``33220A``, ``34401A``, ``DSO7104B``, or the dialect of a rate table: ``acl``, ``zaber``,
            ``atl``, ``esp``, ``dd16``, ``mn_as``, ``ruya``, ``aaaa`` or the path of a profile, ``FILE.toml``.
        resource: a VISA resource string, or for tables the name or URL of a serial port.
        library: the VISA library.
        clock: the bench's.
        settings: the fields of :class:`VisaSettings` or :class:`TableSettings`.
        registry: where to look for the driver.

    Raises:
        ConfigError: there is no such model, or a setting that it does not have.
        ConnectFailed: nobody answers there.
        WrongInstrument: something else does.
    """
    try:
        return registry.find(model).opener(role, resource, library, clock, settings)
    except BenchError as error:
        error.instrument = error.instrument or role
        error.resource = error.resource or resource
        raise
