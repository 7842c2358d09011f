"""The data sheet: every value with an uncertainty that results hold, and their own remarks."""

import re
from collections.abc import Iterator, Sequence
from typing import Any

from msgspec import Struct

from vcfbench.records.stated import values_of
from vcfbench.reports.document import Report, Table, Text, heads
from vcfbench.uncertainty.measurand import stated_cells


class SheetRow(Struct, frozen=True):
    """One line of the data sheet; `u` and `u95` are None if the procedure gives none."""

    quantity: str
    value: float
    u: float | None
    u95: float | None
    unit: str
    conditions: str
    procedure: str


def sheet_rows(procedure: str, results: Any, conditions: str) -> Iterator[SheetRow]:
    """Yield the rows that `results` of `procedure` put on a data sheet: the values that they state."""
    for each in values_of(results).values():
        words, value = each.named.words, each.value
        least, most = each.ends
        match each.form:
            case "size-below":
                words, value = f"size of the {words}{_BOUND}", most
            case "below":
                words, value = f"{words}{_BOUND}", most
            case "at-least":
                words, value = f"{words}, at least", least
            case "interval":
                words = f"{words}, from {least:.2g} to {most:.2g} (95 %)"
        if value is not None:
            yield SheetRow(words, value, each.u, each.u95, each.unit, conditions, procedure)


_BOUND = ", below (95 %)"


def data_sheet_report(rows: Sequence[SheetRow], not_measured: Sequence[tuple[str, str]], common: str) -> Report:
    """Return the report of a data sheet."""
    columns = heads("<quantity | value:.7g | U95:.2g | u:.2g | <unit | <conditions | <procedure")
    table: list[Any] = []
    for row in rows:
        value, u, u95 = _cells(row)
        table.append((row.quantity, value, u95, u, row.unit, row.conditions, row.procedure))
    said = [
        f"all: {common}, one session",
        "U95 holds the true value with 95 %; what it holds and what not, each procedure says in its own report",
        *(f"not measured: {name}: {reason}" for name, reason in not_measured),
    ]
    sheet = Table(columns, table, "Data sheet")
    return Report([sheet, Text("\n".join(said)), *_model_equation(rows), *_ieee_2700(rows, not_measured)])


_TERMS = (
    ("S", "sensitivity", "scale factor", "V/(deg/s)"),
    ("D_F", "zero-rate output", "bias", "deg/s"),
    ("D_N", "noise density", "angle random walk", "deg/sqrt(h)"),
    ("D_B", "bias instability", "bias instability", "deg/h"),
    ("D_K", "", "rate random walk", "(deg/h)/sqrt(h)"),
    ("D_R", "", "rate ramp", "(deg/h)/h"),
    ("E_T", "zero-rate output over temperature", "temperature coefficient of the bias", ""),
    ("E_U", "zero-rate output over supply", "bias by both rails", ""),
    ("eps_T", "sensitivity over temperature", "temperature coefficient of the scale factor", ""),
    ("eps_U", "sensitivity over supply", "scale factor by both rails", ""),
    ("eps_L", "non-linearity", "non-linearity, of the span", "ppm"),
    ("", "bandwidth", "-3 dB", "Hz"),
    ("", "supply current", "supply current, positive rail", "A"),
    ("", "turn-on time", "time to valid output, both rails together", "s"),
)
"""Terms of the model equation: sign, name in IEEE 2700 (unverified), and quantity and unit on the data sheet."""


def _model_equation(rows: Sequence[SheetRow]) -> list[Table | Text]:
    """Return the model equation (IEEE 952; 1431, 8.3: texts not at hand, unverified) with its measured terms."""
    found: list[tuple[Any, ...]] = []
    missing = []
    for sign, name, quantity, unit in _TERMS:
        row = _row_of(rows, quantity, unit)
        if row is None:
            missing.append(sign or name)
            continue
        found.append((sign, row.quantity, *_cells(row), row.unit, name))
    if not {"S", "D_F"} <= {row[0] for row in found}:
        return []
    said = [
        "V = S (1 + 1e-6 eps) (Omega_z + E + D)",
        "  D = D_F + random drift (D_N, D_B, D_K, D_R); E = E_T (T - T0) + E_U (U - U0)",
        "  eps = eps_T (T - T0) + eps_U (U - U0) + curvature, of which eps_L is the largest part of the span",
        "the form of IEEE 952 and 1431 divides by (1 + 1e-6 eps): its eps has the other sign (unverified)",
        *([f"not measured: {', '.join(missing)}"] if missing else []),
    ]
    columns = heads("<term | <quantity | value:.7g | u:.2g | U95:.2g | <unit | <in IEEE 2700 (unverified)")
    return [Table(columns, found, "Model equation"), Text("\n".join(said))]


def line_of(rows: Sequence[SheetRow]) -> str:
    """Return the procedure from which values that several procedures measure are stated."""
    return next((each.procedure for each in rows if each.quantity.endswith("scale factor")), "")


def _row_of(rows: Sequence[SheetRow], quantity: str, unit: str) -> SheetRow | None:
    """Return the row of a quantity, that of the first line before those of others: scale factor and bias are of one."""
    line = line_of(rows)
    named = quantity, re.sub("both rails( together)?", "the rail", quantity)  # of one supply
    fitting = [
        each
        for each in rows
        if each.quantity.removesuffix(_BOUND).rpartition(": ")[2] in named and each.unit.endswith(unit)
    ]
    return min(fitting, key=lambda each: each.procedure != line, default=None)


def _cells(row: SheetRow) -> tuple[Any, Any, Any]:
    if row.u is None or row.u95 is None:
        return row.value, row.u, row.u95
    return stated_cells(row.value, row.u, row.u95)


_SHEET = (
    ("full scale, positive", "positive input rate limit", "deg/s", "rate-limits", ""),
    ("full scale, negative", "negative input rate limit", "deg/s", "rate-limits", ""),
    ("sensitivity", "scale factor", "V/(deg/s)", "turntable", ""),
    ("sensitivity error over temperature", "temperature coefficient of the scale factor", "", "temperature", ""),
    ("cross-axis sensitivity", "", "", "", "the bench turns about one axis"),
    ("zero-rate output", "bias", "deg/s", "turntable", ""),
    ("zero-rate output over temperature", "temperature coefficient of the bias", "", "temperature", ""),
    ("noise density", "angle random walk", "deg/sqrt(h)", "zero", ""),
    ("non-linearity", "non-linearity, of the span", "ppm", "turntable", ""),
    ("turn-on time", "time to valid output, both rails together", "s", "power", ""),
    ("bandwidth", "-3 dB", "Hz", "bandwidth", ""),
    *(
        (f"sensitivity to linear acceleration, {axis}", f"bias by acceleration along {axis}", "/g", "g-sensitivity", "")
        for axis in "xyz"
    ),
    ("vibration rectification", "", "", "", "the bench has no shaker"),
)
"""Parameters of a gyroscope as IEEE 2700 orders them (from memory and public summaries: the text was not at hand).

Each has quantity and unit on the data sheet, the procedure that measures it, or why none does.
"""


def _ieee_2700(rows: Sequence[SheetRow], not_measured: Sequence[tuple[str, str]]) -> list[Table | Text]:
    """Return the parameters of IEEE 2700 in its order; of each unmeasured one the reason."""
    left_out, table = dict(not_measured), []
    for name, quantity, unit, procedure, why in _SHEET:
        row = _row_of(rows, quantity, unit) if quantity else None
        if row is not None:
            what = ", ".join(filter(None, (row.quantity, row.conditions)))
            table.append((name, *_cells(row), row.unit, f"{what} ({row.procedure})"))
            continue
        done = any(each.procedure == procedure for each in rows)
        by = f"{procedure} did not find it" if done else left_out.get(procedure, f"run {procedure}")
        table.append((name, None, None, None, "", f"not measured: {why or by}"))
    columns = heads("<parameter | value:.7g | u:.2g | U95:.2g | <unit | <conditions")
    said = "parameters and their order are those of IEEE 2700 from memory and public summaries (unverified)"
    return [Table(columns, table, "Sheet in the order of IEEE 2700"), Text(said)] if rows else []
