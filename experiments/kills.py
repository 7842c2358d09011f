"""Runs that die or hang at random instants: whether the bench is safe soon, nothing is lost, and the rest is true.

    python experiments/kills.py 0:300 --lines kills.jsonl [--workers 24]    cases 0 to 299, a line each
    python experiments/kills.py 0:100 --watchdog-first --lines first.jsonl  its watchdog is killed first, then the run
    python experiments/kills.py --summary --lines kills.jsonl

A case draws, by its number, a table language, the wires (TCP, terminals, VXI-11 where a box has it), how the program
ends (SIGKILL, SIGSTOP, a call of a VISA library that never returns, with Python's lock in its hands or without, no
memory) and when. The bench is served in another process, on the wall clock, and to the program it is a real one. It
must be at rest and off within BAR_S, without anybody's doing. For a call that never returns that counts from when it
should have returned. Then the run is resumed to its end: no point that was shown may be missing, and what it states
is held against the truth of the simulated gyroscope, which each bench draws anew of the kind: one that settles soon, or
the paper's with --gyroscopes paper. A non-linearity is stated only where errors alone would hardly
make it, so those that stand by chance are all wrong: where none is stated, the bound that is said instead is held
against the truth. With --watchdog-first nobody is left who makes the bench safe: the next run must say so, and leave
it safe. What stands in the file of --lines is not run again. The exit code is 1 where anything is wrong, or U95 holds
too few of the truths (limits.py).

A case is mostly waiting. So there may be many workers, each with benches of its own, and a program is forked from a
process that has loaded everything; its watchdog is not. Benches are drawn by the case's number, within the accuracy
of their instruments. Instruments must answer within TIMEOUT_S: on a computer that does other work too, begin with
`chrt --rr 1`.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import json
import multiprocessing
import os
import random
import re
import resource
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
import traceback
from collections import Counter
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import pyvisa_py  # type: ignore[import-untyped]  # noqa: F401  # with the next, what programs would load each for itself
import serial.urlhandler.protocol_socket  # noqa: F401
from ageing import toml_lines
from limits import outside
from simrack.serve import Control
from simrack_tests.ports import free_port

import vcfbench
import vcfbench_tables
from tests.faults.benches import RATE_DEG_S, ROLES, SPEED, Physics, bench_text
from vcfbench.drivers import serial_wire, visa_wire
from vcfbench.sim.gyro.data_sheet import settling_s
from vcfbench.sim.own_gyro import own_gyro_bench
from vcfbench.steps.events import StepFinished
from vcfbench.studies.metrics import metrics_of
from vcfbench.studies.truth import truth_of
from vcfbench.testing.gyroscopes import drawn_sheet

if TYPE_CHECKING:
    from collections.abc import Callable

    Case = Callable[[int, "Station", Path], dict[str, Any]]

BAR_S = 5.0
LANGUAGES = tuple(RATE_DEG_S)
WIRES = ("tcp", "pty", "vxi11")
ENDS = ("SIGKILL", "SIGSTOP", "call", "call with lock", "memory")
LIBRARIES = {"call": ctypes.CDLL, "call with lock": ctypes.PyDLL}
TIMEOUT_S = 1.0
LONGEST_S = 150.0
"""Of one run, wall time."""
STRUCK_S = dict.fromkeys(LANGUAGES, 9.0) | {"ruya": 50.0, "aaaa": 20.0}
"""From when the bench is live, at most: about as long as a run takes."""
SHARE = {"ruya": 3, "aaaa": 4}
"""Workers of a language for each of another: their cases take longer."""
TRIES = 6
"""To resume: on a busy computer an answer may come too late."""
WAITS = 60
"""Half seconds, for the watchdog of the run before."""
SETTLES_S = 2.0
"""Of a drawn gyroscope, drive loop and output, at most."""
KEPT = ("site", "expected", "uncertainty")
"""Tables of a drawn gyroscope's bench file that stay as they are."""
JITTERY = {"aaaa"}
"""Languages without a rate or a flag of it."""
LOOK_S = 0.1
BEGIN_S = 1.5
"""From the begin of one worker to that of the next."""


class Shows:
    """Observer that writes down each point that a run shows."""

    def __init__(self) -> None:
        self._number = os.open("shown", os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)

    def handle(self, event: object) -> None:
        """Write the point of a step that has one."""
        point = event.result.recorded_point if isinstance(event, StepFinished) else None
        if point is not None:
            os.write(self._number, json.dumps(point.as_json()).encode() + b"\n")


def hang_when_asked(how: str) -> None:
    """Let a call of a VISA library never return once SIGUSR1 has come; say since when."""
    said = os.open("hung", os.O_WRONLY | os.O_CREAT, 0o644)
    armed: list[ctypes.CDLL] = []
    signal.signal(signal.SIGUSR1, lambda *_: armed.append(LIBRARIES[how](None)))

    def hanging(receive: Any) -> Any:
        def doing(*values: Any) -> Any:
            if armed:
                os.write(said, f"{time.time()}\n".encode())
                while True:
                    armed[0].pause()
            return receive(*values)

        return doing

    wires: tuple[Any, ...] = (visa_wire.SocketWire, visa_wire.VisaWire, serial_wire.SerialWire)
    for wire in wires:
        wire.receive = hanging(wire.receive)


def starve_when_asked() -> None:
    """Leave no memory, in large pieces or small, once SIGUSR1 has come."""
    hoard = []

    def starve(*_: object) -> None:
        size = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
        resource.setrlimit(resource.RLIMIT_AS, (size, size))
        for piece in (1 << 20, 1 << 14, 1 << 9):
            with suppress(MemoryError):
                while True:
                    hoard.append(bytearray(piece))

    signal.signal(signal.SIGUSR1, starve)


def run(how: str = "") -> None:
    """Run the four steps, prepared for an end of this kind."""
    if how in LIBRARIES:
        hang_when_asked(how)
    elif how == "memory":
        starve_when_asked()
    vcfbench.run("virtual-coriolis", "bench.toml", runs="runs", observers=[Shows()])


def go_on(record: Path) -> None:
    """Resume `record`."""
    vcfbench.resume(record, observers=[Shows()])


class Program:
    """A process that does something with the bench in `folder`, where its words go too."""

    def __init__(self, folder: Path, act: Callable[[], Any]) -> None:
        self.code: int | None = None
        self.pid = os.fork()
        if self.pid:
            self._ended = os.pidfd_open(self.pid)
            return
        code = 70
        try:
            os.setsid()
            os.chdir(folder)
            for number, name in ((1, "stdout"), (2, "stderr")):
                os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_APPEND), number)
            act()
            code = 0
        except vcfbench.BenchError as error:
            print(f"{type(error).__name__}: {error}", file=sys.stderr)
            code = error.exit_code
        finally:  # an orderly end of Python would end the worker's affairs too
            if code == 70:
                traceback.print_exc()
            sys.stderr.flush()
            os._exit(code)

    def ended(self, wait_s: float = 0.0) -> bool:
        """Wait for its end; tell whether it has come."""
        if self.code is None and select.select([self._ended], [], [], wait_s)[0]:
            self.code = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
            os.close(self._ended)
        return self.code is not None

    def strike(self, how: str) -> None:
        """End it, or let it hang."""
        if not self.ended():
            os.kill(self.pid, getattr(signal, how, signal.SIGUSR1))


def profile_of(language: str, folder: Path) -> Path:
    """Return a profile whose rate from angles is believed though the computer is busy when they come."""
    file = folder / f"{language}.toml"
    text = (Path(vcfbench_tables.__path__[0]) / "profiles" / file.name).read_text(encoding="utf-8")
    file.write_text(f"{text}\n[at_rate]\ntolerance_deg_s = 1.0\n", encoding="utf-8")
    return file


def papers_text(language: str) -> str:
    """Return the file of the paper's bench with a table of this language."""
    text = bench_text(language, name=f"kills-{language}", timeout_s=TIMEOUT_S)
    text = text.replace("sample_interval_s = 0.1", "sample_interval_s = 0.2")
    text = re.sub("\ngenerator_ranges_v.*", "", text.split("# The generator's errors are chosen")[0])
    text += '\n[simulation.errors]\nrate_source = "drawn"\n'
    return text + "\n[simulation.override.thermal]\nself_heating_k = 0.0\n"  # the truth is that of a warm one


def drawn_text(language: str, number: int) -> str:
    """Return the same with a gyroscope of the kind: the first one from here on that is as fast as the paper's."""
    sheet = next(
        each
        for each in map(drawn_sheet, range(1000 * number, 1000 * number + 1000))
        if max(settling_s(each)) <= SETTLES_S and each.range_deg_s >= RATE_DEG_S[language]
    )
    usual = tomllib.loads(papers_text(language))
    file = tomllib.loads(own_gyro_bench(sheet, f"kills-{language}", imperfections=True))
    bench = {name: value for name, value in file.items() if not isinstance(value, dict) or name in KEPT}
    for role in ROLES:
        bench[role] = usual[role]
    bench["limits"] = {key: each for key, each in file["limits"].items() if key in usual["limits"]}
    bench["limits"] |= {"max_acceleration_deg_s2": 1000.0}
    own = file["procedure"]
    shared = {key: value for key, value in own.items() if not isinstance(value, dict)}
    faster = {key: value for key, value in usual["procedure"].items() if not isinstance(value, dict)}
    match_deg_s = max(faster["match_rate_deg_s"], own["virtual-coriolis"]["match_rate_deg_s"])
    match_deg_s = min(match_deg_s, RATE_DEG_S[language])  # a table may have little travel
    slower = {"match_rate_deg_s": match_deg_s, "settle_s": settling_s(sheet)[1]}
    bench["procedure"] = {**shared, **faster, **slower, "drive": own["drive"]}
    bench["simulation"] = {**file["simulation"], "errors": {"rate_source": "drawn"}}
    bench["simulation"]["override"]["thermal"] = {"self_heating_k": 0.0}
    return "".join(toml_lines(bench))


class Station:
    """A served bench of one language, the file that leads to it, and what is really there."""

    def __init__(self, language: str, folder: Path, text: str) -> None:
        folder.mkdir(parents=True)
        if language in JITTERY:
            text = text.replace(f'dialect = "{language}"', f'dialect = "{profile_of(language, folder.parent)}"')
        self.language, self.text, file = language, text, folder / "served.toml"
        file.write_text(text, encoding="utf-8")
        self.description = vcfbench.load_bench(file)
        self.port = free_port()
        offers = [word for role in ROLES for word in ("--offer", f"{role}:tcp,pty")]
        offers += [word for role in ("power", "multimeter") for word in ("--offer", f"{role}:vxi11")]
        words = ["--bench", str(file), "--speed", str(SPEED[language]), "--control-port", str(self.port), "--json"]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "vcfbench", "sim", "serve", *words, *offers], stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None  # noqa: S101
        self.wires = json.loads(self.process.stdout.readline())["instruments"]
        self.control = Control(self.port)
        if os.sched_getscheduler(0) == os.SCHED_RR:  # no box waits for what the computer is busy with
            os.sched_setscheduler(self.process.pid, os.SCHED_RR, os.sched_param(2))

    def begin(self, number: int, folder: Path) -> str:
        """Put the bench back to its first state, and write the file that leads to it as a real one; return its wires.

        A table is on TCP where others are on VXI-11.
        """
        self.control.request("reset", seed=number)
        wires = WIRES[(number // len(LANGUAGES)) % len(WIRES)]
        text = self.text.split("\n[simulation]")[0]
        for role in ROLES:
            resource_name = self.wires[role][wires] or self.wires[role]["tcp"]
            head, table, rest = text.partition(f"[{role}]\n")
            first, _, others = rest.partition("\nresource = ")
            pause = "\nserial_pause_s = 0.0" if resource_name.startswith("ASRL") else ""
            text = f'{head}{table}{first}\nresource = "{resource_name}"{pause}\n{others.partition(chr(10))[2]}'
        (folder / "bench.toml").write_text(text, encoding="utf-8")
        return wires

    def physics(self) -> Physics:
        """Look at what is really there."""
        names = ("applied_rate_deg_s", "node.v_vc", "rail.positive.voltage_v", "rail.negative.voltage_v")
        return Physics(*(float(self.control.request("get", name=name)) for name in names))

    def await_live(self, program: Program) -> float:
        """Wait until there is something to be made safe, or `program` has ended; return when that wait began."""
        begun = time.time()
        while self.physics().safe and not program.ended(LOOK_S) and time.time() < begun + LONGEST_S:
            pass
        return begun

    def close(self) -> None:
        """End it."""
        self.control.close()
        self.process.terminate()
        self.process.wait(20.0)


def watched(station: Station, folder: Path, how: str, at_s: float) -> dict[str, Any]:
    """Run, strike, and see how long the bench stays live."""
    program = Program(folder, partial(run, how))
    begun = station.await_live(program)
    program.ended(at_s)
    line: dict[str, Any] = {"ended_before": program.ended(), "live": not station.physics().safe}
    struck = time.time()
    program.strike(how)
    due, over = struck, struck + (LONGEST_S if line["live"] or how == "memory" else 30.0)
    while time.time() < over:
        if how in LIBRARIES:
            hung = (folder / "hung").read_text() if (folder / "hung").exists() else ""
            due = float(hung.split()[0]) + TIMEOUT_S if hung else time.time()
        elif how == "memory" and not program.ended():
            due = time.time()  # it goes on while it needs no more
        if station.physics().safe and program.ended():
            break
        time.sleep(LOOK_S)
    line |= {"safe": station.physics().safe, "safe_s": round(max(0.0, time.time() - due), 2)}
    if not program.ended():
        line["not_ended"] = True
        program.strike("SIGKILL")
        program.ended(20.0)
    return line | {"code": program.code, "ran_s": round(struck - begun, 1)}


def points_of(path: Path) -> list[dict[str, Any]]:
    """Return the points in a file, one a line."""
    return [json.loads(each) for each in path.read_text().splitlines()] if path.exists() else []


def in_order(shown: list[dict[str, Any]], kept: vcfbench.Run) -> bool:
    """Tell whether all that was shown is kept; a program may be ended between keeping and showing."""
    points = iter([point.as_json() for point in kept.points])
    return all(each in points for each in shown)


def resumed(station: Station, folder: Path) -> dict[str, Any]:
    """Resume the record until it is complete; say what was lost, and what it states beside the truth."""
    line: dict[str, Any] = {"lost": 0, "resumes": 0, "waits": 0}
    complaints = folder / "stderr"
    if not list((folder / "runs").glob("*/journal.jsonl")):
        return line | {"lost": len(points_of(folder / "shown")), "record": "none"}
    while line["resumes"] < TRIES and line["waits"] < WAITS:
        records = [vcfbench.load_run(each.parent) for each in sorted((folder / "runs").glob("*/journal.jsonl"))]
        kept = records[-1]  # which goes back along the earlier ones, if it was ended before it had taken them over
        known = records[-1:] if kept.status == "complete" else records
        line["lost"] += int(not any(in_order(points_of(folder / "shown"), each) for each in known))
        if kept.status == "complete":
            break
        time.sleep(0.5)
        assert kept.directory is not None  # noqa: S101
        said, program = complaints.stat().st_size, Program(folder, partial(go_on, kept.directory))
        if not program.ended(LONGEST_S):
            program.strike("SIGTERM")
            program.ended(30.0)
        in_use = complaints.read_bytes()[said:].startswith(b"InUse")  # by the watchdog, which makes the bench safe
        line["waits" if in_use else "resumes"] += 1
        line["resume_code"] = program.code
    else:
        why = (folder / "stderr").read_text()[-1500:]
        if "it would end again as it did" in why:  # no V_Vc gives the output, between two ranges or for noise
            return line | {"record": "refused", "why": why}
        slow = "at-rate flag not set" in why  # readings come too late for a rate that follows from angles
        return line | {"record": "slow" if slow else str(kept.status), "why": why}
    stated = metrics_of(kept, station.description, ["*"])
    names = [name.removesuffix(".covered") for name in stated if name.endswith(".covered")]
    found = {name: [stated[name], stated[f"{name}.truth"], stated[f"{name}.u95"]] for name in names}
    truth = truth_of(kept, station.description)
    for bound in kept.results.uncertainty.bounds:  # of one that errors alone may make
        found[bound.name] = [0.0, truth[bound.name], bound.high]
    return line | {"record": "complete", "stated": found}


def case(number: int, station: Station, folder: Path) -> dict[str, Any]:
    """Run one case; return its line."""
    draw = random.Random(number)  # noqa: S311 - no secret
    how, at_s = draw.choice(ENDS), draw.uniform(0.0, STRUCK_S[station.language])
    line: dict[str, Any] = {"case": number, "language": station.language, "wires": station.begin(number, folder)}
    line |= {"how": how, "at_s": round(at_s, 2), **watched(station, folder, how, at_s)}
    deadline = time.time() + 10.0
    complaints = (folder / "stderr").read_text()
    while line["code"] not in {0, 3, 4} and "watchdog" not in complaints and time.time() < deadline:
        time.sleep(LOOK_S)
        complaints = (folder / "stderr").read_text()
    line |= {"load": round(os.getloadavg()[0], 1), **resumed(station, folder)}
    late = line["safe_s"] > BAR_S and line["live"]
    line["wrong"] = [
        *(["not safe"] if not line["safe"] else []),
        *(["late"] if late else []),
        *(["lost"] if line["lost"] else []),
        *(["not resumed"] if line["record"] not in {"complete", "none", "slow", "refused"} else []),
        *(["it did not end"] if line.get("not_ended") and line["live"] else []),
        *(["NOT SAFE said"] if complaints.rfind("NOT SAFE") > complaints.rfind("bench was made safe") else []),
    ]
    if line["wrong"]:
        line["words"] = complaints[-2000:]
    return line


def watchdog_first(number: int, station: Station, folder: Path) -> dict[str, Any]:
    """Kill the watchdog and then its run while the bench is live; look whether the next start says so."""
    draw = random.Random(number)  # noqa: S311 - no secret
    at_s, gap_s = draw.uniform(0.0, 5.0), draw.uniform(0.0, 0.1)
    wires, complaints = station.begin(number, folder), folder / "stderr"
    program = Program(folder, run)
    station.await_live(program)
    program.ended(at_s)
    with suppress(FileNotFoundError, IndexError):  # it has ended before, and is not live then
        children = Path(f"/proc/{program.pid}/task/{program.pid}/children").read_text().split()
        os.kill(int(children[0]), signal.SIGKILL)
    time.sleep(gap_s)
    program.strike("SIGKILL")
    program.ended(20.0)
    time.sleep(LOOK_S)
    found = station.physics()
    line = {"case": number, "language": station.language, "wires": wires, "how": "watchdog first"}
    line |= {"live": not found.safe, "turns": not found.at_rest, "code": program.code}
    said = f"process {program.pid} of"
    for what, act in (("run", run), ("safe", lambda: print(vcfbench.safe_bench("bench.toml"), file=sys.stderr))):
        begun, program = time.time(), Program(folder, act)
        while not program.ended(LOOK_S) and time.time() < begun + LONGEST_S:
            if what == "run" and said in complaints.read_text():
                program.strike("SIGTERM")
                program.ended(30.0)
        line |= {f"{what}_code": program.code, f"{what}_s": round(time.time() - begun, 2)}
        line |= {f"{what}_said": said in complaints.read_text(), f"safe_after_{what}": station.physics().safe}
        if line[f"safe_after_{what}"]:
            break
    line["wrong"] = [
        *(["not said"] if line["live"] and not line["run_said"] else []),
        *(["not safe"] if not station.physics().safe else []),
    ]
    if line["wrong"]:
        line["words"] = complaints.read_text()[-2000:]
    return line


def work(languages: tuple[str, ...], numbers: list[int], place: Path, lines: Path, one: Case, *, drawn: bool) -> None:
    """Do the cases of `languages` among `numbers` that no other worker has begun."""
    stations: dict[str, Station] = {}
    for number in numbers:
        folder, language = place / str(number), LANGUAGES[number % len(LANGUAGES)]
        if language not in languages:
            continue
        try:
            folder.mkdir()
        except FileExistsError:
            continue
        try:
            if language not in stations:
                text = drawn_text(language, number) if drawn else papers_text(language)
                stations[language] = Station(language, place / f"{language}-{number}", text)
            line = one(number, stations[language], folder)
        except Exception as error:  # noqa: BLE001  # the next case may do better, with another bench
            line = {"case": number, "wrong": [f"{type(error).__name__}: {error}"]}
            if language in stations:
                stations.pop(language).close()
        with lines.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")  # at once, so that lines of several workers stay whole
        if line["wrong"]:
            shutil.copytree(folder, lines.parent / f"{lines.stem}-{number}", dirs_exist_ok=True)
        shutil.rmtree(folder / "runs", ignore_errors=True)
    for station in stations.values():
        station.close()


def run_cases(numbers: list[int], lines: Path, workers: int, one: Case, *, drawn: bool) -> None:
    """Run `numbers` in their order, as many at once as there are workers, more of those that take longer."""
    done = {json.loads(each)["case"] for each in lines.read_text().splitlines()} if lines.exists() else set()
    todo = [number for number in numbers if number not in done]
    shares = sum(SHARE.get(language, 1) for language in LANGUAGES)
    vcfbench.run("virtual-coriolis", "paper", runs=None)  # what is loaded once is loaded
    gc.freeze()
    fork = multiprocessing.get_context("fork")
    with tempfile.TemporaryDirectory() as name:
        os.environ["VCFBENCH_LOCKS"] = f"{name}/locks"
        ways: list[tuple[str, ...]] = [LANGUAGES] * workers
        if workers >= shares:
            ways = [(each,) for each in LANGUAGES for _ in range(round(workers * SHARE.get(each, 1) / shares))]
        args, named = (todo, Path(name), lines, one), {"drawn": drawn}
        processes = [fork.Process(target=work, args=(way, *args), kwargs=named) for way in ways]
        for process in processes:
            process.start()
            time.sleep(BEGIN_S)
        for process in processes:
            process.join()


def summary(lines: Path) -> bool:
    """Print what the lines say; return whether nothing is wrong."""
    cases = [json.loads(each) for each in lines.read_text().splitlines()]
    whole = [each for each in cases if "record" in each]
    live = [each for each in cases if each.get("live")]
    for what in ("how", "wires", "language"):
        print(f"{what}:", dict(sorted(Counter(each[what] for each in live).items())))
    if first := [each for each in cases if each.get("how") == "watchdog first"]:
        live = [each for each in first if each["live"]]
        said, turning = sum(each["run_said"] for each in live), sum(each["turns"] for each in live)
        print(f"watchdog first: {len(first)}, {len(live)} left live, {turning} turning; {said} said at the next start")
    live = [each for each in whole if each["live"]]
    wrong = Counter(word for each in cases for word in each["wrong"])
    times = sorted(each["safe_s"] for each in live)
    slow, refused = (sum(each["record"] == what for each in whole) for what in ("slow", "refused"))
    again = [each for each in whole if each["resumes"]]
    done = sum(each["record"] == "complete" for each in again)
    print(
        f"{len(whole)} cases, {len(live)} struck while live, {done} of {len(again)} resumed to the end; "
        f"{slow} not, for this machine was too slow, {refused} could not be matched"
    )
    if times:
        print(f"at rest and off after {times[len(times) // 2]} s (median), {times[-1]} s at most; bar {BAR_S} s")
    print("wrong:", dict(wrong) or "nothing")
    names = sorted({name for each in whole for name in each.get("stated", {})})
    for name in names:
        stated = [each["stated"][name] for each in whole if each["resumes"] and name in each.get("stated", {})]
        z = [(value - truth) / u95 for value, truth, u95 in stated]
        if z:
            held = [abs(one) <= 1.0 for one in z]
            beyond = outside(held)
            wrong += Counter([beyond] if beyond else [])
            share = f"{sum(held)} of {len(z)} within U95 ({sum(held) / len(z):.1%})"
            print(f"{name}: {share}, largest {max(map(abs, z)):.2f} U95")
    return not wrong


def main() -> int:
    """Run the cases that are asked for, and print what they say."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("cases", nargs="?", default="0:40", help="FIRST:END")
    asked.add_argument("--lines", type=Path, default=Path("kills.jsonl"))
    asked.add_argument("--workers", type=int, default=24)
    asked.add_argument("--watchdog-first", action="store_true")
    asked.add_argument("--gyroscopes", choices=["drawn", "paper"], default="drawn")
    asked.add_argument("--summary", action="store_true")
    said = asked.parse_args()
    if not said.summary:
        first, end = map(int, said.cases.split(":"))
        one = watchdog_first if said.watchdog_first else case
        drawn = said.gyroscopes == "drawn"
        run_cases(list(range(first, end)), said.lines.absolute(), said.workers, one, drawn=drawn)
    return int(not summary(said.lines))


if __name__ == "__main__":
    sys.exit(main())
