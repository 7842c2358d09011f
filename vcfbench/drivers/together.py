"""Outputs of several gyroscopes, read at the same time."""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from vcfbench.clock import Clock, Deadline
from vcfbench.drivers.streams.reader import StreamReader
from vcfbench.errors import Aborted, BenchError, DeadlineExceeded, NotSafe
from vcfbench.interfaces import BeginsReadings, Identity, SafeReport, UnprovedCommand

_TURN_S = 0.005
"""Longest wait for the frames of one stream while others are read too."""


class Outputs:
    """The outputs of several gyroscopes, in the place of one multimeter, by the names of the devices.

    `missing` are those that could not be opened, set or asked for errors, each with its error.
    """

    safe_words = ""

    def __init__(
        self, of: Mapping[str, Any], identities: Mapping[str, Identity], missing: dict[str, BenchError]
    ) -> None:
        first = next(iter(of.values()))
        self._of = of
        self.identities = identities
        self.missing = missing
        self.name: str = first.name
        self.resource = ", ".join(dict.fromkeys(each.resource for each in of.values()))

    def of(self, device: str) -> Any:
        """Return the output of a device; raises its error where it is missing."""
        if device in self.missing:
            raise self.missing[device]
        return self._of[device]

    def identify(self) -> Identity:
        """Return the identity of the first: each was asked for its own when it was opened."""
        return next(iter(self.identities.values()))

    def check_errors(self) -> None:
        """See that none has an error."""
        self._have_each(lambda each: each.check_errors())

    def check_settings(self) -> None:
        """See that each is still set as it was."""
        self._have_each(_check_settings)

    def configure_dc_voltage(self, range_v: float, nplc: float) -> None:
        """Set range and integration time of each."""
        self._have_each(lambda each: each.configure_dc_voltage(range_v, nplc))

    def _have_each(self, do: Callable[[Any], None]) -> None:
        """Have each do something; one that fails is missing from then on, and raises where all are."""
        for name, each in self._of.items():
            if name not in self.missing:
                with kept(self.missing, name):
                    do(each)
        if self._of.keys() <= self.missing.keys():
            raise BenchError.joined(self.missing)

    def command_safe(self) -> UnprovedCommand:
        """Send each the words that make it safe."""
        sent = [each.command_safe() for each in self._of.values()]
        return UnprovedCommand("", sent=all(each.sent for each in sent))

    def make_safe(self, deadline: Deadline) -> SafeReport:
        """Make each safe; the error names the first that is not."""
        reports: list[SafeReport] = [each.make_safe(deadline) for each in self._of.values()]
        return next((each for each in reports if not each.safe), reports[0])

    def close(self) -> None:
        """Close each."""
        for each in self._of.values():
            each.close()


def _check_settings(output: Any) -> None:
    """Check what can be checked: a stream has no settings."""
    if (check := getattr(output, "check_settings", None)) is not None:
        check()


def read_together(meters: Mapping[str, Any], clock: Clock, within_s: float = math.inf) -> dict[str, float | BenchError]:
    """Read each meter once, all at the same time as far as they can; return the reading, or the error, of each.

    Streams are read in turns, and one that has no reading `within_s` is not waited for. Meters that begin a reading
    begin it together; others are read one after another. One that takes longer than `within_s` is an error.

    Raises:
        Aborted: a person or a signal stopped it.
    """
    found: dict[str, float | BenchError] = {}
    asked = {}
    for name, each in meters.items():
        if isinstance(each, BeginsReadings):
            asked[name] = each.begun_reading_v
            with kept(found, name):
                each.begin_reading()
        elif not isinstance(each, StreamReader):
            asked[name] = each.read_voltage_v
    _read_streams({name: each for name, each in meters.items() if isinstance(each, StreamReader)}, within_s, found)
    for name, ask in asked.items():
        if name in found:
            continue
        asked_s = clock.now()
        with kept(found, name):
            found[name] = ask()
            if (took_s := clock.now() - asked_s) > within_s:
                raise late(meters[name], f"its reading took {took_s:.2g} s, the others are read every {within_s:g} s")
    return found


def late(meter: Any, what: str) -> DeadlineExceeded:
    """Return the error of a meter that the others do not wait for."""
    return DeadlineExceeded(what, instrument=meter.name, resource=meter.resource)


def _read_streams(streams: Mapping[str, StreamReader], within_s: float, found: dict[str, float | BenchError]) -> None:
    under_way = {name: each.reading(_TURN_S) for name, each in streams.items()}
    over = [Deadline.after(each.clock, within_s) for each in streams.values()][:1]
    while under_way and not over[0].expired():
        for name, reading in tuple(under_way.items()):
            try:
                with kept(found, name):
                    next(reading)
            except StopIteration as end:
                found[name] = end.value
            if name in found:
                del under_way[name]
    for name in under_way:
        said = f"no reading in {within_s:g} s: the stream is silent, or too many frames are lost"
        found[name] = late(streams[name], said)


@contextmanager
def kept(found: dict[str, Any], name: str) -> Iterator[None]:
    """Keep the error of one, for the others go on."""
    try:
        yield
    except BenchError as error:
        if isinstance(error, NotSafe) or Aborted.behind(error) is not None:
            raise
        found[name] = error
