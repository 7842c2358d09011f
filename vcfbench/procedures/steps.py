"""The steps of which procedures are made: frozen values that say what to do, not how.

A procedure is a generator that yields steps and is sent their results (:data:`Plan`). Since a step is a value, a plan
can be walked without a bench: dry run, estimate of the time and limits read the same steps that the executor
performs. Every step has a `key` made of its own parameters, the same in each run, so that a journal can be replayed
against a plan.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass
from typing import ClassVar

from vcfbench.interfaces import Regulation  # noqa: TC001  # a record decodes by these annotations
from vcfbench.record.schema import Point

__all__ = [
    "Acquire",
    "AwaitDrive",
    "AwaitRate",
    "CheckRails",
    "ConfigureGenerator",
    "ConfigureMeter",
    "ConfigureRail",
    "DisableSupply",
    "DisableTable",
    "DisableVvc",
    "Done",
    "DriveReading",
    "EnableSupply",
    "EnableTable",
    "EnableVvc",
    "Note",
    "Outcome",
    "Plan",
    "RailReading",
    "RailsReading",
    "RateReading",
    "Reading",
    "SetRate",
    "SetVvc",
    "Settle",
    "Step",
    "StepResult",
    "VerifyZero",
    "VvcSetting",
    "Window",
]


@dataclass(frozen=True, slots=True)
class Reading:
    """One reading of the multimeter: bench time at which it was asked for (s) and voltage (V)."""

    t_s: float
    voltage_v: float


@dataclass(frozen=True, slots=True)
class Done:
    """A step was performed and there is nothing to tell."""


@dataclass(frozen=True, slots=True)
class RailReading:
    """What the supply says of one rail: voltage at the terminals (V), current (A) and regulation."""

    rail: str
    voltage_v: float
    current_a: float
    regulation: Regulation


@dataclass(frozen=True, slots=True)
class RailsReading:
    """What the supply says of all rails."""

    rails: tuple[RailReading, ...]


@dataclass(frozen=True, slots=True)
class DriveReading:
    """The drive signal on the oscilloscope: frequency (Hz), amplitude (V), phase of the drive to the carrier (deg)."""

    frequency_hz: float
    amplitude_v: float
    phase_deg: float
    looks: int


@dataclass(frozen=True, slots=True)
class RateReading:
    """The table has reached its rate: read-back (deg/s) and bench time (s)."""

    rate_deg_s: float
    t_s: float


@dataclass(frozen=True, slots=True)
class VvcSetting:
    """The DC level that the generator says it has set, V."""

    v_vc_v: float


@dataclass(frozen=True, slots=True)
class Window:
    """One averaging window: every reading, and the state of the bench read back at its end.

    `table_rate_deg_s` is the read-back of the table, `rails` that of the supply.
    """

    readings: tuple[Reading, ...]
    table_rate_deg_s: float
    rails: tuple[RailReading, ...]

    @property
    def mean_v(self) -> float:
        """Mean of the readings, V."""
        return math.fsum(reading.voltage_v for reading in self.readings) / len(self.readings)

    @property
    def std_v(self) -> float:
        """Sample standard deviation of the readings (n - 1), V."""
        mean = self.mean_v
        total = math.fsum((reading.voltage_v - mean) ** 2 for reading in self.readings)
        return math.sqrt(total / max(1, len(self.readings) - 1))


StepResult = Done | RailsReading | DriveReading | RateReading | VvcSetting | Window


@dataclass(frozen=True, slots=True)
class Outcome:
    """A plan came to its end. What it measured is in the points; this says in one line that it is all there."""

    summary: str


@dataclass(frozen=True, slots=True)
class Step:
    """What all steps have in common."""

    overhead_s: ClassVar[float] = 0.0
    """Estimate of the time that talking to the instruments takes, beside what physics asks for."""

    def describe(self) -> str:
        """Say what the step does, as the work instruction would."""
        raise NotImplementedError

    @property
    def key(self) -> str:
        """Name the step by its kind and parameters; the same in every run of the same plan."""
        return repr(self)

    @property
    def physical_s(self) -> float:
        """Least time the step needs on any bench (ramp, settling, averaging window), s."""
        return 0.0

    @property
    def duration_s(self) -> float:
        """Estimate of the time the step takes, s."""
        return self.physical_s + self.overhead_s


Plan = Generator[Step, StepResult, Outcome]


@dataclass(frozen=True, slots=True)
class Note(Step):
    """A heading of the work instruction; nothing is done."""

    text: str

    def describe(self) -> str:
        """Return the heading."""
        return self.text


@dataclass(frozen=True, slots=True)
class Settle(Step):
    """Wait for the bench to come to rest."""

    seconds: float
    reason: str

    def describe(self) -> str:
        """Say how long and why."""
        return f"wait {self.seconds:g} s: {self.reason}"

    @property
    def physical_s(self) -> float:
        """The wait itself, s."""
        return self.seconds


@dataclass(frozen=True, slots=True)
class ConfigureRail(Step):
    """Set level and current limit of one supply output, outputs off."""

    overhead_s: ClassVar[float] = 0.05

    rail: str
    output: str
    voltage_v: float
    current_limit_a: float

    def describe(self) -> str:
        """Name output, level and limit."""
        return f"supply {self.output} ({self.rail} rail): {self.voltage_v:+g} V, limit {self.current_limit_a:g} A"


@dataclass(frozen=True, slots=True)
class EnableSupply(Step):
    """Switch the supply outputs on."""

    overhead_s: ClassVar[float] = 0.05

    def describe(self) -> str:
        """Say so."""
        return "supply outputs on"


@dataclass(frozen=True, slots=True)
class DisableSupply(Step):
    """Switch the supply outputs off."""

    overhead_s: ClassVar[float] = 0.05

    def describe(self) -> str:
        """Say so."""
        return "supply outputs off"


@dataclass(frozen=True, slots=True)
class CheckRails(Step):
    """Read back rails and currents; each must be regulated in voltage and within `tolerance_v` of its level."""

    overhead_s: ClassVar[float] = 0.2

    rails: tuple[ConfigureRail, ...]
    tolerance_v: float

    def describe(self) -> str:
        """Name the rails and what is asked of them."""
        levels = ", ".join(f"{rail.voltage_v:+g} V" for rail in self.rails)
        return f"read back the rails: {levels} within {self.tolerance_v:g} V, constant voltage"


@dataclass(frozen=True, slots=True)
class ConfigureMeter(Step):
    """Select the multimeter's fixed DC range and integration time."""

    overhead_s: ClassVar[float] = 0.1

    range_v: float
    nplc: float

    def describe(self) -> str:
        """Name range and integration time."""
        return f"multimeter: DC {self.range_v:g} V range, {self.nplc:g} power-line cycles, autozero on"


@dataclass(frozen=True, slots=True)
class ConfigureGenerator(Step):
    """Select DC at `v_vc_v` into the high impedance of the PCB; the output stays off."""

    overhead_s: ClassVar[float] = 0.1

    v_vc_v: float

    def describe(self) -> str:
        """Name the level."""
        return f"generator: output off, DC {self.v_vc_v:g} V into high impedance"


@dataclass(frozen=True, slots=True)
class EnableVvc(Step):
    """Switch the generator's output on."""

    overhead_s: ClassVar[float] = 0.05

    def describe(self) -> str:
        """Say so."""
        return "generator output on"


@dataclass(frozen=True, slots=True)
class DisableVvc(Step):
    """Switch the generator's output off: the PCB pulls the V_Vc node to 0 V."""

    overhead_s: ClassVar[float] = 0.05

    def describe(self) -> str:
        """Say so."""
        return "generator output off, the PCB holds V_Vc at 0 V"


@dataclass(frozen=True, slots=True)
class SetVvc(Step):
    """Set V_Vc; the result is the level read back."""

    overhead_s: ClassVar[float] = 0.05

    v_vc_v: float

    def describe(self) -> str:
        """Name the level."""
        return f"V_Vc = {self.v_vc_v:+.6g} V"


@dataclass(frozen=True, slots=True)
class AwaitDrive(Step):
    """Look at the drive signal on the oscilloscope until the AGC has settled and everything lies in its window.

    Settled: two looks in a row differ by less than `amplitude_tolerance` (relative). Windows are (least, most).
    """

    overhead_s: ClassVar[float] = 1.0

    drive_channel: int
    carrier_channel: int
    frequency_hz: tuple[float, float]
    amplitude_v: tuple[float, float]
    phase_deg: tuple[float, float]
    amplitude_tolerance: float
    interval_s: float
    deadline_s: float

    def describe(self) -> str:
        """Name channel and windows."""
        low, high = self.frequency_hz
        return (
            f"oscilloscope: drive signal settled, {low:g}...{high:g} Hz, "
            f"{self.amplitude_v[0]:g}...{self.amplitude_v[1]:g} V, "
            f"{self.phase_deg[0]:g}...{self.phase_deg[1]:g} deg to the carrier"
        )


@dataclass(frozen=True, slots=True)
class EnableTable(Step):
    """Close the table's servo at zero demand."""

    overhead_s: ClassVar[float] = 0.1

    def describe(self) -> str:
        """Say so."""
        return "table enabled, at rest"


@dataclass(frozen=True, slots=True)
class DisableTable(Step):
    """Open the table's servo; the table is at rest."""

    overhead_s: ClassVar[float] = 0.1

    def describe(self) -> str:
        """Say so."""
        return "table disabled"


@dataclass(frozen=True, slots=True)
class SetRate(Step):
    """Start the table's ramp from `previous_deg_s` to `rate_deg_s`; :class:`AwaitRate` sees it through."""

    overhead_s: ClassVar[float] = 0.02

    rate_deg_s: float
    acceleration_deg_s2: float
    previous_deg_s: float

    def describe(self) -> str:
        """Name rate and acceleration."""
        return f"table to {self.rate_deg_s:+g} deg/s at {self.acceleration_deg_s2:g} deg/s^2"

    @property
    def ramp_s(self) -> float:
        """Length of the ramp, s."""
        return abs(self.rate_deg_s - self.previous_deg_s) / self.acceleration_deg_s2


@dataclass(frozen=True, slots=True)
class AwaitRate(Step):
    """Wait for the ramp, then until the table says at-rate *and* its read-back is within `tolerance_deg_s`."""

    overhead_s: ClassVar[float] = 0.1

    rate_deg_s: float
    ramp_s: float
    tolerance_deg_s: float
    deadline_s: float

    def describe(self) -> str:
        """Name rate and tolerance."""
        return f"table at {self.rate_deg_s:+g} deg/s, read-back within {self.tolerance_deg_s:g} deg/s"

    @property
    def physical_s(self) -> float:
        """The ramp, s."""
        return self.ramp_s


@dataclass(frozen=True, slots=True)
class Acquire(Step):
    """Take `samples` readings on a grid of `interval_s`; the window counts `samples * interval_s` seconds.

    `step` is the number of the paper's step. `rate_deg_s` is the rate that the point stands for: the table's rate, in
    step 4 the equivalent rate K_Vc V_Vc. `table_deg_s` is what the table must read back (within `tolerance_deg_s`) at
    the end, `rails` what the supply must (within `rail_tolerance_v`). `resolution_v` is that of one reading; `noise_v`
    is what the scatter of the readings is expected to be, (least, most), None when nothing is known of it.
    """

    step: int
    rate_deg_s: float
    v_vc_v: float
    table_deg_s: float
    tolerance_deg_s: float
    rails: tuple[ConfigureRail, ...]
    rail_tolerance_v: float
    samples: int
    interval_s: float
    resolution_v: float
    noise_v: tuple[float, float] | None = None

    def describe(self) -> str:
        """Name the point and the window."""
        return (
            f"average {self.samples} readings, one every {self.interval_s:g} s: "
            f"{self.rate_deg_s:+.6g} deg/s, V_Vc {self.v_vc_v:+.6g} V"
        )

    def point(self, window: Window) -> Point:
        """Return the point that `window` gives."""
        return Point(self.step, self.rate_deg_s, self.v_vc_v, window.mean_v, window.std_v, len(window.readings))

    @property
    def physical_s(self) -> float:
        """The averaging window, s."""
        return self.samples * self.interval_s


@dataclass(frozen=True, slots=True)
class VerifyZero(Acquire):
    """Take the zero once more when everything has been measured: a window that is compared, and is no point."""

    def describe(self) -> str:
        """Say what the window is for."""
        return f"the zero again, to compare: {self.samples} readings, one every {self.interval_s:g} s"
