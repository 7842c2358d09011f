"""CALCulate of the 34401A (User's Guide p. 124-126)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.instruments.hp34401a.calculation import MATH_RULES
from simrack.scpi import Boolean, Choice, Command, Limits, Number, ScpiError, boolean, real

if TYPE_CHECKING:
    from collections.abc import Callable

    from simrack.instruments.hp34401a.instrument import SimulatedHp34401A

_NR3 = real(8)
_ON_OFF = (Boolean(),)
_DBM_OHMS = (50, 75, 93, 110, 124, 125, 135, 150, 250, 300, 500, 600, 800, 900, 1000, 1200, 8000)


def _set_math(meter: SimulatedHp34401A, operation: str) -> None:
    if meter.math.on and meter.function.name not in MATH_RULES[operation]:
        meter.math.on = False
        raise ScpiError(-221)
    meter.math.choose(operation)


def _math(meter: SimulatedHp34401A) -> str:
    return meter.math.operation


def _set_math_state(meter: SimulatedHp34401A, state: object) -> None:
    if state and meter.function.name not in MATH_RULES[meter.math.operation]:
        meter.math.on = False
        raise ScpiError(-221)
    meter.math.switch(on=bool(state))


def _math_state(meter: SimulatedHp34401A) -> bool:
    return meter.math.on


def _null_limits(meter: SimulatedHp34401A) -> Limits:
    top = 1.2 * (meter.function.ranges[-1] if meter.function.ranges else meter.function.highest)
    return Limits(-top, top)


def _require_math(meter: SimulatedHp34401A) -> None:
    """Null and dB registers can be written only while math is on; the error number is unverified."""
    if not meter.math.on:
        raise ScpiError(-221)


def _set_null(meter: SimulatedHp34401A, value: float) -> None:
    _require_math(meter)
    meter.math.null_offset = value


def _set_db(meter: SimulatedHp34401A, value: float) -> None:
    _require_math(meter)
    meter.math.db_reference = value


def _set_dbm(meter: SimulatedHp34401A, value: float) -> None:
    meter.math.dbm_reference = value


def _set_lower(meter: SimulatedHp34401A, value: float) -> None:
    meter.math.lower = value


def _set_upper(meter: SimulatedHp34401A, value: float) -> None:
    meter.math.upper = value


def _math_value(attribute: str) -> Callable[..., float]:
    return lambda meter: float(getattr(meter.math, attribute) or 0.0)


def _statistic(name: str) -> Callable[..., float]:
    return lambda meter: float(getattr(meter.math, name)())


COMMANDS = (
    Command("CALCulate:FUNCtion", (Choice(("NULL", "DB", "DBM", "AVERage", "LIMit")),), do=_set_math, query=_math),
    Command("CALCulate:STATe", _ON_OFF, do=_set_math_state, query=_math_state, reply=boolean),
    Command("CALCulate:AVERage:MINimum", query=_statistic("minimum"), reply=_NR3),
    Command("CALCulate:AVERage:MAXimum", query=_statistic("maximum"), reply=_NR3),
    Command("CALCulate:AVERage:AVERage", query=_statistic("average"), reply=_NR3),
    Command("CALCulate:AVERage:COUNt", query=_statistic("count"), reply=_NR3),
    Command(
        "CALCulate:NULL:OFFSet",
        (Number(unit=("V", "A", "OHM", "HZ", "S"), limits=_null_limits),),
        do=_set_null,
        query=_math_value("null_offset"),
        reply=_NR3,
    ),
    Command(
        "CALCulate:DB:REFerence",
        (Number(unit="DBM", limits=Limits(-200.0, 200.0)),),
        do=_set_db,
        query=_math_value("db_reference"),
        reply=_NR3,
    ),
    Command(
        "CALCulate:DBM:REFerence",
        (Number(unit="OHM", limits=Limits(50.0, 8000.0), legal=_DBM_OHMS),),
        do=_set_dbm,
        query=_math_value("dbm_reference"),
        reply=_NR3,
    ),
    Command(
        "CALCulate:LIMit:LOWer",
        (Number(unit=("V", "A", "OHM", "HZ", "S"), limits=_null_limits),),
        do=_set_lower,
        query=_math_value("lower"),
        reply=_NR3,
    ),
    Command(
        "CALCulate:LIMit:UPPer",
        (Number(unit=("V", "A", "OHM", "HZ", "S"), limits=_null_limits),),
        do=_set_upper,
        query=_math_value("upper"),
        reply=_NR3,
    ),
)
