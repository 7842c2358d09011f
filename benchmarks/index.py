"""What lists of many records take, with and without an index: `python benchmarks/index.py [RECORDS]`.

The records are copies of one of 17 points, each with a start, a device and a tag of its own. Seconds of wall and of
CPU; on a busy machine the latter counts.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import vcfbench
from vcfbench.archive.index import RunIndex
from vcfbench.archive.summary import Selection
from vcfbench.records.seal import Sealer

if TYPE_CHECKING:
    from collections.abc import Callable

SELECTIONS: tuple[dict[str, Any], ...] = (
    {"dut": "G-0042"},
    {"dut": "G-0042", "tags": {"batch": "3"}},
    {"tags": {"batch": "3"}},
    {"since": "2026-02-18"},
    {"status": "aborted"},
    {},
)


def records(folder: Path, count: int) -> Path:
    """Write `count` records."""
    run = vcfbench.run("turntable", runs=folder / "one")
    assert run.directory is not None  # noqa: S101
    journal = (run.directory / "journal.jsonl").read_bytes()
    result = (run.directory / "result.json").read_bytes()
    first, rest = journal.split(b"\n", 1)
    header = json.loads(first)
    between, last = rest[: rest.rindex(b"\n", 0, -1) + 1], json.loads(rest[rest.rindex(b"\n", 0, -1) :])
    del last["seal"]
    for number in range(count):
        began = datetime(2026, 1, 1, tzinfo=UTC) + timedelta(minutes=7 * number)
        metadata = {"dut": f"G-{number % 200:04d}", "operator": "A. Person", "tags": {"batch": str(number % 17)}}
        directory = folder / "runs" / f"{began:%Y%m%dT%H%M%SZ}-turntable-{number:06x}"
        directory.mkdir(parents=True)
        changed = {**header, "run": directory.name, "utc": began.isoformat(), "metadata": metadata}
        data = json.dumps(changed).encode() + b"\n" + between
        (directory / "journal.jsonl").write_bytes(data + Sealer(data).sealed(json.dumps(last).encode()))
        (directory / "result.json").write_bytes(result)
    return folder / "runs"


def timed(what: str, do: Callable[[], object]) -> None:
    """Print what `do` takes."""
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    done = do()
    wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
    found = f"{len(done)} runs" if isinstance(done, tuple) else ""
    print(f"{what:50} {wall_s:9.3f} s   CPU {cpu_s:9.3f} s   {found}", flush=True)


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    with tempfile.TemporaryDirectory() as folder:
        runs = records(Path(folder), count)
        timed(f"{count} records, no index", lambda: vcfbench.run_summaries(runs))
        index = RunIndex(runs)
        timed("made of the records", lambda: index.refresh(rebuild=True))
        index.select(Selection.of(dut="none"))
        timed("held against the records", index.refresh)
        for asked in SELECTIONS:
            timed(f"query {asked}", lambda asked=asked: index.select(Selection.of(**asked)))  # type: ignore[misc]


if __name__ == "__main__":
    main()
