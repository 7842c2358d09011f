"""A report of a run as HTML, with a usual run and with one million raw readings: whole commands, start-up included."""

from __future__ import annotations

import json
import statistics
import tempfile
from pathlib import Path

from measure import COMMAND, Figure, child, report

READINGS = 1_000_000
CHUNK = 1000


def lengthened(record: Path, copy: Path, readings: int) -> None:
    """Write a record like that of a static record, with so many readings of two a second."""
    lines = [json.loads(line) for line in (record / "journal.jsonl").read_text(encoding="utf-8").splitlines()]
    old = [each for line in lines if line["type"] == "readings" for each in line["readings"]]
    chunk = next(line for line in lines if line["type"] == "readings")
    begin_s, later_s = old[0]["t_s"], 0.0
    copy.mkdir(parents=True)
    with (copy / "journal.jsonl").open("w", encoding="utf-8") as file:
        for line in lines:
            if line["type"] == "readings":
                continue
            if line["type"] == "header":
                line["settings"] |= {"duration_s": readings / 2, "sample_interval_s": 0.5}
            elif line["type"] == "step" and line.get("chunks"):
                line["step"] |= {"samples": readings, "interval_s": 0.5}
                for number, first in enumerate(range(0, readings, CHUNK), start=1):
                    taken = [
                        {"t_s": begin_s + place / 2, "voltage_v": old[place % len(old)]["voltage_v"]}
                        for place in range(first, first + CHUNK)
                    ]
                    end_s = taken[-1]["t_s"]
                    entry = {**chunk, "step": line["step"], "chunk": number, "readings": taken, "end_s": end_s}
                    file.write(json.dumps(entry) + "\n")
                line["result"]["readings"] = []
                line["chunks"], later_s = readings // CHUNK, end_s + 1.0 - line["end_s"]
                taken_v = [old[place % len(old)]["voltage_v"] for place in range(readings)]
                mean_v, sd_v = statistics.fmean(taken_v), statistics.stdev(taken_v[:10_000])
                line["point"] |= {"n": readings, "output_v": mean_v, "std_v": sd_v}
                line["result"]["point"] = line["point"]
                line["end_s"] += later_s
            elif "t_s" in line:
                line |= {key: line[key] + later_s for key in ("t_s", "end_s") if key in line}
            file.write(json.dumps(line) + "\n")


def figures(runs: int = 3) -> list[Figure]:
    with tempfile.TemporaryDirectory() as name:
        usual, static = Path(name) / "usual", Path(name) / "static"
        child([*COMMAND, "run", "virtual-coriolis", "--quiet", "--runs", str(usual)])
        child([*COMMAND, "run", "zero", "--quiet", "--runs", str(static)])
        (record,) = static.iterdir()
        long = Path(name) / "long" / record.name
        lengthened(record, long, READINGS)
        found = []
        for words, run in (("virtual-coriolis", "last"), ("zero, a million readings", str(long))):
            made = [child([*COMMAND, "report", run, "--runs", str(usual), "-o", "x.html"]) for _ in range(runs)]
            found.append(report(Figure(f"report of {words}", min(each.wall_s for each in made), "s", bar=3, gross=15)))
            cpu_s = [each.cpu_s for each in made if each.cpu_s is not None]
            if cpu_s:
                found.append(report(Figure(f"report of {words}, processor", min(cpu_s), "s")))
    return found


if __name__ == "__main__":
    figures()
