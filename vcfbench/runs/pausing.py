"""Pauses of a run on an open bench: to rest and looked at, later looked at again, and all as before.

Between pause and going on the rails stay on, so that the gyroscope stays warm. The output at rest with V_Vc off is read
before and after: by what it moved everything later is counted from a new reference.
"""

import math
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from typing import Final, Self

from msgspec import Struct

from vcfbench import steps
from vcfbench.belief.walk import Limits, sigmas
from vcfbench.bench.bench import Bench
from vcfbench.bench.ground import checked_pace
from vcfbench.clock import WallClock, sleep
from vcfbench.instructions.routines import meter_set, window_of
from vcfbench.runs.request import Prepared
from vcfbench.safety.control import RunControl
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps.events import Moved
from vcfbench.steps.replay import powered_after, set_again
from vcfbench.steps.step import Effect, Routine, Step, answer

_AT_REST: Final = frozenset(
    {
        *(steps.EnableTable.subject, steps.SetRate.subject),
        *("generator", steps.DisableVvc.subject, "V_Vc", steps.DisableVibration.subject, "virtual vibration"),
        *("multimeter", "V_Vc meter", "oscilloscope"),
    }
)
"""Subjects that may be set otherwise since a measurement, and the output at rest with V_Vc off be the same."""
_WINDOWS: Final = 2
"""Length of the reference, in windows of the run: values counted from the reference have its noise too."""


class Pausing(Struct, frozen=True):
    """Pauses of an executor by a run's control, and the steps around one.

    `drifts` tells that drift is the run's measurand. `pace` is how many seconds a second of the wall is on a bench
    whose time does not go on by itself. On a simulated bench that is as fast as it goes (0) bench time stands still in
    a pause, else it goes on as the wall does.
    """

    settings: ProcedureSettings
    drifts: bool
    control: RunControl
    bench: Bench
    pace: float

    @classmethod
    def of(cls, control: RunControl, bench: Bench, prepared: Prepared) -> Self:
        """Return it for a run that was `prepared`, on the open `bench`."""
        pace = checked_pace(prepared.description, prepared.request.speed) or 0.0
        return cls(prepared.settings, bool(prepared.procedure.in_one_piece), control, bench, pace)

    @property
    def by(self) -> str:
        """Source of the request for a pause, or ""."""
        return self.control.pause_by

    def wait(self) -> tuple[str, float]:
        """Wait until the run is to go on; return the source of that and the time waited, s of wall time."""
        waited = WallClock()
        by = self.control.wait()
        waited_s = waited.now()
        if self.pace:
            sleep(self.bench.clock, waited_s * self.pace)
        return by, waited_s

    def to_rest(self, done: Sequence[Step]) -> Routine[steps.Window | None]:
        """Bring the bench to rest after the steps `done`, and read the output, where something was measured before."""
        settings = self.settings
        if isinstance(_last(done, steps.DisableVvc.subject), steps.EnableVvc):
            yield steps.DisableVvc()
        if isinstance(_last(done, steps.DisableVibration.subject), steps.EnableVibration):
            yield steps.DisableVibration()
        turns = _last(done, steps.SetRate.subject)
        if isinstance(turns, steps.SetRate) and turns.rate_deg_s:
            stop = steps.SetRate(0.0, turns.acceleration_deg_s2, turns.rate_deg_s)
            yield stop
            deadline_s = 2.0 * stop.ramp_s + settings.rate_deadline_s
            yield steps.AwaitRate(0.0, stop.ramp_s, settings.rate_tolerance_deg_s, deadline_s)
        # Comparable is what was measured since rails, temperature or manual settings were changed
        changed = powered_after(done)
        for place, step in enumerate(done, 1):
            if step.effect is Effect.SETS and not _AT_REST.issuperset(step.sets):
                changed = place
        comparable = changed > 0 and any(step.effect is Effect.MEASURES for step in done[changed:])
        if self.bench.description.several:  # each plan sees by itself whether its output moved
            return None
        return (yield from self.looked_at(done)) if comparable else None

    def looked_at(self, done: Sequence[Step]) -> Routine[steps.Window]:
        """Read the output at rest, V_Vc off."""
        settings = self.settings
        yield from meter_set(settings)
        yield steps.Settle(settings.settle_s, "gyro settles, table at rest")
        held = isinstance(_last(done, steps.EnableTable.subject), steps.EnableTable)
        rails = next((step.rails for step in reversed(done) if isinstance(step, steps.Acquire)), ())
        window = {**window_of(settings), "rails": rails, "samples": _WINDOWS * settings.samples, "noise_v": None}
        return answer((yield steps.VerifyZero(0, 0.0, 0.0, 0.0 if held else None, **window)), steps.Window)

    def as_before(self, done: Sequence[Step], disturbed: AbstractSet[str]) -> Routine[None]:
        """Set again all that was `disturbed` by the pause, and wait as after a setting."""
        yield from set_again(done, disturbed)
        if disturbed - {"multimeter"}:
            yield steps.Settle(self.settings.settle_s, "gyro settles as it did before the pause")

    def moved(self, done: Sequence[Step], before: steps.Window, after: steps.Window) -> Moved:
        """Return the shift of the output from `before` to `after`, and the limit of its noise and drift."""
        settings, limits = self.settings, Limits.of(self.settings)
        one, other = before.point, after.point
        dof = one.n + other.n - 2
        scatter_v2 = ((one.n - 1) * one.std_v**2 + (other.n - 1) * other.std_v**2) / max(1, dof)
        variance = scatter_v2 * (1.0 / one.n + 1.0 / other.n) + settings.meter_resolution_v**2 / 6.0
        apart_s = after.readings[0].t_s - before.readings[0].t_s if before.readings and after.readings else 0.0
        length_s = max(1e-3, one.n * settings.sample_interval_s)
        variance += 2.0 / math.pi * limits.flicker_v**2 * (1.5 + math.log(max(1.0, apart_s / length_s)))
        u_v = max(math.sqrt(variance), 1e-12)
        if self.drifts:
            return Moved(one.output_v, other.output_v, u_v, None)
        warm_s = sum(step.physical_s for step in done[powered_after(done) :])
        cooled = math.exp(-warm_s / limits.warm_up_s) - math.exp(-(warm_s + apart_s) / limits.warm_up_s)
        drift_v = limits.warm_up_v * cooled + limits.wander_v
        return Moved(one.output_v, other.output_v, u_v, sigmas(dof) * u_v + drift_v)


def _last(done: Sequence[Step], subject: str) -> Step | None:
    """Return the last step that set `subject`."""
    return next((step for step in reversed(done) if subject in step.sets), None)
