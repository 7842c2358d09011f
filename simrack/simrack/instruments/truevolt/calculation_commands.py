"""CALCulate of the Truevolt series: statistics and limit test; scaling is kept only, no trend, no histogram."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.scpi import (
    Boolean,
    Choice,
    Command,
    Limits,
    Number,
    Rows,
    attribute,
    boolean,
    comma_list,
    real,
    remembered,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from simrack.instruments.truevolt.instrument import SimulatedTruevolt
    from simrack.instruments.truevolt.mathematics import Statistics

ROWS = Rows()
"""Rows that stand on their handlers."""

_NR3 = real(8)
_AVERAGE, _LIMIT = "CALCulate:AVERage", "CALCulate:LIMit"
_ANY = Number(unit=("V", "OHM", "HZ", "S"), limits=Limits(-1e15, 1e15, 0.0))


def _statistic(value: Callable[[Statistics], float]) -> Callable[[SimulatedTruevolt], float]:
    return lambda meter: float(value(meter.statistics))


@ROWS.query(f"{_AVERAGE}:ALL", reply=comma_list(_NR3))
def _all(meter: SimulatedTruevolt) -> tuple[float, ...]:
    statistics = meter.statistics
    return statistics.mean, statistics.deviation(), statistics.minimum, statistics.maximum


COMMANDS = (
    *ROWS,
    attribute(
        f"{_AVERAGE}[:STATe]",
        Boolean(),
        "statistics.on",
        boolean,
        do=lambda meter, on: meter.statistics.switch(on=on),
    ),
    Command(f"{_AVERAGE}:CLEar[:IMMediate]", do=lambda meter: meter.statistics.clear()),
    Command(f"{_AVERAGE}:AVERage", query=_statistic(lambda statistics: statistics.mean), reply=_NR3),
    Command(f"{_AVERAGE}:COUNt", query=_statistic(lambda statistics: statistics.count), reply=_NR3),
    Command(f"{_AVERAGE}:MAXimum", query=_statistic(lambda statistics: statistics.maximum), reply=_NR3),
    Command(f"{_AVERAGE}:MINimum", query=_statistic(lambda statistics: statistics.minimum), reply=_NR3),
    Command(f"{_AVERAGE}:PTPeak", query=_statistic(lambda statistics: statistics.span()), reply=_NR3),
    Command(f"{_AVERAGE}:SDEViation", query=_statistic(lambda statistics: statistics.deviation()), reply=_NR3),
    remembered("CALCulate:SCALe[:STATe]", Boolean(), default=False, reply=boolean),
    remembered("CALCulate:SCALe:FUNCtion", Choice(("NULL", "DB", "DBM", "PCT", "SCALe")), "NULL"),
    remembered("CALCulate:SCALe:GAIN", Number(limits=Limits(-1e15, 1e15, 1.0)), 1.0, _NR3),
    remembered("CALCulate:SCALe:OFFSet", Number(limits=Limits(-1e15, 1e15, 0.0)), 0.0, _NR3),
    remembered("CALCulate:SCALe:REFerence", Number(limits=Limits(-1e15, 1e15, 0.0)), 0.0, _NR3),
    remembered("CALCulate:SCALe:DBM:REFerence", Number(unit="OHM", limits=Limits(50.0, 8000.0, 600.0)), 600.0, _NR3),
    attribute(f"{_LIMIT}[:STATe]", Boolean(), "limit_test.on", boolean),
    attribute(f"{_LIMIT}:LOWer[:DATA]", _ANY, "limit_test.lower", _NR3),
    attribute(f"{_LIMIT}:UPPer[:DATA]", _ANY, "limit_test.upper", _NR3),
)
