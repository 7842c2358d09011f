"""CALCulate of the Truevolt series: statistics, limit test, scaling, smoothing; no trend, no histogram."""

from __future__ import annotations

from operator import attrgetter

from simrack import scpi
from simrack.instruments.truevolt.instrument import SimulatedTruevolt
from simrack.instruments.truevolt.mathematics import Statistics

ROWS = scpi.Rows()

_NR3 = scpi.real(8)
_AVERAGE, _LIMIT = "CALCulate:AVERage", "CALCulate:LIMit"
_STATISTICS = {
    "AVERage": attrgetter("mean"),
    "COUNt": attrgetter("count"),
    "MAXimum": attrgetter("maximum"),
    "MINimum": attrgetter("minimum"),
    "PTPeak": Statistics.span,
    "SDEViation": Statistics.deviation,
}
_ANY = scpi.Number(unit=("V", "OHM", "HZ", "S"), limits=scpi.Limits(-1e15, 1e15, 0.0))


@ROWS.query(f"{_AVERAGE}:ALL", reply=scpi.comma_list(_NR3))
def _all(meter: SimulatedTruevolt) -> tuple[float, ...]:
    statistics = meter.statistics
    return statistics.mean, statistics.deviation(), statistics.minimum, statistics.maximum


COMMANDS = (
    *ROWS,
    scpi.attribute(
        f"{_AVERAGE}[:STATe]",
        scpi.Boolean(),
        "statistics.on",
        scpi.boolean,
        do=lambda meter, on: meter.statistics.switch(on=on),
    ),
    scpi.Command(f"{_AVERAGE}:CLEar[:IMMediate]", do=lambda meter: meter.statistics.clear()),
    *(
        scpi.Command(f"{_AVERAGE}:{word}", query=lambda meter, of=of: float(of(meter.statistics)), reply=_NR3)
        for word, of in _STATISTICS.items()
    ),
    scpi.remembered("CALCulate:SCALe[:STATe]", scpi.Boolean(), default=False, reply=scpi.boolean),
    scpi.remembered("CALCulate:SCALe:FUNCtion", scpi.Choice(("NULL", "DB", "DBM", "PCT", "SCALe")), "NULL"),
    scpi.remembered("CALCulate:SCALe:GAIN", scpi.Number(limits=scpi.Limits(-1e15, 1e15, 1.0)), 1.0, _NR3),
    scpi.remembered("CALCulate:SCALe:OFFSet", scpi.Number(limits=scpi.Limits(-1e15, 1e15, 0.0)), 0.0, _NR3),
    scpi.remembered("CALCulate:SCALe:REFerence", scpi.Number(limits=scpi.Limits(-1e15, 1e15, 0.0)), 0.0, _NR3),
    scpi.remembered(
        "CALCulate:SCALe:DBM:REFerence", scpi.Number(unit="OHM", limits=scpi.Limits(50.0, 8000.0, 600.0)), 600.0, _NR3
    ),
    scpi.remembered("CALCulate:SMOothing[:STATe]", scpi.Boolean(), default=False, reply=scpi.boolean),
    scpi.remembered("CALCulate:SMOothing:RESPonse", scpi.Choice(("SLOW", "MEDium", "FAST")), "FAST"),
    scpi.attribute(f"{_LIMIT}[:STATe]", scpi.Boolean(), "limit_test.on", scpi.boolean),
    scpi.attribute(f"{_LIMIT}:LOWer[:DATA]", _ANY, "limit_test.lower", _NR3),
    scpi.attribute(f"{_LIMIT}:UPPer[:DATA]", _ANY, "limit_test.upper", _NR3),
)
