"""Simulated 34461A and 34465A: a 34401A's inputs behind another parser, memory and mathematics.

Source: Keysight Truevolt Series Operating and Service Guide, SCPI Programming Reference. At hand were single pages of
it (p. 197, 221, 223 of Agilent's edition; p. 204, 257, 269, 289, 305, 328, 345, 451 of Keysight's; the help page of the
DATA subsystem) and users' drivers (QCoDeS). What neither has is taken over from the 34401A and unverified: times beside
integration, alternating voltage, ohms and their errors, the errors that a refused value gives, what becomes of a
running measurement when a setting is changed (here it is ended, as the readings are forgotten).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import deepcopy
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from simrack import specifications
from simrack.instruments.hp34401a.calculation import OVERLOAD
from simrack.instruments.hp34401a.functions import Function
from simrack.instruments.hp34401a.imperfections import MeterErrors
from simrack.instruments.hp34401a.instrument import SimulatedHp34401A
from simrack.instruments.hp34401a.trigger import TriggerSystem
from simrack.instruments.truevolt.kinds import MeterKind
from simrack.instruments.truevolt.mathematics import LimitTest, Null, Recent, Statistics, scaled
from simrack.instruments.truevolt.memory import RingTriggerSystem
from simrack.scpi import GPIB, LAN, USB, Dialect, Interface, Register
from simrack.specifications import VoltmeterSpecification

_DIALECT = Dialect(queue_depth=20, words={-350: "Error queue overflow"}, takes_blocks=False)
"""Depth and words are unverified."""
_OVERFLOW = 1 << 14
"""QUEStionable bit of a memory that overflowed (guide p. 306)."""
_SMOOTHED = {"FAST": 10, "MED": 50, "SLOW": 100}
"""Readings that smoothing means (general knowledge, unverified)."""
_SERIAL_NUMBER = "MY54500001"
_OFFSET_RANGE_V = 10.0
_SCALING = "CALCulate:SCALe[:STATe]"
_PRESET = ("CALCulate:SMOothing[:STATe]", "SAMPle:COUNt:PRETrigger", "TRIGger:LEVel")
"""What CONFigure presets of settings that are only kept; the factors of mathematics stay."""
_STORED = ("setups", "bandwidth_hz", "high_impedance", "_autozero", "aperture_on", "nulls", "limit_test")
_STORED_OF_TRIGGER = (
    *("source", "delay_s", "delay_auto", "sample_count", "trigger_count"),
    *("slope", "paced_by", "interval_s"),
)
"""Settings that *SAV stores (unverified)."""


def errors_of(kind: MeterKind) -> type[MeterErrors]:
    """Return the imperfections of a model: those of a 34401A, in direct voltage drawn from its own data sheet.

    They are drawn from the 1-year accuracy of the 10 V range as two standard deviations.
    """

    class TruevoltErrors(MeterErrors, frozen=True):
        """Imperfections of one specimen."""

        @classmethod
        def drawn(cls, rng: np.random.Generator) -> TruevoltErrors:
            """Return a specimen drawn from the data sheet."""
            # those of direct voltage are scaled and not drawn anew, so that a seed keeps its meaning
            like = MeterErrors.drawn(rng)
            own, classic = (
                each.standard_deviation(_OFFSET_RANGE_V, 365) for each in (kind.sheet, specifications.HP_34401A)
            )
            fields = {name: getattr(like, name) for name in MeterErrors.__struct_fields__}
            gain_error, offset_v = (
                like.gain_error * own.reading / classic.reading,
                like.offset_v * own.range / classic.range,
            )
            return cls(**{**fields, "gain_error": gain_error, "offset_v": offset_v})

    return TruevoltErrors


class SimulatedTruevolt(SimulatedHp34401A):
    """A meter of the series; arguments as of the 34401A, `interface` is "usb", "gpib" or "lan"."""

    kind: ClassVar[MeterKind]
    dialect: ClassVar[Dialect] = _DIALECT
    interfaces: ClassVar[Mapping[str, Interface]] = MappingProxyType({"usb": USB, "gpib": GPIB, "lan": LAN})
    identifies_as = "DEF"
    before_mathematics = math.nan

    def data_sheet(self) -> VoltmeterSpecification:
        """Return the data sheet of the model's direct voltages."""
        return self.kind.sheet

    def made_trigger_system(self) -> TriggerSystem:
        """Return the trigger system: a memory that forgets the oldest readings."""
        self.engine.status.summaries[7] = self.operation = Register()
        self.ring = RingTriggerSystem(
            self.clock,
            self._begin_reading,
            self._finish_reading,
            self.engine.work_out,
            capacity=self.kind.memory,
            overflowed=lambda: self.questionable.latch(_OVERFLOW),
        )
        return self.ring

    # --- what the engine asks -----------------------------------------------------------------------------

    def identity(self) -> str:
        """Return the identity (guide p. 270); the serial number is made up."""
        maker = {"DEF": "Keysight Technologies", "HP34401A": "HEWLETT-PACKARD"}.get(
            self.identifies_as, "Agilent Technologies"
        )
        model = self._model if self.identifies_as == "DEF" else self.identifies_as[2:]
        return f"{maker},{model},{_SERIAL_NUMBER},{self.kind.firmware}"

    def reset(self) -> None:
        """*RST."""
        self._autozero = dict.fromkeys(self.functions, True)
        self.aperture_on = dict.fromkeys(self.functions, False)
        self.nulls = {name: Null() for name in self.functions}
        self.statistics = Statistics()
        self.limit_test = LimitTest()
        self.recent = Recent()
        super().reset()

    def power_on(self) -> None:
        """Be as after *RST; states that were stored are there still."""
        self._states: dict[int, tuple[Function, dict[str, Any], dict[str, Any]]] = {}
        super().power_on()

    def save(self, place: int) -> None:
        """*SAV."""
        own = {name: deepcopy(getattr(self, name)) for name in _STORED}
        self._states[place] = self.function, own, {name: getattr(self.ring, name) for name in _STORED_OF_TRIGGER}

    def recall(self, place: int) -> None:
        """*RCL; that an empty place gives the settings of *RST is unverified."""
        self.reset()
        function, own, of_trigger = self._states.get(place, (self.function, {}, {}))
        self._turn_to(function)
        for name, value in own.items():
            setattr(self, name, deepcopy(value))
        for name, value in of_trigger.items():
            setattr(self.ring, name, value)

    def operations_end_s(self) -> float:
        """*OPC, *OPC? and *WAI wait for a measurement that INITiate has begun."""
        return -math.inf if self.triggering.sequence is None else math.inf

    # --- measuring ----------------------------------------------------------------------------------------

    @property
    def autozero(self) -> bool:
        """True if the present function takes a zero with each reading; the 34401A has one setting for all."""
        return self._autozero[self.function.name]

    @autozero.setter
    def autozero(self, on: bool) -> None:
        self._autozero[self.function.name] = on

    def autozeroes(self, name: str) -> bool:
        """Return True if a function takes a zero with each reading."""
        return self._autozero[name]

    def set_autozero(self, name: str, *, on: bool) -> None:
        """Set whether a function takes a zero with each reading; the ratio follows DC voltage."""
        self._autozero[name] = on
        if name == "VOLT":
            self._autozero["VOLT:RAT"] = on

    def autorange_once(self, name: str) -> None:
        """Select the range for the present signal, and keep it."""
        setup = self.setups[name]
        setup.range = self.inputs.autorange(self.functions[name].voltage_ranged, setup.range)
        setup.auto = False

    def shortest_interval_s(self) -> float:
        """Return the longest time of a reading with the present setup: the least of SAMPle:TIMer."""
        setup, function = self.setup, self.function
        window_s = setup.aperture_s if function.gated else self.inputs.aperture_s(setup.nplc) * (1 + self.autozero)
        return self.delay_s() + window_s + function.autorange_s * (setup.auto and bool(function.ranges))

    def forget(self) -> None:
        """End the measurement and forget its readings, because a setting changes."""
        self.triggering.abort()
        self.triggering.memory = []

    def configure(self, function: Function, expected: Any, resolution: Any) -> None:
        """CONFigure: all settings of the measurement are preset, null and mathematics among them."""
        automatic = isinstance(expected, float) and math.isnan(expected)
        super().configure(function, None if automatic else expected, resolution)
        self.aperture_on[function.name] = False
        self.nulls[function.name] = Null()
        self.statistics, self.limit_test = Statistics(), LimitTest()
        for each in _PRESET:
            self.engine.remembered.pop((each,), None)

    def _turn_to(self, function: Function) -> None:
        """Go to a function: scaling goes off (guide p. 224)."""
        super()._turn_to(function)
        self.engine.remembered.pop((_SCALING,), None)

    def averages_over(self) -> int:
        """Return the number of readings of a moving mean: CALCulate:SMOothing, which the 34465A has."""
        kept = self.engine.remembered
        on = kept.get(("CALCulate:SMOothing[:STATe]",), False)
        return _SMOOTHED[kept.get(("CALCulate:SMOothing:RESPonse",), "FAST")] if on else 1

    def calculated(self, reading: float) -> float:
        """Return a reading after CALCulate:SCALe."""
        kept, scale = self.engine.remembered, "CALCulate:SCALe"
        if not kept.get((_SCALING,)):
            return reading
        operation = kept.get((f"{scale}:FUNCtion",), "NULL")
        reference = kept.get((f"{scale}:DBM:REFerence",), 600.0) if operation == "DBM" else None
        reference = kept.get((f"{scale}:REFerence",), float(operation == "DB")) if reference is None else reference
        gain, offset = kept.get((f"{scale}:GAIN",), 1.0), kept.get((f"{scale}:OFFSet",), 0.0)
        return scaled(reading, operation, gain, offset, reference)

    def _finish_reading(self, value: float) -> float:
        value = self.read_at_terminals(value)
        self.before_mathematics = value
        if abs(value) >= OVERLOAD:
            self._show_overload()
            return value
        self._sound(value)
        reading = self.nulls[self.function.name].apply(value)
        if (count := self.averages_over()) > 1:
            reading = self.recent.mean(reading, count)
        reading = self.calculated(reading)
        if abs(reading) == math.inf or math.isnan(reading):
            return math.copysign(OVERLOAD, reading)
        if self.statistics.on:
            self.statistics.take(reading)
        self.questionable.latch(self.limit_test.bits(reading))
        return reading
