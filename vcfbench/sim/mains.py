"""Pick-up of the mains by leads: one sine each, in series with their ends."""

import math

import numpy as np
from msgspec import Struct
from simrack.adding import added
from simrack.sources import Drive, Played, Sine

from vcfbench.sim.parameters import PickUp

_STREAM = 3
"""Number of this random stream among those of the World's seed; see :mod:`.gyro.gyro`."""


class Mains(Struct, frozen=True):
    """Mains in the leads of the multimeters and of V_Vc; None without pick-up."""

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
        """Return a generator with the pick-up of its lead; a free lead has none."""
        caught = self.in_v_vc_lead
        if source is None or caught is None:
            return source
        return added(source, Drive(0.0, caught.amplitude_v, caught.frequency_hz, caught.phase_rad))
