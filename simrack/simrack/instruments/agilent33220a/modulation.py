"""Signals of a 33220A from its settings.

Nothing is on its connectors Modulation In and Trig In: external AM is the carrier at half its amplitude, external FM,
PM, PWM and FSK are the carrier alone, a gate is closed (NORMal) or open (INVerted), external triggers never come.
Sync, trigger output and the marker are outputs of which nothing on the bench takes notice.
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING

from msgspec.structs import replace

from simrack.instruments.agilent33220a.settings import SOURCE_OHM
from simrack.sources import Drive, Sine

if TYPE_CHECKING:
    from simrack.instruments.agilent33220a.arbitrary import ArbitraryMemory
    from simrack.instruments.agilent33220a.envelopes import Envelope, WidthSwing
    from simrack.instruments.agilent33220a.levels import Levels
    from simrack.instruments.agilent33220a.phases import Phase, Rhythm
    from simrack.instruments.agilent33220a.settings import GeneratorErrors, GeneratorSettings, Keying, Modulation
    from simrack.instruments.agilent33220a.waveforms import Cycle
    from simrack.sources import Played

_TIMED_SHARE = 0.8
"""The edge time is from 10 to 90 % (33250A guide p. 168; for this model unverified)."""
_SQUARE_EDGE_S = 13e-9 / _TIMED_SHARE
"""Edges of a square wave from end to end (data sheet, unverified: below 13 ns from 10 to 90 %)."""
_NOISE_POINTS = 1 << 16
_NOISE_CYCLES_HZ = 2.0
"""Modulating noise is 65536 values, over and over, each held for 7.6 us; of the real one no more is known."""


@cache
def pseudo_random_bits() -> list[float]:
    """Return the 127 bits of PN7, of x^7 + x^6 + 1 (which polynomial a real one takes is unverified)."""
    register, bits = 0x7F, []
    for _ in range(127):
        bits.append(1.0 if register & 0x40 else -1.0)
        register = (register << 1 | (register >> 6 ^ register >> 5) & 1) & 0x7F
    return bits


class Player:
    """Makes the source that fits the settings, its phase going on from where it was.

    Args:
        noise_seed: which noise it is.
        clock_hz: at which arbitrary points are looked up; 0 for none.
    """

    def __init__(
        self,
        settings: GeneratorSettings,
        errors: GeneratorErrors,
        levels: Levels,
        memory: ArbitraryMemory,
        noise_seed: int,
        *,
        clock_hz: float = 0.0,
    ) -> None:
        self._settings = settings
        self._errors = errors
        self._levels = levels
        self._memory = memory
        self._noise_seed = noise_seed
        self._clock_hz = clock_hz
        self._phase: Phase | None = None

    def source(self, started_s: float | None, now_s: float) -> Drive | Played:
        """Return the output from `now_s` on.

        `started_s` is when a burst or sweep began or will begin, None while it waits for its trigger.
        """
        settings, direct = self._settings, self._levels.direct_v()
        function = settings.function
        if function == "DC" or (function == "NOIS" and not self._gate_open()):
            return Drive(direct, source_ohm=SOURCE_OHM)
        peak = self._levels.peak_v() * (1.0 + self._errors.amplitude_error)
        if function == "NOIS":
            return self._noise(direct, peak)
        if settings.polarity == "INV":  # turns the waveform over, not the offset
            peak = -peak
        phase = self._turned(started_s, now_s)
        if phase is None:
            import numpy as np  # noqa: PLC0415

            between_bursts = float(self._waveform().values(np.array([self._burst_phase() % 1.0]))[0])
            return Drive(direct + peak * between_bursts, source_ohm=SOURCE_OHM)
        return self._sine(direct, peak, phase) or self._playing(direct, peak, phase)

    def _noise(self, direct_v: float, peak_v: float) -> Played:
        from simrack.instruments.agilent33220a.noise import CREST, NoiseSource  # noqa: PLC0415  (numpy only where played)

        return NoiseSource(direct_v, peak_v / CREST, self._noise_seed, SOURCE_OHM)

    def _sine(self, direct_v: float, peak_v: float, phase: Phase) -> Drive | None:
        """Return a sine with the sidebands of AM by another sine in closed form; None where it is not that simple."""
        from simrack.instruments.agilent33220a.phases import Steady  # noqa: PLC0415

        if self._settings.function != "SIN" or not isinstance(phase, Steady):
            return None
        depth = self._depth()
        if depth and (self._settings.am.function != "SIN" or depth > 1.0):
            return None
        size = abs(peak_v) if depth is None else abs(peak_v) / 2.0
        turn = math.remainder(math.tau * phase.cycles, math.tau) + (0.0 if peak_v >= 0.0 else math.pi)
        sidebands: tuple[Sine, ...] = ()
        if depth:
            apart_hz, quarter, size_v = (
                self._exact_hz(self._settings.am.frequency_hz),
                math.pi / 2.0,
                size * depth / 2.0,
            )
            sidebands = (
                Sine(size_v, phase.hz - apart_hz, turn + quarter),
                Sine(size_v, phase.hz + apart_hz, turn - quarter),
            )
        return Drive(direct_v, size, phase.hz, turn, SOURCE_OHM, sidebands)

    def _playing(self, direct_v: float, peak_v: float, phase: Phase) -> Played:
        from simrack.instruments.agilent33220a.playing import Playing  # noqa: PLC0415

        envelope = self._envelope(direct_v, peak_v)
        clock_hz = self._clock_hz if self._settings.function == "USER" else 0.0
        return Playing(direct_v, peak_v, self._waveform(), phase, envelope, self._width(), SOURCE_OHM, clock_hz)

    def absorb_phase(self) -> None:
        """Call the present phase 0."""
        if self._phase is not None:
            added = self._settings.phase_deg / 360.0
            self._phase = replace(self._phase, cycles=self._phase.cycles + added)
        self._settings.phase_deg = 0.0

    # --- the waveform -------------------------------------------------------------------------------------------

    def _waveform(self) -> Cycle:
        from simrack.instruments.agilent33220a import waveforms as shapes  # noqa: PLC0415

        settings, hz = self._settings, self._settings.frequency_hz
        match settings.function:
            case "SIN":
                return shapes.SineCycle()
            case "RAMP" | "TRI" as function:
                return shapes.ramp(0.5 if function == "TRI" else settings.symmetry_percent / 100.0)
            case "PRBS":
                return shapes.held(pseudo_random_bits())
            case "SQU":
                return shapes.PulseCycle(settings.duty_percent / 100.0, _SQUARE_EDGE_S * hz)
            case "PULS":
                duty = min(settings.width_s * hz, 1.0)
                return shapes.PulseCycle(duty, min(settings.edge_s / _TIMED_SHARE * hz, duty, 1.0 - duty))
        return self._memory.waveform(settings.user)

    def _depth(self) -> float | None:
        """Return the depth of AM, None where there is no AM."""
        if self._settings.mode != "AM":
            return None
        return 0.0 if self._settings.am.source != "INT" else float(self._settings.am_depth_percent) / 100.0

    def _envelope(self, direct_v: float, peak_v: float) -> Envelope | None:
        from simrack.instruments.agilent33220a.envelopes import HIGHEST_PEAK_V, Envelope  # noqa: PLC0415

        depth = self._depth()
        if depth is None:
            return None
        most = max(HIGHEST_PEAK_V - abs(direct_v), 0.0) / abs(peak_v)
        return Envelope(depth, self._rhythm(self._settings.am), most)

    def _width(self) -> WidthSwing | None:
        from simrack.instruments.agilent33220a.envelopes import WidthSwing  # noqa: PLC0415

        settings = self._settings
        if settings.mode != "PWM" or settings.pwm.source != "INT":
            return None
        hz = settings.frequency_hz
        return WidthSwing(settings.width_s * hz, settings.pwm_deviation_s * hz, self._rhythm(settings.pwm))

    def _rhythm(self, modulation: Modulation) -> Rhythm:
        """Return the internal modulating waveform; noise keeps its own pace."""
        from simrack.instruments.agilent33220a import waveforms as shapes  # noqa: PLC0415
        from simrack.instruments.agilent33220a.phases import Rhythm  # noqa: PLC0415

        hz = self._exact_hz(modulation.frequency_hz)
        match modulation.function:
            case "SIN":
                return Rhythm(shapes.SineCycle(), hz)
            case "SQU":
                return Rhythm(shapes.PulseCycle(0.5), hz)
            case "NOIS":
                import numpy as np  # noqa: PLC0415

                from simrack.instruments.agilent33220a.noise import CREST, gaussian  # noqa: PLC0415
                from simrack.instruments.agilent33220a.waveforms import held  # noqa: PLC0415

                drawn = gaussian(self._noise_seed, 32, np.arange(_NOISE_POINTS)) / CREST
                return Rhythm(held(np.clip(drawn, -1.0, 1.0).tolist()), _NOISE_CYCLES_HZ)
            case "USER":
                return Rhythm(self._memory.waveform(self._settings.user), hz)
        return Rhythm(shapes.ramp({"RAMP": 1.0, "NRAM": 0.0, "TRI": 0.5}[modulation.function]), hz)

    # --- the phase ----------------------------------------------------------------------------------------------

    def _exact_hz(self, hz: float) -> float:
        """Return a frequency by the specimen's own time base."""
        return hz * (1.0 + self._errors.frequency_error)

    def _turned(self, started_s: float | None, now_s: float) -> Phase | None:
        """Return the phase with PHASe added; bursts begin at their own, None while there is none to come."""
        if self._settings.mode == "BURS" and not self._gate_open():
            gated = self._settings.burst_mode == "GAT"
            return None if gated or started_s is None else self._bursts(started_s)
        from simrack.instruments.agilent33220a.phases import continued  # noqa: PLC0415

        self._phase = continued(self._running(started_s), self._phase, now_s)
        added = self._settings.phase_deg / 360.0
        return replace(self._phase, cycles=self._phase.cycles + added) if added else self._phase

    def _gate_open(self) -> bool:
        """Return True if it runs on: no burst at all, or one gated by an open input, which is low."""
        settings = self._settings
        gated = settings.burst_mode == "GAT" and settings.gate == "INV"
        return bool(settings.mode != "BURS" or gated)

    def _burst_phase(self) -> float:
        """Return the phase at which bursts begin, cycles; pulses have no other than 0 (33250A guide, unverified)."""
        return 0.0 if self._settings.function == "PULS" else float(self._settings.burst_phase_deg) / 360.0

    def _bursts(self, started_s: float) -> Phase:
        from simrack.instruments.agilent33220a.phases import Bursts  # noqa: PLC0415

        settings, hz, turn = self._settings, self._exact_hz(self._settings.frequency_hz), self._burst_phase()
        period = settings.burst_period_s / (1.0 + self._errors.frequency_error)
        return Bursts(hz, settings.cycles, started_s, period if settings.trigger == "IMM" else math.inf, turn)

    def _running(self, started_s: float | None) -> Phase:
        from simrack.instruments.agilent33220a import phases  # noqa: PLC0415
        from simrack.instruments.agilent33220a import waveforms as shapes  # noqa: PLC0415

        settings, hz, mode = self._settings, self._exact_hz(self._settings.frequency_hz), self._settings.mode
        if mode == "SWE":
            return self._sweep(started_s)
        if mode == "BPSK":  # of the Trueform series: between 0 and its phase
            keyed = phases.Rhythm(shapes.PulseCycle(0.5), self._exact_hz(settings.bpsk.rate_hz))  # type: ignore[attr-defined]
            return phases.Shifted(hz, settings.bpsk_phase_deg / 720.0, keyed)  # type: ignore[attr-defined]
        modulations: dict[str, Modulation | Keying] = {"FM": settings.fm, "PM": settings.pm, "FSK": settings.fsk}
        modulation = modulations.get(mode)
        if modulation is not None and modulation.source == "INT":
            if mode == "FM":
                return phases.Deviated(hz, self._exact_hz(settings.fm_deviation_hz), self._rhythm(settings.fm))
            if mode == "PM":
                return phases.Shifted(hz, settings.pm_deviation_deg / 360.0, self._rhythm(settings.pm))
            return phases.Keyed(hz, self._exact_hz(settings.fsk.frequency_hz), self._exact_hz(settings.fsk.rate_hz))
        return phases.Steady(hz)

    def _sweep(self, started_s: float | None) -> Phase:
        from simrack.instruments.agilent33220a.phases import Steady, Swept  # noqa: PLC0415

        settings = self._settings
        start, stop = self._exact_hz(settings.start_hz), self._exact_hz(settings.stop_hz)
        if started_s is None:
            return Steady(start)
        lasts = settings.sweep_s / (1.0 + self._errors.frequency_error)
        return Swept(start, stop, lasts, settings.spacing == "LOG", started_s, settings.trigger == "IMM")
