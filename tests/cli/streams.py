"""Runs `vcfbench` with its streams closed, full and broken, each time in a process of its own.

    python -m tests.cli.streams FOLDER [all]

with all of them or with a few, prints one JSON object a line: how it ended, which streams it had, exit code, what it
said, and its journal's last line.
The modules are loaded once; each process is forked from there, given its streams, and ends as every interpreter does.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec.structs import replace
from typer.testing import CliRunner

from vcfbench.cli import main
from vcfbench.drivers.e3631a import E3631A
from vcfbench.drivers.hp34401a import Hp34401A
from vcfbench.errors import MeasurementError
from vcfbench.station.file import embedded_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.interfaces import SafeReport

ENDINGS = {"done": 0, "limit": 1, "usage": 2, "instrument": 3, "aborted": 4, "unsafe": 5, "aborted unsafe": 5}
STREAMS = ("open", "closed", "full", "broken")
LIMIT = "\n[acceptance]\nbias_v = [1.0, 2.0]\n"
QUICK = "\n[procedure]\nrates_deg_s = [20, 0, -20]\nsamples = 2\nmatch_rate_deg_s = 20\n[procedure.drive]"


def spoil(ending: str) -> None:
    """Let the run end so."""
    read = Hp34401A.read_voltage_v
    safe = E3631A.make_safe

    def refuse(meter: Hp34401A) -> float:
        raise MeasurementError("overload", instrument=meter.name, resource=meter.resource)

    def stop(meter: Hp34401A) -> float:
        os.kill(os.getpid(), signal.SIGTERM)
        return read(meter)

    def unsafe(supply: E3631A, *arguments: Any) -> SafeReport:
        return replace(safe(supply, *arguments), safe=False, detail="the outputs are on")

    if ending == "instrument":
        Hp34401A.read_voltage_v = refuse  # type: ignore[method-assign]
    if "aborted" in ending:
        Hp34401A.read_voltage_v = stop  # type: ignore[method-assign]
    if "unsafe" in ending:
        E3631A.make_safe = unsafe  # type: ignore[method-assign]


FEW = (
    ("done", "full", "open"),
    ("done", "broken", "full"),
    ("limit", "full", "closed"),
    ("usage", "full", "full"),
    ("instrument", "broken", "broken"),
    ("aborted", "closed", "closed"),
    ("unsafe", "open", "open"),
    ("aborted unsafe", "closed", "broken"),
)
"""What is tried in every test run; each stream in each state, at each ending."""


def pairs() -> Iterator[tuple[str, str, str]]:
    """Each ending with each stdout and with each stderr, and each stdout with each stderr, in 28 cases of 112."""
    for place, ending in enumerate(ENDINGS):
        for turn, out in enumerate(STREAMS):
            yield ending, out, STREAMS[(place + turn) % len(STREAMS)]


def give(number: int, kind: str, file: int) -> None:
    """Make `number` what a process is started with: a file, one on a full disk, or a pipe that nobody reads."""
    if kind == "open":
        os.dup2(file, number)
    elif kind == "full":
        os.dup2(os.open("/dev/full", os.O_WRONLY), number)
    elif kind == "broken":
        reader, writer = os.pipe()
        os.close(reader)
        os.dup2(writer, number)
        os.close(writer)


def streams_as_started() -> None:
    """Make the streams anew, as the interpreter does when it starts."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            stream = None
        else:
            stream = open(number, mode, encoding="utf-8", closefd=False)  # noqa: SIM115
        setattr(sys, name, stream)
        setattr(sys, f"__{name}__", stream)


def load(folder: Path) -> None:
    """Do here once what loads modules."""
    quick = embedded_text("paper").replace("\n[procedure.drive]", QUICK)
    (folder / "quick.toml").write_text(quick, encoding="utf-8")
    (folder / "limit.toml").write_text(quick + LIMIT, encoding="utf-8")
    CliRunner().invoke(main.app, ["run", "turntable", "--bench", str(folder / "quick.toml"), "--runs", str(folder)])


def child(ending: str, out: str, err: str, pipes: dict[str, int], folder: Path) -> None:
    """Be `vcfbench`; does not return."""
    for number, kind, pipe in ((1, out, pipes["out"]), (2, err, pipes["err"])):
        give(number, kind, pipe)
    for number, kind in ((1, out), (2, err), (0, "closed" if out == err == "closed" else "open")):
        if kind == "closed":  # last of all: what is opened takes the lowest number that is free
            os.close(number)
    streams_as_started()
    os.chdir(folder)
    spoil(ending)
    sys.argv = [
        "vcfbench",
        "run",
        "sing" if ending == "usage" else "turntable",
        "--bench",
        str(folder.parent / ("limit.toml" if ending == "limit" else "quick.toml")),
    ]
    main.main()


def last_line(folder: Path) -> dict[str, Any] | None:
    journals = list(folder.glob("runs/*/journal.jsonl"))
    if not journals:
        return None
    (journal,) = journals
    line: dict[str, Any] = json.loads(journal.read_bytes().splitlines()[-1])
    return {**line, "files": sorted(path.name for path in journal.parent.iterdir())}


def run(ending: str, out: str, err: str, folder: Path) -> dict[str, Any]:
    folder.mkdir()
    files = {name: os.open(folder / name, os.O_RDWR | os.O_CREAT) for name in ("out", "err")}
    process = os.fork()
    if process == 0:
        child(ending, out, err, files, folder)
    _, status = os.waitpid(process, 0)
    for descriptor in files.values():
        os.close(descriptor)
    said = {name: (folder / name).read_text(encoding="utf-8") for name in files}
    code = os.waitstatus_to_exitcode(status)
    return {"ending": ending, "out": out, "err": err, "code": code, "said": said, "last": last_line(folder)}


if __name__ == "__main__":
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    folder = Path(sys.argv[1])
    load(folder)
    cases = pairs() if "all" in sys.argv else FEW
    for index, case in enumerate(cases):
        sys.stdout.write(json.dumps(run(*case, folder / str(index))) + "\n")
        sys.stdout.flush()
