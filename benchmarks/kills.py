"""Runs that die or hang at random instants: whether the bench is safe soon, nothing is lost, and the rest is true.

    python benchmarks/kills.py 0:300 --lines kills.jsonl [--workers 3]     cases 0 to 299, a line each
    python benchmarks/kills.py 0:100 --watchdog-first --lines first.jsonl  its watchdog is killed first, then the run
    python benchmarks/kills.py --summary --lines kills.jsonl

A case draws, by its number, a table language, the wires (TCP, terminals, VXI-11 where a box has it), how the program
ends (SIGKILL, SIGSTOP, a call of a VISA library that never returns, with Python's lock in its hands or without, no
memory) and when. The bench is served in another process, on the wall clock, and to the program it is a real one. It
must be at rest and off within BAR_S, without anybody's doing. For a call that never returns that counts from when it
should have returned. Then the run is resumed to its end: no point that was shown may be missing, and what it states
is held against the truth of the simulated gyroscope. A non-linearity is stated only where errors alone would hardly
make it, so those that stand by chance are all wrong: where none is stated, the bound that is said instead is held
against the truth. With --watchdog-first nobody is left who makes the bench safe: the next run must say so, and leave
it safe. A case is mostly waiting: there may be more workers than processors, while instruments still answer within
TIMEOUT_S. What stands in the file of --lines is not run again.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter, defaultdict
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simrack.serve import Control, ControlError
from simrack_tests.ports import free_port

from tests.faults.benches import RATE_DEG_S, ROLES, SPEED, Physics, bench_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

BAR_S = 5.0
LANGUAGES = tuple(RATE_DEG_S)
WIRES = ("tcp", "pty", "vxi11")
ENDS = ("SIGKILL", "SIGSTOP", "call", "call with lock", "memory")
TIMEOUT_S = 1.0
LONGEST_S = 150.0
"""Of one run, wall time."""
BOUND = re.compile(r"^(\S+nonlinearity): .*; it is below (\S+) ppm")

HOST = r"""
import ctypes, json, os, signal, sys, threading, time
os.environ["OPENBLAS_NUM_THREADS"] = "1"
import numpy, numpy.fft, numpy.ma, numpy.polynomial, numpy.random, pyvisa, pyvisa_py, serial
import vcfbench, vcfbench.bench.bench, vcfbench.station.file, vcfbench.drivers.registry, vcfbench.records.export
import vcfbench.procedures.virtual_coriolis.plan, vcfbench.runs.conduct, vcfbench.runs.resumed
import vcfbench.drivers.visa_wire as visa_wire, vcfbench.drivers.rate_table.line as line
from vcfbench.steps.executor import StepFinished

armed = {}

def never(library):
    os.write(armed["said"], f"{time.time()}\n".encode())
    while True:
        library.pause()

def hanging(receive):
    def doing(self, deadline):
        if "library" in armed:
            never(armed["library"])
        return receive(self, deadline)
    return doing

class Shows:
    def __init__(self):
        self.number = os.open("shown", os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    def handle(self, event):
        point = event.result.recorded_point if isinstance(event, StepFinished) else None
        if point is not None:
            os.write(self.number, json.dumps(point.as_json()).encode() + b"\n")

def act(asked):
    os.chdir(asked["folder"])
    for number, name in ((1, "stdout"), (2, "stderr")):
        os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_APPEND), number)
    kinds = {"call": ctypes.CDLL, "call with lock": ctypes.PyDLL}
    if asked["how"] in kinds:
        armed["said"] = os.open("hung", os.O_WRONLY | os.O_CREAT, 0o644)
        signal.signal(signal.SIGUSR1, lambda *_: armed.update(library=kinds[asked["how"]](None)))
        for wire in (visa_wire.SocketWire, visa_wire.VisaWire, line.SerialWire):
            wire.receive = hanging(wire.receive)
    try:
        if asked["how"] == "safe":
            print(vcfbench.safe_bench("bench.toml"), file=sys.stderr, flush=True)
        elif asked["record"] is None:
            vcfbench.run("virtual-coriolis", "bench.toml", runs="runs", observers=[Shows()])
        else:
            vcfbench.resume(asked["record"], observers=[Shows()])
    except vcfbench.BenchError as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr, flush=True)
        sys.exit(error.exit_code)

while words := sys.stdin.readline():
    if pid := os.fork():
        print(pid, flush=True)
        print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)
        continue
    os.setsid()
    act(json.loads(words))
    break
"""


class Host:
    """Starts runs that need not load anything; each is a process of its own."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", HOST], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def start(self, folder: Path, how: str, record: str | None = None) -> int:
        """Start a run in `folder`, or resume `record`; return its process."""
        assert self.process.stdin is not None  # noqa: S101
        print(json.dumps({"folder": str(folder), "how": how, "record": record}), file=self.process.stdin, flush=True)
        return self._line()

    def _line(self) -> int:
        assert self.process.stdout is not None  # noqa: S101
        return int(self.process.stdout.readline())

    def waiting(self) -> tuple[threading.Event, list[int]]:
        """Return what is set when the run has ended, and where its exit code is then."""
        ended, codes = threading.Event(), []

        def wait() -> None:
            codes.append(self._line())
            ended.set()

        threading.Thread(target=wait, daemon=True).start()
        return ended, codes

    def close(self) -> None:
        assert self.process.stdin is not None  # noqa: S101
        self.process.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(10.0)


class Station:
    """A served bench of one language, the file that leads to it, and what is really there."""

    def __init__(self, language: str, folder: Path) -> None:
        text = bench_text(language, name=f"kills-{language}", timeout_s=TIMEOUT_S)
        text += "\n[simulation.override.thermal]\nself_heating_k = 0.0\n"  # the truth is that of a warm one
        folder.mkdir(parents=True, exist_ok=True)
        self.language, self.text, self.file = language, text, folder / "served.toml"
        self.file.write_text(text, encoding="utf-8")
        self.port = free_port()
        offers = [word for role in ROLES for word in ("--offer", f"{role}:tcp,pty")]
        offers += [word for role in ("power", "multimeter") for word in ("--offer", f"{role}:vxi11")]
        words = ["--bench", str(self.file), "--speed", str(SPEED[language]), "--control-port", str(self.port), "--json"]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "vcfbench", "sim", "serve", *words, *offers], stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None  # noqa: S101
        self.wires = json.loads(self.process.stdout.readline())["instruments"]
        self.control = Control(self.port)

    def bench(self, wires: str) -> str:
        """Return the bench file of a real bench on these wires; a table is on TCP where others are on VXI-11."""
        text = self.text.split("\n[simulation]")[0]
        for role in ROLES:
            resource_name = self.wires[role][wires] or self.wires[role]["tcp"]
            head, table, rest = text.partition(f"[{role}]\n")
            first, _, others = rest.partition("\nresource = ")
            pause = "\nserial_pause_s = 0.0" if resource_name.startswith("ASRL") else ""
            text = f'{head}{table}{first}\nresource = "{resource_name}"{pause}\n{others.partition(chr(10))[2]}'
        return text

    def physics(self) -> Physics:
        """Look at what is really there."""
        names = ("applied_rate_deg_s", "node.v_vc", "rail.positive.voltage_v", "rail.negative.voltage_v")
        return Physics(*(float(self.control.request("get", name=name)) for name in names))

    def close(self) -> None:
        self.control.close()
        self.process.terminate()
        self.process.wait(20.0)


def strike(how: str, pid: int) -> None:
    """End the program, or let it hang."""
    with suppress(ProcessLookupError, FileNotFoundError):
        if how == "memory":
            size = int(Path(f"/proc/{pid}/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
            resource.prlimit(pid, resource.RLIMIT_AS, (size, size))
        else:
            os.kill(pid, getattr(signal, {"call": "SIGUSR1", "call with lock": "SIGUSR1"}.get(how, how)))


def watched(station: Station, host: Host, folder: Path, how: str, at_s: float) -> dict[str, Any]:
    """Run, strike, and see how long the bench stays live."""
    pid = host.start(folder, how)
    ended, codes = host.waiting()
    begun = time.time()
    while station.physics().safe and not ended.is_set() and time.time() < begun + LONGEST_S:
        time.sleep(0.1)  # before, there is nothing to be made safe
    ended.wait(at_s)
    line: dict[str, Any] = {"ended_before": ended.is_set(), "live": not station.physics().safe}
    struck = time.time()
    strike(how, pid)
    due, over = struck, struck + (LONGEST_S if line["live"] or how == "memory" else 30.0)
    while time.time() < over:
        if how.startswith("call"):
            hung = (folder / "hung").read_text() if (folder / "hung").exists() else ""
            due = float(hung.split()[0]) + TIMEOUT_S if hung else time.time()
        elif how == "memory" and not ended.is_set():
            due = time.time()  # it goes on while it needs no more
        if station.physics().safe and ended.wait(0.0):
            break
        time.sleep(0.05)
    line |= {"safe": station.physics().safe, "safe_s": round(max(0.0, time.time() - due), 2)}
    if not ended.is_set():
        line["not_ended"] = True
        os.kill(pid, signal.SIGKILL)
        ended.wait(20.0)
    return line | {"code": codes[0] if codes else None, "ran_s": round(struck - begun, 1)}


def points_of(path: Path) -> list[dict[str, Any]]:
    return [json.loads(each) for each in path.read_text().splitlines()] if path.exists() else []


def resumed(station: Station, host: Host, folder: Path) -> dict[str, Any]:
    """Resume the record until it is complete; say what was lost, and what it states beside the truth."""
    import vcfbench  # noqa: PLC0415 - heavy
    from vcfbench.studies.metrics import metrics_of  # noqa: PLC0415
    from vcfbench.studies.truth import truth_of  # noqa: PLC0415

    line: dict[str, Any] = {"lost": 0, "resumes": 0}
    shown = points_of(folder / "shown")
    records = list((folder / "runs").glob("*/journal.jsonl"))
    if not records:
        return line | ({"lost": len(shown), "record": "none"} if shown else {"record": "none"})
    directory = records[0].parent
    for _ in range(4):
        kept = vcfbench.load_run(directory)
        points = [point.as_json() for point in kept.points]
        line["lost"] += int(points[: len(shown)] != shown)
        if kept.status == "complete":
            break
        line["resumes"] += 1
        time.sleep(1.0)
        pid = host.start(folder, "nothing", str(directory))
        ended, codes = host.waiting()
        if not ended.wait(LONGEST_S):
            strike("SIGTERM", pid)
            ended.wait(30.0)
        line["resume_code"] = codes[0] if codes else None
        newest = max((folder / "runs").glob("*/journal.jsonl"), key=lambda each: each.stat().st_mtime).parent
        directory = newest
    else:
        why = (folder / "stderr").read_text()[-1500:]
        slow = "at-rate flag not set" in why  # readings come too late for a rate that follows from angles
        return line | {"record": "slow" if slow else str(kept.status), "why": why}
    stated = metrics_of(kept, vcfbench.load_bench(station.file), ["*"])
    names = [name.removesuffix(".covered") for name in stated if name.endswith(".covered")]
    found = {name: [stated[name], stated[f"{name}.truth"], stated[f"{name}.u95"]] for name in names}
    truth = truth_of(kept, vcfbench.load_bench(station.file))
    for said in kept.results.uncertainty.not_in_u:  # one that errors alone may make has a bound in place of a value
        if bound := BOUND.search(said):
            found[bound[1]] = [0.0, truth[bound[1]], float(bound[2])]
    return line | {"record": "complete", "stated": found}


def case(number: int, station: Station, host: Host, folder: Path) -> dict[str, Any]:
    """Run one case; return its line."""
    draw = random.Random(number)  # noqa: S311 - no secret
    wires, how = WIRES[(number // len(LANGUAGES)) % len(WIRES)], draw.choice(ENDS)
    at_s = draw.uniform(0.0, 28.0 if SPEED[station_language(number)] < 8.0 else 9.0)
    station.control.request("reset", seed=number)
    folder.mkdir()
    (folder / "bench.toml").write_text(station.bench(wires), encoding="utf-8")
    line: dict[str, Any] = {
        "case": number,
        "language": station_language(number),
        "wires": wires,
        "how": how,
        "at_s": round(at_s, 2),
    }
    line |= watched(station, host, folder, how, at_s)
    complaints = (folder / "stderr").read_text() if (folder / "stderr").exists() else ""
    deadline = time.time() + 10.0
    while "nothing" not in complaints and "watchdog" not in complaints and time.time() < deadline and line["live"]:
        if line["code"] in {0, 3, 4, 5}:
            break
        time.sleep(0.1)
        complaints = (folder / "stderr").read_text()
    line |= {"load": round(os.getloadavg()[0], 1), **resumed(station, host, folder)}
    late = line["safe_s"] > BAR_S and line["live"]
    line["wrong"] = [
        *(["not safe"] if not line["safe"] else []),
        *(["late"] if late else []),
        *(["lost"] if line["lost"] else []),
        *(["not resumed"] if line["record"] not in {"complete", "none", "slow"} else []),
        *(["it did not end"] if line.get("not_ended") and line["live"] else []),
        *(["NOT SAFE said"] if "NOT SAFE" in complaints else []),
    ]
    if line["wrong"]:
        line["words"] = complaints[-2000:]
    return line


def watchdog_first(number: int, station: Station, host: Host, folder: Path) -> dict[str, Any]:
    """Kill the watchdog and then its run while the bench is live; look whether the next start says so."""
    draw = random.Random(number)  # noqa: S311 - no secret
    wires, at_s, gap_s = WIRES[(number // len(LANGUAGES)) % len(WIRES)], draw.uniform(0.0, 5.0), draw.uniform(0.0, 0.1)
    station.control.request("reset", seed=number)
    folder.mkdir()
    (folder / "bench.toml").write_text(station.bench(wires), encoding="utf-8")
    pid = host.start(folder, "nothing")
    ended, codes = host.waiting()
    over = time.time() + LONGEST_S
    while station.physics().safe and not ended.is_set() and time.time() < over:
        time.sleep(0.05)
    ended.wait(at_s)
    with suppress(FileNotFoundError, IndexError):  # it has ended before, and is not live then
        os.kill(int(Path(f"/proc/{pid}/task/{pid}/children").read_text().split()[0]), signal.SIGKILL)
    time.sleep(gap_s)
    strike("SIGKILL", pid)
    ended.wait(20.0)
    time.sleep(0.1)
    line = {"case": number, "language": station.language, "wires": wires, "how": "watchdog first"}
    line |= {"live": not station.physics().safe, "turns": not station.physics().at_rest, "codes": list(codes)}
    said = f"process {pid} of"
    for what in ("run", "safe"):
        begun, complaints = time.time(), folder / "stderr"
        next_pid = host.start(folder, what)
        ended, codes = host.waiting()
        while not ended.wait(0.1) and time.time() < begun + LONGEST_S:
            if what == "run" and said in complaints.read_text():
                strike("SIGTERM", next_pid)
                ended.wait(30.0)
        line |= {f"{what}_code": codes[0] if codes else None, f"{what}_s": round(time.time() - begun, 2)}
        line |= {f"{what}_said": said in complaints.read_text(), f"safe_after_{what}": station.physics().safe}
        if station.physics().safe:
            break
    line["wrong"] = [
        *(["not said"] if line["live"] and not line.get("run_said") else []),
        *(["not safe"] if not station.physics().safe else []),
    ]
    if line["wrong"]:
        line["words"] = complaints.read_text()[-2000:]
    return line


def station_language(number: int) -> str:
    return LANGUAGES[number % len(LANGUAGES)]


class Stations:
    """Served benches: each serves one case at a time, and many one after the other."""

    def __init__(self, place: Path) -> None:
        self.place, self.made, self.lock = place, 0, threading.Lock()
        self.free: dict[str, list[Station]] = defaultdict(list)
        self.all: list[Station] = []

    @contextmanager
    def one(self, language: str) -> Iterator[Station]:
        """Lend a bench of `language`; one after which something broke is not lent again."""
        with self.lock:
            station = self.free[language].pop() if self.free[language] else None
            self.made += station is None
            name = f"{language}-{self.made}"
        if station is None:
            station = Station(language, self.place / name)
            self.all.append(station)
        yield station
        with self.lock:
            self.free[language].append(station)

    def close(self) -> None:
        for station in self.all:
            station.close()


def run_cases(numbers: list[int], lines: Path, workers: int, one: Callable[..., dict[str, Any]]) -> None:
    """Run `numbers` in their order, as many at once as there are workers: most of a case is waiting."""
    done = {json.loads(each)["case"] for each in lines.read_text().splitlines()} if lines.exists() else set()
    todo = iter([number for number in numbers if number not in done])
    taking = threading.Lock()

    def work(place: Path, stations: Stations) -> None:
        host = Host()
        while True:
            with taking:
                number = next(todo, None)
            if number is None:
                return host.close()
            folder = place / str(number)
            try:
                with stations.one(station_language(number)) as station:
                    line = one(number, station, host, folder)
            except (AssertionError, ControlError, OSError, ValueError) as error:
                line = {"case": number, "wrong": [f"{type(error).__name__}: {error}"]}
                host.close()
                host = Host()
            with taking, lines.open("a", encoding="utf-8") as file:
                print(json.dumps(line), file=file, flush=True)
            if line["wrong"]:
                shutil.copytree(folder, lines.parent / f"{lines.stem}-{number}", dirs_exist_ok=True)
            shutil.rmtree(folder, ignore_errors=True)

    with tempfile.TemporaryDirectory() as name:
        stations = Stations(Path(name))
        threads = [threading.Thread(target=work, args=(Path(name), stations)) for _ in range(workers)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        stations.close()


def summary(lines: Path) -> None:
    """Print what the lines say."""
    cases = [json.loads(each) for each in lines.read_text().splitlines()]
    whole = [each for each in cases if "record" in each]
    for what in ("how", "wires", "language"):
        print(f"{what}:", dict(sorted(Counter(each[what] for each in cases if what in each).items())))
    if first := [each for each in cases if each.get("how") == "watchdog first"]:
        live = [each for each in first if each["live"]]
        said, turning = sum(each["run_said"] for each in live), sum(each["turns"] for each in live)
        print(f"watchdog first: {len(first)}, {len(live)} left live, {turning} turning; {said} said at the next start")
    live = [each for each in whole if each["live"]]
    wrong = Counter(word for each in cases for word in each["wrong"])
    times = sorted(each["safe_s"] for each in live)
    slow = sum(each["record"] == "slow" for each in whole)
    again = [each for each in whole if each["resumes"]]
    done = sum(each["record"] == "complete" for each in again)
    print(
        f"{len(whole)} cases, {len(live)} struck while live, {done} of {len(again)} resumed to the end; "
        f"{slow} not, for this machine was too slow"
    )
    if times:
        print(f"at rest and off after {times[len(times) // 2]} s (median), {times[-1]} s at most; bar {BAR_S} s")
    print("wrong:", dict(wrong) or "nothing")
    names = sorted({name for each in whole for name in each.get("stated", {})})
    for name in names:
        stated = [each["stated"][name] for each in whole if each["resumes"] and name in each.get("stated", {})]
        z = [(value - truth) / u95 for value, truth, u95 in stated]
        if z:
            held = sum(abs(one) <= 1.0 for one in z)
            print(f"{name}: {held} of {len(z)} within U95 ({held / len(z):.1%}), largest {max(map(abs, z)):.2f} U95")


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("cases", nargs="?", default="0:40", help="FIRST:END")
    asked.add_argument("--lines", type=Path, default=Path("kills.jsonl"))
    asked.add_argument("--workers", type=int, default=2)
    asked.add_argument("--watchdog-first", action="store_true")
    asked.add_argument("--summary", action="store_true")
    said = asked.parse_args()
    if not said.summary:
        first, end = map(int, said.cases.split(":"))
        one = watchdog_first if said.watchdog_first else case
        run_cases(list(range(first, end)), said.lines.absolute(), said.workers, one)
    summary(said.lines)


if __name__ == "__main__":
    main()
