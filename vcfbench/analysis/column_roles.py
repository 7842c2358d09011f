"""What the name of a column says of it: an applied rate, a gyroscope's output, or neither of both."""

import re
from collections.abc import Sequence
from typing import Final

from vcfbench.analysis.column_names import ColumnName

_APPLIED: Final = {
    *("applied", "reference", "ref", "table", "turntable", "stage", "commanded", "command", "cmd", "setpoint"),
    *("input", "true", "stimulus", "nominal", "target"),
}
"""Words of a rate that somebody applied; a rate of which nothing more is said may be either."""
_MEASURED: Final = {"imu", "sensor", "dut", "output", "out", "measured", "meas", "reading", "raw"}
_OTHERS: Final = {
    *("supply", "vdd", "vcc", "vbat", "battery", "bat", "batt", "vin", "vref", "rail", "usb", "power"),
    *("ptat", "ntc", "pt", "tcase", "tdie", "tamb", "tchip", "ambient", "oven", "chamber"),
    *("ax", "ay", "az", "mag", "magx", "magy", "magz", "mx", "my", "mz", "baro", "pressure", "press", "humidity", "rh"),
    *("current", "angle", "heading", "position", "pos", "altitude", "tick", "ticks", "idx", "index"),
    *("fit", "fitted", "residual", "residuals", "deviation", "error"),
    *("counter", "seq", "sequence", "crc", "checksum", "flag", "flags", "status"),
}
"""Words of supplies, temperatures, accelerations, other sensors, of another fit, and counters."""
_COUNTERS: Final = {
    *("n", "no", "nr", "i", "k", "step", "sample", "samples", "line", "row", "id", "point", "frame", "packet", "cycle"),
    *("count", "counts", "num", "number", "#", ""),
}
"""Whole names of counters."""
_SOURCES: Final = {
    *("sensor", "axis", "type", "event", "instance", "channel", "device", "imu", "source", "topic", "id", "i"),
}
"""Words of columns that say whose a line is."""
_DIRECTIONS: Final = {
    *("cw", "ccw", "acw", "clockwise", "counterclockwise", "counter-clockwise", "anticlockwise", "left", "right"),
    *("links", "rechts", "gauche", "droite", "+", "-", "pos", "neg", "positive", "negative", "plus", "minus"),
    *("forward", "reverse", "fwd", "rev", "1", "-1", "+1", "1.0", "-1.0"),
}
"""Cells that say in which direction a table turns."""
_BEGINS: Final = ("temp", "therm", "acc", "beschl", "versorg")
_WORD: Final = re.compile(r"[^\W\d_]+")


def says_applied(name: ColumnName) -> bool:
    """Return True for the name of a rate that was applied."""
    return bool(_APPLIED & _words(name))


def says_measured(name: ColumnName) -> bool:
    """Return True for the name of a gyroscope's own output."""
    words = _words(name)
    return not words & _APPLIED and (bool(words & _MEASURED) or any(each.startswith("gyr") for each in words))


def may_be_applied(name: ColumnName) -> bool:
    """Return True for the name of an applied rate, and for one that is called rate alone."""
    return says_applied(name) or ("rate" in _words(name) and not says_measured(name))


def says_source(name: ColumnName) -> bool:
    """Return True for the name of a column that says of which sensor a line is."""
    return name.unit is None and bool(_SOURCES & _words(name))


def are_directions(cells: Sequence[str]) -> bool:
    """Return True for cells that say in which direction something turns, if there are two of them."""
    words = {cell.lower() for cell in cells}
    return len(words) == 2 and words <= _DIRECTIONS


def may_be_output(name: ColumnName) -> bool:
    """Return False for times, temperatures, supplies, accelerations and counters."""
    words = _words(name)
    counts = name.unit is None and name.base.rstrip("0123456789") in _COUNTERS
    return not (name.is_time or counts or words & _OTHERS or any(each.startswith(_BEGINS) for each in words))


def _words(name: ColumnName) -> set[str]:
    return set(_WORD.findall(name.base))
