"""The paper as one command: its printed numbers against those of the simulated bench, its figures, its errata.

A number holds where the difference from print is at most 1.5 times both expanded uncertainties together (k = 3): that
of the run, and that of the print, which is its last digit or the scatter of its own table.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from msgspec import Struct, structs

from vcfbench.analysis.scale_factor import characterise, compare
from vcfbench.archive.written import write_document
from vcfbench.clock import WallClock
from vcfbench.errors import MeasurementError
from vcfbench.reports.document import Figure, Heading, Notice, Report, Table, Text, heads
from vcfbench.runs.conduct import run
from vcfbench.validation import paper
from vcfbench.validation.errata import Erratum, executed
from vcfbench.values.quantile import t_quantile

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from vcfbench.analysis.scale_factor import ScaleFactorResult
    from vcfbench.archive.run import Run
    from vcfbench.values.value import Value

_FIGURES: Final = {
    "Figure 3": ("bandwidth", "Response"),
    "Figure 6": ("virtual-coriolis", "Output against rate"),
    "Figure 7": ("zero", "Allan deviation"),
}
_BY_CHANCE: Final = 1.5
"""Joint expanded uncertainties (k = 2) up to which a number holds: k = 3."""
_DIGITS_HZ, _DIGITS_Q = 0.05, 0.5
_KELVIN_HZ, _KELVIN_Q = 0.12, 3.0
"""What 1 K does to the drive's frequency (-30 ppm/K) and to a quality factor (-0.2 %/K); the print says 20 degC."""


class Mark(Struct, frozen=True):
    """A printed number and that of a run, each with its expanded uncertainty."""

    where: str
    what: str
    unit: str
    printed: float
    printed_u95: float
    ours: float
    ours_u95: float

    @property
    def holds(self) -> bool:
        """True if both agree within 1.5 joint expanded uncertainties."""
        return abs(self.ours - self.printed) <= _BY_CHANCE * math.hypot(self.printed_u95, self.ours_u95)


class Article(Struct, frozen=True):
    """The paper on one simulated bench: its marks, the errata, the figures by their names, and the time it took, s."""

    seed: int
    marks: tuple[Mark, ...]
    errata: tuple[Erratum, ...]
    figures: Mapping[str, Figure]
    took_s: float

    @property
    def holds(self) -> bool:
        """True if every printed number holds, and each erratum is shown."""
        return all(each.holds for each in self.marks) and all(each.shown for each in self.errata)


def article(seed: int = 1, *, shown: Callable[[Mark], None] = lambda _: None) -> Article:
    """Make the paper's numbers, figures and errata on the embedded simulated bench with this seed.

    `shown` is called with each mark when it is known.
    """
    begun = WallClock()
    marks: list[Mark] = []
    figures: dict[str, Figure] = {}
    for each in _equations():
        marks.append(each)
        shown(each)
    for procedure, marks_of in _MARKS.items():
        done = run(procedure, "paper", seed=seed, runs=None)
        for mark in marks_of(done):
            marks.append(mark)
            shown(mark)
        drawn = [part for part in done.report().parts if isinstance(part, Figure)]
        for name, (of, title) in _FIGURES.items():
            if of == procedure:
                figures[name] = next(each for each in drawn if each.title.startswith(title))
    return Article(seed, tuple(marks), executed(), figures, begun.now())


def _lines() -> tuple[ScaleFactorResult, ScaleFactorResult]:
    """Return the two columns of the printed table, each with its line."""
    return characterise(paper.RATES_DEG_S, paper.TURNTABLE_V), characterise(paper.RATES_DEG_S, paper.VIRTUAL_V)


def _measured(where: str, what: str, unit: str, printed: tuple[float, float], value: Value) -> Mark:
    """Return the mark of a value of a run beside number and U95 of the print; `unit` is mV where its own is V."""
    times = 1e3 if unit.startswith("mV") else 1.0
    if value.value is None:
        raise MeasurementError(f"{what}: the run has no such value")
    return Mark(where, what, unit, *printed, times * value.value, times * (value.u95 or 0.0))


def _equations() -> Iterator[Mark]:
    """Yield what follows from the printed table alone: it is the print to its last digit."""
    table, virtual = _lines()
    error = compare(table, virtual).scale_factor_error_percent_rounded
    for where, what, unit, printed, digit, ours in (
        ("(17)", "scale factor, printed table", "mV/(deg/s)", -12.54, 0.005, 1e3 * table.line.scale_factor),
        ("(17)", "bias, printed table", "mV", -42.04, 0.005, 1e3 * table.line.bias),
        ("(18)", "scale factor, printed table", "mV/(deg/s)", -12.73, 0.005, 1e3 * virtual.line.scale_factor),
        ("(18)", "bias, printed table", "mV", 0.66, 0.005, 1e3 * virtual.line.bias),
        ("section 4.2", "non-linearity, printed table", "ppm", 742.0, 10.0, table.nonlinearity_ppm["max_span_rounded"]),
        ("section 4.2", "the same by V_Vc", "ppm", 3389.0, 10.0, virtual.nonlinearity_ppm["max_span_rounded"]),
        ("section 4.2", "error of the scale factor, printed table", "%", 1.515, 0.0005, error),
    ):
        yield Mark(where, what, unit, printed, digit, ours or 0.0, 0.0)


def _four_steps(done: Run) -> Iterator[Mark]:
    """Yield equations 17 and 18 and table 1 by the run."""
    table, virtual = _lines()
    yield from _column(done, 3, "turntable", table, paper.TURNTABLE_V)
    yield from _column(done, 4, "virtual", virtual, paper.VIRTUAL_V)
    relative = [each.line.u_scale_factor / each.line.scale_factor for each in (table, virtual)]
    error = structs.replace(done.values["scale_factor_error_percent"], u95=None, u=None, dof=None)
    yield _measured("section 4.2", "error of the scale factor", "%", (1.515, 200.0 * math.hypot(*relative)), error)


def _column(done: Run, step: int, name: str, fitted: ScaleFactorResult, printed_v: tuple[float, ...]) -> Iterator[Mark]:
    """Yield a column of table 1 and its line; the print scatters about a curve of third order by what that leaves."""
    line, t = fitted.line, t_quantile(0.05, len(printed_v) - 2)
    for what, unit, printed, u in (
        ("scale_factor", "mV/(deg/s)", line.scale_factor, line.u_scale_factor),
        ("bias", "mV", line.bias, line.u_bias),
    ):
        words = f"{what.replace('_', ' ')} by {name}"
        yield _measured(
            "(17)" if step == 3 else "(18)", words, unit, (1e3 * printed, 1e3 * t * u), done.values[f"{name}.{what}"]
        )
    rates = np.array(paper.RATES_DEG_S, float) / max(paper.RATES_DEG_S)
    left_v = np.array(printed_v) - np.polyval(np.polyfit(rates, printed_v, 3), rates)
    scatter_v = math.sqrt(float(left_v @ left_v) / (len(printed_v) - 4))
    points = {round(point.rate_deg_s): point for point in done.points if point.step == step}
    ours = characterise(paper.RATES_DEG_S, [points[rate].output_v for rate in paper.RATES_DEG_S])
    yield Mark(
        *("section 4.2", f"non-linearity by {name}", "ppm", fitted.nonlinearity_ppm["max_span_rounded"] or 0.0),
        2e6 * scatter_v / (max(printed_v) - min(printed_v)),
        ours.nonlinearity_ppm["max_span_rounded"] or 0.0,
        done.values[f"{name}.nonlinearity"].u95 or 0.0,
    )
    for rate_deg_s, volts in zip(paper.RATES_DEG_S, printed_v, strict=True):
        point = points[rate_deg_s]
        yield Mark(
            *("table 1", f"{name} at {rate_deg_s:g} deg/s", "mV", 1e3 * volts, 2e3 * line.s_v),
            *(1e3 * point.output_v, 2e3 * point.std_v / math.sqrt(point.n)),
        )


def _modes(done: Run) -> Iterator[Mark]:
    """Yield the modes of section 4.2, and the one of figure 2 that is measured too."""
    for where, what, name, unit, printed, digits, kelvin in (
        ("section 4.2", "drive", "drive_hz", "Hz", paper.DRIVE_HZ, _DIGITS_HZ, _KELVIN_HZ),
        ("section 4.2", "sense mode", "sense_hz", "Hz", paper.SENSE_HZ, _DIGITS_HZ, _KELVIN_HZ),
        ("section 4.2", "Q of the drive", "drive_q", "", paper.DRIVE_Q, _DIGITS_Q, _KELVIN_Q),
        ("section 4.2", "Q of the sense mode", "sense_q_ring_down", "", paper.SENSE_Q, _DIGITS_Q, _KELVIN_Q),
        ("figure 2", "sense mode, in phase", "in_phase_hz", "Hz", paper.FIGURE_2_HZ["sense in phase"], 0.5, _KELVIN_HZ),
    ):
        yield _measured(where, what, unit, (printed, math.hypot(digits, kelvin)), done.values[name])


def _band(done: Run) -> Iterator[Mark]:
    """Yield the split, and where the gain of a single mode has risen by 3 dB: at 0.54 of it."""
    split_hz = paper.DRIVE_HZ - paper.SENSE_HZ
    yield _measured("section 4.2", "split", "Hz", (split_hz, math.sqrt(2.0) * _DIGITS_HZ), done.values["split_hz"])
    alone = math.sqrt(1.0 - 1.0 / math.sqrt(2.0))
    yield Mark("section 3", "+3 dB of one mode, over its split", "", 0.54, 0.005, alone, 0.0)


def _record(done: Run) -> Iterator[Mark]:
    """Yield noise and bias stability of section 4.2.

    The latter is the least Allan deviation, most likely: of one record, so the printed one scatters as much as ours.
    """
    noise = done.values["angle_random_walk"]
    yield _measured("section 4.2", "angle random walk", "deg/sqrt(h)", (0.21, 0.005), noise)
    (figure,) = (part for part in done.report().parts if isinstance(part, Figure) and part.title.startswith("Allan"))
    as_read, gapless = figure.series[:2]
    least = int(np.argmin(gapless.y))
    low, high = as_read.low or as_read.y, as_read.high or as_read.y
    relative = 0.5 * (high[least] - low[least]) / as_read.y[least]
    ours, printed = gapless.y[least], 3.7
    what = "bias stability, least Allan deviation"
    yield Mark("section 4.2", what, "deg/h", printed, printed * relative, ours, ours * relative)


_MARKS: Final[Mapping[str, Callable[[Run], Iterator[Mark]]]] = {
    "virtual-coriolis": _four_steps,
    "resonance": _modes,
    "bandwidth": _band,
    "zero": _record,
}


def article_report(found: Article) -> Report:
    """Return the article as a document."""
    failed = [each.what for each in found.marks if not each.holds] + [e.where for e in found.errata if not e.shown]
    rows = [
        (
            *(each.where, each.what, each.printed, each.printed_u95),
            *(each.ours, each.ours_u95 or None, each.unit, _said(each.holds)),
        )
        for each in found.marks
    ]
    mistakes = [
        (e.where, e.printed, e.by_printed, e.holds, e.by_correct, e.true, e.unit, _said(e.shown)) for e in found.errata
    ]
    return Report(
        [
            Heading("The paper, executed"),
            Notice(
                f"All {len(rows)} printed numbers hold, and all {len(mistakes)} errata are shown."
                if not failed
                else f"Not so: {', '.join(failed)}.",
                "pass" if not failed else "fail",
            ),
            Text(
                "Wang, Cao, Shen, Chai: A Novel Self-Calibration Method and Experiment of MEMS Gyroscope Based on "
                "Virtual Coriolis Force, Micromachines 9 (2018). Each number is computed from the printed table, or "
                f"measured on the embedded simulated bench, seed {found.seed}. It holds within 1.5 joint expanded "
                "uncertainties (k = 3). The print's own is its last digit, or the scatter of its table."
            ),
            Table(heads("<where | <what | printed:.6g | U95:.2g | here:.6g | U95:.2g | <unit | <mark"), rows),
            *(part for name, figure in found.figures.items() for part in (Heading(name, 2), figure)),
            Heading("Errata", 2),
            Table(heads("<where | <printed | gives:.5g | <holds | gives:.5g | true:.5g | <unit | <mark"), mistakes),
        ]
    )


def _said(holds: bool) -> str:  # noqa: FBT001 - a mark is one of two words
    return "holds" if holds else "NOT SO"


def write_article(found: Article, path: Path) -> tuple[Path, ...]:
    """Write the article as ``.html``, ``.pdf`` or ``.md``; raises ConfigError where that cannot be."""
    return write_document(article_report(found), "The paper, executed", f"seed {found.seed}", path)
