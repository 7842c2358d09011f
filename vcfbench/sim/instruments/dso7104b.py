"""A simulated Agilent InfiniiVision DSO7104B, four channels, whose inputs are wired to nodes of the PCB.

The 7000B programmer's guide was not at hand; facts come from its quotations in public drivers, the 3000T guide, live
traces of the 6000 series and the service guide. Unverified, among others: three-digit exponents (seen on the 6000
series, same code base), number and words of most refusals, limits of offset and time base, default of the waveform
format, and what :SINGle;*OPC? waits for. Measurements are computed from the record on the screen.

Inputs are taken as 1:1 and without loading of the node; FIFTy changes the reply only. Trigger modes other than EDGE
and GLITch can be set and read, and trigger like EDGE; a pulse must outlast a 4000th of the search to be seen.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from vcfbench.sim.instruments.dso_acquisition import (
    Acquisition,
    ChannelView,
    EdgeTrigger,
    Record,
    ScopeErrors,
    ScopeWorld,
    Screen,
)
from vcfbench.sim.instruments.dso_measurements import Thresholds, Trace
from vcfbench.sim.instruments.dso_screen import screenshot
from vcfbench.sim.scpi import (
    COMMON_COMMANDS,
    GPIB,
    LAN,
    USB,
    Block,
    Boolean,
    Choice,
    Command,
    CommandTable,
    Dialect,
    Integer,
    Limits,
    Number,
    Parameter,
    Pending,
    Register,
    ScpiEngine,
    ScpiError,
    ScpiInstrument,
    Status,
    Text,
    block,
    boolean,
    comma_list,
    quoted,
    real,
    signed_integer,
)
from vcfbench.sim.scpi.lexer import Kind, Token
from vcfbench.sim.scpi.parameters import Violation

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from numpy.typing import NDArray

__all__ = ["Dso7104B", "ScopeErrors", "ScopeWorld"]

CHANNELS = (1, 2, 3, 4)
INVALID = 9.9e37
_RUN_BIT, _WAIT_BIT = 8, 32
_SCREEN_POINTS = 1000
_CODES = {"BYTE": 256, "WORD": 65536, "ASC": 65536}
_WAVEFORM = ("WAV:SOUR", "WAV:FORM", "WAV:UNS", "WAV:BYT", "ACQ:TYPE")
"""What :WAVeform:DATA? sends of a record depends on these, and on the number of points."""
_ACQUISITION_TYPES = {"NORM": 0, "PEAK": 1, "AVER": 2, "HRES": 3}
_FORMATS = {"BYTE": 0, "WORD": 1, "ASC": 4}
_AUTOSCALE_S = 0.1
_PATIENCE_S = 0.1

_nr3 = real(8, 3)


def _clip_plainly(value: float, limits: Limits, word: str) -> Violation:
    """Clip to the nearest legal value and queue a plain -222."""
    del word
    return Violation(limits.maximum if value > limits.maximum else limits.minimum, ScpiError(-222))


def _channel_defaults(channel: int) -> dict[str, Any]:
    return {
        "RANG": 40.0,
        "OFFS": 0.0,
        "COUP": "DC",
        "IMP": "ONEM",
        "DISP": channel == 1,
        "BWL": False,
        "INV": False,
        "LAB": str(channel),
        "UNIT": "VOLT",
        "PROB": 1.0,
        "SKEW": 0.0,
        "STYP": "SING",
        "VERN": False,
        "PROT": "NORM",
    }


def _defaults() -> dict[str, Any]:
    state: dict[str, Any] = {
        "TIM:MODE": "MAIN",
        "TIM:RANG": 1e-3,
        "TIM:POS": 0.0,
        "TIM:REF": "CENT",
        "TIM:VERN": False,
        "WIND:POS": 0.0,
        "WIND:RANG": 1e-4,
        "ACQ:TYPE": "NORM",
        "ACQ:MODE": "RTIM",
        "ACQ:COUN": 8,
        "ACQ:COMP": 100,
        "TRIG:MODE": "EDGE",
        "TRIG:SWE": "AUTO",
        "TRIG:SOUR": "CHAN1",
        "TRIG:LEV": 0.0,
        "TRIG:SLOP": "POS",
        "TRIG:COUP": "DC",
        "TRIG:REJ": "OFF",
        "TRIG:HFR": False,
        "TRIG:NREJ": False,
        "TRIG:HOLD": 60e-9,
        "GLIT:SOUR": "CHAN1",
        "GLIT:LEV": 0.0,
        "GLIT:QUAL": "LESS",
        "GLIT:POL": "POS",
        "GLIT:LESS": 30e-9,
        "GLIT:RANG": (30e-9, 10e-9),
        "GLIT:GRE": 20e-9,
        "MEAS:SOUR": ("CHAN1", "CHAN2"),
        "MEAS:THR": ("STAN", 90.0, 50.0, 10.0),
        "MEAS:DEL": (1, 1),
        "MEAS:STAT": "ON",
        "MEAS:SHOW": False,
        "WAV:SOUR": "CHAN1",
        "WAV:FORM": "BYTE",
        "WAV:UNS": True,
        "WAV:BYT": "MSBF",
        "WAV:POIN": 1000,
        "WAV:MODE": "NORM",
        "WAV:VIEW": "MAIN",
        "AUT:CHAN": "ALL",
        "SEGM:COUN": 2,
        "SEGM:IND": 1,
        "TV:SOUR": "CHAN1",
        "TV:MODE": "ALIN",
        "TV:STAN": "NTSC",
        "TV:POL": "NEG",
        "TV:LINE": 1,
        "DISP:VECT": True,
        "DISP:LAB": False,
        "DISP:PERS": "MIN",
        "HARD:INKS": True,
        "SYST:LOCK": False,
        "SYST:PROT": False,
    }
    for channel in CHANNELS:
        state |= {f"CHAN{channel}:{key}": value for key, value in _channel_defaults(channel).items()}
    return state


class Dso7104B(ScpiInstrument):
    """The oscilloscope. `channels` says which node each input sees; `interface` is usb, gpib or lan."""

    def __init__(
        self, world: ScopeWorld, channels: Mapping[int, str], errors: ScopeErrors, interface: str = "usb"
    ) -> None:
        self._world = world
        self._nodes = dict(channels)
        self._errors = errors
        self.state: dict[str, Any] = _defaults()
        self._stored: dict[int, dict[str, Any]] = {}
        self.operation = Register()
        self.triggered = Register()
        self.triggered.enable = 1
        self.overload = Register()
        self.mask_test = Register()
        self.hardware = Register()
        self.message = ""
        self.installed: list[tuple[str, Callable[[], float]]] = []
        self.date = (2026, 1, 1)
        self.time = (12, 0, 0)
        self._armed_event = False
        self._run_state = "run"
        self._acquisition: Acquisition | None = None
        self._record: Record | None = None
        self._sent: tuple[Record, tuple[Any, ...], bytes] | None = None
        self._number = 0
        self._traces: dict[str, Trace] = {}
        self.engine = ScpiEngine(
            self,
            TABLE,
            world.clock,
            dialect=Dialect(queue_depth=30, out_of_range=_clip_plainly, input_limit=1 << 24),
            interface={"usb": USB, "gpib": GPIB, "lan": LAN}[interface],
            status=Status({7: self.operation, 0: self.triggered}),
        )
        self.run()

    # --- the instrument ---------------------------------------------------------------------------------------------

    def identity(self) -> str:
        """Return the reply of a real unit."""
        return "AGILENT TECHNOLOGIES,DSO7104B,MY49520121,06.00.0003"

    def reset(self) -> None:
        """Take the default setup, running."""
        self.restore(_defaults())
        self.installed.clear()
        self._record = None
        self.run()

    def restore(self, state: dict[str, Any]) -> None:
        """Take a whole setup."""
        self.state = dict(state)
        self._traces.clear()
        if self._run_state == "run":
            self._acquisition = None

    def abort(self) -> None:
        """Device clear ends an acquisition that waits."""
        self._acquisition = None
        if self._run_state == "single":
            self._run_state = "stop"
        self._show_state()

    def service(self) -> None:
        """Look for the trigger when there is something to look at."""
        acquisition = self._acquisition
        if acquisition is None or self._world.clock.now() < acquisition.due_s:
            return
        found = acquisition.step()
        if found is not None:
            self._finish(acquisition, *found)

    def next_event_s(self) -> float | None:
        """Return when the armed acquisition wants to look again."""
        return None if self._acquisition is None else self._acquisition.due_s

    # --- run control --------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """:RUN; from outside a continuous run looks like a record taken whenever somebody asks for one."""
        self._run_state = "run"
        self._acquisition = None
        self._show_state()

    def stop(self) -> None:
        """:STOP; coming from a run, the record on the screen is one that starts now."""
        was_running, self._run_state = self._run_state == "run", "stop"
        self._acquisition = None
        if was_running:
            self._arm()
        self._show_state()

    def single(self) -> None:
        """:SINGle: arm once and return."""
        self._run_state = "single"
        self._record = None
        self._arm()

    def digitize(self, *sources: str) -> Pending:
        """:DIGitize: arm once, keep the parser busy until the record is there, stop."""
        if sources:
            for channel in CHANNELS:
                self.state[f"CHAN{channel}:DISP"] = f"CHAN{channel}" in sources
        self.single()
        return Pending(lambda: self._idle_since(math.inf), lambda: None)

    def look(self, finish: Callable[[], Any]) -> Any:
        """Return `finish()` on the record; while running that is a fresh one, which takes its time.

        Without a trigger (NORMal sweep) it is on what the screen shows after a moment: nothing.
        """
        if self._run_state == "run" and self._acquisition is None:
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

    def _idle_since(self, patience_s: float) -> float | None:
        if self._acquisition is None:
            return -math.inf
        return None if math.isinf(patience_s) else patience_s

    def _arm(self) -> None:
        self._armed_event = True
        self._traces.clear()
        trigger = self._trigger()
        auto = self.state["TRIG:SWE"] == "AUTO"
        repeats = self.state["ACQ:COUN"] if self.state["ACQ:TYPE"] == "AVER" else 1
        self._acquisition = Acquisition(self._world, self.screen(), self._views(), trigger, auto=auto, repeats=repeats)
        self._show_state()

    def _finish(self, acquisition: Acquisition, capture: Any, trigger_s: float) -> None:
        kind = self.state["ACQ:TYPE"]
        self._number += 1
        averages = self.state["ACQ:COUN"] if kind == "AVER" else 16 if kind == "HRES" else 1
        bits = self._errors.converter_bits
        if bits and kind in {"AVER", "HRES"}:
            bits = 12  # averaging gains up to four bits (data sheet)
        self._record = Record(
            capture,
            trigger_s,
            acquisition.screen,
            acquisition.views,
            self._errors,
            number=self._number,
            bits=bits,
            averages=averages,
        )
        self._acquisition = None
        self._traces.clear()
        if self._run_state == "single":
            self._run_state = "stop"
        self.triggered.latch(1)
        self._show_state()

    def _show_state(self) -> None:
        running = _RUN_BIT if self._run_state != "stop" else 0
        waiting = _WAIT_BIT if self._acquisition is not None and running else 0
        self.operation.set_condition(running | waiting)

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
            self._nodes.get(channel), of("RANG"), of("OFFS"), of("PROB"), of("INV"), ac=of("COUP") == "AC"
        )

    def _trigger(self) -> EdgeTrigger:
        return self._glitch() if self.state["TRIG:MODE"] == "GLIT" else self._edge()

    def _glitch(self) -> EdgeTrigger:
        """Return the trigger on a pulse by its width, which is at its end."""
        state = self.state
        less, greater = state["GLIT:RANG"]
        widths = {
            "LESS": (0.0, state["GLIT:LESS"]),
            "GRE": (state["GLIT:GRE"], math.inf),
            "RANG": (greater, less),
        }
        source, positive = state["GLIT:SOUR"], state["GLIT:POL"] == "POS"
        channel = int(source[4:]) if source.startswith("CHAN") else None
        width_s = widths[state["GLIT:QUAL"]]
        return EdgeTrigger(channel, state["GLIT:LEV"], rising=not positive, falling=positive, ac=False, width_s=width_s)

    def _edge(self) -> EdgeTrigger:
        source, slope = self.state["TRIG:SOUR"], self.state["TRIG:SLOP"]
        channel = int(source[4:]) if source.startswith("CHAN") else None
        both = slope in {"EITH", "ALT"}
        return EdgeTrigger(
            channel,
            self.state["TRIG:LEV"],
            rising=both or slope == "POS",
            falling=both or slope == "NEG",
            ac=self.state["TRIG:COUP"] != "DC",
        )

    def memory(self) -> int:
        """Return the points in memory: 4 GSa/s and 8 Mpts with one channel a pair (1, 2 and 3, 4), else half."""
        shown = {channel for channel in CHANNELS if self.state[f"CHAN{channel}:DISP"]}
        half = {1, 2} <= shown or {3, 4} <= shown
        most, rate = (4_000_000, 2e9) if half else (8_000_000, 4e9)
        return int(max(100, min(most, self.state["TIM:RANG"] * rate)))

    def sample_rate(self) -> float:
        """Return the sample rate, 1/s."""
        return self.memory() / float(self.state["TIM:RANG"])

    def autoscale(self) -> Pending:
        """:AUToscale: look at every input for a while, then set it up."""
        now = self._world.clock.now()
        capture = self._world.capture(now, now + _AUTOSCALE_S)
        return Pending.at(now + _AUTOSCALE_S, lambda: self._autoscaled(capture, now))

    def _autoscaled(self, capture: Any, start_s: float) -> None:
        times = start_s + np.linspace(0.0, _AUTOSCALE_S, 20_000)
        frequencies = []
        for channel in CHANNELS:
            node = self._nodes.get(channel)
            volts = np.zeros(len(times)) if node is None else np.asarray(capture.samples(node, times))
            frequencies += self._fit_channel(channel, times, volts)
        if frequencies:
            self.state["TIM:RANG"] = 10.0 * _nice(3.0 / frequencies[0] / 10.0)
            self.state["TIM:POS"] = 0.0
        self.run()

    def _fit_channel(self, channel: int, times: NDArray[np.float64], volts: NDArray[np.float64]) -> list[float]:
        """Show a channel that has a signal above 10 mVpp; return its frequency, if any."""
        swing = float(np.ptp(volts)) * self.state[f"CHAN{channel}:PROB"]
        self.state[f"CHAN{channel}:DISP"] = swing > 0.01
        if swing <= 0.01:
            return []
        self.state[f"CHAN{channel}:RANG"] = 8.0 * _nice(swing / 5.0)
        self.state[f"CHAN{channel}:OFFS"] = float(volts.max() + volts.min()) / 2.0 * self.state[f"CHAN{channel}:PROB"]
        trace = Trace(times, volts, clipped=False, thresholds=Thresholds())
        counted = trace.counted_frequency()
        return [] if counted is None else [counted]

    # --- the record ---------------------------------------------------------------------------------------------------

    @property
    def record(self) -> Record:
        """The record on the screen; -230 if there is none."""
        if self._record is None:
            raise ScpiError(-230, "Data corrupt or stale")
        return self._record

    def trace(self, source: str) -> Trace:
        """Return the screen's trace of `source` for measurements."""
        found = self._traces.get(source)
        if found is None:
            digitised = self.record.digitised(int(source[4:]), _SCREEN_POINTS)
            times = self.record.screen.times_s(_SCREEN_POINTS)
            found = Trace(times, digitised.volts, clipped=digitised.clipped, thresholds=self._thresholds())
            self._traces[source] = found
        return found

    def _thresholds(self) -> Thresholds:
        kind, upper, middle, lower = self.state["MEAS:THR"]
        return Thresholds() if kind == "STAN" else Thresholds(upper, middle, lower, absolute=kind == "ABS")

    def forget_traces(self) -> None:
        """Measure anew: the definitions have changed."""
        self._traces.clear()

    def points(self) -> int:
        """Return how many points :WAVeform:DATA? sends: a listed number, rounded down."""
        wanted = self.state["WAV:POIN"]
        if self.state["WAV:MODE"] == "NORM" or self._run_state == "run":
            return max(each for each in (100, 250, 500, 1000) if each <= max(100, wanted))
        # RAW and MAX read the memory, which only a stopped acquisition of NORM, AVER or HRES type holds
        return min(_listed(wanted), self.memory())

    def codes(self) -> Iterator[NDArray[np.uint16]]:
        """Yield the record of the waveform source, block by block, as unsigned codes of the waveform format."""
        channel, points = int(self.state["WAV:SOUR"][4:]), self.points()
        peak = self.state["ACQ:TYPE"] == "PEAK"
        record, levels = self.record, _CODES[self.state["WAV:FORM"]]
        blocks = [record.extremes(channel, points).volts] if peak else record.blocks(channel, points)
        for volts in blocks:
            yield _coded(volts, record.views[channel], levels)

    def sent(self, make: Callable[[], bytes]) -> bytes:
        """Return `make()`, the record as :WAVeform:DATA? sends it, or what it was the last time that this was asked."""
        asked = (self.points(), *(self.state[key] for key in _WAVEFORM))
        kept = self._sent
        if kept is None or kept[0] is not self.record or kept[1] != asked:
            kept = self._sent = (self.record, asked, make())
        return kept[2]

    def scaling(self) -> tuple[float, float, int, float, float, int]:
        """Return xincrement, xorigin, xreference, yincrement, yorigin, yreference."""
        screen, channel = self.record.screen, int(self.state["WAV:SOUR"][4:])
        levels = _CODES[self.state["WAV:FORM"]]
        view = self.record.views[channel]
        increment, origin = screen.range_s / self.points(), screen.left_s
        return increment, origin, 0, view.range_v / levels, view.offset_v, levels // 2

    def average_count(self) -> int:
        """Return how many acquisitions the record averages."""
        return int(self.state["ACQ:COUN"]) if self.state["ACQ:TYPE"] == "AVER" else 1

    # --- setups -------------------------------------------------------------------------------------------------------

    def save(self, place: int) -> None:
        """*SAV."""
        self._stored[place] = dict(self.state)

    def recall(self, place: int) -> None:
        """*RCL; an empty place gives the default setup (unverified)."""
        self.restore(self._stored.get(place, _defaults()))


_RECORD_LENGTHS = (
    *(100, 250, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000, 200_000, 500_000),
    *(1_000_000, 2_000_000, 5_000_000, 8_000_000),
)


def _coded(volts: NDArray[np.float64], view: ChannelView, levels: int) -> NDArray[np.uint16]:
    """Return samples as codes: 1 is below the converter's range, the highest above."""
    codes = np.round((volts - view.offset_v) * (levels / view.range_v)) + levels // 2
    unit = levels // 256
    codes[codes < 2 * unit - unit / 2] = 1
    codes[codes > 254 * unit + unit / 2] = levels - 1
    return codes.astype(np.uint16)


def _listed(wanted: float) -> int:
    """Return the largest of 100, 250, 500, 1000, 2000, 5000 ... 8000000 that is not above `wanted`."""
    return max(each for each in _RECORD_LENGTHS if each <= max(100, wanted))


def _nice(value: float) -> float:
    """Return the next 1-2-5 value at or above `value`."""
    decade = 10.0 ** math.floor(math.log10(value))
    return next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= value * (1 - 1e-9))


# --- handlers -------------------------------------------------------------------------------------------------

_Model = Dso7104B


def _setting(
    pattern: str, key: str, parameter: Parameter, reply: Callable[[Any], str] = str, then: str | None = None
) -> Command:
    """Declare a setting; `then` names a method of the model called after a change."""

    def write(model: _Model, value: Any) -> None:
        model.state[key] = value
        if then is not None:
            getattr(model, then)()

    return Command(pattern, (parameter,), do=write, query=lambda model: model.state[key], reply=reply)


def _of_channel(key: str, name: str, parameter: Parameter, reply: Callable[[Any], str] = str) -> Command:
    """Declare a setting of each channel that depends on nothing else."""

    def write(model: _Model, channel: int, value: Any) -> None:
        model.state[f"CHAN{channel}:{key}"] = value

    def read(model: _Model, channel: int) -> Any:
        return model.state[f"CHAN{channel}:{key}"]

    return Command(f"CHANnel<1-4>:{name}", (parameter,), do=write, query=read, reply=reply)


def _clipped(model: _Model, value: float, low: float, high: float) -> float:
    """Clip to the limits, with -222."""
    if low <= value <= high:
        return value
    model.engine.report(ScpiError(-222))
    return min(max(value, low), high)


def _set_range(model: _Model, channel: int, volts: float) -> None:
    """Set the full screen: 16 mV to 40 V times the probe; the offset follows its limit."""
    probe = model.state[f"CHAN{channel}:PROB"]
    model.state[f"CHAN{channel}:RANG"] = _clipped(model, volts, 0.016 * probe, 40.0 * probe)
    reach = _offset_reach(model, channel)
    offset = model.state[f"CHAN{channel}:OFFS"]
    model.state[f"CHAN{channel}:OFFS"] = min(max(offset, -reach), reach)


def _offset_reach(model: _Model, channel: int) -> float:
    """Return the largest offset: 5 V below 10 mV/div, 20 V to 200 mV/div, 75 V above (unverified)."""
    probe = model.state[f"CHAN{channel}:PROB"]
    scale = model.state[f"CHAN{channel}:RANG"] / 8.0 / probe
    return float(probe * (5.0 if scale < 0.01 else 20.0 if scale <= 0.2 else 75.0))


def _set_offset(model: _Model, channel: int, volts: float) -> None:
    reach = _offset_reach(model, channel)
    model.state[f"CHAN{channel}:OFFS"] = _clipped(model, volts, -reach, reach)


def _set_probe(model: _Model, channel: int, ratio: float) -> None:
    """Change the attenuation: range and offset scale with it."""
    factor = ratio / model.state[f"CHAN{channel}:PROB"]
    for key in ("RANG", "OFFS"):
        model.state[f"CHAN{channel}:{key}"] *= factor
    model.state[f"CHAN{channel}:PROB"] = ratio


def _channel_learned(model: _Model, channel: int) -> str:
    """Return the learn string of one channel, in the shape of a recorded one."""

    def of(key: str) -> Any:
        return model.state[f"CHAN{channel}:{key}"]

    parts = (
        f":CHAN{channel}:RANG {_engineering(of('RANG'), 3)}",
        f"OFFS {of('OFFS'):+.5E}",
        f"COUP {of('COUP')}",
        f"IMP {of('IMP')}",
        f"DISP {boolean(of('DISP'))}",
        f"BWL {boolean(of('BWL'))}",
        f"INV {boolean(of('INV'))}",
        f'LAB "{of("LAB")}"',
        f"UNIT {of('UNIT')}",
        f"PROB {_engineering(of('PROB'), 2)}",
        f"PROB:SKEW {of('SKEW'):+.2E}",
        f"STYP {of('STYP')}",
    )
    return ";".join(parts)


def _engineering(value: float, digits: int) -> str:
    """Return `value` with an exponent that is a multiple of three: `+40.0E+00`."""
    exponent = 3 * math.floor(math.log10(abs(value)) / 3) if value else 0
    mantissa = value / 10.0**exponent
    decimals = max(0, digits - len(str(int(abs(mantissa)))))
    return f"{mantissa:+.{decimals}f}E{exponent:+03d}"


def _time_learned(model: _Model) -> str:
    state = model.state
    return (
        f":TIM:MODE {state['TIM:MODE']};REF {state['TIM:REF']};"
        f"MAIN:RANG {state['TIM:RANG']:+.2E};POS {state['TIM:POS']:+.1E}"
    )


def _show(model: _Model, source: str, *, shown: bool) -> None:
    model.state[f"{source}:DISP"] = shown


def _source_status(model: _Model, source: str) -> bool:
    return bool(model.state[f"{source}:DISP"])


# measurements


def _valid(value: float | None) -> float:
    return INVALID if value is None else value


def _measured(model: _Model, source: str | None, of: Callable[[Trace], float | None]) -> Any:
    name = source or model.state["MEAS:SOUR"][0]
    return model.look(lambda: _try(lambda: of(model.trace(name))))


def _measured_pair(
    model: _Model, first: str | None, second: str | None, of: Callable[[Trace, Trace], float | None]
) -> Any:
    one, two = first or model.state["MEAS:SOUR"][0], second or model.state["MEAS:SOUR"][1]
    return model.look(lambda: _try(lambda: of(model.trace(one), model.trace(two))))


def _try(measure: Callable[[], float | None]) -> float:
    """Return the measurement; without any record it is not measurable, which is no error."""
    try:
        return _valid(measure())
    except ScpiError:
        return INVALID


def _install(model: _Model, name: str, sources: tuple[str | None, ...], of: Callable[..., float | None]) -> None:
    """Put a measurement on the screen, for :MEASure:RESults?; there is room for four (unverified)."""
    defaults = model.state["MEAS:SOUR"]
    named = [source or default for source, default in zip(sources, defaults, strict=False)]
    label = f"{name}({','.join(source[4:] for source in named)})"
    model.installed.append((label, lambda: _try(lambda: of(*(model.trace(source) for source in named)))))
    del model.installed[:-4]


def _results(model: _Model) -> Any:
    return model.look(lambda: _results_now(model))


def _results_now(model: _Model) -> str:
    """Return what is installed: label, current, minimum, maximum, mean, deviation, count of the one record (ON)."""
    kind = model.state["MEAS:STAT"]
    values = [(label, measure()) for label, measure in model.installed]
    if kind == "ON":
        return ",".join(",".join((label, *[_nr3(value)] * 4, _nr3(0.0), "1")) for label, value in values)
    fixed = {"STDD": "+0.00000000E+000", "COUN": "+1"}
    return ",".join(fixed.get(kind) or _nr3(value) for _, value in values)


def _measurement(name: str, of: Callable[[Trace], float | None]) -> Command:
    """Declare `:MEASure:<name> [<source>]` (install) and `:MEASure:<name>? [<source>]`."""
    return Command(
        f"MEASure:{name}",
        (_OPTIONAL_SOURCE,),
        do=lambda model, source: _install(model, name, (source,), of),
        query=lambda model, source: _measured(model, source, of),
        query_parameters=(_OPTIONAL_SOURCE,),
        reply=_nr3,
    )


def _averaging(name: str, of: Callable[[Trace, set[str]], float | None]) -> Command:
    """Declare VAVerage or VRMS, whose words before the source are all optional."""

    def sorted_out(words: tuple[str | None, ...]) -> tuple[str | None, set[str]]:
        given = {word for word in words if word is not None}
        return next((word for word in given if word.startswith("CHAN")), None), given

    def read(model: _Model, *words: str | None) -> Any:
        source, given = sorted_out(words)
        return _measured(model, source, lambda trace: of(trace, given))

    def install(model: _Model, *words: str | None) -> None:
        source, given = sorted_out(words)
        _install(model, name, (source,), lambda trace: of(trace, given))

    return Command(
        f"MEASure:{name}",
        (_AVERAGING,) * 3,
        do=install,
        query=read,
        query_parameters=(_AVERAGING,) * 3,
        reply=_nr3,
    )


def _pair_measurement(name: str, of: Callable[[Trace, Trace], float | None]) -> Command:
    return Command(
        f"MEASure:{name}",
        (_OPTIONAL_SOURCE, _OPTIONAL_SOURCE),
        do=lambda model, *sources: _install(model, name, sources, of),
        query=lambda model, first, second: _measured_pair(model, first, second, of),
        query_parameters=(_OPTIONAL_SOURCE, _OPTIONAL_SOURCE),
        reply=_nr3,
    )


def _delay(model: _Model, first: str | None, second: str | None) -> Any:
    edges = model.state["MEAS:DEL"]
    return _measured_pair(model, first, second, lambda one, two: one.delay_to(two, *edges))


def _ratio_db(one: Trace, two: Trace) -> float | None:
    first, second = one.rms(cycle=False, ac=True), two.rms(cycle=False, ac=True)
    return 20.0 * math.log10(first / second) if first and second else None


def _set_sources(model: _Model, first: str, second: str | None) -> None:
    model.state["MEAS:SOUR"] = (first, second or model.state["MEAS:SOUR"][1])


def _define(model: _Model, what: str, *values: Any) -> None:
    """Take `DEFine THResholds,...` or `DEFine DELay,...`."""
    if what == "DEL":
        if len(values) != 2 or not all(isinstance(value, float) and value for value in values):
            raise ScpiError(-109 if len(values) < 2 else -224)
        model.state["MEAS:DEL"] = tuple(int(value) for value in values)
    else:
        model.state["MEAS:THR"] = _threshold_definition(model, values)
    model.forget_traces()


def _threshold_definition(model: _Model, values: tuple[Any, ...]) -> tuple[str, float, float, float]:
    if values == ("STAN",):
        return "STAN", 90.0, 50.0, 10.0
    kind, numbers = (values[0], values[1:]) if isinstance(values[0], str) else ("PERC", values)
    if kind == "STAN" or len(numbers) != 3 or any(isinstance(number, str) for number in numbers):
        raise ScpiError(-109 if len(numbers) < 3 else -224)
    upper, middle, lower = numbers
    if kind == "PERC":
        upper, middle, lower = (_clipped(model, number, 5.0, 95.0) for number in numbers)
    if not lower < middle < upper:
        raise ScpiError(-221)
    return kind, upper, middle, lower


def _edge_number(value: float) -> int:
    if value != int(value) or not value:
        raise ScpiError(-224)
    return int(value)


# waveforms


def _set_points(model: _Model, points: float) -> None:
    """Take a number, or NORMal, MAXimum, RAW, which set the mode too."""
    words = {-1.0: ("NORM", 1000), -2.0: ("MAX", 8_000_000), -3.0: ("RAW", 8_000_000)}
    if points in words:
        model.state["WAV:MODE"], model.state["WAV:POIN"] = words[points]
        return
    most = 1000 if model.state["WAV:MODE"] == "NORM" else 8_000_000
    model.state["WAV:POIN"] = _listed(_clipped(model, points, 100, most))


def _preamble(model: _Model) -> Any:
    return model.look(lambda: _preamble_now(model))


def _preamble_now(model: _Model) -> str:
    x_increment, x_origin, x_reference, y_increment, y_origin, y_reference = model.scaling()
    fields = (
        signed_integer(_FORMATS[model.state["WAV:FORM"]]),
        signed_integer(_ACQUISITION_TYPES[model.state["ACQ:TYPE"]]),
        signed_integer(model.points()),
        signed_integer(model.average_count()),
        _nr3(x_increment),
        _nr3(x_origin),
        signed_integer(x_reference),
        _nr3(y_increment),
        _nr3(y_origin),
        signed_integer(y_reference),
    )
    return ",".join(fields)


def _scaled(name: str, index: int, reply: Callable[[Any], str]) -> Command:
    def read(model: _Model) -> Any:
        return model.look(lambda: model.scaling()[index])

    return Command(f"WAVeform:{name}", query=read, reply=reply)


def _data(model: _Model) -> Any:
    return model.look(lambda: model.sent(lambda: _data_now(model)))


def _data_now(model: _Model) -> bytes:
    form = model.state["WAV:FORM"]
    if form == "ASC":
        return block(",".join(chain.from_iterable(_as_text(model, codes) for codes in model.codes())).encode(), 8)
    half = 0 if model.state["WAV:UNS"] else _CODES[form] // 2
    sign = "u" if model.state["WAV:UNS"] else "i"
    order = ">" if model.state["WAV:BYT"] == "MSBF" else "<"
    kind = f"{sign}1" if form == "BYTE" else f"{order}{sign}2"
    return block(b"".join((codes.astype(np.int32) - half).astype(kind).tobytes() for codes in model.codes()), 8)


def _as_text(model: _Model, codes: NDArray[np.uint16]) -> Iterator[str]:
    _, _, _, increment, origin, reference = model.scaling()
    return map(real(5, 3), ((codes.astype(float) - reference) * increment + origin).tolist())


# system


def _activity(model: _Model) -> Any:
    """Return the logic activity of the channels, H above and L below the trigger level, X when both (unverified)."""
    return model.look(lambda: ",".join(("+0", *(_activity_of(model, channel) for channel in CHANNELS))))


def _activity_of(model: _Model, channel: int) -> str:
    volts = model.trace(f"CHAN{channel}").volts
    above = volts >= model.state["TRIG:LEV"]
    return "H" if above.all() else "X" if above.any() else "L"


def _picture(model: _Model, kind: str, *_: str | None) -> Any:
    if kind != "PNG":
        raise ScpiError(-224)  # this screen is only drawn as PNG
    return model.look(lambda: block(screenshot(_traces(model)), 8))


def _traces(model: _Model) -> list[NDArray[np.float64]]:
    """Return the shown traces, each -0.5...0.5 of the screen; none without a record."""
    shown = [channel for channel in CHANNELS if model.state[f"CHAN{channel}:DISP"]]
    try:
        views = model.record.views
    except ScpiError:
        return []
    return [
        (model.trace(f"CHAN{channel}").volts - views[channel].offset_v) / views[channel].range_v for channel in shown
    ]


def _setup(model: _Model) -> bytes:
    """Return the setup as a block; its inside is ours."""
    return block(json.dumps(model.state).encode(), 8)


def _set_setup(model: _Model, data: bytes) -> None:
    try:
        state = json.loads(data)
    except ValueError:
        raise ScpiError(-161) from None
    defaults = _defaults()
    if not isinstance(state, dict) or set(state) != set(defaults):
        raise ScpiError(-161)
    tuples = {key: tuple(state[key]) for key, value in defaults.items() if isinstance(value, tuple)}
    model.restore(state | tuples)


def _learned(model: _Model) -> bytes:
    return b":SYST:SET " + _setup(model)


def _set_date(model: _Model, year: int, month: int, day: int) -> None:
    model.date = (year, month, day)


def _set_time(model: _Model, hour: int, minute: int, second: int) -> None:
    model.time = (hour, minute, second)


def _list_of(values: tuple[int, ...]) -> str:
    return ",".join(map(signed_integer, values))


def _put(name: str) -> Callable[..., None]:
    def write(model: _Model, value: Any) -> None:
        setattr(model, name, value)

    return write


def _nothing(_: _Model, *arguments: object) -> None:
    del arguments


def _enable_commands(pattern: str, read_event: str, of: Callable[[_Model], Register]) -> tuple[Command, Command]:
    def write(model: _Model, mask: int) -> None:
        of(model).enable = mask

    return (
        Command(
            pattern,
            (Integer(limits=Limits(0, 65535)),),
            do=write,
            query=lambda model: of(model).enable,
            query_parameters=(),
            reply=signed_integer,
        ),
        Command(read_event, query=lambda model: of(model).read_event(), reply=signed_integer),
    )


_SOURCE = Choice(("CHANnel<1-4>",))
_OPTIONAL_SOURCE = Choice(("CHANnel<1-4>",), required=False)
_AVERAGING = Choice(("CYCLe", "DISPlay", "AC", "DC", "CHANnel<1-4>"), required=False)
_TRIGGER_SOURCE = Choice(("CHANnel<1-4>", "EXTernal", "LINE"))
_VOLTS = Number(unit="V")
_SECONDS = Number(unit="S")
_PLACES = Integer(limits=Limits(0, 9))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Label(Text):
    """A channel's label: ten capitals are kept (siblings' guide, as quoted by PyMeasure's DSOX1102G)."""

    def parse(self, token: Token) -> str:
        """Return the label as it will be shown."""
        return Text.parse(self, token)[:10].upper()


_GLITCH_TIME = Number(unit="S", limits=Limits(2e-9, 10.0))
_TRIGGER_LEVEL = Number(unit="V", limits=Limits(-75.0, 75.0))
_TIME_RANGE = Limits(5e-9, 500.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Definition(Parameter):
    """A word or a number of :MEASure:DEFine."""

    def parse(self, token: Token) -> str | float:
        if token.kind is Kind.NUMBER:
            return token.number
        return Choice(("STANdard", "PERCent", "ABSolute")).parse(token)


TABLE = CommandTable(
    *COMMON_COMMANDS,
    Command("*OPT", query=lambda _: "0"),
    Command("*TST", query=lambda _: 0, reply=signed_integer, query_takes_s=5.0),
    Command("*TRG", do=lambda model: model.digitize()),
    Command("*SAV", (_PLACES,), do=lambda model, place: model.save(place)),
    Command("*RCL", (_PLACES,), do=lambda model, place: model.recall(place)),
    Command("*LRN", query=_learned),
    # root
    Command("RUN", do=lambda model: model.run()),
    Command("STOP", do=lambda model: model.stop()),
    Command("SINGle", do=lambda model: model.single()),
    Command(
        "DIGitize",
        (Choice(("CHANnel<1-4>",), required=False),),
        do=lambda model, *sources: model.digitize(*sources),
        repeat=True,
    ),
    Command(
        "AUToscale",
        (Choice(("CHANnel<1-4>",), required=False),),
        do=lambda model, *_: model.autoscale(),
        repeat=True,
    ),
    Command("CDISplay", do=_nothing),
    Command("BLANk", (_SOURCE,), do=lambda model, source: _show(model, source, shown=False)),
    Command("VIEW", (_SOURCE,), do=lambda model, source: _show(model, source, shown=True)),
    Command("STATus", query=_source_status, query_parameters=(_SOURCE,), reply=boolean),
    Command("AER", query=lambda model: model.armed(), reply=signed_integer),
    Command("TER", query=lambda model: model.triggered.read_event(), reply=signed_integer),
    Command("SERial", query=lambda _: "MY49520121"),
    Command("PRINt", do=_nothing),
    Command("MERGe", (Choice(("PMEMory<0-9>",)),), do=_nothing),
    Command("ACTivity", do=_nothing, query=_activity),
    Command("OPERegister:CONDition", query=lambda model: model.operation.condition, reply=signed_integer),
    *_enable_commands("OPEE", "OPERegister[:EVENt]", lambda model: model.operation),
    *_enable_commands("OVLenable", "OVLRegister", lambda model: model.overload),
    *_enable_commands("MTEenable", "MTERegister[:EVENt]", lambda model: model.mask_test),
    *_enable_commands("HWEenable", "HWERegister[:EVENt]", lambda model: model.hardware),
    Command("HWERegister:CONDition", query=lambda model: model.hardware.condition, reply=signed_integer),
    _setting("AUToscale:CHANnels", "AUT:CHAN", Choice(("ALL", "DISPlayed"))),
    # vertical
    Command("CHANnel<1-4>", query=_channel_learned),
    Command(
        "CHANnel<1-4>:RANGe",
        (_VOLTS,),
        do=_set_range,
        query=lambda model, channel: model.state[f"CHAN{channel}:RANG"],
        reply=_nr3,
    ),
    Command(
        "CHANnel<1-4>:SCALe",
        (_VOLTS,),
        do=lambda model, channel, volts: _set_range(model, channel, 8.0 * volts),
        query=lambda model, channel: model.state[f"CHAN{channel}:RANG"] / 8.0,
        reply=_nr3,
    ),
    Command(
        "CHANnel<1-4>:OFFSet",
        (_VOLTS,),
        do=_set_offset,
        query=lambda model, channel: model.state[f"CHAN{channel}:OFFS"],
        reply=_nr3,
    ),
    Command(
        "CHANnel<1-4>:PROBe",
        (Number(limits=Limits(0.1, 1000.0)),),
        do=_set_probe,
        query=lambda model, channel: model.state[f"CHAN{channel}:PROB"],
        reply=_nr3,
    ),
    Command("CHANnel<1-4>:PROBe:ID", query=lambda *_: "NONE"),
    _of_channel("SKEW", "PROBe:SKEW", Number(unit="S", limits=Limits(-100e-9, 100e-9)), _nr3),
    _of_channel("STYP", "PROBe:STYPe", Choice(("DIFFerential", "SINGle"))),
    _of_channel("BWL", "BWLimit", Boolean(), boolean),
    _of_channel("COUP", "COUPling", Choice(("AC", "DC"))),
    _of_channel("DISP", "DISPlay", Boolean(), boolean),
    _of_channel("IMP", "IMPedance", Choice(("ONEMeg", "FIFTy"))),
    _of_channel("INV", "INVert", Boolean(), boolean),
    _of_channel("LAB", "LABel", _Label(), quoted),
    _of_channel("PROT", "PROTection", Choice(("CLEar",))),
    _of_channel("UNIT", "UNITs", Choice(("VOLT", "AMPere"))),
    _of_channel("VERN", "VERNier", Boolean(), boolean),
    # horizontal
    Command("TIMebase", query=_time_learned),
    _setting("TIMebase:MODE", "TIM:MODE", Choice(("MAIN", "WINDow", "XY", "ROLL"))),
    _setting("TIMebase:RANGe", "TIM:RANG", Number(unit="S", limits=_TIME_RANGE), _nr3),
    Command(
        "TIMebase:SCALe",
        (Number(unit="S", limits=Limits(500e-12, 50.0)),),
        do=lambda model, seconds: model.state.update({"TIM:RANG": 10.0 * seconds}),
        query=lambda model: model.state["TIM:RANG"] / 10.0,
        reply=_nr3,
    ),
    _setting("TIMebase:POSition", "TIM:POS", Number(unit="S", limits=Limits(-500.0, 500.0)), _nr3),
    _setting("TIMebase:DELay", "TIM:POS", Number(unit="S", limits=Limits(-500.0, 500.0)), _nr3),
    _setting("TIMebase:REFerence", "TIM:REF", Choice(("LEFT", "CENTer", "RIGHt"))),
    _setting("TIMebase:VERNier", "TIM:VERN", Boolean(), boolean),
    _setting("TIMebase:WINDow:POSition", "WIND:POS", Number(unit="S", limits=Limits(-500.0, 500.0)), _nr3),
    _setting("TIMebase:WINDow:RANGe", "WIND:RANG", Number(unit="S", limits=_TIME_RANGE), _nr3),
    Command(
        "TIMebase:WINDow:SCALe",
        (Number(unit="S", limits=Limits(500e-12, 50.0)),),
        do=lambda model, seconds: model.state.update({"WIND:RANG": 10.0 * seconds}),
        query=lambda model: model.state["WIND:RANG"] / 10.0,
        reply=_nr3,
    ),
    # acquisition
    _setting("ACQuire:TYPE", "ACQ:TYPE", Choice(("NORMal", "AVERage", "HRESolution", "PEAK"))),
    _setting("ACQuire:MODE", "ACQ:MODE", Choice(("RTIMe", "ETIMe", "SEGMented"))),
    _setting("ACQuire:COUNt", "ACQ:COUN", Integer(limits=Limits(2, 65536)), signed_integer),
    _setting("ACQuire:COMPlete", "ACQ:COMP", Integer(limits=Limits(0, 100)), signed_integer),
    _setting("ACQuire:SEGMented:COUNt", "SEGM:COUN", Integer(limits=Limits(2, 2000)), signed_integer),
    _setting("ACQuire:SEGMented:INDex", "SEGM:IND", Integer(limits=Limits(1, 2000)), signed_integer),
    Command("ACQuire:SEGMented:ANALyze", do=_nothing),
    Command("ACQuire:POINts", query=lambda model: model.memory(), reply=signed_integer),
    Command("ACQuire:SRATe", query=lambda model: model.sample_rate(), reply=_nr3),
    # trigger
    _setting(
        "TRIGger:MODE",
        "TRIG:MODE",
        Choice(("EDGE", "GLITch", "PATTern", "TV", "CAN", "DURation", "EBURst", "IIC", "LIN", "SPI", "USB")),
    ),
    _setting("TRIGger:SWEep", "TRIG:SWE", Choice(("AUTO", "NORMal"))),
    _setting("TRIGger[:EDGE]:SOURce", "TRIG:SOUR", _TRIGGER_SOURCE),
    _setting("TRIGger[:EDGE]:LEVel", "TRIG:LEV", _TRIGGER_LEVEL, _nr3),
    _setting("TRIGger[:EDGE]:SLOPe", "TRIG:SLOP", Choice(("POSitive", "NEGative", "EITHer", "ALTernate"))),
    _setting("TRIGger[:EDGE]:COUPling", "TRIG:COUP", Choice(("AC", "DC", "LFReject"))),
    _setting("TRIGger[:EDGE]:REJect", "TRIG:REJ", Choice(("OFF", "LF", "HF"))),
    _setting("TRIGger:HFReject", "TRIG:HFR", Boolean(), boolean),
    _setting("TRIGger:NREJect", "TRIG:NREJ", Boolean(), boolean),
    _setting("TRIGger:HOLDoff", "TRIG:HOLD", Number(unit="S", limits=Limits(60e-9, 10.0)), _nr3),
    Command("TRIGger:FORCe", do=lambda model: model.force(), urgent=True),
    _setting("TRIGger:GLITch:SOURce", "GLIT:SOUR", _TRIGGER_SOURCE),
    _setting("TRIGger:GLITch:LEVel", "GLIT:LEV", _TRIGGER_LEVEL, _nr3),
    _setting("TRIGger:GLITch:QUALifier", "GLIT:QUAL", Choice(("GREaterthan", "LESSthan", "RANGe"))),
    _setting("TRIGger:GLITch:POLarity", "GLIT:POL", Choice(("POSitive", "NEGative"))),
    _setting("TRIGger:GLITch:LESSthan", "GLIT:LESS", _GLITCH_TIME, _nr3),
    _setting("TRIGger:GLITch:GREaterthan", "GLIT:GRE", _GLITCH_TIME, _nr3),
    Command(
        "TRIGger:GLITch:RANGe",
        (_GLITCH_TIME, _GLITCH_TIME),
        do=lambda model, less, greater: model.state.update({"GLIT:RANG": (less, greater)}),
        query=lambda model: model.state["GLIT:RANG"],
        reply=comma_list(_nr3),
    ),
    _setting("TRIGger:TV:SOURce", "TV:SOUR", _TRIGGER_SOURCE),
    _setting(
        "TRIGger:TV:MODE",
        "TV:MODE",
        Choice(("FIELd1", "FIELd2", "AFIelds", "ALINes", "LINE", "VERTical", "LFIeld1", "LFIeld2", "LALTernate")),
    ),
    _setting("TRIGger:TV:STANdard", "TV:STAN", Choice(("GENeric", "NTSC", "PALM", "PAL", "SECam"))),
    _setting("TRIGger:TV:POLarity", "TV:POL", Choice(("POSitive", "NEGative"))),
    _setting("TRIGger:TV:LINE", "TV:LINE", Integer(limits=Limits(1, 1125)), signed_integer),
    # measurements
    Command(
        "MEASure:SOURce",
        (_SOURCE, _OPTIONAL_SOURCE),
        do=_set_sources,
        query=lambda model: ",".join(model.state["MEAS:SOUR"]),
    ),
    Command(
        "MEASure:DEFine",
        (Choice(("THResholds", "DELay")), _Definition()),
        do=_define,
        repeat=True,
    ),
    Command("MEASure:RESults", query=_results),
    Command("MEASure:CLEar", do=lambda model: model.installed.clear()),
    _setting("MEASure:SHOW", "MEAS:SHOW", Boolean(), boolean),
    _setting(
        "MEASure:STATistics",
        "MEAS:STAT",
        Choice(("ON", "CURRent", "MINimum", "MAXimum", "MEAN", "STDDev", "COUNt")),
    ),
    _measurement("VPP", Trace.peak_to_peak),
    _measurement("VMAX", Trace.maximum),
    _measurement("VMIN", Trace.minimum),
    _measurement("VAMPlitude", Trace.amplitude),
    _measurement("VTOP", Trace.top),
    _measurement("VBASe", Trace.base),
    _averaging("VAVerage", lambda trace, words: trace.average(cycle="CYCL" in words)),
    _averaging("VRMS", lambda trace, words: trace.rms(cycle="CYCL" in words, ac="AC" in words)),
    _measurement("SDEViation", lambda trace: trace.rms(cycle=False, ac=True)),
    _measurement("OVERshoot", Trace.overshoot),
    _measurement("PREShoot", Trace.preshoot),
    _measurement("FREQuency", Trace.frequency),
    _measurement("PERiod", Trace.period),
    _measurement("COUNter", Trace.counted_frequency),
    _measurement("RISetime", Trace.rise_time),
    _measurement("FALLtime", Trace.fall_time),
    _measurement("PWIDth", Trace.positive_width),
    _measurement("NWIDth", Trace.negative_width),
    _measurement("DUTYcycle", Trace.duty_cycle),
    _measurement("XMAX", Trace.time_of_maximum),
    _measurement("XMIN", Trace.time_of_minimum),
    Command(
        "MEASure:DELay",
        (_OPTIONAL_SOURCE, _OPTIONAL_SOURCE),
        do=lambda model, *sources: _install(
            model, "DELay", sources, lambda one, two: one.delay_to(two, *model.state["MEAS:DEL"])
        ),
        query=_delay,
        query_parameters=(_OPTIONAL_SOURCE, _OPTIONAL_SOURCE),
        reply=_nr3,
    ),
    _pair_measurement("PHASe", lambda one, two: one.phase_to(two)),
    _pair_measurement("VRATio", _ratio_db),
    Command(
        "MEASure:TEDGe",
        query=lambda model, number, source: _measured(
            model, source, lambda trace: trace.time_of_edge(_edge_number(number))
        ),
        query_parameters=(Number(), _OPTIONAL_SOURCE),
        reply=_nr3,
    ),
    Command(
        "MEASure:TVALue",
        query=lambda model, level, number, source: _measured(
            model, source, lambda trace: trace.time_of_value(level, _edge_number(number))
        ),
        query_parameters=(_VOLTS, Number(), _OPTIONAL_SOURCE),
        reply=_nr3,
    ),
    Command(
        "MEASure:VTIMe",
        query=lambda model, seconds, source: _measured(model, source, lambda trace: trace.voltage_at(seconds)),
        query_parameters=(_SECONDS, _OPTIONAL_SOURCE),
        reply=_nr3,
    ),
    # waveforms
    _setting("WAVeform:SOURce", "WAV:SOUR", _SOURCE),
    _setting("WAVeform:FORMat", "WAV:FORM", Choice(("BYTE", "WORD", "ASCii"))),
    _setting("WAVeform:UNSigned", "WAV:UNS", Boolean(), boolean),
    _setting("WAVeform:BYTeorder", "WAV:BYT", Choice(("MSBFirst", "LSBFirst"))),
    Command(
        "WAVeform:POINts",
        (Number(words={"NORMal": -1.0, "MAXimum": -2.0, "RAW": -3.0}),),
        do=_set_points,
        query=lambda model: model.points(),
        reply=signed_integer,
    ),
    _setting("WAVeform:POINts:MODE", "WAV:MODE", Choice(("NORMal", "MAXimum", "RAW"))),
    Command("WAVeform:PREamble", query=_preamble),
    Command("WAVeform:DATA", query=_data, reply=bytes),
    _scaled("XINCrement", 0, _nr3),
    _scaled("XORigin", 1, _nr3),
    _scaled("XREFerence", 2, signed_integer),
    _scaled("YINCrement", 3, _nr3),
    _scaled("YORigin", 4, _nr3),
    _scaled("YREFerence", 5, signed_integer),
    Command("WAVeform:COUNt", query=lambda model: model.average_count(), reply=signed_integer),
    Command("WAVeform:TYPE", query=lambda model: model.state["ACQ:TYPE"]),
    Command("WAVeform:SEGMented:COUNt", query=lambda _: 1, reply=signed_integer),
    Command("WAVeform:SEGMented:TTAG", query=lambda _: 0.0, reply=_nr3),
    _setting("WAVeform:VIEW", "WAV:VIEW", Choice(("MAIN",))),
    # display and system
    _setting("DISPlay:VECTors", "DISP:VECT", Boolean(), boolean),
    _setting("DISPlay:LABel", "DISP:LAB", Boolean(), boolean),
    _setting("DISPlay:PERSistence", "DISP:PERS", Choice(("MINimum", "INFinite"))),
    Command("DISPlay:CLEar", do=_nothing),
    Command(
        "DISPlay:DATA",
        query=_picture,
        query_parameters=(
            Choice(("PNG", "BMP", "BMP8bit"), required=False, default="PNG"),
            Choice(("SCReen", "GRATicule"), required=False),
            Choice(("COLor", "GRAYscale", "MONochrome"), required=False),
        ),
        reply=bytes,
    ),
    _setting("HARDcopy:INKSaver", "HARD:INKS", Boolean(), boolean),
    Command("SYSTem:SETup", (Block(),), do=_set_setup, query=_setup, query_parameters=(), reply=bytes),
    Command("SYSTem:DSP", (Text(limit=254),), do=_put("message"), query=lambda model: model.message, reply=quoted),
    Command(
        "SYSTem:DATE",
        (Integer(limits=Limits(1980, 2099)), Integer(limits=Limits(1, 12)), Integer(limits=Limits(1, 31))),
        do=_set_date,
        query=lambda model: model.date,
        reply=_list_of,
    ),
    Command(
        "SYSTem:TIME",
        (Integer(limits=Limits(0, 23)), Integer(limits=Limits(0, 59)), Integer(limits=Limits(0, 59))),
        do=_set_time,
        query=lambda model: model.time,
        reply=_list_of,
    ),
    _setting("SYSTem:LOCK", "SYST:LOCK", Boolean(), boolean),
    _setting("SYSTem:PROTection:LOCK", "SYST:PROT", Boolean(), boolean),
)
"""Every command of the model, in the order of the manual's list."""
