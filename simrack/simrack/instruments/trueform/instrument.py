"""Simulated 33500B and 33600A: a 33220A's output behind another command table, limits, memory and accuracy.

Sources: single pages of the Agilent 33500 Series Operating and Service Guide (p. 62 output termination; the VOLTage
subsystem), the maker's help pages, a driver made from the maker's SCPI description of the 33500B, and a users' record
of what a 33600A answers after ``*RST``. What none of them has is the 33220A's and unverified: times, the words of -221
and -222, what gives way to what.

The second channel of a model that has two is set and asked as the first; its output is on a node of a rack that names
one, else it leads nowhere.

Not simulated: modulation by the other channel, a suppressed carrier, hold and return of sweeps, the bandwidth of
noise, sums with other than sines, what a couple of channels has beside equal levels and frequencies, sequences,
lists, the timer as trigger, and the lower amplitudes of a 33600A at high frequencies.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar, Self

from msgspec import Struct
from msgspec.structs import replace

from simrack.clock import Clock
from simrack.instruments.agilent33220a.instrument import GeneratorWorld, SimulatedAgilent33220A
from simrack.instruments.agilent33220a.settings import GeneratorErrors, drawn_ranges
from simrack.instruments.trueform.arbitrary import MOST_POINTS, NamedWaveforms
from simrack.instruments.trueform.kinds import PRBS_BITS, SERIES_33500B, SERIES_33600A, TrueformSeries, kind
from simrack.instruments.trueform.levels import LimitedLevels, TrueformSettings
from simrack.scpi import CommandTable, ScpiEngine
from simrack.sources import Drive, Played, Sine
from simrack.specifications import KEYSIGHT_33500B

if TYPE_CHECKING:
    import numpy as np

_LONGEST_LINE = 15 * MOST_POINTS + 1024
_FREQUENCY_ERROR = 2e-6
"""Of the time base: 1 ppm a year and 1 ppm of temperature (general knowledge of the data sheet, unverified)."""


class TrueformErrors(GeneratorErrors, frozen=True):
    """Imperfections of one specimen; each is off at zero. The converter has 16 bits."""

    promised: ClassVar = (KEYSIGHT_33500B.setting, KEYSIGHT_33500B.offset_v)

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> TrueformErrors:
        """Return a specimen drawn uniformly within the data sheet (unverified, as the sheet says itself)."""
        sheet = KEYSIGHT_33500B
        errors = [
            (float(rng.uniform(-sheet.setting, sheet.setting)), float(rng.uniform(-1.0, 1.0)) * sheet.offset_v)
            for _ in sheet.ranges_v
        ]
        amplitude = float(rng.uniform(-0.01, 0.01))
        frequency = float(rng.uniform(-_FREQUENCY_ERROR, _FREQUENCY_ERROR))
        return cls(drawn_ranges(rng, errors, cls.promised), amplitude, frequency, sheet.bits, 4)


class _Unwired(Struct, frozen=True):
    """Surroundings of an output that leads nowhere."""

    clock: Clock

    def drive(self, node: str, source: Drive | Played | None) -> None:
        """Nobody sees it."""


class SimulatedTrueform(SimulatedAgilent33220A):
    """A generator of the series, made by :meth:`of_model`; arguments as of the 33220A.

    The second channel of those with two is on `second_node`, else on nothing. `first` is the generator whose second
    channel it is.
    """

    errors_class: ClassVar = TrueformErrors
    table_of: ClassVar[Callable[[int], CommandTable]]
    channels: ClassVar[int]
    longest_line: ClassVar[int] = _LONGEST_LINE
    series: ClassVar[TrueformSeries]
    state: TrueformSettings

    @classmethod
    def of_model(cls, model: str, sine_hz: float) -> type[Self]:
        """Return the simulated model of the series whose sines go up to `sine_hz`."""
        series = SERIES_33600A if model.endswith("A") else SERIES_33500B
        channels = 2 - int(model[4]) % 2
        own = {
            "own_name": model,
            "series": series,
            "kind": kind(series, sine_hz),
            "channels": channels,
            "table": cls.table_of(channels),
        }
        return type(cls.__name__, (cls,), {**own, "__doc__": cls.__doc__})

    def __init__(
        self,
        world: GeneratorWorld,
        errors: GeneratorErrors,
        interface: str = "usb",
        noise_seed: int = 0,
        model: str | None = None,
        *,
        node: str = "input",
        second_node: str | None = None,
        first: Self | None = None,
    ) -> None:
        self._first = first
        self.second: Self | None = None
        super().__init__(world, errors, interface, noise_seed, model, node=node)
        if first is None and self.channels == 2:
            wired = (_Unwired(world.clock), "") if second_node is None else (world, second_node)
            self.second = type(self)(wired[0], errors, interface, noise_seed + 1, model, node=wired[1], first=self)

    def made_engine(self, interface: str) -> ScpiEngine:
        """Return the message exchange, which the channels share."""
        return super().made_engine(interface) if self._first is None else self._first.engine

    def reset(self) -> None:
        """Take the *RST state on all channels."""
        super().reset()
        if self.second is not None:
            self.second.reset()

    def save(self, place: int) -> None:
        """*SAV, of all channels."""
        super().save(place)
        if self.second is not None:
            self.second.save(place)

    def recall(self, place: int) -> None:
        """*RCL, of all channels."""
        super().recall(place)
        if self.second is not None:
            self.second.recall(place)

    def operations_end_s(self) -> float:
        """*OPC, *OPC? and *WAI wait for the triggered bursts and sweeps of all channels."""
        own = super().operations_end_s()
        return own if self.second is None else max(own, self.second.operations_end_s())

    def put_out(self, source: Drive | Played) -> Drive | Played | None:
        """Return the output: none while a gate would have to open it, with a sum, with the other channel's signal."""
        if self.state.gating == "GAT":
            return None
        if self.state.mode == "SUM" and isinstance(source, Drive):
            share = self.state.sum_percent / 100.0
            added = Sine(source.amplitude_v * share, self.state.sum.frequency_hz, 0.0)
            source = replace(source, overtones=(*source.overtones, added))
        other = self.second if self._first is None else self._first
        if self.state.combined == "NONE" or other is None or not isinstance(source, Drive):
            return source
        theirs = other.state
        sine = Sine(other.levels.peak_v(), theirs.frequency_hz, 0.0)
        sines = (*source.overtones, sine) if theirs.function == "SIN" else source.overtones
        return replace(source, dc_v=source.dc_v + theirs.offset_v, overtones=sines)

    def update(self) -> None:
        """Put the present output on the World, and on the other channel if tracking is on."""
        super().update()
        state, other = self.state, self.second if self._first is None else self._first
        if other is None:
            return
        before = other.state.offset_v, other.state.vpp, other.state.frequency_hz
        if state.tracking != "OFF" or state.levels_coupled:
            other.state.offset_v, other.state.vpp = state.offset_v, state.vpp
        if state.tracking != "OFF" or state.frequencies_coupled:
            other.state.frequency_hz = state.frequency_hz
        if before != (other.state.offset_v, other.state.vpp, other.state.frequency_hz):
            SimulatedAgilent33220A.update(other)

    def reset_state(self) -> TrueformSettings:
        """Return the settings of ``*RST``."""
        return TrueformSettings(edge_s=self.series.edge_reset_s)

    def made_memory(self, full_scale: int) -> NamedWaveforms:
        """Return the waveform memory of the series."""
        self.waveforms = NamedWaveforms(full_scale)
        return self.waveforms

    def made_levels(self, errors: GeneratorErrors) -> LimitedLevels:
        """Return levels that keep within VOLTage:LIMit."""
        self.limited = LimitedLevels(self.state, errors, self.memory, self.engine.report)
        return self.limited

    def identity(self) -> str:
        """Return the reply of a real unit, but for the model."""
        return self.series.identity.format(self._model)

    def choose_arbitrary(self, name: str) -> None:
        """FUNCtion:ARBitrary: select a waveform; another length is another frequency at the same sample rate."""
        self.waveforms.points(name)
        self.state.user = name
        self.tune_arbitrary()
        self.update()

    def tune_arbitrary(self) -> None:
        """Take the frequency of the sample rate if an arbitrary waveform is selected; of the bit rate for PRBS."""
        if self.state.function == "PRBS":
            self.state.frequency_hz = self.state.bit_rate_hz / PRBS_BITS
        if self.state.function == "USER":
            self.state.frequency_hz = self.state.sample_rate_hz / len(self.waveforms.points(self.state.user))
