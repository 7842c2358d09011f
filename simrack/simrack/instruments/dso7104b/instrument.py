"""A simulated Agilent InfiniiVision DSO7104B, four channels, whose inputs are wired to nodes of the PCB.

The 7000B programmer's guide was not at hand; facts come from its quotations in public drivers, pages of the guides of
the 5000, 6000 and 3000T series, the 7000B user's guide, live traces of the 6000 series and the service guide.
Unverified, among others: three-digit exponents (seen on the 6000 series, same code base), number and words of most
refusals, limits of offset and time base, default of the waveform format, and what :SINGle;*OPC? waits for.
Measurements and the math trace are computed from the record on the screen.

Here it is run, armed and stopped. What settings mean is made of them alone: how the inputs are sampled
(:mod:`.sampling`), the trigger (:mod:`.trigger_settings`), the math function (:mod:`.math_settings`). What was acquired
is shown by :mod:`.showing`. The commands, in the modules above this one whose names end so, act on it;
:mod:`.commands` lists them.

Inputs are taken as 1:1; with 50 ohm they load their node, with 1 Mohm they do not. Single lines and fields of
television never trigger.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Mapping
from copy import deepcopy
from functools import partial
from typing import Any, ClassVar

from simrack import scpi
from simrack.instruments.dso7104b.acquisition import Acquisition, Arming, CapturedRecord, acquisition
from simrack.instruments.dso7104b.conditions import NeverMet
from simrack.instruments.dso7104b.coupling import Coupling
from simrack.instruments.dso7104b.inputs import ChannelView, ScopeWorld, Signals
from simrack.instruments.dso7104b.installed import INVALID, Installed
from simrack.instruments.dso7104b.kinds import KIND_7000B, ScopeKind
from simrack.instruments.dso7104b.record import AcquiredRecord, Record, ScopeErrors
from simrack.instruments.dso7104b.sampling import channel_view, main_window, pace_of, sample_rate_hz
from simrack.instruments.dso7104b.settings import CHANNELS, ScopeSettings
from simrack.instruments.dso7104b.showing import ShownRecords
from simrack.instruments.dso7104b.termination import Terminations
from simrack.instruments.dso7104b.trigger import Trigger
from simrack.instruments.dso7104b.trigger_settings import comparator_of, trigger_of
from simrack.scpi.parameters import Violation
from simrack.trace import Piece

_RUN_BIT, _WAIT_BIT = 8, 32
_OVERLOAD, _HARDWARE = 11, 12
"""Bits of the operation status that other registers feed (status chapter of the 6000 and 3000T guides)."""
_PATIENCE_S = 0.1


def _clip_plainly(value: float, limits: scpi.Limits, word: str) -> Violation:
    """Clip to the nearest legal value and queue a plain -222."""
    del word
    return Violation(limits.maximum if value > limits.maximum else limits.minimum, scpi.ScpiError(-222))


class SimulatedDso7104B(scpi.ScpiTwin):
    """The oscilloscope. `channels` says which node each input sees; `interface` is usb, gpib or lan.

    `model` is what it calls itself, where it stands for an oscilloscope that speaks the same words.
    """

    errors_class: ClassVar = ScopeErrors
    kind: ClassVar[ScopeKind] = KIND_7000B
    table: ClassVar[scpi.CommandTable]

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
        self.nr3: Callable[[float], str] = scpi.real(self.kind.decimals, errors.exponent_digits)
        self.state = ScopeSettings()
        self.inputs = Terminations(world, self._nodes, self._trip)
        self._stored: dict[int, ScopeSettings] = {}
        self.operation: scpi.Register = scpi.Register()
        self.triggered: scpi.Register = scpi.Register()
        self.triggered.enable = 1
        self.overload: scpi.Register = scpi.Register(self.operation, _OVERLOAD)
        self.hardware: scpi.Register = scpi.Register(self.operation, _HARDWARE)
        self.message = ""
        self.calibration_label = ""
        self.installed: list[Installed] = []
        self.shown = ShownRecords(self.state, errors.time_base_error)
        self.date = (2026, 1, 1)
        self.time = (12, 0, 0)
        self._armed_event = False
        self._run_state = "run"
        self._acquisition: Acquisition | None = None
        self._searching = False
        """Whether its trigger is being looked for."""
        self._coupling = Coupling(world, self._nodes)
        self._last_trigger_s = -math.inf
        self._number = 0
        self.engine = scpi.ScpiEngine(
            self,
            self.table,
            world.clock,
            dialect=scpi.Dialect(queue_depth=30, out_of_range=_clip_plainly, input_limit=1 << 24),
            interface={"usb": scpi.USB, "gpib": scpi.GPIB, "lan": scpi.LAN}[interface],
            status=scpi.Status({7: self.operation, 0: self.triggered}, (self.overload, self.hardware)),
        )
        self.run()

    # --- the instrument ---------------------------------------------------------------------------------------------

    def identity(self) -> str:
        """Return the reply of a real unit, but for the model that it stands for."""
        return self.kind.identity.format(self._model)

    def reset(self) -> None:
        """Take the default setup, running."""
        self.restore(ScopeSettings())
        self.installed.clear()
        self.shown.show([])
        self.run()

    def restore(self, state: ScopeSettings) -> None:
        """Take a whole setup."""
        self.state.take(state)
        for channel in CHANNELS:
            self.inputs.terminate(channel, fifty=self.state.channel[channel].impedance == "FIFT")
        self.shown.forget_traces()
        if self._run_state == "run":
            self._disarm()

    def write(self, data: bytes, *, end: bool = False) -> None:
        """Take bytes from the controller; the protection of 50 ohm inputs looks whenever there is something to do."""
        self.engine.write(data, end=end)
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
        if self.inputs.due_s is not None:
            self.inputs.judge()
        armed = self._acquisition
        if armed is not None and not self._searching and self._world.clock.now() >= armed.due_s:
            self._searching = True
            self.engine.work_out(self._search(armed))

    def _search(self, armed: Acquisition) -> Iterator[None]:
        """Look for the trigger of an acquisition, slice by slice, and show the record if it is complete."""
        found = yield from armed.step()
        if self._acquisition is not armed:  # it has been given up meanwhile
            return
        self._searching = False
        if found is not None:
            segmented = self.state.acquire.mode == "SEGM"
            records = [self._recorded(armed, found, trigger_s, segmented=segmented) for trigger_s in found.triggers_s]
            self.shown.show(records, segmented=segmented)
            self._last_trigger_s = found.triggers_s[-1]
            self._acquisition = None
            if self._run_state == "single":
                self._run_state = "stop"
            self.triggered.latch(1)
            self._show_state()

    def next_event_s(self) -> float | None:
        """Return the next instant at which the armed acquisition or the input protection acts."""
        armed_s = None if self._acquisition is None or self._searching else self._acquisition.due_s
        judged_s = self.inputs.due_s
        if armed_s is None or judged_s is None:
            return judged_s if armed_s is None else armed_s
        return min(armed_s, judged_s)

    def _trip(self, channel: int) -> None:
        """A 50 ohm input got too much: it becomes 1 Mohm until the protection is cleared."""
        self.state.channel[channel].impedance, self.state.channel[channel].protection = "ONEM", "TRIP"
        self.inputs.terminate(channel, fifty=False)
        self.overload.latch(1 << (channel - 1))

    # --- run control --------------------------------------------------------------------------------------------------

    @property
    def running(self) -> bool:
        """True if it acquires again and again."""
        return self._run_state == "run"

    def run(self) -> None:
        """Run: each query for data takes a record."""
        self._run_state = "run"
        self._disarm()
        self._show_state()

    def run_now(self) -> None:
        """:RUN: search for the first trigger at once, so that :TER? can report it."""
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
        self.shown.show([])
        self._arm()

    def digitize(self, *sources: str) -> scpi.Pending:
        """:DIGitize: arm once, keep the parser busy until the record is there, stop."""
        if sources:
            for source in (*(f"CHAN{channel}" for channel in CHANNELS), "FUNC"):
                self.state.show(source, source in sources)
        self.single()
        return scpi.Pending(lambda: self._idle_since(math.inf), lambda: None)

    def look(self, finish: Callable[[], Any]) -> Any:
        """Return `finish()` on the record; while running that is a fresh one, which takes its time.

        Without a trigger (NORMal sweep) it is on what the screen shows after a moment: nothing.
        """
        if self.running and self._acquisition is None:
            self._arm()
        if self._acquisition is None or self._run_state == "single":
            return finish()
        patience = math.inf
        if self.state.trigger.sweep != "AUTO":
            patience = self._world.clock.now() + 3.0 * self.state.timebase.range_s + _PATIENCE_S
        return scpi.Pending(lambda: self._idle_since(patience), finish)

    def force(self) -> None:
        """:TRIGger:FORCe."""
        if self._acquisition is not None:
            self._acquisition.force()

    def armed(self) -> bool:
        """:AER?: return True if the trigger was armed since the last time, and forget."""
        armed, self._armed_event = self._armed_event, False
        return armed

    def was_triggered(self) -> int:
        """:TER?: return True if there was a trigger since the last time, and forget; a run then looks for the next."""
        triggered = self.triggered.read_event()
        if self.running and self._acquisition is None:
            self._arm()
        return triggered

    def _idle_since(self, patience_s: float) -> float | None:
        if self._acquisition is None:
            return -math.inf
        return None if math.isinf(patience_s) or self._searching else patience_s

    def _disarm(self) -> None:
        self._searching = False
        if self._acquisition is not None:
            self._acquisition.close()
            self._acquisition = None

    def _arm(self) -> None:
        self._disarm()
        self._armed_event = True
        self.shown.forget_traces()
        trigger, views = trigger_of(self.state), self._views()
        past, pace = self._past_of(views, trigger), pace_of(self.state, self._last_trigger_s)
        self._acquisition = acquisition(self._world, Arming(main_window(self.state), views, trigger, pace, past))
        self._show_state()

    def _recorded(self, armed: Acquisition, found: CapturedRecord, trigger_s: float, *, segmented: bool) -> Record:
        kind = self.state.acquire.type
        self._number += 1
        averages = self.state.acquire.count if kind == "AVER" and not segmented else 1
        bits = self._errors.converter_bits
        if bits and kind in {"AVER", "HRES"}:
            bits = 12  # averaging gains up to four bits (data sheet)
        kept = AcquiredRecord(self._number, kind, bits, averages, sample_rate_hz(self.state, self.kind))
        return Record(found.signals, trigger_s, armed.screen, self._errors, kept)

    def _show_state(self) -> None:
        running = _RUN_BIT if self._run_state != "stop" else 0
        waiting = _WAIT_BIT if self._acquisition is not None and running else 0
        self.operation.set_bits(_RUN_BIT | _WAIT_BIT, running | waiting)

    # --- settings -> acquisition ------------------------------------------------------------------------------------

    def _views(self) -> dict[int, ChannelView]:
        limit_hz = self.kind.limit_hz
        return {each: channel_view(self.state, each, self._nodes.get(each), limit_hz) for each in CHANNELS}

    def _past_of(self, views: Mapping[int, ChannelView], trigger: Trigger) -> Callable[[], dict[int, list[Piece]]]:
        """Return the function that tells the past of inputs seen through a blocking capacitor."""
        self._coupling.watch(self.state)
        coupled = {channel for channel, view in views.items() if view.ac}
        coupled |= {channel for channel, comparator in trigger.comparators.items() if comparator.ac}
        return partial(self._coupling.past, coupled)

    def count(self, channel: int) -> scpi.Pending:
        """:MEASure:COUNter?: count a channel's edges from now on, independent of the acquisition."""
        from simrack.instruments.dso7104b.counter import counted_hz, five_digits, gate_s  # noqa: PLC0415

        now, views = self._world.clock.now(), self._views()
        start_s = now + views[channel].remembered_s
        stop_s = start_s + gate_s(self.state.timebase.range_s)
        capture = self._world.capture(now, stop_s + views[channel].remembered_s)
        comparator = comparator_of(self.state, f"CHAN{channel}")
        signals = Signals(capture, views, self._past_of(views, Trigger({channel: comparator}, NeverMet))())

        def count() -> Generator[None, None, str]:
            hertz = yield from counted_hz(signals, channel, comparator, start_s, stop_s)
            return self.nr3(INVALID if hertz is None else five_digits(hertz / (1.0 + self._errors.time_base_error)))

        return scpi.Pending.at(stop_s + views[channel].remembered_s, lambda: scpi.Pending.worked_out(count()))

    def autoscale(self) -> scpi.Pending:
        """:AUToscale: look at every input for a while, then set it up."""
        from simrack.instruments.dso7104b.autoscale import LOOK_S, fitting  # noqa: PLC0415  # few ask for it

        now = self._world.clock.now()
        capture = self._world.capture(now, now + LOOK_S)

        def fit() -> Generator[None, None, None]:
            yield from fitting(self.state, self._nodes, capture, now)
            self.run()

        return scpi.Pending.at(now + LOOK_S, lambda: scpi.Pending.worked_out(fit()))

    # --- setups -------------------------------------------------------------------------------------------------------

    def save(self, place: int) -> None:
        """*SAV."""
        self._stored[place] = deepcopy(self.state)

    def recall(self, place: int) -> None:
        """*RCL; an empty place gives the default setup (unverified)."""
        self.restore(self._stored.get(place) or ScopeSettings())
