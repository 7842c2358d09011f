"""The reader of a stream: a reading is the mean of the whole frames that began after it was asked for.

Between readings nobody reads the port; what has piled up is thrown away when the next is asked for. What cannot be
believed is no number: silence, too many lost frames, an output at its end, one number over and over, a status that
is not well, a clock that is further off than the bench file says. What can be left out is counted.
"""

import math
import re
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from statistics import stdev
from typing import Any

from vcfbench import errors
from vcfbench.clock import Clock, Deadline, sleep
from vcfbench.drivers.serial_wire import Link, serial_port
from vcfbench.drivers.streams.decoder import Decoder, Sample
from vcfbench.drivers.streams.description import Stream
from vcfbench.drivers.trace import BEHIND, Connect
from vcfbench.drivers.wire import Interface, Wire
from vcfbench.interfaces import Identity, SafeReport, UnprovedCommand

_MOST_LOST = 0.2
"""Share of the frames of a reading that may be missing or spoilt."""
_LATE_S = 0.02
"""By how much the arrival of a frame is uncertain: USB adapters hold bytes for up to 16 ms."""
_ALIKE = 20
"""Frames in a row, a whole reading at least, that say the same number of a device that is stuck."""
_POLL_S = 0.01
_BYTES = 65_536


class _FileWire:
    """A wire over a file that another program writes; its present content is skipped."""

    interface: Interface = "serial"

    def __init__(self, path: Path, clock: Clock) -> None:
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise errors.ConnectFailed(f"cannot be opened ({error.strerror or error})") from error
        self._file.seek(0, 2)
        self.clock = clock

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Raise LinkLost: a file takes no commands."""
        raise errors.LinkLost("a file takes no commands")

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        """Return the new bytes, waiting for the first."""
        while not (data := self.pending()):
            if deadline.expired():
                raise errors.DeadlineExceeded("no answer")
            sleep(self.clock, min(_POLL_S, deadline.remaining()))
        return data, False

    def pending(self) -> bytes:
        """Return the new bytes."""
        return self._file.read(_BYTES)

    def clear(self, deadline: Deadline) -> None:
        """Skip the new bytes."""
        self._file.seek(0, 2)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def stream_port(stream: Stream, port: str | None, clock: Clock) -> Connect:
    """Return the function that opens the wire of a stream, at `port` in place of the resource."""
    where = port or stream.resource
    if where.startswith("file:"):
        return lambda _: _FileWire(Path(where.removeprefix("file:")), clock)
    if found := re.fullmatch(r"ASRL(.+?)(?:::INSTR)?", where, re.IGNORECASE):
        where = f"COM{found[1]}" if found[1].isdigit() else found[1]
    link = Link(parity=stream.parity, stop_bits=stream.stop_bits)
    return serial_port(where, link, clock, stream.timeout_s, stream.baud_rate)


class StreamReader:
    """The output of a gyroscope with digital output, in the place of a multimeter.

    Readings are in `output_unit` of the stream, whatever their names say.
    """

    safe_words = ""

    def __init__(self, name: str, resource: str, connect: Connect, stream: Stream, clock: Clock) -> None:
        self.name = name
        self.resource = resource
        self.stream = stream
        self.clock = clock
        for behind in BEHIND.get():
            connect = behind(name, resource, clock, connect)
        self._wire: Wire = connect(Deadline.after(clock, stream.timeout_s))
        self._decoder = Decoder(stream)
        self._frames = self._dropped = self._repeated = 0
        self._longer: list[float] = []
        self._temperature_c: float | None = None
        self._alike, self._value = 0, math.nan
        self._first: tuple[float, int] | None = None
        self._last: tuple[float, int] | None = None

    def identify(self) -> Identity:
        """Wait for a frame; a stream has no identity, so the profile is its model.

        Raises:
            MeasurementError: bytes come, and no frame.
            DeadlineExceeded: nothing comes.
        """
        self.flush()
        next(filter(None, self._coming(self.stream.timeout_s + 3.0 / self.stream.sample_rate_hz, math.inf)))
        return Identity("", self.stream.name, "", "")

    def check_errors(self) -> None:
        """Do nothing: a stream has no error queue."""

    def configure_dc_voltage(self, range_v: float, nplc: float) -> None:
        """Do nothing: the bench file has range and integration time of a stream."""

    def read_voltage_v(self) -> float:
        """Return the mean output of the frames that begin now, over `aperture_s`, in the unit of the output.

        Raises:
            MeasurementError: the frames are no measurement.
            DeadlineExceeded: none come.
        """
        reading = self.reading(self.stream.timeout_s)
        try:
            while True:
                next(reading)
        except StopIteration as end:
            value: float = end.value
            return value

    def reading(self, turn_s: float) -> Generator[None, None, float]:
        """Take a reading as `read_voltage_v` does; yield at its request, and after each wait of at most `turn_s`.

        So several are taken at the same time, each in its turn.
        """
        stream = self.stream
        period_s = 1.0 / stream.sample_rate_hz
        asked_s = self.clock.now()
        self.flush()
        yield
        bad_before = self._decoder.bad
        wanted = max(2, round(stream.aperture_s * stream.sample_rate_hz))
        # a frame that comes sooner began before it was asked for
        from_s = asked_s + stream.latency_s + 2.0 * period_s
        taken: list[Sample] = []
        times_s: list[float] = []
        steps, repeated = 0, 0
        longest_s = stream.latency_s + (wanted + 3) * period_s * (1.0 + _MOST_LOST) + stream.timeout_s
        for found in self._coming(longest_s, turn_s):
            if found is None:
                yield
                continue
            sample, t_s = found
            if t_s < from_s or (sample.late and not taken):
                continue
            if taken:
                gone = 1
                if stream.counter is not None:
                    gone = ((sample.counter or 0) - (taken[-1].counter or 0)) % stream.counter.numbers
                if gone == 0:
                    repeated += 1
                    self._require(repeated <= wanted, "the same frame comes again and again: the device stands still")
                    continue
                steps += gone
            taken.append(sample)
            times_s.append(t_s)
            if steps + 1 >= wanted and not sample.late:
                break
        bad, dropped = self._decoder.bad - bad_before, steps + 1 - len(taken)
        self._frames += len(taken)
        self._dropped += dropped
        self._longer.append((times_s[-1] - times_s[0]) * stream.sample_rate_hz - steps)
        self._repeated += repeated
        lost = max(bad, dropped)
        self._require(
            lost <= _MOST_LOST * (len(taken) + lost),
            f"{dropped} frames of {steps + 1} are missing and {bad} were spoilt: look at the line and its speed",
        )
        self._require_well(taken)
        self._require_clock(taken, times_s, steps)
        if stream.temperature is not None:
            self._temperature_c = math.fsum(each.temperature_c or 0.0 for each in taken) / len(taken)
        return self._mean(taken, steps) * stream.per_unit

    def frames(self, within_s: float) -> list[tuple[float, Sample]]:
        """Return the whole frames of the next bytes with their bench times.

        None, where none come in time. Nothing is refused: they are not of a reading.
        """
        try:
            with self._located():
                data = self._wire.receive(Deadline.after(self.clock, within_s))[0]
        except errors.DeadlineExceeded:
            return []
        now_s = self.clock.now()
        return [(now_s, each) for each in self._decoder.feed(data)]

    def health(self) -> dict[str, Any]:
        """Return counts of the frames so far, and the device's clock against bench time.

        Without a counter the missing ones follow from the time that readings took. How late the first and the last
        frame of one arrive is as it happens, and is in `u_dropped`.
        """
        dropped, u_dropped = self._dropped, 0.0
        if self.stream.counter is None and len(self._longer) > 1:
            dropped = max(0, round(math.fsum(self._longer)))
            u_dropped = round(math.sqrt(len(self._longer)) * stdev(self._longer), 3)
        clock_ppm, u_clock_ppm = self._clock_ppm() or (None, None)
        return {
            "frames": self._frames,
            "dropped": dropped,
            "u_dropped": u_dropped,
            "bad": self._decoder.bad,
            "repeated": self._repeated,
            "clock_ppm": clock_ppm,
            "u_clock_ppm": u_clock_ppm,
            "temperature_c": self._temperature_c,
        }

    def command_safe(self) -> UnprovedCommand:
        """Return an empty command: a stream drives nothing."""
        return UnprovedCommand("", sent=True)

    def make_safe(self, deadline: Deadline) -> SafeReport:
        """Report the stream as safe: it has no output."""
        return SafeReport(self.name, self.resource, safe=True, detail="a stream, it has no output")

    def close(self) -> None:
        """Give the connection back."""
        self._wire.close()

    def flush(self) -> None:
        """Throw away the received bytes; the next may be in the middle of a frame."""
        with self._located():
            self._wire.clear(Deadline.after(self.clock, self.stream.timeout_s))
        self._decoder.reset()

    @contextmanager
    def _located(self) -> Iterator[None]:
        try:
            yield
        except errors.BenchError as error:
            error.instrument, error.resource = self.name, self.resource
            raise

    def _coming(self, within_s: float, turn_s: float) -> Iterator[tuple[Sample, float] | None]:
        """Yield the frames that come, with the bench time at which each was there; None at the end of each turn."""
        deadline, heard = Deadline.after(self.clock, within_s), 0
        silent = deadline.within(self.stream.timeout_s)
        while True:
            with self._located():
                try:
                    data = self._wire.receive(silent.within(turn_s))[0]
                except errors.DeadlineExceeded as error:
                    if not silent.expired():
                        yield None
                        continue
                    if not heard:
                        error.what, error.hint = "the stream is silent", "check that the device is on and sending"
                        raise
                    what = f"{heard} bytes came, and no whole frames for long enough"
                    hint = "check baud_rate, header, length, checksum, sample_rate_hz of [gyro.stream]"
                    raise errors.MeasurementError(what, hint=hint) from None
            heard += len(data)
            now_s = self.clock.now()
            for sample in self._decoder.feed(data):
                yield sample, now_s
            silent = deadline.within(self.stream.timeout_s)
            yield None

    def _require(self, well: bool, what: str) -> None:  # noqa: FBT001
        if not well:
            raise errors.MeasurementError(what, instrument=self.name, resource=self.resource)

    def _require_well(self, taken: list[Sample]) -> None:
        """Raise MeasurementError where frames say something that is no output."""
        ill = next((each.status for each in taken if each.status is not None), None)
        self._require(ill is None, f"the device reports a fault: its status is {ill or 0:#x}")
        at_end = sum(each.saturated for each in taken)
        self._require(not at_end, f"the output is saturated in {at_end} of {len(taken)} frames")
        for each in taken:  # of a slow stream over several readings
            self._alike = self._alike + 1 if each.value == self._value else 1
            self._value = each.value
        self._require(
            self._alike < max(_ALIKE, len(taken)) or self.stream.quiet,
            f"{self._alike} frames in a row report {self._value:g} {self.stream.unit}: it is stuck; if it is as "
            "quiet as that, set quiet = true in [gyro.stream]",
        )

    def _mean(self, taken: list[Sample], steps: int) -> float:
        """Return the mean output a frame, in the unit of the frame; of an angle its growth a second."""
        if self.stream.kind != "angle":
            return math.fsum(each.value for each in taken) / len(taken)
        turn = self.stream.turn
        grown = 0.0
        for before, after in pairwise(taken):
            step = after.value - before.value
            grown += step - turn * round(step / turn) if turn else step
        return grown / steps

    def _require_clock(self, taken: list[Sample], times_s: list[float], steps: int) -> None:
        """Hold the device's frames against bench time: within the reading, and since the first of the run."""
        rate_hz, counter = self.stream.sample_rate_hz, self.stream.counter
        lasted_s, due_s = times_s[-1] - times_s[0], steps / rate_hz
        allowed_s = 2.0 * _LATE_S + (0.0 if counter else _MOST_LOST * due_s) + 1e-6 * self.stream.clock_ppm * due_s
        self._require(
            abs(lasted_s - due_s) <= allowed_s + 1.0 / rate_hz,
            f"{steps} frames came in {lasted_s:.3f} s; at sample_rate_hz = {rate_hz:g} they take {due_s:.3f} s",
        )
        if counter is None or taken[-1].counter is None or taken[0].counter is None:
            return
        if self._last is None:
            self._first = self._last = (times_s[0], taken[0].counter)
        before_s, before = self._last
        foreseen = (times_s[-1] - before_s) * rate_hz
        step = (taken[-1].counter - before) % counter.numbers
        self._last = (times_s[-1], before + step + counter.numbers * round((foreseen - step) / counter.numbers))
        if clock := self._clock_ppm():
            off_ppm, u_ppm = clock
            self._require(
                abs(off_ppm) <= self.stream.clock_ppm + 2.0 * u_ppm,
                f"the device's clock is {off_ppm:+.0f} ppm off bench time (u {u_ppm:.0f}), "
                f"clock_ppm = {self.stream.clock_ppm:g} is what the bench file allows",
            )

    def _clock_ppm(self) -> tuple[float, float] | None:
        """Return the device's clock against bench time, ppm, fast positive, with its u; None in the first second."""
        if self._first is None or self._last is None or (lasted_s := self._last[0] - self._first[0]) < 1.0:
            return None
        frames = self._last[1] - self._first[1]
        u_s = math.hypot(_LATE_S, 1.0 / self.stream.sample_rate_hz) / math.sqrt(6.0)
        return 1e6 * (frames / self.stream.sample_rate_hz / lasted_s - 1.0), 1e6 * u_s / lasted_s
