"""The whole analysis of a calibration table that was measured elsewhere, from its file."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from msgspec import Struct

from vcfbench.analysis.csv_table import Series, decode, parse_table
from vcfbench.analysis.scale_factor import Comparison, ScaleFactorResult, characterise, compare
from vcfbench.errors import ConfigError
from vcfbench.files import MOST_TABLE, read_file, shown


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


def analyze(file: Path | str, compared: Sequence[str] | None = None) -> TableAnalysis:
    """Analyse a table that was measured elsewhere, as ``vcfbench analyze`` does: a CSV file of rates and outputs.

    The first column is ``rate_deg_s``, every other one an output, V, or the standard uncertainty of one. `compared`
    names two columns, reference first; two columns are compared by default.

    Raises:
        ConfigError: there is no such file or column, or what is in it is no such table: file, line and column are told.
    """
    path = Path(file)
    series = read_series(path)
    pair = compared_columns(compared, list(series), path)
    results = {}
    for column, one in series.items():
        try:
            results[column] = characterise(one.rate_deg_s, one.output_v, one.u_output_v)
        except ConfigError as error:
            raise ConfigError(f"{shown(path)}, column {column}: {error}") from error
    comparison = None if pair is None else compare(results[pair[0]], results[pair[1]])
    return TableAnalysis(results, pair, comparison)


def read_series(file: Path) -> dict[str, Series]:
    """Read the table in `file`; raises ConfigError with file, line and column."""
    return parse_table(decode(read_file(file, "a CSV file", MOST_TABLE), shown(file)), shown(file))


def compared_columns(asked: Sequence[str] | None, columns: list[str], file: Path) -> tuple[str, str] | None:
    """Return the two columns to compare, reference first, or None; raises ConfigError for an unknown one."""
    if asked is None:
        return (columns[0], columns[1]) if len(columns) == 2 else None
    if isinstance(asked, str) or len(asked) != 2:
        raise ConfigError(f"expected the names of two columns to compare, came {asked!r}")
    for name in asked:
        if name not in columns:
            raise ConfigError(f"{shown(file)} has no column {name!r}, only {', '.join(columns)}")
    return asked[0], asked[1]
