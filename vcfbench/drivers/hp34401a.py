"""HP (Agilent, Keysight) 34401A multimeter, after its user's guide 34401-90004."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar, Self

from vcfbench.arguments import require_number
from vcfbench.clock import Deadline
from vcfbench.drivers import replies
from vcfbench.drivers.scpi_instrument import Left, ScpiInstrument, VisaSettings, decimal, require_within, safely
from vcfbench.drivers.session import Session
from vcfbench.errors import FramingError, LimitError
from vcfbench.interfaces import SafeReport

_HIGH_IMPEDANCE_V = 10.0
"""The highest range whose input resistance can be above 10 Gohm; those above have 10 Mohm (guide p. 53)."""
_TRANSFER_S = 0.02
"""One reading on a 9600-baud line, 16 characters."""
_OVERHEAD_S = 0.05
"""Settling delay 1.5 ms (guide p. 81), about 20 ms into wait-for-trigger, and a 9600-baud line's 17 ms."""


class Hp34401A(ScpiInstrument):
    """A voltmeter on a fixed range with a fixed integration time."""

    model: ClassVar[str] = "34401A"
    reading_form: ClassVar[replies.NumberForm] = replies.nr3(decimals=8)
    """15 characters, ``SD.DDDDDDDDESDD`` (guide p. 106)."""

    questions: ClassVar[tuple[tuple[str, replies.NumberForm], ...]] = (
        ("VOLT:DC:RANG?", replies.ANY_NUMBER),
        ("VOLT:DC:NPLC?", replies.ANY_NUMBER),
    )

    over_range: ClassVar[float] = 1.2
    """Highest reading over the range (guide p. 216; the 1000 V range ends at itself, which is not looked at)."""

    ranges_v: ClassVar[tuple[float, ...]] = (0.1, 1.0, 10.0, 100.0, 1000.0)
    integration_times_nplc: ClassVar[tuple[float, ...]] = (0.02, 0.2, 1.0, 10.0, 100.0)
    fast_apertures_s: ClassVar[Mapping[float, float]] = MappingProxyType({0.02: 400e-6, 0.2: 3e-3})
    """Integration times that do not depend on the line, by power-line cycles (guide p. 216)."""
    memory_readings: ClassVar[int] = 512
    """Readings that INITiate can store (guide p. 84)."""
    longest_delay_s: ClassVar[float] = 3600.0
    """Trigger delay between readings (guide p. 80)."""
    least_samples: ClassVar[int] = 1
    abort_words: ClassVar[tuple[str, ...]] = ()
    """Commands that end a measurement, if a device clear does not; a 34401A takes none while it measures (p. 116)."""
    left: ClassVar[tuple[Left, ...]] = (
        Left("ROUT:TERM", "FRON", "p. 58", "the front panel's switch selects other terminals"),
        Left("DATA:FEED", 'RDG_STORE,"CALC"', "p. 84"),
    )
    """What CONFigure leaves as it was; `{header}` is that of a function's settings, `{mains}` the mains' frequency."""

    # CONFigure presets one sample, one trigger, source and delay, 10 Mohm, no math (p. 112); autozero by the NPLC.
    # Above 10 Gohm, as the lower ranges can (p. 53), no output is loaded.
    function_words: ClassVar[tuple[str, ...]] = (
        "CONF:{function} {range}",
        "{header}:NPLC {nplc}",
        "{autozero_on}",
        "{high_impedance}",
        "TRIG:SOUR IMM",
    )
    """Commands that select a function, one reading a trigger: VOLT:DC, RES by two wires, FRES by four.

    The settings of a function are under its header. Autozero is switched on for direct voltage alone.
    """
    header: ClassVar[str] = "VOLT:DC"
    """Header of the settings of direct voltage."""
    autozero: ClassVar[str] = "ZERO:AUTO"
    impedance: ClassVar[str] = "INP:IMP:AUTO"
    """Setting that has the lower ranges above 10 Gohm, where there is one of this name."""
    ranges_ohm: ClassVar[tuple[float, ...]] = (1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8)
    begin_words: ClassVar[str] = "INIT"
    """Command that takes one reading."""
    sampling_words: ClassVar[tuple[str, ...]] = ("{autozero} ONCE", "SAMP:COUN {samples}", "TRIG:DEL {pause}")
    sampling_question: ClassVar[str | None] = "SAMP:COUN?"
    """Question for the number of readings that was set, where there is one."""
    samples_question: ClassVar[str] = "FETC?"
    """Question for the readings of a sampling."""
    single_words: ClassVar[tuple[str, ...]] = ("SAMP:COUN 1", "TRIG:DEL:AUTO ON", "{autozero} ON")
    """Commands that set it back to single readings."""
    waits_for_readings: ClassVar[bool] = False
    """Whether ``*OPC?`` must have been answered before a reading that is under way can be asked for."""

    def __init__(self, session: Session, *, mains_hz: float = 50.0, serial_number: str | None = None) -> None:
        super().__init__(session, serial_number=serial_number)
        self._mains_hz = mains_hz
        self._nplc = 10.0
        self._range_v: float | None = None
        self._sampled = 0

    @classmethod
    def opened(cls, session: Session, settings: VisaSettings) -> Self:
        """Return the driver on an open session; how long a reading takes depends on the mains."""
        return cls(session, mains_hz=settings.mains_hz, serial_number=settings.serial_number)

    def _take_remote(self, deadline: Deadline) -> None:
        if self._session.interface == "asrl":  # in local READ? is refused with 550
            self._session.send("SYST:REM", deadline=deadline)

    @property
    def reading_time_s(self) -> float:
        """Duration of one reading, s: with autozero the meter integrates twice (guide p. 217)."""
        return 2.0 * self._nplc / self._mains_hz + _OVERHEAD_S

    @property
    def aperture_s(self) -> float:
        """Integration time of one reading, s; the shortest ones do not depend on the line."""
        return self.fast_apertures_s.get(self._nplc, self._nplc / self._mains_hz)

    def answers(self) -> dict[str, str]:
        """Send each query once, then those for the front panel: terminals, mains."""
        found = super().answers()
        self._take_over(tuple(row for row in self.left if row.refused), mains=f"{self._mains_hz:g}")
        return found

    def configure_dc_voltage(self, range_v: float, nplc: float) -> None:
        """Select DC voltage on a fixed range with an integration time of `nplc` power-line cycles, autozero on."""
        self._configure("VOLT:DC", self.header, range_v, self.ranges_v, nplc)
        self._range_v = range_v

    def configure_resistance(self, range_ohm: float, nplc: float, wires: int = 2) -> None:
        """Select resistance by two or four wires on a fixed range with an integration time of `nplc` cycles."""
        self._require_one_of("number of wires", wires, (2, 4))
        function = "RES" if wires == 2 else "FRES"
        self._configure(function, function, range_ohm, self.ranges_ohm, nplc)
        self._range_v = None

    def _configure(self, function: str, header: str, end: float, ranges: tuple[float, ...], nplc: float) -> None:
        """Select `function` on the range that ends at `end`, and read its settings back under their `header`."""
        self._require_one_of("range", end, ranges)
        self._require_one_of("integration time in power-line cycles", nplc, self.integration_times_nplc)
        values = {"function": function, "header": header, "range": decimal(end), "nplc": decimal(nplc)}
        values["autozero_on"] = f"{self.autozero} ON" if function == "VOLT:DC" else ""
        high = function == "VOLT:DC" and end <= _HIGH_IMPEDANCE_V
        values["high_impedance"] = f"{self.impedance} ON" if high else ""
        self._session.send(*self.abort_words, deadline=self._reading_deadline())
        self._take_over(self.left, header=header, mains=f"{self._mains_hz:g}")
        said = (each.format(**values) for each in self.function_words)
        self._session.write(*filter(None, said), deadline=self._reading_deadline())
        self._kept.clear()
        for question, wanted in ((f"{header}:RANG?", end), (f"{header}:NPLC?", nplc)):
            self._kept[question] = self._session.query_number, self._read_back(question, decimal(wanted), 1e-6 * wanted)
        self._nplc = nplc

    def _reading_deadline(self) -> Deadline:
        return self._session.deadline(self._session.timeout_s + self.reading_time_s)

    def _require_one_of(self, what: str, value: float, allowed: tuple[float, ...]) -> None:
        require_number(what, value)
        if value not in allowed:
            raise self._error(
                LimitError, f"{what} {value:g} is not one of {', '.join(f'{a:g}' for a in allowed)}, nothing was sent"
            )

    def read_voltage_v(self) -> float:
        """Take one reading and return it, V.

        The meter keeps the reading, and it is fetched twice: a digit that a bad line has turned into another digit is
        still in form and may well lie within the noise, but it does not come twice.

        Raises:
            FramingError: the answers differ, are not in form, or lie beyond the range: the wire cannot be believed.
            MeasurementError: overload.
        """
        deadline = self._reading_deadline()
        with self._session.exclusive():
            self._session.send(self.begin_words, deadline=deadline)
            return self._begun_reading_v(deadline)

    def read_resistance_ohm(self) -> float:
        """Take one reading and return it, ohm, fetched twice as a voltage is; inf where it is beyond the range.

        FramingError: the answers differ or are not in form.
        """
        deadline = self._reading_deadline()
        with self._session.exclusive():
            self._session.send(self.begin_words, deadline=deadline)
            if self.waits_for_readings:
                self._session.query_int("*OPC?", deadline)
            first, again = (self._session.query_ohms("FETC?", deadline, self.reading_form) for _ in range(2))
        if first != again:
            raise self._unbelievable(f"one reading was answered as {first:.9g} ohm and as {again:.9g} ohm")
        return first

    def begin_reading(self) -> None:
        """Trigger one reading; return at once."""
        self._session.send(self.begin_words, deadline=self._session.deadline())

    def begun_reading_v(self) -> float:
        """Wait for the reading that was begun and return it, V; as of :meth:`read_voltage_v`, which see."""
        return self._begun_reading_v(self._reading_deadline())

    def _begun_reading_v(self, deadline: Deadline) -> float:
        with self._session.exclusive():
            if self.waits_for_readings:
                self._session.query_int("*OPC?", deadline)
            first_v = self._session.query_reading("FETC?", deadline, self.reading_form)
            again_v = self._session.query_reading("FETC?", deadline, self.reading_form)
        if first_v != again_v:
            raise self._unbelievable(f"one reading was answered as {first_v:.9g} V and as {again_v:.9g} V")
        self._require_in_range(first_v)
        return first_v

    def start_sampling(self, samples: int, interval_s: float) -> float:
        """Begin to take `samples` readings by itself, one every `interval_s`; return their duration, s.

        They go to its memory, whence :meth:`sampled_voltages_v` takes them; until they are taken it hears nothing. What
        it needs beside delay and integration is not known below a millisecond (unverified).

        Raises:
            LimitError: more than the memory holds, or an interval below one integration time; nothing was sent.
        """
        aperture_s = self.aperture_s
        require_within(self, "a number of readings", samples, (self.least_samples, self.memory_readings), "readings")
        require_within(self, "an interval", interval_s, (aperture_s, aperture_s + self.longest_delay_s), "s")
        pause = decimal(round(interval_s - aperture_s, 6))
        self._session.write(
            *(each.format(autozero=self.autozero, samples=samples, pause=pause) for each in self.sampling_words),
            deadline=self._reading_deadline(),
        )
        if self.sampling_question and (found := self._session.query_int(self.sampling_question)) != samples:
            raise self._disagreement(self.sampling_question, f"{samples} readings", str(found))
        self._session.send("INIT")
        self._sampled = samples
        return samples * interval_s + _OVERHEAD_S

    def sampled_voltages_v(self) -> tuple[float, ...]:
        """Return the readings of the sampling that was begun last, V, and set the meter back to single ones.

        They are fetched twice, as in :meth:`read_voltage_v`.

        Raises:
            DeadlineExceeded: it is still taking them.
            FramingError: the answers differ, are too few, are not in form, or lie beyond the range.
            MeasurementError: one of them is an overload.
        """
        deadline = self._session.deadline(self._session.timeout_s + 2.0 * self._sampled * _TRANSFER_S)
        question = self.samples_question.format(samples=self._sampled)
        with self._session.exclusive():
            if self.waits_for_readings:
                self._session.query_int("*OPC?", deadline)
            first_v, again_v = (self._session.query_readings(question, deadline, self.reading_form) for _ in range(2))
        if first_v != again_v:
            raise self._unbelievable("the same readings were answered differently when they were fetched again")
        if len(first_v) != self._sampled:
            raise self._unbelievable(f"{len(first_v)} readings came, {self._sampled} were taken")
        for voltage_v in first_v:
            self._require_in_range(voltage_v)
        self._session.write(*(each.format(autozero=self.autozero) for each in self.single_words))
        return first_v

    def _require_in_range(self, voltage_v: float) -> None:
        if self._range_v is not None and abs(voltage_v) > self.over_range * self._range_v:
            raise self._unbelievable(
                f"a reading of {voltage_v:.9g} V, which the {self._range_v:g} V range cannot give "
                f"(at most {self.over_range * self._range_v:g} V)"
            )

    def _unbelievable(self, what: str) -> FramingError:
        return self._error(FramingError, what, command="FETC?")

    def make_safe(self, deadline: Deadline) -> SafeReport:
        """Abort the measurement; an answer to the query shows that the meter is idle."""
        return safely(self, self._prove_idle, deadline)

    def _prove_idle(self, deadline: Deadline) -> str:
        self._session.revive(deadline)
        self._session.clear(deadline)
        for words in self.abort_words:
            self._session.send(words, deadline=deadline)
        self._session.query_int("*OPC?", deadline)
        return "idle"
