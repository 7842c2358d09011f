"""Simulated 34401A multimeter: settings of its functions, and the making of a reading.

Source: HP 34401A User's Guide 34401-90004, ed. 4, 1996 (p. 51-101 functions, 105-147 commands, 173-182 errors,
216-227 specifications). What the guide leaves open is marked *unverified*. The parts: `functions` what there is to
measure, `setup` settings, `inputs` readings, `ac`, `counter`, `ohms`, `current` their physics,
`errors` the specimen, `calibration`, `trigger`, `calculation`, and `commands` what it understands.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

from simrack import scpi
from simrack.instruments.hp34401a import ohms
from simrack.instruments.hp34401a.calculation import MATH_RULES, OVERLOAD, Math
from simrack.instruments.hp34401a.calibration import CalibrationMemory, MeterCalibration
from simrack.instruments.hp34401a.functions import BY_NAME, Function
from simrack.instruments.hp34401a.imperfections import MeterErrors
from simrack.instruments.hp34401a.inputs import FAST_APERTURES_S, Inputs, MeasuringConditions, MeterReading
from simrack.instruments.hp34401a.setup import Setup, configured
from simrack.instruments.hp34401a.trigger import TriggerSystem
from simrack.scpi import CommandTable, Interface
from simrack.specifications import HP_34401A, VoltmeterSpecification

__all__ = ["MeterErrors", "SimulatedHp34401A"]

_DIALECT = scpi.Dialect(
    queue_depth=20,
    words={-350: "Too many errors"},
    number_not_allowed=-104,
    input_buffer=100,
    output_queue=1024,
    takes_blocks=False,
)
"""The input buffer of about 100 characters is that of RS-232; that it is the same on GPIB is unverified."""
_NR3 = scpi.real(8)
_CALIBRATION_FILTER_HZ = 3.0
_SCPI = 1
_OPEN_V = 3e-6
"""What terminals read that nothing is on (unverified)."""
_WAY_BACK = re.compile(rb"(?i)\bL1\b")


class SimulatedHp34401A(scpi.ScpiTwin):
    """The meter.

    Args:
        world: the World, or leads to it.
        node: the node on its input terminals.
        errors: imperfections of this specimen.
        mains_hz: line frequency, which sets what a power line cycle is (sensed at power-on; 400 Hz counts as 50).
        sense: the node on its sense terminals, for ratios and four-wire resistance; None leaves them open.
        interface: "gpib" or "rs232", one of which is selected on the front panel; None is the usual one, the first.
        model: what it calls itself, where it stands for a meter that speaks the same words.
    """

    own_name: ClassVar = "34401A"
    errors_class: ClassVar = MeterErrors
    interfaces: ClassVar[Mapping[str, Interface]] = MappingProxyType({"gpib": scpi.GPIB, "rs232": scpi.RS232})
    functions: ClassVar[Mapping[str, Function]] = BY_NAME
    table: ClassVar[CommandTable]
    dialect: ClassVar[scpi.Dialect] = _DIALECT
    fast_apertures_s: ClassVar[Mapping[float, float]] = FAST_APERTURES_S

    def __init__(
        self,
        world: Any,
        *,
        node: str = "output",
        errors: MeterErrors,
        mains_hz: float = 50.0,
        sense: str | None = None,
        interface: str | None = None,
        model: str | None = None,
    ) -> None:
        self._model = model or self.own_name
        self.world = world
        self.clock = world.clock
        self.line_hz = 60 if mains_hz == 60.0 else 50
        self.inputs = Inputs(
            world,
            node,
            errors,
            mains_hz=50.0 if mains_hz > 360.0 else mains_hz,
            sense=sense,
            fast_apertures_s=self.fast_apertures_s,
            sheet=self.data_sheet(),
        )
        self.questionable = scpi.Register()
        status = scpi.Status({3: self.questionable})
        self.engine = scpi.ScpiEngine(
            self,
            self.table,
            world.clock,
            dialect=self.dialect,
            interface=self.interfaces[interface or next(iter(self.interfaces))],
            status=status,
        )
        self.math = Math()
        self.triggering = self.made_trigger_system()
        self.calibration = CalibrationMemory()
        self.local = True
        self.language = _SCPI
        """1 is SCPI, 2 that of the HP 3478A, 3 of the Fluke 8840A; non-volatile. Only SCPI is simulated."""
        self.rear = False
        """Whether the front panel's switch selects the rear terminals, on which there is nothing."""
        self.beeper = True
        self.beeps = 0
        self._calibrating = False
        self.power_on()

    def power_on(self) -> None:
        """Be as after *RST."""
        self.reset()

    def data_sheet(self) -> VoltmeterSpecification:
        """Return the data sheet of the model's direct voltages."""
        return HP_34401A

    def made_trigger_system(self) -> TriggerSystem:
        """Return the trigger system of the model."""
        return TriggerSystem(self.clock, self._begin_reading, self._finish_reading, self.engine.work_out)

    # --- what the engine asks -----------------------------------------------------------------------------

    def identity(self) -> str:
        """Return the identity; the firmware numbers are typical, unverified."""
        return f"HEWLETT-PACKARD,{self._model},0,11-5-2"

    def reset(self) -> None:
        """*RST (p. 101)."""
        self.setups = {name: Setup.of(function) for name, function in self.functions.items() if name != "VOLT:RAT"}
        self._turn_to(self.functions["VOLT"])
        self.bandwidth_hz = 20.0
        self.autozero = True
        self.display_on = True
        self.display_text = ""
        self.preset_trigger()
        self.math.reset()

    def preset_trigger(self) -> None:
        """Take the settings that *RST, CONFigure and MEASure share (p. 112)."""
        self.triggering.preset()
        self.high_impedance = False
        self.math.on = False

    def service(self) -> None:
        """Finish readings that are due and start the next ones."""
        if self.triggering.sequence is not None:
            self.triggering.service()

    def next_event_s(self) -> float | None:
        """Return when the running reading ends."""
        sequence = self.triggering.sequence
        return None if sequence is None or sequence.current is None else sequence.current.end_s

    def abort(self) -> None:
        """Device clear: the trigger system goes idle (p. 116), a calibration is given up (705)."""
        self.triggering.abort()
        if self._calibrating:
            self._calibrating = False
            self.engine.report(scpi.ScpiError(705))

    def write(self, data: bytes, *, end: bool = False) -> None:
        """Take bytes; in another language only the command back to SCPI is simulated."""
        if self.language != _SCPI and _WAY_BACK.search(data):
            self.language = _SCPI
        elif self.language == _SCPI:
            self.engine.write(data, end=end)

    def read(self, limit: int) -> tuple[bytes, bool]:
        """Return at most `limit` bytes that are ready."""
        return self.engine.read(limit) if self.language == _SCPI else (b"", False)

    # --- measuring ----------------------------------------------------------------------------------------

    @property
    def setup(self) -> Setup:
        """The settings of the present function; the ratio shares those of dc voltage."""
        return self.setups["VOLT" if self.function.name == "VOLT:RAT" else self.function.name]

    def external_trigger(self) -> None:
        """The external trigger input."""
        self.service()
        self.triggering.external()

    def delay_s(self) -> float:
        """Return the delay between trigger and measurement."""
        if not self.triggering.delay_auto:
            return self.triggering.delay_s
        return self.function.auto_delay_s(self.setup.nplc, self.bandwidth_hz, self.setup.range)

    def _begin_reading(self, start_s: float) -> MeterReading:
        setup, function = self.setup, self.function
        if setup.auto and function.ranges and function.name != "VOLT:AC":
            better = self.inputs.autorange(function, setup.range)
            start_s += function.autorange_s if better != setup.range else 0.0
            setup.range = better
        conditions = MeasuringConditions(self.autozero, self.high_impedance, self.bandwidth_hz, self.delay_s())
        return self.inputs.begin(function, start_s, setup, conditions)

    def read_at_terminals(self, value: float) -> float:
        """Return what the selected terminals give where those at the front give `value`; open ones a few uV."""
        return _OPEN_V if self.rear else value

    def _finish_reading(self, value: float) -> float:
        value = self.read_at_terminals(value)
        if abs(value) >= OVERLOAD:
            self._show_overload()
        self._sound(value)
        if not self.math.on:
            return value
        result = self.math.apply(value)
        self.questionable.latch(result.limit_bits)
        if result.error is not None:
            self.engine.report(result.error)
        return result.value

    def _show_overload(self) -> None:
        """An overload sets its QUEStionable bit and DDE, and queues nothing (p. 173)."""
        self.questionable.latch(self.function.overload_bit)
        self.engine.status.esr |= 8

    def _sound(self, value: float) -> None:
        """Continuity and diode test beep; nothing on the bus tells of it."""
        low, high = ohms.BEEP_DIODE_V
        closed = self.function.name == "CONT" and value <= ohms.BEEP_OHM
        good = self.function.name == "DIOD" and low <= value <= high
        self.beeps += self.beeper and (closed or good)

    # --- settings -----------------------------------------------------------------------------------------

    def choose(self, function: Function) -> None:
        """Select `function`; this switches math off (-221 if the function does not allow it, p. 124)."""
        if function is self.function:
            return
        self._turn_to(function)
        self.triggering.memory = []
        was_on, self.math.on = self.math.on, False
        if was_on and function.name not in MATH_RULES[self.math.operation]:
            raise scpi.ScpiError(-221)

    def configure(self, function: Function, expected: Any, resolution: Any) -> None:
        """CONFigure (p. 111-113): preset, function, range, resolution.

        Raises:
            ScpiError: as :func:`~simrack.instruments.hp34401a.setup.configured` does.
        """
        setup = configured(function, expected, resolution)
        self._turn_to(function)
        self.preset_trigger()
        self.bandwidth_hz = 20.0
        self.setups["VOLT" if function.name == "VOLT:RAT" else function.name] = setup
        self.autozero = setup.nplc >= 1.0

    def _turn_to(self, function: Function) -> None:
        self.function = function
        self.inputs.route(function)

    # --- calibration --------------------------------------------------------------------------------------

    def calibrate(self) -> scpi.Pending:
        """CALibration? (p. 147): adjust the present function and range to the given value.

        Raises:
            ScpiError: 702 while secured, and what :class:`MeterCalibration` refuses.
        """
        self.calibration.require_unsecured()
        running = MeterCalibration(self.inputs, self.function, self.setup, self.calibration.value)
        delay = self.function.auto_delay_s(100.0, _CALIBRATION_FILTER_HZ, self.setup.range)
        conditions = MeasuringConditions(filter_hz=_CALIBRATION_FILTER_HZ, delay_s=delay)
        return self._attended(running.begin(self.clock.now(), conditions, self._calibrated))

    def _attended(self, pending: scpi.Pending) -> scpi.Pending:
        """Return `pending` such that a device clear meanwhile is known to give up a calibration."""
        self._calibrating = True

        def finish() -> Any:
            self._calibrating = False
            outcome = pending.finish()
            return self._attended(outcome) if isinstance(outcome, scpi.Pending) else outcome

        return scpi.Pending(pending.ready_at, finish)

    def _calibrated(self) -> str:
        self.calibration.count_up()
        return "+0"
