"""CALCulate of the 34401A (User's Guide p. 124-126)."""

from __future__ import annotations

from collections.abc import Callable

from simrack.instruments.hp34401a.calculation import MATH_RULES
from simrack.instruments.hp34401a.instrument import SimulatedHp34401A
from simrack.scpi import Boolean, Choice, Command, Limits, Number, Rows, ScpiError, attribute, boolean, real

ROWS = Rows()

_NR3 = real(8)
_DBM_OHMS = (50, 75, 93, 110, 124, 125, 135, 150, 250, 300, 500, 600, 800, 900, 1000, 1200, 8000)


@ROWS.attribute("CALCulate:FUNCtion", Choice(("NULL", "DB", "DBM", "AVERage", "LIMit")), "math.operation")
def _set_math(meter: SimulatedHp34401A, operation: str) -> None:
    if meter.math.on and meter.function.name not in MATH_RULES[operation]:
        meter.math.on = False
        raise ScpiError(-221)
    meter.math.choose(operation)


@ROWS.attribute("CALCulate:STATe", Boolean(), "math.on", boolean)
def _set_math_state(meter: SimulatedHp34401A, state: object) -> None:
    if state and meter.function.name not in MATH_RULES[meter.math.operation]:
        meter.math.on = False
        raise ScpiError(-221)
    meter.math.switch(on=bool(state))


def _null_limits(meter: SimulatedHp34401A) -> Limits:
    top = 1.2 * (meter.function.ranges[-1] if meter.function.ranges else meter.function.highest)
    return Limits(-top, top)


def _while_on(name: str) -> Callable[..., None]:
    """Null and dB registers can be written only while math is on; the error number is unverified."""

    def write(meter: SimulatedHp34401A, value: float) -> None:
        if not meter.math.on:
            raise ScpiError(-221)
        setattr(meter.math, name, value)

    return write


def _statistic(name: str) -> Callable[..., float]:
    return lambda meter: float(getattr(meter.math, name)())


def _register(pattern: str, parameter: Number, name: str, *, while_on: bool = False) -> Command:
    """Declare a register of the mathematics; one that was never set is 0."""
    do = _while_on(name) if while_on else None
    return attribute(pattern, parameter, f"math.{name}", lambda value: _NR3(value or 0.0), do=do)


_DB = Number(unit="DBM", limits=Limits(-200.0, 200.0))
_ANY = Number(unit=("V", "A", "OHM", "HZ", "S"), limits=_null_limits)

COMMANDS = (
    *ROWS,
    *(
        Command(f"CALCulate:AVERage:{word}", query=_statistic(word.lower()), reply=_NR3)
        for word in ("MINimum", "MAXimum", "AVERage", "COUNt")
    ),
    _register("CALCulate:NULL:OFFSet", _ANY, "null_offset", while_on=True),
    _register("CALCulate:DB:REFerence", _DB, "db_reference", while_on=True),
    _register(
        "CALCulate:DBM:REFerence", Number(unit="OHM", limits=Limits(50.0, 8000.0), legal=_DBM_OHMS), "dbm_reference"
    ),
    _register("CALCulate:LIMit:LOWer", _ANY, "lower"),
    _register("CALCulate:LIMit:UPPer", _ANY, "upper"),
)
