"""Temptronic (inTEST) ATS-545 ThermoStream: a stream of air that brings a device to a temperature.

The manual (ATS-545 & -645 Interface & Applications Manual, rev. B, 2015) was not at hand. The words are those of single
pages of the TP04300's manual, whose command set the series shares (syntax p. 4-6, TMPA?, TMPD?, TESR? p. 4-25, *IDN?
p. C-1), and those that PyMeasure's driver of the ATS-545 takes from the manual. Unverified: what *IDN? answers beside
the maker, that refusals are told by *ESR? alone, and that there is no error queue.
"""

from types import MappingProxyType
from typing import ClassVar

from vcfbench.clock import Deadline
from vcfbench.drivers.scpi_instrument import Left, ScpiInstrument, require_within, safely
from vcfbench.errors import InstrumentError, InterlockError
from vcfbench.interfaces import SafeReport

_FLOW = 1 << 5
"""AUXC?: air flows."""
_HEAD_UP = 1 << 2
"""AUXC?: the head is up."""
_AT_TEMPERATURE = 1
"""TECR?: the soak time has passed within the window."""
_NO_SENSOR_C = 400.0
"""Without a sensor readings are above this."""
_HOT_C, _COLD_C = 30.0, 20.0
"""From where on a temperature is set as the hot or the cold one: the operator's screen has three setpoints."""
_FAULTS = MappingProxyType(
    {
        1: "overheat",
        2: "air open loop",
        8: "low flow",
        16: "low input air pressure",
        32: "air sensor open",
        128: "internal error",
        512: "flow sensor",
        1024: "no line sense",
        2048: "NVRAM",
        4096: "BVRAM",
        16384: "no device sensor selected",
    }
)


class TemptronicATS545(ScpiInstrument):
    """Air on a device, by the three setpoints of the operator's screen; the head is moved by a person only."""

    model: ClassVar[str] = "ATS-545"
    makers: ClassVar[tuple[str, ...]] = ("TEMPTRONIC", "INTEST")
    safe_words: ClassVar[tuple[str, ...]] = ("FLOW 0",)
    error_question: ClassVar[str] = "*ESR?"
    left: ClassVar[tuple[Left, ...]] = (Left("DUTM", "0", "PyMeasure: the air is controlled, not a device's sensor"),)

    def set_temperature(self, temperature_c: float, ramp_k_min: float) -> float:
        """Go to `temperature_c` with at most `ramp_k_min` once air flows; return the setting read back, degC."""
        require_within(self, "temperature", temperature_c, (-99.9, 225.0), "degC")
        require_within(self, "temperature ramp", ramp_k_min, (0.1, 9999.0), "K/min")
        number = 0 if temperature_c >= _HOT_C else 2 if temperature_c <= _COLD_C else 1
        ramp = f"{ramp_k_min:.1f}" if ramp_k_min < 100.0 else f"{ramp_k_min:.0f}"
        if not self._taken_over:
            self.disable_flow()  # whatever it was doing
        self._take_over(self.left)
        self._session.write(f"SETN {number}")
        self._session.write(f"RAMP {ramp}")
        setpoint = f"{temperature_c:.1f}"
        self._session.write(f"SETP {setpoint}")
        self._read_back("RAMP?", ramp, 0.05, "K/min")
        return self._read_back("SETP?", setpoint, 0.05, "degC")

    def set_settled(self, window_k: float, soak_s: float) -> None:
        """Say when it counts as at temperature: for `soak_s` within `window_k` of the setting chosen last."""
        require_within(self, "window", window_k, (0.1, 9.9), "K")
        require_within(self, "soak time", soak_s, (0.0, 9999.0), "s")
        window, soak = f"{window_k:.1f}", f"{soak_s:.0f}"
        self._session.write(f"WNDW {window}")
        self._session.write(f"SOAK {soak}")
        self._read_back("WNDW?", window, 0.05, "K")
        self._read_back("SOAK?", soak, 0.5, "s")

    def at_temperature(self) -> bool:
        """Return True if the temperature is reached and has been held for the soak time."""
        return bool(self._session.query_int("TECR?") & _AT_TEMPERATURE)

    def air_temperature_c(self) -> float:
        """Read the temperature of the air, degC."""
        return self._session.query_reading("TMPA?")

    def device_temperature_c(self) -> float | None:
        """Read the temperature at the device, degC; None where no sensor is wired."""
        found = self._session.query_reading("TMPD?")
        return None if found > _NO_SENSOR_C else found

    def enable_flow(self) -> None:
        """Switch the air on; InterlockError at a fault, or while the head is up."""
        if fault := self.fault():
            raise self._error(InterlockError, fault)
        if self._session.query_int("AUXC?") & _HEAD_UP:
            raise self._error(
                InterlockError, "its head is up, no air was let out", hint="lower the head onto the device by hand"
            )
        self._switch(on=True)

    def disable_flow(self) -> None:
        """Stop the air."""
        self._switch(on=False)

    def _switch(self, *, on: bool) -> None:
        self._session.write(f"FLOW {on:d}")
        if self.flow_enabled() is not on:
            raise self._error(
                InstrumentError,
                f"the air was switched {'on' if on else 'off'} but does not read back so",
                command="AUXC?",
            )

    def flow_enabled(self) -> bool:
        """Return True if air flows."""
        return self._flows(None)

    def _flows(self, deadline: Deadline | None) -> bool:
        on = bool(self._session.query_int("AUXC?", deadline) & _FLOW)
        self._session.note_read(f"air {'on' if on else 'off'}")
        return on

    def fault(self) -> str | None:
        """Return the faults in EROR? in words, or None."""
        bits = self._session.query_int("EROR?")
        known = [words for bit, words in _FAULTS.items() if bits & bit]
        return (", ".join(known) or f"error register {bits}") if bits else None

    def make_safe(self, deadline: Deadline) -> SafeReport:
        """Stop the air and prove it; a hot or cold device then comes to the room's temperature by itself."""
        return safely(self, self._prove_off, deadline)

    def _prove_off(self, deadline: Deadline) -> str:
        self._session.revive(deadline)
        self._tell_safe("FLOW 0", deadline=deadline)
        if self._flows(deadline):
            raise self._error(InstrumentError, "the air goes on", command="AUXC?")
        return "air off"
