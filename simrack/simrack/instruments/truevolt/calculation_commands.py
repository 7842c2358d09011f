"""CALCulate of the Truevolt series: statistics and limit test; scaling, trend and histogram are not simulated."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.scpi import Boolean, Command, Limits, Number, boolean, comma_list, real

if TYPE_CHECKING:
    from collections.abc import Callable

    from simrack.instruments.truevolt.instrument import SimulatedTruevolt
    from simrack.instruments.truevolt.mathematics import Statistics

_NR3 = real(8)
_ON_OFF = (Boolean(),)
_AVERAGE, _LIMIT = "CALCulate:AVERage", "CALCulate:LIMit"
_ANY = Number(unit=("V", "OHM", "HZ", "S"), limits=Limits(-1e15, 1e15, 0.0))


def _switch_statistics(meter: SimulatedTruevolt, state: object) -> None:
    meter.statistics.switch(on=bool(state))


def _clear_statistics(meter: SimulatedTruevolt) -> None:
    meter.statistics.clear()


def _statistic(value: Callable[[Statistics], float]) -> Callable[[SimulatedTruevolt], float]:
    return lambda meter: float(value(meter.statistics))


def _all(meter: SimulatedTruevolt) -> tuple[float, ...]:
    statistics = meter.statistics
    return statistics.mean, statistics.deviation(), statistics.minimum, statistics.maximum


def _switch_limits(meter: SimulatedTruevolt, state: object) -> None:
    meter.limit_test.on = bool(state)


def _set_lower(meter: SimulatedTruevolt, value: float) -> None:
    meter.limit_test.lower = value


def _set_upper(meter: SimulatedTruevolt, value: float) -> None:
    meter.limit_test.upper = value


COMMANDS = (
    Command(
        f"{_AVERAGE}[:STATe]", _ON_OFF, do=_switch_statistics, query=lambda meter: meter.statistics.on, reply=boolean
    ),
    Command(f"{_AVERAGE}:CLEar[:IMMediate]", do=_clear_statistics),
    Command(f"{_AVERAGE}:ALL", query=_all, reply=comma_list(_NR3)),
    Command(f"{_AVERAGE}:AVERage", query=_statistic(lambda statistics: statistics.mean), reply=_NR3),
    Command(f"{_AVERAGE}:COUNt", query=_statistic(lambda statistics: statistics.count), reply=_NR3),
    Command(f"{_AVERAGE}:MAXimum", query=_statistic(lambda statistics: statistics.maximum), reply=_NR3),
    Command(f"{_AVERAGE}:MINimum", query=_statistic(lambda statistics: statistics.minimum), reply=_NR3),
    Command(f"{_AVERAGE}:PTPeak", query=_statistic(lambda statistics: statistics.span()), reply=_NR3),
    Command(f"{_AVERAGE}:SDEViation", query=_statistic(lambda statistics: statistics.deviation()), reply=_NR3),
    Command(f"{_LIMIT}[:STATe]", _ON_OFF, do=_switch_limits, query=lambda meter: meter.limit_test.on, reply=boolean),
    Command(f"{_LIMIT}:LOWer[:DATA]", (_ANY,), do=_set_lower, query=lambda meter: meter.limit_test.lower, reply=_NR3),
    Command(f"{_LIMIT}:UPPer[:DATA]", (_ANY,), do=_set_upper, query=lambda meter: meter.limit_test.upper, reply=_NR3),
)
