"""Both sense modes of one ring-down, and their response to a V_Vc."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean

from msgspec import Struct

from vcfbench.errors import MeasurementError
from vcfbench.procedures.resonance import RingingMode, SenseDecay


class Modes(Struct, frozen=True):
    """Drive frequency and both modes, with the amplitudes as their record begins."""

    drive_hz: float
    anti_phase: RingingMode
    in_phase: RingingMode

    def answers(self, offset_hz: float) -> tuple[complex, complex]:
        """Return motion over force of both modes so far from the drive frequency; in one unit, not that of forces."""
        at_hz = self.drive_hz + offset_hz
        first, second = (
            1.0 / complex(mode.frequency_hz**2 - at_hz**2, mode.frequency_hz * at_hz / mode.q)
            for mode in (self.anti_phase, self.in_phase)
        )
        return first, second

    def answer(self, share: float, offset_hz: float) -> complex:
        """Return the response of both to V_Vc, `share` being that of the in-phase mode at the drive's own frequency."""
        stiff = [(1.0 / each).real for each in self.answers(0.0)]
        anti_phase, in_phase = self.answers(offset_hz)
        return -((1.0 - share) * stiff[0] * anti_phase + share * stiff[1] * in_phase)


def modes_of(decay: SenseDecay) -> Modes:
    """Return both modes, the one nearer to the drive as that in anti-phase.

    Raises:
        MeasurementError: only one rang down.
    """
    if len(decay.modes) < 2:
        raise MeasurementError(
            f"one sense mode alone rang down, at {decay.modes[0].frequency_hz:.1f} Hz", instrument="oscilloscope"
        )
    near, far = sorted(decay.modes, key=lambda mode: abs(mode.frequency_hz - decay.drive_hz))
    return Modes(decay.drive_hz, near, far)


def middle_of(found: Sequence[Modes]) -> Modes:
    """Return the mean of several ring-downs."""

    def mode(of: Sequence[RingingMode]) -> RingingMode:
        return RingingMode(
            fmean(each.frequency_hz for each in of),
            fmean(each.q for each in of),
            fmean(each.amplitude_v for each in of),
        )

    drive_hz = fmean(each.drive_hz for each in found)
    return Modes(drive_hz, mode([each.anti_phase for each in found]), mode([each.in_phase for each in found]))
