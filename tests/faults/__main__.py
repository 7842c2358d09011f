"""Cells of the fault matrix whose names hold all words given: ``python -m tests.faults acl silent "table at rate"``.

``stop LANGUAGE`` sends a run SIGTERM at rate, on a good wire, and shows what the table was told.
"""

from __future__ import annotations

import json
import signal
import sys
import tempfile
from pathlib import Path

from simrack.wire_faults import WireFault, faulty_wire

from tests.faults.benches import SPEED, bench_text, serving
from tests.faults.forks import fork_host
from tests.faults.matrix import Ended, Station, all_cases, run_cases
from vcfbench.clock import WallClock, sleep


def say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def tell(end: Ended) -> None:
    """Print how a case ended."""
    facts = end.facts
    rest = "never" if facts.rest_s is None else f"{facts.rest_s:.2f} s"
    hit = "" if end.hit else ", NOT HIT" if end.begun else ", NOT BEGUN"
    with Path("cells.jsonl").open("a") as record:
        record.write(json.dumps(end.as_json()) + "\n")
    say(f"{end.case}: exit code {facts.exit_code}{hit}, safe after {rest}")
    for wrong in end.wrong:
        say(f"    WRONG {wrong}")
    if end.wrong or not end.begun:
        say("    " + facts.stderr.strip()[:500])


def cells(words: list[str], workers: int = 4) -> None:
    """Run the cells that `words` name."""
    cases = [case for case in all_cases() if all(word in str(case) for word in words)]
    with tempfile.TemporaryDirectory() as folder:
        ended = run_cases(cases, Path(folder), workers=workers, report=tell)
    say(f"{len(ended)} cells, {sum(1 for end in ended if end.wrong)} wrong")


def stop(language: str) -> None:
    """Stop a run at rate."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with (
            serving(folder, bench_text(language, name=f"stop-{language}"), speed=SPEED[language]) as served,
            fork_host() as host,
            faulty_wire(served.resources("tcp")["rate_table"]) as wire,
        ):
            station = Station(served, host, folder, language)
            bench = served.bench_file({**served.resources("tcp"), "rate_table": wire.resource})
            run, clock = station.start(folder, bench, "turntable"), WallClock()
            while not station.come("table at rate"):
                sleep(clock, 0.1)
            wire.begin(WireFault("silent", count=0))
            run.signal(signal.SIGTERM)
            say(f"exit code {run.wait()}\n{run.stderr}{served.physics()}\n{bytes(wire.received)!r}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["stop"]:
        stop(sys.argv[2])
    else:
        cells([word for word in sys.argv[1:] if not word.isdigit()], *map(int, filter(str.isdigit, sys.argv[1:])))
