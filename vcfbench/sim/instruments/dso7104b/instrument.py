"""A simulated Agilent InfiniiVision DSO7104B, four channels, whose inputs are wired to nodes of the PCB.

The 7000B programmer's guide was not at hand; facts come from its quotations in public drivers, pages of the guides of
the 5000, 6000 and 3000T series, the 7000B user's guide, live traces of the 6000 series and the service guide.
Unverified, among others: three-digit exponents (seen on the 6000 series, same code base), number and words of most
refusals, limits of offset and time base, default of the waveform format, and what :SINGle;*OPC? waits for.
Measurements and the math trace are computed from the record on the screen.

The commands stand in modules of their own: root and system (:mod:`.system`), channels (:mod:`.vertical`), time
base and acquisition (:mod:`.timing`), trigger (:mod:`.triggering`), measurements (:mod:`.measuring`),
waveforms (:mod:`.waveform`), math (:mod:`.function`), cursors, files, masks (:mod:`.accessories`).

Inputs are taken as 1:1; with 50 ohm they load their node, with 1 Mohm they do not. Serial modes, single lines and
fields of television are waited for in vain.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

from vcfbench.sim.instruments.dso7104b.accessories import ACCESSORY_COMMANDS
from vcfbench.sim.instruments.dso7104b.acquisition import Acquisition, Arming, CapturedRecord, Pace, acquisition
from vcfbench.sim.instruments.dso7104b.commands import INVALID
from vcfbench.sim.instruments.dso7104b.conditions import NeverMet
from vcfbench.sim.instruments.dso7104b.coupling import Coupling
from vcfbench.sim.instruments.dso7104b.function import FUNCTION_COMMANDS, math_trace
from vcfbench.sim.instruments.dso7104b.inputs import ChannelView, ScopeWorld, Screen, Signals
from vcfbench.sim.instruments.dso7104b.kinds import KIND_7000B, ScopeKind
from vcfbench.sim.instruments.dso7104b.measurements import MeasuredTrace, Thresholds
from vcfbench.sim.instruments.dso7104b.measuring import MEASURE_COMMANDS, Installed
from vcfbench.sim.instruments.dso7104b.record import AcquiredRecord, Record, ScopeErrors
from vcfbench.sim.instruments.dso7104b.settings import CHANNELS, default_setup
from vcfbench.sim.instruments.dso7104b.system import ROOT_COMMANDS, SYSTEM_COMMANDS
from vcfbench.sim.instruments.dso7104b.termination import Terminations
from vcfbench.sim.instruments.dso7104b.timing import TIMING_COMMANDS
from vcfbench.sim.instruments.dso7104b.trigger import Trigger
from vcfbench.sim.instruments.dso7104b.triggering import TRIGGER_COMMANDS, comparator_of, trigger_of
from vcfbench.sim.instruments.dso7104b.vertical import VERTICAL_COMMANDS
from vcfbench.sim.instruments.dso7104b.waveform import WAVEFORM_COMMANDS
from vcfbench.sim.scpi import (
    COMMON_COMMANDS,
    GPIB,
    LAN,
    USB,
    CommandTable,
    Dialect,
    Limits,
    Parts,
    Pending,
    Register,
    ScpiEngine,
    ScpiError,
    ScpiTwin,
    Status,
    block_header,
    real,
)
from vcfbench.sim.scpi.parameters import Violation

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from vcfbench.sim.trace import Piece

__all__ = ["TABLE", "Dso7104BTwin", "ScopeErrors", "ScopeWorld"]

_RUN_BIT, _WAIT_BIT = 8, 32
_MASK_TEST, _OVERLOAD, _HARDWARE = 9, 11, 12
"""Bits of the operation status that other registers feed (status chapter of the 6000 and 3000T guides)."""
_SCREEN_POINTS = 1000
_PATIENCE_S = 0.1


def _clip_plainly(value: float, limits: Limits, word: str) -> Violation:
    """Clip to the nearest legal value and queue a plain -222."""
    del word
    return Violation(limits.maximum if value > limits.maximum else limits.minimum, ScpiError(-222))


TABLE = CommandTable(
    *COMMON_COMMANDS,
    *ROOT_COMMANDS,
    *VERTICAL_COMMANDS,
    *TIMING_COMMANDS,
    *TRIGGER_COMMANDS,
    *MEASURE_COMMANDS,
    *WAVEFORM_COMMANDS,
    *FUNCTION_COMMANDS,
    *SYSTEM_COMMANDS,
    *ACCESSORY_COMMANDS,
)
"""Every command of the model."""


class Dso7104BTwin(ScpiTwin):
    """The oscilloscope. `channels` says which node each input sees; `interface` is usb, gpib or lan.

    `model` is what it calls itself, where it stands for an oscilloscope that speaks the same words.
    """

    errors_class: ClassVar = ScopeErrors
    kind: ClassVar[ScopeKind] = KIND_7000B
    table: ClassVar[CommandTable] = TABLE

    def __init__(
        self,
        world: ScopeWorld,
        channels: Mapping[int, str],
        errors: ScopeErrors,
        interface: str = "usb",
        model: str | None = None,
    ) -> None:
        self._model = model or self.kind.name
        self._world = world
        self._nodes = dict(channels)
        self._errors = errors
        self.exponent_digits = errors.exponent_digits
        self.nr3: Callable[[float], str] = real(self.kind.decimals, errors.exponent_digits)
        self.state: dict[str, Any] = default_setup()
        self.inputs = Terminations(world, self._nodes, self._trip)
        self._stored: dict[int, dict[str, Any]] = {}
        self.operation: Register = Register()
        self.triggered: Register = Register()
        self.triggered.enable = 1
        self.overload: Register = Register(self.operation, _OVERLOAD)
        self.mask_test: Register = Register(self.operation, _MASK_TEST)
        self.hardware: Register = Register(self.operation, _HARDWARE)
        self.message = ""
        self.calibration_label = ""
        self.installed: list[Installed] = []
        self.analysed = False
        self.date = (2026, 1, 1)
        self.time = (12, 0, 0)
        self._armed_event = False
        self._run_state = "run"
        self._acquisition: Acquisition | None = None
        self._coupling = Coupling(world, self._nodes)
        self._last_trigger_s = -math.inf
        self._records: list[Record] = []
        self._segmented = False
        self._sent: tuple[Record, tuple[Any, ...], Parts] | None = None
        self._number = 0
        self._traces: dict[tuple[int, str], MeasuredTrace] = {}
        self.engine = ScpiEngine(
            self,
            self.table,
            world.clock,
            dialect=Dialect(queue_depth=30, out_of_range=_clip_plainly, input_limit=1 << 24),
            interface={"usb": USB, "gpib": GPIB, "lan": LAN}[interface],
            status=Status({7: self.operation, 0: self.triggered}, (self.overload, self.mask_test, self.hardware)),
        )
        self.run()

    # --- the instrument ---------------------------------------------------------------------------------------------

    def identity(self) -> str:
        """Return the reply of a real unit, but for the model that it stands for."""
        return self.kind.identity.format(self._model)

    def reset(self) -> None:
        """Take the default setup, running."""
        self.restore(default_setup())
        self.installed.clear()
        self._keep([])
        self.run()

    def restore(self, state: dict[str, Any]) -> None:
        """Take a whole setup."""
        self.state = dict(state)
        for channel in CHANNELS:
            self.inputs.terminate(channel, fifty=self.state[f"CHAN{channel}:IMP"] == "FIFT")
        self._traces.clear()
        if self._run_state == "run":
            self._disarm()

    def write(self, data: bytes, *, end: bool = False) -> None:
        """Take bytes from the controller; the protection of 50 ohm inputs looks whenever there is something to do."""
        super().write(data, end=end)
        self.inputs.watch()
        self._coupling.watch(self.state)

    def abort(self) -> None:
        """Device clear ends an acquisition that waits."""
        self._disarm()
        if self._run_state == "single":
            self._run_state = "stop"
        self._show_state()

    def service(self) -> None:
        """Look for the trigger when there is something to look at."""
        self.inputs.judge()
        armed = self._acquisition
        if armed is None or self._world.clock.now() < armed.due_s:
            return
        found = armed.step()
        if found is not None:
            self._finish(armed, found)

    def next_event_s(self) -> float | None:
        """Return when the armed acquisition wants to look again, or the protection has seen enough."""
        armed_s = None if self._acquisition is None else self._acquisition.due_s
        judged_s = self.inputs.due_s
        if armed_s is None or judged_s is None:
            return judged_s if armed_s is None else armed_s
        return min(armed_s, judged_s)

    def _trip(self, channel: int) -> None:
        """A 50 ohm input got too much: it becomes 1 Mohm until the protection is cleared."""
        self.state[f"CHAN{channel}:IMP"], self.state[f"CHAN{channel}:PROT"] = "ONEM", "TRIP"
        self.inputs.terminate(channel, fifty=False)
        self.overload.latch(1 << (channel - 1))

    # --- run control --------------------------------------------------------------------------------------------------

    @property
    def running(self) -> bool:
        """Whether it acquires again and again."""
        return self._run_state == "run"

    def run(self) -> None:
        """Run; from outside that looks like a record taken whenever somebody asks for one."""
        self._run_state = "run"
        self._disarm()
        self._show_state()

    def run_now(self) -> None:
        """:RUN: the first trigger is looked for at once, so that :TER? can tell of it."""
        self.run()
        self._arm()

    def stop(self) -> None:
        """:STOP; coming from a run, the record on the screen is one that starts now."""
        was_running, self._run_state = self.running, "stop"
        self._disarm()
        if was_running:
            self._arm()
        self._show_state()

    def single(self) -> None:
        """:SINGle: arm once and return."""
        self._run_state = "single"
        self._keep([])
        self._arm()

    def digitize(self, *sources: str) -> Pending:
        """:DIGitize: arm once, keep the parser busy until the record is there, stop."""
        if sources:
            for source in (*(f"CHAN{channel}" for channel in CHANNELS), "FUNC"):
                self.state[f"{source}:DISP"] = source in sources
        self.single()
        return Pending(lambda: self._idle_since(math.inf), lambda: None)

    def look(self, finish: Callable[[], Any]) -> Any:
        """Return `finish()` on the record; while running that is a fresh one, which takes its time.

        Without a trigger (NORMal sweep) it is on what the screen shows after a moment: nothing.
        """
        if self.running and self._acquisition is None:
            self._arm()
        if self._acquisition is None or self._run_state == "single":
            return finish()
        patience = math.inf
        if self.state["TRIG:SWE"] != "AUTO":
            patience = self._world.clock.now() + 3.0 * self.state["TIM:RANG"] + _PATIENCE_S
        return Pending(lambda: self._idle_since(patience), finish)

    def force(self) -> None:
        """:TRIGger:FORCe."""
        if self._acquisition is not None:
            self._acquisition.force()

    def armed(self) -> bool:
        """:AER?: tell whether the trigger was armed since the last time, and forget."""
        armed, self._armed_event = self._armed_event, False
        return armed

    def was_triggered(self) -> int:
        """:TER?: tell whether there was a trigger since the last time, and forget; a run then looks for the next."""
        triggered = self.triggered.read_event()
        if self.running and self._acquisition is None:
            self._arm()
        return triggered

    def _idle_since(self, patience_s: float) -> float | None:
        if self._acquisition is None:
            return -math.inf
        return None if math.isinf(patience_s) else patience_s

    def _disarm(self) -> None:
        if self._acquisition is not None:
            self._acquisition.close()
            self._acquisition = None

    def _arm(self) -> None:
        self._disarm()
        self._armed_event = True
        self._traces.clear()
        trigger, views = trigger_of(self.state), self._views()
        past = self._past_of(views, trigger)
        self._acquisition = acquisition(self._world, Arming(self.screen(), views, trigger, self._pace(), past))
        self._show_state()

    def _pace(self) -> Pace:
        state = self.state
        segmented = state["ACQ:MODE"] == "SEGM"
        return Pace(
            auto=state["TRIG:SWE"] == "AUTO",
            repeats=state["ACQ:COUN"] if state["ACQ:TYPE"] == "AVER" and not segmented else 1,
            segments=state["SEGM:COUN"] if segmented else 0,
            holdoff_s=state["TRIG:HOLD"],
            not_before_s=self._last_trigger_s + state["TRIG:HOLD"],
            smooth=state["ACQ:TYPE"] == "HRES",
        )

    def _finish(self, armed: Acquisition, found: CapturedRecord) -> None:
        self._segmented = self.state["ACQ:MODE"] == "SEGM"
        self._keep([self._recorded(armed, found, trigger_s) for trigger_s in found.triggers_s])
        self._last_trigger_s = found.triggers_s[-1]
        self._acquisition = None
        if self._run_state == "single":
            self._run_state = "stop"
        self.triggered.latch(1)
        self._show_state()

    def _recorded(self, armed: Acquisition, found: CapturedRecord, trigger_s: float) -> Record:
        kind = self.state["ACQ:TYPE"]
        self._number += 1
        averages = self.state["ACQ:COUN"] if kind == "AVER" and not self._segmented else 1
        bits = self._errors.converter_bits
        if bits and kind in {"AVER", "HRES"}:
            bits = 12  # averaging gains up to four bits (data sheet)
        kept = AcquiredRecord(self._number, kind, bits, averages, self.sample_rate())
        return Record(found.signals, trigger_s, armed.screen, self._errors, kept)

    def _keep(self, records: list[Record]) -> None:
        """Show these records, the first of them, and forget all others."""
        self._records = records
        self.state["SEGM:IND"] = 1
        self.analysed = False
        self._sent = None
        self._traces.clear()

    def _show_state(self) -> None:
        running = _RUN_BIT if self._run_state != "stop" else 0
        waiting = _WAIT_BIT if self._acquisition is not None and running else 0
        self.operation.set_bits(_RUN_BIT | _WAIT_BIT, running | waiting)

    # --- settings -> acquisition ------------------------------------------------------------------------------------

    def screen(self) -> Screen:
        """Return the main window."""
        span, position = self.state["TIM:RANG"], self.state["TIM:POS"]
        share = {"LEFT": 0.1, "CENT": 0.5, "RIGH": 0.9}[self.state["TIM:REF"]]
        return Screen(position - share * span, span)

    def _views(self) -> dict[int, ChannelView]:
        return {channel: self._view(channel) for channel in CHANNELS}

    def _view(self, channel: int) -> ChannelView:
        def of(key: str) -> Any:
            return self.state[f"CHAN{channel}:{key}"]

        return ChannelView(
            self._nodes.get(channel),
            of("RANG"),
            of("OFFS"),
            of("PROB"),
            of("INV"),
            ac=of("COUP") == "AC",
            skew_s=of("SKEW"),
            limit_hz=self.kind.limit_hz if of("BWL") else math.inf,
        )

    def _past_of(self, views: Mapping[int, ChannelView], trigger: Trigger) -> Callable[[], dict[int, list[Piece]]]:
        """Return what tells the past of the inputs that are seen through a blocking capacitor."""
        self._coupling.watch(self.state)
        coupled = {channel for channel, view in views.items() if view.ac}
        coupled |= {channel for channel, comparator in trigger.comparators.items() if comparator.ac}
        return partial(self._coupling.past, coupled)

    def memory(self) -> int:
        """Return the points in memory; with both channels of a pair (1, 2 and 3, 4) there are fewer.

        Segments share it.
        """
        half = self._both_of_a_pair()
        most, rate = self.kind.memory[half], self.kind.rate_hz[half]
        if self.state["ACQ:MODE"] == "SEGM":
            most //= self.state["SEGM:COUN"]
        return int(max(100, min(most, self.state["TIM:RANG"] * rate)))

    def _both_of_a_pair(self) -> bool:
        shown = {channel for channel in CHANNELS if self.state[f"CHAN{channel}:DISP"]}
        return {1, 2} <= shown or {3, 4} <= shown

    def sample_rate(self) -> float:
        """Return the sample rate, 1/s: what fills the memory, but no more than the converters give."""
        return min(self.memory() / float(self.state["TIM:RANG"]), self.kind.rate_hz[self._both_of_a_pair()])

    def count(self, channel: int) -> Pending:
        """:MEASure:COUNter?: count a channel's edges from now on, whatever the acquisition does."""
        from vcfbench.sim.instruments.dso7104b.counter import counted_hz, five_digits, gate_s  # noqa: PLC0415

        now, views = self._world.clock.now(), self._views()
        start_s = now + views[channel].remembered_s
        stop_s = start_s + gate_s(self.state["TIM:RANG"])
        capture = self._world.capture(now, stop_s + views[channel].remembered_s)
        comparator = comparator_of(self.state, f"CHAN{channel}")
        signals = Signals(capture, views, self._past_of(views, Trigger({channel: comparator}, NeverMet))())

        def finish() -> str:
            hertz = counted_hz(signals, channel, comparator, start_s, stop_s)
            return self.nr3(INVALID if hertz is None else five_digits(hertz / (1.0 + self._errors.time_base_error)))

        return Pending.at(stop_s + views[channel].remembered_s, finish)

    def autoscale(self) -> Pending:
        """:AUToscale: look at every input for a while, then set it up."""
        from vcfbench.sim.instruments.dso7104b.autoscale import LOOK_S, fit  # noqa: PLC0415  # few ask for it

        now = self._world.clock.now()
        capture = self._world.capture(now, now + LOOK_S)

        def finish() -> None:
            fit(self.state, self._nodes, capture, now)
            self.run()

        return Pending.at(now + LOOK_S, finish)

    # --- the record ---------------------------------------------------------------------------------------------------

    @property
    def record(self) -> Record:
        """The record on the screen, of the chosen segment; -230 if there is none."""
        if not self._records:
            raise ScpiError(-230, "Data corrupt or stale")
        index: int = self.state["SEGM:IND"]
        return self._records[min(index, len(self._records)) - 1]

    def records(self) -> list[Record]:
        """Return the records of all segments."""
        return self._records

    def segments(self) -> int:
        """Return how many segments were acquired; 0 of an acquisition that was not segmented."""
        return len(self._records) if self._segmented else 0

    def time_tag_s(self) -> float:
        """Return the trigger of the chosen segment after that of the first, s."""
        if not self.segments():
            return 0.0
        elapsed_s = self.record.trigger_s - self._records[0].trigger_s
        return elapsed_s * (1.0 + self._errors.time_base_error)

    def measured(self, source: str, record: Record | None = None) -> MeasuredTrace:
        """Return the trace of `source` for measurements; -230 where it is not shown."""
        if not self.state[f"{source}:DISP"]:
            raise ScpiError(-230)
        return self.trace(source, record)

    def trace(self, source: str, record: Record | None = None) -> MeasuredTrace:
        """Return what was acquired of `source`, shown or not."""
        shown = record or self.record
        found = self._traces.get((shown.number, source))
        if found is None:
            found = self._traces[shown.number, source] = self._trace(source, shown)
        return found

    def _trace(self, source: str, record: Record) -> MeasuredTrace:
        if source == "FUNC":
            math_ = math_trace(self.state, record, _SCREEN_POINTS)
            return MeasuredTrace(math_.places(), math_.values, clipped=math_.clipped, thresholds=self._thresholds())
        channel = int(source[4:])
        points = record.measured_points(channel, _SCREEN_POINTS)
        digitised = record.digitised(channel, points)
        times = record.screen.times_s(points)
        if record.kept.kind != "PEAK":
            return MeasuredTrace(times, digitised.volts, clipped=digitised.clipped, thresholds=self._thresholds())
        peaks = record.extremes(channel, points)
        return MeasuredTrace(
            times, digitised.volts, clipped=peaks.clipped, thresholds=self._thresholds(), peaks=peaks.volts
        )

    def _thresholds(self) -> Thresholds:
        kind, upper, middle, lower = self.state["MEAS:THR"]
        return Thresholds() if kind == "STAN" else Thresholds(upper, middle, lower, absolute=kind == "ABS")

    def forget_traces(self) -> None:
        """Measure anew: the definitions have changed."""
        self._traces.clear()

    def sent(self, asked: tuple[Any, ...], parts: Iterator[bytes]) -> Any:
        """Return the record as :WAVeform:DATA? sends it, a block of `parts`, or what it was the last time."""
        kept = self._sent
        if kept is not None and kept[0] is self.record and kept[1] == asked:
            return kept[2]
        record, made = self.record, list[bytes]()

        def make() -> Iterator[None]:
            for part in parts:
                made.append(part)
                yield

        def keep() -> Parts:
            self._sent = (record, asked, Parts((block_header(sum(map(len, made)), 8), *made)))
            return self._sent[2]

        return Pending.worked_out(make(), keep)

    # --- setups -------------------------------------------------------------------------------------------------------

    def save(self, place: int) -> None:
        """*SAV."""
        self._stored[place] = dict(self.state)

    def recall(self, place: int) -> None:
        """*RCL; an empty place gives the default setup (unverified)."""
        self.restore(self._stored.get(place, default_setup()))
