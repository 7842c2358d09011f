"""Runs of the command line that start at once: forked from a process that has imported what they need.

Each is a process of its own, with its own streams, signals, exit and interpreter's end.
"""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

__all__ = ["ForkHost", "Forked", "fork_host"]

_PRELOADED = (
    "numpy, scipy.linalg, pyvisa, pyvisa_py, serial, vcfbench.bench.bench, vcfbench.station.file, vcfbench.sim.served, "
    "vcfbench.cli.run, "
    "vcfbench.procedures.virtual_coriolis.plan, vcfbench.drivers.registry, vcfbench.records.export"
)

_HOST = f"""
import json, os, runpy, signal, sys
os.environ["OPENBLAS_NUM_THREADS"] = "1"
import {_PRELOADED}
while line := sys.stdin.readline():
    asked = json.loads(line)
    if pid := os.fork():
        print(pid, flush=True)
        _, status = os.waitpid(pid, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)
        continue
    os.chdir(asked["folder"])
    for number, name in enumerate(("stdin.txt", "stdout.txt", "stderr.txt")):
        os.dup2(os.open(name, os.O_RDWR | os.O_CREAT | (os.O_TRUNC if number else 0)), number)
    sys.argv = ["vcfbench", *asked["arguments"]]
    break
else:
    sys.exit()
runpy.run_module("vcfbench", run_name="__main__")
"""


@dataclass(slots=True)
class Forked:
    """A run under way."""

    folder: Path
    pid: int
    host: ForkHost
    exit_code: int | None = None

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        if self.exit_code is None and self.host.has_written():
            self.wait()
        return self.exit_code is None

    def wait(self) -> int:
        """Wait for its end; return its exit code."""
        if self.exit_code is None:
            self.exit_code = self.host.line()
        return self.exit_code

    def signal(self, number: int) -> None:
        """Send it a signal, unless it has ended."""
        if self.running:
            with suppress(ProcessLookupError):  # it may end at this very moment
                os.kill(self.pid, number)

    @property
    def stdout(self) -> str:
        """What it has printed."""
        return (self.folder / "stdout.txt").read_text(errors="replace")

    @property
    def stderr(self) -> str:
        """What it has complained of."""
        return (self.folder / "stderr.txt").read_text(errors="replace")

    def journal(self) -> list[dict[str, Any]]:
        """Return the lines of its journal, none if it has not got that far."""
        files = list(self.folder.glob("runs/*/journal.jsonl"))
        return [json.loads(line) for file in files for line in file.read_text().splitlines()]

    def failed_at(self) -> datetime | None:
        """Return when the first step failed, None if none did."""
        failed = [line["utc"] for line in self.journal() if line.get("type") == "error"]
        return datetime.fromisoformat(failed[0]) if failed else None

    def footer(self) -> dict[str, Any] | None:
        """Return the end of its journal, None if there is none."""
        lines = self.journal()
        return lines[-1] if lines and lines[-1].get("type") == "footer" else None


@dataclass(slots=True)
class ForkHost:
    """Starts runs, one after the other."""

    process: subprocess.Popen[str]

    def start(self, folder: Path, *arguments: str) -> Forked:
        """Start ``vcfbench`` with `arguments` in `folder`, where its streams go to files."""
        assert self.process.stdin is not None
        print(json.dumps({"folder": str(folder), "arguments": arguments}), file=self.process.stdin, flush=True)
        return Forked(folder, self.line(), self)

    def has_written(self) -> bool:
        """Whether the host has something to tell."""
        assert self.process.stdout is not None
        return bool(select.select([self.process.stdout], [], [], 0.0)[0])

    def line(self) -> int:
        """Return the next number that the host tells."""
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, "the host of the runs has died"
        return int(line)


@contextmanager
def fork_host(executable: str = sys.executable, environment: Sequence[tuple[str, str]] = ()) -> Iterator[ForkHost]:
    """Start a process from which runs are forked."""
    with subprocess.Popen(  # noqa: S603 - our own words
        [executable, "-c", _HOST],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, **dict(environment)},
    ) as process:
        try:
            yield ForkHost(process)
        finally:
            assert process.stdin is not None
            process.stdin.close()
            try:
                process.wait(20.0)
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGKILL)
