"""One start of a program under the drawn happenings, from the first operation to the last, with its observations."""

import errno
import os
import shutil
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

from msgspec import Struct, field
from msgspec.structs import replace
from simrack.faulty_device import FaultInjector

import vcfbench.clock
import vcfbench.records.journal
from vcfbench.archive.run import Run
from vcfbench.clock import Clock
from vcfbench.errors import Aborted, BenchError, ConfigError
from vcfbench.procedures.layers import asked_in_python
from vcfbench.runs.conduct import conduct
from vcfbench.runs.request import Request
from vcfbench.runs.resumed import Resumed, broken_off
from vcfbench.safety.signals import StopSignals
from vcfbench.sim.builder import SimulatedBench
from vcfbench.station.description import BenchDescription
from vcfbench.steps.events import Event, StepFinished, StepStarted
from vcfbench.testing.disk import Disk, DiskState
from vcfbench.testing.soaking.draw import Draw, Happening

_STILL = 100_000
"""Waits without a moment passing after which time stands still."""
_WALL_S = 600.0
"""Wall time of a start after which it hangs; the longest takes some seconds of a processor."""
_SYNCHRONISING = ("_see_to_disk", "_see_names_to_disk")
"""What the journal of a simulated bench leaves to the system."""


class Killed(BaseException):
    """The program has died; no handler on the way knows it, and their actions are not seen."""


class Stuck(BaseException):
    """The program would never end."""


class Clean(Struct, frozen=True):
    """The clean run of a draw: its duration in bench time and in operations of its disk, its results, its faults."""

    duration_s: float = 0.0
    operations: int = 0
    values: Mapping[str, tuple[float, float]] = {}
    """Value and U95 by name."""
    wrong: tuple[str, ...] = ()


class Ended(Struct):
    """Observations of one start."""

    error: BaseException | None = None
    run: Run | None = None
    died: str = ""
    """Cause of its death: "kill" or "power cut"; empty where it lived."""
    signals: int = 0
    faults: list[Happening] = field(default_factory=list)
    """Those that could happen, their instants bench time."""
    disk_troubles: int = 0
    wrong: list[str] = field(default_factory=list)
    points: list[dict[str, Any]] = field(default_factory=list)
    """Those that were shown."""
    measured_s: tuple[float, float] | None = None
    """From the first window of these to the end of the last."""
    rate_deg_s: float = 0.0
    opened_deg_s: float = 0.0
    """Highest rate at which the table's servo was opened."""
    v_vc_v: float = 0.0
    rails_v: tuple[float, float] = (0.0, 0.0)
    began: bool = False
    end_s: float = 0.0
    last_event_s: float = 0.0
    operations: int = 0


class _Clock:
    """Simulated time at whose instants something happens."""

    def __init__(self, clock: Clock, acts: list[tuple[float, Happening]], stage: "_Stage") -> None:
        self._clock = clock
        self._acts = acts
        self._stage = stage
        self._still = 0
        self.now = clock.now

    def sleep_until(self, instant_s: float) -> None:
        self._still = self._still + 1 if instant_s <= self.now() else 0
        if self._still > _STILL:
            self._stage.ended.wrong.append(f"bench time stands still at {self.now():.6f} s")
            raise Stuck
        while self._acts and self._acts[0][0] <= instant_s:
            at_s, happening = self._acts.pop(0)
            self._clock.sleep_until(at_s)
            self._stage.act(happening)
        self._clock.sleep_until(instant_s)


class _Stage:
    """Everything around one start: its clock, its disk, its faults."""

    def __init__(self, happenings: Sequence[Happening], clean: Clean, random: Random) -> None:
        self.ended = Ended()
        self.over = False
        self.disk: Disk | None = None
        self.left: DiskState | None = None
        self.resumes: Path | None = None
        self.folder: Path | None = None
        self._random = random
        self._timed = [(each.at * clean.duration_s, each) for each in happenings if not each.by_writes]
        self._written = [(1 + round(each.at * clean.operations), each) for each in happenings if each.by_writes]
        self._world: Any = None
        self._clock: Any = None
        self._begun_s = 0.0
        """When the step under way began."""

    def build(self, description: BenchDescription, seed: int, clock: Clock, /) -> SimulatedBench:
        """Build the bench with its faults."""
        acts = [each for each in self._timed if each[1].fault is None]
        built = SimulatedBench.build(description, seed, _Clock(clock, acts, self))
        faults = FaultInjector(built.devices, built.clock, seed)
        attended: Any = built.clock
        attended.attend(*faults.devices.values())
        for at_s, each in self._timed:
            if each.fault is not None:
                fault = replace(each.fault, at_s=at_s)
                try:
                    faults.add(fault)
                except ValueError:  # this model does not know it
                    continue
                self.ended.faults.append(replace(each, fault=fault))
        self._world, self._clock = built.world, built.clock
        motion: Any = built.world.table
        motion.open_servo = partial(self._open_servo, motion, motion.open_servo)
        return replace(built, devices=faults.devices)

    def _open_servo(self, motion: Any, opening: Callable[[], None]) -> None:
        if motion.servo_closed:
            self.ended.opened_deg_s = max(self.ended.opened_deg_s, abs(motion.rate_deg_s()))
        opening()

    def handle(self, event: Event) -> None:
        """Keep the points that were shown."""
        ended, now_s = self.ended, self._clock.now()
        ended.last_event_s = now_s
        if isinstance(event, StepStarted):
            self._begun_s = now_s
        point = event.result.recorded_point if isinstance(event, StepFinished) else None
        if point is not None and not ended.died:
            ended.points.append(point.as_json())
            ended.measured_s = (self._begun_s if ended.measured_s is None else ended.measured_s[0]), now_s

    def act(self, happening: Happening) -> None:
        """Start an action at an instant."""
        if self.over or self.ended.died:
            return
        if happening.ends:
            self._die(happening)
        elif happening.what == "signal":
            for _ in range(round(happening.size)):
                self.ended.signals += 1
                _send(self._random.choice((signal.SIGINT, signal.SIGTERM)))
        elif happening.what == "starter":
            # Try to go on with the run that is under way, as somebody at another terminal might
            found = sorted(self.folder.glob("*/journal.jsonl")) if self.folder is not None else []
            for journal in found:
                if vcfbench.records.journal.being_written(journal):
                    try:
                        broken_off(journal.parent)
                    except ConfigError:
                        continue
                    self.ended.wrong.append("a run under way is taken for one that was broken off")
        elif happening.what == "clock":
            _Shifted.by += timedelta(seconds=happening.size)

    def _die(self, happening: Happening) -> None:
        disk = self.disk
        assert disk is not None  # noqa: S101  # there is one around every start
        self.ended.died = happening.what
        self.left = next(disk.after_power_cut(self._random)) if happening.what == "power cut" else disk.now()
        disk.stopped = True
        raise Killed

    def before(self, number: int, what: str) -> float | None:
        """Return the part of a write that the disk takes, None for all; raise the OSError that was drawn."""
        for at, each in self._written:
            if each.ends and number == at:
                self._die(each)
            if each.ends and number == at - 1 and what == "write":
                return self._random.random()
            if each.what == "disk full" and at <= number < at + each.size and what in {"write", "open", "mkdir"}:
                self.ended.disk_troubles += 1
                if what == "write" and number == at:
                    return self._random.random()
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            if each.what == "sync fails" and at <= number < at + each.size and what.endswith("sync"):
                self.ended.disk_troubles += 1
                raise OSError(errno.EIO, os.strerror(errno.EIO))
        return None

    def look(self) -> None:
        """Record the true state of the bench."""
        self.ended.operations = 0 if self.disk is None else self.disk.operations
        if self._world is not None:
            world, ended = self._world, self.ended
            ended.began, ended.end_s = True, self._clock.now()
            ended.rate_deg_s = world.table.rate_deg_s()
            ended.v_vc_v = world.glance_v("v_vc")
            ended.rails_v = (world.glance_v("rail_positive"), world.glance_v("rail_negative"))


class _Shifted(datetime):
    """The time of day of a computer whose clock is set."""

    by = timedelta()

    @classmethod
    def now(cls, tz: Any = None) -> Any:
        return datetime.now(tz) + cls.by  # noqa: TID251  # clock.utc_now calls it


def _send(number: int) -> None:
    if threading.current_thread() is threading.main_thread():
        signal.raise_signal(number)
    else:
        main = threading.main_thread().ident
        assert main is not None  # noqa: S101  # it goes on
        signal.pthread_kill(main, number)


@contextmanager
def _within(wall_s: float, ended: Ended) -> Iterator[None]:
    """End the context if it takes longer (where there is an alarm), with Stuck."""
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(_number: int, _frame: Any) -> None:
        ended.wrong.append(f"it has not ended after {wall_s:g} s of wall time")
        raise Stuck

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, wall_s, 1.0)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def _surroundings(draw: Draw) -> Iterator[None]:
    """Let clocks be set, and the journal be synchronised as on a real bench."""
    simulated, clock = vcfbench.records.journal.SimulatedJournal, vcfbench.clock
    plain, day = {name: vars(simulated)[name] for name in _SYNCHRONISING}, clock.datetime  # type: ignore[attr-defined]
    _Shifted.by = timedelta()
    clock.datetime = _Shifted  # type: ignore[attr-defined]  # put back
    if draw.synchronised:
        for name in _SYNCHRONISING:
            setattr(simulated, name, getattr(vcfbench.records.journal.Journal, name))
    try:
        yield
    finally:
        clock.datetime = day  # type: ignore[attr-defined]
        for name, method in plain.items():
            setattr(simulated, name, method)


def start(draw: Draw, life: int, clean: Clean, folder: Path, earlier: Path | None) -> Ended:
    """Start the program, or resume the record `earlier`; its disk is left in `folder`.

    Raises:
        Aborted: a signal came that was not drawn.
    """
    own = [each for each in draw.happenings if each.life == life]
    stage = _Stage(own, clean, Random(f"{draw.seed}/{life}"))  # noqa: S311  # faults, no secrets
    stage.folder = folder
    ended = stage.ended
    with _surroundings(draw), StopSignals() as signals, _within(_WALL_S, ended):
        stage.disk = disk = Disk(folder, stage.before)
        with disk:
            try:
                ended.run = _conducted(draw, stage, folder, earlier, signals)
            except BaseException as error:  # noqa: BLE001  # all of it is judged
                ended.error = error
                error.__traceback__ = error.__traceback__ if not isinstance(error, BenchError) else None
            stage.over = True
        stage.look()
    if isinstance(ended.error, Aborted) and not ended.signals:  # by a signal that was meant for the soak itself
        raise ended.error
    if stage.left is not None:
        shutil.rmtree(folder)
        folder.mkdir()
        stage.left.lay(folder)
    return ended


def _conducted(draw: Draw, stage: _Stage, folder: Path, earlier: Path | None, signals: StopSignals) -> Run:
    common: dict[str, Any] = {"observers": [stage], "build": stage.build, "warn": lambda _words: None}
    if earlier is None:
        settings = asked_in_python(draw.settings)
        asked = Request(draw.procedure, draw.bench(), draw.specimens, settings, folder, **common)
        return conduct(asked, signals)
    broken = broken_off(earlier)
    return conduct(Request(broken.procedure, runs=folder, **common), signals, partial(Resumed, broken))
