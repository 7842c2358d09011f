"""Results and reports of one's own procedure, from the run to the record that is read without its code."""

from __future__ import annotations

import json
import pickle
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest

import vcfbench
from tests.cells import few
from vcfbench.errors import PlanError
from vcfbench.station.file import embedded_text

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from vcfbench import Plan, Point, Run
    from vcfbench.station.settings import ProcedureSettings

QUICK = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5}


@dataclass(frozen=True, slots=True)
class Swing:
    """What it came to."""

    width: vcfbench.Value
    outputs_v: Any
    bias_v: float
    count: int = 3


class Lean(msgspec.Struct, frozen=True):
    """The same without a dataclass."""

    bias_v: float


def swing(_settings: object, points: Sequence[Point]) -> Swing:
    outputs = np.array([point.output_v for point in points])
    width = vcfbench.Value("width", np.ptp(outputs), "V", np.float64(1e-5))
    return Swing(width, outputs, outputs.mean())


def procedure(results: Callable[[Any, Sequence[Point]], Any], **changes: Any) -> vcfbench.Procedure[Any, Any]:
    turntable = vcfbench.PROCEDURES["turntable"]

    def plan(settings: ProcedureSettings) -> Plan:
        return turntable.plan(settings)

    own = vcfbench.Procedure(
        name="swing", title="Measure how far it swings.", settings=turntable.settings, plan=plan, results=results
    )
    return msgspec.structs.replace(own, **changes)


def perform(runs: Path, results: Callable[[Any, Sequence[Point]], Any], **changes: Any) -> Run:
    return vcfbench.run(procedure(results, **changes), settings=QUICK, runs=runs)


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return perform(tmp_path_factory.mktemp("own"), swing)


def test_frozen_value_is_result_written_by_fields(own: Run) -> None:
    assert isinstance(own.results, Swing)
    assert own.directory is not None
    written = json.loads((own.directory / "result.json").read_text())["results"]
    assert list(written) == ["width", "outputs_v", "bias_v", "count"]
    width = {"name": "width", "value": own.results.width.value, "u": 1e-5, "unit": "V", "form": "plus-minus"}
    assert written["width"].items() >= width.items()
    assert written["outputs_v"] == [point.output_v for point in own.points]
    assert own.as_json()["results"] == written


def test_each_field_of_the_result_is_described(own: Run) -> None:
    assert own.directory is not None
    page = (Path(__file__).parents[1] / "docs" / "records.md").read_text(encoding="utf-8")
    table = page.partition("## Beside the journal\n")[2].partition("\n## ")[0]
    described = [name for names in re.findall(r"^\| (`.+?) \|", table, re.MULTILINE) for name in names.split(", ")]
    written = json.loads((own.directory / "result.json").read_text())
    assert {f"`{name}`" for name in written} <= set(described)


def test_a_procedure_without_a_report_has_points_and_fields(own: Run) -> None:
    text = vcfbench.text_of(own.report())
    assert "rate / (deg/s)" in text
    assert "\nwidth  " in text
    assert "\noutputs_v  " in text
    assert "<table>" in own._repr_html_()


def test_a_record_is_read_without_the_code_that_made_it(own: Run) -> None:
    assert own.directory is not None
    again = vcfbench.load_run(own.directory)
    assert (again.status, again.points, again.error) == ("complete", own.points, None)
    assert again.no_results == "the procedure 'swing' is not known here"
    assert again.results == json.loads((own.directory / "result.json").read_text(), object_hook=_tuples)["results"]
    assert again.results["width"]["unit"] == "V"
    assert again.as_json() == own.as_json()
    with pytest.raises(TypeError):
        again.results["count"] = 4
    assert pickle.loads(pickle.dumps(again)) == again  # noqa: S301  # ours
    shown = vcfbench.text_of(again.report())
    assert shown.startswith(vcfbench.text_of(own.report()))
    assert "\nsamples  " in shown


@pytest.mark.exhaustive
def test_uncomputable_results_are_shown_as_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = vcfbench.run("turntable", settings=QUICK, runs=tmp_path)

    def broken(*_: object) -> None:
        raise RuntimeError("not today")

    monkeypatch.setattr("vcfbench.uncertainty.columns.characterise", broken)
    again = vcfbench.load_run("last", tmp_path)
    assert again.no_results is not None
    assert again.no_results.startswith("the points give no result: ")
    assert again.no_results.endswith("RuntimeError: not today")
    assert again.as_json() == run.as_json()
    assert again.results["scale_factor"]["value"] == run.results.scale_factor.value


def _tuples(values: dict[str, Any]) -> dict[str, Any]:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}


@pytest.mark.parametrize(
    ("results", "verdict"),
    few([(swing, "fail"), (lambda _s, _p: Lean(0.3), "pass"), (lambda _s, _p: {"n": 1}, None)], (swing, "fail")),
)
def test_limits_judge_numbers_of_their_name_and_are_recorded(
    results: Callable[[Any, Sequence[Point]], Any], verdict: str | None, tmp_path: Path
) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(embedded_text("paper") + "\n[acceptance]\nbias_v = [0.1, 0.5]\nk_vc_deg_s_per_v = [1, 2]\n")
    run = vcfbench.run(procedure(results), bench, settings=QUICK, runs=tmp_path)
    again = vcfbench.load_run("last", tmp_path)
    assert again.verdict == run.verdict
    assert verdict == (None if run.verdict is None else run.verdict.as_json()["verdict"])
    if again.verdict is not None:
        assert [limit.word for limit in again.verdict.limits] == [verdict, "not measured"]


@pytest.mark.parametrize(
    ("results", "words"),
    few(
        [
            (lambda _s, _p: {"a": [float("nan")]}, r"results\.a\[0\]: expected a finite number or None, got nan"),
            (lambda _s, _p: {"a": object()}, r"results\.a: expected numbers, texts, lists, .* got a object"),
            (lambda _s, points: points[99], r".*test_own_results\.py, line \d+: IndexError: tuple index out of range"),
        ],
        every=3,
    ),
)
def test_invalid_result_removes_results_not_record(
    results: Callable[[Any, Sequence[Point]], Any], words: str, tmp_path: Path
) -> None:
    """The mistake is in the procedure's code: it is no fault of the leads, and its points are not lost."""
    with pytest.raises(PlanError, match=f"the points give no result: {words}") as caught:
        perform(tmp_path, results)
    assert len(caught.value.run.points) == 3
    assert (caught.value.exit_code, "resume with --procedure FILE" in str(caught.value)) == (2, True)
    again = vcfbench.load_run("last", tmp_path)
    assert (again.status, again.points, again.results) == ("aborted", caught.value.run.points, None)
    assert caught.value.run.report().parts == again.report().parts


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("report", "words"),
    [
        (lambda _s, _p, results: results.nothing, ": AttributeError: 'Swing' object has no attribute 'nothing'"),
        (lambda _s, _p, _r: "words", ": it returned a str"),
        (
            lambda _s, _p, _r: vcfbench.Report([vcfbench.Table([vcfbench.Column("a")], [(1, 2)])]),
            ": ValueError: row 1 of a table of 1 columns has 2 values",
        ),
    ],
)
def test_a_report_that_fails_costs_nothing_but_itself(report: Any, words: str, tmp_path: Path) -> None:
    run = perform(tmp_path, swing, report=report)
    assert run.status == "complete"
    text = vcfbench.text_of(run.report())
    begin = text.rindex("the report of swing failed: ")
    last = " ".join(text[begin:].split())
    assert last.endswith(words)
    assert (f"{__file__}, line " in last) == ("Error" in words)
    assert "\nwidth  " in text


def test_a_report_of_ones_own_is_that_of_the_run(tmp_path: Path) -> None:
    def report(_settings: object, points: Sequence[Point], results: Swing) -> vcfbench.Report:
        rows = [(point.rate_deg_s, point.output_v) for point in points]
        table = vcfbench.Table([vcfbench.Column("rate", "deg/s", "g"), vcfbench.Column("output", "V", ".2f")], rows)
        return vcfbench.Report([table, vcfbench.Text(f"{results.count} points")])

    run = perform(tmp_path, swing, report=report)
    assert vcfbench.text_of(run.report()).splitlines()[-1] == "3 points"
    assert run.report().parts[0].rows == tuple((p.rate_deg_s, p.output_v) for p in run.points)  # type: ignore[union-attr]
