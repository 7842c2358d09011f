"""Simulated 34401A multimeter: its command set, and readings averaged on a node of the World.

Source: HP 34401A User's Guide 34401-90004, ed. 4, 1996 (p. 51-101 functions, 105-147 commands, 173-182 errors,
216-227 specifications). What the guide leaves open is marked *unverified*.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from vcfbench.sim.instruments.dmm_functions import APERTURES_S, BY_NAME, RESOLUTIONS, Function
from vcfbench.sim.instruments.dmm_inputs import Inputs, MeterErrors
from vcfbench.sim.instruments.dmm_math import OVERLOAD, Math
from vcfbench.sim.scpi import (
    COMMON_COMMANDS,
    GPIB,
    RS232,
    Boolean,
    Choice,
    Command,
    CommandTable,
    Dialect,
    Integer,
    Limits,
    Number,
    Pending,
    Register,
    ScpiEngine,
    ScpiError,
    ScpiInstrument,
    Special,
    Status,
    Text,
    Word,
    boolean,
    comma_list,
    enable,
    event,
    quoted,
    real,
    signed_integer,
)
from vcfbench.sim.scpi.mnemonics import Mnemonic

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.sim.instruments.dmm_inputs import Reading
    from vcfbench.sim.world import World

__all__ = ["Hp34401A", "MeterErrors"]

_MEMORY = 512
_MATH_RULES = {
    "NULL": ("VOLT", "VOLT:AC", "CURR", "CURR:AC", "RES", "FRES", "FREQ", "PER"),
    "AVER": ("VOLT", "VOLT:RAT", "VOLT:AC", "CURR", "CURR:AC", "RES", "FRES", "FREQ", "PER"),
    "LIM": ("VOLT", "VOLT:RAT", "VOLT:AC", "CURR", "CURR:AC", "RES", "FRES", "FREQ", "PER"),
    "DB": ("VOLT", "VOLT:AC"),
    "DBM": ("VOLT", "VOLT:AC"),
}
"""Which functions each math operation goes with (p. 63)."""

_ARMING_S = 0.02
"""From leaving idle to waiting for the trigger (p. 79: about 20 ms)."""
_FUNCTION_CHANGE_S = 1 / 26
"""Function changes a second over the bus (p. 217)."""
_RANGE_CHANGE_S = 1 / 50
"""Range changes a second over the bus (p. 217)."""
_SELF_TEST_S = 15.0
"""*TST? (p. 86: about 15 s)."""


@dataclass(slots=True)
class _Setup:
    """What one function is set to. `resolution` is a fraction of the range, `nplc` and `aperture_s` go with it."""

    range: float
    auto: bool = True
    nplc: float = 10.0
    resolution: float = 1e-6
    aperture_s: float = 0.1


@dataclass(slots=True)
class _Sequence:
    """A running measurement: what is left of it and what it has given.

    Args:
        triggers: triggers still to come, infinity for ever. samples: readings left of the present trigger.
        stored: whether readings go to memory (INITiate) or straight out (READ?).
    """

    triggers: float
    samples: int
    stored: bool
    armed_s: float
    readings: list[float] = field(default_factory=list)
    current: Reading | None = None
    triggered: bool = False


class Hp34401A(ScpiInstrument):
    """The meter.

    Args:
        world: where its leads go.
        node: the node on its input terminals.
        errors: imperfections of this specimen.
        mains_hz: line frequency, which sets what a power line cycle is (sensed at power-on; 400 Hz counts as 50).
        source_ohm: resistance of the node, which the input resistance loads.
        interface: "gpib" or "rs232", one of which is selected on the front panel.
    """

    def __init__(
        self,
        world: World,
        *,
        node: str = "output",
        errors: MeterErrors,
        mains_hz: float = 50.0,
        source_ohm: float = 0.0,
        interface: str = "gpib",
    ) -> None:
        self.world = world
        self.clock = world.clock
        self.inputs = Inputs(world, node, errors, 50.0 if mains_hz > 360.0 else mains_hz, source_ohm)
        self.questionable = Register()
        status = Status({3: self.questionable})
        self.engine = ScpiEngine(
            self, TABLE, world.clock, dialect=_DIALECT, interface=_INTERFACES[interface], status=status
        )
        self.math = Math()
        self.calibration = _Calibration()
        self.local = True
        self.beeper = True
        self.reset()

    # --- what the engine asks -----------------------------------------------------------------------------

    def identity(self) -> str:
        """Return the identity; the firmware numbers are typical, unverified."""
        return "HEWLETT-PACKARD,34401A,0,11-5-2"

    def reset(self) -> None:
        """*RST (p. 101)."""
        self.setups = {name: _Setup(function.default_range) for name, function in BY_NAME.items() if name != "VOLT:RAT"}
        self.function = BY_NAME["VOLT"]
        self.bandwidth_hz = 20.0
        self.autozero = True
        self.display_on = True
        self.display_text = ""
        self.preset_trigger()
        self.math.reset()

    def preset_trigger(self) -> None:
        """Take the settings that *RST, CONFigure and MEASure share (p. 112)."""
        self.sequence: _Sequence | None = None
        self.memory: list[float] = []
        self.trigger_source = "IMM"
        self.trigger_delay_s = 0.0
        self.delay_auto = True
        self.sample_count = 1
        self.trigger_count = 1.0
        self.external_pending = False
        self.high_impedance = False
        self.feed = "CALC"
        self.math.on = False

    def service(self) -> None:
        """Finish readings that are due and start the next ones."""
        sequence = self.sequence
        while sequence is not None and sequence.current is not None and sequence.current.end_s <= self.clock.now():
            self._finish_reading(sequence)
            sequence = self.sequence

    def next_event_s(self) -> float | None:
        """Return when the running reading ends."""
        if self.sequence is None or self.sequence.current is None:
            return None
        return self.sequence.current.end_s

    def abort(self) -> None:
        """Device clear: the trigger system goes idle (p. 116)."""
        self.sequence = None
        self.external_pending = False

    # --- measuring ----------------------------------------------------------------------------------------

    @property
    def setup(self) -> _Setup:
        """The settings of the present function; the ratio shares those of dc voltage."""
        return self.setups["VOLT" if self.function.name == "VOLT:RAT" else self.function.name]

    def start(self, *, stored: bool) -> _Sequence:
        """Leave idle."""
        if self.sequence is not None:
            raise ScpiError(-213)
        if stored:
            self.memory = []
        self.sequence = _Sequence(self.trigger_count, self.sample_count, stored, self.clock.now() + _ARMING_S)
        if self.trigger_source == "IMM":
            self.fire()
        elif self.external_pending:
            self.external_pending = False
            self.fire()
        return self.sequence

    def waiting(self) -> bool:
        """Whether a trigger would be taken."""
        return self.sequence is not None and not self.sequence.triggered

    def fire(self) -> None:
        """Take a trigger."""
        sequence = self.sequence
        if sequence is None:
            return
        sequence.triggered = True
        sequence.samples = self.sample_count
        self._start_reading(sequence)

    def external_trigger(self) -> None:
        """The external trigger input: taken in wait-for-trigger, one is kept while measuring, none in idle."""
        self.service()
        if self.trigger_source != "EXT" or self.sequence is None:
            return
        if self.waiting():
            if self.clock.now() >= self.sequence.armed_s:
                self.fire()
        else:
            self.external_pending = True

    def delay_s(self) -> float:
        """Return the delay between trigger and measurement."""
        if not self.delay_auto:
            return self.trigger_delay_s
        return self.function.auto_delay_s(self.setup.nplc, self.bandwidth_hz, self.setup.range)

    def _start_reading(self, sequence: _Sequence) -> None:
        setup, function = self.setup, self.function
        start = max(self.clock.now(), sequence.armed_s)
        if setup.auto and function.ranges:
            better = self.inputs.autorange(function, setup.range)
            start += function.autorange_s if better != setup.range else 0.0
            setup.range = better
        sequence.current = self.inputs.begin(
            function,
            start + self.delay_s(),
            range_=setup.range,
            nplc=setup.nplc,
            aperture_s=setup.aperture_s,
            autozero=self.autozero,
            high_impedance=self.high_impedance,
        )

    def _finish_reading(self, sequence: _Sequence) -> None:
        assert sequence.current is not None  # noqa: S101  (service looked)
        value = sequence.current.value()
        sequence.current = None
        if abs(value) >= OVERLOAD:
            self._show_overload()
        self._keep(sequence, self._through_math(value))
        sequence.samples -= 1
        if sequence.samples > 0:
            self._start_reading(sequence)
        else:
            self._finish_trigger(sequence)

    def _show_overload(self) -> None:
        """An overload sets its QUEStionable bit and DDE, and queues nothing (p. 173)."""
        self.questionable.latch(self.function.overload_bit)
        self.engine.status.esr |= 8

    def _through_math(self, value: float) -> float:
        if not self.math.on:
            return value
        result = self.math.apply(value)
        self.questionable.latch(result.limit_bits)
        if result.error is not None:
            self.engine.report(result.error)
        return result.value

    def _keep(self, sequence: _Sequence, value: float) -> None:
        if not sequence.stored:
            sequence.readings.append(value)
        elif self.feed:
            self.memory.append(value)

    def _finish_trigger(self, sequence: _Sequence) -> None:
        sequence.triggers -= 1
        sequence.triggered = False
        if sequence.triggers <= 0:
            self.sequence = None
        elif self.trigger_source == "IMM" or self.external_pending:
            self.external_pending = False
            self.fire()

    # --- settings -----------------------------------------------------------------------------------------

    def choose(self, function: Function) -> None:
        """Go to `function`; math goes off with a change (-221 when it was on and does not go with it, p. 124)."""
        if function is self.function:
            return
        self.function = function
        self.memory = []
        was_on, self.math.on = self.math.on, False
        if was_on and function.name not in _MATH_RULES[self.math.operation]:
            raise ScpiError(-221)

    def configure(self, function: Function, expected: Any, resolution: Any) -> None:
        """CONFigure (p. 111-113): preset, function, range, resolution.

        Raises:
            ScpiError: -221 for a resolution together with autorange, -222 beyond the top range, 532 for a resolution
                that cannot be had.
        """
        setup = _Setup(function.default_range)
        if not function.ranges:
            _configure_gate(setup, function, expected, resolution)
        elif expected is None or expected is Special.DEF:
            if resolution not in (None, Special.DEF):
                raise ScpiError(-221)
        else:
            setup.auto = False
            setup.range = function.range_for(_expected(function, expected))
            setup.resolution = _fraction(function, setup.range, resolution)
            setup.nplc = function.nplc_for(setup.resolution)
        self.function = function
        self.preset_trigger()
        self.bandwidth_hz = 20.0
        self.setups["VOLT" if function.name == "VOLT:RAT" else function.name] = setup
        self.autozero = setup.nplc >= 1.0


class _Calibration:
    """The calibration memory: guarded by a code (p. 146); adjusting changes nothing here."""

    def __init__(self) -> None:
        self.secured = True
        self.code = "HP034401"
        self.count = 1
        self.text = ""
        self.value = 0.0

    def require_unsecured(self) -> None:
        """Raise 702 while secured."""
        if self.secured:
            raise ScpiError(702)


def _expected(function: Function, expected: Any) -> float:
    if isinstance(expected, Special):
        return function.ranges[0] if expected is Special.MIN else function.ranges[-1]
    return float(expected)


def _fraction(function: Function, range_: float, resolution: Any) -> float:
    """Return the resolution as a fraction of the range, the coarsest attainable one that is fine enough (p. 55)."""
    legal = function.resolutions
    if resolution in (None, Special.DEF):
        return 1e-6
    if isinstance(resolution, Special):
        return min(legal) if resolution is Special.MIN else max(legal)
    wanted = resolution / range_
    fine_enough = [fraction for fraction in legal if fraction <= wanted * (1 + 1e-9)]
    if not fine_enough:
        raise ScpiError(532)
    return max(fine_enough)


def _configure_gate(setup: _Setup, function: Function, expected: Any, resolution: Any) -> None:
    """Frequency, period, continuity and diode have one range; a resolution picks the gate time (p. 61)."""
    if isinstance(expected, float) and not function.lowest <= expected <= function.highest:
        raise ScpiError(-222)
    if isinstance(resolution, Special) or resolution is None:
        setup.aperture_s = 1.0 if resolution is Special.MIN else 0.01 if resolution is Special.MAX else 0.1
        return
    wanted = resolution / (expected if isinstance(expected, float) else function.default_range)
    gates = [aperture for aperture, fraction in APERTURES_S.items() if fraction <= wanted * (1 + 1e-9)]
    if not gates:
        raise ScpiError(532)
    setup.aperture_s = min(gates)


# --- handlers: measuring ----------------------------------------------------------------------------------


def _require_remote(meter: Hp34401A) -> None:
    if meter.local and meter.engine.interface is RS232:
        raise ScpiError(550)


def _running(meter: Hp34401A, sequence: _Sequence, finish: Callable[[], Any]) -> Pending:
    """Return what keeps the parser busy until `sequence` is through."""
    return Pending(lambda: meter.clock.now() if meter.sequence is not sequence else None, finish)


def _read(meter: Hp34401A) -> Pending:
    _require_remote(meter)
    if meter.trigger_source == "BUS":
        raise ScpiError(-214)
    sequence = meter.start(stored=False)
    return _running(meter, sequence, lambda: sequence.readings)


def _initiate(meter: Hp34401A) -> Pending:
    if meter.sample_count * meter.trigger_count > _MEMORY:
        raise ScpiError(531)
    return _running(meter, meter.start(stored=True), lambda: None)


def _fetch(meter: Hp34401A) -> list[float]:
    if not meter.memory:
        raise ScpiError(-230)
    return meter.memory


def _trigger(meter: Hp34401A) -> None:
    if meter.trigger_source != "BUS" or not meter.waiting():
        raise ScpiError(-211)
    meter.fire()


def _configure(function: Function) -> Callable[..., None]:
    def configure(meter: Hp34401A, expected: Any = None, resolution: Any = None) -> None:
        meter.configure(function, expected, resolution)

    return configure


def _measure(function: Function) -> Callable[..., Pending]:
    def measure(meter: Hp34401A, expected: Any = None, resolution: Any = None) -> Pending:
        meter.configure(function, expected, resolution)
        return _read(meter)

    return measure


def _configuration(meter: Hp34401A) -> str:
    setup, function = meter.setup, meter.function
    resolution = _gate_resolution(setup, function) if not function.ranges else setup.resolution * setup.range
    return f"{function.name} {_NR3(setup.range)},{_NR3(resolution)}"


def _gate_resolution(setup: _Setup, function: Function) -> float:
    return setup.range * (APERTURES_S[setup.aperture_s] if function.gated else setup.resolution)


def _set_function(meter: Hp34401A, name: str) -> None:
    meter.choose(_function_named(name))


def _function_named(text: str) -> Function:
    """Return the function a string names, in short or long forms, `:DC` being optional."""
    words = tuple(text.strip().upper().split(":"))
    for function in BY_NAME.values():
        if any(_spells(words, spelling) for spelling in function.spellings):
            return function
    raise ScpiError(-224)


def _spells(words: tuple[str, ...], spelling: str) -> bool:
    nodes = [Mnemonic.parse(node) for node in spelling.split(":")]
    return len(nodes) == len(words) and all(word in node.spellings for word, node in zip(words, nodes, strict=True))


def _function(meter: Hp34401A) -> str:
    return meter.function.name


# --- handlers: ranges, resolution, integration ------------------------------------------------------------


def _set_range(name: str) -> Callable[..., None]:
    def write(meter: Hp34401A, value: float) -> None:
        setup = meter.setups[name]
        setup.range = BY_NAME[name].voltage_ranged.range_for(value)
        setup.auto = False

    return write


def _range(name: str) -> Callable[..., float]:
    return lambda meter: float(meter.setups[name].range)


def _set_auto(name: str) -> Callable[..., None]:
    def write(meter: Hp34401A, state: object) -> None:
        meter.setups[name].auto = bool(state)

    return write


def _auto(name: str) -> Callable[..., bool]:
    return lambda meter: bool(meter.setups[name].auto)


def _resolution_limits(name: str) -> Callable[[Hp34401A], Limits]:
    legal = BY_NAME[name].resolutions
    return lambda meter: Limits(min(legal) * meter.setups[name].range, max(legal) * meter.setups[name].range)


def _set_resolution(name: str) -> Callable[..., None]:
    def write(meter: Hp34401A, value: Any) -> None:
        setup, function = meter.setups[name], BY_NAME[name]
        setup.resolution = _fraction(function, setup.range, value)
        setup.nplc = function.nplc_for(setup.resolution)

    return write


def _resolution(name: str) -> Callable[..., float]:
    return lambda meter: float(meter.setups[name].resolution * meter.setups[name].range)


def _set_nplc(name: str) -> Callable[..., None]:
    def write(meter: Hp34401A, cycles: float) -> None:
        meter.setups[name].nplc = cycles
        meter.setups[name].resolution = RESOLUTIONS[cycles]

    return write


def _nplc(name: str) -> Callable[..., float]:
    return lambda meter: float(meter.setups[name].nplc)


def _set_aperture(name: str) -> Callable[..., None]:
    def write(meter: Hp34401A, seconds: float) -> None:
        meter.setups[name].aperture_s = seconds

    return write


def _aperture(name: str) -> Callable[..., float]:
    return lambda meter: float(meter.setups[name].aperture_s)


def _set_bandwidth(meter: Hp34401A, hertz: float) -> None:
    """A filter is chosen that is slow enough for `hertz` (p. 115)."""
    meter.bandwidth_hz = 200.0 if hertz >= 200.0 else 20.0 if hertz >= 20.0 else 3.0


def _bandwidth(meter: Hp34401A) -> float:
    return meter.bandwidth_hz


def _set_autozero(meter: Hp34401A, state: object) -> None:
    meter.autozero = state is True


def _autozero(meter: Hp34401A) -> bool:
    return meter.autozero


def _set_impedance(meter: Hp34401A, state: object) -> None:
    meter.high_impedance = bool(state)


def _impedance(meter: Hp34401A) -> bool:
    return meter.high_impedance


def _terminals(meter: Hp34401A) -> str:
    del meter
    return "FRON"


# --- handlers: math ---------------------------------------------------------------------------------------


def _set_math(meter: Hp34401A, operation: str) -> None:
    if meter.math.on and meter.function.name not in _MATH_RULES[operation]:
        meter.math.on = False
        raise ScpiError(-221)
    meter.math.choose(operation)


def _math(meter: Hp34401A) -> str:
    return meter.math.operation


def _set_math_state(meter: Hp34401A, state: object) -> None:
    if state and meter.function.name not in _MATH_RULES[meter.math.operation]:
        meter.math.on = False
        raise ScpiError(-221)
    meter.math.switch(on=bool(state))


def _math_state(meter: Hp34401A) -> bool:
    return meter.math.on


def _null_limits(meter: Hp34401A) -> Limits:
    top = 1.2 * (meter.function.ranges[-1] if meter.function.ranges else meter.function.highest)
    return Limits(-top, top)


def _require_math(meter: Hp34401A) -> None:
    """Null and dB registers can be written only while math is on; the error number is unverified."""
    if not meter.math.on:
        raise ScpiError(-221)


def _set_null(meter: Hp34401A, value: float) -> None:
    _require_math(meter)
    meter.math.null_offset = value


def _set_db(meter: Hp34401A, value: float) -> None:
    _require_math(meter)
    meter.math.db_reference = value


def _set_dbm(meter: Hp34401A, value: float) -> None:
    meter.math.dbm_reference = value


def _set_lower(meter: Hp34401A, value: float) -> None:
    meter.math.lower = value


def _set_upper(meter: Hp34401A, value: float) -> None:
    meter.math.upper = value


# --- handlers: memory and trigger -------------------------------------------------------------------------


def _set_feed(meter: Hp34401A, destination: str, source: str) -> None:
    del destination
    if source and source.upper() not in ("CALC", "CALCULATE"):
        raise ScpiError(-224)
    meter.feed = "CALC" if source else ""


def _feed(meter: Hp34401A, destination: str | None) -> str:
    del destination
    return meter.feed


def _points(meter: Hp34401A) -> int:
    return len(meter.memory)


def _set_source(meter: Hp34401A, source: str) -> None:
    meter.trigger_source = source


def _source(meter: Hp34401A) -> str:
    return meter.trigger_source


def _set_delay(meter: Hp34401A, seconds: float) -> None:
    meter.trigger_delay_s = round(seconds, 5)
    meter.delay_auto = False


def _delay(meter: Hp34401A) -> float:
    return meter.delay_s()


def _set_delay_auto(meter: Hp34401A, state: object) -> None:
    meter.delay_auto = bool(state)


def _delay_auto(meter: Hp34401A) -> bool:
    return meter.delay_auto


def _set_samples(meter: Hp34401A, count: int) -> None:
    meter.sample_count = count


def _samples(meter: Hp34401A) -> int:
    return meter.sample_count


def _set_triggers(meter: Hp34401A, count: float) -> None:
    meter.trigger_count = float(count)


def _triggers(meter: Hp34401A) -> float:
    return meter.trigger_count


# --- handlers: display, system, calibration ---------------------------------------------------------------


def _set_display(meter: Hp34401A, state: object) -> None:
    meter.display_on = bool(state)


def _display(meter: Hp34401A) -> bool:
    return meter.display_on


def _set_text(meter: Hp34401A, text: str) -> None:
    meter.display_text = text[:12]


def _text(meter: Hp34401A) -> str:
    return meter.display_text


def _clear_text(meter: Hp34401A) -> None:
    meter.display_text = ""


def _nothing(meter: Hp34401A) -> None:
    del meter


def _set_beeper(meter: Hp34401A, state: object) -> None:
    meter.beeper = bool(state)


def _beeper(meter: Hp34401A) -> bool:
    return meter.beeper


def _version(meter: Hp34401A) -> str:
    del meter
    return "1991.0"


def _require_rs232(meter: Hp34401A) -> None:
    if meter.engine.interface is not RS232:
        raise ScpiError(514)


def _go_local(meter: Hp34401A) -> None:
    _require_rs232(meter)
    meter.local = True


def _go_remote(meter: Hp34401A) -> None:
    _require_rs232(meter)
    meter.local = False


def _self_test(meter: Hp34401A) -> str:
    meter.memory = []
    return "+0"


def _preset_status(meter: Hp34401A) -> None:
    meter.questionable.enable = 0


def _language(meter: Hp34401A) -> None:
    """L1 is SCPI; L2 (HP3478A) and L3 (Fluke 8840) are accepted on GPIB only and not simulated."""
    if meter.engine.interface is RS232:
        raise ScpiError(-113)


def _calibrate(meter: Hp34401A) -> str:
    meter.calibration.require_unsecured()
    meter.calibration.count += 1
    return "+0"


def _calibration_count(meter: Hp34401A) -> int:
    return meter.calibration.count


def _set_code(meter: Hp34401A, code: str) -> None:
    meter.calibration.require_unsecured()
    meter.calibration.code = code


def _set_secured(meter: Hp34401A, state: object, code: str) -> None:
    if code != meter.calibration.code:
        raise ScpiError(703)
    meter.calibration.secured = bool(state)


def _secured(meter: Hp34401A) -> bool:
    return meter.calibration.secured


def _set_calibration_text(meter: Hp34401A, text: str) -> None:
    meter.calibration.require_unsecured()
    meter.calibration.text = text


def _calibration_text(meter: Hp34401A) -> str:
    return meter.calibration.text


def _set_calibration_value(meter: Hp34401A, value: float) -> None:
    meter.calibration.require_unsecured()
    meter.calibration.value = value


def _calibration_value(meter: Hp34401A) -> float:
    return meter.calibration.value


# --- the command list (p. 105-147) ------------------------------------------------------------------------

_INTERFACES = {"gpib": GPIB, "rs232": RS232}
_DIALECT = Dialect(queue_depth=20, words={-350: "Too many errors"}, number_not_allowed=-104)
_NR3 = real(8)
_READINGS = comma_list(_NR3)
_ON_OFF = (Boolean(),)
_DBM_OHMS = (50, 75, 93, 110, 124, 125, 135, 150, 250, 300, 500, 600, 800, 900, 1000, 1200, 8000)


def _measurement_commands(function: Function) -> tuple[Command, ...]:
    """Declare CONFigure and MEASure of one function: `[<range>[,<resolution>]]`."""
    number = Number(unit=function.unit, required=False, deferred=True)
    parameters = () if function.name in ("CONT", "DIOD") else (number, number)
    return (
        Command(f"CONFigure:{function.header}", parameters, do=_configure(function), takes_s=_FUNCTION_CHANGE_S),
        Command(
            f"MEASure:{function.header}",
            query=_measure(function),
            query_parameters=parameters,
            reply=_READINGS,
            query_takes_s=_FUNCTION_CHANGE_S,
        ),
    )


def _range_commands(name: str, header: str) -> tuple[Command, ...]:
    """Declare RANGe and RANGe:AUTO of one function; limits are the lowest range and the top one with its over-range."""
    ranged = BY_NAME[name].voltage_ranged
    number = Number(unit=ranged.unit, limits=Limits(0.0, ranged.ranges[-1] * ranged.over_range))
    shown = Choice(("MINimum", "MAXimum"), required=False)
    bounds = {"MIN": ranged.ranges[0], "MAX": ranged.ranges[-1]}

    def read(meter: Hp34401A, which: str | None) -> float:
        return bounds[which] if which else float(meter.setups[name].range)

    return (
        Command(
            f"[SENSe:]{header}:RANGe[:UPPer]",
            (number,),
            do=_set_range(name),
            query=read,
            query_parameters=(shown,),
            reply=_NR3,
            takes_s=_RANGE_CHANGE_S,
        ),
        Command(f"[SENSe:]{header}:RANGe:AUTO", _ON_OFF, do=_set_auto(name), query=_auto(name), reply=boolean),
    )


def _resolution_command(name: str, header: str) -> Command:
    limits = _resolution_limits(name)
    return Command(
        f"[SENSe:]{header}:RESolution",
        (Number(unit=BY_NAME[name].unit, deferred=True),),
        do=_set_resolution(name),
        query=_limited(_resolution(name), limits),
        query_parameters=(Choice(("MINimum", "MAXimum"), required=False),),
        reply=_NR3,
    )


def _limited(value: Callable[..., float], limits: Callable[[Hp34401A], Limits]) -> Callable[..., float]:
    def read(meter: Hp34401A, which: str | None) -> float:
        if which is None:
            return value(meter)
        bounds = limits(meter)
        return bounds.minimum if which == "MIN" else bounds.maximum

    return read


def _nplc_command(name: str, header: str) -> Command:
    number = Number(limits=Limits(0.02, 100.0), legal=tuple(RESOLUTIONS))
    return Command(f"[SENSe:]{header}:NPLCycles", (number,), do=_set_nplc(name), query=_nplc(name), reply=_NR3)


def _aperture_command(name: str, header: str) -> Command:
    number = Number(unit="S", limits=Limits(0.01, 1.0), legal=tuple(APERTURES_S))
    return Command(f"[SENSe:]{header}:APERture", (number,), do=_set_aperture(name), query=_aperture(name), reply=_NR3)


def _math_value(attribute: str) -> Callable[..., float]:
    return lambda meter: float(getattr(meter.math, attribute) or 0.0)


def _statistic(name: str) -> Callable[..., float]:
    return lambda meter: float(getattr(meter.math, name)())


_RANGED = {
    "VOLT": "VOLTage[:DC]",
    "VOLT:AC": "VOLTage:AC",
    "CURR": "CURRent[:DC]",
    "CURR:AC": "CURRent:AC",
    "RES": "RESistance",
    "FRES": "FRESistance",
}
_INTEGRATING = ("VOLT", "CURR", "RES", "FRES")

TABLE = CommandTable(
    *COMMON_COMMANDS,
    # measuring
    *(command for function in BY_NAME.values() for command in _measurement_commands(function)),
    Command("CONFigure", query=_configuration, reply=quoted),
    Command("READ", query=_read, reply=_READINGS),
    Command("INITiate[:IMMediate]", do=_initiate),
    Command("FETCh", query=_fetch, reply=_READINGS),
    # function, range, resolution, integration
    Command("[SENSe:]FUNCtion", (Text(),), do=_set_function, query=_function, reply=quoted, takes_s=_FUNCTION_CHANGE_S),
    *(command for name, header in _RANGED.items() for command in _range_commands(name, header)),
    *_range_commands("FREQ", "FREQuency:VOLTage"),
    *_range_commands("PER", "PERiod:VOLTage"),
    *(_resolution_command(name, header) for name, header in _RANGED.items()),
    *(_nplc_command(name, _RANGED[name]) for name in _INTEGRATING),
    _aperture_command("FREQ", "FREQuency"),
    _aperture_command("PER", "PERiod"),
    Command(
        "[SENSe:]DETector:BANDwidth",
        (Number(unit="HZ", limits=Limits(3.0, 200.0)),),
        do=_set_bandwidth,
        query=_bandwidth,
        reply=_NR3,
    ),
    Command("[SENSe:]ZERO:AUTO", (Boolean(words=("ONCE",)),), do=_set_autozero, query=_autozero, reply=boolean),
    Command("INPut:IMPedance:AUTO", _ON_OFF, do=_set_impedance, query=_impedance, reply=boolean),
    Command("ROUTe:TERMinals", query=_terminals),
    # math
    Command("CALCulate:FUNCtion", (Choice(("NULL", "DB", "DBM", "AVERage", "LIMit")),), do=_set_math, query=_math),
    Command("CALCulate:STATe", _ON_OFF, do=_set_math_state, query=_math_state, reply=boolean),
    Command("CALCulate:AVERage:MINimum", query=_statistic("minimum"), reply=_NR3),
    Command("CALCulate:AVERage:MAXimum", query=_statistic("maximum"), reply=_NR3),
    Command("CALCulate:AVERage:AVERage", query=_statistic("average"), reply=_NR3),
    Command("CALCulate:AVERage:COUNt", query=_statistic("count"), reply=_NR3),
    Command(
        "CALCulate:NULL:OFFSet",
        (Number(unit=("V", "A", "OHM", "HZ", "S"), limits=_null_limits),),
        do=_set_null,
        query=_math_value("null_offset"),
        reply=_NR3,
    ),
    Command(
        "CALCulate:DB:REFerence",
        (Number(unit="DBM", limits=Limits(-200.0, 200.0)),),
        do=_set_db,
        query=_math_value("db_reference"),
        reply=_NR3,
    ),
    Command(
        "CALCulate:DBM:REFerence",
        (Number(unit="OHM", limits=Limits(50.0, 8000.0), legal=_DBM_OHMS),),
        do=_set_dbm,
        query=_math_value("dbm_reference"),
        reply=_NR3,
    ),
    Command(
        "CALCulate:LIMit:LOWer",
        (Number(unit=("V", "A", "OHM", "HZ", "S"), limits=_null_limits),),
        do=_set_lower,
        query=_math_value("lower"),
        reply=_NR3,
    ),
    Command(
        "CALCulate:LIMit:UPPer",
        (Number(unit=("V", "A", "OHM", "HZ", "S"), limits=_null_limits),),
        do=_set_upper,
        query=_math_value("upper"),
        reply=_NR3,
    ),
    # memory and trigger
    Command(
        "DATA:FEED",
        (Choice(("RDG_STORE",)), Text()),
        do=_set_feed,
        query=_feed,
        query_parameters=(Choice(("RDG_STORE",), required=False),),
        reply=quoted,
    ),
    Command("DATA:POINts", query=_points, reply=signed_integer),
    Command("TRIGger:SOURce", (Choice(("BUS", "IMMediate", "EXTernal")),), do=_set_source, query=_source),
    Command("TRIGger:DELay", (Number(unit="S", limits=Limits(0.0, 3600.0)),), do=_set_delay, query=_delay, reply=_NR3),
    Command("TRIGger:DELay:AUTO", _ON_OFF, do=_set_delay_auto, query=_delay_auto, reply=boolean),
    Command(
        "TRIGger:COUNt",
        (Integer(limits=Limits(1, 50000), words={"INFinity": float("inf")}),),
        do=_set_triggers,
        query=_triggers,
        reply=_NR3,
    ),
    Command("SAMPle:COUNt", (Integer(limits=Limits(1, 50000)),), do=_set_samples, query=_samples, reply=signed_integer),
    Command("*TRG", do=_trigger, urgent=True),
    # display and system
    Command("DISPlay[:WINDow][:STATe]", _ON_OFF, do=_set_display, query=_display, reply=boolean),
    Command("DISPlay[:WINDow]:TEXT[:DATA]", (Text(),), do=_set_text, query=_text, reply=quoted),
    Command("DISPlay[:WINDow]:TEXT:CLEar", do=_clear_text),
    Command("SYSTem:BEEPer[:IMMediate]", do=_nothing),
    Command("SYSTem:BEEPer:STATe", _ON_OFF, do=_set_beeper, query=_beeper, reply=boolean),
    Command("SYSTem:VERSion", query=_version),
    Command("SYSTem:LOCal", do=_go_local),
    Command("SYSTem:REMote", do=_go_remote),
    Command("SYSTem:RWLock", do=_go_remote),
    Command("*TST", query=_self_test, query_takes_s=_SELF_TEST_S),
    Command("L1", do=_language),
    Command("L2", do=_language),
    Command("L3", do=_language),
    # status
    event("STATus:QUEStionable[:EVENt]", lambda meter: meter.questionable),
    enable("STATus:QUEStionable:ENABle", lambda meter: meter.questionable),
    Command("STATus:PRESet", do=_preset_status),
    # calibration
    Command("CALibration", query=_calibrate),
    Command("CALibration:COUNt", query=_calibration_count, reply=signed_integer),
    Command("CALibration:SECure:CODE", (Word(word_too_long=704),), do=_set_code),
    Command("CALibration:SECure:STATe", (Boolean(), Word()), do=_set_secured, query=_secured, reply=boolean),
    Command("CALibration:STRing", (Text(limit=40),), do=_set_calibration_text, query=_calibration_text, reply=quoted),
    Command("CALibration:VALue", (Number(),), do=_set_calibration_value, query=_calibration_value, reply=_NR3),
)
