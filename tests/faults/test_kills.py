"""A run on a simulated bench is killed at its writes, one after the other, and amid them.

Its journal is synchronised at its end alone, so what a killed program leaves is what the system has of it: no point
that was shown is lost, the record is readable, and the run goes on where it was.
"""

from __future__ import annotations

import json
import subprocess
import sys
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest

import vcfbench
from vcfbench.records.journal import read_journal

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = [
    pytest.mark.exhaustive,
    pytest.mark.skipif(sys.platform == "win32", reason="forks are killed"),
]

SETTINGS = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5}
LONG = {"duration_s": 250.0, "powered_s": 10.0}

FORKS = """
import json, os, pathlib, signal, sys
import vcfbench
from vcfbench.steps.events import StepFinished
folder, procedure, settings, every = pathlib.Path(sys.argv[1]), sys.argv[2], json.loads(sys.argv[3]), int(sys.argv[4])
write, opened, fsync, fdatasync = os.write, os.open, os.fsync, os.fdatasync
write_bytes, replace = pathlib.Path.write_bytes, pathlib.Path.replace
left = 0

def tick():
    global left
    left -= 1
    return left == 0

def die():
    os.kill(os.getpid(), signal.SIGKILL)

def around(act):
    def doing(*values, **named):
        if tick():
            die()
        done = act(*values, **named)
        if tick():
            die()
        return done
    return doing

def writing(number, data):
    for part in (0, len(data) // 2, len(data) - 1):
        if tick():
            write(number, data[:part])
            die()
    return around(write)(number, data)

def writing_bytes(path, data):
    if tick():
        write_bytes(path, data[: len(data) // 2])
        die()
    return around(write_bytes)(path, data)

class Shows:
    def __init__(self, path):
        self.number = opened(path, os.O_WRONLY | os.O_CREAT, 0o644)

    def handle(self, event):
        point = event.result.recorded_point if isinstance(event, StepFinished) else None
        if point is not None:
            write(self.number, json.dumps(point.as_json()).encode() + b"\\n")

vcfbench.run(procedure, "ideal", settings=settings, runs=None)  # what is loaded once is loaded
for at in range(1, 100_000, every):
    if (pid := os.fork()) == 0:
        left = at
        os.write, os.fsync, os.fdatasync = writing, around(fsync), around(fdatasync)
        pathlib.Path.write_bytes, pathlib.Path.replace = writing_bytes, around(replace)
        (folder / str(at)).mkdir()
        shows = Shows(folder / str(at) / "shown")
        vcfbench.run(procedure, "ideal", settings=settings, runs=folder / str(at) / "runs", observers=[shows])
        os._exit(0)
    if os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0:
        break
"""


@pytest.mark.parametrize(("procedure", "settings", "every"), [("turntable", SETTINGS, 4), ("zero", LONG, 4)])
def test_run_killed_at_a_write_loses_no_shown_point(
    procedure: str, settings: dict[str, float], every: int, tmp_path: Path
) -> None:
    command = [sys.executable, "-c", FORKS, str(tmp_path), procedure, json.dumps(settings), str(every)]
    subprocess.run(command, check=True, timeout=600)  # noqa: S603  # our own words
    whole = vcfbench.run(procedure, "ideal", settings=settings, runs=None)
    killed = sorted(map(int, (each.name for each in tmp_path.iterdir())))
    assert len(killed) > 30
    steps = [_steps_after_a_kill(tmp_path / str(at), whole) for at in killed]
    assert all(earlier <= later for earlier, later in pairwise(steps))
    assert vcfbench.load_run(_only(tmp_path / str(killed[-1]))).status == "complete"  # that was not killed any more


def _only(folder: Path) -> Path:
    (directory,) = (folder / "runs").iterdir()
    return directory


def _steps_after_a_kill(folder: Path, whole: vcfbench.Run) -> int:
    """Return how many steps were kept, once the rest of the run has been done as well."""
    directory, journal = _only(folder), _only(folder) / "journal.jsonl"
    shown = [json.loads(line) for line in (folder / "shown").read_text().splitlines()]
    if not journal.exists():
        assert not shown
        assert vcfbench.run_summaries(folder / "runs") == ()
        return 0
    record = read_journal(journal)
    (summary,) = vcfbench.run_summaries(folder / "runs")
    kept = [point.as_json() for point in record.points]
    assert record.damage is None
    assert summary.status == record.status
    assert kept[: len(shown)] == shown
    assert all(each.suffix in {".json", ".csv", ".jsonl", ".part"} for each in directory.iterdir())
    if record.status == "complete":
        assert vcfbench.load_run(directory).results == whole.results
        return len(record.steps)
    assert record.status == "incomplete"
    if record.header:
        resumed = vcfbench.resume(directory)
        assert [point.as_json() for point in resumed.points[: len(kept)]] == kept
        assert [(each.rate_deg_s, each.n) for each in resumed.points] == [
            (each.rate_deg_s, each.n) for each in whole.points
        ]
    return len(record.steps)
