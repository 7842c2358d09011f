"""What an export of a million raw readings takes, by format: `python benchmarks/export.py [READINGS]`.

Each format is written by a process of its own: seconds of wall and of CPU, its largest memory, the size of the file.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from vcfbench.archive.export import FORMATS, export_run
from vcfbench.records.journal import Journal
from vcfbench.records.schema import CHUNK_READINGS

STEP = {"step": 1, "rate_deg_s": 0.0, "v_vc_v": 0.0, "table_deg_s": 0.0, "samples": 0, "interval_s": 0.02}


def record(folder: Path, readings: int) -> Path:
    """Write the record of one long window, chunk by chunk, as a run does."""
    directory = folder / "20260101T000000Z-zero-000000"
    directory.mkdir()
    journal = Journal(directory / "journal.jsonl")
    journal.header({"run": directory.name, "procedure": "zero", "bench": {"name": "paper"}, "settings": {}})
    chunks = -(-readings // CHUNK_READINGS)
    line = {"n": 1, "key": "k", "step_kind": "AcquireGapless", "step": STEP, "t_s": 0.0}
    for chunk in range(chunks):
        places = range(chunk * CHUNK_READINGS, min((chunk + 1) * CHUNK_READINGS, readings))
        values = [{"t_s": 0.0213 * place, "voltage_v": -0.0414 + 1e-7 * (place % 997)} for place in places]
        journal.write("readings", {**line, "end_s": 0.0213 * places[-1], "chunk": chunk + 1, "readings": values})
    mean_v = -0.0414 + 1e-7 * sum(place % 997 for place in range(readings)) / readings
    point = {"step": 1, "rate_deg_s": 0.0, "v_vc_v": 0.0, "output_v": mean_v, "std_v": 3e-5, "n": readings}
    result = {"readings": [], "table_rate_deg_s": 0.0, "rails": []}
    step = {**line, "end_s": 0.0213 * readings, "result_kind": "Window", "result": result, "point": point}
    journal.write("step", {**step, "chunks": chunks})
    journal.footer({"status": "complete", "error": None, "points": 1})
    journal.close()
    return directory


def measure(directory: str, format_: str) -> None:
    """Export, and print what it took."""
    began = time.perf_counter()
    done = export_run(directory, f"{directory}/out.{format_}", format=format_, raw=True)
    used = resource.getrusage(resource.RUSAGE_SELF)
    print(
        json.dumps(
            {
                "rows": done.rows,
                "wall_s": time.perf_counter() - began,
                "cpu_s": used.ru_utime + used.ru_stime,
                "memory_mb": used.ru_maxrss / 1024,
                "file_mb": done.file.stat().st_size / 1e6,
            }
        )
    )


def main() -> None:
    if len(sys.argv) == 3:
        measure(sys.argv[1], sys.argv[2])
        return
    readings = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    with tempfile.TemporaryDirectory() as folder:
        directory = record(Path(folder), readings)
        print("format    readings   wall / s   CPU / s   memory / MB   file / MB")
        for each in FORMATS:
            command = [sys.executable, __file__, str(directory), each]
            took = json.loads(subprocess.run(command, capture_output=True, check=True, text=True).stdout)
            print(
                f"{each:8} {took['rows']:9d} {took['wall_s']:10.1f} {took['cpu_s']:9.1f} "
                f"{took['memory_mb']:13.0f} {took['file_mb']:11.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
