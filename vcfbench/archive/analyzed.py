"""The whole analysis of a calibration table that was measured elsewhere, from its file."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct

from vcfbench.analysis import csv_table
from vcfbench.analysis.nonlinearity import DEFINITIONS
from vcfbench.analysis.scale_factor import Comparison, ScaleFactorResult, characterise, compare
from vcfbench.errors import ConfigError
from vcfbench.files import MOST_TABLE, read_file, shown
from vcfbench.reports.document import Axis, Cell, Column, Figure, Report, Series, Table, Text, texts


class TableAnalysis(Struct, frozen=True):
    """Results of a table: of each column its `series`, and the `comparison` of two of them.

    `compared` names those two, reference first; both are None where nothing was compared.
    """

    series: dict[str, ScaleFactorResult]
    compared: tuple[str, str] | None
    comparison: Comparison | None

    def as_json(self) -> dict[str, Any]:
        """Return it as ``vcfbench analyze --json`` prints it."""
        compared: dict[str, Any] | None = None
        if self.compared is not None and self.comparison is not None:
            reference, other = self.compared
            compared = {"reference": reference, "other": other, **self.comparison.as_json()}
        return {"series": {name: result.as_json() for name, result in self.series.items()}, "comparison": compared}

    def report(self) -> Report:
        """Return the lines, their non-linearities and residuals, and the comparison of two where there is one."""
        found = self.series.values()
        columns = [Column(name) for name in self.series]
        fits: list[tuple[Cell | float | str, ...]] = [
            ("scale factor, mV/(deg/s)", *(Cell(1e3 * each.line.scale_factor, ".6f") for each in found)),
            ("  u_fit, mV/(deg/s)", *(Cell(1e3 * each.u_fit_scale_factor, ".2g") for each in found)),
            ("bias, mV", *(Cell(1e3 * each.line.bias, ".4f") for each in found)),
            ("  u_fit, mV", *(Cell(1e3 * each.u_fit_bias, ".2g") for each in found)),
            ("bias, deg/s", *(Cell(each.line.bias_deg_s, ".4f") for each in found)),
            ("residual std, mV", *(Cell(1e3 * each.line.s_v, ".4f") for each in found)),
            ("degrees of freedom", *(each.line.dof for each in found)),
        ]
        bends: list[tuple[Cell | float | str, ...]] = [
            (name, *(Cell(each.nonlinearity_ppm[name], ".1f") for each in found), words)
            for name, words in DEFINITIONS.items()
        ]
        ppm = [1e6 / abs(each.line.scale_factor) / float(np.ptp(each.rate_deg_s)) for each in found]
        drawn = [
            Series(name, each.rate_deg_s.tolist(), (of_span * each.line.residuals_v).tolist())
            for of_span, (name, each) in zip(ppm, self.series.items(), strict=True)
        ]
        residual = Axis("residual of the span", "ppm")
        return Report(
            [
                Table([*texts(""), *columns], fits, "Least-squares line"),
                Text("u_fit: of the fit alone, lack of fit included; of points alone no combined u is known"),
                Table([*texts(""), *columns, *texts("definition")], bends, "Non-linearity and asymmetry, ppm"),
                Text("full scale: |K| times the largest rate; reading: from 10 deg/s on"),
                *self._compared(),
                Figure("Residuals of the least-squares line", Axis("Omega_z", "deg/s"), residual, drawn),
            ]
        )

    def _compared(self) -> Iterator[Table]:
        found = self.comparison
        if self.compared is None or found is None:
            return
        rows = [
            ("scale factor error, %", Cell(found.scale_factor_error_percent, ".3f")),
            ("  u_fit, percentage points", Cell(found.u_fit_scale_factor_error_percent, ".3f")),
            ("  from slopes rounded to five decimals, %", Cell(found.scale_factor_error_percent_rounded, ".3f")),
            ("E_n of the fits' scatter alone, no verdict", Cell(found.e_n, ".2f")),
            ("bias difference, mV", Cell(1e3 * found.bias_difference_v, ".3f")),
        ]
        yield Table([*texts(""), Column("")], rows, f"{self.compared[1]} against {self.compared[0]}")


def analyze(file: Path | str, compared: Sequence[str] | None = None) -> TableAnalysis:
    """Analyse a table that was measured elsewhere, as ``vcfbench analyze`` does: a CSV file of rates and outputs.

    The first column is ``rate_deg_s``, every other one an output, V, or the standard uncertainty of one. `compared`
    names two columns, reference first; two columns are compared by default.

    Raises:
        ConfigError: there is no such file or column, or what is in it is no such table: file, line and column are told.
    """
    path = Path(file)
    text = csv_table.decode(read_file(file, "a CSV file", MOST_TABLE), shown(path))
    series = csv_table.parse_table(text, shown(path))
    pair = _compared_columns(compared, list(series), path)
    results = {}
    for column, one in series.items():
        try:
            results[column] = characterise(one.rate_deg_s, one.output_v, one.u_output_v)
        except ConfigError as error:
            raise ConfigError(f"{shown(path)}, column {column}: {error}") from error
    comparison = None if pair is None else compare(results[pair[0]], results[pair[1]])
    return TableAnalysis(results, pair, comparison)


def _compared_columns(asked: Sequence[str] | None, columns: list[str], file: Path) -> tuple[str, str] | None:
    """Return the two columns to compare, reference first, or None; raises ConfigError for an unknown one."""
    if asked is None:
        return (columns[0], columns[1]) if len(columns) == 2 else None
    if isinstance(asked, str) or len(asked) != 2:
        raise ConfigError(f"expected the names of two columns to compare, came {asked!r}")
    for name in asked:
        if name not in columns:
            raise ConfigError(f"{shown(file)} has no column {name!r}, only {', '.join(columns)}")
    return asked[0], asked[1]
