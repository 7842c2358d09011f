"""A simulated Agilent 33220A, 20 MHz function generator, on the V_Vc input of the PCB.

The manual itself was not at hand: ranges, coupling rules and most wordings come from its quotations in public
drivers and from the guides of its siblings (33210A, 33250A, 33500 series), and the power-on replies from the record
of a real 33250A. What only general knowledge supports (the words of -221 and -222, errors 781...788, times, which
parameter wins a conflict) is unverified.

What the World is given is a direct voltage and sines behind 50 ohm: square, ramp, pulse and arbitrary waveforms are
their first 64 harmonics (edges ring accordingly), AM is a carrier with its sidebands (a modulating shape that is no
sine counts by its fundamental). FM, PM, FSK, PWM and sweep drive it with their unmodulated
carrier, noise with its offset. All of it can be set and read back.
"""

from __future__ import annotations

import cmath
import math
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from vcfbench.sim.scpi import (
    COMMON_COMMANDS,
    GPIB,
    LAN,
    USB,
    Boolean,
    Choice,
    Command,
    CommandTable,
    Dialect,
    Integer,
    Limits,
    Number,
    Parameter,
    Quantity,
    Register,
    ScpiEngine,
    ScpiError,
    ScpiInstrument,
    Status,
    Text,
    boolean,
    clip,
    condition,
    enable,
    event,
    next_error,
    quoted,
    real,
    signed_integer,
)
from vcfbench.sim.scpi.lexer import Kind, Token
from vcfbench.sim.sources import Drive, Sine

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np

    from vcfbench.clock import Clock

__all__ = ["Agilent33220A", "GeneratorErrors", "GeneratorWorld", "OutputRange"]

SOURCE_OHM = 50.0
MAX_PEAK_V = 10.0
"""Largest peak voltage into an open circuit; half of it into 50 ohm."""
MIN_VPP = 0.02
"""Smallest amplitude into an open circuit, Vpp; half of it into 50 ohm."""
_SAME_INSTANT_S = 1e-9
_SHORTEST_PERIOD_S = 1e-3
"""Bursts that come faster from the internal timer run on without gaps: each edge is an event of the World."""
HARMONICS = 64
"""How many harmonics of a waveform the World is given."""
_LEAST_HARMONIC = 1e-6
"""Part of the largest below which a harmonic is none."""
_FUNDAMENTALS = {
    "SIN": 1.0,
    "SQU": 4.0 / math.pi,
    "TRI": 8.0 / math.pi**2,
    "RAMP": 2.0 / math.pi,
    "NRAM": 2.0 / math.pi,
}
"""Fundamental of the modulating shapes, of their peak."""
ARBITRARY_POINTS = 16384
"""Length of the built-in arbitrary waveforms (unverified for the 33220A; the 33250A has 4096)."""


class GeneratorWorld(Protocol):
    """What the generator needs of the World."""

    @property
    def clock(self) -> Clock:
        """Bench time."""
        ...

    def drive_v_vc(self, source: Drive | None) -> None:
        """Connect the source to the V_Vc input, or None."""
        ...


@dataclass(frozen=True, slots=True)
class OutputRange:
    """One attenuator range of the direct-voltage path, open-circuit volts."""

    upper_v: float
    """Largest peak voltage of the range, V (the breaks of the 33220A are unverified)."""
    gain_error: float
    """Relative gain error of the range."""
    offset_error_v: float
    """Voltage that the range adds, V."""


@dataclass(frozen=True, slots=True)
class GeneratorErrors:
    """Imperfections of one specimen; each is off at zero."""

    ranges: tuple[OutputRange, ...]
    """Ranges of the direct-voltage path, smallest first."""
    amplitude_error: float
    """Relative error of the alternating amplitude (data sheet, unverified: 1 % at 1 kHz)."""
    frequency_error: float
    """Relative error of the time base (data sheet, unverified: 20 ppm a year)."""
    dac_bits: int
    """Bits of the converter over -upper_v...upper_v of the range: 14; 0 for a continuous output."""
    setting_digits: int
    """Digits to which amplitude, offset and levels are set: 4; 0 for as many as sent."""

    @classmethod
    def none(cls) -> GeneratorErrors:
        """Return a generator that puts out what it was told."""
        return cls(tuple(OutputRange(upper, 0.0, 0.0) for upper in _RANGES_V), 0.0, 0.0, 0, 0)

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> GeneratorErrors:
        """Return a specimen drawn uniformly within the data sheet: 2 % and 2 mV into 50 ohm, hence 4 mV open."""
        ranges = tuple(
            OutputRange(upper, float(rng.uniform(-0.02, 0.02)), float(rng.uniform(-0.004, 0.004)))
            for upper in _RANGES_V
        )
        return cls(ranges, float(rng.uniform(-0.01, 0.01)), float(rng.uniform(-2e-5, 2e-5)), 14, 4)


_RANGES_V = (0.32, 1.0, 3.2, 10.0)

_FREQUENCY_HZ = {
    "SIN": (1e-6, 20e6),
    "SQU": (1e-6, 20e6),
    "RAMP": (1e-6, 200e3),
    "PULS": (500e-6, 5e6),
    "USER": (1e-6, 6e6),
    "NOIS": (1e-6, 20e6),
    "DC": (1e-6, 20e6),
}
_NAMES = {"RAMP": "ramp", "PULS": "pulse", "USER": "user"}
_BUILT_IN = ("EXP_RISE", "EXP_FALL", "NEG_RAMP", "SINC", "CARDIAC")
_MODES = ("AM", "FM", "PM", "FSK", "PWM", "SWE", "BURS")
_MODE_WORDS = {"SWE": "sweep", "BURS": "burst"}
_UNMODULATED = {"PULS", "NOIS", "DC"}

_RESET: dict[str, Any] = {
    "func": "SIN",
    "freq": 1000.0,
    "vpp": 0.2,  # open-circuit: 100 mVpp into the 50 ohm of *RST
    "offset": 0.0,
    "unit": "VPP",
    "load": 50.0,
    "output": False,
    "polarity": "NORM",
    "sync": True,
    "range_auto": True,
    "range": 0,
    "duty": 50.0,
    "symmetry": 100.0,
    "width": 1e-4,
    "hold": "WIDT",
    "edge": 5e-9,
    "user": "EXP_RISE",
    "angle": "DEG",
    "phase": 0.0,
    "mode": "",
    "AM:depth": 100.0,
    "AM:func": "SIN",
    "AM:freq": 100.0,
    "AM:source": "INT",
    "FM:dev": 100.0,
    "FM:func": "SIN",
    "FM:freq": 10.0,
    "FM:source": "INT",
    "PM:dev": 180.0,
    "PM:func": "SIN",
    "PM:freq": 10.0,
    "PM:source": "INT",
    "PWM:dev": 1e-5,
    "PWM:duty": 1.0,
    "PWM:func": "SIN",
    "PWM:freq": 10.0,
    "PWM:source": "INT",
    "FSK:freq": 100.0,
    "FSK:rate": 10.0,
    "FSK:source": "INT",
    "start": 100.0,
    "stop": 1000.0,
    "spacing": "LIN",
    "sweep_s": 1.0,
    "marker": 500.0,
    "marker_on": False,
    "burst_mode": "TRIG",
    "cycles": 1.0,
    "burst_period": 1e-2,
    "burst_phase": 0.0,
    "gate": "NORM",
    "trigger": "IMM",
    "slope": "POS",
    "delay": 0.0,
    "trigger_out": False,
    "trigger_out_slope": "POS",
    "order": "NORM",
    "unlock_error": False,
}

_number = real(13)


def _conflict(words: str) -> ScpiError:
    return ScpiError(-221, f"Settings conflict; {words}")


# --- waveforms ------------------------------------------------------------------------------------------------


def _built_in(name: str) -> list[float]:
    """Return a built-in waveform in -1...1; only their names are known, the shapes are ours."""
    places = [index / (ARBITRARY_POINTS - 1) for index in range(ARBITRARY_POINTS)]
    return [_SHAPES[name](place) for place in places]


def _fall(place: float) -> float:
    """Return an exponential from 1 to 0 over six time constants: gives the average on record, the crest 0.3 % low."""
    end = math.exp(-6.0)
    return (math.exp(-6.0 * place) - end) / (1.0 - end)


def _sinc(place: float) -> float:
    argument = (place - 0.5) * 20.0 * math.pi
    return math.sin(argument) / argument if argument else 1.0


def _beat(place: float, centre: float, width: float, height: float) -> float:
    return height * math.exp(-(((place - centre) / width) ** 2))


def _cardiac(place: float) -> float:
    beats = ((0.2, 0.025, 0.12), (0.32, 0.008, -0.15), (0.35, 0.01, 1.0), (0.38, 0.008, -0.25), (0.6, 0.05, 0.25))
    return sum(_beat(place, *each) for each in beats)


_SHAPES: dict[str, Callable[[float], float]] = {
    "EXP_RISE": lambda place: 1.0 - 2.0 * _fall(place),
    "EXP_FALL": lambda place: 2.0 * _fall(place) - 1.0,
    "NEG_RAMP": lambda place: 1.0 - 2.0 * place,
    "SINC": _sinc,
    "CARDIAC": _cardiac,
}


def _mean(points: list[float]) -> float:
    return math.fsum(points) / len(points)


def _crest(points: list[float]) -> float:
    mean = _mean(points)
    rms = math.sqrt(math.fsum((point - mean) ** 2 for point in points) / len(points))
    return max(abs(point) for point in points) / rms if rms else 0.0


def _harmonics(points: list[float]) -> list[complex]:
    """Return a_n of Im sum a_n exp(j 2 pi n x), the harmonics of one period of `points`, n from 1."""
    import numpy as np  # noqa: PLC0415  (only where an arbitrary waveform is put out)

    spectrum = np.fft.rfft(points)[1 : HARMONICS + 1] * (2j / len(points))
    return [complex(each) for each in spectrum]


# --- parameters of its own ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class _Name(Parameter):
    """A free name without quotes: a letter, then letters, digits or underscores, at most 12 (unverified)."""

    def parse(self, token: Token) -> str:
        if token.kind is not Kind.WORD:
            raise self.refuse_kind(token)
        if len(token.text) > 12:
            raise ScpiError(-144)
        return token.text


@dataclass(frozen=True, slots=True, kw_only=True)
class _DacPoints(Parameter):
    """A block of 16-bit words or a number -8191...8191."""

    def parse(self, token: Token) -> bytes | float:
        if token.kind is Kind.BLOCK:
            return token.text.encode("latin-1")
        if token.kind is not Kind.NUMBER:
            raise self.refuse_kind(token)
        return token.number


# --- the model ------------------------------------------------------------------------------------------------


class Agilent33220A(ScpiInstrument):
    """The generator. `interface` is usb, gpib or lan; it has no RS-232."""

    def __init__(self, world: GeneratorWorld, errors: GeneratorErrors, interface: str = "usb") -> None:
        self._world = world
        self._errors = errors
        self.state: dict[str, Any] = dict(_RESET)
        self._stored: dict[int, dict[str, Any]] = {}
        self.state_names = {0: "AUTO_RECALL", 1: "STATE_1", 2: "STATE_2", 3: "STATE_3", 4: "STATE_4"}
        self.auto_recall = False
        self._volatile: list[float] = []
        self._waveforms: dict[str, list[float]] = {}
        self.panel: dict[str, Any] = {"display": True, "text": "", "beep": True, "lock": False, "exclude": "NONE"}
        self.panel |= {
            "gpib": 10,
            "dhcp": True,
            "address": "169.254.2.20",
            "mask": "255.255.0.0",
            "gateway": "169.254.2.1",
        }
        self.panel |= {"host": "A-33220A-21876"}
        self.remote = "LOC"
        self._burst_from_s = math.inf
        self._burst_until_s = -math.inf
        self._edge_s: float | None = None
        self._phase_rad = 0.0
        self._frequency_hz = 0.0
        self._driven: Drive | None = None
        self._questionable = Register()
        self.engine = ScpiEngine(
            self,
            TABLE,
            world.clock,
            dialect=Dialect(out_of_range=clip),
            interface={"usb": USB, "gpib": GPIB, "lan": LAN}[interface],
            status=Status({3: self._questionable}),
        )
        world.drive_v_vc(None)

    @property
    def questionable(self) -> Register:
        """The QUEStionable register; this model never sets its bits: nothing here overloads or loses lock."""
        return self._questionable

    def identity(self) -> str:
        """Return the reply of a real unit."""
        return "Agilent Technologies,33220A,MY44021876,2.02-2.02-22-2"

    def reset(self) -> None:
        """Take the *RST state: output off; stored waveforms and states stay."""
        self.state = dict(_RESET)
        self._burst_until_s = -math.inf
        self.update()

    def abort(self) -> None:
        """Device clear ends a running burst."""
        self._burst_until_s = -math.inf
        self.update()

    def service(self) -> None:
        """Begin a burst after its delay, end one that is over."""
        now = self.engine.clock.now()
        if now >= self._burst_from_s:
            self._burst_from_s = math.inf
            self.update()
        if self._edge_s is not None and now >= self._edge_s:
            self.update()
        if self._burst_until_s != -math.inf and now >= self._burst_until_s:
            self._burst_until_s = -math.inf
            self.update()

    def next_event_s(self) -> float | None:
        """Return the delayed start or the end of the burst."""
        instant = min(self._burst_from_s, abs(self._burst_until_s), self._edge_s or math.inf)
        return instant if math.isfinite(instant) else None

    def operations_end_s(self) -> float:
        """*OPC, *OPC? and *WAI wait for a triggered burst."""
        return self._burst_until_s

    # --- levels: kept as open-circuit volts, shown for the load that OUTPut:LOAD says -----------------------------

    @property
    def share(self) -> float:
        """The part of the open-circuit voltage that the assumed load sees."""
        load: float = self.state["load"]
        return 1.0 if math.isinf(load) else load / (load + SOURCE_OHM)

    def max_v(self) -> float:
        """Return the largest peak voltage as shown."""
        return MAX_PEAK_V * self.share

    def peak_v(self) -> float:
        """Return the peak alternating voltage into an open circuit; direct voltage has none."""
        return 0.0 if self.state["func"] == "DC" else float(self.state["vpp"]) / 2.0

    def rounded(self, shown_v: float) -> float:
        """Return a setting at the resolution of the instrument."""
        digits = self._errors.setting_digits
        return float(f"{shown_v:.{digits - 1}e}") if digits else shown_v

    def set_amplitude(self, shown_vpp: float) -> None:
        """Set the amplitude, Vpp as shown; an offset that no longer fits is moved (-221)."""
        self.state["vpp"] = shown_vpp / self.share
        room = MAX_PEAK_V - self.peak_v()
        offset = self.state["offset"]
        if abs(offset) > room * (1 + 1e-12):
            self.state["offset"] = math.copysign(room, offset)
            self.engine.report(_conflict("offset changed due to amplitude"))

    def set_offset(self, shown_v: float) -> None:
        """Set the offset as shown; one that does not fit the amplitude is clipped (-222)."""
        room = (MAX_PEAK_V - self.peak_v()) * self.share
        if abs(shown_v) > room * (1 + 1e-12):
            shown_v = self.clipped(shown_v, Limits(-room, room), "offset")
        self.state["offset"] = shown_v / self.share

    def clipped(self, value: float, limits: Limits, name: str) -> float:
        """Return `value` clipped, with the error that says so."""
        violation = clip(value, limits, name)
        self.engine.report(violation.error)
        assert violation.value is not None  # noqa: S101  (clipping always has a value)
        return violation.value

    def in_unit(self, vpp: float, unit: str) -> float:
        """Return an amplitude in `unit`."""
        rms = vpp / self._vpp_per_vrms()
        if unit == "DBM":
            return 10.0 * math.log10(rms**2 / self.state["load"] * 1e3)
        return rms if unit == "VRMS" else vpp

    def in_vpp(self, value: float, unit: str) -> float:
        """Return an amplitude given in `unit` in Vpp."""
        if unit == "DBM":
            return math.sqrt(1e-3 * 10.0 ** (value / 10.0) * self.state["load"]) * self._vpp_per_vrms()
        return value * self._vpp_per_vrms() if unit == "VRMS" else value

    def _vpp_per_vrms(self) -> float:
        """Return Vpp per Vrms of the function (noise: unverified)."""
        if self.state["func"] == "USER":
            return 2.0 * (_crest(self.points(self.state["user"])) or 1.0)
        factors = {"SIN": 2.0 * math.sqrt(2.0), "RAMP": 2.0 * math.sqrt(3.0), "NOIS": 6.6}
        return factors.get(self.state["func"], 2.0)

    # --- arbitrary waveforms ----------------------------------------------------------------------------------------

    def names(self) -> list[str]:
        """Return every waveform that can be selected."""
        volatile = ["VOLATILE"] if self._volatile else []
        return [*volatile, *_BUILT_IN, *self._waveforms]

    def stored_names(self) -> list[str]:
        """Return the waveforms in the four non-volatile places."""
        return list(self._waveforms)

    def points(self, name: str) -> list[float]:
        """Return a waveform in -1...1; 785 if there is none of that name."""
        if name == "VOLATILE" and self._volatile:
            return self._volatile
        if name in _BUILT_IN:
            return _built_in(name)
        if name not in self._waveforms:
            raise ScpiError(785, "Specified arb waveform does not exist")
        return self._waveforms[name]

    def load_volatile(self, points: list[float]) -> None:
        """Take 1...65536 points."""
        if len(points) > 65536:
            raise ScpiError(-223)
        self._volatile = points
        self.update()

    def copy_volatile(self, name: str) -> None:
        """Keep the volatile waveform under `name`."""
        if name == "VOLATILE":
            raise ScpiError(788, "Cannot copy to VOLATILE arb waveform")
        if name in _BUILT_IN:
            raise ScpiError(782, "Cannot overwrite a built-in waveform")
        points = self.points("VOLATILE")
        if name not in self._waveforms and len(self._waveforms) >= 4:
            raise ScpiError(781, "Not enough memory to store new arb waveform; use DATA:DELETE")
        self._waveforms[name] = points

    def delete(self, name: str) -> None:
        """Forget a waveform."""
        if name in _BUILT_IN:
            raise ScpiError(786, "Not able to delete a built-in arb waveform")
        self.points(name)
        if name == self.state["user"] and self.state["func"] == "USER":
            raise ScpiError(787, "Not able to delete the currently selected active arb waveform")
        if name == "VOLATILE":
            self._volatile = []
        else:
            del self._waveforms[name]

    # --- states -----------------------------------------------------------------------------------------------------

    def save(self, place: int) -> None:
        """*SAV."""
        self._stored[place] = dict(self.state)

    def recall(self, place: int) -> None:
        """*RCL; an empty place is error 810 (unverified)."""
        if place not in self._stored:
            raise ScpiError(810, "State has not been stored")
        self.state = dict(self._stored[place])
        self.update()

    def forget(self, place: int) -> None:
        """MEMory:STATe:DELete."""
        self._stored.pop(place, None)

    def has_stored(self, place: int) -> bool:
        """MEMory:STATe:VALid?."""
        return place in self._stored

    # --- functions and modes ----------------------------------------------------------------------------------------

    def select(self, function: str) -> None:
        """Change the function; what it cannot do is reduced (-221)."""
        left_dc = self.state["func"] == "DC" and function != "DC"
        self.state["func"] = function
        low, high = _FREQUENCY_HZ[function]
        frequency = self.state["freq"]
        if not low <= frequency <= high:
            self.state["freq"] = min(max(frequency, low), high)
            word = "reduced" if function != "PULS" else "changed"
            self.engine.report(_conflict(f"frequency {word} for {_NAMES[function]} function"))
        room = MAX_PEAK_V - self.peak_v()
        if left_dc and abs(self.state["offset"]) > room:
            self.state["offset"] = math.copysign(room, self.state["offset"])
            self.engine.report(_conflict("offset changed on exit from dc function"))
        if self.state["mode"] and not self._allows(self.state["mode"]):
            self.state["mode"] = ""
            self.engine.report(_conflict("not able to modulate this function"))
        self.fit_pulse()

    def _allows(self, mode: str) -> bool:
        function = self.state["func"]
        if mode == "PWM":
            return bool(function == "PULS")
        if mode == "BURS":
            return function != "DC" and not (function == "NOIS" and self.state["burst_mode"] == "TRIG")
        return function not in _UNMODULATED

    def switch_mode(self, mode: str, state: object) -> None:
        """Switch one of AM, FM, PM, FSK, PWM, sweep, burst; only one can be on."""
        active = self.state["mode"]
        if not state:
            self.state["mode"] = "" if active == mode else active
        elif not self._allows(mode):
            if mode == "BURS" and self.state["func"] == "NOIS":
                raise _conflict("triggered burst not available for noise")
            raise _conflict("not able to modulate this function")
        else:
            if active not in ("", mode):
                word = _MODE_WORDS.get(active, active)
                self.engine.report(_conflict(f"{word} turned off by selection of other mode or modulation"))
            self.state["mode"] = mode
            self._burst_until_s = -math.inf
        self.update()

    def fit_pulse(self) -> None:
        """Keep the pulse within its period."""
        period = 1.0 / self.state["freq"]
        if self.state["func"] != "PULS" or self.state["width"] <= period:
            return
        self.state["width"] = period / 2.0
        self.engine.report(_conflict("pulse width decreased due to period"))

    def set_frequency(self, frequency_hz: float) -> None:
        """Set the frequency; HOLD tells whether a pulse keeps its width or its duty cycle."""
        old = self.state["freq"]
        self.state["freq"] = frequency_hz
        if self.state["hold"] == "DCYC":
            self.state["width"] *= old / frequency_hz
        self.fit_pulse()
        self.update()

    def fire(self) -> None:
        """Take a trigger; -211 when neither burst nor sweep waits for one."""
        if self.state["mode"] not in {"BURS", "SWE"} or self.state["trigger"] == "IMM":
            raise ScpiError(-211)
        burst_s, sweep_s = self.state["cycles"] / self.state["freq"], self.state["sweep_s"]
        length = burst_s if self.state["mode"] == "BURS" else sweep_s
        self._burst_from_s = self.engine.clock.now() + self.state["delay"]
        self._burst_until_s = self._burst_from_s + length
        self.service()

    # --- the output ---------------------------------------------------------------------------------------------------

    def update(self) -> None:
        """Put on the World what the connector really carries, if that has changed."""
        self._edge_s = self._next_edge_s()
        drive = self._drive() if self.state["output"] else None
        if drive != self._driven:
            self._driven = drive
            self._world.drive_v_vc(drive)

    def _drive(self) -> Drive:
        state = self.state
        peak = self.peak_v() if self._running() else 0.0
        mean, waves = self._wave(peak)
        factor = (1.0 + self._errors.amplitude_error) * (0.5 if state["mode"] == "AM" else 1.0)
        if state["polarity"] == "INV":  # turns the waveform over, not the offset
            mean, factor = -mean, -factor
        direct = self._direct_v(state["offset"] + mean)
        if not any(waves):
            return Drive(direct, source_ohm=SOURCE_OHM)
        frequency = state["freq"] * (1.0 + self._errors.frequency_error)
        turn = self._continuous_phase(frequency) + math.radians(state["phase"])
        least = _LEAST_HARMONIC * max(map(abs, waves))
        first, *others = (
            _sine(factor * wave * cmath.exp(1j * order * turn), order * frequency)
            for order, wave in enumerate(waves, 1)
            if order == 1 or abs(wave) > least
        )
        overtones = (*others, *self._sidebands(first))
        return Drive(direct, first.amplitude_v, frequency, first.phase_rad, SOURCE_OHM, overtones)

    def _sidebands(self, carrier: Sine) -> tuple[Sine, ...]:
        """Return what AM adds to the carrier, which is at half amplitude: (1 + m sin w t) times it."""
        state = self.state
        depth = state["AM:depth"] / 100.0 * _FUNDAMENTALS.get(state["AM:func"], 0.0)
        if state["mode"] != "AM" or state["AM:source"] == "EXT" or not depth:
            return ()
        size, apart_hz = carrier.amplitude_v * depth / 2.0, state["AM:freq"] * (1.0 + self._errors.frequency_error)
        quarter = math.pi / 2.0
        return (
            Sine(size, carrier.frequency_hz - apart_hz, carrier.phase_rad + quarter),
            Sine(size, carrier.frequency_hz + apart_hz, carrier.phase_rad - quarter),
        )

    def _running(self) -> bool:
        """Tell whether the waveform runs: a triggered burst only does between trigger and end."""
        if self.state["mode"] != "BURS":
            return True
        if self.state["burst_mode"] == "GAT":  # nothing is on the gate's connector: low
            return bool(self.state["gate"] == "INV")
        if self.state["trigger"] == "IMM":
            return self.state["burst_period"] < _SHORTEST_PERIOD_S or self._place_s() < self._burst_s()
        return bool(self._burst_until_s != -math.inf and math.isinf(self._burst_from_s))

    def _place_s(self) -> float:
        """Return how long ago the internal timer last started a burst."""
        return (self.engine.clock.now() + _SAME_INSTANT_S) % float(self.state["burst_period"])

    def _burst_s(self) -> float:
        return float(self.state["cycles"] / self.state["freq"])

    def _next_edge_s(self) -> float | None:
        """Return when the internal timer next starts a burst, or the running one ends."""
        state = self.state
        timed = state["mode"] == "BURS" and state["burst_mode"] == "TRIG" and state["trigger"] == "IMM"
        period, lasts = state["burst_period"], self._burst_s()
        if not timed or not state["output"] or lasts >= period or period < _SHORTEST_PERIOD_S:
            return None
        place = self._place_s()
        return float(self.engine.clock.now() + (lasts if place < lasts else period) - place + _SAME_INSTANT_S)

    def _continuous_phase(self, frequency_hz: float) -> float:
        """Return the phase that lets a change of frequency go without a jump."""
        if frequency_hz != self._frequency_hz:
            before_hz = self._frequency_hz or frequency_hz
            turned = 2.0 * math.pi * (before_hz - frequency_hz) * self.engine.clock.now()
            self._phase_rad = math.remainder(self._phase_rad + turned, 2.0 * math.pi)
            self._frequency_hz = frequency_hz
        return self._phase_rad

    def _wave(self, peak: float) -> tuple[float, list[complex]]:
        """Return mean and harmonics a_n of Im sum a_n exp(j n w t) of the waveform with that peak voltage."""
        function, orders = self.state["func"], range(1, HARMONICS + 1)
        if function == "SIN":
            return 0.0, [complex(peak)]
        if function == "RAMP":
            return 0.0, [peak * _ramp(self.state["symmetry"] / 100.0, order) for order in orders]
        if function in {"SQU", "PULS"}:
            duty = self.state["duty"] / 100.0 if function == "SQU" else self.state["width"] * self.state["freq"]
            return peak * (2.0 * duty - 1.0), [peak * _rectangle(duty, order) for order in orders]
        if function == "USER" and peak:
            points = self.points(self.state["user"])
            return peak * _mean(points), [peak * each for each in _harmonics(points)]
        return 0.0, []

    def _direct_v(self, wanted_v: float) -> float:
        """Return the direct voltage through converter and attenuator of the range in use."""
        reach = abs(self.state["offset"]) + self.peak_v()
        ranges = self._errors.ranges
        fitting = next((index for index, each in enumerate(ranges) if reach <= each.upper_v), len(ranges) - 1)
        # with autorange off the range is held; it is left only for a larger one that the output needs (unverified)
        index = fitting if self.state["range_auto"] else max(fitting, self.state["range"])
        self.state["range"] = index
        used = ranges[index]
        return self._quantised(wanted_v, used.upper_v) * (1.0 + used.gain_error) + used.offset_error_v

    def _quantised(self, volts: float, upper_v: float) -> float:
        bits = self._errors.dac_bits
        step = 2.0 * upper_v / 2**bits
        return round(volts / step) * step if bits else volts


def _sine(wave: complex, frequency_hz: float) -> Sine:
    return Sine(abs(wave), frequency_hz, cmath.phase(wave))


def _ramp(rising: float, order: int) -> complex:
    """Return a harmonic of a ramp that rises from -1 to 1 for the part `rising` of its period."""
    if 0.0 < rising < 1.0:
        size = 2.0 * math.sin(math.pi * order * rising) / (math.pi**2 * order**2 * rising * (1.0 - rising))
    else:
        size = 2.0 / (math.pi * order) * ((-1) ** (order + 1) if rising else 1)
    # a quarter of its period into the rise, so that a triangle starts like a sine
    return size * cmath.exp(1j * math.pi * order * (0.5 - rising))


def _rectangle(duty: float, order: int) -> complex:
    """Return a harmonic of a rectangle that is 1 from the start for the part `duty` of its period, else -1."""
    size = 4.0 / (math.pi * order) * math.sin(math.pi * order * duty)
    return size * cmath.exp(1j * math.pi * (0.5 - order * duty))


# --- handlers -------------------------------------------------------------------------------------------------

_Model = Agilent33220A


def _setting(
    pattern: str, key: str, parameter: Parameter, reply: Callable[[Any], str] = str, takes_s: float = 0.0
) -> Command:
    """Declare a setting that depends on nothing else."""

    def write(model: _Model, value: Any) -> None:
        model.state[key] = value
        model.update()

    return Command(pattern, (parameter,), do=write, query=lambda model: model.state[key], reply=reply, takes_s=takes_s)


def _panel(pattern: str, key: str, parameter: Parameter, reply: Callable[[Any], str]) -> Command:
    def write(model: _Model, value: Any) -> None:
        model.panel[key] = value

    return Command(pattern, (parameter,), do=write, query=lambda model: model.panel[key], reply=reply)


def _mode(pattern: str, mode: str) -> Command:
    return Command(
        pattern,
        (Boolean(),),
        do=lambda model, state: model.switch_mode(mode, state),
        query=lambda model: model.state["mode"] == mode,
        reply=boolean,
    )


def _frequency_limits(model: _Model) -> Limits:
    return Limits(*_FREQUENCY_HZ[model.state["func"]], default=1000.0)


def _amplitude_limits(model: _Model) -> Limits:
    unit = model.state["unit"]
    low, high, default = (model.in_unit(oc * model.share, unit) for oc in (MIN_VPP, 2 * MAX_PEAK_V, 0.1 / model.share))
    return Limits(low, high, default=default)


def _offset_limits(model: _Model) -> Limits:
    room = (MAX_PEAK_V - model.peak_v()) * model.share
    return Limits(-room, room, default=0.0)


def _level_limits(model: _Model) -> Limits:
    return Limits(-model.max_v(), model.max_v())


def _select(model: _Model, function: str) -> None:
    model.select(function)
    model.update()


def _vpp_of(model: _Model, given: Quantity) -> float:
    """Return an amplitude argument in Vpp as shown, within the limits of the instrument."""
    unit = given.unit or model.state["unit"]
    if unit == "V":
        unit = "VPP"
    if unit == "DBM" and math.isinf(model.state["load"]):
        raise _conflict("amplitude units changed to Vpp due to high-Z load")
    if unit != "DBM" and given.value <= 0.0:
        return model.clipped(given.value, Limits(MIN_VPP * model.share, math.inf), "amplitude")
    vpp = model.in_vpp(given.value, unit)
    low, high = MIN_VPP * model.share, 2.0 * model.max_v()
    if not low * (1 - 1e-12) <= vpp <= high * (1 + 1e-12):
        return model.clipped(vpp, Limits(low, high), "amplitude")
    return model.in_vpp(model.rounded(given.value), unit)


def _set_amplitude(model: _Model, given: Quantity) -> None:
    model.set_amplitude(_vpp_of(model, given))
    model.update()


def _amplitude(model: _Model) -> float:
    return model.in_unit(model.state["vpp"] * model.share, model.state["unit"])


def _set_offset(model: _Model, volts: float) -> None:
    model.set_offset(model.rounded(volts))
    model.update()


def _offset(model: _Model) -> float:
    return float(model.state["offset"] * model.share)


def _levels(model: _Model) -> tuple[float, float]:
    """Return low and high level as shown."""
    half = model.state["vpp"] / 2.0 * model.share
    return _offset(model) - half, _offset(model) + half


def _set_high(model: _Model, high: float) -> None:
    low, gap = _levels(model)[0], MIN_VPP * model.share
    high = model.rounded(high)
    if high - low < gap:
        low = max(high - gap, -model.max_v())
        high = max(high, low + gap)
        model.engine.report(_conflict("low level changed due to high level"))
    _set_levels(model, low, high)


def _set_low(model: _Model, low: float) -> None:
    high, gap = _levels(model)[1], MIN_VPP * model.share
    low = model.rounded(low)
    if high - low < gap:
        high = min(low + gap, model.max_v())
        low = min(low, high - gap)
        model.engine.report(_conflict("high level changed due to low level"))
    _set_levels(model, low, high)


def _set_levels(model: _Model, low: float, high: float) -> None:
    model.state["vpp"] = (high - low) / model.share
    model.state["offset"] = (high + low) / 2.0 / model.share
    model.update()


def _set_unit(model: _Model, unit: str) -> None:
    if unit == "DBM" and math.isinf(model.state["load"]):
        unit = "VPP"
        model.engine.report(_conflict("amplitude units changed to Vpp due to high-Z load"))
    model.state["unit"] = unit


def _set_load(model: _Model, ohm: float) -> None:
    """Change what is shown, not what comes out."""
    model.state["load"] = ohm
    if math.isinf(ohm) and model.state["unit"] == "DBM":
        _set_unit(model, "DBM")


def _set_range_auto(model: _Model, state: object) -> None:
    model.state["range_auto"] = True
    model.update()
    model.state["range_auto"] = state is True


def _apply(function: str) -> Command:
    """Declare APPLy for one function."""

    def write(model: _Model, frequency: float | None, amplitude: Quantity | None, offset: float | None) -> None:
        model.state.update(mode="", trigger="IMM", duty=50.0, symmetry=100.0, range_auto=True, offset=0.0)
        low, high = _FREQUENCY_HZ[function]
        model.state["freq"] = min(max(1000.0 if frequency is None else frequency, low), high)
        model.select(function)
        _apply_levels(model, amplitude, 0.0 if offset is None else offset)
        model.state["output"] = True
        model.update()

    return Command(f"APPLy:{_FUNCTIONS[function]}", _apply_parameters(function), do=write, takes_s=_SWITCH_S)


def _apply_levels(model: _Model, amplitude: Quantity | None, offset: float) -> None:
    """Set amplitude, then the offset that fits it; direct voltage ignores the amplitude and keeps the old one."""
    if model.state["func"] != "DC":
        model.set_amplitude(0.1 if amplitude is None else _vpp_of(model, amplitude))
    model.set_offset(model.rounded(offset))


def _apply_parameters(function: str) -> tuple[Parameter, ...]:
    limits = Limits(*_FREQUENCY_HZ[function], default=1000.0)
    return (
        Number(unit="HZ", limits=limits, name="frequency", required=False),
        Number(unit=_AMPLITUDE_UNITS, limits=_amplitude_limits, with_unit=True, required=False),
        Number(
            unit="V", limits=lambda model: Limits(-model.max_v(), model.max_v(), 0.0), name="offset", required=False
        ),
    )


def _applied(model: _Model) -> str:
    values = (model.state["freq"], _amplitude(model), _offset(model))
    return quoted(f"{model.state['func']} " + ",".join(map(_number, values)))


def _set_period(model: _Model, seconds: float) -> None:
    model.set_frequency(1.0 / seconds)


def _set_width(model: _Model, seconds: float) -> None:
    period = 1.0 / model.state["freq"]
    if seconds > period - 20e-9:
        seconds = model.clipped(seconds, Limits(20e-9, period - 20e-9), "pulse width limited by period")
    model.state["width"] = seconds
    model.update()


def _set_pulse_duty(model: _Model, percent: float) -> None:
    _set_width(model, percent / 100.0 / model.state["freq"])


def _set_user(model: _Model, name: str) -> None:
    model.points(name)
    model.state["user"] = name
    model.update()


def _duty_limits(model: _Model) -> Limits:
    return Limits(20.0, 80.0, 50.0) if model.state["freq"] <= 10e6 else Limits(40.0, 60.0, 50.0)


def _angle_limits(reach_deg: float, low_deg: float) -> Callable[[_Model], Limits]:
    def limits(model: _Model) -> Limits:
        factor = math.pi / 180.0 if model.state["angle"] == "RAD" else 1.0
        return Limits(low_deg * factor, reach_deg * factor)

    return limits


def _angle(pattern: str, key: str, low_deg: float, high_deg: float) -> Command:
    """Declare an angle: kept in degrees, said in UNIT:ANGLe."""

    def write(model: _Model, value: float) -> None:
        model.state[key] = math.degrees(value) if model.state["angle"] == "RAD" else value
        model.update()

    def read(model: _Model) -> float:
        degrees: float = model.state[key]
        return math.radians(degrees) if model.state["angle"] == "RAD" else degrees

    return Command(pattern, (Number(limits=_angle_limits(high_deg, low_deg)),), do=write, query=read, reply=_number)


def _sweep(pattern: str, read: Callable[[float, float], float], write: Callable[..., tuple[float, float]]) -> Command:
    """Declare one of STARt, STOP, CENTer, SPAN, which share two numbers."""

    def do(model: _Model, value: float) -> None:
        model.state["start"], model.state["stop"] = write(model.state["start"], model.state["stop"], value)

    return Command(
        pattern,
        (Number(unit="HZ", limits=_sweep_limits),),
        do=do,
        query=lambda model: read(model.state["start"], model.state["stop"]),
        reply=_number,
    )


def _sweep_limits(model: _Model) -> Limits:
    high = _FREQUENCY_HZ[model.state["func"]][1]
    return Limits(-high, high)


def _set_cycles(model: _Model, cycles: float) -> None:
    model.state["cycles"] = cycles
    if math.isinf(cycles) and model.state["trigger"] == "IMM":
        model.state["trigger"] = "BUS"
        model.engine.report(_conflict("infinite burst changed trigger source to MANUAL"))
    model.update()


def _set_trigger(model: _Model, source: str) -> None:
    if source == "IMM" and math.isinf(model.state["cycles"]):
        model.state["cycles"] = 50000.0
        model.engine.report(_conflict("turned off infinite burst to allow immediate trigger source"))
    model.state["trigger"] = source
    model.update()


def _bus_trigger(model: _Model) -> None:
    if model.state["trigger"] != "BUS":
        raise ScpiError(-211)
    model.fire()


def _load_points(model: _Model, place: str, *points: float) -> None:
    del place
    model.load_volatile(list(points))


def _load_dac(model: _Model, place: str, first: bytes | float, *others: bytes | float) -> None:
    del place
    values = _dac_block(first, model.state["order"]) if isinstance(first, bytes) else _dac_list((first, *others))
    if any(not -8191 <= value <= 8191 for value in values):
        raise ScpiError(-222)
    model.load_volatile([value / 8191.0 for value in values])


def _dac_block(data: bytes, order: str) -> list[float]:
    if len(data) % 2:
        raise ScpiError(800, "Block length must be even")
    words = struct.unpack(f"{'>' if order == 'NORM' else '<'}{len(data) // 2}h", data)
    return [float(word) for word in words]


def _dac_list(values: tuple[bytes | float, ...]) -> list[float]:
    if any(isinstance(value, bytes) for value in values):
        raise ScpiError(-168)
    return [round(value) for value in values if not isinstance(value, bytes)]


def _attribute(name: str, of: Callable[[list[float]], float], reply: Callable[[float], str] = _number) -> Command:
    return Command(
        f"DATA:ATTRibute:{name}",
        query=lambda model, which: of(model.points(which or model.state["user"])),
        query_parameters=(_Name(required=False),),
        reply=reply,
    )


def _names(names: list[str]) -> str:
    return ",".join(map(quoted, names)) or '""'


def _delete_all(model: _Model) -> None:
    for name in model.stored_names():
        model.delete(name)


def _name_state(model: _Model, place: int, name: str | None) -> None:
    model.state_names[place] = name or f"STATE_{place}"


def _learn(model: _Model) -> str:
    """Return settings as commands: *RCL-able text; the real unit's is longer and unverified."""
    state = model.state
    parts = (
        f":FUNC {state['func']}",
        f":OUTP:LOAD {_number(state['load'])}",
        f":FREQ {_number(state['freq'])}",
        f":VOLT:UNIT {state['unit']}",
        f":VOLT {_number(_amplitude(model))}",
        f":VOLT:OFFS {_number(_offset(model))}",
        f":OUTP:POL {state['polarity']}",
        f":OUTP {boolean(state['output'])}",
    )
    return ";".join(parts)


def _preset_status(model: _Model) -> None:
    model.questionable.enable = 0


_FUNCTIONS = {
    "SIN": "SINusoid",
    "SQU": "SQUare",
    "RAMP": "RAMP",
    "PULS": "PULSe",
    "NOIS": "NOISe",
    "DC": "DC",
    "USER": "USER",
}
_AMPLITUDE_UNITS = ("VPP", "VRMS", "DBM", "V")
_SOURCES = Choice(("INTernal", "EXTernal"))
_SHAPE_WORDS = Choice(("SINusoid", "SQUare", "RAMP", "NRAMp", "TRIangle", "NOISe", "USER"))
_SLOPES = Choice(("POSitive", "NEGative"))
_POLARITIES = Choice(("NORMal", "INVerted"))
_STATES = Integer(limits=Limits(0, 4))
_MODULATION_HZ = Number(unit="HZ", limits=Limits(2e-3, 20e3), name="frequency")

_SWITCH_S = 0.1
_LEVEL_S = 0.03
_TUNE_S = 0.002
"""Times of a change of function, level (attenuator relays) and frequency (unverified)."""

TABLE = CommandTable(
    *COMMON_COMMANDS,
    # levels and functions
    *(_apply(function) for function in _FUNCTIONS),
    Command("APPLy", query=_applied),
    Command(
        "[SOURce:]FUNCtion[:SHAPe]",
        (Choice(tuple(_FUNCTIONS.values())),),
        do=_select,
        query=lambda model: model.state["func"],
        takes_s=_SWITCH_S,
    ),
    Command(
        "[SOURce:]FREQuency",
        (Number(unit="HZ", limits=_frequency_limits, name="frequency"),),
        do=lambda model, value: model.set_frequency(value),
        query=lambda model: model.state["freq"],
        reply=_number,
        takes_s=_TUNE_S,
    ),
    Command(
        "[SOURce:]VOLTage",
        (Number(unit=_AMPLITUDE_UNITS, limits=_amplitude_limits, with_unit=True),),
        do=_set_amplitude,
        query=_amplitude,
        reply=_number,
        takes_s=_LEVEL_S,
    ),
    Command(
        "[SOURce:]VOLTage:OFFSet",
        (Number(unit="V", limits=_offset_limits, name="offset"),),
        do=_set_offset,
        query=_offset,
        reply=_number,
        takes_s=_LEVEL_S,
    ),
    Command(
        "[SOURce:]VOLTage:HIGH",
        (Number(unit="V", limits=_level_limits, name="high level"),),
        do=_set_high,
        query=lambda model: _levels(model)[1],
        reply=_number,
        takes_s=_LEVEL_S,
    ),
    Command(
        "[SOURce:]VOLTage:LOW",
        (Number(unit="V", limits=_level_limits, name="low level"),),
        do=_set_low,
        query=lambda model: _levels(model)[0],
        reply=_number,
        takes_s=_LEVEL_S,
    ),
    Command(
        "[SOURce:]VOLTage:UNIT",
        (Choice(("VPP", "VRMS", "DBM")),),
        do=_set_unit,
        query=lambda model: model.state["unit"],
    ),
    Command(
        "[SOURce:]VOLTage:RANGe:AUTO",
        (Boolean(words=("ONCE",)),),
        do=_set_range_auto,
        query=lambda model: model.state["range_auto"],
        reply=boolean,
    ),
    _setting(
        "[SOURce:]FUNCtion:SQUare:DCYCle",
        "duty",
        Number(unit="PCT", limits=_duty_limits, name="duty cycle"),
        _number,
    ),
    _setting("[SOURce:]FUNCtion:RAMP:SYMMetry", "symmetry", Number(unit="PCT", limits=Limits(0.0, 100.0)), _number),
    # pulse
    Command(
        "[SOURce:]PULSe:PERiod",
        (Number(unit="S", limits=Limits(200e-9, 2000.0)),),
        do=_set_period,
        query=lambda model: 1.0 / model.state["freq"],
        reply=_number,
        takes_s=_TUNE_S,
    ),
    Command(
        "[SOURce:]FUNCtion:PULSe:WIDTh",
        (Number(unit="S", limits=Limits(20e-9, 2000.0)),),
        do=_set_width,
        query=lambda model: model.state["width"],
        reply=_number,
    ),
    Command(
        "[SOURce:]FUNCtion:PULSe:DCYCle",
        (Number(unit="PCT", limits=Limits(0.0, 100.0), name="duty cycle"),),
        do=_set_pulse_duty,
        query=lambda model: 100.0 * model.state["width"] * model.state["freq"],
        reply=_number,
    ),
    _setting("[SOURce:]FUNCtion:PULSe:HOLD", "hold", Choice(("WIDTh", "DCYCle"))),
    _setting("[SOURce:]FUNCtion:PULSe:TRANsition", "edge", Number(unit="S", limits=Limits(5e-9, 100e-9)), _number),
    # output
    _setting("OUTPut[:STATe]", "output", Boolean(), boolean, takes_s=_LEVEL_S),
    Command(
        "OUTPut:LOAD",
        (Number(unit="OHM", limits=Limits(1.0, 10000.0, 50.0), words={"INFinity": math.inf}),),
        do=_set_load,
        query=lambda model: model.state["load"],
        reply=_number,
    ),
    _setting("OUTPut:POLarity", "polarity", _POLARITIES),
    _setting("OUTPut:SYNC[:STATe]", "sync", Boolean(), boolean),
    _setting("OUTPut:TRIGger[:STATe]", "trigger_out", Boolean(), boolean),
    _setting("OUTPut:TRIGger:SLOPe", "trigger_out_slope", _SLOPES),
    # phase
    _angle("[SOURce:]PHASe[:ADJust]", "phase", -360.0, 360.0),
    Command("[SOURce:]PHASe:REFerence", do=lambda model: model.state.update(phase=0.0)),
    _setting("[SOURce:]PHASe:UNLock:ERRor:STATe", "unlock_error", Boolean(), boolean),
    _setting("UNIT:ANGLe", "angle", Choice(("DEGree", "RADian"))),
    # modulation
    *(
        _setting(f"[SOURce:]{mode}:INTernal:FUNCtion", f"{mode}:func", _SHAPE_WORDS)
        for mode in ("AM", "FM", "PM", "PWM")
    ),
    *(
        _setting(f"[SOURce:]{mode}:INTernal:FREQuency", f"{mode}:freq", _MODULATION_HZ, _number)
        for mode in ("AM", "FM", "PM", "PWM")
    ),
    *(_setting(f"[SOURce:]{mode}:SOURce", f"{mode}:source", _SOURCES) for mode in ("AM", "FM", "PM", "PWM")),
    _setting("[SOURce:]AM:DEPTh", "AM:depth", Number(unit="PCT", limits=Limits(0.0, 120.0)), _number),
    _setting(
        "[SOURce:]FM:DEViation",
        "FM:dev",
        Number(unit="HZ", limits=lambda model: Limits(0.0, _FREQUENCY_HZ[model.state["func"]][1] / 2.0)),
        _number,
    ),
    _angle("[SOURce:]PM:DEViation", "PM:dev", 0.0, 360.0),
    _setting(
        "[SOURce:]PWM:DEViation",
        "PWM:dev",
        Number(unit="S", limits=lambda model: Limits(0.0, model.state["width"])),
        _number,
    ),
    _setting("[SOURce:]PWM:DEViation:DCYCle", "PWM:duty", Number(unit="PCT", limits=Limits(0.0, 100.0)), _number),
    _setting(
        "[SOURce:]FSKey:FREQuency", "FSK:freq", Number(unit="HZ", limits=_frequency_limits, name="frequency"), _number
    ),
    _setting("[SOURce:]FSKey:INTernal:RATE", "FSK:rate", Number(unit="HZ", limits=Limits(2e-3, 100e3)), _number),
    _setting("[SOURce:]FSKey:SOURce", "FSK:source", _SOURCES),
    *(_mode(f"[SOURce:]{mode}:STATe", mode) for mode in ("AM", "FM", "PM", "PWM")),
    _mode("[SOURce:]FSKey:STATe", "FSK"),
    # sweep
    _sweep("[SOURce:]FREQuency:STARt", lambda start, _: start, lambda _, stop, value: (value, stop)),
    _sweep("[SOURce:]FREQuency:STOP", lambda _, stop: stop, lambda start, _, value: (start, value)),
    _sweep(
        "[SOURce:]FREQuency:CENTer",
        lambda start, stop: (start + stop) / 2.0,
        lambda start, stop, value: (value - (stop - start) / 2.0, value + (stop - start) / 2.0),
    ),
    _sweep(
        "[SOURce:]FREQuency:SPAN",
        lambda start, stop: stop - start,
        lambda start, stop, value: ((start + stop - value) / 2.0, (start + stop + value) / 2.0),
    ),
    _setting("[SOURce:]SWEep:SPACing", "spacing", Choice(("LINear", "LOGarithmic"))),
    _setting("[SOURce:]SWEep:TIME", "sweep_s", Number(unit="S", limits=Limits(1e-3, 500.0)), _number),
    _mode("[SOURce:]SWEep:STATe", "SWE"),
    _setting("MARKer:FREQuency", "marker", Number(unit="HZ", limits=_frequency_limits), _number),
    _setting("MARKer[:STATe]", "marker_on", Boolean(), boolean),
    # burst and trigger
    _setting("[SOURce:]BURSt:MODE", "burst_mode", Choice(("TRIGgered", "GATed"))),
    Command(
        "[SOURce:]BURSt:NCYCles",
        (Number(limits=Limits(1, 50000), words={"INFinity": math.inf}, name="burst count"),),
        do=_set_cycles,
        query=lambda model: model.state["cycles"],
        reply=_number,
    ),
    _setting("[SOURce:]BURSt:INTernal:PERiod", "burst_period", Number(unit="S", limits=Limits(1e-6, 500.0)), _number),
    _angle("[SOURce:]BURSt:PHASe", "burst_phase", -360.0, 360.0),
    _mode("[SOURce:]BURSt:STATe", "BURS"),
    _setting("[SOURce:]BURSt:GATE:POLarity", "gate", _POLARITIES),
    Command(
        "TRIGger:SOURce",
        (Choice(("IMMediate", "EXTernal", "BUS")),),
        do=_set_trigger,
        query=lambda model: model.state["trigger"],
    ),
    _setting("TRIGger:SLOPe", "slope", _SLOPES),
    _setting("TRIGger:DELay", "delay", Number(unit="S", limits=Limits(0.0, 85.0), name="trigger delay"), _number),
    Command("TRIGger", do=lambda model: model.fire()),
    Command("*TRG", do=_bus_trigger, urgent=True),
    # arbitrary waveforms
    Command("DATA", (Choice(("VOLATILE",)), Number(limits=Limits(-1.0, 1.0))), do=_load_points, repeat=True),
    Command("DATA:DAC", (Choice(("VOLATILE",)), _DacPoints()), do=_load_dac, repeat=True),
    _setting("FORMat:BORDer", "order", Choice(("NORMal", "SWAPped"))),
    Command(
        "DATA:COPY",
        (_Name(), Choice(("VOLATILE",), required=False)),
        do=lambda model, name, _: model.copy_volatile(name),
    ),
    Command("DATA:CATalog", query=lambda model: _names(model.names())),
    Command("DATA:NVOLatile:CATalog", query=lambda model: _names(model.stored_names())),
    Command("DATA:NVOLatile:FREE", query=lambda model: 4 - len(model.stored_names()), reply=signed_integer),
    Command("DATA:DELete[:NAME]", (_Name(),), do=lambda model, name: model.delete(name)),
    Command("DATA:DELete:ALL", do=_delete_all),
    _attribute("AVERage", _mean),
    _attribute("CFACtor", _crest),
    _attribute("POINts", len, signed_integer),
    _attribute("PTPeak", lambda points: (max(points) - min(points)) / 2.0),
    Command("[SOURce:]FUNCtion:USER", (_Name(),), do=_set_user, query=lambda model: model.state["user"]),
    # states
    Command("*SAV", (_STATES,), do=lambda model, place: model.save(place)),
    Command("*RCL", (_STATES,), do=lambda model, place: model.recall(place), takes_s=_SWITCH_S),
    Command("*LRN", query=_learn),
    Command("*TST", query=lambda _: 0, reply=signed_integer, query_takes_s=5.0),
    Command(
        "MEMory:STATe:NAME",
        (_STATES, _Name(required=False)),
        do=_name_state,
        query=lambda model, place: model.state_names[place],
        query_parameters=(_STATES,),
        reply=quoted,
    ),
    Command("MEMory:STATe:DELete", (_STATES,), do=lambda model, place: model.forget(place)),
    Command(
        "MEMory:STATe:VALid",
        query=lambda model, place: model.has_stored(place),
        query_parameters=(_STATES,),
        reply=boolean,
    ),
    Command("MEMory:STATe:CATalog", query=lambda model: _names(list(model.state_names.values()))),
    Command(
        "MEMory:STATe:RECall:AUTO",
        (Boolean(),),
        do=lambda model, state: setattr(model, "auto_recall", state),
        query=lambda model: model.auto_recall,
        reply=boolean,
    ),
    Command("MEMory:NSTates", query=lambda _: 5, reply=signed_integer),
    # panel and system
    _panel("DISPlay", "display", Boolean(), boolean),
    _panel("DISPlay:TEXT", "text", Text(limit=40), quoted),
    Command("DISPlay:TEXT:CLEar", do=lambda model: model.panel.update(text="")),
    Command("SYSTem:BEEPer[:IMMediate]", do=lambda _: None),
    Command("SYSTem:ERRor:NEXT", query=next_error),  # of SCPI 1999.0, which it claims; unverified
    _panel("SYSTem:BEEPer:STATe", "beep", Boolean(), boolean),
    _panel("SYSTem:KLOCk[:STATe]", "lock", Boolean(), boolean),
    _panel("SYSTem:KLOCk:EXCLude", "exclude", Choice(("NONE", "LOCal")), str),
    Command("SYSTem:VERSion", query=lambda _: "1999.0"),
    Command(
        "SYSTem:COMMunicate:RLSTate",
        (Choice(("LOCal", "REMote", "RWLock")),),
        do=lambda model, state: setattr(model, "remote", state),
        query=lambda model: model.remote,
    ),
    _panel("SYSTem:COMMunicate:GPIB:ADDRess", "gpib", Integer(limits=Limits(0, 30)), signed_integer),
    _panel("SYSTem:COMMunicate:LAN:DHCP[:STATe]", "dhcp", Boolean(), boolean),
    _panel("SYSTem:COMMunicate:LAN:IPADdress", "address", Text(limit=15), quoted),
    _panel("SYSTem:COMMunicate:LAN:SMASk", "mask", Text(limit=15), quoted),
    _panel("SYSTem:COMMunicate:LAN:GATEway", "gateway", Text(limit=15), quoted),
    _panel("SYSTem:COMMunicate:LAN:HOSTname", "host", Text(limit=15), quoted),
    Command("SYSTem:COMMunicate:LAN:MAC", query=lambda _: '"0030D3002041"'),
    # status
    condition("STATus:QUEStionable:CONDition", lambda model: model.questionable),
    event("STATus:QUEStionable[:EVENt]", lambda model: model.questionable),
    enable("STATus:QUEStionable:ENABle", lambda model: model.questionable),
    Command("STATus:PRESet", do=_preset_status),
)
"""Every command of the model, in the order of the manual's list."""
