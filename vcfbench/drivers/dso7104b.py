"""Agilent (Keysight) DSO7104B oscilloscope.

The programmer's guide was at hand only as quoted by others and through its siblings of the 6000 and X series; what
is unverified is marked.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Final, Literal, Self

from msgspec import Struct

from vcfbench.drivers import replies
from vcfbench.drivers.scpi_instrument import Left, ScpiInstrument, VisaSettings, decimal, require_within, safely
from vcfbench.errors import ClippedRecord, FramingError, InstrumentError, LimitError, MeasurementError
from vcfbench.interfaces import Waveform

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from vcfbench.clock import Deadline
    from vcfbench.drivers.session import Session
    from vcfbench.interfaces import SafeReport

CHANNELS: Final = (1, 2, 3, 4)

_HOLE, _CLIPPED_LOW = 0, 1
"""Codes of a record that are no samples, as is the highest (programmer's guides of the siblings)."""

_CODES: Final = {"BYTE": "u1", "WORD": "<u2"}
"""Type of a record's codes by its format."""

_NORMAL_RECORD = 1000
"""Longest measurement record; beyond it the raw one must be read."""

_RUNNING = 1 << 3
"""Bit of ``:OPER:COND?``."""

_AUTO_TRIGGER_S = 1.0
"""Allowance for the automatic sweep to trigger by itself (unverified; tens of milliseconds at fast time bases)."""
_RECORDS_A_TRIGGER, _REARM_S, _LEAST_MEAN_S = 3.1, 2e-3, 10.0
"""A mean takes 2 records and 1.1 times the time between triggers, which come at least once a record, for each of its
records, and not less than 10 s are to be allowed (the maker's sample program); what re-arming takes is unverified."""


class Preamble(Struct, frozen=True):
    """Scaling of codes to seconds and volts: t = (i - x_reference) x_step_s + x_origin_s, the voltage by y alike."""

    points: int
    x_step_s: float
    x_origin_s: float
    x_reference: float
    y_step_v: float
    y_origin_v: float
    y_reference: float

    @classmethod
    def parse(cls, reply: str) -> Self:
        """Read ``:WAV:PRE?``: format, type, points, count, then increment, origin and reference of x and of y."""
        fields = replies.numbers(reply)
        if len(fields) != 10 or fields[0] not in {0.0, 1.0} or fields[2] < 1.0 or min(fields[4], fields[7]) <= 0.0:
            raise FramingError(f"expected the ten fields of a BYTE or WORD preamble, got {reply!r}")
        return cls(int(fields[2]), fields[4], fields[5], fields[6], fields[7], fields[8], fields[9])

    def waveform(self, codes: NDArray[np.unsignedinteger[Any]]) -> Waveform:
        """Return the instants of all points, s, trigger at 0, and the voltages of `codes`, V."""
        import numpy as np  # noqa: PLC0415 - heavy, needed only with waveforms

        time_s = (np.arange(self.points, dtype=np.float64) - self.x_reference) * self.x_step_s + self.x_origin_s
        return Waveform(time_s, (codes.astype(np.float64) - self.y_reference) * self.y_step_v + self.y_origin_v)


class Dso7104B(ScpiInstrument):
    """Four channels, seen DC coupled at 1 Mohm."""

    model: ClassVar[str] = "DSO7104B"
    reading_form: ClassVar[replies.NumberForm] = replies.nr3(exponent_digits=(2, 3))  # both were seen on siblings
    questions: ClassVar[tuple[tuple[str, replies.NumberForm], ...]] = (
        (":CHAN1:SCAL?", reading_form),
        (":TIM:SCAL?", reading_form),
        (":TRIG:EDGE:LEV?", reading_form),
        (":OPER:COND?", replies.ANY_NUMBER),
    )
    least_scale_v: ClassVar[float] = 2e-3
    first_answer_s: ClassVar[float] = 15.0  # older units were seen to take 10 s for the first answer on LAN

    left: ClassVar[tuple[Left, ...]] = (
        Left(":STOP", "", "it may run while nobody looks"),
        *(
            Left(f":CHAN{channel}:DISP", "0", "a channel that is shown takes memory and sample rate")
            for channel in CHANNELS
        ),
        Left(":ACQ:MODE", "RTIM", "ACQuire commands: segmented, equivalent time"),
        Left(":ACQ:COMP", "100", "ACQuire commands"),
        Left(":TRIG:HFR", "0", "TRIGger commands"),
        Left(":TRIG:NREJ", "0", "TRIGger commands"),
        Left(":TRIG:HOLD", "6E-8", "TRIGger commands: the least"),
        Left(":TRIG:EDGE:COUP", "DC", "TRIGger commands"),
        Left(":TRIG:EDGE:REJ", "OFF", "TRIGger commands"),
        Left(":MEAS:DEF", "THR,STAN", "MEASure commands: 10, 50 and 90 %"),
        Left(":WAV:VIEW", "MAIN", "WAVeform commands"),
    )
    left_of_channel: ClassVar[tuple[Left, ...]] = (
        Left(
            ":{source}:PROB",
            "{probe}",
            "CHANnel commands",
            "its probe factor is not what [oscilloscope] probe in the bench file says",
        ),
        Left(":{source}:INV", "0", "CHANnel commands"),
        Left(":{source}:UNIT", "VOLT", "CHANnel commands"),
        Left(":{source}:BWL", "0", "CHANnel commands"),
        Left(":{source}:PROB:SKEW", "0", "CHANnel commands"),
        Left(":{source}:VERN", "1", "CHANnel commands: scales between 1, 2 and 5"),
    )

    _record_s = 1e-3
    _trigger: tuple[str, str] | None = None
    """Source and level that were asked for."""
    _armed = False
    """Whether they are set, with the channel as it is."""
    _format: Literal["BYTE", "WORD"] = "BYTE"

    def __init__(self, session: Session, *, probe: float = 1.0, serial_number: str | None = None) -> None:
        super().__init__(session, serial_number=serial_number)
        self._probe = probe
        self._shown: dict[str, tuple[float, float]] = {}
        """Scale and offset of the channels that were set, V/div and V."""

    @classmethod
    def opened(cls, session: Session, settings: VisaSettings) -> Self:
        """Return the driver on an open session; the bench gives the ratio of its probes."""
        return cls(session, probe=settings.probe, serial_number=settings.serial_number)

    def configure_channel(self, channel: int, scale_v_per_div: float, offset_v: float = 0.0) -> None:
        """Show `channel`, DC coupled, 1 Mohm, at the given scale and offset."""
        source = self._source(channel)
        most = 5e3  # 5 V/div at a 1000:1 probe
        require_within(self, f"scale of channel {channel}", scale_v_per_div, (self.least_scale_v, most), "V/div")
        self._take_over(self.left)
        self._take_over(self.left_of_channel, source=source, probe=f"{self._probe:g}")
        self._session.write(
            f":{source}:DISP 1",
            f":{source}:COUP DC",
            f":{source}:IMP ONEM",
            f":{source}:SCAL {decimal(scale_v_per_div)}",
            f":{source}:OFFS {decimal(offset_v)}",
        )
        shown = scale_v_per_div, offset_v
        if self._trigger is not None and source == self._trigger[0] and self._shown.get(source) != shown:
            self._armed = False  # what its level can be depends on scale and offset
        self._shown[source] = shown

    def configure_timebase(self, scale_s_per_div: float) -> None:
        """Set the main time base, trigger in the centre."""
        require_within(self, "time base", scale_s_per_div, (500e-12, 50.0), "s/div")
        self._take_over(self.left)
        self._session.write(":TIM:MODE MAIN", ":TIM:REF CENT", f":TIM:SCAL {decimal(scale_s_per_div)}", ":TIM:POS 0")
        self._record_s = 10.0 * scale_s_per_div

    def configure_trigger(self, channel: int, level_v: float = 0.0) -> None:
        """Have a rising edge on `channel` trigger, with an automatic sweep; set before a record, after the channels."""
        self._trigger, self._armed = (self._source(channel), decimal(level_v)), False

    def _arm(self) -> None:
        """Set the trigger that was asked for: a level must lie on the screen, which scale and offset make."""
        if self._trigger is None or self._armed:
            return
        source, level = self._trigger
        self._session.write(
            ":TRIG:MODE EDGE",
            f":TRIG:EDGE:SOUR {source}",
            ":TRIG:EDGE:SLOP POS",
            f":TRIG:EDGE:LEV {level}",
            ":TRIG:SWE AUTO",  # or an untriggered :DIGitize would block the instrument for good
        )
        # Three digits come back; how finely levels are set is unverified
        scale_v, _ = self._shown.get(source, (self.least_scale_v, 0.0))
        step_v = 0.005 * abs(float(level)) + 0.02 * scale_v
        self._read_back(":TRIG:EDGE:LEV?", level, step_v, "V", form=self.reading_form)
        self._armed = True

    def acquire(self, *channels: int) -> None:
        """Take one record of `channels` and stop."""
        self._digitize(channels, 1, ":ACQ:TYPE NORM")
        self._format = "BYTE"

    def acquire_mean(self, count: int, *channels: int) -> None:
        """Take the mean of `count` records of `channels`, each from its own trigger, and stop."""
        require_within(self, "number of averages", count, (2, 65_536), "records")
        self._digitize(channels, count, ":ACQ:TYPE AVER", f":ACQ:COUN {count}")
        self._format = "WORD"  # a mean has more bits than a sample

    def acquire_fine(self, *channels: int) -> None:
        """Take one record of `channels` whose points are means of all samples about them, and stop."""
        self._digitize(channels, 1, ":ACQ:TYPE HRES")
        self._format = "WORD"

    def _digitize(self, channels: tuple[int, ...], count: int, *how: str) -> None:
        sources = ",".join(self._source(channel) for channel in channels)
        self._arm()
        lasts_s = _AUTO_TRIGGER_S + 2.0 * self._record_s
        if count > 1:
            lasts_s += max(count * (_RECORDS_A_TRIGGER * self._record_s + _REARM_S), _LEAST_MEAN_S)
        deadline = self._session.deadline(self._session.timeout_s + lasts_s)
        with self._session.exclusive():
            self._session.send(*how, f":DIG {sources}", deadline=deadline)
            self._session.query_int("*OPC?", deadline)
            self._session.check_errors(deadline)

    def measure_frequency_hz(self, channel: int) -> float:
        """Measure the frequency of the record; raises MeasurementError without a signal."""
        return self._session.query_reading(f":MEAS:FREQ? {self._source(channel)}", form=self.reading_form)

    def measure_amplitude_v(self, channel: int) -> float:
        """Measure half the peak-to-peak voltage of the record, V."""
        return self._session.query_reading(f":MEAS:VPP? {self._source(channel)}", form=self.reading_form) / 2.0

    def measure_phase_deg(self, channel: int, reference: int) -> float:
        """Measure the phase of `channel` against `reference`, deg in -180...180: positive when `channel` leads.

        The instrument takes the delay from the first source's edge to the second's, over the first's period: an edge
        of `channel` before that of `reference` is a positive delay (siblings' guides; unverified on this model).
        """
        question = f":MEAS:PHAS? {self._source(channel)},{self._source(reference)}"
        phase_deg = self._session.query_reading(question, form=self.reading_form)
        return 180.0 - (180.0 - phase_deg) % 360.0

    def waveform(self, channel: int, points: int = 1000) -> Waveform:
        """Download the record of `channel`; raises MeasurementError when any of it is clipped or missing."""
        import numpy as np  # noqa: PLC0415

        source = self._source(channel)
        require_within(self, "number of points", points, (100, 8_000_000), "points")
        with self._session.exclusive():
            self._session.write(
                f":WAV:SOUR {source}",
                f":WAV:FORM {self._format}",
                *([":WAV:BYT LSBF"] if self._format == "WORD" else []),
                ":WAV:UNS 1",
                f":WAV:POIN:MODE {'NORM' if points <= _NORMAL_RECORD else 'RAW'}",
                f":WAV:POIN {points}",
            )
            preamble = self._session.query_as(":WAV:PRE?", Preamble.parse)
            # 20 Mbit/s are what VXI-11 over 100-Mbit LAN was seen to give at worst.
            deadline = self._session.deadline(self._session.timeout_s + preamble.points / 250_000.0)
            codes = np.frombuffer(self._session.query_block(":WAV:DATA?", deadline), dtype=_CODES[self._format])
        if codes.size != preamble.points:
            raise self._error(
                FramingError, f"{source}: the preamble promises {preamble.points} points, {codes.size} came"
            )
        clipped = int(((codes == _CLIPPED_LOW) | (codes == 256**codes.itemsize - 1)).sum())
        missing = int((codes == _HOLE).sum())
        if clipped or missing:
            raise self._error(
                ClippedRecord if clipped else MeasurementError,
                f"{source}: {clipped} of {codes.size} points are clipped, {missing} are missing",
                hint="choose a larger scale or another offset",
            )
        return preamble.waveform(codes)

    def _source(self, channel: int) -> str:
        if channel not in CHANNELS:
            raise self._error(LimitError, f"there is no channel {channel}")
        return f"CHAN{channel}"

    def make_safe(self, deadline: Deadline) -> SafeReport:
        """Stop acquiring; the oscilloscope drives nothing."""
        return safely(self, self._prove_stopped, deadline)

    def _prove_stopped(self, deadline: Deadline) -> str:
        self._session.revive(deadline)
        self._tell_safe(":STOP", deadline=deadline)
        if self._session.query_int(":OPER:COND?", deadline) & _RUNNING:
            raise self._error(InstrumentError, "keeps running", command=":OPER:COND?")
        return "stopped"
