"""Results of a gyroscope with another output than volts: names of fields stay, the printed units are the device's.

Inside of procedures every output is as a voltage is; what becomes of it is given its unit here, in one place.
"""

import re
from collections.abc import Mapping
from typing import Any, TypeVar

from msgspec import Struct, structs

from vcfbench.drivers.streams.description import Stream
from vcfbench.reports.document import Axis, Cell, Column, Report, Table, Text
from vcfbench.typed import typed
from vcfbench.values.kinds import slope_unit
from vcfbench.values.sources import METER_GAIN

_T = TypeVar("_T")

_CLOCK = "device clock"
_SOURCES = {METER_GAIN: _CLOCK, "last digit": "quantisation"}
_MILLI = re.compile(r"([-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?) mV(/\(deg/s\))?")


def unit_of_record(header: Mapping[str, Any]) -> str:
    """Return the unit of the output of a run by the header of its record."""
    below: Any = header
    for key in ("settings", "station", "gyro", "stream"):
        below = below.get(key) if isinstance(below, Mapping) else None
    return typed(below, Stream).output_unit if below else "V"


def in_output_unit(results: _T, unit: str) -> _T:
    """Return results with the unit of the output in place of volts."""
    return results if unit == "V" else _Renamed(unit).value(results)


def report_in_output_unit(report: Report, unit: str) -> Report:
    """Return a report with the unit of the output in place of volts, and of millivolts in its words."""
    return report if unit == "V" else Report([_Renamed(unit).value(part) for part in report.parts])


class _Renamed:
    def __init__(self, unit: str) -> None:
        slope = slope_unit(unit)
        self._units = {"V": unit, "V/(deg/s)": slope, "(V/(deg/s))/K": f"({slope})/K"}
        self._units["(V/(deg/s))/K^2"] = f"({slope})/K^2"

    def value(self, each: Any) -> Any:
        """Return any value with the units of the device."""
        if isinstance(each, Table) and any(column.name == "V_Vc" for column in each.columns):
            at = [place for place, column in enumerate(each.columns) if column.name != "V_Vc"]
            each = Table([each.columns[n] for n in at], [[row[n] for n in at] for row in each.rows], each.title)
        if isinstance(each, Text) and not each.verbatim:
            return structs.replace(each, text=self._text(each.text))
        if isinstance(each, Struct):
            return self._struct(each)
        if isinstance(each, tuple | list):
            return type(each)(map(self.value, each)) if type(each) in (tuple, list) else each
        if isinstance(each, Mapping):
            return {key: self.value(below) for key, below in each.items()}
        return self._units.get(each, each) if isinstance(each, str) and each in {"V", "V/(deg/s)"} else each

    def _struct(self, each: Struct) -> Any:
        changed = {}
        for name in each.__struct_fields__:
            was = getattr(each, name)
            if name == "unit" or (name == "source" and isinstance(was, str)):
                known = self._units if name == "unit" else _SOURCES
                now = known.get(was, was)
            elif isinstance(each, Axis | Cell | Column) and isinstance(was, str):
                now = was
            else:
                now = self.value(was)
            if now is not was:
                changed[name] = now
        return structs.replace(each, **changed) if changed else each

    def _text(self, text: str) -> str:
        def whole(found: re.Match[str]) -> str:
            return f"{float(found[1]) / 1e3:.5g} {self._units['V/(deg/s)' if found[2] else 'V']}"

        return _MILLI.sub(whole, text).replace(" V/(deg/s)", f" {self._units['V/(deg/s)']}")
