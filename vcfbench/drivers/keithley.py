"""Keithley 2000 and DMM6500 multimeters in their SCPI languages, which are not the 34401A's.

Sources: PyMeasure's drivers of both and other users' code, with records of ``*IDN?``; the 2000's User's Manual
(2000-900-01) and the DMM6500's Reference Manual (DMM6500-901-01) were not at hand but for single sentences that users
quote, so that what a setting does beside itself is unverified. What matters is therefore set, not presumed.

Their names in ``*IDN?`` are ``MODEL 2000`` and ``MODEL DMM6500``.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

from vcfbench.clock import Deadline
from vcfbench.drivers import replies
from vcfbench.drivers.hp34401a import Hp34401A
from vcfbench.drivers.scpi_instrument import decimal, require_within
from vcfbench.errors import WrongInstrument

_LONGEST_DELAY_S = 999_999.999
_OVERHEAD_S = 0.05
"""Settling, conversion and transfer of a reading (chosen)."""


class _Keithley(Hp34401A):
    """A Keithley multimeter: a reading is begun, waited for by ``*OPC?`` and fetched twice."""

    makers: ClassVar[tuple[str, ...]] = ("KEITHLEY",)
    reading_form: ClassVar[replies.NumberForm] = replies.ANY_NUMBER  # digits follow settings
    integration_times_nplc: ClassVar[tuple[float, ...]] = (0.01, 0.1, 0.2, 1.0, 10.0)
    """Those in use: both take any from 0.01 to 10 (PyMeasure's drivers), and have no more digits in between."""
    fast_apertures_s: ClassVar[Mapping[float, float]] = MappingProxyType({})
    begin: ClassVar[str] = "INIT"

    def _configure(self, range_v: float, nplc: float, *words: str) -> None:
        self._require_one_of("range", range_v, self.ranges_v)
        self._require_one_of("integration time in power-line cycles", nplc, self.integration_times_nplc)
        deadline = self._session.deadline(self._session.timeout_s + self.reading_time_s)
        self._session.write(*words, deadline=deadline)
        self._verify_setting("VOLT:RANG?", range_v)
        self._verify_setting("VOLT:NPLC?", nplc)
        self._nplc, self._range_v = nplc, range_v

    def read_voltage_v(self) -> float:
        """Take one reading and return it, V; as the 34401A's, which see."""
        self.begin_reading()
        return self.begun_reading_v()

    def begin_reading(self) -> None:
        """Trigger one reading; return at once."""
        self._session.send(self.begin, deadline=self._session.deadline())

    def begun_reading_v(self) -> float:
        """Wait for the reading that was begun and return it, V."""
        deadline = self._session.deadline(self._session.timeout_s + self.reading_time_s)
        with self._session.exclusive():
            self._session.query_int("*OPC?", deadline)
            return self._begun_reading_v(deadline)

    def _require_sampling(self, samples: int, interval_s: float) -> float:
        """Return the pause between the readings of a sampling that the meter can do, s."""
        aperture_s = self.aperture_s
        require_within(self, "a number of readings", samples, (2, self.memory_readings), "readings")
        require_within(self, "an interval", interval_s, (aperture_s, aperture_s + _LONGEST_DELAY_S), "s")
        return round(interval_s - aperture_s, 6)

    def _waited_for(self, question: str) -> tuple[float, ...]:
        """Return the readings of the sampling when it is done."""
        deadline = self._session.deadline(self._session.timeout_s + 0.04 * self._sampled)
        with self._session.exclusive():
            self._session.query_int("*OPC?", deadline)
            return self._fetched(question, deadline)


class Keithley2000(_Keithley):
    """The 2000: it measures by itself from power-on until it is told not to, and averages unless it is told not to."""

    model: ClassVar[str] = "2000"
    memory_readings: ClassVar[int] = 1024
    """Its buffer (User's Manual, as users quote it)."""
    abort_words: ClassVar[tuple[str, ...]] = ("INIT:CONT OFF", "ABOR")

    def configure_dc_voltage(self, range_v: float, nplc: float) -> None:
        """Select DC voltage on a fixed range with an integration time of `nplc` power-line cycles, autozero on."""
        self._configure(
            range_v,
            nplc,
            "INIT:CONT OFF;:ABOR",
            "CONF:VOLT:DC",
            f"VOLT:RANG {decimal(range_v)}",
            f"VOLT:NPLC {decimal(nplc)}",
            "VOLT:AVER:STAT OFF;:VOLT:REF:STAT OFF;:VOLT:DIG 7",
            "SYST:AZER:STAT ON",
            "FORM ASC;:FORM:ELEM READ",
            "TRIG:SOUR IMM;:TRIG:COUN 1;:SAMP:COUN 1",
        )

    def start_sampling(self, samples: int, interval_s: float) -> float:
        """Begin to take `samples` readings into its buffer, one every `interval_s`; return how long they take, s."""
        pause_s = self._require_sampling(samples, interval_s)
        self._session.write(
            "SYST:AZER:STAT OFF",
            f"TRAC:CLE;:TRAC:POIN {samples};:TRAC:FEED SENS;:TRAC:FEED:CONT NEXT",
            f"TRIG:COUN {samples};:TRIG:DEL {decimal(pause_s)}",
            deadline=self._session.deadline(self._session.timeout_s + self.reading_time_s),
        )
        self._session.send("INIT")
        self._sampled = samples
        return samples * interval_s + _OVERHEAD_S

    def sampled_voltages_v(self) -> tuple[float, ...]:
        """Return the readings of the sampling that was begun last, V, and set the meter back to single ones."""
        readings_v = self._waited_for("TRAC:DATA?")
        self._session.write("TRAC:FEED:CONT NEV", "TRIG:COUN 1;:TRIG:DEL:AUTO ON", "SYST:AZER:STAT ON")
        return readings_v


class KeithleyDMM6500(_Keithley):
    """The DMM6500 set to the command set SCPI; set to TSP it is refused, with words."""

    model: ClassVar[str] = "DMM6500"
    memory_readings: ClassVar[int] = 100_000
    """Readings that defbuffer1 holds by default (general knowledge, unverified)."""
    abort_words: ClassVar[tuple[str, ...]] = ("ABOR",)
    begin: ClassVar[str] = 'TRAC:TRIG "defbuffer1"'

    def _take_remote(self, deadline: Deadline) -> None:
        language = self._session.query("*LANG?", deadline).strip().upper()
        if language != "SCPI":
            self._session.close()
            raise self._error(
                WrongInstrument,
                f"it is set to the command set {language}, not SCPI",
                hint="choose SCPI in its menu (System, Settings) or send *LANG SCPI, then switch it off and on",
            )

    def configure_dc_voltage(self, range_v: float, nplc: float) -> None:
        """Select DC voltage on a fixed range with an integration time of `nplc` power-line cycles, autozero on."""
        self._configure(
            range_v,
            nplc,
            "ABOR",
            'FUNC "VOLT:DC"',
            f"VOLT:RANG {decimal(range_v)}",
            f"VOLT:NPLC {decimal(nplc)}",
            "VOLT:AVER:STAT OFF;:VOLT:REL:STAT OFF",
            "VOLT:AZER ON",
            "FORM ASC",
            "COUN 1",
        )

    def start_sampling(self, samples: int, interval_s: float) -> float:
        """Begin to take `samples` readings into its buffer, one every `interval_s`; return how long they take, s."""
        pause_s = self._require_sampling(samples, interval_s)
        self._session.write(
            "VOLT:AZER OFF",
            "AZER:ONCE",
            'TRAC:CLE "defbuffer1"',
            f'TRIG:LOAD "SimpleLoop",{samples},{decimal(pause_s)},"defbuffer1"',
            deadline=self._session.deadline(self._session.timeout_s + self.reading_time_s),
        )
        self._session.send("INIT")
        self._sampled = samples
        return samples * interval_s + _OVERHEAD_S

    def sampled_voltages_v(self) -> tuple[float, ...]:
        """Return the readings of the sampling that was begun last, V, and set the meter back to single ones."""
        readings_v = self._waited_for(f'TRAC:DATA? 1,{self._sampled},"defbuffer1",READ')
        self._session.write("VOLT:AZER ON")
        return readings_v
