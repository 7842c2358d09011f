"""Windows too long for one line of the journal: their readings are written as they come, and are not kept in memory."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest

from tests.procedures.fakes import FakeBench, Gyro, MemoryJournal, make_settings
from vcfbench.errors import BenchError, MeasurementError
from vcfbench.instructions.routines import rails_of
from vcfbench.records.damage import first_damage, own_readings
from vcfbench.records.journal import Journal, read_journal
from vcfbench.records.schema import Status
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.steps import Acquire, VerifyZero, Window, ZeroWindow
from vcfbench.steps.events import ReadingTaken
from vcfbench.steps.executor import Execution, Executor
from vcfbench.steps.tally import Tally

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from vcfbench.steps.events import Event, Observer
    from vcfbench.steps.step import Plan, Step

NOISE_V = 1.2e-4


def acquire(samples: int, interval_s: float, kind: type[Acquire] = Acquire) -> Acquire:
    return kind(1, 0.0, 0.0, 0.0, 0.05, rails_of(make_settings())[:0], 0.1, samples, interval_s, 1e-5)


def plan(*steps: Step) -> Plan:
    for step in steps:  # noqa: UP028  # a tuple cannot be sent results
        yield step


def bench(noise_v: float = NOISE_V, **changes: Any) -> FakeBench:
    made = FakeBench(Gyro(noise_v=noise_v, rng=np.random.default_rng(3), **changes))
    made.multimeter.reading_s = 0.02
    return made


def run(journal: Any, *steps: Step, on: FakeBench | None = None, observers: tuple[Observer, ...] = ()) -> Execution:
    return Executor(on or bench(), journal, observers).execute(plan(*steps))


@pytest.mark.parametrize(
    ("samples", "interval_s", "chunks"),
    [
        (10, 1.0, []),
        (60, 1.0, []),
        (61, 1.0, [60, 1]),
        (150, 1.0, [60, 60, 30]),
        (1000, 0.05, []),
        (1001, 0.05, [1000, 1]),
        (3000, 0.05, [1000, 1000, 1000]),
        (3, 100.0, [1, 1, 1]),
    ],
)
def test_a_chunk_is_closed_by_its_count_or_its_age(samples: int, interval_s: float, chunks: list[int]) -> None:
    journal = MemoryJournal()
    assert run(journal, acquire(samples, interval_s)).error is None
    *before, step = journal.lines
    assert [line["type"] for line in before] == ["readings"] * len(chunks)
    assert [len(line["readings"]) for line in before] == chunks
    assert [line["chunk"] for line in before] == list(range(1, len(chunks) + 1))
    assert step.get("chunks", 0) == len(chunks)
    assert len(step["result"]["readings"]) == (0 if chunks else samples)


def test_each_chunk_says_which_step_it_belongs_to() -> None:
    journal = MemoryJournal()
    run(journal, acquire(10, 1.0), acquire(150, 1.0))
    *chunks, step = journal.lines[1:]
    for line in chunks:
        assert {key: line[key] for key in ("n", "key", "step_kind", "step", "t_s")} == {
            key: step[key] for key in ("n", "key", "step_kind", "step", "t_s")
        }
    ends = [line["end_s"] for line in (*chunks, step)]
    assert ends == sorted(ends)


@pytest.mark.exhaustive
def test_the_point_is_that_of_all_readings(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "j")
    journal.header({"procedure": "own"})
    execution = run(journal, acquire(25_000, 0.1), acquire(10, 1.0))
    journal.footer({"status": "complete", "points": 2})
    journal.close()
    record = read_journal(tmp_path / "j")
    assert record.status is Status.COMPLETE
    assert record.points == execution.points
    volts = [reading["voltage_v"] for chunk in record.chunks for reading in chunk["readings"]]
    volts += [reading["voltage_v"] for reading in own_readings(record.steps[0])]
    point = execution.points[0]
    assert (point.n, len(volts)) == (25_000, 25_000)
    assert point.output_v == pytest.approx(math.fsum(volts) / len(volts), rel=1e-14)
    assert point.std_v == pytest.approx(float(np.std(volts, ddof=1)), rel=1e-10)
    assert len(own_readings(record.steps[1])) == 10


def test_readings_far_from_zero_lose_no_digit_of_their_scatter() -> None:
    """10 V and microvolts: a sum of squares less the square of a sum would keep none of them."""
    volts = (10.0 + 1e-6 * np.random.default_rng(1).standard_normal(36_000)).tolist()
    tally = Tally()
    for first in range(0, len(volts), 1000):
        tally.add(volts[first : first + 1000])
    assert (tally.count, tally.chunks) == (36_000, 36)
    assert tally.mean_v == pytest.approx(math.fsum(volts) / len(volts), rel=1e-15)
    assert tally.std_v == pytest.approx(float(np.std(np.array(volts) - 10.0, ddof=1)), rel=1e-9)


def test_the_last_zero_of_a_run_may_be_long_too() -> None:
    journal = MemoryJournal()
    execution = run(journal, acquire(90, 1.0, VerifyZero))
    assert execution.points == ()
    assert journal.lines[-1]["result"]["point"]["n"] == 90


def test_failed_window_has_its_rest_in_the_error_line() -> None:
    journal, made = MemoryJournal(), bench()
    made.multimeter.overload_at = 131
    execution = run(journal, acquire(1000, 1.0), on=made)
    assert isinstance(execution.error, MeasurementError)
    assert [(line["type"], len(line["readings"])) for line in journal.lines] == [
        ("readings", 60),
        ("readings", 60),
        ("error", 10),
    ]
    assert journal.lines[-1]["chunks"] == 2


class Spoil:
    """Moves the zero of the gyroscope for one reading."""

    def __init__(self, made: FakeBench, at: int, off_v: float) -> None:
        self.made, self.left, self.off_v = made, at - 1, off_v

    def handle(self, event: Event) -> None:
        if isinstance(event, ReadingTaken):
            self.left -= 1
            self.made.gyro.zero_v += {0: self.off_v, -1: -self.off_v}.get(self.left, 0.0)


def test_outlier_ends_long_window_in_its_chunk() -> None:
    made, journal = bench(), MemoryJournal()
    execution = run(journal, acquire(36_000, 0.1), on=made, observers=(Spoil(made, 2004, 0.5),))
    assert "reading 204 of 600 is +0.5 V off the others" in str(execution.error)
    assert "(readings 1801 to 2400 of 36000); a mean of them is no measurement" in str(execution.error)
    assert made.clock.now() < 300.0


@pytest.mark.exhaustive
def test_a_long_window_may_drift_as_no_short_one_may() -> None:
    """A curve through hours: the scatter about each chunk's own line is that of the readings."""
    made = bench(zero_v=-0.032)

    class Warming:
        def handle(self, event: Event) -> None:
            if isinstance(event, ReadingTaken):
                made.gyro.zero_v = -0.042 + 0.01 * math.exp(-event.t_s / 3000.0)

    execution = run(MemoryJournal(), acquire(20_000, 1.0), on=made, observers=(Warming(),))
    assert execution.error is None
    assert execution.points[0].std_v > 5.0 * NOISE_V


@pytest.mark.parametrize(("kind", "result"), [(Acquire, Window), (VerifyZero, ZeroWindow)])
def test_prediction_has_number_of_readings_of_window(kind: type[Acquire], result: type[Window]) -> None:
    predicted = acquire(360_000, 0.1, kind).predict(LinearGyro(40.0))
    assert isinstance(predicted, result)
    assert predicted.readings == ()
    assert predicted.point.n == 360_000
    assert len(acquire(60, 1.0, kind).predict(LinearGyro(40.0)).readings) == 60


def test_full_disk_in_long_window_ends_run() -> None:
    class Full(MemoryJournal):
        def write(self, kind: str, values: Any) -> None:
            if kind == "readings" and values["chunk"] == 3:
                raise BenchError("the record cannot be written: no space left on device")
            super().write(kind, values)

    made = bench()
    execution = run(Full(), acquire(36_000, 0.1), on=made)
    assert "no space left" in str(execution.error)
    assert made.clock.now() == pytest.approx(180.0, abs=0.1)


class Quiet(FakeBench):
    """A bench that keeps no list of what it was told."""

    def __init__(self) -> None:
        super().__init__(Gyro())
        self.multimeter.reading_s = 0.02
        self.multimeter.log = lambda _: None  # type: ignore[method-assign]
        self.volts = 0

    def output_v(self) -> float:
        self.volts += 1
        return 1e-5 * (self.volts * 7919 % 101)


TEN_HOURS = """
import resource
import sys
from pathlib import Path
from tests.steps.test_long_window import Quiet, acquire, run
from vcfbench.steps.events import ReadingTaken
from vcfbench.records.damage import own_readings
from vcfbench.records.journal import Journal

class Memory:
    count = 0

    def handle(self, event):
        if isinstance(event, ReadingTaken):
            self.count += 1
            if self.count in {36_000, 360_000}:
                print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)

execution = run(Journal(Path(sys.argv[1])), acquire(360_000, 0.1), on=Quiet(), observers=(Memory(),))
assert execution.error is None, execution.error
print(execution.points[0].n)
"""


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform == "win32", reason="getrusage of POSIX")
def test_memory_stays_flat_over_ten_hours(tmp_path: Path) -> None:
    """10 h at 10 Hz in a process of its own: the most memory of the first hour is that of all ten."""
    command = [sys.executable, "-c", TEN_HOURS, str(tmp_path / "j")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603
    early, late, count = map(int, done.stdout.split())
    assert count == 360_000
    assert late < 1.1 * early  # were the readings kept it would be 36 MB more, two thirds


CHILD = """
import sys
from pathlib import Path
from tests.steps.test_long_window import acquire, plan
from vcfbench.bench.bench import open_bench
from vcfbench.procedures.bench_file import load_bench
from vcfbench.steps.events import ReadingTaken
from vcfbench.steps.executor import Executor
from vcfbench.steps import ConfigureMeter
from vcfbench.records.damage import own_readings
from vcfbench.records.journal import Journal

class Tick:
    count = 0

    def handle(self, event):
        if isinstance(event, ReadingTaken):
            self.count += 1
            print(self.count, flush=True)

journal = Journal(Path(sys.argv[1]))
journal.header({"procedure": "own"})
with open_bench(load_bench(None), speed="1000") as bench:
    Executor(bench, journal, [Tick()]).execute(plan(ConfigureMeter(10.0, 1.0), acquire(10, 1.0), acquire(360_000, 0.1)))
"""


@pytest.mark.exhaustive
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="the system has no SIGKILL")
def test_a_killed_long_window_loses_one_chunk_at_most(tmp_path: Path) -> None:
    path = tmp_path / "j"
    with subprocess.Popen([sys.executable, "-c", CHILD, str(path)], stdout=subprocess.PIPE, text=True) as child:  # noqa: S603
        assert child.stdout is not None
        printed = [int(child.stdout.readline()) for _ in range(1500)]
        child.kill()
        printed += [int(line) for line in child.stdout.read().splitlines()]
    record = read_journal(path)
    assert record.status is Status.INCOMPLETE
    assert record.damage is None
    assert len(record.points) == 1
    kept = 10 + sum(len(chunk["readings"]) for chunk in record.chunks)
    assert printed[-1] - 601 <= kept  # 60 s at 10 Hz, give or take what is rounded
    assert kept > 1000
    assert record.chunks[-1]["n"] not in [step["n"] for step in record.steps]
    assert record.chunks[-1]["step"]["samples"] == 360_000


def lines_of_a_long_window() -> list[dict[str, Any]]:
    journal = MemoryJournal()
    run(journal, acquire(10, 1.0), acquire(150, 1.0), acquire(10, 1.0))
    lines = [{"type": "header"}, *journal.lines, {"type": "footer", "points": 3}]
    return [msgspec.json.decode(msgspec.json.encode(line)) for line in lines]


def test_record_with_chunks_is_undamaged_at_every_cut() -> None:
    lines = lines_of_a_long_window()
    assert [line["type"] for line in lines] == ["header", "step", *["readings"] * 3, "step", "step", "footer"]
    assert [first_damage(lines[:kept]) for kept in range(len(lines) + 1)] == [None] * 9


def _change(place: int, *keys: Any, to: Any) -> Callable[[list[dict[str, Any]]], None]:
    def change(lines: list[dict[str, Any]]) -> None:
        value: Any = lines[place]
        for key in keys[:-1]:
            value = value[key]
        value[keys[-1]] = to

    return change


def _swap(lines: list[dict[str, Any]]) -> None:
    lines[2], lines[3] = lines[3], lines[2]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda lines: lines.pop(2), "line 3 is chunk 2 of step 2, after step 1"),
        (lambda lines: lines.pop(3), "line 4 is chunk 3 of step 2, after chunk 1 of step 2"),
        (lambda lines: lines.pop(4), "line 5: step 2 has 2 chunks of readings, not 3"),
        (lambda lines: lines.insert(6, lines[2]), "line 7 is chunk 1 of step 2, after step 2"),
        (_swap, "line 3 is chunk 2 of step 2, after step 1"),
        (_change(3, "n", to=3), "line 4 is chunk 2 of step 3, after chunk 1 of step 2"),
        (_change(5, "chunks", to=4), "line 6: step 2 has 3 chunks of readings, not 4"),
        (_change(3, "readings", 7, "voltage_v", to=1.0), "line 6: the point's -0.04"),
        (_change(3, "readings", 7, "t_s", to=1.0), "line 4: a reading of 1 s comes after one of 7"),
        (lambda lines: lines[4]["readings"].pop(), "line 6: a point of 150 readings has 149"),
    ],
)
def test_what_is_wrong_with_chunks_is_named(change: Callable[[list[dict[str, Any]]], None], words: str) -> None:
    lines = lines_of_a_long_window()
    change(lines)
    damage = first_damage(lines)
    assert damage is not None
    assert damage.startswith(words)
