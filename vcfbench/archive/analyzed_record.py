"""Noise of a record at rest that was taken elsewhere, from its file: Allan deviation, N, B, K, R, stability."""

import math
import re
from pathlib import Path
from typing import Any, Final

import numpy as np
from msgspec import Struct, to_builtins

from vcfbench.analysis.allan import BiasStability, Sampling
from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.csv_table import decode, parse_columns
from vcfbench.errors import ConfigError
from vcfbench.files import MOST_TABLE, read_file, shown
from vcfbench.procedures.zero.noise import (
    AllanRow,
    NoiseCoefficient,
    RecordNoise,
    allan_figure,
    allan_table,
    noise_table,
    record_noise,
    stability_table,
)
from vcfbench.reports.document import Heading, Report, Text, facts

_FEWEST: Final = 64
_EVEN: Final = 0.01
"""Part of the interval by which a time may be off its place."""
_UNIT: Final = re.compile(
    r"^.+?(?: ?/ ?\(?(?P<over>[^()]+?)\)?| ?[\[(](?P<inside>[^\])]+)[\])]|_(?P<end>mv|v|deg_s|deg_h|rad_s|ms|s))$"
)
"""Unit at the end of a column's name: ``rate / (deg/s)``, ``rate [deg/h]``, ``output (V)``, ``output_mv``."""
_RATES: Final = {
    **dict.fromkeys(("deg/s", "deg_s", "dps", "°/s"), 1.0),
    **dict.fromkeys(("deg/h", "deg_h", "°/h"), 1.0 / 3600.0),
    **dict.fromkeys(("rad/s", "rad_s"), math.degrees(1.0)),
    "mdeg/s": 1e-3,
}
_VOLTS: Final = {"V": 1.0, "v": 1.0, "mV": 1e-3, "mv": 1e-3, "uV": 1e-6}
_TIMES: Final = {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}


class RecordAnalysis(Struct, frozen=True):
    """Noise of one column: its name, readings, interval, mean, and what :func:`record_noise` finds."""

    column: str
    samples: int
    interval_s: float
    mean_deg_s: float
    noise: tuple[NoiseCoefficient, ...]
    allan_deg_h: tuple[AllanRow, ...]
    stability_deg_h: BiasStability
    fitted_from_s: float

    def as_json(self) -> dict[str, Any]:
        """Return it as ``vcfbench analyze --json`` prints it."""
        plain: dict[str, Any] = to_builtins(self)
        return plain

    def report(self) -> Report:
        """Return tables and figure."""
        rows = [
            ("column", self.column),
            ("readings", f"{self.samples}, one every {self.interval_s:g} s: {self.samples * self.interval_s:g} s"),
            ("mean", f"{self.mean_deg_s:.6g} deg/s"),
        ]
        return Report(
            [
                Heading(f"Noise of {self.column}"),
                facts(rows),
                noise_table(self.noise),
                stability_table(self.stability_deg_h),
                allan_table(self.allan_deg_h),
                Text(
                    "The record counts as gapless: each reading as the mean over its whole interval. Bounds hold the "
                    f"true value with 95 %. Fitted from {self.fitted_from_s:g} s on (IEEE 952, annex C)."
                ),
                allan_figure(self.allan_deg_h, 1.0),
            ]
        )


def analyze_record(
    file: Path | str,
    rate_hz: float | None = None,
    *,
    column: str | None = None,
    scale_factor_v_per_deg_s: float | None = None,
) -> RecordAnalysis:
    """Analyse a record at rest, as ``vcfbench analyze --rate`` does: a CSV file with one line a reading.

    Args:
        file: its first line names the columns, with their units: ``rate / (deg/s)``, ``rate [deg/h]``, ``output_v``.
        rate_hz: readings a second; None where a column of times tells it.
        column: the one that is analysed; None for the only one beside times.
        scale_factor_v_per_deg_s: of an output in volts, V/(deg/s).

    Raises:
        ConfigError: file, line and column of what cannot be read; a unit that is none; times that are not even.
    """
    path = Path(file)
    columns = parse_columns(decode(read_file(path, "a CSV file", MOST_TABLE), shown(path)), shown(path))
    units = {name: unit_of(name) for name in columns}
    times = [name for name, unit in units.items() if unit in _TIMES]
    values = [name for name in columns if name not in times]
    if column is not None and column not in columns:
        raise ConfigError(f"{shown(path)} has no column {column!r}, only {', '.join(columns)}")
    if column is None and len(values) != 1:
        raise ConfigError(f"{shown(path)} has the columns {', '.join(values)}", hint="--column says which one")
    name = column or values[0]
    record = np.asarray(columns[name]) * _factor(name, units[name], scale_factor_v_per_deg_s, shown(path))
    if record.size < _FEWEST:
        raise ConfigError(f"{shown(path)}: expected {_FEWEST} readings at least, came {record.size}")
    clocks = {each: np.asarray(columns[each]) * _TIMES[units[each] or ""] for each in times}
    interval_s = _interval_s(path, rate_hz, clocks)
    sampling = Sampling.without_gaps(interval_s)
    found: RecordNoise = record_noise(record, sampling, corrected=False, u_bandwidth_hz=0.0)
    return RecordAnalysis(
        name, record.size, interval_s, float(record.mean()), found.coefficients, found.rows, found.stability,
        found.fitted_from_s,
    )  # fmt: skip


def begins_with_times(file: Path) -> bool:
    """Tell whether the first column of a file is one of times: a record at rest."""
    head = read_file(file, "a CSV file", MOST_TABLE).split(b"\n", 1)[0].decode(errors="replace")
    return unit_of(head.split(",")[0]) in _TIMES


def unit_of(column: str) -> str | None:
    """Return the unit in the name of a column, None where it has none."""
    found = _UNIT.match(column.strip())
    return None if found is None else next(filter(None, found.groups()), None)


def _factor(name: str, unit: str | None, scale_v: float | None, where: str) -> float:
    """Return what turns the column into deg/s."""
    if unit in _RATES:
        return _RATES[unit]
    if unit not in _VOLTS:
        known = "deg/s, deg/h, rad/s, V, mV"
        raise ConfigError(
            f"{where}, column {name}: expected a unit in its name, of {known}, came {unit or 'none'}",
            hint="name it 'rate / (deg/s)', 'rate [deg/h]' or 'output_v'",
        )
    if not scale_v:
        raise ConfigError(
            f"{where}, column {name}: volts become a rate by a scale factor, which nobody tells",
            hint="--scale-factor -12.5e-3, in V/(deg/s)",
        )
    return _VOLTS[unit] / scale_v


def _interval_s(path: Path, rate_hz: float | None, times: dict[str, Floats]) -> float:
    if rate_hz is not None:
        return 1.0 / rate_hz
    if not times:
        raise ConfigError(f"{shown(path)} has no column of times", hint="--rate 100, readings a second")
    name, at_s = next(iter(times.items()))
    steps = np.diff(at_s)
    interval = float((at_s[-1] - at_s[0]) / steps.size)
    off = np.flatnonzero(np.abs(steps - interval) > _EVEN * abs(interval))
    if interval <= 0.0 or off.size:
        line = int(off[0]) + 3 if off.size else 2
        raise ConfigError(
            f"{shown(path)}, line {line}, column {name}: expected times {interval:g} s apart, "
            f"came {float(steps[off[0]]) if off.size else interval:g} s",
            hint="a gap is no noise: cut the record there, or tell --rate",
        )
    return interval
