"""Runs from Python: the same records as the command's, read back whole, one beside the other."""

from __future__ import annotations

import json
import pickle
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from msgspec.structs import replace
from simrack_tests.cells import few

import vcfbench
from tests import warm
from vcfbench.errors import BenchError
from vcfbench.records.journal import read_journal
from vcfbench.station.file import embedded_text, template
from vcfbench.steps import SetRate, Settle

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench import Run

QUICK = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5}
DERIVED = ("points.csv", "result.json")


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("runs")


@pytest.fixture(scope="module")
def quick(runs: Path) -> Run:
    return vcfbench.run("turntable", seed=3, settings=QUICK, runs=runs)


def record_of(run: Run) -> Path:
    assert run.directory is not None
    return run.directory


def bytes_of(directory: Path) -> list[bytes]:
    return [(directory / name).read_bytes() for name in DERIVED]


# --- the same as the command's ---


@pytest.mark.exhaustive
@pytest.mark.parametrize("procedure", few(["turntable", "virtual-coriolis"], "virtual-coriolis"))
def test_points_and_results_are_those_of_the_command(procedure: str, tmp_path: Path) -> None:
    run = vcfbench.run(procedure, seed=3, runs=tmp_path / "python")
    done = warm.run(["vcfbench", "run", procedure, "--seed", "3", "--quiet", "--json"], tmp_path)
    assert done.returncode == 0, done.stderr
    (commands,) = (tmp_path / "runs").iterdir()
    assert bytes_of(record_of(run)) == bytes_of(commands)
    answer = json.loads(done.stdout)
    assert answer.pop("not_seen") is None
    assert {**run.as_json(), "run": ""} == {**answer, "run": ""}


@pytest.mark.exhaustive
def test_settings_are_those_of_the_bench_file(quick: Run, tmp_path: Path) -> None:
    changed = embedded_text("paper").replace("\n[procedure.drive]", f"\n[procedure]\n{_toml(QUICK)}\n[procedure.drive]")
    bench = tmp_path / "quick.toml"
    bench.write_text(changed, encoding="utf-8")
    assert bytes_of(record_of(vcfbench.run("turntable", bench, seed=3, runs=tmp_path))) == bytes_of(record_of(quick))
    described = vcfbench.run("turntable", vcfbench.load_bench(bench), seed=3, runs=tmp_path)
    assert described.points == quick.points


def _toml(settings: dict[str, Any]) -> str:
    return "\n".join(f"{key} = {list(v) if isinstance(v, tuple) else v}" for key, v in settings.items())


# --- many benches in one process ---


@pytest.mark.exhaustive
def test_runs_in_one_process_do_not_see_each_other(tmp_path: Path) -> None:
    """One after another and two at once: what each gives is what a process of its own gives."""
    benches = [("paper", 1), ("ideal", 2), ("paper", 3)]
    with ThreadPoolExecutor(2) as pool:
        futures = [
            pool.submit(vcfbench.run, "turntable", bench, seed=seed, settings=QUICK, runs=tmp_path / "at-once")
            for bench, seed in benches * 2
        ]
        at_once = [future.result() for future in futures]
    in_turn = [
        vcfbench.run("turntable", bench, seed=seed, settings=QUICK, runs=tmp_path / "in-turn")
        for bench, seed in benches
    ]
    alone = [_in_its_own_process(bench, seed, tmp_path / f"alone-{seed}") for bench, seed in benches]
    assert [bytes_of(record_of(run)) for run in in_turn] == alone
    assert [bytes_of(record_of(run)) for run in at_once] == alone * 2


COLD = """
from concurrent.futures import ThreadPoolExecutor
import vcfbench
with ThreadPoolExecutor(2) as pool:
    print(*pool.map(lambda seed: vcfbench.run("turntable", seed=seed, settings={settings}).status, range(2)))
"""


@pytest.mark.exhaustive
def test_two_threads_may_be_the_first_to_use_anything(tmp_path: Path) -> None:
    """What is loaded when first used is loaded once."""
    command = [sys.executable, "-c", COLD.format(settings=QUICK)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)  # noqa: S603
    assert (done.returncode, done.stdout) == (0, "complete complete\n"), done.stderr


def _in_its_own_process(bench: str, seed: int, folder: Path) -> list[bytes]:
    folder.mkdir()
    script = f"import vcfbench\nvcfbench.run('turntable', {bench!r}, seed={seed}, settings={QUICK!r})\n"
    (folder / "alone.py").write_text(script, encoding="utf-8")
    done = warm.run(["python", "alone.py"], folder)
    assert done.returncode == 0, done.stderr
    (directory,) = (folder / "runs").iterdir()
    return bytes_of(directory)


# --- what a run tells ---


def test_a_run_tells_what_it_came_to(quick: Run) -> None:
    assert (quick.procedure, quick.status, quick.error, quick.bench, quick.seed) == (
        *("turntable", "complete", None, "paper"),
        3,
    )
    assert [point.rate_deg_s for point in quick.points] == [10.0, 0.0, -10.0]
    assert isinstance(quick.results, vcfbench.TurntableResult)
    assert quick.results.scale_factor.unit == "V/(deg/s)"
    assert quick.header["settings"]["samples"] == 3
    assert quick.header["options"]["settings"]["samples"] == 3
    assert repr(quick) == f"<Run {record_of(quick).name}: complete, 3 points>"


def test_a_run_cannot_be_changed_and_can_be_sent_elsewhere(quick: Run) -> None:
    with pytest.raises(AttributeError):
        quick.points = ()  # type: ignore[misc]
    assert pickle.loads(pickle.dumps(quick)) == quick  # noqa: S301  # ours


def test_readings_are_every_raw_one_with_the_tables_read_back(quick: Run) -> None:
    readings = quick.readings
    measured = [r for r in readings if r.number in _numbers_of_points(quick)]
    assert len(readings) >= len(measured) == 9
    for index, point in enumerate(quick.points):
        window = measured[3 * index : 3 * index + 3]
        assert sum(r.voltage_v for r in window) / 3 == pytest.approx(point.output_v, rel=1e-12)
        assert all(r.table_rate_deg_s == pytest.approx(point.rate_deg_s, abs=0.05) for r in window)
        assert [r.step for r in window] == [point.step] * 3
        assert window[1].t_s - window[0].t_s == pytest.approx(0.5, abs=0.2)
    assert [r.t_s for r in readings] == sorted(r.t_s for r in readings)


@pytest.mark.exhaustive
def test_readings_of_long_windows_are_all_there(tmp_path: Path) -> None:
    """The journal has them in chunks."""
    run = vcfbench.run("turntable", settings={**QUICK, "samples": 130}, runs=tmp_path)
    assert '"type":"readings"' in (record_of(run) / "journal.jsonl").read_text()
    measured = [reading for reading in run.readings if reading.number in _numbers_of_points(run)]
    assert len(measured) == 390
    for index, point in enumerate(run.points):
        window = measured[130 * index : 130 * (index + 1)]
        assert sum(r.voltage_v for r in window) / 130 == pytest.approx(point.output_v, rel=1e-9)
        assert {r.table_rate_deg_s for r in window} == {window[0].table_rate_deg_s}
        assert window[0].table_rate_deg_s == pytest.approx(point.rate_deg_s, abs=0.05)


def _numbers_of_points(run: Run) -> set[int]:
    lines = [json.loads(line) for line in (record_of(run) / "journal.jsonl").read_text().splitlines()]
    return {line["n"] for line in lines if "point" in line}


@pytest.mark.exhaustive
def test_a_notebook_shows_table_and_results(quick: Run) -> None:
    shown = quick._repr_html_()
    assert "complete" in shown
    assert "scale factor" in shown.lower()
    assert shown.count("<svg") == shown.count("<figcaption>") == 2
    assert re.findall(r'id="r[0-9a-f]{8}-[12]-', shown)  # figures of two runs in one notebook do not mix
    points, *_ = shown.split("</table>")
    assert points.count("<tr>") == 1 + 3


def test_without_pandas_the_table_says_what_to_install(quick: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match="pip install pandas"):
        quick.table()


def test_with_pandas_the_table_has_the_points(quick: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def frame(rows: list[dict[str, float]], columns: list[str]) -> tuple[list[dict[str, float]], list[str]]:
        return rows, columns

    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=frame))
    rows, columns = quick.table()
    assert columns == ["step", "rate_deg_s", "v_vc_v", "output_v", "std_v", "n"]
    assert [row["output_v"] for row in rows] == [point.output_v for point in quick.points]


def test_pandas_makes_a_table_of_the_readings(quick: Run) -> None:
    pandas = pytest.importorskip("pandas", reason="pip install 'vcfbench[dev]'")
    table = pandas.DataFrame(quick.readings)
    assert list(table.columns) == ["number", "step", "t_s", "voltage_v", "table_rate_deg_s", "v_vc_v"]
    assert list(table["voltage_v"]) == [each.voltage_v for each in quick.readings]


# --- records read back ---


@pytest.mark.parametrize("how", ["path", "journal", "name", "end", "last"])
def test_a_record_read_back_is_the_run(how: str, quick: Run, runs: Path) -> None:
    directory = record_of(quick)
    words = {
        "path": directory,
        "journal": directory / "journal.jsonl",
        "name": directory.name,
        "end": directory.name[-6:],
        "last": "last",
    }
    assert vcfbench.load_run(words[how], runs) == quick


def test_runs_are_listed_with_those_that_cannot_be_read(quick: Run, tmp_path: Path) -> None:
    assert vcfbench.list_runs(tmp_path / "none") == ()
    later = vcfbench.run("turntable", seed=4, settings=QUICK, runs=tmp_path)
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "journal.jsonl").write_text('{"type": "header", "format": 99}\n', encoding="utf-8")
    listed = {run.name: run for run in vcfbench.list_runs(tmp_path)}
    assert listed[later.name] == later
    assert listed["broken"].status == "unreadable"
    assert "format 99" in str(listed["broken"].error)
    assert quick.name not in listed


def test_a_record_that_was_changed_says_so(quick: Run, tmp_path: Path) -> None:
    changed = tmp_path / "changed"
    changed.mkdir()
    lines = (record_of(quick) / "journal.jsonl").read_text().splitlines(keepends=True)
    (changed / "journal.jsonl").write_text("".join([*lines[:5], *lines[6:]]), encoding="utf-8")
    run = vcfbench.load_run(changed)
    assert (run.status, run.results) == ("damaged", None)
    assert isinstance(run.error, vcfbench.ConfigError)
    assert run.damage is not None
    assert run.damage in str(run.error)


# --- what goes wrong ---


class StopsAt:
    """An observer to whom somebody presses Ctrl-C at the nth event of a kind."""

    def __init__(self, kind: type, number: int) -> None:
        self.kind, self.left = kind, number

    def handle(self, event: object) -> None:
        self.left -= isinstance(event, self.kind)
        if self.left == 0:
            raise KeyboardInterrupt


@pytest.mark.parametrize(("kind", "number"), [(vcfbench.ReadingTaken, 5), (vcfbench.StepFinished, 20)])
def test_bench_error_is_raised_with_its_run(kind: type, number: int, tmp_path: Path) -> None:
    """The recorded points are kept and the record says the same, in the midst of a step or when it was written."""
    with pytest.raises(vcfbench.Aborted) as caught:
        vcfbench.run("turntable", settings=QUICK, runs=tmp_path, observers=[StopsAt(kind, number)])
    run = caught.value.run
    assert (run.status, run.results, run.error) == ("aborted", None, caught.value)
    again = vcfbench.load_run(record_of(run))
    assert again.points == run.points
    assert again.readings == run.readings
    assert len(run.readings) >= 3
    assert (type(again.error), str(again.error)) == (vcfbench.Aborted, str(caught.value))
    assert again.error is not None
    assert again.error.run is again


@pytest.mark.parametrize("kind", [OSError, ImportError])
def test_refusal_of_the_computer_closes_the_record(
    kind: type[Exception], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No file descriptor is left, or the package was changed: a module that is loaded late cannot be."""

    def refuse(_walk: object) -> None:
        raise kind("too many open files")

    monkeypatch.setattr("vcfbench.belief.jumps.require_no_jump", refuse)
    with pytest.raises(
        vcfbench.BenchError, match=rf"this computer ended the run: {kind.__name__}: too many open"
    ) as caught:
        vcfbench.run("turntable", settings=QUICK, runs=tmp_path)
    assert isinstance(caught.value.__cause__, kind)
    assert caught.value.run is not None
    footer = read_journal(caught.value.run.directory / "journal.jsonl").footer  # type: ignore[operator]
    assert all(each["safe"] for each in footer["safe"])  # type: ignore[index]


def test_a_failed_limit_is_a_verdict_and_no_error(tmp_path: Path) -> None:
    strict = embedded_text("paper") + "\n[acceptance]\nbias_v = [1.0, 2.0]\n"
    (tmp_path / "strict.toml").write_text(strict, encoding="utf-8")
    run = vcfbench.run("turntable", tmp_path / "strict.toml", settings=QUICK, runs=tmp_path)
    assert (run.status, run.error) == ("complete", None)
    assert run.verdict is not None
    assert not run.verdict.passed
    assert vcfbench.load_run(record_of(run)).verdict == run.verdict


class Breaks:
    """An observer with a mistake."""

    def __init__(self, mistake: Exception) -> None:
        self.events = 0
        self.mistake = mistake

    def handle(self, event: object) -> None:
        del event
        self.events += 1
        raise self.mistake


class Hears:
    """An observer that keeps what it was told."""

    def __init__(self) -> None:
        self.events: list[object] = []

    def handle(self, event: object) -> None:
        self.events.append(event)


def test_failing_observer_is_dropped_and_run_continues(quick: Run, tmp_path: Path) -> None:
    breaks, hears = Breaks(ZeroDivisionError("a mistake")), Hears()
    asks = Breaks(vcfbench.ConfigError("there is no run 'x'"))  # as an error of the run itself would be
    run = vcfbench.run("turntable", seed=3, settings=QUICK, runs=tmp_path, observers=[breaks, asks, hears])
    assert run.points == quick.points
    assert (breaks.events, asks.events) == (1, 1)
    assert run.observers_lost == (
        "1 (Breaks): ZeroDivisionError: a mistake",
        "2 (Breaks): ConfigError: there is no run 'x'",
    )
    assert vcfbench.load_run(record_of(run)).observers_lost == run.observers_lost
    assert sum(isinstance(event, vcfbench.ReadingTaken) for event in hears.events) == len(run.readings)


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"samples": 1}, "settings: procedure.samples: expected a whole number at least 2"),
        ({"samples": "ten"}, "settings: procedure.samples: expected a whole number"),
        ({"sample": 10}, "settings: procedure.sample: expected a known key ('samples'?), got an unknown key"),
        ({"settle_s": float("nan")}, "settings: procedure.settle_s: expected a finite number, got nan"),
        ({"drive": {"start_up_s": 1e9}}, "settings: procedure.drive.start_up_s: expected a number"),
        ({"rates_deg_s": [1.0]}, "settings: procedure.rates_deg_s: expected a list of 3 to 1000 numbers"),
        ({"k_vc_guess_deg_s_per_v": 0}, "settings: procedure.k_vc_guess_deg_s_per_v: expected a number that is not 0"),
        ({"match": "nearly"}, "settings: procedure.match: expected 'zero' or 'absolute', got 'nearly'"),
    ],
)
def test_settings_are_checked_like_those_of_a_bench_file(
    settings: dict[str, Any], expected: str, tmp_path: Path
) -> None:
    with pytest.raises(vcfbench.ConfigError) as caught:
        vcfbench.run("virtual-coriolis", settings=settings, runs=tmp_path)
    assert str(caught.value).startswith(expected)
    assert caught.value.run.directory is None
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(vcfbench.ConfigError):
        vcfbench.dry_run("virtual-coriolis", settings=settings)


def test_read_back_error_shows_wrong_digit() -> None:
    tight = {**QUICK, "rate_tolerance_deg_s": 1e-5}
    with pytest.raises(vcfbench.NotSafe, match=r"not proved.*\+10 deg/s.*: reads \+(10\.0\d{2,}|9\.99\d+) deg/s"):
        vcfbench.run("turntable", seed=2, settings=tight, runs=None)


@pytest.mark.parametrize("settings", [[1.0], "samples=3", {1: 2}, vcfbench.ProcedureSettings()])
def test_settings_are_a_mapping(settings: Any, tmp_path: Path) -> None:
    for ask in (partial(vcfbench.run, runs=tmp_path), vcfbench.dry_run):
        with pytest.raises(vcfbench.ConfigError, match="settings: expected a mapping of keys to values, got "):
            ask("turntable", settings=settings)


def test_settings_from_numpy_are_numbers(quick: Run) -> None:
    import numpy as np  # noqa: PLC0415  # this test alone needs it

    settings = {**QUICK, "rates_deg_s": np.array(QUICK["rates_deg_s"]), "samples": np.int64(3)}
    assert vcfbench.dry_run("turntable", settings=settings) == vcfbench.dry_run("turntable", settings=QUICK)
    assert quick.results


@pytest.mark.parametrize("seed", [-1, 2**63, 1.5, "one"])
def test_a_seed_is_a_whole_number(seed: Any, tmp_path: Path) -> None:
    with pytest.raises(vcfbench.ConfigError, match="expected a whole number"):
        vcfbench.run("turntable", seed=seed, runs=tmp_path)
    with pytest.raises(vcfbench.ConfigError, match="expected a whole number"):
        vcfbench.open_bench(seed=seed)


@pytest.mark.parametrize("open_", [vcfbench.load_bench, vcfbench.open_bench, vcfbench.safe_bench])
def test_a_number_is_no_bench(open_: Any) -> None:
    """A seed in the second place was read as a file descriptor: 0 waited for the terminal."""
    with pytest.raises(vcfbench.ConfigError, match="expected a bench file or one of paper, lab, ideal, got 0"):
        open_(0)


@pytest.mark.parametrize("given", [None, 3, vcfbench.ProcedureSettings])
def test_what_is_no_procedure_is_refused_with_words(given: Any, tmp_path: Path) -> None:
    with pytest.raises(vcfbench.PlanError, match="expected a procedure's name, its file or a Procedure, got"):
        vcfbench.run(given, runs=tmp_path)


def test_records_need_a_directory_with_a_name() -> None:
    with pytest.raises(vcfbench.ConfigError, match="got an empty name"):
        vcfbench.run("turntable", runs=" ")


def too_fast(settings: Any) -> vcfbench.Plan:
    yield Settle(3600.0, "an hour")
    yield SetRate(4000.0, settings.acceleration_deg_s2, 0.0)


def test_settings_beyond_bench_are_refused_before_opening(tmp_path: Path) -> None:
    spin = vcfbench.Procedure(
        name="spin",
        title="Turn too fast after an hour.",
        settings=vcfbench.ProcedureSettings,
        plan=too_fast,
        results=lambda _settings, _points: {},
    )
    with pytest.raises(vcfbench.LimitError, match=r"step 2 .*1:00:00 into the plan.*nothing was opened"):
        vcfbench.run(spin, runs=tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("seconds", [float("nan"), float("inf"), -5.0])
def test_step_of_impossible_duration_is_refused(seconds: float, tmp_path: Path) -> None:
    def plan(_settings: Any) -> vcfbench.Plan:
        yield vcfbench.Note("Begin")
        yield Settle(seconds, "what for")

    with pytest.raises(vcfbench.PlanError, match=rf"step 2 \(wait {seconds:g} s: what for\): expected to last 0 s"):
        vcfbench.run(own(plan=plan), runs=tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        ({"needs": {"power": (vcfbench.PowersRails,)}}, "'mine': needs: expected a capability by role"),
        ({"needs": ["power"]}, "'mine': needs: expected a capability by role"),
        ({"uses": {"scope": vcfbench.CapturesWaveforms}}, "'mine': uses: .* got 'scope'"),
        ({"settings": vcfbench.ProcedureSettings()}, "'mine': expected settings that are ProcedureSettings, a class"),
    ],
)
def test_mistakes_in_a_procedure_are_told_when_it_is_made(mistake: dict[str, Any], words: str) -> None:
    with pytest.raises(vcfbench.ConfigError, match=words):
        own(**mistake)


def own(**parts: Any) -> Any:
    known = {"name": "mine", "title": "Mine.", "settings": vcfbench.ProcedureSettings}
    return vcfbench.Procedure(**{**known, "plan": too_fast, "results": lambda _settings, _points: {}, **parts})


def test_a_list_of_runs_is_told_how_runs_are_compared(quick: Run) -> None:
    with pytest.raises(vcfbench.ConfigError, match=r"as in compare_runs\(before, after\), got a list"):
        vcfbench.compare_runs([quick, quick])  # type: ignore[arg-type]  # what is tested


def test_the_catalogue_shows_its_names() -> None:
    assert repr(vcfbench.PROCEDURES).startswith("<procedures turntable, virtual-coriolis, zero, ")


# --- without a bench ---


def test_a_dry_run_tells_steps_and_time(quick: Run) -> None:
    planned = vcfbench.dry_run("turntable", settings=QUICK)
    assert quick.bench_seconds is not None
    assert planned.physical_minimum_s < planned.bench_seconds <= quick.bench_seconds
    assert planned.physical_minimum_s == pytest.approx(quick.physical_minimum_s, rel=0.02)
    assert [each.number for each in planned.steps] == list(range(1, len(planned.steps) + 1))
    assert repr(planned).startswith(f"<DryRun turntable: {len(planned.steps)} steps, ")


def test_a_procedure_object_does_as_its_name(quick: Run) -> None:
    procedure = vcfbench.PROCEDURES["turntable"]
    assert vcfbench.dry_run(procedure, settings=QUICK) == vcfbench.dry_run("turntable", settings=QUICK)
    assert quick.procedure == procedure.name


def test_a_real_bench_has_no_seed(tmp_path: Path) -> None:
    (tmp_path / "station.toml").write_text(template(), encoding="utf-8")
    with pytest.raises(vcfbench.ConfigError, match="only such a bench has a seed"):
        vcfbench.run("turntable", tmp_path / "station.toml", seed=1, runs=tmp_path / "runs")


def test_a_bench_is_opened_by_its_name() -> None:
    with vcfbench.open_bench("ideal") as bench:
        assert repr(bench) == "<Bench ideal, open>"
    assert bench.closed


@pytest.mark.parametrize("kind", BenchError.__subclasses__())
def test_every_error_in_json_has_its_exit_code(kind: type[BenchError]) -> None:
    answer = replace(vcfbench.run("electrical", "ideal"), error=kind("what")).as_json()
    assert (answer["error"], answer["exit_code"]) == ("what", kind.exit_code)
