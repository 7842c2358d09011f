"""Everything about the rate table."""

from msgspec import Struct

from vcfbench.bench.bench import Bench
from vcfbench.clock import Deadline, sleep
from vcfbench.errors import InterlockError, MeasurementError
from vcfbench.interfaces import RateTable
from vcfbench.station.limits import LimitChecks, driver_of
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.steps.step import Context, Effect, Step, StepResult, does, problem
from vcfbench.steps.wait import Settle

_POLL_S = 0.05
"""Interval of the queries whether the table is at its rate, s."""
_ABSOLUTE_TO_DEG_S = 200.0
"""Rate up to which a tolerance holds as it is told. What a table turns otherwise is a share of its rate beyond it: its
scale, and the ripple of its encoder (5 arcsec once a turn are 0.005 deg/s at 200 deg/s, 0.022 at 900)."""


def allowed_deg_s(rate_deg_s: float, tolerance_deg_s: float) -> float:
    """Return by how much a read-back may differ from a rate, deg/s: in proportion to the rate above 200 deg/s."""
    return tolerance_deg_s * max(1.0, abs(rate_deg_s) / _ABSOLUTE_TO_DEG_S)


class RateReading(StepResult, Struct, frozen=True):
    """The table has reached its rate: read-back (deg/s) and bench time (s)."""

    rate_deg_s: float
    t_s: float

    def describe(self) -> str:
        return f"reads {self.rate_deg_s:+.4f} deg/s"


@does(Effect.SETS, "table servo", "table enabled, at rest", overhead_s=0.1, also=("table rate",))
class EnableTable(Step, Struct, frozen=True):
    """Close the table's servo at zero demand."""

    def command(self, bench: Bench) -> None:
        bench.rate_table.enable()


@does(Effect.SETS, "table servo", "table disabled", overhead_s=0.1, also=("table rate",))
class DisableTable(Step, Struct, frozen=True):
    """Open the table's servo; the table is at rest."""

    def command(self, bench: Bench) -> None:
        bench.rate_table.disable()


@does(Effect.SETS, "table rate", overhead_s=0.02)
class SetRate(Step, Struct, frozen=True):
    """Start the table's ramp from `previous_deg_s` to `rate_deg_s`; :class:`AwaitRate` sees it through."""

    rate_deg_s: float
    acceleration_deg_s2: float
    previous_deg_s: float

    def describe(self) -> str:
        return f"table to {self.rate_deg_s:+g} deg/s at {self.acceleration_deg_s2:g} deg/s^2"

    @property
    def ramp_s(self) -> float:
        """Length of the ramp, s."""
        return abs(self.rate_deg_s - self.previous_deg_s) / self.acceleration_deg_s2

    def again(self) -> tuple[Step, ...]:
        """Ramp from rest, with the full time of that ramp: later steps only know the one from the rate before."""
        from_rest = SetRate(self.rate_deg_s, self.acceleration_deg_s2, 0.0)
        return (from_rest, Settle(from_rest.ramp_s, "the table ramps from rest")) if self.rate_deg_s else (from_rest,)

    def within(self, limits: LimitChecks) -> None:
        limits.motion(self.rate_deg_s, self.acceleration_deg_s2)

    def command(self, bench: Bench) -> None:
        bench.rate_table.set_rate(self.rate_deg_s, self.acceleration_deg_s2)


@does(Effect.WAITS, "table rate", overhead_s=0.1)
class AwaitRate(Step, Struct, frozen=True):
    """Wait for the ramp, then until the table says at-rate *and* its read-back is within the tolerance of that rate."""

    rate_deg_s: float
    ramp_s: float
    tolerance_deg_s: float
    deadline_s: float

    def describe(self) -> str:
        return f"table at {self.rate_deg_s:+g} deg/s, read-back within {self._allowed_deg_s:g} deg/s"

    @property
    def _allowed_deg_s(self) -> float:
        return allowed_deg_s(self.rate_deg_s, self.tolerance_deg_s)

    @property
    def physical_s(self) -> float:
        return self.ramp_s

    def perform(self, context: Context) -> RateReading:
        """Wait; InterlockError for a fault meanwhile, MeasurementError when the rate is not reached in time."""
        clock, table = context.bench.clock, context.bench.rate_table
        deadline = Deadline.after(clock, self.deadline_s)
        sleep(clock, self.ramp_s)
        while True:
            require_no_fault(table)
            at_rate, reading = table.at_rate(), table.rate_deg_s()
            if at_rate and abs(reading - self.rate_deg_s) <= self._allowed_deg_s:
                return RateReading(reading, clock.now())
            if deadline.expired():
                raise self.not_reached(context, reading, at_rate=at_rate)
            sleep(clock, _POLL_S)

    def not_reached(self, context: Context, reading: float, *, at_rate: bool) -> MeasurementError:
        """Return the error with the keys that decide."""
        off, judged = abs(reading - self.rate_deg_s) > self._allowed_deg_s, ""
        said = f"not at {self.rate_deg_s:+g} deg/s within {self.deadline_s:.3g} s: reads {reading:+.9g} deg/s, "
        said += f"{self._allowed_deg_s:g} off allowed"
        if not at_rate:
            judged = getattr(driver_of(context.bench.rate_table), "judges_rate_by", "")
            said += f", not steady by {judged}" if judged else ", not steady as the table reports"
        keys = ["rate_tolerance_deg_s allows more"] if off else []
        keys += ["[at_rate] of the profile allows more, by a larger tolerance_deg_s or fewer polls"] if judged else []
        keys += ["rate_deadline_s waits longer", "where a profile takes the rate from angles, a longer span_s"]
        return _disbelieved(context, said, "; ".join(keys))

    def predict(self, gyro: LinearGyro) -> RateReading:
        return RateReading(self.rate_deg_s, 0.0)


def require_no_fault(table: RateTable) -> None:
    """Raise InterlockError when a fault has latched at the table."""
    fault = table.fault()
    if fault is not None:
        raise InterlockError(f"fault: {fault}", instrument=table.name, resource=table.resource)


def read_rate(context: Context, rate_deg_s: float, tolerance_deg_s: float) -> float:
    """Read the table's rate back, deg/s; it must have no fault and be within its tolerance of `rate_deg_s`.

    Raises:
        InterlockError: a fault has latched.
        MeasurementError: it turns otherwise.
    """
    table = context.bench.rate_table
    require_no_fault(table)

    def left(reading: float) -> str:
        if abs(reading - rate_deg_s) <= allowed_deg_s(rate_deg_s, tolerance_deg_s):
            return ""
        return f"left {rate_deg_s:+g} deg/s during the window: reads {reading:+.9g} deg/s"

    reading = context.believable(table.rate_deg_s, left)
    if said := left(reading):
        raise _disbelieved(context, said)
    return reading


def _disbelieved(context: Context, said: str, hint: str | None = None) -> MeasurementError:
    """Return the error of a table whose read-back is wrong, so that it proves no rest."""
    table = context.bench.rate_table
    if "rate_table" not in context.bench.by_hand:  # a person who types the rate looks at the table
        context.bench.disbelieve(table.name, said)
    return problem(table, said, hint)
