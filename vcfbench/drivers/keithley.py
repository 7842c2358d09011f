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
from vcfbench.drivers.scpi_instrument import Left
from vcfbench.drivers.truevolt import MAINS, REAR
from vcfbench.errors import WrongInstrument


class _Keithley(Hp34401A):
    """A Keithley multimeter: a reading is begun, waited for by ``*OPC?`` and fetched twice."""

    makers: ClassVar[tuple[str, ...]] = ("KEITHLEY",)
    reading_form: ClassVar[replies.NumberForm] = replies.ANY_NUMBER  # digits follow settings
    integration_times_nplc: ClassVar[tuple[float, ...]] = (0.01, 0.1, 0.2, 1.0, 10.0)
    """Those in use: both take any from 0.01 to 10 (PyMeasure's drivers), and have no more digits in between."""
    fast_apertures_s: ClassVar[Mapping[float, float]] = MappingProxyType({})
    longest_delay_s: ClassVar[float] = 999_999.999
    least_samples: ClassVar[int] = 2
    header: ClassVar[str] = "VOLT"
    sampling_question: ClassVar[str | None] = None
    waits_for_readings: ClassVar[bool] = True


class Keithley2000(_Keithley):
    """The 2000, which from power-on measures and averages by itself until it is set otherwise."""

    model: ClassVar[str] = "2000"
    memory_readings: ClassVar[int] = 1024
    """Its buffer (User's Manual, as users quote it)."""
    abort_words: ClassVar[tuple[str, ...]] = ("INIT:CONT OFF", "ABOR")
    left: ClassVar[tuple[Left, ...]] = (
        Left("SYST:FRSW", "1", "SYSTem subsystem: 1 is front", REAR),
        Left("SYST:LFR", "{mains}", "SYSTem subsystem", MAINS),
        Left("CALC:STAT", "OFF", "CALCulate1: mX+b and percent, which FETCh? has been through"),
        Left("UNIT:VOLT:DC", "V", "UNIT subsystem: V, dB, dBm"),
        Left("HOLD:STAT", "OFF", "SENSe subsystem"),
        Left("FORM", "ASC", "FORMat subsystem"),
        Left("FORM:ELEM", "READ", "FORMat subsystem"),
    )
    autozero: ClassVar[str] = "SYST:AZER:STAT"
    # After CONFigure, which may set them (unverified): filter, relative value, digits
    function_words: ClassVar[tuple[str, ...]] = (
        "CONF:{function}",
        "{header}:RANG {range}",
        "{header}:NPLC {nplc}",
        "{header}:AVER:STAT OFF;:{header}:REF:STAT OFF;:{header}:DIG 7",
        "{autozero_on}",
        "TRIG:SOUR IMM;:TRIG:COUN 1;:SAMP:COUN 1",
        "TRIG:DEL:AUTO ON",
    )
    sampling_words: ClassVar[tuple[str, ...]] = (
        "{autozero} OFF",
        "TRAC:CLE;:TRAC:POIN {samples};:TRAC:FEED SENS;:TRAC:FEED:CONT NEXT",
        "TRIG:COUN {samples};:TRIG:DEL {pause}",
    )
    samples_question: ClassVar[str] = "TRAC:DATA?"
    single_words: ClassVar[tuple[str, ...]] = (
        "TRAC:FEED:CONT NEV",
        "TRIG:COUN 1;:TRIG:DEL:AUTO ON",
        "{autozero} ON",
    )


class KeithleyDMM6500(_Keithley):
    """The DMM6500 set to the command set SCPI; set to TSP it is refused, with words."""

    model: ClassVar[str] = "DMM6500"
    memory_readings: ClassVar[int] = 100_000
    """Readings that defbuffer1 holds by default (general knowledge, unverified)."""
    longest_delay_s: ClassVar[float] = 10_000.0
    """Delay of SimpleLoop (p. 13-267)."""
    abort_words: ClassVar[tuple[str, ...]] = ("ABOR",)
    left: ClassVar[tuple[Left, ...]] = (
        Left("ROUT:TERM", "FRON", "p. 13-54", REAR),
        Left("SYST:LFR", "{mains}", "p. 13-170", MAINS),
        Left("FORM", "ASC", "FORMat subsystem"),
        Left("FORM:ASC:PREC", "0", "FORMat subsystem: all digits"),
        Left("{header}:AVER:STAT", "OFF", "[SENSe1]: filter"),
        Left("{header}:REL:STAT", "OFF", "[SENSe1]: relative offset"),
        Left("CALC:{header}:MATH:STAT", "OFF", "CALCulate1: mx+b, percent, reciprocal"),
        Left("{header}:LINE:SYNC", "OFF", "[SENSe1]: line synchronisation"),
        Left("{header}:DEL:AUTO", "ON", "[SENSe1]: auto delay"),
        Left("VOLT:UNIT", "VOLT", "[SENSe1]: V, dB, dBm"),
        Left("VOLT:INP", "AUTO", "[SENSe1]: input impedance, above 10 Gohm up to 10 V"),
        Left("TRAC:POIN", '100000,"defbuffer1"', "TRACe subsystem"),
        Left("TRAC:FILL:MODE", 'CONT,"defbuffer1"', "TRACe subsystem"),
    )
    begin_words: ClassVar[str] = 'TRAC:TRIG "defbuffer1"'
    autozero: ClassVar[str] = "VOLT:AZER"
    # FUNCtion ends digitizing, too
    function_words: ClassVar[tuple[str, ...]] = (
        'FUNC "{function}"',
        "{header}:RANG {range}",
        "{header}:NPLC {nplc}",
        "{autozero_on}",
        "COUN 1",
    )
    sampling_words: ClassVar[tuple[str, ...]] = (
        "{autozero} OFF",
        "AZER:ONCE",
        'TRAC:CLE "defbuffer1"',
        'TRIG:LOAD "SimpleLoop",{samples},{pause},"defbuffer1"',
    )
    samples_question: ClassVar[str] = 'TRAC:DATA? 1,{samples},"defbuffer1",READ'
    single_words: ClassVar[tuple[str, ...]] = ("{autozero} ON",)

    def _take_remote(self, deadline: Deadline) -> None:
        language = self._session.query("*LANG?", deadline).strip().upper()
        if language != "SCPI":
            self._session.close()
            raise self._error(
                WrongInstrument,
                f"it is set to the command set {language}, not SCPI",
                hint="choose SCPI in its menu (System, Settings) or send *LANG SCPI, then switch it off and on",
            )
