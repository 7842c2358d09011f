"""Statistics of the runs of a study, case by case: mean, spread, coverage, pass rate."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from msgspec import Struct

from vcfbench.reports.document import Cell, Table, Value, heads, texts
from vcfbench.studies.metrics import PARTS
from vcfbench.studies.one_run import RunRow
from vcfbench.studies.table import in_words

_QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


class MetricSummary(Struct, frozen=True):
    """One metric over the runs of a case that have it.

    `sd` is None of a single run. `u` is the root mean square of the stated standard uncertainties; `z_mean` and `z_sd`
    are of (value - truth)/u, `coverage` the share of runs whose U95 holds the truth; each None where it is not known.
    """

    n: int
    mean: float
    sd: float | None
    least: float
    most: float
    quantiles: dict[str, float]
    u: float | None = None
    z_mean: float | None = None
    z_sd: float | None = None
    coverage: float | None = None


class CaseSummary(Struct, frozen=True):
    """One case: its values by label, runs by how they ended, share of runs that passed, metrics by name.

    `pass_rate` is of the runs that were judged, None where none was.
    """

    case: int
    values: dict[str, Any]
    runs: int
    complete: int
    pass_rate: float | None
    metrics: dict[str, MetricSummary]


def summaries(rows: Sequence[RunRow], values: Mapping[int, Mapping[str, Any]]) -> tuple[CaseSummary, ...]:
    """Return the summary of every case of the sorted `rows`; `values` are those of each case, by label."""
    cases: dict[int, list[RunRow]] = {}
    for row in rows:
        cases.setdefault(row.case, []).append(row)
    found = []
    for number, of_case in cases.items():
        judged = [row.verdict == "pass" for row in of_case if row.verdict is not None]
        names = dict.fromkeys(name for row in of_case for name in row.metrics if not name.endswith(PARTS))
        summary = CaseSummary(
            case=number,
            values=dict(values.get(number, {})),
            runs=len(of_case),
            complete=sum(row.status == "complete" for row in of_case),
            pass_rate=sum(judged) / len(judged) if judged else None,
            metrics={name: metric for name in names if (metric := _metric(name, of_case)) is not None},
        )
        found.append(summary)
    return tuple(found)


def _metric(name: str, rows: Sequence[RunRow]) -> MetricSummary | None:
    def numbers(of: str) -> list[float]:
        return [float(row.metrics[of]) for row in rows if row.metrics.get(of) is not None]

    found, z, covered = numbers(name), numbers(f"{name}.z"), numbers(f"{name}.covered")
    if not found:
        return None
    stated = np.array(numbers(f"{name}.u"))
    spread = np.quantile(found, _QUANTILES)
    return MetricSummary(
        n=len(found),
        mean=float(np.mean(found)),
        sd=float(np.std(found, ddof=1)) if len(found) > 1 else None,
        least=min(found),
        most=max(found),
        quantiles={f"{share:g}": float(each) for share, each in zip(_QUANTILES, spread, strict=True)},
        u=float(np.sqrt(np.mean(stated**2))) if stated.size else None,
        z_mean=float(np.mean(z)) if z else None,
        z_sd=float(np.std(z, ddof=1)) if len(z) > 1 else None,
        coverage=float(np.mean(covered)) if covered else None,
    )


def headlines(cases: Sequence[CaseSummary]) -> tuple[str, ...]:
    """Return the metrics to show: those stated with an uncertainty, or where there are none, all."""
    stated = dict.fromkeys(name for case in cases for name, each in case.metrics.items() if each.u is not None)
    return tuple(stated or dict.fromkeys(name for case in cases for name in case.metrics))


def summary_table(cases: Sequence[CaseSummary]) -> Table:
    """Return mean, spread and coverage as a table, metric after metric, a row a case."""
    labels = list(dict.fromkeys(label for case in cases for label in case.values))
    columns = [
        *texts("metric", *(".".join(label.split(".")[-2:]) for label in labels)),
        *heads("n | mean:.6g | sd:.6g | 5 %:.6g | 95 %:.6g | u:.6g | z mean:+.2f | z sd:.2f | in U95"),
    ]
    rows: list[list[Value | Cell]] = []
    for name in headlines(cases):
        for case in cases:
            if (each := case.metrics.get(name)) is not None:
                spread = (each.mean, each.sd, each.quantiles["0.05"], each.quantiles["0.95"], each.u)
                stated = (each.z_mean, each.z_sd, _percent(each.coverage))
                rows.append([name, *_values(case, labels), each.n, *spread, *stated])
    if any(case.pass_rate is not None for case in cases):
        rows += [
            ["passed", *_values(case, labels), case.complete, _percent(case.pass_rate), *[None] * 7] for case in cases
        ]
    return Table(columns, rows, title="by case" if labels else "")


def _values(case: CaseSummary, labels: Sequence[str]) -> list[str | None]:
    return [in_words(case.values[label]) if label in case.values else None for label in labels]


def _percent(share: float | None) -> Cell | None:
    return None if share is None else Cell(100.0 * share, ".1f", "%")
