"""Agilent (Keysight) 33220A function generator.

The user's guide (33220-90002) was at hand only as quoted by others; what it leaves open is marked.
"""

import math
from typing import ClassVar, Literal

from vcfbench.clock import Deadline
from vcfbench.drivers import replies
from vcfbench.drivers.scpi_instrument import Left, ScpiInstrument, decimal, require_within, safely
from vcfbench.errors import FramingError, PlanError
from vcfbench.interfaces import SafeReport

MAX_V = 10.0
"""Into an open circuit |offset| + amplitude / 2 may be 10 V (guide p. 60)."""

FREQUENCY_STEP_HZ = 1e-6
"""Resolution of frequencies."""
LEAST_OFFSET_STEP_V = 1e-3
"""Offsets are held to four digits, and to no less than this (unverified)."""


class Agilent33220A(ScpiInstrument):
    """The generator speaks of voltages into its load; the load is a high impedance here (``OUTP:LOAD INF``)."""

    model: ClassVar[str] = "33220A"
    number_form: ClassVar[replies.NumberForm] = replies.nr3(decimals=13)  # seen on its siblings
    questions: ClassVar[tuple[tuple[str, replies.NumberForm], ...]] = (
        ("OUTP?", replies.ANY_NUMBER),
        ("FREQ?", number_form),
        ("VOLT?", number_form),
        ("VOLT:OFFS?", number_form),
    )
    safe_words: ClassVar[tuple[str, ...]] = ("OUTP OFF",)  # the relay: no level is anything behind it
    source: ClassVar[str] = ""
    """Prefix of the commands to the channel that drives V_Vc."""
    output: ClassVar[str] = "OUTP"
    """The root of the words of its connector."""
    sine_hz: ClassVar[float] = 20e6
    """Highest frequency of a sine, Hz."""
    least_vpp: ClassVar[float] = 20e-3
    left: ClassVar[tuple[Left, ...]] = (
        # Modulation, sweep and burst: of each function but direct voltage, which -221 would refuse (siblings' guides)
        *(Left(f"{mode}:STAT", "OFF", f"{mode} subsystem") for mode in ("AM", "FM", "PM", "FSK", "PWM", "SWE", "BURS")),
        Left("VOLT:RANG:AUTO", "ON", "VOLTage subsystem: held, small levels have the resolution of large ones"),
        Left("VOLT:UNIT", "VPP", "VOLTage subsystem: dBm would be changed, and refused, with the load"),
        Left("OUTP:POL", "NORM", "OUTPut subsystem: inverted, a sine is turned about its offset"),
    )
    """What a last user may have left beside function, levels, unit and load, which are always set."""

    _configured = False

    def _take_remote(self, deadline: Deadline) -> None:
        # On LAN nothing goes remote by itself, and the front panel would stay alive during a calibration. On USB and
        # GPIB the bus does it.
        if self._session.interface in ("socket", "instr"):
            self._session.send("SYST:COMM:RLST REM", deadline=deadline)

    def configure_dc(self, voltage_v: float) -> float:
        """Select DC at `voltage_v` into an open circuit, output switch unchanged; return the setting read back, V."""
        self._require_voltage(voltage_v)
        self._select_open_circuit()
        level = decimal(voltage_v)
        self._write_source("FUNC DC", f"VOLT:OFFS {level}")
        found_v = self._level_v(level)
        self._kept[f"{self.source}FUNC?"] = self._session.query, "DC"
        self._configured = True
        return found_v

    def set_dc(self, voltage_v: float) -> float:
        """Change the DC level; return the setting read back, V."""
        self._require_voltage(voltage_v)
        self._require_configured("no DC level was configured")
        level = decimal(voltage_v)
        self._write_source(f"VOLT:OFFS {level}")
        return self._level_v(level)

    def configure_sine(self, frequency_hz: float, amplitude_vpp: float, offset_v: float = 0.0) -> None:
        """Select a sine into an open circuit, output switch unchanged."""
        require_within(self, "frequency", frequency_hz, (1e-6, self.sine_hz), "Hz")
        require_within(self, "amplitude", amplitude_vpp, (self.least_vpp, 2.0 * MAX_V), "Vpp")
        require_within(self, "peak voltage", abs(offset_v) + amplitude_vpp / 2.0, (0.0, MAX_V), "V")
        self._select_open_circuit()
        frequency, amplitude, offset = decimal(frequency_hz), decimal(amplitude_vpp), decimal(offset_v)
        # Offset to zero first: an amplitude that does not fit beside it would move it, and be reported as -221.
        self._write_source(
            "VOLT:OFFS 0",
            "FUNC SIN",
            "VOLT:UNIT VPP",
            f"FREQ {frequency}",
            f"VOLT {amplitude}",
            f"VOLT:OFFS {offset}",
        )
        form = self.number_form
        self._read_back(f"{self.source}FREQ?", frequency, FREQUENCY_STEP_HZ, "Hz", form=form)
        self._read_back(f"{self.source}VOLT?", amplitude, _fourth_digit(amplitude_vpp), "Vpp", form=form)
        self._offset_v(offset)
        self._kept[f"{self.source}FUNC?"] = self._session.query, "SIN"
        self._configured = True

    def _write_source(self, *commands: str) -> None:
        self._session.write(*(f"{self.source}{command}" for command in commands))

    def _require_voltage(self, voltage_v: float) -> None:
        require_within(self, "DC voltage", voltage_v, (-MAX_V, MAX_V), "V")

    def _require_configured(self, what: str) -> None:
        if not self._configured:
            raise self._error(PlanError, f"{what}, nothing was sent")

    def _select_open_circuit(self) -> None:
        """Select levels into an open circuit; before the first setting the output is switched off."""
        if not self._taken_over:
            self._switch("off")
        self._take_over(self.left)
        self._session.write(f"{self.output}:LOAD INF")
        load_ohm = self._session.query_ohms(f"{self.output}:LOAD?")
        self._kept[f"{self.output}:LOAD?"] = self._session.query_ohms, math.inf
        if not math.isinf(load_ohm):
            raise self._disagreement(f"{self.output}:LOAD?", "a high-impedance load", f"{load_ohm:g} ohm")

    def _level_v(self, sent: str) -> float:
        """Return the level that is set, V. It counts as measured, so it is asked for twice: no digit may be wrong."""
        first_v, again_v = self._offset_v(sent), self._offset_v(sent)
        if first_v != again_v:
            raise self._error(
                FramingError,
                f"one setting was answered as {first_v:.9g} V and as {again_v:.9g} V",
                command=f"{self.source}VOLT:OFFS?",
            )
        return first_v

    def _offset_v(self, sent: str) -> float:
        step_v = max(_fourth_digit(float(sent)), LEAST_OFFSET_STEP_V)
        return self._read_back(f"{self.source}VOLT:OFFS?", sent, step_v, "V", form=self.number_form)

    def enable_output(self) -> None:
        """Close the output relay."""
        self._require_configured("no function was configured")
        self._switch("on")

    def disable_output(self) -> None:
        """Open the output relay."""
        self._switch("off")

    def _switch(self, wanted: Literal["on", "off"], deadline: Deadline | None = None) -> None:
        self._session.write(f"{self.output} {wanted.upper()}", deadline=deadline)
        self._require_switched(wanted, deadline)

    def _require_switched(self, wanted: Literal["on", "off"], deadline: Deadline | None) -> None:
        if self._switched_on(deadline) is not (wanted == "on"):
            raise self._disagreement(f"{self.output}?", wanted, "off" if wanted == "on" else "on")

    def output_enabled(self) -> bool:
        """Return True if the output relay is closed."""
        return self._switched_on(None)

    def _switched_on(self, deadline: Deadline | None) -> bool:
        on = self._session.query_bool(f"{self.output}?", deadline)
        self._session.note_read(f"output {'on' if on else 'off'}")
        return on

    def make_safe(self, deadline: Deadline) -> SafeReport:
        """Open the output relay and read it back."""
        return safely(self, self._prove_off, deadline)

    def _prove_off(self, deadline: Deadline) -> str:
        self._session.revive(deadline)
        self._tell_safe(*self.safe_words, deadline=deadline)
        self._require_switched("off", deadline)
        return "output relay open"


def _fourth_digit(value: float) -> float:
    """Return one unit of the fourth digit of `value`: levels hold four (general knowledge of the data sheet)."""
    return float(10.0 ** (math.floor(math.log10(abs(value))) - 3)) if value else 0.0
