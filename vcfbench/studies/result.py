"""Result of a study: its rows, and their statistics."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from pathlib import Path as AnyPath
from typing import Any

import msgspec
from msgspec import Struct

from vcfbench.errors import ConfigError
from vcfbench.extras import need
from vcfbench.files import shown
from vcfbench.records.export import result_text, write_text
from vcfbench.reports.document import Report, Text
from vcfbench.reports.html_page import html_of
from vcfbench.studies.figures import picture
from vcfbench.studies.journal import Begun, rows_of
from vcfbench.studies.one_run import RunRow
from vcfbench.studies.summary import CaseSummary, headlines, summaries, summary_table
from vcfbench.studies.table import Columns, columns_of, write_table


class StudyResult(Struct, frozen=True):
    """Result of a study.

    `title`, `procedure` and `bench` are those of the study. `rows` are those of the table, sorted by case and seed:
    ``status`` is ``complete`` or says how the run failed, ``metrics`` are its numbers. `values` are the varied ones,
    by case and label, `drawn` the drawn ones, by seed and label. `table_path` is the file of the table, None where
    there is none.

    >>> found = vcfbench.load_study("samples.csv")
    >>> [(row.seed, row.status) for row in found.rows]
    [(0, 'complete'), (1, 'complete')]
    """

    title: str
    procedure: str
    bench: str
    rows: tuple[RunRow, ...]
    values: Mapping[int, Mapping[str, Any]]
    drawn: Mapping[int, Mapping[str, Any]]
    table_path: Path | None = None

    @property
    def summary(self) -> tuple[CaseSummary, ...]:
        """Statistics of the runs of each case."""
        return summaries(self.rows, self.values)

    @property
    def columns(self) -> Columns:
        """The table, column by column."""
        return columns_of(
            self.rows, [{**self.values.get(row.case, {}), **self.drawn.get(row.seed, {})} for row in self.rows]
        )

    def table(self) -> Any:
        """Return the table as a pandas DataFrame, a row a run.

        Raises:
            ConfigError: pandas is not installed.
        """
        pandas = need("pandas", "export", "a table of a study")
        return pandas.DataFrame({name: list(values) for name, values in self.columns.items()})

    def report(self) -> Report:
        """Return the summary as a report: the number of runs, and a table of the headlines by case."""
        cases = self.summary
        complete = sum(case.complete for case in cases)
        said = [f"{self.title}: {self.procedure} on the {self.bench}", f"{complete} of {len(self.rows)} runs complete"]
        if (broken := next((row for row in self.rows if row.status != "complete"), None)) is not None:
            said.append(f"the first that is not: case {broken.case}, seed {broken.seed}: {broken.message}")
        return Report([Text("\n".join(said)), *([summary_table(cases)] if headlines(cases) else [])])

    def as_json(self) -> dict[str, Any]:
        """Return the contents of ``summary.json``."""
        members = {"title": self.title, "procedure": self.procedure, "bench": self.bench, "runs": len(self.rows)}
        return {**members, "cases": msgspec.to_builtins(self.summary)}

    def write(self, path: Path) -> tuple[Path, ...]:
        """Write the table to `path` (``.csv``), and summary and picture next to it; return all of them.

        Raises:
            BenchError: the disk does not take them.
        """
        summary, drawing = beside(path, ".summary.json"), beside(path, ".svg")
        write_table(path, self.columns)
        write_text(summary, result_text(self.as_json()))
        cases = self.summary
        if not headlines(cases):
            return path, summary
        write_text(drawing, picture(self.title, self.rows, cases))
        return path, summary, drawing

    def __repr__(self) -> str:
        return f"<StudyResult {self.title}: {len(self.rows)} runs of {self.procedure}, {len(self.values)} cases>"

    def _repr_html_(self) -> str:
        """Show the summary in a notebook."""
        return html_of(self.report())


def beside(path: Path, ending: str) -> Path:
    """Return the file of that ending next to the table at `path`."""
    return path.with_name(f"{path.stem}{ending}")


def of_rows(begun: Begun, rows: Iterable[RunRow], path: Path | None) -> StudyResult:
    """Return the result of the study `begun` from `rows`."""
    ordered = tuple(sorted(rows, key=lambda row: (row.case, row.seed)))
    values = {
        number: {begun.labels[path]: value for path, value in case.items()} for number, case in enumerate(begun.cases)
    }
    seeds = {row.seed for row in ordered} if begun.drawn else ()
    drawn = {seed: {each.label: each.value(seed) for each in begun.drawn} for seed in seeds}
    return StudyResult(begun.title, begun.procedure, begun.bench, ordered, values, drawn, path)


def load_study(path: str | Path) -> StudyResult:
    """Return the result of a study until now, by the path of its table, or of the journal next to it.

    Raises:
        ConfigError: there is no journal of a study.

    >>> vcfbench.load_study("samples.csv").title
    'study'
    """
    asked = AnyPath(path)
    journal = asked if asked.suffix == ".jsonl" else beside(asked, ".journal.jsonl")
    begun, rows, _ = rows_of(journal)
    if begun is None:
        raise ConfigError(f"{shown(journal)}: not a study journal: the first line has no study header")
    return of_rows(begun, rows.values(), None if journal == asked else asked)
