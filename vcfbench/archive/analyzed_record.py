"""Noise of a record at rest that was taken elsewhere, from its file: Allan deviation, N, B, K, R, stability."""

import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from shlex import quote
from typing import Any, Final

import numpy as np
from msgspec import Struct

from vcfbench.analysis.allan import BiasStability, Sampling, Term
from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.cells import clock_period_s, fraction_digits
from vcfbench.analysis.column_names import KNOWN, ColumnName, Kind, cure_of, with_unit
from vcfbench.analysis.column_roles import may_be_output, says_source
from vcfbench.analysis.csv_table import Head, Layout, Numbers, read_head, read_numbers
from vcfbench.analysis.digit import COARSE, FINE, digit_of
from vcfbench.analysis.pace import pace_of
from vcfbench.analysis.plausibility import doubts_of_record
from vcfbench.archive.table_files import opened_table
from vcfbench.errors import ConfigError
from vcfbench.files import shown
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
from vcfbench.records.plain import plain
from vcfbench.reports.document import Heading, Notice, Report, Text, facts

_FEWEST: Final = 64
_AGREE: Final = 0.01
"""Part by which a stated rate may differ from that of the times."""
_UNEVEN: Final = 0.1
"""Part of the interval by which times scatter that are not even."""
_LINES: Final = 2.0
"""Lines by which the number between two changes of the time may be off."""
_FEW_MISSING: Final = 0.01
_MOST_HZ: Final = 1e9
_DAYS_FROM: Final = 3e4
"""Days from 1900 to 1982: times before it are no dates of a spreadsheet."""
_AS_DAYS_S: Final = 2e-5
"""Interval of readings a second apart, if days are taken for seconds."""
_MOST_SENSORS: Final = 16
_BY_TURNS: Final = 0.25
"""Part of the lines that have another sensor than the one before."""
_LATEST_S: Final = 1e11
"""Beyond it times in seconds are no date, be they counted from 1970, 1601 or 0: the year 3000 is at 9.5e10 s from 0."""
_ANALYSED: Final = (Kind.RATE, Kind.VOLTAGE, Kind.COUNT)


class RecordAnalysis(Struct, frozen=True):
    """Noise of one column: its name, readings, interval, mean, and the findings of :func:`record_noise`.

    `u_digit_deg_s` is what the last digit leaves open of the mean, 0 where noise spans it. `taken_as` says what its
    numbers were taken for; `notices` what is odd about the file, each with its line; `densities` N and K in
    deg/s/sqrt(Hz), rad/s/sqrt(Hz), deg/s^2/sqrt(Hz), rad/s^2/sqrt(Hz), as filters take them: of a two-sided spectrum,
    so that white noise of N at f readings a second has the standard deviation N sqrt(f).

    >>> found = vcfbench.analyze_record("rest.csv", rate_hz=10.0)
    >>> f"{found.samples} readings, mean {found.mean_deg_s:.2f} deg/s"
    '500 readings, mean 0.01 deg/s'
    >>> found.noise[0].name, found.noise[0].unit
    ('angle_random_walk', 'deg/sqrt(h)')
    """

    column: str
    taken_as: str
    notices: tuple[str, ...]
    samples: int
    interval_s: float
    mean_deg_s: float
    u_digit_deg_s: float
    noise: tuple[NoiseCoefficient, ...]
    allan_deg_h: tuple[AllanRow, ...]
    stability_deg_h: BiasStability
    fitted_from_s: float
    fitted_to_s: float
    densities: dict[str, float | None]
    described: bool
    remarks: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Return it as ``vcfbench analyze --json`` prints it."""
        found: dict[str, Any] = plain(self)
        return found

    def report(self) -> Report:
        """Return tables and figure."""
        rows = [
            ("column", self.column),
            ("taken as", self.taken_as),
            ("readings", f"{self.samples}, one every {self.interval_s:g} s: {self.samples * self.interval_s:g} s"),
            ("mean", f"{self.mean_deg_s:.6g} deg/s"),
        ]
        if self.u_digit_deg_s:
            rows.append(("  u of the digit", f"{self.u_digit_deg_s:.2g} deg/s"))
        return Report(
            [
                Heading(f"Noise of {self.column}"),
                facts(rows),
                *(Notice(each) for each in self.notices),
                noise_table(self.noise),
                *map(Text, self.remarks),
                *(Text(f"{name}, two-sided: {value:.4g}") for name, value in self.densities.items() if value),
                stability_table(self.stability_deg_h),
                allan_table(self.allan_deg_h),
                Text(
                    "The record counts as gapless: each reading as the mean over its whole interval. Bounds hold the "
                    "true value with 95 % where the curve follows these powers of the time, of which the averages from "
                    f"{self.fitted_from_s:g} to {self.fitted_to_s:g} s were fitted (IEEE 952, annex C)."
                ),
                allan_figure(self.allan_deg_h, 1.0),
            ]
        )


def analyze_record(
    file: Path | str,
    rate_hz: float | None = None,
    *,
    scale_factor_per_deg_s: float | None = None,
    layout: Layout | None = None,
    progress: Callable[[float], None] | None = None,
) -> RecordAnalysis:
    """Analyse a record at rest, as ``vcfbench analyze --rate`` does: a text file with one line per reading.

    Args:
        file: its first line names the columns, with their units: ``rate / (deg/s)``, ``gyro_z [mdps]``, ``output_v``.
        rate_hz: readings a second; None where a column of times tells it.
        scale_factor_per_deg_s: of an output in volts, V/(deg/s); of one in counts, LSB/(deg/s).
        layout: how the file is to be read, where it does not tell by itself; the column of several that is analysed.
        progress: is told the part of the file that is read.

    Raises:
        ConfigError: file, line and column of what cannot be read; a unit that is none; a stated rate that the times
            contradict.

    >>> found = vcfbench.analyze_record("rest.csv", rate_hz=10.0)
    >>> list(found.densities)
    ['N, deg/s/sqrt(Hz)', 'N, rad/s/sqrt(Hz)', 'K, deg/s^2/sqrt(Hz)', 'K, rad/s^2/sqrt(Hz)']
    """
    path, layout = Path(file), layout or Layout()
    if rate_hz is not None and not 0.0 < rate_hz <= _MOST_HZ:
        raise ConfigError(f"--rate: expected readings a second, at most {_MOST_HZ:g}, got {rate_hz:g}")
    with opened_table(path) as raw:
        head = read_head(raw, shown(path), layout)
        place = record_place(head, layout)
        require_one_sensor(head)
        name = head.names[place]
        if unit := layout.units.get(""):
            name = with_unit(name, unit)
        factor, taken_as = factor_to_rate(name, scale_factor_per_deg_s, head.file)
        time = None if layout.time == "none" else _time_place(head, layout, place)
        numbers = read_numbers(raw, head, [place] if time is None else [place, time[0]], progress)
    record = np.ascontiguousarray(numbers.values[:, 0])
    record *= factor
    if record.size < _FEWEST:
        raise ConfigError(f"{head.file}: expected {_FEWEST} readings at least, got {record.size}")
    notices, begin = list[str](), 0
    if time is not None:
        times_s = _unbroken(numbers.values[:, 1] * time[1], head, time[0])
        record, interval_s, begin, notices = _piece(record, numbers, times_s, rate_hz, head)
    elif rate_hz is None:
        raise ConfigError(f"{head.file} has no column of times", hint="--rate, in readings a second, or --time NAME")
    else:
        interval_s = 1.0 / rate_hz
    doubts = doubts_of_record(record)
    notices += [f"{each.words} (first in line {numbers.line(begin + each.row)})" for each in doubts]
    del numbers
    mean_deg_s, digit, sampling = float(record.mean()), digit_of(record), Sampling.without_gaps(interval_s)
    found: RecordNoise = record_noise(
        record, sampling, corrected=False, u_bandwidth_hz=0.0, meter_deg_s=0.0, digit=digit, overwrite=True
    )
    size = digit.in_sd(round(found.fitted_from_s / interval_s))
    if not digit.step:
        notices.append("all readings are the same: the noise is below the last digit, or no sensor was read")
    elif size > FINE:
        unknown = "the mean stands within its digit, N is below its bound" if size > COARSE else "N is less its noise"
        notices.append(
            f"the last digit is {digit.step:.3g} deg/s, {size:.2g} standard deviations of the noise: {unknown}"
        )
    u_digit_deg_s = digit.step / math.sqrt(12.0) if size > COARSE else 0.0
    return RecordAnalysis(
        name.written, taken_as, tuple(notices), record.size, interval_s, mean_deg_s, u_digit_deg_s, found.coefficients,
        found.rows, found.stability, found.fitted_from_s,
        found.fitted_to_s, _densities(found), found.described, found.remarks,
    )  # fmt: skip


def require_one_sensor(head: Head) -> None:
    """Raise ConfigError for lines of several sensors by turns: a column has few words, or numbers of sensors."""
    for place, name in enumerate(head.names if head.only is None else ()):
        cells = [row[place] for row in head.sample]
        words = list(dict.fromkeys(cells))
        numbered = says_source(name) and all(map(str.isdecimal, words))
        turns = sum(first != second for first, second in pairwise(cells))
        if not (name.written and 1 < len(words) <= _MOST_SENSORS and turns > _BY_TURNS * len(cells)):
            continue
        if numbered or (head.is_text(place) and not head.is_clock(place)):
            one = next((word for word in words if word.lower().startswith("g")), words[0])
            raise ConfigError(
                f"{head.file}, column {name.written}: lines of {', '.join(words)} by turns",
                hint=f"--rows {quote(f'{name.written}={one}')} reads the lines of one",
            )


def _densities(found: RecordNoise) -> dict[str, float | None]:
    """Return N and K as densities; None where they are not stated."""
    named = {each.words: each.value if each.u is not None else None for each in found.coefficients}
    densities = dict[str, float | None]()
    for name, term, in_data_sheets, unit in (
        ("N", Term.ANGLE_RANDOM_WALK, 60.0, "s"),
        ("K", Term.RATE_RANDOM_WALK, 3600.0 * 60.0, "s^2"),
    ):
        value = named.get(term.value)
        degrees = None if value is None else value / in_data_sheets
        densities[f"{name}, deg/{unit}/sqrt(Hz)"] = degrees
        densities[f"{name}, rad/{unit}/sqrt(Hz)"] = None if degrees is None else math.radians(degrees)
    return densities


def record_place(head: Head, layout: Layout) -> int:
    """Return the column that is analysed: the one that is named, or the only one with a unit that can be."""
    names = head.names
    if len(layout.columns) not in {0, 1, len(names)}:
        raise ConfigError(f"--columns: of a record at rest one column is analysed, got {', '.join(layout.columns)}")
    if asked := head.asked(layout):
        return head.place(asked[0])
    numbers = [place for place in range(len(names)) if not head.is_text(place) and not names[place].spread]
    values = [place for place in numbers if names[place].kind in _ANALYSED]
    values = values or [place for place in numbers if names[place].unit is None and not names[place].is_time]
    if len(values) != 1:
        several = ", ".join(names[place].written for place in values) or "no column with a unit that can be analysed"
        raise ConfigError(
            f"{head.file} has the columns {several}" if values else f"{head.file} has {several}: {KNOWN}",
            hint="--columns says which one; of a table --columns RATE,OUTPUT"
            if values
            else "--columns says which one, --unit what its unit is",
        )
    return values[0]


def factor_to_rate(name: ColumnName, scale: float | None, where: str) -> tuple[float, str]:
    """Return the factor of the column to deg/s, and its assumed unit in words."""
    column, unit = f"{where}, column {name.written}", name.unit
    if unit is None or unit.kind not in _ANALYSED:
        came = name.unknown or (unit.written if unit else "none")
        raise ConfigError(
            f"{column}: expected a unit in its name, of {KNOWN}, got {came}",
            hint=cure_of(name.unknown or column, name.written) or "--unit with that of its numbers",
        )
    if unit.kind is Kind.RATE:
        if scale is not None:
            raise ConfigError(f"{column}: a scale factor is for volts or counts, but this is a rate in {unit.written}")
        return unit.factor, f"a rate in {unit.written}, {unit.factor:.9g} deg/s each"
    if scale is None or not math.isfinite(scale) or scale == 0.0:
        what = "give the scale factor" if scale is None else f"expected a scale factor other than 0, got {scale:g}"
        raise ConfigError(
            f"{column} is in {'volts' if unit.kind is Kind.VOLTAGE else 'counts'}: {what}",
            hint=f"--scale-factor, in {unit.kind.value}/(deg/s)",
        )
    each = f"{unit.factor:g} {unit.kind.value} each, over {scale:g} {unit.kind.value}/(deg/s)"
    return unit.factor / scale, f"an output in {unit.written}, {each}"


def is_record(head: Head, layout: Layout, temperature: str | None = None) -> bool:
    """Return True for a record at rest: one column is selected, or none and there are times, and no table.

    Times in the first column are enough, or a column of times that is named; beside others, and beside temperatures,
    one column alone can be analysed.
    """
    named = [each for each in head.names if each.written]
    if len(layout.columns) == 1 or not named or head.asked(layout):
        return len(layout.columns) == 1
    if named[0].is_time or layout.time not in {None, "none"}:
        return True
    values = [place for place, each in enumerate(head.names) if each.kind in _ANALYSED and may_be_output(each)]
    timed = (
        temperature is not None
        or any(each.is_time for each in named)
        or any(map(head.is_clock, range(len(head.names))))
    )
    return timed and len(values) == 1 and not _bare_outputs(head, {values[0], temperature})


def _bare_outputs(head: Head, but: set[int | str | None]) -> bool:
    """Return True if a column without a unit may be an output."""
    return any(
        place not in but and each.written and each.written not in but and each.unit is None and not each.spread
        and not head.is_text(place) and not head.is_clock(place) and may_be_output(each)
        for place, each in enumerate(head.names)
    )  # fmt: skip


def _time_place(head: Head, layout: Layout, value: int) -> tuple[int, float] | None:
    """Return the column of times and its unit in s, None where there is none."""
    if layout.time is not None:
        place = head.place(layout.time)
    else:
        dated = list(map(head.is_clock, range(len(head.names))))
        timed = [each.is_time and not head.is_text(place) for place, each in enumerate(head.names)]
        either = [place for place in range(len(timed)) if place != value and (timed[place] or dated[place])]
        if len(either) > 1:
            several = ", ".join(head.names[place].written for place in either)
            raise ConfigError(f"{head.file} has several columns of times: {several}", hint="--time NAME selects one")
        if not either:
            return None
        place = either[0]
    name = head.names[place]
    if head.is_clock(place):
        return place, 1.0
    if name.unit is None or name.unit.kind is not Kind.TIME:
        raise ConfigError(
            f"{head.file}, column {name.written}: expected a unit of time in its name, got {name.unknown or 'none'}",
            hint=f"--unit {quote(f'{name.written}=s')}, or ms, us, ns, d; --time none ignores it",
        )
    return place, name.unit.factor


def _unbroken(times_s: Floats, head: Head, place: int) -> Floats:
    """Return times of day as times that go on over midnight; raises ConfigError for what is no time in seconds."""
    if not head.is_clock(place):
        if abs(times_s[0]) > _LATEST_S:
            column = head.names[place].written
            raise ConfigError(
                f"{head.file}, column {column}: times of {times_s[0]:.4g} s are no date in s",
                hint=f"--unit {quote(f'{column}=ms')}, or us, ns; --time none --rate HZ ignores them",
            )
        return times_s
    period_s = clock_period_s(head.sample[0][place])
    times_s = times_s if period_s is None else np.unwrap(times_s, period=period_s)
    if len({fraction_digits(row[place]) for row in head.sample}) > 1 and (np.diff(times_s) < 0.0).any():
        raise ConfigError(
            f"{head.file}, column {head.names[place].written}: times with fractions of one digit and of more run "
            "backwards, as milliseconds without their zeros do",
            hint="write .005 for 5 ms",
        )
    return times_s


def _rate_without_times(times_s: Floats, head: Head) -> str:
    """Return the options that replace times of too few digits, without a number where lines are of several sensors."""
    unknown = "--time none --rate HZ, of readings a second, ignores the times"
    changes = np.flatnonzero(np.diff(times_s) != 0.0)
    if changes.size < 2 or (np.diff(times_s) < 0.0).any():
        return unknown
    lines = int(changes[-1] - changes[0])
    several = round(lines / (changes.size - 1))
    for column in zip(*head.sample, strict=True):
        if column[several:] == column[:-several] and len(set(column)) == several:
            return unknown
    span_s = float(times_s[changes[-1]] - times_s[changes[0]])
    whole, rate_hz = round(lines / span_s), lines / span_s
    rate_hz = whole if abs(whole - rate_hz) * span_s < _LINES else rate_hz
    return f"--time none --rate {rate_hz:.6g}, if each line is a reading of the same sensor"


def _piece(
    record: Floats, numbers: Numbers, times_s: Floats, rate_hz: float | None, head: Head
) -> tuple[Floats, float, int, list[str]]:
    """Return the longest piece of a record without a break, its interval and first row, and its irregularities."""
    file = head.file
    try:
        pace = pace_of(times_s)
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}", hint=_rate_without_times(times_s, head)) from error
    if rate_hz is None and times_s[0] > _DAYS_FROM and pace.interval_s < _AS_DAYS_S:
        raise ConfigError(
            f"{file}: times of {times_s[0]:.9g} s with steps of {pace.interval_s:.2g} s may be days of a spreadsheet",
            hint="--unit TIME=d, or --rate if they are seconds",
        )
    if rate_hz is not None and abs(rate_hz * pace.interval_s - 1.0) > _AGREE:
        raise ConfigError(
            f"{file}: --rate says {rate_hz:g} readings a second, the times say {1.0 / pace.interval_s:.6g}",
            hint="leave --rate out, or set the unit of the times by --unit",
        )
    notices = []
    for rows, words in (
        (pace.breaks, "breaks in the times (a gap, or a clock that was set)"),
        (pace.repeats, "times that are the one before"),
        (pace.backwards, "times before the one before"),
    ):
        if rows:
            notices.append(f"{words}: {len(rows)}, the first in line {numbers.line(rows[0])}")
    if pace.jitter_s > _UNEVEN * pace.interval_s:
        notices.append(f"the times scatter by {pace.jitter_s:.2g} s about steps of {pace.interval_s:.4g} s")
    gone = np.diff(times_s)[np.array(pace.breaks, dtype=int) - 1]
    set_back = gone[gone <= 0.0]  # of which the times tell no gap: as long as a step
    span_s = float(times_s[-1] - times_s[0] - set_back.sum()) + (1 + set_back.size) * pace.interval_s
    missing = span_s / pace.interval_s - times_s.size
    few = abs(missing) < _FEW_MISSING * times_s.size  # which move no noise by its u
    whole = f"--time none --rate {1.0 / pace.interval_s:.6g} takes all lines as even" if few else None
    if pace.breaks:
        first, last = numbers.line(pace.begin), numbers.line(pace.end - 1)
        of = f"{(pace.end - pace.begin) * pace.interval_s:.4g} of {span_s:.4g} s"
        lost = "the clock was set back" if set_back.size else f"{missing:.0f} are missing"
        cure = f" ({lost}: {whole})" if whole else ""
        notices.append(f"analysed is the longest piece without a break, lines {first} to {last}, {of}{cure}")
    piece = record[pace.begin : pace.end]
    if piece.size < _FEWEST:
        came = f"{file}: expected {_FEWEST} readings without a break in their times, got {piece.size}"
        raise ConfigError(came, hint=whole)
    return piece, pace.interval_s, pace.begin, notices
