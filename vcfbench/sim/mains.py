"""Pick-up of the mains by leads: one sine each, in series with their ends."""

import cmath
import math

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from simrack.components import Component, Tone
from simrack.sources import Bend, Drive, Piece, Played, Sine

from vcfbench.sim.parameters import PickUp

_STREAM = 3
"""Number of this random stream among those of the World's seed; see :mod:`.gyro.gyro`."""


class Mains(Struct, frozen=True):
    """Mains in the leads of the multimeters and in that of V_Vc; None where nothing is."""

    in_meter_leads: Sine | None
    in_v_vc_lead: Sine | None
    in_v_vc_meter_leads: Sine | None = None

    @classmethod
    def drawn(cls, pick_up: PickUp, seed: int) -> "Mains":
        """Return the pick-up of a bench: frequency and phases by the seed."""
        random = np.random.default_rng([seed, _STREAM])
        frequency_hz = pick_up.mains_hz + pick_up.mains_deviation_hz * float(random.standard_normal())
        phases = random.uniform(0.0, math.tau, 3)

        def sine(rms_v: float, phase_rad: float) -> Sine | None:
            return Sine(math.sqrt(2.0) * rms_v, frequency_hz, phase_rad) if rms_v else None

        in_leads = (pick_up.meter_leads_v, pick_up.v_vc_lead_v, pick_up.meter_leads_v)
        return cls(*(sine(rms_v, float(phase)) for rms_v, phase in zip(in_leads, phases, strict=True)))

    def through_v_vc_lead(self, source: Drive | Played | None) -> Drive | Played | None:
        """Return a generator together with the pick-up of its lead; a lead that leads nowhere brings nothing."""
        if source is None or self.in_v_vc_lead is None:
            return source
        if isinstance(source, Drive):
            return source.with_overtone(self.in_v_vc_lead)
        return _Overlaid(source, self.in_v_vc_lead)


class _Overlaid(Struct, frozen=True):
    """A source that plays, and a small sine in series; of an input's curvature the sine sees none."""

    source: Played
    sine: Sine

    @property
    def source_ohm(self) -> float:
        """Series resistance, ohm."""
        return self.source.source_ohm

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the open-circuit volts at bench times."""
        return self.source.at(times_s) + self.sine.at(times_s)

    def piece(self, start_s: float, bend: Bend) -> Piece:
        """Return the pick-up after the input's non-linearity, from `start_s`."""
        played, speed = self.source.piece(start_s, bend), math.tau * self.sine.frequency_hz
        size = -1j * cmath.rect(bend[1] * self.sine.amplitude_v, speed * played.start_s + self.sine.phase_rad)
        terms = (*played.terms, (size, 1j * speed))
        return Piece(played.start_s, played.stop_s, played.constant, played.slope_per_s, terms)

    def divided(self, share: float) -> "_Overlaid":
        """Return the source behind a resistance that leaves `share` of its open voltage (Thevenin)."""
        sine = Sine(share * self.sine.amplitude_v, self.sine.frequency_hz, self.sine.phase_rad)
        return _Overlaid(self.source.divided(share), sine)

    def components(self) -> tuple[Component, ...]:
        """Return its components."""
        return *self.source.components(), Tone(self.sine)
