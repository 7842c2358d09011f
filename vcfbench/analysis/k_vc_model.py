"""K_Vc in closed form: its dependence on frequencies, damping, phases and feed-through, and its change with them.

Equation (16) of Wang et al. (2018) with both sense modes, their damping, phases of carrier and demodulator, combs that
excite the modes in another proportion than a rate does, and a feed-through; derived in docs/theory.md. What has no
other way to be known, the absolute force of the combs and the mass, is a factor that no function here returns.
"""

import cmath
import math
from collections.abc import Mapping

from msgspec import Struct
from msgspec.structs import replace

_TURN = 2.0 * math.pi


class Gyroscope(Struct, frozen=True, kw_only=True):
    """Measurable parameters of a gyroscope that K_Vc depends on; the drive is held at its resonance."""

    drive_hz: float
    split_hz: float
    """Drive less anti-phase sense frequency."""
    q_anti_phase: float
    in_phase_split_hz: float
    """Drive less in-phase sense frequency."""
    q_in_phase: float
    in_phase_share: float
    """Part of the in-phase mode in the static response to V_Vc, each mode by its stiffness at the drive frequency."""
    carrier_phase_deg: float
    """Phase of the carrier against the drive's velocity, apart from half turns: 0 is ideal."""
    demodulator_phase_deg: float
    """Phase of the demodulator's reference against the same."""
    comb_mismatch: float
    """In-phase over anti-phase force of the combs, over the same of a rate, less 1; 0 for equal combs."""
    v_vc_feedthrough: float
    """Carrier modulated by V_Vc in the sense signal without motion, over the modes' answer to V_Vc."""
    drive_amplitude_v: float
    """Amplitude of the drive signal; in any unit, if it is the same in all that is compared."""
    carrier_amplitude_v: float
    """Amplitude of the carrier, likewise."""


QUANTITIES = Gyroscope.__struct_fields__
"""The names of all that K_Vc depends on."""


class _Mode(Struct, frozen=True):
    """1/(P + jR) of a sense mode at the drive frequency, and its derivatives by drive frequency, split and Q."""

    answer: complex
    by_drive: complex
    by_split: complex
    by_q: complex


def _mode(drive_hz: float, split_hz: float, q: float) -> _Mode:
    drive, own = _TURN * drive_hz, _TURN * (drive_hz - split_hz)
    answer = 1.0 / complex(own**2 - drive**2, own * drive / q)
    falls = -(answer**2)
    return _Mode(
        answer,
        falls * _TURN * complex(2.0 * (own - drive), (own + drive) / q),
        falls * -_TURN * complex(2.0 * own, drive / q),
        falls * complex(0.0, -own * drive / q**2),
    )


class _Worked(Struct, frozen=True):
    """K_Vc of a gyroscope, in a unit of combs and mass, and its terms."""

    k_vc: float
    anti_phase: _Mode
    in_phase: _Mode
    weight: float
    """Force times pick-off of the in-phase mode over those of the anti-phase mode, for a rate."""
    through: float
    """Feed-through in the unit of 1/(P + jR) of the anti-phase mode."""
    by_v_vc: complex
    by_rate: complex
    """Responses to V_Vc and to a rate, in one unit."""
    turns: tuple[complex, complex]
    """Those of their phasors against the demodulator."""

    def change(self, by_v_vc: complex, by_rate: complex) -> float:
        """Return the relative derivative of K_Vc for those of both responses."""
        v_vc, rate = self.turns
        seen = (v_vc * self.by_v_vc).real, (rate * self.by_rate).real
        return (v_vc * by_v_vc).real / seen[0] - (rate * by_rate).real / seen[1]


def _stiffness(anti_phase: _Mode, in_phase: _Mode) -> float:
    """Return the stiffness of the in-phase mode at the drive frequency over that of the other."""
    return (1.0 / in_phase.answer).real / (1.0 / anti_phase.answer).real


def _worked(of: Gyroscope, weight: float | None = None, through: float | None = None) -> _Worked:
    """Work it out; `weight` and `through` where they are known otherwise than by `of`.

    Neither depends on frequencies and losses.
    """
    anti_phase, in_phase = (
        _mode(of.drive_hz, *each) for each in ((of.split_hz, of.q_anti_phase), (of.in_phase_split_hz, of.q_in_phase))
    )
    mismatch = 1.0 + of.comb_mismatch
    if weight is None:
        weight = of.in_phase_share / (1.0 - of.in_phase_share) * _stiffness(anti_phase, in_phase) / mismatch
    moved = anti_phase.answer + weight * mismatch * in_phase.answer
    through = of.v_vc_feedthrough * abs(moved) if through is None else through
    by_v_vc, by_rate = moved + through, anti_phase.answer + weight * in_phase.answer
    carrier, demodulator = math.radians(of.carrier_phase_deg), math.radians(of.demodulator_phase_deg)
    turns = cmath.exp(1j * (carrier - demodulator)), cmath.exp(-1j * demodulator)
    ratio = (turns[0] * by_v_vc).real / (turns[1] * by_rate).real
    k_vc = of.carrier_amplitude_v / (of.drive_amplitude_v * of.drive_hz) * ratio
    return _Worked(k_vc, anti_phase, in_phase, weight, through, by_v_vc, by_rate, turns)


def change_ppm(then: Gyroscope, now: Mapping[str, float]) -> float:
    """Return the increase of K_Vc, ppm, if the quantities `then` take their values in `now`.

    It is exact however large the change is. Force and pick-off of both modes stay as they were where neither
    `in_phase_share` nor `comb_mismatch` is in `now`, and so does the feed-through, in volts a volt.
    """
    before = _worked(then)
    weight = None if "in_phase_share" in now else before.weight
    through = None if "v_vc_feedthrough" in now else before.through
    return 1e6 * (_worked(replace(then, **now), weight, through).k_vc / before.k_vc - 1.0)


def sensitivities(of: Gyroscope) -> dict[str, float]:
    """Return the derivatives of K_Vc by each of `QUANTITIES`, the others held, ppm for one unit of it.

    Those by Q, by the splits and by the drive frequency hold force and pick-off of both modes, as `change_ppm` does.
    """
    worked, mismatch, degree = _worked(of), 1.0 + of.comb_mismatch, 1j * math.pi / 180.0
    anti_phase, in_phase, change = worked.anti_phase, worked.in_phase, worked.change
    weight, mismatched = worked.weight, worked.weight * mismatch
    by_share = _stiffness(anti_phase, in_phase) / (1.0 - of.in_phase_share) ** 2
    by_drive = change(
        anti_phase.by_drive + mismatched * in_phase.by_drive, anti_phase.by_drive + weight * in_phase.by_drive
    )
    found = {
        "drive_hz": by_drive - 1.0 / of.drive_hz,
        "split_hz": change(anti_phase.by_split, anti_phase.by_split),
        "q_anti_phase": change(anti_phase.by_q, anti_phase.by_q),
        "in_phase_split_hz": change(mismatched * in_phase.by_split, weight * in_phase.by_split),
        "q_in_phase": change(mismatched * in_phase.by_q, weight * in_phase.by_q),
        "in_phase_share": change(by_share * in_phase.answer, by_share / mismatch * in_phase.answer),
        "carrier_phase_deg": change(degree * worked.by_v_vc, 0j),
        "demodulator_phase_deg": change(-degree * worked.by_v_vc, -degree * worked.by_rate),
        "comb_mismatch": change(weight * in_phase.answer, 0j),
        "v_vc_feedthrough": change(complex(abs(anti_phase.answer + mismatched * in_phase.answer)), 0j),
        "drive_amplitude_v": -1.0 / of.drive_amplitude_v,
        "carrier_amplitude_v": 1.0 / of.carrier_amplitude_v,
    }
    return {name: 1e6 * value for name, value in found.items()}
