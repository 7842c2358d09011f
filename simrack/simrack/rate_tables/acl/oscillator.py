"""The oscillator of the ACUTROL3000, which SYNTHESIS mode follows (TM-8004-C 4.2.19 and 4.7)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from msgspec import Struct

from simrack.motion import Swing
from simrack.rate_tables.acl.arguments import Action, Arguments, Query, check_axis, counted, number, word
from simrack.rate_tables.acl.refusal import OUT_OF_RANGE, Refusal
from simrack.rate_tables.acl.replies import decimal

if TYPE_CHECKING:
    from simrack.rate_tables.acl.demand import Demand
    from simrack.rate_tables.acl.drive import AclDrive
    from simrack.rate_tables.acl.limits import AclLimits

_SETTLE_S = 0.15
"""Pause for the rate loop before a turning axis that was stopped begins to oscillate (chosen)."""


class OscillatorSetup(Struct, frozen=True):
    """Configure:Oscillator (TM-8004-C 4.2.19). Power-on values are chosen; a frequency is taken at once, not slewed."""

    enabled: str = "Disable"
    amplitude_slew: float = 10.0
    frequency_slew: float = 1.0
    amplitude_of: str = "Position"
    frequency_mode: str = "Linear"


class Oscillator:
    """Oscillates about where the axis stands, by the demanded magnitude, frequency and phase."""

    def __init__(self, drive: AclDrive, limits: AclLimits, demand: Demand) -> None:
        self._drive = drive
        self._clock = drive.clock
        self._motion = drive.motion
        self._limits = limits
        self._demand = demand
        self._setup = OscillatorSetup()
        self._swing: Swing | None = None
        self._swing_s = 0.0
        self.due_s: float | None = None
        """When an axis that is being stopped begins to oscillate."""

    def start(self) -> None:
        """Oscillate about the present position; a turning axis is stopped first, for it would have no centre."""
        if not self._motion.oscillating and self._motion.profile_rate_deg_s():
            self._motion.demand_rate(0.0, *self._limits.of("Synthesis").ramps)
            self.due_s = self._motion.complete_s + _SETTLE_S
        else:
            self._begin()

    def cancel(self) -> None:
        """Do not begin to oscillate; an oscillation that has begun is not touched."""
        self.due_s = None

    def advance(self) -> None:
        """Begin to oscillate if it is time; an axis that was shut down meanwhile does not."""
        if self.due_s is not None and self._clock.now() >= self.due_s:
            self.due_s = None
            if self._drive.follows:
                self._begin()

    def peak_deg_s(self) -> float:
        """Return the largest rate of the oscillation, deg/s."""
        return 0.0 if self._swing is None else abs(self._swing.to_deg) * 2 * math.pi * self._swing.frequency_hz

    def _begin(self) -> None:
        now, going = self._clock.now(), self._swing if self._motion.oscillating else None
        magnitude, frequency, phase = self._demand.oscillator
        if not frequency:
            self._stand()
            return
        slew = self._setup.amplitude_slew / self._per_degree(frequency)
        present, phase_rad = (0.0, math.radians(phase)) if going is None else _state_of(going, now - self._swing_s)
        self._swing = Swing(present, self._amplitude_deg(magnitude, frequency), slew, frequency, phase_rad)
        self._swing_s = now
        self._motion.oscillate(self._swing)

    def _stand(self) -> None:
        """Stand still: a sinusoid of frequency 0 is a constant."""
        self._swing = None
        self._motion.demand_rate(0.0, *self._limits.of("Synthesis").ramps)

    def _per_degree(self, frequency_hz: float) -> float:
        """Return how much of the regulated state a degree of amplitude is."""
        power = {"Position": 0, "Rate": 1, "Acceleration": 2}[self._setup.amplitude_of]
        return (2 * math.pi * frequency_hz) ** power

    def _amplitude_deg(self, magnitude: float, frequency_hz: float) -> float:
        """Return the amplitude that the limits of SYNTHESIS mode leave of what was demanded, deg."""
        limits, turning = self._limits.of("Synthesis"), 2 * math.pi * frequency_hz
        most = min(limits.rate_deg_s / turning, limits.acceleration_deg_s2 / turning**2)
        return max(-most, min(most, magnitude / self._per_degree(frequency_hz)))

    def commands(self) -> dict[str, Action]:
        """Return how it can be configured."""
        return {"Configure:Oscillator": self._configure}

    def queries(self) -> dict[str, Query]:
        """Return what can be asked about its configuration."""
        return {"Configure:Oscillator": self._ask_setup}

    def _configure(self, arguments: Arguments) -> None:
        axis, enabled, amplitude, frequency, amplitude_of, frequency_mode = counted(arguments, 6)
        check_axis((axis,))
        slews = number(amplitude), number(frequency)
        if min(slews) <= 0.0:
            raise Refusal(OUT_OF_RANGE)
        state = word(amplitude_of, ("Position", "Rate", "Acceleration"))
        mode = word(frequency_mode, ("Linear", "Logarithmic"))
        self._setup = OscillatorSetup(word(enabled, ("Enable", "Disable")), *slews, state, mode)

    def _ask_setup(self, arguments: Arguments) -> str:
        check_axis(arguments, everything=False)
        setup = self._setup
        slews = decimal(setup.amplitude_slew), decimal(setup.frequency_slew)
        return ",".join((setup.enabled, *slews, setup.amplitude_of, setup.frequency_mode))


def _state_of(swing: Swing, elapsed_s: float) -> tuple[float, float]:
    """Return amplitude (deg) and phase (rad) that an oscillation has reached."""
    share = min(elapsed_s / swing.lasts_s, 1.0) if swing.lasts_s else 1.0
    reached = swing.from_deg + share * (swing.to_deg - swing.from_deg)
    return reached, swing.phase_rad + 2 * math.pi * swing.frequency_hz * elapsed_s
