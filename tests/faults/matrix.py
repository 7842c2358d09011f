"""The fault matrix: what a run does, and what becomes of the bench, when a wire fails at a bad moment."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from itertools import cycle, product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simrack.wire_faults import FaultyWire, WireFault, faulty_wire

from tests.faults.benches import RATE_DEG_S, SPEED, Served, bench_text, serving
from tests.faults.forks import Forked, ForkHost, fork_host
from tests.faults.verdict import REST_S, Facts, mistakes
from vcfbench.clock import WallClock, sleep, utc_now

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

__all__ = ["LANGUAGES", "MODES", "MOMENTS", "OTHERS", "WIRES", "Case", "Ended", "Station", "all_cases", "run_cases"]

LANGUAGES = tuple(RATE_DEG_S)
WIRES = ("tcp", "pty")
MOMENTS = {"table at rate": "rate_table", "V_Vc on": "rate_source", "rails on": "power"}
"""When the fault strikes, and on whose wire."""

OTHERS = {"rails on, meter": "multimeter", "rails on, oscilloscope": "oscilloscope"}
"""The same for what drives nothing: no cells of the matrix, but their replies matter too."""

MODES: dict[str, dict[str, Any]] = {
    "silent": {"kind": "silent"},
    "late": {"kind": "late", "delay_s": 1.4},
    **{kind: {"kind": kind} for kind in ("truncated", "replaced", "unended")},
    "trickle": {"kind": "trickle", "delay_s": 0.3},
    **{kind: {"kind": kind} for kind in ("doubled", "disconnect", "unreachable", "garbage")},
}
"""Modes of failing: faults by their kind. *Unreachable* lasts a second."""

_RUN_S = 90.0
_POLL_S = 0.1
_AWAY_S = 1.0
_TRIES = 3


@dataclass(frozen=True, slots=True)
class Case:
    """One cell of the matrix: the fault `mode` on a wire, at a moment, once or for good."""

    language: str
    moment: str
    wires: str
    mode: str
    lasting: bool

    @property
    def hears(self) -> bool:
        """Whether the instrument can still be told anything."""
        return not (self.lasting and self.mode == "unreachable")

    @property
    def fault(self) -> WireFault:
        """What happens on the wire."""
        return WireFault(count=None if self.lasting else 1, **MODES[self.mode])

    @property
    def procedure(self) -> str:
        """The procedure that comes by the moment."""
        return "virtual-coriolis" if self.moment == "V_Vc on" else "turntable"

    def __str__(self) -> str:
        return f"{self.language}/{self.moment}/{self.wires}/{self.mode}/{'lasting' if self.lasting else 'once'}"


@dataclass(frozen=True, slots=True)
class Ended:
    """How a case ended; `wrong` says what must not have been."""

    case: Case
    facts: Facts
    begun: bool
    """Whether the run came as far as the fault: on a slow machine its time-outs may be over before."""
    hit: bool
    """Whether any reply was spoilt: after its last question an instrument says nothing that could be."""
    wrong: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Return what is kept of it."""
        return {
            **asdict(self.case),
            "exit_code": self.facts.exit_code,
            "begun": self.begun,
            "hit": self.hit,
            "hears": self.facts.hears,
            "at_rest_and_off": self.facts.physics.safe,
            "still_s": None if self.facts.still_s is None else round(self.facts.still_s, 1),
            "rest_s": None if self.facts.rest_s is None else round(self.facts.rest_s, 1),
            "slowness_s": round(self.facts.slowness_s, 1),
            "wrong": list(self.wrong),
            "words": self.facts.stderr.strip()[:1000] if self.wrong else "",
        }


def all_cases() -> list[Case]:
    """Return every cell: of the table's own wire in each language, of the others with the languages in turn."""
    turns = cycle(LANGUAGES)
    return [
        Case(language, moment, wires, mode, lasting)
        for lasting, moment, wires, mode in product((True, False), MOMENTS, WIRES, MODES)
        for language in (LANGUAGES if moment == "table at rate" else (next(turns),))
    ]


@dataclass(slots=True)
class _Watch:
    """Looks at the bench while a run goes on: lets the fault happen in time, and sees when all is at rest."""

    station: Station
    case: Case
    wire: FaultyWire
    run: Forked
    begun: bool = False
    still_s: float | None = None
    at_rest_s: float | None = None
    ended: threading.Event = field(default_factory=threading.Event)

    def watch(self) -> Ended:
        """Watch until the run is over and the bench is at rest, or has had its time."""
        waiter = threading.Thread(target=self._wait, daemon=True)
        waiter.start()
        clock = self.wire.clock
        give_up_s = clock.now() + _RUN_S
        while clock.now() < give_up_s and not self.ended.wait(_POLL_S):
            self._look()
        hung = not self.ended.is_set()
        run_end_s = clock.now()
        if hung:
            self.run.signal(signal.SIGKILL)
        waiter.join(10.0)
        self._look()
        while self.at_rest_s is None and self.case.hears and clock.now() < run_end_s + REST_S + self.station.stop_s:
            sleep(clock, _POLL_S)
            self._look()
        return self._judged(run_end_s, hung=hung)

    def _wait(self) -> None:
        self.run.wait()
        self.ended.set()

    def _look(self) -> None:
        if not self.begun:
            if not self.ended.is_set() and self.station.come(self.case.moment):
                self.begun = True
                self.wire.begin(self.case.fault)
            return
        now_s = self.wire.clock.now()
        once_away = self.case.mode == "unreachable" and not self.case.lasting
        if once_away and self.wire.spoilt_s and now_s > self.wire.spoilt_s[0] + _AWAY_S:
            self.wire.end()
        physics = self.station.served.physics()
        self.still_s = _since(self.still_s, now_s, now=physics.at_rest)
        self.at_rest_s = _since(self.at_rest_s, now_s, now=physics.safe)

    def _judged(self, run_end_s: float, *, hung: bool) -> Ended:
        code = None if hung else self.run.exit_code
        since_s = self.wire.spoilt_s[0] if self.wire.spoilt_s else run_end_s
        if code == 0:  # the fault was healed, and the run went on
            since_s = run_end_s
        elif (noticed := self.run.failed_at()) is not None:  # a stream that is late can look right for long
            since_s = max(since_s, self.wire.clock.now() - (utc_now() - noticed).total_seconds())
        facts = Facts(
            exit_code=code,
            stderr=self.run.stderr,
            footer=self.run.footer(),
            answer=_json(self.run.stdout),
            physics=self.station.served.physics(),
            hears=self.case.hears,
            still_s=None if self.still_s is None else max(0.0, self.still_s - since_s),
            rest_s=None if self.at_rest_s is None else max(0.0, self.at_rest_s - since_s),
            after_end_s=None if self.at_rest_s is None else max(0.0, self.at_rest_s - run_end_s),
            slowness_s=self.station.stop_s,
            clean_v=self.station.clean_v(self.case) if code == 0 else None,
        )
        return Ended(self.case, facts, self.begun, bool(self.wire.spoilt_s), mistakes(facts))


def _since(before_s: float | None, now_s: float, *, now: bool) -> float | None:
    """Return since when something is so that is so `now`."""
    if not now:
        return None
    return now_s if before_s is None else before_s


def _json(text: str) -> dict[str, Any] | None:
    try:
        answer: dict[str, Any] = json.loads(text)
    except ValueError:
        return None
    return answer


@dataclass(slots=True)
class Station:
    """One served bench, and what is known of it when nothing fails."""

    served: Served
    host: ForkHost
    folder: Path
    language: str
    stop_s: float = 10.0
    clean: dict[str, list[float]] = field(default_factory=dict)

    def run(self, case: Case) -> Ended:
        """Run one case, again when this machine was too slow to come as far as the fault."""
        for _ in range(_TRIES - 1):
            ended = self._run(case)
            if ended.begun:
                return ended
        return self._run(case)

    def _run(self, case: Case) -> Ended:
        self.served.reset()
        folder = self.new_folder()
        role, resources = {**MOMENTS, **OTHERS}[case.moment], self.served.resources(case.wires)
        try:
            with faulty_wire(resources[role]) as wire:
                bench = self.served.bench_file({**resources, role: wire.resource})
                ended = _Watch(self, case, wire, self.start(folder, bench, case.procedure)).watch()
                for number in re.findall(r"its watchdog, process (\d+)", ended.facts.stderr):
                    with suppress(ProcessLookupError):  # it would switch the bench of the next case off for ever
                        os.kill(int(number), signal.SIGKILL)
                return ended
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def new_folder(self) -> Path:
        """Return an empty folder."""
        return Path(tempfile.mkdtemp(dir=self.folder))

    def start(self, folder: Path, bench: str, procedure: str) -> Forked:
        """Start a run."""
        (folder / "bench.toml").write_text(bench)
        words = ("--quiet", "--json", "--bench", "bench.toml", "--runs", "runs")
        return self.host.start(folder, "run", procedure, *words)

    def come(self, moment: str) -> bool:
        """Tell whether the bench is where the fault is to strike."""
        if moment == "table at rate":
            return abs(self.served.look("applied_rate_deg_s")) >= 0.99 * RATE_DEG_S[self.language]
        if moment == "V_Vc on":
            return abs(self.served.look("node.v_vc")) > 0.05
        return self.served.look("rail.positive.voltage_v") > 9.5

    def clean_v(self, case: Case) -> list[float]:
        """Return the outputs of the procedure of `case` without a fault, V."""
        if case.procedure not in self.clean:
            run = self._good_run(case.procedure)
            for _ in range(_TRIES - 1):
                if run.wait() == 0:
                    break
                run = self._good_run(case.procedure)
            assert run.wait() == 0, f"{self.language}: without a fault: {run.stderr}"
            self.clean[case.procedure] = [point["output_v"] for point in json.loads(run.stdout)["points"]]
        return self.clean[case.procedure]

    def _good_run(self, procedure: str) -> Forked:
        self.served.reset()
        return self.start(self.new_folder(), self.served.bench_file(self.served.resources("tcp")), procedure)

    def brought_to(self, moment: str, procedure: str) -> Forked:
        """Return a run on good wires that has come to `moment`; a machine too slow for its time-outs tries again."""
        clock = WallClock()
        for _ in range(5):
            run, give_up_s = self._good_run(procedure), clock.now() + _RUN_S
            while run.running and clock.now() < give_up_s:
                if self.come(moment):
                    return run
                sleep(clock, 0.02)
        raise AssertionError(f"{self.language}: never came to {moment}: {run.stderr}")

    def measure_stop(self) -> Ended:
        """Stop a run at rate on a good wire; from then on that is what this machine needs."""
        case = Case(self.language, "table at rate", "tcp", "stopped, no fault", lasting=False)
        run, clock = self.brought_to(case.moment, case.procedure), WallClock()
        begin_s, rest_s = clock.now(), None
        run.signal(signal.SIGTERM)
        while rest_s is None and clock.now() < begin_s + 2.0 * self.stop_s:
            sleep(clock, _POLL_S)
            rest_s = clock.now() - begin_s if self.served.physics().safe else None
        code = run.wait()
        if rest_s is not None:
            self.stop_s = rest_s
        facts = Facts(
            exit_code=code,
            stderr=run.stderr,
            footer=run.footer(),
            answer=None,
            physics=self.served.physics(),
            hears=True,
            still_s=rest_s,
            rest_s=rest_s,
            after_end_s=0.0,
            slowness_s=self.stop_s,
            clean_v=None,
        )
        wrong = mistakes(replace(facts, exit_code=3 if code == 4 else code))
        return Ended(case, facts, begun=True, hit=True, wrong=wrong)


def run_cases(
    cases: Sequence[Case],
    folder: Path,
    *,
    workers: int = 4,
    measured: bool = True,
    report: Callable[[Ended], None] = lambda _: None,
) -> list[Ended]:
    """Run `cases`, each language on a bench of its own, `workers` languages at a time.

    `measured`: stops on a good wire come first, and are the measure of how slow this machine is.
    """
    ended: list[Ended] = []

    def tell(end: Ended) -> None:
        ended.append(end)
        report(end)

    def work(language: str) -> None:
        own = [case for case in cases if case.language == language]
        place = folder / language
        place.mkdir()
        text = bench_text(language, name=f"faults-{language}-{folder.name}"[:60])
        with serving(place, text, speed=SPEED[language]) as served, fork_host() as host:
            station = Station(served, host, place, language)
            if measured:
                tell(station.measure_stop())
            for case in own:
                tell(station.run(case))

    languages = [language for language in LANGUAGES if any(case.language == language for case in cases)]
    with ThreadPoolExecutor(workers) as pool:
        failed = [(language, pool.submit(work, language)) for language in languages]
        for language, future in failed:
            if (error := future.exception()) is not None:
                raise RuntimeError(f"{language}: {error!r}") from error
    return ended
